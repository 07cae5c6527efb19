"""The smallest gain any stabilising law can reach: bisection on gamma, sped up by what the limit looks like."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

LARGEST = 1e14
"""Gains above this times the scale of the plant are not looked for."""


@dataclass(frozen=True, eq=False, slots=True)
class Trial:
    """Outcome at one gamma: `feasible`; `measures` named numbers that fall through zero at the limit they name."""

    gamma: float
    feasible: bool
    measures: dict[str, float]


@dataclass(frozen=True, eq=False, slots=True)
class Infimum:
    """`lower` is infeasible (or the trivial bound), `upper` feasible; `limit` names what ends the feasible range."""

    lower: float
    upper: float
    limit: str
    trials: int


def infimum(
    test: Callable[[float], Trial], *, floor: float, scale: float, tolerance: float = 2e-7, negligible: float = 1e-10
) -> Infimum | None:
    """Bracket of the smallest feasible gamma; None where no gamma up to LARGEST x scale is feasible.

    Parameters
    ----------
    floor : no gamma at or below it is feasible
    scale : a gain typical of the plant, positive
    negligible : below this share of the scale the infimum counts as zero

    Examples
    --------
    >>> found = infimum(lambda g: Trial(g, g > 3.0, {"limit": g - 3.0}), floor=0.0, scale=1.0)
    >>> round(found.upper, 5), found.limit
    (3.0, 'limit')
    """
    lower, upper, count = _bracket(test, floor, scale, negligible)
    if upper is None:
        return None
    least = negligible * scale
    turn = 0
    while upper.gamma - lower.gamma > tolerance * upper.gamma and upper.gamma > least and count < 200:
        gamma = _proposal(lower, upper, turn, tolerance, floor, least)
        turn += 1
        count += 1
        trial = test(gamma)
        lower, upper = (lower, trial) if trial.feasible else (trial, upper)
    return Infimum(lower.gamma, upper.gamma, _limit(lower, upper, floor, least), count)


def _bracket(
    test: Callable[[float], Trial], floor: float, scale: float, negligible: float
) -> tuple[Trial, Trial | None, int]:
    start = max(floor * 1.5, scale)
    trial, count = test(start), 1
    bottom = Trial(floor, False, {})
    if trial.feasible:
        upper = trial
        while upper.gamma > negligible * scale:
            step = 0.25 * upper.gamma if floor == 0.0 else floor + 0.1 * (upper.gamma - floor)
            if step - floor <= 1e-8 * floor:
                return bottom, upper, count
            trial, count = test(step), count + 1
            if not trial.feasible:
                return trial, upper, count
            upper = trial
        return bottom, upper, count
    lower = trial
    while lower.gamma < LARGEST * scale:
        trial, count = test(4.0 * lower.gamma), count + 1
        if trial.feasible:
            return lower, trial, count
        lower = trial
    return lower, None, count


def _proposal(lower: Trial, upper: Trial, turn: int, tolerance: float, floor: float, least: float) -> float:
    """Secant of a measure that changes sign, pushed a little past the root: the bracket shrinks from both ends."""
    a, b = lower.gamma, upper.gamma
    middle = 0.5 * (a + b) if a > 0.25 * b else float(np.sqrt(max(a, least, 1e-3 * b) * b))
    if turn % 3 == 2:
        return middle
    best: float | None = None
    for name, high in upper.measures.items():
        low = lower.measures.get(name, np.nan)
        if low < 0.0 < high:
            root = a + (b - a) * low / (low - high)
            best = root if best is None else max(best, root)
    if best is None:
        return middle
    push = max(0.25 * tolerance * b, 0.02 * min(best - a, b - best))
    aimed = best + push if turn % 3 == 0 else best - push
    edge = 0.2 * tolerance * b
    return float(min(max(aimed, a + edge), b - edge))


def _limit(lower: Trial, upper: Trial, floor: float, least: float) -> str:
    if upper.gamma <= least:
        return "none: the gain can be made as small as wanted"
    if floor > 0.0 and lower.gamma <= floor * (1.0 + 1e-12):
        return "feedthrough"
    crossed = [name for name, value in lower.measures.items() if value < 0.0]
    if crossed:
        return crossed[0]
    return min(upper.measures, key=lambda name: upper.measures[name]) if upper.measures else "unknown"
