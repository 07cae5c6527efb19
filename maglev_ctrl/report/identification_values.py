"""Identified coefficients in words, rows and JSON; one source for the terminal, the page, the CSV and the JSON file."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from maglev_ctrl._version import __version__
from maglev_ctrl.forces.identification import Description, Estimate, Identification, damping_words
from maglev_ctrl.report.serialise import plain
from maglev_ctrl.report.style import ABSENT, MINUS, number
from maglev_ctrl.scenario.oscillation import OscillationSeries, RecordFit

FORMAT: Final = 1
SIGNS: Final = (
    "Force on the vehicle: force = m u'' + c u' + k u, so c > 0 is negative damping. On the left-hand side of "
    "M q'' + C q' + K q = 0 the signs turn: M_m = -m, C_m = -c, K_m = -k."
)
COLUMNS: Final = (
    "force", "motion", "quantity", "unit", "value", "standard_error", "low_95", "high_95", "left_hand_side",
    "description", "reason",
)  # fmt: skip


@dataclass(frozen=True, eq=False, slots=True)
class Result:
    """What was measured of one force under one motion, and the constants identified from it."""

    series: OscillationSeries
    found: Identification

    @property
    def label(self) -> str:
        """The pair in words."""
        return f"{self.series.force} force by {self.series.motion}"

    @property
    def identified(self) -> bool:
        """Whether m, c and k are numbers that the data do not contradict."""
        return self.found.separated and self.found.description is not Description.FREQUENCY_DEPENDENT

    def quantities(self) -> tuple[tuple[str, str, Estimate], ...]:
        """Symbol, unit and estimate of k, c, m, and of k - m w^2 where that is all there is."""
        k, c, m = self.series.units
        found = self.found
        rows = (("k", k, found.stiffness), ("c", c, found.damping), ("m", m, found.mass))
        return rows if found.separated else (*rows, ("k - m w^2", k, found.dynamic_stiffness))

    def words(self) -> tuple[str, ...]:
        """Sentences: the verdict and its test, what c does, and every note."""
        found = self.found
        test = found.test if math.isnan(found.chance) else f"{found.test}, chance {chance_words(found.chance)}"
        return (
            f"{found.description.value} ({test})" if test else found.description.value,
            damping_words(found, direct=self.series.direct),
            *found.notes,
            *self.series.notes,
        )


def chance_words(chance: float) -> str:
    """A probability, never as a bare zero.

    Examples
    --------
    >>> chance_words(0.0), chance_words(0.25)
    ('below 1e-6', '0.25')
    """
    return "below 1e-6" if chance < 1e-6 else f"{chance:.2g}"


def value_words(estimate: Estimate) -> str:
    """The value with half the width of its 95 % interval, as many digits as that has meaning.

    Examples
    --------
    >>> value_words(Estimate(-4006.63, 10.6, -4027.4, -3985.9)), value_words(Estimate(float("nan")))
    ('−4007 ± 21', '–')
    """
    if math.isnan(estimate.value):
        return ABSENT
    half = 0.5 * (estimate.high - estimate.low)
    if not half > 1e-9 * abs(estimate.value):
        return number(estimate.value, digits=5)
    decimals = 1 - math.floor(math.log10(half))
    if -4 <= decimals <= 6:
        value, width = (f"{round(x, decimals):.{max(decimals, 0)}f}" for x in (estimate.value, half))
    else:
        value, width = (
            f"{estimate.value:.{max(decimals + math.floor(math.log10(abs(estimate.value) or half)), 1)}e}",
            f"{half:.1e}",
        )
    return f"{value} ± {width}".replace("-", MINUS)


def interval_words(estimate: Estimate) -> str:
    """The 95 % interval."""
    if math.isnan(estimate.low):
        return ABSENT
    return f"{number(estimate.low, digits=4)} … {number(estimate.high, digits=4)}"


def frequency_columns(result: Result) -> tuple[str, ...]:
    """Heads of `frequency_rows`."""
    k, c, m = result.series.units
    return (
        "frequency (Hz)", f"Re Q ({k})", "error", f"Im Q ({k})", "error", f"c(ω) ({c})", "error", f"m(ω) ({m})",
        "error",
    )  # fmt: skip


def frequency_rows(result: Result) -> tuple[tuple[str, ...], ...]:
    """Measured values frequency by frequency with their standard errors."""
    found = result.found
    columns = (
        found.frequency / (2.0 * np.pi), found.response.real, found.response_error[:, 0], found.response.imag,
        found.response_error[:, 1], found.damping_at, found.damping_error_at, found.mass_at, found.mass_error_at,
    )  # fmt: skip
    digits = (4, 4, 3, 4, 3, 4, 3, 4, 3)
    return tuple(
        tuple(number(float(value), digits=size) for value, size in zip(values, digits, strict=True))
        for values in zip(*columns, strict=True)
    )


def opposite(estimate: Estimate) -> Estimate:
    """The same with the sign of the left-hand side.

    Examples
    --------
    >>> opposite(Estimate(2.0, 0.5, 1.0, 3.0)).low
    -3.0
    """
    return Estimate(-estimate.value, estimate.error, -estimate.high, -estimate.low, estimate.reason)


def to_csv(results: Sequence[Result]) -> str:
    """One row per force, motion and quantity, SI; empty cells where there is no number, with the reason beside."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(COLUMNS)
    for result in results:
        for symbol, unit, estimate in result.quantities():
            turned = -estimate.value if len(symbol) == 1 else math.nan
            values = (estimate.value, estimate.error, estimate.low, estimate.high, turned)
            writer.writerow([
                _cell(result.series.force), _cell(result.series.motion), symbol, unit,
                *("" if math.isnan(value) else f"{value:.12g}" for value in values),
                result.found.description.name, estimate.reason,
            ])  # fmt: skip
    return stream.getvalue()


