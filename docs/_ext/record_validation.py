"""Run the tests that docs/validation.md names and keep what they said: python3 dev.py validation [TEST FILE ...]

With test files only these run, and the rest of the record stays as it is. The record is docs/_data/validation.json; the
page shows it, and says of which version and day each part is.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "validation.md"
RECORD = ROOT / "docs" / "_data" / "validation.json"
NAMED = re.compile(r"`(tests/[\w/]+\.py)(?:::(\w+))?`")

Record = dict[str, dict[str, Any]]
"""Test file -> version, commit, day, seconds, tests (name -> outcome -> count), errors (largest found, allowed)."""


def named_tests(text: str) -> list[tuple[str, str]]:
    """(file, test or '') of every test that a text names, each once, in order."""
    return list(dict.fromkeys(NAMED.findall(text)))


def read_results(text: str) -> dict[str, dict[str, Any]]:
    """What a run said, from pytest's JUnit XML: test file -> seconds, tests, errors.

    A test tells an error it measured with `record_property("error", found)` and `record_property("allowed", limit)`;
    of each test the error nearest to its limit is kept.
    """
    files: dict[str, dict[str, Any]] = {}
    for case in ElementTree.fromstring(text).iter("testcase"):
        # A class of tests stands behind its file's name.
        name = re.sub(r"(/Test\w*)+$", "", case.get("classname", "").replace(".", "/")) + ".py"
        kept = files.setdefault(name, {"seconds": 0.0, "tests": {}, "errors": {}})
        test = case.get("name", "").partition("[")[0]
        outcome = next((kind for kind in ("failure", "error", "skipped") if case.find(kind) is not None), "passed")
        outcome = {"failure": "failed", "error": "failed"}.get(outcome, outcome)
        counts = kept["tests"].setdefault(test, {})
        counts[outcome] = counts.get(outcome, 0) + 1
        kept["seconds"] = round(kept["seconds"] + float(case.get("time", 0.0)), 2)
        told = {one.get("name", ""): one.get("value", "") for one in case.iter("property")}
        if {"error", "allowed"} <= set(told):
            pair = [float(told["error"]), float(told["allowed"])]
            before = kept["errors"].get(test)
            if before is None or pair[0] / pair[1] > before[0] / before[1]:
                kept["errors"][test] = pair
    return files


def run(files: Iterable[str]) -> tuple[int, dict[str, dict[str, Any]]]:
    """Run test files; pytest's exit status and what the run said."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "results.xml"
        # The older family of the format is the one that has properties of a test.
        asked = ["-q", "-p", "no:cacheprovider", "-o", "junit_family=xunit1", f"--junit-xml={out}"]
        command = [sys.executable, "-m", "pytest", *asked, *files]
        status = subprocess.run(command, cwd=ROOT, check=False).returncode
        return status, read_results(out.read_text(encoding="utf-8")) if out.exists() else {}


def commit() -> str:
    """The commit of the working tree, '' where there is none; with '+' where files differ from it."""
    told = subprocess.run(
        ["git", "describe", "--always", "--dirty=+", "--exclude=*"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    return told.stdout.strip()


def main(chosen: list[str]) -> int:
    """Run, merge, write; 0 where every test passed or was skipped."""
    sys.path.insert(0, str(ROOT))
    from maglev_ctrl._version import __version__

    known = dict.fromkeys(file for file, _ in named_tests(PAGE.read_text(encoding="utf-8")))
    strangers = [file for file in chosen if file not in known]
    if strangers:
        print(f"{strangers[0]} is not named in docs/validation.md", file=sys.stderr)
        return 2
    status, found = run(chosen or known)
    record: Record = json.loads(RECORD.read_text(encoding="utf-8")) if RECORD.exists() else {}
    told = {"version": __version__, "commit": commit(), "day": datetime.now(UTC).date().isoformat()}
    record |= {file: told | results for file, results in found.items()}
    RECORD.parent.mkdir(parents=True, exist_ok=True)
    text = json.dumps({file: record[file] for file in sorted(record) if file in known}, indent=1)
    RECORD.write_text(text + "\n", encoding="utf-8")
    print(f"{len(found)} test files recorded in {RECORD.relative_to(ROOT)}")
    return status


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
