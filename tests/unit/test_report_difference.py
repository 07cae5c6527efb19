"""The difference of two reports: every outcome by name, symmetric under exchange, blind to rounding, never to NaN."""

from __future__ import annotations

import copy
import itertools
import json
import math
from typing import Any

import pytest
import report_fixture

from maglev_ctrl.errors import Verdict
from maglev_ctrl.report.difference import difference, difference_plain
from maglev_ctrl.report.difference_records import COUNTED, Difference, NumberChange, Outcome, RequirementChange
from maglev_ctrl.report.difference_sections import number_change, section_change
from maglev_ctrl.report.reading import report_of
from maglev_ctrl.report.serialise import to_json

WORDS = [verdict.value for verdict in Verdict]
MIRROR = {
    Outcome.WORSE: Outcome.BETTER, Outcome.BETTER: Outcome.WORSE, Outcome.OTHER: Outcome.OTHER,
    Outcome.SAME: Outcome.SAME, Outcome.NEW: Outcome.GONE, Outcome.UNMET: Outcome.GONE,
}  # fmt: skip


def requirement(name: str = "stable", verdict: str = "PASS", value: object = -0.5, **other: Any) -> dict[str, Any]:
    unit = other.pop("unit", "1/s")
    limit = other.pop("limit", 0.0)
    return {
        "name": name, "quantity": "growth_rate", "description": "largest growth rate", "sense": "at_most",
        "limit": {"value": limit, "unit": unit}, "value": {"value": value, "unit": unit}, "unit": unit,
        "verdict": verdict, "margin_percent": {"value": "NaN", "unit": "%"}, "worst_at": "speed 100 km/h",
        "method": "", "reason": "" if verdict == "PASS" else "too fast", "bound": "exact",
    } | other  # fmt: skip


def option(name: str = "bare", *requirements: dict[str, Any], **other: Any) -> dict[str, Any]:
    return {
        "name": name, "label": name.title(), "kind": "baseline", "summary": [], "verdict": "PASS", "failure": "",
        "requirements": list(requirements), "modes": None, "margins": None, "floquet": None, "sweeps": [],
        "seconds": {"value": 1.0, "unit": "s"},
    } | other  # fmt: skip


def report(*options: dict[str, Any], **other: Any) -> dict[str, Any]:
    return {
        "format": 1, "kind": "maglev-ctrl comparison", "verdict": "PASS", "title": "Car", "scenario_text": "a = 1\n",
        "scenario_hash": "1f", "versions": [["numpy", "2.0"]], "created": "2026-01-01", "options": list(options),
        "design_speed": {"value": 50.0, "unit": "m/s"}, "design_height": {"value": 0.1, "unit": "m"},
    } | other  # fmt: skip


def compared(before: dict[str, Any], after: dict[str, Any], **how: Any) -> Difference:
    return difference(report_of(before), report_of(after), **how)


def only(found: Difference) -> RequirementChange:
    (change,) = found.options[0].requirements
    return change


@pytest.fixture(scope="module")
def real() -> dict[str, Any]:
    """A report made by the real analysis, as its file has it."""
    written: dict[str, Any] = json.loads(to_json(report_fixture.comparison(points=6, cells=8)))
    return written


# ------------------------------------------------------------------------------------------------------ verdicts
@pytest.mark.parametrize(
    ("before", "after", "outcome"),
    [
        ("PASS", "FAIL", Outcome.WORSE),
        ("PASS", "NOT EVALUATED", Outcome.WORSE),
        ("FAIL", "PASS", Outcome.BETTER),
        ("NOT EVALUATED", "PASS", Outcome.BETTER),
        ("FAIL", "NOT EVALUATED", Outcome.OTHER),
        ("NOT EVALUATED", "FAIL", Outcome.OTHER),
        ("FAIL", "FAIL", Outcome.SAME),
    ],
)
def test_outcomes(before: str, after: str, outcome: Outcome) -> None:
    found = compared(
        report(option("bare", requirement(verdict=before))), report(option("bare", requirement(verdict=after)))
    )
    assert only(found).outcome is outcome
    assert found.at_least_as_good is (outcome not in COUNTED)


