"""Pole measures with exact gradients: growth rate and damping ratio of the worst pole."""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

import numpy as np
from scipy.linalg import eig

from maglev_ctrl.arrays import ComplexArray, FloatArray
from maglev_ctrl.synthesis.structured.loop import Closed


@dataclass(frozen=True, eq=False, slots=True)
class Piece:
    """One smooth piece of a maximum: its value and its derivatives by the entries of K."""

    value: float
    gradient: FloatArray


def growth_rates(poles: ComplexArray, dt: float | None) -> FloatArray:
    """Growth rate (1/s) of every pole: Re s, or log|z| / dt of a sampled loop."""
    if dt is None:
        return np.asarray(poles.real)
    return np.asarray(np.log(np.maximum(np.abs(poles), 1e-300)) / dt)


def abscissa(A: FloatArray, dt: float | None) -> float:
    """Largest growth rate (1/s): negative where the loop is stable.

    Examples
    --------
    >>> abscissa(np.array([[-2.0]]), None)
    -2.0
    """
    return float(np.max(growth_rates(np.linalg.eigvals(A).astype(complex), dt), initial=-np.inf))


def growth_pieces(loop: Closed, *, closeness: float = 0.0) -> list[Piece]:
    """Growth rates of the poles within `closeness` (1/s) of the worst, worst first.

    dRe(s) = Re(w^H dA v) / (w^H v) with right and left eigenvectors v, w.
    """
    poles, left, right = eigenvectors(loop.A)
    return _pieces(loop, growth_rates(poles, loop.dt), poles, left, right, closeness, ratio=False)


def damping_pieces(loop: Closed, *, closeness: float = 0.0) -> list[Piece]:
    """Minus the damping ratio, -zeta = Re(s) / |s|, of the poles within `closeness` of the worst, worst first.

    A sampled pole z counts as s = log(z) / dt.
    """
    poles, left, right = eigenvectors(loop.A)
    s = poles if loop.dt is None else np.log(np.where(poles == 0.0, 1e-300, poles)) / loop.dt
    return _pieces(loop, s.real / np.maximum(np.abs(s), 1e-300), poles, left, right, closeness, ratio=True)


def eigenvectors(A: FloatArray) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
    """Eigenvalues, left and right eigenvectors (columns)."""
    return cast(tuple[ComplexArray, ComplexArray, ComplexArray], eig(A, left=True, right=True))


def _pieces(
    loop: Closed,
    values: FloatArray,
    poles: ComplexArray,
    left: ComplexArray,
    right: ComplexArray,
    closeness: float,
    *,
    ratio: bool,
) -> list[Piece]:
    found: list[Piece] = []
    top = float(np.max(values))
    for k in (int(i) for i in np.argsort(-values)):
        if values[k] < top - closeness or (found and closeness == 0.0):
            break
        if poles[k].imag < 0.0:
            continue
        overlap = complex(np.vdot(left[:, k], right[:, k]))
        if abs(overlap) < 1e-14:
            overlap = 1e-14
        turn = 1.0 + 0j  # ds / d(pole)
        s = complex(poles[k])
        if loop.dt is not None:
            s = complex(np.log(poles[k] if poles[k] != 0.0 else 1e-300))
            turn = 1.0 / (loop.dt * complex(np.exp(s)))
            s /= loop.dt
        if ratio:
            # d(Re s / |s|) = Im(s) / |s|^3 (Im(s) dRe - Re(s) dIm)
            size = max(abs(s), 1e-300)
            turn *= s.imag / size * (s.imag / size + 1j * s.real / size) / size
        inner = turn * np.outer(np.conj(left[:, k]), right[:, k]) / overlap
        found.append(Piece(float(values[k]), loop.gain_gradient(inner.real)))
    return found
