"""Any text, any bytes, any table of TOML, any JSON: a result, or the project's own error in a sentence."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from maglev_ctrl.errors import MaglevError
from maglev_ctrl.proofs.claims import DecayClaim
from maglev_ctrl.proofs.file import DesignFile, from_document, to_document
from maglev_ctrl.report.reading import read_report
from maglev_ctrl.scenario.force_table import read_force_table
from maglev_ctrl.scenario.json_text import parse_json
from maglev_ctrl.scenario.oscillation_table import read_oscillation_table
from maglev_ctrl.scenario.problems import legible
from maglev_ctrl.scenario.reader import load_text
from maglev_ctrl.scenario.units import LENGTH, read_quantity
from maglev_ctrl.study.design.document import load_designs, prove_again
from maglev_ctrl.systems import Controller
from maglev_ctrl.systems.plant import Plant

KEYS = st.sampled_from([
    "format", "title", "vehicle", "forces", "operating", "option", "periodic", "requirement", "ride", "tuning", "model",
    "car", "mass", "bogie", "name", "kind", "speed", "height", "sweep", "control", "law", "allowed", "x", "",
])  # fmt: skip
WORDS = st.one_of(
    st.text(max_size=12), st.sampled_from(["1 m", "1e999 m", "heave_surge", "table", "lqr", "\x1b[31m", "../x"])
)
LEAVES = st.one_of(
    st.none(), st.booleans(), st.integers(), st.integers(-(10**400), 10**400), st.floats(), WORDS, st.just("NaN"),
    st.sampled_from(["maglev_ctrl design 1", "maglev-ctrl comparison", "PASS"]),
)  # fmt: skip
FIELDS = st.sampled_from([
    "format", "kind", "designs", "plants", "controllers", "claims", "name", "law", "A", "P", "rate", "options", "title",
    "verdict", "requirements", "modes", "s", "value", "unit", "versions", "digest", "extra", "sampled", "x",
])  # fmt: skip
JSON = st.recursive(
    LEAVES,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(FIELDS | WORDS, inner, max_size=5),
    max_leaves=20,
)
QUICK = settings(
    max_examples=60, deadline=None, derandomize=True, database=None, suppress_health_check=list(HealthCheck)
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("hostile")


def toml(value: Any) -> str:
    """A value as TOML would hold it, or nearly."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{json.dumps(key)} = {toml(inner)}" for key, inner in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(map(toml, value)) + "]"
    if isinstance(value, str):
        return json.dumps(value)
    if isinstance(value, bool):
        return str(value).lower()
    return "nan" if value is None else repr(value)


def in_a_sentence(error: MaglevError) -> None:
    said = str(error)
    assert 0 < len(said) < 20_000
    assert all(letter.isprintable() or letter == "\n" for letter in said), said


@QUICK
@given(
    st.dictionaries(
        KEYS,
        st.recursive(
            LEAVES, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(KEYS, inner, max_size=4), max_leaves=12
        ),
        max_size=7,
    )
)
def test_any_table_is_a_scenario_or_told(data: dict[str, Any]) -> None:
    text = "\n".join(f"{json.dumps(key)} = {toml(value)}" for key, value in data.items())
    try:
        load_text(text, "any.toml")
    except MaglevError as error:
        in_a_sentence(error)


@QUICK
@given(st.text(max_size=300) | st.text("[]{}=.\"'\n#a1 ", max_size=300))
def test_any_text_is_told(text: str) -> None:
    with pytest.raises(MaglevError) as told:
        load_text(text, "any.toml")
    in_a_sentence(told.value)


@QUICK
@given(st.binary(max_size=300) | st.text('height[m],lift\n"1e9. ;#', max_size=300).map(str.encode))
def test_any_bytes_are_no_table(content: bytes) -> None:
    for reader in (read_force_table, read_oscillation_table):
        with pytest.raises(MaglevError) as told:
            reader(content, shown="any.csv")
        in_a_sentence(told.value)


