"""Linear numbers beside those of the nonlinear vehicle: growth of small motions, deviations, a parametric tongue."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from maglev_ctrl.analysis.floquet import floquet
from maglev_ctrl.analysis.simulation.ensemble import ensemble_rms
from maglev_ctrl.analysis.simulation.measure import Growth, measured_growth
from maglev_ctrl.analysis.simulation.records import Trajectory
from maglev_ctrl.errors import Agreement, MaglevError
from maglev_ctrl.guideway import Modulation
from maglev_ctrl.study.forcing import periodic_system
from maglev_ctrl.study.nonlinear.records import Compared
from maglev_ctrl.study.nonlinear.tracks import SimulatedTracks, in_band
from maglev_ctrl.study.ride import ride_at
from maglev_ctrl.study.situation import VERIFICATION_ORDER
from maglev_ctrl.systems.periodic import at_depth

if TYPE_CHECKING:
    from maglev_ctrl.study.nonlinear.run import SimulatedOption

GROWTH_TOLERANCE = 0.01
"""Of |s|: how far a measured growth rate may be from the linear one."""
CONFIDENCE = 0.95
"""Of the band of a standard deviation over the runs; with ten signals one in two options misses one of them by chance,
so disagreement is told only where the wider of two bands misses by as much again."""
_FAULTS = (MaglevError, ValueError, ArithmeticError, np.linalg.LinAlgError)
CYCLES = 12.0
DECAYS = 4.0
"""Time constants of the slowest decay that a window holds: of what is smaller, roundings would be fitted."""
LARGEST_TOLERANCE, LARGEST_RESIDUAL = 0.05, 0.01
"""Of |s|: a rate known less well than this confirms nothing; so does a fit that leaves more than this unexplained."""


def compared_growth(one: SimulatedOption) -> tuple[Compared, float]:
    """Growth of small nonlinear motions beside the nearest eigenvalue; and the linear spectral abscissa, 1/s."""
    closed = one.model.closed_of(one.vehicle, one.situation, one.continuous, pade_order=VERIFICATION_ORDER)
    s = np.linalg.eigvals(closed.state_matrix())
    abscissa = float(np.max(s.real))
    slow = s[np.argmax(s.real)]
    duration = _window(s)
    try:
        found = measured_growth(
            one.vehicle, one.balanced, duration=duration, controller=one.continuous, seed=one.request.seed
        )  # fmt: skip
    except _FAULTS as fault:
        return _row("growth rate of small motions", "1/s", abscissa, np.nan, np.nan, np.nan, f"{fault}"), abscissa
    near = s[np.argmin(np.abs(s - complex(found.rate, found.frequency)))]
    reason = _growth_doubt(found, near, slow, _allowed(found, abs(near)), one.request.smallest_growth)
    name = f"growth rate of small motions, {found.frequency / (2.0 * np.pi):.3g} Hz"
    low, high = found.rate - found.spread, found.rate + found.spread
    return _row(name, "1/s", float(near.real), found.rate, low, high, reason), abscissa


def _allowed(found: Growth, size: float) -> float:
    """How far a measured rate may be from that of a root of this size, 1/s."""
    spread = found.spread if np.isfinite(found.spread) else 0.0
    return float(np.clip(2.0 * spread, GROWTH_TOLERANCE * size, LARGEST_TOLERANCE * size))


def _window(s: np.ndarray) -> float:
    """Long enough for the slowest oscillation, short enough that what decays slowest is still there."""
    oscillating = np.abs(s.imag[s.imag > 1e-3 * np.abs(s)])
    slowest = float(np.min(oscillating, initial=np.inf))
    decays = -float(np.max(s.real))
    wanted = CYCLES * 2.0 * np.pi / slowest if np.isfinite(slowest) else 10.0
    return float(np.clip(wanted, 1.0, max(DECAYS / decays, 1.0) if decays > 0.0 else 30.0))


def _growth_doubt(found: Growth, near: complex, slow: complex, allowed: float, smallest: float) -> str:
    if found.residual > LARGEST_RESIDUAL:
        return f"no few modes explain the nonlinear motion: {100.0 * found.residual:.2g} % of it are left over"
    if abs(found.rate - near.real) > allowed:
        return f"the nonlinear motion grows at {found.rate:.4g} 1/s, the nearest mode at {near.real:.4g} 1/s"
    both = min(abs(found.rate), abs(slow.real)) > smallest
    if both and (found.rate > 0.0) != (slow.real > 0.0):
        return f"the linear verdict rests on a mode of {slow.real:.4g} 1/s that the nonlinear motion does not show"
    return ""


def compared_spreads(
    one: SimulatedOption, found: Trajectory, tracks: SimulatedTracks, *, discard: float
) -> list[Compared]:
    """Standard deviations over the runs beside those of the linear theory in the same band."""
    if found.events:
        return []  # a run that ended early has no deviation to compare; its end is told as what it is
    try:
        linear = ride_at(in_band(one.model, tracks.band), one.continuous, one.situation)
    except _FAULTS as fault:
        return [_row("standard deviations", "m", np.nan, np.nan, np.nan, np.nan, f"{fault}")]
    wanted: list[tuple[str, str, str, float]] = []
    car = one.vehicle.bodies[0].name
    for passenger in linear.passengers:
        if (passenger.x, passenger.y) == (0.0, 0.0) and "vertical" in passenger.axes:
            at = passenger.axes.index("vertical")
            wanted.append(
                (f"acceleration of {car}", "m/s^2", f"{car}.heave.acceleration", float(passenger.unweighted[at]))
            )
    for gap in linear.clearances:
        if gap.kind == "gap" and not gap.name.endswith("(wall)"):
            wanted.append((f"height of {gap.name}", "m", f"{gap.name}.height", gap.deviation))
        elif gap.kind == "stroke":
            wanted.append((f"stroke of {gap.name}", "m", f"{gap.name}.stroke", gap.deviation))
    wanted += [(f"force of {a.name}", "N", f"{a.name}.applied", a.force) for a in linear.actuators]
    share = discard / float(found.time[-1])
    return [
        _spread(name, unit, value, np.asarray(found.signals[signal]), share)
        for name, unit, signal, value in wanted
        if signal in found.signals and np.isfinite(value)
    ]


def _spread(name: str, unit: str, linear: float, values: np.ndarray, share: float) -> Compared:
    measured = ensemble_rms(values, discard=share, confidence=CONFIDENCE, about_mean=True)
    low = min(measured.band[0], measured.scatter_band[0])
    high = max(measured.band[1], measured.scatter_band[1])
    wide = (measured.rms - 2.0 * (measured.rms - low), measured.rms + 2.0 * (high - measured.rms))
    inside = wide[0] <= linear <= wide[1]
    reason = "" if inside else f"outside {100 * CONFIDENCE:g} % of the runs' scatter, and by as much again"
    return _row(f"standard deviation: {name}", unit, linear, measured.rms, low, high, reason)


def compared_tongue(one: SimulatedOption) -> list[Compared]:
    """Growth under the expected modulation, by Floquet theory and by the simulated vehicle."""
    periodic = one.model.scenario.periodic
    if periodic is None or periodic.wavelength is None or periodic.depth is None:
        return []
    name = "growth rate under the expected modulation"
    try:
        system = at_depth(periodic_system(one.model, one.vehicle, one.situation, one.continuous), periodic.depth)
        theory = floquet(system)
        modulation = Modulation(periodic.wavelength, periodic.depth, periodic.harmonics)
        found = measured_growth(
            one.vehicle, one.balanced, duration=_window(np.asarray(theory.exponents)), controller=one.continuous,
            modulation=modulation, seed=one.request.seed,
        )  # fmt: skip
    except _FAULTS as fault:
        return [_row(name, "1/s", np.nan, np.nan, np.nan, np.nan, f"{fault}")]
    rates = np.asarray(theory.exponents).real
    near = float(rates[np.argmin(np.abs(rates - found.rate))])
    allowed = _allowed(found, float(np.max(np.abs(theory.exponents))))
    verdicts = min(abs(found.rate), abs(float(np.max(rates)))) > one.request.smallest_growth
    reason = ""
    if abs(found.rate - near) > allowed:
        reason = f"the nonlinear motion grows at {found.rate:.4g} 1/s, the nearest Floquet exponent says {near:.4g} 1/s"
    elif verdicts and (found.rate > 0.0) != (float(np.max(rates)) > 0.0):
        reason = "Floquet theory and the nonlinear motion differ on whether it grows"
    return [_row(name, "1/s", near, found.rate, found.rate - found.spread, found.rate + found.spread, reason)]


def _row(
    name: str, unit: str, linear: float, nonlinear: float, low: float, high: float, reason: str
) -> Compared:  # fmt: skip
    agreed = not reason and np.isfinite(linear) and np.isfinite(nonlinear)
    return Compared(
        name, unit, linear, nonlinear, low, high, Agreement.AGREED if agreed else Agreement.UNRESOLVED, reason
    )  # fmt: skip


def row(name: str, unit: str, *, linear: float, nonlinear: float, band: tuple[float, float], reason: str) -> Compared:
    """A comparison; AGREED where both numbers exist and nothing speaks against them."""
    return _row(name, unit, linear, nonlinear, band[0], band[1], reason)
