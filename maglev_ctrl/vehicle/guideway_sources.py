"""What makes a guideway periodic: surfaces that rise and fall, and stiffness that varies, each with its own period.

Positions s run along the track, m; the origin of every source is its support or joint (moved by its `offset`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import KW_ONLY, dataclass
from functools import lru_cache, partial
from math import pi

import numpy as np

from maglev_ctrl.arrays import ComplexArray, FloatArray, read_only, read_only_any
from maglev_ctrl.guideway.features import aslant, half_sine

Profile = Callable[[FloatArray], FloatArray]
"""Displacement (...) m at positions (...) m from the start of a period, 0 to one period."""


@dataclass(frozen=True, eq=False, slots=True)
class DisplacedGuideway:
    """A guideway whose surface rises, or whose walls come nearer, once per period.

    Parameters
    ----------
    name : what it is, for tables and messages
    period : m
    breaks : (b,) ascending positions from 0 to the period between which the profiles are smooth, m
    rise : how far the surface under the magnets stands up; None: nowhere
    narrowing : how far each guidance wall stands towards the magnets; None: nowhere
    offset : where along the track its origin lies, m

    Raises
    ------
    ValueError : a period that is not positive, or breaks that do not run from 0 to it

    Examples
    --------
    >>> girder = girder_bow("girder", span=25.0, rise=-0.004)
    >>> [round(1e3 * float(one), 3) for one in girder.range_of_rise()]        # mm about the mean
    [-1.454, 2.546]
    """

    name: str
    period: float
    _: KW_ONLY
    breaks: FloatArray
    rise: Profile | None = None
    narrowing: Profile | None = None
    offset: float = 0.0

    def __post_init__(self) -> None:
        require_length(self.period, f"{self.name}: period")
        _require_finite(self.offset, f"{self.name}: offset")
        breaks = read_only(self.breaks, name="breaks")
        if breaks.ndim != 1 or breaks.size < 2 or np.any(np.diff(breaks) <= 0.0):
            raise ValueError(f"{self.name}: breaks: expected ascending positions, got {breaks.tolist()}")
        if breaks[0] != 0.0 or abs(breaks[-1] / self.period - 1.0) > 1e-12:
            raise ValueError(f"{self.name}: breaks: expected positions from 0 to {self.period:g} m")
        object.__setattr__(self, "breaks", breaks)

    def stations(self, per_piece: int) -> tuple[FloatArray, FloatArray]:
        """Positions (q,) m of a Gauss rule with that many in every smooth piece, and weights (q,) that sum to one."""
        node, weight = _gauss(per_piece)
        low, width = self.breaks[:-1, None], np.diff(self.breaks)[:, None]
        return (low + 0.5 * width * (1.0 + node)).ravel(), (0.5 * width * weight / self.period).ravel()

    def displaced(self, positions: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Rise and narrowing (...) m at positions (...) m of one period, each about its own mean."""
        level = _means(self)
        rise, narrowing = (
            np.zeros_like(positions) if profile is None else np.asarray(profile(positions) - mean)
            for profile, mean in zip((self.rise, self.narrowing), level, strict=True)
        )
        return rise, narrowing

    def range_of_rise(self) -> tuple[float, float]:
        """Lowest and highest rise about the mean, m."""
        return _ranges(self)[0]

    def range_of_narrowing(self) -> tuple[float, float]:
        """Least and greatest narrowing about the mean, m."""
        return _ranges(self)[1]


@dataclass(frozen=True, eq=False, slots=True)
class StiffnessRipple:
    """A stiffness that is K [1 + Re sum over k of c_k exp(2 pi i k s / period)] along the track, K its mean.

    Parameters
    ----------
    period : m
    coefficients : (H,) complex c_1, c_2, ...
    mean_square : mean square of the whole ripple, with the harmonics that are not in `coefficients`; None: all are
    offset : where along the track its origin lies, m

    Raises
    ------
    ValueError : a period that is not positive, no coefficient, or one that is not finite
    """

    name: str
    period: float
    _: KW_ONLY
    coefficients: ComplexArray
    mean_square: float | None = None
    offset: float = 0.0

    def __post_init__(self) -> None:
        require_length(self.period, f"{self.name}: period")
        _require_finite(self.offset, f"{self.name}: offset")
        coefficients = np.asarray(self.coefficients, dtype=np.complex128)
        if coefficients.ndim != 1 or not coefficients.size or not np.all(np.isfinite(coefficients)):
            raise ValueError(f"{self.name}: coefficients: expected at least one finite number, got {coefficients}")
        object.__setattr__(self, "coefficients", read_only_any(coefficients))


