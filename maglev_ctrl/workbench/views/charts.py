"""Every view as a chart of the printed report's kind."""

from __future__ import annotations

import numpy as np

from maglev_ctrl.analysis.plane_records import NO_ANSWER, STABLE, UNRESOLVED, UNSTABLE
from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.errors import Verdict
from maglev_ctrl.report.chart import (
    Area,
    Axis,
    Bars,
    Cells,
    Chart,
    Heat,
    Item,
    Line,
    Marks,
    Note,
    Panel,
    Rule,
    Span,
)
from maglev_ctrl.report.charts_modes import growth_window
from maglev_ctrl.report.groups import ledger_groups
from maglev_ctrl.report.model import cell
from maglev_ctrl.report.raster import outer_edges
from maglev_ctrl.report.style import FADED, FAIL_COLOUR, INK, ON_MAP, Symbol, colour, dash, number
from maglev_ctrl.study.live.records import LiveComparison, LiveView
from maglev_ctrl.workbench.views.comparison import QUANTITIES
from maglev_ctrl.workbench.views.ledger import SUM, ledger_rows
from maglev_ctrl.workbench.views.map_image import boundary_line, even_map, map_words
from maglev_ctrl.workbench.views.shape_parts import AXIS_WORDS, moved
from maglev_ctrl.workbench.views.shown import mode_words, shown_modes
from maglev_ctrl.workbench.views.tables import picked

_SYMBOLS: tuple[Symbol, ...] = ("circle", "square", "diamond", "triangle", "open_circle", "cross")


def eigenvalue_chart(view: LiveView) -> Chart:
    """Tracks over speed in the complex plane and the modes at the operating point.

    Raises
    ------
    ValueError : there are no modes
    """
    if view.modes is None:
        raise ValueError(view.failure or "there are no modes to show")
    shown = shown_modes(view)
    items: list[Item] = []
    s = view.modes.s[[one.mode for one in shown]]
    for place, one in enumerate(shown):
        tint = colour(one.colour + 1)
        if one.track >= 0 and view.tracks is not None:
            track = view.tracks.s[:, one.track]
            s = np.concatenate([s, track])
            items.append(Line(track.real, track.imag / (2.0 * np.pi), "", tint, dash(one.colour + 1)))
        at = view.modes.s[shown[place].mode]
        items.append(Marks(np.array([at.real]), np.array([at.imag / (2.0 * np.pi)]),
                           _SYMBOLS[one.colour % len(_SYMBOLS)], one.label, tint, 6.0))  # fmt: skip
    low, high = growth_window(s)
    seen = s.imag[(s.real >= low) & (s.real <= high)]
    top = 1.1 * float(np.max(seen, initial=0.0)) / (2.0 * np.pi) or 1.0
    whole: list[Item] = [Span("x", 0.0, high, FAIL_COLOUR, 0.10, True, "unstable"), *items]
    words = f"at {number(3.6 * view.speed, 'km/h')}"
    return Chart(
        key="live-eigenvalues", caption=f"Eigenvalues of {view.label} over speed; symbols {words}.",
        alt=f"Eigenvalues of {view.label} {words}: {view.modes.verdict.value}.",
        panels=(Panel(tuple(whole), Axis("growth rate (1/s)", limits=(low, high)),
                      Axis("frequency (Hz)", limits=(-0.04 * top, top)), title=f"{view.label} {words}"),),
        panel_height=3.4,
    )  # fmt: skip


