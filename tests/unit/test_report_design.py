"""The page of a design: figures with units, tables and words that say no more than is proved."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from design_fixture import law, small_study

from maglev_ctrl.errors import Verdict
from maglev_ctrl.proofs.claims import DecayClaim, EllipsoidClaim
from maglev_ctrl.proofs.makers import energy_claim
from maglev_ctrl.report.chart import Area, Chart, Line
from maglev_ctrl.report.design.charts import (
    budget_chart,
    gain_chart,
    manoeuvre_chart,
    poles_chart,
    region_area,
    response_chart,
)
from maglev_ctrl.report.design.content import design_model
from maglev_ctrl.report.design.levels import level_blocks
from maglev_ctrl.report.design.tables import (
    GAIN,
    budget_table,
    claim_table,
    manoeuvre_table,
    performance_table,
    sampled_table,
)
from maglev_ctrl.report.design.words import (
    claim_units,
    claim_words,
    claims_in_short,
    gathered,
    round_up,
    rounded_claim,
    short_names,
)
from maglev_ctrl.report.html import html
from maglev_ctrl.report.model import Banner, FigureBlock, Paragraph, Table
from maglev_ctrl.report.style import ABSENT, MINUS, number
from maglev_ctrl.report.vector import svg
from maglev_ctrl.study.design.records import DesignStudy, Level
from maglev_ctrl.synthesis.damping.budget import damping_budget
from maglev_ctrl.synthesis.damping.places import DampingPlace
from maglev_ctrl.synthesis.lmi.regions import contains, damping, disk, half_plane, intersection
from maglev_ctrl.synthesis.result import Performance, proven
from maglev_ctrl.systems import Controller, SecondOrderSystem
from maglev_ctrl.systems.plant import Plant

UNIT = re.compile(r"\((1/s|rad/s|Hz|dB|%|kN s/m|s|m/s|km/h)\)$|^(mm|kN|m/s\^2|m/s|deg|deg/s)$")


@pytest.fixture(scope="module")
def study() -> DesignStudy:
    return small_study()


@pytest.fixture(scope="module")
def charts(study: DesignStudy) -> tuple[Chart, ...]:
    return tuple(design_model(study).charts())


def test_every_axis_has_a_name_and_a_unit(charts: tuple[Chart, ...]) -> None:
    assert len(charts) >= 8 and len({chart.key for chart in charts}) == len(charts)
    for chart in charts:
        assert chart.caption.endswith(".") and len(chart.caption) < 300 and chart.alt.endswith(".")
        for panel in chart.panels:
            assert all(UNIT.search(axis.label) for axis in (panel.x, panel.y)), (chart.key, panel.x, panel.y)


def test_no_legend_has_two_entries_alike_and_every_tick_is_in_sight(charts: tuple[Chart, ...]) -> None:
    for chart in charts:
        for panel in chart.panels:
            labels = [item.label for item in panel.items if getattr(item, "label", "")]
            assert len(labels) == len(set(labels)), chart.key
            for axis in (panel.x, panel.y):
                if axis.limits is not None and axis.ticks:
                    assert axis.limits[0] <= min(axis.ticks) and max(axis.ticks) <= axis.limits[1]


def test_every_figure_draws(charts: tuple[Chart, ...]) -> None:
    for chart in charts:
        assert svg(chart).lstrip().startswith("<") and "nan" not in svg(chart)[:200]


@pytest.mark.parametrize(
    ("region", "window"),
    [
        (damping(0.3), (-13.0, 3.0, 29.0)),
        (damping(0.95), (-13.0, 3.0, 29.0)),  # the cone leaves the window by its side, far below its corners
        (disk(0.0, 5.0), (-13.0, 3.0, 29.0)),
        (disk(-8.0, 2.0), (-13.0, 3.0, 29.0)),
        (half_plane(4.0), (-13.0, 3.0, 29.0)),
        (intersection(damping(0.6), half_plane(1.0), disk(0.0, 12.0)), (-13.0, 3.0, 29.0)),
    ],
)
def test_the_outline_of_a_region_is_inside_the_region_and_the_window(region, window) -> None:
    area = region_area(region, window)
    assert area is not None
    left, right, height = window
    assert np.all((area.x >= left - 1e-9) & (area.x <= right + 1e-9) & (np.abs(area.y) <= height * (1.0 + 1e-12)))
    centre = complex(np.mean(area.x), np.mean(area.y))
    outline = area.x + 1j * area.y
    assert np.all(contains(region, centre + (1.0 - 1e-6) * (outline - centre)))
    # and it is no smaller than it need be: beyond it is outside of the one or the other
    beyond = centre + 1.02 * (outline - centre)
    out = (beyond.real < left) | (beyond.real > right) | (np.abs(beyond.imag) > height)
    assert np.mean(out | ~contains(region, beyond)) > 0.99


def test_a_region_out_of_sight_is_not_drawn() -> None:
    assert region_area(half_plane(50.0), (-13.0, 3.0, 29.0)) is None


def test_poles_and_gains_are_those_of_the_study(study: DesignStudy) -> None:
    one = law(study, "worst")
    chart = poles_chart(one)
    assert chart is not None
    closed = next(item for item in chart.panels[0].items if getattr(item, "label", "") == "with the law")
    assert np.array_equal(np.sort(closed.x), np.sort(one.corners[0].closed_loop.real))
    gain = gain_chart(one)
    assert gain is not None and one.gain is not None
    line = next(item for item in gain.panels[0].items if isinstance(item, Line) and item.label == "with the law")
    assert np.max(10.0 ** (line.y / 20.0)) == pytest.approx(np.max(one.gain.closed_loop))
    said = float(re.search(r"stay below ([\d.]+)\.", gain.caption)[1])  # type: ignore[index]
    assert said >= one.gain.level
    steady = replace(one.corners[0], open_loop=np.array([-1.0 + 1.0j, -1.0 - 1.0j]))
    calm = gain_chart(replace(one, corners=(steady,)))
    assert calm is not None and "unstable" not in calm.caption
    falling = replace(one.corners[0], open_loop=np.array([-1.0 + 0.0j, 1.0 + 0.0j]))
    warned = gain_chart(replace(one, corners=(falling,)))
    assert warned is not None and "Without the law the loop is unstable" in warned.caption
    assert any(getattr(item, "label", "") == "without the law, unstable" for item in warned.panels[0].items)
    assert poles_chart(replace(one, corners=())) is None and gain_chart(replace(one, gain=None)) is None


def test_a_region_is_drawn_where_a_law_asks_for_one(study: DesignStudy) -> None:
    chart = poles_chart(replace(law(study, "lqr"), region=damping(0.1)))
    assert chart is not None and any(isinstance(item, Area) for item in chart.panels[0].items)


def test_manoeuvre_is_named_in_titles_and_told_in_numbers(study: DesignStudy) -> None:
    one = law(study, "mpc")
    assert one.predictive is not None
    chart = manoeuvre_chart(one, one.predictive)
    assert [panel.title for panel in chart.panels] == [signal.name for signal in one.predictive.signals]
    table = manoeuvre_table(one.predictive)
    stroke = next(signal for signal in one.predictive.signals if signal.name.endswith(".stroke"))
    row = next(row for row in table.rows if row[0].text == stroke.name)
    assert row[1].text == "20.0 mm"
    assert float(row[2].text.split()[0]) == pytest.approx(1e3 * np.max(np.abs(stroke.predicted)), rel=0.01)
    outside = 0.02 * np.sum(np.abs(stroke.saturated) > 0.02 * (1 + 1e-6))
    assert float(row[5].text.split()[0]) == pytest.approx(outside, abs=1e-3)


def test_claims_are_rounded_to_the_safe_side() -> None:
    said = rounded_claim("every pole decays at 1.99999 1/s; the gain is below 2.00001, and |u| < 1234.5678")
    assert said == "every pole decays at 1.999 1/s; the gain is below 2.001, and |u| < 1235"
    assert (
        rounded_claim("decays at 0.5 1/s; is below 3.75; of 5 loops") == "decays at 0.5 1/s; is below 3.75; of 5 loops"
    )
    rng = np.random.default_rng(0)
    for value in 10.0 ** rng.uniform(-6, 5, 300):
        rate = float(rounded_claim(f"decays at {value:.10g} 1/s").split()[2])
        bound = float(rounded_claim(f"below {value:.10g}").split()[1])
        assert rate <= value * (1 + 1e-9) and bound >= value * (1 - 1e-9)
        assert rate >= value * 0.9985 and bound <= value * 1.0015


def test_claims_in_few_words(study: DesignStudy) -> None:
    one = law(study, "scheduled").synthesis
    assert one is not None
    assert claim_words(one, 0).startswith("the loop is stable everywhere from speed 216 km/h to speed 360 km/h while")
    (short,) = claims_in_short(one)
    slowest = min(claim.speed_limit for claim in one.claims)  # type: ignore[union-attr]
    assert "between 3 nodes" in short and float(short.split(" at ")[1].split()[0]) <= slowest
    failed = replace(one, proofs=(replace(one.proofs[0], holds=False, reason="too fast"), *one.proofs[1:]))
    assert any(words.startswith("NOT PROVED: ") and "too fast" in words for words in claims_in_short(failed))
    table = claim_table(replace(law(study, "scheduled"), synthesis=failed))
    assert [row[1].text for row in table.rows] == ["✗ FAIL", "✓ PASS"] and table.rows[0][3].text == "too fast"


def test_numbers_come_with_their_units(study: DesignStudy) -> None:
    one = law(study, "scheduled")
    assert one.synthesis is not None
    units = claim_units(one)
    assert units["the parameter"] == "m/s"
    for words in (claim_words(one.synthesis, 0, units), *claims_in_short(one.synthesis, units)):
        assert re.search(r"moves at [\d.e]+ m/s per second or slower", words)
    plant = Plant.from_matrices([[1.0]], [[1.0]], [[1.0]], [[1.0]])
    gain = Controller.static([[-3.0]], measured=("x1",), commands=("u1",))
    claims = [EllipsoidClaim((0,), (0,), np.ones((1, 1, 1)), (3.00001,))]
    held = proven("demo", [plant], [gain], claims=claims)
    assert claim_words(held, 0, {"u1": "N"}).endswith("|u1| < 3.001 N")
    assert (
        claim_words(held, 0, {"u2": "N"}).endswith("|u1| < 3.001") and claim_words(held, 0) == claims_in_short(held)[0]
    )


def test_numbers_no_solver_reported_stand_alone(study: DesignStudy) -> None:
    one = law(study, "lqr")
    assert one.synthesis is not None
    alone = Performance(GAIN, float("nan"), 4.64999e6)
    table = performance_table(replace(one, synthesis=replace(one.synthesis, performance=(alone,))))
    assert table.columns == ("Quantity", "Computed") and table.rows[0][1].text == "4.6500e6 SI"
    both = (alone, Performance("H2 norm", 1.0, 1.0))
    table = performance_table(replace(one, synthesis=replace(one.synthesis, performance=both)))
    assert [len(row) for row in table.rows] == [3, 3] and table.rows[0][1].text == ABSENT
    assert table.rows[1][1].text == table.rows[1][2].text == "1.000000"
    first = one.synthesis.controllers[0]
    springs = replace(first, D=np.where([name == "car.heave" for name in first.measured], first.D, 0.0))
    pure = replace(one, synthesis=replace(one.synthesis, controllers=(springs,), performance=(alone,)))
    assert performance_table(pure).rows[0][1].text == "4.6500e6 N/m"


def test_what_sampling_gains_is_not_a_loss(study: DesignStudy) -> None:
    one = law(study, "lqr").sampled
    assert one is not None and one.loss is not None
    turned = replace(one, loss=replace(one.loss, continuous=one.loss.sampled, sampled=one.loss.continuous))
    lost, gained = ([row[3].text for row in sampled_table(each).rows] for each in (one, turned))
    assert not any(text.startswith(MINUS) for text in (*lost, *gained))
    assert any(text.startswith("gained ") for text in gained)


def test_names_with_commas_are_told_apart(study: DesignStudy) -> None:
    first, second = (replace(law(study, "lqr"), label=f"LQR, {k}") for k in ("soft", "hard"))
    banner = design_model(replace(study, options=(first, second))).sections[0].blocks[0]
    assert isinstance(banner, Banner) and banner.text == "Proved: LQR, soft; LQR, hard."


def test_poles_and_gains_share_a_figure(study: DesignStudy) -> None:
    one = law(study, "worst")
    chart = response_chart(one)
    assert chart is not None and [panel.title for panel in chart.panels] == ["poles", "gain"] and chart.columns == 2
    assert one.gain is not None and f"proved below {number(round_up(one.gain.level), digits=4)}" in chart.caption
    poles = response_chart(replace(one, gain=None))
    gain = response_chart(replace(one, corners=()))
    assert poles is not None and gain is not None and len(poles.panels) == len(gain.panels) == 1
    assert response_chart(replace(one, corners=(), gain=None)) is None


def test_levels_that_are_alike_share_a_row(study: DesignStudy) -> None:
    names = [f"bogie_magnet_{k}.gap" for k in range(1, 12)]
    levels = [Level(name, "m", 0.0096 * (1.0 + 1e-12 * k), 0.01, "") for k, name in enumerate(names)]
    levels += [Level("other.gap", "m", 0.0095, 0.01, ""), Level("cylinder_bogie", "N", 24e3, 8e3, "")]
    table, words = level_blocks(replace(law(study, "worst"), levels=tuple(levels)))
    assert isinstance(table, Table) and isinstance(words, Paragraph)
    told = [row[0].text for row in table.rows]
    assert told == ["cylinder_bogie", "bogie_magnet_1.gap to bogie_magnet_11.gap", "other.gap"]
    assert words.text.startswith("cylinder_bogie exceeds")


def test_one_bound_for_several_points_is_the_weakest() -> None:
    plant = Plant.from_matrices([[1.0]], [[1.0]], [[1.0]], [[1.0]])
    plants = (plant, replace(plant, A=plant.A - 1.0), replace(plant, A=plant.A - 2.0))
    law = Controller.static([[-3.0]], measured=("x1",), commands=("u1",))
    claims = [DecayClaim((i,), (0,), rate, np.ones((1, 1, 1))) for i, rate in enumerate((1.90009, 2.5, 3.5))]
    claims.append(DecayClaim((0, 1, 2), (0, 0, 0), 1.0, np.ones((1, 1, 1))))
    made = proven("demo", plants, [law], claims=claims)
    first, second = claims_in_short(made)
    assert first == "every pole of the closed loop decays at 1.9 1/s or faster (at each of 3 operating points)"
    assert second.startswith("each of the 3 closed loops, and every loop between them however fast it varies, decays")
    norms = [energy_claim(plants[i], law, level, index=i) for i, level in enumerate((0.6, 0.5, 0.7))]
    (bound,) = claims_in_short(proven("demo", plants, [law], claims=norms))
    assert bound.endswith("is below 0.7 (at each of 3 operating points)")


def test_names_in_few_words() -> None:
    assert short_names(("a_b_c", "d_b_c")) == ("a", "d") and short_names(("a_b", "a_b_c")) == ("b", "b_c")
    assert short_names(("leg_front",)) == ("leg_front",) and short_names(()) == ()
    assert gathered("a_1, a_2, a_3, b and c_1, c_2") == "a_1 to a_3, b and c_1, c_2"
    assert gathered("limits (s, m_1.gap, m_2.gap, m_4.gap)") == "limits (s, m_1.gap, m_2.gap, m_4.gap)"
    assert gathered("a sentence, of words, as it is") == "a sentence, of words, as it is"


def test_budget_of_two_places(study: DesignStudy) -> None:
    chain = SecondOrderSystem.from_matrices(
        [[1.0, 0.0], [0.0, 1.0]], np.zeros((2, 2)), [[2000.0, -1000.0], [-1000.0, 2000.0]]
    )
    places = [DampingPlace("first_damper_leg", [1.0, 0.0], cost=1e3), DampingPlace("second_damper_leg", [0.0, 1.0])]
    told: list[str] = []
    budget = damping_budget([chain], places, margins=[0.1, 0.2], step=told.append)
    assert told[0] == "decay rate 0.1 1/s, all places" and any("second_damper_leg alone" in words for words in told)
    one = law(study, "dampers")
    table = budget_table(budget, 0.2)
    assert table.columns[:3] == ("Decay rate", "first", "second") and max(map(len, table.columns)) < 20
    assert table.rows[1][0].text == "0.200 1/s (chosen)"
    chart = budget_chart(one, budget, chosen=0.2)
    left, right = ({item.label for item in panel.items if getattr(item, "label", "")} for panel in chart.panels)
    assert {"all places", "only second", "chosen"} <= left and {"first", "second"} <= right
    none = damping_budget([chain], places, margins=[0.1, 0.2], time_limit=0.0)
    assert not none.together.certified.any() and set(none.alone[0].reasons) == {"the time limit was reached"}
    assert [row[5].text for row in budget_table(none, 0.2).rows if row] and svg(budget_chart(one, none, chosen=0.2))
    with pytest.raises(ValueError, match="time_limit: expected a time"):
        damping_budget([chain], places, margins=[0.1], time_limit=float("nan"))


def test_the_page_tells_what_is_not_proved(study: DesignStudy) -> None:
    good, bad = law(study, "lqr"), law(study, "worst")
    assert bad.synthesis is not None
    proofs = tuple(replace(proof, holds=False, reason="an eigenvalue is positive") for proof in bad.synthesis.proofs)
    failed = replace(bad, synthesis=replace(bad.synthesis, proofs=proofs))
    lost = replace(law(study, "mpc"), failure="no terminal set was found", synthesis=None)
    report = design_model(replace(study, options=(good, failed, lost)))
    assert report.subtitle == "3 laws of small" and report.sections[0].verdict is Verdict.FAIL
    page = html(report, {chart.key: svg(chart) for chart in report.charts()})
    for words in (
        "an eigenvalue is positive",
        "No law: no terminal set was found",
        "Every claim is proved.",
        "NOT EVALUATED",
    ):
        assert words in page
    assert "conj(s)" not in page
    single = design_model(replace(study, options=(good,)))
    assert single.subtitle == "1 law of small" and single.sections[0].verdict is Verdict.PASS


def test_tables_are_whole(study: DesignStudy) -> None:
    blocks = [block for section in design_model(study).sections for block in section.blocks]
    assert sum(isinstance(block, FigureBlock) for block in blocks) >= 8
    for table in (block for block in blocks if isinstance(block, Table)):
        assert all(len(row) == len(table.columns) for row in table.rows), table.caption
        assert all(name for name in table.columns)


def test_thin_margins_are_told(study: DesignStudy) -> None:
    one = law(study, "lqr")
    assert one.margins is not None
    first = one.margins.channels[0]
    thin = replace(first, gain_increase=replace(first.gain_increase, value=1.05))
    margins = replace(one.margins, channels=(thin, *one.margins.channels[1:]))

    def said(option) -> str:
        report = design_model(replace(study, options=(option,)))
        return html(report, {chart.key: "" for chart in report.charts()})

    assert "Proved is not robust: LQR has less than" in said(replace(one, margins=margins))
    assert "Proved is not robust" not in said(one)
