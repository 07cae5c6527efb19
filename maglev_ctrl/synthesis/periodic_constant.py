"""What a constant gain can do for a periodic system, and how much a periodic one is better.

The constant gains are the linear-quadratic regulator of the averaged system and a local optimum of the periodic cost,
reached by the steps of Anderson and Moore (P. M. Mäkilä, H. T. Toivonen, IEEE Trans. Autom. Control 32 (1987) 658)
with periodic Lyapunov equations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import eigh

from maglev_ctrl.analysis.resonance_map import ResonanceMap, resonance_map
from maglev_ctrl.arrays import FloatArray, read_only, read_only_any, transpose
from maglev_ctrl.errors import ModelError, Status
from maglev_ctrl.kernels.fourier_matrix import FourierMatrix
from maglev_ctrl.kernels.periodic_riccati import periodic_riccati
from maglev_ctrl.synthesis.periodic import PeriodicRegulator
from maglev_ctrl.synthesis.periodic_problem import PeriodicProblem, cost_scale, loop_multipliers
from maglev_ctrl.synthesis.riccati import riccati_continuous
from maglev_ctrl.systems import PeriodicSystem

__all__ = ["ConstantGain", "LawRating", "PeriodicComparison", "compare_laws", "constant_lqr", "law_map", "law_rating"]

_NO_STEP = 1e-6


@dataclass(frozen=True, eq=False, slots=True)
class LawRating:
    """What a law u = -gain(t) x costs and asks for.

    `spectral_radius` of one period; `mean_cost_ratio` mean cost over starting phases and starting states relative to
    the best periodic law, `worst_cost_ratio` the same for the worst state and phase (both inf where not stable);
    `peak_gain` (m, n) largest modulus of each entry over the period; `peak_command` largest command from a starting
    state of the spread, in units of its weight.
    """

    name: str
    gain: FourierMatrix
    spectral_radius: float
    mean_cost_ratio: float
    worst_cost_ratio: float
    peak_gain: FloatArray
    peak_command: float

    @property
    def stable(self) -> bool:
        """Whether all motions decay."""
        return self.spectral_radius < 1.0


@dataclass(frozen=True, eq=False, slots=True)
class ConstantGain:
    """A constant gain (m, n): `origin` where it came from; `slope` relative gain of cost a further step would promise.

    `refined` is False where the gain was only evaluated or no step improved it, `steps` counts those taken.
    """

    gain: FloatArray
    origin: str
    refined: bool
    slope: float
    steps: int


@dataclass(frozen=True, eq=False, slots=True)
class PeriodicComparison:
    """The periodic law against constant ones; `constants` the averaged design (where it exists), then the refined."""

    periodic: LawRating
    constants: tuple[LawRating, ...]

    @property
    def best_constant(self) -> LawRating:
        """The constant law of least mean cost; where none is stable, of least spectral radius."""
        return min(self.constants, key=lambda law: (law.mean_cost_ratio, law.spectral_radius))


def periodic_cost(problem: PeriodicProblem, gain: FourierMatrix) -> FourierMatrix | None:
    """X(t) with x0' X(t) x0 the cost of the law u = -gain x from x0 at t; None where the loop is not stable.

    Examples
    --------
    >>> still = PeriodicSystem.from_matrices([[1.0]], [[[0.0]]], frequency=2.0)
    >>> problem = PeriodicProblem.of(still, [[1.0]], [[1.0]], [[1.0]])
    >>> periodic_cost(problem, FourierMatrix.of([[2.0]], frequency=2.0)).mean.round(9)
    array([[2.5]])
    """
    spent = gain.T.times(FourierMatrix.of(problem.R, frequency=gain.frequency)).times(gain)
    return _lyapunov(problem.closed(gain), FourierMatrix.of(problem.Q, frequency=gain.frequency).plus(spent))


def default_spread(P: FourierMatrix) -> FloatArray:
    """Covariance of starting states in which every direction costs the same on average: the inverse of mean P."""
    scale = cost_scale(P)
    return np.asarray(np.linalg.pinv(P.mean / np.outer(scale, scale), rcond=1e-10) / np.outer(scale, scale))


def law_rating(
    regulator: PeriodicRegulator, gain: FourierMatrix, *, name: str, spread: ArrayLike | None = None,
    offset: ArrayLike | None = None,
) -> LawRating:  # fmt: skip
    """Rate a law on the regulator's problem.

    Parameters
    ----------
    regulator : the best periodic law, for its problem and its cost
    gain : the law u = -gain(t) x; its frequency that of the problem
    name : how to call it
    spread : (n, n) covariance of the starting states; `default_spread` where not given
    offset : (m, n) constant part of the law that the problem has taken into its A(t), as a cross weight makes it:
        the command is -(gain + offset) x

    Raises
    ------
    ValueError : a shape or the frequency does not fit
    """
    problem, P = regulator.problem, regulator.P
    weight = _spread(P, spread)
    radius = float(np.max(np.abs(loop_multipliers(problem.closed(gain)))))
    cost = periodic_cost(problem, gain) if radius < 1.0 else None
    count = 2 * max(gain.harmonics, P.harmonics, 0 if cost is None else cost.harmonics) + 33
    whole = gain if offset is None else gain.plus(FourierMatrix.of(offset, frequency=gain.frequency))
    values = whole.samples(count)
    root = np.linalg.cholesky(problem.R).T
    lengths, axes = np.linalg.eigh(weight)
    commands = root @ values @ (axes * np.sqrt(np.maximum(lengths, 0.0)))
    return LawRating(
        name=name, gain=whole, spectral_radius=radius,
        mean_cost_ratio=np.inf if cost is None else float(np.sum(cost.mean * weight) / np.sum(P.mean * weight)),
        worst_cost_ratio=np.inf if cost is None else _worst_ratio(cost.samples(count), P.samples(count), P),
        peak_gain=read_only_any(np.max(np.abs(values), axis=0)),
        peak_command=float(np.max(np.linalg.norm(commands, 2, axis=(1, 2)))),
    )  # fmt: skip


def constant_lqr(
    regulator: PeriodicRegulator, *, refine: bool = True, spread: ArrayLike | None = None, steps: int = 100
) -> tuple[ConstantGain, ...]:
    """Constant gains for the regulator's problem: the averaged design, and a local optimum of the periodic cost.

    The refinement starts from the better of two gains, that of the averaged system and the mean of the periodic gain,
    and goes down the mean cost over starting phases and states. A local optimum: others may exist. Where neither start
    is stable nothing is refined and only the averaged design comes back.

    Parameters
    ----------
    regulator : the best periodic law
    refine : whether to refine
    spread : (n, n) covariance of the starting states; `default_spread` where not given
    steps : most steps of the refinement

    Raises
    ------
    ModelError : the averaged system has no regulator and refinement has no stable gain to start from
    """
    problem = regulator.problem
    weight = _spread(regulator.P, spread)
    found: list[ConstantGain] = []
    averaged = riccati_continuous(problem.A.mean, problem.B.mean, problem.Q, problem.R)
    if averaged.status in (Status.SOLVED, Status.ALMOST_SOLVED):
        found.append(ConstantGain(averaged.gain, "averaged system", False, np.nan, 0))
    if refine:
        starts = [*found, ConstantGain(regulator.gain.mean, "mean of the periodic gain", False, np.nan, 0)]
        costs = [_mean_cost(problem, start.gain, weight) for start in starts]
        if np.isfinite(min(costs)):
            found.append(_descend(problem, starts[int(np.argmin(costs))], weight, steps))
    if not found:
        raise ModelError(
            f"no constant gain was found; the averaged system: {averaged.message or averaged.status.value}"
        )
    return tuple(found)


def compare_laws(
    regulator: PeriodicRegulator, *, refine: bool = True, spread: ArrayLike | None = None,
    offset: ArrayLike | None = None,
) -> PeriodicComparison:  # fmt: skip
    """The periodic law and its constant competitors on the same problem.

    Parameters
    ----------
    regulator : the best periodic law
    refine : whether to refine the constant gain
    spread : (n, n) covariance of the starting states; `default_spread` where not given
    offset : as in `law_rating`

    Raises
    ------
    ModelError : no constant gain was found

    Examples
    --------
    >>> from maglev_ctrl.synthesis.periodic import periodic_lqr
    >>> mathieu = PeriodicSystem.from_matrices([[0, 1], [-1, 0]], [[[0, 0], [-0.9, 0]]], frequency=2.0)
    >>> problem = PeriodicProblem.of(mathieu, [[0.0], [1.0]], 0.04 * np.eye(2), [[1.0]])
    >>> found = compare_laws(periodic_lqr(problem))
    >>> [(law.name, round(law.mean_cost_ratio, 2)) for law in (found.periodic, *found.constants)]
    [('periodic', 1.0), ('averaged system', inf), ('refined, from mean of the periodic gain', 1.22)]
    """
    laws = [(law.origin, law.gain) for law in constant_lqr(regulator, refine=refine, spread=spread)]
    frequency = regulator.gain.frequency
    rated = [
        law_rating(regulator, gain, name=name, spread=spread, offset=offset)
        for name, gain in (
            ("periodic", regulator.gain), *((name, FourierMatrix.of(gain, frequency=frequency)) for name, gain in laws)
        )
    ]  # fmt: skip
    return PeriodicComparison(rated[0], tuple(rated[1:]))


def law_map(
    systems: Sequence[PeriodicSystem], B: ArrayLike, gains: FourierMatrix | Sequence[FourierMatrix],
    depths: ArrayLike, *, design_depth: float, parameter: ArrayLike, parameter_name: str = "speed",
    harmonics_below: float = 1e-4, checks: int = 24, seeds: bool = False,
) -> ResonanceMap:  # fmt: skip
    """Stability of a law over a parameter (speed) and the modulation depth, by `resonance_map`.

    The law is carried to other depths as gain.mean + depth / design_depth * (its harmonics): what it was designed for
    at `design_depth`, constant without modulation, and linear in the depth as the map needs. It is locked to the
    phase of the guideway. A constant gain is a series without harmonics.

    Parameters
    ----------
    systems : (V,) systems at depth 1, one per value of the parameter
    B : (n, m) or (V, n, m) constant input matrix
    gains : one law for all columns, or one per column
    depths : (E,) ascending
    design_depth : depth the gains were designed for
    parameter : (V,) ascending, for instance m/s
    harmonics_below : harmonics of the gain that together stay below this share are left out, to spare time
    checks, seeds : as in `resonance_map`

    Raises
    ------
    ValueError : shapes do not fit, or the design depth is not positive
    """
    if not design_depth > 0.0:
        raise ValueError("design_depth: expected a positive depth")
    count = len(systems)
    laws = [gains] * count if isinstance(gains, FourierMatrix) else list(gains)
    if len(laws) != count:
        raise ValueError(f"gains: expected one law or {count}, got {len(laws)}")
    laws = [law.truncated(harmonics_below) for law in laws]
    n = systems[0].A_0.shape[-1]
    inputs = np.broadcast_to(read_only(B, name="B", shape=(n, None)), (count, n, laws[0].mean.shape[0]))
    most = max(*(law.harmonics for law in laws), *(len(system.A_cos) for system in systems))
    A_0 = np.stack([s.A_0 - b @ law.mean for s, b, law in zip(systems, inputs, laws, strict=True)])
    waves: list[FloatArray] = []
    for kind, own in (("A_cos", "cosine"), ("A_sin", "sine")):
        wave = np.zeros((count, most, n, n))
        for v, (system, b, law) in enumerate(zip(systems, inputs, laws, strict=True)):
            wave[v, : len(system.A_cos)] += getattr(system, kind)
            wave[v, : law.harmonics] -= b @ getattr(law, own) / design_depth
        waves.append(wave)
    frequency = np.array([float(system.frequency) for system in systems])
    return resonance_map(
        A_0, waves[0], waves[1], frequency, np.asarray(depths, dtype=float),
        parameter=np.asarray(parameter, dtype=float), parameter_name=parameter_name, states=systems[0].states,
        checks=checks, seeds=seeds,
    )  # fmt: skip


def _lyapunov(A: FourierMatrix, source: FourierMatrix) -> FourierMatrix | None:
    """Periodic X of -X' = A'X + X A + source; None where A is not stable."""
    nothing = FourierMatrix.of(np.zeros_like(A.mean), frequency=A.frequency)
    found = periodic_riccati(A, nothing, source, segments=2 * max(A.harmonics, 8))
    return None if found is None else found.series


def _spread(P: FourierMatrix, spread: ArrayLike | None) -> FloatArray:
    n = len(P.mean)
    weight = default_spread(P) if spread is None else read_only(spread, name="spread", shape=(n, n))
    return np.asarray(0.5 * (weight + weight.T))


def _worst_ratio(cost: FloatArray, best: FloatArray, P: FourierMatrix) -> float:
    scale = cost_scale(P)
    weight = np.outer(scale, scale)
    least = 1e-12 * np.eye(len(scale))  # states that cost nothing under either law do not count
    ratios = [eigh(x / weight, p / weight + least, eigvals_only=True)[-1] for x, p in zip(cost, best, strict=True)]
    return float(np.max(ratios))


def _mean_cost(problem: PeriodicProblem, gain: FloatArray, spread: FloatArray) -> float:
    cost = periodic_cost(problem, FourierMatrix.of(gain, frequency=problem.A.frequency))
    return np.inf if cost is None else float(np.sum(cost.mean * spread))


def cost_and_gradient(
    problem: PeriodicProblem, gain: FloatArray, spread: FloatArray
) -> tuple[float, FloatArray, FloatArray]:
    """Mean cost of a stable constant gain, its gradient (m, n), and the step of Anderson and Moore (m, n).

    With X the cost and Y the state covariance under noise of intensity `spread`, both periodic, the gradient is
    2 <(R K - B'X) Y> and the step R^-1 <B'X Y> <Y>^-1 - K, angle brackets being means over the period.

    Parameters
    ----------
    gain : (m, n)
    spread : (n, n)

    Raises
    ------
    ModelError : the loop is not stable
    """
    frequency = problem.A.frequency
    series = FourierMatrix.of(gain, frequency=frequency)
    X = periodic_cost(problem, series)
    backward = problem.closed(series).T.reversed  # Y(-s) obeys the cost's equation with A(-s)'
    Z = _lyapunov(backward, FourierMatrix.of(spread, frequency=frequency))
    if X is None or Z is None:
        raise ModelError("the constant gain does not stabilise the periodic system")
    Y = Z.reversed
    count = 2 * (X.harmonics + Y.harmonics + problem.B.harmonics) + 1
    drawn = np.mean(transpose(problem.B.samples(count)) @ X.samples(count) @ Y.samples(count), axis=0)
    gradient = 2.0 * (problem.R @ gain @ Y.mean - drawn)
    step = np.linalg.solve(problem.R, np.linalg.solve(Y.mean, drawn.T).T) - gain
    return float(np.sum(X.mean * spread)), np.asarray(gradient), np.asarray(step)


def _descend(problem: PeriodicProblem, start: ConstantGain, spread: FloatArray, steps: int) -> ConstantGain:
    """Anderson-Moore steps, halved until the cost falls."""
    gain, slope, taken = start.gain, np.inf, 0
    for _ in range(steps):
        cost, gradient, step = cost_and_gradient(problem, gain, spread)
        slope = -float(np.sum(gradient * step)) / cost
        if slope <= _NO_STEP:
            break
        length = 1.0
        while length > 1e-6 and not _mean_cost(problem, gain + length * step, spread) < cost * (
            1.0 - 0.1 * length * slope
        ):
            length *= 0.5
        if length <= 1e-6:
            break
        gain, taken = gain + length * step, taken + 1
    return ConstantGain(read_only(gain, name="gain"), f"refined, from {start.origin}", taken > 0, slope, taken)