GuidewaySource = DisplacedGuideway | StiffnessRipple


def girder_bow(name: str, *, span: float, rise: float, offset: float = 0.0) -> DisplacedGuideway:
    """Girders between supports at s = 0, span, ...: the surface is rise sin(pi s / span), rise < 0 for a sag.

    Parameters
    ----------
    span : m
    rise : of mid-span over the supports, m

    Raises
    ------
    ValueError : a span that is not positive, or a rise that is not finite
    """
    require_length(span, f"{name}: span")
    _require_finite(rise, f"{name}: rise")
    return DisplacedGuideway(
        name, span, breaks=np.array([0.0, span]), rise=partial(half_sine, span=span, height=rise), offset=offset
    )


def girder_softness(
    name: str, *, span: float, variation: float, harmonics: int, offset: float = 0.0
) -> StiffnessRipple:
    """Girders that give way: the stiffness is proportional to 1 - variation sin(pi s / span), s = 0 at a support.

    c_k = variation (4/pi) / (4 k^2 - 1) over the mean 1 - 2 variation / pi.

    Parameters
    ----------
    span : m
    variation : fraction by which the stiffness at mid-span is below that over a support, below one
    harmonics : how many coefficients

    Raises
    ------
    ValueError : a span that is not positive, or a variation that is not below one

    Examples
    --------
    >>> girder_softness("girder", span=25.0, variation=0.1, harmonics=2).coefficients.real.round(5).tolist()
    [0.04533, 0.00907]
    """
    require_length(span, f"{name}: span")
    if not (np.isfinite(variation) and -1.0 < variation < 1.0):
        raise ValueError(f"{name}: variation: expected a fraction between -1 and 1, got {variation}")
    order, mean = np.arange(1, harmonics + 1), 1.0 - 2.0 * variation / pi
    coefficients = (variation * (4.0 / pi) / (4.0 * order**2 - 1.0) / mean).astype(np.complex128)
    square = variation**2 * (0.5 - 4.0 / pi**2) / mean**2
    return StiffnessRipple(name, span, coefficients=coefficients, mean_square=square, offset=offset)


def open_joints(name: str, *, spacing: float, opening: float, harmonics: int, offset: float = 0.0) -> StiffnessRipple:
    """Joints without conductor over a length `opening` about s = 0, spacing, ...: no stiffness there.

    c_k = -2 sin(pi k opening / spacing) / (pi k), over the mean 1 - opening / spacing. The edges are sharp: fields
    spread over about the levitation height, so harmonics with a shorter period than that are overestimated.

    Parameters
    ----------
    spacing, opening : m
    harmonics : how many coefficients

    Raises
    ------
    ValueError : a spacing that is not positive, or an opening that is not below it

    Examples
    --------
    >>> open_joints("joint", spacing=10.0, opening=0.1, harmonics=1).coefficients.real.round(6).tolist()
    [-0.020199]
    """
    require_length(spacing, f"{name}: spacing")
    if not (np.isfinite(opening) and 0.0 < opening < spacing):
        raise ValueError(f"{name}: opening: expected a length above zero and below {spacing:g} m, got {opening:g} m")
    order, share = np.arange(1, harmonics + 1), opening / spacing
    coefficients = (-2.0 * np.sin(pi * order * share) / (pi * order) / (1.0 - share)).astype(np.complex128)
    return StiffnessRipple(
        name, spacing, coefficients=coefficients, mean_square=share / (1.0 - share), offset=offset
    )  # fmt: skip


def stepped_joints(name: str, *, spacing: float, step: float, offset: float = 0.0) -> DisplacedGuideway:
    """Segments laid aslant: at every joint s = 0, spacing, ... the surface jumps up by `step` and falls back evenly.

    Parameters
    ----------
    spacing, step : m

    Raises
    ------
    ValueError : a spacing that is not positive, or a step that is not finite
    """
    require_length(spacing, f"{name}: spacing")
    _require_finite(step, f"{name}: step")
    return DisplacedGuideway(
        name, spacing, breaks=np.array([0.0, spacing]),
        rise=partial(aslant, spacing=spacing, step=step),
        offset=offset,
    )  # fmt: skip


