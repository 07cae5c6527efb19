"""Size and depth of what people hand in: each limit is kept with a sentence, and shortly below it all is well."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
from design_fixture import VEHICLE

from maglev_ctrl.scenario import ScenarioProblems, load
from maglev_ctrl.scenario.csv_table import CELL_LIMIT, COLUMN_LIMIT, read_rows
from maglev_ctrl.scenario.force_table import read_force_table
from maglev_ctrl.scenario.limits import DEPTH_LIMIT, LINE_LIMIT, SIZE_LIMIT, VALUE_LIMIT, very_long_keys
from maglev_ctrl.scenario.oscillation import read_oscillations
from maglev_ctrl.scenario.oscillation_table import read_oscillation_table
from maglev_ctrl.scenario.problems import MOST_TOLD, Problem, legible
from maglev_ctrl.scenario.reader import load_text
from maglev_ctrl.study.map.request import LARGEST_COUNT, map_request

TABLE = b"height [m],speed [m/s],lift [N],drag [N]\n"


def told(text: str) -> str:
    begun = time.process_time()
    with pytest.raises(ScenarioProblems) as found:
        load_text(text, "mine.toml")
    assert time.process_time() - begun < 10.0
    message = str(found.value)
    assert 0 < len(message) < 20_000 and len(found.value.problems) <= MOST_TOLD
    return message


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("#" * (SIZE_LIMIT + 1), "at most 1 MiB"),
        ("title = '" + "x" * LINE_LIMIT + "'", f"lines of at most {LINE_LIMIT}"),
        ("a = " + "[" * (DEPTH_LIMIT + 1) + "]" * (DEPTH_LIMIT + 1), "nested at most"),
        ("a = " + "[" * 9000, "nested at most"),
        ("a = " + "{a=" * 5000, "nested at most"),
        ("a." * 9000 + "b = 1", "nested at most"),
        ("\n".join(["a." * 9000 + f"b{k} = 1" for k in range(50)]), "nested at most"),
        ("[" + "a . " * 4000 + "b]", "nested at most"),
        ('"a".' * 40 + "b = 1", "nested at most"),
        ("a = { " + "b." * 40 + "c = 1 }", "nested at most"),
        ("x = [" + "1,\n" * (VALUE_LIMIT + 1) + "]", f"at most {VALUE_LIMIT} keys and entries"),
        ("".join(f"[k{k}]\n" for k in range(70_000)), f"at most {VALUE_LIMIT} keys and entries"),
        ("".join(f"k{k} = 1\n" for k in range(3000)), "more faults are not listed"),
        ("a = " + "9" * 5000, "expected valid TOML"),
        ("a = 1e999999999", "unknown key"),
    ],
    ids=range(15),
)
def test_a_text_that_is_too_much_is_refused(text: str, words: str) -> None:
    assert words in told(text)


def test_long_keys_are_seen_and_long_words_are_not() -> None:
    assert very_long_keys("a." * 32 + "b = 1") and not very_long_keys("a." * 20 + "b = 1")
    assert not very_long_keys("x" * LINE_LIMIT) and not very_long_keys("'" * LINE_LIMIT)  # and in no time


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('kind = "baseline"', 'kind = "combined"\n' + "".join(
            f'[[option.spring_damper]]\nname = "s{k}"\nbetween = ["car", "bogie"]\ndamping = "1 kN*s/m"\n'
            for k in range(101)), "at most 100, got 101"),
        ('kind = "baseline"', 'kind = "baseline"\n' + "".join(
            f'[[requirement]]\nname = "r{k}"\nquantity = "growth_rate"\nat_most = "0 1/s"\n' for k in range(201)),
         "at most 200, got 201"),
        ("count = 4", "count = 402", "less than or equal to 400"),
        ("count = 3", "count = 1000000000", "less than or equal to 2000"),
        ("count = 3", "count = " + "9" * 400, "whole number of at most 64 bits"),
        ('mass = "24 t"', "mass = 1" + "0" * 400, "whole number of at most 64 bits"),
        ("mass = \"24 t\"", f"mass = {2**63 - 1}", "did you mean"),
        ('name = "bare"', 'name = "../../x"', "lower-case letters, digits and underscores"),
        ('name = "bare"', 'name = "a/b"', "lower-case letters, digits and underscores"),
        ('name = "bare"', f'name = "{"a" * 41}"', "at most 40"),
        ('name = "bare"', 'name = "bare."', "lower-case letters, digits and underscores"),
    ],
    ids=range(11),
)  # fmt: skip
def test_a_scenario_that_asks_for_too_much_is_refused(old: str, new: str, words: str) -> None:
    assert old in VEHICLE
    assert any(word in told(VEHICLE.replace(old, new, 1)) for word in words.split("|"))


def test_too_many_magnets_are_refused_and_many_are_not() -> None:
    bogie = VEHICLE[VEHICLE.index("[[vehicle.bogie]]") : VEHICLE.index("[vehicle.secondary]")]
    bogies = "".join(bogie.replace('"bogie"', f'"b{k}"') for k in range(11))
    text = VEHICLE.replace(bogie, bogies)
    assert "4000 magnets on all bogies together, got 4400" in told(text.replace("count = 4", "count = 400"))
    assert load_text(text.replace("count = 4", "count = 2"), "fine.toml").vehicle.magnets is not None


def test_a_map_of_a_thousand_million_points_is_refused_or_asked_for() -> None:
    scenario = load("scenarios/periodic/girder_passing.toml")
    with pytest.raises(ValueError, match=f"2 to {LARGEST_COUNT} points"):
        map_request(scenario, x="speed=10:20:1000000000")
    with pytest.raises(ValueError, match="2 to"):
        map_request(scenario, x=f"speed=10:20:{'9' * 18}")
    for axis in ("speed=10:20:" + "9" * 5000, "speed=1e999:20:5", "speed=9**9**9:20:5", "speed=10:20:5:5", "=1:2:3"):
        with pytest.raises(ValueError) as found:
            map_request(scenario, x=axis)
        assert 0 < len(str(found.value)) < 20_000


@pytest.mark.parametrize(
    ("text", "fine"),
    [
        ("1 m" + "*m" * 40, False), ("1 m**1e9", False), ("9**9**9 m", False), ("1e999 m", False), ("1 m^7", False),
        ("1 " + "(" * 50 + "m" + ")" * 50, False), ("1 __import__('os').getcwd()", False), ("1 m" + "m" * 9000, False),
        ("9" * 9000 + " m", False), ("1 m\x00", False), ("nan m", False), ("\u0663 m\u00b2", False), ("1 m^6^6^6",
        False),
        ("12.7 mm", True), ("1e-320 m", True),
    ],
)  # fmt: skip
def test_quantities_are_read_or_refused_in_no_time(text: str, fine: bool) -> None:
    from maglev_ctrl.scenario.units import LENGTH

    begun = time.process_time()
    if fine:
        LENGTH.read(text)
    else:
        with pytest.raises(ValueError) as found:
            LENGTH.read(text)
        assert 0 < len(str(found.value)) < 500
    assert time.process_time() - begun < 5.0


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"lift [N]," * 1000, f"at most {COLUMN_LIMIT} columns"),
        (b"," * 1_000_000 + b"x", f"at most {COLUMN_LIMIT} columns"),
        (b"x" * (CELL_LIMIT + 1), f"cells of at most {CELL_LIMIT} letters"),
        (b"x" * 200_000, "field larger than field limit"),
        (TABLE + b'"1,1,1,1\n', "expected a CSV table"),
        (TABLE + b"1,1,\x1b[31m,1\n", "control signs, got U+001B"),
        (TABLE + b"1,1,\x00,1\n", "control signs, got U+0000"),
        (TABLE + "1,1,\u202e1,1\n".encode(), "control signs, got U+202E"),
        (TABLE + b"1,1,\xff,1\n", "expected UTF-8"),
        (TABLE + b"1,1,nan,1\n", "finite number"),
        (TABLE + b"1,1,1e400,1\n", "finite number"),
        (TABLE.replace(b"lift [N]", b"lift [MN]") + b"1,1,1e305,1\n", "finite in SI"),
        (TABLE + b"1,1\n" * 5000, "expected 4 cells"),
        (TABLE.replace(b"[N]", b"[m**9**9**9]") + b"1,1,1,1\n", "is not a unit"),
        (b"\n" * 100_000, "expected a header"),
    ],
    ids=range(15),
)
def test_a_hostile_table_is_refused(content: bytes, words: str) -> None:
    begun = time.process_time()
    with pytest.raises(ScenarioProblems) as found:
        read_force_table(content, shown="t.csv")
    assert words in str(found.value) and len(str(found.value)) < 20_000
    assert time.process_time() - begun < 10.0
    with pytest.raises(ScenarioProblems):
        read_oscillation_table(content, shown="t.csv")


def test_names_in_records_are_one_line(tmp_path: Path) -> None:
    file = tmp_path / "a.csv"
    file.write_text('frequency [Hz],force,motion,amplitude [N/m],phase [deg]\n1,"a\nproved",b,1,1\n', encoding="utf-8")
    with pytest.raises(ScenarioProblems, match="a name of at most 80 letters in one line"):
        read_oscillations([file])


def test_a_table_within_its_limits_is_read() -> None:
    assert len(read_rows(TABLE + b"1,1,1,1\n" * 2000, shown="t.csv")) == 2001


def test_what_a_message_repeats_is_harmless() -> None:
    error = ScenarioProblems("f", [Problem(1, 1, "a\x1b[2J", 'got "\x9b31m\nf:2:1: all is well"\ud800')])
    assert str(error) == 'f:1:1: a\\x1b[2J: got "\\x9b31m\\nf:2:1: all is well"\\ud800'
    many = ScenarioProblems("f", [Problem(k, 1, "", "x" * 5000) for k in range(1, 5000)])
    assert 1 < len(many.problems) < MOST_TOLD and many.more == 4999 - len(many.problems) and len(str(many)) < 20_000
    short = ScenarioProblems("f", [Problem(k, 1, "", "x") for k in range(1, 5000)])
    assert len(short.problems) == MOST_TOLD and str(short).endswith("f: 4899 more faults are not listed")
    again = ScenarioProblems(*many.__reduce__()[1])
    assert str(again) == str(many)
    assert legible("fine é 中") == "fine é 中"


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('height = "98.07 mm"', 'height = "1e300 m"'),
        ('height = "98.07 mm"', 'height = "1e-320 m"'),
        ('thickness = "20 mm"', 'thickness = "1e-320 m"'),
        ('conductivity = "2.5e7 S/m"', 'conductivity = "1e308 S/m"'),
        ('mass = "24 t"', 'mass = "1e307 kg"'),
        ("exponent = 1", "exponent = 1e308"),
        ('speed = "135 m/s"', 'speed = "1e-320 m/s"'),
    ],
)
def test_sizes_that_no_vehicle_has_are_told_or_read(old: str, new: str) -> None:
    """Found by changing files at random: a force that comes out as zero was divided by."""
    assert old in VEHICLE
    try:
        load_text(VEHICLE.replace(old, new), "mine.toml")
    except ScenarioProblems as error:
        assert 0 < len(str(error)) < 2000


def test_a_force_of_zero_is_not_divided_by() -> None:
    said = told(VEHICLE.replace('thickness = "20 mm"', 'thickness = "1e-320 m"'))
    assert "vehicle: these values leave the range of numbers" in said
