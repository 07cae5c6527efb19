"""Spectral factorisation: the stable minimum-phase filter that turns white noise into a guideway's roughness."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from maglev_ctrl.arrays import ComplexArray, FloatArray, read_only
from maglev_ctrl.errors import ModelError
from maglev_ctrl.guideway.spectra import Roughness

_LARGEST_MISMATCH = 1e-9  # of |F|^2 against the density; rounding leaves some 1e-14


@dataclass(frozen=True, eq=False, slots=True)
class ShapingFilter:
    """What a vehicle at one speed meets, as a state-space system driven by white noise of unit intensity.

    x' = A x + B nu, w = C x, w' = C_rate x + D_rate nu with E[nu(t) nu(t + tau)] = delta(tau). Then |F(jw)|^2 / pi, F
    from nu to w, is the one-sided density over rad/s (a white noise of unit intensity has 1/pi there). All poles and
    zeros lie in the left half plane, zeros perhaps at 0.

    Parameters
    ----------
    A : (n, n); n may be 0
    B : (n, 1)
    C : (1, n) m, or None where the density has a pole at zero: then w is the integral of w' and has no variance
    C_rate, D_rate : (1, n), (1, 1) m/s
    speed : m/s
    mismatch : greatest relative difference of |F|^2 / pi from the density, over ten decades about its corners
    """

    A: FloatArray
    B: FloatArray
    C: FloatArray | None
    C_rate: FloatArray
    D_rate: FloatArray
    speed: float
    mismatch: float

    def rate_response(self, frequency: ArrayLike) -> ComplexArray:
        """(...) from nu to w' at frequencies (...) rad/s."""
        return _response(self.A, self.B, self.C_rate, self.D_rate, np.asarray(frequency, dtype=np.float64))

    def response(self, frequency: ArrayLike) -> ComplexArray:
        """(...) from nu to w at frequencies (...) rad/s, not zero where C is None."""
        w = np.asarray(frequency, dtype=np.float64)
        if self.C is None:
            return np.asarray(self.rate_response(w) / (1j * w))
        return _response(self.A, self.B, self.C, np.zeros((1, 1)), w)


def shaping_filter(roughness: Roughness, *, speed: float) -> ShapingFilter:
    """The minimum-phase factor of a roughness met at a speed.

    With W^2 = -p^2, p = s / v, the roots r of P and Q in W^2 are the zeros and poles p = -sqrt(-r), taken on the left.
    They stand in a chain of sections of first and second order, which keeps corners many decades apart exact.

    Parameters
    ----------
    roughness : the density over the wave number
    speed : m/s

    Raises
    ------
    ValueError : a speed that is not positive, or a density that grows faster than W^-2 towards zero: then even the
        rate has no variance at the low end
    ModelError : the filter does not reproduce the density

    Examples
    --------
    >>> from maglev_ctrl.guideway.spectra import single_pole
    >>> rough = single_pole(1e-6, corner=0.1)
    >>> filtered = shaping_filter(rough, speed=100.0)
    >>> filtered.A.tolist(), filtered.mismatch < 1e-12
    ([[-10.0]], True)
    >>> power = np.abs(filtered.response(20.0)) ** 2 / np.pi
    >>> bool(np.isclose(power, rough.temporal(20.0, speed=100.0), rtol=1e-12))
    True
    """
    if not (np.isfinite(speed) and speed > 0.0):
        raise ValueError(f"speed: expected a positive number (m/s), got {speed}")
    integrator = roughness.poles_at_zero
    if integrator > 1:
        raise ValueError(
            f"roughness: expected a density that grows no faster than W^-2 towards W = 0, got W^-{2 * integrator}: "
            "the rate of the displacement has no variance at the low end"
        )
    zeros, poles = (
        speed * _left_roots(poly) for poly in (roughness.numerator, roughness.denominator[: -integrator or None])
    )
    # |F|^2 = pi S(w / v) / v, and W^(2 (q - p)) = (w / v)^(2 (q - p)).
    order = len(roughness.denominator) - len(roughness.numerator)
    gain = np.sqrt(np.pi * roughness.numerator[0] / roughness.denominator[0]) * speed ** (order - 0.5)
    A, B, C, D = _chain(zeros, poles, float(gain))
    shown: FloatArray | None
    if integrator:
        shown, rate, through = None, C, D
    else:
        shown, rate, through = C, C @ A, C @ B
    found = ShapingFilter(
        read_only(A, name="A"),
        B=read_only(B, name="B"),
        C=None if shown is None else read_only(shown, name="C"),
        C_rate=read_only(rate, name="C_rate"),
        D_rate=read_only(through, name="D_rate"),
        speed=float(speed),
        mismatch=float("nan"),
    )
    mismatch = _mismatch(found, roughness)
    if not mismatch <= _LARGEST_MISMATCH:
        raise ModelError(
            f"the shaping filter misses the density of {roughness.name or 'the guideway'} by {mismatch:.1e}"
        )
    return ShapingFilter(found.A, found.B, found.C, found.C_rate, found.D_rate, found.speed, mismatch)


