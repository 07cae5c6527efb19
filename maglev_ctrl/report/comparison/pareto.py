"""What tuned options can reach where objectives conflict: their fronts, two objectives at a time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal, NamedTuple

import numpy as np

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.report.chart import Axis, Chart, Item, Line, Marks, Note, Panel
from maglev_ctrl.report.style import FADED, INK, Symbol, colour, dash, number

Sense = Literal["smaller", "larger"]

KNEE: Final = "knee of a front"
_SYMBOLS: Final[tuple[Symbol, ...]] = ("circle", "square", "triangle", "diamond")
_SIZES: Final[dict[Symbol, float]] = {"circle": 1.0, "square": 0.9, "triangle": 1.1, "diamond": 0.85}  # alike in area
_FRONT, _REST, _CHOSEN, _EDGE, _RING = 2.8, 1.7, 6.0, 1.6, 10.5  # pt
_HEIGHTS: Final = {2: 3.2, 3: 2.3, 4: 1.75}  # in, of a panel by the number of objectives
_ROOM: Final = 0.06  # of the range beyond the outermost points
_CORNER: Final = 0.22  # in, on the better side, where the word stands
_LETTERS: Final = {2: 55, 3: 42, 4: 32}  # of a name and its unit that fit along a panel, by the number of objectives
_DECADES: Final = 30.0  # largest over smallest value from which on an axis is logarithmic


class Objective(NamedTuple):
    """A quantity to be made smaller or larger, in words, with the unit of its values."""

    name: str
    unit: str
    sense: Sense


class Front(NamedTuple):
    """The designs of one option that none of its own betters: `points` (n, m) in the units of the objectives.

    `chosen` and `knee` are rows of `points`, -1 for none.
    """

    label: str
    points: FloatArray
    chosen: int
    knee: int


@dataclass(frozen=True, eq=False, slots=True)
class ParetoChartData:
    """Two to four objectives and the front of every option; plain tuples will do."""

    objectives: tuple[Objective | tuple[str, str, Sense], ...]
    options: tuple[Front | tuple[str, FloatArray, int, int], ...]


def pareto_chart(data: ParetoChartData, *, key: str = "pareto") -> Chart:
    """Fronts of all options, one panel for every pair of objectives, each objective along the same axes throughout.

    Parameters
    ----------
    key : of the chart, unique on its page

    Raises
    ------
    ValueError : not two to four objectives, an unknown sense, no option, points of another shape, rows that are not
        there, no finite point at all

    Examples
    --------
    >>> front = np.array([[0.2, 30.0], [0.3, 20.0], [0.5, 15.0]])
    >>> chart = pareto_chart(ParetoChartData(
    ...     (("ride", "m/s²", "smaller"), ("smallest gap", "mm", "larger")), (("Damper", front, 1, 1),)))
    >>> len(chart.panels), chart.panels[0].x.label, chart.panels[0].y.label
    (1, 'ride (m/s²)', 'smallest gap (mm)')
    """
    objectives = tuple(Objective(*one) for one in data.objectives)
    fronts = tuple(Front(*one) for one in data.options)
    _require_sound(objectives, fronts)
    count = len(objectives)
    axes = tuple(
        _axis(objective, fronts, k, letters=_LETTERS[count], height=_HEIGHTS[count])
        for k, objective in enumerate(objectives)
    )
    panels = []
    for row in range(1, count):
        for column in range(count - 1):
            if column >= row:
                panels.append(_BLANK)
                continue
            x, y = axes[column], axes[row]
            panels.append(Panel(
                tuple(_items(objectives, fronts, column, row, axes=(x, y))),
                x if row == count - 1 else _unnamed(x), y if column == 0 else _unnamed(y),
            ))  # fmt: skip
    empty = [front.label for front in fronts if not _finite(front).any()]
    goals = ", ".join(f"{one.sense} {one.name}" for one in objectives)
    joined = (
        "the front" if count == 2 else "what no other design of the option betters in the two quantities of a panel"
    )
    caption = (
        f"What each option can reach ({goals}). Small marks are the designs on its front, a line joins {joined}, the "
        "large mark with an edge is the chosen design, and a ring is the knee."
        + (f" Nothing to show for {', '.join(empty)}." if empty else "")
    )  # fmt: skip
    alt = f"Fronts over {', '.join(one.name for one in objectives)}. " + " ".join(
        _told(front, objectives) for front in fronts
    )
    return Chart(
        key=key,
        caption=caption,
        alt=alt,
        panels=tuple(panels),
        columns=count - 1,
        panel_height=_HEIGHTS[count],
        legend="bottom",
    )


_NOWHERE: Final = Axis("", limits=(0.0, 1.0), hidden=True)
_BLANK: Final = Panel((), _NOWHERE, _NOWHERE)


def _require_sound(objectives: tuple[Objective, ...], fronts: tuple[Front, ...]) -> None:
    if len(objectives) not in _HEIGHTS:
        raise ValueError(f"objectives: expected 2 to 4, got {len(objectives)}")
    wrong = next((one for one in objectives if one.sense not in ("smaller", "larger")), None)
    if wrong is not None:
        raise ValueError(f"objectives: expected the sense smaller or larger for {wrong.name}, got {wrong.sense!r}")
    if not fronts:
        raise ValueError("options: expected at least one, got none")
    for front in fronts:
        shape = np.shape(front.points)
        if len(shape) != 2 or shape[1] != len(objectives):
            raise ValueError(f"options: expected points (n, {len(objectives)}) for {front.label}, got {shape}")
        for name, row in (("chosen", front.chosen), ("knee", front.knee)):
            if not -1 <= row < shape[0]:
                raise ValueError(f"options: expected {name} of {front.label} in -1 .. {shape[0] - 1}, got {row}")
    if not any(_finite(front).any() for front in fronts):
        raise ValueError("options: expected a design with finite objectives, got none")


def _finite(front: Front) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Rows (n,) whose objectives are all finite; a single NaN keeps a design out of every panel."""
    return np.asarray(np.isfinite(front.points).all(axis=1))


