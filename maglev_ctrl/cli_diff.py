"""The verb `diff`: what changed between two reports; everything heavy is loaded inside."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from maglev_ctrl.cli_output import answer, manner, say_quietly
from maglev_ctrl.cli_terminal import NOT_PASSED, PASSED, VERDICT_STYLES, console

if TYPE_CHECKING:
    from rich.console import Console

    from maglev_ctrl.errors import Verdict
    from maglev_ctrl.report.difference_records import (
        Difference,
        NumberChange,
        OptionChange,
        RequirementChange,
        SectionChange,
    )

Report = Annotated[Path, typer.Argument(metavar="REPORT", help="Folder with report.json, or that file.",
                                        show_default=False)]  # fmt: skip

_WAYS = {"worse": "red", "better": "green", "": "default"}
_SIGNS = {"exact": "", "lower": "≥ ", "upper": "≤ "}
_SCENARIO = {
    "same": "the same",
    "words": "says the same; the text of the file differs",
    "data": "the file is the same; its data files differ",
    "changed": "changed",
}


def diff(
    before: Report,
    after: Report,
    tolerance: Annotated[
        float, typer.Option("--tolerance", metavar="SHARE", help="Relative change up to which numbers are equal.")
    ] = 1e-6,
) -> None:
    """What changed from one report to another, worst first.

    The second is at least as good where every option and requirement of the first is still there, and each requirement
    of these options passes in the second or has the verdict it had. Options that only the second report has, and wishes
    (requirements that are not hard), are told but not judged.
    """
    if not 0.0 <= tolerance < 1.0:
        raise typer.BadParameter(f"expected at least 0 and below 1, got {tolerance:g}", param_hint="--tolerance")

    from maglev_ctrl.report.difference import difference, difference_plain
    from maglev_ctrl.report.reading import read_report

    found = difference(read_report(before), read_report(after), tolerance=tolerance)
    _print(found)
    verdict = _verdict(found)[0]
    say_quietly(f"{verdict}: {_summary(found)}")
    if manner().as_json:
        answer({"before": str(before), "after": str(after), **difference_plain(found)})
    raise typer.Exit(PASSED if found.at_least_as_good else NOT_PASSED)


def _print(found: Difference) -> None:
    from rich.markup import escape

    screen = console()
    title = found.title_before
    if found.title_after != title:
        title += f" → {found.title_after}"
    screen.print(f"[bold]{escape(title)}[/]")
    if not found.empty:
        _print_scenario(screen, found)
        for option in found.options:
            if option.changed:
                _print_option(screen, option)
        for section in found.sections:
            screen.print(f"- {escape(_section_words(section))}")
        same = [option.label for option in found.options if not option.changed]
        if same:
            screen.print(f"without a difference: {escape(', '.join(same))}")
    verdict, colour = _verdict(found)
    screen.print(f"[{colour}]{verdict}[/]: {_summary(found)}")


def _verdict(found: Difference) -> tuple[str, str]:
    """In two or three words, with their colour."""
    if found.empty:
        return "no difference", "green"
    return ("at least as good", "green") if found.at_least_as_good else ("NOT AS GOOD", "red")


def _print_scenario(screen: Console, found: Difference) -> None:
    from rich.markup import escape

    screen.print(f"scenario: {_SCENARIO[found.scenario]}")
    colours = {"+": "green", "-": "red", "@": "cyan"}
    for line in found.scenario_lines:
        screen.print(f"  [{colours.get(line[:1], 'default')}]{escape(line)}[/]")
    if found.scenario_lines_left:
        screen.print(f"  ... {found.scenario_lines_left} more line(s)")
    if found.versions:
        pairs = (f"{name} {old or 'none'} → {new or 'none'}" for name, old, new in found.versions)
        screen.print(f"versions: {escape('; '.join(pairs))}")
    for change in found.design_point:
        screen.print(f"{change.name}: {escape(' → '.join(_ends(change)))} ({escape(_step(change))})")


def _print_option(screen: Console, option: OptionChange) -> None:
    from rich.markup import escape
    from rich.table import Table

    screen.print()
    name = {
        "gone": "[red]gone[/]", "new": "new", "both": "",
        "renamed": f"{escape(option.name_before)} is now {escape(option.name_after)}",
    }[option.standing]  # fmt: skip
    first, last = option.verdict_before, option.verdict_after
    verdict = _words(first or last, last or first)
    screen.print(": ".join(part for part in (f"[bold]{escape(option.label)}[/]", name, verdict) if part))
    rows = [_requirement_row(one) for one in option.requirements if one.changed]
    for number, change in enumerate(option.numbers):
        rows.append(("at the design point" if number == 0 else "", escape(change.name), *_cells(change), ""))
    if rows:
        table = Table()
        for heading in ("requirement", "verdict", "before", "after", "change", "worst at"):
            right = heading in ("before", "after")
            table.add_column(heading, overflow="fold", justify="right" if right else "left")
        for row in rows:
            table.add_row(*row)
        screen.print(table)
    notes = [f"{one.name}: {note}" for one in option.requirements for note in _requirement_notes(one)]
    for note in (*option.notes, *notes, *(_section_words(one) for one in option.sections)):
        screen.print(f"  - {escape(note)}")


def _requirement_row(change: RequirementChange) -> tuple[str, ...]:
    from rich.markup import escape

    before, after = _ends(change.value)
    step = _step(change.value)
    way = f"{step}, {change.toward}" if change.toward else step
    at = change.worst_at_after
    if change.worst_at_before != at and change.verdict_before is not None and change.verdict_after is not None:
        at = f"{change.worst_at_before or 'nowhere'} → {at or 'nowhere'}"
    return (
        escape(change.name) + ("" if change.hard else " (wish)"), _words(change.verdict_before, change.verdict_after),
        _SIGNS[change.bound_before] * bool(before) + escape(before),
        _SIGNS[change.bound_after] * bool(after) + escape(after),
        f"[{_WAYS[change.toward]}]{escape(way)}[/]", escape(at),
    )  # fmt: skip


def _requirement_notes(change: RequirementChange) -> Iterator[str]:
    if change.limit.changed and change.verdict_before is not None and change.verdict_after is not None:
        sign = "≥" if change.sense == "at_least" else "≤"
        way = f", {change.limit_toward}" if change.limit_toward else ""
        yield f"limit {sign} {' → '.join(_ends(change.limit))}{way}"
    yield from change.notes


def _section_words(change: SectionChange) -> str:
    said = []
    if change.changed:
        words = f"{change.changed} of {change.numbers} numbers differ"
        if change.largest is not None:
            words += f", most at {change.largest.name}: {' → '.join(_ends(change.largest))}"
        said.append(words)
    if change.other:
        said.append(f"{change.other} text(s) or list(s) differ, the first at {change.other_at}")
    return f"{change.name}: {'; '.join(said)}"


def _words(before: Verdict | None, after: Verdict | None) -> str:
    """One verdict, or two with an arrow, in their colours."""
    old, new = ("" if one is None else one.value for one in (before, after))
    if old == new:
        return f"[{VERDICT_STYLES[new]}]{new}[/]"
    return f"[{VERDICT_STYLES[old]}]{old or 'not asked'}[/] → [{VERDICT_STYLES[new]}]{new or 'gone'}[/]"


def _cells(change: NumberChange) -> tuple[str, str, str]:
    from rich.markup import escape

    before, after = _ends(change)
    return escape(before), escape(after), escape(_step(change))


def _ends(change: NumberChange) -> tuple[str, str]:
    """Both numbers with as many digits as it takes to tell them apart."""
    from maglev_ctrl.report.style import number

    digits = 3
    if change.changed and math.isfinite(change.relative) and change.relative != 0.0:
        digits = min(9, max(3, 2 - math.floor(math.log10(abs(change.relative)))))
    return number(change.before, change.unit_before, digits=digits), number(change.after, change.unit, digits=digits)


def _step(change: NumberChange) -> str:
    """The change with its sign and its share, e.g. "+0.2 dB (+4 %)"."""
    from maglev_ctrl.report.style import number

    if change.unit != change.unit_before:
        return "another unit"
    if math.isnan(change.absolute) or not change.changed:
        return ""
    words = _signed(number(change.absolute, change.unit))
    if math.isfinite(change.relative):
        words += f" ({_signed(number(100.0 * change.relative, '%', digits=2))})"
    return words


def _signed(words: str) -> str:
    from maglev_ctrl.report.style import MINUS

    return words if words.startswith(MINUS) else f"+{words}"


def _summary(found: Difference) -> str:
    """The whole in a line."""
    from maglev_ctrl.report.difference_records import Outcome

    standings = [option.standing for option in found.options]
    asked = sum(len(option.requirements) for option in found.options)
    counts = [(outcome.value, found.count(outcome)) for outcome in Outcome if outcome is not Outcome.SAME]
    told = [f"{count} {words}" for words, count in counts if count]
    both = sum(standing in ("both", "renamed") for standing in standings)
    said = f"{both} option(s) in both reports with {asked} requirement(s)"
    said += f": {', '.join(told)}" if told else ", no verdict changed"
    tail = [f"{standings.count(word)} option(s) {word}" for word in ("gone", "new", "renamed") if word in standings]
    losing = [
        f"{option.label}: {', '.join(one.name for one in option.counted)}"
        for option in found.options if option.counted
    ]  # fmt: skip
    return "; ".join((said, *tail, *losing))
