"""The views of the page hold the numbers of their records, in the units their axes name, and words stay words."""

from __future__ import annotations

import csv
import io
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import xarray
from bokeh.document import Document
from bokeh.models import Div, HoverTool
from live_fixture import HOSTILE, hostile_view, live_comparison, live_view

from maglev_ctrl.analysis.plane_records import NO_ANSWER, STABLE, UNRESOLVED, UNSTABLE
from maglev_ctrl.report.charts_modes import growth_window
from maglev_ctrl.report.geometry import at_largest, best_view, boxes, corners, displacement, motion
from maglev_ctrl.study.live.records import LiveMap
from maglev_ctrl.workbench.style import DARK, LIGHT, MARKERS, PAGE_STYLE, dress, theme_switch
from maglev_ctrl.workbench.views import (
    ComparisonView,
    Cursor,
    EigenvalueView,
    LedgerView,
    MapView,
    MarginsView,
    ShapeView,
)
from maglev_ctrl.workbench.views.downloads import FIGURES, figure_files
from maglev_ctrl.workbench.views.eigenvalues import both_sides
from maglev_ctrl.workbench.views.ledger import SUM
from maglev_ctrl.workbench.views.legend import marker_sign, tint_of
from maglev_ctrl.workbench.views.map import CHECKED, LEAST_SCALE, NOT_CHECKED
from maglev_ctrl.workbench.views.map_image import even_map
from maglev_ctrl.workbench.views.shape_parts import AXES, moved
from maglev_ctrl.workbench.views.shown import at_speed, shown_modes


@pytest.fixture(scope="module", autouse=True)
def _studied() -> None:
    live_view()


def _all(cursor: Cursor) -> tuple[Any, ...]:
    return EigenvalueView(cursor), MapView(cursor), LedgerView(cursor), ShapeView(cursor), MarginsView()


def test_markers_stand_at_growth_and_hertz() -> None:
    view, drawn = live_view(), EigenvalueView(Cursor(500 / 3.6))
    drawn.show(view)
    shown = shown_modes(view)
    s = view.modes.s[[one.mode for one in shown]]
    np.testing.assert_allclose(drawn.marks.data["x"], s.real)
    np.testing.assert_allclose(drawn.marks.data["y"], s.imag / (2 * np.pi))  # not rad/s, not swapped
    np.testing.assert_allclose(drawn.marks.data["damping"], -100 * s.real / np.abs(s))
    assert drawn.figure.xaxis[0].axis_label.startswith("growth rate") and "(Hz)" in drawn.figure.yaxis[0].axis_label
    assert "stable" in drawn.summary and "500 km/h" in drawn.summary


def test_every_marker_lies_on_the_track_of_its_own_colour() -> None:
    view, drawn = live_view(), EigenvalueView(Cursor(500 / 3.6))
    drawn.show(view)
    near = at_speed(view.tracks, view.speed)
    for place, one in enumerate(shown_modes(view)):
        row = int(drawn.marks.data["row"][place])
        assert drawn.tracks.data["label"][row] == drawn.marks.data["label"][place]
        assert drawn.tracks.data["colour"][row] == drawn.marks.data["colour"][place]
        assert abs(near[one.track] - view.modes.s[one.mode]) < 0.02 * abs(view.modes.s[one.mode])
        np.testing.assert_allclose(drawn.tracks.data["x"][row], view.tracks.s[:, one.track].real)
        np.testing.assert_allclose(drawn.tracks.data["y"][row], view.tracks.s[:, one.track].imag / (2 * np.pi))
    assert len(set(drawn.marks.data["marker"])) == len(drawn.marks.data["marker"])  # told apart without colour


def test_a_window_holds_the_light_modes_and_one_that_was_chosen_stays() -> None:
    view, drawn = live_view(), EigenvalueView(Cursor(500 / 3.6))
    drawn.show(view)
    x, y = drawn.figure.x_range, drawn.figure.y_range
    light = view.modes.s[view.modes.s.real > -0.3 * np.abs(view.modes.s)]
    assert np.all((light.real > x.start) & (light.real < x.end)) and np.all(light.imag < 2 * np.pi * y.end)
    assert x.start > -5.0  # the far fast ones at -32 1/s do not squeeze it
    drawn.figure.x_range.start = -2.5
    drawn.show(live_view("bare"))
    assert x.start == -2.5


