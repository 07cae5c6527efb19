"""Rational fit of a dynamic stiffness, so that a frequency-dependent force becomes a few internal states.

    Q(s) = K + C s + M s^2 + sum over j of R_j s / (s - p_j)

K is the static stiffness, imposed exactly; poles are shared by all entries and lie strictly in the left half plane;
complex ones come in pairs. What is fitted is H = (Q - K)/s, of which Re H is the damping: an error that is small
beside |Q| would swamp a damping force that is itself small beside the stiffness.

Vector fitting: B. Gustavsen & A. Semlyen, IEEE Trans. Power Delivery 14 (1999) 1052; relaxed: B. Gustavsen, ibid. 21
(2006) 1587; entry by entry compression: D. Deschrijver et al., IEEE Microw. Wirel. Compon. Lett. 18 (2008) 383.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike, NDArray

from maglev_ctrl.arrays import ComplexArray, FloatArray, read_only, read_only_any
from maglev_ctrl.errors import ModelError

RELOCATIONS = 15
CLOSEST = 1e-6  # of |p|: the least decay of a pole
NOISE = 1e3 * float(np.finfo(np.float64).eps)  # relative rounding of Q that H must not be fitted to
FEWEST = 5


@dataclass(frozen=True, eq=False, slots=True)
class RationalStiffness:
    """A fitted dynamic stiffness Q(s) = K + C s + M s^2 + sum of R_j s / (s - p_j) of m coordinates.

    `static` K, `damping` C, `mass` M (m, m) real; `poles` (p,) 1/s, of a pair only the one with Im > 0, and
    `residues` (p, m, m) complex (real for a real pole), the conjugate understood; `band` rad/s; `residual`: the
    largest error of H = (Q - K)/s on the frequencies `held_back` (which the fit never saw), entry by entry relative to
    `scale` (m, m) N s/m; at most `tolerance`.
    """

    static: FloatArray
    damping: FloatArray
    mass: FloatArray
    poles: ComplexArray
    residues: ComplexArray
    band: tuple[float, float]
    scale: FloatArray
    residual: float
    tolerance: float
    held_back: FloatArray

    @property
    def order(self) -> int:
        """Number of poles, both members of a pair counted."""
        return int(np.sum(np.where(self.poles.imag > 0.0, 2, 1)))

    def at(self, s: ArrayLike) -> ComplexArray:
        """Q at complex rates s (...) in 1/s; (..., m, m)."""
        rate = np.asarray(s, dtype=np.complex128)[..., None, None]
        found = self.static + self.damping * rate + self.mass * rate**2
        for pole, residue in zip(self.poles, self.residues, strict=True):
            found = found + residue * rate / (rate - pole)
            if pole.imag > 0.0:
                found = found + residue.conj() * rate / (rate - pole.conjugate())
        return np.asarray(found, dtype=np.complex128)


def fit_rational(
    frequency: ArrayLike,
    stiffness: ArrayLike,
    *,
    static: ArrayLike,
    tolerance: float = 1e-3,
    order_at_most: int = 14,
    mass: bool = False,
) -> RationalStiffness:
    """The rational form of the smallest order that meets a tolerance at frequencies it was not fitted to.

    Every second frequency inside the band is held back. The error is that of H = (Q - K)/s, relative, entry by entry,
    to the largest |H_ij| or sqrt(|H_ii| |H_jj|), whichever is larger.

    Parameters
    ----------
    frequency : (F,) rad/s, positive and distinct, at least five; the fit covers their span
    stiffness : (F, m, m) complex Q at these frequencies
    static : (m, m) Q(0)
    order_at_most : largest number of poles to try
    mass : whether a term M s^2 is allowed

    Raises
    ------
    ValueError : a shape that does not fit, frequencies that are not positive and distinct, a tolerance out of (0, 1)
    ModelError : no order reaches the tolerance

    Examples
    --------
    >>> w = np.geomspace(1.0, 100.0, 9)
    >>> Q = -40.0 - 3.0 * 1j * w / (1.0 + 0.02 * 1j * w)
    >>> found = fit_rational(w, Q[:, None, None], static=[[-40.0]], tolerance=1e-9)
    >>> found.order, round(float(found.poles[0].real), 6)
    (1, -50.0)
    """
    w, Q, K = _checked(frequency, stiffness, static)
    if not 0.0 < tolerance < 1.0:
        raise ValueError(f"tolerance: expected a number between 0 and 1, got {tolerance}")
    m = len(K)
    H = (Q - K) / (1j * w[:, None, None])
    scale, active = _scales(H, Q, K, w[0])
    goal = np.asarray((H / scale)[:, active], dtype=np.complex128)
    aside = np.arange(1, len(w) - 1, 2)
    kept = np.setdiff1d(np.arange(len(w)), aside)
    s = np.asarray(1j * w / w[-1], dtype=np.complex128)
    best = _Form(np.zeros(0, dtype=np.complex128), np.zeros((1 + mass, goal.shape[1])))
    least = np.inf if goal.size else 0.0  # nothing that depends on the motion: nothing to fit
    most = min(order_at_most, len(kept) - 2)
    for order in range(most + 1) if goal.size else ():
        for start in _starting_poles(order, w[0] / w[-1]):
            form = _fitted(s[kept], goal[kept], start, mass=mass)
            error = float(np.max(np.abs(_evaluated(s[aside], form, mass=mass) - goal[aside]), initial=0.0))
            if error < least:
                best, least = form, error
        if least <= tolerance:
            break
    if least > tolerance:
        raise ModelError(
            f"dynamic stiffness: no rational form of up to {most} poles meets the tolerance {tolerance:.3g} between "
            f"{w[0]:.4g} and {w[-1]:.4g} rad/s (best {least:.3g}); narrow the band or sample it more closely"
        )
    coefficients = _spread(best, scale=scale, active=active)
    residues, row = [], 0
    for pole in best.poles:
        paired = pole.imag > 0.0
        residues.append(w[-1] * (coefficients[row] + (1j * coefficients[row + 1] if paired else 0.0)))
        row += 2 if paired else 1
    return RationalStiffness(
        static=K,
        damping=read_only(coefficients[row], name="damping"),
        mass=read_only(coefficients[row + 1] / w[-1] if mass else np.zeros((m, m)), name="mass"),
        poles=read_only_any(w[-1] * best.poles),
        residues=read_only_any(np.array(residues, dtype=np.complex128).reshape(-1, m, m)),
        band=(float(w[0]), float(w[-1])),
        scale=read_only(np.where(active, scale, 0.0), name="scale"),
        residual=least,
        tolerance=tolerance,
        held_back=read_only(w[aside], name="held_back"),
    )


@dataclass(frozen=True, eq=False, slots=True)
class _Form:
    """Poles (one per pair) in units of the band's end, and real coefficients (n + 1 [+ 1], entries)."""

    poles: ComplexArray
    coefficients: FloatArray


