"""Continuous algebraic Riccati equation, solved by several methods, refined in extended precision and checked.

    A'P + P A + Q - (P B + N) R^-1 (P B + N)' = 0,  gain = R^-1 (B'P + N'),  A - B gain stable.

The data are scaled by powers of two (no rounding), seeds come from an ordered Schur form and from doubling, and
Newton steps with residuals in twice the working precision carry the best seed to the accuracy of its last digits.
The last step bounds the forward error of the stored numbers; `condition` tells how the data's own rounding weighs.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import solve_continuous_lyapunov

from maglev_ctrl.arrays import ComplexArray, FloatArray, read_only, read_only_any
from maglev_ctrl.errors import Agreement, ModelError, Status
from maglev_ctrl.kernels import scaling
from maglev_ctrl.synthesis.doubling import hamiltonian
from maglev_ctrl.synthesis.extended import Extended, extended_solve
from maglev_ctrl.synthesis.riccati_newton import EPS, Refined, agreement, best_refined, better, exists
from maglev_ctrl.synthesis.riccati_seeds import FALLBACK, PRIMARY, Seed

NEAR = 1e-3
"""How far rounding may throw a fourfold eigenvalue off the axis, relative to the norm of the Hamiltonian."""


@dataclass(frozen=True, eq=False, slots=True)
class RiccatiSolution:
    """Stabilising solution of a continuous Riccati equation and the evidence for it.

    `P` (n, n) and `gain` (m, n), NaN where unsolved; `closed_loop_poles` (n,) of A - B gain; `residual` relative to
    the terms of the equation (extended precision, scaled coordinates); `forward_error` relative error of `P` for the
    data as stored; `condition` relative sensitivity of `P` to relative changes of the data (Kenney and Hewer, SIAM J.
    Control Optim. 28 (1990) 50, upper bound); `method` the seed that won; `agreed` whether two seeds agree.
    """

    P: FloatArray
    gain: FloatArray
    closed_loop_poles: ComplexArray
    residual: float
    forward_error: float
    condition: float
    method: str
    agreed: Agreement
    status: Status
    message: str

    def require(self) -> RiccatiSolution:
        """This solution, or the reason why there is none.

        Raises
        ------
        ModelError : the equation was not solved
        """
        if self.status not in (Status.SOLVED, Status.ALMOST_SOLVED):
            raise ModelError(f"Riccati equation: {self.status.value}; {self.message}")
        return self


@dataclass(frozen=True, eq=False, slots=True)
class _Equation:
    """Scaled data and the scaling back: P = scale * outer(d, d) * P_scaled with d = 1 / `states`."""

    A: FloatArray
    B: FloatArray
    Q: FloatArray
    R: FloatArray
    N: FloatArray
    A_bare: FloatArray
    G: FloatArray
    Q_bare: FloatArray
    states: FloatArray
    scale: float


def riccati_continuous(
    A: ArrayLike, B: ArrayLike, Q: ArrayLike, R: ArrayLike, N: ArrayLike | None = None
) -> RiccatiSolution:
    """Stabilising solution of the continuous Riccati equation; failure is a status, never a wrong number.

    Parameters
    ----------
    A : (n, n) state matrix
    B : (n, m) input matrix
    Q, R, N : (n, n), (m, m), (n, m) weights of the cost x'Qx + u'Ru + 2 x'Nu; R positive definite

    Raises
    ------
    ValueError : shapes do not fit, Q or R is not symmetric, or R is not positive definite

    Examples
    --------
    >>> solution = riccati_continuous([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], [[1.0, 0.0], [0.0, 2.0]], [[1.0]])
    >>> [[round(float(x), 12) for x in row] for row in solution.P]
    [[2.0, 1.0], [1.0, 2.0]]
    >>> solution.status.name
    'SOLVED'
    """
    a, b, q, r, n = checked(A, B, Q, R, N)
    try:
        np.linalg.cholesky(r)
    except np.linalg.LinAlgError:
        raise ValueError("R: expected a positive definite matrix") from None
    equation = _scaled(a, b, q, r, n)
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        newton, size = partial(_newton, equation), partial(_size_of_residual, equation)
        seeds = _seeds(equation, PRIMARY)
        refined = best_refined(seeds, newton, size)
        if len(seeds) < 2 or refined is None or refined.step > 1e-12:
            more = _seeds(equation, FALLBACK)
            refined, seeds = better(refined, best_refined(more, newton, size)), seeds | more
        if refined is None:
            return unsolved(a, b, *_diagnosis(equation))
        decay = _decay(equation, refined.P.high)
        if not exists(_departure(equation, refined, decay)):
            return unsolved(a, b, *_reason(equation, refined))
        condition = _condition(equation, refined.P.high, decay)
        return _finished(equation, refined, condition, agreement(seeds, refined.P.high, condition, newton))


def checked(
    A: ArrayLike, B: ArrayLike, Q: ArrayLike, R: ArrayLike, N: ArrayLike | None
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Data of one Riccati equation as arrays, shapes and symmetry checked.

    Raises
    ------
    ValueError : shapes do not fit, or Q or R is not symmetric
    """
    a = read_only(A, name="A", shape=(None, None))
    if a.ndim != 2 or a.shape[0] != a.shape[1] or not a.size:
        raise ValueError(f"A: expected one square matrix, got shape {a.shape}")
    states = a.shape[0]
    b = read_only(B, name="B", shape=(states, None))
    inputs = b.shape[-1]
    if inputs == 0:
        raise ValueError("B: expected at least one column")
    q = read_only(Q, name="Q", shape=(states, states))
    r = read_only(R, name="R", shape=(inputs, inputs))
    n = read_only(np.zeros((states, inputs)) if N is None else N, name="N", shape=(states, inputs))
    for name, matrix in (("B", b), ("Q", q), ("R", r), ("N", n)):
        if matrix.ndim != 2:
            raise ValueError(f"{name}: expected one matrix, got shape {matrix.shape}; use riccati_batch for many")
    for name, matrix in (("Q", q), ("R", r)):
        if np.linalg.norm(matrix - matrix.T) > 1e-10 * np.linalg.norm(matrix):
            raise ValueError(f"{name}: expected a symmetric matrix")
    return a, b, 0.5 * (q + q.T), 0.5 * (r + r.T), n


