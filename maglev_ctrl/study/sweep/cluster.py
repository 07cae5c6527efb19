"""Blocks of a sweep on a Dask cluster: the same code, somebody else's processors.

The cluster may lose workers, and its scheduler: blocks that are not back yet are sent again. Dask sends Python objects
between its processes, so its workers and its scheduler are trusted ground; see docs/guides/run_on_cluster.md.
"""

from __future__ import annotations

import logging
import queue
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final
from uuid import uuid4

from maglev_ctrl.errors import ModelError
from maglev_ctrl.study.sweep.identity import code_identity
from maglev_ctrl.study.sweep.local import ATTEMPTS, Compute
from maglev_ctrl.study.sweep.records import SweepBlock
from maglev_ctrl.study.sweep.worker import Prepared, Refused, compute_block, differences
from maglev_ctrl.study.workers import Lost

if TYPE_CHECKING:
    from distributed import Client

PATIENCE: Final = 600.0
"""Seconds a cluster that went away is waited for."""
_CONNECT = 10.0  # s for one attempt
_AHEAD = 2  # blocks at a worker beside the one it computes
_LOOK = 1.0  # s between two looks at the cluster
_FETCH = 60.0  # s for a result to come over the network
Say = Callable[[str], None]


def on_cluster(
    compute: Compute, blocks: Sequence[int], *, address: str, say: Say = lambda what: None, patience: float = PATIENCE
) -> Iterator[tuple[int, SweepBlock | Lost]]:
    """Blocks in the order they come from the workers of a scheduler.

    Parameters
    ----------
    compute : a block from its index, of a module's top level
    address : of the scheduler, such as "tcp://127.0.0.1:8786"
    say : told what happens to the cluster
    patience : seconds a scheduler that went away is waited for

    Raises
    ------
    ModelError : no scheduler at the address, workers with other code, or the cluster went away and stayed away
    """
    with _unheard():
        yield from _all_of(_Fleet(compute, list(blocks)[::-1], say), address, say, patience)


def _all_of(fleet: _Fleet, address: str, say: Say, patience: float) -> Iterator[tuple[int, SweepBlock | Lost]]:
    """Results until all are there, over as many connections as it takes."""
    client: Client | None = _connected(address, first=True)
    gone_since: float | None = None
    try:
        while not fleet.done:
            try:
                if client is None:
                    client = _connected(address, first=False)
                for found in fleet.results(client):
                    gone_since = None
                    yield found
            except _Gone as fault:
                fleet.recall()
                _dismiss(client)
                client = None
                gone_since = time.monotonic() if gone_since is None else gone_since
                if time.monotonic() - gone_since > patience:
                    raise ModelError(f"{address}: the cluster went away and did not come back: {fault}") from None
                say(f"the scheduler is gone ({fault}); waiting for it")
                time.sleep(_LOOK)
    finally:
        fleet.cancel()
        _dismiss(client)


@contextmanager
def _unheard() -> Iterator[None]:
    """Dask logs every lost connection with its traceback; here they are told in words."""
    import distributed

    assert distributed is not None  # its import sets the levels
    loggers = [logging.getLogger(name) for name in ("distributed", "distributed.client", "tornado.application")]
    before = [one.level for one in loggers]
    for one in loggers:
        one.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        for one, level in zip(loggers, before, strict=True):
            one.setLevel(level)


class _Gone(Exception):
    """The scheduler does not answer."""


