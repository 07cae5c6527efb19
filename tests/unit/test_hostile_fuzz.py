"""The long run of tests/hold/fuzz.py for seconds: changed files of every kind, and a faulty reader it must find."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

HOLD = Path(__file__).resolve().parents[1] / "hold"


SECONDS = """
import json, sys
from pathlib import Path
from fuzz_child import Child, run_plain

told, folder = {}, Path(sys.argv[1])
for kind, inputs in (("scenario", 150), ("csv", 300), ("certificate", 300), ("design", 300), ("report", 500)):
    child = Child(kind, folder / kind, folder / "keep", 1e9)
    run_plain(child, inputs, 3, folder / "none")
    found = [(one["what"], one["place"], one["details"]) for one in child.found.values()]
    told[kind] = {"inputs": child.done, "found": found, **child.target.outcomes, "slowest": child.slowest[0]}
print(json.dumps(told), flush=True)
"""


FAULTY = """
import os, sys, time
from pathlib import Path
import fuzz_child, fuzz_targets
from fuzz_child import Child

def careless(self):
    content = self._content
    if b"boom" in content: raise KeyError("boom")
    if b"quiet" in content: raise fuzz_targets.MaglevError("")
    if b"loud" in content: raise fuzz_targets.MaglevError("x" * 30000)
    if b"steer" in content: raise fuzz_targets.MaglevError("a\\x1b[31mb")
    if b"write" in content: Path(sys.argv[1], "outside.txt").write_text("x")
    if b"remove" in content: os.remove(Path(sys.argv[1], "given.txt"))
    if b"read" in content: Path(sys.argv[1], "given2.txt").read_text()
    if b"start" in content: os.system("true")
    if b"run" in content: eval("1 + 1")
    if b"slow" in content: fuzz_child.SLOW = 0.0

folder = Path(sys.argv[1])
(folder / "given.txt").write_text("x")
(folder / "given2.txt").write_text("x")
folder = Path(sys.argv[1], "faults")
child = Child("csv", folder / "box", folder / "keep", 1e9)
fuzz_targets.Target._csv = careless
fuzz_targets.WHOLE = 2**40
child.target._reader = lambda: careless(child.target)
child.one(b"fine")
assert not child.found, child.found
for word in (b"boom", b"quiet", b"loud", b"steer", b"write", b"remove", b"read", b"start", b"run", b"slow"):
    before = len(child.found)
    child.one(word)
    assert len(child.found) > before, word
print("all seen")
"""


@pytest.fixture(scope="module")
def said(tmp_path_factory: pytest.TempPathFactory) -> subprocess.CompletedProcess[str]:
    """What both scripts say, in one process of their own: an audit hook stays for the life of a process."""
    if os.name == "nt":
        pytest.skip("memory is measured in another way there")
    return subprocess.run(
        [sys.executable, "-c", SECONDS + FAULTY, str(tmp_path_factory.mktemp("fuzz"))],
        capture_output=True, text=True, timeout=300, env={**os.environ, "PYTHONPATH": str(HOLD)},
    )  # fmt: skip


def test_some_hundreds_of_every_kind_find_nothing(said: subprocess.CompletedProcess[str]) -> None:
    assert said.stdout, said.stderr[-3000:]
    for kind, told in json.loads(said.stdout.splitlines()[0]).items():
        assert told["found"] == [], (kind, told)
        assert told["inputs"] >= 150 and told["slowest"] < 10.0
        assert told["read"] > 5 and told["refused"] > 50, (kind, told)  # not all are refused at the door


def test_a_reader_with_faults_is_found_out(said: subprocess.CompletedProcess[str]) -> None:
    """Ten faults of ten kinds, one after the other, each of which the run has to see."""
    assert said.returncode == 0 and "all seen" in said.stdout, said.stderr[-3000:]
