"""The figures of the map report: nothing unstable or undecided gets lost in the picture."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from map_fixture import flat_plane, map_study, marked, on

from maglev_ctrl.analysis.plane_records import NO_ANSWER, STABLE, UNRESOLVED, UNSTABLE, StabilityPlane
from maglev_ctrl.report.chart import Bars, Cells, Chart, Heat, Line, Marks, Note
from maglev_ctrl.report.interactive import interactive
from maglev_ctrl.report.labels import Anchor, Room, placed
from maglev_ctrl.report.map import picture as picture_module
from maglev_ctrl.report.map.atlas_chart import atlas_chart, bands_panel
from maglev_ctrl.report.map.chart import map_chart, pair_chart
from maglev_ctrl.report.map.content import speed_unit
from maglev_ctrl.report.map.picture import MOST_COLUMNS, MOST_ROWS, boundary, picture, region_anchors
from maglev_ctrl.report.raster import even_cells, rectangles
from maglev_ctrl.report.vector import svg
from maglev_ctrl.study.map.records import MapStudy


@pytest.fixture(scope="module")
def study() -> MapStudy:
    return map_study()


def items_of(chart: Chart, kind: type) -> list[Any]:
    return [item for panel in chart.panels for item in panel.items if isinstance(item, kind)]


def texts(chart: Chart) -> set[str]:
    return {note.text for note in items_of(chart, Note)}


# --- the picture ------------------------------------------------------------------------------------------------------


def thin_tongue_is_shown(plane: StabilityPlane, column: int) -> bool:
    """Whether a tongue of one column stands in the picture, in the right place, with its growth and its name."""
    shown = picture(plane)
    place = int(np.abs(shown.x - plane.x.values[column]).argmin())
    seen = shown.state[:, place] == UNSTABLE
    named = [one.text for one in region_anchors(shown, plane)] == ["(w1 + w2)/2"]
    return bool(seen[-1] and not seen[0] and float(np.nanmax(shown.growth)) == 0.25 and named)


def huge(column: int) -> StabilityPlane:
    return marked(flat_plane((2000, 2000)), (column, slice(900, None)), UNSTABLE, 0.25)


def test_a_huge_map_keeps_a_tongue_of_one_column() -> None:
    for column in (777, 1203):
        plane = huge(column)
        assert picture(plane).state.shape == (MOST_ROWS, MOST_COLUMNS)
        assert thin_tongue_is_shown(plane, column)


def test_a_picture_of_nearest_points_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    def nearest(priority: Any, columns: Any, rows: Any) -> Any:
        flat = np.arange(priority.size).reshape(priority.shape)
        return flat[np.ix_([c[0] for c in columns], [r[0] for r in rows])].T

    monkeypatch.setattr(picture_module, "worst_members", nearest)
    assert not thin_tongue_is_shown(huge(777), 777)


def undecided_is_shown(plane: StabilityPlane) -> bool:
    return int(np.sum(picture(plane).state == UNRESOLVED)) == 1


def test_one_undecided_point_of_many_is_not_told_stable() -> None:
    assert undecided_is_shown(marked(flat_plane((1500, 700)), (901, 333), UNRESOLVED, -5.0))


def test_undecided_ranked_below_stable_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    wrong = {STABLE: 1, NO_ANSWER: 2, UNRESOLVED: 0, UNSTABLE: 3}
    monkeypatch.setattr(picture_module, "_RANK", wrong)
    assert not undecided_is_shown(marked(flat_plane((1500, 700)), (901, 333), UNRESOLVED, -5.0))


def test_a_small_map_is_shown_point_by_point(study: MapStudy) -> None:
    plane = study.options[1].plane
    assert plane is not None
    shown = picture(plane)
    assert np.array_equal(shown.state, plane.state.T) and np.array_equal(shown.growth, plane.growth.T, equal_nan=True)
    assert not shown.gathered


def test_uneven_values_all_have_a_cell() -> None:
    values = np.concatenate([np.linspace(0.0, 1.0, 300), np.geomspace(1.01, 100.0, 300)])
    centres, members = even_cells(values, most=120)
    assert len(centres) == 120 and set(np.concatenate(members).tolist()) == set(range(600))


def test_rectangles_cover_exactly_the_marked_cells() -> None:
    mask = np.random.default_rng(3).random((17, 23)) < 0.4
    x, y = np.arange(23.0), np.arange(17.0)
    area = sum((right - left) * (high - low) for left, right, low, high in rectangles(x, y, mask))
    assert area == pytest.approx(mask.sum(), abs=1e-9)


def test_the_boundary_separates_what_the_states_separate() -> None:
    plane = marked(flat_plane((30, 20)), (slice(10, 20), slice(5, None)), UNSTABLE, 0.5)
    x, y = boundary(picture(plane))
    step = float(plane.x.values[1] - plane.x.values[0])
    assert np.nanmin(x) > plane.x.values[9] and np.nanmax(x) < plane.x.values[20]
    assert np.nanmax(x) - np.nanmin(x) == pytest.approx(9 * step + 2 * step / 1.5 / 2, abs=step)
    assert np.nanmin(y) > plane.y.values[4]


def test_nothing_is_drawn_around_what_is_not_decided() -> None:
    plane = marked(flat_plane((30, 20)), (slice(10, 20), slice(5, 9)), UNRESOLVED, 0.5)
    assert boundary(picture(plane))[0].size == 0


def test_a_single_undecided_point_gets_a_mark_that_can_be_seen(study: MapStudy) -> None:
    plane = marked(flat_plane((200, 150)), (120, 40), UNRESOLVED, -0.1)
    option, x, y = on(study, marked(plane, (slice(10, 60), slice(10, 60)), UNRESOLVED, -0.1))
    assert option.plane is not None
    (mark,) = [m for m in items_of(map_chart(option, option.plane, x, y), Marks) if m.label.startswith("UNRESOLVED")]
    assert mark.x.tolist() == [pytest.approx(3.6 * plane.x.values[120])]
    assert mark.y.tolist() == [pytest.approx(100.0 * plane.y.values[40])]


# --- names ------------------------------------------------------------------------------------------------------------


def test_names_stand_clear_of_each_other_and_of_narrow_regions() -> None:
    busy = np.zeros((80, 120), dtype=bool)
    columns = (20, 24, 28, 90)
    for column in columns:
        busy[30:, column] = True
    room = Room((0.0, 120.0), (0.0, 80.0), (5.2, 3.4), busy)
    anchors = [Anchor(c + 0.5, 70.0, "(w1 + w2)/2", (c + 0.5, 30.5)) for c in columns]
    items, left_out = placed(anchors, room)
    notes = [item for item in items if isinstance(item, Note)]
    assert len(notes) == 4 and left_out == 0
    half = (0.5 * (0.6 * 8.0 / 72.0 * 11 + 0.09) / 5.2 * 120.0, 0.5 * 1.75 * 8.0 / 72.0 / 3.4 * 80.0)
    for k, one in enumerate(notes):
        low, left = int(one.y - half[1]), int(one.x - half[0])
        assert not busy[max(low, 0) : int(one.y + half[1]), max(left, 0) : int(one.x + half[0])].any()
        assert all(abs(one.x - b.x) >= 2 * half[0] or abs(one.y - b.y) >= 2 * half[1] for b in notes[k + 1 :])


def test_every_region_of_the_map_is_named(study: MapStudy) -> None:
    option = study.options[0]
    assert option.plane is not None
    found = texts(map_chart(option, option.plane, study.x, study.y))
    assert {"2 w1", "2 w2", "w1 + w2", "none"} <= found


# --- the figures ------------------------------------------------------------------------------------------------------


def test_growth_and_decay_have_colours_of_their_own(study: MapStudy) -> None:
    option = study.options[1]
    assert option.plane is not None
    chart = map_chart(option, option.plane, study.x, study.y)
    growth, decay = items_of(chart, Heat)
    assert (growth.colours, decay.colours) == ("growth", "decay")
    assert np.nanmin(growth.z) > 0.0 and np.nanmin(decay.z) > 0.0
    shown = picture(option.plane)
    assert np.array_equal(np.isfinite(growth.z), shown.state == UNSTABLE)
    assert np.array_equal(np.isfinite(decay.z), shown.state == STABLE)
    marks = {cells.label: cells for cells in items_of(chart, Cells)}
    assert np.array_equal(marks["UNRESOLVED"].mask, shown.state == UNRESOLVED) and marks["UNRESOLVED"].hatched
    assert np.array_equal(marks["no answer"].mask, shown.state == NO_ANSWER)
    assert "the magnets touch at 21.6 m/s" in chart.caption and "does not count as stable" in chart.caption


@pytest.mark.parametrize(
    ("state", "growth"), [(UNSTABLE, np.nan), (STABLE, np.nan), (NO_ANSWER, np.nan), (UNRESOLVED, np.nan),
                          (UNSTABLE, 0.3), (STABLE, -0.3), (STABLE, 0.0)],
)  # fmt: skip
def test_maps_of_one_kind_are_drawn_and_no_cell_stays_blank(study: MapStudy, state: int, growth: float) -> None:
    option, x, y = on(study, flat_plane((12, 9), state=state, growth=growth))
    assert option.plane is not None
    chart = map_chart(option, option.plane, x, y)
    covered = np.zeros((9, 12), dtype=bool)
    for item in items_of(chart, Heat):
        covered |= np.isfinite(item.z)
    for item in items_of(chart, Cells):
        covered |= item.mask
    assert covered.all()
    assert svg(chart).startswith("<svg") and "NaN" not in json.dumps(interactive(chart))


def test_maps_of_one_row_or_column_are_drawn(study: MapStudy) -> None:
    for shape in ((1, 5), (6, 1), (1, 1)):
        option, x, y = on(study, flat_plane(shape))
        assert option.plane is not None
        assert svg(map_chart(option, option.plane, x, y)).startswith("<svg")


def test_two_laws_share_their_colours(study: MapStudy) -> None:
    option = study.options[1]
    assert option.plane is not None and option.law is not None and option.law.plane is not None
    chart = pair_chart(option, (("constant", option.plane), ("periodic", option.law.plane)), study.x, study.y)
    highs = [item.high for item in items_of(chart, Heat) if item.colours == "growth"]
    assert len(chart.panels) == 2 and len(set(highs)) == 1
    assert ", 0 % UNRESOLVED" not in chart.caption and "UNRESOLVED" in chart.caption


def test_bands_of_the_atlas_show_the_narrowest_no_go_range(study: MapStudy) -> None:
    atlas = study.options[0].atlas
    assert atlas is not None
    bad = atlas.of("no-go")[0]
    narrow = replace(atlas, ranges=(replace(bad, upper=bad.lower + 1e-6), *atlas.of("go")))
    speed, limits = speed_unit(study), (72.0, 414.0)
    drawn = {item.label: item for item in bands_panel(narrow, speed, limits).items if isinstance(item, Bars)}
    assert drawn["no go"].length[0] >= 0.003 * (limits[1] - limits[0]) and not drawn["no go"].hatched
    middle = float(drawn["no go"].start[0] + drawn["no go"].length[0] / 2)
    assert middle == pytest.approx(3.6 * bad.lower, abs=1e-3)


def test_the_atlas_names_what_grows(study: MapStudy) -> None:
    option = study.options[0]
    assert option.atlas is not None
    chart = atlas_chart(option, option.atlas, speed_unit(study))
    grows = {one.resonance.name for one in option.atlas.crossings if one.growth > 0.0}
    assert grows and {"2 w1", "2 w2"} <= texts(chart)
    assert any(isinstance(item, Line) and item.label == "sums and differences" for item in chart.panels[0].items)
    doubtful = tuple(replace(one, growth=np.nan) for one in option.atlas.crossings)
    marks = svg(atlas_chart(option, replace(option.atlas, crossings=doubtful), speed_unit(study)))
    assert "crossing, UNRESOLVED" in marks and "crossing, damped" not in marks
