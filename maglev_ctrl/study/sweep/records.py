"""What a sweep is made of: the columns of a point, one finished block, the whole."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.study.sweep.request import Part, SweepRequest

STABLE: Final = -1.0
UNRESOLVED: Final = 0.0
UNSTABLE: Final = 1.0
NO_ANSWER: Final = 2.0
"""States of a point, as on a map."""

COMPLETE: Final = 0.0
INCOMPLETE: Final = 1.0
FAILED: Final = 2.0
"""Status of a point: everything asked for was computed, some of it was not, nothing was."""

STATE_WORDS: Final = (("stable", STABLE), ("unresolved", UNRESOLVED), ("unstable", UNSTABLE), ("no_answer", NO_ANSWER))
STATUS_WORDS: Final = (("complete", COMPLETE), ("incomplete", INCOMPLETE), ("failed", FAILED))
MET_WORDS: Final = (("missed", -1.0), ("unresolved", 0.0), ("met", 1.0))
_NOWHERE: Final = "; NaN where the loop is not stable, there is nothing to break, or it could not be verified"


@dataclass(frozen=True, slots=True)
class Column:
    """One figure of a point: its name, unit, what it is, and the meaning of its values where they are a code."""

    name: str
    unit: str
    words: str
    codes: tuple[tuple[str, float], ...] = ()
    blank: float = float("nan")


_COLUMNS: Final[dict[Part, tuple[Column, ...]]] = {
    "modes": (
        Column("status", "1", "whether the point could be computed", STATUS_WORDS, FAILED),
        Column("state", "1", "stability without modulation", STATE_WORDS, NO_ANSWER),
        Column("growth", "1/s", "largest growth rate, without modulation"),
        Column("growth_bound", "1/s", "bound on the error of the growth rate"),
        Column("least_damping", "1", "least damping ratio of the oscillating modes; NaN where nothing oscillates"),
        Column("frequency", "Hz", "frequency of the mode that grows fastest"),
    ),
    "floquet": (
        Column("modulated_state", "1", "stability under the periodic forces", STATE_WORDS, NO_ANSWER),
        Column("modulated_growth", "1/s", "largest growth rate under the periodic forces"),
        Column("modulated_growth_bound", "1/s", "bound on its error"),
    ),
    "margins": (
        Column("gain_margin", "dB", f"least gain margin, up or down{_NOWHERE}"),
        Column("phase_margin", "rad", f"least phase margin{_NOWHERE}"),
        Column("delay_margin", "s", f"least delay margin{_NOWHERE}"),
        Column("disk_margin", "1", f"least disk margin, single and multi-loop{_NOWHERE}"),
        Column("sensitivity_peak", "1", f"largest sensitivity of a single loop{_NOWHERE}"),
    ),
    "requirements": (
        Column("requirements", "1", "stability and all hard requirements that are about one operating point",
               MET_WORDS, 0.0),
    ),
}  # fmt: skip


def columns_of(parts: tuple[Part, ...]) -> tuple[Column, ...]:
    """The columns of every option, in the order they stand in."""
    return tuple(column for part in parts for column in _COLUMNS[part])


@dataclass(frozen=True, eq=False, slots=True)
class SweepBlock:
    """A finished block: `quantities` (n, q) SI, `figures` (n, options, columns), and of each remark the point in the
    block, the option and the words."""

    index: int
    quantities: FloatArray
    figures: FloatArray
    remarks: tuple[tuple[int, int, str], ...]
    seconds: float = 0.0


@dataclass(frozen=True, slots=True)
class OptionCount:
    """How the points of one option came out; `modulated` the states under the periodic forces, None where not asked.

    `remarks`: the commonest reasons with how many points gave each, numbers in them aside.
    """

    name: str
    label: str
    states: dict[str, int]
    statuses: dict[str, int]
    modulated: dict[str, int] | None
    verdicts: dict[str, int] | None
    remarks: tuple[tuple[str, int], ...]


@dataclass(frozen=True, eq=False, slots=True)
class SweepStudy:
    """A finished sweep without its arrays, which stay in the store until they are written."""

    title: str
    name: str
    scenario_path: str
    scenario_hash: str
    request: SweepRequest
    options: tuple[OptionCount, ...]
    block: int
    blocks: int
    resumed: int
    damaged: int
    workers: str
    notes: tuple[str, ...]
    versions: tuple[tuple[str, str], ...]
    created: str
    seconds: float
    busy: float
