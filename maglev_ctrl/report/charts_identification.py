"""Figures of an identification: complex stiffness with its fit, residuals, and damping and mass over frequency."""

from __future__ import annotations

from typing import cast

import numpy as np

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.forces.identification import Description, Estimate, Identification
from maglev_ctrl.report.chart import Area, Axis, Chart, Item, Line, Marks, Panel, Rule, Span
from maglev_ctrl.report.identification_values import Result
from maglev_ctrl.report.style import INK, MINUS, PALETTE, Dash

_FIT, _BAND, _MASS = PALETTE[1], PALETTE[6], PALETTE[2]
_CURVE = 200
_FREQUENCY = "frequency (Hz)"


def charts(result: Result, *, key: str) -> tuple[Chart, ...]:
    """Every figure the result has something to draw for; `key` makes their names unique."""
    made = [response_chart(result, key=key)]
    if result.found.errors_from != "none" and result.found.frequency.size > 1:
        made.append(residual_chart(result, key=key))
    made.append(coefficient_chart(result, key=key))
    return tuple(made)


def response_chart(result: Result, *, key: str) -> Chart:
    """Re Q and Im Q over frequency: measured with 95 % bars, fitted with its 95 % band."""
    found = result.found
    factor, unit = scaled(np.abs(found.response), result.series.units[0])
    hertz = found.frequency / (2.0 * np.pi)
    low = 0.0 if found.separated and not np.isnan(found.static) else float(hertz[0])
    curve = np.linspace(low, float(hertz[-1]), _CURVE)
    model, spread = found.model(2.0 * np.pi * curve)
    panels = []
    for part, name in enumerate(("Re Q", "Im Q")):
        values = (found.response.real, found.response.imag)[part] * factor
        fitted = (model.real, model.imag)[part] * factor
        half = found.quantile * spread[:, part] * factor
        items: list[Item] = []
        if np.isfinite(half).all() and curve.size and hertz.size > 1:
            x, y = np.concatenate([curve, curve[::-1]]), np.concatenate([fitted + half, (fitted - half)[::-1]])
            items.append(Area(x, y, "95 % band", fill=_BAND, opacity=0.35, edge=None))
        if np.isfinite(fitted).all() and hertz.size > 1:
            rejected = found.description is Description.FREQUENCY_DEPENDENT
            label, dash = ("best constants, rejected", "dash") if rejected else ("constant m, c, k", "solid")
            items.append(Line(curve, fitted, label, colour=_FIT, dash=cast("Dash", dash)))
        items += _bars(hertz, values, found.quantile * found.response_error[:, part] * factor)
        items.append(Marks(hertz, values, "circle", "measured", size=4.5))
        if part == 0 and not np.isnan(found.static):
            place, level = np.zeros(1), np.array([found.static * factor])
            half_static = found.quantile * np.array([found.static_error]) * factor
            items += _bars(place, level, half_static)
            items.append(Marks(place, level, "diamond", "static stiffness", colour=_MASS, size=5.0))
        panels.append(Panel(tuple(items), Axis(_FREQUENCY), Axis(f"{name} ({unit})")))
    return Chart(
        key=f"{key}-response",
        caption=(
            f"Complex stiffness Q of the {result.label}: force on the vehicle per unit displacement. Bars and "
            f"band hold the true value with 95 %. Constant coefficients make Re Q = k {MINUS} m ω² a "
            "parabola in frequency and Im Q = c ω a line through zero."
        ),
        alt=f"Real and imaginary part of the complex stiffness, {result.label}; {found.description.value}",
        panels=tuple(panels), share_x=True, panel_height=1.7,
    )  # fmt: skip


