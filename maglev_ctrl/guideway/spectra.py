"""Spectra of guideway roughness: rational densities over the wave number, and the formulas they come from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import quad

from maglev_ctrl.arrays import FloatArray, read_only

WARWICK_AMPLITUDE = 1.5e-6  # m
FEDERAL_RAILROAD_AMPLITUDES = {5: 2.095e-5, 6: 3.365e-6}  # m^2 rad/m, vertical profile
FEDERAL_RAILROAD_CORNER = 0.8245  # rad/m
FEDERAL_RAILROAD_FACTOR = 0.25
_LARGEST_DOUBT = 1e-7  # of a variance; a resonance of damping 1e-4 leaves 1e-9 to rounding
_WARWICK_SOURCE = (
    "University of Warwick maglev papers, digitised item 0678: S(w) = A U / w^2 with A = 1.5e-6 m, better A U / (w0^2 "
    "+ w^2); read here as a one-sided density over rad/s, which the text does not say"
)


@dataclass(frozen=True, eq=False, slots=True)
class Roughness:
    """One-sided density of a displacement over the wave number: S(W) = P(W^2) / Q(W^2), m^2/(rad/m).

    The variance is the integral of S over W from 0 to infinity. Being written in W^2 the density is even; it must be
    positive and finite at every W > 0 (decided in exact arithmetic) and fall to zero at the high end. A density that
    grows without bound towards W = 0 is allowed: its displacement has no variance, its rate may have one.

    Parameters
    ----------
    numerator, denominator : coefficients of P and Q in powers of W^2 (rad^2/m^2), highest first
    name, source : what it is and where the numbers come from

    Raises
    ------
    ValueError : a coefficient that is not finite, a degree of P that is not below that of Q, a density that is
        negative or infinite at some W > 0, or P and Q that vanish together at W = 0

    Examples
    --------
    >>> rough = Roughness((1e-6,), (1.0, 0.01), name="single pole at 0.1 rad/m")
    >>> [float(f"{one:.4g}") for one in rough.density([0.0, 0.1, 1.0])]
    [0.0001, 5e-05, 9.901e-07]
    >>> Roughness((1.0, -1.0), (1.0, 0.0, 1.0))
    Traceback (most recent call last):
        ...
    ValueError: numerator: expected P(W^2) positive at every W > 0, got a change of sign or a zero (1 of them)
    """

    numerator: tuple[float, ...]
    denominator: tuple[float, ...]
    name: str = ""
    source: str = ""

    def __post_init__(self) -> None:
        top, bottom = (_stripped(getattr(self, label), label) for label in ("numerator", "denominator"))
        if len(top) >= len(bottom):
            raise ValueError(
                f"numerator: expected a degree below that of the denominator ({len(bottom) - 1} in W^2), so that the "
                f"density falls to zero at the high end, got {len(top) - 1}"
            )
        if top[-1] == 0.0 == bottom[-1]:
            raise ValueError("numerator, denominator: expected no common factor W^2, got both zero at W = 0")
        sign = np.sign(bottom[0])
        top, bottom = tuple(float(sign * one) for one in top), tuple(float(sign * one) for one in bottom)
        for label, poly, letter in (("numerator", top, "P"), ("denominator", bottom, "Q")):
            count = _positive_roots(poly)
            if count or poly[0] < 0.0:
                found = f"a change of sign or a zero ({count} of them)" if count else "a negative one"
                raise ValueError(f"{label}: expected {letter}(W^2) positive at every W > 0, got {found}")
        object.__setattr__(self, "numerator", top)
        object.__setattr__(self, "denominator", bottom)

    @property
    def poles_at_zero(self) -> int:
        """m, where the density grows as W^(-2m) towards W = 0."""
        return _trailing_zeros(self.denominator)

    def density(self, wavenumber: ArrayLike) -> FloatArray:
        """S at wave numbers (...) rad/m, m^2/(rad/m); infinite at 0 where it has poles there."""
        square = np.square(np.asarray(wavenumber, dtype=np.float64))
        with np.errstate(divide="ignore"):
            return np.asarray(np.polyval(self.numerator, square) / np.polyval(self.denominator, square))

    def temporal(self, frequency: ArrayLike, *, speed: float) -> FloatArray:
        """One-sided density over the frequency at which a vehicle meets it, S(w / v) / v, m^2/(rad/s).

        Parameters
        ----------
        frequency : (...) w, rad/s
        speed : v, m/s

        Raises
        ------
        ValueError : a speed that is not positive
        """
        _require_positive(speed, "speed", "m/s")
        return np.asarray(self.density(np.asarray(frequency, dtype=np.float64) / speed) / speed)

    def variance(self, band: tuple[float, float], *, speed: float = 1.0, derivative: int = 0) -> float:
        """Variance of the displacement met at a speed, or of its n-th derivative in time, from a frequency band.

        The integral over the band of w^(2n) S(w / v) / v. The band may reach from 0 and to infinity where the
        integral exists. At 1 m/s the band is one of wave numbers and the derivatives are by the place.

        Parameters
        ----------
        band : lowest and highest frequency, rad/s
        speed : v, m/s
        derivative : n; 0 displacement (m^2), 1 velocity (m^2/s^2), 2 acceleration, ...

        Raises
        ------
        ValueError : a band that does not ascend from 0 or above, a speed that is not positive, a negative derivative,
            or an infinite variance; the message says which end of the band makes it so
        ArithmeticError : the integral did not reach its tolerance

        Examples
        --------
        >>> rough = inverse_square()
        >>> float(f"{rough.variance((1.0, 100.0), speed=100.0):.6g}"), 1.5e-6 * 100 * (1 - 0.01)
        (0.0001485, 0.0001485)
        >>> rough.variance((0.0, 100.0), speed=100.0)
        Traceback (most recent call last):
            ...
        ValueError: band: the variance is infinite at the LOW end: the density of derivative 0 grows as w^-2 towards
        w = 0; expected a lowest frequency above 0, got 0
        """
        low, high = (float(one) for one in band)
        if not (0.0 <= low < high) or np.isinf(low):
            raise ValueError(f"band: expected 0 <= lowest < highest in rad/s, got {low:g} and {high:g}")
        _require_positive(speed, "speed", "m/s")
        if derivative < 0:
            raise ValueError(f"derivative: expected 0 or more, got {derivative}")
        at_zero = 2 * (derivative + _trailing_zeros(self.numerator) - self.poles_at_zero)
        at_infinity = 2 * (derivative + len(self.numerator) - len(self.denominator))
        if low == 0.0 and at_zero < 0:
            raise ValueError(
                f"band: the variance is infinite at the LOW end: the density of derivative {derivative} grows as "
                f"w^{at_zero} towards w = 0; expected a lowest frequency above 0, got 0"
            )
        if np.isinf(high) and at_infinity >= 0:
            raise ValueError(
                f"band: the variance is infinite at the HIGH end: the density of derivative {derivative} goes as "
                f"w^{at_infinity} there; expected a highest frequency that is finite, got inf"
            )
        return float(speed ** (2 * derivative) * self._moment(low / speed, high / speed, 2 * derivative))

    def scaled(self, factor: float) -> Roughness:
        """The same shape with densities multiplied by a positive factor.

        Raises
        ------
        ValueError : a factor that is not positive
        """
        _require_positive(factor, "factor", "ratio")
        return Roughness(
            tuple(factor * one for one in self.numerator), self.denominator, name=self.name,
            source=f"{self.source} (times {factor:g})" if self.source else "",
        )  # fmt: skip

    def corners(self) -> FloatArray:
        """Wave numbers at which the density bends, ascending, rad/m: moduli of the roots of P and Q, 0 left out."""
        found = np.concatenate([np.roots(self.numerator), np.roots(self.denominator)])
        return read_only(np.sort(np.sqrt(np.abs(found[found != 0.0]))), name="corners")

    def _moment(self, low: float, high: float, power: int) -> float:
        """Integral of W^power S over a band of wave numbers, in log W: every decade counts alike there."""
        corner = self.corners()
        scale = float(corner[0]) if corner.size else max(low, 1.0)
        # Below and above the corners the integrand is a power of W, whose tail in log W falls off at least as exp(-u).
        bottom = low if low > 0.0 else 1e-18 * min(scale, high)
        top = high if np.isfinite(high) else 1e18 * max(float(corner[-1]) if corner.size else scale, low)
        inner = corner[(corner > bottom) & (corner < top)]
        edges = np.log(np.concatenate([[bottom], np.unique(inner), [top]]))
        edges = np.unique(np.concatenate([np.linspace(a, b, 2 + int((b - a) // 3.0)) for a, b in pairwise(edges)]))

        def integrand(u: float) -> float:
            return float(np.exp((power + 1) * u) * self.density(np.exp(u)))

        # With its full output a quadrature that meets rounding says so by its error estimate and not by a warning.
        parts = [
            quad(integrand, a, b, epsabs=0.0, epsrel=1e-12, limit=400, full_output=1)[:2] for a, b in pairwise(edges)
        ]
        total, doubt = (float(np.sum([part[i] for part in parts])) for i in range(2))
        if not doubt <= _LARGEST_DOUBT * total:
            raise ArithmeticError(f"variance: the integral over the band is only known to {doubt / total:.1e}")
        return total


def inverse_square(
    amplitude: float = WARWICK_AMPLITUDE, *, name: str = "inverse square", source: str = _WARWICK_SOURCE
) -> Roughness:
    """A / W^2: the roughness whose slope is white; met at speed U it is A U / w^2.

    Parameters
    ----------
    amplitude : A, m (m^2 rad/m); that of the Warwick studies unless you choose

    Raises
    ------
    ValueError : an amplitude that is not positive

    Examples
    --------
    >>> float(inverse_square().temporal(10.0, speed=135.0))               # 1.5e-6 * 135 / 100 m^2/(rad/s)
    2.025e-06
    """
    _require_positive(amplitude, "amplitude", "m")
    return Roughness((amplitude,), (1.0, 0.0), name=name, source=source)


def single_pole(
    amplitude: float = WARWICK_AMPLITUDE, *, corner: float, name: str = "single pole", source: str = _WARWICK_SOURCE
) -> Roughness:
    """A / (W0^2 + W^2): as the inverse square, with long waves bounded; the variance is A pi / (2 W0).

    The Warwick text bends at a frequency w0; that is the wave number W0 = w0 / U at its speed U.

    Parameters
    ----------
    amplitude : A, m
    corner : W0, rad/m

    Raises
    ------
    ValueError : an amplitude or a corner that is not positive

    Examples
    --------
    >>> float(f"{single_pole(1e-6, corner=0.1).variance((0.0, np.inf)):.9g}"), float(f"{np.pi / 0.2 * 1e-6:.9g}")
    (1.57079633e-05, 1.57079633e-05)
    """
    _require_positive(amplitude, "amplitude", "m")
    _require_positive(corner, "corner", "rad/m")
    return Roughness((amplitude,), (1.0, corner**2), name=name, source=source)


def federal_railroad(
    line_class: int = 5,
    *,
    amplitude: float | None = None,
    corner: float = FEDERAL_RAILROAD_CORNER,
    factor: float = FEDERAL_RAILROAD_FACTOR,
    source: str = "",
) -> Roughness:
    """k A Wc^2 / ((W^2 + Wc^2) W^2): vertical profile of rails by the Federal Railroad Administration's classes.

    Built in are class 5, A = 2.095e-5 m^2 rad/m, and class 6, 3.365e-6. **Class 6 is in doubt**: published programs
    give 3.365e-6 and ten times that. The larger one would make class 6 rougher than class 5, the wrong way round, so
    the smaller one stands here; the report itself was not seen, and `amplitude` decides otherwise. k = 0.25 and Wc =
    0.8245 rad/m (0.8242 in some programs). Uses differ on whether the density is one-sided; it is here.

    Parameters
    ----------
    line_class : 5 or 6 (better); any other needs an amplitude
    amplitude : A, m^2 rad/m; None: by the class
    corner : Wc, rad/m
    factor : k

    Raises
    ------
    ValueError : a class without a built-in amplitude, or a number that is not positive

    Examples
    --------
    >>> fine = federal_railroad(6)
    >>> float(f"{fine.density(1.0):.4g}"), fine.poles_at_zero
    (3.404e-07, 1)
    """
    name = "Federal Railroad Administration form"
    if amplitude is None:
        name = f"{name}, class {line_class}"
        if line_class not in FEDERAL_RAILROAD_AMPLITUDES:
            raise ValueError(f"line_class: expected 5 or 6, or an amplitude in m^2 rad/m, got {line_class}")
        amplitude = FEDERAL_RAILROAD_AMPLITUDES[line_class]
        source = source or (
            f"Federal Railroad Administration form, class {line_class}, A = {amplitude:g} m^2 rad/m as in published "
            "rail-irregularity programs"
        ) + (
            "; ten times this amplitude is published too, which would be rougher than class 5"
            if line_class == 6
            else ""
        )
    for label, value, unit in (
        ("amplitude", amplitude, "m^2 rad/m"),
        ("corner", corner, "rad/m"),
        ("factor", factor, "ratio"),
    ):
        _require_positive(value, label, unit)
    square = corner**2
    return Roughness(
        (factor * amplitude * square,), (1.0, square, 0.0), name=name,
        source=source or f"A = {amplitude:g} m^2 rad/m as given",
    )  # fmt: skip


def rational(
    numerator: Sequence[float], denominator: Sequence[float], *, name: str = "rational", source: str = ""
) -> Roughness:
    """P(W^2) / Q(W^2) with your own coefficients, in powers of W^2, highest first.

    Raises
    ------
    ValueError : as `Roughness`

    Examples
    --------
    >>> float(rational([2e-6, 1e-8], [1.0, 0.5, 0.02]).density(0.0))
    5e-07
    """
    return Roughness(tuple(numerator), tuple(denominator), name=name, source=source)


def _stripped(coefficients: Sequence[float], label: str) -> tuple[float, ...]:
    values = tuple(float(one) for one in coefficients)
    if not np.all(np.isfinite(values)):
        raise ValueError(f"{label}: expected finite coefficients, got {values}")
    first = next((i for i, one in enumerate(values) if one != 0.0), None)
    if first is None:
        raise ValueError(f"{label}: expected at least one coefficient that is not zero, got {values}")
    return values[first:]


def _trailing_zeros(coefficients: tuple[float, ...]) -> int:
    return next(i for i, one in enumerate(reversed(coefficients)) if one != 0.0)


def _positive_roots(coefficients: tuple[float, ...]) -> int:
    """Distinct roots above zero, by a Sturm chain in exact fractions."""
    poly = [Fraction(one) for one in coefficients[: len(coefficients) - _trailing_zeros(coefficients)]]
    degree = len(poly) - 1
    chain = [poly, [one * (degree - i) for i, one in enumerate(poly[:-1])]]
    while len(chain[-1]) > 1:
        rest = _remainder(chain[-2], chain[-1])
        if not rest:
            break
        chain.append([-one for one in rest])
    links = [one for one in chain if one]
    return _sign_changes([one[-1] for one in links]) - _sign_changes([one[0] for one in links])


def _remainder(dividend: list[Fraction], divisor: list[Fraction]) -> list[Fraction]:
    rest = list(dividend)
    while len(rest) >= len(divisor):
        ratio = rest[0] / divisor[0]
        rest = [a - ratio * b for a, b in zip(rest, divisor + [Fraction(0)] * len(rest), strict=False)][1:]
    while rest and rest[0] == 0:
        rest = rest[1:]
    return rest


def _sign_changes(values: list[Fraction]) -> int:
    signs = [one > 0 for one in values if one != 0]
    return sum(a != b for a, b in pairwise(signs))


def _require_positive(value: float, label: str, unit: str) -> None:
    if not (np.isfinite(value) and value > 0.0):
        raise ValueError(f"{label}: expected a positive number ({unit}), got {value}")
