"""Monodromy matrix of one operating point as a function of modulation depth.

The monodromy matrix is an entire function of the depth: a short Chebyshev series, whose tail is the error estimate,
replaces an integration per depth. Where the tail does not fall, every depth is integrated directly.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from maglev_ctrl.analysis.floquet import plan_for, scaled_coefficients
from maglev_ctrl.arrays import ComplexArray, FloatArray
from maglev_ctrl.kernels import (
    ChebyshevSeries,
    TaylorPlan,
    chebyshev_series,
    eigen_triplets,
    monodromy_over_depths,
)
from maglev_ctrl.kernels.chebyshev import chebyshev_points

_MOST_NODES = 49
_NEUTRAL = 1e-6  # |largest Re eigenvalue of A_0| times the period below which a point counts as undamped
_NOISE = 1e-7  # growth per period that rounding can feign at the edge of an undamped tongue


@dataclass(frozen=True, eq=False, slots=True)
class DepthSurrogate:
    """Monodromy matrix over depths 0..`depth_max`, in balanced coordinates `A_0`, `A_cos`, `A_sin`.

    `series` is None where the Chebyshev tail did not fall; `error` is the relative error of the matrix, `nodes` the
    number of integrations, `threshold` the growth rate (1/s) above which the point is called unstable.
    """

    A_0: FloatArray
    A_cos: FloatArray
    A_sin: FloatArray
    frequency: float
    depth_max: float
    plan: TaylorPlan
    series: ChebyshevSeries | None
    error: float
    nodes: int
    needed: int
    abscissa: float
    threshold: float

    @property
    def period(self) -> float:
        """Period in s."""
        return float(2.0 * np.pi / self.frequency)

    def monodromy(self, depths: FloatArray) -> FloatArray:
        """Monodromy matrices (E, n, n)."""
        points = np.asarray(depths, dtype=np.float64)
        return self.series(points) if self.series is not None else self.direct(points)

    def direct(self, depths: FloatArray) -> FloatArray:
        """Monodromy matrices (E, n, n) by integration at every depth."""
        return monodromy_over_depths(
            self.A_0, self.A_cos, self.A_sin, frequency=self.frequency, depths=depths, plan=self.plan
        )

    def leading(self, depths: FloatArray) -> ComplexArray:
        """The multiplier of largest modulus for each depth (E,)."""
        multipliers = np.linalg.eigvals(self.monodromy(depths))
        chosen = np.argmax(np.abs(multipliers), axis=1)
        return np.asarray(multipliers[np.arange(len(multipliers)), chosen].astype(complex))

    def growth(self, depths: FloatArray) -> FloatArray:
        """Growth rate for each depth (E,), 1/s."""
        return np.asarray(np.log(np.maximum(np.abs(self.leading(depths)), 1e-300)) / self.period)

    def growth_error(self) -> float:
        """Error of the growth rate, 1/s: matrix error times the condition of the leading multiplier at full depth."""
        matrix = self.monodromy(np.array([self.depth_max]))[0]
        values, left, right = eigen_triplets(matrix)
        worst = int(np.argmax(np.abs(values)))
        overlap = max(abs(np.vdot(left[:, worst], right[:, worst])), 1e-16)
        relative = self.error * float(np.linalg.norm(matrix, 2)) / max(abs(values[worst]), 1e-300)
        return float(min(relative / overlap, 10.0 * np.sqrt(relative)) / self.period)


def depth_surrogate(
    A_0: FloatArray, A_cos: FloatArray, A_sin: FloatArray, *, frequency: float, depth_max: float,
    tolerance: float = 1e-11, first_nodes: int = 9,
) -> DepthSurrogate:  # fmt: skip
    """Monodromy over depth for one operating point.

    Parameters
    ----------
    A_0 : (n, n); A_cos, A_sin : (H, n, n) at unit depth, 1/s
    frequency : rad/s
    depth_max : largest depth wanted
    tolerance : relative tail of the Chebyshev series allowed
    first_nodes : nodes tried first; doubled until the tail is small enough, at most 49

    Examples
    --------
    >>> A_1 = np.array([[[0.0, 0.0], [-1.0, 0.0]]])
    >>> surrogate = depth_surrogate(np.array([[0.0, 1.0], [-1.0, 0.0]]), A_1, 0 * A_1, frequency=2.0, depth_max=0.5)
    >>> round(float(surrogate.growth(np.array([0.4]))[0]), 6)
    0.099536
    """
    A_0, A_cos, A_sin = scaled_coefficients(A_0, A_cos, A_sin, depth=depth_max)
    plan = plan_for(A_0, A_cos, A_sin, frequency=frequency, depth=depth_max, tolerance=1e-14)
    count = max(5, first_nodes)
    series: ChebyshevSeries | None = None
    values = np.empty((0, *A_0.shape))
    while True:
        nodes = chebyshev_points(count, lower=0.0, upper=depth_max)
        fresh = slice(1, None, 2) if len(values) else slice(None)
        added = monodromy_over_depths(A_0, A_cos, A_sin, frequency=frequency, depths=nodes[fresh], plan=plan)
        values = _interleave(values, added) if len(values) else added
        series = chebyshev_series(values, lower=0.0, upper=depth_max)
        if series.tail <= tolerance or 2 * count - 1 > _MOST_NODES:
            break
        count = 2 * count - 1
    rounding = plan.segments * plan.truncation + 1e-14 * np.sqrt(plan.segments)
    trusted = series.tail <= tolerance
    period = 2.0 * np.pi / frequency
    abscissa = float(np.max(np.linalg.eigvals(A_0).real))
    return DepthSurrogate(
        A_0, A_cos, A_sin, frequency, depth_max, plan, series if trusted else None,
        error=rounding + (series.tail if trusted else 0.0), nodes=count, needed=_needed(series, tolerance),
        abscissa=abscissa, threshold=_NOISE / period if abs(abscissa) * period < _NEUTRAL else 0.0,
    )  # fmt: skip


def _interleave(old: FloatArray, added: FloatArray) -> FloatArray:
    joined = np.empty((len(old) + len(added), *old.shape[1:]))
    joined[0::2], joined[1::2] = old, added
    return joined


def _needed(series: ChebyshevSeries, tolerance: float) -> int:
    """Nodes that would have been enough: a first guess for the neighbouring operating point."""
    norms = np.sqrt(np.sum(series.coefficients.reshape(len(series.coefficients), -1) ** 2, axis=1))
    above = np.nonzero(norms > 0.1 * tolerance * np.max(norms))[0]
    return int(above[-1]) + 3
