"""Tasks shared by processes that never outlive this one: an interrupt ends them all, a killed one is noticed."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from types import FrameType
from typing import Any, TypeVar

from maglev_ctrl.errors import ModelError

_CONTEXT = multiprocessing.get_context("spawn")
_READY = "ready"
_CURE = 'use one process only (--jobs 1); in a script, call run() from under `if __name__ == "__main__":`'
Item = TypeVar("Item")
Result = TypeVar("Result")


@dataclass(frozen=True, slots=True)
class Lost:
    """Stands for the result of a task whose process died."""

    reason: str


@dataclass(eq=False, slots=True)
class _Worker:
    process: SpawnProcess
    pipe: Connection
    ready: bool = False
    task: int | None = None  # what it works on


def shared(
    task: Callable[[Item], Result], items: Sequence[Item], *, workers: int, attempts: int = 1
) -> Generator[tuple[int, Result | Lost], None, None]:
    """Results in the order they come, each with the position of its item.

    A process that dies loses only the task it was at, which is begun again up to `attempts` times and `Lost` then.
    Another process takes its place, or the others go on without it. However this ends, by the last result, an exception
    or an interrupt, no process is left behind.

    Parameters
    ----------
    task : of a module's top level, so that a new process can import it
    workers : number of processes, one or more
    attempts : how often a task is begun

    Raises
    ------
    ModelError : the processes cannot start
    Exception : whatever the task raised
    """
    waiting, begun = list(range(len(items)))[::-1], dict[int, int]()
    team: list[_Worker] = []
    try:
        for _ in range(min(workers, len(items))):
            _join_team(team, task)
        while waiting or any(worker.task is not None for worker in team):
            for pipe in wait([worker.pipe for worker in team]):
                worker = next(one for one in team if one.pipe is pipe)
                try:
                    message = worker.pipe.recv()
                except (EOFError, OSError):
                    for position, lost in _loss(team, worker):
                        if begun[position] < attempts:
                            waiting.append(position)  # at once: it may be the last one
                        else:
                            yield position, lost
                    _hand_out(team, waiting, begun, items)  # there may be some with nothing to do
                    if waiting and worker.ready:
                        _join_team(team, task)
                    elif not team:
                        yield from _rest(waiting, worker, none_done=len(waiting) == len(items))
                        return
                    continue
                yield from _result(worker, message)
                _hand_out(team, waiting, begun, items)
    finally:
        _dismiss(team)


def _hand_out(team: list[_Worker], waiting: list[int], begun: dict[int, int], items: Sequence[Any]) -> None:
    """A task for every process that has none, as far as there are any."""
    for worker in team:
        if waiting and worker.ready and worker.task is None:
            worker.task = waiting.pop()
            begun[worker.task] = begun.get(worker.task, 0) + 1
            with suppress(OSError):  # a death in between is seen at the next turn
                worker.pipe.send(items[worker.task])


def _join_team(team: list[_Worker], task: Callable[..., Any]) -> None:
    """Start one more process."""
    with _unheard_interrupts():
        ours, theirs = _CONTEXT.Pipe()
        process = _CONTEXT.Process(target=_work, args=(theirs, task), daemon=True)
        try:
            process.start()
        finally:
            theirs.close()  # the process's end of the pipe closes with it, which is how its death is noticed
        team.append(_Worker(process, ours))


def _loss(team: list[_Worker], worker: _Worker) -> Iterator[tuple[int, Lost]]:
    team.remove(worker)
    worker.pipe.close()
    worker.process.join(5.0)
    if worker.task is not None:
        how = _ending(worker.process.exitcode)
        reason = f"not studied: its process {how}; where memory is short, use fewer processes (--jobs 1)"
        yield worker.task, Lost(reason)


def _rest(waiting: list[int], last: _Worker, *, none_done: bool) -> Iterator[tuple[int, Lost]]:
    """What becomes of the tasks not begun when no process is left and none can start."""
    how = _ending(last.process.exitcode)
    if none_done:
        raise ModelError(f"the processes for the study cannot start: one {how}; {_CURE}")
    yield from ((position, Lost(f"not studied: its process {how}")) for position in waiting)


def _result(worker: _Worker, message: Any) -> Iterator[tuple[int, Any]]:
    if message == _READY:
        worker.ready = True
        return
    fault, value = message
    if fault is not None:
        raise fault
    position, worker.task = worker.task, None
    assert position is not None
    yield position, value


def _ending(status: int | None) -> str:
    if status is not None and status < 0:
        try:
            return f"was killed ({signal.Signals(-status).name})"
        except ValueError:
            pass
    return f"ended with status {status}"


def _dismiss(team: list[_Worker]) -> None:
    """End every process at once: they hold nothing that has to be saved."""
    for worker in team:
        worker.process.kill()
    for worker in team:
        worker.process.join(2.0)
        worker.pipe.close()


def _work(pipe: Connection, task: Callable[[Any], Any]) -> None:
    """Life of a process: tasks until it is ended."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches every process; the first one ends the others
    threading.Thread(target=_end_with_parent, daemon=True).start()
    pipe.send(_READY)
    while True:
        try:
            item = pipe.recv()
        except EOFError:
            return
        message: tuple[Exception | None, Any]
        try:
            message = (None, task(item))
        except Exception as fault:
            message = (fault, None)
        try:
            pipe.send(message)
        except BrokenPipeError:
            return
        except Exception as fault:  # what cannot be sent
            pipe.send((RuntimeError(f"{type(fault).__name__}: {fault}"), None))


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)


@contextmanager
def _unheard_interrupts() -> Iterator[None]:
    """Ctrl-C waits until the block is done, and a process started in it never hears one, not even while it imports."""
    if os.name == "nt" or threading.current_thread() is not threading.main_thread():
        yield  # without signal masks, or without the right to handlers, the process ignores it once it runs
        return
    from multiprocessing import resource_tracker

    heard: list[tuple[int, FrameType | None]] = []
    before = signal.signal(signal.SIGINT, lambda number, frame: heard.append((number, frame)))
    resource_tracker.ensure_running()  # before the mask: starting it lifts the mask
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        signal.signal(signal.SIGINT, before)
        if heard and callable(before):
            before(*heard[0])
