"""One kind's inputs in a process of its own: makes them, reads them, notes what must not happen.

The parent sees in a mapped file which input is being read since when, so that nothing is lost with the process.
"""

from __future__ import annotations

import gc
import hashlib
import json
import mmap
import os
import random
import resource
import struct
import sys
import time
from pathlib import Path
from typing import Any

MOST = 1 << 17
"""Bytes of a mutated input."""
FULL = 5000
"""Inputs of a kind from which on the classics, some of which take a second, are among them."""
SLOW, HEAVY = 10.0, 2**30
"""Seconds of one input, and bytes a process may take."""
TOO_HEAVY, INTERRUPTED = 77, 78
_HEAD = struct.Struct("<QQdQ")  # inputs done, size of the one that is read, when it was begun, findings


class Board:
    """What the parent reads: how far the process is, and the input it is at."""

    SIZE = 1 << 23

    def __init__(self, path: Path) -> None:
        if not path.exists() or path.stat().st_size != self.SIZE:
            path.write_bytes(bytes(self.SIZE))
        with path.open("r+b") as stream:
            self._map = mmap.mmap(stream.fileno(), self.SIZE)

    def put(self, done: int, content: bytes, findings: int) -> None:
        """The input that is read from now on."""
        held = content[: self.SIZE - _HEAD.size]
        self._map[_HEAD.size : _HEAD.size + len(held)] = held
        _HEAD.pack_into(self._map, 0, done, len(held), time.monotonic(), findings)

    def get(self) -> tuple[int, bytes, float, int]:
        """Inputs done, the input that is read, since when, findings so far."""
        done, size, begun, findings = _HEAD.unpack_from(self._map, 0)
        return done, bytes(self._map[_HEAD.size : _HEAD.size + size]), begun, findings


class Child:
    """Counts, times and judges; findings of one place are told once, with their number."""

    def __init__(self, kind: str, folder: Path, keep: Path, seconds: float) -> None:
        from fuzz_targets import Target
        from fuzz_watch import Watch

        folder.mkdir(parents=True, exist_ok=True)
        keep.mkdir(parents=True, exist_ok=True)
        self.kind, self.keep = kind, keep
        self.target = Target(kind, folder)
        self.board = Board(keep / f"{kind}.board")
        self.state = keep / f"{kind}.state.json"
        self.done = 0
        self.slowest = (0.0, "")
        self.found: dict[str, dict[str, Any]] = {}
        self._warm()
        self.end = time.monotonic() + seconds
        gc.collect()
        gc.freeze()
        self.watch = Watch(folder).install()

    def _warm(self) -> None:
        """Everything that is loaded late is loaded before the watch begins."""
        from fuzz_seeds import seeds

        for k, seed in enumerate(dict.fromkeys(seeds(self.kind))):
            self.target(seed)
            if k < 3:
                self.target._read()
                self.target._command()
        self.target.outcomes = dict.fromkeys(self.target.outcomes, 0)

    def one(self, content: bytes) -> None:
        """Read one input."""
        self.board.put(self.done, content, len(self.found))
        begun = time.process_time()
        self.watch.active = True
        finding = self.target(content)
        self.watch.active = False
        took = time.process_time() - begun
        self.done += 1
        self.board.put(self.done, b"", len(self.found))  # what follows is no reading: the next input is being made
        if finding is not None:
            self.note(content, finding.what, finding.place, finding.details)
        for breach in self.watch.breaches:
            self.note(content, breach, "audit", "")
        self.watch.breaches.clear()
        if took > self.slowest[0]:
            self.slowest = (took, hashlib.sha256(content).hexdigest()[:16])
            (self.keep / f"{self.kind}.slowest").write_bytes(content)
        if took > SLOW:
            self.note(content, f"{took:.1f} s", "slow", "")
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
        if memory > HEAVY:
            self.note(content, f"{memory / 2**20:.0f} MiB resident", "memory", "")
            self.tell()
            os._exit(TOO_HEAVY)
        over = time.monotonic() > self.end
        if over or self.done % 512 == 0:
            self.tell()
        if over:
            os._exit(0)

    def note(self, content: bytes, what: str, place: str, details: str) -> None:
        """A finding: its input is kept, once for every place."""
        key = hashlib.sha256(f"{what.split(':')[0]} {place}".encode()).hexdigest()[:12]
        known = self.found.setdefault(key, {"what": what, "place": place, "count": 0, "details": details, "input": key})
        known["count"] += 1
        file = self.keep / f"{self.kind}-{key}.bin"
        if known["count"] == 1 or len(content) < file.stat().st_size:
            file.write_bytes(content)
            known["what"], known["details"] = what, details

    def tell(self) -> None:
        """Leave the state for the parent."""
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
        told = {
            "inputs": self.done, "outcomes": self.target.outcomes, "slowest": self.slowest, "memory": memory,
            "findings": list(self.found.values()),
        }  # fmt: skip
        beside = self.state.with_suffix(".part")
        beside.write_text(json.dumps(told, default=str))
        beside.replace(self.state)
        self.board.put(self.done, b"", len(self.found))


