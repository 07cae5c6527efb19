"""Norms of linear systems, each by two methods: H2 and L2 (energy), H-infinity and L-infinity (peak gain).

H2 and H-infinity belong to stable systems and are infinite for others; L2 and L-infinity look at the imaginary axis
(the unit circle) alone and are finite while no pole lies there. A pole on the axis counts only if inputs move it and
outputs see it; one that is hidden is left out, and the message says so.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import cast

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike
from scipy.optimize import minimize_scalar

from maglev_ctrl.analysis.hamiltonian import (
    balanced_realisation,
    continuous_equivalent,
    gain_rounding,
    largest_gain,
    peak_gain,
    response,
)
from maglev_ctrl.analysis.minimal import linked_states, minimal_part
from maglev_ctrl.arrays import ComplexArray, FloatArray, read_only
from maglev_ctrl.errors import Agreement

EPS = float(np.finfo(float).eps)
SAME = 1e-8
"""Two methods agree where they differ by less than this share."""
SHARP = 1e-6
"""A peak that rounding of the matrices may move by more than this share is not told as known."""


@dataclass(frozen=True, eq=False, slots=True)
class SystemNorm:
    """A norm of a system: `value` (inf where it does not exist), whether two methods gave it, and what was noticed.

    `frequency` rad/s where a peak gain is attained (inf: at the feedthrough); None for energies. `difference` between
    the two methods, relative.
    """

    value: float
    agreed: Agreement
    message: str = ""
    frequency: float | None = None
    difference: float = 0.0


@dataclass(frozen=True, eq=False, slots=True)
class _System:
    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray
    dt: float | None
    beyond: bool
    on_axis: bool
    certain: bool
    message: str
    doubtful: bool = False  # what was left out as hidden is weak, but not absent


def h2_norm(A: ArrayLike, B: ArrayLike, C: ArrayLike, D: ArrayLike, *, dt: float | None = None) -> SystemNorm:
    """H2 norm: energy of the responses to an impulse at every input, or the output's deviation under white noise.

    Parameters
    ----------
    A, B, C, D : (n, n), (n, m), (p, n), (p, m)
    dt : sampling period in s, None for continuous time, where any D but zero makes the norm infinite

    Raises
    ------
    ValueError : shapes do not fit

    Examples
    --------
    >>> round(h2_norm([[-2.0]], [[1.0]], [[4.0]], [[0.0]]).value, 12)  # sqrt(16 / 4)
    2.0
    >>> h2_norm([[0.0]], [[1.0]], [[1.0]], [[0.0]]).value
    inf
    """
    system = _system(A, B, C, D, dt)
    if system.beyond or system.on_axis:
        return _infinite(system)
    if dt is None and np.any(system.D):
        return SystemNorm(np.inf, Agreement.AGREED, "the feedthrough passes noise of unlimited bandwidth")
    return _energy(system, _energy_by_gramian(system), _energy_by_doubling(system))


def l2_norm(A: ArrayLike, B: ArrayLike, C: ArrayLike, D: ArrayLike, *, dt: float | None = None) -> SystemNorm:
    """L2 norm: the energy on the axis, sqrt(integral of trace G'G dw / 2 pi), also of a system that is not stable.

    The parts left and right of the axis are orthogonal; the second method makes the system stable by an all-pass
    factor, G M with M inner, which leaves the gain on the axis as it is (continuous), or sums over the circle.

    Raises
    ------
    ValueError : shapes do not fit

    Examples
    --------
    >>> round(l2_norm([[2.0]], [[1.0]], [[4.0]], [[0.0]]).value, 12)
    2.0
    """
    system = _system(A, B, C, D, dt)
    if system.on_axis:
        return _infinite(system)
    if dt is None and np.any(system.D):
        return SystemNorm(np.inf, Agreement.AGREED, "the feedthrough passes noise of unlimited bandwidth")
    if not system.beyond:
        return _energy(system, _energy_by_gramian(system), _energy_by_doubling(system))
    stable, other = _split(system)
    if dt is None:
        mirrored = _System(-other.A, other.B, -other.C, other.D, None, False, False, True, "")
        total = float(np.hypot(_energy_by_gramian(stable), _energy_by_gramian(mirrored)))
        return _energy(system, total, _energy_by_all_pass(system))
    back: FloatArray = np.asarray(np.linalg.inv(other.A), dtype=np.float64)
    middle = system.D - other.C @ back @ other.B
    mirrored = _System(back, back @ other.B, other.C @ back, np.zeros_like(system.D), dt, False, False, True, "")
    parts = [float(np.linalg.norm(middle)), _energy_by_gramian(stable), _energy_by_gramian(mirrored)]
    return _energy(system, float(np.linalg.norm(parts)), _energy_by_sum(system))


def l_infinity_norm(A: ArrayLike, B: ArrayLike, C: ArrayLike, D: ArrayLike, *, dt: float | None = None) -> SystemNorm:
    """Largest gain over all frequencies, whether the system is stable or not; infinite with a pole on the axis.

    Raises
    ------
    ValueError : shapes do not fit

    Examples
    --------
    >>> round(l_infinity_norm([[1.0]], [[1.0]], [[1.0]], [[0.0]]).value, 9)
    1.0
    """
    system = _system(A, B, C, D, dt)
    return _infinite(system) if system.on_axis else _peak(system)


def h_infinity_norm(A: ArrayLike, B: ArrayLike, C: ArrayLike, D: ArrayLike, *, dt: float | None = None) -> SystemNorm:
    """Largest gain over all frequencies of a stable system; infinite for any other.

    Raises
    ------
    ValueError : shapes do not fit

    Examples
    --------
    >>> norm = h_infinity_norm([[0.0, 1.0], [-1.0, -1.0]], [[0.0], [1.0]], [[1.0, 0.0]], [[0.0]])
    >>> round(norm.value, 12), round(norm.frequency, 6)  # 2 / sqrt(3) at 1 / sqrt(2)
    (1.154700538379, 0.707107)
    """
    system = _system(A, B, C, D, dt)
    return _infinite(system) if system.beyond or system.on_axis else _peak(system)


def _system(A: ArrayLike, B: ArrayLike, C: ArrayLike, D: ArrayLike, dt: float | None) -> _System:
    """Checked and balanced; without its hidden part where a pole lies on the axis."""
    if dt is not None and not (np.isfinite(dt) and dt > 0.0):
        raise ValueError(f"dt: expected a positive sampling period in s or None, got {dt!r}")
    d = read_only(D, name="D", shape=(None, None))
    if d.ndim != 2:
        raise ValueError(f"D: expected one matrix, got shape {d.shape}")
    a = np.asarray(A, dtype=float)
    n = a.shape[-1] if a.size else 0
    a = read_only(a.reshape(n, n) if a.size == n * n else a, name="A", shape=(n, n))
    b = read_only(
        np.reshape(np.asarray(B, dtype=float), (n, d.shape[1])) if n == 0 else B, name="B", shape=(n, d.shape[1])
    )
    c = read_only(
        np.reshape(np.asarray(C, dtype=float), (d.shape[0], n)) if n == 0 else C, name="C", shape=(d.shape[0], n)
    )
    if n == 0:
        return _System(a, b, c, d, dt, False, False, True, "")
    a, b, c = balanced_realisation(a, b, c)
    beyond, on_axis, certain = _poles(a, dt)
    if not on_axis:
        return _System(a, b, c, d, dt, beyond, False, certain, "")
    small = minimal_part(a, b, c)
    if small[0].shape[0] == n:
        return _System(a, b, c, d, dt, beyond, True, certain, "a pole lies on the axis")
    still_beyond, still_on, certain = _poles(small[0], dt) if small[0].size else (False, False, True)
    told = "a pole lies on the axis" if still_on else "a pole on the axis is hidden from inputs or outputs: left out"
    doubtful = linked_states(a, b, c) > small[0].shape[0]
    return _System(*small, d, dt, beyond or still_beyond, still_on, certain, told, doubtful)


def _poles(A: FloatArray, dt: float | None) -> tuple[bool, bool, bool]:
    """Whether a pole lies beyond the axis, on it, and whether rounding leaves no doubt."""
    poles, left, right = cast(tuple[ComplexArray, ...], scipy.linalg.eig(A, left=True, right=True))
    overlap = np.abs(np.sum(left.conj() * right, axis=0))
    size = float(np.linalg.norm(A, 2))
    moved = np.sum(np.abs(left) * (np.abs(A) @ np.abs(right)), axis=0)  # first order, entry by entry
    blur = 4.0 * len(A) * EPS * moved / np.maximum(overlap, EPS)
    distance = poles.real if dt is None else np.abs(poles) - 1.0
    # A multiple pole is spread by a root of the rounding, never further than this share of the size.
    near = np.abs(distance) <= np.minimum(blur, 1e-4 * (size if dt is None else 1.0))
    exact = np.abs(distance) <= 4.0 * len(A) * EPS * (size if dt is None else 1.0)
    return bool(np.any((distance > 0.0) & ~near)), bool(np.any(near)), bool(np.all(exact[near]))


def _infinite(system: _System) -> SystemNorm:
    message = system.message if system.on_axis else "a pole lies beyond the axis"
    agreed = Agreement.AGREED if system.certain or system.beyond else Agreement.UNRESOLVED
    if agreed is Agreement.UNRESOLVED:
        message += " as far as rounding can tell"
    return SystemNorm(np.inf, agreed, message)


def _energy(system: _System, first: float, second: float) -> SystemNorm:
    return _compared(system, first, first, second, None)


def _compared(
    system: _System, value: float, first: float, second: float, frequency: float | None, *, rounding: float = 0.0
) -> SystemNorm:
    """AGREED where two methods meet, the norm is sharp against rounding, and nothing in doubt was left out."""
    larger = max(abs(first), abs(second))
    difference = abs(first - second) / larger if larger > 0.0 else 0.0
    told = [system.message] if system.message else []
    doubts = []
    if not difference <= SAME:
        doubts.append(f"two methods differ: {first:.12g} and {second:.12g}")
    if system.doubtful:
        doubts.append("rounding may hide that it is weak, not absent, and the norm infinite")
    if not rounding <= SHARP:
        doubts.append(f"rounding of the matrices may move the peak by {min(rounding, 1.0):.1e} of it")
    agreed = Agreement.UNRESOLVED if doubts else Agreement.AGREED
    return SystemNorm(value, agreed, "; ".join(told + doubts), frequency, difference)


def _energy_by_gramian(system: _System) -> float:
    """sqrt(trace(C P C' + D D')) with the Gramian of the inputs from a Schur form."""
    through = float(np.linalg.norm(system.D)) if system.dt is not None else 0.0
    if not system.A.size:
        return through
    load = system.B @ system.B.T
    if system.dt is None:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # SciPy warns where it changed the equation to have an answer: none, then
            try:
                P = scipy.linalg.solve_continuous_lyapunov(system.A, -load)
            except RuntimeWarning:
                return np.nan
    else:
        P = scipy.linalg.solve_discrete_lyapunov(system.A, load, method="bilinear")
    return float(np.hypot(through, np.sqrt(max(float(np.trace(system.C @ P @ system.C.T)), 0.0))))


def _energy_by_doubling(system: _System) -> float:
    """sqrt(trace(B' Q B + D'D)) with the Gramian of the outputs by squaring.

    Smith, SIAM J. Appl. Math. 16 (1968) 198.
    """
    through = float(np.linalg.norm(system.D)) if system.dt is not None else 0.0
    n = system.A.shape[0]
    if n == 0:
        return through
    step: FloatArray = system.A
    rows: FloatArray = system.C
    if system.dt is None:
        poles = np.abs(np.linalg.eigvals(system.A))
        shift = float(np.exp(np.mean(np.log(np.maximum(poles, 1e-300)))))
        lowered = shift * np.eye(n) - system.A
        step = np.asarray(np.linalg.solve(lowered, shift * np.eye(n) + system.A), dtype=np.float64)
        rows = np.asarray(np.sqrt(2.0 * shift) * np.linalg.solve(lowered.T, system.C.T).T, dtype=np.float64)
    Q = rows.T @ rows
    for _ in range(100):
        added = step.T @ Q @ step
        Q = Q + added
        if float(np.linalg.norm(added)) <= EPS * float(np.linalg.norm(Q)):
            break
        step = step @ step
    return float(np.hypot(through, np.sqrt(max(float(np.trace(system.B.T @ Q @ system.B)), 0.0))))


def _split(system: _System) -> tuple[_System, _System]:
    """The stable and the other part, apart (block-diagonal), without feedthrough."""
    T, basis, count = scipy.linalg.schur(system.A, output="real", sort="lhp" if system.dt is None else "iuc")
    A1, A2, A12 = T[:count, :count], T[count:, count:], T[:count, count:]
    R = scipy.linalg.solve_sylvester(A1, -A2, -A12)
    B, C = basis.T @ system.B, system.C @ basis
    zero = np.zeros_like(system.D)
    stable = _System(A1, B[:count] - R @ B[count:], C[:, :count], zero, system.dt, False, False, True, "")
    other = _System(A2, B[count:], C[:, :count] @ R + C[:, count:], zero, system.dt, True, False, True, "")
    return stable, other


def _energy_by_all_pass(system: _System) -> float:
    """H2 norm of G M, M inner with the unstable poles as zeros: A'X + X A = X B B'X, poles mirrored by -B'X.

    A part that no input moves does not show in G and is left out first.
    """
    A, B, C = minimal_part(system.A, system.B, system.C)
    if not A.size:
        return 0.0
    T, basis, count = scipy.linalg.schur(A, output="real", sort="lhp")
    if count < len(A):
        rows = basis.T @ B
        W = scipy.linalg.solve_continuous_lyapunov(T[count:, count:], rows[count:] @ rows[count:].T)
        right = np.linalg.solve(W, basis[:, count:].T)
        A = A - B @ (rows[count:].T @ right)
    return _energy_by_doubling(_System(A, B, C, system.D, None, False, False, True, ""))


def _energy_by_sum(system: _System) -> float:
    """Mean of trace G'G over the unit circle; the trapezoidal rule converges geometrically."""
    last = np.nan
    for count in (256, 1024, 4096, 16384):
        z = np.exp(1j * np.pi * (np.arange(count) + 0.5) / count)
        values = system.D + system.C @ np.linalg.solve(
            z[:, None, None] * np.eye(len(system.A)) - system.A, system.B + 0j
        )
        mean = float(np.sqrt(np.mean(np.sum(np.abs(values) ** 2, axis=(1, 2)))))
        if abs(mean - last) <= 1e-12 * mean:
            break
        last = mean
    return mean


def _peak(system: _System) -> SystemNorm:
    """Hamiltonian bisection and, independently, a search from every pole's frequency: it must not find more."""
    if not system.A.size or not np.any(system.B) or not np.any(system.C):
        return SystemNorm(
            float(np.linalg.norm(system.D, 2)) if system.D.size else 0.0, Agreement.AGREED, system.message, 0.0
        )
    peak = peak_gain(system.A, system.B, system.C, system.D, dt=system.dt, tolerance=1e-10)
    swept, at = _swept_peak(system)
    value, frequency = (swept, at) if swept > peak.lower else (peak.lower, peak.frequency)
    point = 1j * frequency if system.dt is None else complex(np.exp(1j * frequency * system.dt))
    rounding = gain_rounding(system.A, system.B, system.C, system.D, point)
    return _compared(system, value, peak.lower, swept, frequency, rounding=rounding)


def _swept_peak(system: _System) -> tuple[float, float]:
    """Largest gain over a grid laid around every pole, polished; only a lower bound by itself."""
    A, B, C, D = system.A, system.B, system.C, system.D
    if system.dt is not None:
        A, B, C, D = continuous_equivalent(A, B, C, D, system.dt)
        A, B, C = balanced_realisation(A, B, C)
    poles = np.linalg.eigvals(A)
    steps = np.concatenate([-np.geomspace(30.0, 0.1, 12), [0.0], np.geomspace(0.1, 30.0, 12)])
    size = float(np.max(np.abs(poles)))
    around = np.abs(poles.imag)[:, None] + np.maximum(np.abs(poles.real), 1e-12 * size)[:, None] * steps
    wide = np.geomspace(1e-3 * max(float(np.min(np.abs(poles))), 1e-9 * size), 1e3 * size, 200)
    grid = np.unique(np.concatenate([[0.0], np.abs(around).ravel(), np.abs(poles), wide]))
    grid = grid[np.concatenate([[True], np.diff(grid) > 1e-13 * grid[1:]])]

    def gain(frequency: float) -> float:
        return float(largest_gain(response(A, B, C, D, np.array([frequency])))[0])

    gains = largest_gain(response(A, B, C, D, grid))
    best, at = float(np.linalg.norm(D, 2)), np.inf
    tops = [k for k in range(grid.size) if gains[k] == np.max(gains[max(k - 1, 0) : k + 2])]
    for k in sorted(tops, key=lambda k: -gains[k])[:6]:
        low, high = grid[max(k - 2, 0)], grid[min(k + 2, grid.size - 1)]
        if gains[k] > best:
            best, at = float(gains[k]), float(grid[k])
        found = minimize_scalar(
            lambda w: -gain(w), bounds=(low, high), method="bounded", options={"xatol": 1e-9 * high}
        )
        if -float(found.fun) > best:
            best, at = -float(found.fun), float(found.x)
    if system.dt is not None:
        at = 2.0 / system.dt * float(np.arctan(at * system.dt / 2.0))
    return best, at
