"""What the difference of two reports is made of; `maglev_ctrl.report.difference` makes it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Final, Literal

from maglev_ctrl.errors import Verdict
from maglev_ctrl.report.reading import Bound


class Outcome(Enum):
    """What became of a requirement of an option that both reports have, worst first."""

    WORSE = "worse"  # it passed and no longer does
    GONE = "gone"  # only the first report asks for it
    UNMET = "new, not passed"  # only the second report asks for it, and it does not pass
    OTHER = "other verdict, not passed"  # FAIL became NOT EVALUATED, or the other way round
    SAME = "same verdict"
    BETTER = "better"  # it passes and did not
    NEW = "new, passed"


COUNTED: Final = frozenset({Outcome.WORSE, Outcome.GONE, Outcome.UNMET, Outcome.OTHER})
"""What keeps the second report from being at least as good as the first, unless the requirement is only a wish."""


@dataclass(frozen=True, eq=False, slots=True)
class NumberChange:
    """A number before and after.

    Parameters
    ----------
    before, after : NaN where there is none
    unit : of `after`; that of `before` where it differs is `unit_before`
    absolute, relative : the change and its share of |before|; NaN where one of the two is missing, infinite shares
        from zero
    changed : it differs by more than rounding
    """

    name: str
    before: float
    after: float
    unit: str
    unit_before: str
    absolute: float
    relative: float
    changed: bool


@dataclass(frozen=True, eq=False, slots=True)
class RequirementChange:
    """One requirement of one option before and after.

    Parameters
    ----------
    verdict_before, verdict_after : None where the report does not ask for it
    toward : where the value went, by the sense of the requirement; "" where it stayed or cannot be told
    limit_toward : what the change of the limit did: a "looser" one is easier to meet
    hard : False where it is only a wish in each report that has it
    notes : what else is different, in sentences
    """

    name: str
    outcome: Outcome
    verdict_before: Verdict | None
    verdict_after: Verdict | None
    value: NumberChange
    limit: NumberChange
    sense: Literal["at_least", "at_most"]
    toward: Literal["better", "worse", ""]
    limit_toward: Literal["looser", "tighter", ""]
    bound_before: Bound
    bound_after: Bound
    worst_at_before: str
    worst_at_after: str
    hard: bool
    notes: tuple[str, ...]

    @property
    def counts(self) -> bool:
        """Whether the second report is not as good as the first for its sake."""
        return self.hard and self.outcome in COUNTED

    @property
    def changed(self) -> bool:
        """Whether anything is different."""
        return (
            self.outcome is not Outcome.SAME or self.value.changed or self.limit.changed or bool(self.notes)
            or self.bound_before != self.bound_after or self.worst_at_before != self.worst_at_after
        )  # fmt: skip


@dataclass(frozen=True, eq=False, slots=True)
class SectionChange:
    """How much differs in a part of an option that is compared without knowing what it means.

    Parameters
    ----------
    numbers : how many numbers both have at the same places
    changed : how many of them differ by more than rounding, each list of numbers measured by its largest
    other : how many texts, names or lengths of lists differ
    other_at : the first place of those, "" where there is none
    largest : where the relative change is largest; None where no number differs
    """

    name: str
    numbers: int
    changed: int
    other: int
    other_at: str
    largest: NumberChange | None


@dataclass(frozen=True, eq=False, slots=True)
class OptionChange:
    """One suspension option before and after; a name is "" where the report does not have it."""

    name_before: str
    name_after: str
    label: str
    verdict_before: Verdict | None
    verdict_after: Verdict | None
    requirements: tuple[RequirementChange, ...]  # worst first
    numbers: tuple[NumberChange, ...]  # modes and margins at the design point, only those that changed
    sections: tuple[SectionChange, ...]  # only those that differ
    notes: tuple[str, ...]

    @property
    def standing(self) -> Literal["gone", "new", "renamed", "both"]:
        """Which report has it."""
        if not self.name_after:
            return "gone"
        if not self.name_before:
            return "new"
        return "both" if self.name_before == self.name_after else "renamed"

    @property
    def counted(self) -> tuple[RequirementChange, ...]:
        """The requirements that are not as good as before."""
        return tuple(one for one in self.requirements if one.counts)

    @property
    def changed(self) -> bool:
        """Whether anything is different."""
        return (
            self.standing != "both" or bool(self.numbers or self.sections or self.notes)
            or any(one.changed for one in self.requirements)
        )  # fmt: skip


@dataclass(frozen=True, eq=False, slots=True)
class Difference:
    """What changed from a first report to a second one.

    Parameters
    ----------
    scenario : "same", "words" (only comments, order or units as written), "data" (only its data files), "changed"
    scenario_lines : unified difference of the two scenario texts, cut; `scenario_lines_left` lines are left out
    versions : (name, before, after) of what differs, "" where there is none
    design_point : only what changed
    options : worst first
    sections : other parts of the report, only those that differ
    tolerance : relative change up to which numbers count as equal
    """

    title_before: str
    title_after: str
    scenario_hash_before: str
    scenario_hash_after: str
    scenario: Literal["same", "words", "data", "changed"]
    scenario_lines: tuple[str, ...]
    scenario_lines_left: int
    versions: tuple[tuple[str, str, str], ...]
    design_point: tuple[NumberChange, ...]
    options: tuple[OptionChange, ...]
    sections: tuple[SectionChange, ...]
    tolerance: float

    @property
    def at_least_as_good(self) -> bool:
        """Every option and requirement is still there, and each requirement passes or has the verdict it had.

        Options that only the second report has, and wishes, are not judged.
        """
        return not any(option.standing == "gone" or option.counted for option in self.options)

    @property
    def empty(self) -> bool:
        """Nothing is different but the time at which the reports were made."""
        return (
            self.scenario == "same" and not self.versions and not self.design_point and not self.sections
            and self.title_before == self.title_after and not any(option.changed for option in self.options)
        )  # fmt: skip

    def count(self, outcome: Outcome) -> int:
        """How many requirements, all options together, this became of."""
        return sum(one.outcome is outcome for option in self.options for one in option.requirements)
