"""Bounds are told as bounds everywhere, lone critical depths are drawn, and no banner contradicts its own words."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Literal

import numpy as np
import pytest

from maglev_ctrl.analysis.modes import ModeKind
from maglev_ctrl.analysis.resonance_map import SeededTongue
from maglev_ctrl.errors import Verdict
from maglev_ctrl.report import content_margins
from maglev_ctrl.report.chart import Area, Bars, Chart, Line, Marks, Note
from maglev_ctrl.report.charts_comparison import options_over_speed
from maglev_ctrl.report.charts_margins import margin_bars
from maglev_ctrl.report.charts_periodic import critical_curve, resonance_chart, tips_below_curve
from maglev_ctrl.report.content import report_model
from maglev_ctrl.report.content_cover import cover_tiles
from maglev_ctrl.report.content_method import METHOD
from maglev_ctrl.report.content_worst import worst_blocks
from maglev_ctrl.report.findings import CHOICE, key_findings, leading_option, tightest, unforced_warning
from maglev_ctrl.report.legend import legend_entries
from maglev_ctrl.report.model import Banner, Bullets, Paragraph, Report, Table
from maglev_ctrl.report.style import INK, PALETTE, colour
from maglev_ctrl.report.values import bound_words, margin_words, reason_words, value_words
from maglev_ctrl.scenario import Scenario
from maglev_ctrl.study import Comparison, FloquetStudy, OptionStudy, RequirementResult
from maglev_ctrl.study.option import study_option
from maglev_ctrl.vehicle import Actuator

Bound = Literal["exact", "lower", "upper"]
ENDS = "no instability found up to height 280 mm"


def result(
    name: str = "height", *, bound: Bound = "lower", margin: float = 60.0, verdict: Verdict = Verdict.PASS,
    sense: Literal["at_least", "at_most"] = "at_least",
) -> RequirementResult:  # fmt: skip
    return RequirementResult(
        name=name, quantity="height_margin", description="distance to instability in height", sense=sense, limit=50.0,
        value=80.0, unit="mm", verdict=verdict, margin_percent=margin, worst_at="height 280 mm", method="search",
        reason=ENDS if bound != "exact" else "", bound=bound,
    )  # fmt: skip


@pytest.fixture(scope="module")
def studied(small_scenario: Callable[..., Scenario]) -> OptionStudy:
    scenario = small_scenario()
    return study_option(scenario, scenario.options[1])


def judged(studied: OptionStudy, name: str, *results: RequirementResult) -> OptionStudy:
    return replace(studied, name=name, label=name, requirements=results)


def compared(*options: OptionStudy) -> Comparison:
    return Comparison(
        title="t", description="d", scenario_path="p", scenario_text="x", scenario_hash="0" * 64, sources=(),
        assumptions=(), forces=(), design_speed=100.0, design_height=0.2, options=options, versions=(),
        created="2026-01-01T00:00:00Z", seconds=1.0,
    )  # fmt: skip


def table(report: Report, start: str) -> Table:
    blocks = (block for section in report.sections for block in section.blocks)
    return next(b for b in blocks if isinstance(b, Table) and b.caption.startswith(start))


def test_a_bound_never_reads_like_a_number() -> None:
    assert value_words(result()) == "≥ 80.0 mm"
    assert value_words(result(bound="upper")) == "≤ 80.0 mm"
    assert value_words(result(bound="exact")) == "80.0 mm"
    assert bound_words(result()) == f"height ≥ 80.0 mm ({ENDS})"
    assert ENDS in reason_words(result()) and "≥ 80.0 mm" in reason_words(result())


@pytest.mark.parametrize(
    ("bound", "sense", "sign"),
    [("lower", "at_least", "≥ "), ("upper", "at_least", "≤ "), ("upper", "at_most", "≥ "), ("lower", "at_most", "≤ ")],
)
def test_the_margin_is_bounded_the_right_way(bound: Bound, sense: Literal["at_least", "at_most"], sign: str) -> None:
    assert margin_words(result(bound=bound, sense=sense)) == f"{sign}60.0 %"


def test_bounds_do_not_decide_what_is_closest(studied: OptionStudy) -> None:
    exact = result("disk", bound="exact", margin=90.0)
    tight = tightest(judged(studied, "a", result(margin=10.0), exact))
    assert tight is not None and tight.name == "disk"
    mutant = tightest(judged(studied, "a", result(bound="exact", margin=10.0), exact))  # the bound taken for exact
    assert mutant is not None and mutant.name == "height"


def test_bounds_do_not_choose_the_leading_option(studied: OptionStudy) -> None:
    large = judged(studied, "large", result(margin=5.0), result("disk", bound="exact", margin=90.0))
    small = judged(studied, "small", result(margin=70.0), result("disk", bound="exact", margin=40.0))
    best = leading_option(compared(small, large))
    assert best is large
    told = " ".join(key_findings(compared(small, large)))
    assert CHOICE in told and f"height ≥ 80.0 mm ({ENDS})" in told


def test_without_an_exact_margin_it_is_said(studied: OptionStudy) -> None:
    told = " ".join(key_findings(compared(judged(studied, "a", result()), judged(studied, "b", result()))))
    assert "no exactly known margin" in told and "closest to its limit" not in told


def test_a_bound_is_an_open_arrow_and_an_exact_margin_a_bar(studied: OptionStudy) -> None:
    chart = margin_bars(compared(judged(studied, "a", result()), judged(studied, "b", result(bound="exact"))))
    assert chart is not None
    items = chart.panels[0].items
    (arrow,) = [item for item in items if isinstance(item, Area)]
    (bar,) = [item for item in items if isinstance(item, Bars)]
    assert arrow.fill is None and float(np.max(arrow.x)) == pytest.approx(60.0)
    assert "≥" in [item.text for item in items if isinstance(item, Note)]
    assert bar.position[0] == -1.0
    assert "a ≥ 60.0 %" in chart.alt


def test_tables_show_bounds_and_no_change_from_them(studied: OptionStudy) -> None:
    base = replace(judged(studied, "a", result(bound="exact", margin=10.0)), kind="baseline")
    report = report_model(compared(base, judged(studied, "b", result())))
    values = table(report, "Values of every requirement")
    assert [cells[1].text for cells in values.rows] == ["80.0 mm", "≥ 80.0 mm"]
    assert table(report, "Requirements of b").rows[0][3].text == "≥ 80.0 mm"
    heads = table(report, "Verdicts of every option").columns
    assert heads[:2] == ("Option", "Overall")


def test_a_single_unstable_column_is_a_mark_and_no_line() -> None:
    x = np.arange(6.0)
    depth = np.array([np.inf, 0.2, np.inf, np.inf, np.inf, 0.1])
    alone = critical_curve(x, depth, "d", ("one", "circle"), INK, "solid")
    assert [type(item) for item in alone] == [Marks]
    assert alone[0].y.tolist() == pytest.approx([20.0, 10.0])
    both = critical_curve(x, np.array([np.inf, 0.2, np.inf, 0.3, 0.4, np.inf]), "d", ("one", "circle"), INK, "solid")
    assert [type(item) for item in both] == [Line, Marks]
    assert np.isfinite(both[0].y).tolist() == [False, False, False, True, True, False]
    assert critical_curve(x, np.full(6, np.inf), "d", ("one", "circle"), INK, "solid") == ()


def lonely(studied: OptionStudy) -> OptionStudy:
    """The option with one unstable column and one tongue between columns."""
    study = periodic(studied)
    speeds = study.map.parameter
    critical = np.full(len(speeds), np.inf)
    critical[2] = 0.2
    seed = SeededTongue(0.5 * float(speeds[3] + speeds[4]), 0.07, "2 w1/1 (car heave)", False)
    hidden = SeededTongue(0.5 * float(speeds[1] + speeds[2]), 0.25, "2 w2/1 (car pitch)", True)
    atlas = replace(study.map, seeded=(seed, hidden))
    return replace(studied, floquet=replace(study, critical_depth=critical, map=atlas))


def periodic(studied: OptionStudy) -> FloquetStudy:
    assert studied.floquet is not None
    return studied.floquet


def labels(chart: Chart | None) -> list[str]:
    assert chart is not None
    return [label for _, label in legend_entries(chart)]


def test_lone_columns_and_tips_are_drawn_and_told(studied: OptionStudy) -> None:
    option = lonely(studied)
    assert [tip.threshold for tip in tips_below_curve(periodic(option))] == [0.07]
    chart = options_over_speed(compared(option))
    assert chart is not None
    marks = [item for item in chart.panels[2].items if isinstance(item, Marks)]
    assert [(m.symbol, m.y.tolist()) for m in marks] == [
        ("circle", pytest.approx([20.0])), ("triangle", pytest.approx([7.0]))
    ]  # fmt: skip
    assert "no line or marker: stable up to" in chart.caption
    drawn = resonance_chart(option, design_speed=100.0)
    assert "critical depth" not in labels(drawn)
    assert "critical depth at a single speed" in labels(drawn)
    assert drawn is not None and "the line is" not in drawn.caption and "a circle" in drawn.caption


def growth(verdict: Verdict) -> RequirementResult:
    words = "largest growth rate, worst over the speed sweep"
    return replace(result("stable", bound="exact", verdict=verdict), quantity="growth_rate", description=words)


def test_a_map_that_contradicts_the_sweep_is_told(studied: OptionStudy) -> None:
    study = periodic(studied)
    unstable = np.array(study.map.unstable)
    unstable[:, 0] = False
    unstable[:2, 0] = True
    sweep = next(s for s in studied.sweeps if s.parameter == "speed")
    speeds = np.linspace(0.5, 1.5, len(study.map.parameter)) * float(sweep.values[0])
    atlas = replace(study.map, unstable=unstable, parameter=speeds, depths=study.map.depths - study.map.depths[0])
    option = replace(studied, floquet=replace(study, map=atlas), requirements=(growth(Verdict.PASS),))
    told = unforced_warning(option)
    assert "reaches beyond the speed sweep" in told and "unstable without modulation at" in told
    assert any(told in sentence for sentence in key_findings(compared(option)))
    assert unforced_warning(replace(option, requirements=(growth(Verdict.FAIL),))) == ""
    unstable = np.zeros_like(unstable)
    assert unforced_warning(replace(option, floquet=replace(study, map=replace(atlas, unstable=unstable)))) == ""


def banner(*options: OptionStudy) -> Banner:
    cover = report_model(compared(*options)).cover
    assert cover is not None
    return cover.banner


def test_the_banner_is_neutral_where_options_differ(studied: OptionStudy) -> None:
    good, bad = judged(studied, "g", result()), judged(studied, "b", result(verdict=Verdict.FAIL))
    mixed = banner(good, bad)
    assert mixed.verdict is None
    assert mixed.text.startswith("1 of 2 options PASS, 1 FAIL, 0 NOT EVALUATED.")
    assert banner(good, replace(good, name="h")).verdict is Verdict.PASS
    assert banner(bad, replace(bad, name="c")).verdict is Verdict.FAIL


def test_what_the_analysis_leaves_out_is_said(studied: OptionStudy) -> None:
    assert any("three standard deviations of the force" in line for line in METHOD)
    body = studied.vehicle.bodies[0].name
    limited = Actuator("push", body, to="guideway", position=(0.0, 0.0, 0.0), force_limit=60e3)
    plain = report_model(compared(studied))
    assert table(plain, "Equilibrium of").rows[-2][0].text == "Held"
    option = replace(studied, vehicle=studied.vehicle.with_elements(actuators=(limited,)))
    line = "Force limits (60.0 kN): the linear analysis does not enforce them; nothing else checks them."
    told = [item for s in report_model(compared(option)).sections for b in s.blocks if isinstance(b, Bullets)
            for item in b.items]  # fmt: skip
    assert line in told
    assert not any(line in b.items for s in plain.sections for b in s.blocks if isinstance(b, Bullets))


def test_ten_options_have_ten_colours() -> None:
    assert len({colour(order) for order in range(10)}) == 10 == len(PALETTE)


def growing(name: str, value: float, at: str, *, hard: bool = True) -> RequirementResult:
    return RequirementResult(
        name=name, quantity="growth_rate", description="largest growth rate", sense="at_most", limit=0.0, value=value,
        unit="1/s", verdict=Verdict.PASS, margin_percent=math.nan, worst_at=at, method="two methods", reason="",
        bound="exact", hard=hard,
    )  # fmt: skip


def test_a_key_figure_is_the_worst_of_its_kind(studied: OptionStudy) -> None:
    at_design, over_speed = growing("here", -0.0471, "design point"), growing("everywhere", -0.0462, "speed 443 km/h")
    for order in ((at_design, over_speed), (over_speed, at_design)):
        tiles = cover_tiles(compared(judged(studied, "a", *order, growing("wished", 5.0, "nowhere", hard=False))))
        (tile,) = (one for one in tiles if one.label == "Largest growth rate")
        assert tile.value == "\N{MINUS SIGN}0.0462 1/s" and "443 km/h" in tile.detail


def test_the_summary_tells_where_a_baseline_grows_that_is_stable_at_the_design_point(studied: OptionStudy) -> None:
    sweep = studied.sweeps[0]
    assert studied.modes is not None and studied.modes.stable and not np.any(sweep.abscissa > 0.0)
    base = replace(judged(studied, "bare"), kind="baseline")
    assert "it grows at" not in " ".join(key_findings(compared(base)))
    grown = np.array(sweep.abscissa)
    grown[[1, 2]] = 0.0744, 0.03
    rounding = replace(base, sweeps=(replace(sweep, abscissa=grown), *studied.sweeps[1:]))
    assert "it grows at" not in " ".join(key_findings(compared(rounding)))  # no mode is of a kind that grows
    kinds = tuple((ModeKind.DIVERGENCE, *row[1:]) if k in (1, 2) else row for k, row in enumerate(sweep.tracks.kinds))
    unstable = replace(sweep, abscissa=grown, tracks=replace(sweep.tracks, kinds=kinds))
    base = replace(base, sweeps=(unstable, *studied.sweeps[1:]))
    told = " ".join(key_findings(compared(base)))
    at = f"{sweep.scale * sweep.values[1]:.3g}"
    assert f"grows at 2 of {len(grown)} points, at most by 0.0744 1/s at {at} {sweep.unit}" in told


def test_a_disk_that_is_as_large_as_can_be_has_no_gains_and_loses_nothing(studied: OptionStudy) -> None:
    assert content_margins._any_gain(-186.6, 186.6) == "any positive gain"
    assert content_margins._any_gain(-6.0, 6.0) == "any gain between \N{MINUS SIGN}6.00 dB and 6.00 dB"
    margins = studied.margins
    assert margins is not None
    first = margins.channels[0]
    whole = replace(first, disk=replace(first.disk, alpha=2.0, perturbation=np.array([2.0 + 0.0j])))
    assert not np.isfinite(whole.disk.factors[0])
    told = worst_blocks(replace(margins, channels=(whole,)), "x", key="k")[0]
    assert isinstance(told, Paragraph) and "none is lost by any positive gain" in told.text
