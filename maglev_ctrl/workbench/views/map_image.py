"""A live map as even cells with a sign that its state decides, its boundary, and what it says in words."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from maglev_ctrl.analysis.plane_records import NO_ANSWER, STABLE, UNRESOLVED, UNSTABLE
from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.report.map.words import percent
from maglev_ctrl.report.raster import even_cells, worst_members
from maglev_ctrl.study.live.records import LiveMap

WORDS: Final = {
    STABLE: "stable", UNSTABLE: "unstable", UNRESOLVED: "UNRESOLVED", NO_ANSWER: "without an answer",
}  # fmt: skip
_RANK: Final = {STABLE: 0, NO_ANSWER: 1, UNRESOLVED: 2, UNSTABLE: 3}
_MOST: Final = 400


@dataclass(frozen=True, eq=False, slots=True)
class EvenMap:
    """Even cells over `speed` (m/s) and `depth`; `state`, `signed` (depth, speed).

    `signed`: growth in 1/s, above zero where unstable, not above zero where stable, NaN elsewhere.
    """

    speed: FloatArray
    depth: FloatArray
    state: NDArray[np.int8]
    signed: FloatArray


def even_map(found: LiveMap) -> EvenMap:
    """The map on even cells, each as its worst point is, so that nothing unstable is lost."""
    state, growth = np.asarray(found.state), np.asarray(found.growth, dtype=float)
    speed, depth = np.asarray(found.speed, dtype=float), np.asarray(found.depth, dtype=float)
    if not (_even(speed) and _even(depth)):
        speed, columns = even_cells(speed, most=_MOST)
        depth, rows = even_cells(depth, most=_MOST)
        rank = np.vectorize(_RANK.get, otypes=[float])(state) + 0.5 * np.tanh(np.nan_to_num(growth, nan=-1e3))
        # The worst point of a cell: unstable before unresolved before no answer before stable.
        chosen = worst_members(rank.T, columns, rows)
        state, growth = state.T.ravel()[chosen], growth.T.ravel()[chosen]
    least = float(np.finfo(np.float32).tiny)
    signed = np.where(state == UNSTABLE, np.maximum(growth, least), np.where(state == STABLE, growth, np.nan))
    signed = np.where(state == STABLE, np.minimum(signed, 0.0), signed)
    return EvenMap(speed, depth, state, signed)


def _even(values: FloatArray) -> bool:
    if len(values) < 3:
        return True
    steps = np.diff(values)
    return bool(np.ptp(steps) <= 1e-6 * abs(float(values[-1] - values[0])))


def boundary_line(x: FloatArray, y: FloatArray, shown: EvenMap) -> tuple[FloatArray, FloatArray]:
    """Where stable turns to unstable, as one line with gaps; nothing where a side is undecided."""
    stable, unstable = shown.state == STABLE, shown.state == UNSTABLE
    if not (np.any(stable) and np.any(unstable)) or min(shown.state.shape) < 2:
        return np.zeros(0), np.zeros(0)
    from contourpy import contour_generator

    least = float(np.finfo(np.float64).tiny)
    growth = np.nan_to_num(shown.signed, nan=0.0)
    signed = np.where(unstable, np.maximum(growth, least), np.minimum(growth, -least))
    masked: Any = np.ma.masked_array(signed, ~(stable | unstable))
    lines = contour_generator(x, y, masked, corner_mask=True).lines(0.0)
    pieces = [np.vstack([np.asarray(line), [[np.nan, np.nan]]]) for line in lines]
    curve = np.concatenate(pieces) if pieces else np.zeros((0, 2))
    return np.ascontiguousarray(curve[:, 0]), np.ascontiguousarray(curve[:, 1])


def map_words(found: LiveMap) -> str:
    """How much of a map is in each state, and the names of its unstable regions."""
    shares = ", ".join(
        f"{percent(float(np.mean(found.state == state)))} {words}"
        for state, words in WORDS.items()
        if np.any(found.state == state)
    )
    names = ", ".join(dict.fromkeys(one.name for one in found.regions))
    return f"{shares}." + (f" Unstable regions: {names}." if names else "")


def state_words(found: LiveMap, speed: float, depth: float) -> str:
    """The state of the map's point nearest to a speed (m/s) and a depth."""
    if not (found.speed[0] <= speed <= found.speed[-1] and found.depth[0] <= depth <= found.depth[-1]):
        return "outside the map"
    column = int(np.argmin(np.abs(found.speed - speed)))
    row = int(np.argmin(np.abs(found.depth - depth)))
    return WORDS[int(found.state[row, column])]
