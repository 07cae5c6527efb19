"""Who makes a mode grow: the exact split of its growth rate over the elements of the vehicle (Eq. 14 of the paper).

An eigenpair s = lambda + i w, shape a, satisfies sum over elements of (s^2 M_e + s C_e + K_e) a - F_e xi = 0. The
imaginary part of a^H times it reads

    lambda (2 w a^H M_1 a + Im a^H C_2 a)
        = - sum over e of [ w a^H C_1e a + a^H Im(Z_e)_1 a                              damping share
                          + Im a^H K_2e a + (lambda^2 - w^2) Im a^H M_2e a + Im a^H Re(Z_e)_2 a ]   circulatory share

with 1 and 2 the symmetric and antisymmetric parts and Z_e(s) a = -F_e xi the dynamic stiffness of an element with
internal states (a damper's lag, an actuator with its controller). No approximation is made.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from maglev_ctrl.arrays import ComplexArray, FloatArray, read_only_any, transpose
from maglev_ctrl.display import Shown
from maglev_ctrl.errors import ModelError
from maglev_ctrl.systems import SecondOrderSystem

RESOLVED = 1e-10  # shares are given only where rounding leaves the sum this accurate relative to |s|
ROUNDOFF = float(np.finfo(np.float64).eps)


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class Ledger(Shown):
    """Growth rate of each mode, element by element: growth = sum over elements of damping + circulatory.

    `damping`, `circulatory` (e, m) and `growth` (m,) in 1/s; `residual` (m,) = growth minus the sum of the shares,
    1/s. Shares are NaN where the split is undefined: real s (divergence, overdamped), a shape that carries no action
    (purely gyroscopic flutter: no element does net work), a mode of internal states alone. `stiffness_share` (e, m)
    = Re a^H (K_e a - F_e xi), the generalised stiffness per element for the shape with largest entry 1 (N/m or
    N m/rad); its negative entries are what drives a divergence.
    """

    _told: ClassVar = ("elements", "growth")

    elements: tuple[str, ...]
    damping: FloatArray
    circulatory: FloatArray
    growth: FloatArray
    residual: FloatArray
    stiffness_share: FloatArray

    def ranked(self, mode: int) -> tuple[tuple[str, float, float], ...]:
        """(element, damping share, circulatory share) of one mode, largest effect first; empty where undefined."""
        if np.isnan(self.damping[:, mode]).any():
            return ()
        size = -np.abs(self.damping[:, mode] + self.circulatory[:, mode])
        return tuple(
            (self.elements[e], float(self.damping[e, mode]), float(self.circulatory[e, mode]))
            for e in np.argsort(size, kind="stable")
        )


def energy_ledger(
    system: SecondOrderSystem, s: ComplexArray, shapes: ComplexArray, internal: ComplexArray, *, error: FloatArray
) -> Ledger:
    """The split for eigenpairs of one system.

    Parameters
    ----------
    s : (m,) 1/s, Im s >= 0
    shapes : (n, m) displacement shapes
    internal : (n_xi, m) internal states that go with them
    error : (m,) 1/s, bound on each eigenvalue: a frequency below it is not resolved, so the mode counts as real

    Raises
    ------
    ModelError : the contributions do not add up to the system's matrices

    Examples
    --------
    >>> one = SecondOrderSystem.from_matrices([[1.0]], [[0.2]], [[4.0]])
    >>> s = np.array([-0.1 + 3.99**0.5 * 1j])
    >>> ledger = energy_ledger(one, s, np.ones((1, 1)) + 0j, np.zeros((0, 1)) + 0j, error=np.zeros(1))
    >>> ledger.damping.tolist(), ledger.circulatory.tolist()
    ([[-0.1]], [[-0.0]])
    """
    M, C, K, F = _stacked_shares(system)
    lam, w = s.real, s.imag
    mass, damper, spring = (_quadratic(matrices, shapes) for matrices in (M, C, K))
    force = np.sum(shapes.conj() * (F @ internal), axis=-2)
    turning = _circulation(F, _internal_response(system, s), shapes)
    stiffness = (spring - force).real
    circulatory = spring.imag + (lam**2 - w**2) * mass.imag + turning
    damping = w * damper.real - force.imag - turning
    size = np.sum(np.abs(spring) + np.abs(s) ** 2 * np.abs(mass) + np.abs(s * damper) + np.abs(force), axis=0)
    mass, damper = _quadratic(system.M, shapes), _quadratic(system.C, shapes)
    action = 2.0 * w * mass.real + damper.imag
    with np.errstate(divide="ignore", invalid="ignore"):
        uncertainty = (4.0 * ROUNDOFF * size + error * (np.abs(2.0 * s * mass) + np.abs(damper))) / np.abs(action)
        defined = (w > error) & (uncertainty <= np.maximum(RESOLVED * np.abs(s), 10.0 * error))
        damping = np.where(defined, -damping / action, np.nan)
        circulatory = np.where(defined, -circulatory / action, np.nan)
    residual = lam - np.sum(damping + circulatory, axis=0)
    return Ledger(
        tuple(share.name for share in system.contributions),
        *(read_only_any(a) for a in (damping, circulatory, lam, residual, stiffness)),
    )


def _stacked_shares(system: SecondOrderSystem) -> list[FloatArray]:
    """M, C, K, F of every contribution, (e, n, *) each; ModelError unless they add up to the system's own."""
    stacked = []
    for key in ("M", "C", "K", "F"):
        total = getattr(system, key)
        parts = np.array([getattr(share, key) for share in system.contributions])
        missing = np.abs(total - parts.sum(axis=0))
        if (missing > 1e-9 * (np.abs(total) + np.abs(parts).sum(axis=0))).any():
            raise ModelError(f"contributions: they do not add up to {key}; largest difference {np.max(missing):.3g}")
        stacked.append(parts)
    return stacked


def _quadratic(matrices: FloatArray, shapes: ComplexArray) -> ComplexArray:
    """a^H A a for every matrix and every shape; (..., m)."""
    return np.asarray(np.sum(shapes.conj() * (matrices @ shapes), axis=-2), dtype=np.complex128)


def _internal_response(system: SecondOrderSystem, s: ComplexArray) -> ComplexArray | None:
    """T(s) with xi = T(s) a; (m, n_xi, n). None without internal states."""
    n_xi = len(system.internal)
    if n_xi == 0:
        return None
    at = s[:, None, None]
    drive = system.G_q + at * system.G_v + at**2 * system.G_a
    resolvent = at * np.eye(n_xi) - system.A_internal
    try:
        return np.asarray(np.linalg.solve(resolvent, drive))
    except np.linalg.LinAlgError:
        # A mode of the internal states alone meets its own pole; it has no displacement, so zero is as good as any.
        regular = np.abs(np.linalg.det(resolvent)) > 0.0
        response = np.zeros(drive.shape, dtype=np.complex128)
        response[regular] = np.linalg.solve(resolvent[regular], drive[regular])
        return response


def _circulation(F: FloatArray, response: ComplexArray | None, shapes: ComplexArray) -> FloatArray:
    """Im a^H Re(Z_e)_2 a of elements with internal states, Z_e = -F_e T; (e, m)."""
    circulation = np.zeros((F.shape[0], shapes.shape[-1]))
    acting = np.flatnonzero(np.any(F != 0.0, axis=(-2, -1)))
    if response is not None and len(acting):
        real = -(F[acting, None] @ response).real
        antisymmetric = (real - transpose(real)) / 2.0
        circulation[acting] = np.einsum("im,emij,jm->em", shapes.conj(), antisymmetric, shapes).imag
    return circulation
