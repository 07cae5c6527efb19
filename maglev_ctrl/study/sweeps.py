"""Eigenvalues of one option along one operating parameter: tracked, bounded, with the holes named."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize_scalar

from maglev_ctrl.analysis.boundary import Boundaries, stability_boundaries
from maglev_ctrl.analysis.modes import Modes, modes
from maglev_ctrl.analysis.tracking import ModeTracks, track
from maglev_ctrl.arrays import ComplexArray, FloatArray, read_only_any
from maglev_ctrl.errors import ModelError, OutOfDomain
from maglev_ctrl.scenario import Scenario
from maglev_ctrl.study.records import Sweep, SweepName
from maglev_ctrl.study.situation import OptionModel, Situation
from maglev_ctrl.systems import Controller, SecondOrderSystem
from maglev_ctrl.vehicle import Vehicle

DISPLAY: dict[SweepName, tuple[str, float]] = {
    "speed": ("km/h", 3.6),
    "payload": ("t", 1e-3),
    "height": ("mm", 1e3),
    "gap": ("mm", 1e3),
    "lateral_offset": ("mm", 1e3),
}
"""Display unit of each parameter and the factor from SI."""

DENSE = 20
"""A sweep of fewer points is searched for its worst place on twice as many."""


def varied(design: Situation, parameter: SweepName, value: float) -> Situation:
    """The design situation with one parameter set to another value."""
    match parameter:
        case "speed":
            return replace(design, speed=value)
        case "payload":
            return replace(design, payload=value)
        case "height":
            return replace(design, height=value)
        case "gap":
            return replace(design, gap=value)
        case "lateral_offset":
            return replace(design, lateral_offset=value)


def place(one: Sweep, value: float) -> str:
    """A value of the swept parameter as people read it: "speed 153 km/h"."""
    return f"{one.parameter.replace('_', ' ')} {value * one.scale:.4g} {one.unit}"


def sweep_values(scenario: Scenario) -> tuple[tuple[SweepName, FloatArray], ...]:
    """The scenario's sweeps: parameter and values in SI."""
    sweeps = scenario.operating.sweep
    found: list[tuple[SweepName, FloatArray]] = []
    names: tuple[SweepName, ...] = ("speed", "payload", "height", "gap", "lateral_offset")
    for name in names:
        record = getattr(sweeps, name)
        if record is not None:
            found.append((name, np.linspace(record.first, record.last, record.count)))
    return tuple(found)


def sweep(model: OptionModel, controller: Controller | None, *, parameter: SweepName, values: FloatArray) -> Sweep:
    """The closed loop's eigenvalues at every value of one parameter, all others at the design point.

    Points without an equilibrium or outside the force data are left as NaN and named in `gaps`.

    Parameters
    ----------
    values : (p,) SI, rising
    """
    closed = _closed_at(model, controller, parameter)
    systems: list[SecondOrderSystem | None] = []
    gaps: list[tuple[float, str]] = []
    for value in values:
        try:
            systems.append(closed(float(value)))
        except (ModelError, OutOfDomain) as fault:
            systems.append(None)
            gaps.append((float(value), str(fault)))
    good = [i for i, system in enumerate(systems) if system is not None]
    found = [modes(system) for system in systems if system is not None]
    unit, scale = DISPLAY[parameter]
    abscissa, damping = np.full(len(values), np.nan), np.full(len(values), np.nan)
    for i, one in zip(good, found, strict=True):
        abscissa[i] = one.spectral_abscissa
        damping[i] = least_damping(one)
    return Sweep(
        parameter=parameter,
        unit=unit,
        scale=scale,
        values=read_only_any(values),
        tracks=_tracks(found, good, values),
        abscissa=read_only_any(abscissa),
        least_damping=read_only_any(damping),
        boundaries=_boundaries(closed, values, found),
        gaps=tuple(gaps),
    )


def least_damping(found: Modes) -> float:
    """Smallest damping ratio among the oscillating modes; NaN when nothing oscillates."""
    oscillating = found.s.imag > found.error_bound
    return float(np.min(found.damping_ratio[oscillating])) if np.any(oscillating) else float("nan")


