"""JSON from strangers (designs, reports): refused in a sentence, whatever it holds; what fuzzing found stays found."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any

import pytest
from test_design_file import written
from test_report_difference import option, report, requirement

from maglev_ctrl.errors import MaglevError, ModelError, ScenarioError
from maglev_ctrl.proofs.file import LONGEST_NAME, from_document
from maglev_ctrl.report.reading import read_report
from maglev_ctrl.scenario import json_text
from maglev_ctrl.scenario.json_text import DEPTH_LIMIT, SIZE_LIMIT, VALUE_LIMIT, parse_json
from maglev_ctrl.study.design.document import load_designs, prove_again

DESIGNS = '{{"format": "maglev_ctrl designs 1", "designs": [{}]}}'


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"\xff\xfe{}", "UTF-8"),
        (b"{", "property name"),
        (b'{"a": NaN}', "NaN is no JSON number"),
        (b'{"a": -Infinity}', "-Infinity is no JSON number"),
        (b'{"a": 1, "a": 2}', 'the key "a" stands twice'),
        (b'{"a": "\\u001b[31m"}', "control signs, got U[+]001B"),
        (b'{"a": "\\u009b"}', "control signs, got U[+]009B"),
        (b'{"\\u202e": 1}', "control signs, got U[+]202E"),
        (b'["\\ud800"]', "control signs, got U[+]D800"),
        ('["\u2066"]'.encode(), "control signs, got U[+]2066"),
        (b"9" * 5000, "whole number of 5000 digits"),
        (b"[" * 100_000, "nested"),
        (b"[" * (DEPTH_LIMIT + 2) + b"]" * (DEPTH_LIMIT + 2), "nested"),
        (b'{"a":' * 5000 + b"1" + b"}" * 5000, "nested"),
        (b"," * (VALUE_LIMIT + 1), "values"),
    ],
)
def test_what_no_reader_should_see_is_refused(content: bytes, words: str) -> None:
    with pytest.raises((ValueError, RecursionError), match=words):
        parse_json(content)


def test_what_is_good_is_read_as_python_does() -> None:
    text = json.dumps({"a": [1, 2.5, -1e-320, None, True, "é\n\t"], "b": {"c": []}, "\ud83d\ude00": 10**300})
    assert parse_json(text.encode()) == json.loads(text)
    assert parse_json(b"[" * DEPTH_LIMIT + b"]" * DEPTH_LIMIT)


def test_a_large_file_is_not_parsed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(json_text, "SIZE_LIMIT", 100)
    with pytest.raises(ValueError, match="MiB"):
        parse_json(b" " * 101)
    assert SIZE_LIMIT <= 64 * 2**20  # a file of this size read into lists stays below a gibibyte


def test_a_reader_reads_no_more_than_its_limit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for module in ("maglev_ctrl.report.reading", "maglev_ctrl.study.design.document", "maglev_ctrl.scenario.json_text"):
        monkeypatch.setattr(f"{module}.SIZE_LIMIT", 1000)
    file = tmp_path / "report.json"
    file.write_text(json.dumps(report(option("a", requirement()))) + " " * 1000)
    with pytest.raises(ScenarioError, match="at most 0 MiB"):
        read_report(file)
    with pytest.raises(ModelError, match="at most 0 MiB"):
        load_designs(file)


def placed(document: dict[str, Any], path: tuple[Any, ...], value: Any) -> dict[str, Any]:
    changed = copy.deepcopy(document)
    spot: Any = changed
    for part in path[:-1]:
        spot = spot[part]
    spot[path[-1]] = value
    return changed


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        (("name",), "a\nproved", "letters in one line"),
        (("name",), "x" * (LONGEST_NAME + 1), "letters in one line"),
        (("law",), "\x1b[2J", "letters in one line"),
        (("versions", "\r\n"), {}, r"versions\['\\r\\n'\]"),
        (("plants", 0, "states", 0), "a\u2028b", "letters in one line"),
        (("plants", 0, "A", 0, 0), 10**400, "very large whole number"),
        (("plants", 0, "A", 0, 0), 10**5000, "very large whole number"),
        (("plants", 0, "A", 0, 0), "Infinity", "a finite double-precision number|a number"),
        (("plants", 0, "dt"), 10**5000, "very large whole number"),
        (("claims", 0, "kind"), "x" * 9000, "expected one of"),
        (("format",), "y" * 9000, "expected"),
        (("claims", 0, "plants"), [10**5000], "very large whole number"),
    ],
    ids=range(12),
)
def test_a_hostile_design_is_told_in_one_short_line(path: tuple[Any, ...], value: Any, words: str) -> None:
    with pytest.raises(ModelError, match=words) as told:
        from_document(placed(written(), path, value))
    assert len(str(told.value)) < 500 and str(told.value).isprintable()


def test_the_extremes_of_floats_are_decided_in_no_time(tmp_path: Path) -> None:
    """Exact arithmetic on numbers 600 decades apart; with a thousand million in the exponent they are infinite."""
    for value, proved in ((5e-324, None), (1.7976931348623157e308, False), (-1e308, False)):
        document = placed(written(), ("plants", 0, "A", 1, 0), value)
        found = prove_again(from_document(document))
        assert proved is None or found.proved is proved
    file = tmp_path / "design.json"
    text = json.dumps(placed(written(), ("plants", 0, "A", 1, 0), "@")).replace('"@"', "1e1000000000")
    file.write_text(DESIGNS.format(text))
    with pytest.raises(ModelError, match="finite"):
        load_designs(file)


@pytest.mark.parametrize("content", [b"", b"null", b"[]", b"{}", b"\0", b'{"format": 1e999}', b'{"designs": []}'])
def test_no_design_and_no_report(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "it.json"
    file.write_bytes(content)
    for reader in (load_designs, read_report):
        with pytest.raises(MaglevError) as told:
            reader(file)
        assert str(told.value).startswith(str(file)) and len(str(told.value)) < 500


def test_a_title_that_steers_a_terminal_never_reaches_it(tmp_path: Path) -> None:
    file = tmp_path / "report.json"
    file.write_text(json.dumps(report(option("a", requirement()), title="\x1b]0;owned\x07")))
    with pytest.raises(ScenarioError, match="control signs"):
        read_report(file)
    file.write_text(json.dumps({"kind": "\ud800", "format": 1}))
    with pytest.raises(ScenarioError, match=r"U[+]D800"):
        read_report(file)
    file.write_text(json.dumps({"kind": "\r\nf: all is well", "format": 1}))
    with pytest.raises(ScenarioError) as told:
        read_report(file)
    assert str(told.value).isprintable()
