"""Published margins: every case of the margin collection, with the tolerances the collection gives."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from maglev_ctrl.analysis.disk import DiskMargin, disk_gain_range, disk_phase
from maglev_ctrl.analysis.loops import Loop
from maglev_ctrl.analysis.margins import loop_margins
from maglev_ctrl.errors import NotStable

SOURCE = Path(__file__).resolve().parents[3] / "shared" / "data" / "external" / "margins.json"
CASES: list[dict[str, Any]] = json.loads(SOURCE.read_text())["cases"] if SOURCE.exists() else []
COMPUTED = 1e-6  # the collection's own computation: root finding and golden section on a dense grid
DISK = 2e-6  # our structured bound is proven to 1e-6

pytestmark = pytest.mark.skipif(not CASES, reason="the external collection margins.json is not beside this checkout")


def of_kind(kind: str) -> list[Any]:
    return [pytest.param(case, id=case["id"]) for case in CASES if case["kind"] == kind]


def loop_of(case: dict[str, Any]) -> Loop:
    return Loop.from_transfer_function(case["num"], case["den"], delay=case.get("delay", 0.0), dt=case.get("dt"))


def test_every_kind_of_case_is_tested() -> None:
    assert {case["kind"] for case in CASES} == {"loop", "disk_siso", "disk_mimo", "disk_conversion"}


@pytest.mark.parametrize("case", of_kind("loop"))
def test_classical_margins(case: dict[str, Any]) -> None:
    margins = loop_margins(loop_of(case))
    one, computed, published = margins.channels[0], case["computed"], case["published"]
    assert margins.verified
    assert one.searches_agree
    ours = one.phase_crossovers[(one.phase_crossovers[:, 1] > 0.0) & np.isfinite(one.phase_crossovers[:, 1])]
    assert ours.shape[0] == len(computed["gain_margins"])
    if computed["gain_margins"]:
        assert np.allclose(ours, computed["gain_margins"], rtol=COMPUTED)
    assert one.gain_crossovers.shape[0] == len(computed["phase_margins_deg"])
    if computed["phase_margins_deg"]:
        assert np.allclose(one.gain_crossovers[:, [0, 2]], computed["phase_margins_deg"], rtol=COMPUTED)
        assert np.allclose(one.gain_crossovers[:, 1:], computed["delay_margins_all"], rtol=COMPUTED)
        assert one.delay.value == pytest.approx(computed["delay_margin"], rel=COMPUTED)
    assert one.modulus.value == pytest.approx(computed["sm"][0], rel=COMPUTED)
    tolerance = case["rel_tol_published"]
    if "gm" in published:
        binding = one.gain_increase if published["gm"] > 1.0 else one.gain_reduction
        assert binding.value == pytest.approx(published["gm"], rel=tolerance)
        # the collection prints this frequency to four decimals; 0.0243 carries three digits
        assert binding.frequency == pytest.approx(published.get("wpc", binding.frequency), rel=tolerance, abs=5e-5)
    if "pm" in published:
        assert one.phase.value == pytest.approx(published["pm"], rel=tolerance)
        assert one.phase.frequency == pytest.approx(published.get("wgc", one.phase.frequency), rel=tolerance, abs=5e-5)
    if "sm" in published:
        assert one.modulus.value == pytest.approx(published["sm"], rel=tolerance)
    # mutant: positive feedback is another loop
    flipped = {**case, "num": [-value for value in case["num"]]}
    try:
        other = loop_margins(loop_of(flipped)).channels[0].modulus.value
    except NotStable:
        return
    assert other != pytest.approx(computed["sm"][0], rel=1e-3)


def check_disk(disk: DiskMargin, expected: dict[str, float]) -> None:
    assert disk.verified
    assert disk.alpha == pytest.approx(expected["alpha"], rel=DISK)
    assert disk.frequency == pytest.approx(expected["w"], rel=1e-5)  # a smooth maximum: half the digits of its value
    assert disk.gain_min == pytest.approx(expected["gmin"], rel=DISK)
    assert disk.gain_max == pytest.approx(expected["gmax"], rel=DISK)
    assert disk.phase == pytest.approx(expected["pm_deg"], rel=2.0 * DISK)


@pytest.mark.parametrize("case", of_kind("disk_siso"))
def test_disk_margin_of_a_single_loop(case: dict[str, Any]) -> None:
    disk = loop_margins(loop_of(case), sigma=case["sigma"]).multi_loop
    check_disk(disk, case)
    published = case.get("published")
    if published:  # printed to two decimals and one decimal
        assert disk.alpha == pytest.approx(published["alpha"], abs=5e-3)
        assert disk.gain_min == pytest.approx(published["gmin"], abs=5e-3)
        assert disk.gain_max == pytest.approx(published["gmax"], abs=5e-3)
        assert disk.phase == pytest.approx(published["pm"], abs=0.06)
        assert disk.frequency == pytest.approx(published["w"], abs=0.02)
    wrong = loop_margins(loop_of(case), sigma=case["sigma"] + 0.3).multi_loop
    assert wrong.alpha != pytest.approx(case["alpha"], rel=1e-3)  # mutant: another skew


@pytest.mark.parametrize("case", of_kind("disk_mimo"))
def test_disk_margins_of_the_spinning_satellite(case: dict[str, Any]) -> None:
    """Loops broken at plant input, plant output, and at both at once."""
    A, B, C, D, K = (np.array(case[key]) for key in "ABCDK")
    assert not np.any(D)
    zero = np.zeros((2, 2))
    at_input = loop_margins(Loop(A, B, K @ C, zero, ("u1", "u2")))
    at_output = loop_margins(Loop(A, B @ K, C, zero, ("y1", "y2")))
    # e = -L e with e = (u, y): u = -K y, y = P u
    both = Loop(
        A, np.hstack([B, 0 * B]), np.vstack([0 * C, -C]), np.block([[zero, K], [zero, zero]]), ("u1", "u2", "y1", "y2")
    )
    at_both = loop_margins(both)
    expected, published = case["sigma0"], case["published"]
    for margins, name in ((at_input, "input"), (at_output, "output"), (at_both, "io")):
        check_disk(margins.multi_loop, expected[name])
        low, high = margins.multi_loop.gain_range_db
        assert high == pytest.approx(expected[name]["dgm_dB"], rel=1e-5)
        assert low == pytest.approx(-expected[name]["dgm_dB"], rel=1e-5)
        number = published["io_alpha"] if name == "io" else published["output_input_alpha"]
        # one unit of the last digit: 0.0499 is 1.1 units of half a digit from the collection's own 0.049845
        assert margins.multi_loop.alpha == pytest.approx(number, abs=1e-4)
    for margins, name in ((at_input, "loop_at_a_time_input"), (at_output, "loop_at_a_time_output")):
        for one, alpha in zip(margins.channels, expected[name], strict=True):
            assert one.disk.alpha == pytest.approx(alpha, rel=1e-6)
            assert one.disk.alpha == pytest.approx(published["loop_alpha"], rel=1e-6)
            assert one.disk.alpha > 10.0 * margins.multi_loop.alpha  # mutant: one loop at a time sees nothing


@pytest.mark.parametrize("case", of_kind("disk_conversion"))
def test_disk_conversions(case: dict[str, Any]) -> None:
    low, high = disk_gain_range(case["alpha"], sigma=case["sigma"])
    phase = disk_phase(case["alpha"], sigma=case["sigma"])
    assert (low, high, phase) == pytest.approx((case["gmin"], case["gmax"], case["pm_deg"]), rel=1e-12)
    published = case["published"]
    assert low == pytest.approx(published["gmin"], abs=6e-5)
    assert high == pytest.approx(published["gmax"], abs=6e-5)
    if published["pm"] is not None:
        assert phase == pytest.approx(published["pm"], abs=6e-5)
    mutant = disk_gain_range(case["alpha"], sigma=case["sigma"] + 0.1)
    assert mutant != pytest.approx((case["gmin"], case["gmax"]), rel=1e-3)
