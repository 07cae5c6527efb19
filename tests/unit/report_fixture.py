"""A small comparison made by the real analysis functions, for the tests of the report."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from maglev_ctrl.analysis.boundary import stability_boundaries
from maglev_ctrl.analysis.floquet import floquet
from maglev_ctrl.analysis.floquet_margins import FloquetMargins, floquet_margins
from maglev_ctrl.analysis.loops import Loop, return_ratio
from maglev_ctrl.analysis.margins import loop_margins
from maglev_ctrl.analysis.modes import modes, spectral_abscissa
from maglev_ctrl.analysis.resonance_map import ResonanceMap, critical_depth_curve, resonance_map
from maglev_ctrl.analysis.tracking import track
from maglev_ctrl.errors import NotStable, Verdict
from maglev_ctrl.forces import ImageForce
from maglev_ctrl.study.records import (
    Comparison,
    FloquetStudy,
    NyquistCurve,
    OptionStudy,
    RequirementResult,
    RootLocus,
    Sweep,
    SweepName,
)
from maglev_ctrl.synthesis.design import Design
from maglev_ctrl.synthesis.laws import design_lqr
from maglev_ctrl.synthesis.weights import InputWeight, OutputWeight
from maglev_ctrl.systems import PeriodicSystem, SecondOrderSystem, close_loop, loop_matrices, modulate
from maglev_ctrl.vehicle import (
    Actuator,
    Body,
    OperatingPoint,
    SpringDamper,
    Vehicle,
    as_feedback,
    equilibrium,
    linearize,
    stiffness_modulation,
)
from maglev_ctrl.vehicle.models import MagnetRow, Secondary, two_stage

SPEED, HEIGHT, WAVELENGTH, DEPTH = 500.0 / 3.6, 0.20, 40.0, 0.15


def train(mass: float = 108e3) -> Vehicle:
    """A car on two bogies with image-force magnets whose heave damping is negative at speed."""
    coil = ImageForce(6e5, 1.5, 2.5e7, 0.02, 1.0, vertical_velocity="receding_image")
    bogies = [Body("front", 13.5e3, position=(14.0, 0.0, 0.0)), Body("rear", 13.5e3, position=(-14.0, 0.0, 0.0))]
    return two_stage(
        Body("car", mass, inertia=(0.0, 2.8e7, 0.0), dofs=("heave", "pitch")),
        bogies,
        magnets=MagnetRow(coil, 10, length=24.0, half_gauge=1.35),
        secondary=Secondary(1.36e6),
        reference_height=HEIGHT,
    )


def _windings() -> tuple[SpringDamper, ...]:
    return tuple(
        SpringDamper(f"winding_{name}", name, position=(x, 0.0, 0.0), damping=1.2e4, lag=0.03)
        for name, x in (("front", 14.0), ("rear", -14.0))
    )


def _cylinders() -> tuple[Actuator, ...]:
    return tuple(
        Actuator(f"cylinder_{name}", name, to="car", position=(x, 0.0, 0.0), bandwidth=125.0)
        for name, x in (("front", 14.0), ("rear", -14.0))
    )


def _design(vehicle: Vehicle) -> Design:
    plant = linearize(vehicle, OperatingPoint(SPEED, HEIGHT))
    outputs = (("car.heave.acceleration", 0.5), ("front.heave", 0.02), ("rear.heave", 0.02))
    return design_lqr(
        plant,
        [OutputWeight(name, size) for name, size in outputs],
        [InputWeight("cylinder_front", 2e4), InputWeight("cylinder_rear", 2e4)],
    )


def _closed(vehicle: Vehicle, design: Design | None, at: OperatingPoint) -> SecondOrderSystem:
    system = linearize(vehicle, at)
    return system if design is None else close_loop(system, design.controller)


def _sweep(vehicle: Vehicle, design: Design | None, name: SweepName, count: int) -> Sweep:
    low, high = {"speed": (100 / 3.6, 550 / 3.6), "height": (0.12, 0.28)}.get(name, (100 / 3.6, 550 / 3.6))
    values = np.linspace(low, high, count)

    def at(value: float) -> OperatingPoint:
        return OperatingPoint(SPEED, value) if name == "height" else OperatingPoint(value, HEIGHT)

    points = [modes(_closed(vehicle, design, at(float(v)))) for v in values]
    tracks = track(points, parameter=values)
    unit, scale = ("mm", 1e3) if name == "height" else ("km/h", 3.6)
    least = [float(np.min(p.damping_ratio[p.s.imag > p.error_bound])) for p in points]
    boundaries = stability_boundaries(
        lambda v: float(spectral_abscissa(_closed(vehicle, design, at(v)))), low, high, samples=40
    )
    return Sweep(name, unit, scale, values, tracks, np.array([p.spectral_abscissa for p in points]), np.array(least),
                 boundaries, ())  # fmt: skip


def _loop(vehicle: Vehicle, design: Design | None) -> Loop | None:
    at = OperatingPoint(SPEED, HEIGHT)
    if design is not None:
        return Loop(*loop_matrices(linearize(vehicle, at), design.controller), design.controller.commands)
    own = tuple(c.name for c in vehicle.connections if c.name.startswith("winding"))
    if not own:
        return None
    opened, law = as_feedback(vehicle, own)
    return Loop(*loop_matrices(linearize(opened, at), law), law.commands)


def _locus(loop: Loop) -> RootLocus:
    gain = np.linspace(0.0, 1.5, 31)
    eye = np.eye(len(loop.channels))
    closed = [loop.A - loop.B @ np.linalg.solve(eye + g * loop.D, g * loop.C) for g in gain]
    return RootLocus(gain, np.linalg.eigvals(np.stack(closed)))


def _nyquist(loop: Loop) -> tuple[NyquistCurve, ...]:
    poles = np.linalg.eigvals(loop.A)
    near = [w * (1.0 + np.sinh(np.linspace(-6, 6, 61)) / 2e3) for w in poles.imag if w > 0.1]
    frequency = np.unique(np.concatenate([np.geomspace(0.05, 500.0, 300), *near]))
    response = return_ratio(loop, frequency)
    curves = []
    for i, channel in enumerate(loop.channels):
        j = 1 - i
        own = response[:, i, i] - response[:, i, j] * response[:, j, i] / (1.0 + response[:, j, j])
        curves.append(NyquistCurve(channel, frequency, own))
    return tuple(curves)


def _runs(flags: np.ndarray) -> list[tuple[int, int]]:  # type: ignore[type-arg]
    """First and last index of every run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(int)))
    return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _at(found: ResonanceMap, column: int, depth: float) -> str:
    index = int(found.tongue_index[column, int(np.argmin(np.abs(found.depths - depth)))])
    return found.tongues[index].name if index >= 0 else "none"