def residual_chart(result: Result, *, key: str) -> Chart:
    """What the fit leaves over, in standard errors."""
    found = result.found
    hertz = found.frequency / (2.0 * np.pi)
    left = found.response - found.fitted
    error = np.where(found.response_error > 0.0, found.response_error, np.nan)
    items: tuple[Item, ...] = (
        Span("y", -found.quantile, found.quantile, _BAND, opacity=0.18, label="95 % of a good fit"),
        Rule("y", 0.0, dash="solid", width=0.7),
        Marks(hertz, left.real / error[:, 0], "circle", "real part", colour=INK),
        Marks(hertz, left.imag / error[:, 1], "open_circle", "imaginary part", colour=_FIT, size=6.0),
    )
    largest = float(np.nanmax(np.abs(np.concatenate([left.real / error[:, 0], left.imag / error[:, 1], [0.0]]))))
    reach = 1.15 * max(largest, found.quantile, 1.0)
    return Chart(
        key=f"{key}-residuals",
        caption=(
            f"Measured minus fitted, {result.label}, in standard errors ({_errors_words(result)}). A pattern over "
            "frequency means that m, c or k is not constant."
        ),
        alt=f"Residuals of the fit over frequency, {result.label}; largest {largest:.2g} standard errors",
        panels=(Panel(items, Axis(_FREQUENCY), Axis("residual / error", limits=(-reach, reach))),), panel_height=1.5,
    )  # fmt: skip


def coefficient_chart(result: Result, *, key: str) -> Chart:
    """c(w), and m(w) where a stiffness is known, against the constants."""
    found = result.found
    hertz = found.frequency / (2.0 * np.pi)
    panels = [
        _coefficient(hertz, found.damping_at, found.damping_error_at, found.damping, found, "c", result.series.units[1])
    ]
    words = ""
    if not np.isnan(found.mass_at).all():
        panels.append(
            _coefficient(hertz, found.mass_at, found.mass_error_at, found.mass, found, "m", result.series.units[2])
        )
        words = f" m(ω) = (k {MINUS} Re Q)/ω² with k from the {found.mass_from}; its bars grow as 1/ω²."
    else:
        words = " m(ω) is not drawn: it needs the static stiffness."
    return Chart(
        key=f"{key}-coefficients",
        caption=f"Frequency by frequency, {result.label}: c(ω) = Im Q/ω, 95 % bars.{words}",
        alt=f"Damping and mass derivative over frequency, {result.label}",
        panels=tuple(panels), share_x=True, panel_height=1.5,
    )  # fmt: skip


def _coefficient(
    hertz: FloatArray, values: FloatArray, errors: FloatArray, constant: Estimate, found: Identification, symbol: str,
    unit: str,
) -> Panel:  # fmt: skip
    factor, unit = scaled(np.abs(values), unit)
    items: list[Item] = [Rule("y", 0.0, dash="solid", width=0.7)] if np.ptp(np.sign(values)) > 0 else []
    if not np.isnan(constant.low):
        items.append(
            Span("y", constant.low * factor, constant.high * factor, _BAND, opacity=0.35, label="95 % interval")
        )
    if not np.isnan(constant.value):
        items.append(Rule("y", constant.value * factor, "constant", colour=_FIT, dash="solid", width=1.2))
    items += _bars(hertz, values * factor, found.quantile * errors * factor)
    items.append(Marks(hertz, values * factor, "circle", "measured", size=4.5))
    return Panel(tuple(items), Axis(_FREQUENCY), Axis(f"{symbol} ({unit})"))


def _bars(x: FloatArray, y: FloatArray, half: FloatArray) -> list[Item]:
    """Error bars as one broken line."""
    if not np.isfinite(half).any():
        return []
    gap = np.full_like(x, np.nan)
    across = np.column_stack([x, x, gap]).ravel()
    return [Line(across, np.column_stack([y - half, y + half, gap]).ravel(), "", width=0.9)]


def _errors_words(result: Result) -> str:
    if result.series.records:
        return "of the sine fits"
    return "as given with the data" if result.found.errors_from == "given" else "estimated from these very residuals"


def scaled(values: FloatArray, unit: str) -> tuple[float, str]:
    """Factor and unit that keep the numbers on an axis short.

    Examples
    --------
    >>> scaled(np.array([2.0e6]), "N/m"), scaled(np.array([3.0]), "kg")
    ((1e-06, 'MN/m'), (1.0, 'kg'))
    """
    known = np.asarray(values)[np.isfinite(values)]
    largest = float(np.max(np.abs(known))) if known.size else 0.0
    if not unit.startswith("N"):
        return 1.0, unit
    if largest >= 1e6:
        return 1e-6, f"M{unit}"
    return (1e-3, f"k{unit}") if largest >= 1e4 else (1.0, unit)
