"""What figures and tables need of a sweep, gathered block by block in bounded memory."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import numpy as np
from scipy.special import betaincinv

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.study.sweep.records import STABLE, UNSTABLE, OptionCount, SweepBlock, SweepStudy
from maglev_ctrl.study.sweep.run import columns_in

BINS: Final = 24
MOST_DRAWN: Final = 400_000
"""Points of a grid of one or two quantities that are drawn; larger ones are for a program."""
_KEPT: Final = 4000  # growth rates kept of every option for its distribution
_PAIR: Final = 2


@dataclass(eq=False)
class SweepDigest:
    """Shares over every quantity, a sample of the growth rates, and the whole of a small grid.

    `counts` (quantities, options, BINS, 3): points, stable ones, unstable ones. `growth`, `state` (options, points) of
    a grid of at most two quantities, else empty.
    """

    study: SweepStudy
    counts: FloatArray = field(init=False)
    growth: FloatArray = field(init=False)
    state: FloatArray = field(init=False)
    kept: list[FloatArray] = field(default_factory=list)

    def __post_init__(self) -> None:
        request = self.study.request
        options = len(request.options)
        self.counts = np.zeros((len(request.ranges), options, BINS, 3))
        whole = request.method == "grid" and len(request.ranges) <= _PAIR and request.points <= MOST_DRAWN
        self.growth = np.full((options, request.points if whole else 0), np.nan)
        self.state = np.full(self.growth.shape, np.nan)
        self._every = max(1, request.points // _KEPT)
        columns = self.columns
        self._growth_column, self._state_column = columns

    @property
    def modulated(self) -> bool:
        """Whether the states are those under the periodic forces."""
        return "floquet" in self.study.request.parts

    @property
    def columns(self) -> tuple[int, int]:
        """Places of growth and state: under the periodic forces where they were computed."""
        from maglev_ctrl.study.sweep.records import columns_of

        found = columns_of(self.study.request.parts)
        prefix = "modulated_" if self.modulated else ""
        growth, state = (columns_in(found, f"{prefix}{name}") for name in ("growth", "state"))
        assert growth is not None
        assert state is not None
        return growth, state

    def add(self, block: SweepBlock) -> None:
        """Take a block in."""
        first = block.index * self.study.block
        growth, state = block.figures[:, :, self._growth_column], block.figures[:, :, self._state_column]
        if self.growth.size:
            self.growth[:, first : first + len(growth)] = growth.T
            self.state[:, first : first + len(growth)] = state.T
        self.kept.append(growth[(-first) % self._every :: self._every])
        for k in range(len(self.study.request.ranges)):
            place = self._bins(k, block.quantities[:, k])
            for j in range(state.shape[1]):
                for what, hit in enumerate((np.ones(len(place)), state[:, j] == STABLE, state[:, j] == UNSTABLE)):
                    self.counts[k, j, :, what] += np.bincount(place, weights=hit, minlength=BINS)

    def middles(self, k: int) -> FloatArray:
        """Middles (BINS,) of the bins of a quantity, SI."""
        edges = np.linspace(*self.study.request.ranges[k].ends, BINS + 1)
        return np.asarray(0.5 * (edges[1:] + edges[:-1]))

    def _bins(self, k: int, values: FloatArray) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
        low, high = self.study.request.ranges[k].ends
        return np.clip(((values - low) / (high - low) * BINS).astype(np.int64), 0, BINS - 1)

    def growth_sample(self, option: int) -> FloatArray:
        """Some growth rates of an option, ascending, those without an answer left out."""
        values = np.concatenate(self.kept)[:, option] if self.kept else np.zeros(0)
        return np.sort(values[np.isfinite(values)])


def share_words(option: OptionCount, points: int) -> str:
    """How the points of an option came out, in a line."""
    states = option.modulated or option.states
    shown = (("stable", "stable"), ("unresolved", "UNRESOLVED"), ("unstable", "unstable"), ("no_answer", "no answer"))
    return ", ".join(f"{100.0 * states[name] / points:.4g} % {words}" for name, words in shown if states[name])


def share_interval(hits: int, points: int, *, confidence: float = 0.95) -> tuple[float, float]:
    """Clopper and Pearson's interval of a share of independently drawn points: never too narrow.

    Examples
    --------
    >>> low, high = share_interval(0, 59)
    >>> low, round(high, 3)
    (0.0, 0.061)
    """
    tail = 0.5 * (1.0 - confidence)
    low = 0.0 if hits == 0 else float(betaincinv(hits, points - hits + 1, tail))
    high = 1.0 if hits == points else float(betaincinv(hits + 1, points - hits, 1.0 - tail))
    return low, high
