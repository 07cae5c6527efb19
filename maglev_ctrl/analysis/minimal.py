"""The part of a system that its inputs move and its outputs see, by orthogonal staircases."""

from __future__ import annotations

import numpy as np

from maglev_ctrl.arrays import FloatArray

HIDDEN = 1e-11
"""Directions weaker than this share of the balanced system's size count as zero."""


def minimal_part(A: FloatArray, B: FloatArray, C: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Controllable and observable part of a balanced realisation, in orthonormal coordinates of its subspace.

    Examples
    --------
    >>> A, B, C = np.diag([-1.0, 0.0]), np.array([[1.0], [0.0]]), np.array([[1.0, 1.0]])
    >>> minimal_part(A, B, C)[0].shape
    (1, 1)
    """
    reach = reachable_basis(A, B)
    A, B, C = reach.T @ A @ reach, reach.T @ B, C @ reach
    seen = reachable_basis(A.T, C.T)
    return seen.T @ A @ seen, seen.T @ B, C @ seen


def linked_states(A: FloatArray, B: FloatArray, C: FloatArray) -> int:
    """How many states inputs reach and outputs see through entries that are not zero: no more can matter.

    Examples
    --------
    >>> linked_states(np.diag([-1.0, 0.0]), np.array([[1.0], [0.0]]), np.array([[1.0, 1.0]]))
    1
    """
    links, moved, seen = A != 0.0, np.any(B != 0.0, axis=1), np.any(C != 0.0, axis=0)
    for _ in range(len(A)):
        moved, seen = moved | np.any(links & moved, axis=1), seen | np.any(links & seen[:, None], axis=0)
    return int(np.sum(moved & seen))


def reachable_basis(A: FloatArray, B: FloatArray) -> FloatArray:
    """Orthonormal basis (n, k) of the smallest A-invariant subspace that holds the columns of B, by a staircase.

    Examples
    --------
    >>> reachable_basis(np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[1.0], [0.0]])).shape
    (2, 1)
    """
    n = A.shape[0]
    basis: FloatArray = np.zeros((n, 0))
    fresh, size = B, float(np.linalg.norm(B, 2)) if B.size else 0.0
    weight = float(np.linalg.norm(A, 2)) if A.size else 0.0
    while basis.shape[1] < n and fresh.size:
        for _ in range(2):
            fresh = fresh - basis @ (basis.T @ fresh)
        left, strength, _ = np.linalg.svd(fresh, full_matrices=False)
        new = left[:, strength > HIDDEN * size]
        if not new.shape[1]:
            break
        basis = np.linalg.qr(np.hstack([basis, new]))[0]
        fresh, size = A @ basis[:, -new.shape[1] :], weight
    return basis
