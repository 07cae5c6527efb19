"""First-order centre and half-width of a tongue over the parameter of a path, slope of the Campbell curve included."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from maglev_ctrl.analysis.resonance import (
    Resonance,
    make_resonance,
    modal_harmonics,
    pair_indices,
    pair_interval,
    state_modes,
)
from maglev_ctrl.analysis.tongue_search import Crossing, Track

_UNDAMPED = 1e-9


@dataclass(frozen=True, slots=True)
class FirstOrder:
    """One tongue by first-order theory: its name, `centre` and `half_width` (parameter; half-width 0 below the
    threshold, inf without an edge, NaN where the order has no first-order term), `decay` rates of the two modes (1/s),
    `product` of their couplings (1/s^2), and `slope`: how fast the resonant frequency leaves the passing frequency
    (rad/s per unit of the parameter, with its sign).
    """

    resonance: Resonance
    centre: float
    half_width: float
    decay: tuple[float, float]
    product: complex
    slope: float


def first_order(track: Track, one: Crossing, *, depth: float = 1.0) -> FirstOrder:
    """The first-order tongue at a crossing, the modulation of the path's systems times `depth`.

    Parameters
    ----------
    track : the path, with an answer at the crossing
    one : see `find_crossings`
    depth : 1 for a path at its actual depth

    Examples
    --------
    >>> from maglev_ctrl.systems import PeriodicSystem
    >>> A_1 = [[[0.0, 0.0], [-0.1, 0.0]]]
    >>> track = Track(lambda v: PeriodicSystem.from_matrices([[0, 1], [-1, 0]], A_1, frequency=2.0 * v))
    >>> _ = track.system(0.9), track.system(1.1)
    >>> found = first_order(track, Crossing("parametric", (0, 0), 1, 1.0))
    >>> found.resonance.name, round(found.half_width, 6), round(found.slope, 6)
    ('2 w1/1', 0.025, -2.0)
    """
    system = track.system(one.at)
    assert system is not None
    modes = state_modes(system.A_0, states=system.states)
    first, second, distance = pair_indices(modes, one.kind, *one.modes)
    a, b = (0.0 if abs(s.real) <= _UNDAMPED * abs(s) else -float(s.real) for s in modes.s[[first, second]])
    resonance = make_resonance(one.kind, one.order, (one.modes[0] + 1, one.modes[1] + 1), modes.labels,
                               frequency=distance / one.order)  # fmt: skip
    slope, nan = slope_at(track, one), float("nan")
    if one.order > len(system.A_cos):
        return FirstOrder(resonance, nan, nan, (a, b), complex(nan), slope)
    couplings = modal_harmonics(modes, depth * system.A_cos, depth * system.A_sin)
    product = complex(couplings[one.order][first, second] * couplings[-one.order][second, first])
    shift, half = pair_interval(a, b, product)
    # the tongue lies where the passing frequency exceeds the resonant one by shift / order
    centre = one.at - shift / one.order / slope if np.isfinite(half) else nan
    return FirstOrder(resonance, centre, float(half / one.order / abs(slope)), (a, b), product, slope)


def slope_at(track: Track, one: Crossing) -> float:
    """How fast the resonant frequency leaves the passing frequency at a crossing, rad/s per unit; NaN: not known."""
    known = sorted(v for v, system in track.systems.items() if system is not None)
    left = max((v for v in known if v < one.at - 1e-6 * abs(one.at)), default=one.at)
    right = min((v for v in known if v > one.at + 1e-6 * abs(one.at)), default=one.at)
    gaps = [gap_at(track, one, v) for v in (left, right)]
    return (gaps[1] - gaps[0]) / (right - left) if right > left else float("nan")


def gap_at(track: Track, one: Crossing, parameter: float) -> float:
    """Resonant frequency minus passing frequency, rad/s; NaN where there is no such pair or no answer."""
    system = track.system(parameter)
    if system is None:
        return float("nan")
    s = np.linalg.eigvals(system.A_0)
    w = np.sort(s.imag[s.imag > 1e-9 * np.abs(s)])
    if len(w) <= max(one.modes):
        return float("nan")
    sign = -1.0 if one.kind == "difference" else 1.0
    return float(abs(w[one.modes[1]] + sign * w[one.modes[0]]) / one.order - float(system.frequency))
