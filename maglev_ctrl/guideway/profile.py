"""Functions of the place along the track: sampled profiles, and a track of several that a vehicle rides on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass, field
from typing import Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline, PPoly

from maglev_ctrl.arrays import FloatArray, read_only
from maglev_ctrl.errors import OutOfDomain

Interpolation = Literal["cubic", "band_limited"]
_FINER = 4  # points of the finer grid per sample: 8 in the shortest wave that the samples hold
_UNEVEN = 1e-9  # of the step, and of the range of heights: rounding, not a step


class ProfileLike(Protocol):
    """A function of the place x (...) m along the track with its derivative."""

    def at(self, x: ArrayLike, /) -> FloatArray:
        """Values (...) at places (...) m."""
        ...

    def slope(self, x: ArrayLike, /) -> FloatArray:
        """Derivatives by x (...) at places (...) m."""
        ...


@dataclass(frozen=True, eq=False, slots=True)
class Profile:
    """One sampled function of the place; nothing is extrapolated, but a periodic one repeats.

    "cubic" is the spline through the samples (not-a-knot ends, or periodic ones). "band_limited" is the trigonometric
    polynomial through the samples of one period, which has no wave shorter than two steps: evaluated with its first
    two derivatives on a grid four times finer, and by polynomials of fifth order between, to 5e-6 of the shortest wave.

    Parameters
    ----------
    positions : (N,) ascending, m; of a periodic one the last is the first of the next period
    heights : (N,) m (rad for a cross level); of a periodic one the last is the first
    periodic : whether it repeats after positions[-1] - positions[0]
    interpolation : "band_limited" needs an even grid and a periodic profile

    Raises
    ------
    ValueError : wrong shapes, fewer than four samples, positions that do not ascend, or ends that do not meet
    OutOfDomain : asked for a place outside the samples (`at`, `slope`)

    Examples
    --------
    >>> x = np.linspace(0.0, 10.0, 11)
    >>> wave = Profile(x, np.sin(0.2 * np.pi * x), periodic=True, interpolation="band_limited")
    >>> wave.at([2.5, 12.5, -7.5]).round(6).tolist(), wave.slope(0.0).round(6).tolist()
    ([1.0, 1.0, 1.0], 0.628319)
    """

    positions: FloatArray
    heights: FloatArray
    _: KW_ONLY
    periodic: bool = False
    interpolation: Interpolation = "cubic"
    name: str = ""
    source: str = ""
    _pieces: PPoly = field(init=False, repr=False)
    _slopes: PPoly = field(init=False, repr=False)

    def __post_init__(self) -> None:
        positions, heights = read_only(self.positions, name="positions"), read_only(self.heights, name="heights")
        if positions.ndim != 1 or positions.shape != heights.shape or positions.size < 4:
            shapes = f"{positions.shape} and {heights.shape}"
            raise ValueError(f"positions, heights: expected the same shape (N,), N at least 4, got {shapes}")
        if np.any(np.diff(positions) <= 0.0):
            raise ValueError("positions: expected them to ascend")
        if self.periodic:
            if abs(heights[-1] - heights[0]) > _UNEVEN * np.ptp(heights):
                ends = f"{heights[0]} and {heights[-1]}"
                raise ValueError(f"heights: expected the last to be the first in a periodic profile, got {ends}")
            heights = read_only([*heights[:-1], heights[0]], name="heights")
        object.__setattr__(self, "positions", positions)
        object.__setattr__(self, "heights", heights)
        if self.interpolation == "band_limited":
            if not self.periodic:
                raise ValueError("interpolation: expected a periodic profile for band_limited, got one that is not")
            pieces = _band_limited(heights[:-1], low=float(positions[0]), step=self.step)
        else:
            pieces = CubicSpline(positions, heights, bc_type="periodic" if self.periodic else "not-a-knot")
        object.__setattr__(self, "_pieces", pieces)
        object.__setattr__(self, "_slopes", pieces.derivative())

    @property
    def length(self) -> float:
        """From the first position to the last, m."""
        return float(self.positions[-1] - self.positions[0])

    @property
    def step(self) -> float:
        """Distance of the samples, m.

        Raises
        ------
        ValueError : the positions are not evenly spaced
        """
        step = self.length / (len(self.positions) - 1)
        if np.max(np.abs(np.diff(self.positions) - step)) > _UNEVEN * max(step, float(np.max(np.abs(self.positions)))):
            raise ValueError("positions: expected an even spacing")
        return step

    def at(self, x: ArrayLike, /) -> FloatArray:
        """Heights (...) m at places (...) m."""
        return np.asarray(self._pieces(self._inside(x)))

    def slope(self, x: ArrayLike, /) -> FloatArray:
        """Slopes (...) at places (...) m."""
        return np.asarray(self._slopes(self._inside(x)))

    def _inside(self, x: ArrayLike) -> FloatArray:
        place = np.asarray(x, dtype=np.float64)
        low, high = self.positions[0], self.positions[-1]
        if self.periodic:
            return np.asarray(low + np.mod(place - low, high - low))
        if not np.all((place >= low) & (place <= high)):
            raise OutOfDomain(
                f"x: expected places from {low:g} to {high:g} m, where {self.name or 'the profile'} has samples, got "
                f"{float(np.min(place)):g} to {float(np.max(place)):g} m"
            )
        return place


@dataclass(frozen=True, eq=False, slots=True)
class TrackProfile:
    """A track: sums of profiles for its vertical and lateral displacement and its cross level.

    Under a point x forward and y to the left the track stands at vertical(x) + y cross_level(x) vertically and at
    lateral(x) laterally: left and right share the vertical part and differ by the cross level.

    Parameters
    ----------
    vertical, lateral : profiles, m, summed; none: flat
    cross_level : profiles, rad, left side up positive, summed; none: level

    Examples
    --------
    >>> from maglev_ctrl.guideway.features import GirderSag, Steps
    >>> sag, tilt = GirderSag(25.0, rise=-0.004), Steps([0.0], heights=[1e-3], ramp=1.0)
    >>> track = TrackProfile(vertical=(sag,), cross_level=(tilt,))
    >>> left, right = track.under(10.0, 1.5)[0], track.under(10.0, -1.5)[0]
    >>> round(1e3 * float(left - right), 9)                               # mm over a gauge of 3 m
    3.0
    """

    vertical: tuple[ProfileLike, ...] = ()
    lateral: tuple[ProfileLike, ...] = ()
    cross_level: tuple[ProfileLike, ...] = ()

    def __post_init__(self) -> None:
        for label in ("vertical", "lateral", "cross_level"):
            object.__setattr__(self, label, tuple(getattr(self, label)))

    def under(self, x: ArrayLike, y: ArrayLike = 0.0) -> tuple[FloatArray, FloatArray]:
        """Vertical and lateral displacement (...) m under places x, y (...) m, which broadcast.

        Raises
        ------
        OutOfDomain : a place outside a profile
        """
        place, side = np.broadcast_arrays(np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64))
        tilt = _sum([one.at(place) for one in self.cross_level], place)
        vertical = _sum([one.at(place) for one in self.vertical], place)
        return np.asarray(vertical + side * tilt), _sum([one.at(place) for one in self.lateral], place)

    def slopes(self, x: ArrayLike, y: ArrayLike = 0.0) -> tuple[FloatArray, FloatArray]:
        """Derivatives by x of `under`, (...); times the speed they are the rates that a vehicle meets.

        Raises
        ------
        OutOfDomain : a place outside a profile
        """
        place, side = np.broadcast_arrays(np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64))
        tilt = _sum([one.slope(place) for one in self.cross_level], place)
        vertical = _sum([one.slope(place) for one in self.vertical], place)
        return np.asarray(vertical + side * tilt), _sum([one.slope(place) for one in self.lateral], place)


def surveyed(
    positions: ArrayLike, heights: ArrayLike, *, levelled: bool = False, name: str = "survey", source: str = ""
) -> Profile:
    """A measured profile: the cubic spline through samples at any spacing.

    Parameters
    ----------
    positions, heights : (N,) m, ascending positions
    levelled : take the straight line of least squares away, which a survey's own datum leaves in

    Raises
    ------
    ValueError : as `Profile`

    Examples
    --------
    >>> wavy = surveyed([0.0, 1.0, 3.0, 4.0, 6.0], [1.0, 2.0, 4.0, 5.0, 7.0], levelled=True)
    >>> bool(np.all(np.abs(wavy.at([0.5, 2.0, 5.0])) < 1e-12))
    True
    """
    place, height = read_only(positions, name="positions"), read_only(heights, name="heights")
    if levelled and place.ndim == 1 and place.shape == height.shape and place.size:
        centred = place - np.mean(place)
        spread = float(centred @ centred)
        height = height - np.mean(height) - (float(centred @ height) / spread if spread else 0.0) * centred
    return Profile(place, height, name=name, source=source)


def _sum(parts: Sequence[FloatArray], like: FloatArray) -> FloatArray:
    total = np.zeros(like.shape)
    for one in parts:
        total = total + one
    return np.asarray(total)


def _band_limited(samples: FloatArray, *, low: float, step: float) -> PPoly:
    """Polynomials of fifth order through value, slope and curvature of the samples' trigonometric polynomial."""
    count, fine = len(samples), _FINER * len(samples)
    line = np.fft.rfft(samples)
    if count % 2 == 0:
        line[-1] *= 0.5  # a wave of two steps: half of it stands at the negative wave number once the grid is finer
    wavenumber = 2.0 * np.pi * np.arange(line.size) / (count * step)
    h = step / _FINER
    f, g, k = (
        _FINER * np.fft.irfft(line * (1j * wavenumber) ** n, n=fine) * h**n for n in range(3)
    )  # value, slope and curvature per grid step
    rise = np.roll(f, -1) - f
    g1, k1 = np.roll(g, -1), np.roll(k, -1)
    coefficients = np.stack(
        [
            6.0 * rise - 3.0 * (g + g1) - 0.5 * (k - k1),
            -15.0 * rise + 8.0 * g + 7.0 * g1 + 1.5 * k - k1,
            10.0 * rise - 6.0 * g - 4.0 * g1 - 1.5 * k + 0.5 * k1,
            0.5 * k,
            g,
            f,
        ]
    )
    scale = h ** -np.arange(5, -1, -1, dtype=np.float64)
    return PPoly(coefficients * scale[:, None], low + h * np.arange(fine + 1))
