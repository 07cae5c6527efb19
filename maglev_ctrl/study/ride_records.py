"""What the ride of one option leaves behind: the random guideway at every place looked at, girders, steps, masks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from maglev_ctrl.analysis.response.records import RideResponse
from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.display import Shown


@dataclass(frozen=True, eq=False, slots=True)
class RidePoint:
    """The ride at one operating point, or why there is none; `touches`: a magnet touches there at rest."""

    where: str
    speed: float  # m/s
    payload: float  # kg
    response: RideResponse | None
    reason: str
    touches: bool = False


@dataclass(frozen=True, eq=False, slots=True)
class MaskResult:
    """A passenger's acceleration against a mask: the largest ratio of densities, where; above 1 it is exceeded."""

    passenger: str
    axis: str
    ratio: float
    frequency: float  # Hz
    mask_frequency: FloatArray  # Hz
    mask_density: FloatArray  # (m/s^2)^2/Hz


@dataclass(frozen=True, eq=False, slots=True)
class SpanPassing:
    """Girders passed one after another: peaks of the steady motion over speed.

    `gap` (V,) m: largest change of a magnet's gap; `acceleration` (V,) m/s^2: largest of the car's centre; both by the
    first harmonics. At the design speed and at `worst_speed` (m/s, with the harmonic and mode that meet there) the
    numbers are exact; `check`: their relative difference to a second method.
    """

    span: float
    sag: float
    speeds: FloatArray
    gap: FloatArray
    acceleration: FloatArray
    design_gap: float
    design_acceleration: float
    worst_speed: float
    worst_gap: float
    worst: str
    check: float
    reason: str


@dataclass(frozen=True, eq=False, slots=True)
class FlexibleSpan:
    """The girder as a moving beam: what it adds to the rigid one, at the design speed."""

    frequency: float  # Hz, first bending mode
    speed_ratio: float  # v / (2 f1 span)
    deflection: float  # m, largest at mid-span
    static_deflection: float  # m, of the same loads at rest
    gap: float  # m, largest change of a magnet's gap
    acceleration: float  # m/s^2, largest vertical of a passenger
    stable: str  # verdict of the coupled periodic system in words
    reason: str


@dataclass(frozen=True, eq=False, slots=True)
class StepPassing:
    """A single step of the guideway: peaks as it is passed at the design speed."""

    height: float  # m
    ramp: float  # m
    gap: float  # m
    acceleration: float  # m/s^2
    reason: str


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class RideStudy(Shown):
    """Everything about the ride of one option; `points` begin with the design point."""

    _told: ClassVar = ("points", "masks", "spectrum")

    points: tuple[RidePoint, ...]
    masks: tuple[MaskResult, ...]
    passing: SpanPassing | None
    flexible: FlexibleSpan | None
    step: StepPassing | None
    spectrum: str  # the guideway's irregularity in words, with its source
