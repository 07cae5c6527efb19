"""NSGA-II over one option's design variables: the same method, budget and seed for every option.

Deb, Pratap, Agarwal & Meyarivan, IEEE Trans. Evolutionary Computation 6 (2002) 182: non-dominated sorting, crowding
distance, simulated binary crossover, polynomial mutation; of two candidates that miss requirements the one that misses
less is better, and one that misses none is better than any that does.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final, Protocol

import numpy as np

from maglev_ctrl.arrays import FloatArray, read_only

NOWHERE: Final = 1e9
"""Objectives of a candidate without any: they are never compared, for it misses requirements."""
Tell = Callable[[int, int], None]


class Assessed(Protocol):
    """What the search has to know of a candidate: objectives (smaller is better, NaN: none) and what it misses."""

    @property
    def score(self) -> FloatArray:
        """Objectives (k,), each to be made small; NaN where there is none."""

    @property
    def total(self) -> float:
        """By how much requirements are missed; 0: none is."""


@dataclass(frozen=True, eq=False, slots=True)
class Search:
    """Every candidate that was assessed, in order: `places` (n, v) on the scale searched on.

    `population`: positions of the last generation's survivors. `stopped`: "generations" or "time limit".
    """

    places: FloatArray
    population: tuple[int, ...]
    generations: int
    stopped: str
    seconds: float


def search(
    assess: Callable[[tuple[float, ...]], Assessed],
    *,
    upper: Sequence[float],
    integral: Sequence[bool],
    objectives: int,
    population: int,
    generations: int,
    seed: int,
    start: Sequence[float] | None = None,
    time_limit: float | None = None,
    tell: Tell = lambda generation, evaluations: None,
) -> Search:
    """Breed candidates; the same seed gives the same candidates.

    Parameters
    ----------
    assess : of a place; called once for every distinct place, in the order of `Search.places`
    upper : (v,) largest place of each variable; the smallest is 0. A whole number for those that are `integral`
    objectives : how many there are
    start : a place that is among the first generation
    time_limit : s; looked at before every candidate
    tell : told the generation and the candidates assessed so far

    Raises
    ------
    ValueError : no variable, or fewer than four candidates of a generation

    Examples
    --------
    >>> class One:
    ...     def __init__(self, x): self.score, self.total = np.array([x[0] ** 2, (x[0] - 0.5) ** 2]), 0.0
    >>> found = search(One, upper=[1.0], integral=[False], objectives=2, population=8, generations=12, seed=1)
    >>> kept = found.places[list(found.population), 0]
    >>> bool(np.all(kept < 0.55)), found.stopped
    (True, 'generations')
    """
    if not len(upper) or population < 4:
        raise ValueError(f"expected a variable and four candidates or more, got {len(upper)} and {population}")
    started = time.perf_counter()
    algorithm = _algorithm(upper, integral, objectives, population, seed, start)
    known: dict[tuple[float, ...], int] = {}
    found: list[Assessed] = []
    survivors: tuple[int, ...] = ()
    done, stopped = 0, "generations"
    for generation in range(generations):
        bred = algorithm.ask()
        rows: list[int] = []
        for place in _rounded(bred.get("X"), integral):
            if place not in known:
                if time_limit is not None and found and time.perf_counter() - started > time_limit:
                    stopped = "time limit"
                    break
                known[place] = len(found)
                found.append(assess(place))
            rows.append(known[place])
        if stopped == "time limit":
            break
        bred.set("F", np.array([np.nan_to_num(found[i].score, nan=NOWHERE) for i in rows]))
        bred.set("G", np.array([[found[i].total] for i in rows]))
        bred.set("row", np.array(rows))
        algorithm.evaluator.eval(_given(algorithm, bred), bred, algorithm=algorithm)
        algorithm.tell(infills=bred)
        survivors = tuple(int(i) for i in dict.fromkeys(algorithm.pop.get("row")))
        done = generation + 1
        tell(done, len(found))
    return Search(
        places=read_only(np.array(list(known)).reshape(len(known), len(upper)), name="places"),
        population=survivors or tuple(range(len(found))),
        generations=done,
        stopped=stopped,
        seconds=time.perf_counter() - started,
    )


def _algorithm(
    upper: Sequence[float], integral: Sequence[bool], objectives: int, population: int, seed: int,
    start: Sequence[float] | None,
) -> Any:  # fmt: skip
    """NSGA-II of pymoo, ready to be asked."""
    from pymoo.algorithms.moo.nsga2 import NSGA2
    from pymoo.core.problem import Problem
    from pymoo.core.termination import NoTermination

    # A whole number is what a place rounds to: every one gets a cell of its own, the outermost too.
    low = np.array([-0.4999 if whole else 0.0 for whole in integral])
    high = np.array([u + 0.4999 if whole else u for u, whole in zip(upper, integral, strict=True)])
    first = low + _latin_hypercube(population, len(upper), seed) * (high - low)
    if start is not None:
        first[0] = np.clip(np.asarray(start, dtype=float), low, high)
    problem = Problem(n_var=len(upper), n_obj=objectives, n_ieq_constr=1, xl=low, xu=high)
    algorithm = NSGA2(pop_size=population, sampling=first)
    algorithm.setup(problem, termination=NoTermination(), seed=seed, verbose=False)
    return algorithm


def _given(algorithm: Any, bred: Any) -> Any:
    """The problem whose answers were found outside."""
    from pymoo.problems.static import StaticProblem

    return StaticProblem(algorithm.problem, F=bred.get("F"), G=bred.get("G"))


def _rounded(places: FloatArray, integral: Sequence[bool]) -> list[tuple[float, ...]]:
    return [
        tuple(float(round(x)) if whole else float(x) for x, whole in zip(row, integral, strict=True)) for row in places
    ]


def _latin_hypercube(count: int, size: int, seed: int) -> FloatArray:
    """(count, size) in 0 .. 1: in every variable one candidate in each of `count` equal cells."""
    draw = np.random.default_rng(seed)
    cells = np.column_stack([draw.permutation(count) for _ in range(size)])
    return np.asarray((cells + draw.random((count, size))) / count)


def non_dominated(score: FloatArray) -> tuple[int, ...]:
    """Rows that no other row betters in one column without losing in another; of equal rows the first.

    Examples
    --------
    >>> non_dominated(np.array([[1.0, 2.0], [2.0, 1.0], [2.0, 2.0], [1.0, 2.0]]))
    (0, 1)
    """
    kept = []
    for i, row in enumerate(score):
        no_worse = np.all(score <= row, axis=1)
        better = no_worse & np.any(score < row, axis=1)
        if not np.any(better) and not np.any(np.all(score[:i] == row, axis=1)):
            kept.append(i)
    return tuple(kept)
