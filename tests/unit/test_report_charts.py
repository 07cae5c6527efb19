"""Charts, numbers in words, geometry and the compact SVG, without a study behind them."""

from __future__ import annotations

import json

import numpy as np
import pytest

from maglev_ctrl.report.chart import Area, Axis, Bars, Chart, Heat, Line, Marks, Note, Panel, Rule, Span
from maglev_ctrl.report.charts_margins import exclusion_disk
from maglev_ctrl.report.draw import draw
from maglev_ctrl.report.geometry import boxes, corners, displacement, motion
from maglev_ctrl.report.interactive import interactive
from maglev_ctrl.report.style import MINUS, PALETTE, number, tick_text
from maglev_ctrl.report.vector import svg, themed, without_empty_groups
from maglev_ctrl.vehicle import Body, Vehicle


def _chart() -> Chart:
    x = np.linspace(0.0, 1.0, 5)
    grid = np.outer(x, x)
    grid[0, 0] = np.nan
    items = (
        Line(x, np.where(x > 0.9, np.nan, x), "cost in $ and $", "#0072b2", "dash"),
        Marks(x, x, "open_circle", "points"),
        Bars(np.array([0.5]), np.zeros(1), np.array([0.4]), 0.1, "bar", "#009e73", True, ("<b>bar</b>",)),
        Area(np.array([0.0, 1.0, 1.0]), np.array([0.0, 0.0, 1.0]), "area", "#d55e00"),
        Span("y", 0.8, 1.0, "#d55e00", hatched=True, label="unstable"),
        Rule("x", 0.5, "design <point>"),
        Note(0.2, 0.2, "a & b", boxed=True),
    )
    heat = Panel((Heat(x, x, grid, "growth rate (1/s)", 0.0, 1.0),), Axis("speed (km/h)"), Axis("depth (%)"))
    return Chart("key", "caption", "alt", (Panel(items, Axis("x (m)"), Axis("y (m)"), title="one"), heat))


def test_every_item_is_drawn_both_ways() -> None:
    chart = _chart()
    text = svg(chart)
    assert text.startswith("<svg")
    assert "cost in $ and $" in text
    assert "growth rate (1/s)" in text
    spec = interactive(chart)
    assert {trace["type"] for trace in spec["data"]} == {"scatter", "bar", "heatmap"}
    assert "NaN" not in json.dumps(spec)


def test_svg_is_the_same_every_time_and_unique_to_its_key() -> None:
    from dataclasses import replace

    assert svg(_chart()) == svg(_chart())
    ids = [{part.split('"')[0] for part in svg(c).split(' id="')[1:]} for c in (_chart(), replace(_chart(), key="b"))]
    assert not ids[0] & ids[1]


def test_svg_is_well_formed_even_where_nothing_is_drawn() -> None:
    from xml.etree import ElementTree

    nothing = Line(np.array([np.nan, np.nan]), np.array([np.nan, np.nan]), "gone")
    outside = Marks(np.array([9.0]), np.array([9.0]), "square", "outside")
    limits = (0.0, 1.0)
    empty = Panel((nothing, outside), Axis("x (m)", limits=limits), Axis("y (m)", limits=limits))
    for chart in (_chart(), Chart("empty", "caption", "alt", (empty,))):
        assert ElementTree.fromstring(svg(chart)).tag.endswith("svg")


def test_groups_go_in_pairs() -> None:
    text = '<svg><g/><g><g clip="c"><path/></g></g></svg>'
    assert without_empty_groups(text) == '<svg><g clip="c"><path/></g></svg>'


def test_markup_in_words_is_escaped() -> None:
    spec = interactive(_chart())
    assert "<b>" not in json.dumps(spec["data"])
    assert "design &lt;point&gt;" in json.dumps(spec["layout"])
    assert 'aria-label="&lt;i&gt; &quot;q&quot;"' in themed(svg(_chart()), label='<i> "q"')


def test_theme_replaces_ink_everywhere() -> None:
    raw, dark = svg(_chart()), themed(svg(_chart()), label="alt")
    assert ": #1b1b1b" in raw
    assert ": #1b1b1b" not in dark
    assert "var(--ink, #1b1b1b)" in dark


def test_drawing_leaves_matplotlib_as_it_was() -> None:
    import matplotlib

    before = dict(matplotlib.rcParams)
    draw(_chart())
    assert dict(matplotlib.rcParams) == before


def test_no_text_overlaps_another() -> None:
    figure = draw(_chart())
    figure.canvas.draw()
    boxes_ = [t.get_window_extent() for t in figure.texts if t.get_text() and not t.get_bbox_patch()]
    clashes = [
        (a, b) for i, a in enumerate(boxes_) for b in boxes_[i + 1 :]
        if min(a.x1, b.x1) - max(a.x0, b.x0) > 1.0 and min(a.y1, b.y1) - max(a.y0, b.y0) > 1.0
    ]  # fmt: skip
    assert clashes == []


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (0.0, "m", "0 m"),
        (-0.016, "", f"{MINUS}0.0160"),
        (1.0e9, "Pa", "1.00e9 Pa"),
        (float("-inf"), "dB", f"{MINUS}∞ dB"),
    ],
)
def test_numbers_in_words(value: float, unit: str, text: str) -> None:
    assert number(value, unit) == text


def test_ticks_show_what_tells_them_apart() -> None:
    assert [tick_text(v, 0.25) for v in (-0.25, -0.0, 0.25)] == [f"{MINUS}0.25", "0.00", "0.25"]


def test_palette_keeps_its_distance_in_every_pair() -> None:
    rgb = np.array([[int(c[i : i + 2], 16) for i in (1, 3, 5)] for c in PALETTE], dtype=float)
    apart = np.linalg.norm(rgb[:, None] - rgb[None], axis=-1) + 1e3 * np.eye(len(rgb))
    assert np.min(apart) > 60.0


def test_exclusion_disk_is_where_the_survived_gains_send_minus_one() -> None:
    found = exclusion_disk(0.8)
    assert found is not None
    centre, radius = found
    gains = np.array([(2.0 - 0.8) / (2.0 + 0.8), (2.0 + 0.8) / (2.0 - 0.8)])
    assert np.sort([centre - radius, centre + radius]) == pytest.approx(np.sort(-1.0 / gains))
    mutant = np.sort(1.0 / gains)  # the sign of the feedback flipped
    assert not np.allclose(np.sort([centre - radius, centre + radius]), mutant)
    assert exclusion_disk(2.0) is None


def test_positive_pitch_is_nose_down() -> None:
    vehicle = Vehicle("v", (Body("car", 1.0, inertia=(1.0, 1.0, 1.0), dofs=("pitch",)),), reference_height=0.1)
    (box,) = boxes(vehicle)
    moved = displacement(box, corners(box, "side"), motion(vehicle, np.array([1.0 + 0j]), "car"))
    nose = corners(box, "side")[:, 0] > 0.0
    assert np.all(moved[nose, 2].real < 0.0)
    assert np.all(moved[~nose, 2].real > 0.0)
    mutant = displacement(box, corners(box, "side"), motion(vehicle, np.array([-1.0 + 0j]), "car"))
    assert not np.any(mutant[nose, 2].real < 0.0)
