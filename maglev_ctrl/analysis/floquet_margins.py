"""Margins of a loop with periodic terms: how far depth, gain or speed may go until a Floquet multiplier reaches one.

Every margin is a verified bracket with its tongue named, see `first_instability`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from maglev_ctrl.analysis.first_instability import PeriodicMargin, first_instability
from maglev_ctrl.analysis.floquet import floquet
from maglev_ctrl.analysis.resonance import resonant_pairs
from maglev_ctrl.analysis.tongue_search import Crossing, Path, pair_at
from maglev_ctrl.arrays import read_only_any
from maglev_ctrl.errors import ModelError, OutOfDomain
from maglev_ctrl.systems import Controller, PeriodicSystem

__all__ = [
    "FloquetMargins",
    "PeriodicLoop",
    "PeriodicMargin",
    "depth_margin",
    "first_instability",
    "floquet_margins",
    "gain_margins",
    "scaled_controller",
    "speed_margins",
]


class PeriodicLoop(Protocol):
    """A closed loop with periodic terms: its periodic system for a depth, a factor on the gain, and a speed (m/s)."""

    def __call__(self, *, depth: float, gain: float, speed: float) -> PeriodicSystem:
        """The periodic system at its actual depth."""


@dataclass(frozen=True, eq=False, slots=True)
class FloquetMargins:
    """All margins of one loop; `gain` and `speed` are (down, up), None where the loop is unstable at its own depth.

    `gain` is None too where no gain was asked for: a loop without a controller has none.
    """

    depth: PeriodicMargin
    gain: tuple[PeriodicMargin, PeriodicMargin] | None
    speed: tuple[PeriodicMargin, PeriodicMargin] | None


def floquet_margins(
    loop: PeriodicLoop, *, depth: float, speed: float, largest_depth: float,
    gain_limits: tuple[float, float] | None = (0.1, 10.0), speed_limits: tuple[float, float], samples: int = 48,
    max_order: int | None = None,
) -> FloquetMargins:  # fmt: skip
    """Depth, gain and speed margins of a loop about one operating point.

    Parameters
    ----------
    loop : see `PeriodicLoop`; gain 1 is the design
    depth, speed : the operating point (m/s)
    largest_depth : end of the search over depth
    gain_limits : factors between which the gain is searched, below and above 1; None: no gain to change
    speed_limits : m/s, below and above `speed`
    samples, max_order : see `first_instability`

    Raises
    ------
    NotStable : the loop is unstable without modulation at the design point
    ValueError : limits that do not enclose the operating point

    Examples
    --------
    >>> def loop(*, depth, gain, speed):
    ...     A_0 = [[0.0, 1.0], [-1.0, -0.02 * gain]]
    ...     return PeriodicSystem.from_matrices(A_0, [[[0.0, 0.0], [-depth, 0.0]]], frequency=speed)
    >>> found = floquet_margins(loop, depth=0.02, speed=2.0, largest_depth=0.2, speed_limits=(1.6, 2.4), samples=12)
    >>> round(found.depth.value, 4), round(found.gain[0].value, 3), found.speed[1].bound
    (0.04, 0.5, 'lower')
    """
    low, high = gain_limits or (0.5, 2.0)
    if not (0.0 < low < 1.0 < high and speed_limits[0] < speed < speed_limits[1] and speed_limits[0] > 0.0):
        raise ValueError("limits: expected gain limits around 1 and positive speed limits around the speed")
    at_depth = depth_margin(lambda e: loop(depth=e, gain=1.0, speed=speed), largest=largest_depth, samples=samples,
                            max_order=max_order)  # fmt: skip
    if floquet(loop(depth=depth, gain=1.0, speed=speed)).stable is False:
        return FloquetMargins(at_depth, None, None)
    gain = None if gain_limits is None else gain_margins(
        lambda k: loop(depth=depth, gain=k, speed=speed), limits=gain_limits, samples=samples, max_order=max_order,
    )  # fmt: skip
    over_speed = speed_margins(lambda v: loop(depth=depth, gain=1.0, speed=v), speed=speed, limits=speed_limits,
                               samples=samples, max_order=max_order)  # fmt: skip
    return FloquetMargins(at_depth, gain, over_speed)


def depth_margin(path: Path, *, largest: float, samples: int = 48, max_order: int | None = None) -> PeriodicMargin:
    """Smallest modulation depth that is lost, searched from 0 to `largest`; `path` gives the system at a depth.

    Tongues that the modulation itself shifts onto the passing frequency (the shift is of second order in the depth)
    are sought where perturbation theory puts them.

    Parameters
    ----------
    path : depth -> periodic system, stable at depth 0
    largest : end of the search
    samples, max_order : see `first_instability`

    Raises
    ------
    NotStable : unstable without modulation
    ValueError : `largest` is not positive

    Examples
    --------
    >>> A_0 = [[0.0, 1.0], [-1.0, -0.02]]
    >>> path = lambda e: PeriodicSystem.from_matrices(A_0, [[[0.0, 0.0], [-e, 0.0]]], frequency=2.0)
    >>> depth_margin(path, largest=0.1, samples=12).text
    'depth: lost between 0.0400006 and 0.040001 (2 w1/1)'
    """
    if not largest > 0.0:
        raise ValueError(f"largest: expected a positive depth, got {largest}")
    return first_instability(path, nominal=0.0, limit=largest, quantity="depth", samples=samples, max_order=max_order,
                             extra=_shifted_onto(path, largest, max_order))  # fmt: skip


def gain_margins(
    path: Path, *, limits: tuple[float, float] = (0.1, 10.0), samples: int = 48, max_order: int | None = None
) -> tuple[PeriodicMargin, PeriodicMargin]:
    """Factors on a gain, down and up from 1, at which stability is lost; `path` gives the system for a factor.

    Parameters
    ----------
    path : factor -> periodic system, stable at 1; see `scaled_controller`
    limits : smallest and largest factor
    samples, max_order : see `first_instability`

    Raises
    ------
    NotStable : unstable at factor 1
    """
    down, up = (
        first_instability(path, nominal=1.0, limit=end, quantity="gain factor", samples=samples, max_order=max_order,
                          spacing="log") for end in limits
    )  # fmt: skip
    return down, up


def speed_margins(
    path: Path, *, speed: float, limits: tuple[float, float], samples: int = 48, max_order: int | None = None
) -> tuple[PeriodicMargin, PeriodicMargin]:
    """Speeds below and above `speed` at which stability is lost, m/s; `path` gives the system at a speed.

    Parameters
    ----------
    path : speed -> periodic system at its depth, stable at `speed`
    speed : m/s
    limits : lowest and highest speed, m/s
    samples, max_order : see `first_instability`

    Raises
    ------
    NotStable : unstable at `speed`
    """
    down, up = (
        first_instability(path, nominal=speed, limit=end, quantity="speed", samples=samples, max_order=max_order)
        for end in limits
    )
    return down, up


def scaled_controller(controller: Controller, factor: float) -> Controller:
    """The controller with its commands multiplied by a factor.

    Examples
    --------
    >>> law = Controller.static([[-3.0]], measured=("q1",), commands=("force",))
    >>> scaled_controller(law, 2.0).D
    array([[-6.]])
    """
    return replace(controller, C=read_only_any(factor * controller.C), D=read_only_any(factor * controller.D))


def _shifted_onto(path: Path, largest: float, max_order: int | None) -> tuple[Crossing, ...]:
    """Tongues that the depth's own second-order shift carries onto the passing frequency, and the depth that does."""
    try:
        system = path(largest)
    except (ModelError, OutOfDomain):
        return ()
    s = np.linalg.eigvals(system.A_0)
    found = []
    for kind, i, j in resonant_pairs(int(np.sum(s.imag > 1e-9 * np.abs(s)))):
        for order in range(1, (max_order or 2 * len(system.A_cos)) + 1):
            known = pair_at(system, Crossing(kind, (i, j), order, largest))
            if known is None:
                continue
            coupling = known[0]
            apart = (coupling.s[0] - coupling.s[1]).imag - order * float(system.frequency)
            shift = coupling.detuning(1.0)
            if shift * apart < 0.0 and abs(apart) <= abs(shift):
                found.append(Crossing(kind, (i, j), order, largest * float(np.sqrt(-apart / shift))))
    return tuple(found)