def _floquet_margins(periodic: Callable[[float, float], PeriodicSystem]) -> tuple[FloquetMargins | None, str]:
    try:
        found = floquet_margins(
            lambda *, depth, gain, speed: periodic(speed, depth), depth=DEPTH, speed=SPEED, largest_depth=0.5,
            gain_limits=None, speed_limits=(60 / 3.6, 550 / 3.6), samples=8,
        )  # fmt: skip
    except NotStable as fault:
        return None, f"no margins: {fault}"
    return found, "no gain margin: the gain is not varied here"


def _floquet(vehicle: Vehicle, design: Design | None, *, count: int) -> FloquetStudy:
    def periodic(speed: float, depth: float, closed: bool = True):  # type: ignore[no-untyped-def]
        at = OperatingPoint(speed, HEIGHT)
        K_cos, K_sin = stiffness_modulation(vehicle, at, wavelength=WAVELENGTH)
        system = _closed(vehicle, design if closed else None, at)
        return modulate(system, depth * K_cos, depth * K_sin, frequency=2 * np.pi * speed / WAVELENGTH)

    speeds = np.linspace(60 / 3.6, 550 / 3.6, count)
    depths = np.linspace(0.0, 0.5, count)
    unit = [periodic(float(v), 1.0) for v in speeds]
    found = resonance_map(
        np.stack([u.A_0 for u in unit]), np.stack([u.A_cos for u in unit]), np.stack([u.A_sin for u in unit]),
        np.array([float(u.frequency) for u in unit]), depths, parameter=speeds, parameter_name="speed",
        states=unit[0].states,
    )  # fmt: skip
    stable_at_zero = ~found.unstable[:, 0]
    curve = critical_depth_curve(
        np.stack([u.A_0 for u in unit]), np.stack([u.A_cos for u in unit]), np.stack([u.A_sin for u in unit]),
        np.array([float(u.frequency) for u in unit]), depth_max=0.5, parameter=speeds, states=unit[0].states,
    )  # fmt: skip
    critical = curve.depth
    candidates = np.where(stable_at_zero, critical, np.inf)
    worst = int(np.argmin(candidates))
    at_expected = found.unstable[:, int(np.argmin(np.abs(depths - DEPTH)))]
    bad = tuple((float(speeds[a]), float(speeds[b]), _at(found, a, DEPTH)) for a, b in _runs(at_expected))
    good = tuple((float(speeds[a]), float(speeds[b])) for a, b in _runs(~at_expected))
    margins, missing = _floquet_margins(periodic)
    return FloquetStudy(
        WAVELENGTH, DEPTH, floquet(periodic(SPEED, DEPTH)), None, found, critical, 0.5, float(candidates[worst]),
        float(speeds[worst]), curve.resonances[worst].name, good, bad, margins, missing,
    )  # fmt: skip


