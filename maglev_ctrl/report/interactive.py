"""Charts on a live page: the same chart as a plotly specification, and plotly itself packed for one offline file."""

from __future__ import annotations

import base64
import gzip
import json
import math
import re
from functools import lru_cache
from typing import Any, Final, assert_never

import numpy as np

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.report.chart import Area, Axis, Bars, Cells, Chart, Heat, Item, Line, Marks, Note, Panel, Rule, Span
from maglev_ctrl.report.legend import on_page
from maglev_ctrl.report.raster import rectangles
from maglev_ctrl.report.style import ON_MAP, RAMPS

_SYMBOLS: Final = {
    "circle": "circle", "square": "square", "diamond": "diamond", "cross": "x-thin-open", "triangle": "triangle-up",
    "open_circle": "circle-open",
}  # fmt: skip
_ANCHORS: Final = {"left": "left", "center": "center", "right": "right"}
_VERTICAL: Final = {"top": "top", "center": "middle", "bottom": "bottom"}
_PIXELS: Final = 96.0  # per inch
_TEXT: Final = re.compile(rb"\.exports='(?:[^'\\]|\\.)*+'", re.DOTALL)  # a module that is nothing but one text


def interactive(chart: Chart) -> dict[str, Any]:
    """A chart as a plotly figure specification: {"data": [...], "layout": {...}}, plain JSON values only.

    Examples
    --------
    >>> from maglev_ctrl.report.chart import Axis, Chart, Line, Panel
    >>> line = Line(np.array([0.0, 1.0]), np.array([0.0, 1.0]), "rise")
    >>> interactive(Chart("k", "caption", "alt", (Panel((line,), Axis("time (s)"), Axis("m")),)))["data"][0]["y"]
    [0.0, 1.0]
    """
    data: list[dict[str, Any]] = []
    gap_y = 0.30 if chart.share_x else 1.0
    height = sum(chart.heights) + (chart.rows - 1) * gap_y
    layout: dict[str, Any] = {
        "height": round((height + 1.2) * _PIXELS),
        "margin": {"l": 66, "r": 20, "t": 40, "b": 56},
        "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "rgba(0,0,0,0)",
        "font": {"size": 12},
        "hovermode": "closest",
        "modebar": {"bgcolor": "rgba(0,0,0,0)"},
        "bargap": 0,
        "barmode": "overlay",
        "shapes": [],
        "annotations": [],
        "legend": {"orientation": "v"}
        if chart.legend == "right"
        else {"orientation": "h", "y": -0.2, "yanchor": "top"},
    }
    seen: set[str] = set()
    inner = (panel.y for place, panel in enumerate(chart.panels) if place % chart.columns)
    gap_x = (0.20 if any(axis.label for axis in inner) else 0.10) / max(1, chart.columns)
    width = (1.0 - (chart.columns - 1) * gap_x) / chart.columns
    for place, panel in enumerate(chart.panels):
        row, column = divmod(place, chart.columns)
        suffix = "" if place == 0 else str(place + 1)
        left = column * (width + gap_x)
        top = 1.0 - (sum(chart.heights[:row]) + row * gap_y) / height
        bottom = top - chart.heights[row] / height
        last = place + chart.columns >= len(chart.panels)
        x_axis = _axis(panel.x, (left, left + width), "y" + suffix, title=last or not chart.share_x)
        if chart.share_x and place:
            x_axis["matches"] = "x"
        y_axis = _axis(panel.y, (max(0.0, bottom), min(1.0, top)), "x" + suffix, title=True)
        if panel.equal:
            y_axis |= {"scaleanchor": "x" + suffix, "scaleratio": 1}
        layout["xaxis" + suffix], layout["yaxis" + suffix] = x_axis, y_axis
        if panel.title:
            layout["annotations"].append({
                "text": _plain(panel.title), "x": left, "y": min(1.0, top), "xref": "paper", "yref": "paper",
                "xanchor": "left", "yanchor": "bottom", "showarrow": False, "font": {"size": 13, "weight": 700},
            })  # fmt: skip
        for item in panel.items:
            _add(data, layout, item, panel, suffix, seen)
    for place in range(len(chart.panels)):  # words and bands alone: axes appear only with a trace
        suffix = "" if place == 0 else str(place + 1)
        axes = {"xaxis": "x" + suffix, "yaxis": "y" + suffix}
        if not any(trace["xaxis"] == axes["xaxis"] for trace in data):
            blank = {"type": "scatter", "x": [None], "y": [None], "showlegend": False, "hoverinfo": "skip"}
            data.append({**blank, **axes})
    return {"data": data, "layout": layout}


