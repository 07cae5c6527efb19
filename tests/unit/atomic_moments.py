"""A piece of work stopped at every one of its moments, and a look at the folder after each."""

from __future__ import annotations

import errno
import os
import shutil
import signal
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any

import maglev_ctrl.files
import maglev_ctrl.report.folder
import maglev_ctrl.report.swap

WRITERS = frozenset(
    str(module.__file__) for module in (maglev_ctrl.files, maglev_ctrl.report.folder, maglev_ctrl.report.swap)
)
CALLS = (
    "chown", "fsync", "link", "mkdir", "open", "rename", "replace", "rmdir", "unlink", "utime",
)  # fmt: skip
"""What the system may refuse."""

State = dict[str, bytes]
Work = Callable[[], object]


def state(folder: Path) -> State:
    """Every file below a folder with its content, and every folder; empty where there is none."""
    found: State = {}
    for path in sorted(folder.rglob("*")) if folder.is_dir() else ():
        found[str(path.relative_to(folder))] = b"/" if path.is_dir() else path.read_bytes()
    return found


@contextmanager
def blow(at: int, strike: Callable[[], None], *, opcodes: bool = False) -> Iterator[list[int]]:
    """Count lines (or instructions) of the writing modules as they run, and strike before the one with number `at`."""
    count = [0]

    def local(frame: FrameType, event: str, _argument: Any) -> Any:
        if event == ("opcode" if opcodes else "line"):
            count[0] += 1
            if count[0] == at:
                strike()
        return local

    def tracer(frame: FrameType, _event: str, _argument: Any) -> Any:
        if frame.f_code.co_filename not in WRITERS:
            return None
        frame.f_trace_opcodes = opcodes
        return local

    before = sys.gettrace()
    sys.settrace(tracer)
    try:
        yield count
    finally:
        sys.settrace(before)


def moments(work: Work, *, opcodes: bool = False) -> int:
    """How many moments a piece of work has."""
    with blow(0, lambda: None, opcodes=opcodes) as count:
        work()
    return count[0]


def interrupt() -> None:
    """What Ctrl-C does, at this moment."""
    raise KeyboardInterrupt


def kill() -> None:
    """What kill -9 does, at this moment."""
    os.kill(os.getpid(), signal.SIGKILL)


def in_a_process(work: Work) -> int:
    """Run work in a process of its own; its signal, or 0 where it came to its end."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the child only writes files and ends
        child = os.fork()
    if child == 0:
        status = 1
        try:
            work()
            status = 0
        finally:
            os._exit(status)
    _, status = os.waitpid(child, 0)
    if os.WIFSIGNALED(status):
        return os.WTERMSIG(status)
    if os.WEXITSTATUS(status) != 0:
        raise RuntimeError("the process failed")
    return 0


def killed(work: Work, at: int, *, opcodes: bool = False) -> bool:
    """Run work in a process that is killed before its moment number `at`; False where it ended before."""

    def until() -> None:
        with blow(at, kill, opcodes=opcodes):
            work()

    return in_a_process(until) == signal.SIGKILL


@contextmanager
def refusing(at: int, number: int, *, ever: bool = False, only: tuple[str, ...] = CALLS) -> Iterator[list[str]]:
    """Let the `at`-th call that changes something on the disk fail, or all from there on.

    Gives the calls that were made.
    """
    made: list[str] = []
    kept = {name: getattr(os, name) for name in only if hasattr(os, name)}
    exchange = maglev_ctrl.report.swap._exchange

    def counted(name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        def replaced(*values: Any, **named: Any) -> Any:
            made.append(name)
            if len(made) == at or (ever and at and len(made) > at):
                if number < 0:
                    raise KeyboardInterrupt
                raise OSError(number, os.strerror(number), str(values[0]))
            return call(*values, **named)

        return replaced

    for name, call in kept.items():
        setattr(os, name, counted(name, call))
    maglev_ctrl.report.swap._exchange = counted("exchange", exchange)
    try:
        yield made
    finally:
        for name, call in kept.items():
            setattr(os, name, call)
        maglev_ctrl.report.swap._exchange = exchange


NUMBERS = (errno.ENOSPC, errno.EIO, errno.EACCES, -1)
"""Disk full, disk broken, no right, and an interrupt inside the call."""


def set_up(folder: Path, content: State | None) -> None:
    """Make a folder be exactly this, and nothing beside it."""
    shutil.rmtree(folder.parent, ignore_errors=True)
    folder.parent.mkdir(parents=True)
    if content is None:
        return
    folder.mkdir()
    for name, one in content.items():
        if one == b"/":
            (folder / name).mkdir()
        else:
            (folder / name).write_bytes(one)
