"""report.json: the whole comparison for machines, every number with its unit, nothing that JSON cannot say.

NaN and infinities are the strings "NaN", "Infinity" and "-Infinity"; complex numbers are {"re": ..., "im": ...};
a quantity with a unit is {"value": ..., "unit": ...}. `SCHEMA` in `maglev_ctrl.report.schema` describes the file.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from typing import Any, Final

import numpy as np

from maglev_ctrl.analysis.margins import MarginValue
from maglev_ctrl.analysis.robustness.records import WorstPoint
from maglev_ctrl.report.units_ride import UNITS_RIDE
from maglev_ctrl.study.records import Comparison, OptionStudy
from maglev_ctrl.systems import SecondOrderSystem

FORMAT: Final = 1

# Units of record fields, by "Record.field". What is not listed is a pure number, a text or a record of its own.
UNITS: Final[dict[str, str]] = {
    "Comparison.design_speed": "m/s", "Comparison.design_height": "m", "Comparison.seconds": "s",
    "OptionStudy.seconds": "s",
    "Sweep.abscissa": "1/s", "RootLocus.s": "1/s", "NyquistCurve.frequency": "rad/s",
    "ModeTracks.s": "1/s",
    "Modes.s": "1/s", "Modes.natural_frequency": "rad/s", "Modes.frequency": "Hz", "Modes.error_bound": "1/s",
    "Ledger.damping": "1/s", "Ledger.circulatory": "1/s", "Ledger.growth": "1/s", "Ledger.residual": "1/s",
    "FloquetStudy.wavelength": "m", "FloquetStudy.worst_speed": "m/s", "FloquetStudy.go_ranges": "m/s",
    "FloquetStudy.no_go_ranges": "m/s",
    "Floquet.exponents": "1/s", "Floquet.growth_rate": "1/s", "Floquet.period": "s",
    "ResonanceMap.growth_rate": "1/s", "ResonanceMap.frequency": "rad/s", "Resonance.frequency": "rad/s",
    "OperatingPoint.speed": "m/s", "OperatingPoint.height": "m", "OperatingPoint.gap": "m",
    "OperatingPoint.lateral_offset": "m",
    "Equilibrium.magnet_heights": "m", "Equilibrium.magnet_gaps": "m",
    "Certificate.spectral_abscissa": "1/s", "Certificate.closed_loop_eigenvalues": "1/s",
    "Certificate.refined_abscissa": "1/s",
    "Body.mass": "kg", "Body.inertia": "kg*m^2", "Body.position": "m", "Magnet.position": "m",
    "SpringDamper.position": "m", "SpringDamper.lag": "s", "Actuator.position": "m", "Actuator.force_limit": "N",
    "Actuator.bandwidth": "rad/s", "Actuator.delay": "s", "Sensor.position": "m",
    "Vehicle.reference_height": "m", "Vehicle.reference_gap": "m", "Vehicle.gravity": "m/s^2",
    "ChannelMargins.phase": "deg", "ChannelMargins.phase_lag": "deg", "ChannelMargins.phase_lead": "deg",
    "ChannelMargins.delay": "s", "DiskMargin.phase": "deg", "DiskMargin.frequency": "rad/s",
    "MarginValue.frequency": "rad/s", "Margins.poles": "1/s", "PeakGain.frequency": "rad/s",
    "TongueRow.first_order_centre": "m/s", "TongueRow.first_order_half_width": "m/s",
    "TongueRow.computed_centre": "m/s", "TongueRow.computed_half_width": "m/s", "TongueRow.peak_growth": "1/s",
    "TongueRemoval.frequency": "rad/s", "TongueRemoval.growth": "1/s",
    "TongueCrossing.speed": "m/s", "TongueCrossing.located": "m/s", "TongueCrossing.half_width": "m/s",
    "TongueCrossing.growth": "1/s",
    "SpeedRange.lower": "m/s", "SpeedRange.upper": "m/s", "SpeedRange.growth": "1/s",
    "Floquet.error_bound": "1/s", "EngineRecord.exponents": "1/s", "Resonance.detuning": "rad/s",
    "Equilibrium.unbalanced": "N", "Equilibrium.preloads": "N", "MagnetForces.lift": "N",
    "SoughtTongue.growth": "1/s", "MagnetForces.guidance": "N", "MagnetForces.drag": "N",
    **UNITS_RIDE,
}  # fmt: skip

# Left out: matrices that the scenario rebuilds, and working copies that repeat what stands elsewhere.
_LEFT_OUT: Final = {
    "Modes.states", "Modes.left", "Modes.state_matrix", "ModeTracks.index", "OptionStudy.open_system",
    "Magnet.force", "CoefficientElement.table", "InertiaCertificate.solution", "RiccatiSolution.P",
    "Boundaries.parameter", "Boundaries.abscissa", "Equilibrium.posture",
}  # fmt: skip


def to_json(comparison: Comparison) -> str:
    """The comparison as JSON text.

    Raises
    ------
    TypeError : a record holds something that has no place in a report
    """
    return json.dumps(to_plain(comparison), ensure_ascii=False, allow_nan=False, separators=(",", ":"))


def to_plain(comparison: Comparison) -> dict[str, Any]:
    """The comparison as plain dictionaries, lists, texts and finite numbers."""
    body = plain(comparison)
    verdict = comparison.verdict.value
    return {"format": FORMAT, "kind": "maglev-ctrl comparison", "verdict": verdict, **body}


def plain(value: Any) -> Any:
    """Any record value in JSON's terms.

    Examples
    --------
    >>> plain((1.5, float("nan"), float("inf"), 2j))
    [1.5, 'NaN', 'Infinity', {'re': 0.0, 'im': 2.0}]
    """
    if value is None or (isinstance(value, (str, bool, int)) and not isinstance(value, Enum)):
        return value
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, np.ndarray):
        return _array(value)
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float):
        return _number(value)
    if isinstance(value, complex):
        return {"re": _number(value.real), "im": _number(value.imag)}
    if isinstance(value, (tuple, list)):
        return [plain(entry) for entry in value]
    if isinstance(value, Mapping):
        return {str(key): plain(entry) for key, entry in value.items()}
    if isinstance(value, SecondOrderSystem):
        return _system(value)
    if is_dataclass(value) and not isinstance(value, type):
        return _record(value)
    raise TypeError(f"report.json: a {type(value).__name__} has no place in a report")


def _record(value: Any) -> dict[str, Any]:
    owner = type(value).__name__
    out: dict[str, Any] = {}
    for entry in fields(value):
        key = f"{owner}.{entry.name}"
        if key in _LEFT_OUT or entry.name.startswith("_"):
            continue
        content = getattr(value, entry.name)
        unit = _unit(value, key)
        if isinstance(content, MarginValue):
            out[entry.name] = {**plain(content), "unit": unit or "factor"}
        elif isinstance(content, WorstPoint):
            out[entry.name] = {**plain(content), "unit": unit or ""}
        else:
            out[entry.name] = plain(content) if unit is None else {"value": plain(content), "unit": unit}
    if isinstance(value, OptionStudy):
        out["verdict"] = value.verdict.value
    return out


def _unit(value: Any, key: str) -> str | None:
    """Unit of a field; requirements, sweeps, signals and springs carry theirs along."""
    owner, _, name = key.partition(".")
    match owner:
        case "RequirementResult" if name in ("limit", "value"):
            return str(value.unit)
        case "RequirementResult" if name == "margin_percent":
            return "%"
        case "Sweep" if name == "values":
            return _SWEEP_UNITS[value.parameter]
        case "PeriodicMargin" if name in ("nominal", "limit", "safe", "unsafe", "missed_width"):
            return _PERIODIC_UNITS[value.quantity]
        case "Compared" if name in ("linear", "nonlinear", "low", "high"):
            return str(value.unit)
        case "SimulatedSignal" if name == "values":
            return str(value.unit)
        case "SignalStatistics" if name in ("deviation", "by_lyapunov", "by_frequency"):
            return str(value.unit)
        case "SignalStatistics" if name == "rate":
            return f"{value.unit}/s"
        case "SpringDamper" if name == "stiffness":
            return "N*m/rad" if value.angular else "N/m"
        case "SpringDamper" if name == "damping":
            return "N*m*s/rad" if value.angular else "N*s/m"
        case _:
            return UNITS.get(key)


_SWEEP_UNITS: Final = {"speed": "m/s", "payload": "kg", "height": "m", "gap": "m", "lateral_offset": "m"}

_PERIODIC_UNITS: Final = {"depth": "", "gain factor": "", "speed": "m/s"}


def _system(system: SecondOrderSystem) -> dict[str, Any]:
    """Names, M, C, K and eigenvalue-relevant shares are enough to rebuild a figure; the scenario rebuilds the rest."""
    return {
        "dofs": list(system.dofs),
        "internal": list(system.internal),
        "inputs": list(system.inputs),
        "M": plain(system.M),
        "C": plain(system.C),
        "K": plain(system.K),
        "contributions": [{"name": c.name, "kind": c.kind} for c in system.contributions],
        "unit": "SI, left-hand side",
    }


def _array(array: np.ndarray[Any, np.dtype[Any]]) -> Any:
    if np.iscomplexobj(array):
        return {"re": _array(array.real), "im": _array(array.imag)}
    if array.dtype.kind == "f" and not np.all(np.isfinite(array)):
        return [_array(row) for row in array] if array.ndim > 1 else [_number(float(v)) for v in np.atleast_1d(array)]
    return array.tolist()


def _number(value: float) -> float | str:
    if math.isfinite(value):
        return float(value)
    return "NaN" if math.isnan(value) else ("Infinity" if value > 0 else "-Infinity")