@pytest.mark.parametrize("verdict", WORDS)
def test_a_requirement_that_is_gone_counts_and_a_new_one_where_it_does_not_pass(verdict: str) -> None:
    one, two = report(option("bare")), report(option("bare", requirement(verdict=verdict)))
    gone, new = compared(two, one), compared(one, two)
    assert only(gone).outcome is Outcome.GONE and not gone.at_least_as_good
    assert only(new).outcome is (Outcome.NEW if verdict == "PASS" else Outcome.UNMET)
    assert new.at_least_as_good is (verdict == "PASS")


def test_a_wish_is_told_and_does_not_count() -> None:
    wish = report(option("bare", requirement(hard=False)))
    for after in ([requirement(verdict="FAIL", hard=False)], []):
        found = compared(wish, report(option("bare", *after)))
        assert found.at_least_as_good and not found.empty
        assert only(found).outcome in COUNTED and not only(found).counts
    hardened = compared(wish, report(option("bare", requirement(verdict="FAIL"))))
    assert not hardened.at_least_as_good and only(hardened).notes[0] == "was a wish, is now a requirement"
    softened = compared(
        report(option("bare", requirement())), report(option("bare", requirement("stable", "FAIL", hard=False)))
    )
    assert not softened.at_least_as_good and only(softened).notes[0] == "was a requirement, is now a wish"


def test_options_that_are_gone_count_and_new_ones_do_not() -> None:
    one, two = (
        report(option("bare")),
        report(option("bare"), option("coil", requirement(verdict="FAIL"), kind="active")),
    )
    assert [o.standing for o in compared(two, one).options] == ["gone", "both"]
    assert not compared(two, one).at_least_as_good
    assert [o.standing for o in compared(one, two).options] == ["both", "new"]
    assert compared(one, two).at_least_as_good and not compared(one, two).empty


def test_a_renamed_option_is_found_by_its_label_or_its_elements_and_not_where_two_are_alike() -> None:
    old = option("coil", requirement(), kind="active", summary=["1 x coil"])
    labelled = option("winding", requirement(verdict="FAIL"), kind="other", label="Coil")
    found = compared(report(old), report(labelled)).options[0]
    assert (found.standing, found.name_before, found.name_after) == ("renamed", "coil", "winding")
    assert found.requirements[0].outcome is Outcome.WORSE
    built_alike = option("winding", requirement(), kind="active", summary=["1 x coil"])
    assert compared(report(old), report(built_alike)).options[0].standing == "renamed"
    rival = option("other", requirement(), kind="active", summary=["1 x coil"])
    standings = [o.standing for o in compared(report(old), report(built_alike, rival)).options]
    assert sorted(standings) == ["gone", "new", "new"]


@pytest.mark.parametrize(("old", "new"), list(itertools.product([*WORDS, None], repeat=2)))
def test_exchanging_the_reports_exchanges_better_and_worse(old: str | None, new: str | None) -> None:
    values = {"PASS": -0.5, "FAIL": 0.5, "NOT EVALUATED": "NaN"}
    reports = [
        report(option("bare", *([] if word is None else [requirement(verdict=word, value=values[word])])))
        for word in (old, new)
    ]
    there, back = compared(*reports), compared(*reversed(reports))
    if old is None and new is None:
        assert not there.options[0].requirements
        return
    one, other = only(there), only(back)
    if one.outcome is Outcome.GONE:
        one, other = other, one
    assert MIRROR[one.outcome] is other.outcome
    assert {one.toward, other.toward} in ({"better", "worse"}, {""})
    if not math.isnan(one.value.absolute):
        assert one.value.absolute == -other.value.absolute


