"""Blocks of a sweep on the processors of this machine."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from typing import Final

from maglev_ctrl.study.spread import one_blas_thread
from maglev_ctrl.study.sweep.records import SweepBlock
from maglev_ctrl.study.workers import Lost, shared

ATTEMPTS: Final = 3
"""How often a block may cost a process its life before its points are told as failed."""

Compute = Callable[[int], SweepBlock]


def on_this_machine(compute: Compute, blocks: Sequence[int], *, jobs: int) -> Iterator[tuple[int, SweepBlock | Lost]]:
    """Blocks in the order they come. A process that dies loses the block it was at, which another one takes up.

    Parameters
    ----------
    compute : a block from its index; with more than one process of a module's top level
    blocks : indices
    jobs : processes; one computes in this one

    Raises
    ------
    ModelError : the processes cannot start
    """
    if jobs == 1:
        for index in blocks:
            yield index, compute(index)
        return
    with one_blas_thread(), closing(shared(compute, list(blocks), workers=jobs, attempts=ATTEMPTS)) as results:
        for position, found in results:
            yield blocks[position], found