def _checked(
    frequency: ArrayLike, stiffness: ArrayLike, static: ArrayLike
) -> tuple[FloatArray, ComplexArray, FloatArray]:
    w = read_only(frequency, name="frequency", shape=(None,))
    if w.ndim != 1 or len(w) < FEWEST:
        raise ValueError(f"frequency: expected at least {FEWEST} frequencies (F,), got shape {w.shape}")
    if np.any(w <= 0.0) or len(np.unique(w)) < len(w):
        raise ValueError("frequency: expected positive, distinct frequencies")
    K = read_only(static, name="static", shape=(None, None))
    Q = np.asarray(stiffness, dtype=np.complex128)
    if K.ndim != 2 or K.shape[0] != K.shape[1] or Q.shape != (len(w), *K.shape):
        raise ValueError(f"stiffness: expected shape (F, m, m) with static (m, m), got {Q.shape} and {K.shape}")
    if not np.all(np.isfinite(Q)):
        raise ValueError("stiffness: every entry must be finite")
    order = np.argsort(w)
    return w[order], Q[order], K


def _scales(H: ComplexArray, Q: ComplexArray, K: FloatArray, lowest: float) -> tuple[FloatArray, NDArray[np.bool_]]:
    """What errors of H are relative to, and which entries are more than rounding."""
    largest = np.max(np.abs(H), axis=0)
    size = np.maximum(np.max(np.abs(Q), axis=0), np.abs(K))
    noise = NOISE * np.maximum(size, np.sqrt(np.outer(np.diag(size), np.diag(size)))) / lowest
    active = largest > noise
    own = np.diag(np.where(active, largest, 0.0))
    scale = np.maximum(largest, np.sqrt(own[:, None] * own[None, :]))
    return np.where(active, scale, 1.0), active


