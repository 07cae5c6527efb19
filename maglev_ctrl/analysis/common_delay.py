"""Delay margin of all channels at once: the smallest delay, the same in every channel, that destabilises.

With z = exp(-j w tau) in every channel the closed loop is x' = A x + B p, p = (z - 1)(C x + (D - I) p), where
(A, B, C, D) is the sensitivity. A mode v at j w makes X = v v*, P = p v*, Q = v p* solve A X + X A' + B P + Q B' = 0:
X is eliminated by the (regular) Lyapunov equation of the stable loop, and what is left is linear in z. Its eigenvalues
on the unit circle are all the crossings there are (after Chen, Gu & Nett 1995; Louisell 2001).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg
import scipy.optimize

from maglev_ctrl.analysis.crossings import scan_frequencies
from maglev_ctrl.analysis.loops import Loop, return_ratio
from maglev_ctrl.analysis.replay import Factor, pole_near
from maglev_ctrl.analysis.stability_gate import ClosedLoop, close
from maglev_ctrl.arrays import ComplexArray, FloatArray
from maglev_ctrl.errors import Agreement

_CLOSE = 1e-3
_LARGEST = 1500
_REPLAY = 1e-6


@dataclass(frozen=True, eq=False, slots=True)
class CommonDelay:
    """Smallest additional delay (s) common to all channels that puts a pole on the axis at `frequency` (rad/s).

    inf where none does; `pole_distance` is how far from j frequency, relative, the replayed pole of the exact loop
    lies. AGREED where the eigenvalues and a search along the frequency axis give the same delay and the replay holds.
    """

    delay: float
    frequency: float
    pole_distance: float
    agreement: Agreement
    reason: str


def common_delay_margin(loop: Loop) -> CommonDelay:
    """Delay margin of a loop with the same delay in every channel, on top of its own delays.

    Raises
    ------
    NotStable, ModelError : what `close` refuses
    ValueError : a sampled loop

    Examples
    --------
    >>> found = common_delay_margin(Loop.from_transfer_function([1.0], [1.0, 0.0]))
    >>> bool(abs(found.delay - np.pi / 2.0) < 1e-9), found.agreement.value
    (True, 'AGREED')
    """
    if loop.dt is not None:
        raise ValueError("loop: expected continuous time; a sampled loop takes whole samples of delay")
    closed = close(loop)
    end = np.abs(np.linalg.eigvals(loop.D))
    if end.size and np.max(end) >= 1.0 - 1e-12:
        return CommonDelay(0.0, np.inf, 0.0, Agreement.AGREED, "any delay destabilises: gain one at infinite frequency")
    by_search = _delays(loop, _searched(closed))
    n, m = closed.B.shape
    if 2 * n * m > _LARGEST:
        return _told(loop, by_search, by_search, "the loop is too large for the exact method")
    return _told(loop, _delays(loop, _pencil_frequencies(closed)), by_search, "")


def _told(loop: Loop, exact: FloatArray, searched: FloatArray, reason: str) -> CommonDelay:
    both = np.vstack([exact, searched])
    if not both.size:
        settled = Agreement.UNRESOLVED if reason else Agreement.AGREED
        return CommonDelay(np.inf, np.nan, np.nan, settled, reason or "no eigenvalue of the loop ever has modulus one")
    delay, frequency = both[int(np.argmin(both[:, 0]))]
    factor = Factor(delay=float(delay))
    pole = pole_near(loop, 1j * frequency, tuple(factor for _ in loop.channels)).pole
    distance = float(abs(pole - 1j * frequency) / frequency)
    least = [float(np.min(found[:, 0])) if found.size else np.inf for found in (exact, searched)]
    if not reason and abs(least[0] - least[1]) > _REPLAY * delay:
        reason = f"UNRESOLVED: eigenvalues say {least[0]:.6g} s, the search {least[1]:.6g} s"
    if distance > _REPLAY:
        reason = f"UNRESOLVED: the replayed pole lies {distance:.2g} away from the axis"
    return CommonDelay(
        float(delay) if distance <= _REPLAY else np.nan, float(frequency), distance,
        Agreement.UNRESOLVED if reason else Agreement.AGREED, reason,
    )  # fmt: skip


def _delays(loop: Loop, frequencies: FloatArray) -> FloatArray:
    """(k, 2) delay and frequency where an eigenvalue of the exact L has modulus one, polished from the guesses."""
    found = []
    for guess in frequencies[frequencies > 0.0]:
        values = np.linalg.eigvals(return_ratio(loop, guess))
        for value in values[np.abs(np.log(np.abs(values) + 1e-300)) < 0.1]:
            omega, eigenvalue = _polished(loop, float(guess), complex(value))
            if np.isfinite(omega):
                found.append((float(np.mod(np.angle(eigenvalue) + np.pi, 2.0 * np.pi)) / omega, omega))
    return np.array(found).reshape(-1, 2)


def _polished(loop: Loop, omega: float, eigenvalue: complex) -> tuple[float, complex]:
    """Newton's method (secants) on log |lambda(w)| = 0 along one eigenvalue; NaN where it does not arrive."""
    for _ in range(30):
        values = np.linalg.eigvals(return_ratio(loop, omega))
        eigenvalue = complex(values[int(np.argmin(np.abs(values - eigenvalue)))])
        miss = float(np.log(abs(eigenvalue)))
        if abs(miss) < 1e-12:
            return omega, eigenvalue
        step = 1e-6 * omega
        beyond = np.linalg.eigvals(return_ratio(loop, omega + step))
        slope = (float(np.log(abs(beyond[int(np.argmin(np.abs(beyond - eigenvalue)))]))) - miss) / step
        if slope == 0.0:
            break
        omega -= float(np.clip(miss / slope, -0.2 * omega, 0.2 * omega))
    return (omega, eigenvalue) if abs(miss) < 1e-9 else (np.nan, eigenvalue)


