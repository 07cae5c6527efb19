"""What a map study leaves behind: one record per option, complete enough to write page and data from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from maglev_ctrl.analysis.floquet_margins import FloquetMargins
from maglev_ctrl.analysis.plane_records import StabilityPlane
from maglev_ctrl.analysis.tongue_atlas import TongueAtlas
from maglev_ctrl.analysis.tongue_table import TongueRow
from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.display import Shown
from maglev_ctrl.synthesis.periodic_constant import PeriodicComparison


@dataclass(frozen=True, eq=False, slots=True)
class MapQuantity:
    """One axis as people read it: `quantity` as it was asked for, `label` in words, display value = SI * `scale`.

    `design` is the scenario's own value (SI), NaN where it has none.
    """

    quantity: str
    label: str
    unit: str
    scale: float
    values: FloatArray
    design: float


@dataclass(frozen=True, eq=False, slots=True)
class PeriodicLawStudy:
    """The option's constant law against a periodic one at the design point; `plane` the map under the periodic law.

    `unresolved` says why there is no trustworthy periodic law; "" otherwise.
    """

    comparison: PeriodicComparison | None
    certificate: tuple[str, ...]  # what the independent check of the periodic law found, one line each
    plane: StabilityPlane | None
    unresolved: str


@dataclass(frozen=True, eq=False, slots=True)
class OptionMap:
    """The map of one option. `failure` says why there is none; "" otherwise."""

    name: str
    label: str
    kind: str
    summary: tuple[str, ...]
    failure: str
    plane: StabilityPlane | None
    tongues: tuple[TongueRow, ...]  # at the design depth, over the design path (speed)
    atlas: TongueAtlas | None  # only where one axis is the speed, at the design value of the other
    atlas_reason: str
    margins: FloquetMargins | None
    margins_reason: str
    law: PeriodicLawStudy | None
    notes: tuple[str, ...]
    seconds: float


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class MapStudy(Shown):
    """Maps of a scenario's options over the same two quantities."""

    _told: ClassVar = ("title", "x", "y", "options")

    title: str
    scenario_path: str
    scenario_hash: str
    name: str
    sources: tuple[str, ...]  # what makes the forces periodic, one line each, with what is left out
    wavelength: float  # m
    depth: float  # expected depth of modulation
    x: MapQuantity
    y: MapQuantity
    options: tuple[OptionMap, ...]
    backend: str
    notes: tuple[str, ...]
    versions: tuple[tuple[str, str], ...]
    created: str
    seconds: float