def _cell(name: str) -> str:
    """A name from the data as a spreadsheet takes it for text: what begins like a formula is quoted."""
    return f"'{name}" if name.startswith(("=", "+", "-", "@")) else name


def to_json(results: Sequence[Result], *, files: Mapping[str, str]) -> str:
    """Everything as JSON; NaN is the string "NaN", a quantity is {"value": ..., "unit": ...}.

    Parameters
    ----------
    files : SHA-256 of every data file, by name
    """
    body = {
        "format": FORMAT,
        "kind": "maglev-ctrl identification",
        "version": __version__,
        "files": [{"name": name, "sha256": digest} for name, digest in files.items()],
        "signs": SIGNS,
        "series": [_series(result) for result in results],
    }
    return json.dumps(plain(body), ensure_ascii=False, allow_nan=False, indent=1)


def _series(result: Result) -> dict[str, Any]:
    series, found = result.series, result.found
    k, c, m = series.units
    return {
        "force": series.force,
        "motion": series.motion,
        "identified": result.identified,
        "description": found.description.name,
        "test": found.test,
        "chance": found.chance,
        "degrees_of_freedom": found.degrees,
        "errors_from": found.errors_from,
        **{
            name: _estimate(estimate, unit)
            for name, unit, estimate in (
                ("stiffness", k, found.stiffness), ("damping", c, found.damping), ("mass", m, found.mass),
                ("dynamic_stiffness", k, found.dynamic_stiffness),
            )
        },
        "left_hand_side": {
            name: _estimate(opposite(estimate), unit)
            for name, unit, estimate in (("K_m", k, found.stiffness), ("C_m", c, found.damping), ("M_m", m, found.mass))
        },
        "static_stiffness": {"value": found.static, "unit": k, "standard_error": found.static_error},
        "mass_at_from": found.mass_from,
        "at_frequency": [
            {
                "frequency": {"value": w / (2.0 * np.pi), "unit": "Hz"},
                "response": {**plain(complex(q)), "unit": k, "standard_error": plain(error)},
                "damping": {"value": damping, "unit": c, "standard_error": damping_error},
                "mass": {"value": mass, "unit": m, "standard_error": mass_error},
            }
            for w, q, error, damping, damping_error, mass, mass_error in zip(
                found.frequency, found.response, found.response_error, found.damping_at, found.damping_error_at,
                found.mass_at, found.mass_error_at, strict=True,
            )
        ],
        "records": [_record(record) for record in series.records],
        "statements": list(result.words()),
    }  # fmt: skip


def _estimate(estimate: Estimate, unit: str) -> dict[str, Any]:
    return {
        "value": estimate.value, "unit": unit, "standard_error": estimate.error, "low_95": estimate.low,
        "high_95": estimate.high, "reason": estimate.reason,
    }  # fmt: skip


def _record(record: RecordFit) -> dict[str, Any]:
    fit = record.fit
    return {
        "name": record.name,
        "source": record.source,
        "frequency": {"value": fit.frequency / (2.0 * np.pi), "unit": "Hz"},
        "frequency_error": {"value": fit.frequency_error / (2.0 * np.pi), "unit": "Hz"},
        "periods": fit.periods,
        "harmonics_displacement": fit.harmonics_displacement,
        "harmonics_force": fit.harmonics_force,
        "autocorrelation": fit.autocorrelation,
    }