def test_worst_comes_first() -> None:
    def made(*verdicts: str) -> dict[str, Any]:
        values = {"PASS": -0.5, "FAIL": 0.5, "NOT EVALUATED": "NaN"}
        return option("bare", *(requirement(f"r{k}", v, values[v]) for k, v in enumerate(verdicts)))

    calm = option("calm", requirement(), kind="other")
    before = report(calm, made("PASS", "FAIL", "NOT EVALUATED", "PASS"))
    after = report(calm, made("PASS", "PASS", "FAIL", "NOT EVALUATED"))
    found = compared(before, after)
    assert [o.name_after for o in found.options] == ["bare", "calm"]
    assert [r.name for r in found.options[0].requirements] == ["r3", "r2", "r0", "r1"]
    assert [r.name for r in found.options[0].counted] == ["r3", "r2"]
    assert [found.count(o) for o in Outcome] == [1, 0, 0, 1, 2, 1, 0]


# ------------------------------------------------------------------------------------------------------- numbers
def test_the_sense_decides_which_way_is_better() -> None:
    one, two = report(option("bare", requirement(value=-0.5))), report(option("bare", requirement(value=-0.4)))
    change = only(compared(one, two))
    assert (change.toward, change.outcome) == ("worse", Outcome.SAME)
    assert change.value.absolute == pytest.approx(0.1) and change.value.relative == pytest.approx(0.2)
    for written in (one, two):
        written["options"][0]["requirements"][0]["sense"] = "at_least"
    assert only(compared(one, two)).toward == "better"
    two["options"][0]["requirements"][0]["sense"] = "at_most"  # no longer the same question
    change = only(compared(one, two))
    assert change.toward == "" and "asks for something else" in change.notes[0]


@pytest.mark.parametrize(("sense", "limit", "way"), [
    ("at_most", 0.1, "looser"), ("at_most", -0.1, "tighter"), ("at_least", 0.1, "tighter"),
    ("at_least", -0.1, "looser"),
])  # fmt: skip
def test_a_limit_that_moved_is_told(sense: str, limit: float, way: str) -> None:
    one, two = (report(option("bare", requirement(sense=sense, limit=number))) for number in (0.0, limit))
    change = only(compared(one, two))
    assert change.limit_toward == way and change.limit.changed and not change.value.changed


@pytest.mark.parametrize(("before", "after", "changed"), [
    (1.0, 1.0 + 1e-7, False), (1.0, 1.0 + 1e-5, True), ("NaN", "NaN", False), ("NaN", 1.0, True), (1.0, "NaN", True),
    ("Infinity", "Infinity", False), ("Infinity", "-Infinity", True), ("Infinity", 1.0, True), (0.0, -0.0, False),
    (0.0, 1e-300, True), (1, 1.0, False), (1e308, -1e308, True), (10**400, "Infinity", False),
])  # fmt: skip
def test_rounding_is_no_change_and_every_other_difference_is(before: object, after: object, changed: bool) -> None:
    one, two = (report(option("bare", requirement(value=value))) for value in (before, after))
    assert only(compared(one, two)).value.changed is changed
    assert compared(one, two).empty is not changed
    assert section_change("x", {"a": before}, {"a": after}, tolerance=1e-6).changed == int(changed)
    json.dumps(difference_plain(compared(one, two)), allow_nan=False)


def test_the_tolerance_is_the_callers() -> None:
    one, two = (report(option("bare", requirement(value=value))) for value in (1.0, 1.01))
    assert not compared(one, two).empty
    assert compared(one, two, tolerance=0.02).empty
    with pytest.raises(ValueError, match="tolerance: expected at least 0 and below 1"):
        compared(one, two, tolerance=math.nan)


def test_another_unit_is_not_subtracted() -> None:
    one, two = report(option("bare", requirement(unit="mm"))), report(option("bare", requirement(unit="m")))
    change = only(compared(one, two)).value
    assert change.changed and math.isnan(change.absolute) and (change.unit_before, change.unit) == ("mm", "m")


def test_growth_rates_within_the_error_bounds_of_the_modes_are_equal(real: dict[str, Any]) -> None:
    other = copy.deepcopy(real)
    modes = other["options"][0]["modes"]
    bounds = modes["error_bound"]["value"]
    place = max(range(len(bounds)), key=lambda k: modes["s"]["value"]["re"][k])
    modes["s"]["value"]["re"][place] += 0.5 * bounds[place]
    assert compared(real, other, tolerance=0.0).options[0].numbers == ()
    modes["s"]["value"]["re"][place] += 1e3 * bounds[place]
    (found,) = compared(real, other, tolerance=0.0).options[0].numbers
    assert found.name == "largest growth rate" and found.unit == "1/s"


