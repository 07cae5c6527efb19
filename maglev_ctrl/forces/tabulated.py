"""Force model from measured or computed tables, with its domain and its errors on record."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal, assert_never

import numpy as np
from numpy.typing import ArrayLike

from maglev_ctrl.arrays import FloatArray, read_only
from maglev_ctrl.forces.base import (
    AbstractForceModel,
    Domain,
    MagnetDerivatives,
    MagnetForces,
    checked_factor,
    no_forces,
)
from maglev_ctrl.forces.polynomial import PolynomialSurface, fit_polynomial
from maglev_ctrl.forces.samples import Axis, Samples, as_grid, as_samples
from maglev_ctrl.forces.spline import SplineSurface, fit_spline, halved_grid_errors

Method = Literal["spline", "polynomial"]
Check = Literal["leave-one-out", "halved grid", "none"]

DEFAULT_DEGREE = 4


@dataclass(frozen=True, eq=False, slots=True)
class FitQuality:
    """How well a fit keeps its samples (N, per force), and how well it predicts samples it was not shown.

    `residual_*` is fit minus sample; `check_*` comes from `check`: leave-one-out for a polynomial, a spline through
    every second grid line for a spline (pessimistic), None where the table is too small for any check.
    """

    samples: int
    residual_max: MagnetForces
    residual_rms: MagnetForces
    check: Check
    check_max: MagnetForces | None
    check_rms: MagnetForces | None


@dataclass(frozen=True, eq=False, slots=True)
class TabulatedForce(AbstractForceModel):
    """Lift, guidance and drag fitted to samples; defined on the box the samples span, and nowhere else.

    Build it with `from_samples`.

    Examples
    --------
    >>> height = [0.01, 0.02, 0.03, 0.04]
    >>> table = TabulatedForce.from_samples(height, None, 30.0, lift=[8.0, 4.0, 2.0, 1.0], drag=[4.0, 2.0, 1.0, 0.5])
    >>> round(float(table.forces(0.02, None, 30.0).lift), 12)
    4.0
    >>> table.forces(0.05, None, 30.0)
    Traceback (most recent call last):
        ...
    maglev_ctrl.errors.OutOfDomain: height 0.05 m is outside the model's range 0.01 to 0.04 m
    """

    domain: Domain = field()  # field() hides the property of the base, which would count as a default
    surface: SplineSurface | PolynomialSurface
    method: Method
    quality: FitQuality
    strength: FloatArray = field(default_factory=lambda: read_only(1.0, name="strength"))

    @classmethod
    def from_samples(
        cls,
        height: ArrayLike,
        gap: ArrayLike | None,
        speed: ArrayLike,
        *,
        lift: ArrayLike,
        drag: ArrayLike,
        guidance: ArrayLike | None = None,
        method: Method = "spline",
        degree: int = DEFAULT_DEGREE,
        constant: tuple[Axis, ...] = (),
    ) -> TabulatedForce:
        """A force model from a table.

        Either rows, every argument (N,), in any order; or a grid, strictly increasing axes `height` (H,), `gap` (G,),
        `speed` (V,) and forces (H, G, V). A spline needs every combination of a regular grid exactly once; a polynomial
        takes scattered rows. An axis with one value is constant: its partial is zero, and only that value is in the
        domain, unless `constant` names it.

        Parameters
        ----------
        height, gap, speed : m, m, m/s; gap None for a table without a gap
        lift, guidance, drag : N; guidance left out is zero
        method : "spline" (through every sample; cubic with four values or more on an axis, lower with fewer) or
            "polynomial" (least squares)
        degree : total degree of the polynomial
        constant : axes ("height", "gap", "speed") with one value that holds everywhere

        Raises
        ------
        ValueError : NaN, doubled or unsorted points, an incomplete grid, too few samples, guidance without a gap

        Examples
        --------
        >>> axis = np.linspace(0.01, 0.03, 5)
        >>> lift = np.broadcast_to((0.1 / axis)[:, None, None], (5, 5, 1))
        >>> table = TabulatedForce.from_samples(axis, axis, 30.0, lift=lift, guidance=lift * 0.3, drag=lift * 0.5)
        >>> table.domain.gap, table.quality.check
        ((0.01, 0.03), 'halved grid')
        """
        if method not in ("spline", "polynomial"):
            raise ValueError(f"method: expected 'spline' or 'polynomial', got {method!r}")
        samples = as_samples(height, gap, speed, lift=lift, guidance=guidance, drag=drag)
        domain = _domain(samples, constant=constant)
        surface: SplineSurface | PolynomialSurface
        errors: FloatArray | None
        match method:
            case "spline":
                axes, values = as_grid(samples)
                surface, errors = fit_spline(axes, values), halved_grid_errors(axes, values)
                check: Check = "none" if errors is None else "halved grid"
            case "polynomial":
                surface, errors = fit_polynomial(samples.points, samples.values, degree=degree)
                check = "leave-one-out"
            case _ as never:
                assert_never(never)
        residuals = surface.value(samples.points) - samples.values
        quality = FitQuality(
            samples=len(samples.points),
            residual_max=_largest(residuals),
            residual_rms=_root_mean_square(residuals),
            check=check,
            check_max=None if errors is None else _largest(errors),
            check_rms=None if errors is None else _root_mean_square(errors),
        )
        return cls(domain=domain, surface=surface, method=method, quality=quality)

    def forces(self, height: ArrayLike, gap: ArrayLike | None, speed: ArrayLike) -> MagnetForces:
        """Fitted lift, guidance and drag."""
        return self._forces(self._points(height, gap, speed), derivative=None)

    def derivatives(self, height: ArrayLike, gap: ArrayLike | None, speed: ArrayLike) -> MagnetDerivatives:
        """Analytic partials of the fit; a table has none by vertical or lateral velocity."""
        points = self._points(height, gap, speed)
        by_height, by_gap, by_speed = (self._forces(points, derivative=axis) for axis in range(3))
        nothing = no_forces(by_height.lift.shape)
        return MagnetDerivatives(
            by_height=by_height,
            by_gap=by_gap,
            by_speed=by_speed,
            by_vertical_velocity=nothing,
            by_lateral_velocity=nothing,
        )

    def scaled(self, factor: ArrayLike) -> TabulatedForce:
        """The same table with every force times `factor`; the recorded errors stay those of the table.

        Examples
        --------
        >>> table = TabulatedForce.from_samples([0.01, 0.02], None, [30.0, 30.0], lift=[2.0, 1.0], drag=[1.0, 0.5])
        >>> float(table.scaled(3.0).forces(0.01, None, 30.0).lift)
        6.0
        """
        return replace(self, strength=read_only(self.strength * checked_factor(factor), name="strength"))

    def _points(self, height: ArrayLike, gap: ArrayLike | None, speed: ArrayLike) -> FloatArray:
        """Points (..., 3) clipped to the box by no more than the slack of the domain."""
        self.domain.require(height, gap, speed)
        gaps = np.zeros(()) if gap is None else np.asarray(gap, dtype=np.float64)
        given = np.broadcast_arrays(np.asarray(height, dtype=np.float64), gaps, np.asarray(speed, dtype=np.float64))
        spans = (self.domain.height, self.domain.gap or (-np.inf, np.inf), self.domain.speed)
        return np.stack([np.clip(one, *span) for one, span in zip(given, spans, strict=True)], axis=-1)

    def _forces(self, points: FloatArray, *, derivative: int | None) -> MagnetForces:
        values = self.surface.value(points, derivative=derivative)
        lift, guidance, drag = (self.strength * values[..., i] for i in range(3))
        return MagnetForces(lift=lift, guidance=guidance, drag=drag)


def _domain(samples: Samples, *, constant: tuple[Axis, ...]) -> Domain:
    spans: dict[str, tuple[float, float]] = {}
    names: tuple[Axis, ...] = ("height", "gap", "speed")
    for axis, name in enumerate(names):
        column = samples.points[:, axis]
        spans[name] = (float(column.min()), float(column.max()))
        if name in constant:
            if spans[name][0] != spans[name][1]:
                raise ValueError(f"constant: expected an axis with one value, got {name!r} with several")
            spans[name] = (0.0 if name == "height" else -np.inf, np.inf)
    unknown = sorted(set(constant) - set(names))
    if unknown:
        raise ValueError(f"constant: expected names out of {names}, got {unknown[0]!r}")
    has_gap = samples.has_gap and "gap" not in constant
    return Domain(height=spans["height"], gap=spans["gap"] if has_gap else None, speed=spans["speed"])


def _largest(errors: FloatArray) -> MagnetForces:
    lift, guidance, drag = np.max(np.abs(errors), axis=0)
    return MagnetForces(lift=lift, guidance=guidance, drag=drag)


def _root_mean_square(errors: FloatArray) -> MagnetForces:
    lift, guidance, drag = np.sqrt(np.mean(errors**2, axis=0))
    return MagnetForces(lift=lift, guidance=guidance, drag=drag)
