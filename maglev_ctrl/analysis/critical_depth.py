"""Smallest modulation depth that makes a periodic system unstable, and the resonance that does it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from maglev_ctrl.analysis.depth_surrogate import DepthSurrogate, depth_surrogate
from maglev_ctrl.analysis.resonance import NO_RESONANCE, Resonance, state_modes
from maglev_ctrl.analysis.resonance_naming import name_exponent
from maglev_ctrl.arrays import FloatArray, read_only, read_only_any
from maglev_ctrl.systems import PeriodicSystem

_SCAN = 65


@dataclass(frozen=True, slots=True)
class CriticalDepth:
    """`depth` where instability begins (inf: none up to `depth_max`; 0: unstable without modulation), and its name."""

    depth: float
    resonance: Resonance
    unstable_at_zero: bool
    depth_max: float

    @property
    def text(self) -> str:
        """The result in words.

        Examples
        --------
        >>> CriticalDepth(float("inf"), NO_RESONANCE, False, 0.2).text
        'stable up to depth 0.2'
        """
        if self.unstable_at_zero:
            return "unstable without modulation"
        if np.isinf(self.depth):
            return f"stable up to depth {self.depth_max:g}"
        return f"unstable from depth {self.depth:.4g} ({self.resonance.name})"


@dataclass(frozen=True, eq=False, slots=True)
class CriticalDepthCurve:
    """Critical depth over a parameter: `depth` (V,), `resonances` (V), `unstable_at_zero` (V,)."""

    parameter: FloatArray
    depth: FloatArray
    resonances: tuple[Resonance, ...]
    unstable_at_zero: np.ndarray[tuple[int, ...], np.dtype[np.bool_]]
    depth_max: float


def critical_depth(system: PeriodicSystem, *, depth_max: float, labels: tuple[str, ...] | None = None) -> CriticalDepth:
    """Smallest depth in 0..depth_max at which `system`, its modulation scaled by the depth, stops being stable.

    Parameters
    ----------
    system : one periodic system with the modulation at unit depth
    depth_max : largest depth searched
    labels : names of the oscillating modes of A_0 in order of frequency

    Raises
    ------
    ValueError : depth_max is not positive, or the system carries batch axes

    Examples
    --------
    >>> damped = PeriodicSystem.from_matrices([[0, 1], [-1, -0.02]], [[[0, 0], [-1, 0]]], frequency=2.0)
    >>> critical_depth(damped, depth_max=0.2).text
    'unstable from depth 0.04 (2 w1/1)'
    """
    if system.A_0.ndim != 2 or system.A_cos.ndim != 3 or system.frequency.ndim != 0:
        raise ValueError("system: expected one periodic system, got batch axes; see critical_depth_curve")
    _require_positive(depth_max)
    surrogate = depth_surrogate(
        system.A_0, system.A_cos, system.A_sin, frequency=float(system.frequency), depth_max=depth_max
    )
    return critical_of(surrogate, states=system.states, labels=labels)


def critical_depth_curve(
    A_0: FloatArray, A_cos: FloatArray, A_sin: FloatArray, frequency: FloatArray, *, depth_max: float,
    parameter: FloatArray, states: tuple[str, ...] = (), labels: tuple[str, ...] | None = None,
) -> CriticalDepthCurve:  # fmt: skip
    """Critical depth at every value of a parameter (speed).

    Parameters
    ----------
    A_0 : (V, n, n); A_cos, A_sin : (V, H, n, n) at unit depth, 1/s
    frequency : (V,) rad/s
    depth_max : largest depth searched
    parameter : (V,) its values

    Raises
    ------
    ValueError : a shape does not fit, or depth_max is not positive

    Examples
    --------
    >>> A_0 = np.broadcast_to(np.array([[0.0, 1.0], [-1.0, -0.02]]), (2, 2, 2))
    >>> A_1 = np.broadcast_to(np.array([[0.0, 0.0], [-1.0, 0.0]]), (2, 1, 2, 2))
    >>> curve = critical_depth_curve(A_0, A_1, 0 * A_1, np.array([2.0, 5.0]), depth_max=0.2,
    ...                              parameter=np.array([10.0, 25.0]))
    >>> [round(float(d), 4) for d in curve.depth]
    [0.04, inf]
    """
    _require_positive(depth_max)
    values = read_only(parameter, name="parameter", shape=(None,))
    count = len(values)
    n = A_0.shape[-1]
    A_0 = read_only(A_0, name="A_0", shape=(count, n, n))
    A_cos = read_only(A_cos, name="A_cos", shape=(count, None, n, n))
    A_sin = read_only(A_sin, name="A_sin", shape=(count, A_cos.shape[1], n, n))
    omega = read_only(frequency, name="frequency", shape=(count,))
    nodes, found = 9, []
    for k in range(count):
        surrogate = depth_surrogate(
            A_0[k], A_cos[k], A_sin[k], frequency=float(omega[k]), depth_max=depth_max, first_nodes=nodes
        )
        nodes = surrogate.needed
        found.append(critical_of(surrogate, states=states, labels=labels))
    return CriticalDepthCurve(
        parameter=values,
        depth=read_only_any([one.depth for one in found]),
        resonances=tuple(one.resonance for one in found),
        unstable_at_zero=read_only_any([one.unstable_at_zero for one in found]),
        depth_max=depth_max,
    )


def critical_of(
    surrogate: DepthSurrogate, *, states: tuple[str, ...] = (), labels: tuple[str, ...] | None = None,
    named: bool = True,
) -> CriticalDepth:  # fmt: skip
    """Critical depth from a depth surrogate: scan, refinement at near misses, bisection."""
    if surrogate.abscissa > max(surrogate.threshold, 1e-12):
        return CriticalDepth(0.0, NO_RESONANCE, True, surrogate.depth_max)
    bracket = _bracket(surrogate)
    if bracket is None:
        return CriticalDepth(float("inf"), NO_RESONANCE, False, surrogate.depth_max)
    depth, beyond = _bisect(surrogate, *bracket)
    resonance = name_at(surrogate, beyond, states=states, labels=labels) if named else NO_RESONANCE
    return CriticalDepth(depth, resonance, False, surrogate.depth_max)


def name_at(
    surrogate: DepthSurrogate, depth: float, *, states: tuple[str, ...] = (), labels: tuple[str, ...] | None = None
) -> Resonance:
    """The resonance behind the leading multiplier at one depth."""
    exponent = complex(np.log(surrogate.leading(np.array([depth]))[0]) / surrogate.period)
    modes = state_modes(surrogate.A_0, states=states, labels=labels)
    return name_exponent(
        surrogate.A_0, depth * surrogate.A_cos, depth * surrogate.A_sin, frequency=surrogate.frequency,
        exponent=exponent, modes=modes,
    )  # fmt: skip


def _bracket(surrogate: DepthSurrogate) -> tuple[float, float] | None:
    """A stable depth and the next unstable one; narrow unstable intervals are looked for at the local maxima."""
    depths = np.linspace(0.0, surrogate.depth_max, _SCAN)
    above = surrogate.growth(depths) - surrogate.threshold
    above[0] = min(above[0], -1e-300)
    for _ in range(3):
        first = np.nonzero(above > 0.0)[0]
        last = int(first[0]) if len(first) else len(depths) - 1
        peaks = [i for i in range(1, last) if above[i] >= above[i - 1] and above[i] > above[i + 1]]
        if not peaks:
            break
        finer = np.unique(np.concatenate([np.linspace(depths[i - 1], depths[i + 1], 9) for i in peaks]))
        finer = np.setdiff1d(finer, depths)
        order = np.argsort(np.concatenate([depths, finer]), kind="stable")
        above = np.concatenate([above, surrogate.growth(finer) - surrogate.threshold])[order]
        depths = np.concatenate([depths, finer])[order]
    first = np.nonzero(above > 0.0)[0]
    return (float(depths[first[0] - 1]), float(depths[first[0]])) if len(first) else None


def _bisect(surrogate: DepthSurrogate, stable: float, unstable: float) -> tuple[float, float]:
    """Depth of the crossing, and a depth just beyond it that is unstable; regula falsi with bisection as guard."""
    for _ in range(6):
        points = np.linspace(stable, unstable, 34)[1:-1]
        above = surrogate.growth(points) - surrogate.threshold
        first = np.nonzero(above > 0.0)[0]
        edge = int(first[0]) if len(first) else len(points)
        stable, unstable = (
            float(points[edge - 1]) if edge > 0 else stable,
            float(points[edge]) if edge < len(points) else unstable,
        )
        if unstable - stable <= 1e-13 * surrogate.depth_max:
            break
    return 0.5 * (stable + unstable), unstable


def _require_positive(depth_max: float) -> None:
    if not depth_max > 0.0:
        raise ValueError(f"depth_max: expected a positive depth, got {depth_max}")