def test_margins_and_their_absence_are_told(real: dict[str, Any]) -> None:
    other = copy.deepcopy(real)
    margins = other["options"][2]["margins"]
    margins["channels"][0]["phase"]["value"] *= 1.1
    margins["multi_loop"]["alpha"] *= 0.9
    found = next(o for o in compared(real, other).options if o.name_after == "lqr")
    relative = {change.name: change.relative for change in found.numbers}
    channel = margins["channels"][0]["channel"]
    assert relative == pytest.approx({f"phase margin, {channel}": 0.1, "disk margin, all loops": -0.1})
    other["options"][2]["margins"] = None
    found = next(o for o in compared(real, other).options if o.name_after == "lqr")
    assert found.numbers and all(math.isnan(change.after) for change in found.numbers)


def test_modes_and_margins_are_those_of_the_records(real: dict[str, Any]) -> None:
    made = report_fixture.comparison(points=6, cells=8).options[2]
    assert made.modes is not None and made.margins is not None
    found = {one.name: one.value for one in report_of(real).options[2].numbers}
    assert found["largest growth rate"] == made.modes.spectral_abscissa
    swinging = made.modes.s.imag > made.modes.error_bound
    assert found["least damping ratio"] == min(made.modes.damping_ratio[swinging])
    assert found["disk margin, all loops"] == made.margins.multi_loop.alpha
    for channel in made.margins.channels:
        assert found[f"delay margin, {channel.channel}"] == channel.delay.value


def test_a_damping_ratio_is_one_of_an_oscillation() -> None:
    modes = {
        "s": {"value": {"re": [0.2, -1.0, -1.0], "im": [0.0, 2.0, -2.0]}, "unit": "1/s"},
        "damping_ratio": [-1.0, 0.447, 0.447], "error_bound": {"value": [1e-9] * 3, "unit": "1/s"},
    }  # fmt: skip
    growth, damping = report_of(report(option("bare", modes=modes))).options[0].numbers
    assert (growth.value, growth.error, damping.value) == (0.2, 1e-9, 0.447)


# -------------------------------------------------------------------------------------------- everything else
def test_a_real_report_equals_itself_and_its_later_self(real: dict[str, Any]) -> None:
    later = copy.deepcopy(real) | {"created": "2030-01-01", "seconds": {"value": 99.0, "unit": "s"}}
    found = compared(real, later)
    assert found.empty and found.at_least_as_good and len(found.options) == 3


def test_scenario_and_versions() -> None:
    one = report()
    assert compared(one, report(scenario_text="a = 1 # one\n")).scenario == "words"
    assert compared(one, report(scenario_hash="2f")).scenario == "data"
    found = compared(one, report(scenario_hash="2f", scenario_text="a = 2\n", versions=[["scipy", "1"]]))
    assert found.scenario == "changed" and found.at_least_as_good
    assert found.scenario_lines[-2:] == ("-a = 1", "+a = 2") and found.scenario_lines_left == 0
    assert found.versions == (("numpy", "2.0", ""), ("scipy", "", "1"))
    long = report(scenario_hash="2f", scenario_text="".join(f"b{k} = 1\n" for k in range(500)))
    found = compared(one, long, most_lines=7)
    assert len(found.scenario_lines) == 7 and found.scenario_lines_left == 3 + 501 - 7


