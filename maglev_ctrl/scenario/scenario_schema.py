"""A whole scenario file as a record, with what was read beside it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from pydantic import Field, PrivateAttr

from maglev_ctrl.display import Shown
from maglev_ctrl.forces import AbstractForceModel
from maglev_ctrl.scenario.force_schema import ForceRecord
from maglev_ctrl.scenario.force_table import ForceSamples
from maglev_ctrl.scenario.option_schema import OptionRecord
from maglev_ctrl.scenario.periodic_schema import SourceRecord
from maglev_ctrl.scenario.records import Many, Record
from maglev_ctrl.scenario.requirement_packs import Pack, pack_requirements
from maglev_ctrl.scenario.requirement_schema import RequirementRecord
from maglev_ctrl.scenario.track_schema import Irregularity, Ride
from maglev_ctrl.scenario.tuning_schema import Simulation, Tuning, Uncertainty
from maglev_ctrl.scenario.units import (
    Length,
    NonnegativeLength,
    NonnegativeRatio,
    Payload,
    PositiveLength,
    Ratio,
    Speed,
)
from maglev_ctrl.scenario.vehicle_schema import VehicleRecord

Count = Annotated[int, Field(ge=2, le=2000)]


class SpeedSweep(Record):
    """Speeds from the first to the last, evenly spaced."""

    first: Speed = Field(alias="from", description="lowest speed")
    last: Speed = Field(alias="to", description="highest speed")
    count: Count = Field(description="how many, both ends included")


class PayloadSweep(Record):
    """Payloads from the first to the last, evenly spaced."""

    first: Payload = Field(alias="from", description="smallest payload")
    last: Payload = Field(alias="to", description="largest payload")
    count: Count = Field(description="how many, both ends included")


class LengthSweep(Record):
    """Heights or gaps from the first to the last, evenly spaced."""

    first: PositiveLength = Field(alias="from", description="smallest")
    last: PositiveLength = Field(alias="to", description="largest")
    count: Count = Field(description="how many, both ends included")


class OffsetSweep(Record):
    """Lateral offsets from the first to the last, evenly spaced."""

    first: Length = Field(alias="from", description="rightmost")
    last: Length = Field(alias="to", description="leftmost")
    count: Count = Field(description="how many, both ends included")


class DepthSweep(Record):
    """Modulation depths from the first to the last, evenly spaced."""

    first: NonnegativeRatio = Field(alias="from", description="smallest depth, a fraction of the magnetic stiffness")
    last: NonnegativeRatio = Field(alias="to", description="largest depth")
    count: Count = Field(description="how many, both ends included")


AnySweep = SpeedSweep | PayloadSweep | LengthSweep | OffsetSweep | DepthSweep


class Sweeps(Record):
    """Operating parameters that are varied one at a time about the design point."""

    speed: SpeedSweep | None = None
    payload: PayloadSweep | None = None
    height: LengthSweep | None = None
    gap: LengthSweep | None = None
    lateral_offset: OffsetSweep | None = None


class Operating(Record):
    """The design point and the sweeps about it."""

    speed: Speed = Field(description="design speed")
    height: PositiveLength = Field(description="levitation height of the magnets at the design point")
    gap: PositiveLength | None = Field(None, description="guidance gap; only where magnets face a guidance wall")
    lateral_offset: Length = Field(0.0, description="lateral displacement of the vehicle from the centre line")
    hold: Literal["height", "strength"] = Field(
        "height",
        description="height: currents are trimmed so that lift = weight at this height; strength: the height follows",
    )
    sweep: Sweeps = Field(default_factory=Sweeps, description="sweep.speed, sweep.payload, sweep.height, ...")


class PeriodicMap(Record):
    """Grid of the resonance map."""

    speed: SpeedSweep
    depth: DepthSweep


class Periodic(Record):
    """Magnetic stiffness modulated at the frequency at which the guideway's period passes under the vehicle.

    Either one pattern is prescribed by `wavelength`, `depth` and `harmonics`, or `[[periodic.source]]` tables say what
    makes the guideway periodic and the pattern is computed from the magnets' forces.
    """

    later_keys: ClassVar[frozenset[str]] = frozenset(
        {"sources", "source_harmonics", "magnet_length", "on_incommensurate"}
    )

    wavelength: PositiveLength | None = Field(
        None, description="period of the guideway: girder span, joint distance, coil pitch; without sources only"
    )
    depth: NonnegativeRatio | None = Field(
        None, description="expected modulation, a fraction of the magnetic stiffness; without sources only"
    )
    harmonics: Many[Ratio] = Field(
        (1.0,), min_length=1, max_length=20, description="relative size of the harmonics; without sources only"
    )
    sources: Many[SourceRecord] = Field(
        (), alias="source", max_length=8, description="what makes the guideway periodic; in place of wavelength, depth"
    )
    source_harmonics: int = Field(4, ge=1, le=20, description="harmonics kept of every source, of its own period")
    magnet_length: NonnegativeLength = Field(
        0.0, description="length of one magnet along the track, over which the sources' harmonics are averaged"
    )
    on_incommensurate: Literal["refuse", "slower"] = Field(
        "refuse",
        description="sources whose periods have no ratio of small whole numbers: refuse them, or keep the slower one "
        "and say which was left out",
    )
    map: PeriodicMap


@dataclass(frozen=True, slots=True)
class Origin:
    """Where a scenario came from and what was read beside it."""

    path: Path
    text: str
    hash: str
    force_samples: ForceSamples | None


class Scenario(Shown, Record):
    """A study: a vehicle, its forces, where it runs, the suspension options to compare and what they must reach."""

    _told: ClassVar = ("title", "vehicle", "options", "requirements")

    later_keys: ClassVar[frozenset[str]] = frozenset(
        {"packs", "irregularity", "ride", "uncertainty", "tuning", "simulation"}
    )

    format: Literal[1] = Field(description="version of this format")
    title: str = Field(min_length=1, max_length=200, description="one line for the report's title")
    description: str = Field("", max_length=20_000, description="what the study is about")
    sources: dict[str, str] = Field(default_factory=dict, description="where the numbers come from: key = citation")
    assumptions: Many[str] = Field(
        (), max_length=1000, description="numbers and simplifications no source confirms, one line each"
    )
    vehicle: VehicleRecord
    forces: ForceRecord
    operating: Operating
    periodic: Periodic | None = Field(None, description="left out: no resonance map")
    options: Many[OptionRecord] = Field(alias="option", min_length=1, max_length=40, description="options to compare")
    requirements: Many[RequirementRecord] = Field(
        (), alias="requirement", max_length=200, description="what they must reach"
    )
    packs: Many[Pack] = Field((), description="sets of requirements from practice, beside those of the file")
    irregularity: Irregularity | None = Field(None, description="left out: no ride, no gaps, no actuator power")
    ride: Ride = Field(default_factory=Ride, description="who rides, how far gaps and strokes may close")
    uncertainty: Uncertainty | None = Field(None, description="left out: no worst case over uncertain parameters")
    tuning: Tuning | None = Field(None, description="left out: options are compared as they are written")
    simulation: Simulation | None = Field(None, description="left out: no check on the nonlinear vehicle in the report")

    _origin: Origin | None = PrivateAttr(default=None)
    _solved_force: AbstractForceModel | None = PrivateAttr(default=None)

    @property
    def origin(self) -> Origin:
        """Path, text, hash and force samples of the file it was read from.

        Raises
        ------
        ValueError : the scenario was not read from a file
        """
        if self._origin is None:
            raise ValueError("this scenario was not read from a file; use maglev_ctrl.scenario.load")
        return self._origin

    @property
    def path(self) -> Path:
        """The file it was read from."""
        return self.origin.path

    @property
    def name(self) -> str:
        """Name of the file without its ending; results go into a folder of this name, so that it leads nowhere else."""
        return self.origin.path.stem.strip(". ") or "scenario"

    @property
    def text(self) -> str:
        """The file as it was read."""
        return self.origin.text

    @property
    def hash(self) -> str:
        """SHA-256 of what the file says (comments, order and choice of units do not matter) and of its data files."""
        return self.origin.hash

    @property
    def force_samples(self) -> ForceSamples | None:
        """Samples of a force table, SI; None for other force models."""
        return self.origin.force_samples

    @property
    def judged(self) -> tuple[RequirementRecord, ...]:
        """Every requirement: those of the file, then those of its packs that the file does not name itself.

        A pack's requirement has the name of its quantity, with the pack's before it where an earlier pack has that.
        """
        swept, taken = self.operating.sweep.speed is not None, {one.name for one in self.requirements}
        found, packed = list(self.requirements), set[str]()
        for pack in self.packs:
            for one in pack_requirements(pack, swept=swept):
                name = one.name if one.name not in packed else f"{pack}_{one.name}"[:40]
                packed.add(name)
                if name not in taken:
                    found.append(one if name == one.name else one.model_copy(update={"name": name}))
        return tuple(found)

    @property
    def solved_force(self) -> AbstractForceModel | None:
        """Eddy-current force of one magnet once it is solved; None before, and for other force models."""
        return self._solved_force


def with_origin(scenario: Scenario, origin: Origin) -> Scenario:
    """The same scenario with its origin recorded."""
    copy = scenario.model_copy()
    copy._origin = origin
    return copy


def with_solved_force(scenario: Scenario, force: AbstractForceModel) -> Scenario:
    """The same scenario with the eddy-current force of one magnet, which takes long to solve, put in."""
    copy = scenario.model_copy()
    copy._solved_force = force
    return copy
