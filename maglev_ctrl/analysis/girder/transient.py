"""One step or ramp of the guideway, met once: the response from rest, exact by exponentials."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from scipy import linalg

from maglev_ctrl.analysis.girder.drive import DrivenSystem
from maglev_ctrl.analysis.girder.passing import driven_system
from maglev_ctrl.analysis.girder.shapes import PieceShape
from maglev_ctrl.arrays import FloatArray, read_only
from maglev_ctrl.systems import SecondOrderSystem

_PER_CYCLE: Final = 40
_MOST: Final = 200_000
_REFINED: Final = 40


@dataclass(frozen=True, eq=False, slots=True)
class StepPeak:
    """Largest modulus of one output while a step passes, at a `time` (s) after the first element met its start.

    `settled` is the value that remains, `bound` an upper bound on the modulus after the time looked at.
    """

    name: str
    peak: float
    time: float
    settled: float
    bound: float
    reason: str


@dataclass(frozen=True, eq=False, slots=True)
class StepResponse:
    """Response to one step: `times` (k,) s, `values` (outputs, k), and the peaks."""

    speed: float
    times: FloatArray
    values: FloatArray
    peaks: tuple[StepPeak, ...]


def step_response_peak(
    closed: SecondOrderSystem,
    *,
    height: float,
    length: float,
    speed: float,
    places: Mapping[str, float],
    outputs: Sequence[str],
) -> StepResponse:
    """Peaks while a vehicle at rest on a level guideway meets one step up, drawn out over a length.

    The front meets it first, every element behind it (front - x_i)/v later. Samples lie at most a fortieth of the
    fastest oscillation apart, each exact; the largest is climbed to its top. The time looked at ends where what is
    left of all modes is bounded below half of every peak.

    Parameters
    ----------
    height : m
    length : over which the guideway rises evenly, m; zero for an abrupt step
    speed : m/s
    places, outputs : see `passing_response`

    Raises
    ------
    NotStable : the loop has a root that does not decay
    ValueError : a length that is negative, and see `passing_response`

    Examples
    --------
    >>> car = SecondOrderSystem.from_matrices([[1.0]], [[0.0002]], [[1.0]], dofs=("z",), guideway=("heave@m",),
    ...                                       K_w=[[1.0]])
    >>> met = step_response_peak(car, height=0.001, length=0.0, speed=50.0, places={"m": 0.0}, outputs=["z"])
    >>> round(1e3 * met.peaks[0].peak, 3)                                  # twice the step without damping
    2.0
    """
    if not (np.isfinite(length) and length >= 0.0):
        raise ValueError(f"length: expected a length that is not negative in m, got {length}")
    names = tuple(outputs)
    # An abrupt step has no piece of its own: what is met is constant before and after it.
    drawn = PieceShape.step(height, length=length if length > 0.0 else 1.0)
    system = driven_system(closed, drawn, speed=speed, places=places, outputs=names)
    if not system.shapes:
        raise ValueError("closed: expected an element that feels the guideway's heave")
    begins = (np.max(system.places) - system.places) / speed
    ends = begins + length / speed
    breaks = np.unique(np.concatenate([begins, ends]))
    state, w_before = np.zeros(len(system.A)), np.zeros(len(system.shapes))
    fastest = float(np.max(np.abs(linalg.eigvals(system.A)), initial=0.0))
    track = _Track([], [], [], [])
    for start, end in pairwise(breaks.tolist()):
        state, w_before = _passed(
            system, state, w_before, start, end, height=height, begins=begins, length=length,
            fastest=fastest, track=track,
        )  # fmt: skip
    last = float(breaks[-1])
    if length == 0.0:
        state = state + system.E_v @ (np.full(len(begins), height) - w_before)
    bound = _settle(system, state, last, height=height, fastest=fastest, track=track)
    times, values = np.concatenate(track.times), np.concatenate(track.values, axis=1)
    settled = (system.D_w - system.C @ np.linalg.solve(system.A, system.E_w)) @ np.full(len(begins), height)
    peaks = tuple(_top(i, name, system, times, values, settled=settled, bound=bound, track=track, abrupt=length == 0.0)
                  for i, name in enumerate(names))  # fmt: skip
    return StepResponse(speed, read_only(times, name="times"), read_only(values, name="values"), peaks)


@dataclass(slots=True, eq=False)
class _Track:
    """What has been sampled: times, outputs, and the joined states with their generators, by piece."""

    times: list[FloatArray]
    values: list[FloatArray]
    states: list[FloatArray]
    pieces: list[tuple[FloatArray, FloatArray]]


def _passed(
    system: DrivenSystem, state: FloatArray, w_before: FloatArray, start: float, end: float, *, height: float,
    begins: FloatArray, length: float, fastest: float, track: _Track,
) -> tuple[FloatArray, FloatArray]:  # fmt: skip
    """Over one time between breaks; the drive is linear in time there."""
    middle = 0.5 * (start + end)
    if length > 0.0:
        steep = height * system.speed / length
        rate = np.where((middle > begins) & (middle < begins + length / system.speed), steep, 0.0)
        w = np.clip((start - begins) * steep, min(0.0, height), max(0.0, height))
    else:
        rate = np.zeros(len(begins))
        w = np.where(middle > begins, height, 0.0)
        state = state + system.E_v @ (w - w_before)
    found = _sampled(system, state, w, rate, start, end, fastest=fastest, track=track)
    return found, w + rate * (end - start)


def _sampled(
    system: DrivenSystem, state: FloatArray, w: FloatArray, rate: FloatArray, start: float, end: float, *,
    fastest: float, track: _Track,
) -> FloatArray:  # fmt: skip
    n = len(system.A)
    joined = np.zeros((n + 2, n + 2))
    joined[:n, :n] = system.A
    joined[:n, n], joined[:n, n + 1] = system.E_w @ w + system.E_v @ rate, system.E_w @ rate
    joined[n + 1, n] = 1.0
    through = np.stack([system.D_w @ w + system.D_v @ rate, system.D_w @ rate], axis=1)
    output = np.hstack([system.C, through])
    count = int(np.clip(np.ceil((end - start) * fastest * _PER_CYCLE / (2.0 * np.pi)), 8, _MOST)) + 1
    step = linalg.expm(joined * ((end - start) / (count - 1)))
    states = np.empty((n + 2, count))
    states[:, 0] = np.concatenate([state, [1.0, 0.0]])
    for k in range(1, count):
        states[:, k] = step @ states[:, k - 1]
    track.times.append(np.linspace(start, end, count))
    track.values.append(output @ states)
    track.states.append(states)
    track.pieces.append((joined, output))
    return states[:n, -1].copy()


def _settle(
    system: DrivenSystem, state: FloatArray, start: float, *, height: float, fastest: float, track: _Track
) -> FloatArray:
    """The time after the last element has passed, until what is left is bounded below half of every peak."""
    w = np.full(len(system.shapes), height)
    rest = -np.linalg.solve(system.A, system.E_w @ w)
    settled = np.abs(system.C @ rest + system.D_w @ w)
    s, V = linalg.eig(system.A)
    defective = np.linalg.cond(V) > 1e10
    slowest = float(np.min(-s.real))
    span, now = 2.0 / slowest if slowest > 0.0 else 1.0, start
    longest = _MOST * 2.0 * np.pi / (fastest * _PER_CYCLE)
    bound = np.full(len(system.C), np.inf)
    while now - start < longest:
        length = min(span, longest)
        state = _sampled(system, state, w, np.zeros(len(w)), now, now + length, fastest=fastest, track=track)
        now += length
        top = np.max(np.abs(np.concatenate(track.values, axis=1)), axis=1)
        if not defective:
            bound = settled + np.abs(system.C @ V) @ np.abs(np.linalg.solve(V, state - rest))
        elif now - start >= 40.0 / slowest:
            break
        if np.all(bound - settled <= np.maximum(0.5 * (top - settled), 1e-9 * top)):
            break
    return bound


def _top(
    i: int, name: str, system: DrivenSystem, times: FloatArray, values: FloatArray, *, settled: FloatArray,
    bound: FloatArray, track: _Track, abrupt: bool,
) -> StepPeak:  # fmt: skip
    if abrupt and np.any(system.D_v[i]):
        reason = "the output feels the rate of a step, which is infinite; draw the step out over a length"
        return StepPeak(name, np.inf, np.nan, float(settled[i]), float(bound[i]), reason)
    best = int(np.argmax(np.abs(values[i])))
    peak, time = float(abs(values[i, best])), float(times[best])
    sizes = np.cumsum([len(part) for part in track.times])
    piece = int(np.searchsorted(sizes, best, side="right"))
    local = best - (int(sizes[piece - 1]) if piece else 0)
    joined, output = track.pieces[piece]
    gap = float(track.times[piece][1] - track.times[piece][0])
    # Around the sample the output is climbed by halving; every value is exact.
    state, low, high = track.states[piece][:, max(local - 1, 0)], 0.0, 2.0 * gap if local > 0 else gap
    golden = 0.5 * (np.sqrt(5.0) - 1.0)

    def value(t: float) -> float:
        return float(abs(output[i] @ linalg.expm(joined * t) @ state))

    a, b = low, min(high, float(track.times[piece][-1] - track.times[piece][max(local - 1, 0)]))
    for _ in range(_REFINED):
        c, d = b - golden * (b - a), a + golden * (b - a)
        a, b = (a, d) if value(c) > value(d) else (c, b)
    middle = 0.5 * (a + b)
    if value(middle) > peak:
        peak, time = value(middle), float(track.times[piece][max(local - 1, 0)] + middle)
    certain = bound[i] <= max(peak, abs(float(settled[i])) * (1.0 + 1e-9))
    reason = "" if certain else "a later peak is not excluded: the modes are nearly defective, or decay too slowly"
    return StepPeak(name, peak, time, float(settled[i]), float(bound[i]), reason)