def _axis(objective: Objective, fronts: tuple[Front, ...], k: int, *, letters: int, height: float) -> Axis:
    """The objective's axis with room for every front, more of it where it gets better; `height` (in) of a panel."""
    values = np.concatenate([front.points[_finite(front), k] for front in fronts])
    low, high = float(np.min(values)), float(np.max(values))
    log = low > 0.0 and high > _DECADES * low
    if log:
        low, high = np.log10(low), np.log10(high)
    span = (high - low) or 0.1 * abs(high) or 1.0
    corner = _CORNER / height
    below, above = (corner, _ROOM) if objective.sense == "smaller" else (_ROOM, corner)
    low, high = low - below * span, high + above * span
    limits = (10.0**low, 10.0**high) if log else (low, high)
    unit = f" ({objective.unit})" if objective.unit else ""
    return Axis(f"{shortened(objective.name, letters - len(unit))}{unit}", limits=limits, log=log)


def shortened(name: str, letters: int) -> str:
    """A name cut between words, or within the first one, to at most so many letters; the caption has it in full.

    Examples
    --------
    >>> shortened("largest excursion of the gap", 20), shortened("ride", 20)
    ('largest excursion…', 'ride')
    """
    if len(name) <= letters:
        return name
    cut = name[: max(1, letters - 1)]
    whole = cut if name[len(cut)] == " " else cut.rpartition(" ")[0]
    return f"{(whole or cut).rstrip(' ,')}…"


def _unnamed(axis: Axis) -> Axis:
    return Axis("", limits=axis.limits, log=axis.log)


