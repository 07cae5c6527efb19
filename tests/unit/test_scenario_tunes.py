"""Design variables: what a `[[option.tune]]` may say, and that putting a value in is what the file would do."""

from pathlib import Path

import numpy as np
import pytest

from maglev_ctrl.errors import ScenarioError
from maglev_ctrl.scenario import load
from maglev_ctrl.scenario.problems import ScenarioProblems
from maglev_ctrl.scenario.reader import with_values
from maglev_ctrl.scenario.tunes import decoded, encoded, file_values, tuned_quantities, with_tuned

EDS = Path("scenarios/compare/eds_135t.toml")
WINDINGS = (
    ("spring_damper.winding.damping", "20 kN*s/m", "600 kN*s/m"),
    ("spring_damper.winding.lag", "5 ms", "100 ms"),
)
CHOICES = """
[[option.tune]]
value = "control"
choices = [
  { law = "sky_hook", damping = "80 kN*s/m", sensor = "car_velocity" },
  { law = "damping", sky = "50 kN*s/m" },
]
"""


TABLE = '[option.control]\nlaw = "sky_hook"\ndamping = "120 kN*s/m"\nsensor = "car_velocity"\n'
INLINE = 'control = { law = "sky_hook", damping = "120 kN*s/m", sensor = "car_velocity" }\n'


def written(tmp_path, option, tunes, tuning='[tuning]\nobjectives = ["margin", "damping"]\n', *, inline=True):
    """The EDS comparison with [[option.tune]] tables, triples or text, added to one option."""
    text = EDS.read_text().replace("[periodic]", f"{tuning}[periodic]", 1)
    at = text.index(f'name = "{option}"')
    ends = [i for i in (text.find("[[option]]", at), text.find("# ----", at)) if i > 0]
    added = "".join(
        t if isinstance(t, str) else f'[[option.tune]]\nvalue = "{t[0]}"\nfrom = "{t[1]}"\nto = "{t[2]}"\n'
        for t in tunes
    )
    own = text[at : min(ends)]
    if CHOICES.strip()[:30] in added and inline:  # a law that is chosen whole stands in one line
        own = own.replace(TABLE, "").replace('kind = "active_secondary"\n', f'kind = "active_secondary"\n{INLINE}')
    path = tmp_path / "tuned.toml"
    path.write_text(text[:at] + own + added + "\n" + text[min(ends) :])
    return load(path)


def option_of(scenario, name):
    return next(one for one in scenario.options if one.name == name)


def faults(tmp_path, option, tunes):
    scenario = written(tmp_path, option, tunes)
    with pytest.raises(ScenarioProblems) as caught:
        tuned_quantities(scenario, option_of(scenario, option))
    return caught.value


def test_ranges_in_si_with_labels_and_start(tmp_path):
    scenario = written(tmp_path, "damper_windings", WINDINGS)
    damping, lag = tuned_quantities(scenario, option_of(scenario, "damper_windings"))
    assert (damping.lower, damping.upper, damping.start) == (20e3, 600e3, 120e3)
    assert (lag.lower, lag.upper, lag.start) == (5e-3, 0.1, 0.03)
    assert damping.logarithmic and damping.label == "damping of spring damper winding"
    assert damping.text(120e3) == "120 kN s/m" and lag.text(0.03) == "30 ms"


@pytest.mark.parametrize(
    ("option", "tunes", "values"),
    [
        ("damper_windings", WINDINGS, (123456.789, 0.0123)),
        (
            "active_primary_lqg",
            (
                ("control.allowed[0].value", "0.05 m/s^2", "5 m/s^2"),
                ("control.disturbance", "0.05 m/s^2/Hz^0.5", "5 m/s^2/Hz^0.5"),
                ("actuator.coil.bandwidth", "5 Hz", "50 Hz"),
                ("sensor.gap.noise", "0.01 mm/Hz^0.5", "0.1 mm/Hz^0.5"),
            ),
            (0.321, 0.77, 2.0 * np.pi * 17.3, 3e-5),
        ),
        ("active_secondary_skyhook", (CHOICES, ("actuator.cylinder.delay", "1 ms", "5 ms")), (1.0, 0.0021)),
    ],
)
def test_putting_values_in_is_what_the_file_would_do(tmp_path, option, tunes, values):
    """The record made by copying equals the one read and checked from the values as a file has them."""
    scenario = written(tmp_path, option, tunes)
    tuned = tuned_quantities(scenario, option_of(scenario, option))
    quick = with_tuned(option_of(scenario, option), tuned, values)
    slow = option_of(with_values(scenario, file_values(tuned, values)), option)
    assert quick == slow
    moved = with_tuned(quick, tuned[-1:], (decoded(tuned[-1], 0.9),))
    assert moved != slow


