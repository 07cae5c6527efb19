"""The stability map as a chart: growth where it is unstable, decay where it is stable, and never a guess between."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from maglev_ctrl.analysis.plane_records import NO_ANSWER, STABLE, UNRESOLVED, UNSTABLE, StabilityPlane
from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.report.chart import Axis, Cells, Chart, Heat, Item, Line, Marks, Panel
from maglev_ctrl.report.charts_periodic import short_words
from maglev_ctrl.report.labels import Anchor, Room, placed
from maglev_ctrl.report.map.picture import Picture, boundary, picture, region_anchors, small_parts
from maglev_ctrl.report.map.words import depth_axis, percent, reasons, scan_words, tips
from maglev_ctrl.report.raster import outer_edges
from maglev_ctrl.report.style import ON_MAP, number
from maglev_ctrl.study.map.records import MapQuantity, OptionMap

_GREY: Final = "#9b9b9b"
_PALE: Final = "#f4f4f4"
_STRONG: Final = "#f98c0a"
_HATCHABLE: Final = 5e-4  # of the picture: in a smaller part no hatch can be seen
_MOST_SPECKS: Final = 200
_MOST_NAMES: Final = 24
_MOST_IN_PAIR: Final = 4
_SIZE: Final = (5.2, 3.4)  # in, of a map alone
_PAIR: Final = (2.25, 2.3)  # in, of two side by side
_MOST_DECAY: Final = 95.0  # per cent of the stable cells: few that decay faster share the last colour
_GAP: Final = 0.05  # of the panel's height between the two scales


def map_chart(option: OptionMap, plane: StabilityPlane, x: MapQuantity, y: MapQuantity) -> Chart:
    """The map of one option."""
    shown = picture(plane, scale=(x.scale, y.scale))
    anchors = region_anchors(shown, plane)
    marks = _tips(option, plane, x, y)
    panel, hidden = _panel(shown, anchors, x, y, limits=_limits([shown]), size=_SIZE, more=marks)
    signs = _legend_words(shown, plane, anchors, hidden)
    if marks:
        signs += " A triangle is the tip of a tongue found on its own: where the map shows none, it is narrower than "
        signs += "the step between the map's points."
    return Chart(
        key=f"{option.name}-map", caption=f"Stability of {option.label} over {x.label} and {y.label}. {signs}",
        alt=_alt(option, plane, anchors, x, y), panels=(panel,), row_heights=(_SIZE[1],), legend="bottom",
    )  # fmt: skip


def pair_chart(
    option: OptionMap, planes: Sequence[tuple[str, StabilityPlane]], x: MapQuantity, y: MapQuantity
) -> Chart:
    """Maps of two laws side by side with the same colours."""
    shown = [picture(plane, scale=(x.scale, y.scale)) for _, plane in planes]
    limits = _limits(shown)
    panels = [
        _panel(
            one, region_anchors(one, plane), x, y, limits=limits, size=_PAIR, title=title, last=plane is planes[-1][1]
        )[0]
        for (title, plane), one in zip(planes, shown, strict=True)
    ]
    told = ". ".join(f"{title[:1].upper()}{title[1:]}: {share_words(plane)}" for title, plane in planes)
    return Chart(
        key=f"{option.name}-laws-map",
        caption=f"{option.label} under two laws, same axes and colours. {told}. Signs as in the "
        "map above; the largest regions are named.",
        alt=f"Stability of {option.label} over {x.label} and {y.label} under two laws. {told}.",
        panels=tuple(panels), columns=len(panels), row_heights=(_PAIR[1],), legend="bottom",
    )  # fmt: skip


def axis_words(quantity: MapQuantity) -> str:
    """Label of an axis with its unit."""
    return f"{quantity.label} ({quantity.unit})" if quantity.unit else quantity.label


def share_words(plane: StabilityPlane) -> str:
    """How much of a map is in each state; what is undecided or without an answer is told beside what is stable."""
    parts = [f"{percent(plane.share(UNSTABLE))} of the map unstable", f"{percent(plane.share(STABLE))} stable"]
    parts += [
        f"{percent(plane.share(state))} {words}"
        for state, words in ((UNRESOLVED, "UNRESOLVED"), (NO_ANSWER, "without an answer"))
        if plane.share(state) > 0.0
    ]
    return ", ".join(parts)


def _alt(option: OptionMap, plane: StabilityPlane, anchors: list[Anchor], x: MapQuantity, y: MapQuantity) -> str:
    """The map in words."""
    ranges = " and ".join(
        f"{q.label} from {number(float(q.values[0]) * q.scale)} to {number(float(q.values[-1]) * q.scale, q.unit)}"
        for q in (x, y)
    )
    names = ", ".join(dict.fromkeys(one.text for one in anchors))
    regions = f" Unstable regions: {names}." if names else ""
    return f"Stability map of {option.label} over {ranges}: {share_words(plane)}.{regions}"


def _limits(shown: Sequence[Picture]) -> tuple[float, float]:
    """Largest growth and decay with a colour of their own, 1/s; 0 where there is none."""
    growth = np.concatenate([one.growth[one.where(UNSTABLE)].ravel() for one in shown])
    decay = -np.concatenate([one.growth[one.where(STABLE)].ravel() for one in shown])
    fastest, slowest = (values[np.isfinite(values)] for values in (growth, decay))
    return (
        float(np.max(fastest)) if fastest.size else 0.0,
        max(float(np.percentile(slowest, _MOST_DECAY)), 0.0) if slowest.size else 0.0,
    )


def _panel(
    shown: Picture, anchors: list[Anchor], x: MapQuantity, y: MapQuantity, *, limits: tuple[float, float],
    size: tuple[float, float], title: str = "", last: bool = True, more: tuple[Item, ...] = (),
) -> tuple[Panel, int]:  # fmt: skip
    """One map and the number of regions without a name in it; the `last` of a row has the scales of its colours."""
    x_limits, y_limits = outer_edges(shown.x), outer_edges(shown.y)
    items = [*grid_colours(shown, limits, scales=last)]
    across, up = boundary(shown)
    if across.size:
        items.append(Line(across, up, "boundary of stability", ON_MAP, "solid", 0.8))
    design, words = _design(x, y, x_limits, y_limits)
    items += design
    room = Room(x_limits, y_limits, size, shown.where(UNSTABLE))
    most = _MOST_NAMES if size == _SIZE else _MOST_IN_PAIR
    names, left_out = placed(anchors[:most], room, taken=words, line=ON_MAP)
    beside = bool(title) and last  # of two maps over the same axes the left one names them
    axes = Axis(axis_words(x), limits=x_limits), Axis("" if beside else axis_words(y), limits=y_limits)
    return Panel((*items, *more, *names), *axes, title=title), left_out + max(0, len(anchors) - most)


def grid_colours(shown: Picture, limits: tuple[float, float], *, scales: bool) -> list[Item]:
    """Growth, decay, and the cells that have neither."""
    known = np.isfinite(shown.growth)
    growing, still = shown.where(UNSTABLE) & known, shown.where(STABLE) & known
    both = bool(growing.any() and still.any())
    items: list[Item] = []
    if growing.any():
        high = limits[0] or 1.0
        upper = ((0.5 + _GAP / 2, 1.0) if both else (0.0, 1.0)) if scales else None
        z = np.where(growing, shown.growth, np.nan)
        items.append(Heat(shown.x, shown.y, z, "growth (1/s)", 0.0, high, "growth", upper))
    if still.any():
        high = limits[1] or 1.0
        lower = ((0.0, 0.5 - _GAP / 2) if both else (0.0, 1.0)) if scales else None
        z = np.where(still, -shown.growth, np.nan)
        items.append(Heat(shown.x, shown.y, z, "decay (1/s)", 0.0, high, "decay", lower))
    for mask, words, tint, hatched in (
        (shown.where(UNSTABLE) & ~known, "unstable, growth not computed", _STRONG, False),
        (shown.where(STABLE) & ~known, "stable, decay not computed", "#d4e2ee", False),
        (shown.where(UNRESOLVED), "UNRESOLVED", _PALE, True),
        (shown.where(NO_ANSWER), "no answer", _GREY, False),
    ):
        if mask.any():
            items.append(Cells(shown.x, shown.y, mask, words, tint, hatched))
    specks = small_parts(shown, shown.where(UNRESOLVED), least=_HATCHABLE, most=_MOST_SPECKS)
    if specks[0].size:
        items.append(Marks(*specks, "cross", "UNRESOLVED, a few points", ON_MAP, 3.5))
    return items


def _tips(option: OptionMap, plane: StabilityPlane, x: MapQuantity, y: MapQuantity) -> tuple[Item, ...]:
    """Where the tongues of the option's table begin, on a map over speed and depth."""
    found = [one for one in tips(option.tongues, plane, x, y) if one[1] <= float(_depths(plane, x, y)[-1])]
    if not found:
        return ()
    speed, depth = np.array([one[0] for one in found]), np.array([one[1] for one in found])
    upright = depth_axis(plane, x, y) == "y"
    across, up = (speed, depth) if upright else (depth, speed)
    hover = tuple(f"{short_words(name)}: from {number(100.0 * onset, '%')}" for _, onset, name in found)
    words = "tip of a tongue"
    return (Marks(across * x.scale, up * y.scale, "triangle", words, ON_MAP, 3.5, hover),)


