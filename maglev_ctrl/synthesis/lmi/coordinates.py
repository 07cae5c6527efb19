"""Coordinates in which the best Lyapunov matrix is near the identity, and signals without what repeats itself.

With P of a quadratic regulator and T' P T = I, the certificate of that regulator is the identity. Norms are those of
z'z and of w'w: any orthogonal combination of the outputs, or of the disturbances, of one vertex has the same, so that
outputs which repeat each other are replaced by as many as are independent.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
from scipy.linalg import LinAlgError, cholesky, solve_continuous_are, solve_triangular

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.synthesis.lmi.scaling import ScaledVertex

Norm = Literal["h2", "h_infinity"]
LIFT, PRICE = 1e-4, 1e-6
"""Shares of state and command weight added, so that what no output sees has a size as well."""
LIGHT = 1e-2
"""Weight of the scaled states where no norm gives one."""
RANK = 1e-13
"""Singular values of signals below this share of the largest are rounding."""


def regulator_basis(
    vertices: Sequence[ScaledVertex], norms: Sequence[Norm] = ("h2",), *, shift: float = 0.0, gamma: float | None = None
) -> FloatArray:  # fmt: skip
    """T (n, n) with T' P T = I, P of the regulator of the mean vertex and the outputs of the norms; else the identity.

    With a `shift` (scaled) the regulator is that of A + shift I: its loop decays faster than `shift`, and the identity
    is a certificate of that (Anderson & Moore 1990, section 3.5). Without norms all states and commands count alike.
    With `gamma` (scaled) it is the H-infinity regulator of that bound, where there is one.

    Examples
    --------
    >>> one = np.ones((1, 1))
    >>> outputs = (one, np.array([[2.0], [0.0]]), np.array([[0.0], [1.0]]))
    >>> vertex = ScaledVertex(0.0 * one, one, outputs, (*outputs, np.zeros((2, 1))))
    >>> regulator_basis([vertex]).round(3)  # P = 2
    array([[0.707]])
    """
    n, m = vertices[0].B.shape
    A, B = (np.mean([getattr(one, key) for one in vertices], axis=0) for key in ("A", "B"))
    A = A + shift * np.eye(n)
    if not norms:
        return _basis(A, B, LIGHT * np.eye(n), np.eye(m), np.zeros((n, m)))
    C, D = (np.vstack([np.mean([getattr(one, key)[k] for one in vertices], axis=0) for key in norms]) for k in (1, 2))
    weight = C.T @ C + LIFT * max(float(np.linalg.norm(C, 2)) ** 2, 1e-12) * np.eye(n)
    price = D.T @ D + PRICE * max(float(np.linalg.norm(D, 2)) ** 2, PRICE) * np.eye(B.shape[1])
    if gamma is not None and "h_infinity" in norms:
        # Both channels as one, that of the bound divided by it; alike they give the regulator of either.
        shares = [np.sqrt((1.0 if key == "h2" else 1.0 / gamma) / len(norms)) for key in norms]
        parts = [[np.mean([getattr(v, key)[k] for v in vertices], axis=0) for key in norms] for k in (1, 2)]
        C_g, D_g = (np.vstack([s * one for s, one in zip(shares, part, strict=True)]) for part in parts)
        entry = np.mean([v.h_infinity[0] for v in vertices], axis=0)
        inputs, q = np.hstack([B, entry]), entry.shape[1]
        blocks = np.zeros((m + q, m + q))
        blocks[:m, :m] = D_g.T @ D_g + PRICE * max(float(np.linalg.norm(D_g, 2)) ** 2, PRICE) * np.eye(m)
        blocks[m:, m:] = -gamma * np.eye(q)
        weight_2 = C_g.T @ C_g + LIFT * max(float(np.linalg.norm(C_g, 2)) ** 2, 1e-12) * np.eye(n)
        found = _basis(A, inputs, weight_2, blocks, np.hstack([C_g.T @ D_g, np.zeros((n, q))]))
        if not np.array_equal(found, np.eye(n)):
            return found
    return _basis(A, B, weight, price, C.T @ D)


def _basis(A: FloatArray, B: FloatArray, weight: FloatArray, price: FloatArray, cross: FloatArray) -> FloatArray:
    n = A.shape[0]
    try:
        P = solve_continuous_are(A, B, weight, price, s=cross)
        root = cholesky(0.5 * (P + P.T))
        return np.asarray(solve_triangular(root, np.eye(n)), dtype=np.float64)
    except (LinAlgError, ValueError):
        return np.eye(n)


def in_basis(vertex: ScaledVertex, basis: FloatArray) -> ScaledVertex:
    """The vertex for x = basis @ x_new.

    Examples
    --------
    >>> one = np.ones((1, 1))
    >>> vertex = ScaledVertex(one, one, (one, one, one), (one, one, one, one))
    >>> in_basis(vertex, 2.0 * one).B.item()
    0.5
    """
    two, infinity = vertex.h2, vertex.h_infinity
    A, B, B_2, B_infinity = (
        np.asarray(np.linalg.solve(basis, right), dtype=np.float64)
        for right in (vertex.A @ basis, vertex.B, two[0], infinity[0])
    )
    return ScaledVertex(
        A, B, (B_2, two[1] @ basis, two[2]), (B_infinity, infinity[1] @ basis, infinity[2], infinity[3])
    )


def compressed(vertices: Sequence[ScaledVertex]) -> tuple[ScaledVertex, ...]:
    """The vertices with as few outputs and disturbances as have the same norms, of one number for all vertices.

    Examples
    --------
    >>> one, two = np.ones((1, 1)), np.ones((2, 1))
    >>> vertex = ScaledVertex(one, one, (one, two, two), (one, two, two, 0.0 * two))
    >>> compressed([vertex])[0].h2[1].shape
    (1, 1)
    """
    n = vertices[0].A.shape[0]
    m = vertices[0].B.shape[1]
    energy_rows = _fewest([np.hstack(one.h2[1:]) for one in vertices])
    energy_columns = _fewest([one.h2[0].T for one in vertices])
    rows = _fewest([np.hstack(one.h_infinity[1:]) for one in vertices])
    turned = [
        replace(one, h_infinity=(one.h_infinity[0], row[:, :n], row[:, n : n + m], row[:, n + m :]))
        for one, row in zip(vertices, rows, strict=True)
    ]
    columns = _fewest([np.hstack([one.h_infinity[0].T, one.h_infinity[3].T]) for one in turned])
    return tuple(
        replace(
            one, h2=(B.T, row[:, :n], row[:, n:]),
            h_infinity=(column[:, :n].T, one.h_infinity[1], one.h_infinity[2], column[:, n:].T),
        )
        for one, row, B, column in zip(turned, energy_rows, energy_columns, columns, strict=True)
    )  # fmt: skip


def distinct(vertices: Sequence[ScaledVertex]) -> tuple[int, ...]:
    """Indices of the vertices without exact copies of earlier ones.

    Examples
    --------
    >>> one = np.ones((1, 1))
    >>> vertex = ScaledVertex(one, one, (one, one, one), (one, one, one, one))
    >>> distinct([vertex, vertex])
    (0,)
    """
    found: dict[bytes, int] = {}
    for i, one in enumerate(vertices):
        found.setdefault(b"".join(x.tobytes() for x in (one.A, one.B, *one.h2, *one.h_infinity)), i)
    return tuple(found.values())


def _fewest(matrices: Sequence[FloatArray]) -> list[FloatArray]:
    """Matrices N with N'N = M'M and the fewest rows, the same number for all (zero rows make up for a lower rank)."""
    if not all(one.size for one in matrices):
        return list(matrices)
    parts = [np.linalg.svd(one, full_matrices=False)[1:] for one in matrices]
    count = max(1, *(int(np.sum(s > RANK * s[0])) for s, _ in parts))
    if count >= len(matrices[0]):
        return list(matrices)
    return [np.asarray(s[:count, None] * rows[:count], dtype=np.float64) for s, rows in parts]
