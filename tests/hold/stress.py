"""The stress set: thousands of questions with known answers, asked of every engine that gives a verdict.

    python tests/hold/stress.py [--short] [--seed N] [--record FILE]

Right, or unresolved, never wrong; and where a good method owes a decision, it is decided. Any wrong answer is shown
with its recipe (family, seed, number), by which it can be asked again.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).resolve().parent))

import stress_designs
import stress_invariance
import stress_linear
import stress_loops
import stress_periodic
from stress_record import RIGHT, UNRESOLVED, WRONG, Family, Outcome

GROUPS: tuple[tuple[str, tuple[Family, ...], int], ...] = (
    ("modes, inertia, exact counts", stress_linear.FAMILIES, 300),
    ("loops, margins, norms", stress_loops.FAMILIES, 300),
    ("Floquet, radii, maps, boundaries", stress_periodic.FAMILIES, 120),
    ("proofs and designs", stress_designs.FAMILIES, 60),
)
"""Title, families, rounds: each family is asked once a round."""
SHORT = 0.05
OWED, OWED_SHORT = 0.98, 0.95
"""Share of the questions with a well-conditioned answer that has to be decided; of few questions one weighs more."""


def asked(family: Family, seed: int, number: int) -> Iterator[Outcome]:
    """The outcomes of one question; an exception is an answer withheld, told as what it is."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            yield from family(np.random.default_rng([seed, number]))
    except Exception as fault:  # an engine that dies decides nothing, and it should not die
        where = traceback.extract_tb(fault.__traceback__)[-1]
        told = f"{type(fault).__name__}: {fault} ({Path(where.filename).name}:{where.lineno})"
        yield Outcome("crash", family.__name__, UNRESOLVED, True, told)


def main(arguments: list[str]) -> int:
    """Ask everything, tell what came of it; 0 where nothing is wrong and what is owed is decided."""
    parser = argparse.ArgumentParser(description="the stress set")
    parser.add_argument("--short", action="store_true", help="a twentieth of it")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--record", type=Path)
    options = parser.parse_args(arguments)
    started = time.perf_counter()
    rounds = [(title, families, max(1, int(n * (SHORT if options.short else 1.0)))) for title, families, n in GROUPS]
    total, done = sum(len(families) * n for _, families, n in rounds), 0
    share = OWED_SHORT if options.short else OWED
    figures, notes = [], []
    crashes = 0
    for title, families, count in rounds:
        verdicts, owed, decided = Counter[str](), 0, 0
        for k in range(count):
            for family in families:
                for one in asked(family, options.seed, k):
                    verdicts[one.verdict] += 1
                    owed += one.easy
                    decided += one.easy and one.verdict != UNRESOLVED
                    if one.verdict == WRONG or one.engine == "crash":
                        crashes += one.engine == "crash"
                        words = f"{one.verdict}: {one.engine}, {one.family}, seed {options.seed}, {k}: {one.told}"
                        print(words, flush=True)
                        if len(notes) < 40:
                            notes.append(words)
                done += 1
            if k % 20 == 19 or k == count - 1:
                left = (time.perf_counter() - started) / done * (total - done)
                print(f"{title}: {k + 1} of {count}, {dict(verdicts)}, about {left:.0f} s left", flush=True)
        figures += [
            figure(f"wrong verdicts: {title}", "0", f"{verdicts[WRONG]} of {verdicts.total()}", not verdicts[WRONG]),
            figure(
                f"decided where a decision is owed: {title}", f"at least {share:.0%}",
                f"{decided} of {owed} ({decided / max(owed, 1):.2%}); of all {verdicts.total()}: "
                f"{verdicts[RIGHT]} right, {verdicts[UNRESOLVED]} unresolved", decided >= share * owed,
            ),
        ]  # fmt: skip
    figures += stress_invariance.figures(short=options.short)
    figures.append(figure("engines that raise instead of answering", "0", f"{crashes}", not crashes))
    record = {
        "part": "stress", "title": "Numerical honesty: a stress set with known answers",
        "seconds": round(time.perf_counter() - started, 1), "figures": figures,
        "notes": [f"seed {options.seed}; truth in whole numbers, fractions or 50 digits, shared with none", *notes],
    }  # fmt: skip
    for one in figures:
        print(f"{'met ' if one['met'] else 'NOT '} {one['what']}: asked {one['asked']}, reached {one['reached']}")
    if options.record:
        options.record.write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")
    return 0 if all(one["met"] for one in figures) else 1


def figure(what: str, asked_for: str, reached: str, met: bool) -> dict[str, str | bool]:
    """One line of the record."""
    return {"what": what, "asked": asked_for, "reached": reached, "met": bool(met)}


if __name__ == "__main__":
    try:
        sys.exit(main(sys.argv[1:]))
    except KeyboardInterrupt:
        sys.exit(130)
