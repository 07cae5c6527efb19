"""Electromagnets in the one assembly: poles, signs, inputs, guideway, equilibrium."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from maglev_ctrl.analysis.modes import modes
from maglev_ctrl.errors import OutOfDomain
from maglev_ctrl.forces import Electromagnet, ImageForce
from maglev_ctrl.systems import Controller, SecondOrderSystem, close_loop
from maglev_ctrl.vehicle import (
    Body,
    Equilibrium,
    Magnet,
    OperatingPoint,
    Sensor,
    SpringDamper,
    Vehicle,
    equilibrium,
    generalized_force,
    linearize,
    magnet_circuits,
)
from maglev_ctrl.vehicle.kinematics import stance
from maglev_ctrl.vehicle.loads import position_slopes

GRAVITY, GAP, MASS = 9.80665, 0.010, 2000.0
AT = OperatingPoint(0.0, GAP)
RATE = np.sqrt(2.0 * GRAVITY / GAP)  # 44.287 1/s


def magnet_for(mass: float, **change: object) -> Electromagnet:
    data = {"turns": 300, "pole_area": 0.06, "resistance": 2.0, "drive": "current"} | change
    return Electromagnet.for_lift(mass * GRAVITY, GAP, **data)  # type: ignore[arg-type]


def hovering(**change: object) -> Vehicle:
    force = magnet_for(MASS, **change)
    return Vehicle("hover", (Body("car", MASS),), magnets=(Magnet("lift", "car", force=force),), reference_height=GAP)


def on_four(*, drive: str, depth: float = 0.0) -> Vehicle:
    """Heave, pitch and roll over four corners."""
    force = magnet_for(MASS / 4.0, drive=drive, leakage=0.02)
    corners = tuple(
        Magnet(f"m{k}", "car", force=force, position=(x, y, -depth))
        for k, (x, y) in enumerate([(3.0, 1.0), (3.0, -1.0), (-3.0, 1.0), (-3.0, -1.0)])
    )
    car = Body("car", MASS, inertia=(900.0, 7000.0, 0.0), dofs=("heave", "roll", "pitch"))
    return Vehicle("four", (car,), magnets=corners, reference_height=GAP)


def poles(system: SecondOrderSystem) -> np.ndarray:
    return np.sort_complex(np.linalg.eigvals(system.state_matrix()))


def test_a_held_current_diverges_with_gravity_over_gap() -> None:
    system = linearize(hovering(), AT)
    np.testing.assert_allclose(poles(system), [-RATE, RATE], rtol=1e-12)
    assert pytest.approx(44.287, abs=1e-3) == RATE
    assert (system.inputs, system.internal) == (("lift.current",), ())


def test_a_positive_stiffness_would_be_caught() -> None:
    system = linearize(hovering(), AT)
    mutant = replace(system, K=-system.K)
    assert float(system.K[0, 0]) < 0.0
    assert np.max(poles(mutant).real) < 1e-9  # it would swing, not diverge


def test_the_iron_path_slows_the_divergence() -> None:
    system = linearize(hovering(iron_gap=2e-3), AT)
    np.testing.assert_allclose(poles(system)[-1], np.sqrt(4.0 * GRAVITY / (2.0 * GAP + 2e-3)), rtol=1e-12)


@pytest.mark.parametrize("leakage", [0.0, 0.05])
def test_a_held_voltage_has_the_poles_of_the_third_order_polynomial(leakage: float) -> None:
    """m L s^3 + m R s^2 + (K_i^2 - K_s L) s - K_s R, with K_i^2 = K_s (L - leakage)."""
    vehicle = hovering(drive="voltage", leakage=leakage)
    system = linearize(vehicle, AT)
    i = float(vehicle.magnets[0].force.current)  # type: ignore[attr-defined]
    weight, R = MASS * GRAVITY, 2.0
    main = 4e-7 * np.pi * 300**2 * 0.06 / (2.0 * GAP)
    L, K_s = main + leakage, 2.0 * weight / GAP
    assert K_s * main == pytest.approx((2.0 * weight / i) ** 2, rel=1e-12)
    expected = np.roots([MASS * L, MASS * R, -K_s * leakage, -K_s * R])
    np.testing.assert_allclose(poles(system), np.sort_complex(expected), rtol=1e-9)
    # One change of sign: one growing pole, slower than with a held current.
    growing = poles(system)[poles(system).real > 0.0]
    assert len(growing) == 1 and 0.0 < growing[0].real < RATE
    assert (system.inputs, system.internal) == (("lift.voltage",), ("lift.current",))


def test_held_flux_is_neutral() -> None:
    """Without resistance and leakage the flux cannot change, and the force with it: three poles at zero."""
    system = linearize(hovering(drive="voltage", resistance=0.0), AT)
    A = system.state_matrix()
    scale = np.max(np.abs(A))
    # Nilpotent: what the current makes up for is exactly what the gap loses.
    assert np.max(np.abs(A @ A @ A)) < 1e-9 * scale**2


def nonlinear_rate(vehicle: Vehicle, x: np.ndarray, v: float, w: float, w_rate: float) -> np.ndarray:
    """[z', z'', i'] of one magnet under a moving rail, from the nonlinear force and flux alone."""
    force: Electromagnet = vehicle.magnets[0].force  # type: ignore[assignment]
    z, rise, i = x
    gap, gap_rate = GAP - z + w, -rise + w_rate
    step = 1e-5
    by_gap = (force.flux_linkage(gap + step, i) - force.flux_linkage(gap - step, i)) / (2.0 * step)
    current_rate = (v - 2.0 * i - float(by_gap) * gap_rate) / float(force.inductance(gap))
    return np.array([rise, float(force.pull(gap, i)) / MASS - GRAVITY, current_rate])


def test_the_linear_model_is_the_slope_of_the_nonlinear_one() -> None:
    vehicle = hovering(drive="voltage", leakage=0.03, iron_gap=1e-3)
    system = linearize(vehicle, AT)
    i0 = magnet_circuits(vehicle, equilibrium(vehicle, AT))["lift"].current
    base, steps = np.array([0.0, 0.0, i0, 2.0 * i0, 0.0, 0.0]), np.array([1e-5, 1e-3, 1e-2, 0.1, 1e-5, 1e-3])
    np.testing.assert_allclose(nonlinear_rate(vehicle, base[:3], *base[3:]), 0.0, atol=1e-9)
    found = np.zeros((3, 6))
    for k, step in enumerate(steps):
        up, down = base.copy(), base.copy()
        up[k] += step
        down[k] -= step
        found[:, k] = (
            nonlinear_rate(vehicle, up[:3], *up[3:]) - nonlinear_rate(vehicle, down[:3], *down[3:])
        ) / (2.0 * step)  # fmt: skip
    whole = np.hstack([system.state_matrix(), system.input_matrix(), system.guideway_matrix()])
    assert system.guideway == ("heave@lift",)
    np.testing.assert_allclose(whole, found, rtol=1e-5, atol=1e-6)
    # A motional voltage of the other sign would not pass.
    assert abs(found[2, 1]) > 1.0 and found[2, 1] < 0.0


def test_a_rail_that_rises_opens_the_gap_and_lets_the_vehicle_fall() -> None:
    system = linearize(hovering(), AT)
    C, _, E = system.output_rows(("lift.gap",))
    np.testing.assert_allclose(C, [[-1.0, 0.0]])
    np.testing.assert_allclose(E, [[1.0, 0.0]])
    _, fall = system.guideway_matrix()[:, 0]
    assert fall == pytest.approx(-2.0 * GRAVITY / GAP)  # m/s^2 per m
    # Vehicle and rail raised together: nothing happens.
    np.testing.assert_allclose(system.K @ [1.0], system.K_w @ [1.0])


@pytest.mark.parametrize("drive", ["current", "voltage"])
def test_a_stabilised_vehicle_follows_its_rail(drive: str) -> None:
    """Feedback of gap, velocity and current: after a step of the rail the vehicle comes to rest one step higher."""
    system = linearize(hovering(drive=drive, leakage=0.03), AT)
    measured = ("lift.gap", "car.heave.velocity", *system.internal)
    gains = [[6000.0, -80.0]] if drive == "current" else [[120e3, -1700.0, -25.0]]
    law = Controller.from_matrices(
        np.zeros((0, 0)), np.zeros((0, len(measured))), np.zeros((1, 0)), gains,
        measured=measured, commands=system.inputs, name="hover",
    )  # fmt: skip
    closed = close_loop(system, law)
    A, E = closed.state_matrix(), closed.guideway_matrix()
    assert np.max(np.linalg.eigvals(A).real) < -1.0
    resting = dict(zip(closed.states, np.linalg.solve(A, -E[:, 0]), strict=True))
    assert resting["car.heave"] == pytest.approx(1.0, rel=1e-9)
    assert resting["car.heave.velocity"] == pytest.approx(0.0, abs=1e-9)
    # A commanded current lifts at once; under a voltage the wider gap first loses force.
    first = float(E[1, 0])
    assert first > 0.0 if drive == "current" else first == pytest.approx(-2.0 * GRAVITY / GAP)


@pytest.mark.parametrize("drive", ["current", "voltage"])
def test_four_corners_diverge_in_heave_roll_and_pitch(drive: str) -> None:
    system = linearize(on_four(drive=drive), AT)
    K_s = 2.0 * MASS * GRAVITY / GAP / 4.0
    np.testing.assert_allclose(
        system.K, -np.diag([4.0 * K_s, 4.0 * K_s * 1.0, 4.0 * K_s * 9.0]), atol=1e-6 * K_s, rtol=1e-12
    )
    assert int(np.sum(poles(system).real > 1e-6)) == 3
    assert system.inputs == tuple(f"m{k}.{drive}" for k in range(4))
    # Front right alone: lifts, rolls its side up (y < 0: negative roll), pitches the nose up (negative).
    if drive == "current":
        push = system.B[:, 1]
    else:
        push = system.F[:, 1]
    assert push[0] > 0.0 and push[1] < 0.0 and push[2] < 0.0
    np.testing.assert_allclose(push / push[0], [1.0, -1.0, -3.0])


def test_stiffness_is_the_slope_of_the_nonlinear_force_about_a_lowered_posture() -> None:
    vehicle = on_four(drive="current", depth=0.4)
    state = equilibrium(vehicle, OperatingPoint(0.0, 0.012))
    system = linearize(vehicle, state)
    step, found = 1e-6, np.zeros((3, 3))
    for k in range(3):
        move = np.zeros(3)
        move[k] = step
        found[:, k] = -(generalized_force(vehicle, state, move) - generalized_force(vehicle, state, -move)) / (2 * step)
    np.testing.assert_allclose(found, system.K, rtol=1e-6, atol=1e-3)


def test_magnets_of_one_group_count_as_often_as_they_are() -> None:
    force = magnet_for(MASS / 8.0, drive="voltage", leakage=0.02)
    one = Vehicle(
        "one", (Body("car", MASS),), magnets=(Magnet("lift", "car", force=force, count=8),), reference_height=GAP
    )
    eight = replace(one, magnets=tuple(Magnet(f"lift{k}", "car", force=force) for k in range(8)))
    alike, apart = linearize(one, AT), linearize(eight, AT)
    np.testing.assert_allclose(alike.K, apart.K, rtol=1e-12)
    np.testing.assert_allclose(alike.F[0, 0], np.sum(apart.F), rtol=1e-12)
    np.testing.assert_allclose(alike.A_internal[0, 0], apart.A_internal[0, 0], rtol=1e-12)
    # Seven further currents, all differences, decay as the circuit does.
    decay = float(apart.A_internal[0, 0])
    assert int(np.sum(np.abs(poles(apart) - decay) < 1e-5 * abs(decay))) == 7
    found = magnet_circuits(one, equilibrium(one, AT))["lift"]
    assert 8 * found.force == pytest.approx(MASS * GRAVITY, rel=1e-12)


def test_the_trimmed_currents_carry_whatever_the_vehicle_weighs() -> None:
    vehicle = hovering(drive="voltage")
    heavy = replace(vehicle, bodies=(Body("car", 1.21 * MASS),))
    one, other = (magnet_circuits(v, equilibrium(v, AT))["lift"] for v in (vehicle, heavy))
    assert other.current == pytest.approx(1.1 * one.current, rel=1e-12)
    wide = equilibrium(vehicle, OperatingPoint(0.0, 2.0 * GAP))
    assert magnet_circuits(vehicle, wide)["lift"].current == pytest.approx(2.0 * one.current, rel=1e-12)
    np.testing.assert_allclose(poles(linearize(vehicle, wide)).real.max(), _root(2.0 * GAP), rtol=1e-9)


def _root(gap: float) -> float:
    main = 4e-7 * np.pi * 300**2 * 0.06 / (2.0 * gap)
    return float(np.max(np.roots([1.0, 2.0 / main, 0.0, -2.0 * GRAVITY / gap * 2.0 / main]).real))


def test_with_held_currents_a_heavier_vehicle_balances_nearer_to_its_rail() -> None:
    """F ~ 1 / g^2: 1.21 times the weight at g / 1.1, higher up. The balance is found although it is unstable."""
    heavy = replace(hovering(), bodies=(Body("car", 1.21 * MASS),))
    state = equilibrium(heavy, AT, hold="strength")
    assert float(state.magnet_heights[0]) == pytest.approx(GAP / 1.1, rel=1e-9)
    assert float(state.displacement[0]) == pytest.approx(GAP - GAP / 1.1, rel=1e-7)
    start = equilibrium(heavy, OperatingPoint(0.0, 0.0095), hold="strength")
    assert float(start.magnet_heights[0]) == pytest.approx(GAP / 1.1, rel=1e-9)


def test_saturation_is_judged_at_the_trimmed_currents() -> None:
    vehicle = hovering(flux_limit=0.8)  # 0.64 T at 10 mm for this weight
    near = equilibrium(vehicle, OperatingPoint(0.0, 0.004))  # the untrimmed current would saturate here
    assert near.strength == pytest.approx(0.16)
    heavy = replace(vehicle, bodies=(Body("car", 2.0 * MASS),))
    with pytest.raises(OutOfDomain, match=r"0\.9064 T in the gap is above the 0\.8 T"):
        equilibrium(heavy, AT)
    with pytest.raises(OutOfDomain, match="saturates"):
        generalized_force(vehicle, equilibrium(vehicle, AT), np.array([0.004]))


def test_the_ledger_shows_the_magnet_as_the_source() -> None:
    spring = SpringDamper("skid", "car", stiffness=1e5, damping=1e3)
    for drive in ("current", "voltage"):
        system = linearize(hovering(drive=drive, leakage=0.03).with_elements(connections=(spring,)), AT)
        ledger = modes(system).ledger
        fastest = int(np.argmax(ledger.growth))
        share = dict(zip(ledger.elements, ledger.stiffness_share[:, fastest], strict=True))
        assert ledger.growth[fastest] > 10.0
        assert share["lift"] < 0.0 < share["skid"] and min(share, key=share.get) == "lift"  # type: ignore[arg-type]


def test_a_displaced_rail_changes_the_stiffness_by_the_gap_it_opens() -> None:
    vehicle = hovering()
    state: Equilibrium = equilibrium(vehicle, AT)
    here = stance(vehicle, state.displacement)
    found = position_slopes(vehicle, state.posture, here, rise=np.array([-1e-3, 0.0, 1e-3]), narrowing=np.zeros(3))
    expected = [2.0 * MASS * GRAVITY * GAP**2 / (GAP + w) ** 3 for w in (-1e-3, 0.0, 1e-3)]
    np.testing.assert_allclose(found[:, 0, 2, 2], expected, rtol=1e-12)


def test_currents_can_be_measured() -> None:
    vehicle = hovering(drive="voltage").with_elements(
        sensors=(
            Sensor("amps", "current", body="car", magnet="lift", noise=0.01),
            Sensor("gap", "gap", body="car", direction=(0.0, 0.0, -1.0)),
        )
    )
    system = linearize(vehicle, AT)
    C, _, E = system.output_rows(("amps", "lift.current", "gap", "lift.gap"))
    np.testing.assert_allclose(C, [[0.0, 0.0, 1.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
    columns = [system.guideway.index(name) for name in ("heave@gap", "heave@lift")]
    np.testing.assert_allclose(E[2:, columns], np.eye(2))


def test_wrong_vehicles_are_refused() -> None:
    sheet = ImageForce(1e5, 1.0, 2.5e7, 0.02, 1.0)
    with pytest.raises(ValueError, match="expected all under a rail or all over a guideway, got lift that hangs and m"):
        replace(hovering(), magnets=(*hovering().magnets, Magnet("m", "car", force=sheet)))
    with pytest.raises(ValueError, match="expected an electromagnet driven by voltage, got 'lift'; there is none"):
        hovering().with_elements(sensors=(Sensor("amps", "current", body="car", magnet="lift"),))
    with pytest.raises(ValueError, match="did you mean 'lift'"):
        hovering(drive="voltage").with_elements(sensors=(Sensor("amps", "current", body="car", magnet="lit"),))
    with pytest.raises(ValueError, match="expected the name of a magnet, got None"):
        Sensor("amps", "current", body="car")
    with pytest.raises(ValueError, match="with kind 'current' only"):
        Sensor("gap", "gap", body="car", magnet="lift")
