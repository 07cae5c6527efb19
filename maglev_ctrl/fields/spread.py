"""How work is shared out: numerics ask for results, whoever calls them decides on processes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, Protocol

Progress = Callable[[float], None]
"""Told the fraction done, 0 to 1."""


class Spread(Protocol):
    """Runs a task on every item, in any order and perhaps in several processes: pairs of position and result."""

    def __call__(self, task: Callable[[Any], Any], items: Sequence[Any], /) -> Iterator[tuple[int, Any]]:
        """The task is picklable, and so are items and results."""
        ...


def one_by_one(task: Callable[[Any], Any], items: Sequence[Any], /) -> Iterator[tuple[int, Any]]:
    """Every item in turn, in this process.

    Examples
    --------
    >>> list(one_by_one(abs, [-1, 2]))
    [(0, 1), (1, 2)]
    """
    return ((position, task(item)) for position, item in enumerate(items))


def in_order(
    task: Callable[[Any], Any], items: Sequence[Any], *, spread: Spread, progress: Progress | None = None
) -> list[Any]:
    """Results in the order of the items, with progress told after each.

    Examples
    --------
    >>> in_order(abs, [-1, 2], spread=one_by_one)
    [1, 2]
    """
    found: dict[int, Any] = {}
    for position, result in spread(task, items):
        found[position] = result
        if progress is not None:
            progress(len(found) / len(items))
    return [found[position] for position in range(len(items))]
