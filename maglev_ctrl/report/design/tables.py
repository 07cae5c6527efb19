"""Tables of a design: claims and proofs, numbers reported and recomputed, corners, gains, sampling, cost of damping."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from maglev_ctrl.analysis.margins import Margins
from maglev_ctrl.errors import Verdict
from maglev_ctrl.report.design.words import claim_units, claim_words, short_names
from maglev_ctrl.report.model import Cell, Table, cell, row
from maglev_ctrl.report.style import ABSENT, number
from maglev_ctrl.study.design.budgeted import shown_damping
from maglev_ctrl.study.design.records import LawStudy, PredictiveStudy, SampledLaw
from maglev_ctrl.synthesis.damping.budget import DampingBudget

MOST_ENTRIES = 60
MOST_ROWS = 6
"""More rows than this are set small."""
MOST_PLACES = 4
"""A table of more places than this tells the cost of each alone in the figure only."""
COMPARED, ALONE = 7, 5
"""Digits of numbers that stand beside what was reported, and of those that stand alone."""
GAIN = "gain of the law"
_METHODS = {"tustin": "Tustin's rule", "hold": "held measurements"}


def claim_table(option: LawStudy) -> Table:
    """Every claim in a sentence, whether it is proved, by how much and by what."""
    assert option.synthesis is not None
    units = claim_units(option)
    rows = tuple(
        (cell(claim_words(option.synthesis, i, units)), cell(Verdict.PASS if proof.holds else Verdict.FAIL),
         cell(number(proof.margin)), cell(proof.method if proof.holds else proof.reason))
        for i, proof in enumerate(option.synthesis.proofs)
    )  # fmt: skip
    caption = (
        f"Claims of {option.label}; numbers rounded to the safe side. Margin: smallest eigenvalue of the inequality, "
        "scaled to a largest of about one"
    )
    return Table(caption, ("Claim", "Proved", "Margin", "By"), rows, (4.2, 0.9, 0.8, 1.4), (2,), True)


def performance_table(option: LawStudy) -> Table:
    """Numbers a solver reported, where it did, beside the same numbers found again from the closed loop."""
    assert option.synthesis is not None
    numbers = option.synthesis.performance
    reported = any(not np.isnan(one.reported) for one in numbers)
    rows = []
    for one in numbers:
        unit = _gain_unit(option) if one.quantity == GAIN else one.unit
        digits = COMPARED if not np.isnan(one.reported) else ALONE
        told = [ABSENT if np.isnan(one.reported) else number(one.reported, unit, digits=digits)] if reported else []
        rows.append(row(one.quantity, *told, number(one.recomputed, unit, digits=digits)))
    if not reported:
        caption = f"Numbers of {option.label}, computed from the closed loop by independent code"
        return Table(caption, ("Quantity", "Computed"), tuple(rows), (3.6, 1.2), (1,), len(rows) > MOST_ROWS)
    caption = f"Numbers of {option.label}: as the synthesis reports them, and computed again by independent code"
    heads = ("Quantity", "Reported", "Recomputed")
    return Table(caption, heads, tuple(rows), (3.6, 1.2, 1.2), (1, 2), len(rows) > MOST_ROWS)


def corner_table(option: LawStudy) -> Table:
    """Rightmost poles without and with the law, at every operating point."""
    rows = tuple(
        row(corner.name, number(float(np.max(corner.open_loop.real)), "1/s"),
            number(float(np.max(corner.closed_loop.real)), "1/s"), number(_least_damping(corner.closed_loop)))
        for corner in option.corners
    )  # fmt: skip
    caption = f"Operating points {option.label} has to hold at: rightmost poles and least damping ratio"
    heads = ("Operating point", "Without the law", "With the law", "Least damping ratio")
    return Table(caption, heads, rows, (3.0, 1.1, 1.1, 1.1), (1, 2, 3), True)


def gain_table(option: LawStudy) -> Table | None:
    """The gains of a constant law as it was proved; None for a dynamic one, whose poles are told elsewhere."""
    synthesis = option.synthesis
    if option.design is None or synthesis is None or len(synthesis.controllers) != 1:
        return None
    law = synthesis.controllers[0]
    if law.states:
        return None
    entries = [
        (law.commands[i], law.measured[j], float(law.D[i, j]))
        for i in range(law.D.shape[0])
        for j in range(law.D.shape[1])
        if law.D[i, j] != 0.0
    ]
    entries.sort(key=lambda entry: entry[:2])
    units = claim_units(option)
    rows = tuple(
        row(name, seen, number(value, digits=5), _unit_of_gain(units, name, seen))
        for name, seen, value in entries[:MOST_ENTRIES]
    )
    more = len(entries) - len(rows)
    caption = f"Gains of {option.label}: u = gain x measurement"
    if option.predictive is not None:
        caption += ", of the sampled law that acts where a step fails"
    caption += f" ({more} more are in design.json)" if more > 0 else ""
    return Table(caption, ("Command", "Measured", "Gain", "Unit"), rows, (1.6, 2.2, 1.2, 1.0), (2,), True)


def _unit_of_gain(units: Mapping[str, str], command: str, measured: str) -> str:
    per = units.get(measured, "")
    per = f"({per})" if "/" in per else per
    return f"{units[command]}/{per}" if per and command in units else "SI"


def _gain_unit(option: LawStudy) -> str:
    """The unit all gains of the law share; "SI" where they differ, and the largest of all has none of its own."""
    assert option.synthesis is not None
    law, units = option.synthesis.controllers[0], claim_units(option)
    found = {_unit_of_gain(units, law.commands[i], law.measured[j]) for i, j in np.argwhere(law.D)}
    return found.pop() if len(found) == 1 else "SI"


def sampled_table(sampled: SampledLaw) -> Table:
    """Smallest margins of the continuous loop beside those of the sampled one."""
    loss = sampled.loss
    assert loss is not None
    rows: list[tuple[Cell, ...]] = []
    before, after = smallest_margins(loss.continuous), smallest_margins(loss.sampled)
    names = (("gain margin", "dB"), ("phase margin", "deg"), ("disk margin, all channels", ""))
    for (name, unit), old, new in zip(names, before, after, strict=True):
        lost = 0.0 if abs(old - new) < 1e-6 * abs(old) else old - new
        told = number(lost, unit) if not lost < 0.0 else f"gained {number(-lost, unit)}"
        rows.append(row(name, number(old, unit), number(new, unit), told))
    stable = "stable" if loss.stable else "NOT STABLE"
    limit = loss.largest_period
    reach = f"{number(1e3 * limit.value, 'ms')}{'' if limit.verified else ' (not verified)'}"
    caption = (
        f"The law sampled every {number(1e3 * sampled.period, 'ms')} ({_METHODS[loss.method]}), commands held between "
        f"samples, actuator delays left out: {stable}, spectral radius {number(loss.spectral_radius, digits=6)}. "
        f"Largest period that keeps the loop stable: {reach}"
    )
    return Table(caption, ("Margin", "Continuous", "Sampled", "Lost"), tuple(rows), (2.0, 1.0, 1.0, 1.0), (1, 2, 3))


def smallest_margins(margins: Margins | None) -> tuple[float, float, float]:
    """Smallest gain margin (dB) and phase margin (deg) of any channel, and the proven disk margin of all at once."""
    if margins is None:
        return float("nan"), float("nan"), float("nan")
    gains = [min(abs(one.gain_reduction.decibel), one.gain_increase.decibel) for one in margins.channels]
    phases = [one.phase.value for one in margins.channels]
    return min(gains), min(phases), margins.multi_loop.alpha_proven


def budget_table(budget: DampingBudget, chosen: float) -> Table:
    """Cost and damping at each place for every margin of the curve."""
    together, rate = budget.together, budget.quantity == "decay rate"
    damping, names = shown_damping(together.damping), short_names(together.places)
    single = [(name, curve) for name, curve in zip(names, budget.alone, strict=False) if np.any(curve.certified)]
    single = single if len(names) <= MOST_PLACES else []
    rows: list[tuple[Cell, ...]] = []
    for i, margin in enumerate(together.margin):
        proved = Verdict.PASS if together.certified[i] else Verdict.NOT_EVALUATED
        rows.append((
            cell(number(float(margin), "1/s" if rate else "") + (" (chosen)" if margin == chosen else "")),
            *(cell(number(1e-3 * float(c))) for c in damping[i]),
            cell(number(1e-3 * float(together.cost[i]))), cell(number(1e-3 * float(together.lower_bound[i]))),
            cell(number(1e-3 * float(together.marginal[i]))), cell(proved),
            *(cell(number(1e-3 * float(curve.cost[i]))) for _, curve in single),
        ))  # fmt: skip
    heads = (
        budget.quantity.capitalize(), *names, "Cost", "No less than", f"Cost per {'1/s' if rate else 'unit'}", "Proved",
        *(f"Cost, {name} only" for name, _ in single),
    )  # fmt: skip
    caption = (
        f"Damping at each place, kN s/m, and the least cost found, weighted kN s/m; proved for {budget.guarantee}"
        f"{' of the operating points' if budget.guarantee == 'every constant blend' else ''}"
    )
    widths = (1.4, *(1.0 for _ in names), 0.8, 0.9, 0.9, 0.9, *(1.1 for _ in single))
    return Table(
        caption, heads, tuple(rows), widths, tuple(k for k in range(1, len(heads)) if k != len(names) + 4), True
    )


def manoeuvre_table(predictive: PredictiveStudy) -> Table:
    """How far limited signals went, and for how long outside their limits, with and without prediction."""
    step = float(predictive.time[1] - predictive.time[0])
    rows: list[tuple[Cell, ...]] = []
    for signal in predictive.signals:
        if not np.isfinite(signal.limit):
            continue
        told = [cell(signal.name), cell(number(signal.scale * signal.limit, signal.unit))]
        for course in (signal.predicted, signal.saturated):
            beyond = step * int(np.sum(np.abs(course) > signal.limit * (1.0 + 1e-6)))
            told += [cell(number(signal.scale * float(np.max(np.abs(course))), signal.unit)), cell(number(beyond, "s"))]
        rows.append(tuple(told))
    heads = ("Signal", "Limit", "Largest, prediction", "Outside for", "Largest, saturated law", "Outside for")
    caption = "How far the limited signals went in the manoeuvre, and for how long outside their limits"
    return Table(caption, heads, tuple(rows), (2.0, 1.0, 1.2, 0.8, 1.2, 0.8), (1, 2, 3, 4, 5))


def _least_damping(poles: np.ndarray[tuple[int, ...], np.dtype[np.complex128]]) -> float:
    swinging = poles[np.abs(poles.imag) > 1e-9 * np.abs(poles)]
    return float(np.min(-swinging.real / np.abs(swinging))) if swinging.size else float("nan")
