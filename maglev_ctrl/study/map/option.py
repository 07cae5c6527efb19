"""The map of one option: the plane, and beside it tongues, speed ranges, margins and a periodic law."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from maglev_ctrl.analysis.exponent_surface import SpeedSurface
from maglev_ctrl.analysis.floquet_margins import FloquetMargins
from maglev_ctrl.analysis.plane_records import (
    NO_ANSWER,
    UNRESOLVED,
    UNSTABLE,
    MapStore,
    PeriodicFamily,
    StabilityPlane,
)
from maglev_ctrl.analysis.stability_plane import stability_plane
from maglev_ctrl.analysis.tongue_atlas import TongueAtlas, tongue_atlas
from maglev_ctrl.analysis.tongue_table import TongueRow, tongue_table
from maglev_ctrl.scenario import OptionRecord, Scenario, describe_option
from maglev_ctrl.scenario.quantity_paths import DEPTH, SPEED
from maglev_ctrl.study.faults import sentence
from maglev_ctrl.study.floquet_margins import option_margins
from maglev_ctrl.study.law import designed_option
from maglev_ctrl.study.map.family import OptionFamily
from maglev_ctrl.study.map.records import OptionMap, PeriodicLawStudy
from maglev_ctrl.study.map.request import MapRequest
from maglev_ctrl.study.modulation import depth_of
from maglev_ctrl.study.periodic_law import periodic_law_study
from maglev_ctrl.study.situation import OptionModel
from maglev_ctrl.synthesis.design import Design
from maglev_ctrl.systems import PeriodicSystem, at_depth

Tell = Callable[[str, float], None]
MERGED = (
    "Delay and bandwidth of every actuator are merged into one lag on the map, in the tongues and in the speed ranges, "
    "as was asked for: error bounds speak of that model. The margins are those of the full one."
)
NOT_ASKED = "not asked for"
_FEW_HARMONICS = 2
PLANE_SHARE = 0.7
"""Share of an option's progress that its plane takes."""


def option_map(
    scenario: Scenario, request: MapRequest, name: str, *, threads: int = 1, store: MapStore | None = None,
    tell: Tell | None = None,
) -> OptionMap:  # fmt: skip
    """Everything about one option; what has no answer is recorded with its reason, never dropped.

    Parameters
    ----------
    name : of the option
    threads : that share the plane
    store : where finished parts of the plane are kept
    tell : told what is done and the fraction of it, 0 to 1
    """
    started, told = time.perf_counter(), tell or (lambda what, fraction: None)
    record = next(option for option in scenario.options if option.name == name)
    blank = OptionMap(
        name=name, label=record.label or name, kind=record.kind, summary=describe_option(scenario, record), failure="",
        plane=None, tongues=(), atlas=None, atlas_reason="", margins=None, margins_reason="", law=None, notes=(),
        seconds=0.0,
    )  # fmt: skip
    try:
        done = _mapped(scenario, request, record, blank, threads, store, told)
    except Exception as fault:  # whatever it is, the other options go on
        reason = sentence(fault)
        done = replace(blank, failure=reason, atlas_reason=reason, margins_reason=reason)
    told(f"{blank.label}: done", 1.0)
    return replace(done, seconds=time.perf_counter() - started)


def unmapped(scenario: Scenario, name: str, reason: str) -> OptionMap:
    """The record of an option that was lost with its process."""
    record = next(option for option in scenario.options if option.name == name)
    return OptionMap(
        name=name, label=record.label or name, kind=record.kind, summary=describe_option(scenario, record),
        failure=reason, plane=None, tongues=(), atlas=None, atlas_reason=reason, margins=None, margins_reason=reason,
        law=None, notes=(), seconds=0.0,
    )  # fmt: skip


def _mapped(
    scenario: Scenario, request: MapRequest, record: OptionRecord, blank: OptionMap, threads: int,
    store: MapStore | None, tell: Tell,
) -> OptionMap:  # fmt: skip
    tell(f"{blank.label}: control law", 0.0)
    model, design = designed_option(scenario, record)
    controller = None if design is None else design.controller
    family = OptionFamily.of(model, controller, request)
    plane = stability_plane(
        family, request.x.axis(), request.y.axis(), coverage=request.coverage, threads=threads,
        backend=request.backend, states=family.nominal().states, store=store,
        progress=lambda what, fraction: tell(f"{blank.label}: {what}", PLANE_SHARE * fraction),
    )  # fmt: skip
    tabled = replace(blank, atlas_reason=NOT_ASKED, margins_reason=NOT_ASKED)
    tongues: tuple[TongueRow, ...] = ()
    tongue_note = ""
    if request.tables:
        depth = depth_of(scenario)
        tell(f"{blank.label}: tongues", PLANE_SHARE)
        try:
            surface = _surface(family, scenario, request, depth)
        except Exception as fault:
            tongue_note, atlas, atlas_reason = f"No table of tongues: {sentence(fault)}", None, sentence(fault)
        else:
            tongues, tongue_note = _tongues(family, surface, depth)
            tell(f"{blank.label}: speed ranges", 0.8)
            atlas, atlas_reason = _atlas(family, surface, request, depth, plane)
        tell(f"{blank.label}: margins", 0.85)
        margins, margins_reason = _margins(model, family, scenario)
        tabled = replace(
            blank, tongues=tongues, atlas=atlas, atlas_reason=atlas_reason, margins=margins,
            margins_reason=margins_reason,
        )  # fmt: skip
    law, law_note = None, ""
    if request.periodic_law:
        tell(f"{blank.label}: periodic law", 0.9)
        law, law_note = _periodic_law(model, request, design, threads)
    notes = (MERGED if family.merged else "", *_plane_notes(plane), tongue_note, law_note,
             *(design.notes if design else ()))  # fmt: skip
    return replace(tabled, plane=plane, law=law, notes=tuple(note for note in notes if note))


