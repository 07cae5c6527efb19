"""Who ranks where, and how firmly: distances to the ideal point of all fronts, limits and weights changed.

Yoon & Hwang's ideal point: every objective in units of its range over all fronts, the distance to the best of all. The
sensitivities need no new search: fronts are formed anew from the candidates of the searches, under the changed limit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.scenario import RequirementRecord
from maglev_ctrl.study.tuning.evaluate import violation
from maglev_ctrl.study.tuning.knee import knee
from maglev_ctrl.study.tuning.option import OptionSearch
from maglev_ctrl.study.tuning.records import ObjectiveAxis, RankedOption, RankingShift
from maglev_ctrl.study.tuning.search import non_dominated

LIMIT_FACTORS: Final = (0.8, 0.9, 1.1, 1.25)
WEIGHT_FACTORS: Final = (0.5, 2.0)


@dataclass(frozen=True, eq=False, slots=True)
class Contender:
    """One option as the ranking sees it: its front (p, k), smaller better, and the row chosen; none where it misses."""

    front: FloatArray
    chosen: int


def distances(contenders: Sequence[Contender], weights: Sequence[float] | FloatArray) -> FloatArray:
    """Distance of each chosen point to the ideal point of all fronts, in ranges; inf for one without a front.

    Objectives in which all fronts agree count nothing. Weights multiply squared distances; their sum is scaled to one.

    Examples
    --------
    >>> one = Contender(np.array([[0.0, 2.0], [1.0, 0.0]]), 1)
    >>> other = Contender(np.array([[2.0, 1.0]]), 0)
    >>> np.round(distances([one, other], [1.0, 1.0]), 4)
    array([0.3536, 0.7906])
    """
    fronts = [one.front for one in contenders if len(one.front)]
    if not fronts:
        return np.full(len(contenders), np.inf)
    union = np.vstack(fronts)
    ideal, extent = np.min(union, axis=0), np.ptp(union, axis=0)
    share = np.asarray(weights, dtype=float) / float(np.sum(weights))
    found = []
    for one in contenders:
        if not len(one.front):
            found.append(np.inf)
            continue
        step = np.divide(one.front[one.chosen] - ideal, extent, out=np.zeros(len(ideal)), where=extent > 0.0)
        found.append(float(np.sqrt(share @ step**2)))
    return np.array(found)


def ranked(searches: Sequence[OptionSearch]) -> tuple[RankedOption, ...]:
    """The options, best first; those that miss a requirement after all others, by how much they miss."""
    contenders = [_as_tuned(one) for one in searches]
    far = distances(contenders, np.ones(_size(searches)))
    order = _order(searches, far)
    found: list[RankedOption] = []
    for place, i in enumerate(order):
        record = searches[i].record
        found.append(RankedOption(record.option, record.label, place + 1, float(far[i]), searches[i].misses))
    return tuple(found)


def shifts(
    searches: Sequence[OptionSearch],
    requirements: Sequence[RequirementRecord],
    objectives: Sequence[ObjectiveAxis],
    *,
    choose: str,
) -> tuple[RankingShift, ...]:
    """The ranking under every changed limit and weight.

    Parameters
    ----------
    requirements : those judged in the loop, in the order of `OptionSearch.values`; a limit of zero has no per cent
    choose : "knee", or the objective whose best point is taken
    """
    base = _order(searches, distances([_as_tuned(one) for one in searches], np.ones(len(objectives))))
    names = [axis.name for axis in objectives]
    found: list[RankingShift] = []
    for j, one in enumerate(requirements):
        for factor in LIMIT_FACTORS:
            if one.limit == 0.0:
                continue
            changed = [_contender(s, requirements, j, factor, names.index(choose) if choose in names else None)
                       for s in searches]  # fmt: skip
            far = distances(changed, np.ones(len(objectives)))
            found.append(_shift(searches, base, far, f"limit of {one.name}", factor))
    for j, axis in enumerate(objectives):
        for factor in WEIGHT_FACTORS:
            weights = np.ones(len(objectives))
            weights[j] = factor
            far = distances([_as_tuned(one) for one in searches], weights)
            found.append(_shift(searches, base, far, f"weight of {axis.name}", factor))
    return tuple(found)


def _as_tuned(one: OptionSearch) -> Contender:
    record = one.record
    if not record.feasible or record.reason:
        return Contender(np.zeros((0, one.score.shape[1])), -1)
    return Contender(one.score[: len(record.front)], record.chosen)


def _contender(
    one: OptionSearch, requirements: Sequence[RequirementRecord], changed: int, factor: float, best: int | None
) -> Contender:
    """The option's front when one limit is multiplied by a factor, from the candidates of its search."""
    met = [
        i
        for i, values in enumerate(one.values)
        if all(
            violation(r, float(value), factor=factor if j == changed else 1.0) == 0.0
            for j, (r, value) in enumerate(zip(requirements, values, strict=True))
        )
    ]
    if not met:
        return Contender(np.zeros((0, one.score.shape[1])), -1)
    front = one.score[met][list(non_dominated(one.score[met]))]
    return Contender(front, knee(front) if best is None else int(np.argmin(front[:, best])))


def _order(searches: Sequence[OptionSearch], far: FloatArray) -> list[int]:
    """Positions of the options, best first."""

    def key(i: int) -> tuple[float, float, int]:
        record = searches[i].record
        beyond = float("inf") if record.reason else record.violation
        return (float(far[i]), beyond if np.isinf(far[i]) else 0.0, i)

    return sorted(range(len(searches)), key=key)


def _shift(
    searches: Sequence[OptionSearch], base: Sequence[int], far: FloatArray, what: str, factor: float
) -> RankingShift:
    order = _order(searches, far)
    first = searches[order[0]].record.option if np.isfinite(far[order[0]]) else ""
    places = tuple(order.index(i) + 1 for i in base)
    return RankingShift(what, factor, places, first, changed=list(order) != list(base))


def _size(searches: Sequence[OptionSearch]) -> int:
    return int(searches[0].score.shape[1])
