"""The pages of one option: what it is, its verdicts, modes, margins, periodic stability and controller."""

from __future__ import annotations

from typing import Final

import numpy as np

from maglev_ctrl.analysis.modes import Modes
from maglev_ctrl.errors import Agreement, Verdict
from maglev_ctrl.report.charts_modes import boundary_words, energy_ledger, other_sweeps, root_locus, speed_chart
from maglev_ctrl.report.charts_periodic import resonance_chart, resonance_words, tongue_tips, tongue_words
from maglev_ctrl.report.charts_shapes import mode_shapes
from maglev_ctrl.report.content_margins import option_margin_blocks
from maglev_ctrl.report.content_nonlinear import nonlinear_blocks
from maglev_ctrl.report.content_periodic import floquet_margin_blocks
from maglev_ctrl.report.content_robustness import robustness_blocks
from maglev_ctrl.report.equations import FLOQUET, LEDGER, LYAPUNOV, MOTION, RESONANCE, SHARES
from maglev_ctrl.report.findings import unforced_warning
from maglev_ctrl.report.groups import largest_feeder
from maglev_ctrl.report.model import Banner, Block, Bullets, FigureBlock, Paragraph, Section, Table, row
from maglev_ctrl.report.ride import ride_blocks
from maglev_ctrl.report.ride.summary import at_design
from maglev_ctrl.report.style import ABSENT, SIGMA, number
from maglev_ctrl.report.values import breakable, judged_cell, margin_words, reason_words, value_words, with_prefix
from maglev_ctrl.study.records import Comparison, FloquetStudy, OptionStudy, Sweep
from maglev_ctrl.synthesis.design import Design
from maglev_ctrl.systems import SecondOrderSystem
from maglev_ctrl.vehicle import magnet_circuits
from maglev_ctrl.vehicle.operating import Hold

_MOST_MODES = 12
_MOST_TONGUES = 12
_KILOMETRES_PER_HOUR = 3.6
NO_LEDGER: Final = (
    "No energy ledger is drawn: it splits the growth rate of oscillating modes, and none here has shares that stand "
    "out of the error of the computation."
)
HELD: Final[dict[Hold, str]] = {
    "height": "height (magnet currents trimmed at every point)",
    "strength": "magnet strength (the height follows)",
    "frozen": "height and magnet strength as given (what is out of balance remains)",
}


def option_section(comparison: Comparison, option: OptionStudy, place: int) -> list[Section]:
    """The option's chapter: an overview and its parts as sub-sections."""
    anchor = f"option-{place + 1}"
    overview: list[Block] = [Banner(option.verdict, verdict_words(option))]
    told = (*option.summary, *_force_limits(option))
    if told:
        overview.append(Bullets(told))
    warning = unforced_warning(option)
    if warning:
        overview.append(Paragraph(f"Warning. {warning}"))
    if option.failure:
        overview.append(Paragraph(f"This option could not be studied: {option.failure}"))
    if option.requirements:
        overview.append(requirement_table(option, f"Requirements of {option.label}"))
        overview += _reasons(option)
    if option.equilibrium is not None:
        overview.append(_equilibrium_table(option))
    if option.notes:
        overview.append(Bullets(option.notes))
    sections = [Section(f"Option: {option.label}", anchor, 1, tuple(overview), option.verdict)]
    parts = (
        ("Modes and stability", "modes", _mode_blocks(comparison, option)),
        ("Margins", "margins", option_margin_blocks(option)),
        ("Worst cases", "robustness", robustness_blocks(option)),
        ("Periodic forcing", "periodic", _periodic_blocks(comparison, option)),
        ("Ride, gaps and actuators", "ride", ride_blocks(option, design_speed=comparison.design_speed)),
        ("Nonlinear check", "nonlinear", nonlinear_blocks(option)),
        ("Controller", "controller", _controller_blocks(option)),
    )
    sections += [Section(title, f"{anchor}-{part}", 2, tuple(blocks)) for title, part, blocks in parts if blocks]
    return sections


