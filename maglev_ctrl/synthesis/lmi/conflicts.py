"""Which requirements cannot be met together: the smallest set, found by asking each alone, then each pair."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

from maglev_ctrl.errors import Status
from maglev_ctrl.synthesis.lmi.problem import USUAL, WIDE, Problem
from maglev_ctrl.synthesis.lmi.request import only, requirements

SOLVES_MOST = 24


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
    solves, all_told = 1, True
    for size in range(1, len(names) + 1):
        for chosen in combinations(names, size):
            told = _list([words[name] for name in chosen])
            if size == len(names) and all_told:
                return _sentence(told, size, scope, chosen)
            if size == len(names) or solves >= SOLVES_MOST or problem.clock.left <= 0.0:
                break
            solves += 1
            answer = _feasible(problem, chosen)
            all_told = all_told and answer is not None
            if answer is False:
                return _sentence(told, size, scope, chosen)
    return f"{scope}not all can be met together: {_list([words[name] for name in names])}{_caveat(names)}"


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
