"""Runge-Kutta integration of many runs at once, with the law's samples and delays on nodes of the steps."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from maglev_ctrl.analysis.simulation.events import Bounds, Node
from maglev_ctrl.analysis.simulation.ground import Ground
from maglev_ctrl.analysis.simulation.loop import Law, Schedule
from maglev_ctrl.analysis.simulation.magnets import extra_current
from maglev_ctrl.analysis.simulation.motion import Equations, Rates
from maglev_ctrl.analysis.simulation.past import Past
from maglev_ctrl.analysis.simulation.records import Event
from maglev_ctrl.analysis.simulation.store import Store
from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.guideway import Modulation

CHUNK = 400_000
"""Numbers of guideway displacements that are found at a time."""

RESOLVES = 4
RESOLVED = 1e-9
"""Corrections of a command through measured accelerations, and what may be left; forces are nearly linear in it."""


@dataclass(frozen=True, eq=False, slots=True)
class Problem:
    """One simulation: `start` (r, n), (r, n), (r, n_xi); the limits; `seed` of the noise."""

    equations: Equations
    law: Law | None
    ground: Ground
    modulation: Modulation | None
    bounds: Bounds
    start: tuple[FloatArray, FloatArray, FloatArray]
    seed: int


@dataclass(frozen=True, eq=False, slots=True)
class Outcome:
    """Events, the ends (r,) s of the runs, and the share of its time that each input was at its limit, (r, n_u)."""

    events: tuple[Event, ...]
    ends: FloatArray
    saturation: FloatArray


@dataclass(frozen=True, eq=False, slots=True)
class _Slope:
    """Rate of the whole state, the motion behind it, and the law's command (r, c)."""

    change: FloatArray
    rates: Rates
    command: FloatArray


