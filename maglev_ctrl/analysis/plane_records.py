"""Stability over two parameters: what a map is made of and what it holds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Final, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from maglev_ctrl.analysis.resonance import Resonance
from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.display import Shown
from maglev_ctrl.systems import PeriodicSystem

Coverage = Literal["auto", "every", "adaptive"]

STABLE: Final = -1
UNSTABLE: Final = 1
UNRESOLVED: Final = 0
NO_ANSWER: Final = 2


class PeriodicFamily(Protocol):
    """Periodic systems over two parameters, each at its actual depth of modulation."""

    def __call__(self, x: float, y: float) -> PeriodicSystem:
        """The system at (x, y); ModelError or OutOfDomain where the model has no answer."""


class MapStore(Protocol):
    """Keeps finished parts of a map by name, so that an interrupted one goes on where it was."""

    def get(self, key: str) -> Mapping[str, FloatArray] | None:
        """The arrays kept under a name; None when there are none."""

    def put(self, key: str, arrays: Mapping[str, FloatArray]) -> None:
        """Keep arrays under a name, as a whole or not at all."""


@dataclass(frozen=True, eq=False, slots=True)
class MapAxis:
    """`values` (p,) ascending of the parameter `name`, in SI.

    `reciprocal`: the frequency is proportional to the parameter (a speed), so that the monodromy matrix is smooth in
    its reciprocal. `linear`: the modulation is proportional to it and nothing else depends on it (a depth).
    """

    name: str
    values: FloatArray
    reciprocal: bool = False
    linear: bool = False


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class StabilityPlane(Shown):
    """Stability over `x` (p,) and `y` (q,).

    `state` (p, q): STABLE, UNSTABLE, UNRESOLVED (the engines or the error bound do not decide) or NO_ANSWER (the
    model has none there, reasons in `faults`). `growth` (p, q) 1/s, NaN without an answer; `growth_error` (p, q) 1/s
    bounds its error. `interpolated` (p, q): not computed but filled in between computed points of one state.
    `tongue_index` (p, q): -1, or an index into `tongues`. `checked` (k, 2): indices of the points decided again by
    Hill's method, `check_difference` (k,) 1/s. `evaluated`: points computed, `integrated`: systems integrated over a
    period. `missed_width`: an unstable strip along x narrower than this (in x) may be missing; NaN where not bounded.
    """

    _told: ClassVar = ("x", "y", "growth", "evaluated", "tongues")

    x: MapAxis
    y: MapAxis
    growth: FloatArray
    growth_error: FloatArray
    state: NDArray[np.int8]
    interpolated: NDArray[np.bool_]
    tongue_index: NDArray[np.int16]
    tongues: tuple[Resonance, ...]
    checked: NDArray[np.int64]
    check_difference: FloatArray
    faults: tuple[str, ...]
    evaluated: int
    integrated: int
    missed_width: float
    method: str

    def share(self, state: int) -> float:
        """The share of points in a state, 0 to 1."""
        return float(np.mean(self.state == state))