def _force_limits(option: OptionStudy) -> list[str]:
    """Where the force limits of the actuators count, and where they do not; nothing without limits."""
    limits = sorted({a.force_limit for a in option.vehicle.actuators if a.force_limit is not None})
    if not limits:
        return []
    sizes = ", ".join(with_prefix(limit, "N") for limit in limits)
    where = []
    if at_design(option) is not None:
        where.append(f"3 {SIGMA} of the force is compared with them on the guideway's irregularity")
    if option.nonlinear is not None:
        where.append("the nonlinear check enforces them")
    told = " and ".join(where) or "nothing else checks them"
    return [f"Force limits ({sizes}): the linear analysis does not enforce them; {told}."]


def verdict_words(option: OptionStudy) -> str:
    """How many requirements were judged, and how."""
    if not option.requirements:
        return "No requirement was judged."
    hard = [r for r in option.requirements if r.hard]
    counts = {r.verdict: sum(x.verdict is r.verdict for x in hard) for r in hard}
    judged = ", ".join(f"{count} {verdict.value}" for verdict, count in counts.items())
    told = f"Requirements: {judged}." if hard else "No hard requirement was judged."
    wishes = [r for r in option.requirements if not r.hard]
    met = sum(r.verdict is Verdict.PASS for r in wishes)
    return f"{told} Wishes met: {met} of {len(wishes)}." if wishes else told


def requirement_table(option: OptionStudy, caption: str) -> Table:
    """Limit, value, margin, worst operating point and method of every requirement; wishes are marked."""
    rows = tuple(
        (
            *row(
                breakable(r.name), r.description, f"{'≥' if r.sense == 'at_least' else '≤'} {number(r.limit, r.unit)}",
                value_words(r), margin_words(r), r.worst_at or ABSENT, r.method,
            ),
            judged_cell(r),
        )
        for r in option.requirements
    )  # fmt: skip
    heads = ("Requirement", "Quantity", "Limit", "Value", "Margin", "Worst at", "Method", "Verdict")
    return Table(caption, heads, rows, (1.15, 2.5, 1.1, 0.95, 0.8, 1.2, 1.75, 1.0), right=(2, 3, 4), small=True)


def _reasons(option: OptionStudy) -> list[Block]:
    told = tuple(reason_words(r) for r in option.requirements if r.reason)
    return [Bullets(told)] if told else []


def _equilibrium_table(option: OptionStudy) -> Table:
    found = option.equilibrium
    if found is None:
        raise ValueError("option: expected an equilibrium, got None")
    heights, gaps = np.atleast_1d(found.magnet_heights), np.atleast_1d(found.magnet_gaps)
    rows = [
        row("Speed", number(found.at.speed * _KILOMETRES_PER_HOUR, "km/h")),
        row("Magnet heights", _range(heights * 1e3, "mm")),
        row("Held", HELD[found.hold]),
        row("Magnet strength, factor on the currents as given", number(float(found.strength), digits=4)),
    ]
    if gaps.size and np.isfinite(gaps).any():
        rows.insert(2, row("Guidance gaps", _range(gaps * 1e3, "mm")))
    windings = magnet_circuits(option.vehicle, found)
    if windings:
        power = sum(magnet.count * windings[magnet.name].power for magnet in option.vehicle.magnets)
        rows += [
            row("Standing currents of the windings", _range(np.array([one.current for one in windings.values()]), "A")),
            row("Standing voltages of the windings", _range(np.array([one.voltage for one in windings.values()]), "V")),
            row("Heat in all windings", number(power / 1e3, "kW")),
        ]
    return Table(
        f"Equilibrium of {option.label} at the design point", ("Quantity", "Value"), tuple(rows), (1.2, 1.0), (1,)
    )


def _range(values: np.ndarray[tuple[int, ...], np.dtype[np.float64]], unit: str) -> str:
    known = values[np.isfinite(values)]
    if not known.size:
        return ABSENT
    low, high = float(np.min(known)), float(np.max(known))
    return number(low, unit) if high - low <= 1e-6 * abs(high) else f"{number(low)} to {number(high, unit)}"


