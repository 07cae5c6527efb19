"""Judges a periodic regulator by methods that share nothing but the problem it was made for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import solve_ivp
from scipy.linalg import solve_discrete_lyapunov
from scipy.optimize import linear_sum_assignment

from maglev_ctrl.arrays import ComplexArray, FloatArray, read_only_any, transpose
from maglev_ctrl.errors import Agreement
from maglev_ctrl.kernels.fourier_matrix import FourierMatrix
from maglev_ctrl.synthesis.periodic_problem import PeriodicProblem, cost_scale, loop_multipliers, multiplier_text

METHODS = (
    "residual of the Riccati differential equation between the samples, rate from the Fourier series",
    "multipliers of the closed loop by Taylor propagators",
    "cost of the closed loop simulated by a Runge-Kutta method of order 8",
)


@dataclass(frozen=True, eq=False, slots=True)
class PeriodicCertificate:
    """Independent evidence about a periodic regulator; P is measured in units of its own mean diagonal.

    `residual` of the Riccati differential equation at times between the samples, relative to its terms; `asymmetry`
    and `least_eigenvalue` of P at those times; `multipliers` (n,) of the closed loop over one period;
    `multiplier_difference` to those the solver implies, absolute; `cost_difference` simulated cost against P(0),
    relative (NaN where not simulated).
    """

    residual: float
    asymmetry: float
    least_eigenvalue: float
    multipliers: ComplexArray
    multiplier_difference: float
    cost_difference: float
    methods: tuple[str, ...]
    agreed: Agreement
    disagreements: tuple[str, ...]

    @property
    def spectral_radius(self) -> float:
        """Largest modulus of a multiplier over one period."""
        return float(np.max(np.abs(self.multipliers)))

    @property
    def stable(self) -> bool:
        """All multipliers inside the unit circle, and all methods agree."""
        return self.agreed is Agreement.AGREED and self.spectral_radius < 1.0


def verify_periodic(
    problem: PeriodicProblem, P: FourierMatrix, gain: FourierMatrix, *, solver: ArrayLike | None = None,
    simulate: bool = True, tolerance: float = 1e-6,
) -> PeriodicCertificate:  # fmt: skip
    """Judge a cost matrix P(t) and a gain K(t) by methods that share nothing but the problem.

    Parameters
    ----------
    problem : system and weights
    P, gain : the claim: cost matrix and law u = -gain(t) x
    solver : (n,) multipliers the solver claims
    simulate : whether to simulate the cost
    tolerance : what still counts as agreement, relative; for multipliers absolute

    Examples
    --------
    >>> from maglev_ctrl.systems import PeriodicSystem
    >>> still = PeriodicSystem.from_matrices([[1.0]], [[[0.0]]], frequency=2.0)
    >>> problem = PeriodicProblem.of(still, [[1.0]], [[1.0]], [[1.0]])
    >>> P = FourierMatrix.of([[1.0 + np.sqrt(2.0)]], frequency=2.0)
    >>> verify_periodic(problem, P, P).stable, verify_periodic(problem, P.reversed.plus(P), P).stable
    (True, False)
    """
    told: list[str] = []
    scale = cost_scale(P)
    weight = np.outer(scale, scale)
    between = 2 * max(P.harmonics, problem.A.harmonics, problem.B.harmonics) + 9
    times = P.period * (np.arange(between) + 0.381966) / between  # on no uniform grid that a solver would use
    values = P(times)
    residual = _residual(problem, P, times, weight)
    asymmetry = float(np.max(np.abs(values - transpose(values)) / weight))
    least = float(np.min(np.linalg.eigvalsh(values / weight)))
    multipliers = loop_multipliers(problem.closed(gain))
    radius = float(np.max(np.abs(multipliers)))
    difference = 0.0 if solver is None else _matched(multipliers, np.asarray(solver, dtype=complex))
    cost = float("nan")
    if residual > tolerance:
        told.append(f"residual of the Riccati differential equation {residual:.1e}")
    if asymmetry > tolerance or least < -tolerance:
        told.append(f"P is not symmetric and semidefinite: {asymmetry:.1e}, least eigenvalue {least:.1e}")
    if radius >= 1.0:
        told.append(f"the closed loop has {multiplier_text(multipliers[0])}")
    if difference > tolerance:
        told.append(f"multipliers differ by {difference:.1e} from those of the solver")
    if simulate and radius < 1.0:
        simulated = simulated_cost(problem, gain, scale)
        claimed = P(0.0) / weight
        cost = float(np.linalg.norm(simulated / weight - claimed) / max(float(np.linalg.norm(claimed)), 1e-300))
        if not cost <= tolerance:
            told.append(f"simulated cost differs by {cost:.1e}")
    return PeriodicCertificate(
        residual=residual, asymmetry=asymmetry, least_eigenvalue=least, multipliers=read_only_any(multipliers),
        multiplier_difference=difference, cost_difference=cost, methods=METHODS if simulate else METHODS[:2],
        agreed=Agreement.UNRESOLVED if told else Agreement.AGREED, disagreements=tuple(told),
    )  # fmt: skip


def simulated_cost(problem: PeriodicProblem, gain: FourierMatrix, scale: FloatArray) -> FloatArray:
    """X with x0' X x0 the cost of the stable closed loop from x0 at t = 0, for ever: (n, n).

    One period is simulated from every unit state (Dormand-Prince of order 8); the periods after it follow from the
    simulated transition. No Riccati or Lyapunov differential equation is used.

    Parameters
    ----------
    gain : law u = -gain(t) x
    scale : (n,) square roots of typical costs per unit state, to make tolerances mean something

    Examples
    --------
    >>> from maglev_ctrl.systems import PeriodicSystem
    >>> still = PeriodicSystem.from_matrices([[1.0]], [[[0.0]]], frequency=2.0)
    >>> problem = PeriodicProblem.of(still, [[1.0]], [[1.0]], [[1.0]])
    >>> simulated_cost(problem, FourierMatrix.of([[2.0]], frequency=2.0), np.ones(1)).round(8)  # (1 + 2^2) / 2
    array([[2.5]])
    """
    n = len(scale)
    closed = problem.closed(gain).scaled(scale, 1.0 / scale)
    law = gain.scaled(np.ones(len(problem.R)), 1.0 / scale)
    state_weight = problem.Q / np.outer(scale, scale)

    def rates(t: float, flat: FloatArray) -> FloatArray:
        x = flat[: n * n].reshape(n, n)
        u = law(t) @ x
        return np.concatenate([(closed(t) @ x).ravel(), (x.T @ state_weight @ x + u.T @ problem.R @ u).ravel()])

    start = np.concatenate([np.eye(n).ravel(), np.zeros(n * n)])
    done = solve_ivp(
        rates, (0.0, closed.period), start, method="DOP853", rtol=1e-11, atol=1e-13, t_eval=[closed.period]
    )
    transition, cost = done.y[: n * n, -1].reshape(n, n), done.y[n * n :, -1].reshape(n, n)
    whole = np.asarray(solve_discrete_lyapunov(transition.T, 0.5 * (cost + cost.T)), dtype=float)
    return np.asarray(whole * np.outer(scale, scale))


def _residual(problem: PeriodicProblem, P: FourierMatrix, times: FloatArray, weight: FloatArray) -> float:
    """Largest residual of P' + A'P + P A + Q - P B R^-1 B'P at `times` relative to the largest terms."""
    A, B, values = problem.A(times), problem.B(times), P(times)
    forward = values @ A / weight
    drawn = values @ B
    quadratic = drawn @ np.linalg.solve(problem.R, transpose(drawn)) / weight
    rate, source = P.rate(times) / weight, problem.Q / weight
    rest = rate + forward + transpose(forward) + source - quadratic
    size = 2.0 * _norms(forward) + _norms(quadratic) + _norms(rate) + float(np.linalg.norm(source))
    return float(np.max(_norms(rest)) / max(float(np.max(size)), 1e-300))


def _norms(matrices: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.norm(matrices, axis=(-2, -1)))


def _matched(first: ComplexArray, second: ComplexArray) -> float:
    distance = np.abs(first[:, None] - second[None, :])
    rows, columns = linear_sum_assignment(distance)
    return float(np.max(distance[rows, columns]))
