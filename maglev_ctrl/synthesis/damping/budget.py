"""Cost of damping against certified margin: all places together, and each place alone."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from maglev_ctrl.arrays import FloatArray, read_only, read_only_any
from maglev_ctrl.errors import Agreement
from maglev_ctrl.synthesis.damping.certified import Guarantee
from maglev_ctrl.synthesis.damping.minimum import DampingDesign, designed, undone
from maglev_ctrl.synthesis.damping.places import DampedFamily, DampingPlace, damped_family
from maglev_ctrl.synthesis.neutral import hidden_modes
from maglev_ctrl.systems import SecondOrderSystem
from maglev_ctrl.systems.plant import Plant

Margin = Literal["decay rate", "damping ratio"]
OUT_OF_TIME: Final = "the time limit was reached"


@dataclass(frozen=True, eq=False, slots=True)
class BudgetCurve:
    """Least cost found at each margin, with dampers at `places`.

    `cost` (r,) and `damping` (r, k) N s/m are NaN where a point is UNRESOLVED, with the reason in `reasons` (r,), empty
    where proved; `lower_bound` (r,) no damping is cheaper; `marginal` (r,) cost per unit of margin, from neighbouring
    proved points, NaN where there is none.
    """

    places: tuple[str, ...]
    margin: FloatArray
    cost: FloatArray
    damping: FloatArray
    lower_bound: FloatArray
    marginal: FloatArray
    status: tuple[Agreement, ...]
    reasons: tuple[str, ...]

    @property
    def certified(self) -> NDArray[np.bool_]:
        """Which points are proved; (r,)."""
        return np.array([one is Agreement.AGREED for one in self.status])

    @property
    def best_margin(self) -> float:
        """Largest margin proved, NaN where none is."""
        kept = self.margin[self.certified]
        return float(np.max(kept)) if kept.size else float("nan")


@dataclass(frozen=True, eq=False, slots=True)
class DampingBudget:
    """Cost against certified margin: `together` with dampers at all places, `alone` one curve for each place.

    `quantity` "decay rate" (1/s) or "damping ratio"; `designs` the points of `together` with their proofs.
    """

    quantity: Margin
    guarantee: Guarantee
    together: BudgetCurve
    alone: tuple[BudgetCurve, ...]
    designs: tuple[DampingDesign, ...]


def damping_budget(
    vertices: Sequence[SecondOrderSystem] | Sequence[Plant],
    places: Sequence[DampingPlace],
    *,
    margins: ArrayLike,
    quantity: Margin = "decay rate",
    guarantee: Guarantee = "each vertex",
    starts: int = 6,
    time_limit: float = np.inf,
    step: Callable[[str], None] | None = None,
) -> DampingBudget:
    """What each margin costs, and where the damping should sit.

    Every point is a `minimum_damping` warm-started from its neighbour; where a larger margin turned out cheaper, the
    smaller one is sought again from there. Points that fail are UNRESOLVED with the reason.

    Parameters
    ----------
    margins : decay rates (1/s) or damping ratios, rising
    starts : descents at the first point; later points start from their neighbour and two others
    time_limit : s; points that would start later are UNRESOLVED
    step : told before every point what it is

    Raises
    ------
    ValueError : margins that do not rise, a time limit below zero, or as in `minimum_damping`
    ModelError : as in `damped_family`

    Examples
    --------
    >>> mass = SecondOrderSystem.from_matrices([[2.0]], [[0.0]], [[8.0]])
    >>> budget = damping_budget([mass], [DampingPlace("leg", [1.0])], margins=[0.5, 1.0, 3.0])
    >>> budget.together.cost.round(2), budget.together.marginal.round(2)  # c = 2 m rate up to the rate of 2 1/s
    (array([ 2.,  4., nan]), array([ 4.,  4., nan]))
    """
    levels = read_only(margins, name="margins")
    if levels.ndim != 1 or not levels.size or np.any(np.diff(levels) <= 0.0):
        raise ValueError(f"margins: expected rising numbers, got {levels.tolist()}")
    if quantity not in ("decay rate", "damping ratio"):
        raise ValueError(f"quantity: expected 'decay rate' or 'damping ratio', got {quantity!r}")
    if not time_limit >= 0.0:
        raise ValueError(f"time_limit: expected a time in s, got {time_limit!r}")
    deadline = time.monotonic() + time_limit
    family = damped_family(vertices, places)
    tell = step or (lambda words: None)
    designs = _curve(family, levels, quantity, guarantee, starts, deadline, tell)
    together = _record(family, levels, designs)
    alone: list[BudgetCurve] = []
    for place in range(len(family.places) if len(family.places) > 1 else 0):
        single = family.only(place)
        blocked = _unmoved(single)
        if blocked:
            alone.append(_blocked(single, levels, blocked))
        else:
            found = _curve(single, levels, quantity, guarantee, min(starts, 4), deadline, tell)
            alone.append(_record(single, levels, found))
    return DampingBudget(quantity, guarantee, together, tuple(alone), designs)


def _curve(
    family: DampedFamily, levels: FloatArray, quantity: Margin, guarantee: Guarantee, starts: int,
    deadline: float, tell: Callable[[str], None],
) -> tuple[DampingDesign, ...]:  # fmt: skip
    where = "all places" if len(family.places) > 1 else f"{family.places[0]} alone"

    def point(level: float, warm: FloatArray | None) -> DampingDesign:
        if time.monotonic() >= deadline:
            return undone(family, level if quantity == "decay rate" else 0.0, OUT_OF_TIME)
        tell(f"{quantity} {level:.6g}{' 1/s' if quantity == 'decay rate' else ''}, {where}")
        rate, ratio = (level, 0.0) if quantity == "decay rate" else (0.0, level)
        tries = starts if warm is None else 2
        return designed(family, rate, ratio=ratio, guarantee=guarantee, starts=tries, warm=warm)

    found: list[DampingDesign] = []
    warm: FloatArray | None = None
    for level in levels:
        found.append(point(float(level), warm))
        warm = found[-1].damping if found[-1].certified else None
    for i in range(len(found) - 2, -1, -1):
        here, beyond = found[i], found[i + 1]
        if beyond.certified and not here.cost <= beyond.cost:
            again = point(float(levels[i]), beyond.damping)
            if again.certified and not again.cost >= here.cost:
                found[i] = again
    return tuple(found)


def _record(family: DampedFamily, levels: FloatArray, designs: Sequence[DampingDesign]) -> BudgetCurve:
    cost = np.array([one.cost for one in designs])
    return BudgetCurve(
        places=family.places, margin=levels, cost=read_only_any(cost),
        damping=read_only_any(np.stack([one.damping for one in designs])),
        lower_bound=read_only_any(np.array([one.lower_bound for one in designs])),
        marginal=read_only_any(_slopes(levels, cost)),
        status=tuple(Agreement.AGREED if one.certified else Agreement.UNRESOLVED for one in designs),
        reasons=tuple(one.reason for one in designs),
    )  # fmt: skip


def _slopes(levels: FloatArray, cost: FloatArray) -> FloatArray:
    """Central differences inside a run of proved points, one-sided at its ends."""
    steps = np.diff(cost) / np.diff(levels)
    sides = np.stack([np.append(np.nan, steps), np.append(steps, np.nan)])
    weight = np.isfinite(sides)
    total = np.sum(np.where(weight, sides, 0.0), axis=0)
    slope = np.where(weight.any(axis=0), total / np.maximum(weight.sum(axis=0), 1), np.nan)
    return np.asarray(np.where(np.isfinite(cost), slope, np.nan))


def _unmoved(family: DampedFamily) -> str:
    for plant in family.plants:
        hidden = hidden_modes(plant.A, plant.C2, plant.states) or hidden_modes(plant.A.T, plant.B2.T, plant.states)
        if hidden:
            return f"a damper at {family.places[0]} alone does not act on {hidden[0].label} of {plant.name}"
    return ""


def _blocked(family: DampedFamily, levels: FloatArray, reason: str) -> BudgetCurve:
    nothing = read_only_any(np.full(levels.shape, np.nan))
    return BudgetCurve(
        family.places, levels, nothing, read_only_any(np.full((len(levels), 1), np.nan)), nothing, nothing,
        (Agreement.UNRESOLVED,) * len(levels), (reason,) * len(levels),
    )  # fmt: skip
