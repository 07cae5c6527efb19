"""Motion-dependent coefficients from a forced oscillation (Eqs. 6-9)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from maglev_ctrl.arrays import FloatArray, read_only


@dataclass(frozen=True, eq=False, slots=True)
class OscillationCoefficients:
    """Magnetic mass m (kg) and damping c (N s/m) as force derivatives: force = m u'' + c u' + k u ON the vehicle.

    c > 0 feeds energy in. `CoefficientTable.from_force_derivatives` turns the sign to the left-hand side.
    `mass_error` and `damping_error` are standard errors, first order.
    """

    mass: FloatArray
    damping: FloatArray
    mass_error: FloatArray
    damping_error: FloatArray


def coefficients_from_oscillation(
    amplitude: ArrayLike,
    phase: ArrayLike,
    *,
    frequency: ArrayLike,
    stiffness: ArrayLike,
    amplitude_error: ArrayLike = 0.0,
    phase_error: ArrayLike = 0.0,
    stiffness_error: ArrayLike = 0.0,
) -> OscillationCoefficients:
    """c = a sin(psi) / W and m = (k - a cos(psi)) / W^2, Eq. 9.

    One frequency cannot tell a magnetic mass from a stiffness that changes with frequency: m absorbs both, and k must
    be measured at the same speed.

    Parameters
    ----------
    amplitude : (...) force amplitude per unit displacement a, N/m, not negative
    phase : (...) lead psi of the force over the displacement, rad
    frequency : (...) W of the oscillation, rad/s
    stiffness : (...) k = dF/du of the steady force at the same speed, N/m
    amplitude_error, phase_error, stiffness_error : (...) standard errors, independent of one another

    Raises
    ------
    ValueError : a frequency that is not positive, a negative amplitude or error

    Examples
    --------
    >>> import math
    >>> found = coefficients_from_oscillation(100.0, math.pi, frequency=10.0, stiffness=-120.0)
    >>> round(float(found.mass), 12), round(abs(float(found.damping)), 12)
    (-0.2, 0.0)
    """
    a = _not_negative(amplitude, name="amplitude")
    psi = read_only(phase, name="phase")
    w = read_only(frequency, name="frequency")
    k = read_only(stiffness, name="stiffness")
    if np.any(w <= 0.0):
        raise ValueError(f"frequency: expected a positive frequency in rad/s, got {np.min(w):.6g}")
    error_a = _not_negative(amplitude_error, name="amplitude_error")
    error_psi = _not_negative(phase_error, name="phase_error")
    error_k = _not_negative(stiffness_error, name="stiffness_error")

    sine, cosine = np.sin(psi), np.cos(psi)
    mass_error = np.sqrt(error_k**2 + (cosine * error_a) ** 2 + (a * sine * error_psi) ** 2) / w**2
    damping_error = np.hypot(sine * error_a, a * cosine * error_psi) / w
    return OscillationCoefficients(
        mass=read_only((k - a * cosine) / w**2, name="mass"),
        damping=read_only(a * sine / w, name="damping"),
        mass_error=read_only(mass_error, name="mass_error"),
        damping_error=read_only(damping_error, name="damping_error"),
    )


def _not_negative(value: ArrayLike, *, name: str) -> FloatArray:
    array = read_only(value, name=name)
    if np.any(array < 0.0):
        raise ValueError(f"{name}: expected a value that is not negative, got {np.min(array):.6g}")
    return array
