"""All gain and phase crossovers of every loop, from eigenvalues of structured pencils, polished on the exact loop.

With S_ii = 1/(1 + L_i): |L_i| = 1 where Re S_ii = 1/2, and L_i is real where Im S_ii = 0. Both are zeros on the axis
of S_ii(s) +- S_ii(-s) - const, a system of twice the order whose zeros are generalised eigenvalues. An independent
search for sign changes on the poles' frequencies and a grid between them backs the eigenvalues up.
"""

from __future__ import annotations

from typing import Literal, assert_never

import numpy as np
import scipy.linalg
import scipy.optimize
from numpy.typing import NDArray

from maglev_ctrl.analysis.loops import bordered, delay_factors
from maglev_ctrl.analysis.replay import frequencies_of
from maglev_ctrl.analysis.stability_gate import ClosedLoop
from maglev_ctrl.arrays import ComplexArray, FloatArray

Kind = Literal["gain", "phase"]
_PER_DECADE = 25
_PER_TURN = 8
_MOST_TURNS = 4000


def scan_frequencies(closed: ClosedLoop) -> FloatArray:
    """Frequencies (on the axis) of the backing search: every pole with its neighbourhood, and a grid between."""
    narrow = frequencies_of(np.concatenate([np.linalg.eigvals(closed.A), np.linalg.eigvals(closed.loop.A) + 0j]))
    if closed.loop.dt is not None:
        narrow = frequencies_of(np.asarray(np.linalg.eigvals(closed.A), dtype=complex))
    moduli = narrow[narrow > 1e-12 * np.max(narrow, initial=0.0)]
    if not moduli.size:
        moduli = np.ones(1)
    low, high = np.log10(0.01 * moduli.min()), np.log10(100.0 * moduli.max())
    grid = np.logspace(low, high, int((high - low) * _PER_DECADE) + 2)
    points = np.unique(np.concatenate([moduli, grid]))
    if not np.isfinite(closed.reach):
        return points
    # Delays turn the phase for ever: step with the turn, up to where the loop gain has died out.
    step = np.pi / (_PER_TURN * float(np.max(closed.loop.delays)))
    turns = np.arange(1, min(int(closed.reach / step) + 2, _MOST_TURNS)) * step
    return np.unique(np.concatenate([points[points <= closed.reach], turns]))


def crossovers(
    closed: ClosedLoop, channel: int, kind: Kind, *, scan: FloatArray, scanned: ComplexArray
) -> tuple[FloatArray, bool]:
    """Positive finite frequencies (on the axis) where |L_i| = 1 ("gain") or L_i is real ("phase"), sorted.

    `scan`, `scanned`: frequencies of the backing search and S_ii there. The flag says whether both searches agree:
    every sign change of the search is an eigenvalue of the pencil.
    """
    roots = _polish(closed, channel, kind, pencil_frequencies(closed, channel, kind))
    values = _measure(scanned, kind)
    changes = np.flatnonzero(np.sign(values[:-1]) * np.sign(values[1:]) < 0)
    missed = changes[~_held(roots, scan, changes)]
    agree = not np.any(scan[missed] <= closed.band)  # beyond the band of a delayed loop the pencil promises nothing
    if missed.size:
        middle = _polish(closed, channel, kind, 0.5 * (scan[missed] + scan[missed + 1]))
        roots = _distinct(np.concatenate([roots, middle]))
        missed = missed[~_held(roots, scan, missed)]
    extra = [_bisect(closed, channel, kind, scan[k], scan[k + 1]) for k in missed]
    return _distinct(np.concatenate([roots, np.asarray(extra, dtype=float)])), agree