def measured_profile(
    name: str,
    *,
    spacing: float,
    heights: Sequence[float] = (),
    gaps: Sequence[float] = (),
    offset: float = 0.0,
) -> DisplacedGuideway:
    """Segments with a profile given by evenly spaced samples over one period, the first at the joint, lines between.

    Parameters
    ----------
    spacing : m
    heights : samples of how far the surface stands up, m; may be empty
    gaps : samples of how far each wall stands towards the magnets, m; may be empty

    Raises
    ------
    ValueError : a spacing that is not positive, or a sample that is not finite
    """
    require_length(spacing, f"{name}: spacing")
    profiles: list[Profile | None] = []
    breaks = np.array([0.0, spacing])
    for label, samples in (("heights", heights), ("gaps", gaps)):
        if not len(samples):
            profiles.append(None)
            continue
        closed = read_only([*samples, samples[0]], name=f"{name}: {label}")
        at = np.linspace(0.0, spacing, len(closed))
        breaks = np.union1d(breaks, at)
        profiles.append(partial(_polyline, at=at, height=closed))
    # Two even grids may meet in places that rounding keeps apart.
    breaks = breaks[np.concatenate([np.diff(breaks) > 1e-9 * spacing, [True]])]
    return DisplacedGuideway(name, spacing, breaks=breaks, rise=profiles[0], narrowing=profiles[1], offset=offset)


def pitch_ripple(
    name: str, *, pitch: float, ripple: float, harmonics: Sequence[float] = (1.0,), offset: float = 0.0
) -> StiffnessRipple:
    """Coils or poles: the stiffness varies by ripple * harmonics[k-1] cos(2 pi k s / pitch).

    Parameters
    ----------
    pitch : m
    ripple : relative amplitude
    harmonics : relative size of the harmonics 1, 2, ...

    Raises
    ------
    ValueError : a pitch that is not positive, or amplitudes that are not finite
    """
    return StiffnessRipple(name, pitch, coefficients=ripple * np.asarray(harmonics, dtype=np.complex128), offset=offset)


def require_length(value: float, label: str) -> None:
    """Refuse a length that is not positive and finite.

    Raises
    ------
    ValueError : it is not
    """
    if not (np.isfinite(value) and value > 0.0):
        raise ValueError(f"{label}: expected a positive length in m, got {value}")


def _require_finite(value: float, label: str) -> None:
    if not np.isfinite(value):
        raise ValueError(f"{label}: expected a finite length in m, got {value}")


@lru_cache(maxsize=64)
def _gauss(count: int) -> tuple[FloatArray, FloatArray]:
    node, weight = np.polynomial.legendre.leggauss(count)
    return read_only(node, name="node"), read_only(weight, name="weight")


@lru_cache(maxsize=64)
def _means(source: DisplacedGuideway) -> tuple[float, float]:
    """Mean rise and narrowing; 32 positions find the mean of a half sine or a line to rounding."""
    at, weight = source.stations(32)
    rise, narrowing = (0.0 if one is None else float(weight @ one(at)) for one in (source.rise, source.narrowing))
    return rise, narrowing


@lru_cache(maxsize=64)
def _ranges(source: DisplacedGuideway) -> tuple[tuple[float, float], tuple[float, float]]:
    inner, _ = source.stations(max(2, 64 // (len(source.breaks) - 1)))
    # Both sides of a break count: a profile may jump there.
    edges = np.concatenate([source.breaks[:-1], np.nextafter(source.breaks[1:], 0.0)])
    middle = 0.5 * (source.breaks[1:] + source.breaks[:-1])
    rise, narrowing = source.displaced(np.concatenate([inner, edges, middle]))
    return (float(np.min(rise)), float(np.max(rise))), (float(np.min(narrowing)), float(np.max(narrowing)))


def _polyline(position: FloatArray, *, at: FloatArray, height: FloatArray) -> FloatArray:
    return np.asarray(np.interp(position, at, height))
