"""From an `eddy_current` record to what is solved: cross-section, coils, and the ranges of height, gap and speed."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import NoReturn, assert_never

import numpy as np
from numpy.typing import ArrayLike

from maglev_ctrl.errors import ModelError
from maglev_ctrl.fields.coil import RectangularCoil, coil_groups
from maglev_ctrl.fields.section import Conductor, CrossSection
from maglev_ctrl.forces import AbstractForceModel, Domain
from maglev_ctrl.scenario.guideway_schema import (
    Channel,
    EddyCurrentForces,
    GuidewayRecord,
    LShape,
    Plate,
    Plates,
    Polygon,
)
from maglev_ctrl.scenario.layout import Layout
from maglev_ctrl.scenario.operating_points import values_named
from maglev_ctrl.scenario.periodic_sources import reach
from maglev_ctrl.scenario.problems import Fault, KeyPath
from maglev_ctrl.scenario.scenario_schema import Scenario

MARGIN = 0.1
"""How far ranges that are not given reach beyond the study's own, relative."""
FREE = 2.0
"""Factor on heights where the height follows from the strength of the magnets."""
CLEAR = 0.2
"""Least clearance of a coil anywhere in a range that is not given, as a share of that at the design point."""


class UnsolvedForce(AbstractForceModel):
    """Stands for eddy-current forces until they are solved: it has their domain and no forces."""

    __slots__ = ("_domain",)

    def __init__(self, domain: Domain) -> None:
        self._domain = domain

    @property
    def domain(self) -> Domain:
        """Where the forces will be defined."""
        return self._domain

    def forces(self, height: ArrayLike, gap: ArrayLike | None, speed: ArrayLike) -> NoReturn:
        """Refused."""
        raise ModelError(
            "the eddy-current forces of this scenario have not been solved yet; use maglev_ctrl.study.solve_forces"
        )

    derivatives = forces

    def scaled(self, factor: ArrayLike) -> UnsolvedForce:
        """The same: there is nothing to scale."""
        return self


def section_of(record: GuidewayRecord) -> CrossSection:
    """The cross-section a record describes.

    Raises
    ------
    ValueError : an outline that crosses itself, conductors that overlap, or a size that is not positive
    """
    match record:
        case LShape():
            return CrossSection.l_shape(
                leg=record.leg, thickness=record.thickness, conductivity=record.conductivity, outside=record.outside
            )
        case Plate():
            return CrossSection.plate(
                width=record.width, thickness=record.thickness, conductivity=record.conductivity, centre=record.centre
            )
        case Channel():
            return CrossSection.channel(
                width=record.width, wall=record.wall, thickness=record.thickness, conductivity=record.conductivity
            )
        case Plates():
            return CrossSection.plates(
                [(one.left, one.right, one.bottom, one.top) for one in record.plates],
                conductivity=[one.conductivity for one in record.plates],
            )
        case Polygon():
            return CrossSection(
                tuple(Conductor(one.name, np.array(one.vertices), one.conductivity) for one in record.conductors)
            )
        case _ as never:
            assert_never(never)


def coils_of(forces: EddyCurrentForces) -> tuple[RectangularCoil, ...]:
    """The coils; one ampere a turn where no current is given, since the weight sets the scale then.

    Raises
    ------
    ValueError : a current of zero
    """
    return tuple(
        RectangularCoil(
            length=one.length, width=one.width, current=1.0 if one.current is None else one.current, turns=one.turns,
            lateral=one.lateral, height=one.height, roll=one.roll, forward=one.forward,
        )
        for one in forces.coils
    )  # fmt: skip


def domain_of(scenario: Scenario, here: Layout) -> Domain:
    """The ranges to solve for: as given, or those of the study with a margin, kept clear of the metal."""
    forces = scenario.forces
    assert isinstance(forces, EddyCurrentForces)
    wanted = study_domain(scenario, has_gap=here.has_walls)
    if forces.height_range is not None:
        wanted = replace(wanted, height=(forces.height_range.low, forces.height_range.high))
    if forces.gap_range is not None and here.has_walls:
        wanted = replace(wanted, gap=(forces.gap_range.low, forces.gap_range.high))
    if forces.velocity_range is not None:
        wanted = replace(wanted, speed=(forces.velocity_range.low, forces.velocity_range.high))
    return _kept_clear(scenario, wanted, forces)


