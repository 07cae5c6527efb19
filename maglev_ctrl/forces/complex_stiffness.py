"""Measured complex stiffness over frequency: force on the vehicle per unit displacement, with its errors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from maglev_ctrl.arrays import ComplexArray, FloatArray, read_only

_SAME_FREQUENCY = 1e-3  # relative; closer ones cannot tell k from -m w^2


def response_from_polar(
    amplitude: ArrayLike,
    phase: ArrayLike,
    *,
    amplitude_error: ArrayLike | None = None,
    phase_error: ArrayLike | None = None,
) -> tuple[ComplexArray, FloatArray | None]:
    """Q = a exp(i psi) and the covariance (N, 2, 2) of its real and imaginary part, None without errors.

    Parameters
    ----------
    amplitude : (N,) force per unit displacement a, N/m, not negative
    phase : (N,) lead psi of the force over the displacement, rad
    amplitude_error, phase_error : (N,) independent standard errors, both or neither

    Raises
    ------
    ValueError : a negative amplitude, an error that is not positive, one error without the other

    Examples
    --------
    >>> q, spread = response_from_polar([2.0], [0.0], amplitude_error=[0.1], phase_error=[0.01])
    >>> complex(q[0]), np.round(np.diag(spread[0]), 6).tolist()
    ((2+0j), [0.01, 0.0004])
    """
    a = read_only(amplitude, name="amplitude", shape=(None,))
    psi = read_only(phase, name="phase", shape=a.shape)
    if np.any(a < 0.0):
        raise ValueError(f"amplitude: expected a value that is not negative, got {np.min(a):.6g}")
    q = a * np.exp(1j * psi)
    if amplitude_error is None and phase_error is None:
        return q, None
    if amplitude_error is None or phase_error is None:
        raise ValueError("amplitude_error, phase_error: expected both or neither")
    along = read_only(amplitude_error, name="amplitude_error", shape=a.shape)
    across = a * read_only(phase_error, name="phase_error", shape=a.shape)
    if np.any(along <= 0.0) or np.any(across <= 0.0):
        raise ValueError("amplitude_error, phase_error: expected errors above zero, and no amplitude of zero with them")
    turn = np.stack([np.stack([np.cos(psi), -np.sin(psi)], -1), np.stack([np.sin(psi), np.cos(psi)], -1)], axis=-2)
    # one error a million times the other would be lost to rounding, and with it the covariance's inverse
    size = np.maximum(np.stack([along, across], axis=-1), 1e-6 * np.maximum(along, across)[:, None]) ** 2
    return q, np.einsum("nij,nj,nkj->nik", turn, size, turn)


@dataclass(frozen=True, eq=False, slots=True)
class ComplexStiffness:
    """Measured force per unit displacement Q (N,) over frequency w (N,), ascending, and the static stiffness or NaN."""

    w: FloatArray
    q: ComplexArray
    covariance: FloatArray | None
    degrees: float
    static: float  # NaN = none
    static_error: float  # NaN = not given

    @classmethod
    def checked(
        cls, frequency: ArrayLike, response: ArrayLike, covariance: ArrayLike | None, degrees: float,
        static: float | None, static_error: float | None,
    ) -> ComplexStiffness:  # fmt: skip
        """Checked input of `identify_constants`.

        Raises
        ------
        ValueError : see there
        """
        w = read_only(frequency, name="frequency", shape=(None,))
        q = np.array(response, dtype=np.complex128)
        if w.size == 0 or q.shape != w.shape:
            raise ValueError(f"response: expected one per frequency ({w.size}, at least one), got shape {q.shape}")
        if np.any(w <= 0.0):
            raise ValueError(f"frequency: expected a positive frequency in rad/s, got {np.min(w):.6g}")
        if not np.isfinite(q).all():
            raise ValueError("response: every entry must be finite")
        order = np.argsort(w, kind="stable")
        spread = None
        if covariance is not None:
            spread = read_only(covariance, name="covariance", shape=(w.size, 2, 2))[order]
            if np.any(np.linalg.eigvalsh(spread)[:, 0] <= 0.0):
                raise ValueError("covariance: expected positive definite matrices")
        if static is not None and not np.isfinite(static):
            raise ValueError(f"static_stiffness: expected a finite number, got {static}")
        if static_error is not None and not (static_error > 0.0 and static is not None):
            raise ValueError("static_error: expected an error above zero, beside a static stiffness")
        if spread is not None and static is not None and static_error is None:
            raise ValueError("static_error: expected one, as the other points have errors too")
        return cls(
            w[order], q[order], spread, degrees, np.nan if static is None else float(static),
            np.nan if static_error is None else float(static_error),
        )  # fmt: skip

    @property
    def has_static(self) -> bool:
        """Whether a static stiffness was measured."""
        return not np.isnan(self.static)

    @property
    def distinct(self) -> int:
        """Frequencies that differ enough to count."""
        return 1 + int(np.sum(np.diff(self.w) > _SAME_FREQUENCY * self.w[1:]))

    @property
    def values(self) -> FloatArray:
        """Real and imaginary parts (2 N,), then the static stiffness."""
        parts = np.stack([self.q.real, self.q.imag], axis=-1).ravel()
        return np.append(parts, self.static) if self.has_static else parts

    def whitener(self) -> FloatArray:
        """Matrix that turns `values` into independent ones of unit error; needs a covariance."""
        assert self.covariance is not None
        rows = self.values.size
        out = np.zeros((rows, rows))
        for place, block in enumerate(self.covariance):
            out[2 * place : 2 * place + 2, 2 * place : 2 * place + 2] = np.linalg.inv(np.linalg.cholesky(block))
        if self.has_static:
            out[-1, -1] = 1.0 / self.static_error
        return out
