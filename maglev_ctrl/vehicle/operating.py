"""Where a vehicle is operated, and the static state it is linearised about."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass
from typing import Literal

import numpy as np

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.forces.base import MagnetForces

Hold = Literal["height", "strength", "frozen"]


@dataclass(frozen=True, eq=False, slots=True)
class OperatingPoint:
    """Speed (m/s), levitation height (m), guidance gap (m; the vehicle's own when None) and lateral offset (m).

    A lateral offset moves the vehicle towards +y: the gap shrinks on that side and widens on the other.

    Raises
    ------
    ValueError : a height or gap that is not positive, a negative speed, a number that is not finite
    """

    speed: float
    height: float
    _: KW_ONLY
    gap: float | None = None
    lateral_offset: float = 0.0

    def __post_init__(self) -> None:
        if not (np.isfinite(self.speed) and self.speed >= 0.0):
            raise ValueError(f"speed: expected a speed that is not negative, got {self.speed}")
        if not (np.isfinite(self.height) and self.height > 0.0):
            raise ValueError(f"height: expected a positive height, got {self.height}")
        if self.gap is not None and not (np.isfinite(self.gap) and self.gap > 0.0):
            raise ValueError(f"gap: expected a positive gap, got {self.gap}")
        if not np.isfinite(self.lateral_offset):
            raise ValueError(f"lateral_offset: expected a finite number, got {self.lateral_offset}")


@dataclass(frozen=True, eq=False, slots=True)
class Posture:
    """A trial state for the force balance: where the vehicle stands and what static forces act beside the magnets'.

    `displacement` (n,) is measured from the level posture with every magnet at `height` and `gap`, moved sideways by
    `offset`; `strength` scales every magnet force; `static_forces` are N along each connection's or actuator's
    direction, on its body; `thrust` is N on each body; `loads` (n,) are dead loads at the centres of mass.
    """

    speed: float
    height: float
    gap: float | None
    offset: float
    displacement: FloatArray
    strength: float
    static_forces: Mapping[str, float]
    thrust: Mapping[str, float]
    loads: FloatArray


@dataclass(frozen=True, eq=False, slots=True)
class Equilibrium:
    """The static state of a vehicle.

    Attributes
    ----------
    at : the operating point that was asked for
    hold : what was held: "height", "strength" or "frozen" (see `equilibrium`)
    displacement : (n,) from the level posture at the held height (or at the reference height); m, rad
    magnet_heights, magnet_gaps : (magnets,) m; the gap is NaN where a magnet has no gap
    forces : per magnet (magnets,), N, with strength and count
    strength : common factor on every magnet's forces
    unbalanced : (n,) net force that is left; a dead load of the opposite sign has to supply it, N and N m
    preloads : static force of each connection and actuator, along its direction on its body, N
    """

    at: OperatingPoint
    hold: Hold
    displacement: FloatArray
    magnet_heights: FloatArray
    magnet_gaps: FloatArray
    forces: MagnetForces
    strength: float
    unbalanced: FloatArray
    preloads: Mapping[str, float]
    posture: Posture