def _depths(plane: StabilityPlane, x: MapQuantity, y: MapQuantity) -> FloatArray:
    return plane.y.values if depth_axis(plane, x, y) == "y" else plane.x.values


def _design(
    x: MapQuantity, y: MapQuantity, x_limits: tuple[float, float], y_limits: tuple[float, float]
) -> tuple[list[Item], list[Anchor]]:
    """Lines through the scenario's own values and the point where they meet, and the room that takes."""
    items: list[Item] = []
    at = (x.design * x.scale, y.design * y.scale)
    inside = tuple(low <= value <= high for value, (low, high) in zip(at, (x_limits, y_limits), strict=True))
    if inside[0]:
        label = f"design {x.label} {number(at[0], x.unit)}"
        items.append(Line(np.full(2, at[0]), np.array(y_limits), label, ON_MAP, "dot", 0.9))
    if inside[1]:
        label = f"design {y.label} {number(at[1], y.unit)}"
        items.append(Line(np.array(x_limits), np.full(2, at[1]), label, ON_MAP, "dash", 0.9))
    if not all(inside):
        return items, []
    items.append(Marks(np.array([at[0]]), np.array([at[1]]), "diamond", "design point", ON_MAP, 5.0, ("design point",)))
    return items, [Anchor(at[0], at[1], " ")]


def _legend_words(shown: Picture, plane: StabilityPlane, anchors: list[Anchor], hidden: int) -> str:
    """What the colours and signs of this very map stand for."""
    words = []
    if shown.where(UNSTABLE).any():
        words.append("Strong colours are unstable: the growth rate; names say which modes feed each other.")
    if shown.where(STABLE).any():
        words.append(
            "Faint blue is stable: the decay rate of the slowest motion (the fastest twentieth in one colour)."
        )
    if any(one.text == "none" for one in anchors):
        words.append('"none": unstable without any resonance.')
    if shown.where(UNRESOLVED).any():
        words.append("Hatched is UNRESOLVED: the methods do not decide, it does not count as stable.")
    if shown.where(NO_ANSWER).any():
        words.append(f"Grey has no answer: {reasons(plane)}.")
    if hidden:
        words.append(f"{hidden} smaller unstable region(s) are drawn without a name.")
    if shown.gathered:
        words.append("Each cell of the picture stands for several points and shows the worst of them.")
    return " ".join((*words, scan_words(plane)))
