"""Live views of a small train, made by the real analysis functions, for the tests of the page's views."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from report_fixture import (
    DEPTH,
    HEIGHT,
    SPEED,
    WAVELENGTH,
    _closed,
    _cylinders,
    _design,
    _judge,
    _loop,
    _windings,
    train,
)

from maglev_ctrl.analysis.floquet import Floquet, floquet
from maglev_ctrl.analysis.margins import Margins, loop_margins
from maglev_ctrl.analysis.modes import Modes, modes
from maglev_ctrl.analysis.plane_records import NO_ANSWER, STABLE, UNRESOLVED, UNSTABLE
from maglev_ctrl.analysis.resonance_map import resonance_map
from maglev_ctrl.analysis.tracking import ModeTracks, track
from maglev_ctrl.errors import NotStable, Verdict
from maglev_ctrl.report.charts_periodic import short_words
from maglev_ctrl.study.live.records import LiveComparison, LiveMap, LiveQuantity, LiveRegion, LiveView
from maglev_ctrl.study.records import RequirementResult
from maglev_ctrl.study.sweeps import least_damping
from maglev_ctrl.synthesis.design import Design
from maglev_ctrl.systems import PeriodicSystem, SecondOrderSystem, modulate
from maglev_ctrl.vehicle import OperatingPoint, Vehicle, stiffness_modulation

HOSTILE = "<script>alert(1)</script> $$x$$ \\(y\\)"
VALUES = (
    LiveQuantity("speed", "speed", "km/h", 3.6, SPEED, 100 / 3.6, 550 / 3.6, "operating"),
    LiveQuantity("depth", "modulation depth", "%", 100.0, DEPTH, 0.0, 0.5, "modulation"),
)


@dataclass(frozen=True, eq=False, slots=True)
class Studied:
    """What the views need of one option."""

    name: str
    label: str
    vehicle: Vehicle
    system: SecondOrderSystem
    modes: Modes
    tracks: ModeTracks
    least_damping: float
    margins: Margins | None
    margins_reason: str
    floquet: Floquet
    map: LiveMap


@lru_cache(maxsize=1)
def studies() -> dict[str, Studied]:
    """Three options of the report's train: bare, damper windings, active."""
    bare = train()
    active = bare.with_elements(actuators=_cylinders())
    design = _design(active)
    return {
        "bare": _studied("bare", "No added suspension", bare, None),
        "windings": _studied("windings", "Damper windings", bare.with_elements(connections=_windings()), None),
        "lqr": _studied("lqr", "Active secondary, LQR", active, design),
    }


def _studied(name: str, label: str, vehicle: Vehicle, design: Design | None) -> Studied:
    at = OperatingPoint(SPEED, HEIGHT)
    system = _closed(vehicle, design, at)
    found = modes(system)
    speeds = np.linspace(100 / 3.6, 550 / 3.6, 16)
    tracks = track([modes(_closed(vehicle, design, OperatingPoint(float(v), HEIGHT))) for v in speeds],
                   parameter=speeds)  # fmt: skip
    margins, reason = None, "the option adds no loop"
    loop = _loop(vehicle, design)
    if loop is not None:
        try:
            margins, reason = loop_margins(loop), ""
        except NotStable as fault:
            reason = str(fault)
    return Studied(
        name, label, vehicle, system, found, tracks, least_damping(found), margins, reason,
        floquet(_periodic(vehicle, design, SPEED, DEPTH)), _map(vehicle, design),
    )  # fmt: skip


def _periodic(vehicle: Vehicle, design: Design | None, speed: float, depth: float) -> PeriodicSystem:
    at = OperatingPoint(speed, HEIGHT)
    K_cos, K_sin = stiffness_modulation(vehicle, at, wavelength=WAVELENGTH)
    system = _closed(vehicle, design, at)
    return modulate(system, depth * K_cos, depth * K_sin, frequency=2 * np.pi * speed / WAVELENGTH)