def _judge(name: str, words: str, sense: str, limit: float, value: float, unit: str, reason: str) -> RequirementResult:
    if math.isnan(value):
        verdict, margin, why = Verdict.NOT_EVALUATED, math.nan, reason
    else:
        inside = value - limit if sense == "at_least" else limit - value
        verdict = Verdict.PASS if inside >= 0.0 else Verdict.FAIL
        margin, why = 100.0 * inside / abs(limit), "" if inside >= 0.0 else "outside the limit"
    return RequirementResult(
        name=name, quantity=name, description=words, sense=sense, limit=limit, value=value, unit=unit,  # type: ignore[arg-type]
        verdict=verdict, margin_percent=margin, worst_at="speed 500 km/h", method="eigenvalues, confirmed by inertia",
        reason=why, bound="exact",
    )  # fmt: skip


def _requirements(study: OptionStudy) -> tuple[RequirementResult, ...]:
    sweep, margins = study.sweeps[0], study.margins
    growth, light = float(np.max(sweep.abscissa)), float(np.min(sweep.least_damping))
    disk = math.nan if margins is None else min(c.disk.alpha for c in margins.channels)
    phase = math.nan if margins is None else min(c.phase.value for c in margins.channels)
    depth = math.nan if study.floquet is None else study.floquet.worst_depth / DEPTH
    return (
        _judge("stable", "largest growth rate over the speed sweep", "at_most", -0.01, growth, "1/s", ""),
        _judge("damping", "least damping ratio over the speed sweep", "at_least", 0.02, light, "", ""),
        _judge("disk", "least disk margin of a channel", "at_least", 0.4, disk, "", study.margins_reason),
        _judge("phase_margin", "least phase margin", "at_least", 30.0, phase, "deg", study.margins_reason),
        _judge("modulation", "depth survived / expected depth", "at_least", 2.0, depth, "", study.floquet_reason),
    )


def option(
    name: str, label: str, kind: str, vehicle: Vehicle, *, active: bool = False, points: int = 24, cells: int = 40
) -> OptionStudy:
    """One option, fully studied."""
    design = _design(vehicle) if active else None
    at = OperatingPoint(SPEED, HEIGHT)
    system = _closed(vehicle, design, at)
    loop = _loop(vehicle, design)
    margins, reason = None, "the option adds no loop"
    if loop is not None:
        try:
            margins, reason = loop_margins(loop), ""
        except NotStable as fault:
            reason = str(fault)
    study = OptionStudy(
        name=name, label=label, kind=kind, summary=("Elements as in the scenario",), vehicle=vehicle,
        failure="",
        equilibrium=equilibrium(vehicle, at), system=system, open_system=linearize(vehicle, at), modes=modes(system),
        design=design, sweeps=(_sweep(vehicle, design, "speed", points), _sweep(vehicle, design, "height", 5)),
        locus=None if loop is None else _locus(loop), margins=margins, margins_reason=reason,
        nyquist=() if loop is None else _nyquist(loop), floquet=_floquet(vehicle, design, count=cells),
        floquet_reason="",
        requirements=(), notes=(), seconds=1.0,
    )  # fmt: skip
    return replace(study, requirements=_requirements(study))


def comparison(*, points: int = 24, cells: int = 40) -> Comparison:
    """Three options of one vehicle: bare, passive, active."""
    bare = train()
    studies = (
        option("bare", "No added suspension", "baseline", bare, points=points, cells=cells),
        option("windings", "Damper windings", "passive_primary", bare.with_elements(connections=_windings()),
               points=points, cells=cells),
        option("lqr", "Active secondary, LQR", "active_secondary", bare.with_elements(actuators=_cylinders()),
               active=True, points=points, cells=cells),
    )  # fmt: skip
    return Comparison(
        title="Three ways to suspend a test train", description="A small scenario for the tests of the report.",
        scenario_path="tests/three.toml", scenario_text="format = 1\ntitle = \"Three ways\"\n", 
        scenario_hash="0123456789abcdef" * 4,
        sources=(("typed", "numbers typed for this test"),), assumptions=("The guideway is rigid.",),
        forces=("Image force, typed for this test.",), 
        design_speed=SPEED,
        design_height=HEIGHT, options=studies, versions=(("maglev-ctrl", "0.1.0"), ("numpy", np.__version__)),
        created="2026-01-01T00:00:00Z", seconds=3.0,
    )  # fmt: skip
