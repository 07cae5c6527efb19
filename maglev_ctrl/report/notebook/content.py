"""What a notebook shows of each kind of result, as blocks: tables first, then a figure where there is one."""

from __future__ import annotations

from dataclasses import dataclass
from functools import singledispatch
from typing import Final

import numpy as np

from maglev_ctrl.analysis.floquet import Floquet
from maglev_ctrl.analysis.ledger import Ledger
from maglev_ctrl.analysis.margins import ChannelMargins, Margins
from maglev_ctrl.analysis.modes import Modes, StabilityVerdict
from maglev_ctrl.analysis.plane_records import NO_ANSWER, STABLE, UNRESOLVED, UNSTABLE, StabilityPlane
from maglev_ctrl.analysis.resonance_map import ResonanceMap
from maglev_ctrl.analysis.response.records import RideResponse
from maglev_ctrl.analysis.robustness.records import WorstCase
from maglev_ctrl.analysis.simulation.records import Trajectory
from maglev_ctrl.analysis.tracking import ModeTracks
from maglev_ctrl.errors import Agreement, Verdict
from maglev_ctrl.report.chart import Chart
from maglev_ctrl.report.charts_modes import ledger_chart
from maglev_ctrl.report.charts_periodic import tongue_words
from maglev_ctrl.report.content_margins import margin_blocks
from maglev_ctrl.report.content_option import mode_table
from maglev_ctrl.report.content_robustness import worst_case_blocks
from maglev_ctrl.report.groups import ledger_groups
from maglev_ctrl.report.model import Banner, Block, Bullets, Cell, FigureBlock, Table, cell, row
from maglev_ctrl.report.notebook.charts import (
    axis_quantity,
    eigenvalue_chart,
    motion_chart,
    multiplier_chart,
    plane_chart,
    resonance_chart,
    track_chart,
)
from maglev_ctrl.report.ride.charts import along_the_car
from maglev_ctrl.report.ride.content import agreement_block
from maglev_ctrl.report.ride.tables import actuator_table, clearance_table, passenger_table
from maglev_ctrl.report.style import ABSENT, number

MOST_ROWS: Final = 20
_MOST_MODES: Final = 8


@dataclass(frozen=True, eq=False, slots=True)
class Alone:
    """A result that belongs to no option: what its figures and tables call it."""

    name: str
    label: str


@singledispatch
def blocks_of(record: object) -> list[Block]:
    """Tables and figures of a result; none for what has no page of its own."""
    return []


def figure(chart: Chart | None) -> list[Block]:
    """A figure, where there is one."""
    return [] if chart is None else [FigureBlock(chart)]


def left_out(count: int) -> str:
    """That a table holds only the first rows."""
    return f" (first {MOST_ROWS} of {count})" if count > MOST_ROWS else ""


@blocks_of.register
def _modes(found: Modes) -> list[Block]:
    verdicts = {StabilityVerdict.STABLE: Verdict.PASS, StabilityVerdict.UNSTABLE: Verdict.FAIL}
    least = found.labels[found.critical]
    growth = number(found.spectral_abscissa, "1/s")
    told = f"{found.verdict.value.capitalize()}: largest growth rate {growth} ({least})."
    return [
        Banner(verdicts.get(found.verdict, Verdict.NOT_EVALUATED), told),
        mode_table(found, "the system"),
        *figure(eigenvalue_chart(found.s, found.labels, key="modes", what="the system")),
        *figure(ledger_chart(found, ledger_groups(None, found.ledger), "the system", key="modes")),
    ]  # fmt: skip


@blocks_of.register
def _ledger(found: Ledger) -> list[Block]:
    total = found.damping + found.circulatory
    size = np.nansum(np.abs(total), axis=1)
    order = np.argsort(-size, kind="stable")[:MOST_ROWS]
    shown = range(min(total.shape[1], _MOST_MODES))
    rows = [row(found.elements[e], *(number(float(total[e, k])) for k in shown)) for e in order]
    rows.append(row("Sum: growth rate", *(number(float(found.growth[k])) for k in shown)))
    more = f", first {_MOST_MODES} modes" if total.shape[1] > _MOST_MODES else ""
    heads = ("Element", *(f"Mode {k + 1}" for k in shown))
    caption = (
        f"Energy ledger in 1/s{more}{left_out(len(found.elements))}: what each element adds to a mode's growth rate, "
        "through damping and circulatory stiffness together"
    )
    return [Table(caption, heads, tuple(rows), right=tuple(range(1, len(heads))))]


