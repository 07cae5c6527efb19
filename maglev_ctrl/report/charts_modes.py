"""Eigenvalues against an operating parameter, root locus, and the energy ledger."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from maglev_ctrl.analysis.modes import Modes
from maglev_ctrl.arrays import ComplexArray, FloatArray
from maglev_ctrl.report.chart import Axis, Bars, Chart, Item, Line, Marks, Note, Panel, Rule, Span
from maglev_ctrl.report.groups import ledger_groups
from maglev_ctrl.report.style import FADED, FAIL_COLOUR, INK, UNKNOWN_COLOUR, colour, dash, number
from maglev_ctrl.study.records import OptionStudy, Sweep

PARAMETER_WORDS = {
    "speed": "speed", "payload": "payload", "height": "levitation height", "gap": "guidance gap",
    "lateral_offset": "lateral offset",
}  # fmt: skip
DESIGN_LINE = "design point"
MOST_MODES = 12


def speed_chart(option: OptionStudy, *, design_speed: float) -> Chart | None:
    """Frequency, growth rate and damping ratio of every tracked mode against speed; None without a speed sweep."""
    sweep = next((s for s in option.sweeps if s.parameter == "speed"), None)
    return None if sweep is None else _sweep_chart(option, sweep, design=design_speed)


def other_sweeps(option: OptionStudy) -> Chart | None:
    """Growth rate and least damping ratio against payload, height, gap: one column each; None when there are none."""
    others = [s for s in option.sweeps if s.parameter != "speed"][:3]
    if not others:
        return None
    top: list[Panel] = []
    bottom: list[Panel] = []
    for sweep in others:
        x = sweep.values * sweep.scale
        label = f"{PARAMETER_WORDS[sweep.parameter]} ({sweep.unit})"
        growth = Line(
            x, _beyond_rounding(sweep.abscissa, np.nanmax(np.abs(sweep.tracks.s))), "largest growth rate", colour(2)
        )
        damping = Line(x, 100.0 * _beyond_rounding(sweep.least_damping, 1.0), "least damping ratio", colour(1))
        marks = [Marks(x, line.y, "circle", "", line.colour, 3.5) for line in (growth, damping)]
        common = (*_boundaries(sweep), *_missing(sweep))
        zero = Rule("y", 0.0, "", INK, "solid", 0.7)
        first = sweep is others[0]
        top.append(Panel((growth, marks[0], zero, *common), Axis(""), Axis("growth rate (1/s)" if first else "")))
        bottom.append(Panel((damping, marks[1], *common), Axis(label), Axis("damping ratio (%)" if first else "")))
    words = ", ".join(PARAMETER_WORDS[s.parameter] for s in others)
    return Chart(
        key=f"{option.name}-sweeps",
        caption=f"Stability of {option.label} against {words}: largest growth rate (negative is stable) and least "
        "damping ratio of the oscillating modes.",
        alt=f"Largest growth rate and least damping ratio of {option.label} against {words}. "
        + " ".join(_range_words(s) for s in others),
        panels=(*top, *bottom),
        columns=len(others),
        panel_height=1.25,
        legend="none",
    )


def _range_words(sweep: Sweep) -> str:
    known = sweep.abscissa[np.isfinite(sweep.abscissa)]
    if not known.size:
        return f"No {PARAMETER_WORDS[sweep.parameter]} could be evaluated."
    return f"Over {PARAMETER_WORDS[sweep.parameter]} the largest growth rate is {number(float(np.max(known)), '1/s')}."


def _sweep_chart(option: OptionStudy, sweep: Sweep, *, design: float) -> Chart:
    x = sweep.values * sweep.scale
    s = sweep.tracks.s
    shown = slowest_tracks(s)
    frequency: list[Item] = []
    growth: list[Item] = []
    damping: list[Item] = []
    for order, k in enumerate(shown):
        name, tint, style = sweep.tracks.labels[k], colour(order + 1), dash(order + 1)
        oscillates = s[:, k].imag > 1e-9 * np.abs(s[:, k])
        hertz = np.where(np.isnan(s[:, k].real), np.nan, np.where(oscillates, s[:, k].imag / (2.0 * np.pi), 0.0))
        frequency.append(Line(x, hertz, name, tint, style))
        growth.append(Line(x, s[:, k].real, name, tint, style))
        size = np.where(np.abs(s[:, k]) > 0.0, np.abs(s[:, k]), np.nan)
        damping.append(Line(x, np.where(oscillates, -100.0 * s[:, k].real / size, np.nan), name, tint, style))
    bounds, missing = _boundaries(sweep), _missing(sweep)
    at_design = Rule("x", design * sweep.scale, DESIGN_LINE, INK, "dot", 1.0)
    window_growth = growth_window(s[:, shown])
    window_damping = _damping_window(damping)
    growth.append(Span("y", 0.0, window_growth[1], FAIL_COLOUR, 0.10, label="unstable"))
    damping.append(Span("y", window_damping[0], 0.0, FAIL_COLOUR, 0.10, label="unstable"))
    axis = Axis(f"{PARAMETER_WORDS[sweep.parameter]} ({sweep.unit})")
    left_out = s.shape[1] - len(shown)
    more = f" {left_out} faster or stiffer eigenvalues are left out; report.json has them all." if left_out else ""
    return Chart(
        key=f"{option.name}-{sweep.parameter}",
        caption=f"Eigenvalues of {option.label} against {PARAMETER_WORDS[sweep.parameter]}, tracked and named by "
        f"participation; vertical dashes mark computed stability boundaries.{more}",
        alt=f"Frequency, growth rate and damping ratio of {len(shown)} modes of {option.label} against "
        f"{PARAMETER_WORDS[sweep.parameter]}. {boundary_words(sweep)}",
        panels=(
            Panel((*frequency, at_design, *bounds, *missing), axis, Axis("frequency (Hz)")),
            Panel((*growth, at_design, *bounds, *missing), axis, Axis("growth rate (1/s)", limits=window_growth)),
            Panel((*damping, at_design, *bounds, *missing), axis, Axis("damping ratio (%)", limits=window_damping)),
        ),
        panel_height=1.45,
        share_x=True,
    )


def slowest_tracks(s: ComplexArray) -> list[int]:
    """Tracks worth drawing: every one that is ever unstable or lightly damped, then the slowest, at most MOST_MODES."""
    with np.errstate(invalid="ignore"):
        size = np.nanmedian(np.where(np.isnan(s.real), np.nan, np.abs(s)), axis=0) if s.size else np.zeros(0)
        worst = np.nanmax(np.where(np.isnan(s.real), -np.inf, s.real), axis=0) if s.size else np.zeros(0)
        light = np.nanmax(np.where(s.imag > 0.0, s.real / np.maximum(np.abs(s), 1e-300), -1.0), axis=0, initial=-1.0)
    kept = np.flatnonzero(worth_drawing(size, light))
    order = sorted((int(k) for k in kept), key=lambda k: (not (worst[k] > 0.0 or light[k] > -0.3), size[k]))
    return sorted(order[:MOST_MODES], key=lambda k: size[k])


def worth_drawing(size: FloatArray, light: FloatArray) -> NDArray[np.bool_]:
    """Which modes belong in figures of the vehicle: not the fast, strongly damped ones of actuators and delays.

    Parameters
    ----------
    size : (m,) |s| in 1/s
    light : (m,) Re s / |s|, -1 for a decaying real mode

    Examples
    --------
    >>> worth_drawing(np.array([4.0, 19.0, 1700.0]), np.array([-0.1, -0.02, -0.9])).tolist()
    [True, True, False]
    """
    lively = light > -0.5
    reach = 5.0 * float(np.max(size[lively])) if np.any(lively) else np.inf
    return np.asarray(lively | (size <= reach), dtype=bool)


def growth_window(s: ComplexArray) -> tuple[float, float]:
    """Growth-rate axis (1/s) that keeps the instability readable beside strongly damped modes.

    Examples
    --------
    >>> low, high = growth_window(np.array([-0.5 + 9j, 0.2 + 7j, -80.0 + 1j]))
    >>> low > -1.0, high > 0.2
    (True, True)
    """
    with np.errstate(invalid="ignore"):
        slow = s.real[s.real > -0.3 * np.abs(s)]
    known = slow if slow.size else s.real[np.isfinite(s.real)]
    if not known.size:
        return -1.0, 1.0
    high, low = max(float(np.max(known)), 0.0), min(float(np.min(known)), 0.0)
    room = max(high - low, 1e-6)
    return low - 0.1 * room, high + max(0.15 * room, 0.02)


def _damping_window(items: list[Item]) -> tuple[float, float]:
    """Damping-ratio axis: all of the light modes, at most 40 % up and down."""
    known = np.concatenate([item.y[np.isfinite(item.y)] for item in items if isinstance(item, Line)] or [np.zeros(0)])
    shown = known[np.abs(known) <= 40.0]
    high = max(1.15 * float(np.max(shown, initial=0.0)), 2.0)
    low = min(1.15 * float(np.min(shown, initial=0.0)), -0.12 * high)
    return low, high


def _boundaries(sweep: Sweep) -> list[Item]:
    return [
        Rule("x", c.value * sweep.scale, "stability boundary", FAIL_COLOUR, "dash", 1.0)
        for c in sweep.boundaries.crossings
    ]  # fmt: skip


def _missing(sweep: Sweep) -> list[Item]:
    """Hatched bands over values that could not be evaluated, half a step to each side."""
    if not sweep.gaps or sweep.values.size < 2:
        return []
    half = 0.5 * float(np.median(np.abs(np.diff(sweep.values)))) * sweep.scale
    return [
        Span("x", v * sweep.scale - half, v * sweep.scale + half, UNKNOWN_COLOUR, 0.5, True, "not evaluated")
        for v, _ in sweep.gaps
    ]


def boundary_words(sweep: Sweep) -> str:
    """Where stability is lost and gained along a sweep, in words."""
    if not sweep.boundaries.crossings:
        known = sweep.abscissa[np.isfinite(sweep.abscissa)]
        if not known.size:
            return "No point of the sweep could be evaluated."
        state = "stable" if np.max(known) < 0.0 else "not stable"
        return f"No stability boundary lies inside the sweep; it is {state} throughout."
    parts = [
        f"{c.direction} stability at {number(c.value * sweep.scale, sweep.unit)}" for c in sweep.boundaries.crossings
    ]
    return "It " + ", ".join(parts) + "."


def root_locus(option: OptionStudy) -> Chart | None:
    """Eigenvalues while the option's own elements are faded in; None when nothing was faded."""
    if option.locus is None or option.locus.s.size == 0:
        return None
    s = _branches(option.locus.s)
    shown = [k for k in range(s.shape[1]) if np.nanmax(s[:, k].imag) >= 0.0]
    limits, outside = _locus_window(s[:, shown])
    items: list[Item] = []
    for k in shown:
        upper = np.where(s[:, k].imag >= 0.0, s[:, k], np.nan)
        items.append(Line(upper.real, upper.imag / (2.0 * np.pi), "", colour(1), "solid", 1.1))
    designed = int(np.argmin(np.abs(option.locus.gain - 1.0)))
    for place, symbol, label in (
        (0, "open_circle", "without the option's elements"),
        (designed, "square", "as designed"),
    ):
        at = s[place, shown]
        at = at[at.imag >= 0.0]
        tint = colour(0) if place == 0 else colour(1)
        items.append(Marks(at.real, at.imag / (2.0 * np.pi), symbol, label, tint, 4.5))  # type: ignore[arg-type]
    high = limits[1][1]
    for ratio in (0.02, 0.1, 0.3):
        reach = min(high, -limits[0][0] * np.sqrt(1.0 - ratio**2) / (2.0 * np.pi * ratio))
        end = -2.0 * np.pi * reach * ratio / np.sqrt(1.0 - ratio**2)
        items.append(Line(np.array([0.0, end]), np.array([0.0, reach]), "", FADED, "dot", 0.8))
        items.append(
            Note(end, reach, f"{100 * ratio:g} %", "center", "bottom" if reach >= high else "center", FADED, True)
        )
    items.append(Rule("x", 0.0, "", INK, "solid", 0.8))
    items.append(Span("x", 0.0, limits[0][1], FAIL_COLOUR, 0.10, label="unstable"))
    note = f" {outside} branches reach beyond the window." if outside else ""
    return Chart(
        key=f"{option.name}-locus",
        caption=f"Root locus of {option.label} at the design point as its own elements are faded in from nothing to "
        f"{number(float(option.locus.gain[-1]))} times their design values; dotted rays are constant damping "
        f"ratios.{note}",
        alt=f"Root locus of {option.label}: {int(np.sum(s[0, shown].real > 0))} unstable eigenvalues without its "
        f"elements, {int(np.sum(s[designed, shown].real > 0))} as designed (upper half plane).",
        panels=(
            Panel(tuple(items), Axis("growth rate (1/s)", limits=limits[0]), Axis("frequency (Hz)", limits=limits[1])),
        ),
        panel_height=2.9,
    )


