"""What every magnet force model offers: forces and their partials at a height, a gap and a speed."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from maglev_ctrl.arrays import FloatArray, read_only
from maglev_ctrl.errors import OutOfDomain

EDGE_TOLERANCE = 1e-9
"""Relative slack at the ends of a domain: unit conversions round, and a rounded end point is still data."""


@dataclass(frozen=True, eq=False, slots=True)
class Domain:
    """Where a force model is defined: closed ranges of height (m), gap (m; None = does not matter), speed (m/s).

    A height of zero is contact and always outside.

    Examples
    --------
    >>> Domain(height=(0.005, 0.05), gap=None, speed=(10.0, 100.0)).require(0.02, None, 150.0)
    Traceback (most recent call last):
        ...
    maglev_ctrl.errors.OutOfDomain: speed 150 m/s is outside the model's range 10 to 100 m/s
    """

    height: tuple[float, float]
    gap: tuple[float, float] | None
    speed: tuple[float, float]

    def __post_init__(self) -> None:
        for name, span in (("height", self.height), ("gap", self.gap), ("speed", self.speed)):
            if span is not None and not span[0] <= span[1]:
                raise ValueError(f"{name}: expected a range (lower, upper), got {span}")
        if self.height[0] < 0.0:
            raise ValueError(f"height: expected a range of positive heights, got {self.height}")

    def require(self, height: ArrayLike, gap: ArrayLike | None, speed: ArrayLike) -> None:
        """Refuse points outside; a gap range with no gap given is wrong use.

        Parameters
        ----------
        height, gap, speed : (...) m, m, m/s; gap may be None where `self.gap` is None

        Raises
        ------
        OutOfDomain : a value outside its range, or not a number
        ValueError : the model depends on the gap and none was given
        """
        _require("height", height, self.height, "m")
        heights = np.asarray(height, dtype=np.float64)
        if np.any(heights <= 0.0):
            raise OutOfDomain(f"height {np.min(heights):.6g} m: the height must be positive, zero is contact")
        if self.gap is not None:
            if gap is None:
                raise ValueError("gap: this force model depends on the guidance gap; expected a value in m, got None")
            _require("gap", gap, self.gap, "m")
        _require("speed", speed, self.speed, "m/s")


def _require(name: str, value: ArrayLike, span: tuple[float, float], unit: str) -> None:
    values = np.asarray(value, dtype=np.float64)
    slack = [EDGE_TOLERANCE * abs(end) if np.isfinite(end) else 0.0 for end in span]
    # Not a number is never inside.
    if span[0] - slack[0] <= values.min(initial=np.inf) and values.max(initial=-np.inf) <= span[1] + slack[1]:
        return
    values = np.atleast_1d(values)
    outside = ~((values >= span[0] - slack[0]) & (values <= span[1] + slack[1]))
    worst = values[outside].flat[0]
    raise OutOfDomain(
        f"{name} {worst:.10g} {unit} is outside the model's range {span[0]:.10g} to {span[1]:.10g} {unit}"
    )


@dataclass(frozen=True, eq=False, slots=True)
class MagnetForces:
    """Forces of one magnet, N, all of one shape (...).

    Lift is positive upwards, guidance positive when it repels from the wall, drag positive when it opposes motion.
    The same record carries partial derivatives (N per unit) and fit errors (N).

    Examples
    --------
    >>> MagnetForces(lift=[1.0, 2.0], guidance=0.0, drag=0.5).guidance.shape
    (2,)
    """

    lift: FloatArray
    guidance: FloatArray
    drag: FloatArray

    def __post_init__(self) -> None:
        parts = [np.asarray(getattr(self, name), dtype=np.float64) for name in ("lift", "guidance", "drag")]
        shape = parts[0].shape
        if not shape == parts[1].shape == parts[2].shape:
            shape = np.broadcast_shapes(*(part.shape for part in parts))
        for name, part in zip(("lift", "guidance", "drag"), parts, strict=True):
            object.__setattr__(self, name, _settled(part, shape=shape, name=name))

    def scaled(self, factor: ArrayLike) -> MagnetForces:
        """Every force times `factor` (...)."""
        share = np.asarray(factor, dtype=np.float64)
        return MagnetForces(lift=share * self.lift, guidance=share * self.guidance, drag=share * self.drag)


def _settled(part: FloatArray, *, shape: tuple[int, ...], name: str) -> FloatArray:
    """A read-only array of the shape; one that already is, and owns its data, is shared and not copied."""
    if part.shape != shape:
        spread = np.empty(shape)
        spread[...] = part
        return read_only(spread, name=name)
    if part.base is None and not part.flags.writeable:
        return part
    return read_only(part, name=name)


@dataclass(frozen=True, eq=False, slots=True)
class MagnetDerivatives:
    """Partial derivatives of the forces of one magnet.

    `by_height` and `by_gap` in N/m; `by_speed`, `by_vertical_velocity` (magnet moving up) and `by_lateral_velocity`
    (gap widening) in N s/m. The last two are zero in the quasi-static theory (Eq. 4) unless a model provides them.
    The drag-direction term -D/v0 of a lateral velocity belongs to the assembly, not to the force model.
    """

    by_height: MagnetForces
    by_gap: MagnetForces
    by_speed: MagnetForces
    by_vertical_velocity: MagnetForces
    by_lateral_velocity: MagnetForces

    def scaled(self, factor: ArrayLike) -> MagnetDerivatives:
        """Every partial times `factor` (...)."""
        return MagnetDerivatives(
            by_height=self.by_height.scaled(factor),
            by_gap=self.by_gap.scaled(factor),
            by_speed=self.by_speed.scaled(factor),
            by_vertical_velocity=self.by_vertical_velocity.scaled(factor),
            by_lateral_velocity=self.by_lateral_velocity.scaled(factor),
        )


def no_forces(shape: tuple[int, ...]) -> MagnetForces:
    """Zero lift, guidance and drag of a shape.

    Examples
    --------
    >>> no_forces((2,)).lift.tolist()
    [0.0, 0.0]
    """
    zero = read_only(np.zeros(shape), name="zero")
    return MagnetForces(lift=zero, guidance=zero, drag=zero)


def checked_factor(factor: ArrayLike) -> FloatArray:
    """A scale factor of a magnet's strength: finite and not negative.

    Raises
    ------
    ValueError : a factor that is negative or not finite
    """
    share = read_only(factor, name="factor")
    if np.any(share < 0.0):
        raise ValueError(f"factor: expected a factor that is not negative, got {np.min(share):.6g}")
    return share


class AbstractForceModel(ABC):
    """Forces of one magnet over a guideway in steady forward motion (quasi-static theory, Eqs. 4 and 5)."""

    __slots__ = ()

    @property
    @abstractmethod
    def domain(self) -> Domain:
        """Where the model is defined; outside it nothing is extrapolated."""

    @property
    def hangs(self) -> bool:
        """Whether the magnet hangs under its guideway: its height is the gap below the rail, less where it rises."""
        return False

    @abstractmethod
    def forces(self, height: ArrayLike, gap: ArrayLike | None, speed: ArrayLike) -> MagnetForces:
        """Lift, guidance and drag.

        Parameters
        ----------
        height : (...) levitation height, m
        gap : (...) guidance gap, m; None for a model without guidance
        speed : (...) forward speed, m/s

        Raises
        ------
        OutOfDomain : a point outside `domain`
        """

    @abstractmethod
    def derivatives(self, height: ArrayLike, gap: ArrayLike | None, speed: ArrayLike) -> MagnetDerivatives:
        """Partial derivatives of the forces at the same arguments as `forces`."""

    @abstractmethod
    def scaled(self, factor: ArrayLike) -> AbstractForceModel:
        """The same magnet with every force times `factor` (scalar, or an array that broadcasts with the arguments)."""