def test_the_map_has_speed_across_depth_up_and_the_sign_of_its_state() -> None:
    view, drawn = live_view(), MapView(Cursor(500 / 3.6, 0.15))
    drawn.show(view)
    image = drawn.image.data["growth"][0]
    assert image.dtype == np.float32 and image.shape == (len(view.map.depth), len(view.map.speed))
    known = np.isfinite(image)
    assert np.array_equal(image[known] > 0, view.map.state[known] == UNSTABLE)
    assert np.all(np.isin(view.map.state[~known], (UNRESOLVED, NO_ANSWER)))
    row, column = np.argwhere(view.map.state == UNSTABLE)[0]
    assert image[row, column] == pytest.approx(view.map.growth[row, column], rel=1e-6)
    left, wide = drawn.image.data["x"][0], drawn.image.data["dw"][0]
    step = 3.6 * (view.map.speed[1] - view.map.speed[0])
    assert left + step / 2 == pytest.approx(3.6 * view.map.speed[0])  # km/h
    assert left + wide - step / 2 == pytest.approx(3.6 * view.map.speed[-1])
    assert drawn.image.data["y"][0] + drawn.image.data["dh"][0] == pytest.approx(100 * view.map.depth[-1], rel=0.05)
    assert set(drawn.cells.data["pattern"]) == {"right_diagonal_line", "criss_cross", "dot"}
    starts = [line[0] for line in drawn.leaders.data["x"]]  # a name stands on its region, or beside it with a line
    assert any(x == pytest.approx(3.6 * view.map.regions[0].speed) for x in (*starts, drawn.names.data["x"][0]))


def test_the_hatched_cells_cover_what_is_not_stable_and_nothing_else() -> None:
    view, drawn = live_view(), MapView(Cursor())
    drawn.show(view)
    cells = drawn.cells.data
    for row, depth in enumerate(view.map.depth):
        for column, speed in enumerate(view.map.speed):
            inside = (
                (cells["left"] < 3.6 * speed) & (3.6 * speed < cells["right"])
                & (cells["bottom"] < 100 * depth) & (100 * depth < cells["top"])
            )  # fmt: skip
            assert np.any(inside) == (view.map.state[row, column] != STABLE)


def test_a_fast_map_says_that_it_is_not_checked() -> None:
    drawn = MapView(Cursor())
    drawn.show(live_view(settled=False))
    assert NOT_CHECKED in drawn.status.text and NOT_CHECKED in drawn.summary and CHECKED not in drawn.summary
    drawn.show(live_view())
    assert CHECKED in drawn.status.text and NOT_CHECKED not in drawn.status.text


def test_uneven_maps_lose_nothing_unstable() -> None:
    speed, depth = np.array([10.0, 11.0, 20.0, 30.0]), np.array([0.0, 0.1, 0.4])
    state = np.full((3, 4), STABLE, dtype=np.int8)
    growth = np.full((3, 4), -1.0)
    state[1, 1], growth[1, 1] = UNSTABLE, 0.5
    state[2, 3], growth[2, 3] = NO_ANSWER, np.nan
    shown = even_map(LiveMap(speed, depth, growth, state, (), True, ""))
    assert np.max(shown.signed[np.isfinite(shown.signed)]) == 0.5 and np.any(shown.state == NO_ANSWER)
    at = np.unravel_index(int(np.nanargmax(shown.signed)), shown.signed.shape)
    assert shown.speed[at[1]] == pytest.approx(11.0, abs=0.6) and shown.depth[at[0]] == pytest.approx(0.1, abs=0.06)


def test_the_ledger_adds_up_to_the_growth_rate_of_every_mode() -> None:
    view, drawn = live_view(), LedgerView(Cursor())
    drawn.show(view)
    rows = drawn.rows.data
    for place, one in enumerate(shown_modes(view)):
        own = rows["mode"] == place
        if not np.any(own):
            assert "There is no ledger" in drawn.titles.data["words"][place]
            continue
        total = np.nansum(rows["damping"][own]) + np.nansum(rows["circulatory"][own])
        assert total == pytest.approx(view.modes.s[one.mode].real, rel=1e-6)
        assert rows["total"][own][-1] == pytest.approx(total)
        assert [rows["name"][k] for k in np.flatnonzero(own)][-1] == SUM
    assert any("There is no ledger" in words for words in drawn.titles.data["words"])