class Integration:
    """The running state of a simulation: q, q', xi, work and the states of a continuous law, side by side (r, N)."""

    def __init__(self, problem: Problem, schedule: Schedule) -> None:
        self._problem, self._schedule = problem, schedule
        q, v, xi = problem.start
        law, runs = problem.law, len(q)
        self._n, self._xi = q.shape[1], xi.shape[1]
        states = 0 if law is None else len(law.controller.A)
        self._law_states = np.zeros((runs, states))
        continuous = law is not None and not law.sampled
        self._x = np.hstack([q, v, xi, np.zeros((runs, 1)), np.zeros((runs, states if continuous else 0))])
        self._rows = np.arange(runs)
        self._inputs = len(problem.equations.low)
        self._held = np.zeros((runs, self._inputs))
        count = 0 if law is None else len(law.columns)
        self._noise = np.zeros((runs, 0 if law is None else len(law.noise)))
        self._random = [np.random.default_rng([problem.seed, run]) for run in range(runs)]
        self._issued: list[FloatArray] = []
        self._none = np.zeros((runs, count))
        self._past: Past | None = None
        self._late = self._delayed = np.zeros(0, dtype=np.int64)
        if law is not None and continuous and np.any(~law.immediate):
            late, equations = ~law.immediate, problem.equations
            self._late = law.columns[late]
            self._past = Past(
                law.delays[late], step=float(schedule.widths[0]), runs=runs,
                low=equations.low[self._late], high=equations.high[self._late],
            )  # fmt: skip
            self._delayed = np.flatnonzero(late)

    def run(self, store: Store, frames: int) -> Outcome:
        """Integrate a number of frames; every sample goes into the store."""
        schedule, problem = self._schedule, self._problem
        steps, runs = len(schedule.widths), len(self._x)
        ends, limited = np.full(runs, frames * schedule.frame), np.zeros((runs, self._inputs))
        events: list[Event] = []
        before: Node | None = None
        sample, node = 0, 0
        ground = _Window(problem, schedule, runs)
        for frame in range(frames + 1):
            last = frame == frames
            if not len(self._rows):
                break
            self._disturb()
            ground.reach(frame, self._rows)
            if problem.law is not None and problem.law.sampled:
                self._sample(ground.at(frame, 0, 0), ground.factor(frame, 0, 0))
            for step in range(1 if last else steps):
                width, time = float(schedule.widths[step]), frame * schedule.frame + float(schedule.offsets[step])
                if problem.law is not None and problem.law.sampled:
                    self._hold(step)
                first = self._slope(self._x, node, 0, ground.at(frame, step, 0), ground.factor(frame, step, 0))
                here = self._node(time, first.rates)
                crossed = problem.bounds.crossed(here)
                if crossed.any():
                    for row in np.flatnonzero(crossed):
                        event = problem.bounds.event(before, here, int(row))
                        ends[event.run] = event.time
                        events.append(event)
                    first, here = self._keep(~crossed, first), self._node(time, _rows(first.rates, ~crossed))
                    if not len(self._rows):
                        break
                    ground.reach(frame, self._rows)
                before = here
                if (schedule.kept[step] or last) and frame % schedule.every == 0:
                    self._put(store, sample, first, ground.at(frame, step, 0))
                    sample += 1
                if last:
                    break
                equations = problem.equations
                applied = first.rates.applied
                if equations.limited:
                    at_limit = (applied <= equations.low) | (applied >= equations.high)
                    limited[self._rows] += width * at_limit
                if self._past is not None:
                    self._past.put(node, first.command[:, self._delayed], self._carried())
                self._advance(first, width, node, frame, step, ground)
                ground.respond(time, here, width)
                node += 1
        share = limited / np.maximum(ends, 1e-300)[:, None]
        return Outcome(tuple(sorted(events, key=lambda event: event.run)), ends, np.minimum(share, 1.0))

    def _advance(self, first: _Slope, width: float, node: int, frame: int, step: int, ground: _Window) -> None:
        x = self._x
        middle = ground.at(frame, step, 1), ground.factor(frame, step, 1)
        end = ground.at(frame, step, 2), ground.factor(frame, step, 2)
        second = self._slope(x + 0.5 * width * first.change, node, 1, *middle)
        third = self._slope(x + 0.5 * width * second.change, node, 1, *middle)
        fourth = self._slope(x + width * third.change, node, 2, *end)
        self._x = x + width / 6.0 * (first.change + 2.0 * (second.change + third.change) + fourth.change)

    def _slope(
        self,
        x: FloatArray,
        node: int,
        half: int,
        ground: tuple[FloatArray, FloatArray] | None,
        factor: FloatArray | None,
    ) -> _Slope:
        law, equations = self._problem.law, self._problem.equations
        q, v, xi = x[:, : self._n], x[:, self._n : 2 * self._n], x[:, 2 * self._n : 2 * self._n + self._xi]
        if law is None or law.sampled:
            rates = equations.rates((q, v, xi), self._held, ground=ground, factor=factor)
            command = self._none if law is None or not self._issued else self._issued[-1]
            return _Slope(self._change(v, rates, None), rates, command)
        states = x[:, 2 * self._n + self._xi + 1 :]
        given = np.zeros((len(x), self._inputs))
        if self._past is not None:
            given[:, self._late] = self._past.at(node, half)
        still = law.readings.still(x[:, : 2 * self._n + self._xi], ground) + self._noise
        command = law.command(states, still)
        if not law.accelerates:
            rates = equations.rates((q, v, xi), self._with(given, command, law), ground=ground, factor=factor)
            return _Slope(self._change(v, rates, law.change(states, still)), rates, command)
        rates = equations.rates((q, v, xi), given, ground=ground, factor=factor)
        y = still + rates.acceleration @ law.readings.acceleration
        command = law.command(states, y)
        if law.unlooped is not None:
            # The readings above are without the immediate commands, which add to them.
            command = command @ law.unlooped.T
        if len(law.prompt):
            rates = equations.rates((q, v, xi), self._with(given, command, law), ground=ground, factor=factor)
            y = still + rates.acceleration @ law.readings.acceleration
            for _ in range(RESOLVES if law.unlooped is not None else 0):
                left = law.command(states, y) - command
                spread = self._spread(command, law)
                # A command at its limit does not act back on the readings; it stays as the linear loop has it.
                left[np.any(equations.saturated(spread) != spread, axis=1)] = 0.0
                if np.max(np.abs(left)) <= RESOLVED * np.max(np.abs(command)):
                    break
                command = command + (left if law.unlooped is None else left @ law.unlooped.T)
                rates = equations.rates((q, v, xi), self._with(given, command, law), ground=ground, factor=factor)
                y = still + rates.acceleration @ law.readings.acceleration
        return _Slope(self._change(v, rates, law.change(states, y)), rates, command)

    def _spread(self, command: FloatArray, law: Law) -> FloatArray:
        spread = np.zeros((len(command), self._inputs))
        spread[:, law.columns] = command
        return spread

    def _with(self, given: FloatArray, command: FloatArray, law: Law) -> FloatArray:
        """Delayed commands, already given, with the immediate ones put in and saturated."""
        columns = law.prompt
        if not len(columns):
            return given
        found = given.copy()
        found[:, columns] = self._problem.equations.saturated(self._spread(command, law))[:, columns]
        return found

    def _change(self, v: FloatArray, rates: Rates, states: FloatArray | None) -> FloatArray:
        change = np.empty(self._x.shape)
        n, at = self._n, 2 * self._n + self._xi
        change[:, :n] = v
        change[:, n : 2 * n] = rates.acceleration
        change[:, 2 * n : at] = rates.internal
        np.einsum("ri,ri->r", v, rates.force, out=change[:, at])
        if states is not None:
            change[:, at + 1 :] = states
        return change

    def _sample(self, ground: tuple[FloatArray, FloatArray] | None, factor: FloatArray | None) -> None:
        """A sampled law reads, updates its states and issues its commands."""
        law, equations = self._problem.law, self._problem.equations
        assert law is not None
        x, n = self._x, self._n
        q, v, xi = x[:, :n], x[:, n : 2 * n], x[:, 2 * n : 2 * n + self._xi]
        y = law.readings.still(x[:, : 2 * n + self._xi], ground) + self._noise
        if law.accelerates:
            rates = equations.rates((q, v, xi), self._held, ground=ground, factor=factor)
            y = y + rates.acceleration @ law.readings.acceleration
        self._issued.append(law.command(self._law_states, y))
        self._law_states = law.change(self._law_states, y)
        longest = int(np.max(self._schedule.lags, initial=0)) + 1
        del self._issued[:-longest]

    def _hold(self, step: int) -> None:
        """The commands that act in a step: those issued as many periods ago as the delay asks for."""
        law, equations = self._problem.law, self._problem.equations
        assert law is not None
        lags = self._schedule.lags[step]
        held = np.zeros((len(self._rows), self._inputs))
        for i, (column, lag) in enumerate(zip(law.columns, lags, strict=True)):
            if lag < len(self._issued):
                held[:, column] = self._issued[-1 - lag][:, i]
        self._held = equations.saturated(held)

    def _disturb(self) -> None:
        """New noise for a frame: white up to half the frames' rate, of each sensor's density."""
        law = self._problem.law
        if law is None or not np.any(law.noise):
            return
        deviation = law.noise * np.sqrt(0.5 / self._schedule.frame)
        drawn = np.stack([self._random[row].standard_normal(len(deviation)) for row in self._rows])
        self._noise = drawn * deviation

    def _carried(self) -> tuple[FloatArray, FloatArray] | None:
        """What the held noise has in the delayed commands, and in their rate through the law's own states."""
        law = self._problem.law
        if law is None or not np.any(law.noise):
            return None
        parts = [self._noise @ matrix.T for matrix in (law.controller.D, law.controller.C @ law.controller.B)]
        if law.unlooped is not None:
            parts = [part @ law.unlooped.T for part in parts]
        return parts[0][:, self._delayed], parts[1][:, self._delayed]

    def _node(self, time: float, rates: Rates) -> Node:
        q, xi = self._x[:, : self._n], self._x[:, 2 * self._n : 2 * self._n + self._xi]
        windings = self._problem.bounds.saturating
        currents = np.zeros((len(q), len(windings)))
        for i, winding in enumerate(windings):
            currents[:, i] = extra_current(winding, xi, rates.applied)
        return Node(time, self._rows, q, currents, rates)

    def _keep(self, rows: NDArray[np.bool_], slope: _Slope) -> _Slope:
        """Only some of the runs go on."""
        self._x, self._rows, self._held = self._x[rows], self._rows[rows], self._held[rows]
        self._law_states, self._noise, self._none = self._law_states[rows], self._noise[rows], self._none[rows]
        self._issued = [one[rows] for one in self._issued]
        if self._past is not None:
            self._past.keep(rows)
        return replace(slope, change=slope.change[rows], rates=_rows(slope.rates, rows), command=slope.command[rows])

    def _put(self, store: Store, sample: int, slope: _Slope, ground: tuple[FloatArray, FloatArray] | None) -> None:
        x, n = self._x, self._n
        store.put(
            sample,
            self._rows,
            state=x[:, : 2 * n + self._xi],
            rates=slope.rates,
            ground=ground,
            command=slope.command,
            mass=self._problem.equations.mass,
            work=x[:, 2 * n + self._xi],
        )