@blocks_of.register
def _tracks(found: ModeTracks) -> list[Block]:
    rows = []
    for k, label in enumerate(found.labels[:MOST_ROWS]):
        s = found.s[:, k][np.isfinite(found.s[:, k].real)]
        hertz = s.imag / (2.0 * np.pi)
        lowest = float(np.nanmin(found.confidence[:, k]))
        rows.append(
            row(label, f"{number(float(hertz.min()))} to {number(float(hertz.max()), 'Hz')}",
                f"{number(float(s.real.min()))} to {number(float(s.real.max()), '1/s')}", number(lowest))
        )  # fmt: skip
    first, last = (number(float(v)) for v in found.parameter[[0, -1]])
    caption = (
        f"Modes followed over {len(found.parameter)} points from {first} to {last} (SI){left_out(len(found.labels))}"
    )
    heads = ("Mode", "Frequency", "Growth rate", "Least confidence")
    return [Table(caption, heads, tuple(rows), right=(1, 2, 3)), *figure(track_chart(found))]


@blocks_of.register
def _margins(found: Margins) -> list[Block]:
    return margin_blocks(found, "the loop")


@blocks_of.register
def _channel(found: ChannelMargins) -> list[Block]:
    named = (
        ("Gain reduction", found.gain_reduction, "dB"), ("Gain increase", found.gain_increase, "dB"),
        ("Phase", found.phase, "deg"), ("Phase lag", found.phase_lag, "deg"), ("Phase lead", found.phase_lead, "deg"),
        ("Delay", found.delay, "s"), ("Modulus", found.modulus, ""),
    )  # fmt: skip
    rows = tuple(
        row(name, number(one.decibel if unit == "dB" else one.value, unit),
            number(one.frequency / (2.0 * np.pi), "Hz"), "yes" if one.verified else f"no: {one.reason}")
        for name, one, unit in named
    )  # fmt: skip
    return [Table(f"Margins of {found.channel}", ("Margin", "Value", "At", "Verified"), rows, right=(1, 2))]


@blocks_of.register
def _floquet(found: Floquet) -> list[Block]:
    stable = found.stable
    verdict = Verdict.NOT_EVALUATED if stable is None else (Verdict.PASS if stable else Verdict.FAIL)
    state = "UNRESOLVED" if stable is None else ("Stable" if stable else "Unstable")
    engines = "agree" if found.agreement is Agreement.AGREED else "do not agree"
    words = (
        f"{state}: largest growth rate {number(found.growth_rate, '1/s')} ± "
        f"{number(found.growth_error, '1/s', digits=1)}, period {number(found.period, 's')}; the two engines {engines}."
    )
    rows = tuple(
        row(str(k + 1), number(float(abs(z)), digits=6), number(float(s.real), "1/s"),
            number(float(s.imag), "rad/s"), number(float(error), "1/s", digits=1))
        for k, (z, s, error) in enumerate(
            zip(found.multipliers[:MOST_ROWS], found.exponents, found.error_bound, strict=False)
        )
    )  # fmt: skip
    caption = f"Floquet multipliers and exponents, fastest growth first{left_out(len(found.multipliers))}"
    heads = ("No.", "Modulus of multiplier", "Growth rate", "Angular frequency", "± error")
    return [Banner(verdict, words), Table(caption, heads, rows, right=(1, 2, 3, 4)), *figure(multiplier_chart(found))]


