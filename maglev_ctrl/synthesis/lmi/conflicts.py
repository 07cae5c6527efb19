"""Which requirements cannot be met together: the smallest set, found by asking each alone, then each pair."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from maglev_ctrl.errors import ModelError, Status
from maglev_ctrl.proofs.makers import lyapunov_claim
from maglev_ctrl.proofs.prove import prove
from maglev_ctrl.synthesis.lmi.fastest import without_limit
from maglev_ctrl.synthesis.lmi.optimise import optimise
from maglev_ctrl.synthesis.lmi.problem import USUAL, WIDE, Problem, pose
from maglev_ctrl.synthesis.lmi.request import Objective, only, requirements
from maglev_ctrl.synthesis.riccati import riccati_continuous
from maglev_ctrl.systems import Controller

SOLVES_MOST = 24
BEST: dict[str, tuple[Objective, str]] = {
    "gain_below": ("gain", "the least gain found that stabilises"),
    "h2_below": ("h2", "the least found"),
    "h_infinity_below": ("h_infinity", "the least found"),
    "decay_rate": ("decay", "the largest found"),
}
"""Objective that tells what can be reached of a bound, and the words for it."""
ALONE, CLEARLY, SHARES = 0.3, 0.01, 8
"""Share of the time left for one bound; margin by which it must be missed; steps in the share of initial states."""


def conflict(problem: Problem) -> str:
    """One sentence about what cannot be met, for a problem found infeasible.

    Examples
    --------
    >>> from maglev_ctrl.synthesis.lmi.problem import pose
    >>> from maglev_ctrl.synthesis.lmi.request import MultiObjective
    >>> from maglev_ctrl.synthesis.lmi.session import Clock, LmiSession
    >>> from maglev_ctrl.systems.plant import Plant
    >>> plant = Plant.from_matrices([[1.0]], [[1.0]], [[1.0]], [[1.0]])
    >>> wish = MultiObjective(decay_rate=5.0, gain_below=2.0)
    >>> conflict(pose((plant,), wish, session=LmiSession(), clock=Clock(60.0))).split(" (")[0]
    'a decay rate of 5 1/s and a gain below 2 cannot both be met: each alone can'
    """
    wanted = requirements(problem.request)
    scope = _scope(problem)
    words = dict(wanted)
    names = [name for name, _ in wanted]
    if not names:
        return f"{scope}no state feedback makes every vertex stable"
    if _feasible(problem, []) is False:
        return f"{scope}no state feedback makes every vertex stable, whatever else is asked"
    found = _smallest(problem, whole=True)
    if found:
        return found
    told = _list([words[name] for name in names])
    return f"{scope}not all can be met together: {told}{_caveat(names)}"


def suspected_conflict(problem: Problem) -> str:
    """One sentence about what cannot be met, for a problem without an answer; empty where nothing is found out.

    Examples
    --------
    >>> from maglev_ctrl.synthesis.lmi.problem import pose
    >>> from maglev_ctrl.synthesis.lmi.request import MultiObjective
    >>> from maglev_ctrl.synthesis.lmi.session import Clock, LmiSession
    >>> from maglev_ctrl.systems.plant import Plant
    >>> plant = Plant.from_matrices([[1.0]], [[1.0]], [[1.0]], [[1.0]])
    >>> suspected_conflict(pose((plant,), MultiObjective(gain_below=2.0), session=LmiSession(), clock=Clock(60.0)))
    ''
    """
    return _smallest(problem, whole=False)


def _smallest(problem: Problem, *, whole: bool) -> str:
    """The smallest set that is refuted; with `whole`, all together are known to be."""
    wanted = requirements(problem.request)
    scope, words, names = _scope(problem), dict(wanted), [name for name, _ in wanted]
    solves, all_told = 1, True
    for size in range(1, len(names) + 1):
        for chosen in combinations(names, size):
            told = _list([words[name] for name in chosen])
            reach = ""
            if whole and size == len(names) and all_told:
                return _sentence(told, size, scope, chosen) + (reachable(problem, chosen[0])[0] if size == 1 else "")
            if (whole and size == len(names)) or solves >= SOLVES_MOST or problem.clock.left <= 0.0:
                break
            solves += 1
            answer = _feasible(problem, chosen)
            if size == 1 and not answer:
                reach, beyond = reachable(problem, chosen[0])
                answer = False if beyond else answer
            if answer is None and chosen == ("decay_rate", "gain_below"):
                reach, beyond = reachable(problem, "gain_below", with_decay=True)
                answer = False if beyond else answer
            all_told = all_told and answer is not None
            if answer is False:
                return _sentence(told, size, scope, chosen) + reach
    return ""


def reachable(problem: Problem, name: str, *, with_decay: bool = False) -> tuple[str, bool]:
    """What can be reached where one bound alone is asked for, in words, and whether that falls short of the bound."""
    request, clock = problem.request, problem.clock.part(ALONE)
    if name == "commands":
        return _share_held(problem), False
    if name not in BEST:
        return "", False
    objective, words = BEST[name]
    alone = replace(only(request, ["decay_rate"] if with_decay else []), objective=objective)
    if with_decay:
        words = "the least gain found with that decay rate"
    one = pose(
        problem.plants, alone, session=problem.session, clock=clock, solver=problem.solver, lyapunov=problem.lyapunov
    )  # fmt: skip
    if without_limit(one):
        return "", False
    found = optimise(one)
    if not found.values or not np.isfinite(found.objective) or (objective == "decay" and not found.certain):
        return "", False
    bound, best = float(getattr(request, name)), found.objective
    if objective == "gain":
        # The inequality bounds the gain from above; what the law has is what was found.
        best = float(np.linalg.norm((found.problem or one).gain(found.values), 2))
    missed = best * (1.0 - CLEARLY) > bound if found.certain else 0.5 * best > bound
    if objective == "decay":
        missed = best * (1.0 + CLEARLY) < bound
    return f"; {words} is about {best:.3g}", missed


def share_of_starts(problem: Problem) -> str:
    """Where the solver fails with command limits and a norm: from how much smaller initial states there is a law."""
    if problem.request.commands is None or not (problem.request.has_h2 or problem.request.has_h_infinity):
        return ""
    key = "gamma" if problem.request.objective == "h_infinity" or not problem.request.has_h2 else "energy"
    share = _share(problem, lambda one: one.solve(USUAL, {f"weigh_{key}": 1.0}).usable)
    if share == 0.0:
        return ""
    return (
        "no law was found whose one Lyapunov matrix bounds the norm and keeps the commands below their limits from "
        f"the initial states asked; from {share:.2g} of them there is one"
    )


def _share_held(problem: Problem) -> str:
    """By how much smaller the initial states would have to be for the commands to stay below their limits."""
    share = _share(problem, lambda one: bool(_feasible(one, ["commands"])))
    return "" if share == 0.0 else f"; from {share:.2g} of the initial states they can"


def _share(problem: Problem, serves: Callable[[Problem], bool]) -> float:
    """Largest share of the initial states that serves, roughly; zero where none was found."""
    commands = problem.request.commands
    assert commands is not None
    low, high = 0.0, 1.0
    for _ in range(SHARES):
        if problem.clock.left <= 0.0:
            break
        share = 0.125 * high if low == 0.0 else float(np.sqrt(low * high))
        smaller = replace(
            commands,
            initial_states=None if commands.initial_states is None else share * np.asarray(commands.initial_states),
            allowed=None if commands.allowed is None else share * np.asarray(commands.allowed),
        )
        one = problem.with_request(replace(problem.request, commands=smaller))
        low, high = (share, high) if serves(one) else (low, share)
    return low


def contradicted(problem: Problem) -> bool:
    """Whether a law made without the solver is proved to do what it says no law can; asked of one vertex alone.

    A linear-quadratic law of the plant made faster by the rate decays at that rate; where nothing else is asked, or
    where the solver denies stability itself, that is enough.
    """
    if len(problem.plants) > 1:
        return False
    names = [name for name, _ in requirements(problem.request)]
    if set(names) - {"decay_rate"} and _feasible(problem, []) is not False:
        return False
    plant, rate = problem.plants[0], problem.request.decay_rate if names == ["decay_rate"] else 0.0
    n = len(plant.A)
    shifted = plant.A + 1.001 * (rate or 0.0) * np.eye(n)
    for price in (1.0, 1e-3, 1e3):
        size = float(np.linalg.norm(plant.B2, 2)) ** 2
        found = riccati_continuous(shifted, plant.B2, np.eye(n), price * max(size, 1e-300) * np.eye(plant.B2.shape[1]))
        if found.status is not Status.SOLVED:
            continue
        law = Controller.static(-found.gain, measured=plant.measured, commands=plant.commands)
        try:
            claim = lyapunov_claim([plant], [law], rate=rate or 0.0)
        except (ModelError, ValueError):
            continue
        if prove(claim, [plant], [law]).holds:
            return True
    return False


def _sentence(told: str, size: int, scope: str, chosen: Sequence[str]) -> str:
    caveat = _caveat(chosen)
    if size == 1:
        return f"{scope}{told} cannot be met{caveat}"
    both, rest = ("both", "each alone can") if size == 2 else ("all", "fewer of them can")
    return f"{scope}{told} cannot {both} be met: {rest}{caveat}"


def _caveat(chosen: Sequence[str]) -> str:
    """Bounds on gain and commands are met where their inequalities hold; that these fail does not say the opposite."""
    parts = [word for name, word in (("gain_below", "gain"), ("commands", "commands")) if name in chosen]
    if not parts:
        return ""
    told = " and the ".join(parts)
    return f" (the test of the {told} is sufficient only: a law that just meets it may be overlooked)"


def _feasible(problem: Problem, names: tuple[str, ...] | list[str]) -> bool | None:
    """Whether the named requirements alone can be met; None where the solver could not tell."""
    part = problem.with_request(only(problem.request, names))
    if problem.lyapunov == "common":
        part = part.around(part.request.decay_rate or 0.0)
    weights = {"weigh_sigma": 1.0, "weigh_floor": 0.0 if part.homogeneous else 1.0}
    refuted = False
    for attempt in (USUAL, WIDE):
        answer = part.solve(attempt, weights)
        if answer.usable:
            return True
        refuted = refuted or (answer.status is Status.INFEASIBLE and answer.certain)
    return False if refuted else None


def _scope(problem: Problem) -> str:
    """What the sentence does not speak of: other Lyapunov functions than those tried."""
    if problem.lyapunov != "common":
        return "with the parameter-dependent Lyapunov functions tried, "
    if len(problem.plants) > 1:
        return "with one Lyapunov matrix for all vertices, "
    return "" if _exact(problem) else "with one Lyapunov matrix for all requirements, "


def _exact(problem: Problem) -> bool:
    """One requirement, or none that needs the matrix of another: decay, region, and the gain that both bound."""
    names = {name for name, _ in requirements(problem.request)}
    return len(names) < 2 or names == {"decay_rate", "gain_below"}


def _list(words: list[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"