def run_plain(child: Child, inputs: int, seed: int, corpus: Path) -> None:
    """The classics, then mutations of the seeds, of what a search kept, and of what came of them."""
    from fuzz_mutation import crossed, mutated
    from fuzz_seeds import classics, seeds

    rng = random.Random(seed)
    pool = seeds(child.kind)
    first = len(pool)
    if corpus.exists():
        pool += [one.read_bytes() for one in sorted(corpus.iterdir()) if one.stat().st_size < 8000][:300]
    for content in classics(child.kind) if inputs >= FULL else ():
        child.one(content)
    while child.done < inputs:
        parent = rng.choice(pool)
        content = mutated(child.kind, parent, rng, most=MOST)
        if rng.random() < 0.03:
            content = crossed(content, rng.choice(pool), rng, most=MOST)
        before = child.target.outcomes["read"]
        child.one(content)
        if child.target.outcomes["read"] > before and len(content) < 30_000:
            if len(pool) < 400:
                pool.append(content)
            else:
                pool[rng.randrange(first, len(pool))] = content


def run_guided(child: Child, inputs: int, seed: int, corpus: Path) -> None:
    """Mutations that keep what reaches new branches: libFuzzer's search with the same changes."""
    import atheris
    from fuzz_mutation import crossed, mutated
    from fuzz_seeds import seeds

    corpus.mkdir(parents=True, exist_ok=True)
    for k, content in enumerate(seeds(child.kind)):
        (corpus / f"seed{k}").write_bytes(content)
    pool = seeds(child.kind)

    def mutator(data: bytes, most: int, number: int) -> bytes:
        rng = random.Random(number)
        if rng.random() < 0.1:
            return bytes(atheris.Mutate(data, min(most, MOST)))
        if rng.random() < 0.5:
            data = rng.choice(pool)  # what libFuzzer keeps drifts towards what is refused early
        return mutated(child.kind, data, rng, most=most)

    def crossover(one: bytes, other: bytes, most: int, number: int) -> bytes:
        return crossed(one, other, random.Random(number), most=most)

    def read(data: bytes) -> None:
        if child.done >= inputs:
            child.tell()
            os._exit(0)
        child.one(data)

    options = [
        "fuzz", str(corpus), f"-seed={seed}", f"-max_len={MOST}", "-len_control=0", "-rss_limit_mb=0", "-timeout=0",
        "-runs=-1", "-print_final_stats=0", "-handle_segv=0", "-reload=0", "-use_value_profile=0",
    ]  # fmt: skip
    atheris.Setup(options, read, custom_mutator=mutator, custom_crossover=crossover)
    atheris.Fuzz()


def again(kind: str, file: str, folder: str) -> int:
    """One kept input once more, both ways: 0 where it is no finding any longer."""
    child = Child(kind, Path(folder), Path(folder) / "keep", 1e9)
    content = Path(file).read_bytes()
    child.one(content)
    child.watch.active = False
    found = child.target._command()
    return 1 if child.found or found is not None else 0


def main(arguments: list[str]) -> int:
    """The process of one kind: KIND INPUTS SECONDS SEED ENGINE FOLDER KEEP; or one input: again KIND FILE FOLDER."""
    if arguments[0] == "again":
        return again(*arguments[1:])
    kind, inputs, seconds, seed, engine, folder, keep = arguments
    resource.setrlimit(resource.RLIMIT_AS, (6 * 2**30, 6 * 2**30))
    if engine == "guided":
        import atheris

        with atheris.instrument_imports(include=[
            "maglev_ctrl.scenario", "maglev_ctrl.proofs", "maglev_ctrl.report.reading", "maglev_ctrl.report.difference",
            "maglev_ctrl.report.difference_sections", "maglev_ctrl.study.design.document",
            "maglev_ctrl.forces.identification", "maglev_ctrl.forces.sine_fit", "maglev_ctrl.forces.tabulated",
        ]):  # fmt: skip
            import fuzz_targets  # noqa: F401
    child = Child(kind, Path(folder), Path(keep), float(seconds))
    run = run_guided if engine == "guided" else run_plain
    run(child, int(inputs), int(seed), Path(keep) / f"{kind}-corpus")
    child.tell()
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
