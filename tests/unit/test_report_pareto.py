"""Fronts of options as a figure: every design where it belongs, every option told apart and named, words that fit."""

from __future__ import annotations

import itertools
import json
from typing import Any

import numpy as np
import pytest

from maglev_ctrl.report.chart import Chart, Line, Marks, Note, Panel
from maglev_ctrl.report.comparison.pareto import KNEE, Front, Objective, ParetoChartData, best_of_pairs, pareto_chart
from maglev_ctrl.report.draw import draw
from maglev_ctrl.report.interactive import interactive
from maglev_ctrl.report.style import INK
from maglev_ctrl.report.vector import svg

OBJECTIVES = (
    Objective("weighted acceleration", "m/s²", "smaller"), Objective("largest gap excursion", "mm", "smaller"),
    Objective("r.m.s. actuator force", "kN", "smaller"), Objective("smallest disk margin", "", "larger"),
)  # fmt: skip


def designs(count: int, *, seed: int, objectives: int) -> np.ndarray[Any, Any]:
    """Designs with a conflict: what rides softly needs the gap, and forces that span decades buy both."""
    random = np.random.default_rng(seed)
    soft, spare = np.sort(random.random(count)), random.random(count)
    points = np.column_stack([
        0.2 + soft, 3.0 / (0.2 + soft) * (1.0 + 0.3 * spare), 8.0 * np.exp(-4.0 * soft), 0.2 + 0.6 * spare,
    ])  # fmt: skip
    return points[:, :objectives]


def data(objectives: int = 3) -> ParetoChartData:
    made = (
        Front("No added suspension", designs(1, seed=5, objectives=objectives), 0, -1),
        Front("Damper windings", designs(30, seed=1, objectives=objectives), 12, 10),
        Front("Active secondary, LQR", designs(50, seed=2, objectives=objectives), 20, 25),
        Front("Sky-hook", np.full((2, objectives), np.nan), 0, 1),
    )
    return ParetoChartData(OBJECTIVES[:objectives], made)


def shown(panel: Panel) -> list[Marks]:
    return [item for item in panel.items if isinstance(item, Marks)]


@pytest.mark.parametrize(("across", "upwards"), list(itertools.product(("smaller", "larger"), repeat=2)))
def test_lines_join_what_nothing_betters(across: Any, upwards: Any) -> None:
    random = np.random.default_rng(4)
    for _ in range(50):
        x, y = random.integers(0, 6, (2, 12)).astype(float)  # whole numbers: ties are common
        a, b = x if across == "smaller" else -x, y if upwards == "smaller" else -y
        bettered = [bool(np.any((a <= a[k]) & (b <= b[k]) & ((a < a[k]) | (b < b[k])))) for k in range(12)]
        path = best_of_pairs(x, y, across, upwards=upwards)
        assert {(x[k], y[k]) for k in path} == {(x[k], y[k]) for k in range(12) if not bettered[k]}
        assert len({(x[k], y[k]) for k in path}) == len(path)
        assert np.all(np.diff(a[path]) > 0.0) and np.all(np.diff(b[path]) < 0.0)


@pytest.mark.parametrize("count", [2, 3, 4])
def test_every_pair_has_its_panel_and_an_objective_the_same_axis_everywhere(count: int) -> None:
    chart = pareto_chart(data(count))
    assert chart.columns == chart.rows == count - 1
    limits: dict[int, set[tuple[float, float] | None]] = {}
    for place, panel in enumerate(chart.panels):
        row, column = divmod(place, count - 1)
        assert bool(panel.items) == (column <= row)
        if panel.items:
            limits.setdefault(column, set()).add(panel.x.limits)
            limits.setdefault(row + 1, set()).add(panel.y.limits)
            assert bool(panel.x.label) == (row == count - 2) and bool(panel.y.label) == (column == 0)
    for k, (span,) in limits.items():
        values = np.concatenate([np.asarray(option[1])[:, k] for option in data(count).options])
        assert span is not None and span[0] < np.nanmin(values) and np.nanmax(values) < span[1]


def test_every_design_stands_where_it_belongs() -> None:
    chart, (_, windings, _, _) = pareto_chart(data(3)), data(3).options
    points, tint = np.asarray(windings[1]), next(m.colour for m in shown(chart.panels[2]) if m.label == windings[0])
    for place, (i, j) in ((0, (0, 1)), (2, (0, 2)), (3, (1, 2))):
        marks = [m for m in shown(chart.panels[place]) if m.colour == tint]
        (chosen,) = [m for m in marks if m.label == windings[0]]
        (knee,) = [m for m in marks if m.symbol == "open_circle"]
        assert (chosen.x[0], chosen.y[0]) == (points[12, i], points[12, j])
        assert (knee.x[0], knee.y[0]) == (points[10, i], points[10, j])
        small = {(x, y) for m in marks if m is not chosen and m is not knee for x, y in zip(m.x, m.y, strict=True)}
        assert small == {(row[i], row[j]) for row in points}
        (line,) = [item for item in chart.panels[place].items if isinstance(item, Line) and item.colour == tint]
        assert {*zip(line.x, line.y, strict=True)} <= small