def worst_places(model: OptionModel, controller: Controller | None, one: Sweep) -> tuple[float, ...]:
    """Where along a sweep growth is largest and damping least, also between its points; and the two ends.

    The neighbourhood of the worst sample is searched; a sweep of few points is first made twice as dense.
    """
    closed = _closed_at(model, controller, one.parameter)
    there = np.isfinite(one.abscissa)
    known = one.values[there]
    if not known.size:
        return ()
    between = 0.5 * (known[1:] + known[:-1]) if len(known) < DENSE else known[:0]
    order = np.argsort(np.concatenate([known, between]))
    places = [float(known[0]), float(known[-1])]
    known = np.concatenate([known, between])[order]
    for badness, sampled in ((_growth, one.abscissa), (_lack_of_damping, -one.least_damping)):
        added = [_badness(closed, float(v), badness) for v in between]
        values = np.nan_to_num(np.concatenate([sampled[there], added])[order], nan=-np.inf)
        k = int(np.argmax(values))
        low, high = float(known[max(k - 1, 0)]), float(known[min(k + 1, len(known) - 1)])
        found = minimize_scalar(
            lambda v, of=badness: -_badness(closed, float(v), of), bounds=(low, high), method="bounded",
            options={"xatol": 1e-3 * (high - low), "maxiter": 20},
        )  # fmt: skip
        places.append(float(found.x) if -float(found.fun) > values[k] else float(known[k]))
    # What bisection and refinement met beyond the samples counts too.
    if np.any(np.isfinite(one.boundaries.abscissa)):
        places.append(float(one.boundaries.parameter[int(np.nanargmax(one.boundaries.abscissa))]))
    return tuple(dict.fromkeys(places))


def _badness(
    closed: Callable[[float], SecondOrderSystem], value: float, measure: Callable[[ComplexArray], float]
) -> float:
    try:
        return measure(np.asarray(np.linalg.eigvals(closed(value).state_matrix()), dtype=np.complex128))
    except (ModelError, OutOfDomain):
        return -np.inf


def _growth(s: ComplexArray) -> float:
    return float(np.max(s.real))


def _lack_of_damping(s: ComplexArray) -> float:
    """Minus the least damping ratio of the oscillating eigenvalues."""
    oscillating = s[s.imag > 1e-9 * np.abs(s)]
    return float(np.max(oscillating.real / np.abs(oscillating))) if oscillating.size else -np.inf


def _closed_at(
    model: OptionModel, controller: Controller | None, parameter: SweepName
) -> Callable[[float], SecondOrderSystem]:
    design = Situation.of_design(model.scenario)
    vehicles: dict[float | None, Vehicle] = {}
    systems: dict[float, SecondOrderSystem] = {}  # the search for boundaries begins on the sweep's own points

    def closed(value: float) -> SecondOrderSystem:
        situation = varied(design, parameter, value)
        if situation.payload not in vehicles:
            vehicles[situation.payload] = model.vehicle(situation.payload)
        if value not in systems:
            systems[value] = model.closed_of(vehicles[situation.payload], situation, controller)
        return systems[value]

    return closed


def _boundaries(closed: Callable[[float], SecondOrderSystem], values: FloatArray, found: list[Modes]) -> Boundaries:
    """Stability boundaries by bisection between the sweep's ends."""
    # What the eigenvalues cannot tell from zero is not called unstable.
    neutral = max((float(np.max(one.error_bound)) for one in found), default=0.0)
    return stability_boundaries(
        lambda value: float(np.max(np.linalg.eigvals(closed(value).state_matrix()).real)),
        float(values[0]), float(values[-1]), samples=max(len(values), 3), neutral=neutral,
    )  # fmt: skip


def _tracks(found: list[Modes], good: list[int], values: FloatArray) -> ModeTracks:
    """Tracks over the points that exist, spread over all values with NaN between."""
    if not found:
        return ModeTracks(
            parameter=read_only_any(values), s=read_only_any(np.full((len(values), 0), np.nan, dtype=complex)),
            labels=(), kinds=tuple(() for _ in values), confidence=read_only_any(np.full((len(values), 0), np.nan)),
            index=read_only_any(np.full((len(values), 0), -1)),
        )  # fmt: skip
    tracks = track(found, parameter=values[good])
    if len(good) == len(values):
        return tracks
    lines = len(tracks.labels)
    s = np.full((len(values), lines), np.nan, dtype=complex)
    confidence = np.full((len(values), lines), np.nan)
    index = np.full((len(values), lines), -1)
    s[good], confidence[good], index[good] = tracks.s, tracks.confidence, tracks.index
    nothing = (None,) * lines
    kinds = tuple(tracks.kinds[good.index(i)] if i in good else nothing for i in range(len(values)))
    return ModeTracks(
        parameter=read_only_any(values), s=read_only_any(s), labels=tracks.labels, kinds=kinds,
        confidence=read_only_any(confidence), index=read_only_any(index),
    )  # fmt: skip