def _mode_blocks(comparison: Comparison, option: OptionStudy) -> list[Block]:
    blocks: list[Block] = []
    if option.modes is not None:
        where = f"{option.label} at the design point"
        blocks.append(
            mode_table(option.modes, where, system=option.system, elsewhere="in report.json", key=option.name)
        )
    for sweep in option.sweeps:
        if sweep.parameter == "speed":
            blocks.append(Paragraph(f"Over speed: {boundary_words(sweep)}" + _gap_words(sweep)))
    charts = (
        speed_chart(option, design_speed=comparison.design_speed), other_sweeps(option), root_locus(option),
        mode_shapes(option),
    )  # fmt: skip
    blocks += [FigureBlock(chart) for chart in charts if chart is not None]
    ledger = energy_ledger(option)
    if ledger is not None:
        return [*blocks, FigureBlock(ledger, (LEDGER, SHARES, f"table:{option.name}-modes"))]
    return [*blocks, Paragraph(NO_LEDGER)] if option.modes is not None else blocks


def _gap_words(sweep: Sweep) -> str:
    if not sweep.gaps:
        return ""
    value, reason = sweep.gaps[0]
    more = f" and {len(sweep.gaps) - 1} more" if len(sweep.gaps) > 1 else ""
    return f" Not evaluated at {number(value * sweep.scale, sweep.unit)}{more}: {reason}"


def mode_table(
    modes: Modes, label: str, *, system: SecondOrderSystem | None = None, elsewhere: str = "left out", key: str = ""
) -> Table:
    """The least stable modes and what feeds them; `system` tells kinds of elements, `elsewhere` where the rest is.

    `key` begins the names by which a report refers to the table.
    """
    order = np.argsort(-modes.s.real, kind="stable")
    rows = []
    for k in order[:_MOST_MODES]:
        fed = largest_feeder(system, modes.ledger, mode=int(k))
        feeder = f"{fed[0]} {number(fed[1], '1/s')}" if fed else ABSENT
        damping, growth = float(modes.damping_ratio[k]), float(modes.s[k].real)
        if abs(growth) <= modes.error_bound[k]:  # a neutral mode: what is left is rounding, and so is what feeds it
            damping, growth = 0.0, 0.0
        if fed and abs(fed[1]) <= modes.error_bound[k]:
            feeder = ABSENT
        rows.append(
            row(
                modes.labels[k], number(float(modes.frequency[k]), "Hz"),
                number(100.0 * damping, "%"), number(growth, "1/s"),
                number(float(modes.error_bound[k]), "1/s", digits=1), modes.kind[k].value, feeder,
            )
        )  # fmt: skip
    left = len(order) - len(rows)
    more = f"; {left} faster decaying ones are {elsewhere}" if left > 0 else ""
    heads = ("Mode", "Frequency", "Damping", "Growth rate", "± error", "Kind", "Fed most by")
    return Table(
        f"Modes of {label}, least stable first{more}", heads, tuple(rows),
        (2.0, 0.9, 0.9, 1.0, 0.8, 1.5, 1.5), (1, 2, 3, 4), True, f"{key}-modes" if key else "",
        (MOTION, LYAPUNOV, f"figure:{key}-ledger") if key else (),
    )  # fmt: skip