def _searched(closed: ClosedLoop) -> FloatArray:
    """Frequencies between which the number of eigenvalues of L beyond modulus one changes."""
    scan = scan_frequencies(closed)
    values = np.abs(np.linalg.eigvals(return_ratio(closed.loop, scan)))
    count = np.sum(values > 1.0, axis=-1)
    roots = []
    for k in np.flatnonzero(np.diff(count)):
        low, high = float(scan[k]), float(scan[k + 1])
        order = int(min(count[k], count[k + 1]))  # the eigenvalue that passes through one, by its rank

        def miss(omega: float, order: int = order) -> float:
            sizes = np.sort(np.abs(np.linalg.eigvals(return_ratio(closed.loop, omega))))[::-1]
            return float(np.log(sizes[order] + 1e-300))

        roots.append(float(scipy.optimize.brentq(miss, low, high, xtol=1e-12 * high)))
    return np.asarray(roots, dtype=np.float64)


def _pencil_frequencies(closed: ClosedLoop) -> FloatArray:
    """Frequencies of all crossings, from the eigenvalues z on the unit circle of the pencil in (P, Q)."""
    A, B, C = closed.A, closed.B, closed.C
    n, m = B.shape
    through = closed.D - np.eye(m)
    triangle, turn = scipy.linalg.schur(A, output="real")
    into, out = turn.T @ B, C @ turn
    size = n * m
    by_P, by_Q = np.zeros((2 * size, size)), np.zeros((2 * size, size))
    for i in range(m):
        for j in range(n):
            right = np.zeros((n, n))
            right[:, j] = -into[:, i]
            solution, scale, _ = scipy.linalg.lapack.dtrsyl(triangle, triangle, right, tranb="T")
            X = solution / scale  # from P = e_i e_j'; Q = e_j e_i' gives its transpose
            k = i * n + j
            first, second = out @ X, X @ out.T
            first[:, j] += through[:, i]
            by_P[:, k] = np.concatenate([first.ravel(), second.ravel()])
            first, second = out @ X.T, X.T @ out.T
            second[j] += through[:, i]
            by_Q[:, k] = np.concatenate([first.ravel(), second.ravel()])
    T = np.hstack([by_P, by_Q])
    left, right_side = T.copy(), T.copy()
    left[:size, :size] += np.eye(size)  # P + T1 = z T1
    right_side[size:, size:] += _transposed_eye(n, m)  # T2 = z (Q + T2), Q numbered like P
    values = scipy.linalg.eigvals(left, right_side)
    values = values[np.isfinite(values) & (np.abs(values) > 0.0)]
    on_circle = values[np.abs(np.log(np.abs(values))) < _CLOSE]
    return _frequencies(closed, np.asarray(on_circle, dtype=np.complex128))


def _transposed_eye(n: int, m: int) -> FloatArray:
    """Q (n, m), flattened by rows, from its numbering by (i, j) of P (m, n)."""
    swap = np.zeros((n * m, n * m))
    for i in range(m):
        for j in range(n):
            swap[j * m + i, i * n + j] = 1.0
    return swap


def _frequencies(closed: ClosedLoop, circle: ComplexArray) -> FloatArray:
    """Imaginary parts of the poles near the axis with z in every channel."""
    m = closed.D.shape[0]
    found = []
    for z in circle:
        share = z - 1.0
        inner = np.linalg.solve(np.eye(m) - share * (closed.D - np.eye(m)), share * closed.C)
        poles = np.linalg.eigvals(closed.A + closed.B @ inner)
        near = np.abs(poles.real) <= 1e-2 * np.abs(poles)
        found.extend(np.abs(poles.imag[near]))
    return np.unique(np.asarray(found, dtype=np.float64))