def map_chart(view: LiveView) -> Chart:
    """The map with its boundary, its names and the cursor; in its title whether two engines have checked it.

    Raises
    ------
    ValueError : there is no map
    """
    if view.map is None:
        raise ValueError(view.failure or view.map_reason or "there is no map")
    shown = even_map(view.map)
    x, y = 3.6 * shown.speed, 100.0 * shown.depth
    items: list[Item] = []
    growing, still = shown.state == UNSTABLE, shown.state == STABLE
    both = bool(growing.any() and still.any())
    for mask, ramp, sign, share in ((growing, "growth", 1.0, (0.53, 1.0)), (still, "decay", -1.0, (0.0, 0.47))):
        z = np.where(mask & np.isfinite(shown.signed), sign * shown.signed, np.nan)
        if np.any(np.isfinite(z)):
            high = float(np.nanmax(z)) if ramp == "growth" else float(np.nanpercentile(z, 95.0))
            scale = share if both else (0.0, 1.0)
            items.append(Heat(x, y, z, f"{ramp} (1/s)", 0.0, high or 1.0, ramp, scale))  # type: ignore[arg-type]
    for state, words, tint, hatched in (
        (UNRESOLVED, "UNRESOLVED", "#f4f4f4", True), (NO_ANSWER, "no answer", "#9b9b9b", False),
    ):  # fmt: skip
        if np.any(shown.state == state):
            items.append(Cells(x, y, shown.state == state, words, tint, hatched))
    across, up = boundary_line(x, y, shown)
    if across.size:
        items.append(Line(across, up, "boundary of stability", ON_MAP, "solid", 1.0))
    at = np.array([3.6 * view.speed]), np.array([100.0 * view.depth])
    items.append(Marks(*at, "diamond", "cursor", ON_MAP, 6.0))
    items += [Note(3.6 * r.speed, 100.0 * r.depth, r.name, "center", "center", INK, True) for r in view.map.regions]
    told = "checked by two engines" if view.map.checked else "fast map, not checked yet"
    return Chart(
        key="live-map", caption=f"Resonance map of {view.label}, {told}.",
        alt=f"Resonance map of {view.label}, {told}: {map_words(view.map)}",
        panels=(Panel(tuple(items), Axis("speed (km/h)", limits=outer_edges(x)),
                      Axis("modulation depth (%)", limits=(max(outer_edges(y)[0], 0.0), outer_edges(y)[1])),
                      title=f"{view.label}: {told}"),),
        panel_height=3.4, legend="bottom",
    )  # fmt: skip


def ledger_chart(view: LiveView, mode: int) -> Chart:
    """Shares of the picked mode's growth rate.

    Raises
    ------
    ValueError : there is no split, and why
    """
    one = picked(view, mode)
    if view.modes is None or view.system is None:
        raise ValueError(view.failure or "there are no modes to show")
    rows, why = ledger_rows(ledger_groups(view.system, view.modes.ledger), view.modes, one.mode)
    if not rows:
        raise ValueError(why)
    at = -np.arange(len(rows), dtype=float)
    zero = np.zeros(len(rows))
    total = float(view.modes.ledger.growth[one.mode])
    items: list[Item] = [
        Bars(at + 0.2, zero, np.array([r[1] for r in rows]), 0.36, "through damping", colour(1)),
        Bars(at - 0.2, zero, np.array([r[2] for r in rows]), 0.36, "through circulation", colour(2), True),
        Marks(np.array([total]), np.array([-float(len(rows))]), "diamond", SUM, INK, 6.0),
        Rule("x", 0.0, "", INK, "solid", 0.9),
    ]
    names = (*(name if len(name) <= 30 else f"{name[:28]} …" for name, _, _ in rows), SUM)
    return Chart(
        key="live-ledger", caption=f"Energy ledger of {one.label}. {why}", alt=f"Energy ledger of {one.label}. {why}",
        panels=(Panel(tuple(items), Axis("share of the growth rate (1/s)"),
                      Axis("", limits=(-len(rows) - 0.6, 0.6), ticks=tuple(-float(k) for k in range(len(rows) + 1)),
                           tick_labels=names), title=f"{one.label}: {mode_words(view.modes, one.mode)}"),),
        panel_height=0.5 + 0.32 * (len(rows) + 1), legend="bottom",
    )  # fmt: skip