@dataclass(eq=False)
class _Fleet:
    """What is to do, what is on its way, and how often each block was lost."""

    compute: Compute
    waiting: list[int]
    say: Say
    name: str = field(default_factory=lambda: uuid4().hex)
    away: dict[str, tuple[int, Any]] = field(default_factory=dict)  # by key: block and future
    lost: dict[int, int] = field(default_factory=dict)
    back: queue.SimpleQueue[str] = field(default_factory=queue.SimpleQueue)
    sent: int = 0

    @property
    def done(self) -> bool:
        return not self.waiting and not self.away

    def results(self, client: Client) -> Iterator[tuple[int, SweepBlock | Lost]]:
        """Results as long as the scheduler answers.

        Raises
        ------
        _Gone : it does not
        ModelError : a worker has other code
        """
        _prepare(client, self.name, self.compute)
        room, looked = _room(client), time.monotonic()
        while not self.done:
            while self.waiting and len(self.away) < room:
                self._send(client, self.waiting.pop())
            with suppress(queue.Empty):
                key = self.back.get(timeout=_LOOK)
                if key in self.away:
                    yield from self._landed(key)
            if client.status != "running":
                raise _Gone("the connection broke")
            if time.monotonic() - looked > _LOOK:
                room, looked = _room(client), time.monotonic()
                if not room:
                    self.say("the cluster has no workers; waiting for them")

    def _send(self, client: Client, index: int) -> None:
        self.sent += 1
        key = f"maglev-ctrl-{self.name}-{index}-{self.sent}"
        try:
            future = client.submit(compute_block, self.name, index, key=key, pure=False)
        except Exception as fault:  # a client that is closing may raise anything
            self.waiting.append(index)
            raise _Gone(_short(fault)) from None
        self.away[key] = index, future
        future.add_done_callback(lambda done: self.back.put(done.key))

    def _landed(self, key: str) -> Iterator[tuple[int, SweepBlock | Lost]]:
        index, future = self.away.pop(key)
        if future.status in ("cancelled", "lost"):
            self.waiting.append(index)
            return
        try:
            found = future.result(timeout=_FETCH)
        except Refused as fault:
            raise ModelError(str(fault)) from None
        except Exception as fault:  # the worker died with it, or on the way; Dask tells in many ways
            self.lost[index] = self.lost.get(index, 0) + 1
            if self.lost[index] < ATTEMPTS:
                self.waiting.append(index)
                return
            yield index, Lost(f"not studied: lost {ATTEMPTS} times on the cluster, last with {_short(fault)}")
            return
        yield index, found

    def recall(self) -> None:
        """What was on its way is to do again."""
        self.waiting += sorted((index for index, _ in self.away.values()), reverse=True)
        self.away.clear()

    def cancel(self) -> None:
        """The workers need not go on."""
        futures: list[Any] = [future for _, future in self.away.values()]
        self.away.clear()
        for future in futures:
            with suppress(Exception):
                future.release()


def _prepare(client: Client, name: str, compute: Compute) -> None:
    """Give the task to every worker there is and every one that comes; none with other code takes part.

    Raises
    ------
    ModelError : a worker has other code, or cannot load it
    _Gone : the scheduler does not answer
    """
    from maglev_ctrl.study.sweep.plugin import TaskPlugin

    try:
        refused = client.run(differences, code_identity(), on_error="return")
        client.register_plugin(TaskPlugin(Prepared(name, compute, code_identity())), name=f"maglev-ctrl-{name}")
    except (OSError, TimeoutError) as fault:
        raise _Gone(_short(fault)) from None
    except Exception as fault:
        if client.status != "running":
            raise _Gone(_short(fault)) from None
        raise ModelError(f"the workers cannot take the sweep: {_short(fault)}") from None
    for worker, told in refused.items():
        if told and not isinstance(told, OSError):
            words = told if isinstance(told, str) else f"cannot load maglev_ctrl ({_short(told)})"
            raise ModelError(f"worker {worker} {words}; install the same version on every machine")


def require_scheduler(address: str) -> None:
    """Find out whether a scheduler answers.

    Raises
    ------
    ModelError : it does not
    """
    with _unheard():
        _dismiss(_connected(address, first=True))


def _connected(address: str, *, first: bool) -> Client:
    from distributed import Client

    try:
        return Client(address, timeout=_CONNECT, set_as_default=False, name="maglev-ctrl")
    except (OSError, TimeoutError, ValueError) as fault:
        if not first:
            raise _Gone(_short(fault)) from None
        raise ModelError(
            f"{address}: no Dask scheduler answers there ({_why(fault)}); `dask scheduler` starts one"
        ) from None


def _room(client: Client) -> int:
    """Blocks that may be on their way, some for every thread of the workers.

    Raises
    ------
    _Gone : the scheduler does not answer
    """
    try:
        return int(sum(client.nthreads().values())) * (1 + _AHEAD)
    except Exception as fault:
        raise _Gone(_short(fault)) from None


def _dismiss(client: Client | None) -> None:
    if client is not None:
        with suppress(Exception):
            client.close(timeout=2.0)


def _why(fault: BaseException) -> str:
    return "no connection" if isinstance(fault, OSError | TimeoutError) else _short(fault)


def _short(fault: BaseException) -> str:
    words = " ".join(str(fault).split())
    return (f"{type(fault).__name__}: {words}" if words else type(fault).__name__)[:160]