@QUICK
@given(
    st.lists(st.tuples(*[st.floats() | st.text("1e+-.nai_ ", max_size=8)] * 4), min_size=1, max_size=4),
    st.sampled_from(["N", "kN", "MN", "m", "lbf", "N**9", ""]),
)
def test_any_cells_are_finite_numbers_or_told(rows: list[tuple[float | str, ...]], unit: str) -> None:
    lines = [f"height [mm],speed [km/h],lift [{unit}],drag [N]", *(",".join(map(str, row)) for row in rows)]
    try:
        found = read_force_table("\n".join(lines).encode(), shown="any.csv")
    except MaglevError as error:
        in_a_sentence(error)
    else:
        assert len(found.lift) == len(rows) and all(map(math.isfinite, found.lift))


@QUICK
@given(JSON)
def test_any_json_is_a_design_a_report_or_told(folder: Path, data: Any) -> None:
    file = folder / "any.json"
    try:
        text = json.dumps(data)
    except (ValueError, RecursionError):
        return
    file.write_text(text)
    for reader in (load_designs, read_report):
        try:
            reader(file)
        except MaglevError as error:
            in_a_sentence(error)
    if isinstance(data, dict):
        whole = {"format": "maglev_ctrl designs 1", "designs": [{**DOCUMENT, **data}]}
        file.write_text(json.dumps(whole))
        try:
            for design in load_designs(file):
                prove_again(design)
        except MaglevError as error:
            in_a_sentence(error)


DOCUMENT = json.loads(json.dumps(to_document(DesignFile(
    "demo", "lqr", (Plant.from_matrices([[1.0]], [[1.0]], [[1.0]], [[1.0]]),),
    (Controller.static([[-3.0]], measured=("x1",), commands=("u1",)),),
    (DecayClaim((0,), (0,), 1.0, np.ones((1, 1, 1))),),
))))  # fmt: skip


@QUICK
@given(st.floats(allow_nan=False, allow_infinity=False), st.floats(allow_nan=False, allow_infinity=False))
def test_numbers_of_a_design_come_back_to_the_last_bit(a: float, p: float) -> None:
    document = json.loads(json.dumps(DOCUMENT))
    document["plants"][0]["A"] = [[a]]
    document["claims"][0]["P"] = [[[p]]]
    found = from_document(document)
    again = json.loads(json.dumps(to_document(found), allow_nan=False))
    assert again == document
    assert not prove_again(found).proved or (p > 0.0 and a < 2.0)  # the pole is a - 3, and 1/s is claimed


@QUICK
@given(JSON)
def test_strict_json_is_read_as_python_reads_it(data: Any) -> None:
    try:
        text = json.dumps(data, allow_nan=False)
        expected = json.loads(text)
    except (ValueError, RecursionError):
        return
    try:
        assert parse_json(text.encode()) == expected
    except ValueError as error:
        assert "control signs" in str(error) or "digits" in str(error)


@QUICK
@given(st.text(max_size=60) | st.text("0123456789eE+-._ m*/^()kN\u00b7\u00b2%", max_size=40))
def test_any_quantity_is_finite_or_told(text: str) -> None:
    for read in (read_quantity, LENGTH.read):
        try:
            found = read(text)
        except ValueError as error:
            assert 0 < len(str(error)) < 2000
        else:
            assert math.isfinite(found if isinstance(found, float) else found.value)


@QUICK
@given(st.floats(min_value=-1e300, max_value=1e300))
def test_a_length_comes_back(value: float) -> None:
    assert LENGTH.read(f"{value!r} m") == value


@QUICK
@given(st.text(max_size=2000))
def test_what_is_repeated_is_legible(text: str) -> None:
    shown = legible(text, most=200)
    assert len(shown) <= 200 * 10 and not any(ord(sign) < 32 or 0x7F <= ord(sign) < 0xA0 for sign in shown)