def study_domain(scenario: Scenario, *, has_gap: bool) -> Domain:
    """Heights, gaps and speeds of a study's design point, sweeps, corners and schedules, with a margin."""
    operating, sweep = scenario.operating, scenario.operating.sweep
    heights = [operating.height, *values_named(scenario, "height")]
    speeds = [operating.speed, *values_named(scenario, "speed")]
    upright, sideways = reach(scenario.periodic)
    if sweep.height is not None:
        heights += [sweep.height.first, sweep.height.last]
    if operating.hold == "strength":
        heights += [operating.height / FREE, operating.height * FREE]
    for one in (sweep.speed, None if scenario.periodic is None else scenario.periodic.map.speed):
        if one is not None:
            speeds += [one.first, one.last]
    gap = None
    if has_gap and operating.gap is not None:
        gaps = [operating.gap, *values_named(scenario, "gap")]
        gaps += [] if sweep.gap is None else [sweep.gap.first, sweep.gap.last]
        offsets = [abs(operating.lateral_offset)]
        if sweep.lateral_offset is not None:
            offsets += [abs(sweep.lateral_offset.first), abs(sweep.lateral_offset.last)]
        low, high = min(gaps) - max(offsets) + sideways[0], max(gaps) + max(offsets) + sideways[1]
        gap = (max((1.0 - MARGIN) * low, 0.02 * operating.gap), (1.0 + MARGIN) * high)
    # What a source takes into the metal is told when the study meets it; the solver is not sent there.
    lowest = max(min(heights) + upright[0], min(*heights, 0.02 * operating.height))
    return Domain(height=_wider([lowest, max(heights) + upright[1]]), gap=gap, speed=_wider(speeds))


def _wider(values: list[float]) -> tuple[float, float]:
    return (1.0 - MARGIN) * min(values), (1.0 + MARGIN) * max(values)


def _kept_clear(scenario: Scenario, wanted: Domain, forces: EddyCurrentForces) -> Domain:
    """Ranges that were not given, drawn in until every coil stays clear of the metal."""
    section, coils = section_of(forces.guideway), coils_of(forces)
    height, gap = scenario.operating.height, scenario.operating.gap or 0.0
    needed = CLEAR * box_clearance(section, coils, (height, height), (gap, gap))
    box = [height, height, gap, gap]
    goal = [*wanted.height, *(wanted.gap or (0.0, 0.0))]
    given = [forces.height_range is not None] * 2 + [forces.gap_range is not None or wanted.gap is None] * 2
    for side in sorted(range(4), key=lambda i: not given[i]):
        start, end = box[side], goal[side]
        box[side] = end
        if given[side] or box_clearance(section, coils, (box[0], box[1]), (box[2], box[3])) >= needed:
            continue
        inside, outside = start, end
        for _ in range(20):
            box[side] = 0.5 * (inside + outside)
            if box_clearance(section, coils, (box[0], box[1]), (box[2], box[3])) >= needed:
                inside = box[side]
            else:
                outside = box[side]
        box[side] = inside
    return Domain(height=(box[0], box[1]), gap=None if wanted.gap is None else (box[2], box[3]), speed=wanted.speed)


def box_clearance(
    section: CrossSection,
    coils: tuple[RectangularCoil, ...],
    height: tuple[float, float],
    gap: tuple[float, float],
) -> float:
    """Least distance of the boxes through which coils move from the metal, m; zero where one meets it."""
    least = math.inf
    corners = np.concatenate([one.outline for one in section.conductors])
    for coil in coils:
        ends = np.concatenate([coil.sides(g, h) for g in gap for h in height])
        (left, low), (right, high) = ends.min(axis=0), ends.max(axis=0)
        start = np.array([[left, low], [right, low], [right, high], [left, high]])
        least = min(least, float(np.min(section.clearance(start, np.roll(start, -1, axis=0)))))
        held = (corners[:, 0] > left) & (corners[:, 0] < right) & (corners[:, 1] > low) & (corners[:, 1] < high)
        if np.any(held):
            return 0.0
    return least


def eddy_current_faults(scenario: Scenario, here: Layout) -> Iterator[Fault]:
    """What no single field of the record can know."""
    forces = scenario.forces
    assert isinstance(forces, EddyCurrentForces)
    early = [*_coil_faults(forces), *_guideway_faults(forces.guideway), *_range_faults(scenario, forces, here)]
    yield from early
    operating = scenario.operating
    if early or (here.has_walls and operating.gap is None):
        return
    section, gap = section_of(forces.guideway), operating.gap or 0.0
    for index, coil in enumerate(coils_of(forces)):
        if box_clearance(section, (coil,), (operating.height,) * 2, (gap, gap)) <= 0.0:
            where = f"a height of {operating.height * 1e3:g} mm"
            where += f" and a gap of {gap * 1e3:g} mm" if here.has_walls else ""
            yield Fault(
                ("forces", "coil", index),
                f"at the design point, {where}, the coil touches or lies inside the guideway's metal",
            )
            return
        found = domain_of(scenario, here)
        for key, height, beside in (
            ("height_range", found.height, (gap, gap)),
            ("gap_range", (operating.height,) * 2, found.gap or (gap, gap)),
            ("gap_range" if forces.height_range is None else "height_range", found.height, found.gap or (gap, gap)),
        ):
            if box_clearance(section, (coil,), height, beside) <= 0.0:
                yield Fault(("forces", key), "somewhere in the range a coil would touch the guideway's metal")
                return