def shape_chart(view: LiveView, mode: int) -> Chart:
    """The picked mode on the vehicle: solid at its largest, dotted a quarter of a period later, grey at rest.

    Raises
    ------
    ValueError : there is no such mode
    """
    one = picked(view, mode)
    if view.modes is None:
        raise ValueError(view.failure or "there are no modes to show")
    scene, steps = moved(view.vehicle, view.modes.shapes[:, one.mode])
    now, later = scene.rest + steps.real, scene.rest - steps.imag
    items: list[Item] = []
    if np.isfinite(scene.level):
        items.append(Line(np.array(scene.window[:2]), np.full(2, scene.level), "", INK, "solid", 1.8))
    for part in range(int(scene.part[-1]) + 1):
        own = np.flatnonzero(scene.part == part)
        if scene.kind[own[0]] != 0:
            items.append(Line(now[own, 0], now[own, 1], "", INK, "solid", 1.6 if scene.kind[own[0]] != 2 else 0.8))
            continue
        tint = colour(int(scene.colour[own[0]]) + 1)
        items.append(Area(*_outline(scene.rest[own]), edge=FADED, width=0.6))
        if np.max(np.abs(steps[own].imag)) > 0.05 * np.max(np.abs(steps)):
            items.append(Area(*_outline(later[own]), edge=INK, dash="dot", width=0.7))
        items.append(Area(*_outline(now[own]), fill=tint, opacity=0.35, edge=tint))
    left, right, bottom, top = scene.window
    title = f"{one.label}: {mode_words(view.modes, one.mode)}"
    across, seen = AXIS_WORDS[scene.view]
    return Chart(
        key="live-shape", caption=f"Mode shape {title}, {seen}; displacements and heights not to scale.",
        alt=f"Mode shape {title}, {seen}.",
        panels=(Panel(tuple(items), Axis(across, limits=(left, right)), Axis("", limits=(bottom, top), hidden=True),
                      title=title),),
        panel_height=2.2, legend="none",
    )  # fmt: skip


def _outline(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    return points[:, 0], points[:, 1]


def comparison_chart(found: LiveComparison) -> Chart:
    """Options side by side; a value that is not known has no dot.

    Raises
    ------
    ValueError : there are no options
    """
    if not found.options:
        raise ValueError("the scenario has no options to compare")
    count = len(found.options)
    at = -np.arange(count, dtype=float)
    panels = []
    for place, (field, words, unit, factor, bad_low) in enumerate(QUANTITIES):
        values = factor * np.asarray(getattr(found, field), dtype=float)
        known = np.isfinite(values)
        items: list[Item] = [Rule("x", 0.0, "", INK, "solid", 0.9)]
        reach = float(np.max(np.abs(values[known]), initial=0.0)) or 1.0
        low = min(0.0, float(np.min(values[known], initial=0.0))) - 0.15 * reach
        high = max(0.0, float(np.max(values[known], initial=0.0))) + 0.15 * reach
        if field != "disk_margin":
            items.append(Span("x", *((low, 0.0) if bad_low else (0.0, high)), FAIL_COLOUR, 0.10))
        items.append(Marks(values[known], at[known], "circle", "", colour(1), 6.0))
        items += [Note(0.0, float(one), " not evaluated", "left", "center", FADED) for one in at[~known]]
        labels = tuple(
            f"{label if len(label) <= 24 else label[:22] + ' …'}\n{cell(verdict).text}"
            for label, verdict in zip(found.labels, found.verdicts, strict=True)
        )
        panels.append(
            Panel(tuple(items), Axis(f"{words} ({unit})" if unit else words, limits=(low, high)),
                  Axis("", limits=(0.5 - count, 0.5), ticks=tuple(float(one) for one in at),
                       tick_labels=labels if place % 2 == 0 else ("",) * count))
        )  # fmt: skip
    passed = [label for label, one in zip(found.labels, found.verdicts, strict=True) if one is Verdict.PASS]
    return Chart(
        key="live-comparison", caption="Options at one operating point.",
        alt=f"Options at one operating point; stable: {', '.join(passed) or 'none'}.", panels=tuple(panels), columns=2,
        panel_height=0.4 + 0.34 * count, legend="none",
    )  # fmt: skip
