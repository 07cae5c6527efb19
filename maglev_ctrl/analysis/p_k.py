"""Modes of a vehicle with frequency-dependent magnets by p-k iteration, as in flutter analysis.

At a frequency w the magnets' dynamic stiffness is replaced by real matrices k + c s + m s^2 that equal it at s = iw,

    k = Q(0),    c = Im Q(w) / w,    m = (k - Re Q(w)) / w^2,

the eigenvalue problem is solved, and w is set to the frequency of the mode that is followed, until it stays. The
result is exact where the mode neither grows nor decays; elsewhere the coefficients belong to iw and not to s. Because
Q is analytic its derivative along the axis is its derivative off it, dQ/ds = -i dQ/dw, so the result is corrected
with a Taylor polynomial about iw, and what the polynomial's last term changes is the error estimate.

H. J. Hassig, J. Aircraft 8 (1971) 885; W. P. Rodden, E. D. Bellinger, J. Aircraft 19 (1982) 796.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from maglev_ctrl.analysis.modes import Modes, modes
from maglev_ctrl.analysis.spectrum import Spectrum, system_spectrum
from maglev_ctrl.analysis.tracking import assurance
from maglev_ctrl.arrays import ComplexArray, FloatArray
from maglev_ctrl.vehicle.unsteady import UnsteadyVehicle, rest_stiffness

SETTLED = 1e-10  # of |s|
NEWTON_STEPS = 12
STEP = 0.02  # of the frequency, for derivatives along the axis
REST_DOUBT = 0.1  # of the correction of a real root
ALIKE = 1e-9  # of |s|: corrections below this are rounding
DIVERGING = 0.5  # ratio of two corrections from which the Taylor series is not trusted
RENEWALS = 3
BETWEEN, OFF_AXIS = 2.0, 18.0  # widening of a fit's residual: between its samples, and far from the axis


@dataclass(frozen=True, eq=False, slots=True)
class PKMode:
    """One mode by p-k iteration.

    `start` the quasi-static eigenvalue; `classical` the p-k eigenvalue; `s` the same corrected for its growth rate,
    and `error` 1/s its estimated error (inf when it did not settle); `shape` (n,) of the coordinates.
    """

    label: str
    start: complex
    classical: complex
    s: complex
    error: float
    iterations: int
    converged: bool
    shape: ComplexArray


@dataclass(slots=True, eq=False)
class _Followed:
    """A mode under iteration, with its vectors."""

    s: complex
    right: ComplexArray
    left: ComplexArray
    iterations: int = 0
    converged: bool = False


def quasi_static_modes(unsteady: UnsteadyVehicle) -> Modes:
    """Modes of the quasi-static system, over the states that the unsteady one has.

    Where Q(0) holds a lateral stiffness that quasi-static theory leaves out, a coordinate that was free is free no
    more: it starts from Q(0).
    """
    base = unsteady.quasi_static
    if base.ignorable == unsteady.rest.ignorable:
        return modes(base)
    K = unsteady.rest.K - unsteady.static()
    start = replace(base, K=K, ignorable=unsteady.rest.ignorable)
    return modes(type(base).from_matrices(
        start.M, start.C, K, dofs=start.dofs, internal=start.internal, A_internal=start.A_internal, G_q=start.G_q,
        G_v=start.G_v, G_a=start.G_a, F=start.F, ignorable=start.ignorable,
    ))  # fmt: skip


def p_k_modes(
    unsteady: UnsteadyVehicle, *, start: Modes | None = None, iterations_at_most: int = 40
) -> tuple[PKMode, ...]:
    """Every quasi-static mode followed to its frequency-dependent eigenvalue.

    Parameters
    ----------
    start : modes to start from; the quasi-static ones when left out

    Raises
    ------
    ModelError : the mass matrix is singular
    """
    first = quasi_static_modes(unsteady) if start is None else start
    followed = [_Followed(complex(s), first.states[:, i], first.left[:, i]) for i, s in enumerate(first.s)]
    for _ in range(iterations_at_most):
        waiting = [one for one in followed if not one.converged]
        if not waiting:
            break
        Q = unsteady.magnets_at(np.array([_frequency(unsteady, one.s) for one in waiting]))
        for one, matrix in zip(waiting, Q, strict=True):
            _advance(one, _frozen_spectrum(unsteady, matrix, _frequency(unsteady, one.s)), least=unsteady.band[0])
    found = []
    n = len(unsteady.rest.dofs)
    positions = len(unsteady.rest.positions)
    for one, label, begun in zip(followed, first.labels, first.s, strict=True):
        velocity = one.right[positions : positions + n]
        shape = velocity / one.s if one.s != 0.0 else velocity
        s, error = _corrected(unsteady, one, shape) if one.converged else (one.s, np.inf)
        found.append(
            PKMode(
                label=label, start=complex(begun), classical=one.s, s=s, error=float(error),
                iterations=one.iterations, converged=one.converged, shape=shape,
            )
        )  # fmt: skip
    return tuple(found)


def exact_root(unsteady: UnsteadyVehicle, shape: ComplexArray, start: complex) -> complex | None:
    """The root of det D(s) near a start, with Q at complex frequencies; None when Newton's method does not settle.

    The derivative of Q is taken beside the start, and again only where that does not settle: it sets the speed of
    convergence and not the result.

    Parameters
    ----------
    shape : (n,) complex displacement of the mode, roughly
    start : 1/s; a real start stays real
    """
    s: complex | None = start
    for _ in range(RENEWALS):
        if s is None:
            break
        step = 1e-4 * max(abs(s), unsteady.band[0])
        try:
            beside = unsteady.magnets_at(np.array([(s + step) / 1j, (s - step) / 1j]))
        except (ValueError, np.linalg.LinAlgError):
            return None
        slope = (beside[0] - beside[1]) / (2.0 * step)

        def evaluate(at: complex, slope: ComplexArray = slope) -> tuple[ComplexArray, ComplexArray]:
            D, change = rest_stiffness(unsteady.rest, at)
            return D - unsteady.magnets_at(np.array([at / 1j]))[0], change - slope

        s, settled = _newton(evaluate, s, shape, real=start.imag == 0.0)
        if settled:
            return s
    return None


def _frequency(unsteady: UnsteadyVehicle, s: complex) -> float:
    """Where the coefficients are taken: the mode's frequency, the band's lower end for a mode that does not swing."""
    return max(s.imag, unsteady.band[0])


def _frozen_spectrum(unsteady: UnsteadyVehicle, Q: ComplexArray, w: float) -> Spectrum:
    rest, k = unsteady.rest, unsteady.static()
    c, m = Q.imag / w, (k - Q.real) / w**2
    return system_spectrum(replace(rest, M=rest.M - m, C=rest.C - c, K=rest.K - k))


def _advance(one: _Followed, found: Spectrum, *, least: float) -> None:
    """The eigenvalue of the next step: near in value and alike in shape."""
    alike = assurance(one.left[:, None], one.right[:, None], (found.left, found.right))[0]
    distance = np.abs(found.s - one.s) / max(abs(one.s), least)
    k = int(np.argmin(distance / (1.0 + distance) + 1.0 - alike))
    s = complex(found.s[k])
    one.converged = abs(s - one.s) <= SETTLED * abs(s) + float(found.error_bound[k])
    one.s, one.right, one.left = s, found.right[:, k], found.left[:, k]
    one.iterations += 1


def _corrected(unsteady: UnsteadyVehicle, one: _Followed, shape: ComplexArray) -> tuple[complex, float]:
    """The p-k root corrected for its growth rate, and the error that is left.

    A swinging mode: roots with the Taylor polynomials of first and second order about iw. A real root s: with those
    of third and fourth order about 0, whose coefficients are what c and m change by between two frequencies.
    """
    swings = one.s.imag > 0.0
    terms, centre = _taylor(unsteady, one.s) if swings else (_taylor_at_rest(unsteady, one.s), 0j)
    roots = []
    for last in (len(terms) - 1, len(terms)):

        def evaluate(s: complex, last: int = last) -> tuple[ComplexArray, ComplexArray]:
            D, change = rest_stiffness(unsteady.rest, s)
            off = s - centre
            for power, term in enumerate(terms[:last]):
                D = D - off**power * term
                if power:
                    change = change - power * off ** (power - 1) * term
            return D, change

        root, settled = _newton(evaluate, one.s, shape, real=not swings)
        if root is None or not settled:
            return one.s, np.inf
        roots.append(root)
    last_root = roots[1]
    first, second = abs(roots[0] - one.s), abs(roots[1] - roots[0])
    ratio = second / first if first > ALIKE * abs(one.s) else 0.0
    if ratio >= DIVERGING:
        return last_root, np.inf
    # The terms come from differences: good to about the relative step, or to the next term but one.
    doubt = STEP if swings else REST_DOUBT
    return last_root, SETTLED * abs(one.s) + second / (1.0 - ratio) + doubt * first


def _taylor(unsteady: UnsteadyVehicle, s: complex) -> tuple[list[ComplexArray], complex]:
    """Q about iw to second order in s - iw."""
    w = s.imag
    Q = unsteady.magnets_at(w * np.array([1.0, 1.0 + STEP, 1.0 - STEP]))
    first = -1j * (Q[1] - Q[2]) / (2.0 * STEP * w)
    second = -(Q[1] - 2.0 * Q[0] + Q[2]) / (STEP * w) ** 2
    return [Q[0], first, 0.5 * second], 1j * w


def _taylor_at_rest(unsteady: UnsteadyVehicle, s: complex) -> list[ComplexArray]:
    """Q about 0 to fourth order: c(w) = h1 - h3 w^2 and m(w) = h2 - h4 w^2 from two frequencies."""
    w = np.array([unsteady.band[0], max(0.5 * abs(s), 2.0 * unsteady.band[0])])
    Q, k = unsteady.magnets_at(w), unsteady.static()
    c, m = Q.imag / w[:, None, None], (k - Q.real) / w[:, None, None] ** 2
    span = w[1] ** 2 - w[0] ** 2
    third, fourth = -(c[1] - c[0]) / span, -(m[1] - m[0]) / span
    return [np.asarray(part + 0j) for part in (k, c[0] + third * w[0] ** 2, m[0] + fourth * w[0] ** 2, third, fourth)]


def _newton(
    evaluate: Callable[[complex], tuple[ComplexArray, ComplexArray]], s: complex, shape: ComplexArray, *, real: bool
) -> tuple[complex | None, bool]:
    """Root of D(s) x = 0 by bordered Newton steps, and whether it settled; None when it strays."""
    size = float(np.linalg.norm(shape))
    if not (np.isfinite(size) and size > 0.0):
        return None, False
    x, start, n = shape / size, s, len(shape)
    for _ in range(NEWTON_STEPS):
        try:
            D, slope = evaluate(s)
            rows = 1.0 / np.maximum(np.max(np.abs(D) + abs(s) * np.abs(slope), axis=1), np.finfo(float).tiny)
            bordered = np.zeros((n + 1, n + 1), dtype=np.complex128)
            bordered[:n, :n], bordered[:n, n], bordered[n, :n] = rows[:, None] * D, rows * (slope @ x), x.conj()
            change = np.linalg.solve(bordered, np.append(-rows * (D @ x), 0.0))
        except (ValueError, np.linalg.LinAlgError):
            return None, False
        x, s = x + change[:n], s + complex(change[n])
        x = x / float(np.linalg.norm(x))
        if real:
            s = complex(s.real)
        if not np.isfinite(s) or abs(s - start) > 0.5 * abs(start):
            return None, False
        if abs(change[n]) <= 1e-12 * abs(s):
            return s, True
    return s, False


def fit_error(unsteady: UnsteadyVehicle, found: Modes) -> FloatArray:
    """First-order estimate of what the fits' residual moves each eigenvalue of the augmented system; (m,).

    Off the imaginary axis, where nothing was fitted, a rational form is worse: the residual is widened with the
    distance from the axis, up to twenty times for a real root.

    Parameters
    ----------
    found : modes of `unsteady.augmented`
    """
    system = unsteady.augmented
    n, positions = len(system.dofs), len(system.positions)
    velocity = found.states[positions : positions + n]
    left = np.linalg.solve(system.M.T, found.left[positions : positions + n])
    total = np.zeros(len(found.s))
    for one, fit in zip(unsteady.responses, unsteady.fits, strict=True):
        # The error of the force is that of H times the velocity.
        worst = fit.residual * fit.scale
        total += one.factor * np.sum(np.abs(one.push @ left) * (worst @ np.abs(one.motion @ velocity)), axis=0)
    away = np.abs(found.s.real) / np.maximum(np.abs(found.s), np.finfo(float).tiny)
    return np.asarray(total * (BETWEEN + OFF_AXIS * away) + found.error_bound)
