"""A Pade form is a model of a delay: where the exact delay decides otherwise, the exact delay is believed."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import fsolve

from maglev_ctrl.errors import Verdict
from maglev_ctrl.scenario import load
from maglev_ctrl.study import run
from maglev_ctrl.study.situation import PADE_ORDER, OptionModel, Situation

MASS, STIFFNESS, DAMPING, GAIN, DELAY = (
    20e3,
    981082.9643571507,
    28.01546664765234,
    35.579642642518465,
    0.3569456873865061,
)
ZERO = "[" + ", ".join(["[0, 0, 0, 0, 0, 0]"] * 6) + "]"


def matrix(value: float) -> str:
    rows = [[0.0] * 6 for _ in range(6)]
    rows[2][2] = value
    return repr(rows)


def scenario_text(delay: float) -> str:
    """Heave at 1.1 Hz with damping ratio 1e-4 and rate feedback that comes too late."""
    return f"""
format = 1
title = "Late rate feedback"
[vehicle]
model = "six_dof"
freedom = ["heave"]
[vehicle.car]
mass = "20 t"
[forces]
model = "coefficients"
units = "SI"
convention = "left_hand_side"
mass = {ZERO}
damping = {matrix(DAMPING)}
stiffness = {matrix(STIFFNESS)}
[operating]
speed = "100 m/s"
height = "100 mm"
[[option]]
name = "rate"
kind = "active_primary"
[[option.actuator]]
name = "coil"
between = ["car", "guideway"]
delay = "{delay} s"
[[option.sensor]]
name = "v"
kind = "velocity"
on = "car"
[option.control]
law = "sky_hook"
damping = "{GAIN} N*s/m"
sensor = "v"
[[requirement]]
name = "stable"
quantity = "growth_rate"
at_most = "0 1/s"
over = "nominal"
"""


def exact_root(delay: float) -> complex:
    """Root of m s^2 + c s + k + g s exp(-s delay) by a general solver."""

    def equation(x: np.ndarray) -> list[float]:
        s = complex(x[0], x[1])
        value = MASS * s**2 + DAMPING * s + STIFFNESS + GAIN * s * np.exp(-s * delay)
        return [value.real / STIFFNESS, value.imag / STIFFNESS]

    found = fsolve(equation, [0.0, math.sqrt(STIFFNESS / MASS)], xtol=1e-14)
    return complex(found[0], found[1])


@pytest.mark.parametrize("delay", [DELAY, 0.01])
def test_growth_rate_is_that_of_the_exact_delay(tmp_path: Path, delay: float) -> None:
    path = tmp_path / "late.toml"
    path.write_text(scenario_text(delay), encoding="utf-8")
    scenario = load(path)
    (option,) = run(scenario).options
    (result,) = option.requirements
    exact = exact_root(delay).real
    assert result.value == pytest.approx(exact, rel=0.02)
    assert result.verdict is (Verdict.FAIL if exact > 0.0 else Verdict.PASS)


def test_the_coarse_pade_form_alone_would_have_passed(tmp_path: Path) -> None:
    """The mutant: judged by the plant of low order, this unstable loop is called stable."""
    path = tmp_path / "late.toml"
    path.write_text(scenario_text(DELAY), encoding="utf-8")
    scenario = load(path)
    model = OptionModel(scenario, scenario.options[0])
    (option,) = run(scenario).options
    assert option.design is not None
    coarse = model.closed_of(
        model.vehicle(), Situation.of_design(scenario), option.design.controller, pade_order=PADE_ORDER
    )
    assert np.max(np.linalg.eigvals(coarse.state_matrix()).real) < 0.0 < exact_root(DELAY).real
