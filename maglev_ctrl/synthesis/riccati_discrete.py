"""Discrete algebraic Riccati equation, solved by several methods, refined in extended precision and checked.

    A'XA - X - (A'XB + N)(R + B'XB)^-1 (B'XA + N') + Q = 0,  gain = (R + B'XB)^-1 (B'XA + N'),  A - B gain stable.

R may be singular or indefinite and A singular; only R + B'XB has to be regular. Where it is not positive definite the
solution belongs to a saddle point (a game), not to a least cost, and the message says so. As in `riccati`, the data
are scaled by powers of two (no rounding), seeds come from methods that share no code, and Newton steps with residuals
in twice the working precision carry the best seed to the accuracy of its last digits.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import LinAlgError, eigvals, solve_discrete_lyapunov

from maglev_ctrl.arrays import ComplexArray, FloatArray, read_only, read_only_any
from maglev_ctrl.errors import Agreement, Status
from maglev_ctrl.kernels import scaling
from maglev_ctrl.synthesis.extended import Extended, extended_solve
from maglev_ctrl.synthesis.riccati import NEAR, RiccatiSolution, checked, unsolved, verdict
from maglev_ctrl.synthesis.riccati_discrete_seeds import FALLBACK, PRIMARY, DiscreteSeed, extended_pencil
from maglev_ctrl.synthesis.riccati_newton import EPS, Refined, agreement, best_refined, better, exists

SINGULAR = "an input neither costs nor moves anything: R + B'XB is singular whatever X is"
SADDLE = "R + B'XB is not positive definite: a saddle point, the cost has no least value"


@dataclass(frozen=True, eq=False, slots=True)
class _Equation:
    """Scaled data and the scaling back: X = scale * outer(d, d) * X_scaled with d = 1 / `states`; u = inputs * u_s."""

    A: FloatArray
    B: FloatArray
    Q: FloatArray
    R: FloatArray
    N: FloatArray
    states: FloatArray
    inputs: FloatArray
    scale: float

    @property
    def data(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
        return self.A, self.B, self.Q, self.R, self.N


def riccati_discrete(
    A: ArrayLike, B: ArrayLike, Q: ArrayLike, R: ArrayLike, N: ArrayLike | None = None
) -> RiccatiSolution:
    """Stabilising solution of the discrete Riccati equation; failure is a status, never a wrong number.

    The record is that of `riccati_continuous`: `P` is X here, `closed_loop_poles` lie inside the unit circle.

    Parameters
    ----------
    A : (n, n) state matrix of x+ = A x + B u
    B : (n, m) input matrix
    Q, R, N : (n, n), (m, m), (n, m) weights of the sum of x'Qx + u'Ru + 2 x'Nu; any symmetric Q and R

    Raises
    ------
    ValueError : shapes do not fit, or Q or R is not symmetric

    Examples
    --------
    >>> solution = riccati_discrete([[2.0, -1.0], [1.0, 0.0]], [[1.0], [0.0]], [[0.0, 0.0], [0.0, 1.0]], [[0.0]])
    >>> [[round(float(x), 12) for x in row] for row in solution.gain]
    [[2.0, -1.0]]
    >>> solution.status.name
    'SOLVED'
    """
    a, b, q, r, n = checked(A, B, Q, R, N)
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        equation = _scaled(a, b, q, r, n)
        newton, size = partial(_newton, equation), partial(_size_of_residual, equation)
        seeds = _seeds(equation, PRIMARY)
        refined = best_refined(seeds, newton, size)
        if len(seeds) < 2 or refined is None or refined.step > 1e-12:
            more = _seeds(equation, FALLBACK)
            refined, seeds = better(refined, best_refined(more, newton, size)), seeds | more
        if refined is None:
            return unsolved(a, b, *_diagnosis(equation))
        decay = _gramian(equation.A - equation.B @ refined.gain.high, np.eye(len(a)))
        if not (exists(_departure(equation, refined, decay)) or _plainly_inside(refined)):
            return unsolved(a, b, *_reason(equation, refined))
        condition = _condition(equation, refined.P.high, decay)
        return _finished(equation, refined, condition, agreement(seeds, refined.P.high, condition, newton))


def _scaled(A: FloatArray, B: FloatArray, Q: FloatArray, R: FloatArray, N: FloatArray) -> _Equation:
    """Balance the extended pencil by a symplectic diagonal of the states and one of the inputs; powers of two only."""
    n, m = B.shape
    magnitude = np.zeros((2 * n + m, 2 * n + m))
    magnitude[:n, :n], magnitude[:n, 2 * n :] = np.abs(A), np.abs(B)
    magnitude[n : 2 * n, :n], magnitude[n : 2 * n, n : 2 * n] = np.abs(Q), np.abs(A.T)
    magnitude[n : 2 * n, 2 * n :], magnitude[2 * n :, :n] = np.abs(N), np.abs(N.T)
    magnitude[2 * n :, n : 2 * n], magnitude[2 * n :, 2 * n :] = np.abs(B.T), np.abs(R)
    np.fill_diagonal(magnitude, 0.0)
    balance = scaling.balance(magnitude)
    states = np.exp2(np.round(0.5 * np.log2(balance[:n] / balance[n : 2 * n])))
    # Inputs to unit size in what they move and cost: R + B'XB is then no worse conditioned than the problem is.
    push = np.linalg.norm(B / states[:, None], axis=0)
    heavy = float(np.linalg.norm(Q * np.outer(states, states)))
    price = np.sqrt(np.abs(np.diag(R)) / heavy) if heavy > 0.0 else np.zeros(m)
    weight = np.hypot(push, price)
    inputs = np.exp2(-np.round(np.log2(np.where(weight > 0.0, weight, 1.0))))
    scale = float(np.exp2(np.round(np.log2(heavy)))) if heavy > 0.0 else 1.0
    return _Equation(
        A=A * states / states[:, None], B=B * inputs / states[:, None], Q=Q * np.outer(states, states) / scale,
        R=R * np.outer(inputs, inputs) / scale, N=N * np.outer(states, inputs) / scale,
        states=states, inputs=inputs, scale=scale,
    )  # fmt: skip


def _seeds(equation: _Equation, methods: dict[str, DiscreteSeed]) -> dict[str, FloatArray]:
    found: dict[str, FloatArray] = {}
    for name, seed in methods.items():
        try:
            X = seed(*equation.data)
            gain = _plain_gain(equation, X)
        except (LinAlgError, ValueError):
            continue
        if np.all(np.isfinite(X)) and _radius(equation.A - equation.B @ gain) < 1.0:
            found[name] = X
    return found


def _plain_gain(equation: _Equation, X: FloatArray) -> FloatArray:
    A, B, _, R, N = equation.data
    return np.asarray(np.linalg.solve(R + B.T @ X @ B, B.T @ X @ A + N.T), dtype=float)


def _gramian(closed: FloatArray, weight: FloatArray) -> FloatArray:
    """Y of closed'Y closed - Y + weight = 0; NaN where the loop is neutral to rounding."""
    try:
        return np.asarray(solve_discrete_lyapunov(closed.T, weight), dtype=float)
    except (LinAlgError, ValueError):
        return np.full_like(closed, np.nan)


