"""The supply chain: the lock file, the licences, the smallest set, the bill of materials, what an audit may say."""

from __future__ import annotations

import copy
import json
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.append(str(ROOT / "tests" / "hold"))

import supply  # noqa: E402
import supply_bom  # noqa: E402
import supply_imports  # noqa: E402
import supply_licences  # noqa: E402
import supply_lock  # noqa: E402
import supply_smoke  # noqa: E402

LOCK = supply_lock.LOCK.read_text(encoding="utf-8")
PROJECT = supply_lock.project()
PAGE = supply.PAGE.read_text(encoding="utf-8")
HASH = re.search(r" \\\n    --hash=sha256:[0-9a-f]{64}", LOCK)


def test_the_lock_belongs_to_the_project() -> None:
    assert supply_lock.faults(LOCK, PROJECT) == []


def test_nothing_of_this_machine_is_in_the_lock() -> None:
    assert LOCK.startswith(supply_lock.HEAD)
    assert not re.search(r"/(home|root|work|tmp|opt|Users)/|://", LOCK)


def version_below(text: str) -> str:
    return re.sub(r"^pytest==\S+", "pytest==8.1.0", text, flags=re.MULTILINE)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (version_below, "pytest: locked at 8.1.0, asked for >=8.2"),
        (lambda text: re.sub(r"^numpy==.*?(?=^[a-z])", "", text, flags=re.M | re.S), "numpy: not locked"),
        (lambda text: re.sub(r"^(numpy==\S+) ; \S+ < '3.12'", r"\1", text, flags=re.M), "numpy: two versions"),
        (lambda text: re.sub(r"^(typer==\S+)", r"\1 ; sys_platform == 'linux'", text, flags=re.M),
         "typer: not locked on Python 3.11 on darwin"),
        (lambda text: text + "\nrequests>=2\n", "is no pinned package"),
        (lambda text: text + "\nrequests==2.0\n", "is no pinned package"),
        (lambda text: text + "\n--extra-index-url https://example.org/simple\n", "names a place"),
        (lambda text: text + "\nours @ file:///home/a/ours.whl\n", "names a place"),
        (lambda text: text.replace("--hash=sha256:", "--hash=md5:", 1), "is no pinned package"),
        (lambda text: text.replace(HASH[0], HASH[0] * 2, 1) if HASH else text, "a hash twice"),
    ],
)  # fmt: skip
def test_a_lock_that_does_not_belong_is_seen(change: Callable[[str], str], told: str) -> None:
    changed = change(LOCK)
    assert changed != LOCK
    assert any(told in one for one in supply_lock.faults(changed, PROJECT))


def test_a_new_requirement_is_missed_in_the_lock() -> None:
    changed = copy.deepcopy(PROJECT)
    changed["project"]["dependencies"].append("requests-unheard-of>=1")
    changed["project"]["optional-dependencies"]["ui"] = ["bokeh>=99"]
    found = supply_lock.faults(LOCK, changed)
    assert any("requests-unheard-of: not locked" in one for one in found)
    assert any(one.startswith("bokeh: locked at") for one in found)


def test_every_licence_is_listed_and_allowed() -> None:
    assert supply.licence_faults(PAGE, supply_lock.names(), PROJECT) == []


@pytest.mark.parametrize(
    ("line", "instead", "told"),
    [
        (r"\| numpy \|.*\n", "", "numpy is not listed"),
        (r"(\| numpy \|[^|]*\|)[^|]*\|[^|]*\|", r"\1 GPL-3.0-or-later | strong copyleft |", "numpy: GPL-3.0-or-later"),
        (r"(\| typst \|)[^|]*\|", r"\1 0.1 |", "typst is listed at 0.1"),
        (r"(\| cvxopt \|.*\|)[^|]*\|\n", r"\1 running it |\n", "cvxopt: GPL"),
        (r"(\| ruff \|[^|]*\|)[^|]*\|[^|]*\|", r"\1 Own-Licence | unknown |", "nobody knows its licence"),
        (r"(\| ruff \|)", r"| ruffian | 1 | MIT | permissive | test |\n\1", "ruffian is listed and not locked"),
    ],
)
def test_a_list_that_is_wrong_is_seen(line: str, instead: str, told: str) -> None:
    start = PAGE.index(supply.LIST[0])
    changed = PAGE[:start] + re.sub(line, instead, PAGE[start:], count=1)
    assert changed != PAGE
    assert any(told in one for one in supply.licence_faults(changed, supply_lock.names(), PROJECT))


