"""Stability proved by Lyapunov inertia: the second method beside eigenvalues.

If A^T P + P A is negative definite, then A has as many eigenvalues in the right half plane as P has negative ones
(Ostrowski & Schneider, J. Math. Anal. Appl. 4 (1962) 72). How P was found does not matter: the inequality is checked
afterwards with its rounding error, so a wrong P can only fail to certify. Two guesses for P are tried: the solution
of a Lyapunov equation, then P built on a modal basis, which is stronger for light damping.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy.linalg

from maglev_ctrl.arrays import ComplexArray, FloatArray
from maglev_ctrl.kernels import balance, rescale

ROUNDOFF = float(np.finfo(np.float64).eps)


@dataclass(frozen=True, eq=False, slots=True)
class InertiaCertificate:
    """How many eigenvalues lie right and left of Re s = `shift`, and whether that is proved.

    `margin`: smallest eigenvalue of -(A^T P + P A) over its rounding error (a proof needs more than 1).
    """

    right: int
    left: int
    shift: float
    certified: bool
    method: Literal["Lyapunov equation", "modal basis", "none"]
    margin: float


def lyapunov_inertia(A: FloatArray, *, shift: float = 0.0) -> InertiaCertificate:
    """Number of eigenvalues of A on each side of the line Re s = shift, with a proof where one is found.

    Parameters
    ----------
    A : (nx, nx) 1/s
    shift : 1/s

    Raises
    ------
    ValueError : A is not one square matrix of finite numbers

    Examples
    --------
    >>> lyapunov_inertia(np.array([[0.0, 1.0], [-4.0, -0.4]])).right
    0
    >>> lyapunov_inertia(np.array([[0.0, 1.0], [4.0, -0.4]])).right
    1
    """
    A = np.asarray(A, dtype=np.float64)
    if A.ndim != 2 or A.shape[0] != A.shape[1] or not A.size or not np.all(np.isfinite(A)):
        raise ValueError(f"A: expected one square matrix of finite numbers, got shape {A.shape}")
    # The shift comes after balancing: a similarity by powers of two is exact, a shift before it is not.
    balanced = rescale(A, balance(A))
    shifted = balanced - shift * np.eye(len(A))
    first = _by_equation(shifted, shift)
    if first.certified:
        return first
    second = _by_modal_basis(shifted, shift)
    return second if second.certified else first


def _by_equation(A: FloatArray, shift: float) -> InertiaCertificate:
    n = len(A)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            P = scipy.linalg.solve_continuous_lyapunov(A.T, -np.eye(n))
    except (RuntimeWarning, np.linalg.LinAlgError, ValueError):
        return _none(n, shift)
    P = np.asarray((P + P.T) / 2.0)
    if not np.all(np.isfinite(P)):
        return _none(n, shift)
    product = P @ A
    decrease = np.linalg.eigvalsh(-(product + product.T))
    rounding = 3.0 * n * ROUNDOFF * float(np.linalg.norm(P)) * float(np.linalg.norm(A))
    values = np.linalg.eigvalsh(P)
    resolved = float(np.min(np.abs(values))) > 4.0 * n * ROUNDOFF * float(np.max(np.abs(values)))
    margin = float(decrease[0]) / rounding if rounding > 0.0 else 0.0
    right = int(np.sum(values < 0.0))
    return InertiaCertificate(right, n - right, shift, margin > 1.0 and resolved, "Lyapunov equation", margin)


def _by_modal_basis(A: FloatArray, shift: float) -> InertiaCertificate:
    n = len(A)
    basis, signs = _real_modal_basis(A)
    try:
        inverse = np.linalg.inv(basis)
    except np.linalg.LinAlgError:
        return _none(n, shift)
    if not np.all(np.isfinite(inverse)) or np.any(signs == 0.0):
        return _none(n, shift)
    weighted = -signs[:, None] * np.linalg.solve(basis, A @ basis)
    symmetric = weighted + weighted.T
    error = 3.0 * n * ROUNDOFF * (np.abs(inverse) @ np.abs(basis)) @ (np.abs(inverse) @ (np.abs(A) @ np.abs(basis)))
    error = error + error.T
    radius = np.sum(np.abs(symmetric), axis=1) - np.abs(np.diagonal(symmetric)) + np.sum(error, axis=1)
    reach = -np.diagonal(symmetric)
    margin = float(np.min(reach / np.maximum(radius, np.finfo(float).tiny)))
    right = int(np.sum(signs > 0.0))
    return InertiaCertificate(right, n - right, shift, margin > 1.0, "modal basis", margin)


def _real_modal_basis(A: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Columns (Re x, Im x) per pair and x per real eigenvalue; sign of Re s per column."""
    s, vectors = scipy.linalg.eig(A)
    columns: list[FloatArray] = []
    signs: list[float] = []
    for value, vector in zip(s, _columns(vectors), strict=True):
        if value.imag < 0.0:
            continue
        parts = [vector.real] if value.imag == 0.0 else [vector.real, vector.imag]
        columns.extend(parts)
        signs.extend([float(np.sign(value.real))] * len(parts))
    return np.stack(columns, axis=1), np.array(signs)


def _columns(matrix: ComplexArray) -> list[ComplexArray]:
    return [matrix[:, i] for i in range(matrix.shape[1])]


def _none(n: int, shift: float) -> InertiaCertificate:
    return InertiaCertificate(0, n, shift, False, "none", 0.0)