def _axis(axis: Axis, domain: tuple[float, float], anchor: str, *, title: bool) -> dict[str, Any]:
    spec: dict[str, Any] = {
        "domain": [round(domain[0], 4), round(domain[1], 4)], "anchor": anchor, "zeroline": False,
        "showgrid": not axis.hidden, "showticklabels": title and not axis.hidden, "automargin": True,
    }  # fmt: skip
    if title and axis.label:
        spec["title"] = {"text": _plain(axis.label), "standoff": 6}
    if axis.ticks is not None:
        spec |= {"tickmode": "array", "tickvals": list(axis.ticks)}
        if axis.tick_labels is not None:
            spec["ticktext"] = [_plain(label) for label in axis.tick_labels]
    if axis.log:
        spec |= {"type": "log", "exponentformat": "power"}
    if axis.limits is not None:
        spec["range"] = [_along(float(limit), axis) for limit in axis.limits]
    return spec


def _along(value: float, axis: Axis) -> float:
    """A value as ranges and annotations of plotly want it: its decimal logarithm on a logarithmic axis."""
    return math.log10(value) if axis.log else value


def _add(
    data: list[dict[str, Any]], layout: dict[str, Any], item: Item, panel: Panel, suffix: str, seen: set[str]
) -> None:
    axes = {"xaxis": "x" + suffix, "yaxis": "y" + suffix}
    match item:
        case Line():
            if item.colour == ON_MAP and item.label:
                style = {"color": on_page(item.colour), "dash": item.dash, "width": item.width * 1.3}
                data.append({"type": "scatter", "mode": "lines", "line": style, **_legend_only(item.label, seen, axes)})
            data.append({
                "type": "scatter", "mode": "lines", "x": _values(item.x), "y": _values(item.y),
                "line": {"color": item.colour, "dash": item.dash, "width": item.width * 1.3},
                **_named(item.label, seen), **_hover(panel, item.label, ()), **axes,
            })  # fmt: skip
        case Marks():
            if item.colour == ON_MAP and item.label:
                mark = {"color": on_page(item.colour), "symbol": _SYMBOLS[item.symbol], "size": item.size * 1.5}
                data.append({
                    "type": "scatter", "mode": "markers", "marker": mark, **_legend_only(item.label, seen, axes),
                })  # fmt: skip
            data.append({
                "type": "scatter", "mode": "markers", "x": _values(item.x), "y": _values(item.y),
                "marker": {"color": item.colour, "symbol": _SYMBOLS[item.symbol], "size": item.size * 1.5,
                           "line": {"width": 1.4, "color": item.colour}},
                **_named(item.label, seen), **_hover(panel, item.label, item.hover), **axes,
            })  # fmt: skip
        case Bars():
            data.append({
                "type": "bar", "orientation": "h", "y": _values(item.position), "x": _values(item.length),
                "base": _values(item.start), "width": item.thickness,
                "marker": {"color": item.colour,
                           "pattern": {"shape": "/" if item.hatched else "", "fillmode": "overlay",
                            "fgcolor": "#ffffff",
                                                             "size": 6}},
                **_named(item.label, seen), **_hover(panel, item.label, item.hover), **axes,
            })  # fmt: skip
        case Area():
            data.append({
                "type": "scatter", "mode": "lines", "x": _values(np.append(item.x, item.x[0])),
                "y": _values(np.append(item.y, item.y[0])), "fill": "toself" if item.fill else "none",
                "fillcolor": _faint(item.fill, item.opacity), "hoverinfo": "skip",
                "line": {"color": item.edge or "rgba(0,0,0,0)", "dash": item.dash, "width": item.width * 1.3},
                **_named(item.label, seen), **axes,
            })  # fmt: skip
        case Span():
            _add_span(layout, item, suffix)
        case Rule():
            _add_rule(layout, item, panel, suffix)
        case Heat():
            data.append({
                "type": "heatmap", "x": _values(item.x), "y": _values(item.y),
                "z": [_values(row, digits=3) for row in item.z],
                "zmin": item.low, "zmax": item.high, "colorscale": _colour_scale(item), "hoverongaps": False,
                **_colour_bar(item, layout["yaxis" + suffix]["domain"]),
                "hovertemplate": _heat_hover(item, panel), **axes,
            })  # fmt: skip
        case Cells():
            corners = rectangles(item.x, item.y, item.mask)
            x = [v for left, right, _, _ in corners for v in (left, right, right, left, left, math.nan)]
            y = [v for _, _, low, high in corners for v in (low, low, high, high, low, math.nan)]
            pattern = {"shape": "/", "fgcolor": ON_MAP, "bgcolor": item.colour, "size": 5, "solidity": 0.25}
            data.append({
                "type": "scatter", "mode": "lines", "x": _values(np.array(x)), "y": _values(np.array(y)),
                "fill": "toself", "fillcolor": item.colour, "line": {"width": 0}, "hoverinfo": "skip",
                **({"fillpattern": pattern} if item.hatched else {}), **_named(item.label, seen), **axes,
            })  # fmt: skip
        case Note():
            layout["annotations"].append({
                "x": _along(item.x, panel.x), "y": _along(item.y, panel.y), "text": _plain(item.text),
                "xref": "x" + suffix, "yref": "y" + suffix,
                "xanchor": _ANCHORS[item.horizontal], "yanchor": _VERTICAL[item.vertical], "showarrow": False,
                "font": {"size": 11, "color": item.colour},
                "bgcolor": "paper-colour" if item.boxed else "rgba(0,0,0,0)",
            })  # fmt: skip
        case _:
            assert_never(item)


