"""The assembly against differences of the nonlinear force balance, sums of shares, lags, delays and outputs."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from maglev_ctrl.errors import ModelError
from maglev_ctrl.forces import AbstractForceModel, CoefficientTable, Domain, ImageForce, MagnetDerivatives, MagnetForces
from maglev_ctrl.systems import SecondOrderSystem
from maglev_ctrl.vehicle import (
    DOF_NAMES,
    Actuator,
    Aerodynamics,
    Body,
    Magnet,
    OperatingPoint,
    Sensor,
    SpringDamper,
    Vehicle,
    equilibrium,
    generalized_force,
    linearize,
    stiffness_modulation,
)
from maglev_ctrl.vehicle.models import MagnetRow, Secondary, six_dof, two_stage
from maglev_ctrl.vehicle.pade import pade_delay


@dataclass(frozen=True)
class SmoothForce(AbstractForceModel):
    """F = F0 exp(a_h (h - h0) + a_g (g - g0)) (v/v0)^p for lift, guidance, drag; unsteady partials share of F."""

    size: tuple[float, float, float] = (900.0, 130.0, 70.0)

    @property
    def domain(self) -> Domain:
        return Domain(height=(1e-3, 5.0), gap=(1e-3, 5.0), speed=(1.0, 1e3))

    def forces(self, height, gap, speed):
        self.domain.require(height, gap, speed)
        h, g, v = (np.asarray(x, dtype=float) for x in (height, gap, speed))
        shape = ((-9.0, 0.7, 0.3), (-2.0, -6.0, 0.2), (-4.0, -0.8, -0.6))
        return MagnetForces(*(
            f * np.exp(a * (h - 0.2) + b * (g - 0.3)) * (v / 40.0) ** p
            for f, (a, b, p) in zip(self.size, shape, strict=True)
        ))  # fmt: skip

    def derivatives(self, height, gap, speed):
        found = self.forces(height, gap, speed)
        v = np.asarray(speed, dtype=float)

        def times(a, b, c):
            return MagnetForces(a * found.lift, b * found.guidance, c * found.drag)

        return MagnetDerivatives(
            times(-9.0, -2.0, -4.0), times(0.7, -6.0, -0.8), times(0.3 / v, 0.2 / v, -0.6 / v),
            times(-0.02, 0.01, 0.03), times(0.015, -0.02, 0.01),
        )  # fmt: skip

    def scaled(self, factor):
        return SmoothForce(tuple(factor * f for f in self.size))


AT = OperatingPoint(40.0, 0.2, gap=0.3)


def rich_vehicle(dofs=DOF_NAMES, *, geometric_stiffness: bool = True) -> Vehicle:
    """Car on two bogies, everything off centre, with preloads, thrust and air away from the centres of mass."""
    car = Body("car", 300.0, inertia=[[80.0, 3.0, -5.0], [3.0, 400.0, 2.0], [-5.0, 2.0, 380.0]], dofs=dofs,
               position=(0.1, 0.02, 1.1))  # fmt: skip
    bogies = tuple(
        Body(name, 60.0, inertia=(6.0, 9.0, 11.0), dofs=dofs, position=(x, 0.0, 0.25))
        for name, x in (("front", 3.0), ("rear", -3.0))
    )
    row = MagnetRow(SmoothForce(), 4, length=2.0, half_gauge=0.7, guidance=True, height=-0.1)
    secondary = Secondary(4e4, 900.0, lateral_stiffness=1e4, lateral_damping=300.0, half_spacing=0.5, height=0.6)
    vehicle = two_stage(
        car, bogies, magnets=row, secondary=secondary, reference_height=0.2, reference_gap=0.3
    )  # fmt: skip
    return replace(
        vehicle,
        geometric_stiffness=geometric_stiffness,
        aerodynamics=(Aerodynamics("car", 0.2, position=(1.0, 0.1, 1.5)),),
        thrust_positions=(("car", (0.4, 0.0, 0.9)), ("front", (2.5, 0.1, -0.2))),
        connections=(
            *vehicle.connections,
            SpringDamper("traction_front", "car", to="front", position=(3.0, 0.0, 0.3), direction=(1.0, 0.0, 0.0),
                         stiffness=2e4, damping=100.0),
            SpringDamper("roll_bar", "car", to="rear", direction=(1.0, 0.0, 0.0), stiffness=500.0, damping=7.0,
                         angular=True),
            SpringDamper("skid", "rear", position=(-3.5, 0.3, -0.1), direction=(0.0, 0.6, 0.8), stiffness=800.0,
                         damping=20.0),
        ),
    )  # fmt: skip


def differences(vehicle: Vehicle, state, *, velocity: bool) -> np.ndarray:
    """Central differences of -Q, fourth order."""
    n, step = len(vehicle.dofs), 1e-3
    columns = []
    for i in range(n):
        total = np.zeros(n)
        for weight, k in ((8.0, 1), (-1.0, 2)):
            for sign in (1, -1):
                move = np.zeros(n)
                move[i] = sign * k * step
                zero = np.zeros(n)
                force = generalized_force(vehicle, state, zero, move) if velocity else (
                    generalized_force(vehicle, state, move)
                )  # fmt: skip
                total -= sign * weight * force
        columns.append(total / (12.0 * step))
    return np.stack(columns, axis=1)


SUBSETS = [DOF_NAMES, ("heave", "pitch"), ("surge", "heave", "pitch"), ("sway", "heave", "roll", "yaw")]


@pytest.mark.parametrize("dofs", SUBSETS, ids=lambda d: "+".join(d))
@pytest.mark.parametrize("hold", ["height", "strength"])
def test_matrices_are_differences_of_the_nonlinear_force(dofs, hold) -> None:
    vehicle = rich_vehicle(dofs)
    at = OperatingPoint(40.0, 0.2, gap=0.3, lateral_offset=0.02 if hold == "height" else 0.0)
    state = equilibrium(vehicle, at, hold=hold)
    if hold == "strength":
        assert np.max(np.abs(state.displacement)) > 1e-3  # a turned posture, not the level one
    system = linearize(vehicle, state)
    scale = np.max(np.abs(system.K))
    np.testing.assert_allclose(differences(vehicle, state, velocity=False), system.K, atol=2e-8 * scale)
    damping = np.max(np.abs(system.C))
    np.testing.assert_allclose(differences(vehicle, state, velocity=True), system.C, atol=1e-8 * damping)
    np.testing.assert_allclose(generalized_force(vehicle, state, np.zeros(len(vehicle.dofs))), 0.0, atol=1e-9)


@pytest.mark.parametrize("hold", ["height", "strength"])
def test_the_papers_kinematics_is_consistent_with_itself(hold) -> None:
    vehicle = replace(rich_vehicle(("sway", "heave", "roll", "yaw")), kinematics="paper")
    state = equilibrium(vehicle, AT, hold=hold)
    system = linearize(vehicle, state)
    scale = np.max(np.abs(system.K))
    np.testing.assert_allclose(differences(vehicle, state, velocity=False), system.K, atol=2e-8 * scale)
    damping = np.max(np.abs(system.C))
    np.testing.assert_allclose(differences(vehicle, state, velocity=True), system.C, atol=1e-8 * damping)
    mutant = linearize(replace(vehicle, kinematics="consistent"), state)
    assert np.max(np.abs(mutant.K - system.K)) > 1e-3 * scale


def test_geometric_stiffness_mutants_are_caught() -> None:
    vehicle = rich_vehicle()
    state = equilibrium(vehicle, AT, hold="strength")
    exact = differences(vehicle, state, velocity=False)
    scale = np.max(np.abs(exact))
    full = linearize(vehicle, state)
    geometry = next(c for c in full.contributions if c.name == "geometry").K
    flipped = full.K - 2.0 * geometry
    assert np.max(np.abs(full.K - exact)) < 2e-8 * scale
    assert np.max(np.abs(flipped - exact)) > 1e-4 * scale
    without = linearize(replace(vehicle, geometric_stiffness=False), state)
    np.testing.assert_allclose(without.K, full.K - geometry, atol=1e-9)
    assert np.max(np.abs(without.K - exact)) > 1e-4 * scale
    for part in ("thrust", "air", "preload"):
        if part == "thrust":
            mutant = replace(vehicle, thrust_positions=())
        elif part == "air":
            mutant = replace(vehicle, aerodynamics=(Aerodynamics("car", 0.2),))
        else:
            mutant = vehicle
            posture = replace(state.posture, static_forces={})
            off = linearize(mutant, replace(state, posture=posture))
            assert np.max(np.abs(off.K - exact)) > 1e-6 * scale
            continue
        assert np.max(np.abs(linearize(mutant, state).K - exact)) > 1e-7 * scale


def extended_vehicle() -> Vehicle:
    vehicle = rich_vehicle(("heave", "pitch", "roll"))
    return vehicle.with_elements(
        connections=(SpringDamper("winding", "front", position=(3.0, 0.4, 0.0), damping=900.0, stiffness=50.0,
                                  lag=0.03),),
        actuators=(
            Actuator("lagged", "car", to="front", position=(3.0, 0.0, 0.6), bandwidth=60.0, delay=0.01),
            Actuator("ideal", "rear", position=(-3.0, 0.0, 0.0)),
        ),
        sensors=(
            Sensor("front_gap", "gap", body="front", position=(3.0, 0.2, 0.0)),
            Sensor("car_stroke", "stroke", body="car", to="rear", position=(-3.0, 0.0, 0.5)),
            Sensor("car_speed", "velocity", body="car", position=(2.0, 0.0, 1.0)),
            Sensor("car_acceleration", "acceleration", body="car", position=(2.0, 0.0, 1.0)),
        ),
    )  # fmt: skip


def test_contributions_add_up() -> None:
    vehicle = extended_vehicle()
    system = linearize(vehicle, AT)
    for key in ("M", "C", "K", "F"):
        total = np.sum([getattr(c, key) for c in system.contributions], axis=0)
        np.testing.assert_allclose(total, getattr(system, key), rtol=1e-12, atol=1e-12)
    names = [c.name for c in system.contributions]
    assert len(set(names)) == len(names)
    assert {"car", "front", "front_magnet_1_left", "winding", "lagged", "aerodynamics", "geometry"} <= set(names)
    # Mutant: leaving one share out is seen.
    short = np.sum([c.K for c in system.contributions[:-1]], axis=0)
    assert not np.allclose(short, system.K)


def test_names_of_inputs_states_and_outputs() -> None:
    vehicle = extended_vehicle()
    system = linearize(vehicle, AT, pade_order=2)
    assert system.inputs == ("lagged", "ideal")
    assert system.internal == ("winding.lag", "lagged.force", "lagged.delay1", "lagged.delay2")
    assert system.outputs[:4] == ("front_gap", "car_stroke", "car_speed", "car_acceleration")
    expected = {
        "car.heave",
        "car.heave.velocity",
        "car.roll.acceleration",
        "front_magnet_1_left.gap",
        "winding.stroke",
        "winding.stroke.velocity",
        "winding.force",
        "lagged.stroke",
        "lagged.force",
        "ideal.stroke",
    }
    assert expected <= set(system.outputs)
    assert "ideal.force" not in system.outputs  # it is the input itself
    assert {"heave@front_magnet_1_left", "sway@front_magnet_1_left", "heave@winding", "heave@front_gap", "heave@skid",
            "sway@skid", "heave@ideal"} <= set(system.guideway)  # fmt: skip
    assert linearize(vehicle, AT, pade_order=0).internal == ("winding.lag", "lagged.force")


def response(system: SecondOrderSystem, s: complex, w: np.ndarray, u: np.ndarray | None = None) -> np.ndarray:
    """All outputs to guideway displacements w exp(s t) and inputs u."""
    A, E, B = system.state_matrix(), system.guideway_matrix(), system.input_matrix()
    drive = E @ np.concatenate([w, s * w]).astype(complex)
    if u is not None:
        drive = drive + B @ u
    x = np.linalg.solve(s * np.eye(len(A)) - A, drive)
    C, D, E_y = system.output_rows(system.outputs)
    return C @ x + (D @ u if u is not None else 0.0) + E_y @ np.concatenate([w, s * w])


def test_a_slowly_rising_guideway_lifts_the_vehicle_with_it() -> None:
    """Raising every vertical guideway input by one metre leaves all gaps and strokes as they are."""
    vehicle = extended_vehicle()
    vehicle = replace(vehicle, connections=tuple(c for c in vehicle.connections if c.name != "skid"))
    system = linearize(vehicle, AT)
    heave = np.array([1.0 if name.endswith("heave") else 0.0 for name in system.dofs])
    up = np.array([1.0 if name.startswith("heave@") else 0.0 for name in system.guideway])
    np.testing.assert_allclose(system.K_w @ up, system.K @ heave, atol=1e-9 * np.max(np.abs(system.K)))
    y = dict(zip(system.outputs, response(system, 1e-7, up), strict=True))
    assert abs(y["car.heave"] - 1.0) < 1e-6
    for name in ("front_gap", "front_magnet_1_left.gap", "winding.stroke", "winding.force", "car_stroke"):
        assert abs(y[name]) < 1e-4, name
    # Mutant: a guideway term of the wrong sign drives the vehicle down.
    assert not np.allclose(-system.K_w @ up, system.K @ heave)


def test_vertical_velocity_of_the_guideway_enters_like_the_magnets_own() -> None:
    vehicle = rich_vehicle(("heave",))
    vehicle = replace(vehicle, connections=tuple(c for c in vehicle.connections if c.to != "guideway"))
    system = linearize(vehicle, AT)
    heave = np.ones(3)
    up = np.array([1.0 if name.startswith("heave@") else 0.0 for name in system.guideway])
    np.testing.assert_allclose(system.C_w @ up, system.C @ heave, atol=1e-9 * np.max(np.abs(system.C)))
    assert np.max(np.abs(system.C_w)) > 1.0


def test_sway_of_the_wall_moves_the_gap() -> None:
    vehicle = replace(rich_vehicle(("sway",)), connections=(), aerodynamics=())
    car_only = replace(
        vehicle, bodies=vehicle.bodies[1:2], magnets=tuple(m for m in vehicle.magnets if m.body == "front"),
        thrust_positions=(),
    )  # fmt: skip
    system = linearize(car_only, AT)
    aside = np.array([1.0 if name.startswith("sway@") else 0.0 for name in system.guideway])
    np.testing.assert_allclose(system.K_w @ aside, system.K[:, 0], rtol=1e-12)


def test_a_damper_without_lag_is_the_limit_of_one_with_lag() -> None:
    body = Body("car", 10.0)

    def poles(lag: float) -> np.ndarray:
        leg = SpringDamper("leg", "car", stiffness=4000.0, damping=30.0, lag=lag)
        vehicle = Vehicle("cart", (body,), connections=(leg,), reference_height=0.1)
        s = np.linalg.eigvals(linearize(vehicle, OperatingPoint(0.0, 0.1)).state_matrix())
        return np.sort_complex(s[np.argsort(np.abs(s))[:2]])

    ideal = poles(0.0)
    for lag in (1e-3, 1e-5, 1e-7):
        assert np.max(np.abs(poles(lag) - ideal)) < 100.0 * lag * np.max(np.abs(ideal))
    s = poles(0.02)[1]  # the transfer function k + c s/(1 + lag s) holds at the pole
    assert abs(10.0 * s**2 + 4000.0 + 30.0 * s / (1.0 + 0.02 * s)) < 1e-8
    assert abs(10.0 * s**2 + 4000.0 + 30.0 * s) > 1.0


@pytest.mark.parametrize("order", [1, 2, 4, 8])
def test_pade_form_of_a_delay(order) -> None:
    A, b, c, d = pade_delay(0.02, order)
    for w in (0.0, 10.0, 80.0):
        s = 1j * w
        transfer = c @ np.linalg.solve(s * np.eye(order) - A, b) + d
        assert abs(abs(transfer) - 1.0) < 1e-10  # all-pass
        phase_error = (0.02 * w / 2.0) ** (2 * order + 1)
        assert abs(transfer - np.exp(-0.02 * s)) < 1e-9 + phase_error
    assert np.max(np.linalg.eigvals(A).real) < 0.0


def test_actuator_with_bandwidth_and_delay() -> None:
    body = Body("car", 10.0)
    drive = Actuator("drive", "car", bandwidth=50.0, delay=0.01)
    leg = SpringDamper("leg", "car", stiffness=4000.0, damping=30.0)
    vehicle = Vehicle("cart", (body,), connections=(leg,), actuators=(drive,), reference_height=0.1)
    for elements, factor in (
        (drive, lambda s: np.exp(-0.01 * s) * 50.0 / (s + 50.0)),
        (replace(drive, delay=0.0), lambda s: 50.0 / (s + 50.0)),
        (replace(drive, bandwidth=None), lambda s: np.exp(-0.01 * s)),
        (replace(drive, bandwidth=None, delay=0.0), lambda s: 1.0),
    ):
        system = linearize(replace(vehicle, actuators=(elements,)), OperatingPoint(0.0, 0.1))
        s = 25.0j
        y = response(system, s, np.zeros(len(system.guideway)), np.array([1.0]))
        wanted = factor(s) / (10.0 * s**2 + 30.0 * s + 4000.0)
        assert abs(y[system.outputs.index("car.heave")] - wanted) < 1e-9 * abs(wanted)


def test_sensors_read_what_they_say() -> None:
    vehicle = extended_vehicle()
    system = linearize(vehicle, AT)
    q = dict.fromkeys(system.dofs, 0.0) | {"car.heave": 0.3, "car.pitch": 0.01, "car.roll": 0.02, "rear.heave": 0.1}
    row = np.array(list(q.values()))
    index = system.outputs.index
    # A nose-down pitch lowers what is ahead; a roll to the right raises the left.
    expected = 0.3 - 0.01 * (2.0 - 0.1) + 0.02 * (0.0 - 0.02)
    assert system.H_v[index("car_speed")] @ row == pytest.approx(expected, rel=1e-12)
    assert system.H_a[index("car_acceleration")] @ row == pytest.approx(expected, rel=1e-12)
    stroke = 0.3 - 0.01 * (-3.0 - 0.1) + 0.02 * (-0.02) - 0.1
    assert system.H_q[index("car_stroke")] @ row == pytest.approx(stroke, rel=1e-12)


def test_stiffness_modulation() -> None:
    vehicle = rich_vehicle(("heave", "pitch"))
    K_cos, K_sin = stiffness_modulation(vehicle, AT, wavelength=7.0, harmonics=(1.0, 0.25))
    system = linearize(vehicle, AT)
    shares = {c.name: c.K for c in system.contributions}
    for k, amplitude in enumerate((1.0, 0.25)):
        for time in (0.0, 0.3, 1.1):  # W t
            found = K_cos[k] * np.cos((k + 1) * time) + K_sin[k] * np.sin((k + 1) * time)
            wanted = sum(
                amplitude * np.cos((k + 1) * (time + 2 * np.pi * m.position[0] / 7.0)) * shares[m.name]
                for m in vehicle.magnets
            )
            np.testing.assert_allclose(found, wanted, atol=1e-9)
    long, sine = stiffness_modulation(vehicle, AT, wavelength=1e12)
    magnets = sum(shares[m.name] for m in vehicle.magnets)
    np.testing.assert_allclose(long[0], magnets, rtol=1e-9, atol=1e-6)
    assert np.max(np.abs(sine)) < 1e-6
    assert not np.allclose(K_sin[0], -K_sin[0])  # a flipped direction of travel is a different matrix
    with pytest.raises(ValueError, match="wavelength"):
        stiffness_modulation(vehicle, AT, wavelength=0.0)


def test_coefficient_elements_join_with_their_sign() -> None:
    rng = np.random.default_rng(3)
    mass, damping, stiffness = rng.normal(size=(3, 6, 6))
    stiffness[:, 0] = 0.0
    table = CoefficientTable(40.0, 0.01 * mass, damping, stiffness)
    vehicle = six_dof(50.0, inertia=(4.0, 5.0, 6.0), coefficients=table, reference_height=0.2)
    state = equilibrium(vehicle, OperatingPoint(40.0, 0.2))
    np.testing.assert_allclose(state.unbalanced, 0.0, atol=1e-12)
    system = linearize(vehicle, state)
    np.testing.assert_allclose(system.K, stiffness)
    np.testing.assert_allclose(system.C, damping)
    np.testing.assert_allclose(system.M, np.diag([50, 50, 50, 4, 5, 6.0]) + 0.01 * mass)
    assert system.ignorable == ("car.surge",)
    part = six_dof(50.0, inertia=(4, 5, 6), coefficients=table, reference_height=0.2, dofs=("heave", "yaw"))
    np.testing.assert_allclose(linearize(part, OperatingPoint(40.0, 0.2)).K, stiffness[np.ix_([2, 5], [2, 5])])


def test_receding_image_gives_negative_heave_damping() -> None:
    coil = ImageForce(1e5, 1.0, 2.5e7, 0.02, 1.0, "receding_image")
    vehicle = Vehicle("cart", (Body("car", 1e3),), magnets=(Magnet("coil", "car", force=coil),), reference_height=0.1)
    assert linearize(vehicle, OperatingPoint(50.0, 0.1)).C[0, 0] < 0.0
    assert linearize(vehicle, OperatingPoint(1.0, 0.1)).C[0, 0] > 0.0


def test_a_body_that_turns_needs_inertia() -> None:
    vehicle = six_dof(50.0, inertia=(0.0, 0.0, 0.0), dofs=("heave", "roll"), reference_height=0.2,
                      magnets=(Magnet("m", "car", force=SmoothForce()),), reference_gap=0.3)  # fmt: skip
    with pytest.raises(ModelError, match="smallest eigenvalue is 0"):
        linearize(vehicle, AT)


def test_an_equilibrium_of_another_vehicle_is_refused() -> None:
    state = equilibrium(rich_vehicle(("heave",)), AT)
    with pytest.raises(ValueError, match="expected an equilibrium of 6 coordinates"):
        linearize(rich_vehicle(("heave", "pitch")), state)


def test_a_remembered_vehicle_is_never_taken_for_another() -> None:
    consistent = rich_vehicle()
    first = linearize(consistent, AT)
    paper = linearize(replace(consistent, kinematics="paper"), AT)
    heavier = linearize(replace(consistent, gravity=2.0 * consistent.gravity), AT)
    again = linearize(consistent, AT)
    for key in ("M", "C", "K", "K_w", "H_q"):
        np.testing.assert_array_equal(getattr(again, key), getattr(first, key))
    assert np.max(np.abs(paper.K - first.K)) > 1e-6 * np.max(np.abs(first.K))
    assert np.max(np.abs(heavier.K - first.K)) > 1e-6 * np.max(np.abs(first.K))
    assert not any(share.K.flags.writeable or share.F.flags.writeable for share in first.contributions)
