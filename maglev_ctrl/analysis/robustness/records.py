"""What robustness against uncertain parameters is told by: bounds from both sides, never one number alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.display import Shown
from maglev_ctrl.errors import Agreement, Verdict


@dataclass(frozen=True, eq=False, slots=True)
class StabilityRange:
    """All values of one parameter, between `low` and `high` in units of its spread, for which the loop is stable.

    The range that holds the nominal value 0, exact: -inf or inf where no crossing exists. A pole pair reaches the axis
    at `low_frequency`, `high_frequency` (rad/s; 0 a real pole, NaN where there is none). `agreement`: a search along
    the range by eigenvalues alone finds the same ends; `limit` is how far that search looked.
    """

    low: float
    high: float
    low_frequency: float
    high_frequency: float
    limit: float
    agreement: Agreement
    reason: str


@dataclass(frozen=True, eq=False, slots=True)
class FactorBounds:
    """By what factor all spreads may grow together before stability is lost: bounds from both sides.

    `proven` : stable for every combination of changes within +- proven times the spreads (structured singular value)
    `found` : the smallest factor at which an unstable combination was found; inf where none was found up to `limit`
    `changes` (p,) : that combination in units of the spreads, largest modulus = found; a pole lies on the axis at
    `frequency` (rad/s), `pole_distance` = |Re s| / |s| of it (relative to the loop's rates for a real pole)
    `limit` : how far was searched (a relative change of -1 ends the physics of a parameter)
    `boxes` : how many parts the parameter box was split into for the proof
    `agreement` : AGREED where found is at most 5 % above proven; else the true factor lies between the two
    """

    proven: float
    found: float
    changes: FloatArray
    frequency: float
    pole_distance: float
    limit: float
    boxes: int
    agreement: Agreement
    reason: str


@dataclass(frozen=True, eq=False, slots=True)
class WorstPoint:
    """The worst value found of one quantity inside the box, and where.

    `nominal` without changes, `value` at `changes` (p,) in units of the spreads, `percent` (p,) the same in % of the
    parameters; `frequency` (rad/s) of the mode or of the margin. Found by optimisation: the true worst value may be
    worse still, never better. `verified` : the model assembled again at that point gives the same value; NaN where
    `reason` says why there is none.
    """

    nominal: float
    value: float
    changes: FloatArray
    percent: FloatArray
    frequency: float
    verified: bool
    reason: str


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class WorstCase(Shown):
    """Worst cases of a closed loop within the stated spreads of its parameters.

    `stable` : PASS where stability is proven for every combination, FAIL where an unstable one was found and replayed,
    NOT EVALUATED between the two
    `factor` : by what factor the spreads may grow, from both sides
    `growth` : largest real part of a pole, 1/s; `damping` : smallest damping ratio of an oscillating mode;
    `disk` : smallest balanced disk margin of all channels at once
    `reason` : why the verdict is what it is, wherever it is no plain pass
    `exact_delays` : what the stability gate says with exact delays at the points found; empty without delays
    """

    _told: ClassVar = ("stable", "factor", "names", "agreement", "reason")

    names: tuple[str, ...]
    spreads: FloatArray
    stable: Verdict
    factor: FactorBounds
    growth: WorstPoint
    damping: WorstPoint
    disk: WorstPoint
    agreement: Agreement
    reason: str
    seconds: float
    exact_delays: str = ""
