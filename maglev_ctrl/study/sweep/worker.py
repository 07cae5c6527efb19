"""What happens in a worker of a cluster: it is given a sweep, computes blocks of it, and forgets it."""

from __future__ import annotations

import threading
from dataclasses import dataclass

from maglev_ctrl.study.sweep.identity import WORDS, code_identity
from maglev_ctrl.study.sweep.local import Compute
from maglev_ctrl.study.sweep.records import SweepBlock

_TASKS: dict[str, Compute] = {}
"""What this process computes, by the name of the sweep."""


class Refused(Exception):
    """A worker that must not take part."""


@dataclass(frozen=True, eq=False)
class Prepared:
    """What every worker of the sweep is given before its first block, those that come later too."""

    name: str
    compute: Compute
    code: dict[str, str]


def differences(wanted: dict[str, str]) -> str:
    """What differs from the code that asks."""
    here = code_identity()
    other = [WORDS[name] for name in wanted if here.get(name) != wanted[name]]
    return f"differs in {' and '.join(other)}" if other else ""


def take(prepared: Prepared) -> None:
    """Be ready for the blocks of a sweep."""
    from threadpoolctl import threadpool_limits

    threadpool_limits(limits=1)
    _TASKS[prepared.name] = prepared.compute if not differences(prepared.code) else _refuse


def forget(prepared: Prepared) -> None:
    """The sweep is over."""
    _TASKS.pop(prepared.name, None)


def _refuse(index: int) -> SweepBlock:
    raise Refused("a worker that came later has other code; install the same version on every machine")


_BUSY = threading.Lock()


def compute_block(name: str, index: int) -> SweepBlock:
    """One block. Blocks of one process go one after another: they share what it has designed."""
    with _BUSY:
        return _TASKS[name](index)
