"""Multipliers of a product of matrices without forming the product: periodic orthogonal iteration.

The product of many propagators loses every multiplier that is small against the largest one. Here an orthogonal basis
is carried through the factors, Q_k R_k = F_k Q_(k-1), until the basis repeats after a period; the logarithms of the
diagonal of R add up. Multipliers of like modulus (complex pairs among them) stay together in a small block.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from maglev_ctrl.arrays import ComplexArray, FloatArray

_GROUP = np.log(1e3)  # factors are multiplied together while the product is conditioned better than this
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
    ValueError : wrong shape

    Examples
    --------
    >>> factors = np.broadcast_to(np.diag([1.1, 1e-9]), (40, 2, 2))
    >>> periodic_multipliers(factors).logs.real / 40
    array([  0.09531018, -20.72326584])
    """
    F = np.asarray(factors, dtype=np.float64)
    if F.ndim != 3 or F.shape[1] != F.shape[2]:
        raise ValueError(f"factors: expected shape (S, n, n), got {F.shape}")
    grouped = _group(F)
    n = F.shape[-1]
    basis = np.linalg.qr(np.random.default_rng(20).standard_normal((n, n)))[0]
    sweeps, narrow = 0, False
    triangles, turn, bounds = [np.eye(n)], np.eye(n), [0, n]
    while sweeps < max_sweeps and not narrow:
        triangles, basis, turn = _sweep(grouped, basis)
        sweeps += 1
        bounds = [0, *(i for i in range(1, n) if np.linalg.norm(turn[i:, :i]) < _CLOSED), n]
        logs = np.sum([np.log(np.abs(np.diag(R)) + 1e-300) for R in triangles], axis=0)
        narrow = sweeps > 1 and all(np.ptp(logs[a:b]) <= _SPREAD for a, b in itertools.pairwise(bounds))
    found: list[ComplexArray] = []
    errors: list[FloatArray] = []
    rounding = 4.0 * np.finfo(float).eps * np.sqrt(len(F)) * n
    for a, b in itertools.pairwise(bounds):
        block = _block_logs(triangles, turn, a, b)
        found.append(block)
        errors.append(rounding * np.exp(np.minimum(np.max(block.real) - block.real, 700.0)) * np.exp(_GROUP / 3.0))
    joined = np.concatenate(found)
    order = np.argsort(-joined.real, kind="stable")
    return PeriodicMultipliers(joined[order], np.concatenate(errors)[order], sweeps, narrow)


def _group(factors: FloatArray) -> list[FloatArray]:
    """Neighbouring factors multiplied together while the product stays well conditioned."""
    singular = np.linalg.svd(factors, compute_uv=False)
    spread = np.log(singular[:, 0]) - np.log(np.maximum(singular[:, -1], 1e-300))
    groups: list[FloatArray] = []
    held, budget = None, 0.0
    for factor, cost in zip(factors, spread, strict=True):
        if held is None or budget + cost > _GROUP:
            if held is not None:
                groups.append(held)
            held, budget = factor, float(cost)
        else:
            held, budget = factor @ held, budget + float(cost)
    return [*groups, held] if held is not None else groups


def _sweep(factors: list[FloatArray], start: FloatArray) -> tuple[list[FloatArray], FloatArray, FloatArray]:
    """One pass: the triangles, the basis after the period, and that basis seen from the first one."""
    basis, triangles = start, []
    for factor in factors:
        basis, triangle = np.linalg.qr(factor @ basis)
        triangles.append(triangle)
    return triangles, basis, start.T @ basis


def _block_logs(triangles: list[FloatArray], turn: FloatArray, a: int, b: int) -> ComplexArray:
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
