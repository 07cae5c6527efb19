"""Multipliers of a product of matrices without forming the product: periodic orthogonal iteration.

The product of many propagators loses every multiplier that is small against the largest one. Here an orthogonal basis
is carried through the factors, Q_k R_k = F_k Q_(k-1), until the basis repeats after a period; the logarithms of the
diagonal of R add up. Multipliers of like modulus (complex pairs among them) stay together in a small block.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from scipy.linalg import lapack

from maglev_ctrl.arrays import ComplexArray, FloatArray

_GROUP = 1e6  # factors are multiplied together while the product is conditioned better than this
_SPREAD = np.log(1e3)  # a block may hold multipliers whose moduli differ by this factor
_CLOSED = 1e-13


@dataclass(frozen=True, eq=False, slots=True)
class PeriodicMultipliers:
    """Multipliers of F_S ... F_1 by their complex logarithms `logs` (n,), largest modulus first.

    `error` (n,) bounds the relative error of each multiplier but for its own conditioning; `sweeps` through the
    factors were made; `converged` says that every block is narrow enough.
    """

    logs: ComplexArray
    error: FloatArray
    sweeps: int
    converged: bool


def periodic_multipliers(factors: FloatArray, *, max_sweeps: int = 300) -> PeriodicMultipliers:
    """Eigenvalues of factors[S-1] ... factors[0] as logarithms, each to high relative accuracy.

    Parameters
    ----------
    factors : (S, n, n), in the order in which they act
    max_sweeps : passes through the factors

    Raises
    ------
    ValueError : wrong shape, no factors, or an entry that is not finite

    Examples
    --------
    >>> factors = np.broadcast_to(np.diag([1.1, 1e-9]), (40, 2, 2))
    >>> periodic_multipliers(factors).logs.real / 40
    array([  0.09531018, -20.72326584])
    """
    F = np.asarray(factors, dtype=np.float64)
    if F.ndim != 3 or F.shape[1] != F.shape[2]:
        raise ValueError(f"factors: expected shape (S, n, n), got {F.shape}")
    if F.size == 0:
        raise ValueError(f"factors: expected at least one factor with one state, got shape {F.shape}")
    if not np.isfinite(F).all():
        raise ValueError("factors: every entry must be finite")
    grouped, sizes = _group(F)
    n = F.shape[-1]
    basis = _first_basis(grouped)
    sweeps, narrow = 0, False
    triangles, turn, bounds = grouped, np.eye(n), [0, n]
    while sweeps < max_sweeps and not narrow:
        triangles, basis, turn = _sweep(grouped, basis)
        sweeps += 1
        bounds = [0, *(i for i in range(1, n) if np.linalg.norm(turn[i:, :i]) < _CLOSED), n]
        logs = np.sum(np.log(np.abs(np.diagonal(triangles, axis1=1, axis2=2)) + 1e-300), axis=0)
        narrow = all(np.ptp(logs[a:b]) <= _SPREAD for a, b in itertools.pairwise(bounds))
    found = [_block_logs(triangles, turn, a, b) for a, b in itertools.pairwise(bounds)]
    error = _relative_error(triangles, sizes, found, bounds)
    joined = np.concatenate(found)
    order = np.argsort(-joined.real, kind="stable")
    return PeriodicMultipliers(joined[order], error[order], sweeps, narrow)


def _relative_error(
    triangles: FloatArray, sizes: FloatArray, found: list[ComplexArray], bounds: list[int]
) -> FloatArray:
    """Rounding of every multiplier: that of the groups against its diagonal entries, and the spread of its block.

    A group is known to eps times its size; a direction whose length it changes by r_k is known to eps size / r_k.
    """
    n = triangles.shape[-1]
    diagonal = np.maximum(np.abs(np.diagonal(triangles, axis1=1, axis2=2)), 1e-300)
    rounding = 4.0 * np.finfo(float).eps * np.sqrt(n)
    error = np.empty(n)
    for block, (a, b) in zip(found, itertools.pairwise(bounds), strict=True):
        smallest = np.min(diagonal[:, a:b], axis=1)
        spread = np.exp(np.minimum(np.max(block.real) - block.real, 700.0))
        error[a:b] = rounding * float(np.linalg.norm(sizes / smallest)) * spread
    return error


def _group(factors: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Neighbouring factors multiplied together while every product stays well conditioned: (groups, n, n).

    Beside each product stands a bound on its error over eps: F_2 F_1 inherits |F_2| e_1 + e_2 |F_1| and adds
    |F_2| |F_1|, so that a product that cancels is known to be less sure than its size says.
    """
    levels = [(factors, _norms(factors))]
    while len(levels[-1][0]) > 1:
        last, error = levels[-1]
        size, even = _norms(last), 2 * (len(last) // 2)
        early, late, rest = slice(0, even, 2), slice(1, even, 2), slice(even, None)
        joined = size[late] * size[early] + size[late] * error[early] + error[late] * size[early]
        levels.append((np.concatenate([last[late] @ last[early], last[rest]]), np.concatenate([joined, error[rest]])))
    return next((level for level in levels[:0:-1] if _well_conditioned(level[0])), levels[0])


def _norms(factors: FloatArray) -> FloatArray:
    """Upper bounds of the spectral norms: the root of the largest row sum times the largest column sum."""
    size = np.abs(factors)
    return np.asarray(np.sqrt(np.max(np.sum(size, axis=1), axis=1) * np.max(np.sum(size, axis=2), axis=1)))


def _well_conditioned(factors: FloatArray) -> bool:
    """Whether |F| |F^-1| (Frobenius, an upper bound of the condition) is small enough for every factor."""
    try:
        inverses = np.linalg.inv(factors)
    except np.linalg.LinAlgError:
        return False
    with np.errstate(over="ignore", invalid="ignore"):
        product = np.linalg.norm(factors, axis=(1, 2)) * np.linalg.norm(inverses, axis=(1, 2))
    return bool(np.all(product <= _GROUP))


def _first_basis(factors: FloatArray) -> FloatArray:
    """An orthogonal basis near the invariant one: the eigenvectors of the explicit product, largest multiplier first.

    The product knows nothing of multipliers far below the largest; the sweeps sort those out.
    """
    n = factors.shape[-1]
    product = np.eye(n)
    for factor in factors:
        product = factor @ product
        product = product / max(float(np.max(np.abs(product))), 1e-300)
    blur = 1e-12 * np.random.default_rng(20).standard_normal((n, n))  # nothing is left out by an exact zero
    values, vectors = np.linalg.eig(product)
    order = np.argsort(-np.abs(values), kind="stable")
    columns = np.where(values.imag < 0.0, vectors.imag, vectors.real)[:, order]
    return np.asarray(np.linalg.qr(columns + blur)[0])


def _sweep(factors: FloatArray, start: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """One pass: the triangles, the basis after the period, and that basis seen from the first one."""
    basis, triangles = start, np.zeros_like(factors)
    for factor, triangle in zip(factors, triangles, strict=True):
        packed, tau, _, _ = lapack.dgeqrf(factor @ basis)
        triangle[:] = np.triu(packed)
        basis = lapack.dorgqr(packed, tau)[0]
    return triangles, basis, start.T @ basis


def _block_logs(triangles: FloatArray, turn: FloatArray, a: int, b: int) -> ComplexArray:
    """Complex logarithms of the eigenvalues of one diagonal block of the product."""
    product, log_scale = np.eye(b - a), 0.0
    for triangle in triangles:
        product = triangle[a:b, a:b] @ product
        size = float(np.max(np.abs(product)))
        if size == 0.0:
            return np.full(b - a, -np.inf + 0j)
        product, log_scale = product / size, log_scale + float(np.log(size))
    eigenvalues = np.linalg.eigvals(turn[a:b, a:b] @ product).astype(complex)
    with np.errstate(divide="ignore"):
        return np.asarray(np.log(eigenvalues) + log_scale)
