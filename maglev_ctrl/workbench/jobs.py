"""Reports being made and made before: one process each, known to the whole server by the scenario's hash."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, Literal

from maglev_ctrl.workbench.sources import file_stem

FILES: Final = {
    "report.html": "text/html; charset=utf-8", "report.pdf": "application/pdf", "report.json": "application/json",
    "tuned.toml": "text/plain; charset=utf-8",
}  # fmt: skip
"""What of a report's folder the page hands out, by name, and as what."""
RUNNING_LIMIT: Final = 2
_COMMAND: Final = (sys.executable, "-m", "maglev_ctrl.workbench.report_process")
_HASH_LENGTH: Final = 12
_GRACE = 3.0  # s a process has to end by itself

Status = Literal["none", "running", "done", "failed", "cancelled"]


@dataclass(frozen=True, slots=True)
class JobView:
    """A report as the page shows it: `fraction` 0 to 1, `left` seconds (None: not known yet), names of its `files`."""

    status: Status
    words: str = ""
    fraction: float = 0.0
    left: float | None = None
    folder: str = ""
    files: tuple[str, ...] = ()


@dataclass(eq=False, slots=True)
class _Job:
    """One process and what it told last."""

    folder: str
    process: subprocess.Popen[str]
    began: float
    status: Status = "running"
    words: str = "starting"
    fraction: float = 0.0
    told: float = 0.0
    lock: threading.Lock = field(default_factory=threading.Lock)


class ReportJobs:
    """Every report of a server; a page that lost its connection, and a second page, find theirs again.

    Parameters
    ----------
    folder : where reports go, each into NAME-HASH; made with the first
    command : what makes one; it reads an order from its input and tells JSON lines, as `report_process` does
    """

    def __init__(self, folder: Path, *, command: Sequence[str] = _COMMAND) -> None:
        self.folder = folder
        self._command = tuple(command)
        self._jobs: dict[str, _Job] = {}
        self._lock = threading.Lock()
        self._closed = False

    def start(self, text: str, *, path: Path, name: str, scenario_hash: str, workers: int = 2) -> JobView:
        """Begin a report, unless it is being made already.

        Parameters
        ----------
        path : where the text counts as lying, for the data files it names

        Raises
        ------
        ValueError : why it cannot begin, in words
        """
        folder = report_folder(name, scenario_hash)
        with self._lock:
            known = self._jobs.get(folder)
            if known is not None and known.status == "running":
                return _view(known, self._files(folder))
            if self._closed or sum(job.status == "running" for job in self._jobs.values()) >= RUNNING_LIMIT:
                raise ValueError(f"{RUNNING_LIMIT} reports are being made already; wait for one, or cancel it")
            try:
                self.folder.mkdir(parents=True, exist_ok=True)
                process = _begin(self._command)
            except OSError as error:
                raise ValueError(f"the report cannot begin: {error.strerror or error}") from None
            job = _Job(folder, process, time.monotonic())
            self._jobs[folder] = job
        order = {"text": text, "path": str(path), "name": name, "folder": str(self.folder / folder), "jobs": workers}
        threading.Thread(target=_follow, args=(job, json.dumps(order)), daemon=True).start()
        return _view(job, ())

    def view(self, name: str, scenario_hash: str) -> JobView:
        """The report of a scenario as it stands, one of an earlier day included."""
        folder = report_folder(name, scenario_hash)
        job = self._jobs.get(folder)
        files = self._files(folder)
        if job is not None:
            return _view(job, files)
        if "report.html" in files:
            return JobView("done", "made before", 1.0, None, folder, files)
        return JobView("none", folder=folder)

    def cancel(self, name: str, scenario_hash: str) -> None:
        """End the process of a report; what an earlier one wrote stays."""
        job = self._jobs.get(report_folder(name, scenario_hash))
        if job is not None and job.status == "running":
            with job.lock:
                job.status, job.words = "cancelled", "cancelled; nothing was written"
            threading.Thread(target=_end, args=(job.process,), daemon=True).start()

    def close(self) -> None:
        """End every process; returns when they are gone."""
        with self._lock:
            self._closed = True
            running = [job for job in self._jobs.values() if job.process.poll() is None]
        for job in running:
            _ask_to_end(job.process)
        for job in running:
            _end(job.process)

    def file(self, folder: str, name: str) -> Path | None:
        """A file the page may hand out; None for everything else, above all for paths that lead elsewhere."""
        if name not in FILES or folder != file_stem(folder):
            return None
        found = (self.folder / folder / name).resolve()
        return found if found.is_file() and found.parent.parent == self.folder.resolve() else None

    def _files(self, folder: str) -> tuple[str, ...]:
        return tuple(name for name in FILES if self.file(folder, name) is not None)


def report_folder(name: str, scenario_hash: str) -> str:
    """Name of a report's folder.

    Examples
    --------
    >>> report_folder("../my car", "0123456789abcdef")
    'my_car-0123456789ab'
    """
    return f"{file_stem(name)[:40]}-{scenario_hash[:_HASH_LENGTH]}"


def _begin(command: Sequence[str]) -> subprocess.Popen[str]:
    """A process of a group of its own: Ctrl-C is the server's to hear, which then ends it in order."""
    flags = getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0)  # Windows only
    return subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, encoding="utf-8", creationflags=flags,
        start_new_session=os.name != "nt",
    )  # fmt: skip


def _follow(job: _Job, order: str) -> None:
    """Hand over the order and note what the process tells, to its end."""
    process = job.process
    assert process.stdin is not None and process.stdout is not None
    with suppress(OSError, ValueError):
        process.stdin.write(order + "\n")
        process.stdin.flush()
    fault, finished = "", False
    for line in process.stdout:
        try:
            told = json.loads(line)
        except ValueError:
            continue  # a library's own words
        if not isinstance(told, dict):
            continue
        finished = finished or "done" in told
        fault = str(told.get("fault", fault))
        if "what" in told:
            with job.lock:
                job.words, job.fraction = str(told["what"]), min(1.0, max(0.0, float(told.get("fraction", 0.0))))
                job.told = time.monotonic()
    status = process.wait()
    process.stdout.close()
    with suppress(OSError):
        process.stdin.close()
    with job.lock:
        if job.status == "running":
            job.status = "done" if finished and status == 0 else "failed"
            job.words = _last_words(fault, status, seconds=time.monotonic() - job.began, done=job.status == "done")


def _last_words(fault: str, status: int, *, seconds: float, done: bool) -> str:
    if done:
        return f"made in {seconds:.0f} s"
    if fault:
        return fault
    how = "was ended from outside" if status < 0 else f"ended with status {status}"
    return f"the process that made the report {how}; nothing was written"


def _view(job: _Job, files: tuple[str, ...]) -> JobView:
    with job.lock:
        left = None
        if job.status == "running" and 0.03 <= job.fraction < 1.0:
            spent = job.told - job.began  # at the moment the fraction was told
            left = max(0.0, spent * (1.0 - job.fraction) / job.fraction - (time.monotonic() - job.told))
        return JobView(job.status, job.words, job.fraction, left, job.folder, files)


def _ask_to_end(process: subprocess.Popen[str]) -> None:
    """A closed input is the word to end, for it is heard on every system."""
    if process.stdin is not None:
        with suppress(OSError):
            process.stdin.close()


def _end(process: subprocess.Popen[str]) -> None:
    _ask_to_end(process)
    try:
        process.wait(_GRACE)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait(_GRACE)
