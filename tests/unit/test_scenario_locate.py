"""Positions of keys in TOML text."""

from __future__ import annotations

from maglev_ctrl.scenario.locate import key_places, place_faults
from maglev_ctrl.scenario.problems import Fault

TEXT = """\
# comment
top = 1
a.b."c d" = { x = 1, y.z = [1, { q = "2" }] }  # comment

[vehicle.car]
mass = "1 t"  # ä
[[option]]
name = "é"
[[option]]
name = "second"
[[option.sensor]]
kind = "gap"
[[option.sensor]]
kind = "stroke"
[option.control]
allowed = [
  # comment
  { output = "ä", value = "1 m" },
  { output = "o" },
]
"""


def test_keys_of_every_shape() -> None:
    places = key_places(TEXT)
    assert places[("top",)].key == (2, 1) and places[("top",)].value == (2, 7)
    assert places[("a", "b", "c d", "x")].value == (3, 19)
    assert places[("a", "b", "c d", "y", "z", 1, "q")].value == (3, 38)
    assert places[("vehicle", "car")].key == (5, 2)
    assert places[("vehicle",)].key == (5, 2)
    assert places[("vehicle", "car", "mass")].value == (6, 8)
    assert places[("option", 1, "name")].value == (10, 8)
    assert places[("option", 1, "sensor", 1, "kind")].value == (14, 8)
    assert places[("option", 1, "control", "allowed", 1, "output")].value == (19, 14)


def test_columns_count_characters_not_bytes() -> None:
    assert key_places(TEXT)[("option", 1, "control", "allowed", 0, "value")].key == (18, 19)


def test_what_is_missing_is_placed_at_its_table() -> None:
    (problem,) = place_faults(TEXT, [Fault(("option", 1, "sensor", 0, "noise"), "missing")])
    assert (problem.line, problem.key) == (11, "option[1].sensor[0].noise")
    (nowhere,) = place_faults(TEXT, [Fault(("operating", "speed"), "missing")])
    assert (nowhere.line, nowhere.column) == (1, 1)
