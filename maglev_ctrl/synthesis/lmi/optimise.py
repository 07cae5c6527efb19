"""Two stages: the best objective, then the smallest gain with the objective given up by a little."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.errors import Status
from maglev_ctrl.synthesis.lmi.problem import CAPS, NOTHING, TIGHT, USUAL, WIDE, Optimum, Problem
from maglev_ctrl.synthesis.lmi.session import Answer

BACK_OFF = 2e-3
"""Share of the objective given up so that the law is not at the edge, where gains grow without bound."""
EASE = 0.2
"""Share of gain (squared) given up above the least where nothing is asked to be best."""
RATE_MOST = 2.0**10
"""Scaled decay rate that counts as unbounded."""
RATE_STEPS, RATE_WIDTH = 12, 1e-3
"""Bisections of the decay rate, and the relative width at which they stop."""
GAIN_STEPS = {"gain": 8, "feasible": 2, "h2": 2, "h_infinity": 2, "decay": 2}
NORMS = {"h2": ("energy", 2, "h2"), "h_infinity": ("gamma", 1, "h_infinity")}
"""Variable, power of the norm in it, and unit of an objective that is a norm."""
BISECTED, BISECTIONS = 2e-3, 24
HARD = {Status.TIME_LIMIT, Status.UNBOUNDED}


def optimise(problem: Problem) -> Optimum:
    """The optimum of a problem: caps on condition and gain as usual, tight where the solver stumbles, wide at last.

    Examples
    --------
    >>> from maglev_ctrl.synthesis.lmi.problem import pose
    >>> from maglev_ctrl.synthesis.lmi.request import MultiObjective
    >>> from maglev_ctrl.synthesis.lmi.session import Clock, LmiSession
    >>> from maglev_ctrl.systems.plant import Plant
    >>> plant = Plant.from_matrices([[1.0]], [[1.0]], [[1.0]], [[1.0]])
    >>> best = optimise(pose((plant,), MultiObjective("gain"), session=LmiSession(), clock=Clock(60.0)))
    >>> round(best.objective, 3)  # any gain above one stabilises x' = x + u
    1.0
    """
    found = Optimum(Status.NUMERICAL_ERROR, {})
    solves = 0
    for attempt in (USUAL, TIGHT, WIDE):
        if attempt == TIGHT and found.status is Status.INFEASIBLE:
            continue
        last = found
        found = _decay(problem, attempt) if problem.request.objective == "decay" else _norm(problem, attempt)
        solves += found.solves
        if found.values or found.status in HARD:
            break
        if (
            attempt == WIDE
            and found.status is Status.NUMERICAL_ERROR
            and last.status is Status.INFEASIBLE
            and last.certain
        ):
            found = last
    if not found.values and found.status is Status.NUMERICAL_ERROR and problem.request.objective in NORMS:
        found = _bisected(problem)
        solves += found.solves
    return replace(found, solves=solves)


def _bisected(problem: Problem) -> Optimum:
    """A norm by bisection on its bound: no objective, so that the solver stays inside and not at an edge.

    Slower, and used where the objective itself made the solver stumble. The lower end is not proved.
    """
    request, scaling = problem.request, problem.scaling
    key, power, unit = NORMS[request.objective]
    asked = problem.numbers(USUAL)[f"{key}_most"]
    low, high = 0.5, np.inf
    best: Answer | None = None
    solves = 0
    status = Status.NUMERICAL_ERROR
    while high > low * (1.0 + BISECTED) and solves < BISECTIONS:
        level = 2.0 * low if best is None else float(np.sqrt(low * high))
        answer = problem.solve(USUAL, {f"{key}_most": min(level**power, asked)})
        solves += 1
        if answer.status is Status.TIME_LIMIT:
            status = answer.status
            break
        if answer.usable:
            best, high = answer, level
            low = min(low, 0.5 * high)
        else:
            low = level
    if best is None:
        return Optimum(status, {}, solves=solves)
    value = high * (scaling.h2 if unit == "h2" else scaling.h_infinity)
    return Optimum(Status.ALMOST_SOLVED, best.values, value, request.decay_rate or 0.0, solves, False)


def _norm(problem: Problem, attempt: int) -> Optimum:
    """Objective h2, h_infinity, gain or feasible."""
    request, scaling = problem.request, problem.scaling
    key = {"h2": "energy", "h_infinity": "gamma"}.get(request.objective)
    weights: dict[str, Any] = {f"weigh_{key}": 1.0} if key else _gain_weights(problem, 1.0)
    first = problem.solve(attempt, weights)
    if not first.usable:
        # A norm is never below zero: "unbounded" is rounding.
        status = Status.NUMERICAL_ERROR if first.status is Status.UNBOUNDED else first.status
        return Optimum(status, {}, solves=1, certain=first.certain)
    rate = request.decay_rate or 0.0
    if key is None:
        best, count = _least_gain(problem, attempt, first)
        square = float(best["sigma"] / best["floor"])
        value = float(np.sqrt(square)) * problem.gain_unit if request.objective == "gain" else np.nan
        # The least gain lies on the edge of everything else: any point with a little more gain is inside.
        more = square * (1.0 + (BACK_OFF if request.objective == "gain" else EASE))
        inside = problem.solve(attempt, {"gain_square": min(more, problem.numbers(attempt)["gain_square"])})
        if inside.usable:
            best = inside.values
        return Optimum(first.status, best, value, rate, 2 + count, first.certain)
    value = float(first.values[key])
    share = (1.0 + BACK_OFF) ** (2 if key == "energy" else 1)
    if problem.regular:
        norm = float(np.sqrt(max(value, 0.0))) * scaling.h2
        return Optimum(first.status, _eased(first.values), norm, rate, 1, first.certain)
    # An objective that can be made zero is left there; the floor keeps the second stage from chasing rounding.
    most = max(value * share, value + 1e-6)
    bound = problem.numbers(attempt)[f"{key}_most"]
    best, count = _least_gain(problem, attempt, first, {f"{key}_most": min(most, bound)})
    value = np.sqrt(max(value, 0.0)) * scaling.h2 if key == "energy" else value * scaling.h_infinity
    return Optimum(first.status, best, float(value), rate, 1 + count, first.certain)


def _eased(values: Mapping[str, FloatArray]) -> Mapping[str, FloatArray]:
    """The same law with a little more of its Lyapunov matrix P = X^-1: a little more energy, and room everywhere."""
    share = 1.0 + BACK_OFF
    return {
        **values, "slack": values["slack"] / share, "Y": values["Y"] / share,
        "energy": np.asarray(values["energy"] * share**2),
    }  # fmt: skip


def _gain_weights(problem: Problem, ratio: float) -> dict[str, float]:
    return {"weigh_sigma": 1.0 / ratio, "weigh_floor": 0.0 if problem.homogeneous else 1.0}


def _least_gain(
    problem: Problem, attempt: int, start: Answer, changes: Mapping[str, Any] = NOTHING
) -> tuple[Mapping[str, FloatArray], int]:  # fmt: skip
    """Smallest sigma / floor from a feasible point: sigma - ratio floor, ratio updated (Dinkelbach 1967)."""
    best = start.values
    for count in range(GAIN_STEPS[problem.request.objective]):
        ratio = float(best["sigma"] / best["floor"])
        answer = problem.solve(attempt, {**changes, **_gain_weights(problem, ratio)})
        if not answer.usable:
            return best, count + 1
        smaller = float(answer.values["sigma"] / answer.values["floor"])
        if smaller < ratio or "gamma_most" in changes or "energy_most" in changes:
            best = answer.values
        if not smaller < ratio * (1.0 - 1e-6) or problem.homogeneous:
            return best, count + 1
    return best, count + 1


def _decay(problem: Problem, attempt: int) -> Optimum:
    """Largest common decay rate: a generalised eigenvalue problem, by bisection on the rate.

    Each rate is tried in the coordinates of a regulator that decays that fast, where the inequalities are of order one.
    """
    unit = problem.scaling.rate
    least = (problem.request.decay_rate or 0.0) / unit
    count = 0

    def attempt_at(rate: float) -> tuple[Problem, Answer]:
        nonlocal count
        count += 1
        there = problem.around(rate * unit)
        changes = {"twice_rate": 2.0 * rate, **_gain_weights(problem, 1.0)}
        answer = there.solve(attempt, changes)
        if not answer.usable and answer.status is not Status.TIME_LIMIT and not answer.certain_no:
            count += 1
            other = problem.in_plain_coordinates()
            second = other.solve(attempt, changes)
            if second.usable or second.certain_no:
                return other, second
        return there, answer

    low = least
    there, answer = attempt_at(low)
    if not answer.usable:
        return Optimum(answer.status, {}, solves=count, certain=answer.certain)
    best, high, failed = (there, answer), max(2.0 * low, 0.125), answer
    while True:
        there, answer = attempt_at(high)
        if not answer.usable:
            failed = answer
            break
        low, best, high = high, (there, answer), 2.0 * high
        if high > RATE_MOST:
            return Optimum(Status.UNBOUNDED, {}, solves=count)
    for _ in range(0 if failed.status is Status.TIME_LIMIT else RATE_STEPS):
        middle = 0.5 * (low + high)
        there, answer = attempt_at(middle)
        if answer.usable:
            low, best = middle, (there, answer)
        else:
            high, failed = middle, answer
        if failed.status is Status.TIME_LIMIT or high - low <= RATE_WIDTH * high:
            break
    found, answer = best
    square = float(answer.values["sigma"] / answer.values["floor"])
    rate = max((1.0 - BACK_OFF) * low, least)
    ended = ""
    if failed.status is Status.TIME_LIMIT:
        ended = f"the time was up at {high * unit:.6g} 1/s"
    elif not failed.certain_no:
        ended = f"the solver could not tell whether {high * unit:.6g} 1/s is possible"
    elif problem.request.gain_below is None and square > 0.25 * CAPS[attempt][1]:
        ended = f"the gain reached the most the search allows, at {high * unit:.6g} 1/s"
    values, more = _least_gain(found, attempt, answer, {"twice_rate": 2.0 * rate})
    status = Status.ALMOST_SOLVED if ended else answer.status
    return Optimum(status, values, low * unit, rate * unit, count + more, not ended, found, ended)