def _departure(equation: _Equation, refined: Refined, decay: FloatArray) -> float:
    """How much of the closed loop's decay the steps left and rounding may use up; below one a solution exists.

    With Y = `decay`, the gramian of the identity, b = |Y|, F the closed loop, W = B (R + B'XB)^-1 B' and the step s,
    F'' is 2 F'EWEF to first order and the loop moves by D, |D| <= 2 s |W| |F|; it stays stable where
    |F'YD + D'YF + D'YD| < 1. At a double root, where the steps only halve, 4 b |F|^2 |W| s is one however small s is.
    """
    A, B, _, R, _ = equation.data
    X, gain = refined.P.high, refined.gain.high
    scale = float(np.linalg.norm(X))
    step = refined.step * (scale if scale > 0.0 else 1.0)
    price = R + B.T @ X @ B
    loop = float(np.linalg.norm(A - B @ gain, 2))
    try:
        weight = float(np.linalg.norm(B @ np.linalg.solve(price, B.T), 2))
    except LinAlgError:
        return np.inf
    # The inverse of R + B'XB is to stay what it is while X moves.
    if not (np.all(np.isfinite(decay)) and 4.0 * weight * step <= 1.0):
        return np.inf
    moved = 2.0 * weight * loop * step
    terms = np.abs(A) + np.abs(B) @ np.abs(gain)
    noise = float(np.linalg.norm(np.abs((A - B @ gain).T @ decay) @ terms, 2)) * len(X) * EPS
    size = float(np.linalg.norm(decay, 2))
    return 2.0 * (size * loop * moved + noise) + size * moved**2


