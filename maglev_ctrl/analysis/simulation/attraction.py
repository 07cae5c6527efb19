"""From how far a vehicle returns to its equilibrium: the region of attraction, sampled."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from maglev_ctrl.analysis.simulation.records import Event, Limits
from maglev_ctrl.analysis.simulation.run import simulate
from maglev_ctrl.arrays import FloatArray, read_only, read_only_any
from maglev_ctrl.systems import Controller
from maglev_ctrl.vehicle import Equilibrium, Vehicle

LATE = 0.1
"""Share of the duration, at its end, over which a motion must stay small to count as returned."""


@dataclass(frozen=True, eq=False, slots=True)
class Attraction:
    """Shares of starts that return, by size.

    `sizes` (k,) of the starts in units of the coordinates' scales; `share` (k,) with its exact binomial interval
    `lower`, `upper` (k,) (Clopper and Pearson); `returned` (k, d) by start; `directions` (d, coordinates) unit
    vectors; `events` of the runs that ended, run = size index * d + direction index. Points in time are finite: what
    has not returned within `duration` counts as not returned.
    """

    coordinates: tuple[str, ...]
    scales: FloatArray
    sizes: FloatArray
    share: FloatArray
    lower: FloatArray
    upper: FloatArray
    returned: FloatArray
    directions: FloatArray
    events: tuple[Event, ...]
    duration: float
    confidence: float

    @property
    def surest(self) -> float:
        """Largest size from which, as from all smaller ones, every start returned; 0 if there is none."""
        whole = np.cumprod(self.share == 1.0).astype(bool)
        return float(self.sizes[whole][-1]) if whole.any() else 0.0


def attraction(
    vehicle: Vehicle,
    equilibrium: Equilibrium,
    *,
    coordinates: Mapping[str, float],
    sizes: ArrayLike,
    duration: float,
    controller: Controller | None = None,
    directions: ArrayLike | None = None,
    samples: int = 30,
    seed: int = 0,
    limits: Limits | None = None,
    returned: float = 0.05,
    confidence: float = 0.95,
    sampling: float | None = None,
    computation: float = 0.0,
    step: float | None = None,
) -> Attraction:
    """Share of initial conditions of growing size that return to the equilibrium.

    Starts lie on spheres in the space of the chosen states divided by their scales: in random directions, or in those
    given. A start returns if nothing ends its run and all chosen states stay below `returned` times its size over the
    last tenth of the duration.

    Parameters
    ----------
    coordinates : chosen states (coordinates, "<coordinate>.velocity") and their scales
    sizes : (k,) positive, rising
    directions : (d, states); (1, ..) and (-1, ..) of each state alone are good ones
    samples : number of random directions
    duration, controller, limits, sampling, computation, step : as in `simulate`

    Raises
    ------
    ValueError : an unknown state, scales or sizes that are not positive, directions of the wrong shape
    """
    names, scales = tuple(coordinates), np.array([*coordinates.values()], dtype=np.float64)
    radii = read_only(sizes, name="sizes", shape=(None,))
    if radii.ndim != 1 or not len(radii) or radii[0] <= 0.0 or np.any(np.diff(radii) <= 0.0):
        raise ValueError(f"sizes: expected rising, positive sizes, got {np.asarray(sizes).tolist()}")
    if not len(names) or np.any(~(scales > 0.0)):
        raise ValueError(f"coordinates: expected states with positive scales, got {dict(coordinates)}")
    ways = _directions(directions, len(names), samples, seed)
    d = len(ways)
    starts = (radii[:, None, None] * ways * scales).reshape(-1, len(names))
    found = simulate(
        vehicle, equilibrium, duration=duration, controller=controller, runs=len(starts), seed=seed, limits=limits,
        start={name: starts[:, i] for i, name in enumerate(names)}, sampling=sampling, computation=computation,
        noise=False, signals=names, step=step,
    )  # fmt: skip
    late = np.stack([found.of(name) for name in names], axis=-1)[:, int((1.0 - LATE) * len(found.time)) :] / scales
    size = np.repeat(radii, d)
    with np.errstate(invalid="ignore"):
        # A run that ended early holds NaN, and NaN is not small.
        back = (np.max(np.linalg.norm(late, axis=-1), axis=1) <= returned * size).reshape(len(radii), d)
    counts, tail = back.sum(axis=1), 0.5 * (1.0 - confidence)
    lower = np.where(counts > 0, special.betaincinv(counts, d - counts + 1, tail), 0.0)
    upper = np.where(counts < d, special.betaincinv(counts + 1, d - counts, 1.0 - tail), 1.0)
    return Attraction(
        coordinates=names,
        scales=read_only(scales, name="scales"),
        sizes=radii,
        share=read_only_any(counts / d),
        lower=read_only_any(lower),
        upper=read_only_any(upper),
        returned=read_only_any(back),
        directions=read_only_any(ways),
        events=found.events,
        duration=duration,
        confidence=confidence,
    )


def _directions(given: ArrayLike | None, states: int, samples: int, seed: int) -> FloatArray:
    if given is None:
        if samples < 1:
            raise ValueError(f"samples: expected at least 1, got {samples}")
        ways = np.random.default_rng(seed).standard_normal((samples, states))
    else:
        ways = np.asarray(given, dtype=np.float64)
    if ways.ndim != 2 or ways.shape[1] != states or not np.all(np.linalg.norm(ways, axis=1) > 0.0):
        raise ValueError(f"directions: expected (d, {states}) vectors that are not zero, got shape {ways.shape}")
    return np.asarray(ways / np.linalg.norm(ways, axis=1, keepdims=True))


def axes_of(states: Sequence[str]) -> FloatArray:
    """Both ways along each state alone, (2 states, states), for `directions`.

    Examples
    --------
    >>> axes_of(("car.heave",)).tolist()
    [[1.0], [-1.0]]
    """
    unit = np.eye(len(states))
    return np.concatenate([unit, -unit])
