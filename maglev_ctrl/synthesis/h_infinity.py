"""H-infinity synthesis by Riccati equations: state feedback and output feedback of any plant, sampled or not.

Doyle, Glover, Khargonekar & Francis, IEEE Trans. Autom. Control 34 (1989) 831; Glover & Doyle (1988) for any D.
The infimum over all laws is found first; the law is made a little above it, because at the infimum gains grow without
bound in most problems. What the law reaches is then computed again from the closed loop: three numbers, kept apart.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from decimal import ROUND_FLOOR, Context, Decimal

import numpy as np
from numpy.linalg import LinAlgError

from maglev_ctrl.analysis.hamiltonian import h_infinity_norm as bisected_norm
from maglev_ctrl.analysis.norms import h_infinity_norm
from maglev_ctrl.arrays import FloatArray, read_only
from maglev_ctrl.errors import ModelError, NotStable, Status
from maglev_ctrl.synthesis.h_infinity_claims import proved_law
from maglev_ctrl.synthesis.h_infinity_laws import (
    Problem,
    continuous_plant,
    law_gain,
    measuring_states,
    output_problem,
    state_problem,
)
from maglev_ctrl.synthesis.h_infinity_search import Infimum, infimum
from maglev_ctrl.synthesis.regular import defects, enlarged, require_movable
from maglev_ctrl.synthesis.result import Performance, Synthesis, refused
from maglev_ctrl.systems import Controller
from maglev_ctrl.systems.plant import Plant, closed_channel

BACK_OFF = 1.02
CURVE = (1.0005, 1.002, 1.01, 1.02, 1.05, 1.1, 1.25, 1.5, 2.0, 4.0)
DOUBT = 1e-6
"""Two methods for the norm of the closed loop may differ by this share at most."""
NOTHING = 1e-7
"""A norm below this share of the bound the law was made for is rounding."""
SHARES = (1e-3, 1e-4, 1e-5)
"""Sizes of what is added to a singular plant; the infimum is told for the last two."""
_LIMITS = {
    "growth of X": "the solution of the Riccati equation, and gains with it, grow without bound",
    "frequency": "the gain at one frequency, which no law of this kind lowers",
    "coupling of control and estimation": "control and estimation together, each of which could reach less alone",
    "answer to the disturbance at once": "what a disturbance does before the law can answer",
    "feedthrough": "what disturbances do to outputs at once, which no law changes",
    "unknown": "not known",
}
STATE_LAW = "H-infinity state feedback"
OUTPUT_LAW = "H-infinity output feedback"


@dataclass(frozen=True, eq=False, slots=True)
class GainCurve:
    """What nearness to the infimum costs: `gain` largest gain of the law made at `gamma`, NaN where none was found."""

    gamma: FloatArray
    gain: FloatArray


@dataclass(frozen=True, eq=False, slots=True)
class HInfinityDesign:
    """A proved law and the three numbers around it.

    `infimum` over all stabilising laws of this kind (an upper end of a bracket that is 2e-7 wide; for a singular plant
    the smallest value of the enlarged plants), NaN where none was found; `gamma` the bound the law was made for;
    `norm` what the closed loop has. `limit` is what ends the range of gamma: "growth of X", "frequency" (the loop's
    gain at some frequency), "coupling ...", "feedthrough", or "none". `curve` of the law's gain over gamma.
    `infima` and `shares` list the infimum for each size of what was added to a singular plant, else empty.
    """

    synthesis: Synthesis
    infimum: float
    gamma: float
    norm: float
    limit: str
    curve: GainCurve
    shares: tuple[float, ...] = ()
    infima: tuple[float, ...] = ()

    @property
    def controller(self) -> Controller:
        """The law.

        Raises
        ------
        ModelError : there is none, with the reason
        """
        return self.synthesis.require().controller


def h_infinity_state_feedback(
    plant: Plant,
    *,
    back_off: float = BACK_OFF,
    gamma: float | None = None,
    gain_bound: float | None = None,
    curve: Sequence[float] = CURVE,
) -> HInfinityDesign:
    """Static feedback of all states with the smallest gain from disturbances to performance, backed off.

    Parameters
    ----------
    plant : its measurements are not used; D11, D12 of any kind
    back_off : the law is made for back_off x infimum
    gamma : made for this bound instead
    gain_bound : largest singular value allowed of the feedback; gamma is raised until it is met
    curve : multiples of the infimum at which the gain is recorded

    Raises
    ------
    ValueError : an option is out of range

    Examples
    --------
    >>> plant = Plant.from_matrices([[1.0]], [[1.0]], [[1.0]], [[1.0], [0.0]], D12=[[0.0], [1.0]])
    >>> design = h_infinity_state_feedback(plant)  # for x' = a x + w + u the infimum is 1 where a >= 0
    >>> round(design.infimum, 5), round(design.gamma / design.infimum, 9), design.norm <= design.gamma
    (1.0, 1.02, True)
    """
    return _design(STATE_LAW, measuring_states(plant), state_problem, back_off, gamma, gain_bound, curve)


def h_infinity_output_feedback(
    plant: Plant,
    *,
    back_off: float = BACK_OFF,
    gamma: float | None = None,
    gain_bound: float | None = None,
    curve: Sequence[float] = CURVE,
) -> HInfinityDesign:
    """Dynamic feedback of the measurements (the central law, as many states as the plant), backed off.

    Parameters
    ----------
    plant : any D11, D12, D21, D22
    back_off, gamma, gain_bound, curve : as for the state feedback; the gain is the law's largest over all frequencies

    Raises
    ------
    ValueError : an option is out of range

    Examples
    --------
    >>> plant = Plant.from_matrices([[1.0]], [[1.0, 0.0]], [[1.0]], [[1.0], [0.0]], [[1.0]],
    ...                             D12=[[0.0], [1.0]], D21=[[0.0, 1.0]])
    >>> design = h_infinity_output_feedback(plant)
    >>> design.synthesis.status.name, design.limit
    ('SOLVED', 'coupling of control and estimation')
    """
    return _design(OUTPUT_LAW, plant, output_problem, back_off, gamma, gain_bound, curve)


def h_infinity_synthesis(plant: Plant, *, back_off: float = BACK_OFF) -> HInfinityDesign:
    """State feedback where every state is measured, else output feedback.

    Raises
    ------
    ValueError : `back_off` is not above 1

    Examples
    --------
    >>> plant = Plant.from_matrices([[1.0]], [[1.0]], [[1.0]], [[1.0], [0.0]], D12=[[0.0], [1.0]])
    >>> h_infinity_synthesis(plant).synthesis.law
    'H-infinity state feedback'
    """
    made = h_infinity_state_feedback if plant.measures_states else h_infinity_output_feedback
    return made(plant, back_off=back_off)


@dataclass(frozen=True, eq=False, slots=True)
class _Posed:
    """The problem the law is made from, the bracket of its infimum, and what was added for it."""

    problem: Problem
    bracket: Infimum
    smallest: float
    notes: tuple[str, ...]
    shares: tuple[float, ...] = ()
    infima: tuple[float, ...] = ()


def _design(
    law: str,
    plant: Plant,
    pose: Callable[[Plant], Problem],
    back_off: float,
    gamma: float | None,
    gain_bound: float | None,
    curve: Sequence[float],
) -> HInfinityDesign:
    if not back_off > 1.0:
        raise ValueError(f"back_off: expected a factor above 1, got {back_off!r}")
    for name, value in (("gamma", gamma), ("gain_bound", gain_bound)):
        if value is not None and not value > 0.0:
            raise ValueError(f"{name}: expected a positive number, got {value!r}")
    try:
        require_movable(plant, output=pose is output_problem)
        posed = _posed(plant, pose, back_off, gamma)
    except ModelError as error:
        return _none(refused(law, [plant], Status.INFEASIBLE, str(error)))
    except LinAlgError as fault:
        told = f"its algebra failed: {fault}" if plant.dt is None else "the plant has a pole at -1: change the sampling"
        return _none(refused(law, [plant], Status.NUMERICAL_ERROR, told))
    if not posed:
        message = "no law reaches any finite gain as far as rounding can tell: rescale the plant"
        return _none(refused(law, [plant], Status.NUMERICAL_ERROR, message))
    points = _curve(posed[0], curve)
    smallest = posed[0].smallest
    if gamma is not None and gamma <= smallest:
        message = (
            f"no law reaches {gamma:.6g}: none of this kind stays below {smallest:.6g}; what ends the range: "
            f"{limit_words(posed[0].bracket.limit)}"
        )
        return _record(refused(law, [plant], Status.INFEASIBLE, message), posed[0], gamma, np.nan, points)
    return _made(law, plant, posed, back_off, gamma, gain_bound, points)


def _posed(plant: Plant, pose: Callable[[Plant], Problem], back_off: float, gamma: float | None) -> list[_Posed]:
    """The plant itself where it is regular, else enlarged plants, the one to design with first.

    That is the one with the largest addition that costs little; those with more are for where its law is not proved.
    """
    found = defects(continuous_plant(plant), output=pose is output_problem)
    if not found.any:
        problem = pose(plant)
        bracket = infimum(problem.trial, floor=problem.floor, scale=problem.scale)
        if bracket is not None:
            return [_Posed(problem, bracket, bracket.upper, ())]
        found = replace(found, unclear=True)
    tried: list[tuple[float, Problem, Infimum]] = []
    for share in SHARES:
        problem = pose(enlarged(plant, found, share))
        bracket = infimum(problem.trial, floor=problem.floor, scale=problem.scale)
        if bracket is not None:
            tried.append((share, problem, bracket))
    if not tried:
        return []
    smallest = min(bracket.upper for _, _, bracket in tried)
    falling = len(tried) > 1 and tried[-1][2].upper < 0.9 * tried[-2][2].upper
    most = np.inf if falling else smallest * (1.0 + 0.1 * (back_off - 1.0))
    if gamma is not None:
        most = min(most, max(gamma / (1.0 + 1e-9), smallest))
    best = next(k for k, one in enumerate(tried) if one[2].upper <= most)
    told = ", ".join(f"{one[2].upper:.7g} at {one[0]:g}" for one in tried)
    shares, infima = tuple(one[0] for one in tried), tuple(one[2].upper for one in tried)
    posed: list[_Posed] = []
    for share, problem, bracket in tried[best::-1]:
        notes: tuple[str, ...] = (
            f"the plant is singular: {'; '.join(found.sentences)}",
            f"small outputs and disturbances are added, {share:g} of the plant's own scale for the law; the lowest "
            f"level of the plant itself is at most {told}",
        )
        if falling:
            notes += (
                "the lowest level falls with what is added: it is lower still, or is reached with unlimited gain only",
            )
        posed.append(_Posed(problem, bracket, smallest, notes, shares, infima))
    return posed


def _level_words(posed: _Posed, level: float) -> str:
    """How near the least possible level a law was made, for people."""
    limit = posed.bracket.limit
    if limit.startswith("none") or not posed.smallest > 0.0:
        return f"laws of this kind make the gain as small as wanted; this one was made for {level:.4g}"
    context = Context(prec=4, rounding=ROUND_FLOOR)
    least = float(context.create_decimal(Decimal(posed.smallest)))  # no law is below it: never told higher than it is
    added = "with what is added, " if posed.shares else ""
    return (
        f"{added}no law of this kind stays below {least:.4g}; this one was made for {level:.4g} "
        f"({100.0 * (level / posed.smallest - 1.0):.2g} % above, for smaller gains); what ends the range: "
        f"{limit_words(limit)}"
    )


def limit_words(limit: str) -> str:
    """What ends the range of levels a law can reach, in words.

    Examples
    --------
    >>> limit_words("control: growth of X")
    'in control, the solution of the Riccati equation, and gains with it, grow without bound'
    """
    part, _, name = limit.rpartition(": ")
    words = _LIMITS.get(name, name)
    return f"in {part}, {words}" if part in ("control", "estimation") else _LIMITS.get(limit, limit)


def _target(posed: _Posed, back_off: float) -> float:
    if posed.bracket.limit.startswith("none"):
        return 1e-4 * posed.problem.scale
    return max(back_off * posed.smallest, posed.bracket.upper * (1.0 + 0.9 * (back_off - 1.0)))


def _curve(posed: _Posed, factors: Sequence[float]) -> GainCurve:
    base = posed.bracket.upper
    gammas = [base * factor for factor in factors]
    laws = [posed.problem.law(gamma) for gamma in gammas]
    gains = [np.nan if law is None else law_gain(law) for law in laws]
    return GainCurve(read_only(gammas, name="gamma"), np.asarray(gains))


def _made(
    law: str,
    plant: Plant,
    candidates: Sequence[_Posed],
    back_off: float,
    gamma: float | None,
    gain_bound: float | None,
    points: GainCurve,
) -> HInfinityDesign:
    """The first law at or above the target that keeps its promise and the bound on its gain, and is proved."""
    kept_back: HInfinityDesign | None = None
    least = np.inf
    for posed, target, level in _attempts(candidates, back_off, gamma, gain_bound):
        controller = posed.problem.law(level)
        norm = np.inf if controller is None else _norm(plant, controller)
        if controller is None or norm > level * (1.0 + 1e-6):
            continue
        gain = law_gain(controller)
        least = min(least, gain)
        if gain_bound is not None and gain > gain_bound:
            continue
        notes = [_level_words(posed, level), *posed.notes]
        if level > target:
            reason = f"keep the gain below {gain_bound:.6g}" if gain_bound is not None else "be proved"
            notes.append(f"it was to be made for {target:.4g}; that was raised to {level:.4g} to {reason}")
        design = _finished(law, plant, posed, controller, level, norm, notes, points)
        if design.synthesis.controllers:
            return design
        kept_back = kept_back or design
        if gain_bound is not None:
            break
    if kept_back is not None:
        return kept_back
    message = "no law met its own bound: rescale the plant, or ask for less"
    if np.isfinite(least) and gain_bound is not None:
        message = f"no law with a gain below {gain_bound:.6g}: the smallest found is {least:.6g}; allow more gain"
    status = Status.INFEASIBLE if np.isfinite(least) else Status.NUMERICAL_ERROR
    return _record(refused(law, [plant], status, message), candidates[0], np.nan, np.nan, points)


def _attempts(
    candidates: Sequence[_Posed], back_off: float, gamma: float | None, gain_bound: float | None
) -> Iterator[tuple[_Posed, float, float]]:
    """Problem, target and level to try: as asked for; raised a little, or far, for a proof or a bound on the gain."""
    if gain_bound is not None:
        raises: tuple[tuple[float, ...], ...] = ((*1.02 ** np.arange(36.0), *(2.0 * 1.3 ** np.arange(1.0, 45.0))),)
    else:
        raises = ((1.0,),) if gamma is not None else ((1.0, 1.02, 1.05, 1.1), (1.5, 2.0))
    for factors in raises:
        for posed in candidates:
            target = gamma if gamma is not None else _target(posed, back_off)
            for factor in factors:
                yield posed, target, target * factor


def _finished(
    law: str,
    plant: Plant,
    posed: _Posed,
    controller: Controller,
    gamma: float,
    norm: float,
    notes: list[str],
    points: GainCurve,
) -> HInfinityDesign:
    """The norm by a second method, then the claims."""
    again = h_infinity_norm(*closed_channel(plant, controller), dt=plant.dt)
    nothing = max(norm, again.value) <= NOTHING * gamma
    if nothing:
        notes = [*notes, "the law leaves no gain but rounding"]
    elif again.difference > DOUBT or not np.isfinite(again.value):
        message = f"H-infinity norm of the closed loop: {again.message}"
        return _record(refused(law, [plant], Status.NOT_VERIFIED, message), posed, gamma, np.nan, points)
    synthesis = proved_law(
        law, plant, controller, norm=max(again.value, 1e-3 * gamma), energy=False, notes=notes,
        performance=[Performance("H-infinity norm", np.nan if nothing else norm, again.value)],
    )  # fmt: skip
    return _record(synthesis, posed, gamma, again.value, points)


def _norm(plant: Plant, controller: Controller) -> float:
    try:
        return bisected_norm(*closed_channel(plant, controller), dt=plant.dt, tolerance=1e-8).lower
    except (NotStable, LinAlgError):
        return np.inf


def _record(synthesis: Synthesis, posed: _Posed, gamma: float, norm: float, points: GainCurve) -> HInfinityDesign:
    return HInfinityDesign(
        synthesis, posed.smallest, gamma, norm, posed.bracket.limit, points, posed.shares, posed.infima
    )  # fmt: skip


def _none(synthesis: Synthesis) -> HInfinityDesign:
    empty = GainCurve(np.zeros(0), np.zeros(0))
    return HInfinityDesign(synthesis, np.nan, np.nan, np.nan, "unknown", empty)
