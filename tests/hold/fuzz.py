"""Hostile and broken files by the hundred thousand: every one is read, or refused in a sentence, and nothing else.

Five kinds of file go through the readers of the command line: scenarios, tables (CSV), single certificates, whole
design files and reports. Changes know the formats (keys, units, cells, matrices), and where atheris is installed
libFuzzer's search comes first and keeps what reaches new branches of the readers; what it kept is changed further
without it, which is faster.

A finding is: any exception but the project's own, a traceback printed, more than 10 s of computing, a process of more
than 1 GiB or one that dies or hangs, a message that is empty, longer than 20 kB or steers a terminal, a file written or
removed outside the folder, a file read elsewhere, a program started, a connection, a text compiled, a pickle opened.

    python tests/hold/fuzz.py                       a million inputs, or an hour
    python tests/hold/fuzz.py --short               every kind for seconds
    python tests/hold/fuzz.py --kind csv --inputs 50000 --seed 7 --record csv.json
"""

from __future__ import annotations

import argparse
import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))

from fuzz_child import TOO_HEAVY, Board

SHARES = {"scenario": 0.102, "csv": 0.11, "certificate": 0.11, "design": 0.108, "report": 0.57}
"""Of all inputs: reading a scenario takes several times as long as reading a report."""
ROUNDS = 4
SEARCHED = 0.02
"""Of the time, for every kind's search by coverage; loading what is searched takes most of a minute besides."""
HANG = 60.0
"""Seconds after which a process that is still at one input is ended; 10 s of computing are told by itself."""
ASKED_OF_EACH = 100_000


@dataclass
class Tally:
    """What became of one kind."""

    inputs: int = 0
    guided: int = 0
    read: int = 0
    refused: int = 0
    coverage: int = 0
    memory: int = 0
    slowest: float = 0.0
    seconds: float = 0.0
    findings: dict[str, dict[str, Any]] = field(default_factory=dict)

    def add(self, told: dict[str, Any], *, guided: bool) -> None:
        """What a process told last."""
        self.inputs += told["inputs"]
        self.guided += told["inputs"] * guided
        self.read += told["outcomes"]["read"]
        self.refused += told["outcomes"]["refused"]
        self.memory = max(self.memory, told["memory"])
        self.slowest = max(self.slowest, told["slowest"][0])
        for one in told["findings"]:
            known = self.findings.setdefault(one["input"], {**one, "count": 0})
            known["count"] += one["count"]


def slice_of(
    kind: str, tally: Tally, inputs: int, seconds: float, seed: int, *, guided: bool, box: Path, keep: Path
) -> None:
    """Some inputs of a kind in a process of its own, watched from outside."""
    board = Board(keep / f"{kind}.board")
    board.put(0, b"", 0)
    state, log = keep / f"{kind}.state.json", keep / f"{kind}.log"
    state.unlink(missing_ok=True)
    engine = "guided" if guided else "plain"
    words = [kind, str(inputs), str(seconds), str(seed), engine, str(box / kind), str(keep)]
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "PYTHONWARNINGS": "ignore"}
    begun, ended = time.monotonic(), ""
    with (
        log.open("wb") as output,
        subprocess.Popen(
            [sys.executable, str(HERE / "fuzz_child.py"), *words], stdout=output, stderr=output, env=environment
        ) as process,
    ):
        try:
            while process.poll() is None:
                time.sleep(0.2)
                done, content, since, _ = board.get()
                if content and time.monotonic() - since > HANG:
                    ended = f"no answer within {HANG:.0f} s"
                    process.kill()
                elif not content and time.monotonic() - begun > seconds + 4 * HANG:
                    process.kill()
        except BaseException:
            process.send_signal(signal.SIGKILL)
            raise
    done, content, _, _ = board.get()
    told = json.loads(state.read_text()) if state.exists() else None
    if told is None:
        told = {"inputs": done, "outcomes": {"read": 0, "refused": 0}, "memory": 0, "slowest": [0.0], "findings": []}
    told["inputs"] = max(told["inputs"], done)
    if process.returncode not in (0, TOO_HEAVY) and not ended:
        ended = f"the process died ({process.returncode})"
    if ended:
        name = f"{kind}-{ended.partition('(')[0].replace(' ', '-')}-{seed}"
        (keep / f"{name}.bin").write_bytes(content)
        tail = log.read_bytes()[-2000:].decode(errors="replace")
        told["findings"].append({"what": ended, "place": "process", "count": 1, "details": tail, "input": name})
    tally.add(told, guided=guided)
    tally.seconds += time.monotonic() - begun
    found = [int(one) for one in re.findall(rb"cov: (\d+)", log.read_bytes())]
    tally.coverage = max([tally.coverage, *found])


def still_open(kind: str, name: str, keep: Path, box: Path) -> bool:
    """Whether an input that was a finding still is one, with the code as it is now."""
    words = [sys.executable, str(HERE / "fuzz_child.py"), "again", kind, str(keep / name), str(box / "again")]
    try:
        done = subprocess.run(
            words, capture_output=True, timeout=2 * HANG, env={**os.environ, "PYTHONWARNINGS": "ignore"}
        )
    except subprocess.TimeoutExpired:
        return True
    return done.returncode != 0