def _starting_poles(order: int, lowest: float) -> list[ComplexArray]:
    """Real poles, and damped pairs, spread over the band and beyond it."""
    if order == 0:
        return [np.zeros(0, dtype=np.complex128)]
    real = -np.geomspace(max(lowest, 1e-2), 10.0, order).astype(np.complex128)
    pairs = np.geomspace(max(lowest, 3e-2), 3.0, order // 2) * (-1.0 + 1j)
    mixed = np.concatenate([np.full(order % 2, -1.0 + 0j), pairs])
    return [real] if order == 1 else [real, mixed]


def _fitted(s: ComplexArray, goal: ComplexArray, poles: ComplexArray, *, mass: bool) -> _Form:
    """Poles moved until they settle, then the residues; the best of all that were met."""
    best, least = None, np.inf
    for _ in range(RELOCATIONS if len(poles) else 1):
        design = _design(s, poles, mass=mass)
        solution, *_ = scipy.linalg.lstsq(_real(design), _real(goal), lapack_driver="gelsd")
        error = float(np.max(np.abs(design @ solution - goal), initial=0.0))
        if best is None or error < least:
            best, least = _Form(poles, np.asarray(solution, dtype=np.float64)), error
        if not len(poles):
            break
        moved = _relocated(s, goal, poles, mass=mass)
        if moved is None:
            break
        poles = moved
    assert best is not None
    return best


def _relocated(s: ComplexArray, goal: ComplexArray, poles: ComplexArray, *, mass: bool) -> ComplexArray | None:
    """One relaxed step: zeros of the common weight function, mirrored into the left half plane."""
    plain = _design(s, poles, mass=mass)
    weight = _design(s, poles, mass=False)
    n = weight.shape[1] - 1
    rows = []
    for column in goal.T:
        triangle = np.asarray(np.linalg.qr(_real(np.hstack([plain, -column[:, None] * weight])), mode="r"))
        rows.append(triangle[plain.shape[1] :, plain.shape[1] :])
    balance = float(np.linalg.norm(goal)) / len(s)
    system = np.vstack([*rows, balance * np.sum(weight.real, axis=0)[None, :]])
    target = np.zeros(len(system))
    target[-1] = balance * len(s)
    columns = np.linalg.norm(system, axis=0)
    columns = np.where(columns > 0.0, columns, 1.0)
    solution, *_ = scipy.linalg.lstsq(system / columns, target, lapack_driver="gelsd")
    solution = solution / columns
    constant = solution[n] if abs(solution[n]) > 1e-8 else 1e-8
    A, b = _pole_matrix(poles)
    moved = np.linalg.eigvals(A - np.outer(b, solution[:n]) / constant)
    if not np.all(np.isfinite(moved)):
        return None
    single = moved[moved.imag >= 0.0]
    size = np.maximum(np.abs(single), 1e-9)
    decay = np.maximum(np.abs(single.real), CLOSEST * size)
    return np.asarray(-decay + 1j * single.imag, dtype=np.complex128)


def _pole_matrix(poles: ComplexArray) -> tuple[FloatArray, FloatArray]:
    n = sum(2 if pole.imag > 0.0 else 1 for pole in poles)
    A, b = np.zeros((n, n)), np.ones(n)
    at = 0
    for pole in poles:
        if pole.imag > 0.0:
            A[at : at + 2, at : at + 2] = [[pole.real, pole.imag], [-pole.imag, pole.real]]
            b[at], b[at + 1] = 2.0, 0.0
            at += 2
        else:
            A[at, at] = pole.real
            at += 1
    return A, b


def _design(s: ComplexArray, poles: ComplexArray, *, mass: bool) -> ComplexArray:
    """Partial fractions with real coefficients, then 1 (and s); (F, columns)."""
    columns = []
    for pole in poles:
        first = 1.0 / (s - pole)
        if pole.imag > 0.0:
            second = 1.0 / (s - pole.conjugate())
            columns += [first + second, 1j * (first - second)]
        else:
            columns.append(first)
    columns.append(np.ones_like(s))
    if mass:
        columns.append(s)
    return np.asarray(np.stack(columns, axis=1), dtype=np.complex128)


def _evaluated(s: ComplexArray, form: _Form, *, mass: bool) -> ComplexArray:
    return np.asarray(_design(s, form.poles, mass=mass) @ form.coefficients, dtype=np.complex128)


def _real(array: ComplexArray) -> FloatArray:
    """Real parts on top of imaginary parts."""
    return np.concatenate([array.real, array.imag])


def _spread(form: _Form, *, scale: FloatArray, active: NDArray[np.bool_]) -> FloatArray:
    """Coefficients at the entries they belong to, in units of H; (columns, m, m)."""
    full = np.zeros((len(form.coefficients), *scale.shape))
    full[:, active] = form.coefficients
    return np.asarray(full * scale)
