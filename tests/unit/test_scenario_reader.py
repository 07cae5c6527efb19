"""Scenario files: what is accepted, and what each fault is answered with."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from pathlib import Path

import pytest

from maglev_ctrl.errors import ScenarioError
from maglev_ctrl.scenario import ScenarioProblems, load
from maglev_ctrl.scenario.reader import load_text
from maglev_ctrl.scenario.starter import starter_text

ROOT = Path(__file__).resolve().parents[2]
Write = Callable[..., Path]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    """Writes the starter with (old, new) replacements; every old text has to be there."""

    def edited(*edits: tuple[str, str], name: str = "case.toml") -> Path:
        text = starter_text("Case")
        for old, new in edits:
            assert old in text, old
            text = text.replace(old, new, 1)
        file = tmp_path / name
        file.write_text(text, encoding="utf-8")
        return file

    return edited


def faults(file: Path) -> list[str]:
    with pytest.raises(ScenarioError) as caught:
        load(file)
    lines = str(caught.value).splitlines()
    assert isinstance(caught.value, ScenarioProblems)
    assert len(lines) == len(caught.value.problems)
    return lines


def line_of(file: Path, text: str) -> int:
    return next(i for i, line in enumerate(file.read_text().splitlines(), start=1) if text in line)


def test_starter_is_valid(write: Write) -> None:
    scenario = load(write())
    assert (scenario.title, scenario.name) == ("Case", "case")
    assert [option.kind for option in scenario.options] == ["baseline", "passive_primary", "active_secondary"]
    assert scenario.operating.speed == pytest.approx(400 / 3.6)
    assert scenario.periodic is not None and scenario.periodic.map.depth.last == 0.5


def test_shipped_scenarios_are_valid() -> None:
    files = sorted((ROOT / "scenarios").rglob("*.toml"))
    assert files
    for file in files:
        assert load(file).options


# one edit, the place of the fault (a text of its line), the key, and words of the message
CASES = [
    ('mass = "20 t"', 'mas = "20 t"', "mas =", "vehicle.car.mas", ["unknown key", 'did you mean "mass"?']),
    ('mass = "20 t"', 'mass = "20 m"', "20 m", "vehicle.car.mass", ["expected a mass", "got a length"]),
    ('mass = "20 t"', "mass = 20", "mass = 20", "vehicle.car.mass", ["bare number", 'for example "88 t"']),
    ('mass = "20 t"', 'mass = "0 t"', "0 t", "vehicle.car.mass", ["above zero"]),
    ('mass = "20 t"', 'mass = "-20 t"', "-20 t", "vehicle.car.mass", ["above zero"]),
    ('mass = "20 t"', "mass = nan", "nan", "vehicle.car.mass", ["expected a mass"]),
    ('mass = "3 t"', "", "[[vehicle.bogie]]", "vehicle.bogie[0].mass", ["missing", "expected a mass"]),
    ('freedom = ["heave", "pitch"]', 'freedom = ["heave", "pich"]', "pich", "vehicle.freedom[1]", ['"pitch"?']),
    ('pitch_inertia = "8e5 kg*m^2"', "", "[vehicle.car]", "vehicle.car.pitch_inertia", ["missing", "pitch is free"]),
    ('model = "two_stage"', 'model = "two_stages"', "two_stages", "vehicle.model", ['did you mean "two_stage"?']),
    ('model = "image"', "", "[forces]", "forces.model", ["missing", '"image"']),
    ("exponent = 1 ", "exponent = 0.5 ", "exponent", "forces.exponent", ["receding_image"]),
    ("count = 4\n", "count = 3\n", "count = 3", "vehicle.magnets.count", ["multiple of 2"]),
    ("count = 15", "count = 0", "count = 0", "operating.sweep.speed.count", ["greater than or equal to 2"]),
    ("count = 15", 'count = "15"', 'count = "15"', "operating.sweep.speed.count", ["a whole number"]),
    ("count = 15", "count = true", "count = true", "operating.sweep.speed.count", ["a whole number"]),
    ('to = "450 km/h", count = 15', 'to = "50 km/h", count = 15', "50 km/h", "operating.sweep.speed.to", ["above"]),
    ("format = 1", "format = 2", "format = 2", "format", ["expected 1, got 2"]),
    ('name = "damper_windings"', 'name = "bare"', 'name = "bare"', "option[1].name", ["unique"]),
    ('name = "damper_windings"', 'name = "Damper"', "Damper", "option[1].name", ["lower-case"]),
    ('["bogies", "guideway"]', '["bogeys", "guideway"]', "bogeys", "option[1].spring_damper[0].between[0]",
     ['no body is called "bogeys"', 'did you mean "bogies"?']),
    ('["bogies", "guideway"]', '["car", "bogies"]', '"bogies"]', "option[1].spring_damper[0].between",
     ['one end "guideway"']),
    ('["bogies", "guideway"]', '["front", "bogies"]', '"front", "bogies"', "option[1].spring_damper[0].between",
     ["not with one bogie"]),
    ("[[option.spring_damper]]", "[[option.spring_dampers]]", "spring_dampers", "option[1].spring_dampers",
     ['did you mean "spring_damper"?']),
    ('damping = "30 kN*s/m"', 'damping = "30 kN/m"', "30 kN/m", "option[1].spring_damper[0].damping",
     ["expected a damping coefficient", "got a stiffness"]),
    ('on = "car"\nat', 'on = "cat"\nat', '"cat"', "option[2].sensor[0].on", ['did you mean "car"?']),
    ('to = "bogies"', 'to = "car"', 'to = "car"', "option[2].sensor[1].to", ["another body"]),
    ('noise = "0.1 mm/Hz^0.5"', "", "[[option.sensor]]", "option[2].sensor[1].noise", ["lqg needs a noise density"]),
    ('noise = "0.1 mm/Hz^0.5"', 'noise = "0.1 m/s^2/Hz^0.5"', "0.1 m/s^2", "option[2].sensor[1].noise",
     ["expected a length noise density", "got an acceleration noise density"]),
    ('law = "lqg"', 'law = "lqgg"', "lqgg", "option[2].control.law", ['did you mean "lqg"?']),
    ('{ actuator = "cylinder"', '{ actuator = "cilinder"', "cilinder", "option[2].control.allowed[2].actuator",
     ['did you mean "cylinder"?']),
    ('output = "car.heave.acceleration"', 'output = "car.heave.accelaration"', "accelaration",
     "option[2].control.allowed[0].output", ['did you mean "car.heave.acceleration"?']),
    ('value = "10 mm"', 'value = "10 kN"', "10 kN", "option[2].control.allowed[1].value",
     ["expected a length", "magnet_gap"]),
    ('value = "10 mm"', 'value = "0 mm"', "0 mm", "option[2].control.allowed[1].value", ["above zero"]),
    ('name = "stroke"\n', 'name = "cylinder"\n', 'name = "cylinder"', "option[2].sensor[1].name", ["unique"]),
    ('name = "cylinder"\n', 'name = "car"\n', 'name = "car"', "option[2].actuator[0].name", ["unique"]),
    ('name = "damping"', 'name = "stable"', 'name = "stable"', "requirement[1].name", ["unique"]),
    ('at_least = "6 dB"', "at_least = 6", "at_least = 6", "requirement[2].at_least", ['did you mean "6 dB"?']),
    ('at_least = "6 dB"', 'at_least = "6 dB"\nat_most = "9 dB"', "[[requirement]]", "requirement[2]", ["exactly one"]),
    ('quantity = "gain_margin"', 'quantity = "gainmargin"', "gainmargin", "requirement[2].quantity",
     ['did you mean "gain_margin"?']),
    ('over = "speed"', 'over = "height"', "height", "requirement[0].over", ["operating.sweep.height is missing"]),
    ("depth = 0.05", 'depth = "0.05 m"', "0.05 m", "periodic.depth", ["a plain number"]),
    ("depth = 0.05", "depth = -0.05", "-0.05", "periodic.depth", ["zero or more"]),
    ('sweep.payload = { from = "0 t"', 'gap = "10 mm"\nsweep.payload = { from = "0 t"', 'gap = "10', "operating.gap",
     ["no magnet faces a guidance wall"]),
    ('name = "rear"', 'name = "front"', 'name = "front"', "vehicle.bogie[1].name", ["unique"]),
    ('name = "rear"', 'name = "guideway"', "guideway", "vehicle.bogie[1].name", ["meaning of its own"]),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "place", "key", "words"), CASES, ids=[case[3] for case in CASES])
def test_each_fault_is_placed_and_explained(
    write: Write, old: str, new: str, place: str, key: str, words: list[str]
) -> None:
    file = write((old, new))
    lines = faults(file)
    found = [line for line in lines if f" {key}: " in line]
    assert found, lines
    for word in words:
        assert word in found[0], found[0]
    path, line, column, _ = found[0].split(":", 3)
    assert path == str(file)
    text = file.read_text().splitlines()[int(line) - 1]
    assert place in text, (text, found[0])
    assert 1 <= int(column) <= len(text)


def test_column_points_at_the_value(write: Write) -> None:
    file = write(('value = "10 mm"', "value = 7"))
    (line,) = faults(file)
    number, column = (int(part) for part in line.removeprefix(f"{file}:").split(":")[:2])
    assert file.read_text().splitlines()[number - 1][column - 1 :].startswith("7 }")


def test_all_faults_are_reported_in_order(write: Write) -> None:
    file = write(('mass = "20 t"', "mass = 20"), ('height = "0.10 m"', "height = 1"), ('law = "lqg"', 'law = "x"'))
    lines = faults(file)
    numbers = [int(line.removeprefix(f"{file}:").split(":")[0]) for line in lines]
    assert len(lines) == 3 and numbers == sorted(numbers)


def test_problems_survive_a_process_boundary(write: Write) -> None:
    with pytest.raises(ScenarioProblems) as caught:
        load(write(('mass = "20 t"', "mass = 20")))
    again = pickle.loads(pickle.dumps(caught.value))
    assert str(again) == str(caught.value) and again.problems == caught.value.problems


def test_scenario_survives_a_process_boundary(write: Write) -> None:
    scenario = load(write())
    again = pickle.loads(pickle.dumps(scenario))
    assert again.hash == scenario.hash and again.options == scenario.options


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"format = \n", ["1:10", "expected valid TOML"]),
        (b"format = 1\nmass = 20 t\n", ["2:"]),
        (b"format = 1\nformat = 1\n", ["2:"]),
        (b"a = [\n", ["expected valid TOML"]),
        (b"title = \"\xff\"\n", ["1:10", "UTF-8"]),
        (b"a = " + b"[" * 200 + b"]" * 200, ["nested at most"]),
        (b"a = " + b"[" * 5000 + b"]" * 5000, ["nested at most"]),
        (b"a." * 5000 + b"a = 1\n", ["nested at most"]),
        (b"# " + b"x" * 30_000, ["lines of at most"]),
        (b"# x\n" * 400_000, ["1 MiB"]),
        (b"a = " + b"9" * 10_000, ["expected"]),
        (b"", ["the file is empty; `", " new NAME` writes one to start from"]),
        (b"# hello\n\n", ["the file holds nothing but comments; `"]),
        (b'a = "x\nb = 1\n', ["broken.toml:1:7: expected valid TOML: a text is not closed"]),
        (b'a = """x\nb = 1\n', ["a text is not closed"]),
    ],
    ids=["value", "space", "twice", "end", "utf8", "deep", "deeper", "dotted", "line", "size", "digits", "empty",
         "comment", "open", "open_block"],
)  # fmt: skip
def test_broken_files(tmp_path: Path, content: bytes, words: list[str]) -> None:
    file = tmp_path / "broken.toml"
    file.write_bytes(content)
    text = "\n".join(faults(file))
    for word in words:
        assert word in text, text[:300]