def _held(roots: FloatArray, scan: FloatArray, brackets: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Which brackets [scan_k, scan_k+1] hold a root already."""
    after = np.searchsorted(roots, scan[brackets + 1] * (1.0 + 1e-12), side="right")
    return np.asarray(after > np.searchsorted(roots, scan[brackets] * (1.0 - 1e-12), side="left"))


def pencil_frequencies(closed: ClosedLoop, channel: int, kind: Kind) -> FloatArray:
    """Imaginary parts of the zeros of S_ii(s) + S_ii(-s) - 1 ("gain") or S_ii(s) - S_ii(-s) ("phase") near the axis."""
    A, b, c = closed.A, closed.B[:, channel : channel + 1], closed.C[channel : channel + 1]
    n = A.shape[0]
    if n == 0:
        return np.zeros(0)
    match kind:
        case "gain":
            sign, through = -1.0, 2.0 * closed.D[channel, channel] - 1.0
        case "phase":
            sign, through = 1.0, 0.0
        case _:
            assert_never(kind)
    zero = np.zeros((n, n))
    pencil = np.block([[A, zero, b], [zero, -A.T, c.T], [c, sign * b.T, np.full((1, 1), through)]])
    # Shift and invert at a real point away from the poles: zeros at infinity go to 0 and harm nobody.
    rates = np.abs(np.linalg.eigvals(A))
    centre = float(np.exp(np.mean(np.log(rates[rates > 0.0])))) if np.any(rates > 0.0) else 1.0
    shifts = centre * np.array([1.0, 1.37, 0.71, 1.93, 0.47])
    shift = float(shifts[int(np.argmax([np.min(np.abs(rates - s)) / s for s in shifts]))])
    shifted = pencil.copy()
    shifted[np.arange(2 * n), np.arange(2 * n)] -= shift
    select = np.zeros((2 * n + 1, 2 * n))
    select[np.arange(2 * n), np.arange(2 * n)] = 1.0
    try:
        inverse = np.linalg.eigvals(np.linalg.solve(shifted, select)[: 2 * n])
    except np.linalg.LinAlgError:
        zeros = scipy.linalg.eigvals(pencil, np.diag(np.r_[np.ones(2 * n), 0.0]))
        zeros = zeros[np.isfinite(zeros)]
    else:
        inverse = inverse[np.abs(inverse) > 1e-14 * np.max(np.abs(inverse), initial=0.0)]
        zeros = shift + 1.0 / inverse
    near = np.abs(zeros.real) <= 1e-2 * np.abs(zeros)
    return np.unique(np.abs(zeros.imag[near]))


def _measure(values: ComplexArray, kind: Kind) -> FloatArray:
    return values.real - 0.5 if kind == "gain" else values.imag


def _with_slope(closed: ClosedLoop, channel: int, frequency: FloatArray) -> tuple[ComplexArray, ComplexArray]:
    """Exact S_ii and its derivative by the frequency on the axis."""
    loop = closed.loop
    points = closed.points(frequency)
    n, m = loop.B.shape
    right = np.zeros((n + m, 1), dtype=complex)
    right[n + channel] = 1.0
    matrix = bordered(loop, points)
    solution = np.linalg.solve(matrix, np.broadcast_to(right, (points.size, n + m, 1)))
    rate = 1j * np.ones(points.size) if loop.dt is None else 1j * loop.dt / (1.0 - 0.5j * frequency * loop.dt) ** 2
    theta = delay_factors(loop, points) * (-loop.delays)  # d theta / d s; discrete loops carry no delays here
    slope = np.zeros_like(matrix)
    slope[:, np.arange(n), np.arange(n)] = 1.0
    slope[:, :n, n:] = -loop.B * theta[:, None, :]
    slope[:, n:, n:] = loop.D * theta[:, None, :]
    change = -np.linalg.solve(matrix, slope @ solution)
    value, derivative = solution[:, n + channel, 0], change[:, n + channel, 0] * rate
    return np.asarray(value, dtype=np.complex128), np.asarray(derivative, dtype=np.complex128)


def _polish(closed: ClosedLoop, channel: int, kind: Kind, guesses: FloatArray) -> FloatArray:
    """Newton's method on the exact loop from every guess; those that do not arrive are dropped."""
    omega = guesses[guesses > 0.0]
    if not omega.size:
        return omega
    arrived = np.zeros(omega.size, dtype=bool)
    for _ in range(25):
        values, slopes = _with_slope(closed, channel, omega)
        miss, slope = _measure(values, kind), (slopes.real if kind == "gain" else slopes.imag)
        step = np.divide(miss, slope, out=np.zeros_like(miss), where=slope != 0.0)
        size = np.abs(values) if kind == "phase" else np.ones(omega.size)
        exact = np.abs(miss) <= 1e-10 * size
        arrived = exact & (np.abs(step) <= 1e-7 * omega)
        if np.all(arrived | (np.abs(step) <= 1e-15 * omega)):
            break
        omega = np.maximum(omega - np.clip(step, -0.3 * omega, 0.5 * omega), 1e-300)
    return _distinct(omega[arrived])


def _bisect(closed: ClosedLoop, channel: int, kind: Kind, low: float, high: float) -> float:
    def miss(omega: float) -> float:
        return float(_measure(closed.response(np.array([omega]))[:, channel, channel], kind)[0])

    return float(scipy.optimize.brentq(miss, low, high, xtol=1e-15 * high, rtol=1e-14))


def _distinct(roots: FloatArray) -> FloatArray:
    roots = np.sort(roots)
    return roots[np.r_[True, np.diff(roots) > 1e-9 * roots[1:]]] if roots.size else roots