def _branches(s: ComplexArray) -> ComplexArray:
    """Rows put in order so that each column is one continuous branch (least total step from row to row)."""
    ordered = np.array(s)
    for row in range(1, ordered.shape[0]):
        before = ordered[row - 1] if row == 1 else 2.0 * ordered[row - 1] - ordered[row - 2]
        cost = np.abs(before[:, None] - ordered[row][None, :])
        cost = np.where(np.isfinite(cost), cost, 1e12)
        _, columns = linear_sum_assignment(cost)
        ordered[row] = ordered[row][columns]
    return ordered


def _locus_window(s: ComplexArray) -> tuple[tuple[tuple[float, float], tuple[float, float]], int]:
    """Window on the lightly damped part of the plane, and how many branches leave it."""
    known = s[np.isfinite(s.real)]
    light = known[known.real > -0.5 * np.abs(known)]
    basis = light if light.size else known
    reach = 1.15 * float(np.max(np.abs(basis))) if basis.size else 1.0
    low = max(1.25 * float(np.min(basis.real)), -0.7 * reach) if basis.size else -1.0
    right = max(float(np.max(known.real)) * 1.3, 0.08 * abs(low), 0.05) if known.size else 1.0
    top = 1.15 * max(float(np.max(basis.imag)) / (2.0 * np.pi), 0.1) if basis.size else 1.0
    outside = int(np.sum(np.nanmin(s.real, axis=0) < low))
    return ((min(low, -0.1), right), (0.0, top)), outside