def test_missing_file_and_folder(tmp_path: Path) -> None:
    assert "no such file" in faults(tmp_path / "none.toml")[0]
    assert "got a folder" in faults(tmp_path)[0]


def test_a_missing_file_names_a_near_one(tmp_path: Path) -> None:
    (tmp_path / "eds_135t.toml").write_text("format = 1\n")
    for wanted in ("eds_135.toml", "eds_135t", "eds-135t.toml"):
        assert faults(tmp_path / wanted) == [f'{tmp_path / wanted}: no such file; did you mean "eds_135t.toml"?']
    assert "writes one to start from" in faults(tmp_path / "other.toml")[0]


def test_faults_of_every_item_do_not_make_a_list_short(tmp_path: Path) -> None:
    file = tmp_path / "bogies.toml"
    file.write_text(starter_text("Bogies").replace('mass = "3 t"', 'mass = "3 m"'), encoding="utf-8")
    found = faults(file)
    assert len(found) == 2 and all("].mass: expected a mass" in line for line in found)


@pytest.mark.parametrize(
    ("old", "new", "key"),
    [
        ('damping = "30 kN*s/m"', 'damping = "-30 kN*s/m"', "option[1].spring_damper[0].damping"),
        ('damping = "0 kN*s/m"', 'damping = "-1 kN*s/m"', "vehicle.secondary.damping"),
    ],
)
def test_a_damper_that_adds_energy_is_refused(tmp_path: Path, old: str, new: str, key: str) -> None:
    file = tmp_path / "damper.toml"
    file.write_text(starter_text("Damper").replace(old, new), encoding="utf-8")
    (found,) = faults(file)
    assert f"{key}: expected a damping that is not negative; an actuator can add energy" in found


