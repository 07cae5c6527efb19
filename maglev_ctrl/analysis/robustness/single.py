"""One uncertain parameter: all its values that put a pole on the axis, exactly.

Two poles of A(d) add up to zero where A(d) X + X A(d)' = 0 has a solution X. With the change pulled out,
A X + X A' + B W + (B W)' = 0 and W = d (C X + D W): eliminating X leaves W = d T(W), so that the values are the
inverses of the real eigenvalues of an operator on matrices of the size of W.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg
import scipy.optimize

from maglev_ctrl.analysis.robustness.records import StabilityRange
from maglev_ctrl.analysis.robustness.search import growth_rates
from maglev_ctrl.analysis.robustness.uncertain_loop import UncertainLoop
from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.errors import Agreement

_LARGEST = 3000
_NEARLY_REAL = 1e-5
_LOOKS = 160
_SAME = 1e-6


def stability_range(loop: UncertainLoop, *, limit: float = 1e3) -> StabilityRange:
    """The range of a single parameter, around nominal, for which the loop is stable.

    Parameters
    ----------
    limit : how far, in units of the spread, the second method looks along the range

    Raises
    ------
    ValueError : more than one parameter, an unstable nominal loop, or a loop too large for the exact method

    Examples
    --------
    >>> plant = UncertainLoop.from_affine([[0.0, 1.0], [-4.0, -0.1]], [[[0.0, 0.0], [-4.0, 0.0]]])
    >>> found = stability_range(plant)
    >>> round(found.low, 9), found.high
    (-1.0, inf)
    """
    if len(loop.blocks) != 1:
        raise ValueError(f"loop: expected one parameter, got {len(loop.blocks)}: {', '.join(loop.names)}")
    n, r = loop.B.shape
    if n * r > _LARGEST:
        raise ValueError(f"loop: expected at most {_LARGEST} states times rank, got {n} x {r}")
    if growth_rates(loop, np.zeros((1, 1)))[0] >= 0.0:
        raise ValueError("loop: expected a stable nominal loop")
    values = _critical_values(loop)
    ends = [_end(loop, values, sign) for sign in (-1.0, 1.0)]
    (low, low_frequency), (high, high_frequency) = ends
    seen = [_first_unstable(loop, sign, limit) for sign in (-1.0, 1.0)]
    doubts = [
        f"{side} end: eigenvalues say {exact:.6g}, the search {other:.6g}"
        for side, exact, other in (("lower", -low, seen[0]), ("upper", high, seen[1]))
        if not _same(exact, other, limit)
    ]
    return StabilityRange(
        low=low, high=high, low_frequency=low_frequency, high_frequency=high_frequency, limit=float(limit),
        agreement=Agreement.UNRESOLVED if doubts else Agreement.AGREED, reason="; ".join(doubts),
    )  # fmt: skip


def _critical_values(loop: UncertainLoop) -> FloatArray:
    """Real d at which two poles of A(d) add up to zero; sorted by modulus."""
    n, r = loop.B.shape
    triangle, turn = scipy.linalg.schur(loop.A, output="real")
    into, out = turn.T @ loop.B, loop.C @ turn
    T = np.empty((r, n, r, n))
    for i in range(r):
        for j in range(n):
            # W = e_i e_j' in Schur coordinates: A X + X A' = -(B W + (B W)')
            right = np.zeros((n, n))
            right[:, j] -= into[:, i]
            right[j] -= into[:, i]
            solution, scale, _ = scipy.linalg.lapack.dtrsyl(triangle, triangle, right, tranb="T")
            image = out @ (solution / scale)
            image[:, j] += loop.D[:, i]
            T[:, :, i, j] = image
    values = np.linalg.eigvals(T.reshape(r * n, r * n))
    real = values[(np.abs(values.imag) <= _NEARLY_REAL * np.abs(values)) & (np.abs(values) > 1e-12)].real
    found = 1.0 / real
    return np.asarray(found[np.argsort(np.abs(found))], dtype=np.float64)


def _end(loop: UncertainLoop, values: FloatArray, sign: float) -> tuple[float, float]:
    """The first value on one side behind which the loop is unstable, and the frequency there.

    Between values nothing crosses, so one look between each and the next tells; at some two real poles only mirror
    each other.
    """
    side = sign * values[sign * values > 0.0]
    for k, value in enumerate(side):
        beyond = 0.5 * (value + side[k + 1]) if k + 1 < side.size else 2.0 * value
        beyond = min(beyond, value * (1.0 + 1e-3)) if beyond > value * (1.0 + 1e-9) else value * (1.0 + 1e-6)
        if growth_rates(loop, np.array([[sign * beyond]]))[0] >= 0.0:
            poles = np.linalg.eigvals(loop.state_matrix([sign * value]))
            top = poles[int(np.argmax(poles.real))]
            return sign * float(value), float(abs(top.imag)) if abs(top.imag) > 1e-6 * abs(poles).max() else 0.0
    return sign * np.inf, np.nan


def _first_unstable(loop: UncertainLoop, sign: float, limit: float) -> float:
    """The second method: first sign change of the growth rate along the range; inf where there is none."""
    sizes = np.concatenate([[0.0], np.geomspace(1e-4, 1.0, _LOOKS) * limit])
    rates = growth_rates(loop, sign * sizes[:, None])
    unstable = np.flatnonzero(rates >= 0.0)
    if not unstable.size:
        return float(np.inf)
    first = int(unstable[0])
    if not np.isfinite(rates[first]):
        return float(sizes[first])

    def rate(size: float) -> float:
        return float(growth_rates(loop, np.array([[sign * size]]))[0])

    return float(scipy.optimize.brentq(rate, sizes[first - 1], sizes[first], xtol=1e-14 * limit))


def _same(exact: float, other: float, limit: float) -> bool:
    if not np.isfinite(other):
        return bool(exact >= limit * (1.0 - 1e-9))
    return bool(np.isfinite(exact) and abs(exact - other) <= _SAME * max(exact, 1e-4 * limit))