def _periodic_blocks(comparison: Comparison, option: OptionStudy) -> list[Block]:
    study = option.floquet
    if study is None:
        reason = option.floquet_reason
        return [Paragraph(f"Periodic stability was not evaluated: {reason}")] if reason else []
    blocks: list[Block] = [Paragraph(resonance_words(option.label, study)), _floquet_table(option, study)]
    chart = resonance_chart(option, design_speed=comparison.design_speed)
    if chart is not None:
        blocks.append(FigureBlock(chart, (RESONANCE, f"table:{option.name}-tongues")))
    tips = tongue_tips(study)
    if tips:
        lines = tuple(row(name, number(low, "%"), number(at, "km/h")) for name, low, at in tips[:_MOST_TONGUES])
        more = f" (lowest {_MOST_TONGUES} of {len(tips)})" if len(tips) > _MOST_TONGUES else ""
        caption = f"Resonances of {option.label}{more}: where each begins"
        blocks.append(Paragraph(_mode_numbers(option)))
        blocks.append(Table(
            caption, ("Resonance", "From depth", "At speed"), lines, (3.0, 1.0, 1.0), (1, 2),
            key=f"{option.name}-tongues", see=(RESONANCE, f"figure:{option.name}-resonance"),
        ))  # fmt: skip
    blocks += floquet_margin_blocks(
        option.label, study.margins, study.margins_reason, expected_depth=study.expected_depth
    )  # fmt: skip
    if study.no_go_ranges:
        rows = tuple(
            row(number(a * _KILOMETRES_PER_HOUR, "km/h"), number(b * _KILOMETRES_PER_HOUR, "km/h"), tongue_words(name))
            for a, b, name in study.no_go_ranges
        )
        caption = f"Speeds {option.label} must not hold at the expected modulation depth"
        blocks.append(Table(caption, ("From", "To", "Resonance"), rows, (1.0, 1.0, 3.0), (0, 1)))
    return blocks


def _mode_numbers(option: OptionStudy) -> str:
    """What w1, w2, ... mean; listed where the map is drawn for the very system whose modes are known."""
    meaning = "In the names of resonances w1, w2, ... are the oscillating modes, counted by frequency at each speed"
    modes = option.modes
    if modes is None or any(a.delay > 0.0 for a in option.vehicle.actuators):
        return f"{meaning}."
    oscillating = np.flatnonzero(modes.s.imag > 1e-9 * np.abs(modes.s))
    order = sorted(oscillating, key=lambda k: float(modes.s[k].imag))
    parts = [
        f"w{place + 1} = {modes.labels[k]} {number(float(modes.s[k].imag) / (2.0 * np.pi), 'Hz')}"
        for place, k in enumerate(order)
    ]
    return f"{meaning}; at the design point {', '.join(parts)}." if parts else f"{meaning}."


def _floquet_table(option: OptionStudy, study: FloquetStudy) -> Table:
    cases = [("with the option's elements", study.at_design)]
    if study.open_loop is not None:
        cases.append(("without them", study.open_loop))
    rows = tuple(
        row(
            name, number(float(f.spectral_radius), digits=5), number(float(f.growth_rate), "1/s"),
            number(float(f.growth_error), "1/s", digits=1), _agreement(f.agreement),
        )
        for name, f in cases
    )  # fmt: skip
    heads = ("Vehicle", "Largest multiplier", "Growth rate", "Error bound", "Two engines")
    caption = f"Floquet stability of {option.label} at the design speed and expected depth"
    return Table(caption, heads, rows, (1.8, 1.2, 1.1, 1.0, 1.2), (1, 2, 3), see=(FLOQUET,))


def _agreement(value: Agreement) -> str:
    return "agree" if value is Agreement.AGREED else "UNRESOLVED"


def _controller_blocks(option: OptionStudy) -> list[Block]:
    design = option.design
    if design is None:
        return []
    table = controller_table(design, option.label)
    return [table, Bullets(design.notes)] if design.notes else [table]


def controller_table(design: Design, label: str) -> Table:
    """The law, its signals and the evidence about its closed loop."""
    proof = design.certificate
    controller = design.controller
    rows = [
        row("Law", design.law),
        row("Solver", design.status.value),
        row("Measures", ", ".join(controller.measured)),
        row("Commands", ", ".join(controller.commands)),
        row("Order", str(len(controller.states))),
        row("Closed-loop spectral abscissa on the plant without delays", number(proof.spectral_abscissa, "1/s")),
        row("Lyapunov proof residual (proof below 1)", number(proof.lyapunov_residual)),
        row("Checks", f"{proof.agreed.value}: {'; '.join(proof.disagreements) or '; '.join(proof.methods)}"),
        *(row(f"Riccati residual {i + 1}", number(float(r.residual))) for i, r in enumerate(design.riccati)),
    ]
    return Table(f"Controller of {label}", ("Item", "Value"), tuple(rows), (1.0, 2.4))
