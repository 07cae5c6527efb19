"""A comparison written as a folder of reports: HTML, PDF and JSON, all or nothing."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Literal, get_args

from maglev_ctrl.report.content import report_model
from maglev_ctrl.report.folder import write_whole
from maglev_ctrl.report.html import html
from maglev_ctrl.report.pdf import pdf
from maglev_ctrl.report.serialise import to_json
from maglev_ctrl.report.vector import svg
from maglev_ctrl.study.records import Comparison

Format = Literal["html", "pdf", "json"]
FORMATS: tuple[Format, ...] = get_args(Format)
TUNED = "tuned.toml"
"""The scenario with the values that tuning chose, beside the report of a tuned comparison."""


def write(
    comparison: Comparison, folder: str | os.PathLike[str], *, formats: Sequence[Format] = FORMATS
) -> tuple[Path, ...]:
    """Write report.html, report.pdf and report.json into `folder`; returns their paths in the order of `formats`.

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
    contents = _contents(comparison, formats)
    made = {f"report.{name}": contents[name] for name in formats}
    if comparison.tuning is not None:
        made[TUNED] = comparison.scenario_text.encode()
    return write_whole(made, Path(folder), replaced=[TUNED, *(f"report.{name}" for name in FORMATS)])


def _contents(comparison: Comparison, formats: Sequence[Format]) -> dict[Format, bytes]:
    made: dict[Format, bytes] = {}
    if "html" in formats or "pdf" in formats:
        report = report_model(comparison)
        pictures = {chart.key: svg(chart) for chart in report.charts()}
        if "html" in formats:
            made["html"] = html(report, pictures).encode()
        if "pdf" in formats:
            made["pdf"] = pdf(report, pictures)
    if "json" in formats:
        made["json"] = to_json(comparison).encode()
    return made
