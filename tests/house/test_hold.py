"""The record behind the reliability page: complete, honest about what was missed, renewed part by part."""

from __future__ import annotations

import importlib.util
import json
import re
import sys
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[2]
RECORD = ROOT / "docs" / "_data" / "reliability.json"
PAGE = ROOT / "docs" / "reliability.md"
KEYS = {"part", "title", "seconds", "figures", "notes", "day", "commit", "machine"}


def module(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    made = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = made
    spec.loader.exec_module(made)
    return made


hold = module(ROOT / "tests" / "hold" / "hold.py")
reliability = module(ROOT / "docs" / "_ext" / "reliability.py")


def test_every_part_is_a_script_and_stands_on_the_page():
    shown = re.findall(r"\{reliability\} (\w+)", PAGE.read_text(encoding="utf-8"))
    assert tuple(shown) == hold.PARTS
    assert all((ROOT / "tests" / "hold" / f"{name}.py").is_file() for name in hold.PARTS)


def test_the_record_is_whole():
    known = json.loads(RECORD.read_text(encoding="utf-8"))
    assert tuple(known) == hold.PARTS
    for name, part in known.items():
        assert set(part) == KEYS
        assert part["part"] == name
        assert part["figures"]
        for one in part["figures"]:
            assert set(one) == {"what", "asked", "reached", "met"}
            assert isinstance(one["met"], bool)
        assert "/tmp" not in json.dumps(part)  # no places of the machine it ran on
        assert "/work" not in json.dumps(part)


def test_a_missed_figure_is_told_in_words():
    part = {"figures": [
        {"what": "a", "asked": "0", "reached": "0", "met": True},
        {"what": "b", "asked": "0", "reached": "3", "met": False},
    ]}  # fmt: skip
    rows = [row.astext() for row in reliability.table(part).findall(lambda node: node.tagname == "row")]
    assert "met" in rows[1]
    assert "MISSED" not in rows[1]
    assert "MISSED" in rows[2]


def test_a_part_is_renewed_alone(tmp_path):
    file = tmp_path / "record.json"
    told = {"part": "stress", "title": "t", "seconds": 1.0, "figures": [], "notes": []}
    hold.keep(file, "stress", told)
    hold.keep(file, "sweeps", {**told, "part": "sweeps"})
    hold.keep(file, "stress", {**told, "seconds": 2.0})
    known = json.loads(file.read_text(encoding="utf-8"))
    assert list(known) == ["sweeps", "stress"]
    assert known["stress"]["seconds"] == 2.0
    assert [path.name for path in tmp_path.iterdir()] == ["record.json"]


@pytest.mark.parametrize("arguments", [["nothing"], ["--fast"], ["sweeps", "--quick"]])
def test_wrong_arguments_are_told(arguments, capsys):
    assert hold.main(arguments) == 2
    assert "expected parts of sweeps, fuzz" in capsys.readouterr().err
