"""Outputs whole or not at all, the long way: writers killed at every instruction, whole verbs killed at any moment.

python tests/hold/atomic.py                 all of it: some minutes
python tests/hold/atomic.py --short         the pieces only, at every third line: less than a minute
python tests/hold/atomic.py --record FILE   write what was found
"""

from __future__ import annotations

import argparse
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "unit")]

import atomic_moments as pieces
import test_atomic_folder as written

from maglev_ctrl.files import put_file
from maglev_ctrl.report import swap
from maglev_ctrl.report.folder import require_writable, write_whole

WAYS = ("exchange", "each", "fresh")
SEED = 20
VERBS: dict[str, tuple[list[str], int]] = {
    "new": (["new", "car", "--out", "OUT"], 10),
    "schema": (["schema", "--out", "OUT"], 10),
    "identify": (["identify", "scenarios/data/forced_oscillation.csv", "--out", "OUT"], 10),
    "export": (["export", "DESIGN/design.json", "--to", "c", "--option", "h2", "--out", "OUT"], 6),
    "simulate": (["simulate", "scenarios/paper/heave_surge.toml", "--option", "bare", "--out", "OUT"], 4),
    "report": (
        ["report", "scenarios/paper/heave_surge.toml", "--format", "json", "--format", "md", "--out", "OUT"],
        10,
    ),
}
"""Command lines, and how often each is killed."""


@dataclass(frozen=True, slots=True)
class Figure:
    """One thing that was asked for, and what came of it."""

    what: str
    asked: str
    reached: str
    met: bool


@contextmanager
def way_of(way: str) -> Iterator[None]:
    """Write in one of the ways, on a disk that settles at once, with nobody standing in the folder."""
    kept = swap._exchangeable, swap._stands_in, os.fsync
    if way == "each":
        swap._exchangeable = lambda _target: False
    swap._stands_in = lambda _target: False
    os.fsync = lambda _handle: None
    try:
        yield
    finally:
        swap._exchangeable, swap._stands_in, os.fsync = kept


