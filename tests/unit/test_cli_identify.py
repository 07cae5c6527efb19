"""`identify` on the command line: what it prints and writes, and one sentence for every wrong input."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from maglev_ctrl.cli import main
from maglev_ctrl.fields.coil import RectangularCoil
from maglev_ctrl.fields.section import CrossSection
from maglev_ctrl.fields.solve import Fineness
from maglev_ctrl.forces.eddy_current import EddyCurrentForce
from maglev_ctrl.report import swap
from maglev_ctrl.report.identification_values import Result, to_json
from maglev_ctrl.scenario.oscillation import read_oscillations

DATA = Path(__file__).resolve().parents[2] / "scenarios" / "data"
HEADER = "frequency [Hz], force, motion, amplitude [N/m], phase [deg]\n"
ROWS = "2, heave, heave, 100, 175\n4, heave, heave, 90, 170\n"
TIME = "time [s], displacement [mm], force [N]\n"


def table(tmp_path: Path, text: str, name: str = "data.csv") -> Path:
    file = tmp_path / name
    file.write_text(text, encoding="utf-8")
    return file


def constant(*, hertz: tuple[float, ...] = (2, 4, 6, 8, 10), unit: str = "deg", names: str = "heave, heave") -> str:
    turn = 180.0 / np.pi if unit == "deg" else 1.0
    lines = [HEADER.replace("deg", unit).strip()]
    for place, f in enumerate(hertz):
        w = 2.0 * np.pi * f
        q = (-400.0 + 0.01 * w**2 + 0.5j * w) * (1.0 + 0.002 * (-1) ** place)
        lines.append(f"{f}, {names}, {abs(q):.9g}, {turn * np.angle(q):.9g}")
    return "\n".join(lines) + "\n"


def wave(samples: int, periods: float, edit: Callable[[list[str]], object] = lambda rows: None) -> str:
    t = np.arange(samples) * 0.01
    w = 2.0 * np.pi * periods / (0.01 * samples)
    rows = [f"{a:.6f}, {np.sin(w * a):.6f}, {np.cos(w * a):.6f}" for a in t]
    edit(rows)
    return TIME + "\n".join(rows) + "\n"


def values(folder: Path) -> dict[tuple[str, str], dict[str, str]]:
    with (folder / "identify.csv").open(encoding="utf-8") as stream:
        return {(row["force"], row["quantity"]): row for row in csv.DictReader(stream)}


def test_the_example_gives_back_what_made_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "made" / "out"
    assert main(["identify", str(DATA / "forced_oscillation.csv"), "--out", str(out)]) == 1  # sway has no constants
    shown = capsys.readouterr().out
    assert "negative damping, the force feeds energy into the motion" in shown
    assert "frequency dependent" in shown and "identify.html" in shown
    found = values(out)
    for quantity, exact in (("k", -420.0), ("c", 0.35), ("m", -0.012)):
        row = found["heave", quantity]
        assert abs(float(row["value"]) - exact) < 4.0 * float(row["standard_error"])  # one draw: 4 sigma
        assert float(row["left_hand_side"]) == -float(row["value"])
        assert found["sway", quantity]["value"] == "" and "frequency dependent" in found["sway", quantity]["reason"]
    body = json.loads((out / "identify.json").read_text(encoding="utf-8"))
    heave, sway = body["series"]
    assert heave["identified"] and not sway["identified"]
    assert sway["damping"]["value"] == "NaN" and len(sway["at_frequency"]) == 8
    assert heave["left_hand_side"]["K_m"]["value"] == -heave["stiffness"]["value"]
    assert heave["left_hand_side"]["K_m"]["low_95"] == -heave["stiffness"]["high_95"]
    page = (out / "identify.html").read_text(encoding="utf-8")
    assert page.count("<figure") == 6 and "NOT EVALUATED" in page
    assert {path.name for path in out.iterdir()} == {"identify.html", "identify.csv", "identify.json"}


def test_records_over_time(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["identify", str(DATA / "forced_oscillation_records.csv"), "-o", str(tmp_path / "out")]) == 0
    found = values(tmp_path / "out")
    for quantity, exact in (("k", -420.0), ("c", 0.35), ("m", -0.012)):
        row = found["heave", quantity]
        assert abs(float(row["value"]) - exact) < 4.0 * float(row["standard_error"])
    body = json.loads((tmp_path / "out" / "identify.json").read_text(encoding="utf-8"))
    assert [record["name"] for record in body["series"][0]["records"]] == ["a", "b", "c"]
    assert "constant m, c, k describe the data" in capsys.readouterr().out


def test_radians_degrees_and_other_units_agree(tmp_path: Path) -> None:
    text = constant()
    other = constant(unit="rad").replace("frequency [Hz]", "Frequency [rad/s]").splitlines()
    turned = [other[0], *(f"{2 * np.pi * float(r.split(',')[0]):.12g},{r.split(',', 1)[1]}" for r in other[1:])]
    for name, content in (("a", text), ("b", "\n".join(turned) + "\n")):
        assert main(["identify", str(table(tmp_path, content, f"{name}.csv")), "-o", str(tmp_path / name)]) == 0
    first, second = values(tmp_path / "a"), values(tmp_path / "b")
    for key in first:
        assert float(first[key]["value"]) == pytest.approx(float(second[key]["value"]), rel=1e-6)


def test_static_stiffness_as_a_row_or_a_column(tmp_path: Path) -> None:
    lines = constant().strip().splitlines()
    row = "\n".join([*lines, "0, heave, heave, 400, 180"]) + "\n"
    column = "\n".join([lines[0] + ", static_stiffness [N/m]", lines[1] + ", -400", *(x + "," for x in lines[2:])])
    for name, content in (("a", row), ("b", column)):
        assert main(["identify", str(table(tmp_path, content, f"{name}.csv")), "-o", str(tmp_path / name)]) == 0
    assert values(tmp_path / "a")["heave", "m"] == values(tmp_path / "b")["heave", "m"]


def test_one_frequency_gives_no_k_and_no_m(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["identify", str(table(tmp_path, constant(hertz=(5.0,)))), "-o", str(tmp_path / "out")]) == 1
    found = values(tmp_path / "out")
    assert found["heave", "k"]["value"] == found["heave", "m"]["value"] == ""
    assert "one frequency cannot separate k from -m w^2" in found["heave", "m"]["reason"]
    assert float(found["heave", "k - m w^2"]["value"]) < 0.0
    assert "not identifiable" in capsys.readouterr().out


def test_couplings_are_not_called_damping(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["identify", str(table(tmp_path, constant(names="sway, heave")))]) == 0
    shown = capsys.readouterr().out
    assert "a coupling" in shown and "feeds energy" not in shown


def test_several_files_combine(tmp_path: Path) -> None:
    low, high = table(tmp_path, constant(hertz=(2, 4)), "low.csv"), table(tmp_path, constant(hertz=(6, 9)), "high.csv")
    assert main(["identify", str(low), str(high), "-o", str(tmp_path / "out")]) == 0
    body = json.loads((tmp_path / "out" / "identify.json").read_text(encoding="utf-8"))
    assert len(body["series"][0]["at_frequency"]) == 4 and len(body["files"]) == 2


def test_moments_have_units_of_their_own(tmp_path: Path) -> None:
    text = constant(names="roll, roll").replace("N/m", "N*m/deg")
    assert main(["identify", str(table(tmp_path, text)), "-o", str(tmp_path / "out")]) == 0
    found = values(tmp_path / "out")
    assert found["roll", "k"]["unit"] == "N*m/rad" and found["roll", "m"]["unit"] == "kg*m^2"
    assert float(found["roll", "k"]["value"]) == pytest.approx(-400.0 * 180.0 / np.pi, rel=0.01)


def test_phases_that_may_be_radians_are_remarked(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main(["identify", str(table(tmp_path, constant(unit="rad").replace("rad", "deg")))])
    assert "if these are radians" in capsys.readouterr().out


def with_column(header: str, *cells: str) -> str:
    rows = [f"{2 * (i + 1)}, heave, heave, 100, 175, {cell}" for i, cell in enumerate(cells)]
    return HEADER.strip() + f", {header}\n" + "\n".join(rows) + "\n"


WRONG = [
    ("", ":1:1: expected a header and at least one row, got an empty file"),
    (HEADER, ":1:1: expected a header and at least one row, got a header alone"),
    (HEADER.replace("N/m", "N/q") + ROWS, ':1:4: amplitude: unknown unit "N/q"; did you mean "N/m"?'),
    (HEADER.replace("N/m", "kg") + ROWS, ":1:4: amplitude: expected a force per displacement"),
    (HEADER.replace(" [Hz]", "") + ROWS, ':1:1: frequency: expected a unit in the header, for example "freq'),
    (HEADER.replace("amplitude", "amplitud") + ROWS, ':1:4: amplitud: unknown column; did you mean "amplitude"?'),
    ("frequency [Hz], force, motion, phase [deg]\n2, a, b, 3\n", ":1:1: amplitude: missing column"),
    (HEADER.replace("motion", "motion [m]") + ROWS, ":1:3: motion: expected a column of names"),
    (HEADER.replace("motion", "motion, force") + ROWS, ":1:4: force: column given twice"),
    (HEADER.replace("deg", "rad") + ROWS, ":2:5: phase: expected radians, as the header says"),
    (HEADER + ROWS.replace("175", "400"), ":2:5: phase: expected a phase within one turn"),
    (HEADER + ROWS.replace("100", "-100"), ":2:4: amplitude: expected an amplitude of zero or more"),
    (HEADER + ROWS.replace("100", "1e200"), ":2:4: amplitude: expected zero or a size between"),
    (HEADER + ROWS.replace("100", "nan"), ":2:4: amplitude: expected a finite number, got nan"),
    (HEADER + ROWS.replace("100", "abc"), ':2:4: amplitude: expected a number, got "abc"'),
    (HEADER + ROWS + "4.0, heave, heave, 91, 169\n", ":4:1: frequency: heave by heave has this frequency on line 3"),
    (HEADER + "2, heave, heave, 100\n", ":2:1: expected 5 cells as in the header, got 4"),
    (HEADER + ROWS.replace("4,", "-4,"), ":3:1: frequency: expected a value above zero"),
    (HEADER + "2, , heave, 3, 3\n", ":2:2: force: expected a name, got nothing"),
    (HEADER + "2, roll, roll, 3, 3\n", ":2:4: amplitude: roll by roll is measured in N*m, the header says N/m"),
    (HEADER + ROWS + "0, heave, heave, 100, 90\n", ":4:5: phase: expected 0 or 180 deg at zero frequency"),
    (HEADER + "0, heave, heave, 100, 180\n", ":2:1: frequency: expected a row above zero frequency"),
    (HEADER.replace(",", ";") + ROWS, ":1:1: expected commas between the columns, got semicolons"),
    (HEADER + '2,"heave, heave, 1, 1\n', ":1:1: expected a CSV table"),
    (with_column("amplitude error [N/m]", "1", "1"), ":1:6: amplitude error: expected phase errors beside"),
    (with_column("static stiffness [N/m]", "-90", "-91"), ":3:6: static stiffness: expected one value"),
    (with_column("static stiffness [N*m/rad]", "-90", "-90"), ":1:6: static stiffness: N*m/rad does not fit"),
    (with_column("static stiffness error [N/m]", "1", "1"), ":1:6: static stiffness error: without static stiffness"),
    (with_column("amplitude error [N/m], phase error [rad]", "1, 2", "1, 2"), ":2:7: phase error: expected a phase"),
    (with_column("amplitude error [N/m], phase error [deg]", "0, 2", "1, 2"), ":2:6: amplitude error: expected a"),
    (with_column("amplitude error [N/m], phase error [deg], static stiffness [N/m]", "1, 2, -9", "1, 2, -9"),
     ":2:8: static stiffness: expected a standard error beside it"),
    (wave(100, 1.6), ":2:1: time: expected at least two periods of the oscillation, got 1.6"),
    (wave(100, 4, lambda rows: rows.insert(50, rows.pop(10))), ":52:1: time: expected even steps of 0.01 s, got -"),
    (wave(100, 4, lambda rows: rows.pop(50)), ":52:1: time: expected even steps of 0.01 s, got 0.02 s: a"),
    (wave(100, 4, lambda rows: rows.insert(50, rows[50])), ":53:1: time: expected even steps of 0.01 s, got 0 s"),
    (wave(8, 4), ":2:1: time: expected at least 11 samples, got 8"),
    (wave(100, 40), ":2:1: time: expected at least four samples per period"),
    (wave(100, 4).replace("force [N]", "force"), ":1:3: force: expected a unit in the header"),
    (wave(100, 4).replace("displacement", "displcement"), ':1:2: displcement: unknown column; did you mean "disp'),
    (TIME + "".join(f"{0.01 * i:.2f}, 1, 2\n" for i in range(50)), ":2:2: displacement: expected an oscillation"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "message"), WRONG, ids=[message[:60] for _, message in WRONG])
def test_wrong_input_is_one_sentence_with_its_place(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, message: str
) -> None:
    file = table(tmp_path, text)
    assert main(["identify", str(file), "--out", str(tmp_path / "out")]) == 2
    told = capsys.readouterr()
    assert told.out == "" and told.err.startswith(f"{file}{message}")
    assert told.err.count("\n") == 1 and "Traceback" not in told.err
    assert [path.name for path in tmp_path.iterdir()] == ["data.csv"]


def test_files_that_contradict_one_another(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bare = table(tmp_path, constant(), "bare.csv")
    cells = ", amplitude error [N/m], phase error [deg]\n2, heave, heave, 100, 175, 1, 1\n"
    errors = table(tmp_path, HEADER.strip() + cells, "errors.csv")
    assert main(["identify", str(bare), str(errors)]) == 2
    assert "has errors here or in" in capsys.readouterr().err
    torque = table(tmp_path, HEADER.replace("N/m", "N/rad") + "2, a, b, 1, 1\n", "torque.csv")
    force = table(tmp_path, HEADER + "2, a, b, 1, 1\n", "force.csv")
    assert main(["identify", str(force), str(torque)]) == 2
    assert "in other units" in capsys.readouterr().err
    static = [table(tmp_path, with_column("static stiffness [N/m]", v, v), f"s{v}.csv") for v in ("-9", "-8")]
    assert main(["identify", *map(str, static)]) == 2
    assert "another static stiffness" in capsys.readouterr().err
    assert main(["identify", str(bare), str(bare)]) == 2
    assert "file given twice" in capsys.readouterr().err
    assert main(["identify", str(tmp_path / "none.csv")]) == 2
    assert "expected a CSV file, got nothing" in capsys.readouterr().err


def test_a_failure_leaves_the_earlier_results(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    file, out = table(tmp_path, constant()), tmp_path / "out"
    assert main(["identify", str(file), "-o", str(out)]) == 0
    (out / "notes.txt").write_text("mine", encoding="utf-8")
    before = {path.name: path.read_bytes() for path in out.iterdir()}

    def failing(*arguments: object) -> bool:
        raise OSError(28, "No space left on device", str(out))

    file.write_text(constant(hertz=(3, 5, 7, 9)), encoding="utf-8")
    monkeypatch.setattr(swap, "_exchange", failing)
    monkeypatch.setattr(Path, "rename", failing)  # the other way it can be done
    assert main(["identify", str(file), "-o", str(out)]) == 2
    assert "No space left on device" in capsys.readouterr().err
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before
    assert {path.name for path in tmp_path.iterdir()} == {"data.csv", "out"}
    monkeypatch.undo()
    assert main(["identify", str(file), "-o", str(out)]) == 0
    assert (out / "notes.txt").read_text(encoding="utf-8") == "mine"
    assert (out / "identify.csv").read_bytes() != before["identify.csv"]


def test_a_file_in_place_of_the_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = table(tmp_path, constant())
    assert main(["identify", str(file), "-o", str(file)]) == 2
    assert "expected a folder for the results, got a file" in capsys.readouterr().err


NAMES = ("surge", "sway", "heave", "roll")
UNITS = ("N/m", "N/rad", "N*m/rad")
PLACE = (15e-3, 12.7e-3, 36.1)


@pytest.fixture(scope="module")
def magnet() -> EddyCurrentForce:
    """The default magnet in the corner of its guideway, at one place and one speed."""
    guideway = CrossSection.l_shape(leg=76.2e-3, thickness=6.35e-3, conductivity=2.5e7)
    coil = RectangularCoil(length=50.8e-3, width=25.4e-3, current=6000.0, lateral=12.7e-3, height=3.175e-3)
    return EddyCurrentForce.solve(
        guideway, (coil,), height=(15e-3, 15e-3), gap=(12.7e-3, 12.7e-3), speed=(36.1, 36.1), frequency=3e3,
        accuracy=Fineness(1.0, 2.5, 2, points=3, tolerance=1e-4, rates_per_decade=1.0),
    )  # fmt: skip


def measured(tmp_path: Path, model: EddyCurrentForce, w: np.ndarray, seed: int) -> list[str]:
    """Files of a forced oscillation of all four coordinates, with errors of 1 % and 0.5 deg; one file per unit."""
    rng = np.random.default_rng(seed)
    q = model.motion_stiffness(*PLACE, w)
    lines: dict[str, list[str]] = {unit: [] for unit in UNITS}
    for i, force in enumerate(NAMES):
        for j, motion in enumerate(NAMES):
            for value, hertz in zip(q[:, i, j], w / (2.0 * np.pi), strict=True):
                error = 0.01 * abs(value)
                a = abs(value) + error * rng.standard_normal()
                psi = np.degrees(np.angle(value)) + 0.5 * rng.standard_normal()
                cells = f"{hertz:.12g}, {force}, {motion}, {a:.9g}, {psi:.9g}, {error:.9g}, 0.5"
                lines[UNITS[(i == 3) + (j == 3)]].append(cells)
    head = "frequency [Hz], force, motion, amplitude [{0}], phase [deg], amplitude error [{0}], phase error [deg]"
    return [
        str(table(tmp_path, "\n".join([head.format(unit), *rows]) + "\n", f"unit{place}.csv"))
        for place, (unit, rows) in enumerate(lines.items())
    ]


def identified(files: list[str]) -> dict[tuple[str, str], dict[str, Any]]:
    """What identify.json says of every pair; sixteen pairs of figures would take their time."""
    body = json.loads(to_json([Result(series, series.identify()) for series in read_oscillations(files)], files={}))
    return {(series["force"], series["motion"]): series for series in body["series"]}


def test_a_slow_oscillation_in_a_guideway_gives_its_coefficients(tmp_path: Path, magnet: EddyCurrentForce) -> None:
    w = np.linspace(20.0, 120.0, 8)
    found = identified(measured(tmp_path, magnet, w, seed=1))
    assert len(found) == 16
    q = magnet.motion_stiffness(*PLACE, np.concatenate([[0.0, 1e-2], w]))
    steady, damping = q[0].real, q[1].imag / 1e-2
    # how far the currents' memory takes either part from k and c over the band
    k_moves = np.max(np.abs(q[2:].real - steady), axis=0)
    c_moves = np.max(np.abs(q[2:].imag / w[:, None, None] - damping), axis=0)
    for i, force in enumerate(NAMES):
        for j, motion in enumerate(NAMES):
            series = found[force, motion]
            if series["description"] != "CONSTANT":
                assert c_moves[i, j] > 0.005 * abs(damping[i, j]) or k_moves[i, j] > 0.005 * abs(steady[i, j])
                continue
            # 32 draws: four and a half standard errors are passed once in 4500 suites
            miss = abs(series["stiffness"]["value"] - steady[i, j])
            assert miss < 4.5 * series["stiffness"]["standard_error"] + 0.3 * k_moves[i, j]
            miss = abs(series["damping"]["value"] - damping[i, j])
            assert miss < 4.5 * series["damping"]["standard_error"] + c_moves[i, j]
    for name in ("sway", "heave"):
        series = found[name, name]
        assert series["description"] == "CONSTANT" and series["damping"]["value"] < 0.0
        assert series["damping"]["standard_error"] < 0.35 * abs(series["damping"]["value"])


def test_a_fast_oscillation_shows_the_memory_of_the_currents(tmp_path: Path, magnet: EddyCurrentForce) -> None:
    w = np.geomspace(200.0, 3000.0, 8)
    found = identified(measured(tmp_path, magnet, w, seed=2))
    q = magnet.motion_stiffness(*PLACE, w)
    for i, force in enumerate(NAMES):
        for j, motion in enumerate(NAMES):
            series = found[force, motion]
            assert series["description"] == "FREQUENCY_DEPENDENT" and series["mass"]["value"] == "NaN"
            for at, value, frequency in zip(series["at_frequency"], q[:, i, j], w, strict=True):
                miss = abs(at["damping"]["value"] - value.imag / frequency)
                assert miss < 5.0 * at["damping"]["standard_error"]
