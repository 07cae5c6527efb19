"""What a golden file keeps of a study: every number a verdict rests on, and where it came from."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from maglev_ctrl.scenario import load
from maglev_ctrl.study import OptionStudy, run

ROOT = Path(__file__).resolve().parents[2]
FOLDER = Path(__file__).with_name("studies")
SCENARIOS = ("paper/heave_surge", "paper/heave_pitch_surge", "compare/warwick_30t")


def golden_file(scenario: str) -> Path:
    """Where a scenario's golden summary lies."""
    return FOLDER / f"{scenario.replace('/', '-')}.json"


def summary(scenario: str) -> dict[str, Any]:
    """The study of a scenario in numbers and words that JSON can hold."""
    comparison = run(load(ROOT / "scenarios" / f"{scenario}.toml"))
    return {
        "scenario_hash": comparison.scenario_hash,
        "verdict": comparison.verdict.value,
        "options": {option.name: _option(option) for option in comparison.options},
    }


def _option(option: OptionStudy) -> dict[str, Any]:
    modes, floquet, margins = option.modes, option.floquet, option.margins
    return {
        "failure": option.failure,
        "requirements": {
            r.name: {"value": _plain(r.value), "unit": r.unit, "verdict": r.verdict.value} for r in option.requirements
        },
        "eigenvalues": [[_plain(s.real), _plain(s.imag)] for s in modes.s] if modes else None,
        "labels": list(modes.labels) if modes else None,
        "boundaries": {
            sweep.parameter: [_plain(c.value) for c in sweep.boundaries.crossings] for sweep in option.sweeps
        },
        "margins": {
            c.channel: {
                "gain_increase_db": _plain(c.gain_increase.decibel),
                "gain_reduction_db": _plain(c.gain_reduction.decibel),
                "phase_deg": _plain(c.phase.value),
                "delay_s": _plain(c.delay.value),
                "disk": _plain(c.disk.alpha),
            }
            for c in margins.channels
        }
        if margins
        else None,
        "floquet": {
            "growth_rate": _plain(floquet.at_design.growth_rate),
            "worst_depth": _plain(floquet.worst_depth),
            "worst_speed": _plain(floquet.worst_speed),
            "worst_resonance": floquet.worst_resonance,
        }
        if floquet
        else None,
    }


def _plain(value: float) -> float | str:
    number = float(value)
    return number if math.isfinite(number) else repr(number)
