"""The points of a sweep cut into blocks, the unit that one process works on at a time."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from threadpoolctl import threadpool_limits

from maglev_ctrl.arrays import FloatArray, read_only_any
from maglev_ctrl.errors import MaglevError
from maglev_ctrl.scenario import Scenario
from maglev_ctrl.study.sweep.point import OptionPoint
from maglev_ctrl.study.sweep.records import FAILED, Column, SweepBlock, columns_of
from maglev_ctrl.study.sweep.request import SweepRequest

TARGET = 0.7
"""Seconds a block should take: long beside what sending it costs, short beside what its loss costs."""
_PILOT_SECONDS = 2.0
_PILOT_POINTS = 12


@dataclass(frozen=True, eq=False)
class SweepTask:
    """Computes any block of a sweep; a process keeps the options it has designed.

    Parameters
    ----------
    scenario : its eddy-current forces solved
    size : points of a block; the last one may have fewer
    """

    scenario: Scenario
    request: SweepRequest
    size: int
    _points: list[OptionPoint | str] = field(default_factory=list, repr=False)

    def __getstate__(self) -> dict[str, object]:
        """Without what a process keeps."""
        return {**self.__dict__, "_points": []}

    @property
    def blocks(self) -> int:
        """How many blocks there are."""
        return -(-self.request.points // self.size)

    @property
    def columns(self) -> tuple[Column, ...]:
        """The figures of every option."""
        return columns_of(self.request.parts)

    def span(self, index: int) -> tuple[int, int]:
        """First point of a block, and the first one behind it."""
        return index * self.size, min((index + 1) * self.size, self.request.points)

    def __call__(self, index: int) -> SweepBlock:
        """The block of an index."""
        return self.at(index, self.request.values(*self.span(index)))

    def at(
        self, index: int, quantities: FloatArray, *, enough: Callable[[int], bool] = lambda done: False
    ) -> SweepBlock:
        """The figures at values (n, quantities) SI; those after `enough` says so are left out."""
        started = time.perf_counter()
        columns = self.columns
        place = {column.name: k for k, column in enumerate(columns)}
        blank = np.array([column.blank for column in columns])
        figures = np.tile(blank, (len(quantities), len(self.request.options), 1))
        remarks: list[tuple[int, int, str]] = []
        with threadpool_limits(limits=1):  # matrices are small, and their digits must not depend on the threads
            for k, row in enumerate(quantities):
                if enough(k):
                    figures, quantities = figures[:k], quantities[:k]
                    break
                values = tuple((one.quantity, float(v)) for one, v in zip(self.request.ranges, row, strict=True))
                for j, option in enumerate(self._options()):
                    told, words = option.figures(values) if isinstance(option, OptionPoint) else (
                        {"status": FAILED}, option
                    )  # fmt: skip
                    for name, value in told.items():
                        figures[k, j, place[name]] = value
                    if words:
                        remarks.append((k, j, words))
        return SweepBlock(
            index, read_only_any(quantities), read_only_any(figures), tuple(remarks), time.perf_counter() - started
        )

    def _options(self) -> list[OptionPoint | str]:
        """The options, designed when they are first needed; why not, where one cannot be."""
        if not self._points:
            for name in self.request.options:
                try:
                    self._points.append(OptionPoint.of(self.scenario, name, self.request.parts))
                except MaglevError as fault:
                    self._points.append(f"{fault}")
        return self._points


def seconds_per_point(scenario: Scenario, request: SweepRequest) -> float:
    """What a point costs on this machine, measured at a few of them spread over the sweep; s."""
    task = SweepTask(scenario, request, 1)
    places = np.unique(np.linspace(0, request.points - 1, _PILOT_POINTS).astype(np.int64))
    quantities = np.concatenate(
        [request.values(int(k), int(k) + 1) for k in np.random.default_rng(0).permutation(places)]
    )
    task.at(0, quantities[:1])  # designs the laws
    started = time.perf_counter()
    done = task.at(0, quantities, enough=lambda k: k >= 1 and time.perf_counter() - started > _PILOT_SECONDS)
    return done.seconds / len(done.quantities)


def block_size(points: int, seconds: float, *, workers: int) -> int:
    """Points of a block: about `TARGET` s of work, and some blocks for every worker where there are enough points.

    Examples
    --------
    >>> block_size(10_000, 0.01, workers=2), block_size(20, 0.01, workers=2), block_size(10, 30.0, workers=2)
    (70, 2, 1)
    """
    wanted = int(TARGET / max(seconds, 1e-9))
    return max(1, min(wanted, points // (4 * workers), 100_000))
