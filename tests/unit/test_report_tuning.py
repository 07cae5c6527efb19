"""Tuning and trade-off on the page: what was searched, what binds, who ranks where and how firmly."""

from __future__ import annotations

from dataclasses import replace

import comparison_fixture as made
import numpy as np
import pytest

from maglev_ctrl.errors import Verdict
from maglev_ctrl.report.chart import Marks
from maglev_ctrl.report.comparison.tuning import fronts, tuning_section
from maglev_ctrl.report.content import report_model
from maglev_ctrl.report.findings_ride import tuning_findings
from maglev_ctrl.report.model import Banner, Bullets, FigureBlock, Paragraph, Section, Table
from maglev_ctrl.study.tuning.records import TuningStudy


def table(section: Section, start: str) -> list[list[str]]:
    found = next(b for b in section.blocks if isinstance(b, Table) and b.caption.startswith(start))
    return [[entry.text for entry in cells] for cells in found.rows]


def words(section: Section) -> str:
    said = [b.text for b in section.blocks if isinstance(b, (Paragraph, Banner))]
    return " ".join(said + [item for b in section.blocks if isinstance(b, Bullets) for item in b.items])


def test_it_stands_right_after_the_comparison_of_options() -> None:
    titles = [section.title for section in report_model(made.small()).sections]
    assert titles[titles.index("Comparison of options") + 1] == "Tuning and trade-off"
    assert "Tuning and trade-off" not in [s.title for s in report_model(replace(made.small(), tuning=None)).sections]


def test_method_budget_seed_and_operating_set_are_told() -> None:
    told = words(tuning_section(made.tuning()))
    assert "population 24, 25 generations, seed 1; 1201 candidates" in told
    assert "3 operating points: design point, 100 km/h" in told
    assert "supplied power (kW): smaller is better" in told
    assert "Judged only afterwards, for the chosen candidates: modulation" in told


def test_variables_in_their_display_unit_with_what_binds() -> None:
    told = table(tuning_section(made.tuning()), "Design variables")
    assert told[0] == [
        "Damper windings", "damping of the windings", "1.00 kN s/m", "50.0 kN s/m", "50.0 kN s/m", "at its upper bound",
    ]  # fmt: skip
    assert told[2][2:5] == ["\N{EN DASH}", "\N{EN DASH}", "H-infinity (2 of 3)"]


def test_who_misses_what_is_told_on_top() -> None:
    section = tuning_section(made.tuning())
    (banner,) = (b for b in section.blocks if isinstance(b, Banner))
    assert banner.verdict is Verdict.FAIL
    assert (
        "No added suspension has nothing to tune and misses hard requirements; stable by most, by 82.0 %" in banner.text
    )
    assert [cells[-1] for cells in table(section, "What each search did")] == ["✗ stable", "✓ met", "✓ met"]
    assert table(section, "Ranking")[-1][-1] == "✗ stable, damping"


def test_a_search_without_a_result_is_told() -> None:
    study = made.tuning()
    lost = replace(
        study.options[1], front=np.zeros((0, 3)), front_variables=np.zeros((0, 1)), chosen=-1, knee=-1, feasible=False,
        reason="no candidate has an equilibrium",
    )  # fmt: skip
    study = replace(study, options=(study.options[0], lost, study.options[2]))
    section = tuning_section(study)
    assert any(isinstance(b, Banner) and "no candidate has an equilibrium" in b.text for b in section.blocks)
    assert table(section, "What each search did")[1][-1] == "? no result"
    assert table(section, "Ranking")[1][2:5] == ["\N{EN DASH}"] * 3


def test_the_front_stands_in_display_units() -> None:
    study = made.tuning()
    chart = fronts(study)
    assert chart is not None
    below = chart.panels[2]  # ride across, power upwards
    marks = [item for item in below.items if isinstance(item, Marks) and item.label == "Active secondary, LQR"]
    chosen = study.options[2].front[study.options[2].chosen]
    assert float(marks[0].y[0]) == pytest.approx(1e-3 * chosen[2])
    assert float(marks[0].y[0]) != pytest.approx(chosen[2])  # the mutant: watts told as kilowatts
    legend = [item.label for item in below.items if isinstance(item, Marks)]
    assert "No added suspension (misses stable)" in legend
    nothing = tuple(replace(o, front=np.full((1, 3), np.nan)) for o in study.options)
    assert fronts(replace(study, options=nothing)) is None
    assert any(isinstance(b, FigureBlock) for b in tuning_section(study).blocks)


def test_how_firm_the_ranking_is() -> None:
    section = tuning_section(made.tuning())
    assert "changes in 1 of 4 trials; Active secondary, LQR loses first place in 1" in words(section)
    (told,) = table(section, "What changes the ranking")  # the three changes that alter nothing are a sentence
    assert told[2:] == ["Damper windings", "1. Damper windings; 2. Active secondary, LQR; 3. No added suspension"]
    assert "No other value tried of these alters it" in words(section)
    firm = replace(made.tuning(), shifts=made.tuning().shifts[1:])
    assert "The ranking is firm: none of 3" in words(tuning_section(firm))


def ranked(study: TuningStudy, *, misses: tuple[str, ...]) -> TuningStudy:
    return replace(study, ranking=tuple(replace(entry, misses=misses) for entry in study.ranking))


def test_findings_tell_the_first_and_its_doubts() -> None:
    told = " ".join(tuning_findings(made.tuning()))
    assert "Active secondary, LQR ranks first. It loses this place under 1 of 4" in told
    assert "No added suspension (misses stable most)" in told
    assert "damping of the windings at its upper bound" in told
    nobody = " ".join(tuning_findings(ranked(made.tuning(), misses=("ride",))))
    assert "no option meets every hard requirement" in nobody and "ranks first" not in nobody
    assert tuning_findings(None) == []
