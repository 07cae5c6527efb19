"""What is built into a guideway on purpose or by its weight: girders that sag, joints aslant, steps.

Every feature is a function of the place x along the track (m): `at` its height, `slope` the derivative of it. The
repeating ones are told about their own mean, so that adding one does not move the height at which a vehicle flies.
"""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from math import pi

import numpy as np
from numpy.typing import ArrayLike

from maglev_ctrl.arrays import FloatArray, read_only


def half_sine(position: FloatArray, *, span: float, height: float) -> FloatArray:
    """height sin(pi s / span) at positions (...) m from a support, 0 to one span.

    Examples
    --------
    >>> half_sine(np.array([0.0, 12.5]), span=25.0, height=-0.004).tolist()
    [-0.0, -0.004]
    """
    return np.asarray(height * np.sin(pi * position / span))


def aslant(position: FloatArray, *, spacing: float, step: float) -> FloatArray:
    """step (1/2 - s / spacing) at positions (...) m from a joint: falls evenly by `step` from one joint to the next.

    Examples
    --------
    >>> aslant(np.array([0.0, 5.0]), spacing=10.0, step=0.002).tolist()
    [0.001, 0.0]
    """
    return np.asarray(step * (0.5 - position / spacing))


@dataclass(frozen=True, slots=True)
class GirderSag:
    """Girders between supports at offset, offset + span, ...: rise sin(pi s / span) about its mean, rise < 0 for a sag.

    The slope jumps at every support; there the one ahead is told.

    Parameters
    ----------
    span, rise, offset : m

    Raises
    ------
    ValueError : a span that is not positive, or a length that is not finite

    Examples
    --------
    >>> sag = GirderSag(25.0, rise=-0.004)
    >>> (1e3 * sag.at([0.0, 12.5, 25.0])).round(3).tolist(), (1e3 * sag.slope([0.0, 12.5])).round(3).tolist()
    ([2.546, -1.454, 2.546], [-0.503, -0.0])
    """

    span: float
    _: KW_ONLY
    rise: float
    offset: float = 0.0

    def __post_init__(self) -> None:
        _require_length(self.span, "span")
        _require_finite(rise=self.rise, offset=self.offset)

    def at(self, x: ArrayLike) -> FloatArray:
        """Heights (...) m at places (...) m."""
        s = np.mod(np.asarray(x, dtype=np.float64) - self.offset, self.span)
        return np.asarray(half_sine(s, span=self.span, height=self.rise) - 2.0 * self.rise / pi)

    def slope(self, x: ArrayLike) -> FloatArray:
        """Slopes (...) at places (...) m."""
        s = np.mod(np.asarray(x, dtype=np.float64) - self.offset, self.span)
        return np.asarray(pi * self.rise / self.span * np.cos(pi * s / self.span))


@dataclass(frozen=True, slots=True)
class SlantedJoints:
    """Segments laid aslant: at joints offset, offset + spacing, ... the surface rises by `step`, then falls evenly.

    The rise takes the length `ramp`, half before the joint and half behind, along half a cosine: the slope is
    continuous. No vehicle meets a step of no length: its magnets are long, and a filter would ring for ever.

    Parameters
    ----------
    spacing, step, ramp, offset : m

    Raises
    ------
    ValueError : a spacing or a ramp that is not positive, a ramp longer than the spacing, a length that is not finite

    Examples
    --------
    >>> joints = SlantedJoints(10.0, step=0.002, ramp=0.5)
    >>> (1e3 * joints.at([-0.25, 0.25, 5.0])).round(3).tolist()
    [-0.95, 0.95, 0.0]
    """

    spacing: float
    _: KW_ONLY
    step: float
    ramp: float
    offset: float = 0.0

    def __post_init__(self) -> None:
        _require_length(self.spacing, "spacing")
        _require_length(self.ramp, "ramp")
        _require_finite(step=self.step, offset=self.offset)
        if self.ramp > self.spacing:
            raise ValueError(f"ramp: expected at most the spacing, {self.spacing:g} m, got {self.ramp:g}")

    def at(self, x: ArrayLike) -> FloatArray:
        """Heights (...) m at places (...) m."""
        d = self._from_joint(x)
        # Ahead of the joint the segment is the one that ends there: half a step lower than the formula tells at d < 0.
        falling = aslant(d, spacing=self.spacing, step=self.step) - self.step
        return np.asarray(falling + self.step * _risen(d / self.ramp + 0.5))

    def slope(self, x: ArrayLike) -> FloatArray:
        """Slopes (...) at places (...) m."""
        d = self._from_joint(x)
        return np.asarray(self.step * (_rising(d / self.ramp + 0.5) / self.ramp - 1.0 / self.spacing))

    def _from_joint(self, x: ArrayLike) -> FloatArray:
        half = 0.5 * self.spacing
        return np.asarray(np.mod(np.asarray(x, dtype=np.float64) - self.offset + half, self.spacing) - half)


@dataclass(frozen=True, eq=False, slots=True)
class Steps:
    """Single steps: from each place on the surface stands higher by its height, over a ramp along half a cosine.

    Parameters
    ----------
    places : (n,) where the ramps begin, m
    heights : (n,) m
    ramp : length of each ramp, m

    Raises
    ------
    ValueError : wrong shapes, entries that are not finite, or a ramp that is not positive

    Examples
    --------
    >>> bump = Steps([100.0, 110.0], heights=[0.002, -0.002], ramp=1.0)
    >>> (1e3 * bump.at([100.0, 100.5, 105.0, 111.0])).round(6).tolist(), bump.slope([100.5]).round(6).tolist()
    ([0.0, 1.0, 2.0, 0.0], [0.003142])
    """

    places: FloatArray
    _: KW_ONLY
    heights: FloatArray
    ramp: float

    def __post_init__(self) -> None:
        _require_length(self.ramp, "ramp")
        places, heights = read_only(self.places, name="places"), read_only(self.heights, name="heights")
        if places.ndim != 1 or places.shape != heights.shape:
            raise ValueError(f"places, heights: expected the same shape (n,), got {places.shape} and {heights.shape}")
        object.__setattr__(self, "places", places)
        object.__setattr__(self, "heights", heights)

    def at(self, x: ArrayLike) -> FloatArray:
        """Heights (...) m at places (...) m."""
        return np.asarray(_risen(self._along(x)) @ self.heights)

    def slope(self, x: ArrayLike) -> FloatArray:
        """Slopes (...) at places (...) m."""
        return np.asarray(_rising(self._along(x)) @ self.heights / self.ramp)

    def _along(self, x: ArrayLike) -> FloatArray:
        return np.asarray((np.asarray(x, dtype=np.float64)[..., None] - self.places) / self.ramp)


def _risen(along: FloatArray) -> FloatArray:
    """Half a cosine from 0 to 1 over the ramp, `along` of which is travelled."""
    return np.asarray(0.5 - 0.5 * np.cos(pi * np.clip(along, 0.0, 1.0)))


def _rising(along: FloatArray) -> FloatArray:
    """Derivative of `_risen`; 0 before and behind the ramp, as sin(0) and sin(pi) are."""
    return np.where((along > 0.0) & (along < 1.0), 0.5 * pi * np.sin(pi * np.clip(along, 0.0, 1.0)), 0.0)


def _require_length(value: float, label: str) -> None:
    if not (np.isfinite(value) and value > 0.0):
        raise ValueError(f"{label}: expected a positive length in m, got {value}")


def _require_finite(**values: float) -> None:
    for label, value in values.items():
        if not np.isfinite(value):
            raise ValueError(f"{label}: expected a finite length in m, got {value}")
