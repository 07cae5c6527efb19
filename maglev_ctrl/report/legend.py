"""Legend of a chart: one entry per label, and matplotlib's words for dashes and symbols."""

from __future__ import annotations

from typing import Any, Final

from maglev_ctrl.report.chart import Area, Bars, Cells, Chart, Heat, Line, Marks, Note, Rule, Span
from maglev_ctrl.report.style import INK, ON_MAP, PAPER, Dash, Symbol

_SHORT = 32  # characters of the longest label with which three columns fit

DASHES: Final[dict[Dash, Any]] = {"solid": "-", "dash": (0, (5, 2)), "dot": (0, (1, 1.6)), "dashdot": (0, (5, 2, 1, 2))}
SYMBOLS: Final[dict[Symbol, str]] = {
    "circle": "o", "square": "s", "diamond": "D", "cross": "x", "triangle": "^", "open_circle": "o",
}  # fmt: skip


def legend_entries(chart: Chart) -> list[tuple[Any, str]]:
    """One (handle, label) per label, in order of first appearance."""
    entries: dict[str, Any] = {}
    for item in (item for panel in chart.panels for item in panel.items):
        if isinstance(item, (Heat, Note)) or not item.label or item.label in entries:
            continue
        entries[item.label] = _handle(item)
    return [(handle, label) for label, handle in entries.items()]


def legend_columns(entries: list[tuple[Any, str]]) -> int:
    """Columns of a legend below its chart: as many as the longest label leaves room for."""
    longest = max((len(label) for _, label in entries), default=0)
    return 3 if longest <= _SHORT else 2


def on_page(colour: str) -> str:
    """A colour of a figure as its legend shows it, beside the map and not on it."""
    return INK if colour == ON_MAP else colour


def _handle(item: Line | Rule | Marks | Bars | Area | Span | Cells) -> Any:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    match item:
        case Line() | Rule():
            return Line2D([], [], color=on_page(item.colour), linestyle=DASHES[item.dash], linewidth=item.width)
        case Marks():
            tint = on_page(item.colour)
            face = "none" if item.symbol == "open_circle" else tint
            return Line2D(
                [], [], color=tint, linestyle="none", marker=SYMBOLS[item.symbol], markersize=item.size,
                markerfacecolor=face,
            )  # fmt: skip
        case Bars():
            hatch = "////" if item.hatched else None
            return Patch(facecolor=item.colour, edgecolor=PAPER, hatch=hatch, linewidth=0.4)
        case Area():
            return Patch(
                facecolor=item.fill or "none", alpha=item.opacity if item.fill else 1.0, edgecolor=item.edge or "none"
            )  # fmt: skip
        case Span():
            face, edge = ("none", item.colour) if item.hatched else (item.colour, "none")
            hatch = "///" if item.hatched else None
            return Patch(facecolor=face, edgecolor=edge, alpha=max(item.opacity, 0.2), hatch=hatch, linewidth=0)
        case Cells():
            return Patch(facecolor=item.colour, edgecolor=ON_MAP, hatch="/////" if item.hatched else None, linewidth=0)
