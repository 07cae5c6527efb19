"""What a scenario says is periodic: its wavelength, its expected depth, and the modulated stiffness at unit depth."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from maglev_ctrl.arrays import FloatArray, read_only
from maglev_ctrl.errors import ModelError
from maglev_ctrl.scenario import Scenario, build_vehicle
from maglev_ctrl.scenario.periodic_schema import GirderSource, JointSource, PitchSource, SegmentSource, SourceRecord
from maglev_ctrl.scenario.periodic_sources import build_pattern, source_names
from maglev_ctrl.scenario.scenario_schema import Periodic
from maglev_ctrl.study.situation import Situation
from maglev_ctrl.vehicle import (
    ElementModulation,
    Equilibrium,
    OperatingPoint,
    Vehicle,
    element_modulation,
    stiffness_modulation,
)
from maglev_ctrl.vehicle.guideway_modulation import (
    GuidewayPattern,
    HeaveShare,
    guideway_elements,
    guideway_modulation,
    heave_shares,
    total_depth,
)
from maglev_ctrl.vehicle.loads import MagnetField

At = Equilibrium | OperatingPoint
LEFT_OUT = (
    "Left out of the periodic forces: the vehicle's own motion over the guideway (it flies straight, at its mean "
    "height), the guideway's dynamics (deflections are static), products of two sources, the modulation of damping, "
    "drag and turning forces, and the sampling of digital controllers."
)


@dataclass(frozen=True, eq=False, slots=True)
class ScenarioModulation:
    """The periodic stiffness of a scenario: call it with a vehicle and its equilibrium for K_cos, K_sin at unit depth.

    `wavelength` m of the period; `depth` the expected one: the matrices times it are those of the sources as they are.
    `shares`: what each source contributes at the design point; none where the pattern is prescribed.
    """

    wavelength: float
    depth: float
    harmonics: tuple[float, ...]
    pattern: GuidewayPattern | None
    shares: tuple[HeaveShare, ...]

    def __call__(self, vehicle: Vehicle, at: At, *, fields: MagnetField | None = None) -> tuple[FloatArray, FloatArray]:
        """K_cos, K_sin (H, n, n) N/m at unit depth.

        `fields`: the magnets' forces there, where they are known already; of use to a prescribed pattern alone.

        Raises
        ------
        ModelError : there is no equilibrium
        OutOfDomain : the forces are not known there, or a source leaves their range
        """
        if self.pattern is None:
            return stiffness_modulation(
                vehicle, at, wavelength=self.wavelength, harmonics=self.harmonics, fields=fields
            )
        K_cos, K_sin = guideway_modulation(vehicle, at, self.pattern)
        return read_only(K_cos / self.depth, name="K_cos"), read_only(K_sin / self.depth, name="K_sin")

    def elements(self, vehicle: Vehicle, at: At) -> ElementModulation:
        """The same, of each magnet and coefficient element; Raises as the call does."""
        if self.pattern is None:
            return element_modulation(vehicle, at, wavelength=self.wavelength, harmonics=self.harmonics)
        found = guideway_elements(vehicle, at, self.pattern)
        return ElementModulation(
            found.names, read_only(found.K_cos / self.depth, name="K_cos"),
            read_only(found.K_sin / self.depth, name="K_sin"),
        )  # fmt: skip


_KEPT: dict[int, tuple[Scenario, ScenarioModulation]] = {}
_KEPT_AT_MOST = 8


def modulation_of(scenario: Scenario) -> ScenarioModulation:
    """The periodic stiffness of a scenario.

    With sources, unit depth is where the largest harmonic of the total heave stiffness, every magnet met in phase,
    equals the mean heave stiffness; the expected depth is what the sources make of it for the bare vehicle at the
    design point. A depth scales all sources together.

    Raises
    ------
    ModelError : no [periodic] table, no equilibrium at the design point, or sources that modulate nothing
    OutOfDomain : a source leaves the range of the forces at the design point

    Examples
    --------
    >>> from maglev_ctrl.scenario import load
    >>> found = modulation_of(load("scenarios/periodic/girder_passing.toml"))   # doctest: +SKIP
    >>> found.wavelength, found.depth                                            # doctest: +SKIP
    (24.768, 0.1)
    """
    kept = _KEPT.get(id(scenario))
    if kept is not None:
        return kept[1]
    found = _modulation(scenario)
    while len(_KEPT) >= _KEPT_AT_MOST:
        _KEPT.pop(next(iter(_KEPT)), None)
    _KEPT[id(scenario)] = (scenario, found)
    return found


def wavelength_of(scenario: Scenario) -> float:
    """The period of a scenario's guideway, all its sources together, m.

    Raises
    ------
    ModelError : the scenario has no [periodic] table
    """
    periodic = _periodic(scenario)
    return periodic.wavelength if periodic.wavelength is not None else build_pattern(periodic).wavelength


def depth_of(scenario: Scenario) -> float:
    """The expected depth of modulation of a scenario; Raises as `modulation_of`."""
    periodic = _periodic(scenario)
    return periodic.depth if periodic.depth is not None else modulation_of(scenario).depth


def elements_of(scenario: Scenario) -> Callable[[Vehicle, At], ElementModulation]:
    """The share of each magnet and coefficient element at unit depth; Raises as `modulation_of`."""
    return modulation_of(scenario).elements


def describe_periodicity(scenario: Scenario) -> tuple[str, ...]:
    """What makes the forces periodic, one line each, with what is left out; Raises as `modulation_of`."""
    periodic, found = _periodic(scenario), modulation_of(scenario)
    deep: tuple[str, ...] = ()
    if found.depth > 1.0:
        deep = (
            f"The expected depth of {_percent(found.depth)} is more than the stiffness itself: at places along the "
            "guideway the magnets do not restore. First order says little there.",
        )
    if found.pattern is None:
        sizes = ", ".join(f"{size:g}" for size in found.harmonics)
        return (
            f"Prescribed pattern: the stiffness of every magnet varies by {_percent(found.depth)} (expected depth) "
            f"with a period of {found.wavelength:g} m; harmonics {sizes}.",
            *deep,
        )
    pattern, names = found.pattern, source_names(periodic)
    records = dict(zip(names, periodic.sources, strict=True))
    lines = [_share_words(one, _record_of(one.source.name, records), pattern) for one in found.shares]
    slower = max(pattern.sources, key=lambda source: source.period)
    lines += [
        f'Left out: "{one.name}", period {one.period:g} m, the faster source; kept is "{slower.name}", '
        f"{slower.period:g} m. {reason[:1].upper()}{reason[1:].partition(';')[0]}. For a map of {one.name} by itself "
        f"remove {slower.name}."
        for one, reason in zip(pattern.left_out, pattern.reasons, strict=True)
    ]
    cycles = ", ".join(
        f"{one.name} {count} times" for one, count in zip(pattern.sources, pattern.cycles, strict=True)
    )  # fmt: skip
    averaged = f" Averaged over magnets {pattern.magnet_length:g} m long." if pattern.magnet_length else ""
    return (
        *lines,
        f"Together: period {pattern.wavelength:g} m ({cycles}), expected depth {_percent(found.depth)}. Unit depth is "
        "where the largest harmonic of the total heave stiffness equals its mean; a depth scales all sources in "
        f"proportion.{averaged}",
        *deep,
        LEFT_OUT,
    )


def _periodic(scenario: Scenario) -> Periodic:
    if scenario.periodic is None:
        raise ModelError("the scenario describes no periodic forcing")
    return scenario.periodic


def _modulation(scenario: Scenario) -> ScenarioModulation:
    periodic = _periodic(scenario)
    if periodic.wavelength is not None and periodic.depth is not None:
        return ScenarioModulation(periodic.wavelength, periodic.depth, periodic.harmonics, None, ())
    pattern = build_pattern(periodic)
    shares = heave_shares(build_vehicle(scenario), Situation.of_design(scenario).point, pattern)
    depth = total_depth(shares)
    if not depth > 1e-12:
        raise ModelError(
            f"the sources ({', '.join(one.name for one in pattern.sources)}) leave the total heave stiffness without "
            "any modulation: there is nothing to map"
        )
    return ScenarioModulation(pattern.wavelength, depth, (), pattern, shares)


def _record_of(name: str, records: dict[str, SourceRecord]) -> SourceRecord:
    return records[name] if name in records else records[name.partition(" (")[0]]


def _share_words(share: HeaveShare, record: SourceRecord, pattern: GuidewayPattern) -> str:
    orders = ", ".join(_percent(float(size)) for size in np.abs(share.coefficients))
    words = f"{_source_words(share.source.name, record)}: harmonics of the heave stiffness {orders} of its mean"
    details = []
    if share.positions:
        change = f"{share.change:.0e}" if share.change > 0.0 else "0"
        details.append(f"force model at {share.positions} positions, doubling them changed the harmonics by {change}")
        details.append(f"change of the mean, left out, {_percent(share.mean_change)}")
    if share.rest:
        details.append(
            f"harmonics above {len(share.coefficients)} left out, {_percent(share.rest)} of the mean square"
        )  # fmt: skip
    short = pattern.magnet_length == 0.0 and isinstance(record, PitchSource | JointSource)
    if short:
        details.append("not averaged over a magnet's length")
    return f"{words} ({'; '.join(details)})." if details else f"{words}."


def _source_words(name: str, record: SourceRecord) -> str:
    match record:
        case GirderSource() if name.endswith("(softness)"):
            what = f"girders of {record.span:g} m, magnetic stiffness {_percent(record.softness)} lower at mid-span"
        case GirderSource():
            bow = f", camber {_millimetres(record.camber)}" if record.camber else ""
            what = f"girders of {record.span:g} m, sag {_millimetres(record.sag)}{bow}, half sine between supports"
        case JointSource() if record.opening is not None:
            what = f"joints every {record.spacing:g} m, {_millimetres(record.opening)} without conductor, sharp edges"
        case JointSource():
            what = f"joints every {record.spacing:g} m with a step of {_millimetres(record.step or 0.0)}"
        case SegmentSource():
            which = " and ".join(key for key in ("heights", "gaps") if getattr(record, key))
            what = f"segments of {record.spacing:g} m with a profile of {which}"
        case PitchSource():
            what = f"coils or poles every {record.spacing:g} m, {record.basis} ripple {_percent(record.ripple)}"
    return f"{name[:1].upper()}{name[1:].replace('_', ' ')}: {what}"


def _percent(share: float) -> str:
    return f"{100.0 * share:.3g} %"


def _millimetres(length: float) -> str:
    return f"{1e3 * length:g} mm"
