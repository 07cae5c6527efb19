"""Records of the live study: sliders, maps, and everything the page shows of one option."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from maglev_ctrl.analysis.floquet import Floquet
from maglev_ctrl.analysis.margins import Margins
from maglev_ctrl.analysis.modes import Modes
from maglev_ctrl.analysis.tracking import ModeTracks
from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.errors import Verdict
from maglev_ctrl.study.records import RequirementResult
from maglev_ctrl.systems import SecondOrderSystem
from maglev_ctrl.vehicle.vehicle import Vehicle

SliderGroup = Literal["operating", "modulation", "vehicle", "option", "law"]


@dataclass(frozen=True, eq=False, slots=True)
class LiveQuantity:
    """A quantity with a slider: `value`, `low`, `high` in SI, shown times `scale` in `unit`.

    `name` as in `scenario.quantity_paths` ("speed", "depth", "vehicle.secondary.damping"). Moving one of the groups
    "operating" and "modulation" leaves vehicle and law as they are designed; the others change the file, and the law is
    designed anew. `logarithmic`: the slider runs over factors.
    """

    name: str
    label: str
    unit: str
    scale: float
    value: float
    low: float
    high: float
    group: SliderGroup
    logarithmic: bool = False


@dataclass(frozen=True, eq=False, slots=True)
class LiveRegion:
    """An unstable region of a map: its name, and a point well inside it, speed (m/s) and depth."""

    name: str
    speed: float
    depth: float


@dataclass(frozen=True, eq=False, slots=True)
class LiveMap:
    """Growth over speed (V,) m/s and depth (E,): `growth` (E, V) 1/s, NaN without an answer.

    `state` (E, V) holds STABLE, UNSTABLE, UNRESOLVED and NO_ANSWER of `analysis.plane_records`. `checked`: verified by
    the second engine and named; a fast map is not, and says so. `note`: what a reader has to know of it.
    """

    speed: FloatArray
    depth: FloatArray
    growth: FloatArray
    state: NDArray[np.int8]
    regions: tuple[LiveRegion, ...]
    checked: bool
    note: str


@dataclass(frozen=True, eq=False, slots=True)
class LiveView:
    """One option at the values of the sliders.

    Fast fields are there at once: `modes` (with their two-method verdict) of `system` at the operating point, `tracks`
    over speed, the fast `map`. `settled`: margins, the checked map, Floquet at the operating point and `requirements`
    are there as well; before that, and where they could not be had, their reason stands beside them.
    """

    option: str
    label: str
    values: tuple[LiveQuantity, ...]
    speed: float  # m/s, of the operating point
    height: float  # m
    depth: float  # modulation depth looked at; 0 without periodic forces
    vehicle: Vehicle
    system: SecondOrderSystem | None  # closed loop at the operating point
    modes: Modes | None
    tracks: ModeTracks | None
    map: LiveMap | None
    map_reason: str
    floquet: Floquet | None
    margins: Margins | None
    margins_reason: str
    requirements: tuple[RequirementResult, ...]
    verdict: Verdict  # of the operating point: NOT EVALUATED until settled
    verdict_words: str  # one sentence: stable or not, what grows, what is not evaluated
    failure: str  # why there is nothing to show at these values; "" otherwise
    notes: tuple[str, ...]
    settled: bool
    seconds: float
    following: bool = False
    """Tracks and map are still those of the values before; those of these values follow."""


@dataclass(frozen=True, eq=False, slots=True)
class LiveComparison:
    """All options at one operating point, in the scenario's order; NaN and a reason where there is no answer."""

    options: tuple[str, ...]
    labels: tuple[str, ...]
    growth: FloatArray  # (o,) 1/s, without modulation
    least_damping: FloatArray  # (o,)
    periodic_growth: FloatArray  # (o,) 1/s at the depth looked at
    disk_margin: FloatArray  # (o,)
    verdicts: tuple[Verdict, ...]
    reasons: tuple[str, ...]
