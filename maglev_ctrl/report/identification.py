"""An identification written as a folder: identify.html, identify.csv and identify.json, whole or not at all."""

from __future__ import annotations

import hashlib
import os
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

import numpy as np

from maglev_ctrl._version import __version__
from maglev_ctrl.errors import Verdict
from maglev_ctrl.report.charts_identification import charts
from maglev_ctrl.report.folder import write_whole
from maglev_ctrl.report.html import html
from maglev_ctrl.report.identification_values import (
    SIGNS,
    Result,
    frequency_columns,
    frequency_rows,
    interval_words,
    opposite,
    to_csv,
    to_json,
    value_words,
)
from maglev_ctrl.report.model import Banner, Block, Bullets, FigureBlock, Paragraph, Report, Section, Table, row
from maglev_ctrl.report.style import ABSENT, MINUS, number
from maglev_ctrl.report.vector import svg

METHOD: Final = (
    f"Q = force / displacement is fitted by Q(ω) = k {MINUS} m ω² + i ω c, real and imaginary parts together, weighted "
    "by the errors given with the data or by one standard error estimated from the residuals (Eqs. 6-9).",
    "Intervals hold the true value with 95 %: normal quantiles where errors are given as known, Student's t where "
    "they are estimated.",
    "Constants are called frequency dependent when so large a misfit, or so clear a trend in the residuals, has a "
    "chance below 1 % with constant m, c, k. Then no constant is given.",
    "Records over time are fitted by a sine of free frequency with offset, drift and harmonics; phasors belong to "
    "exp(+iωt), so a positive phase is a force ahead of the displacement.",
    "The coefficients belong to the speed, height and gap of the test; nothing here says how they change with them.",
)


def write_identification(
    results: Sequence[Result], folder: str | os.PathLike[str], *, files: Sequence[str | os.PathLike[str]]
) -> tuple[Path, ...]:
    """Write identify.html, identify.csv and identify.json into `folder`; other files there are kept.

    Everything is made in a temporary folder beside `folder` and moved only when complete, so that a failure leaves an
    earlier identification as it was.

    Parameters
    ----------
    folder : made when it does not exist
    files : the data files, named with their hashes
    """
    digests = {os.fspath(name): hashlib.sha256(Path(name).read_bytes()).hexdigest() for name in files}
    made = {
        "identify.html": page(results, files=digests),
        "identify.csv": to_csv(results),
        "identify.json": to_json(results, files=digests) + "\n",
    }
    return write_whole({name: text.encode() for name, text in made.items()}, Path(folder))


def page(results: Sequence[Result], *, files: Mapping[str, str]) -> str:
    """The page; `files` are the SHA-256 of the data files by name."""
    report = Report(
        title="Identification of magnetic mass, damping and stiffness",
        subtitle="From forced oscillations: " + ", ".join(Path(name).name for name in files),
        created=time.strftime("%Y-%m-%d %H:%M"),
        scenario_hash=hashlib.sha256("".join(files.values()).encode()).hexdigest(),
        version=__version__,
        sections=(
            _summary(results),
            *(_section(place, result) for place, result in enumerate(results)),
            Section("Method", "method", 1, (Bullets(METHOD),)),
            Section("Data", "data", 1, (Bullets(tuple(f"{name}: SHA-256 {d}" for name, d in files.items())),)),
        ),
    )
    text = html(report, {chart.key: svg(chart) for chart in report.charts()})
    return text.replace(" · scenario ", " · data ", 1)  # the page's head speaks of a scenario; here it is data


def _summary(results: Sequence[Result]) -> Section:
    rows = tuple(
        row(f"{result.label}: {symbol}", value_words(estimate), interval_words(estimate), unit,
            value_words(opposite(estimate)) if len(symbol) == 1 else ABSENT, estimate.reason)
        for result in results for symbol, unit, estimate in result.quantities()
    )  # fmt: skip
    columns = ("derivative", "value ± 95 %", "95 % interval", "unit", "left-hand side", "why not")
    blocks: list[Block] = []
    for result in results:
        blocks.append(_banner(result))
    blocks += [
        Table("Derivatives of the force on the vehicle, and on the left-hand side.", columns, rows, right=(1, 2, 4)),
        Paragraph(SIGNS),
    ]  # fmt: skip
    return Section("Coefficients", "coefficients", 1, tuple(blocks))


def _banner(result: Result) -> Banner:
    """Told as evaluated only where m, c and k are all there and not contradicted."""
    return Banner(None if result.identified else Verdict.NOT_EVALUATED, f"{result.label}: {result.words()[0]}.")


def _section(place: int, result: Result) -> Section:
    key = f"pair-{place + 1}"
    blocks: list[Block] = [Bullets(result.words())]
    blocks += [FigureBlock(chart) for chart in charts(result, key=key)]
    blocks.append(_by_frequency(result))
    if result.series.records:
        blocks.append(_records(result))
    return Section(result.label[:1].upper() + result.label[1:], key, 1, tuple(blocks))


def _by_frequency(result: Result) -> Table:
    return Table(
        f"Frequency by frequency, {result.label}, with standard errors.", frequency_columns(result),
        tuple(row(*values) for values in frequency_rows(result)), right=tuple(range(1, 9)), small=True,
    )  # fmt: skip


def _records(result: Result) -> Table:
    rows = tuple(
        row(record.name, record.source, number(record.fit.frequency / (2.0 * np.pi), digits=5),
            number(record.fit.frequency_error / (2.0 * np.pi), digits=2), number(record.fit.periods),
            _harmonics(record.fit.harmonics_displacement), _harmonics(record.fit.harmonics_force),
            " / ".join(number(value, digits=2) for value in record.fit.autocorrelation))
        for record in result.series.records
    )  # fmt: skip
    columns = (
        "record", "from", "frequency (Hz)", "error (Hz)", "periods", "harmonics 2, 3, … of displacement (%)",
        "of force (%)", "autocorrelation",
    )  # fmt: skip
    caption = "Sine fits: harmonics over the fundamental; correlation of neighbouring residuals (displacement / force)."
    return Table(caption, columns, rows, right=(2, 3, 4), small=True)


def _harmonics(values: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> str:
    return ", ".join(number(100.0 * float(value), digits=2) for value in values) or ABSENT