@pytest.mark.parametrize(
    ("expression", "kind"),
    [
        ("MIT", "permissive"), ("BSD-3-Clause AND 0BSD", "permissive"), ("MIT AND GPL-3.0-only", "strong copyleft"),
        ("MIT OR GPL-3.0-only", "permissive"), ("(MIT OR GPL-2.0-only) AND MPL-2.0", "weak copyleft"),
        ("MIT OR GPL-3.0-only AND MPL-2.0", "permissive"), ("AGPL-3.0-only", "strong copyleft"),
        ("GPL-3.0-or-later WITH GCC-exception-3.1", "weak copyleft"), ("Mine", "unknown"), ("UNKNOWN", "unknown"),
    ],
)  # fmt: skip
def test_licences_are_judged(expression: str, kind: str) -> None:
    assert supply_licences.judge(expression) == kind


def test_the_list_says_what_is_installed() -> None:
    """The list was made from metadata; those here must still say the same."""
    known = supply_licences.installed([Path(place) for place in sys.path if place.endswith("site-packages")])
    listed = supply_licences.listed(PAGE)
    assert {
        name: (known[name], listed[name][1]) for name in known if name in listed and known[name] != listed[name][1]
    } == {}


def test_the_table_of_the_smallest_set_is_whole() -> None:
    rows = re.findall(r"^\| ([a-z0-9, -]+) \| [^|]+ \| [^|]+ \|$", PAGE, re.MULTILINE)
    assert {name for row in rows for name in row.split(", ")} >= supply_imports.declared(PROJECT)[""]


@pytest.fixture(scope="module")
def imported() -> list[supply_imports.Import]:
    return supply_imports.imports(supply_imports.sources())


def test_what_is_imported_is_declared_and_what_is_declared_is_imported(imported: list[supply_imports.Import]) -> None:
    assert supply_imports.faults(PROJECT, imported) == []


@pytest.mark.parametrize(
    ("file", "line", "told"),
    [
        ("maglev_ctrl/analysis/new.py", "import requests", "requests is imported and not declared"),
        ("maglev_ctrl/analysis/new.py", "def late():\n    from bokeh.plotting import figure", "not this file's"),
        ("maglev_ctrl/report/new.py", "from importlib import import_module\nimport_module('yaml')", "yaml is imported"),
    ],
)
def test_an_import_that_is_not_declared_is_seen(
    file: str, line: str, told: str, imported: list[supply_imports.Import]
) -> None:
    assert any(told in one for one in supply_imports.faults(PROJECT, imported + supply_imports.imports([(file, line)])))


def test_a_dependency_that_nobody_imports_is_seen(imported: list[supply_imports.Import]) -> None:
    changed = copy.deepcopy(PROJECT)
    changed["project"]["dependencies"].append("requests>=2")
    assert "requests: declared and never imported" in supply_imports.faults(changed, imported)


def test_carried_packages_really_come_with_theirs() -> None:
    needs = supply_lock.needs(LOCK)
    assert {name: carrier for name, carrier in supply_imports.CARRIED.items() if name not in needs[carrier]} == {}


BILL: dict[str, Any] = {
    "$schema": "http://cyclonedx.org/schema/bom-1.6.schema.json", "bomFormat": "CycloneDX", "specVersion": "1.6",
    "metadata": {"component": {"type": "application", "name": "maglev-ctrl"}},
    "components": [
        {"type": "library", "name": "NumPy", "version": "2.0", "purl": "pkg:pypi/numpy@2.0", "bom-ref": "numpy"},
    ],
}  # fmt: skip


def test_a_bill_is_judged() -> None:
    assert supply_bom.bom_faults(json.dumps(BILL), {"numpy"}) == []


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda bill: bill["components"].clear(), "numpy is missing"),
        (lambda bill: bill["components"][0].pop("version"), "numpy has no version"),
        (lambda bill: bill["components"][0].update(colour="red"), "Additional properties"),
        (lambda bill: bill.update(specVersion="9"), "not CycloneDX 1.6"),
        (lambda bill: bill["components"][0].update(description="file:///home/a"), "names a place on this machine"),
        (lambda bill: bill["metadata"]["component"].update(name="other"), "of another thing"),
        (
            lambda bill: bill["components"][0].update(externalReferences=[{"type": "vcs", "url": "not a place"}]),
            "vcs|url",
        ),
        (lambda bill: bill.pop("components"), "no bill of materials"),
    ],
)
def test_a_bill_that_is_wrong_is_seen(change: Callable[[dict[str, Any]], object], told: str) -> None:
    bill = copy.deepcopy(BILL)
    change(bill)
    found = supply_bom.bom_faults(json.dumps(bill), {"numpy"})
    assert any(re.search(told, one) for one in found), found


def test_places_of_an_editable_installation_are_left_out() -> None:
    told = {"externalReferences": [{"url": "file:///home/a"}, {"url": "https://example.org"}], "list": [{"a": 1}]}
    assert supply_bom.without_places(told) == {
        "externalReferences": [{"url": "https://example.org"}],
        "list": [{"a": 1}],
    }


def answering(canary: supply_bom.Audit, rest: supply_bom.Audit) -> Callable[..., supply_bom.Audit]:
    return lambda pins, _service, *, seconds: canary if pins == [supply_bom.CANARY] else rest


