"""Faults of irregularity, ride, packs, uncertainty and tuning; packs as requirements; a file with values replaced."""

from __future__ import annotations

from pathlib import Path
from typing import get_args

import pytest

from maglev_ctrl.errors import ModelError, ScenarioError
from maglev_ctrl.scenario import Scenario, load
from maglev_ctrl.scenario.requirement_packs import SOURCES, Pack, pack_requirements
from maglev_ctrl.scenario.rewrite import rewritten, rewritten_text
from maglev_ctrl.scenario.track import seats, track_spectra

FILE = (Path(__file__).parents[2] / "scenarios" / "compare" / "eds_135t.toml").read_text(encoding="utf-8")


def smooth(text: str) -> str:
    """The train without tables of guideway, ride and spreads, and without what is asked of them: tests add theirs."""
    before, _, rest = text.partition("[irregularity]\n")
    options = rest[rest.index("# ------") :].partition("# What passengers feel")[0]
    return before.replace('packs = ["robust"]\n', "") + options


TRAIN = smooth(FILE)
ROUGH = '[irregularity]\nvertical = { form = "inverse_square", amplitude = "1.5e-6 m" }\n'
TUNING = "[tuning]\ngenerations = 2\n"
TUNE = '[[option.tune]]\nvalue = "spring_damper.winding.damping"\nfrom = "10 kN*s/m"\nto = "400 kN*s/m"\n'


def train(tmp_path: Path, more: str = "", *, top: str = "", tune: str = "") -> Path:
    """The train with tables added at the end, keys at the top, and a part of the damper windings."""
    text = TRAIN.replace("format = 1\n", f"format = 1\n{top}\n", 1)
    text = text.replace('lag = "30 ms"                         # L/R of a shorted coil\n', f'lag = "30 ms"\n{tune}')
    file = tmp_path / "train.toml"
    file.write_text(f"{text}\n{more}", encoding="utf-8")
    return file


def refused(file: Path) -> str:
    with pytest.raises(ScenarioError) as caught:
        load(file)
    return str(caught.value)


def test_without_the_new_tables_a_file_means_what_it_meant(tmp_path: Path) -> None:
    old, new = load(train(tmp_path)), load(train(tmp_path, ROUGH))
    assert old.irregularity is None and old.judged == old.requirements
    assert old.hash != new.hash  # and the tables count once they are there
    before = (tmp_path / "train.toml").read_text(encoding="utf-8").replace(ROUGH, "")
    (tmp_path / "train.toml").write_text(before, encoding="utf-8")
    assert load(tmp_path / "train.toml").hash == old.hash


@pytest.mark.parametrize(
    ("more", "top", "told"),
    [
        ("[irregularity]\n", "", "irregularity: expected at least one spectrum"),
        ('[irregularity]\nvertical = { form = "federal_railroad" }\n', "", "an amplitude or a track_class"),
        (
            '[irregularity]\nvertical = { form = "rational", numerator = [1.0], denominator = [1.0, 0.0, 0.0] }\n',
            "", "infinite variance then, at the LOW end",
        ),
        (
            '[irregularity]\nvertical = { form = "rational", numerator = [1, -1], denominator = [1, 0, 1] }\n',
            "", "expected P(W^2) positive",
        ),
        (
            '[irregularity]\nvertical = { form = "rational", numerator = [1.0, 1.0], denominator = [1.0, 1.0] }\n',
            "", "at the high end",
        ),
        ('[irregularity]\nvertical = { form = "inverse_squar" }\n', "", 'did you mean "inverse_square"?'),
        ('[irregularity]\nvertical = { amplitude = "1e-6 m" }\n', "", "irregularity.vertical.form: missing"),
        (
            '[irregularity]\nvertical = { form = "inverse_square", amplitud = "1e-6 m" }\n', "",
            'did you mean "amplitude"?',
        ),
        (ROUGH + 'cross_level_base = "2.7 m"\n', "", "cross_level is missing"),
        (ROUGH + 'band = { from = "10 Hz", to = "1 Hz" }\n', "", "irregularity.band.to"),
        (ROUGH + 'girder = { span = "25 m" }\n', "", "this girder does nothing"),
        ("", 'packs = ["ride_iso_2631"]', 'needs the table [irregularity]'),
        ("", 'packs = ["gap", "gap"]', "asked for twice"),
        ("", 'packs = ["robust"]', "needs the table [uncertainty]"),
        ("[uncertainty]\n", "", "expected a spread above zero"),
        ("[uncertainty]\nmass = 1.5\n", "", "below 1"),
        (TUNING, "", "there is nothing to tune"),
        (
            '[[requirement]]\nname = "calm"\nquantity = "weighted_acceleration"\nat_most = "0.3 m/s^2"\n', "",
            "needs the table [irregularity]",
        ),
        (
            ROUGH + '[[requirement]]\nname = "calm"\nquantity = "weighted_acceleration"\nat_most = "0.3 m/s^2"\n'
            'passenger = "centr"\n', "", 'did you mean "centre"?',
        ),
        (
            ROUGH + '[[requirement]]\nname = "stroke"\nquantity = "stroke_used"\nat_most = 0.5\n', "",
            "needs ride.largest_stroke",
        ),
        (
            '[[requirement]]\nname = "less"\nquantity = "damping_ratio"\nat_most = 0.01\n', "",
            'contradicts the requirement "damping"',
        ),
        (ROUGH + '[simulation]\nduration = "4 s"\n', "", "simulation.settle"),
        (ROUGH + '[ride]\nsmallest_height = "0.25 m"\n', "", "the levitation height of the design point, 200 mm"),
    ],
)  # fmt: skip
def test_faults_name_their_place(tmp_path: Path, more: str, top: str, told: str) -> None:
    assert told in refused(train(tmp_path, more, top=top))


