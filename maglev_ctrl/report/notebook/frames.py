"""Results as pandas tables: one row per mode, margin, requirement or candidate, units in the names of columns."""

from __future__ import annotations

from functools import singledispatch
from typing import TYPE_CHECKING, Any

import numpy as np

from maglev_ctrl.analysis.ledger import Ledger
from maglev_ctrl.analysis.margins import Margins
from maglev_ctrl.analysis.modes import Modes
from maglev_ctrl.analysis.response.records import RideResponse
from maglev_ctrl.report.style import unit_words
from maglev_ctrl.study.records import Comparison, OptionStudy, RequirementResult
from maglev_ctrl.study.tuning.records import TuningStudy

if TYPE_CHECKING:
    import pandas


@singledispatch
def to_frame(result: object) -> pandas.DataFrame:
    """A result as a pandas table; what NaN means is in the columns beside it ("verified", "verdict", "reason").

    Knows modes (by mode), ledgers (by mode and element), margins (by channel), options and comparisons (by
    requirement), tuning studies (by candidate of each front) and rides (by passenger).

    Raises
    ------
    TypeError : a result that has no such form

    Examples
    --------
    >>> from maglev_ctrl import SecondOrderSystem, modes
    >>> found = to_frame(modes(SecondOrderSystem.from_matrices([[1.0]], [[0.2]], [[4.0]], dofs=("car.heave",))))
    >>> float(found.loc["car heave", "growth rate (1/s)"].round(6))
    -0.1
    """
    known = ", ".join(sorted(kind.__name__ for kind in to_frame.registry if kind is not object))
    raise TypeError(f"result: a {type(result).__name__} has no table; there are those of {known}")


def _table(rows: list[dict[str, Any]], *index: str) -> pandas.DataFrame:
    import pandas

    frame = pandas.DataFrame(rows)
    return frame.set_index(list(index)) if rows else frame


@to_frame.register(Modes)
def _modes(found: Modes) -> pandas.DataFrame:
    return _table([
        {
            "mode": found.labels[k], "frequency (Hz)": float(found.frequency[k]),
            "natural frequency (rad/s)": float(found.natural_frequency[k]),
            "damping ratio": float(found.damping_ratio[k]), "growth rate (1/s)": float(s.real),
            "error bound (1/s)": float(found.error_bound[k]),
            "kind": found.kind[k].value,
        }
        for k, s in enumerate(found.s)
    ], "mode")  # fmt: skip


@to_frame.register(Ledger)
def _ledger(found: Ledger) -> pandas.DataFrame:
    return _table([
        {
            "mode": k, "element": element, "damping (1/s)": float(found.damping[e, k]),
            "circulatory (1/s)": float(found.circulatory[e, k]),
            "sum (1/s)": float(found.damping[e, k] + found.circulatory[e, k]),
        }
        for k in range(len(found.growth))
        for e, element in enumerate(found.elements)
    ], "mode", "element")  # fmt: skip


@to_frame.register(Margins)
def _margins(found: Margins) -> pandas.DataFrame:
    return _table([
        {
            "channel": one.channel, "gain reduction (dB)": one.gain_reduction.decibel,
            "gain increase (dB)": one.gain_increase.decibel, "phase (deg)": one.phase.value,
            "delay (s)": one.delay.value, "modulus": one.modulus.value, "largest |S|": one.sensitivity_peak,
            "largest |T|": one.complementary_peak.value, "disk margin": one.disk.alpha,
            "disk margin, proven": one.disk.alpha_proven, "verified": one.verified,
        }
        for one in found.channels
    ], "channel")  # fmt: skip


@to_frame.register(OptionStudy)
def _option(found: OptionStudy) -> pandas.DataFrame:
    return _table([{"requirement": one.name, **_judged(one)} for one in found.requirements], "requirement")


@to_frame.register(Comparison)
def _comparison(found: Comparison) -> pandas.DataFrame:
    return _table([
        {"option": option.name, "requirement": one.name, **_judged(one)}
        for option in found.options
        for one in option.requirements
    ], "option", "requirement")  # fmt: skip


def _judged(one: RequirementResult) -> dict[str, Any]:
    return {
        "quantity": one.quantity, "sense": one.sense, "limit": one.limit, "value": one.value, "unit": one.unit,
        "bound": one.bound, "margin (%)": one.margin_percent, "verdict": one.verdict.value, "hard": one.hard,
        "worst at": one.worst_at, "reason": one.reason,
    }  # fmt: skip


@to_frame.register(TuningStudy)
def _tuning(found: TuningStudy) -> pandas.DataFrame:
    def head(label: str, unit: str) -> str:
        return f"{label} ({unit_words(unit)})" if unit else label

    rows = []
    for option in found.options:
        for k in range(len(option.front)):
            row: dict[str, Any] = {
                "option": option.option, "candidate": k, "feasible": option.feasible, "chosen": k == option.chosen,
                "knee": k == option.knee,
            }  # fmt: skip
            for axis, value in zip(found.objectives, option.front[k], strict=True):
                row[head(axis.label, axis.unit)] = float(value) * axis.scale
            for variable, value in zip(option.variables, np.atleast_1d(option.front_variables[k]), strict=True):
                row[head(variable.label, variable.unit)] = float(value) * variable.scale
            rows.append(row)
    return _table(rows, "option", "candidate")


@to_frame.register(RideResponse)
def _ride(found: RideResponse) -> pandas.DataFrame:
    return _table([
        {
            "passenger": one.name, "x (m)": one.x, "y (m)": one.y,
            **{f"{axis} (m/s²)": float(v) for axis, v in zip(one.axes, one.weighted, strict=True)},
            "total (m/s²)": one.total, "comfort": one.comfort, "agreement": one.agreement.value,
        }
        for one in found.passengers
    ], "passenger")  # fmt: skip
