"""A comparison written as a folder of reports: HTML, PDF, JSON and Markdown, all or nothing."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Literal, assert_never, get_args

from maglev_ctrl.report.content import report_model
from maglev_ctrl.report.folder import write_whole
from maglev_ctrl.report.html import html
from maglev_ctrl.report.markdown import FIGURES, markdown
from maglev_ctrl.report.pdf import pdf
from maglev_ctrl.report.serialise import to_json
from maglev_ctrl.report.vector import svg
from maglev_ctrl.study.records import Comparison

Format = Literal["html", "pdf", "json", "md"]
FORMATS: tuple[Format, ...] = get_args(Format)
USUAL: tuple[Format, ...] = ("html", "pdf", "json")
"""What is written where nothing else is asked for."""
TUNED = "tuned.toml"
"""The scenario with the values that tuning chose, beside the report of a tuned comparison."""


def write(
    comparison: Comparison, folder: str | os.PathLike[str], *, formats: Sequence[Format] = USUAL
) -> tuple[Path, ...]:
    """Write report.html, report.pdf, report.json, report.md into `folder`; returns paths in the order of `formats`.

    report.md has its figures beside it, in the folder report_figures, which is exchanged as a whole.

    Everything is made in a temporary folder beside `folder` and moved there only when complete: a failure leaves an
    earlier report as it was. What an earlier report has in a format not asked for now goes with it, for it would
    contradict the new one; other files in `folder` are kept.

    Parameters
    ----------
    folder : made when it does not exist

    Raises
    ------
    ValueError : an unknown or doubled format, or none
    """
    unknown = [name for name in formats if name not in FORMATS]
    if unknown or not formats or len(set(formats)) != len(formats):
        raise ValueError(f"formats: expected distinct names out of {', '.join(FORMATS)}, got {tuple(formats)}")
    made = _contents(comparison, formats)
    if comparison.tuning is not None:
        made[TUNED] = comparison.scenario_text.encode()
    known = [TUNED, FIGURES, *(f"report.{name}" for name in FORMATS)]
    return write_whole(made, Path(folder), replaced=known)


def _contents(comparison: Comparison, formats: Sequence[Format]) -> dict[str, bytes]:
    """Content by file name, in the order of `formats`."""
    made: dict[str, bytes] = {}
    if set(formats) != {"json"}:
        report = report_model(comparison)
        pictures = {chart.key: svg(chart) for chart in report.charts()}
    for name in formats:
        match name:
            case "html":
                made["report.html"] = html(report, pictures).encode()
            case "pdf":
                made["report.pdf"] = pdf(report, pictures)
            case "md":
                made |= markdown(report, pictures)
            case "json":
                made["report.json"] = to_json(comparison).encode()
            case _:
                assert_never(name)
    return made
