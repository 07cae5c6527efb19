"""Growth and frequency of small motions measured in the simulation, and the boundary at which they begin to grow."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from maglev_ctrl.analysis.simulation.records import Limits, Trajectory
from maglev_ctrl.analysis.simulation.run import simulate
from maglev_ctrl.arrays import ComplexArray, FloatArray
from maglev_ctrl.errors import Agreement
from maglev_ctrl.guideway import Modulation
from maglev_ctrl.systems import Controller, close_loop
from maglev_ctrl.vehicle import Equilibrium, Vehicle, linearize

AMPLITUDE = 1e-9
"""First displacements, relative to the reference height (per metre of the largest lever for rotations)."""

LINEAR = 1e-5
"""Displacements above this share of the reference height no longer count as small: squares of them, which grow twice
as fast, stay below what is told."""

SAMPLES_PER_CYCLE = 8
RANK = 1e-6
"""Singular values of the samples below this, relative to the largest, are taken for rounding and curvature."""

SIGNIFICANT = 1e-3
"""Least share of a mode in the motion, anywhere in the window, for it to be told."""

DEPTH = 3
"""Samples side by side in the fit: they stand in for states that are not signals (a law's, a delay's)."""

Case = tuple[Vehicle, Equilibrium, Controller | None]


@dataclass(frozen=True, eq=False, slots=True)
class Growth:
    """The dominant small motion of a simulation: the one of the largest growth with a share in what is seen.

    `rate` 1/s, `frequency` rad/s (0: monotonic; with a modulated track modulo the passing frequency); `spread` of the
    rate between fits of the first and the second half of the window; `residual` of the fit, relative; `window` s;
    `modes` (k, 2): rate and frequency of all, largest growth first.
    """

    rate: float
    frequency: float
    spread: float
    residual: float
    window: float
    modes: FloatArray


def measured_growth(
    vehicle: Vehicle,
    equilibrium: Equilibrium,
    *,
    duration: float,
    controller: Controller | None = None,
    modulation: Modulation | None = None,
    coordinates: Sequence[str] | None = None,
    runs: int = 4,
    seed: int = 0,
    sampling: float | None = None,
    computation: float = 0.0,
    step: float | None = None,
) -> Growth:
    """Growth rate and frequency measured from small nonlinear motions.

    Runs start from random displacements and velocities, and a linear map from samples to the next samples is fitted
    to all of them (least squares on their principal components); its eigenvalues are those of the motion. Nothing of
    the linear model enters but the default sampling interval.

    Parameters
    ----------
    coordinates : that are displaced and watched; all but surge when left out
    sampling : s; with a modulated track its passing period, whatever is given
    duration, controller, modulation, computation, step : as in `simulate`

    Raises
    ------
    ValueError : a coordinate that does not exist, or too short a duration

    Examples
    --------
    >>> from maglev_ctrl.vehicle import Body, OperatingPoint, SpringDamper, equilibrium
    >>> leg = SpringDamper("leg", "car", stiffness=4000.0, damping=20.0)
    >>> cart = Vehicle("cart", (Body("car", 10.0),), connections=(leg,), reference_height=0.1)
    >>> found = measured_growth(cart, equilibrium(cart, OperatingPoint(0.0, 0.1)), duration=2.0)
    >>> round(found.rate, 4), round(found.frequency, 3)                              # sqrt(20^2 - 1)
    (-1.0, 19.975)
    """
    names = _coordinates(vehicle, coordinates)
    if modulation is not None:
        sampling = 2.0 * np.pi / float(modulation.frequency(equilibrium.at.speed))
    elif sampling is None:
        sampling = _interval(vehicle, equilibrium, controller, duration)
    watched = (*names, *(f"{name}.velocity" for name in names))
    reach = _reach(vehicle)
    scale = {name: vehicle.reference_height / (reach if _turns(name) else 1.0) for name in names}
    random = np.random.default_rng(seed)
    start = {}
    for name in names:
        start[name] = AMPLITUDE * scale[name] * random.standard_normal(runs)
        start[f"{name}.velocity"] = AMPLITUDE * scale[name] / sampling * random.uniform(-0.3, 0.3, runs)
    found = simulate(
        vehicle, equilibrium, duration=duration, controller=controller, modulation=modulation, start=start, runs=runs,
        seed=seed, sampling=sampling, computation=computation, noise=False, signals=watched, step=step,
        limits=Limits(travel=np.inf, turn=np.inf),
    )  # fmt: skip
    samples = np.stack([found.of(name) for name in watched], axis=-1)
    return _growth(samples, found, np.array([scale[name] for name in names]))


def _growth(samples: FloatArray, found: Trajectory, scale: FloatArray) -> Growth:
    """The fit to samples (r, s, channels) of small motion; scale (channels / 2,) of the displacements."""
    moved = np.max(np.abs(samples[:, :, : len(scale)]) / scale, axis=(0, 2))
    large = np.flatnonzero(~(moved <= LINEAR))
    count = int(large[0]) if len(large) else samples.shape[1]
    if count < 4 * DEPTH:
        raise ValueError(
            f"duration: expected at least {4 * DEPTH} samples of small motion, got {count} every {found.interval:.4g} s"
        )
    # The first eighth of the window lets what decays fast go.
    inside = samples[:, count // 8 : count]
    modes, residual = fitted_modes(inside, found.interval)
    half = inside.shape[1] // 2
    ends = [fitted_modes(part, found.interval)[0] for part in (inside[:, :half], inside[:, half:])]
    # The same motion in either half: what else a half holds (roundings of what has decayed) says nothing about it.
    rates = [float(part[np.argmin(np.abs(part - modes[0]))].real) for part in ends if len(part)]
    spread = abs(rates[0] - rates[1]) if len(rates) == 2 else np.nan
    table = np.stack([modes.real, np.abs(modes.imag)], axis=-1)
    return Growth(
        rate=float(table[0, 0]),
        frequency=float(table[0, 1]),
        spread=spread,
        residual=residual,
        window=inside.shape[1] * found.interval,
        modes=table,
    )


def fitted_modes(samples: FloatArray, interval: float) -> tuple[ComplexArray, float]:
    """Exponents (k,) of the modes in samples (r, s, channels) of free motion, largest growth first, and the residual.

    One of each conjugate pair is told, with a frequency that is not negative.

    Parameters
    ----------
    interval : s between samples; frequencies are told up to pi / interval

    Raises
    ------
    ValueError : nothing moves

    Examples
    --------
    >>> t = 0.05 * np.arange(60)
    >>> wave = np.exp(-0.5 * t) * np.cos(3.0 * t)
    >>> modes, residual = fitted_modes(wave[None, :, None], 0.05)
    >>> np.round(modes, 6)
    array([-0.5+3.j])
    """
    depth = min(DEPTH, samples.shape[1] - 2)
    size = np.sqrt(np.mean(samples**2, axis=(0, 1)))
    if not np.any(size > 0.0):
        raise ValueError("samples: nothing moves")
    scaled = samples[:, :, size > 0.0] / size[size > 0.0]
    s = scaled.shape[1]
    rows = np.concatenate([scaled[:, d : s - depth + d + 1] for d in range(depth)], axis=-1)
    now, following = rows[:, :-1].reshape(-1, rows.shape[-1]), rows[:, 1:].reshape(-1, rows.shape[-1])
    # Samples of a growing or decaying motion count alike.
    weight = 1.0 / np.maximum(np.linalg.norm(now, axis=1), 1e-300)
    now, following = now * weight[:, None], following * weight[:, None]
    left, values, right = np.linalg.svd(now, full_matrices=False)
    rank = int(np.sum(values > RANK * values[0]))
    reduced = (left[:, :rank].T @ following @ right[:rank].T) / values[:rank, None]
    multipliers, vectors = np.linalg.eig(reduced.T)
    residual = float(np.linalg.norm(now @ right[:rank].T @ reduced - following @ right[:rank].T))
    residual /= float(np.linalg.norm(following))
    shares = np.abs(np.linalg.solve(vectors, (now @ right[:rank].T).T)) * np.linalg.norm(vectors, axis=0)[:, None]
    told = (np.max(shares, axis=1) > SIGNIFICANT) & (np.abs(multipliers) > 1e-12)
    exponents = np.log(multipliers[told].astype(np.complex128)) / interval
    exponents = exponents[exponents.imag > -1e-9 / interval]
    order = np.argsort(-exponents.real)
    return np.asarray(exponents[order], dtype=np.complex128), residual


@dataclass(frozen=True, eq=False, slots=True)
class BoundaryCheck:
    """Where small nonlinear motion begins to grow as a parameter changes, and where the linear model says it does.

    `boundary` the middle of `bracket`; `frequency` rad/s of the growing motion (0: divergence); `evaluations` (k, 2):
    values tried and their growth rates; `linear` from eigenvalues, NaN where the loop cannot be closed; `difference`
    of the two relative to the linear one.
    """

    boundary: float
    bracket: tuple[float, float]
    frequency: float
    evaluations: FloatArray
    linear: float
    difference: float
    agreement: Agreement
    reason: str


def boundary_check(
    make: Callable[[float], Case],
    between: tuple[float, float],
    *,
    duration: float,
    tolerance: float = 1e-3,
    neutral: float | None = None,
    agreement: float = 0.01,
    coordinates: Sequence[str] | None = None,
    runs: int = 4,
    seed: int = 0,
    step: float | None = None,
) -> BoundaryCheck:
    """Bisection for the parameter at which the measured growth changes sign, compared with the linear model's.

    Parameters
    ----------
    make : vehicle, equilibrium and controller at a value of the parameter
    between : values on either side of the boundary
    tolerance : width of the bracket, relative to the larger end
    neutral : growth rate that still counts as none, 1/s; 0.01 / duration when left out. An undamped vehicle is neutral
        on one side of its boundary
    agreement : largest relative difference that still counts as the same boundary
    duration, coordinates, runs, seed, step : as in `measured_growth`

    Raises
    ------
    ValueError : the growth has the same sign at both ends
    """
    low, high = between
    level = 0.01 / duration if neutral is None else neutral
    tried: dict[float, Growth] = {}

    def grows(value: float) -> bool:
        vehicle, rest, controller = make(value)
        tried[value] = measured_growth(
            vehicle, rest, duration=duration, controller=controller, coordinates=coordinates, runs=runs, seed=seed,
            step=step,
        )  # fmt: skip
        return tried[value].rate > level

    growing = grows(high)
    if grows(low) == growing:
        raise ValueError(
            f"between: expected growth at one end only, got {tried[low].rate:.4g} 1/s at {low:g} and "
            f"{tried[high].rate:.4g} 1/s at {high:g}"
        )
    bracket = _bisected(grows, low, high, growing=growing, tolerance=tolerance)
    unstable = tried[bracket[1] if growing else bracket[0]]
    boundary = 0.5 * sum(bracket)
    linear, fault = np.nan, ""
    try:
        linear = _linear_boundary(make, low, high, level, tolerance, coordinates)
    except ValueError as refused:
        fault = f"no linear boundary: {refused}"
    difference = abs(boundary - linear) / abs(linear) if linear else np.nan
    same = bool(difference <= agreement)
    told = "" if same else fault or f"the boundaries differ by {100.0 * difference:.3g} %"
    return BoundaryCheck(
        boundary=boundary,
        bracket=bracket,
        frequency=unstable.frequency,
        evaluations=np.array([[value, one.rate] for value, one in tried.items()]),
        linear=linear,
        difference=difference,
        agreement=Agreement.AGREED if same else Agreement.UNRESOLVED,
        reason=told,
    )


def _bisected(
    grows: Callable[[float], bool], low: float, high: float, *, growing: bool, tolerance: float
) -> tuple[float, float]:
    while abs(high - low) > tolerance * max(abs(low), abs(high)):
        middle = 0.5 * (low + high)
        if grows(middle) == growing:
            high = middle
        else:
            low = middle
    return low, high


def _linear_boundary(
    make: Callable[[float], Case],
    low: float,
    high: float,
    level: float,
    tolerance: float,
    coordinates: Sequence[str] | None,
) -> float:
    """Where the largest real part of the poles seen in the coordinates passes the level."""

    def grows(value: float) -> bool:
        vehicle, rest, controller = make(value)
        system = linearize(vehicle, rest)
        closed = system if controller is None else close_loop(system, controller)
        poles, vectors = np.linalg.eig(closed.state_matrix())
        seen = [closed.states.index(f"{name}.velocity") for name in _coordinates(vehicle, coordinates)]
        visible = np.linalg.norm(vectors[seen], axis=0) > SIGNIFICANT * np.linalg.norm(vectors, axis=0)
        return bool(np.max(poles.real[visible], initial=-np.inf) > level)

    growing = grows(high)
    if grows(low) == growing:
        raise ValueError(f"the linear model grows at both or neither of {low:g} and {high:g}")
    return 0.5 * sum(_bisected(grows, low, high, growing=growing, tolerance=0.1 * tolerance))


def _coordinates(vehicle: Vehicle, chosen: Sequence[str] | None) -> tuple[str, ...]:
    if chosen is None:
        return tuple(name for name in vehicle.dofs if not name.endswith(".surge"))
    unknown = [name for name in chosen if name not in vehicle.dofs]
    if unknown or not chosen:
        raise ValueError(f"coordinates: expected some of {', '.join(vehicle.dofs)}, got {', '.join(chosen) or 'none'}")
    return tuple(chosen)


def _turns(name: str) -> bool:
    return name.rsplit(".", 1)[1] in ("roll", "pitch", "yaw")


def _reach(vehicle: Vehicle) -> float:
    points = [*(magnet.position for magnet in vehicle.magnets), *(link.position for link in vehicle.links)]
    return max((float(np.linalg.norm(point)) for point in points), default=0.0) or 1.0


def _interval(vehicle: Vehicle, rest: Equilibrium, controller: Controller | None, duration: float) -> float:
    """Samples that resolve the fastest oscillation; a whole number of a sampled law's periods."""
    system = linearize(vehicle, rest, pade_order=0)
    period = None if controller is None else controller.dt
    closed = system if controller is None or period is not None else close_loop(system, controller)
    fastest = float(np.max(np.abs(np.linalg.eigvals(closed.state_matrix()).imag), initial=0.0))
    wanted = min(2.0 * np.pi / (SAMPLES_PER_CYCLE * fastest) if fastest > 0.0 else np.inf, duration / 64.0)
    return wanted if period is None else max(round(wanted / period), 1) * period