def test_an_unknown_pack_gets_what_there_is(tmp_path: Path) -> None:
    message = refused(train(tmp_path, top='packs = ["ride_iso_2361"]'))
    assert "packs[0]" in message and "ride_iso_2631" in message


def test_a_wish_may_contradict(tmp_path: Path) -> None:
    wish = '[[requirement]]\nname = "less"\nquantity = "damping_ratio"\nat_most = 0.01\nhard = false\n'
    assert load(train(tmp_path, wish)).judged[-1].hard is False


def test_tuning_asks_for_what_its_objectives_need(tmp_path: Path) -> None:
    assert "needs the table [tuning]" in refused(train(tmp_path, tune=TUNE))
    assert '"ride" needs the table [irregularity]' in refused(train(tmp_path, TUNING, tune=TUNE))
    wrong = TUNING + 'objectives = ["ride", "ride"]\n'
    assert "is named twice" in refused(train(tmp_path, ROUGH + wrong, tune=TUNE))
    chosen = TUNING + 'choose = "margin"\n'
    assert 'expected "knee" or one of the objectives' in refused(train(tmp_path, ROUGH + chosen, tune=TUNE))
    assert load(train(tmp_path, ROUGH + TUNING, tune=TUNE)).options[1].tunes[0].low == "10 kN*s/m"


@pytest.mark.parametrize("pack", get_args(Pack))
def test_packs_are_requirements_with_a_source(pack: Pack) -> None:
    swept, nominal = (pack_requirements(pack, swept=value) for value in (True, False))
    assert SOURCES[pack]
    assert [one.quantity for one in swept] == [one.quantity for one in nominal]
    assert {one.over for one in swept} == {"speed"} and {one.over for one in nominal} == {"nominal"}
    assert [one.name for one in swept] == [one.quantity for one in swept]


def test_a_requirement_of_the_file_takes_the_place_of_a_packs(tmp_path: Path) -> None:
    own = '[[requirement]]\nname = "gap_used"\nquantity = "gap_used"\nat_most = 0.7\n'
    scenario = load(train(tmp_path, ROUGH + own, top='packs = ["gap"]'))
    found = {one.name: one.limit for one in scenario.judged}
    assert found["gap_used"] == 0.7 and found["contact_probability"] == 1e-6


def test_two_packs_of_one_quantity_are_told_apart(tmp_path: Path) -> None:
    scenario = load(train(tmp_path, top='packs = ["iso_14839_zone_a", "iso_14839_zone_b"]'))
    found = {one.name: one.limit for one in scenario.judged}
    assert found["sensitivity_peak"] == 3.0 and found["iso_14839_zone_b_sensitivity_peak"] == 4.0


def test_spectra_and_seats(tmp_path: Path) -> None:
    more = (
        ROUGH + 'cross_level = { form = "inverse_square", amplitude = "1e-6 m" }\ncross_level_base = "2 m"\n'
        '[ride]\npassenger = [{ name = "nose", x = "20 m" }]\n'
    )
    plain, seated = load(train(tmp_path)), load(train(tmp_path, more))
    assert [seat.name for seat in seats(plain)] == ["centre", "over_front", "over_rear"]
    assert [(seat.name, seat.x) for seat in seats(seated)] == [("nose", 20.0)]
    assert seated.irregularity is not None
    spectra = track_spectra(seated.irregularity)
    # a difference of height over 2 m is an angle: densities in rad^2 are those in m^2 over 4 m^2
    assert spectra.cross_level is not None and spectra.vertical is not None
    assert spectra.cross_level.density(0.5) == pytest.approx(1e-6 / 0.25 / 4.0)
    assert spectra.lateral is None and "vertical" in spectra.words


def test_replaced_values_stand_in_a_file_of_its_own(tmp_path: Path) -> None:
    scenario = load(train(tmp_path))
    path = ("option", 1, "spring_damper", 0, "damping")
    changed: Scenario = rewritten(scenario, {path: "150 kN*s/m"})
    assert changed.options[1].spring_dampers[0].damping == 150e3
    assert changed.text.count("150 kN*s/m") == 1 and "# L/R of a shorted coil" in TRAIN
    copy = tmp_path / "copy.toml"
    copy.write_text(changed.text, encoding="utf-8")
    again = load(copy)
    assert again.hash == changed.hash != scenario.hash
    assert again.options == changed.options
    with pytest.raises(ModelError, match="stands in the file"):
        rewritten(scenario, {("option", 1, "spring_damper", 0, "stiffness"): "1 kN/m"})
    with pytest.raises(ModelError, match="damping"):
        rewritten(scenario, {path: "-1 kN*s/m"})


def test_values_inside_lists_and_tables_are_replaced_in_place() -> None:
    text = 'a = [ { b = 1, c = "x" }, { b = 2 } ]  # ä\nd = 3\n'
    assert rewritten_text(text, {("a", 1, "b"): 5, ("d",): 4}) == 'a = [ { b = 1, c = "x" }, { b = 5 } ]  # ä\nd = 4\n'
    assert rewritten_text(text, {("a", 0): {"b": 7}}) == "a = [ { b = 7 }, { b = 2 } ]  # ä\nd = 3\n"
