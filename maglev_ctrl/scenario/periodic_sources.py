"""From the `[periodic]` table to the guideway's pattern, and the faults in it that no single field can know."""

from __future__ import annotations

from collections.abc import Iterator
from typing import assert_never

from maglev_ctrl.scenario.force_schema import CoefficientForces
from maglev_ctrl.scenario.layout import Layout
from maglev_ctrl.scenario.periodic_schema import GirderSource, JointSource, PitchSource, SegmentSource, SourceRecord
from maglev_ctrl.scenario.problems import Fault, KeyPath
from maglev_ctrl.scenario.scenario_schema import Periodic, Scenario
from maglev_ctrl.vehicle.guideway_modulation import GuidewayPattern, guideway_pattern
from maglev_ctrl.vehicle.guideway_sources import (
    DisplacedGuideway,
    GuidewaySource,
    girder_bow,
    girder_softness,
    measured_profile,
    open_joints,
    pitch_ripple,
    stepped_joints,
)

_PRESCRIBED = ("wavelength", "depth", "harmonics")
_OF_SOURCES = ("source_harmonics", "magnet_length", "on_incommensurate")
_FEWEST = 3


def source_names(periodic: Periodic) -> tuple[str, ...]:
    """The name of every source: its own, or its kind, numbered where there are several of it without a name."""
    unnamed = [one.kind for one in periodic.sources if one.name is None]
    names: list[str] = []
    count = dict.fromkeys(unnamed, 0)
    for one in periodic.sources:
        if one.name is not None:
            names.append(one.name)
            continue
        count[one.kind] += 1
        names.append(one.kind if unnamed.count(one.kind) == 1 else f"{one.kind}_{count[one.kind]}")
    return tuple(names)


def build_sources(periodic: Periodic) -> tuple[GuidewaySource, ...]:
    """The sources of a scenario's guideway in the order of the file; a girder that sags and gives way makes two.

    Raises
    ------
    ValueError : a source that makes no sense (`periodic_faults` tells them all)
    """
    names, count = source_names(periodic), periodic.source_harmonics
    return tuple(
        made for name, one in zip(names, periodic.sources, strict=True) for made in _made(name, one, count)
    )  # fmt: skip


def build_pattern(periodic: Periodic) -> GuidewayPattern:
    """The pattern of a scenario's guideway sources over their common period.

    Raises
    ------
    ValueError : there are no sources, or they have no common period
    """
    return guideway_pattern(
        build_sources(periodic), harmonics=periodic.source_harmonics, magnet_length=periodic.magnet_length,
        on_incommensurate=periodic.on_incommensurate,
    )  # fmt: skip


def reach(periodic: Periodic | None) -> tuple[tuple[float, float], tuple[float, float]]:
    """How far the sources take heights and gaps of the magnets from their mean: (lowest, highest) of each, m.

    A source with a fault, which is told elsewhere, reaches nowhere.
    """
    heights, gaps = [0.0], [0.0]
    for one in () if periodic is None else periodic.sources:
        try:
            found = tuple(_made(one.kind, one, 1))
        except ValueError:
            continue
        for source in (made for made in found if isinstance(made, DisplacedGuideway)):
            heights += [-value for value in source.range_of_rise()]
            gaps += [-value for value in source.range_of_narrowing()]
    return (min(heights), max(heights)), (min(gaps), max(gaps))


def periodic_faults(scenario: Scenario, here: Layout) -> Iterator[Fault]:
    """Faults of the table's two ways of saying what is periodic; those of its map are found elsewhere."""
    periodic = scenario.periodic
    if periodic is None:
        return
    given = periodic.model_fields_set
    if not periodic.sources:
        if "sources" in given:
            yield Fault(("periodic", "source"), "expected at least one source, or wavelength and depth in its place")
        for key, example in (("wavelength", 'a length with its unit, for example "25 m"'), ("depth", "a plain number")):
            if getattr(periodic, key) is None:
                yield Fault(
                    ("periodic", key), f"missing; expected {example}, or [[periodic.source]] tables in its place"
                )  # fmt: skip
        for key in _OF_SOURCES:
            if key in given:
                yield Fault(("periodic", key), "belongs to [[periodic.source]] tables, and there are none", True)
        if not any(periodic.harmonics):
            yield Fault(("periodic", "harmonics"), "expected at least one harmonic that is not zero")
        return
    for key in _PRESCRIBED:
        if key in given:
            yield Fault(
                ("periodic", key),
                f"given beside [[periodic.source]], which say it themselves; remove {key}, or the sources",
                True,
            )  # fmt: skip
    names = source_names(periodic)
    early = [
        fault
        for index, one in enumerate(periodic.sources)
        for fault in _source_faults(scenario, here, one, path=("periodic", "source", index))
    ]
    early += [
        Fault(("periodic", "source", index), f'expected a unique name; an earlier source is called "{name}" too')
        for index, name in enumerate(names)
        if name in names[:index]
    ]
    yield from early
    if early:
        return
    try:
        build_pattern(periodic)
    except ValueError as fault:
        yield Fault(
            ("periodic", "source"),
            f'{fault}; on_incommensurate = "slower" does that and says what was left out',
        )