def _plainly_inside(refined: Refined) -> bool:
    """Poles away from the circle that the last step did not move.

    It speaks for states of very different size, whose norms say nothing.
    """
    inside = 1.0 - refined.edge
    return inside > 1e-6 and refined.step <= 1e-3 and refined.drift <= 1e-2 * inside


def _reason(equation: _Equation, refined: Refined) -> tuple[Status, str]:
    """Why the iterates led to no solution."""
    status, message = _diagnosis(equation)
    if status is Status.INFEASIBLE:
        return status, message
    if refined.step > 1e-3 or refined.edge < 1.0 - 1e-6:
        return Status.NUMERICAL_ERROR, f"Newton's method stalled at relative step {refined.step:.1e}"
    where = f"the closed loop's pole {1.0 - refined.edge:.1e} inside the unit circle cannot be told from one on it"
    return Status.INFEASIBLE, f"{where}: no stabilising solution"


def _residual(equation: _Equation, X: Extended) -> tuple[Extended, Extended]:
    """Residual of the equation and the gain, both in extended precision."""
    A, B, Q, R, N = (Extended.of(matrix) for matrix in equation.data)
    ahead, push = X @ A, X @ B
    cross = A.T @ push + N
    gain = extended_solve(R + (B.T @ push).symmetric(), cross.T)
    rest = Q - X + A.T @ ahead - cross @ gain
    return rest.symmetric(), gain


def _size_of_residual(equation: _Equation, X: Extended) -> float:
    return float(np.linalg.norm(_residual(equation, X)[0].high))


def _newton(equation: _Equation, X: Extended) -> tuple[Extended, float, FloatArray] | None:
    """One step of Newton's method (Hewer, IEEE TAC 16 (1971) 382)."""
    try:
        rest, gain = _residual(equation, X)
        closed = equation.A - equation.B @ gain.high
        radius = _radius(closed)
        if not radius < 1.0:
            return None
        return gain, radius, np.asarray(solve_discrete_lyapunov(closed.T, rest.high), dtype=float)
    except (LinAlgError, ValueError):
        return None


def _finished(equation: _Equation, refined: Refined, condition: float, agreed: Agreement) -> RiccatiSolution:
    back = 1.0 / equation.states
    stored = refined.P.high
    poles = np.linalg.eigvals(equation.A - equation.B @ refined.gain.high)
    error = max(refined.step, 0.5 * EPS)
    status, message = verdict(refined.method, error, condition, agreed)
    price = equation.R + equation.B.T @ stored @ equation.B
    if np.linalg.eigvalsh(0.5 * (price + price.T))[0] <= 0.0:
        message = f"{SADDLE}; {message}" if message else SADDLE
    P = equation.scale * stored * np.outer(back, back)
    rest, _ = _residual(equation, Extended.of(stored))
    return RiccatiSolution(
        P=read_only(0.5 * (P + P.T), name="P"),
        gain=read_only(equation.inputs[:, None] * refined.gain.high * back, name="gain"),
        closed_loop_poles=read_only_any(poles.astype(complex)),
        residual=float(np.linalg.norm(rest.high)) / _size_of_terms(equation, stored, refined.gain.high),
        forward_error=error,
        condition=condition,
        method=refined.method,
        agreed=agreed,
        status=status,
        message=message,
    )


def _diagnosis(equation: _Equation) -> tuple[Status, str]:
    """Which condition for a stabilising solution is broken: an uncontrollable mode, an unseen mode, a free input."""
    A, B, Q, R, N = equation.data
    n, m = B.shape
    size = float(np.linalg.norm(A, 2)) + float(np.linalg.norm(B, 2)) + 1e-300
    for value in np.linalg.eigvals(A):
        shifted = A - value * np.eye(n)
        if abs(value) >= 1.0 - 1e-9:
            reach = np.linalg.svd(np.hstack([shifted, B]), compute_uv=False)[-1]
            if reach <= 1e-9 * size:
                return Status.INFEASIBLE, f"the inputs cannot move the mode at z = {value:.4g}"
        if abs(abs(value) - 1.0) <= 1e-7:
            seen = np.linalg.svd(np.vstack([shifted, Q, N.T]), compute_uv=False)[-1]
            if seen <= 1e-9 * size:
                return Status.INFEASIBLE, f"the weights do not see the neutral mode at z = {value:.4g}"
    if np.linalg.matrix_rank(np.vstack([B, R, N])) < m:
        return Status.INFEASIBLE, SINGULAR
    alpha, beta = eigvals(*extended_pencil(*equation.data), homogeneous_eigvals=True)
    if np.min(np.hypot(np.abs(alpha), np.abs(beta))) <= 1e-13 * (1.0 + size):
        return Status.INFEASIBLE, "the extended pencil is singular: R + B'XB is singular whatever X is"
    angle = circle_angle(*equation.data, np.asarray(alpha), np.asarray(beta))
    if angle is not None:
        where = f"the extended pencil has an eigenvalue on the unit circle to rounding, at angle {angle:.4g} rad"
        return Status.INFEASIBLE, f"{where}: no stabilising solution"
    return Status.NUMERICAL_ERROR, "no method gave a stabilising solution"


