"""A small tuned comparison as a whole: tuned, judged, written back as a file; and the verbs check and compare."""

from __future__ import annotations

import pytest
from ride_scenario import HEAD, read

from maglev_ctrl.cli import main
from maglev_ctrl.errors import Verdict
from maglev_ctrl.scenario import load
from maglev_ctrl.scenario.problems import ScenarioProblems
from maglev_ctrl.study.compare import compare

WINDINGS = "".join(
    f'[[option.spring_damper]]\nname = "{where}_winding"\nbetween = ["bogies", "guideway"]\ndamping = "10 kN*s/m"\n'
    f'at = "{x} m"\n'
    for where, x in (("front", 3), ("rear", -3))
)
DAMPED = """
[[option]]
name = "damped"
kind = "combined"
[[option.spring_damper]]
name = "damper"
between = ["car", "bogies"]
damping = "5 kN*s/m"   # weak on purpose
"""
STIFF = DAMPED.replace('"damped"', '"stiff"').replace("5 kN*s/m", "60 kN*s/m").replace("  # weak on purpose", "")
TUNE = '[[option.tune]]\nvalue = "spring_damper.damper.damping"\nfrom = "2 kN*s/m"\nto = "200 kN*s/m"\n'
TUNING = '[tuning]\nobjectives = ["ride", "stroke"]\npopulation = 8\ngenerations = 2\nchoose = "ride"\n'
LIMITS = """
[[requirement]]
name = "stable"
quantity = "growth_rate"
at_most = "0 1/s"
over = "nominal"
[[requirement]]
name = "calm"
quantity = "weighted_acceleration"
at_most = "0.5 m/s^2"
over = "nominal"
[[requirement]]
name = "wish"
quantity = "weighted_acceleration"
at_most = "0.001 m/s^2"
over = "nominal"
hard = false
"""
PLAIN = "".join(line for line in HEAD.splitlines(keepends=True) if not line.startswith(("girder", "step", "sweep")))
TEXT = PLAIN + TUNING + DAMPED + WINDINGS + TUNE + STIFF + WINDINGS + LIMITS


@pytest.fixture(scope="module")
def compared(tmp_path_factory):
    told = []
    scenario = read(tmp_path_factory.mktemp("compared"), TEXT)
    return scenario, compare(scenario, progress=lambda what, share: told.append(share)), told


def test_options_are_tuned_then_judged_in_full(compared):
    _, found, told = compared
    tuning = found.tuning
    assert [one.option for one in tuning.options] == ["damped", "stiff"] and len(tuning.ranking) == 2
    (chosen,) = tuning.options[0].variables
    assert tuning.options[1].variables == () and 2e3 <= chosen.value <= 200e3 and chosen.value != 5e3
    assert [one.name for one in found.options] == ["damped", "stiff"] and found.seconds >= tuning.seconds > 0.0
    damper = next(c for c in found.options[0].vehicle.connections if c.name == "damper_bogie")
    assert damper.damping == chosen.value  # the study is about the value that was chosen
    # what the search measured is what the whole study finds
    ride = found.options[0].ride.points[0].response.passengers[0].total
    assert tuning.options[0].front[tuning.options[0].chosen, 0] == pytest.approx(ride, rel=1e-6)
    assert told == sorted(told) and told[-1] == 1.0


def test_a_missed_wish_fails_no_option(compared):
    _, found, _ = compared
    for option in found.options:
        verdicts = {one.name: one.verdict for one in option.requirements}
        assert verdicts == {"stable": Verdict.PASS, "calm": Verdict.PASS, "wish": Verdict.FAIL}
        assert option.verdict is Verdict.PASS
    assert found.verdict is Verdict.PASS


def test_the_tuned_file_read_again_is_the_same_scenario(compared, tmp_path):
    scenario, found, _ = compared
    file = tmp_path / "tuned.toml"
    file.write_text(found.scenario_text, encoding="utf-8")
    again = load(file)
    assert again.hash == found.scenario_hash != scenario.hash
    assert "# weak on purpose" in found.scenario_text  # comments stay
    assert again.options[0].spring_dampers[0].damping == found.tuning.options[0].variables[0].value
    assert again.options[1] == scenario.options[1] and again.options[0].tunes == scenario.options[0].tunes


def test_as_written_nothing_is_tuned(tmp_path, compared):
    scenario, tuned, _ = compared
    only = scenario.model_copy(update={"options": scenario.options[1:]})
    found = compare(only, tuned=False)
    assert found.tuning is None and found.scenario_text == scenario.text
    totals = [one.options[-1].ride.points[0].response.passengers[0].total for one in (found, tuned)]
    assert totals[0] == pytest.approx(totals[1], rel=1e-12)


def test_without_a_table_nothing_is_tuned(tmp_path):
    scenario = read(tmp_path, PLAIN + STIFF + WINDINGS + LIMITS)
    assert compare(scenario).tuning is None
    with pytest.raises(ValueError, match="jobs"):
        compare(scenario, jobs=0)


def test_the_verb_writes_the_tuned_file(tmp_path, compared, monkeypatch, capsys):
    from maglev_ctrl import study
    from maglev_ctrl.study import compare as module

    monkeypatch.chdir(tmp_path)
    (tmp_path / "small.toml").write_text(TEXT, encoding="utf-8")
    _, found, _ = compared
    monkeypatch.setattr(module, "compare", lambda scenario, **how: found)
    assert main(["compare", "small.toml", "--format", "json"]) == 0
    out = capsys.readouterr().out
    assert "Ranking of the tuned options" in out and "kN s/m" in out
    written = tmp_path / "out" / "small"
    assert (written / "tuned.toml").read_text(encoding="utf-8") == found.scenario_text
    assert main(["check", str(written / "tuned.toml")]) == 0
    asked = []
    monkeypatch.setattr(study, "run", lambda scenario, **how: asked.append(scenario.hash) or found, raising=False)
    main(["compare", "small.toml", "--as-written", "--format", "json"])
    assert asked == [load("small.toml").hash]


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        ("damper.damping", "damper.dampin", "value = ", 'did you mean "spring_damper.damper.damping"'),
        ('"200 kN*s/m"', '"1 kN*s/m"', "to = ", "expected more than the smallest value 2 kN s/m"),
        ('"2 kN*s/m"', '"2 m"', "from = ", "expected"),
    ],
)
def test_check_tells_a_wrong_tune_with_its_line(tmp_path, capsys, old, new, line, words):
    text = TEXT.replace(TUNE, TUNE.replace(old, new))
    file = tmp_path / "wrong.toml"
    file.write_text(text, encoding="utf-8")
    assert main(["check", str(file)]) == 2
    said = capsys.readouterr().err
    block = text[: text.index("[[option.tune]]")].count("\n") + 1
    number = next(i for i, row in enumerate(text.splitlines(), start=1) if i > block and row.startswith(line))
    assert f"wrong.toml:{number}:" in said and words in said
    with pytest.raises(ScenarioProblems):
        compare(load(file))
    good = tmp_path / "good.toml"
    good.write_text(TEXT, encoding="utf-8")
    assert main(["check", str(good)]) == 0 and "2 option(s)" in capsys.readouterr().out
