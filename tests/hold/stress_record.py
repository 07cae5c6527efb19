"""What one question of the stress set came to: right, unresolved or wrong."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from stress_systems import Sample

RIGHT, UNRESOLVED, WRONG = "right", "unresolved", "wrong"
Family = Callable[[np.random.Generator], Iterator["Outcome"]]


@dataclass(frozen=True, slots=True)
class Outcome:
    """`engine` asked about `family`; `easy` where a decision is owed; `told` what it said and what is true."""

    engine: str
    family: str
    verdict: str
    easy: bool
    told: str = ""


def decision(engine: str, sample: Sample, said: int | None) -> Outcome:
    """A verdict on stability: -1 stable, 1 unstable, None undecided; held against the sample's truth.

    Where the rightmost eigenvalue lies on the axis itself (truth 0) every decision is wrong.
    """
    verdict = UNRESOLVED if said is None else (RIGHT if said == sample.truth else WRONG)
    return Outcome(engine, sample.family, verdict, sample.easy, f"said {said}, truth {sample.truth}")


def figure(engine: str, family: str, said: float | None, truth: float, *, within: float, easy: bool) -> Outcome:
    """A number, None where the engine would not give one; right within the relative error `within`."""
    if said is None or np.isnan(said):
        return Outcome(engine, family, UNRESOLVED, easy, f"no answer, truth {truth:.17g}")
    same = said == truth or (np.isfinite(truth) and abs(said - truth) <= within * abs(truth))
    return Outcome(engine, family, RIGHT if same else WRONG, easy, f"said {said:.17g}, truth {truth:.17g}")
