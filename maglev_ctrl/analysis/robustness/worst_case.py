"""The worst case of a closed loop within the stated spreads: proven where possible, found by search where not."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from maglev_ctrl.analysis.disk import multi_loop_disk
from maglev_ctrl.analysis.loops import Loop, balanced
from maglev_ctrl.analysis.robustness.exact_delays import DelayedPlant, delayed_loop, stable_with_exact_delays
from maglev_ctrl.analysis.robustness.factor import EFFORT, LATE, bounded, prove_box
from maglev_ctrl.analysis.robustness.parameters import UncertainParameter, perturbed_system
from maglev_ctrl.analysis.robustness.records import FactorBounds, WorstCase, WorstPoint
from maglev_ctrl.analysis.robustness.search import (
    corners,
    fastest_growth,
    growth_rates,
    least_damped,
    least_damping_ratios,
    modal_corners,
    smallest_damping,
)
from maglev_ctrl.analysis.robustness.uncertain_loop import UncertainLoop, uncertain_loop
from maglev_ctrl.analysis.robustness.work import Work
from maglev_ctrl.analysis.stability_gate import close
from maglev_ctrl.arrays import FloatArray, read_only_any
from maglev_ctrl.errors import Agreement, ModelError, NotStable, Verdict
from maglev_ctrl.systems import Controller, SecondOrderSystem, close_loop

_STARTS = 3
_SAME = 1e-6
_DISK_POINTS = 24
_DISK_ROUNDS = 4
_FACTOR_SHARE = 0.75
_BRACKET = 1e-3
_GATE = {True: "stable", False: "unstable", None: "not settled"}
Assembled = Callable[[FloatArray], SecondOrderSystem]


def worst_case(
    plant: SecondOrderSystem,
    controller: Controller | None,
    parameters: Sequence[UncertainParameter],
    *,
    effort: float = EFFORT,
    time_limit: float | None = None,
    delayed: DelayedPlant | None = None,
) -> WorstCase:
    """Worst growth rate, damping ratio and disk margin within the spreads, and by what factor the spreads may grow.

    Parameters
    ----------
    controller : continuous; None for a passive option, which has no disk margin
    effort : units of `Work` for the proofs, about a microsecond each; equal efforts give equal results everywhere
    time_limit : s, an emergency stop; None: the clock is never looked at. Where it strikes, `reason` says so
    delayed : the plant without its delays' Pade forms, to look again with exact delays at the points found

    Raises
    ------
    NotStable : the nominal loop is not stable
    ValueError, ModelError : what `uncertain_loop` refuses

    Examples
    --------
    >>> plant = SecondOrderSystem.from_matrices([[1.0]], [[0.2]], [[4.0]])
    >>> found = worst_case(plant, None, [UncertainParameter("c", "damping", 0.5, ("matrices",))])
    >>> found.stable.value, round(found.damping.value, 6), round(found.factor.limit, 3)
    ('PASS', 0.025, 1.998)
    """
    began, work = time.perf_counter(), Work(effort, time_limit=time_limit)
    loop = uncertain_loop(plant, controller, parameters)
    nominal = np.linalg.eigvals(loop.A)
    if np.any(nominal.real >= 0.0):
        top = nominal[int(np.argmax(nominal.real))]
        raise NotStable(f"the nominal loop is not stable: pole at {top:.6g} 1/s; worst cases of it mean nothing")

    def assembled(changes: FloatArray) -> SecondOrderSystem:
        return perturbed_system(plant, parameters, changes * loop.spreads)

    def state_matrix(changes: FloatArray) -> FloatArray:
        system = assembled(changes)
        return (system if controller is None else close_loop(system, controller)).state_matrix()

    bounds = bounded(loop, work.part(_FACTOR_SHARE), assembled=state_matrix)
    spread = min(1.0, bounds.limit)
    signs = np.vstack([corners(len(loop.blocks)), modal_corners(loop, np.array([0.5 * spread, spread]))])
    points = spread * np.unique(signs, axis=0)
    growth = _worst_growth(loop, points, spread, state_matrix)
    stable, reason = _verdict(loop, bounds, growth, work)
    damping = _worst_damping(loop, points, spread, state_matrix)
    disk = _worst_disk(loop, controller, assembled, points, (growth, damping))
    exact = ""
    if delayed is not None and controller is not None:
        exact, stable, bounds, reason = _with_exact_delays(
            loop, (delayed, controller, parameters), growth, stable, bounds, reason
        )
    resolved = stable is not Verdict.NOT_EVALUATED and all(point.verified for point in (growth, damping))
    if work.late():
        reason = f"{reason}; {LATE}" if reason else LATE
    return WorstCase(
        names=loop.names, spreads=loop.spreads, stable=stable, factor=bounds, growth=growth, damping=damping, disk=disk,
        agreement=Agreement.AGREED if resolved else Agreement.UNRESOLVED, reason=reason,
        seconds=time.perf_counter() - began, exact_delays=exact,
    )  # fmt: skip


def _verdict(loop: UncertainLoop, bounds: FactorBounds, growth: WorstPoint, work: Work) -> tuple[Verdict, str]:
    if bounds.found <= 1.0:
        return Verdict.FAIL, (
            f"robustly unstable: already {bounds.found:.4g} of the spreads hold a combination with a pole on the axis, "
            f"replayed in the model assembled again: {changes_words(loop, bounds.changes)}"
        )
    if growth.verified and growth.value >= 0.0:
        return Verdict.FAIL, _unstable_inside(loop, growth.changes)
    if bounds.limit < 1.0:
        return Verdict.NOT_EVALUATED, "a spread of 100 % or more lets a parameter fall to zero"
    if bounds.proven >= 1.0:
        return Verdict.PASS, ""
    outcome = prove_box(loop, factor=1.0, work=work)
    if outcome.stable:
        return Verdict.PASS, f"proven in {outcome.boxes} parts"
    if outcome.stable is False and outcome.point is not None:
        return Verdict.FAIL, _unstable_inside(loop, outcome.point)
    return Verdict.NOT_EVALUATED, (
        "UNRESOLVED: neither proven stable nor shown unstable within the spreads. No unstable combination was found in "
        f"them, but stability is proven up to {bounds.proven:.4g} of them only"
        + (f"; the smallest unstable combination found needs {bounds.found:.4g}" if np.isfinite(bounds.found) else "")
    )


def _unstable_inside(loop: UncertainLoop, changes: FloatArray) -> str:
    return f"robustly unstable: within the spreads, this combination is unstable: {changes_words(loop, changes)}"


def changes_words(loop: UncertainLoop, changes: FloatArray) -> str:
    """A combination in words, in percent of the parameters.

    Examples
    --------
    >>> loop = UncertainLoop.from_affine([[-1.0]], [[[1.0]]], names=("stiffness",), spreads=[0.2])
    >>> changes_words(loop, np.array([-0.5]))
    'stiffness -10 %'
    """
    percent = 100.0 * changes * loop.spreads
    return ", ".join(f"{name} {value:+.3g} %" for name, value in zip(loop.names, percent, strict=True))


def _with_exact_delays(
    loop: UncertainLoop,
    model: tuple[DelayedPlant, Controller, Sequence[UncertainParameter]],
    growth: WorstPoint,
    stable: Verdict,
    bounds: FactorBounds,
    reason: str,
) -> tuple[str, Verdict, FactorBounds, str]:
    """The points found, through the stability gate with exact delays: words, and verdicts where they do not hold up."""

    def holds(changes: FloatArray) -> bool | None:
        return stable_with_exact_delays(delayed_loop(*model, changes * loop.spreads))

    told: list[str] = []
    if growth.value < 0.0:
        inside = holds(growth.changes)
        told.append(f"at the worst growth within the spreads {_GATE[inside]}")
        if inside is False:
            stable = Verdict.FAIL
            reason = f"with exact delays {_unstable_inside(loop, growth.changes)}"
    if np.isfinite(bounds.found):
        below, beyond = (holds(share * bounds.changes) for share in (1.0 - _BRACKET, 1.0 + _BRACKET))
        percent = 100.0 * _BRACKET
        told.append(f"{percent:g} % below the found factor {_GATE[below]}, {percent:g} % above it {_GATE[beyond]}")
        if below is False or beyond is True:
            doubt = "UNRESOLVED: with exact delays the found combination is not where stability ends"
            bounds = replace(
                bounds, agreement=Agreement.UNRESOLVED, reason="; ".join(one for one in (bounds.reason, doubt) if one)
            )
    return "with exact delays: " + "; ".join(told) if told else "", stable, bounds, reason


def _worst_growth(
    loop: UncertainLoop, points: FloatArray, spread: float, state_matrix: Callable[[FloatArray], FloatArray]
) -> WorstPoint:
    rates = growth_rates(loop, points)
    order = np.argsort(-rates)[:_STARTS]
    found = [(float(rates[order[0]]), points[order[0]])]
    found += [fastest_growth(loop, points[k], size=spread) for k in order]
    value, changes = max(found, key=lambda pair: pair[0])
    poles = np.linalg.eigvals(state_matrix(changes))
    top = poles[int(np.argmax(poles.real))]
    scale = float(np.max(np.abs(poles)))
    nominal = float(growth_rates(loop, np.zeros((1, changes.size)))[0])
    return _point(loop, nominal, value, changes, abs(top.imag), abs(top.real - value) <= _SAME * scale, "")


def _worst_damping(
    loop: UncertainLoop, points: FloatArray, spread: float, state_matrix: Callable[[FloatArray], FloatArray]
) -> WorstPoint:
    nominal, _ = least_damped(np.linalg.eigvals(loop.A).astype(np.complex128))
    ratios = least_damping_ratios(loop, points)
    if not np.any(np.isfinite(ratios)) and not np.isfinite(nominal):
        return _nothing(loop, "no mode oscillates")
    order = np.argsort(np.where(np.isfinite(ratios), ratios, np.inf))[:_STARTS]
    found = [(float(ratios[order[0]]), points[order[0]])]
    found += [smallest_damping(loop, points[k], size=spread) for k in order if np.isfinite(ratios[k])]
    value, changes = min(found, key=lambda pair: pair[0])
    again, frequency = least_damped(np.linalg.eigvals(state_matrix(changes)).astype(np.complex128))
    return _point(loop, nominal, value, changes, frequency, abs(again - value) <= _SAME, "")


def _worst_disk(
    loop: UncertainLoop,
    controller: Controller | None,
    assembled: Assembled,
    points: FloatArray,
    known: tuple[WorstPoint, ...],
) -> WorstPoint:
    """Corners and the points found for growth and damping, then single parameters turned round; the worst in full.

    A quick bound ranks them.
    """
    if controller is None:
        return _nothing(loop, "there is no loop to break")
    if any(point.value >= 0.0 for point in known[:1]):
        return _nothing(loop, "an unstable combination lies within the spreads: it has no margin")
    p = len(loop.blocks)
    rates = growth_rates(loop, points)
    ranked = points[np.argsort(-rates)][:_DISK_POINTS]
    places = [np.zeros(p), *(point.changes for point in known if np.all(np.isfinite(point.changes))), *ranked]
    try:
        nominal = _disk(controller, assembled, np.zeros(p))
        quick = [_quick_disk(controller, assembled, place) for place in places]
        least, place = min(quick), places[int(np.argmin(quick))]
        for _ in range(_DISK_ROUNDS):
            around = [np.where(np.arange(p) == k, -place, place) for k in range(p)]
            quick = [_quick_disk(controller, assembled, one) for one in around]
            if min(quick) >= least * (1.0 - _SAME):
                break
            least, place = min(quick), around[int(np.argmin(quick))]
        worst = _disk(controller, assembled, place)
    except (NotStable, ModelError, np.linalg.LinAlgError) as fault:
        return _nothing(loop, f"{fault}")
    return _point(loop, nominal[0], worst[0], place, worst[1], bool(np.isfinite(worst[0])), worst[2])


def _disk(controller: Controller, assembled: Assembled, changes: FloatArray) -> tuple[float, float, str]:
    margin = multi_loop_disk(close(Loop.from_system(assembled(changes), controller)))
    return margin.alpha, margin.frequency, margin.reason


def _quick_disk(controller: Controller, assembled: Assembled, changes: FloatArray) -> float:
    """Disk margin from above on a grid: one over the largest spectral radius of S - I/2."""
    loop = balanced(Loop.from_system(assembled(changes), controller))
    m = len(loop.channels)
    R = np.linalg.inv(np.eye(m) + loop.D)
    A = loop.A - loop.B @ R @ loop.C
    poles = np.linalg.eigvals(A)
    size = np.abs(poles[np.abs(poles) > 0.0])
    frequencies = np.unique(
        np.concatenate([np.abs(poles.imag), size, np.geomspace(0.1 * size.min(), 10 * size.max(), 40)])
    )
    pencil = 1j * frequencies[:, None, None] * np.eye(A.shape[0]) - A
    inner = np.linalg.solve(pencil, np.broadcast_to((loop.B @ R).astype(complex), (frequencies.size, *loop.B.shape)))
    N = R - 0.5 * np.eye(m) - R @ loop.C @ inner
    return float(1.0 / np.max(np.abs(np.linalg.eigvals(N))))


def _point(
    loop: UncertainLoop,
    nominal: float,
    value: float,
    changes: FloatArray,
    frequency: float,
    verified: bool,
    reason: str,
) -> WorstPoint:
    if not verified and not reason:
        reason = "UNRESOLVED: the model assembled again at this point gives another value"
    return WorstPoint(
        nominal=float(nominal), value=float(value), changes=read_only_any(changes),
        percent=read_only_any(100.0 * changes * loop.spreads), frequency=float(frequency), verified=bool(verified),
        reason=reason,
    )  # fmt: skip


def _nothing(loop: UncertainLoop, reason: str) -> WorstPoint:
    blank = read_only_any(np.full(len(loop.blocks), np.nan))
    return WorstPoint(np.nan, np.nan, blank, blank, np.nan, False, reason)