def energy_ledger(option: OptionStudy) -> Chart | None:
    """What feeds and what damps each mode, element by element; None when there are no modes."""
    if option.modes is None or option.system is None:
        return None
    groups = ledger_groups(option.system, option.modes.ledger)
    return ledger_chart(option.modes, groups, f"{option.label} at the design point", key=option.name)


def ledger_chart(modes: Modes, groups: Mapping[str, list[int]], label: str, *, key: str) -> Chart | None:
    """The same for modes on their own; `groups` says which elements are told together, by their places."""
    modulus = np.abs(modes.s)
    shown = worth_drawing(modulus, modes.s.real / np.maximum(modulus, 1e-300))
    split = [
        int(k)
        for k in np.argsort(-modes.s.real, kind="stable")
        if shown[k]
        and np.isfinite(modes.ledger.damping[:, k]).all()
        and modes.s[k].imag > 0.0
        # Shares of a neutral mode that are no larger than its error are rounding.
        and max(np.max(np.abs(modes.ledger.damping[:, k])), np.max(np.abs(modes.ledger.circulatory[:, k])))
        > modes.error_bound[k]
    ][:6]
    if not split:
        return None
    rows: list[str] = []
    items: list[Item] = []
    tables = (("damping", modes.ledger.damping), ("circulatory", modes.ledger.circulatory))
    for row, k in enumerate(split):
        shares = [
            (name, part, float(np.sum(table[members, k]))) for name, members in groups.items() for part, table in tables
        ]
        size = max(sum(v for *_, v in shares if v > 0), -sum(v for *_, v in shares if v < 0)) or 1.0
        items += _ledger_row(shares, list(groups), -float(row), size)
        growth = float(modes.ledger.growth[k])
        items.append(
            Marks(np.array([growth / size]), np.array([-float(row)]), "diamond", "sum = growth rate", INK, 5.0)
        )
        rows.append(
            f"{_short(modes.labels[k])}\n{number(modes.s[k].imag / (2 * np.pi), 'Hz')}, {number(growth, '1/s')}"
        )
    items.append(Rule("x", 0.0, "", INK, "solid", 0.8))
    return Chart(
        key=f"{key}-ledger",
        caption=f"Energy ledger of {label}: what each element adds to a mode's growth rate, "
        "through damping (plain) and through circulatory, non-symmetric stiffness (hatched). Bars to the right feed "
        "the mode, bars to the left damp it; each row is scaled to its own largest sum, the diamond is the total.",
        alt=f"Energy ledger of {label}: " + "; ".join(row.replace("\n", ", ") for row in rows),
        panels=(
            Panel(
                tuple(items),
                Axis("share of the growth rate (relative to the mode's largest sum)", limits=(-1.08, 1.08)),
                Axis(
                    "",
                    limits=(0.6 - len(split), 0.6),
                    ticks=tuple(-float(r) for r in range(len(split))),
                    tick_labels=tuple(rows),
                ),
            ),
        ),
        panel_height=0.35 + 0.42 * len(split),
    )


def _ledger_row(shares: list[tuple[str, str, float]], names: list[str], row: float, size: float) -> list[Item]:
    items: list[Item] = []
    ends = {True: 0.0, False: 0.0}
    for name, part, value in shares:
        if abs(value) < 1e-3 * size:
            continue
        label = name if part == "damping" else f"{name} (circulatory)"
        items.append(
            Bars(
                np.array([row]),
                np.array([ends[value > 0]]),
                np.array([value / size]),
                0.62,
                label,
                colour(names.index(name) + 1),
                part == "circulatory",
                (f"{label}: {number(value, '1/s')}",),
            )
        )
        ends[value > 0] += value / size
    return items


def _beyond_rounding(values: FloatArray, size: float) -> FloatArray:
    """The values, zero where they are no more than rounding beside a size."""
    return np.where(np.abs(values) <= 1e-12 * size, 0.0, values)


def _short(label: str) -> str:
    return label if len(label) <= 30 else label[:28].rstrip() + " …"