def circle_angle(
    A: FloatArray, B: FloatArray, Q: FloatArray, R: FloatArray, N: FloatArray, alpha: ComplexArray, beta: ComplexArray
) -> float | None:
    """Angle of an eigenvalue z = `alpha` / `beta` of the extended pencil on the unit circle, to rounding, or None.

    [0, A - zI, B; (A - zI)*, Q, N; B', N', R] is Hermitian on the circle and singular there at an eigenvalue only.
    Where a solution exists its inertia is that of R + B'XB and n of either sign all around: a change excludes one.
    """
    n = A.shape[0]

    def eigenvalues(angle: float) -> FloatArray:
        shifted = A - np.exp(1j * angle) * np.eye(n)
        rows = [[np.zeros((n, n)), shifted, B], [shifted.conj().T, Q, N], [B.T, N.T, R]]
        return np.asarray(np.linalg.eigvalsh(np.block(rows)), dtype=float)

    off = np.abs(np.abs(alpha) - np.abs(beta)) / np.hypot(np.abs(alpha), np.abs(beta))
    angles = np.unique(np.abs(np.angle(alpha * np.conj(beta)))[off <= NEAR])
    for angle in angles:
        values = np.abs(eigenvalues(float(angle)))
        if np.min(values) <= 1e2 * EPS * np.max(values):
            return float(angle)
    ends = np.concatenate([[0.0], angles, [np.pi]])
    last = -1
    for index, middle in enumerate(0.5 * (ends[:-1] + ends[1:])):
        values = eigenvalues(float(middle))
        if np.min(np.abs(values)) <= 1e2 * EPS * np.max(np.abs(values)):
            continue
        count = int(np.count_nonzero(values > 0.0))
        if last >= 0 and count != last:
            return float(ends[index])
        last = count
    return None


def _condition(equation: _Equation, X: FloatArray, decay: FloatArray) -> float:
    """First-order bound in the scaled coordinates: 2-norm changes of all five data relative to their norms.

    The change of X solves Z = F'ZF + W with F the closed loop, K the gain, W = dQ + K'dR K - dN K - (dN K)' + U + U',
    U = F'X (dA - dB K). With Y = inverse(F, S) the solution for S, |inverse(U'V + V'U)| <= 2 (|Y_U'U| |Y_V'V|)^1/2.
    """
    A, B, Q, R, N = equation.data
    gain = _plain_gain(equation, X)
    closed = A - B @ gain
    size = float(np.linalg.norm(X, 2))
    if size == 0.0:
        return 1.0
    ahead = X @ closed
    inner = float(np.linalg.norm(decay, 2))
    outer, spent = (float(np.linalg.norm(_gramian(closed, S), 2)) for S in (ahead.T @ ahead, gain.T @ gain))
    a, b, q, r, n = (float(np.linalg.norm(matrix, 2)) for matrix in (A, B, Q, R, N))
    total = inner * q + spent * r + 2.0 * np.sqrt(inner * spent) * n
    return float(total + 2.0 * np.sqrt(outer) * (np.sqrt(inner) * a + np.sqrt(spent) * b)) / size


def _size_of_terms(equation: _Equation, X: FloatArray, gain: FloatArray) -> float:
    A, B, Q, _, N = equation.data
    terms = (Q, X, A.T @ X @ A, (A.T @ X @ B + N) @ gain)
    total = sum(float(np.linalg.norm(term)) for term in terms)
    return total if total > 0.0 else 1.0


def _radius(matrix: FloatArray) -> float:
    return float(np.max(np.abs(np.linalg.eigvals(matrix))))