def _source_faults(scenario: Scenario, here: Layout, source: SourceRecord, *, path: KeyPath) -> Iterator[Fault]:
    match source:
        case GirderSource():
            if source.sag == source.camber and source.softness == 0.0:
                why = "the camber takes away the sag" if source.sag else "there is neither sag, camber nor softness"
                yield Fault(path, f"expected a girder that changes something; {why}")
            if not -1.0 < source.softness < 1.0:
                yield Fault((*path, "softness"), f"expected a fraction between -1 and 1, got {source.softness:g}")
        case JointSource():
            given = [key for key in ("opening", "step") if getattr(source, key) is not None]
            if len(given) != 1:
                got = "both" if given else "none"
                yield Fault(path, f"expected exactly one of opening and step, got {got}; write a source for each")
            if source.opening is not None and source.opening >= source.spacing:
                yield Fault(
                    (*path, "opening"),
                    f"expected less than the spacing of {source.spacing:g} m, got {source.opening:g} m",
                )
            if source.step == 0.0:
                yield Fault((*path, "step"), "expected a step other than zero")
        case SegmentSource():
            yield from _profile_faults(source, here, path=path)
        case PitchSource():
            if not any(source.harmonics):
                yield Fault((*path, "harmonics"), "expected at least one harmonic that is not zero")
        case _ as never:
            assert_never(never)
    if isinstance(scenario.forces, CoefficientForces) and _displaces(source):
        yield Fault(
            path,
            "measured coefficients do not tell how the stiffness changes with the height; give an opening, a softness "
            "or a ripple, or forces by another model",
        )


def _displaces(source: SourceRecord) -> bool:
    match source:
        case GirderSource():
            return source.sag != source.camber
        case JointSource():
            return source.step is not None
        case SegmentSource():
            return True
    return False


def _profile_faults(source: SegmentSource, here: Layout, *, path: KeyPath) -> Iterator[Fault]:
    if not source.heights and not source.gaps:
        yield Fault(path, "missing; expected heights or gaps, a list of lengths over one period")
    for key, samples in (("heights", source.heights), ("gaps", source.gaps)):
        if not samples:
            continue
        if len(samples) < _FEWEST:
            yield Fault((*path, key), f"expected at least {_FEWEST} samples over the period, got {len(samples)}")
        elif min(samples) == max(samples):
            yield Fault((*path, key), "expected a profile that changes; all its samples are equal")
    if source.gaps and not here.has_walls:
        yield Fault((*path, "gaps"), "no magnet faces a guidance wall, so there is no gap; remove it", True)


def _made(name: str, source: SourceRecord, harmonics: int) -> Iterator[GuidewaySource]:
    offset = source.offset
    match source:
        case GirderSource():
            if source.sag != source.camber:
                yield girder_bow(name, span=source.span, rise=source.camber - source.sag, offset=offset)
            if source.softness != 0.0:
                yield girder_softness(
                    f"{name} (softness)", span=source.span, variation=source.softness, harmonics=harmonics,
                    offset=offset,
                )  # fmt: skip
        case JointSource():
            if source.opening is not None:
                yield open_joints(
                    name, spacing=source.spacing, opening=source.opening, harmonics=harmonics, offset=offset
                )  # fmt: skip
            if source.step is not None:
                yield stepped_joints(name, spacing=source.spacing, step=source.step, offset=offset)
        case SegmentSource():
            yield measured_profile(
                name, spacing=source.spacing, heights=source.heights, gaps=source.gaps, offset=offset
            )  # fmt: skip
        case PitchSource():
            yield pitch_ripple(
                name, pitch=source.spacing, ripple=source.ripple, harmonics=source.harmonics, offset=offset
            )  # fmt: skip
        case _ as never:
            assert_never(never)
