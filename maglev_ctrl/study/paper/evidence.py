"""What the verdicts rest on, and how ranges are put into words."""

from __future__ import annotations

from dataclasses import dataclass, field

from maglev_ctrl.errors import Agreement
from maglev_ctrl.study.paper.double_l import Line
from maglev_ctrl.study.paper.magnet_forces import SPEED
from maglev_ctrl.study.paper.records import (
    MODELS,
    ClaimVerdict,
    EigenSweep,
    Extreme,
    Instability,
    Model,
    ModeTable,
    SolvedCase,
    SpeedStudy,
)

Ranges = tuple[tuple[float, float], ...]


@dataclass(frozen=True, eq=False, slots=True)
class Evidence:
    """Everything computed of the double-L vehicle and its magnet."""

    solved: SolvedCase
    extremes: dict[str, tuple[Extreme, ...]]
    slow_extremes: dict[float, tuple[Extreme, ...]]
    sweeps: dict[tuple[str, Model], EigenSweep]
    modes: tuple[ModeTable, ...]
    reciprocity: float
    speeds: SpeedStudy | None
    skipped: tuple[str, ...] = field(default=())

    def ranges(self, key: str, model: Model, kind: Instability) -> Ranges:
        """Intervals of an instability along a figure's sweep, m."""
        sweep = self.sweeps[key, model]
        return sweep.flutter if kind == "flutter" else sweep.divergence

    def resolved(self, *keys: str) -> bool:
        """Whether both ways to a boundary agree in every model of these sweeps."""
        return all(self.sweeps[key, model].agreement is Agreement.AGREED for key in keys for model in MODELS)

    def reasons(self, *keys: str) -> str:
        """Why sweeps are unresolved, in words."""
        told = [
            f"{key}, model {model}: {self.sweeps[key, model].reason}"
            for key in keys
            for model in MODELS
            if self.sweeps[key, model].reason
        ]
        return "; ".join(told)

    @property
    def reciprocity_words(self) -> str:
        """How well k_lg = k_gl is kept, as a share of k_ll."""
        return "to rounding" if self.reciprocity < 1e-12 else f"to {100.0 * self.reciprocity:.1g} % of k_ll"

    def line(self, gap: float, *, height: float | None = None) -> Line:
        """The line of states of a sweep over height, or over the lateral offset where a height is given."""
        return Line(self.solved.force, SPEED, gap, "height" if height is None else "lateral_offset", height)


def ranges_words(ranges: Ranges, *, low: float | None = None, high: float | None = None) -> str:
    """Ranges in mm; an end that is the end of the scan is told as such.

    Parameters
    ----------
    ranges : m
    low, high : of the scan, m

    Examples
    --------
    >>> ranges_words(((0.0193, 0.0347),)), ranges_words(((0.032, 0.045),), high=0.045), ranges_words(())
    ('19.3 to 34.7 mm', 'above 32.0 mm', 'none')
    """
    words = []
    for a, b in ranges:
        if low is not None and high is not None and a <= low + 1e-12 and b >= high - 1e-12:
            words.append("everywhere")
        elif high is not None and b >= high - 1e-12:
            words.append(f"above {1e3 * a:.1f} mm")
        elif low is not None and a <= low + 1e-12:
            words.append(f"below {1e3 * b:.1f} mm")
        else:
            words.append(f"{1e3 * a:.1f} to {1e3 * b:.1f} mm")
    return ", ".join(words).replace("-", "\N{MINUS SIGN}") or "none"


def within(ranges: Ranges, expected: tuple[float, float], tolerance: float) -> bool:
    """Whether there is exactly one range and both its ends lie within a tolerance of those expected, m."""
    return len(ranges) == 1 and all(abs(got - want) <= tolerance for got, want in zip(ranges[0], expected, strict=True))


def judged(resolved: bool, verdict: ClaimVerdict) -> ClaimVerdict:
    """The verdict, or UNRESOLVED where two ways to the numbers disagree."""
    return verdict if resolved else ClaimVerdict.UNRESOLVED