def _map(vehicle: Vehicle, design: Design | None) -> LiveMap:
    """Over speed and depth, with a few cells made undecided or without an answer."""
    speeds, depths = np.linspace(60 / 3.6, 550 / 3.6, 26), np.linspace(0.0, 0.5, 20)
    unit = [_periodic(vehicle, design, float(v), 1.0) for v in speeds]
    found = resonance_map(
        np.stack([u.A_0 for u in unit]), np.stack([u.A_cos for u in unit]), np.stack([u.A_sin for u in unit]),
        np.array([float(u.frequency) for u in unit]), depths, parameter=speeds, parameter_name="speed",
        states=unit[0].states,
    )  # fmt: skip
    growth = np.array(found.growth_rate.T)
    state = np.where(found.unstable.T, UNSTABLE, STABLE).astype(np.int8)
    state[13:16, 16:19] = UNRESOLVED
    state[17:, :2], growth[17:, :2] = NO_ANSWER, np.nan
    regions = []
    for k, one in enumerate(found.tongues):
        inside = np.argwhere((k == found.tongue_index.T) & (state == UNSTABLE))
        if inside.size:
            row, column = inside[len(inside) // 2]
            regions.append(LiveRegion(short_words(one.name), float(speeds[column]), float(depths[row])))
    return LiveMap(speeds, depths, growth, state, tuple(regions), True, "")


def live_view(name: str = "windings", *, settled: bool = True) -> LiveView:
    """One option as the live study shows it."""
    one = studies()[name]
    critical = one.modes.labels[one.modes.critical]
    fast = replace(one.map, regions=(), checked=False)
    return LiveView(
        option=name, label=one.label, values=VALUES, speed=SPEED, height=HEIGHT, depth=DEPTH, vehicle=one.vehicle,
        system=one.system, modes=one.modes, tracks=one.tracks, map=one.map if settled else fast, map_reason="",
        floquet=one.floquet if settled else None, margins=one.margins if settled else None,
        margins_reason=one.margins_reason if settled else "not computed yet",
        requirements=_requirements(one) if settled else (),
        verdict=Verdict.FAIL if settled else Verdict.NOT_EVALUATED,
        verdict_words=f"{critical} decides at 500 km/h", failure="", notes=("A note.",), settled=settled, seconds=0.1,
    )  # fmt: skip


def _requirements(one: Studied) -> tuple[RequirementResult, ...]:
    disk = np.nan if one.margins is None else min(c.disk.alpha for c in one.margins.channels)
    return (
        _judge("stable", "largest growth rate", "at_most", -0.01, one.modes.spectral_abscissa, "1/s", ""),
        _judge("damping", "least damping ratio", "at_least", 0.02, one.least_damping, "", ""),
        _judge("disk", "least disk margin of a channel", "at_least", 0.4, disk, "", one.margins_reason),
        _judge("ride", "comfort index", "at_most", 2.0, np.nan, "", "computed in the report"),
    )


def hostile_view() -> LiveView:
    """A view whose every text from the scenario is a script tag or a formula."""
    view = live_view()
    assert view.modes is not None and view.tracks is not None and view.map is not None and view.system is not None
    modes = replace(
        view.modes, labels=tuple(f"{HOSTILE} {k}" for k in range(len(view.modes.labels))),
        ledger=replace(view.modes.ledger, elements=tuple(f"{HOSTILE} {k}" for k in view.modes.ledger.elements)),
    )  # fmt: skip
    tracks = replace(view.tracks, labels=tuple(f"{HOSTILE} {k}" for k in range(len(view.tracks.labels))))
    return replace(
        view, option=HOSTILE, label=HOSTILE, modes=modes, tracks=tracks, verdict_words=HOSTILE, notes=(HOSTILE,),
        map=replace(view.map, note=HOSTILE, regions=tuple(replace(r, name=HOSTILE) for r in view.map.regions)),
        requirements=tuple(
            replace(r, name=HOSTILE, quantity=HOSTILE, description=HOSTILE, reason=HOSTILE, worst_at=HOSTILE, unit="m")
            for r in view.requirements
        ), margins_reason=HOSTILE,
        margins=None if view.margins is None else replace(
            view.margins, channels=tuple(replace(c, channel=HOSTILE) for c in view.margins.channels)
        ),
    )  # fmt: skip


def live_comparison() -> LiveComparison:
    """The three options side by side."""
    found = tuple(studies().values())
    disk = [np.nan if s.margins is None else min(c.disk.alpha for c in s.margins.channels) for s in found]
    return LiveComparison(
        options=tuple(s.name for s in found), labels=tuple(s.label for s in found),
        growth=np.array([s.modes.spectral_abscissa for s in found]),
        least_damping=np.array([s.least_damping for s in found]),
        periodic_growth=np.array([s.floquet.growth_rate for s in found]), disk_margin=np.array(disk),
        verdicts=(Verdict.FAIL, Verdict.PASS, Verdict.NOT_EVALUATED), reasons=tuple(s.margins_reason for s in found),
    )  # fmt: skip
