"""The difference of two reports: which requirement got better or worse, by how much, and what else changed.

Requirements are matched by name within options matched by name; an option whose name is gone is found again where
exactly one new option has the same label, or the same kind and the same elements and law in words. Numbers are equal
within rounding: a relative tolerance, and the error bounds of the modes for growth rates and damping ratios.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Hashable, Iterable, Sequence
from typing import Any, Final, Literal

from maglev_ctrl.errors import Verdict
from maglev_ctrl.report.difference_records import (
    COUNTED,
    Difference,
    NumberChange,
    OptionChange,
    Outcome,
    RequirementChange,
    SectionChange,
)
from maglev_ctrl.report.difference_sections import number_change, section_change
from maglev_ctrl.report.reading import NumberRead, OptionRead, ReportRead, RequirementRead
from maglev_ctrl.report.serialise import plain

TOLERANCE: Final = 1e-6
MOST_LINES: Final = 40
FORMAT: Final = 1

_PLACES: Final = {outcome: place for place, outcome in enumerate(Outcome)}


def difference(
    before: ReportRead, after: ReportRead, *, tolerance: float = TOLERANCE, most_lines: int = MOST_LINES
) -> Difference:
    """What changed from one report to another.

    Parameters
    ----------
    before, after : from `maglev_ctrl.report.reading.read_report`
    tolerance : relative change up to which two numbers count as equal, at least 0 and below 1
    most_lines : how many lines of the difference of the two scenario texts are kept

    Raises
    ------
    ValueError : tolerance outside its range, most_lines below 0

    Examples
    --------
    >>> from maglev_ctrl.report.reading import report_of
    >>> written = {"kind": "maglev-ctrl comparison", "format": 1, "title": "Car", "verdict": "PASS", "options": [],
    ...     "scenario_hash": "1f", "versions": [], "design_speed": {"value": 50.0, "unit": "m/s"},
    ...     "design_height": {"value": 0.1, "unit": "m"}}
    >>> found = difference(report_of(written), report_of(written))
    >>> found.empty, found.at_least_as_good
    (True, True)
    """
    if not 0.0 <= tolerance < 1.0:
        raise ValueError(f"tolerance: expected at least 0 and below 1, got {tolerance!r}")
    if most_lines < 0:
        raise ValueError(f"most_lines: expected at least 0, got {most_lines!r}")
    lines = _scenario_lines(before, after)
    options = [_option_change(old, new, tolerance) for old, new in _matched(before.options, after.options)]
    options.sort(key=_option_place)
    return Difference(
        title_before=before.title,
        title_after=after.title,
        scenario_hash_before=before.scenario_hash,
        scenario_hash_after=after.scenario_hash,
        scenario=_scenario_standing(before, after),
        scenario_lines=lines[:most_lines],
        scenario_lines_left=max(0, len(lines) - most_lines),
        versions=_versions(before, after),
        design_point=_number_changes(before.design_point, after.design_point, tolerance),
        options=tuple(options),
        sections=_sections(before, after, tolerance),
        tolerance=tolerance,
    )


def difference_plain(found: Difference) -> dict[str, Any]:
    """A difference in JSON's terms, NaN and infinities as texts, with what its records tell of themselves.

    Examples
    --------
    >>> from maglev_ctrl.report.difference_records import Difference
    >>> difference_plain(Difference("A", "B", "1f", "1f", "same", (), 0, (), (), (), (), 1e-6))["at_least_as_good"]
    True
    """
    body = plain(found)
    for option, record in zip(body["options"], found.options, strict=True):
        option["standing"] = record.standing
        option["counted"] = [one.name for one in record.counted]
    return {
        "format": FORMAT, "kind": "maglev-ctrl difference", "at_least_as_good": found.at_least_as_good,
        "empty": found.empty, **body,
    }  # fmt: skip


def _scenario_standing(before: ReportRead, after: ReportRead) -> Literal["same", "words", "data", "changed"]:
    """The hash covers what the file says and its data files; the text is the file itself."""
    text_differs = before.scenario_text != after.scenario_text
    if before.scenario_hash == after.scenario_hash:
        return "words" if text_differs else "same"
    return "changed" if text_differs else "data"


def _scenario_lines(before: ReportRead, after: ReportRead) -> tuple[str, ...]:
    old, new = before.scenario_text.splitlines(), after.scenario_text.splitlines()
    return tuple(difflib.unified_diff(old, new, "before", "after", n=1, lineterm=""))


def _versions(before: ReportRead, after: ReportRead) -> tuple[tuple[str, str, str], ...]:
    old, new = dict(before.versions), dict(after.versions)
    names = dict.fromkeys((*old, *new))
    pairs = ((name, old.get(name, ""), new.get(name, "")) for name in names)
    return tuple(one for one in pairs if one[1] != one[2])


def _matched(
    before: Sequence[OptionRead], after: Sequence[OptionRead]
) -> list[tuple[OptionRead | None, OptionRead | None]]:
    """Options of both reports, in the order of the second with those gone after them."""
    found = {option.name: option for option in before}
    partner = {option.name: found[option.name] for option in after if option.name in found}
    keys: tuple[Callable[[OptionRead], Hashable], ...] = (
        lambda option: option.label,
        lambda option: (option.kind, option.summary),
    )
    for key in keys:
        taken = {old.name for old in partner.values()}
        lost = [option for option in before if option.name not in taken]
        new = [option for option in after if option.name not in partner]
        for option in new:
            alike = [old for old in lost if key(old) == key(option)]
            rivals = [other for other in new if key(other) == key(option)]
            if len(alike) == len(rivals) == 1:
                partner[option.name] = alike[0]
    taken = {old.name for old in partner.values()}
    pairs: list[tuple[OptionRead | None, OptionRead | None]] = [(partner.get(one.name), one) for one in after]
    return pairs + [(one, None) for one in before if one.name not in taken]


def _option_change(before: OptionRead | None, after: OptionRead | None, tolerance: float) -> OptionChange:
    known = after or before
    assert known is not None
    names = "" if before is None else before.name, "" if after is None else after.name
    verdicts = None if before is None else before.verdict, None if after is None else after.verdict
    if before is None or after is None:
        return OptionChange(*names, known.label, *verdicts, (), (), (), ())
    floors = {
        "growth_rate": before.eigenvalue_error + after.eigenvalue_error,
        "damping_ratio": before.damping_error + after.damping_error,
    }
    old, new = ({one.name: one for one in option.requirements} for option in (before, after))
    requirements = [
        _requirement_change(old.get(name), new.get(name), tolerance, floors) for name in dict.fromkeys((*new, *old))
    ]
    requirements.sort(key=_requirement_place)
    return OptionChange(
        *names, known.label, *verdicts, tuple(requirements),
        _number_changes(before.numbers, after.numbers, tolerance),
        _sections(before, after, tolerance), tuple(_option_notes(before, after)),
    )  # fmt: skip


def _sections(
    before: OptionRead | ReportRead, after: OptionRead | ReportRead, tolerance: float
) -> tuple[SectionChange, ...]:
    """Those parts that differ, of an option or of the whole report."""
    changes = (
        section_change(name, before.sections.get(name), after.sections.get(name), tolerance=tolerance)
        for name in dict.fromkeys((*before.sections, *after.sections))
    )
    return tuple(one for one in changes if one.changed or one.other)


def _option_notes(before: OptionRead, after: OptionRead) -> Iterable[str]:
    if before.label != after.label:
        yield f"the label was {before.label!r}"
    if before.kind != after.kind:
        yield f"kind: {before.kind} became {after.kind}"
    if before.failure != after.failure:
        if after.failure:
            yield f"could not be studied: {after.failure}"
        else:
            yield f"could not be studied before: {before.failure}"
    if before.summary != after.summary:
        yield from (f"no longer: {line}" for line in before.summary if line not in after.summary)
        yield from (f"now: {line}" for line in after.summary if line not in before.summary)


def _requirement_change(
    before: RequirementRead | None, after: RequirementRead | None, tolerance: float, floors: dict[str, float]
) -> RequirementChange:
    known = after or before
    assert known is not None
    old, new = before or after, after or before
    assert old is not None and new is not None
    floor = floors.get(known.quantity, 0.0)
    value, limit = (
        number_change(
            name,
            math.nan if before is None else getattr(before, name),
            after=math.nan if after is None else getattr(after, name),
            unit=known.unit, unit_before=old.unit, tolerance=tolerance, floor=floor if name == "value" else 0.0,
        )
        for name in ("value", "limit")
    )  # fmt: skip
    same_question = (old.quantity, old.sense) == (new.quantity, new.sense)
    upward = 1.0 if known.sense == "at_least" else -1.0
    gain = upward * value.absolute if value.changed and same_question else math.nan
    room = upward * limit.absolute if limit.changed and same_question else math.nan
    return RequirementChange(
        name=known.name,
        outcome=_outcome(before, after),
        verdict_before=None if before is None else before.verdict,
        verdict_after=None if after is None else after.verdict,
        value=value,
        limit=limit,
        sense=known.sense,
        toward="better" if gain > 0.0 else "worse" if gain < 0.0 else "",
        limit_toward="looser" if room < 0.0 else "tighter" if room > 0.0 else "",
        bound_before=old.bound,
        bound_after=new.bound,
        worst_at_before=old.worst_at,
        worst_at_after=new.worst_at,
        hard=old.hard or new.hard,
        notes=tuple(_requirement_notes(old, new)),
    )


def _requirement_notes(before: RequirementRead, after: RequirementRead) -> Iterable[str]:
    if (before.quantity, before.sense) != (after.quantity, after.sense):
        yield (
            f"asks for something else: {before.quantity} {before.sense} became {after.quantity} {after.sense}, so the "
            "values cannot be compared"
        )
    elif before.description != after.description:
        yield f"asked for {before.description!r} before, now for {after.description!r}"
    if before.hard != after.hard:
        yield "was a wish, is now a requirement" if after.hard else "was a requirement, is now a wish"
    if after.verdict is not Verdict.PASS and after.reason and (before.verdict, before.reason) != (
        after.verdict, after.reason,
    ):  # fmt: skip
        yield after.reason


def _outcome(before: RequirementRead | None, after: RequirementRead | None) -> Outcome:
    """Only PASS is good; FAIL and NOT EVALUATED stand beside each other, so neither change between them is better."""
    if after is None:
        return Outcome.GONE
    passes = after.verdict is Verdict.PASS
    if before is None:
        return Outcome.NEW if passes else Outcome.UNMET
    if before.verdict is after.verdict:
        return Outcome.SAME
    if passes:
        return Outcome.BETTER
    return Outcome.WORSE if before.verdict is Verdict.PASS else Outcome.OTHER


def _number_changes(
    before: Sequence[NumberRead], after: Sequence[NumberRead], tolerance: float
) -> tuple[NumberChange, ...]:
    """Those of two lists of named numbers that differ; one that is missing is NaN."""
    old, new = ({one.name: one for one in numbers} for numbers in (before, after))
    changes = []
    for name in dict.fromkeys((*old, *new)):
        a, b = old.get(name), new.get(name)
        one = b or a
        assert one is not None
        change = number_change(
            name, math.nan if a is None else a.value, after=math.nan if b is None else b.value, unit=one.unit,
            unit_before=one.unit if a is None else a.unit, tolerance=tolerance,
            floor=sum(number.error for number in (a, b) if number is not None),
        )  # fmt: skip
        # A number that only one report has is a change even where its value is NaN.
        if change.changed or a is None or b is None:
            changes.append(change)
    return tuple(changes)


def _requirement_place(change: RequirementChange) -> tuple[int, int, float]:
    """Worst first; among equal verdicts those whose value went the wrong way, the largest share first."""
    way = {"worse": 0, "": 1, "better": 2}[change.toward]
    share = 0.0 if math.isnan(change.value.relative) else abs(change.value.relative)
    place = _PLACES[change.outcome] if change.hard or change.outcome not in COUNTED else _PLACES[Outcome.SAME]
    return place, way, -share


def _option_place(option: OptionChange) -> tuple[int, int, int]:
    standing = {"gone": 0, "both": 1, "renamed": 1, "new": 2}[option.standing]
    worst = min((_PLACES[one.outcome] for one in option.counted), default=len(_PLACES))
    return standing, worst, -len(option.counted)
