"""Force tables beside a scenario: columns, units, numbers, and where the file may lie."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from maglev_ctrl.scenario import ScenarioProblems, build_vehicle, load
from maglev_ctrl.scenario.force_table import read_force_table

HEADER = "height [mm], gap [mm], speed [km/h], lift [kN], guidance [N], drag [N]"
SCENARIO = """
format = 1
title = "Double L"
[vehicle]
model = "double_l"
half_gauge = "88.9 mm"
magnet_depth = "91.4 mm"
[vehicle.car]
mass = "10 kg"
roll_inertia = "0.0623 kg*m^2"
[forces]
model = "table"
file = "forces.csv"
[operating]
speed = "36 m/s"
height = "25 mm"
gap = "12.7 mm"
[[option]]
name = "bare"
kind = "baseline"
"""


def rows(count: int = 5) -> list[str]:
    heights, gaps = np.linspace(10, 40, count), np.linspace(5, 25, count)
    return [f"{h}, {g}, 129.6, {1.5 / h}, {20.0 / g}, {30.0 / h}" for h in heights for g in gaps]


def write(folder: Path, *, header: str = HEADER, lines: list[str] | None = None, scenario: str = SCENARIO) -> Path:
    file = folder / "case.toml"
    file.write_text(scenario)
    (folder / "forces.csv").write_text("\n".join([header, *(rows() if lines is None else lines)]) + "\n")
    return file


def message(file: Path) -> str:
    with pytest.raises(ScenarioProblems) as caught:
        load(file)
    return str(caught.value)


def test_units_of_the_header_are_read(tmp_path: Path) -> None:
    samples = load(write(tmp_path)).force_samples
    assert samples is not None and samples.gap is not None and samples.guidance is not None
    assert samples.height[0] == pytest.approx(0.010)
    assert samples.speed[0] == pytest.approx(36.0)
    assert samples.lift[0] == pytest.approx(150.0)
    assert samples.guidance[0] == pytest.approx(4.0)


def test_magnets_are_trimmed_to_the_weight(tmp_path: Path) -> None:
    vehicle = build_vehicle(load(write(tmp_path)))
    lift = sum(float(m.force.forces(0.025, 0.0127, 36.0).lift) for m in vehicle.magnets)
    assert lift == pytest.approx(10.0 * 9.80665, rel=1e-12)
    assert [magnet.side for magnet in vehicle.magnets] == [1, -1]
    untrimmed = SCENARIO.replace('file = "forces.csv"', 'file = "forces.csv"\ntrim_to_weight = false')
    raw = build_vehicle(load(write(tmp_path, scenario=untrimmed)))
    assert sum(float(m.force.forces(0.025, 0.0127, 36.0).lift) for m in raw.magnets) != pytest.approx(lift, rel=1e-3)


@pytest.mark.parametrize(
    ("header", "lines", "words"),
    [
        (HEADER.replace(", drag [N]", ""), ["1,2,3,4,5"], ["forces.csv:1:1: drag: missing column", '"drag [kN]"']),
        (HEADER.replace("drag [N]", "drga [N]"), None, ["unknown column", 'did you mean "drag"?']),
        (HEADER.replace("drag [N]", "drag"), None, ["drag: expected a unit in the header", '"drag [kN]"']),
        (HEADER.replace("drag [N]", "drag [mm]"), None, ["drag: expected a force", "got a length"]),
        (HEADER.replace("drag [N]", "lift [N]"), None, ["lift: column given twice"]),
        (HEADER.replace("guidance [N], ", ""), ["1,2,3,4,5"], ["guidance: missing column"]),
        (
            HEADER,
            ["20, 10, 36, 1, 1, 1", "20, 12, 36, nan, 1, 1"],
            ["forces.csv:3:4: lift: expected a finite number", "got nan"],
        ),
        (HEADER, ["20, 10, 36, 1, 1, inf"], ["forces.csv:2:6: drag: expected a finite number", "got inf"]),
        (HEADER, ["20, 10, 36, 1, one, 1"], ['guidance: expected a number, got "one"']),
        (HEADER, ["20, 10, 36, 1, , 1"], ["guidance: expected a number, got nothing"]),
        (HEADER, ["20, 10, 36, 1, 1"], ["forces.csv:2:1", "expected 6 cells", "got 5"]),
        (HEADER, [], ["at least one row"]),
        (HEADER, rows()[:-1], ["case.toml", "forces.file", "every combination"]),
        (HEADER, [row.replace("129.6", "100") for row in rows()], ["operating.speed: the design point", "speed 36"]),
    ],
)
def test_each_fault_of_a_table(tmp_path: Path, header: str, lines: list[str] | None, words: list[str]) -> None:
    text = message(write(tmp_path, header=header, lines=lines))
    for word in words:
        assert word in text, text


def test_comments_and_blank_lines_keep_the_line_numbers(tmp_path: Path) -> None:
    text = message(write(tmp_path, lines=["# measured", "", "20, 10, 36, 1, x, 1"]))
    assert "forces.csv:4:5" in text


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("../forces.csv", "in the scenario's folder"),
        ("/etc/passwd", "in the scenario's folder"),
        ("forces2.csv", 'did you mean "forces.csv"?'),
        (".", "no file"),
    ],
)
def test_where_the_table_may_lie(tmp_path: Path, name: str, words: str) -> None:
    folder = tmp_path / "inside"
    folder.mkdir()
    (tmp_path / "forces.csv").write_text("secret")
    text = message(write(folder, scenario=SCENARIO.replace('"forces.csv"', f'"{name}"')))
    assert "forces.file" in text and words in text and "secret" not in text


def test_a_link_out_of_the_folder_is_refused(tmp_path: Path) -> None:
    folder = tmp_path / "inside"
    folder.mkdir()
    file = write(folder)
    (tmp_path / "outside.csv").write_text((folder / "forces.csv").read_text())
    (folder / "forces.csv").unlink()
    (folder / "forces.csv").symlink_to(tmp_path / "outside.csv")
    assert "in the scenario's folder" in message(file)


def test_hash_covers_the_table(tmp_path: Path) -> None:
    first = load(write(tmp_path)).hash
    changed = [row.replace("129.6", "129.60") for row in rows()]
    assert load(write(tmp_path, lines=changed)).hash != first


def test_a_wall_needs_gap_and_guidance(tmp_path: Path) -> None:
    lines = [f"{h}, 129.6, {1.5 / h}, {30.0 / h}" for h in np.linspace(10, 40, 5)]
    file = write(tmp_path, header="height [mm], speed [km/h], lift [kN], drag [N]", lines=lines)
    assert "forces.file: expected columns gap and guidance" in message(file)


def test_image_forces_cannot_guide(tmp_path: Path) -> None:
    image = 'model = "image"\nexponent = 1\nthickness = "6.35 mm"\nconductivity = "2.5e7 S/m"'
    scenario = SCENARIO.replace('model = "table"\nfile = "forces.csv"', image)
    assert "a double_l needs guidance forces" in message(write(tmp_path, scenario=scenario))


def test_table_without_walls_needs_no_gap() -> None:
    samples = read_force_table(
        b"height [cm];x\n".replace(b";x", b",speed [m/s],lift [N],drag [N]") + b"1,2,3,4\n", shown="t"
    )
    assert samples.gap is None and samples.guidance is None
    assert samples.height.tolist() == [0.01]


def test_wrong_encoding_is_placed() -> None:
    with pytest.raises(ScenarioProblems, match="t:2:1: expected UTF-8"):
        read_force_table(b"height [cm]\n\xff", shown="t")
