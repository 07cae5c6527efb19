"""Budgets of work that are counted, never timed: the same search ends at the same place on every machine.

One unit is about a microsecond of one core of 2020, estimated from the sizes of the matrices, whatever the clock says.
"""

from __future__ import annotations

import time

import numpy as np

_OVERHEAD = 60.0
_CUBED = 0.02


def matrix_cost(size: int) -> float:
    """Units for the eigenvalues of one dense complex matrix of `size`.

    Examples
    --------
    >>> matrix_cost(10)
    80.0
    """
    return _OVERHEAD + _CUBED * float(size) ** 3


class Work:
    """How much a search may still do: a count of units, and, only where asked for, an emergency stop by the clock.

    Parameters
    ----------
    limit : units
    time_limit : s from now; None: the clock is never looked at

    Raises
    ------
    ValueError : a limit is not positive

    Examples
    --------
    >>> whole = Work(100.0)
    >>> half = whole.part(0.5)
    >>> half.spend(60.0)
    >>> half.ended(), whole.ended(), whole.left
    (True, False, 40.0)
    """

    __slots__ = ("_above", "_deadline", "_limit", "_spent")

    def __init__(self, limit: float = np.inf, *, time_limit: float | None = None, above: Work | None = None) -> None:
        if not limit > 0.0:
            raise ValueError(f"limit: expected a positive number of units, got {limit!r}")
        if time_limit is not None and not time_limit > 0.0:
            raise ValueError(f"time_limit: expected a positive time in s or None, got {time_limit!r}")
        self._limit, self._spent, self._above = float(limit), 0.0, above
        self._deadline = None if time_limit is None else time.perf_counter() + time_limit

    def spend(self, amount: float) -> None:
        """Count `amount` units, here and in what this is a part of."""
        self._spent += amount
        if self._above is not None:
            self._above.spend(amount)

    def part(self, share: float) -> Work:
        """A budget of a share of what is left."""
        return Work(max(share * self.left, 1.0), above=self)

    @property
    def left(self) -> float:
        """Units left, not below zero."""
        own = max(self._limit - self._spent, 0.0)
        return own if self._above is None else min(own, self._above.left)

    def late(self) -> bool:
        """Whether the clock's emergency stop has struck."""
        if self._above is not None:
            return self._above.late()
        return self._deadline is not None and time.perf_counter() > self._deadline

    def ended(self) -> bool:
        """Whether nothing more may be begun."""
        return self.left <= 0.0 or self.late()