def _rows(rates: Rates, rows: NDArray[np.bool_]) -> Rates:
    return Rates(*(getattr(rates, field.name)[rows] for field in fields(rates)))


class _Window:
    """The guideway under the vehicle at nodes and middles of the steps, found for many frames at a time."""

    def __init__(self, problem: Problem, schedule: Schedule, runs: int) -> None:
        self._problem, self._schedule = problem, schedule
        offsets, widths = schedule.offsets, schedule.widths
        self._times = np.stack([offsets[:-1], offsets[:-1] + 0.5 * widths, offsets[1:]], axis=1).ravel()
        each = len(self._times) * (len(problem.ground.x) + 1) * (1 if len(problem.ground.tracks) < 2 else runs)
        self._frames = 1 if problem.ground.responds else max(min(CHUNK // each, 4096), 1)
        self._first, self._last = 0, 0
        self._rows = np.arange(runs)
        self._now = np.zeros(0)
        self._w: FloatArray = np.zeros((0, 1, 0))
        self._rate: FloatArray = np.zeros((0, 1, 0))
        self._factors: FloatArray | None = None

    def reach(self, frame: int, rows: NDArray[np.int64]) -> None:
        """Make sure that a frame is known for the runs `rows`."""
        if self._first <= frame < self._last and len(rows) == len(self._rows):
            return
        self._rows = rows
        self._first, self._last = frame, frame + self._frames
        frames = np.arange(self._first, self._last)
        self._now = (frames[:, None] * self._schedule.frame + self._times).ravel()
        if self._problem.ground.tracks and not self._problem.ground.responds:
            self._w, self._rate = self._problem.ground.at(self._now, rows)
        self._factors = self._problem.equations.factors(self._problem.modulation, self._now)

    def at(self, frame: int, step: int, half: int) -> tuple[FloatArray, FloatArray] | None:
        """Displacements and rates (r or 1, nw) `half` half steps after a node; None: there is no track."""
        if not self._problem.ground.tracks:
            return None
        i = self._index(frame, step, half)
        if self._problem.ground.responds:
            w, rate = self._problem.ground.at(self._now[i : i + 1], self._rows)
            return w[0], rate[0]
        return self._w[i], self._rate[i]

    def factor(self, frame: int, step: int, half: int) -> FloatArray | None:
        """Modulation of every element's stiffness, (elements,)."""
        return None if self._factors is None else self._factors[self._index(frame, step, half)]

    def respond(self, time: float, node: Node, width: float) -> None:
        """Tell guideways that give way where the vehicle stood in a step and with what it loaded them."""
        ground = self._problem.ground
        if not ground.responds:
            return
        equations = self._problem.equations
        m = equations.frame.magnets
        places = ground.speed * time + equations.stations[:m]
        for row, run in enumerate(node.rows):
            track = ground.tracks[run if len(ground.tracks) > 1 else 0]
            if getattr(track, "responds", False):
                track.advance(time, places, node.rates.lift[row], width)  # type: ignore[attr-defined]

    def _index(self, frame: int, step: int, half: int) -> int:
        return (frame - self._first) * len(self._times) + 3 * step + half
