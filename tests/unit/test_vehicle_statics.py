"""Equilibria: trimmed, frozen and solved; off-centre double L; refusals with numbers."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from maglev_ctrl.errors import ModelError, OutOfDomain
from maglev_ctrl.forces import AbstractForceModel, Domain, ImageForce, MagnetDerivatives, MagnetForces
from maglev_ctrl.vehicle import (
    Aerodynamics,
    Body,
    Magnet,
    OperatingPoint,
    SpringDamper,
    Vehicle,
    equilibrium,
    generalized_force,
    linearize,
)
from maglev_ctrl.vehicle.models import MagnetRow, Secondary, double_l, heave_surge, two_stage

COIL = ImageForce(1e5, 1.0, 2.5e7, 0.02, 1 / 3)


@dataclass(frozen=True)
class CornerForce(AbstractForceModel):
    """L = L0 exp(-(h-h0)/p) (1 + q (g-g0)), G = G0 exp(-(g-g0)/p) (1 + r (h-h0)): a corner, with a finite domain."""

    lift: float = 5.0
    guidance: float = 4.0
    heights: tuple[float, float] = (0.005, 0.05)

    @property
    def domain(self) -> Domain:
        return Domain(height=self.heights, gap=(0.002, 0.04), speed=(1.0, 100.0))

    def _parts(self, height, gap):
        h, g = np.asarray(height) - 0.02, np.asarray(gap) - 0.0127
        return self.lift * np.exp(-h / 0.0125), 1 + 4.0 * g, self.guidance * np.exp(-g / 0.0133), 1 - 15.0 * h

    def forces(self, height, gap, speed):
        self.domain.require(height, gap, speed)
        a, b, c, d = self._parts(height, gap)
        return MagnetForces(a * b, c * d, 0.1 * a * b)

    def derivatives(self, height, gap, speed):
        a, b, c, d = self._parts(height, gap)
        by_height = MagnetForces(-a * b / 0.0125, -15.0 * c, -0.1 * a * b / 0.0125)
        by_gap = MagnetForces(4.0 * a, -c * d / 0.0133, 0.4 * a)
        zero = MagnetForces(0 * a, 0 * a, 0 * a)
        return MagnetDerivatives(by_height, by_gap, zero, zero, zero)

    def scaled(self, factor):
        return replace(self, lift=factor * self.lift, guidance=factor * self.guidance)


def test_trim_makes_lift_the_weight() -> None:
    vehicle = heave_surge(20e3, force=COIL, reference_height=0.1, drag_factor=1.8)
    state = equilibrium(vehicle, OperatingPoint(50.0, 0.12))
    assert np.sum(state.forces.lift) == pytest.approx(20e3 * 9.80665, rel=1e-13)
    unit = COIL.forces(0.12, None, 50.0)
    assert state.strength == pytest.approx(20e3 * 9.80665 / float(unit.lift), rel=1e-13)
    np.testing.assert_allclose(state.unbalanced, 0.0, atol=1e-9)
    assert state.posture.thrust["car"] == pytest.approx(float(state.forces.drag[0]) + 1.8 * 2500.0, rel=1e-13)
    assert np.isnan(state.magnet_gaps[0])


def test_solved_height_carries_the_weight() -> None:
    """F = mu0 I^2 eps_L/(4 pi z): the height follows in closed form."""
    vehicle = heave_surge(500.0, force=COIL, reference_height=0.1)
    unit = float(COIL.forces(0.1, None, 50.0).lift)
    wanted = 0.1 * unit / (500.0 * 9.80665)
    for start in (0.02, 0.1, 0.5):
        state = equilibrium(vehicle, OperatingPoint(50.0, start), hold="strength")
        assert state.strength == 1.0
        assert state.magnet_heights[0] == pytest.approx(wanted, rel=1e-10)
    # The linear model there is that of the same height with trimmed currents.
    trimmed = linearize(vehicle, OperatingPoint(50.0, wanted))
    np.testing.assert_allclose(linearize(vehicle, state).K, trimmed.K, rtol=1e-9)


def train(front_x: float = 14.0) -> Vehicle:
    car = Body("car", 108e3, inertia=(0.0, 2.8e7, 0.0), dofs=("heave", "pitch"), position=(0.0, 0.0, 0.8))
    bogies = [Body("front", 13.5e3, position=(front_x, 0.0, 0.0)), Body("rear", 13.5e3, position=(-14.0, 0.0, 0.0))]
    return two_stage(
        car, bogies, magnets=MagnetRow(COIL, 10, length=24.0, half_gauge=1.35), secondary=Secondary(1.36e6),
        reference_height=0.2, drag_factor=5.0,
    )  # fmt: skip


def test_springs_carry_the_car() -> None:
    vehicle = train()
    state = equilibrium(vehicle, OperatingPoint(100.0, 0.2))
    assert len(vehicle.magnets) == 10
    for name in ("secondary_front", "secondary_rear"):
        assert state.preloads[name] == pytest.approx(54e3 * 9.80665, rel=1e-12)
    np.testing.assert_allclose(state.unbalanced, 0.0, atol=1e-6)
    off = equilibrium(train(10.0), OperatingPoint(100.0, 0.2))
    assert off.preloads["secondary_front"] == pytest.approx(108e3 * 9.80665 * 14 / 24, rel=1e-12)
    # Equal magnets under unequal loads: the difference is shown, not hidden.
    assert off.unbalanced[2] == pytest.approx(-off.unbalanced[3], rel=1e-9)
    assert abs(off.unbalanced[2]) > 1e4


def test_solved_posture_of_the_train_balances() -> None:
    vehicle = train(10.0)
    strong = replace(vehicle, magnets=tuple(replace(m, force=COIL.scaled(45.0)) for m in vehicle.magnets))
    state = equilibrium(strong, OperatingPoint(100.0, 0.2), hold="strength")
    np.testing.assert_allclose(state.unbalanced, 0.0, atol=1e-3)
    assert state.magnet_heights[0] < state.magnet_heights[-1]  # the heavier front rides lower
    # Springs moved by what they carry more or less than in the level posture.
    level = equilibrium(strong, OperatingPoint(100.0, 0.2))
    rows = {"secondary_front": 10.0, "secondary_rear": -14.0}
    for (name, x), bogie in zip(rows.items(), (2, 3), strict=True):
        heave, pitch = state.displacement[:2]
        stroke = heave - x * np.sin(pitch) + 0.8 * (1.0 - np.cos(pitch)) - state.displacement[bogie]
        assert state.preloads[name] - level.preloads[name] == pytest.approx(-1.36e6 * stroke, rel=1e-6)


def test_pitch_moment_of_drag_is_shown_or_balanced() -> None:
    body = Body("car", 20e3, inertia=(0.0, 1e5, 0.0), dofs=("surge", "heave", "pitch"))
    magnets = tuple(
        Magnet(name, "car", force=COIL.scaled(30.0), position=(x, 0.0, -0.5))
        for name, x in (("front", 3.0), ("rear", -3.0))
    )
    vehicle = Vehicle("cart", (body,), magnets=magnets, reference_height=0.1)
    held = equilibrium(vehicle, OperatingPoint(30.0, 0.1))
    drag = float(np.sum(held.forces.drag))
    # Drag -D at z = -0.5: moment z (-D) about +y, which is nose down.
    assert held.unbalanced[2] == pytest.approx(0.5 * drag, rel=1e-12)
    solved = equilibrium(vehicle, OperatingPoint(30.0, 0.1), hold="strength")
    np.testing.assert_allclose(solved.unbalanced, 0.0, atol=1e-4)
    assert solved.displacement[2] > 0.0  # nose down


AT = OperatingPoint(36.1, 0.02)


def test_off_centre_frozen() -> None:
    """Sec. 2.4 (a): posture imposed, the side force and roll moment about the CM come from dead loads."""
    force = CornerForce()
    vehicle = double_l(force, height=0.02, speed=36.1)
    assert vehicle.mass == pytest.approx(10.0 / 9.80665, rel=1e-12)
    y, a, b = 0.004, 0.09144, 0.0889
    state = equilibrium(vehicle, OperatingPoint(36.1, 0.02, lateral_offset=y), hold="frozen")
    L1, L2 = (float(force.forces(0.02, 0.0127 + s * y, 36.1).lift) for s in (-1, 1))
    G1, G2 = (float(force.forces(0.02, 0.0127 + s * y, 36.1).guidance) for s in (-1, 1))
    np.testing.assert_allclose(state.magnet_gaps, [0.0087, 0.0167], rtol=1e-12)
    sway, heave, roll = -state.unbalanced  # what has to be supplied
    assert sway == pytest.approx(G1 - G2, rel=1e-12)
    assert roll == pytest.approx(a * (G1 - G2) - b * (L1 - L2), rel=1e-12)
    assert heave == pytest.approx(10.0 - L1 - L2, abs=1e-12)
    assert state.strength == 1.0
    assert G1 - G2 > 1.0  # the wall pushes back: a flipped side would not
    np.testing.assert_allclose(generalized_force(vehicle, state, np.zeros(3)), 0.0, atol=1e-12)


def test_off_centre_trimmed() -> None:
    """Sec. 2.4 (b): a side force at the CM, no roll moment, heave, roll and sway solved."""
    vehicle = double_l(CornerForce(), height=0.02, speed=36.1)
    state = equilibrium(vehicle, AT, hold="strength", loads={"car.sway": 0.5})
    np.testing.assert_allclose(state.unbalanced, 0.0, atol=1e-8)
    sway, _, roll = state.displacement
    assert sway > 1e-4
    assert abs(roll) > 1e-4
    net = state.forces.guidance[1] - state.forces.guidance[0]
    assert net == pytest.approx(-0.5, abs=1e-8)
    # The full 3x3 is coupled, and the frozen model at the same offset is another one.
    system = linearize(vehicle, state)
    assert abs(system.K[1, 2]) > 1.0
    frozen = equilibrium(vehicle, OperatingPoint(36.1, 0.02, lateral_offset=float(sway)), hold="frozen")
    assert np.max(np.abs(linearize(vehicle, frozen).K - system.K)) > 1e-3


def test_a_held_offset_gives_the_side_force_that_holds_it() -> None:
    vehicle = double_l(CornerForce(), height=0.02, speed=36.1)
    pushed = equilibrium(vehicle, AT, hold="strength", loads={"car.sway": 0.5})
    offset = float(pushed.displacement[0])
    held = equilibrium(vehicle, OperatingPoint(36.1, 0.02, lateral_offset=offset), hold="strength")
    assert held.unbalanced[0] == pytest.approx(-0.5, rel=1e-8)
    np.testing.assert_allclose(held.unbalanced[1:], 0.0, atol=1e-8)
    np.testing.assert_allclose(linearize(vehicle, held).K, linearize(vehicle, pushed).K, rtol=1e-6)


def test_too_heavy_a_vehicle_is_refused_with_the_edge_of_the_data() -> None:
    vehicle = double_l(CornerForce(), height=0.02, speed=36.1, mass=40.0)
    with pytest.raises(OutOfDomain, match=r"outside the model's range 0\.005 to 0\.05 m"):
        equilibrium(vehicle, AT, hold="strength")


@dataclass(frozen=True)
class SaturatedForce(CornerForce):
    """Lift that stays below 100 N at every height."""

    @property
    def domain(self) -> Domain:
        return Domain(height=(0.0, np.inf), gap=None, speed=(0.0, np.inf))

    def forces(self, height, gap, speed):
        h = np.asarray(height, dtype=float)
        return MagnetForces(100.0 / (1.0 + h**2), 0.0 * h, 0.0 * h)

    def derivatives(self, height, gap, speed):
        h = np.asarray(height, dtype=float)
        zero = MagnetForces(0 * h, 0 * h, 0 * h)
        return MagnetDerivatives(MagnetForces(-200 * h / (1 + h**2) ** 2, 0 * h, 0 * h), zero, zero, zero, zero)


def test_no_equilibrium_is_an_error_with_numbers() -> None:
    magnet = Magnet("magnet", "car", force=SaturatedForce())
    vehicle = Vehicle("cart", (Body("car", 50.0),), magnets=(magnet,), reference_height=0.5)
    with pytest.raises(ModelError, match=r"car\.heave keeps -39\d"):
        equilibrium(vehicle, OperatingPoint(10.0, 0.5), hold="strength")
    feasible = replace(vehicle, bodies=(Body("car", 5.0),))
    state = equilibrium(feasible, OperatingPoint(10.0, 0.5), hold="strength")
    assert state.magnet_heights[0] == pytest.approx(np.sqrt(100.0 / (5.0 * 9.80665) - 1.0), rel=1e-9)


def test_magnets_that_pull_down_cannot_be_trimmed() -> None:
    vehicle = double_l(CornerForce(lift=-5.0), height=0.02, speed=36.1, mass=1.0)
    with pytest.raises(ModelError, match=r"the magnets lift -10 N and have to carry 9\.80665 N"):
        equilibrium(vehicle, AT)


def test_no_lift_at_rest() -> None:
    vehicle = heave_surge(20e3, force=COIL, reference_height=0.1)
    with pytest.raises(ModelError, match="the magnets lift 0 N"):
        equilibrium(vehicle, OperatingPoint(0.0, 0.1))


def test_a_car_that_nothing_carries_is_refused() -> None:
    vehicle = train()
    cut = replace(vehicle, connections=())
    with pytest.raises(ModelError, match=r"car\.heave is left with -1\.0591\d*e\+06 N"):
        equilibrium(cut, OperatingPoint(100.0, 0.2))
    one_leg = replace(vehicle, connections=vehicle.connections[:1])
    with pytest.raises(ModelError, match="no spring carries"):
        equilibrium(one_leg, OperatingPoint(100.0, 0.2))


def test_air_and_thrust_moments_on_the_car_are_carried_by_the_springs() -> None:
    vehicle = replace(train(), aerodynamics=(Aerodynamics("car", 5.0, position=(0.0, 0.0, 2.8)),))
    state = equilibrium(vehicle, OperatingPoint(100.0, 0.2))
    moment = 2.0 * -5.0 * 100.0**2  # about +y: nose up
    difference = state.preloads["secondary_front"] - state.preloads["secondary_rear"]
    assert difference * 14.0 == pytest.approx(moment, rel=1e-12)


def test_wrong_use_is_named() -> None:
    vehicle = heave_surge(20e3, force=COIL, reference_height=0.1)
    at = OperatingPoint(50.0, 0.1)
    with pytest.raises(ValueError, match=r"did you mean 'car\.heave'"):
        equilibrium(vehicle, at, loads={"car.heav": 1.0})
    with pytest.raises(ValueError, match="hold: expected"):
        equilibrium(vehicle, at, hold="hight")  # type: ignore[arg-type]
    for arguments in ({"speed": -1.0, "height": 0.1}, {"speed": 1.0, "height": 0.0}):
        with pytest.raises(ValueError, match="expected a"):
            OperatingPoint(**arguments)


def test_a_spring_to_the_guideway_that_carries_nothing_is_unloaded() -> None:
    leg = SpringDamper("leg", "front", position=(14.0, 0.0, 0.0), stiffness=1e6)
    vehicle = train().with_elements(connections=(leg,))
    assert equilibrium(vehicle, OperatingPoint(100.0, 0.2)).preloads["leg"] == 0.0