def _scaled(A: FloatArray, B: FloatArray, Q: FloatArray, R: FloatArray, N: FloatArray) -> _Equation:
    """Balance the Hamiltonian by a symplectic diagonal and level Q against G; powers of two only."""
    A_bare, G, Q_bare = _without_cross_weight(A, B, Q, R, N)
    size = A.shape[0]
    magnitude = np.abs(hamiltonian(A_bare, G, Q_bare))
    np.fill_diagonal(magnitude, 0.0)
    balance = scaling.balance(magnitude)
    ratio = np.log2(balance[:size] / balance[size:])
    states = np.exp2(np.round(0.5 * ratio))
    heavy, strong = np.linalg.norm(Q_bare * np.outer(states, states)), np.linalg.norm(G / np.outer(states, states))
    level = 2.0 * np.round(0.25 * np.log2(heavy / strong)) if heavy > 0.0 and strong > 0.0 else 0.0
    scale = float(np.exp2(level))
    a = A * states / states[:, None]
    b, q, r, n = B / states[:, None], Q * np.outer(states, states) / scale, R / scale, N * states[:, None] / scale
    return _Equation(a, b, q, r, n, *_without_cross_weight(a, b, q, r, n), states, scale)


def _without_cross_weight(
    A: FloatArray, B: FloatArray, Q: FloatArray, R: FloatArray, N: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    G, Q_bare = B @ np.linalg.solve(R, B.T), Q - N @ np.linalg.solve(R, N.T)
    return A - B @ np.linalg.solve(R, N.T), 0.5 * (G + G.T), 0.5 * (Q_bare + Q_bare.T)


def _seeds(equation: _Equation, methods: dict[str, Seed]) -> dict[str, FloatArray]:
    found: dict[str, FloatArray] = {}
    for name, seed in methods.items():
        try:
            P = seed(equation.A_bare, equation.B, equation.Q_bare, equation.R, equation.G)
        except (np.linalg.LinAlgError, ValueError):
            continue
        if np.all(np.isfinite(P)) and _abscissa(equation.A_bare - equation.G @ P) < 0.0:
            found[name] = P
    return found


def _decay(equation: _Equation, P: FloatArray) -> FloatArray:
    """Y of closed'Y + Y closed + I = 0: its 2-norm is that of the inverse Lyapunov operator of the closed loop."""
    closed = equation.A_bare - equation.G @ P
    return np.asarray(solve_continuous_lyapunov(closed.T, -np.eye(len(P))), dtype=float)


def _departure(equation: _Equation, refined: Refined, decay: FloatArray) -> float:
    """How much of the closed loop's decay the steps left and rounding may use up; below one a solution exists.

    With b = |Y|, the step s and F'' = 2 G, Kantorovich's theorem has a solution within 2 s where 2 b |G| s <= 1/2, and
    |Y D + D'Y| < 1 keeps the loop stable under its change D, |D| <= 2 |G| s. At a double root, where the steps only
    halve, 4 b |G| s is one however small the step is: a neutral loop cannot pass for a stable one.
    """
    if not np.all(np.isfinite(decay)):
        return np.inf
    P = refined.P.high
    scale = float(np.linalg.norm(P))
    moved = 2.0 * float(np.linalg.norm(equation.G, 2)) * refined.step * (scale if scale > 0.0 else 1.0)
    terms = np.abs(equation.A) + np.abs(equation.B) @ np.abs(refined.gain.high)
    noise = float(np.linalg.norm(np.abs(decay) @ terms, 2)) * len(P) * EPS
    return 2.0 * (float(np.linalg.norm(decay, 2)) * moved + noise)


def _reason(equation: _Equation, refined: Refined) -> tuple[Status, str]:
    """Why the iterates led to no solution."""
    status, message = _diagnosis(equation)
    if status is Status.INFEASIBLE:
        return status, message
    if refined.step > 1e-3:
        return Status.NUMERICAL_ERROR, f"Newton's method stalled at relative step {refined.step:.1e}"
    where = f"the closed loop's pole at {refined.edge:.1e} rad/s cannot be told from the imaginary axis"
    return Status.INFEASIBLE, f"{where}: no stabilising solution"


def _residual(equation: _Equation, P: Extended) -> tuple[Extended, Extended]:
    """Residual of the equation and the gain, both in extended precision."""
    cross = P @ Extended.of(equation.B) + Extended.of(equation.N)
    gain = extended_solve(equation.R, cross.T)
    forward = P @ Extended.of(equation.A)
    rest = Extended.of(equation.Q) + (forward + forward.T) - cross @ gain
    return rest.symmetric(), gain


def _size_of_residual(equation: _Equation, P: Extended) -> float:
    return float(np.linalg.norm(_residual(equation, P)[0].high))


def _newton(equation: _Equation, P: Extended) -> tuple[Extended, float, FloatArray] | None:
    """One step of Newton's method (Kleinman, IEEE TAC 13 (1968) 114)."""
    rest, gain = _residual(equation, P)
    closed = equation.A - equation.B @ gain.high
    abscissa = _abscissa(closed)
    if not abscissa < 0.0 or not np.isfinite(rest.high).all():  # without a solution the iterates may run off
        return None
    return gain, abscissa, np.asarray(solve_continuous_lyapunov(closed.T, -rest.high), dtype=float)


def _finished(equation: _Equation, refined: Refined, condition: float, agreed: Agreement) -> RiccatiSolution:
    back = 1.0 / equation.states
    P = equation.scale * refined.P.high * np.outer(back, back)
    gain = refined.gain.high * back
    poles = np.linalg.eigvals(equation.A - equation.B @ refined.gain.high)
    stored = Extended.of(refined.P.high)
    rest, _ = _residual(equation, stored)
    residual = float(np.linalg.norm(rest.high)) / _size_of_terms(equation, stored.high)
    error = max(refined.step, 0.5 * EPS)
    status, message = verdict(refined.method, error, condition, agreed)
    return RiccatiSolution(
        P=read_only(0.5 * (P + P.T), name="P"),
        gain=read_only(gain, name="gain"),
        closed_loop_poles=read_only_any(poles.astype(complex)),
        residual=residual,
        forward_error=error,
        condition=condition,
        method=refined.method,
        agreed=agreed,
        status=status,
        message=message,
    )


def verdict(method: str, error: float, condition: float, agreed: Agreement) -> tuple[Status, str]:
    """Status of a refined solution with relative `error`, for data of the given `condition`."""
    sensitivity = condition * EPS
    if error > 1e-3:
        return Status.NUMERICAL_ERROR, f"Newton's method stalled at relative step {error:.1e}"
    if error > 1e-10:
        return Status.ALMOST_SOLVED, f"relative error of P about {error:.1e}"
    if not sensitivity <= 1e-3:
        return Status.ALMOST_SOLVED, f"rounding of the data alone changes P by about {sensitivity:.1e}"
    if agreed is Agreement.UNRESOLVED:
        return Status.SOLVED, f"only the seed by {method} was good; Newton's method vouches for the solution"
    return Status.SOLVED, ""


def unsolved(A: FloatArray, B: FloatArray, status: Status, message: str) -> RiccatiSolution:
    """No solution, and why."""
    n, m = A.shape[0], B.shape[1]
    return RiccatiSolution(
        P=read_only_any(np.full((n, n), np.nan)),
        gain=read_only_any(np.full((m, n), np.nan)),
        closed_loop_poles=read_only_any(np.full(n, np.nan, dtype=complex)),
        residual=np.inf, forward_error=np.inf, condition=np.inf,
        method="none", agreed=Agreement.UNRESOLVED, status=status, message=message,
    )  # fmt: skip


def _diagnosis(equation: _Equation) -> tuple[Status, str]:
    """Which condition for a stabilising solution is broken: one uncontrollable or one unseen mode."""
    n = equation.A.shape[0]
    size = float(np.linalg.norm(equation.A_bare, 2)) + 1e-300
    for value in np.linalg.eigvals(equation.A_bare):
        shifted = equation.A_bare - value * np.eye(n)
        if value.real >= -1e-9 * size:
            reach = np.linalg.svd(np.hstack([shifted, equation.B]), compute_uv=False)[-1]
            if reach <= 1e-9 * size:
                return Status.INFEASIBLE, f"the inputs cannot move the mode at {value:.4g} rad/s"
        if abs(value.real) <= 1e-7 * size:
            seen = np.linalg.svd(np.vstack([shifted, equation.Q_bare]), compute_uv=False)[-1]
            if seen <= 1e-9 * size:
                return Status.INFEASIBLE, f"the weights do not see the neutral mode at {value:.4g} rad/s"
    frequency = axis_frequency(equation.A_bare, equation.G, equation.Q_bare)
    if frequency is not None:
        where = f"the Hamiltonian has an eigenvalue on the imaginary axis to rounding, at {frequency:.4g} rad/s"
        return Status.INFEASIBLE, f"{where}: no stabilising solution"
    return Status.NUMERICAL_ERROR, "no method gave a stabilising solution"


def axis_frequency(A: FloatArray, G: FloatArray, Q: FloatArray) -> float | None:
    """Frequency w at which the Hamiltonian H = [A, -G; -Q, -A'] has an eigenvalue jw, to rounding; None without one.

    J (H - jw I) is Hermitian: it is singular at an eigenvalue jw and nowhere else, and its inertia, (n, n) for large w,
    changes only there. An inertia is certain where an eigenvalue computed to be near the axis is not.

    Examples
    --------
    >>> round(axis_frequency(np.array([[0.0]]), np.array([[1.0]]), np.array([[-4.0]])), 12)
    2.0
    """
    n = A.shape[0]
    whole = hamiltonian(A, G, Q)
    poles, reach = np.linalg.eigvals(whole), NEAR * float(np.linalg.norm(whole, 2))

    def hermitian(w: float) -> ComplexArray:
        turned = -A.T - 1j * w * np.eye(n)
        return np.block([[-Q.astype(complex), turned], [turned.conj().T, G.astype(complex)]])

    near = np.unique(np.abs(poles.imag[np.abs(poles.real) <= reach]))[::-1]
    for index, w in enumerate(near):
        values = np.linalg.eigvalsh(hermitian(float(w)))
        if np.min(np.abs(values)) <= 1e2 * EPS * np.max(np.abs(values)):
            return float(w)
        below = np.linalg.eigvalsh(hermitian(0.5 * float(w + near[index + 1]) if index + 1 < len(near) else 0.0))
        certain = np.min(np.abs(below)) > 1e2 * EPS * np.max(np.abs(below))
        if certain and np.count_nonzero(below > 0.0) != n:
            return float(w)
    return None


def _condition(equation: _Equation, P: FloatArray, decay: FloatArray) -> float:
    """Kenney-Hewer upper bound in the scaled coordinates, `decay` for the identity and one more Lyapunov equation."""
    closed = equation.A_bare - equation.G @ P
    size = float(np.linalg.norm(P, 2))
    if size == 0.0:
        return 1.0
    inner = float(np.linalg.norm(decay, 2))
    outer = float(np.linalg.norm(solve_continuous_lyapunov(closed.T, -P @ P), 2))
    A, G, Q = (float(np.linalg.norm(x, 2)) for x in (equation.A_bare, equation.G, equation.Q_bare))
    return float(inner * Q + 2.0 * np.sqrt(inner * outer) * A + outer * G) / size


def _size_of_terms(equation: _Equation, P: FloatArray) -> float:
    forward, quadratic = P @ equation.A_bare, P @ equation.G @ P
    total = np.linalg.norm(equation.Q_bare) + 2.0 * np.linalg.norm(forward) + np.linalg.norm(quadratic)
    return float(total) if total > 0.0 else 1.0


def _abscissa(matrix: FloatArray) -> float:
    return float(np.max(np.linalg.eigvals(matrix).real))