def _items(
    objectives: tuple[Objective, ...], fronts: tuple[Front, ...], i: int, j: int, *, axes: tuple[Axis, Axis]
) -> list[Item]:
    """One panel: objective i across, j upwards. What is chosen lies over every front, rings over all."""
    below: list[Item] = []
    above: list[Item] = []
    rings: list[Item] = []
    for order, front in enumerate(fronts):
        known = _finite(front)
        if not known.any():
            continue
        tint, symbol = colour(order), _SYMBOLS[order % len(_SYMBOLS)]
        x, y = front.points[known, i], front.points[known, j]
        words = tuple(_words(front, row, objectives) for row in np.flatnonzero(known).tolist())
        path = best_of_pairs(x, y, objectives[i].sense, upwards=objectives[j].sense)
        if len(path) > 1:
            below.append(Line(x[path], y[path], "", tint, dash(order), 0.9))
        rest = np.setdiff1d(np.arange(len(x)), path)
        for places, size in ((rest, _REST), (path, _FRONT)):
            if len(places):
                said = tuple(words[k] for k in places)
                below.append(Marks(x[places], y[places], symbol, "", tint, size * _SIZES[symbol], said))
        if front.chosen >= 0 and known[front.chosen]:
            at = front.points[front.chosen]
            said = (f"{_words(front, front.chosen, objectives)}, chosen",)
            edge = (_CHOSEN + _EDGE) * _SIZES[symbol]
            above.append(Marks(at[i : i + 1], at[j : j + 1], symbol, "", INK, edge))
            above.append(Marks(at[i : i + 1], at[j : j + 1], symbol, front.label, tint, _CHOSEN * _SIZES[symbol], said))
        else:  # the legend still has to name the option
            above.append(Marks(np.array([np.nan]), np.array([np.nan]), symbol, front.label, tint, _CHOSEN))
        if front.knee >= 0 and known[front.knee]:
            at = front.points[front.knee]
            said = (f"{_words(front, front.knee, objectives)}, knee",)
            rings.append(Marks(at[i : i + 1], at[j : j + 1], "open_circle", "", tint, _RING, said))
    if rings:
        rings.append(Marks(np.array([np.nan]), np.array([np.nan]), "open_circle", KNEE, INK, 0.8 * _RING))
    return [_better(objectives[i].sense, objectives[j].sense, axes), *below, *above, *rings]


def best_of_pairs(
    x: FloatArray, y: FloatArray, across: Sense, *, upwards: Sense
) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    """Indices, along x, of the points that no other betters in both coordinates.

    Parameters
    ----------
    x, y : (n,) finite
    across, upwards : which way x and y are better

    Examples
    --------
    >>> best_of_pairs(np.array([1.0, 2.0, 3.0]), np.array([3.0, 4.0, 1.0]), "smaller", upwards="smaller").tolist()
    [0, 2]
    """
    cost_x, cost_y = x if across == "smaller" else -x, y if upwards == "smaller" else -y
    order = np.lexsort((cost_y, cost_x))
    least = np.minimum.accumulate(cost_y[order])
    kept = order[np.concatenate([[True], cost_y[order][1:] < least[:-1]])]
    return np.asarray(kept, dtype=np.int64)


def _better(across: Sense, upwards: Sense, axes: tuple[Axis, Axis]) -> Note:
    """The corner of the panel that a design should be near."""
    arrow = {
        ("smaller", "smaller"): "↙ better", ("smaller", "larger"): "↖ better",
        ("larger", "smaller"): "better ↘", ("larger", "larger"): "better ↗",
    }[across, upwards]  # fmt: skip
    x, y = (_near_end(axis, sense) for axis, sense in zip(axes, (across, upwards), strict=True))
    return Note(
        x, y, arrow, "left" if across == "smaller" else "right", "bottom" if upwards == "smaller" else "top", FADED
    )


def _near_end(axis: Axis, sense: Sense) -> float:
    """A place just inside the better end of an axis."""
    low, high = axis.limits or (0.0, 1.0)
    inside = 0.015 if sense == "smaller" else 0.985
    return float(low * (high / low) ** inside if axis.log else low + inside * (high - low))


def _words(front: Front, row: int, objectives: tuple[Objective, ...]) -> str:
    values = (
        f"{one.name} {number(float(value), one.unit)}" for one, value in zip(objectives, front.points[row], strict=True)
    )
    return f"{front.label}: {', '.join(values)}"


def _told(front: Front, objectives: tuple[Objective, ...]) -> str:
    """One option in a sentence, for a reader who cannot see the figure."""
    known = _finite(front)
    if not known.any():
        return f"{front.label}: no design with known values."
    row = front.chosen if front.chosen >= 0 and known[front.chosen] else int(np.flatnonzero(known)[0])
    which = "chosen" if row == front.chosen else "for example"
    count = int(np.count_nonzero(known))
    designs = "1 design" if count == 1 else f"{count} designs"
    return f"{_words(front, row, objectives)} ({which}, of {designs})."