def struck(way: str, folder: Path, *, kill: bool, opcodes: bool, step: int) -> Figure:
    """A writer stopped at each of its lines or instructions."""
    case = written.Case(way, folder)
    found, count = [], 0
    with way_of(way):
        case.prepare()
        last = pieces.moments(case.write, opcodes=opcodes)
        start = time.monotonic()
        for at in range(1, last + 1, step):
            count += 1
            case.prepare()
            if kill:
                pieces.killed(case.write, at, opcodes=opcodes)
                left = case.state()
                mixed = any(left[name] not in (written.OLD.get(name), written.NEW.get(name)) for name in left)
                if mixed if way == "each" else left not in (case.before, case.after):
                    found.append(f"{at}: neither")
                require_writable(case.folder)
            else:
                with suppress(KeyboardInterrupt), pieces.blow(at, pieces.interrupt, opcodes=opcodes):
                    case.write()
            if case.state() not in (case.before, case.after):
                found.append(f"{at}: neither old nor new")
            if case.beside():
                found.append(f"{at}: left behind {case.beside()}")
            _tell(count, (last + step - 1) // step, start)
    how = f"{'killed' if kill else 'interrupted'} at {count} {'instructions' if opcodes else 'lines'}"
    return Figure(f"{way}: {how}", "old or new, nothing left", "; ".join(found[:3]) or "each of them", not found)


def _tell(done: int, of: int, start: float) -> None:
    if done % 200 == 0:
        left = (time.monotonic() - start) / done * (of - done)
        print(f"    {done} of {of}, {left:.0f} s left", file=sys.stderr, flush=True)


def refused(way: str, folder: Path) -> Figure:
    """Every call refused, once and from then on, for each reason."""
    found = []
    with way_of(way):
        for number in pieces.NUMBERS:
            for ever in (False, True) if number > 0 else (False,):
                found += written.faults_of_refusals(written.Case(way, folder), number, ever=ever)
    return Figure(
        f"{way}: each call refused", "old or new, nothing left", "; ".join(found[:3]) or "each of them", not found
    )


def two_writers(folder: Path, rounds: int) -> Figure:
    """Two processes write one folder while a third looks, through a folder it has opened."""
    names = ("a", "b", "c", "d")
    contents = [{name: f"{name} of {who}".encode() * 500 for name in names} for who in (1, 2)]
    target = folder / "results" / "out"
    write_whole(contents[0], target)
    children = []
    for made in contents:
        child = os.fork()
        if child == 0:
            status = 1
            with suppress(BaseException):
                for _ in range(rounds):
                    write_whole(made, target)
                status = 0
            os._exit(status)
        children.append(child)
    seen, mixed, alive = 0, 0, set(children)
    failed = 0
    while alive:
        for child in list(alive):
            ended, status = os.waitpid(child, os.WNOHANG)
            if ended:
                alive.discard(child)
                failed += status != 0
        with suppress(OSError):
            handle = os.open(target, os.O_RDONLY)
            try:
                found = {}
                for name in names:
                    one = os.open(name, os.O_RDONLY, dir_fd=handle)
                    with os.fdopen(one, "rb") as stream:
                        found[name] = stream.read()
                seen += 1
                mixed += found not in contents
            finally:
                os.close(handle)
    left = pieces.state(target) in contents and sorted(one.name for one in target.parent.iterdir()) == ["out"]
    met = not failed and not mixed and left
    reached = (
        f"{seen} looks, {mixed} mixed; {failed} writers failed; the last state is {'one of both' if left else 'mixed'}"
    )
    return Figure(f"two writers, {rounds} times each", "one of both, at every look", reached, met)


def verb(name: str, folder: Path, design: Path, chance: random.Random) -> Figure:
    """A whole command killed (and interrupted) at moments of chance, half of them while it writes."""
    words, times = VERBS[name]
    out = folder / name / "out"
    command = [sys.executable, "-m", "maglev_ctrl"]
    command += [{"OUT": str(out), "DESIGN/design.json": str(design)}.get(word, word) for word in words]
    out.mkdir(parents=True)
    start = time.monotonic()
    _run(command)
    usual = time.monotonic() - start
    known = [set(pieces.state(out))]
    found, stopped, aimed = [], 0, 0
    for turn in range(times):
        shutil.rmtree(out)
        out.mkdir()
        (out / "notes.txt").write_text("mine", encoding="utf-8")
        process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        if turn % 2:
            aimed += _wait_for_writing(process, out)
            time.sleep(chance.uniform(0.0, 0.004))
        else:
            with suppress(subprocess.TimeoutExpired):
                process.wait(chance.uniform(0.0, usual))
        process.send_signal(signal.SIGKILL if turn % 4 < 2 else signal.SIGINT)
        stopped += process.wait() not in (0, 1)
        left = set(pieces.state(out)) - {"notes.txt"}
        whole = [left <= {one for one in left if one.startswith(".")}, left == known[0]]
        if not any(whole) or not (out / "notes.txt").exists():
            found.append(f"turn {turn}: {sorted(left)}")
        require_writable(out)
        hidden = [one.name for one in out.parent.iterdir() if one != out]
        if hidden:
            found.append(f"turn {turn}: left behind {hidden}")
        print(f"    {name} {turn + 1} of {times}, {usual * (times - turn - 1):.0f} s left at most", file=sys.stderr)
    reached = "; ".join(found[:3]) or f"{stopped} of {times} were stopped, {aimed} of them while writing"
    return Figure(
        f"{name}, killed and interrupted {times} times", "nothing or all, other files kept", reached, not found
    )


def _wait_for_writing(process: subprocess.Popen[bytes], out: Path) -> bool:
    """Wait until something passing stands beside or in the folder, or the process has ended."""
    while process.poll() is None:
        for place in (out.parent, out):
            with suppress(OSError):
                if any(".maglev-ctrl-" in one.name and one.name != ".maglev-ctrl" for one in place.iterdir()):
                    return True
        time.sleep(0.0005)
    return False


def _run(command: list[str]) -> None:
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    if done.returncode not in (0, 1):
        raise SystemExit(f"{' '.join(command)}: {done.stderr.strip()}")


def record(file: Path, figures: list[Figure], notes: list[str], seconds: float) -> None:
    """Write what was found so far."""
    text = {
        "part": "atomic", "title": "Outputs whole or not at all", "seconds": round(seconds, 1),
        "figures": [asdict(one) for one in figures],
        "notes": [
            *notes,
            "A folder that is exchanged in one step of the system is old or new at every moment. Where entries are"
            " moved one by one (somebody stands in the folder, or the system has no such step), a process killed"
            " between two of them leaves a mixture until the next run into this folder takes it back.",
        ],
    }  # fmt: skip
    put_file(file, (json.dumps(text, indent=1) + "\n").encode())


def main(arguments: list[str]) -> int:
    """Stop writers everywhere; 0 where every one left the old or the new."""
    parser = argparse.ArgumentParser(description="Outputs whole or not at all.")
    parser.add_argument("--short", action="store_true")
    parser.add_argument("--record", type=Path, metavar="FILE")
    asked = parser.parse_args(arguments)
    warnings.simplefilter("ignore", ResourceWarning)  # an interrupt between opening and `with`
    start = time.monotonic()
    figures: list[Figure] = []
    notes: list[str] = []

    def told(one: Figure) -> None:
        figures.append(one)
        print(f"{'met    ' if one.met else 'NOT MET'} {one.what}: {one.reached}", flush=True)
        if asked.record is not None:  # what is interrupted has recorded what it did
            record(asked.record, figures, notes, time.monotonic() - start)

    with tempfile.TemporaryDirectory(prefix="maglev-ctrl-atomic-") as name:
        folder = Path(name)
        steps: list[Callable[[], Figure]] = []
        for way in WAYS:
            if way == "exchange" and swap._exchanger() is None:
                notes.append("The exchange of two folders is NOT EVALUATED: this system has no such step.")
                continue
            for kill in (True, False):
                for opcodes in (False,) if asked.short else (False, True):
                    step = 3 if asked.short else 4 if opcodes and kill else 1
                    steps.append(
                        lambda way=way, kill=kill, opcodes=opcodes, step=step: struck(  # type: ignore[misc]
                            way, folder / "pieces", kill=kill, opcodes=opcodes, step=step
                        )
                    )
            steps.append(lambda way=way: refused(way, folder / "pieces"))  # type: ignore[misc]
        steps.append(lambda: two_writers(folder / "two", 30 if asked.short else 300))
        for one in steps:
            told(one())
        if not asked.short:
            chance = random.Random(SEED)
            design = folder / "design" / "design.json"
            _run([sys.executable, "-m", "maglev_ctrl", "design", "scenarios/design/hinf_secondary.toml", "--quiet",
                  "--out", str(design.parent)])  # fmt: skip
            for verb_name in VERBS:
                told(verb(verb_name, folder / "verbs", design, chance))
    return 0 if all(one.met for one in figures) else 1


if __name__ == "__main__":
    try:
        sys.exit(main(sys.argv[1:]))
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        sys.exit(130)