def main(arguments: list[str]) -> int:
    """Run, tell, record; 0 when nothing was found that is still open."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--inputs", type=int, default=1_000_000, help="of all kinds together")
    parser.add_argument("--seconds", type=float, default=3600.0, help="of all kinds together")
    parser.add_argument("--kind", choices=tuple(SHARES), action="append", help="only this kind; may be repeated")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--engine", choices=("both", "plain"), default="both", help="plain: no search, only chance")
    parser.add_argument("--keep", type=Path, help="folder for inputs that are findings; else a temporary one")
    parser.add_argument("--short", action="store_true", help="a few seconds for every kind")
    parser.add_argument("--record", type=Path, help="JSON file for the figures")
    given = parser.parse_args(arguments)
    kinds = tuple(given.kind or SHARES)
    rounds = 1 if given.short else ROUNDS
    inputs, seconds = (2000, 30.0) if given.short and given.inputs == 1_000_000 else (given.inputs, given.seconds)
    search = given.engine == "both" and find_spec("atheris") is not None
    if not search:
        print(
            "atheris is not used: inputs are changed by chance, no search keeps what reaches new branches", flush=True
        )
    begun = time.monotonic()
    whole = sum(SHARES[kind] for kind in kinds)
    tallies = {kind: Tally() for kind in kinds}
    stopped = False
    with tempfile.TemporaryDirectory(prefix="maglev-fuzz-") as temporary:
        box = Path(temporary)
        keep = given.keep or box / "keep"
        keep.mkdir(parents=True, exist_ok=True)
        try:
            for turn in range(10 * rounds):  # more than enough: a slice may end early
                for kind, tally in tallies.items():
                    wanted = int(inputs * SHARES[kind] / whole)
                    part = min(wanted - tally.inputs, -(-wanted // rounds))
                    left = seconds - (time.monotonic() - begun)
                    if part <= 0 or (left <= 0 and not given.short) or (turn and given.short):
                        continue
                    guided = search and turn == 0 and not given.short
                    turns = max(1, rounds + 1 - turn)
                    allowed = seconds / len(kinds) if given.short else max(2.0, 1.6 * left / turns / len(kinds))
                    allowed = SEARCHED * seconds if guided else allowed
                    slice_of(
                        kind, tally, part, allowed, given.seed + 1000 * turn, guided=guided, box=box, keep=keep
                    )  # fmt: skip
                    _progress(tallies, inputs, seconds, begun)
        except KeyboardInterrupt:
            stopped = True
        opened = {
            kind: [
                one
                for one in tally.findings.values()
                if still_open(
                    kind,
                    f"{one['input']}.bin" if one["place"] == "process" else f"{kind}-{one['input']}.bin",
                    keep,
                    box,
                )
            ]
            for kind, tally in tallies.items()
        }
    record = _record(
        tallies, opened, inputs, time.monotonic() - begun, search=search and not given.short, stopped=stopped
    )
    for figure in record["figures"]:
        print(f"{'met' if figure['met'] else 'NOT MET'}: {figure['what']}: {figure['reached']}")
    for kind, tally in tallies.items():
        for one in tally.findings.values():
            state = "OPEN" if one in opened[kind] else "mended since"
            print(f"{state}: {kind}: {one['count']} x {one['what'][:200]} | {one['place']} | {one['input']}")
    if given.record:
        given.record.write_text(json.dumps(record, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    return 0 if all(figure["met"] for figure in record["figures"]) else 1


def _progress(tallies: dict[str, Tally], inputs: int, seconds: float, begun: float) -> None:
    done = sum(tally.inputs for tally in tallies.values())
    found = sum(len(tally.findings) for tally in tallies.values())
    took = time.monotonic() - begun
    left = min(seconds - took, took * (inputs - done) / max(done, 1))
    parts = ", ".join(f"{kind} {tally.inputs}" for kind, tally in tallies.items())
    print(f"{done} of {inputs} ({parts}); {found} found; {max(left, 0.0):.0f} s left", flush=True)


def _record(
    tallies: dict[str, Tally], opened: dict[str, list[dict[str, Any]]], inputs: int, seconds: float, *, search: bool,
    stopped: bool
) -> dict[str, Any]:  # fmt: skip
    done = sum(tally.inputs for tally in tallies.values())
    found = sum(len(tally.findings) for tally in tallies.values())
    left = sum(map(len, opened.values()))
    heaviest = max(tally.memory for tally in tallies.values())
    slowest = max(tally.slowest for tally in tallies.values())
    asked = {kind: min(ASKED_OF_EACH, int(inputs * SHARES[kind])) for kind in tallies}
    figures = [
        {"what": "hostile inputs read or refused", "asked": f"{inputs}", "reached": f"{done}", "met": done >= inputs},
        {"what": "inputs that are findings still", "asked": "0", "reached": f"{left}", "met": left == 0},
        {"what": "largest memory of a reading process", "asked": "below 1024 MiB", "reached": f"{heaviest} MiB",
         "met": 0 < heaviest < 1024},
        {"what": "slowest input", "asked": "below 10 s", "reached": f"{slowest:.2f} s", "met": slowest < 10.0},
        *({"what": f"inputs of kind {kind}", "asked": f"{asked[kind]}", "reached": _reached(tally),
           "met": tally.inputs >= asked[kind]} for kind, tally in tallies.items()),
    ]  # fmt: skip
    notes = [
        "guided by coverage (atheris) at first" if search else "changed by chance, not guided by coverage",
        f"{found} places found in this run, {found - left} of them mended while it ran",
        *(f"{kind}: {one['what'][:160]} ({one['place']}), {one['count']} inputs, "
          f"{'open' if one in opened[kind] else 'mended'}"
          for kind, tally in tallies.items() for one in tally.findings.values()),
        *(["interrupted"] if stopped else []),
    ]  # fmt: skip
    title = "Hostile and broken files: read, or refused in a sentence"
    return {"part": "fuzz", "title": title, "seconds": round(seconds, 1), "figures": figures, "notes": notes}


def _reached(tally: Tally) -> str:
    how = f"{tally.guided} guided, {tally.coverage} branches"
    return f"{tally.inputs} ({tally.read} read, {tally.refused} refused; {how})"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
