"""Published dynamic controllers: our H2 and H-infinity optima against the collection, and against the printed laws."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from maglev_ctrl.analysis.norms import h2_norm, h_infinity_norm
from maglev_ctrl.errors import Status
from maglev_ctrl.synthesis.h2 import h2_output_feedback
from maglev_ctrl.synthesis.h_infinity import h_infinity_output_feedback
from maglev_ctrl.systems import Controller
from maglev_ctrl.systems.plant import Plant, closed_channel

PATH = Path(__file__).parents[3] / "shared" / "data" / "external" / "synthesis.json"


@cache
def _cases():
    return json.loads(PATH.read_text())["cases"] if PATH.exists() else []


def _sampled(case):
    return case["kind"].endswith("d")


def _plant(case):
    A, B, C, D = (np.array(case[key], dtype=float) for key in "ABCD")
    w, z = B.shape[1] - case["ncon"], C.shape[0] - case["nmeas"]
    return Plant.from_matrices(
        A, B[:, :w], B[:, w:], C[:z], C[z:], D11=D[:z, :w], D12=D[:z, w:], D21=D[z:, :w], D22=D[z:, w:],
        dt=float(case.get("dt") or 1.0) if _sampled(case) else None,
    )  # fmt: skip


def _published(case, plant):
    law = case["published_K"]
    return Controller.from_matrices(
        law["AK"], law["BK"], law["CK"], law["DK"], measured=plant.measured, commands=plant.commands, dt=plant.dt
    )


@pytest.mark.parametrize("index", range(max(len(_cases()), 1)))
def test_case(index):
    if not _cases():
        pytest.skip("the collection synthesis.json is not part of this checkout")
    case = _cases()[index]
    plant = _plant(case)
    if case["kind"].startswith("h2"):
        design = h2_output_feedback(plant)
        published = h2_norm(*closed_channel(plant, _published(case, plant)), dt=plant.dt).value
        # The printed law has four decimals; it is not better than the optimum, and close to it.
        assert design.norm <= published * (1.0 + 1e-12)
        assert published <= design.norm * 1.01
        if "h2_optimal" in case:
            assert design.norm == pytest.approx(case["h2_optimal"], rel=1e-9)
        assert design.optimum == pytest.approx(design.norm, rel=1e-9)
    else:
        design = h_infinity_output_feedback(plant)
        published = h_infinity_norm(*closed_channel(plant, _published(case, plant)), dt=plant.dt).value
        assert design.infimum <= published * (1.0 + 1e-9)
        assert design.infimum <= design.norm <= design.gamma == pytest.approx(1.02 * design.infimum)
        if "hinf_optimal_gamma_sb10ad" in case:
            assert design.infimum == pytest.approx(case["hinf_optimal_gamma_sb10ad"], rel=1e-6)
        # The central law of the collection's own level is the printed one.
        central = h_infinity_output_feedback(plant, gamma=case["gamma"], curve=())
        assert central.norm == pytest.approx(published, rel=1e-3)
    assert design.synthesis.status is Status.SOLVED


def test_a_mutant_is_caught():
    if not _cases():
        pytest.skip("the collection synthesis.json is not part of this checkout")
    case = next(case for case in _cases() if case["kind"] == "h2c")
    plant = _plant(case)
    design = h2_output_feedback(plant)
    law = design.controller
    mutant = Controller.from_matrices(
        law.A, law.B, 1.01 * law.C, law.D, measured=law.measured, commands=law.commands
    )  # fmt: skip
    assert h2_norm(*closed_channel(plant, mutant)).value > case["h2_optimal"] * (1.0 + 1e-6)