def _speeds(scenario: Scenario, request: MapRequest) -> tuple[float, float]:
    """The speeds of the map, or those of the scenario's grid where no axis is the speed."""
    axis = request.axis_of(SPEED)
    if axis is not None:
        return axis.first, axis.last
    assert scenario.periodic is not None
    return scenario.periodic.map.speed.first, scenario.periodic.map.speed.last


def _surface(family: OptionFamily, scenario: Scenario, request: MapRequest, depth: float) -> SpeedSurface:
    """The exponents over speed and depth that both tables are searched on."""
    assert scenario.periodic is not None
    axis = request.axis_of(DEPTH)
    largest = max(depth, scenario.periodic.map.depth.last if axis is None else axis.last)
    lower, upper = _speeds(scenario, request)
    return SpeedSurface.of(family.path, lower=lower, upper=upper, largest_depth=largest)


def _tongues(family: OptionFamily, surface: SpeedSurface, depth: float) -> tuple[tuple[TongueRow, ...], str]:
    """The tongues over speed at the expected depth, and why there are none."""
    if depth <= 0.0:
        return (), "No table of tongues: the expected depth of modulation is zero."
    try:
        order, note = _orders(family)
        return tongue_table(
            family.path, depth=depth, lower=surface.smooth.lower, upper=surface.smooth.upper,
            largest_depth=surface.largest_depth, elements=family.elements, max_order=order, surface=surface,
        ), note  # fmt: skip
    except Exception as fault:
        return (), f"No table of tongues: {sentence(fault)}"


def _orders(family: OptionFamily) -> tuple[int, str]:
    """The largest order of the tongues in the tables, and what is left out.

    Orders above the harmonics have no first-order term. With few harmonics they are worth their time; with many they
    are narrow, and there are hundreds of them.
    """
    harmonics = len(family.nominal().A_cos)
    if harmonics <= _FEW_HARMONICS:
        return 2 * harmonics, ""
    note = f"The table of tongues goes up to order {harmonics}, the highest harmonic; the map has them all."
    return harmonics, note


def _atlas(
    family: OptionFamily, surface: SpeedSurface, request: MapRequest, depth: float, plane: StabilityPlane | None = None
) -> tuple[TongueAtlas | None, str]:
    """Go and no-go speeds at the expected depth, everything else at the scenario's own values."""
    axis = request.axis_of(SPEED)
    if axis is None:
        return None, "neither axis is the speed"
    try:
        return tongue_atlas(lambda v: at_depth(surface.smooth(v), depth), lower=axis.first, upper=axis.last,
                            max_order=_orders(family)[0], reader=surface.over(depth),
                            extra=doubtful_speeds(request, plane, depth)), ""  # fmt: skip
    except Exception as fault:
        return None, sentence(fault)


def doubtful_speeds(request: MapRequest, plane: StabilityPlane | None, depth: float) -> tuple[float, ...]:
    """Speeds that a map over speed and depth shows unstable or UNRESOLVED at its depths next to the expected one."""
    names = tuple(one.quantity.name for one in request.axes)
    if plane is None or set(names) != {SPEED, DEPTH}:
        return ()
    first = names == (SPEED, DEPTH)
    speeds, depths = (plane.x.values, plane.y.values) if first else (plane.y.values, plane.x.values)
    state = plane.state if first else plane.state.T
    above = int(np.searchsorted(depths, depth))
    columns = {min(above, len(depths) - 1), max(above - 1, 0)}
    doubtful = np.any([np.isin(state[:, k], (UNSTABLE, UNRESOLVED)) for k in columns], axis=0)
    return tuple(float(v) for v in speeds[doubtful])


def _margins(model: OptionModel, family: OptionFamily, scenario: Scenario) -> tuple[FloquetMargins | None, str]:
    assert scenario.periodic is not None
    try:
        return option_margins(model, family.controller, scenario.periodic)
    except Exception as fault:
        return None, sentence(fault)


def _periodic_law(
    model: OptionModel, request: MapRequest, design: Design | None, threads: int
) -> tuple[PeriodicLawStudy | None, str]:
    """The periodic law with its map over speed and depth, and what there is to say of it."""
    names = tuple(one.quantity.name for one in request.axes)
    if set(names) != {SPEED, DEPTH}:
        found, reason = periodic_law_study(model, design)
        return found, reason or "The map of the periodic law is drawn over speed and depth only."

    def draw(family: PeriodicFamily) -> StabilityPlane:
        def turned(x: float, y: float) -> PeriodicSystem:
            return family(x, y) if names == (SPEED, DEPTH) else family(y, x)

        return stability_plane(
            turned, request.x.axis(), request.y.axis(), coverage=request.coverage, threads=threads,
            backend=request.backend,
        )  # fmt: skip

    return periodic_law_study(model, design, draw=draw)


def _plane_notes(plane: StabilityPlane) -> tuple[str, ...]:
    """What of a map is not decided, and why."""
    notes = []
    if plane.share(UNRESOLVED):
        count = int(np.sum(plane.state == UNRESOLVED))
        notes.append(
            f"{count} of {plane.state.size} points are UNRESOLVED: the engines or the error bound do not decide them."
        )
    if plane.share(NO_ANSWER):
        why = f": {plane.faults[0]}" if plane.faults else "."
        notes.append(f"{100.0 * plane.share(NO_ANSWER):.3g} % of the points have no answer{why}")
    return tuple(notes)