def _left_roots(coefficients: tuple[float, ...]) -> ComplexArray:
    """Roots p of a polynomial in -p^2, those on the left (or at 0), conjugates exact."""
    roots = np.roots(coefficients).astype(np.complex128)
    roots = np.where(roots.imag == 0.0, roots.real + 0.0j, roots)
    return np.asarray(-np.sqrt(-roots))


def _sections(roots: ComplexArray) -> list[FloatArray]:
    """Monic real polynomials of second order, and one of first where the count is odd, holding these roots."""
    upper = roots[roots.imag > 0.0]
    real = np.sort(roots[roots.imag == 0.0].real)
    found = [np.array([1.0, -2.0 * one.real, abs(one) ** 2]) for one in upper]
    found += [np.array([1.0, -(a + b), a * b]) for a, b in zip(real[0::2], real[1::2], strict=False)]
    if real.size % 2:
        found.append(np.array([1.0, -real[-1]]))
    return found


def _chain(zeros: ComplexArray, poles: ComplexArray, gain: float) -> tuple[NDArray[np.float64], ...]:
    """A, B, C, D of gain prod(s - zeros) / prod(s - poles), one section after the other."""
    over, under = _sections(zeros), _sections(poles)
    # A lone zero takes the lone pole where there is one, and a section of second order where there is not.
    if over and len(over[-1]) == 2 and len(under[-1]) == 2:
        over = [*over[:-1], *[np.array([1.0])] * (len(under) - len(over)), over[-1]]
    over = [*over, *[np.array([1.0])] * (len(under) - len(over))]
    A, B = np.zeros((0, 0)), np.zeros((0, 1))
    C, D = np.zeros((1, 0)), np.array([[1.0]])
    for top, bottom in zip(over, under, strict=True):
        order, size = len(bottom) - 1, float(np.sqrt(abs(bottom[-1]))) if len(bottom) == 3 else 1.0
        padded = np.concatenate([np.zeros(order + 1 - len(top)), top])
        rest = padded[1:] - padded[0] * bottom[1:]
        if order == 1:
            a, b, c = np.array([[-bottom[1]]]), np.array([[1.0]]), np.array([[rest[0]]])
        else:  # both states in the unit of the input over a rate: no entry is a square of a frequency
            a = np.array([[0.0, size], [-bottom[2] / size, -bottom[1]]])
            b, c = np.array([[0.0], [1.0]]), np.array([[rest[1] / size, rest[0]]])
        A = np.block([[A, np.zeros((len(A), order))], [b @ C, a]])
        B = np.concatenate([B, b @ D])
        C, D = np.concatenate([padded[0] * C, c], axis=1), padded[0] * D
    return A, B, gain * C, gain * D


def _response(A: FloatArray, B: FloatArray, C: FloatArray, D: FloatArray, frequency: FloatArray) -> ComplexArray:
    resolvent = 1j * frequency[..., None, None] * np.eye(len(A)) - A
    states = np.linalg.solve(resolvent, np.broadcast_to(B, (*frequency.shape, *B.shape)).astype(np.complex128))
    return np.asarray((C @ states + D)[..., 0, 0])


def _mismatch(found: ShapingFilter, roughness: Roughness) -> float:
    corner = roughness.corners()
    low, high = (float(corner[0]), float(corner[-1])) if corner.size else (1.0, 1.0)
    w = found.speed * np.concatenate([np.geomspace(1e-5 * low, 1e5 * high, 401), corner])
    expected = roughness.temporal(w, speed=found.speed)
    got = np.abs(found.response(w)) ** 2 / np.pi
    return float(np.max(np.abs(got / expected - 1.0)))