def _coil_faults(forces: EddyCurrentForces) -> Iterator[Fault]:
    given = [one.current is not None for one in forces.coils]
    for index, one in enumerate(forces.coils):
        path: KeyPath = ("forces", "coil", index)
        if one.current == 0.0:
            yield Fault((*path, "current"), "expected a current other than zero: without it there is no force")
        if given[index] != given[0]:
            yield Fault(path, "expected a current in every coil or in none")
    if all(one.current != 0.0 for one in forces.coils):
        try:
            coil_groups(coils_of(forces))
        except ValueError as error:
            yield Fault(("forces", "coil", 0), str(error))


def _guideway_faults(guideway: GuidewayRecord) -> Iterator[Fault]:
    path: KeyPath = ("forces", "guideway")
    match guideway:
        case LShape() if guideway.outside and guideway.leg <= guideway.thickness:
            yield Fault((*path, "leg"), "an outside length has to exceed the thickness")
            return
        case Plates():
            crooked = [i for i, p in enumerate(guideway.plates) if not (p.left < p.right and p.bottom < p.top)]
            if crooked:
                yield Fault((*path, "plate", crooked[0]), "expected left below right and bottom below top")
                return
        case Polygon():
            names = [one.name for one in guideway.conductors]
            for index, one in enumerate(guideway.conductors):
                if one.name in names[:index]:
                    yield Fault((*path, "conductor", index, "name"), "expected a unique name")
                try:
                    Conductor(one.name, np.array(one.vertices), one.conductivity)
                except ValueError as error:
                    yield Fault((*path, "conductor", index, "vertices"), str(error))
                    return
        case _:
            pass
    try:
        section_of(guideway)
    except ValueError as error:
        yield Fault(path, str(error))


def _range_faults(scenario: Scenario, forces: EddyCurrentForces, here: Layout) -> Iterator[Fault]:
    operating = scenario.operating
    if forces.velocity_range is not None and forces.velocity_range.low <= 0.0:
        yield Fault(
            ("forces", "velocity_range", "from"),
            "expected a speed above zero: at rest there are no currents, and the forces vanish",
        )
    if forces.gap_range is not None and not here.has_walls:
        yield Fault(("forces", "gap_range"), "no magnet faces a guidance wall, so there is no gap; remove it", True)
        return
    points = (
        ("height_range", forces.height_range, operating.height, 1e3, "mm"),
        ("gap_range", forces.gap_range, operating.gap, 1e3, "mm"),
        ("velocity_range", forces.velocity_range, operating.speed, 1.0, "m/s"),
    )
    for key, span, value, factor, unit in points:
        if span is None or value is None:
            continue
        if not span.low <= span.high:
            yield Fault(("forces", key, "to"), 'expected a value above that of "from"')
        elif not span.low <= value <= span.high:
            word = key.removesuffix("_range").replace("velocity", "speed")
            yield Fault(
                ("forces", key),
                f"expected a range that holds the design point's {word}, {value * factor:g} {unit}; "
                f"got {span.low * factor:g} to {span.high * factor:g} {unit}",
            )
    yield from _sweep_faults(scenario, forces, here)


def _sweep_faults(scenario: Scenario, forces: EddyCurrentForces, here: Layout) -> Iterator[Fault]:
    """Sweeps that leave a range given by hand, or run a magnet into the wall: points there could not be evaluated."""
    operating, sweep = scenario.operating, scenario.operating.sweep
    swept = (
        ("height", sweep.height, "height_range", forces.height_range, 1e3, "mm"),
        ("gap", sweep.gap, "gap_range", forces.gap_range, 1e3, "mm"),
        ("speed", sweep.speed, "velocity_range", forces.velocity_range, 1.0, "m/s"),
    )
    for name, one, key, span, factor, unit in swept:
        if one is None or span is None or (span.low <= one.first and one.last <= span.high):
            continue
        yield Fault(
            ("operating", "sweep", name),
            f"reaches from {one.first * factor:g} to {one.last * factor:g} {unit}, but forces.{key} ends at "
            f"{span.low * factor:g} and {span.high * factor:g} {unit}; widen the range or shorten the sweep",
        )
    offset = sweep.lateral_offset
    if offset is None or operating.gap is None or not here.has_walls:
        return
    farthest = max(abs(offset.first), abs(offset.last))
    if farthest >= operating.gap:
        yield Fault(
            ("operating", "sweep", "lateral_offset"),
            f"moves the magnets by {farthest * 1e3:g} mm, into the wall {operating.gap * 1e3:g} mm away",
        )