def _colour_scale(item: Heat) -> list[list[float | str]]:
    stops = RAMPS[item.colours]
    return [[round(k / (len(stops) - 1), 4), tint] for k, tint in enumerate(stops)]


def _colour_bar(item: Heat, domain: list[float]) -> dict[str, Any]:
    if item.scale is None:
        return {"showscale": False}
    height = domain[1] - domain[0]
    return {"colorbar": {
        "title": {"text": _plain(item.label), "side": "right"}, "thickness": 12, "yanchor": "bottom",
        "y": round(domain[0] + item.scale[0] * height, 4), "len": round((item.scale[1] - item.scale[0]) * height, 4),
        "ypad": 0,
    }}  # fmt: skip


def _heat_hover(item: Heat, panel: Panel) -> str:
    x, y, z = _plain(panel.x.label), _plain(panel.y.label), _plain(item.label)
    return f"{x}: %{{x:.4g}}<br>{y}: %{{y:.4g}}<br>{z}: %{{z:.3g}}<extra></extra>"


def _add_span(layout: dict[str, Any], item: Span, suffix: str) -> None:
    across = {"x0": item.start, "x1": item.stop, "xref": "x" + suffix, "y0": 0, "y1": 1, "yref": f"y{suffix} domain"}
    along = {"y0": item.start, "y1": item.stop, "yref": "y" + suffix, "x0": 0, "x1": 1, "xref": f"x{suffix} domain"}
    layout["shapes"].append({
        "type": "rect", "fillcolor": item.colour, "opacity": item.opacity, "line": {"width": 0}, "layer": "below",
        **(across if item.axis == "x" else along),
    })  # fmt: skip


def _add_rule(layout: dict[str, Any], item: Rule, panel: Panel, suffix: str) -> None:
    upright = {"x0": item.value, "x1": item.value, "xref": "x" + suffix, "y0": 0, "y1": 1, "yref": f"y{suffix} domain"}
    level = {"y0": item.value, "y1": item.value, "yref": "y" + suffix, "x0": 0, "x1": 1, "xref": f"x{suffix} domain"}
    layout["shapes"].append({
        "type": "line", "line": {"color": item.colour, "dash": item.dash, "width": item.width * 1.2},
        **(upright if item.axis == "x" else level),
    })  # fmt: skip
    if item.label:
        place = {"x": _along(item.value, panel.x), "y": 1, "xref": "x" + suffix, "yref": f"y{suffix} domain"}
        flat = {"x": 1, "y": _along(item.value, panel.y), "xref": f"x{suffix} domain", "yref": "y" + suffix}
        layout["annotations"].append({
            "text": _plain(item.label), "showarrow": False, "font": {"size": 10, "color": item.colour},
            "xanchor": "left" if item.axis == "x" else "right", "yanchor": "top" if item.axis == "x" else "bottom",
            **(place if item.axis == "x" else flat),
        })  # fmt: skip