def test_shapes_move_as_the_printed_ones_do() -> None:
    view = live_view()
    outline = boxes(view.vehicle)
    for one in shown_modes(view):
        shape = view.modes.shapes[:, one.mode]
        if not np.any(shape):
            continue
        scene, steps = moved(view.vehicle, shape)
        seen = best_view(view.vehicle, outline, shape)
        turned = at_largest(view.vehicle, outline, shape, seen)
        assert scene.view == seen
        parts = [displacement(b, corners(b, seen), motion(view.vehicle, turned, b.body)) for b in outline]
        wanted = np.concatenate(parts)[:, list(AXES[seen])]
        np.testing.assert_allclose((scene.true @ turned)[scene.kind == 0], wanted, atol=1e-12)
        stretch = np.max(np.abs(steps[scene.kind == 0]), axis=0) > 0
        assert np.any(stretch)
    kinds = set(moved(view.vehicle, view.modes.shapes[:, 3])[0].kind)
    assert kinds == {0, 1, 2}
    assert 3 in moved(live_view("lqr").vehicle, live_view("lqr").modes.shapes[:, 3])[0].kind


def test_a_spring_ends_on_its_two_bodies() -> None:
    view = live_view("bare")
    scene, steps = moved(view.vehicle, view.modes.shapes[:, 0])
    part = scene.part[scene.kind == 2][0]
    ends = np.flatnonzero(scene.part == part)[[0, -1]]
    box = {name: np.flatnonzero(scene.part == k) for k, name in enumerate(scene.names)}
    for end in ends:  # between the lower (or upper) corners of a box, moved by what lies between theirs
        near = [
            name for name, own in box.items()
            if np.any(np.isclose(scene.rest[own, 1], scene.rest[end, 1]))
            and scene.rest[own, 0].min() <= scene.rest[end, 0] <= scene.rest[own, 0].max()
        ]  # fmt: skip
        assert near
        low, high = steps[box[near[0]], 1].real.min(), steps[box[near[0]], 1].real.max()
        assert low - 1e-9 <= steps[end, 1].real <= high + 1e-9


def test_margins_tell_verdicts_by_sign_word_and_colour() -> None:
    drawn = MarginsView()
    drawn.show(live_view())
    text = drawn.block.text
    assert '<span class="fail">✗ FAIL</span>' in text and '<span class="pass">✓ PASS</span>' in text
    assert "computed in the report" in text and '<span class="unknown">? NOT EVALUATED</span>' in text
    assert "winding_front" in text and "54.4 ms" in text and "all at once" in text
    drawn.show(live_view(settled=False))
    assert "PASS" not in drawn.block.text and "not computed yet" in drawn.block.text


def test_the_comparison_scales_damping_to_per_cent_and_marks_the_current_option() -> None:
    found, drawn = live_comparison(), ComparisonView()
    drawn.show(found, "windings")
    data = drawn.options.data
    np.testing.assert_allclose(data["least_damping"], 100 * found.least_damping)
    np.testing.assert_allclose(data["growth"], found.growth)
    assert data["current"] == [False, True, False] and math.isnan(data["disk_margin"][0])
    assert "▶ Damper windings (shown)" in drawn.words.text and "? NOT EVALUATED" in drawn.words.text


@pytest.mark.parametrize("kind", ["title", "hover", "tables", "legend"])
def test_words_from_a_scenario_stay_words(kind: str) -> None:
    cursor = Cursor()
    views = _all(cursor)
    for one in views:
        one.show(hostile_view())
    compared = ComparisonView()
    assert compared.draw() and not compared.draw()  # made once
    found = live_comparison()
    compared.show(replace(found, labels=(HOSTILE,) * 3, reasons=(HOSTILE,) * 3), "bare")
    figures = [figure for one in (*views, compared) for figure in one.figures]
    blocks = [block for one in (*views, compared) for block in one.root.select({"type": Div})]
    if kind == "title":  # a title between dollar signs would be fetched as a formula
        for drawn in figures:
            assert all(sign not in drawn.title.text for sign in ("$$", "\\("))
            assert all("$$" not in str(axis.axis_label) for axis in (*drawn.xaxis, *drawn.yaxis))
            assert not any(axis.major_label_overrides for axis in (*drawn.xaxis, *drawn.yaxis))
    elif kind == "hover":  # columns are escaped by Bokeh unless marked safe
        for drawn in figures:
            for tool in drawn.select({"type": HoverTool}):
                assert isinstance(tool.tooltips, list) and not any("safe" in row[1] for row in tool.tooltips)
    elif kind == "tables":
        assert len(blocks) >= 4
        for block in blocks:
            assert "<script" not in block.text and block.disable_math is True
        assert sum("&lt;script&gt;" in block.text for block in blocks) >= 3
        assert all("<script" not in words for words in views[2].titles.data["words"])
        assert all("<script" not in words for words in views[3].modes.data["words"])
    else:
        assert "&lt;script&gt;" in views[0].legend.text and "<script" not in views[0].legend.text


