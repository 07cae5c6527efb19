"""A map study of a two-mode vehicle: every number computed, none made up but the tongue rows' places."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np

from maglev_ctrl.analysis.floquet_margins import floquet_margins
from maglev_ctrl.analysis.plane_records import NO_ANSWER, STABLE, UNRESOLVED, UNSTABLE, MapAxis, StabilityPlane
from maglev_ctrl.analysis.resonance import make_resonance, state_tongues
from maglev_ctrl.analysis.stability_plane import stability_plane
from maglev_ctrl.analysis.tongue_atlas import tongue_atlas
from maglev_ctrl.analysis.tongue_removal import tongue_removal
from maglev_ctrl.analysis.tongue_table import TongueRow
from maglev_ctrl.study.map.records import MapQuantity, MapStudy, OptionMap, PeriodicLawStudy
from maglev_ctrl.synthesis.periodic import periodic_lqr
from maglev_ctrl.synthesis.periodic_constant import compare_laws
from maglev_ctrl.synthesis.periodic_problem import PeriodicProblem
from maglev_ctrl.systems import PeriodicSystem

WAVELENGTH = 8.0
DEPTH = 0.10
SPEED = 55.0
LABELS = ("car heave", "car pitch")
FILES = ("map.html", "map.pdf", "map.nc", "map.json", "ranges.csv")


def system(*, depth: float = DEPTH, gain: float = 1.0, speed: float = SPEED) -> PeriodicSystem:
    """Heave and pitch on a modulated stiffness; from about 95 m/s on a circulatory force alone makes them unstable."""
    K = np.diag([(2.0 * np.pi * 3.0) ** 2, (2.0 * np.pi * 4.5) ** 2])
    twist = 60.0 * (speed / 60.0) ** 3
    K = K + np.array([[0.0, twist], [-twist, 0.0]])
    C = gain * np.array([[0.5, 0.0], [0.0, 0.7]]) - 0.004 * max(speed - 30.0, 0.0) * np.eye(2)
    K_1 = depth * np.array([[355.0, 160.0], [210.0, 800.0]])
    A_0 = np.block([[np.zeros((2, 2)), np.eye(2)], [-K, -C]])
    wave = np.zeros((1, 4, 4))
    wave[0, 2:, :2] = -K_1
    return PeriodicSystem.from_matrices(A_0, wave, frequency=2.0 * np.pi * speed / WAVELENGTH)


def plane(*, count: tuple[int, int] = (64, 32), gain: float = 1.0, spoiled: bool = False) -> StabilityPlane:
    """The map over speed and depth; `spoiled` has a part that is unresolved and one without an answer."""
    found = stability_plane(
        lambda v, depth: system(depth=depth, gain=gain, speed=v),
        MapAxis("speed", np.linspace(20.0, 115.0, count[0]), reciprocal=True),
        MapAxis("depth", np.linspace(0.0, 0.6, count[1]), linear=True), labels=LABELS,
    )  # fmt: skip
    if not spoiled:
        return found
    state, growth, index = np.array(found.state), np.array(found.growth), np.array(found.tongue_index)
    undecided = np.zeros(state.shape, dtype=bool)
    undecided[int(0.66 * count[0]) : int(0.72 * count[0]), count[1] // 2 : int(0.67 * count[1])] = True
    blank = np.zeros(state.shape, dtype=bool)
    blank[: count[0] // 15, 3 * count[1] // 4 :] = True
    state[undecided], state[blank], growth[blank] = UNRESOLVED, NO_ANSWER, np.nan
    index[undecided | blank] = -1
    return replace(found, state=state, growth=growth, tongue_index=index, faults=("the magnets touch at 21.6 m/s",))


def tongues() -> tuple[TongueRow, ...]:
    """First-order tongues with computed places a little off them, one row without an answer."""
    unit = system(depth=1.0)
    rows = []
    for one in state_tongues(unit.A_0, unit.A_cos, unit.A_sin, depth=DEPTH, labels=LABELS):
        there = 0.0 < one.half_width < np.inf
        speed = WAVELENGTH / (2.0 * np.pi)
        r = one.resonance
        cure = tongue_removal(unit, r.kind, r.modes, order=r.order, depth=DEPTH) if there else None
        rows.append(TongueRow(
            resonance=r, depth=DEPTH, first_order_centre=one.centre * speed,
            first_order_half_width=one.half_width * speed if there else 0.0,
            computed_centre=1.001 * one.centre * speed if there else np.nan,
            computed_half_width=0.98 * one.half_width * speed if there else np.nan,
            onset=one.threshold, peak_growth=one.growth if there else np.nan, removal=cure,
            feeding=(("magnet_front", 0.61), ("magnet_rear", 0.42), ("winding_front_1", -0.03)) if there else (),
            needs="" if r.kind == "parametric" else "couplings of one sign",
            reason="" if there else "no unstable speed at this depth",
        ))  # fmt: skip
    return tuple(rows)


def law(shown: StabilityPlane) -> PeriodicLawStudy:
    """Periodic against constant regulators at the design point."""
    here = system(depth=3 * DEPTH)
    B = np.array([[0.0], [0.0], [1.0], [0.6]])
    found = compare_laws(periodic_lqr(PeriodicProblem.of(here, B, np.diag([100.0, 100.0, 1.0, 1.0]), [[1e-3]])))
    certificate = ("multipliers by Hill's method differ by 2e-11", "Riccati residual over one period 3e-12")
    return PeriodicLawStudy(found, certificate, shown, "")


@lru_cache(maxsize=1)
def map_study() -> MapStudy:
    """Two options with maps, one of them with holes, and one that failed."""
    first, damped = plane(), plane(gain=1.35, spoiled=True)
    bare = OptionMap(
        "bare", "Bare vehicle", "passive", ("Two modes, no controller.",), "", first, tongues(),
        tongue_atlas(lambda v: system(speed=v), lower=20.0, upper=115.0, samples=48, checks=6), "",
        floquet_margins(lambda **at: system(**at), depth=DEPTH, speed=SPEED, largest_depth=0.6,
                        speed_limits=(20.0, 115.0), samples=16), "",
        None, (), 1.5,
    )  # fmt: skip
    second = OptionMap(
        "damper", "Damper, <b>strong</b>", "passive", (), "", damped, (), None, "the speed is on no axis", None,
        "the engines do not agree at the design point", law(plane(gain=1.8)), ("damping is linear",), 2.0,
    )  # fmt: skip
    failed = OptionMap("broken", "Broken option", "lqr", (), "no equilibrium at the design point", None, (), None, "",
                       None, "", None, (), 0.0)  # fmt: skip
    return MapStudy(
        title="Two-mode vehicle", scenario_path="two.toml", scenario_hash="0123456789abcdef0123", name="two-mode",
        sources=("stiffness of all magnets, wavelength 8 m; damping is not modulated",), wavelength=WAVELENGTH,
        depth=DEPTH, x=MapQuantity("speed", "speed", "km/h", 3.6, first.x.values, SPEED),
        y=MapQuantity("depth", "depth of modulation", "%", 100.0, first.y.values, DEPTH),
        options=(bare, second, failed), backend="numpy", notes=(), versions=(("maglev-ctrl", "0.0"), ("numpy", "2")),
        created="2026-01-01 00:00", seconds=3.5,
    )  # fmt: skip


def flat_plane(shape: tuple[int, int], *, state: int = STABLE, growth: float = -1.0) -> StabilityPlane:
    """A map that is the same everywhere."""
    return StabilityPlane(
        x=MapAxis("speed", np.linspace(10.0, 110.0, shape[0]), reciprocal=True),
        y=MapAxis("depth", np.linspace(0.0, 0.5, shape[1]), linear=True),
        growth=np.full(shape, growth), growth_error=np.full(shape, 1e-9), state=np.full(shape, state, dtype=np.int8),
        interpolated=np.zeros(shape, dtype=bool), tongue_index=np.full(shape, -1, dtype=np.int16), tongues=(),
        checked=np.zeros((0, 2), dtype=np.int64), check_difference=np.zeros(0), faults=(), evaluated=shape[0],
        integrated=1, missed_width=np.nan, method="none",
    )  # fmt: skip


def on(study: MapStudy, plane: StabilityPlane) -> tuple[OptionMap, Any, Any]:
    """An option with this map, and axes that fit it."""
    x, y = replace(study.x, values=plane.x.values), replace(study.y, values=plane.y.values)
    return replace(study.options[0], plane=plane), x, y


def marked(plane: StabilityPlane, place: tuple[Any, Any], state: int, growth: float) -> StabilityPlane:
    """The map with another state at one place."""
    states, rates, index = np.array(plane.state), np.array(plane.growth), np.array(plane.tongue_index)
    states[place], rates[place] = state, growth
    index[states == UNSTABLE] = 0
    tongue = make_resonance("sum", 2, (1, 2), ("heave", "pitch"), frequency=5.0)
    return replace(plane, state=states, growth=rates, tongue_index=index, tongues=(tongue,))