def test_unknown_sections_are_counted_and_their_largest_change_is_named() -> None:
    ride = {"index": {"value": 2.0, "unit": "m/s^2"}, "spectrum": [1.0, 1e-17, 3.0], "standard": "ISO 2631"}
    other = {"index": {"value": 2.2, "unit": "m/s^2"}, "spectrum": [1.0, 9e-17, 3.0], "standard": "EN 12299"}
    found = compared(report(option("bare", ride=ride)), report(option("bare", ride=other))).options[0]
    (section,) = found.sections
    assert (section.name, section.numbers, section.changed, section.other) == ("ride", 4, 1, 1)
    assert section.largest is not None and section.largest.name == "ride.index" and section.largest.unit == "m/s^2"
    assert section.largest.relative == pytest.approx(0.1) and section.other_at == "ride.standard"
    whole = compared(report(tuning=ride), report(tuning=other))
    assert [(one.name, one.changed) for one in whole.sections] == [("tuning", 1)] and not whole.empty
    found = compared(report(option("bare")), report(option("bare", ride=ride))).options[0]
    assert [one.name for one in found.sections] == ["ride"] and found.sections[0].other == 1


def test_eigenvalues_have_no_order_but_have_values() -> None:
    def eigenvalues(*values: complex) -> dict[str, Any]:
        return {"s": {"re": [v.real for v in values], "im": [v.imag for v in values]}}

    one = eigenvalues(-1 + 2j, -1 - 2j, -3)
    assert not section_change("locus", one, eigenvalues(-3, -1 - 2j, -1 + 2j), tolerance=1e-6).changed
    assert section_change("locus", one, eigenvalues(-3, -1 - 2.1j, -1 + 2.1j), tolerance=1e-6).changed
    assert section_change("locus", one, eigenvalues(-3.1, -1 - 2j, -1 + 2j), tolerance=1e-6).changed


def test_what_tells_of_the_computation_is_left_out() -> None:
    for name in ("seconds", "lyapunov_residual", "error_bound"):
        assert section_change("x", {name: 1.0}, {name: 2.0}, tolerance=1e-6).numbers == 0
    assert section_change("x", {"mass": 1.0}, {"mass": 2.0}, tolerance=1e-6).changed == 1


def test_very_deep_and_very_odd_sections_do_no_harm() -> None:
    deep: Any = 1.0
    for _ in range(300):
        deep = [deep]
    assert section_change("x", deep, [deep], tolerance=1e-6).numbers == 0
    for one, two in itertools.product(
        [None, True, "a", [], {}, [None], [[1], 2], {"re": 1, "im": []}, 10**400], repeat=2
    ):
        found = section_change("x", one, two, tolerance=1e-6)
        assert (found.changed + found.other > 0) == (one != two), (one, two)


@pytest.mark.parametrize(("wrong", "said"), [
    ({"format": 2}, "format: this version reads reports of format 1, got 2"),
    ({"options": 3}, "options: expected a list, got 3"),
    ({"options": [3]}, "options[0]: expected a record, got 3"),
    ({"options": [option("a"), option("a")]}, 'options: "a" stands there twice'),
    ({"options": [option("a", requirement(), requirement())]}, 'options[0].requirements: "stable" stands there twice'),
    ({"options": [option("a", requirement(verdict="MAYBE"))]}, "requirements[0].verdict: expected one of PASS"),
    ({"options": [option("a", requirement(value="big"))]}, 'value.value: expected a number, got "big"'),
    ({"options": [option("a", requirement(sense="near"))]}, "sense: expected one of at_least, at_most"),
    ({"options": [option("a", verdict=None)]}, "options[0].verdict: expected a text, got null"),
    ({"options": [option("a", modes={"s": 1})]}, "options[0].modes.s: expected a record, got 1"),
    ({"versions": [["numpy"]]}, "versions[0]: expected a name and a version, got 1 entries"),
    ({"kind": "maglev-ctrl stability maps"}, "not a report but maglev-ctrl stability maps"),
])  # fmt: skip
def test_wrong_reports_name_the_place(wrong: dict[str, Any], said: str) -> None:
    with pytest.raises(ValueError) as caught:
        report_of(report() | wrong)
    assert said in str(caught.value) and "\n" not in str(caught.value)


def test_a_number_in_another_unit_is_a_change_even_where_the_number_is_equal() -> None:
    found: NumberChange = number_change("x", 1.0, after=1.0, unit="m", unit_before="mm", tolerance=0.1)
    assert found.changed and math.isnan(found.relative)
