"""What a scheduled synthesis hands back."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.errors import ModelError
from maglev_ctrl.proofs.claims import Proof
from maglev_ctrl.synthesis.result import Synthesis
from maglev_ctrl.systems import Controller
from maglev_ctrl.systems.scheduled import ScheduledController, blended

ScheduleGuarantee = Literal[
    "polytopic: any variation", "interpolated: any variation", "interpolated: slow variation", "none"
]


@dataclass(frozen=True, eq=False, slots=True)
class BetweenCheck:
    """A plant between two nodes, closed with the scheduled law there: abscissa (1/s) of its poles and the proof."""

    value: float
    abscissa: float
    proof: Proof


@dataclass(frozen=True, eq=False, slots=True)
class ScheduledDesign:
    """A scheduled law and what is proved of it.

    `synthesis` one controller for each of its plants (nodes or vertices), empty where nothing was proved; `schedule`
    over one parameter, None without a law or with several parameters; `corners` (v, k) parameter values of vertices;
    `rate_limit` largest proved |rate of the parameter|, in its unit per second (infinite where one P serves all loops,
    NaN without a proof); `segment_limits` the proved one of each segment; `between` plants checked pointwise: the
    proof itself blends node plants linearly.
    """

    synthesis: Synthesis
    schedule: ScheduledController | None
    guarantee: ScheduleGuarantee
    rate_limit: float
    segment_limits: FloatArray
    corners: FloatArray
    between: tuple[BetweenCheck, ...] = ()

    def require(self) -> ScheduledDesign:
        """This design where it is proved.

        Raises
        ------
        ModelError : no law was proved, with the reason
        """
        self.synthesis.require()
        return self

    def law_at(self, values: ArrayLike) -> Controller:
        """The law at parameter values (k,): linear over one parameter, multilinear over a box of corners.

        Raises
        ------
        ValueError : a value is outside the nodes or the box
        ModelError : there is no law
        """
        laws = self.require().synthesis.controllers
        wanted = np.atleast_1d(np.asarray(values, dtype=float))
        if self.schedule is not None:
            return self.schedule.at(float(wanted[0]))
        return blended(laws, box_weights(self.corners, wanted))


def box_weights(corners: FloatArray, values: FloatArray) -> FloatArray:
    """Multilinear weights (2^k,) of the corners of a box at a point of it.

    Raises
    ------
    ValueError : the point is outside the box, or the corners are not those of a box

    Examples
    --------
    >>> box_weights(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 2.0], [1.0, 2.0]]), np.array([0.25, 1.0]))
    array([0.375, 0.125, 0.375, 0.125])
    """
    low, high = corners.min(axis=0), corners.max(axis=0)
    if values.shape != low.shape or np.any(values < low) or np.any(values > high):
        raise ValueError(f"values: expected a point between {low.tolist()} and {high.tolist()}, got {values.tolist()}")
    if not is_box(corners):
        raise ValueError("corners: expected the 2^k corners of a box; blend the laws with weights of your own")
    share = (values - low) / (high - low)
    return np.asarray(np.prod(np.where(corners == high, share, 1.0 - share), axis=1))


def is_box(corners: FloatArray) -> bool:
    """Whether the rows are the 2^k different corners of a box.

    Examples
    --------
    >>> is_box(np.array([[0.0], [1.0]])), is_box(np.array([[0.0], [1.0], [2.0]]))
    (True, False)
    """
    low, high = corners.min(axis=0), corners.max(axis=0)
    at_ends = bool(np.all((corners == low) | (corners == high)) and np.all(high > low))
    return at_ends and len(corners) == 2 ** corners.shape[1] == len({tuple(row) for row in corners.tolist()})


def no_design(synthesis: Synthesis, corners: FloatArray) -> ScheduledDesign:
    """A design that was not proved."""
    if synthesis.controllers:
        raise ModelError("a design that was not proved has no law")
    return ScheduledDesign(synthesis, None, "none", float("nan"), np.full(max(len(corners) - 1, 0), np.nan), corners)