def _named(label: str, seen: set[str]) -> dict[str, Any]:
    """Legend entry once per label; curves of one label switch on and off together in every panel."""
    if not label:
        return {"showlegend": False}
    first = label not in seen
    seen.add(label)
    return {"name": _plain(label), "legendgroup": label, "showlegend": first}


def _legend_only(label: str, seen: set[str], axes: dict[str, str]) -> dict[str, Any]:
    """A trace that only stands in the legend, in the page's ink, for one drawn in the map's."""
    return {"x": [None], "y": [None], "hoverinfo": "skip", **_named(label, seen), **axes}


def _hover(panel: Panel, label: str, texts: tuple[str, ...]) -> dict[str, Any]:
    if texts:
        return {"hovertext": [_plain(text) for text in texts], "hovertemplate": "%{hovertext}<extra></extra>"}
    name = f"{_plain(label)}<br>" if label else ""
    x, y = _plain(panel.x.label), _plain(panel.y.label)
    return {"hovertemplate": f"{name}{x}: %{{x:.4g}}<br>{y}: %{{y:.4g}}<extra></extra>"}


def _plain(text: str) -> str:
    """Words for plotly, which reads a few HTML tags in labels: nothing of ours is markup."""
    safe = text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
    return safe.replace("%{", "%\u200b{").replace("\n", "<br>")


def _faint(fill: str | None, opacity: float) -> str:
    if fill is None:
        return "rgba(0,0,0,0)"
    red, green, blue = (int(fill[i : i + 2], 16) for i in (1, 3, 5))
    return f"rgba({red},{green},{blue},{opacity:g})"


def _values(values: FloatArray, *, digits: int = 5) -> list[float | None]:
    """Numbers to a few significant digits: what a screen can show; the exact values are in report.json."""
    return [float(f"{value:.{digits}g}") if math.isfinite(value) else None for value in np.asarray(values, dtype=float)]


def packed(value: Any) -> str:
    """Any JSON value as gzip in 85 letters, for the browser's DecompressionStream; `unpacked` reads it back."""
    return _pack(json.dumps(value, separators=(",", ":"), allow_nan=False).encode())


@lru_cache(maxsize=1)
def plotly_script() -> str:
    """The plotly.js that ships with the plotly package, packed the same way, without its map worker."""
    from importlib.resources import files

    return _pack(without_worker(files("plotly").joinpath("package_data", "plotly.min.js").read_bytes()))


def without_worker(library: bytes) -> bytes:
    """The library without the program of the geographic maps' worker: half a megabyte kept in it as one text.

    The text is only handed to a worker when a geographic map is drawn; no chart of ours is one. Where it is not found
    the library stays as it is.

    Examples
    --------
    >>> without_worker(b"a.exports='/* maplibre-gl-worker */'; b()"), without_worker(b"b()")
    (b"a.exports=''; b()", b'b()')
    """
    for found in _TEXT.finditer(library):
        if b"maplibre-gl-worker" in found.group():
            return library[: found.start()] + b".exports=''" + library[found.end() :]
    return library


def _pack(raw: bytes) -> str:
    """Four bytes as five letters, a sixteenth less than base64; none of them begins a tag."""
    return base64.b85encode(gzip.compress(raw, compresslevel=9, mtime=0)).decode("ascii").replace("<", ",")


def unpacked(text: str) -> bytes:
    """What a page keeps packed, as the page itself reads it.

    Examples
    --------
    >>> unpacked(packed([1, 2]))
    b'[1,2]'
    """
    return gzip.decompress(base64.b85decode(text.strip().replace(",", "<")))
