"""Best of many starts: stabilise, descend, polish; keep every local optimum."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from maglev_ctrl.arrays import FloatArray, read_only
from maglev_ctrl.synthesis.structured.bundle import polish
from maglev_ctrl.synthesis.structured.descent import Descent, descend
from maglev_ctrl.synthesis.structured.objective import Objective, Quantity
from maglev_ctrl.synthesis.structured.starts import starting_points

_SHORT, _LONG = 60, 300
_SAME = 1e-3
"""Relative difference below which two local optima count as one."""
_AGREEING = 4
_LEAST_STARTS = 10
_CANDIDATES = 3
_SHARE = 0.75
_NEAR = 0.1
"""A descent that ends this close above the best (logarithm of a norm) is worth going on with."""
"""Share of the time limit after which no start is begun; the rest is for the best of them."""


@dataclass(frozen=True, eq=False, slots=True)
class LocalOptimum:
    """Where one start led: its value (1/s, ratio or norm), growth rate (1/s), law K, and why the descent stopped.

    `value` is infinite (minus infinite for decay and damping) where no law was found; `excess` over the limits, as a
    share.
    """

    start: str
    value: float
    growth: float
    gain: FloatArray
    reason: str
    excess: float = 0.0


@dataclass(frozen=True, eq=False, slots=True)
class StartTable:
    """Local optima of all starts, best first, and how they were sought.

    `agreed` where the search ended early because several starts led to the same value.
    """

    quantity: Quantity
    optima: tuple[LocalOptimum, ...]
    seed: int
    wanted: int
    agreed: bool
    out_of_time: bool
    evaluations: int

    @property
    def best(self) -> LocalOptimum:
        """The best local optimum."""
        return self.optima[0]

    @property
    def usable(self) -> tuple[LocalOptimum, ...]:
        """Optima that are stable and keep the limits."""
        return tuple(one for one in self.optima if one.growth < 0.0 and one.excess <= 0.0 and np.isfinite(one.value))

    @property
    def notes(self) -> tuple[str, ...]:
        """Number of starts, spread of the optima, which start won, the seed: for the record of a design."""
        values = [one.value for one in self.usable]
        count = len(self.optima)
        told = f"best of {count} starts (seed {self.seed}); not proved to be the global optimum"
        if not values:
            return (told,)
        same = sum(abs(value - values[0]) <= _SAME * abs(values[0]) for value in values)
        found = [
            told,
            f"the start {self.best.start!r} won; {same} of {len(values)} usable starts agree within {_SAME:.1%}; local "
            f"optima from {values[0]:.6g} to {values[-1]:.6g}",
        ]
        if count > len(values):
            found.append(f"{count - len(values)} starts found no stable loop within the limits")
        if self.out_of_time:
            found.append(f"the time limit ended the search after {count} of {self.wanted} starts")
        return tuple(found)


@dataclass(eq=False, slots=True)
class _Trial:
    start: str
    t: FloatArray
    value: float
    inverse: FloatArray | None
    reason: str


def search(objective: Objective, *, starts: int, seed: int, time_limit: float) -> StartTable:
    """Minimise from many starts.

    Short descents first; the best few, and any that comes close to the best, go on until they stop and are polished.
    The search ends early when several starts agree.

    Parameters
    ----------
    starts : how many
    seed : of the random starts
    time_limit : s; the start under way is broken off. The outcome is reproducible where the limit is not reached
    """
    begun = time.monotonic()
    deadline = begun + time_limit
    enough = begun + _SHARE * time_limit
    stable_first = objective.quantity != "decay_rate" or bool(objective.limits)
    trials: list[_Trial] = []
    agreed = False
    if objective.size.size == 0:
        starts = 1
    for k, (name, point) in enumerate(starting_points(objective, seed=seed, count=starts)):
        if k and time.monotonic() > enough:
            break
        t = point
        if stable_first and objective.growth(t) >= 0.0:
            t, resisted = _stabilised(objective, t, deadline)
            if resisted:
                trials.append(_Trial(name, t, np.inf, None, "no stabilising gain found"))
                continue
        if objective.quantity == "h_infinity" and k % 2 == 0:
            t = _descent(objective.about("h2"), t, 40, deadline).t
        end = _descent(objective, t, _SHORT, deadline)
        if not np.isfinite(end.value):
            end = _descent(objective, point if stable_first else t, _SHORT, deadline)
        trial = _Trial(name, end.t, end.value, end.inverse, end.reason)
        best = min((one.value for one in trials), default=np.inf)
        if end.reason == "iterations" and end.value < best + _NEAR:
            _finish(objective, trial, deadline)
        trials.append(trial)
        agreed = _agree(trials)
        if agreed:
            break
    trials.sort(key=lambda one: one.value)
    for trial in trials[:_CANDIDATES]:
        if trial.value < trials[0].value + _NEAR:
            if trial.reason in ("iterations", "no progress"):
                _finish(objective, trial, deadline)
            _polished(objective, trial, deadline)
            _keep_limits(objective, trial, deadline)
    trials.sort(key=lambda one: (one.value, float(np.linalg.norm(one.t))))
    return StartTable(
        objective.quantity, tuple(_record(objective, trial) for trial in trials), seed, starts, agreed,
        len(trials) < starts and not agreed, objective.evaluations,
    )  # fmt: skip


def _stabilised(objective: Objective, t: FloatArray, deadline: float) -> tuple[FloatArray, bool]:
    """Descend in the growth rate until it is negative; whether it never was."""
    end = descend(
        objective.about("decay_rate").value, t, lower=objective.lower, upper=objective.upper, iterations=150,
        deadline=deadline, until=lambda _, value: value < -1e-3, progress=1e-7, window=30,
    )  # fmt: skip
    return end.t, end.value >= 0.0


def _descent(
    objective: Objective,
    t: FloatArray,
    iterations: int,
    deadline: float,
    inverse: FloatArray | None = None,
    progress: float = 1e-5,
) -> Descent:
    return descend(
        objective.value, t, lower=objective.lower, upper=objective.upper, iterations=iterations, deadline=deadline,
        inverse=inverse, progress=progress,
    )  # fmt: skip


def _finish(objective: Objective, trial: _Trial, deadline: float) -> None:
    end = _descent(objective, trial.t, _LONG, deadline, trial.inverse, progress=1e-6)
    if end.value <= trial.value:
        trial.t, trial.value, trial.inverse, trial.reason = end.t, end.value, end.inverse, end.reason


def _polished(objective: Objective, trial: _Trial, deadline: float) -> None:
    """Bundle steps and fresh descents in turn, as long as they help."""
    if objective.size.size == 0 or (objective.quantity == "h2" and len(objective.plants) == 1 and not objective.limits):
        return
    for round_ in range(4):
        before = trial.value
        for inverse in (None, trial.inverse) if round_ % 2 == 0 else (trial.inverse, None):
            t, value = polish(objective, trial.t, inverse=inverse, deadline=deadline)
            if value < trial.value:
                trial.t, trial.value = t, value
        if before - trial.value > 1e-4:
            end = _descent(objective, trial.t, _SHORT, deadline)
            if end.value < trial.value:
                trial.t, trial.value, trial.inverse = end.t, end.value, end.inverse
        if before - trial.value <= 1e-4:
            break


def _keep_limits(objective: Objective, trial: _Trial, deadline: float) -> None:
    """Raise the price of the excess until the limits are kept."""
    weight = objective.weight
    for _ in range(4):
        if not objective.limits or objective.excess(trial.t) <= 0.0:
            break
        objective.weight *= 5.0
        end = _descent(objective, trial.t, _LONG, deadline)
        trial.t, trial.value = polish(objective, end.t, deadline=deadline)
    objective.weight = weight
    trial.value = objective.value(trial.t)[0]


def _agree(trials: list[_Trial]) -> bool:
    values = sorted(one.value for one in trials)
    if len(trials) < _LEAST_STARTS:
        return False
    return values[_AGREEING - 1] - values[0] <= _SAME * max(1.0, abs(values[0]))


def _record(objective: Objective, trial: _Trial) -> LocalOptimum:
    theta = trial.t * objective.size
    value, excess = trial.value, 0.0
    if objective.limits and np.isfinite(value):
        excess = objective.excess(trial.t)
        value = objective.unlimited().value(trial.t)[0]
    return LocalOptimum(
        trial.start, objective.physical(value), objective.growth(trial.t),
        read_only(objective.structure.gain(theta), name="gain"), trial.reason, excess,
    )  # fmt: skip