def test_a_view_that_has_nothing_says_why_and_comes_back() -> None:
    cursor = Cursor()
    failed = replace(live_view(), modes=None, system=None, tracks=None, map=None, failure="no balance at 3 mm <height>")
    for one in _all(cursor):
        one.show(failed)
        assert "no balance at 3 mm" in one.summary
        one.show(live_view())
        assert "no balance" not in one.summary
    without = replace(live_view(), map=None, map_reason="the scenario describes no periodic forcing")
    drawn = MapView(cursor)
    drawn.show(without)
    assert drawn.summary.endswith("no periodic forcing") and drawn.image.data["growth"] == []
    assert not drawn.figure.visible and not drawn.legend.visible and "no periodic forcing" in drawn.status.text
    drawn.show(live_view())
    assert drawn.figure.visible and drawn.legend.visible


def test_names_on_the_map_stand_inside_it_and_clear_of_each_other() -> None:
    view, drawn = live_view(), MapView(Cursor())
    first = view.map.regions[0]
    ends = (first, replace(first, speed=float(view.map.speed[-1]), depth=float(view.map.depth[-1])),
            replace(first, speed=float(view.map.speed[0]), depth=0.0))  # fmt: skip
    named = tuple(replace(one, name="(w1 + w2)/3 (front heave / rear heave (1), car pitch)") for one in ends)
    drawn.show(replace(view, map=replace(view.map, regions=named)))
    x, y = drawn.figure.x_range, drawn.figure.y_range
    assert "front" not in "".join(drawn.names.data["text"])
    assert len(drawn.names.data["x"]) == 3
    assert np.all((drawn.names.data["x"] > x.start) & (drawn.names.data["x"] < x.end))
    assert np.all((drawn.names.data["y"] > y.start) & (drawn.names.data["y"] < y.end))


def test_next_to_no_growth_looks_like_it() -> None:
    view, drawn = live_view("bare"), MapView(Cursor())
    view = view if view.map is not None else live_view()
    weak = replace(view.map, growth=np.full_like(view.map.growth, 1e-4), state=np.full_like(view.map.state, UNSTABLE))
    drawn.show(replace(view, map=weak))
    assert drawn.growing.high == LEAST_SCALE and drawn.growing.palette[0] == "#fffbe6"
    assert [bar.visible for bar in drawn.bars] == [True, False]


@pytest.mark.parametrize("s", [-0.5 + 9j, 0.2 + 7j, 3e-3 + 2j])
def test_both_half_planes_are_seen(s: complex) -> None:
    low, high = both_sides(*growth_window(np.array([s])))
    assert low < 0.0 < high and high >= 0.19 * -low and -low >= 0.44 * high and low < s.real < high


@pytest.mark.parametrize("marker", MARKERS)
def test_every_marker_has_its_sign_in_the_legend(marker: str) -> None:
    assert "<svg" in marker_sign(marker, tint_of(3))


def test_showing_again_changes_data_and_no_model() -> None:
    cursor, document = Cursor(500 / 3.6), Document()
    views = _all(cursor)
    for one in views:
        one.show(live_view("bare"))
        document.add_root(one.root)
    before = {model.id for model in document.models}
    events: list[Any] = []
    document.on_change(events.append)
    for one in views:
        one.show(live_view())
    assert {model.id for model in document.models} == before
    assert len(events) < 40


def test_the_picked_mode_stays_by_name() -> None:
    cursor = Cursor()
    drawn = EigenvalueView(cursor)
    drawn.show(live_view("windings"))
    labels = list(drawn.marks.data["label"])
    cursor.move(mode=labels.index("car heave"))
    drawn.show(live_view("lqr"))
    assert drawn.marks.data["label"][cursor.mode] == "car heave"
    assert drawn.marks.data["size"][cursor.mode] == max(drawn.marks.data["size"])


def test_a_cursor_that_a_page_has_spoiled_is_not_believed() -> None:
    cursor = Cursor(1.0, 0.1, 2)
    for data in ({"speed": ["x"], "depth": [None], "mode": [float("nan")]}, {}):
        cursor.source.data = data
        assert (cursor.speed, cursor.depth, cursor.mode) == (0.0, 0.0, 0)
    with pytest.raises(ValueError, match="expected one of speed, depth, mode"):
        cursor.slider_code("<script>")


