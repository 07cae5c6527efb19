"""What tuning leaves behind: variables, fronts, what binds, who ranks where, and how firmly."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.display import Shown


@dataclass(frozen=True, eq=False, slots=True)
class ObjectiveAxis:
    """One objective: its name in the file, words, display unit and factor from SI, and which way is better."""

    name: str
    label: str
    unit: str
    scale: float
    sense: Literal["smaller", "larger"]


@dataclass(frozen=True, eq=False, slots=True)
class TunedVariable:
    """One design variable: its range and the value chosen (SI); for a choice the position in the list.

    `at_bound`: "lower" or "upper" where the chosen value stands at an end of its range, which then decides; else "".
    """

    name: str
    label: str
    unit: str  # display unit
    scale: float  # display value = SI value * scale
    lower: float
    upper: float
    value: float
    text: str  # the value as people read it, unit included
    at_bound: str


@dataclass(frozen=True, eq=False, slots=True)
class TunedOption:
    """One option's search.

    `front` (p, m): objectives (SI) of the candidates that no other betters and that meet every hard requirement the
    loop can judge, sorted by the first objective; `front_variables` (p, v). Where none meets them `front` holds the
    best found alone, `feasible` is False, and `binding` names the requirement that it misses by most (`violation`,
    relative to its limit). An option without variables has one candidate: itself. With a `reason` the front is empty,
    and `chosen` and `knee` are -1.
    """

    option: str
    label: str
    kind: str
    variables: tuple[TunedVariable, ...]
    front: FloatArray
    front_variables: FloatArray
    chosen: int
    knee: int
    feasible: bool
    binding: str
    violation: float
    evaluations: int
    failures: int  # candidates whose model or law did not exist
    generations: int
    stopped: str  # "generations", "time limit", "no variables"
    seed: int
    seconds: float
    reason: str  # why there is no result at all; "" otherwise


@dataclass(frozen=True, eq=False, slots=True)
class RankedOption:
    """One option's place. `distance`: to the ideal point of all fronts, in ranges of the objectives (0 best)."""

    option: str
    label: str
    place: int  # 1 is best; options that miss a hard requirement come after those that meet all
    distance: float
    misses: tuple[str, ...]


@dataclass(frozen=True, eq=False, slots=True)
class RankingShift:
    """What the ranking becomes when one requirement's limit or one objective's weight is changed.

    `places`: by option, in the order of `TuningStudy.ranking`; `first`: the option then in first place.
    """

    what: str
    factor: float
    places: tuple[int, ...]
    first: str
    changed: bool


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class TuningStudy(Shown):
    """All options' searches side by side.

    `in_loop`: the hard requirements every candidate had to meet; `after`: those that only the full study of the chosen
    candidates judges.
    """

    _told: ClassVar = ("method", "objectives", "options", "ranking")

    method: str
    in_loop: tuple[str, ...]
    after: tuple[str, ...]
    objectives: tuple[ObjectiveAxis, ...]
    situations: tuple[str, ...]  # the operating set every candidate is judged over
    options: tuple[TunedOption, ...]
    ranking: tuple[RankedOption, ...]
    shifts: tuple[RankingShift, ...]
    seconds: float
