"""The double-L vehicle with magnets whose force follows from the eddy currents at the frequency of the motion.

The paper leaves these coefficients open. Frequencies hardly change; the damping that quasi-static theory finds (drag
turning with the velocity) is a fifth to a third of the real one, and it has none at all for heave.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from maglev_ctrl.analysis.frequency_dependent import UnsteadyComparison, compare_unsteady
from maglev_ctrl.analysis.modes import StabilityVerdict
from maglev_ctrl.errors import Agreement, ModelError
from maglev_ctrl.fields.coil import RectangularCoil
from maglev_ctrl.fields.section import CrossSection
from maglev_ctrl.forces.eddy_current import EddyCurrentForce
from maglev_ctrl.vehicle import OperatingPoint
from maglev_ctrl.vehicle.models import double_l
from maglev_ctrl.vehicle.unsteady import unsteady_vehicle

HEIGHT, GAP, SPEED = 15e-3, 12.7e-3, 36.1
AT = OperatingPoint(SPEED, HEIGHT, gap=GAP)


@pytest.fixture(scope="module")
def magnet() -> EddyCurrentForce:
    guideway = CrossSection.l_shape(leg=76.2e-3, thickness=6.35e-3, conductivity=2.5e7)
    coil = RectangularCoil(length=50.8e-3, width=25.4e-3, current=6000.0, lateral=12.7e-3, height=3.175e-3)
    return EddyCurrentForce.solve(
        guideway, (coil,), height=(14.9e-3, 15.1e-3), gap=(12.6e-3, 12.8e-3), speed=(36.0, 36.2), frequency=400.0,
        accuracy="draft",
    )  # fmt: skip


def compared(magnet: EddyCurrentForce, *, tilt: bool = False, tolerance: float = 1e-3) -> UnsteadyComparison:
    vehicle = double_l(magnet, height=HEIGHT, speed=SPEED, gap=GAP, drag_direction=True)
    return compare_unsteady(unsteady_vehicle(vehicle, AT, tolerance=tolerance, tilt=tilt), complex_frequency=True)


@pytest.fixture(scope="module")
def found(magnet: EddyCurrentForce) -> UnsteadyComparison:
    return compared(magnet)


def test_three_methods_agree(magnet: EddyCurrentForce, found: UnsteadyComparison) -> None:
    assert found.static_mismatch < 1e-12 and found.verdict is StabilityVerdict.STABLE
    for one in found.modes:
        assert one.agreement is Agreement.AGREED and one.margin < 0.005 * abs(one.s.real)
        assert one.p_k == pytest.approx(one.s, abs=1e-4) and one.rational == pytest.approx(one.s, abs=one.margin)
    finer = compared(magnet, tolerance=1e-5)
    for rough, fine in zip(found.modes, finer.modes, strict=True):
        assert abs(rough.rational - fine.s) <= rough.margin and fine.margin < 0.05 * rough.margin
        assert rough.s == pytest.approx(fine.s, abs=1e-9)


def test_quasi_static_theory_has_the_frequencies_and_not_the_damping(found: UnsteadyComparison) -> None:
    assert found.adequate is False and found.quasi_static_verdict is StabilityVerdict.UNRESOLVED
    by_name = {one.label: one for one in found.modes}
    for name, growth in (("car sway", -0.0795), ("car heave", -0.1240), ("car roll", -0.5797)):
        one = by_name[name]
        assert one.s.real == pytest.approx(growth, rel=0.01) and one.adequate is False
        assert one.s.imag == pytest.approx(one.quasi_static.imag, rel=5e-4)
        assert abs(one.quasi_static.real) < 0.3 * abs(one.s.real)
    assert abs(by_name["car heave"].quasi_static.real) < 1e-9


def test_heave_decays_at_the_damping_of_the_magnet(magnet: EddyCurrentForce, found: UnsteadyComparison) -> None:
    heave = next(one for one in found.modes if one.label == "car heave")
    _, damping, _ = magnet.coefficients(HEIGHT, GAP, SPEED, [heave.s.imag])
    mass = 2.0 * float(magnet.forces(HEIGHT, GAP, SPEED).lift) / 9.80665
    assert heave.s.real == pytest.approx(2.0 * damping[0, 2, 2] / (2.0 * mass), rel=2e-3)


def test_the_magnets_own_tilt_matters_for_sway_and_roll(magnet: EddyCurrentForce, found: UnsteadyComparison) -> None:
    tilted = {one.label: one for one in compared(magnet, tilt=True).modes}
    for one in found.modes:
        assert tilted[one.label].agreement is Agreement.AGREED
    assert tilted["car heave"].s == pytest.approx(next(m for m in found.modes if m.label == "car heave").s, abs=1e-9)
    assert tilted["car sway"].s.imag == pytest.approx(16.93, abs=0.03)  # 17.31 as points


@dataclass(frozen=True)
class Reversed:
    """The mutant: currents that lead instead of lagging."""

    magnet: EddyCurrentForce

    def motion_stiffness(self, height, gap, speed, frequency):
        return self.magnet.motion_stiffness(height, gap, speed, -np.asarray(frequency))


def test_a_reversed_sense_of_time_is_seen(magnet: EddyCurrentForce) -> None:
    vehicle = double_l(magnet, height=HEIGHT, speed=SPEED, gap=GAP, drag_direction=True)
    try:
        unsteady = unsteady_vehicle(vehicle, AT, dynamic=Reversed(magnet))
    except ModelError as refused:
        assert "rational" in str(refused)  # such a force is no answer of a stable magnet
        return
    assert compare_unsteady(unsteady).verdict is not StabilityVerdict.STABLE
