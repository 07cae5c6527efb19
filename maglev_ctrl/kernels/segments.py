"""Segment propagators as polynomials in the modulation, one expansion for all segments and all depths.

Within a segment that starts at the phase a the generator is A_0 + sum_q z_q F_q(u): u is the time since the start, the
2 H numbers z are depth * (cos k a, sin k a), and the F_q(u) are the same in every segment. The propagator is an entire
function of z, and as a segment is short against the modulation, a few degrees of its Taylor series in z are enough.
Each coefficient solves x_i' = A_0 x_i + sum_q F_q x_(i - q).
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import lru_cache
from math import comb

import numpy as np
from numpy.typing import NDArray

from maglev_ctrl.arrays import FloatArray

_MOST_DEGREE = 12


@dataclass(frozen=True, eq=False, slots=True)
class Monomials:
    """All monomials up to a total degree in `variables` unknowns; monomial 0 is 1.

    `parents` (q, monomials): the index of the monomial divided by unknown q, or -1; `powers` (monomials, q).
    """

    powers: NDArray[np.intp]
    parents: NDArray[np.intp]

    def values(self, z: FloatArray) -> FloatArray:
        """Every monomial at points z (p, q): (p, monomials).

        Examples
        --------
        >>> monomials(2, 2).values(np.array([[3.0, 5.0]]))
        array([[ 1.,  3.,  5.,  9., 15., 25.]])
        """
        result = np.ones((len(self.powers), len(z)))
        for i in range(1, len(self.powers)):
            q = int(np.argmax(self.parents[:, i] >= 0))
            np.multiply(result[self.parents[q, i]], z[:, q], out=result[i])
        return np.ascontiguousarray(result.T)


@lru_cache(maxsize=64)
def monomials(variables: int, degree: int) -> Monomials:
    """Monomials in ascending total degree."""
    exponents: list[tuple[int, ...]] = []
    for total in range(degree + 1):
        for chosen in itertools.combinations_with_replacement(range(variables), total):
            exponents.append(tuple(chosen.count(q) for q in range(variables)))
    place = {power: i for i, power in enumerate(exponents)}
    parents = np.full((variables, len(exponents)), -1, dtype=np.intp)
    for i, power in enumerate(exponents):
        for q in range(variables):
            if power[q]:
                parents[q, i] = place[(*power[:q], power[q] - 1, *power[q + 1 :])]
    powers = np.array(exponents, dtype=np.intp).reshape(len(exponents), variables)
    powers.flags.writeable = parents.flags.writeable = False  # shared by all callers
    return Monomials(powers, parents)


def degree_for(
    A_0: FloatArray, A_cos: FloatArray, A_sin: FloatArray, *, step: float, depth: float, tolerance: float
) -> int | None:
    """Smallest total degree whose remainder is below `tolerance` by a majorant; None when it would be large.

    |depth cos(k a) F_cos + depth sin(k a) F_sin| <= depth (|A_cos| + |A_sin|) at every instant, so the terms of degree
    m add up to at most exp(step |A_0|) q^m / m!.
    """
    norms = [np.linalg.norm(a, 2) + np.linalg.norm(b, 2) for a, b in zip(A_cos, A_sin, strict=True)]
    size = step * depth * float(np.sum(norms))
    term = float(np.exp(min(step * float(np.linalg.norm(A_0, 2)), 700.0)))
    for degree in range(_MOST_DEGREE + 1):
        term *= size / (degree + 1)
        if term * np.exp(size) <= tolerance:
            return degree
    return None


def count_monomials(variables: int, degree: int) -> int:
    """Number of monomials up to a total degree.

    Examples
    --------
    >>> count_monomials(2, 3)
    10
    """
    return comb(variables + degree, variables)


def segment_coefficients(
    A_0: FloatArray, A_cos: FloatArray, A_sin: FloatArray, basis: Monomials, *, step: float, frequency: float,
    order: int,
) -> FloatArray:  # fmt: skip
    """Coefficient matrices of the segment propagator, (monomials, n, n), by a Taylor recurrence in time.

    Parameters
    ----------
    A_0 : (n, n); A_cos, A_sin : (H, n, n) at unit depth, 1/s
    basis : monomials in 2 H unknowns: cosine and sine of every harmonic in turn
    step : length of the segment, s
    frequency : rad/s
    order : of the Taylor series in time
    """
    n, harmonics = len(A_0), len(A_cos)
    read = np.nonzero(np.any((A_cos != 0.0) | (A_sin != 0.0), axis=(0, 1)))[0]
    rows, count = len(read), len(basis.powers)
    stacked = np.concatenate([A_0, *(m[:, read] for pair in zip(A_cos, A_sin, strict=True) for m in pair)], axis=1)
    # only monomials below the top degree feed others; the column block behind them stands for "no parent" and is zero
    feeding = int(np.max(basis.parents, initial=-1)) + 1
    cosines, sines = trigonometric(np.asarray(frequency * step * np.arange(1.0, harmonics + 1.0)), order)
    history = np.zeros((order + 1, rows, feeding * n))
    current = np.zeros((n, count, n))
    current[:, 0] = np.eye(n)
    total = current.copy()
    combined = np.zeros((stacked.shape[1], count, n))
    padded = np.zeros((2, rows, feeding + 1, n))
    for m in range(order):
        history[order - m] = current[read, :feeding].reshape(rows, feeding * n)
        combined[:n] = current
        newest = history[order - m :].reshape(m + 1, -1)
        for k in range(harmonics):
            padded[0, :, :-1] = (cosines[k, : m + 1 : 2] @ newest[::2]).reshape(rows, feeding, n)
            if m:
                padded[1, :, :-1] = (sines[k, 1 : m + 1 : 2] @ newest[1::2]).reshape(rows, feeding, n)
            even, odd = padded
            by_cosine, by_sine = basis.parents[2 * k], basis.parents[2 * k + 1]
            at = n + 2 * k * rows
            np.subtract(even[:, by_cosine], odd[:, by_sine], out=combined[at : at + rows])
            np.add(odd[:, by_cosine], even[:, by_sine], out=combined[at + rows : at + 2 * rows])
        np.matmul(stacked, combined.reshape(len(combined), -1), out=current.reshape(n, -1))
        current *= step / (m + 1)
        total += current
    return np.ascontiguousarray(total.transpose(1, 0, 2))


def trigonometric(angle: FloatArray, order: int) -> tuple[FloatArray, FloatArray]:
    """Taylor coefficients of cos(angle u) and sin(angle u): (H, order + 1) each, zeros where the parity is wrong."""
    j = np.arange(order + 1)
    factorials = np.cumprod(np.concatenate([[1.0], np.arange(1.0, order + 1.0)]))
    factors = (-1.0) ** (j // 2) * angle[:, None] ** j / factorials
    return np.where(j % 2, 0.0, factors), np.where(j % 2, factors, 0.0)