def test_the_starter_sweeps_the_speeds_of_its_map(tmp_path: Path) -> None:
    file = tmp_path / "starter.toml"
    file.write_text(starter_text("Starter"), encoding="utf-8")
    scenario = load(file)
    assert scenario.periodic is not None and scenario.operating.sweep.speed is not None
    swept, mapped = scenario.operating.sweep.speed, scenario.periodic.map.speed
    assert (swept.first, swept.last) == (mapped.first, mapped.last)


def test_windows_text_is_read(tmp_path: Path, write: Write) -> None:
    content = write().read_bytes().replace(b"\n", b"\r\n")
    (tmp_path / "windows.toml").write_bytes(b"\xef\xbb\xbf" + content)
    assert load(tmp_path / "windows.toml").hash == load(tmp_path / "case.toml").hash


def test_hash_sees_values_not_their_spelling(write: Write) -> None:
    first = load(write()).hash
    assert load(write(('mass = "20 t"', 'mass = "20_000 kg" # same'), name="b.toml")).hash == first
    assert load(write(('height = "0.10 m"', 'height = "100 mm"'), name="c.toml")).hash == first
    assert load(write(('mass = "20 t"', 'mass = "21 t"'), name="d.toml")).hash != first


def test_requirements_know_their_limit(write: Write) -> None:
    requirements = {r.name: r for r in load(write()).requirements}
    assert (requirements["stable"].sense, requirements["stable"].limit) == ("at_most", 0.0)
    assert (requirements["gain_margin"].limit, requirements["gain_margin"].unit) == (6.0, "dB")
    assert requirements["damping"].over == "speed"


@pytest.mark.parametrize("sign", ["\\u202e", "\\u001b[2J", "\\u0000", "\u2066"])
def test_signs_that_steer_a_terminal_or_turn_words_around_are_refused_with_their_place(sign: str) -> None:
    text = Path("scenarios/paper/heave_surge.toml").read_text(encoding="utf-8")
    title = next(line for line in text.splitlines() if line.startswith("title"))
    with pytest.raises(ScenarioProblems) as found:
        load_text(text.replace(title, f'title = "Safe {sign}vehicle"'), "mine.toml")
    (problem,) = found.value.problems
    assert problem.line == text.splitlines().index(title) + 1 and problem.key == "title"
    assert problem.message.startswith("expected text without control signs, got U+")
    assert not any(ord(letter) < 32 or "\u202a" <= letter <= "\u2069" for letter in str(found.value))


def test_letters_of_every_language_and_line_ends_stay() -> None:
    text = Path("scenarios/paper/heave_surge.toml").read_text(encoding="utf-8")
    title = next(line for line in text.splitlines() if line.startswith("title"))
    made = load_text(text.replace(title, 'title = "磁浮 Zug Ω, שלום"'), "scenarios/paper/mine.toml")
    assert made.title == "磁浮 Zug Ω, שלום"
