"""Shared tasks: results, a process that dies, and an interrupt as a terminal sends it, to the whole process group."""

from __future__ import annotations

import math
import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from maglev_ctrl.errors import ModelError, Verdict
from maglev_ctrl.scenario import Scenario
from maglev_ctrl.study import run, workers
from maglev_ctrl.study.workers import Lost, shared

ROOT = Path(__file__).resolve().parents[2]
posix = pytest.mark.skipif(os.name == "nt", reason="process groups and these signals are POSIX")


def test_every_item_has_its_result() -> None:
    assert dict(shared(math.sqrt, [0.0, 1.0, 4.0, 9.0], workers=2)) == {0: 0.0, 1: 1.0, 2: 2.0, 3: 3.0}
    assert multiprocessing.active_children() == []


@posix
def test_a_killed_process_loses_its_task_only() -> None:
    found = dict(shared(signal.raise_signal, [0, signal.SIGKILL, 0, signal.SIGKILL, 0], workers=2))
    assert sorted(found) == [0, 1, 2, 3, 4]
    assert [position for position, result in found.items() if isinstance(result, Lost)] in ([1, 3], [3, 1])
    assert isinstance(found[1], Lost) and "its process was killed (SIGKILL)" in found[1].reason
    assert multiprocessing.active_children() == []


def test_a_fault_of_the_task_is_raised_and_ends_the_processes() -> None:
    with pytest.raises(ValueError, match="math domain"):
        list(shared(math.sqrt, [1.0, -1.0], workers=2))
    assert multiprocessing.active_children() == []


def test_processes_that_cannot_start_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(workers, "_work", math.sqrt)  # called with two arguments: ends at once, before it is ready
    with pytest.raises(ModelError, match="cannot start: one ended with status 1; use one process only"):
        list(shared(math.sqrt, [1.0, 4.0], workers=2))
    assert multiprocessing.active_children() == []


def test_a_lost_option_is_recorded_with_its_reason(
    small_scenario: Callable[..., Scenario], monkeypatch: pytest.MonkeyPatch
) -> None:
    def lose(task: object, items: tuple[object, ...], *, workers: int) -> Iterator[tuple[int, Lost]]:
        yield from ((position, Lost("its process was killed")) for position in range(len(items)))

    monkeypatch.setattr(sys.modules["maglev_ctrl.study.run"], "shared", lose)  # the package has a function run too
    comparison = run(small_scenario(), jobs=2)
    for option in comparison.options:
        assert option.failure == "its process was killed" and option.verdict is Verdict.NOT_EVALUATED
        assert {result.reason for result in option.requirements} == {"its process was killed"}


@posix
@pytest.mark.skipif(shutil.which("ps") is None, reason="ps tells which processes are left")
@pytest.mark.parametrize(
    ("command", "delay"), [([sys.executable, "-m", "maglev_ctrl"], 2.0), ([sys.executable, "dev.py"], 4.0)]
)
def test_one_interrupt_ends_everything(command: list[str], delay: float, tmp_path: Path) -> None:
    if command[-1] == "dev.py" and not (ROOT / ".venv" / "maglev-ctrl-setup").exists():
        pytest.skip("dev.py has not set this place up")
    (tmp_path / "report.html").write_text("earlier", encoding="utf-8")
    process = subprocess.Popen(
        [*command, "report", "scenarios/compare/eds_135t.toml", "--out", str(tmp_path), "--jobs", "2"],
        cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip
    try:
        time.sleep(delay)
        os.killpg(process.pid, signal.SIGINT)
        out, err = process.communicate(timeout=5.0)
        assert process.returncode == 130
        assert out == ""
        assert [line for line in err.splitlines() if "%" not in line] == ["interrupted; nothing was written"]
        assert (tmp_path / "report.html").read_text(encoding="utf-8") == "earlier"
        assert [file.name for file in tmp_path.iterdir()] == ["report.html"]
        assert _group_is_empty(process.pid)
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
            process.communicate()


def _group_is_empty(group: int) -> bool:
    """Whether no process of the group runs; what has ended and was not collected yet does not count."""
    for _ in range(20):
        listed = subprocess.run(["ps", "-e", "-o", "pgid=,stat="], capture_output=True, text=True, check=True).stdout
        if not [line for line in listed.splitlines() if line.split()[0] == str(group) and " Z" not in line]:
            return True
        time.sleep(0.05)
    return False