KNOWS = supply_bom.Audit(1, (), ("jinja2 3.1.2: CVE-2024-22195",))
NOBODY = supply_bom.Audit(0, (), (), "no route")


@pytest.mark.parametrize(
    ("canary", "rest", "words"),
    [
        (NOBODY, supply_bom.Audit(2, (), ()), "SKIPPED: no route; no route; nothing is known about any package"),
        (supply_bom.Audit(1, (), ()), supply_bom.Audit(2, (), ()), "SKIPPED: pypi does not know a flaw of jinja2==3.1"),
        (KNOWS, NOBODY, "SKIPPED: no route"), (KNOWS, supply_bom.Audit(2, (), ()), "no known flaw in 2 packages"),
        (KNOWS, supply_bom.Audit(2, ("b",), ()), "PARTLY: no known flaw in 2 packages; 1 were not asked about: b"),
        (KNOWS, supply_bom.Audit(2, (), ("b 1: X-1",)), "FLAWED: b 1: X-1"),
    ],
)  # fmt: skip
def test_an_audit_says_no_more_than_it_asked(canary: supply_bom.Audit, rest: supply_bom.Audit, words: str) -> None:
    found = supply_bom.audit({"a": {"1"}, "b": {"1"}}, asking=answering(canary, rest))
    assert found.words.startswith(words)
    assert "no known flaw" not in found.words or found.asked


@pytest.mark.parametrize(
    ("rest", "met"),
    [(NOBODY, None), (supply_bom.Audit(2, ("b",), ()), None), (supply_bom.Audit(2, (), ()), True),
     (supply_bom.Audit(2, (), ("b 1: X-1",)), False)],
)  # fmt: skip
def test_nobody_to_ask_is_no_pass_and_no_fault(
    rest: supply_bom.Audit, met: bool | None, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(supply_bom, "audit", lambda _locked: rest)
    file = tmp_path / "record.json"
    assert supply.main(["--audit", "--record", str(file)]) == (1 if met is False else 0)
    told = json.loads(file.read_text(encoding="utf-8"))
    assert [one["met"] for one in told["figures"]] == ([] if met is None else [met])
    assert bool(told["notes"]) == (met is None)


def test_a_package_that_was_passed_over_was_not_asked_about() -> None:
    """What pip-audit answers, with exit status 0, where the index tells nothing of flaws."""
    told = '{"dependencies": [{"name": "jinja2", "skip_reason": "not found on PyPI"}], "fixes": []}'
    found = supply_bom.read_answer(told)
    assert (found.asked, found.unasked, found.flawed) == (0, ("jinja2",), ())


def test_every_version_is_asked_about() -> None:
    asked: list[str] = []

    def asking(pins: list[str], _service: str, *, seconds: float) -> supply_bom.Audit:
        asked.extend(pins)
        names = [pin.partition("==")[0] for pin in pins]
        assert len(set(names)) == len(names)
        return KNOWS if pins == [supply_bom.CANARY] else supply_bom.Audit(len(pins), (), ())

    locked = {"a": {"1", "2"}, "b": {"1"}}
    assert supply_bom.audit(locked, asking=asking).asked == 3
    assert set(asked[1:]) == {"a==1", "a==2", "b==1"}


GOOD = [*supply_smoke.NEEDED, "maglev_ctrl-1.dist-info/licenses/LICENSE"]


@pytest.mark.parametrize(
    ("names", "told"),
    [
        (GOOD, ""), ([name for name in GOOD if not name.endswith("py.typed")], "py.typed is missing"),
        (GOOD[:-1], "LICENSE is missing"), ([*GOOD, "tests/unit/test_a.py"], "does not belong into a wheel"),
        ([*GOOD, "maglev_ctrl/__pycache__/a.pyc"], "was made here"),
    ],
)  # fmt: skip
def test_what_is_in_a_wheel_is_judged(names: list[str], told: str) -> None:
    found = supply_smoke.content_faults(names, wheel=True)
    assert any(told in one for one in found) if told else found == []


@pytest.mark.parametrize("name", ["ci", "release"])
def test_workflows_ask_for_the_least(name: str) -> None:
    """Read as text: no shell text from outside, no write right but where a release is published."""
    text = (ROOT / ".github" / "workflows" / f"{name}.yml").read_text(encoding="utf-8")
    top = text[: text.index("jobs:")]
    assert "permissions:\n  contents: read" in top
    rights = set(re.findall(r"^ {6}([a-z-]+: write)", text, re.MULTILINE))
    assert rights == ({"id-token: write", "attestations: write"} if name == "release" else set())
    assert "pull_request_target" not in text and "secrets." not in text
    assert not re.search(r"run:.*\$\{\{ *(github|inputs)\.", text)
    assert text.count("actions/checkout@") == text.count("persist-credentials: false")
    for minor in supply_lock.PYTHONS:
        assert f'"{minor}"' in text