def test_a_value_inside_a_chosen_law(tmp_path):
    law = (
        CHOICES.replace('sky = "50', 'sky = "60')
        .replace('law = "sky_hook", damping', 'law = "damping", sky')
        .replace(', sensor = "car_velocity"', "")
    )
    own = EDS.read_text()
    assert 'law = "sky_hook"' in own
    scenario = written(tmp_path, "active_secondary_skyhook", (law,))
    base = with_values(scenario, {("option", 5, "control"): {"law": "damping", "sky": "1 kN*s/m"}})  # not of the file
    tuned = tuned_quantities(base, option_of(base, "active_secondary_skyhook"))
    assert [choice.law for choice in tuned[0].choices] == ["damping", "damping"]
    assert tuned[0].start == -1.0 and tuned[0].text(1.0) == "damping (choice 2)"


def test_scale_there_and_back(tmp_path):
    scenario = written(tmp_path, "damper_windings", WINDINGS)
    damping = tuned_quantities(scenario, option_of(scenario, "damper_windings"))[0]
    assert encoded(damping, 20e3) == 0.0 and encoded(damping, 600e3) == 1.0
    assert decoded(damping, 0.5) == pytest.approx(np.sqrt(20e3 * 600e3), rel=1e-12)
    assert decoded(damping, encoded(damping, 77e3)) == pytest.approx(77e3, rel=1e-12)
    assert decoded(damping, 1.7) == 600e3  # never outside


@pytest.mark.parametrize(
    ("tune", "words"),
    [
        (("spring_damper.winding.dampin", "1 kN*s/m", "2 kN*s/m"), "spring_damper.winding.damping"),
        (("winding.damping", "1 kN*s/m", "2 kN*s/m"), "spring_damper.winding.damping"),
        (("spring_damper.winding.damping", "2 kN*s/m", "1 kN*s/m"), "more than the smallest value 2 kN s/m"),
        (("spring_damper.winding.damping", "0 kN*s/m", "1 kN*s/m"), "above zero on a logarithmic scale"),
        (("spring_damper.winding.damping", "1 kN/m", "2 kN/m"), "a damping"),
        (("spring_damper.winding.damping", "-1 kN*s/m", "2 kN*s/m"), "logarithmic"),
        (("spring_damper.winding.stiffness", "1 kN/m", "2 kN/m"), "left out in this option"),
        (("kind", "1", "2"), "no value"),
        ('[[option.tune]]\nvalue = "spring_damper.winding.damping"\nfrom = "1 kN*s/m"\n', "end of the range"),
        ('[[option.tune]]\nvalue = "spring_damper.winding.damping"\nfrom = 1.0\nto = 2.0\n', "with its unit"),
        (
            '[[option.tune]]\nvalue = "control"\nchoices = []\nfrom = "1 m"\nto = "2 m"\n',
            "choices or a range, not both",
        ),
        ('[[option.tune]]\nvalue = "control"\n', "two control laws or more"),
    ],
    ids=lambda value: value[:30] if isinstance(value, str) else value[0],
)
def test_faults_have_a_place_and_say_what_is_expected(tmp_path, tune, words):
    error = faults(tmp_path, "damper_windings", (tune,))
    assert words in str(error)
    assert all(problem.line > 50 and problem.key.startswith("option[1].tune[0]") for problem in error.problems)


def test_the_same_value_twice(tmp_path):
    assert "tuned twice" in str(faults(tmp_path, "damper_windings", (WINDINGS[0], WINDINGS[0])))


def test_a_choice_that_is_no_law_of_the_option(tmp_path):
    wrong = CHOICES.replace('"car_velocity"', '"nowhere"')
    assert "choices[0]" in str(faults(tmp_path, "active_secondary_skyhook", (wrong,)))


def test_a_value_that_only_some_choices_have(tmp_path):
    both = (CHOICES, ("control.damping", "10 kN*s/m", "100 kN*s/m"))
    assert "choice 2 of the control law has no" in str(faults(tmp_path, "active_secondary_skyhook", both))


def test_faults_are_scenario_errors(tmp_path):
    assert isinstance(faults(tmp_path, "damper_windings", (("nothing", "1 m", "2 m"),)), ScenarioError)


def test_what_is_tuned_stands_in_the_file(tmp_path):
    """Else the file with the values chosen would not say what was chosen."""
    scenario = written(tmp_path, "active_secondary_skyhook", (CHOICES,), inline=False)
    with pytest.raises(ScenarioProblems, match=r"control is tuned.*write it in one line"):
        tuned_quantities(scenario, option_of(scenario, "active_secondary_skyhook"))