def test_the_corner_that_is_better() -> None:
    corners = {}
    for across, upwards in itertools.product(("smaller", "larger"), repeat=2):
        axes = (("ride", "m/s²", across), ("gap", "mm", upwards))
        (panel,) = pareto_chart(ParetoChartData(axes, (("One", designs(9, seed=1, objectives=2), 0, 0),))).panels  # type: ignore[arg-type]
        (note,) = [item for item in panel.items if isinstance(item, Note)]
        assert panel.x.limits is not None and panel.y.limits is not None
        right, up = note.x > sum(panel.x.limits) / 2.0, note.y > sum(panel.y.limits) / 2.0
        assert (right, up) == (across == "larger", upwards == "larger")
        corners[note.text.replace("better", "").strip()] = (right, up)
    assert corners == {"↙": (False, False), "↖": (False, True), "↘": (True, False), "↗": (True, True)}


def test_options_are_told_apart_and_named() -> None:
    fronts = tuple((f"Option {k}", designs(8, seed=k, objectives=2), 0, 1) for k in range(10))
    chart = pareto_chart(ParetoChartData(OBJECTIVES[:2], fronts))
    named = {m.label: (m.colour, m.symbol) for m in shown(chart.panels[0]) if m.label and m.label != KNEE}
    assert len(named) == len({tint for tint, _ in named.values()}) == 10
    neighbours = zip(list(named.values()), list(named.values())[1:], strict=False)
    assert all(one[1] != other[1] for one, other in neighbours)
    assert all(label in chart.alt for label, *_ in fronts)


def test_what_is_missing_is_said_and_a_lone_nan_hides_a_design_everywhere() -> None:
    chart = pareto_chart(data(3))
    assert "Nothing to show for Sky-hook." in chart.caption and "Sky-hook: no design with known values." in chart.alt
    assert "Sky-hook" not in {m.label for m in shown(chart.panels[0]) if np.isfinite(m.x).any()}
    points = designs(5, seed=1, objectives=3)
    points[2, 2] = np.inf
    chart = pareto_chart(ParetoChartData(OBJECTIVES[:3], (("One", points, 2, -1),)))
    first = [m for m in shown(chart.panels[0]) if m.colour == INK and np.isfinite(m.x).all()]
    assert points[2, 0] not in np.concatenate([m.x for m in first])
    assert "for example, of 4 designs" in chart.alt


def test_decades_are_logarithmic_and_signs_linear() -> None:
    force = np.geomspace(0.01, 10.0, 8)
    for values, log in ((force, True), (force - 1.0, False), (1.0 + 0.01 * force, False)):
        points = np.column_stack([np.linspace(1.0, 2.0, 8), values])
        (panel,) = pareto_chart(ParetoChartData(OBJECTIVES[:2], (("One", points, 0, 0),))).panels
        assert panel.y.log is log and not panel.x.log


def clashes(chart: Chart) -> list[tuple[str, str]]:
    """Texts of the drawn figure that cover each other or leave the page."""
    figure = draw(chart)
    figure.canvas.draw()
    page = figure.bbox
    texts = [(t.get_text(), t.get_window_extent()) for t in figure.texts if t.get_text()]
    found = [
        (one, other) for (one, a), (other, b) in itertools.combinations(texts, 2)
        if min(a.x1, b.x1) - max(a.x0, b.x0) > 1.0 and min(a.y1, b.y1) - max(a.y0, b.y0) > 1.0
    ]  # fmt: skip
    return found + [(one, "page") for one, a in texts if a.x0 < -1.0 or a.x1 > page.x1 + 1.0 or a.y0 < -1.0]


@pytest.mark.parametrize("count", [2, 3, 4])
def test_it_is_drawn_on_paper_and_on_the_page(count: int) -> None:
    long = tuple(o._replace(name=f"{o.name} of everything anybody could measure") for o in OBJECTIVES[:count])
    for objectives in (OBJECTIVES[:count], long):
        chart = pareto_chart(ParetoChartData(objectives, data(count).options))
        assert clashes(chart) == []
        assert svg(chart).startswith("<svg") and KNEE in svg(chart)
        text = json.dumps(interactive(chart), allow_nan=False)
        assert "Damper windings: weighted acceleration" in text and ", chosen" in text and ", knee" in text
        assert all(one.name in chart.caption for one in objectives)


def test_words_that_cover_each_other_would_be_caught() -> None:
    panel = pareto_chart(data(2)).panels[0]
    double = Panel((*panel.items, Note(0.5, 5.0, "one"), Note(0.5, 5.0, "two")), panel.x, panel.y)
    assert ("one", "two") in clashes(Chart("k", "caption", "alt", (double,)))


FINE = designs(3, seed=1, objectives=2)


@pytest.mark.parametrize(("objectives", "options", "said"), [
    (OBJECTIVES[:1], (("One", FINE, 0, 0),), "objectives: expected 2 to 4, got 1"),
    ((*OBJECTIVES, OBJECTIVES[0]), (("One", FINE, 0, 0),), "objectives: expected 2 to 4, got 5"),
    ((OBJECTIVES[0], ("gap", "mm", "up")), (("One", FINE, 0, 0),), "expected the sense smaller or larger for gap"),
    (OBJECTIVES[:2], (), "options: expected at least one"),
    (OBJECTIVES[:3], (("One", FINE, 0, 0),), r"expected points \(n, 3\) for One, got \(3, 2\)"),
    (OBJECTIVES[:2], (("One", FINE, 3, 0),), "expected chosen of One in -1 .. 2, got 3"),
    (OBJECTIVES[:2], (("One", FINE, 0, -2),), "expected knee of One in -1 .. 2, got -2"),
    (OBJECTIVES[:2], (("One", np.full((3, 2), np.nan), 0, 0),), "expected a design with finite objectives, got none"),
])  # fmt: skip
def test_wrong_data(objectives: Any, options: Any, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        pareto_chart(ParetoChartData(objectives, options))
