"""Work of the numerics shared out over processes."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from typing import Any

from maglev_ctrl.errors import ModelError
from maglev_ctrl.fields.spread import Spread, one_by_one
from maglev_ctrl.study.workers import Lost, shared

BLAS_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")


def spread_over(jobs: int) -> Spread:
    """Shares items out over processes; one job works in this process.

    Sparse factorisation holds the interpreter's lock, so that threads would not help.

    Parameters
    ----------
    jobs : processes; with more than one, call from under `if __name__ == "__main__":` as for any process pool

    Raises
    ------
    ValueError : jobs is below one

    Examples
    --------
    >>> list(spread_over(1)(abs, [-1, 2]))
    [(0, 1), (1, 2)]
    """
    if jobs < 1:
        raise ValueError(f"jobs: expected one or more, got {jobs}")
    return one_by_one if jobs == 1 else _Processes(jobs)


@dataclass(frozen=True, slots=True)
class _Processes:
    """A spread over a number of processes."""

    count: int

    def __call__(self, task: Callable[[Any], Any], items: Sequence[Any], /) -> Iterator[tuple[int, Any]]:
        """Every item's result as it comes; a process that dies ends the whole."""
        with one_blas_thread(), closing(shared(task, items, workers=self.count)) as results:
            for position, result in results:
                if isinstance(result, Lost):
                    raise ModelError(f"the forces cannot be computed: {result.reason.removeprefix('not studied: ')}")
                yield position, result


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Environment for new processes, put back afterwards."""
    before = {name: os.environ.get(name) for name in BLAS_THREADS}
    os.environ.update(dict.fromkeys(BLAS_THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