@blocks_of.register
def _resonance_map(found: ResonanceMap) -> list[Block]:
    rows = []
    for index, tongue in enumerate(found.tongues):
        inside = (found.tongue_index == index) & found.unstable
        if not inside.any():
            continue
        columns, depths = np.flatnonzero(inside.any(axis=1)), np.flatnonzero(inside.any(axis=0))
        ends = found.parameter[columns[[0, -1]]]
        rows.append(row(tongue_words(tongue.name), number(100.0 * float(found.depths[depths[0]]), "%"),
                        f"{number(float(ends[0]))} to {number(float(ends[1]))}",
                        number(float(found.growth_rate[inside].max()), "1/s")))  # fmt: skip
    doubt = int(np.sum(found.unresolved))
    apart = found.check_difference[np.isfinite(found.check_difference)]
    checked = (
        f"{len(found.checked)} points checked by a second engine, largest difference "
        f"{number(float(apart.max()) if apart.size else float('nan'), '1/s', digits=1)}"
    )
    banner = (
        [Banner(Verdict.NOT_EVALUATED, f"{doubt} points are UNRESOLVED: the engines do not agree.")] if doubt else []
    )
    caption = f"Unstable tongues of the map; {checked}{left_out(len(rows))}"
    heads = ("Tongue", "From depth", f"{found.parameter_name} (SI)", "Largest growth rate")
    body = tuple(rows[:MOST_ROWS]) or (row("none on this map", ABSENT, ABSENT, ABSENT),)
    return [*banner, Table(caption, heads, body, right=(1, 2, 3)), *figure(resonance_chart(found))]


@blocks_of.register
def _plane(found: StabilityPlane) -> list[Block]:
    states = ((STABLE, "stable"), (UNSTABLE, "unstable"), (UNRESOLVED, "UNRESOLVED"), (NO_ANSWER, "no answer"))
    rows = tuple(row(words, number(100.0 * found.share(state), "%")) for state, words in states)
    x, y = axis_quantity(found.x), axis_quantity(found.y)
    caption = (
        f"Share of {found.state.size} points over {x.label} and {y.label}; {found.evaluated} of them computed, "
        f"{len(found.checked)} decided again by a second engine"
    )
    faults: list[Block] = [Bullets(found.faults[:MOST_ROWS])] if found.faults else []
    return [Table(caption, ("State", "Share"), rows, right=(1,)), *faults, *figure(plane_chart(found))]


@blocks_of.register
def _ride(found: RideResponse) -> list[Block]:
    here = Alone("ride", f"the loop at {number(found.speed * 3.6, 'km/h')}")
    blocks: list[Block] = [agreement_block(found)]
    blocks += [passenger_table(found, here.label)] if found.passengers else []
    blocks += [clearance_table(found, here.label)] if found.clearances else []
    blocks += [actuator_table(found, here.label)] if found.actuators else []
    return [*blocks, *figure(along_the_car(here, found))]


@blocks_of.register
def _worst_case(found: WorstCase) -> list[Block]:
    return worst_case_blocks(found, "the loop")


@blocks_of.register
def _trajectory(found: Trajectory) -> list[Block]:
    runs = len(found.ends)
    rows: list[tuple[Cell, ...]] = []
    for name in list(found.signals)[:MOST_ROWS]:
        values = np.asarray(found.signals[name])
        known = values[np.isfinite(values)]
        deviation, largest = (float(np.std(known)), float(np.max(np.abs(known)))) if known.size else (np.nan, np.nan)
        rows.append(row(name, number(deviation), number(largest)))
    caption = (
        f"{runs} runs of {number(float(found.time[-1]), 's')}, steps of {number(1e3 * found.step, 'ms')}; half the "
        f"step changes the motion by {number(found.step_error, digits=2)} of its largest{left_out(len(found.signals))}"
    )
    heads = ("Signal (SI)", "Standard deviation", "Largest")
    events = tuple(f"run {e.run + 1} ended after {number(e.time, 's')}: {e.reason}" for e in found.events[:MOST_ROWS])
    told: list[Block] = [Bullets(events)] if events else []
    return [*told, Table(caption, heads, tuple(rows), right=(1, 2)), *figure(motion_chart(found))]


def fact_table(caption: str, facts: list[tuple[str, str | Verdict]]) -> Table:
    """Names and values side by side."""
    return Table(caption, ("Item", "Value"), tuple((cell(name), cell(value)) for name, value in facts))