def test_dressing_changes_ink_and_palette_and_nothing_of_the_data() -> None:
    drawn = EigenvalueView(Cursor())
    drawn.show(live_view())
    before = dict(drawn.marks.data)
    dress(drawn.figure, True)
    assert drawn.figure.title.text_color == DARK.ink
    assert drawn.renderer.glyph.fill_color.transform.palette == list(DARK.palette)
    dress(drawn.figure, False)
    assert drawn.figure.title.text_color == LIGHT.ink and drawn.marks.data == before
    assert theme_switch([drawn.figure]).args["mappers"]
    for one in (LIGHT, DARK):
        assert all(f"--wb-tint-{k}: {tint}" in PAGE_STYLE for k, tint in enumerate(one.palette))


def _contrast(one: str, other: str) -> float:
    def luminance(tint: str) -> float:
        parts = [int(tint[i : i + 2], 16) / 255 for i in (1, 3, 5)]
        linear = [p / 12.92 if p <= 0.04045 else ((p + 0.055) / 1.055) ** 2.4 for p in parts]
        return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]

    high, low = sorted((luminance(one), luminance(other)), reverse=True)
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("theme", [LIGHT, DARK])
def test_words_and_lines_stand_out_from_the_paper(theme: Any) -> None:
    for tint in (theme.ink, theme.faded, theme.good, theme.bad):
        assert _contrast(tint, theme.paper) >= 4.5
    for tint in theme.palette:
        assert _contrast(tint, theme.paper) >= 3.0


@pytest.mark.parametrize("which", FIGURES)
def test_figures_come_as_svg_and_png(which: Any) -> None:
    view: Any = live_comparison() if which == "comparison" else live_view()
    drawn = figure_files(view, which, "svg", mode=3)
    assert drawn.startswith(b"<?xml") and b"</svg>" in drawn
    if which in ("eigenvalues", "map"):
        assert b"<script" not in figure_files(hostile_view(), which, "svg")


def test_a_png_is_one() -> None:
    assert figure_files(live_view(), "ledger", "png", mode=3).startswith(b"\x89PNG")


def test_tables_carry_units_and_the_records_numbers() -> None:
    view = live_view()
    rows = list(csv.DictReader(io.StringIO(figure_files(view, "map", "csv").decode())))
    assert list(rows[0]) == ["speed (m/s)", "modulation depth", "growth rate (1/s)", "state", "checked by two engines"]
    assert len(rows) == view.map.state.size
    at = np.ravel_multi_index((3, 5), view.map.state.shape)
    assert float(rows[at]["speed (m/s)"]) == pytest.approx(view.map.speed[5])
    assert float(rows[at]["modulation depth"]) == pytest.approx(view.map.depth[3])
    assert float(rows[at]["growth rate (1/s)"]) == pytest.approx(view.map.growth[3, 5])
    data = xarray.open_dataset(io.BytesIO(figure_files(view, "eigenvalues", "nc")), engine="scipy")
    assert data["frequency"].attrs["units"] == "Hz" and data["speed"].attrs["units"] == "m/s"
    own = data["point"].values == b"operating point"
    places = [one.mode for one in shown_modes(view)]
    np.testing.assert_allclose(data["growth"].values[own], view.modes.s[places].real)
    np.testing.assert_allclose(data["frequency"].values[own], view.modes.frequency[places])


def test_a_spreadsheet_takes_no_name_for_a_formula() -> None:
    found = replace(live_comparison(), labels=("=1+1", "@x", "plain"))
    rows = list(csv.reader(io.StringIO(figure_files(found, "comparison", "csv").decode())))
    assert [row[1] for row in rows[1:]] == ["'=1+1", "'@x", "plain"]


def test_what_cannot_be_downloaded_is_told_in_one_sentence() -> None:
    with pytest.raises(ValueError, match="no figure of 'margins'"):
        figure_files(live_view(), "margins", "svg")
    with pytest.raises(ValueError, match="expected one of"):
        figure_files(live_view(), "ledger", "csv", mode=99)
    with pytest.raises(ValueError, match="does not oscillate"):
        figure_files(live_view(), "ledger", "svg", mode=0)
    with pytest.raises(ValueError, match="no periodic forcing"):
        figure_files(replace(live_view(), map=None, map_reason="no periodic forcing"), "map", "nc")


def test_sources_are_sent_as_arrays() -> None:
    cursor = Cursor()
    drawn, shape, plane = MapView(cursor), ShapeView(cursor), EigenvalueView(cursor)
    for one in (drawn, shape, plane):
        one.show(live_view())
    words = {"pattern", "marker", "label", "kind"}  # numbers go as bytes, words as words
    for source in (drawn.cells, drawn.line, shape.points, plane.marks, plane.grid):
        for name, column in source.data.items():
            assert isinstance(column, np.ndarray) or (name in words and all(isinstance(one, str) for one in column))
    assert shape.points.data["x_re"].dtype == np.float32
