"""The paper's models come out of the general assembly; the paper's printed slips do not.

Closed forms and numbers: corrected equations of the paper (the errata), evaluated with mpmath and sympy.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from maglev_ctrl.forces import AbstractForceModel, Domain, ImageForce, MagnetDerivatives, MagnetForces
from maglev_ctrl.systems import SecondOrderSystem
from maglev_ctrl.vehicle import OperatingPoint, Vehicle, equilibrium, linearize
from maglev_ctrl.vehicle.models import (
    corner_magnets,
    heave_pitch_surge,
    heave_surge,
    six_dof,
)

G = 9.80665


@dataclass(frozen=True)
class PrescribedForce(AbstractForceModel):
    """Lift, guidance and drag linear in height, gap and speed about a point, with the partials given."""

    at: tuple[float, float, float]
    lift: tuple[float, float, float, float]
    guidance: tuple[float, float, float, float]
    drag: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)

    @property
    def domain(self) -> Domain:
        return Domain(height=(1e-6, 10.0), gap=(1e-6, 10.0), speed=(0.0, 1e4))

    def forces(self, height, gap, speed):
        self.domain.require(height, gap, speed)
        steps = [np.asarray(value) - start for value, start in zip((height, gap, speed), self.at, strict=True)]
        parts = [c[0] + sum(k * s for k, s in zip(c[1:], steps, strict=True)) for c in self._rows]
        return MagnetForces(*parts)

    def derivatives(self, height, gap, speed):
        shape = np.broadcast_shapes(np.shape(height), np.shape(gap), np.shape(speed))
        columns = [MagnetForces(*(np.full(shape, row[i]) for row in self._rows)) for i in (1, 2, 3)]
        zero = MagnetForces(*(np.zeros(shape) for _ in range(3)))
        return MagnetDerivatives(*columns, zero, zero)

    def scaled(self, factor):
        return PrescribedForce(self.at, *(tuple(factor * c for c in row) for row in self._rows))

    @property
    def _rows(self):
        return self.lift, self.guidance, self.drag


# --- heave and surge ---------------------------------------------------------------------------------------------

SHEET = {"conductivity": 2.5e7, "thickness": 0.02}
MASS, Z0, DRAG_FACTOR = 20000.0, 0.1, 0.5 * 0.3 * 10.0 * 1.2
W = 3.1830988618379066


def heave_surge_system(exponent: float, speed: float, drag_factor: float = DRAG_FACTOR) -> SecondOrderSystem:
    coil = ImageForce(current=1e5, length=1.0, exponent=exponent, **SHEET)
    vehicle = heave_surge(MASS, force=coil, reference_height=Z0, drag_factor=drag_factor)
    return linearize(vehicle, OperatingPoint(speed, Z0))


def roots(system: SecondOrderSystem) -> tuple[complex, float]:
    """Heave root with positive imaginary part, and the real surge root."""
    s = np.linalg.eigvals(system.state_matrix())
    assert len(s) == 3  # surge is ignorable: no root at zero
    return s[np.argmax(s.imag)], float(s[np.argmin(abs(s.imag))].real)


@pytest.mark.parametrize(
    ("exponent", "C_xx", "surge", "surge_40", "C_zx"),
    [
        (1.0, -9219.63156709267, 0.7672283432127452, 0.012309709904004732, 3.9704626225392934),
        (1 / 3, -3809.672008582921, 0.7656286753365946, 0.012309705761597598, 145.78936486274),
        (1 / 5, -2400.0965824427644, 0.7652140467523861, 0.012309703458564247, 263.7570120383541),
    ],
)
def test_heave_surge_coefficients_and_roots(exponent, C_xx, surge, surge_40, C_zx) -> None:
    at_2w = heave_surge_system(exponent, 2.0 * W)
    assert at_2w.dofs == ("car.surge", "car.heave")
    assert at_2w.ignorable == ("car.surge",)
    assert at_2w.C[0, 0] == pytest.approx(C_xx, rel=1e-9)
    assert roots(at_2w)[1] == pytest.approx(surge, rel=1e-8)
    assert roots(heave_surge_system(exponent, 40.0))[1] == pytest.approx(surge_40, rel=1e-8)
    fast = heave_surge_system(exponent, 100.0)
    assert -fast.C[1, 0] == pytest.approx(C_zx, rel=1e-9)
    assert -fast.K[0, 1] == pytest.approx(62431.07290688541, rel=1e-9)
    assert fast.K[1, 1] == pytest.approx(MASS * G / Z0, rel=1e-12)


@pytest.mark.parametrize(
    ("exponent", "speed", "expected"),
    [
        (1.0, 0.5 * W, (-6.922158608245127, 11.808723019794124)),
        (1.0, 100.0, (-3.1595866314732205e-06, 9.902853119478777)),
        (1 / 3, 0.5 * W, (-7.605439473761356, 11.634661098030517)),
        (1 / 3, 100.0, (-0.00011601522845632961, 9.902852949240822)),
        (1 / 5, 0.5 * W, (-7.747424249334415, 11.591838578722117)),
        (1 / 5, 100.0, (-0.00020989068741327047, 9.90285280665379)),
    ],
)
def test_heave_root_of_the_exact_cubic(exponent, speed, expected) -> None:
    heave, _ = roots(heave_surge_system(exponent, speed))
    # The double-precision floor of an eigenvalue of size 10 is some 1e-14; the tiny real parts carry it.
    assert heave.real == pytest.approx(expected[0], rel=1e-8, abs=3e-14)
    assert heave.imag == pytest.approx(expected[1], rel=1e-8)


@pytest.mark.parametrize("exponent", [1.0, 1 / 3, 1 / 5])
def test_surge_stability_speed_is_the_same_for_every_exponent(exponent) -> None:
    v_star = 55.76556404461478
    for speed, sign in ((v_star * (1 - 1e-6), 1.0), (v_star * (1 + 1e-6), -1.0)):
        assert np.sign(roots(heave_surge_system(exponent, speed))[1]) == sign
    at_star = heave_surge_system(exponent, v_star)
    constant = at_star.K[1, 1] * at_star.C[0, 0] - at_star.C[1, 0] * at_star.K[0, 1]
    assert abs(constant) < 1e-9 * at_star.K[1, 1] * DRAG_FACTOR * v_star
    # Mutant: Eq. 32's sign of C_zx next to Eq. 22's K_xz moves the boundary.
    mutant = at_star.K[1, 1] * at_star.C[0, 0] + at_star.C[1, 0] * at_star.K[0, 1]
    assert exponent == 1.0 or abs(mutant) > 1e-3 * at_star.K[1, 1] * DRAG_FACTOR * v_star


@pytest.mark.parametrize("exponent", [1.0, 1 / 5])
def test_corrected_surge_exponent_of_eq_27(exponent) -> None:
    slow = roots(heave_surge_system(exponent, 100.0))[1]
    assert slow == pytest.approx(-0.014878446354655728, rel=1e-5)  # exact to O(s^2/w_v^2)
    printed = (2 * exponent - 1) * W * G / 100.0**2 - 2 * DRAG_FACTOR * 100.0  # without 1/m, with (2n-1)
    assert abs(slow - printed) > 1.0


def test_decoupled_surge_threshold_differs_from_the_exact_one() -> None:
    at = heave_surge_system(1 / 5, 51.902590577572724)
    assert abs(at.C[0, 0]) < 1e-7 * 2 * DRAG_FACTOR * 51.9
    assert roots(at)[1] > 0.0  # still unstable: the coupling may not be dropped


def test_printed_C_xx_of_eq_22_is_refuted() -> None:
    n, x = 1 / 3, 2.0
    exact = heave_surge_system(n, x * W, drag_factor=0.0).C[0, 0] * (x * W) ** 2 / (W * MASS * G)
    printed = (1 - (2 * n - 1) * x**2) / (1 + x**2)
    assert exact == pytest.approx(-0.2488, abs=5e-5)
    assert printed == pytest.approx(0.4667, abs=5e-5)


# --- heave, pitch and surge --------------------------------------------------------------------------------------

PRESCRIBED_FRONT = PrescribedForce(
    (0.1, 1.0, 30.0), (60.0, -900.0, 0.0, 2.0), (0.0, 0.0, 0.0, 0.0), (9.0, -55.0, 0.0, -0.3)
)
PRESCRIBED_REAR = PrescribedForce(
    (0.1, 1.0, 30.0), (50.0, -700.0, 0.0, 1.5), (0.0, 0.0, 0.0, 0.0), (7.0, -40.0, 0.0, 0.2)
)


def test_heave_pitch_surge_matrices_of_eq_31() -> None:
    m, I_theta, L, K_a, c = 110.0 / G, 40.0, 2.6, 0.05, 0.4
    for depth, geometric in ((0.0, False), (0.0, True), (c, True)):
        vehicle = heave_pitch_surge(
            m, pitch_inertia=I_theta, spacing=L, force=PRESCRIBED_FRONT, rear_force=PRESCRIBED_REAR,
            reference_height=0.1, drag_factor=K_a, depth=depth,
        )  # fmt: skip
        vehicle = replace(vehicle, reference_gap=1.0, geometric_stiffness=geometric)
        system = linearize(vehicle, equilibrium(vehicle, OperatingPoint(30.0, 0.1), hold="frozen"))
        # (z, theta nose up, x) from our (surge, heave, pitch nose down)
        T = np.zeros((3, 3))
        T[0, 2], T[1, 0], T[2, 1] = 1.0, 1.0, -1.0
        sC, dC, sK, dK, sKxz, dKxz, sCxx = -3.5, -0.5, 1600.0, 200.0, -95.0, -15.0, -0.1
        C = np.array([[0, 0, sC], [0, 0, L / 2 * dC], [0, 0, sCxx + 2 * K_a * 30.0]])
        K = np.array([[sK, L / 2 * dK, 0], [L / 2 * dK, L**2 / 4 * sK, 0], [sKxz, L / 2 * dKxz, 0]])
        lift, d = 110.0, depth
        K[1, 1] += -d * lift + d * L / 2 * dKxz
        # Drags that differ front and rear turn with their levers; the paper has its drag through the CM.
        K[1, 1] += -(L / 2) * (9.0 - 7.0) if geometric else 0.0
        K[1, 0] += d * sKxz
        C[1, 2] += d * sCxx
        C[2, 1] += d * sCxx
        C[0, 1] += d * sC
        C[1, 1] += d**2 * sCxx + d * L / 2 * dC
        np.testing.assert_allclose(T.T @ system.K @ T, K, rtol=1e-12, atol=1e-11)
        np.testing.assert_allclose(T.T @ system.C @ T, C, rtol=1e-12, atol=1e-11)
        np.testing.assert_allclose(T.T @ system.M @ T, np.diag([m, I_theta, m]), rtol=1e-13)


@pytest.mark.parametrize(
    ("h_over_L", "expected"), [(0.0, 1.7320508075688772), (0.5, 1.5491933384829668), (1.0, 1.224744871391589)]
)
def test_pitch_to_heave_frequency_ratio(h_over_L, expected) -> None:
    L = 6.0
    coil = ImageForce(current=1e5, length=1.0, exponent=1.0, **SHEET)
    inertia = MASS * L**2 * (1 + h_over_L**2) / 12
    vehicle = heave_pitch_surge(MASS, pitch_inertia=inertia, spacing=L, force=coil, reference_height=Z0)
    system = linearize(vehicle, OperatingPoint(50.0, Z0))
    ratio = np.sqrt(system.K[2, 2] / system.M[2, 2] / (system.K[1, 1] / system.M[1, 1]))
    assert ratio == pytest.approx(expected, rel=1e-9)
    assert np.all(system.C[2, :2] == 0.0) or np.max(np.abs(system.C[2, :2])) < 1e-12  # pitch is decoupled
    assert abs(ratio - 1.4) > 0.05 or h_over_L != 1.0  # the printed value of the square body


@pytest.mark.parametrize(
    ("height", "expected"),
    [(0.005, 7.0484799267861), (0.015, 4.069441783107629), (0.05, 2.228925061062094), (0.15, 1.286870484007703),
     (0.3, 0.9099548457506613)],
)  # fmt: skip
def test_heave_frequency_of_fig_6(height, expected) -> None:
    coil = ImageForce(current=1e5, length=1.0, exponent=1 / 3, **SHEET)
    system = linearize(heave_surge(MASS, force=coil, reference_height=height), OperatingPoint(50.0, height))
    assert np.sqrt(system.K[1, 1] / system.M[1, 1]) / (2 * np.pi) == pytest.approx(expected, rel=1e-10)


# --- six freedoms ------------------------------------------------------------------------------------------------

SIX_FORCE = PrescribedForce(
    (0.2, 0.3, 30.0), (50.0, -900.0, 37.0, 2.0), (11.0, -21.0, -610.0, 0.7), (9.0, -55.0, -8.0, -0.3)
)
SIX_K = np.reshape(
    [0, 0, -220, 0, 0, 0, 0, 2440, 0, 917.2, 0, 0, 0, 0, 3600, 0, 0, 0, 0, 1079.6, 0, 2061.52, 0, 0,
     0, 0, 88, 0, 6004.000000000001, 0, 0, -22.4, 0, 84.44, 0, 4092.8], (6, 6),
)  # fmt: skip
SIX_C = np.reshape(
    [-1.2, 0, 0, 0, 0.48, 0, 0, 1.2, 0, 0.48, 0, -1.96, -8, 0, 0, 0, 3.2, 0, 0, 0.48, 0, 0.192, 0, 3.136,
     0.48, 0, 0, 0, -0.192, 0, 0, 0, 0, 0, 0, 1.44], (6, 6),
)  # fmt: skip


def six_vehicle() -> Vehicle:
    magnets = corner_magnets(SIX_FORCE, half_length=1.3, half_gauge=0.7, depth=0.4)
    return six_dof(200.0 / G, inertia=(3.0, 7.0, 9.0), magnets=magnets, reference_height=0.2, reference_gap=0.3)


def test_six_freedom_matrices() -> None:
    vehicle = six_vehicle()
    state = equilibrium(vehicle, OperatingPoint(30.0, 0.2))
    assert state.strength == pytest.approx(1.0, rel=1e-12)
    system = linearize(vehicle, state)
    np.testing.assert_allclose(system.K, SIX_K, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(system.C, SIX_C, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(np.diag(system.M), [200 / G] * 3 + [3.0, 7.0, 9.0], rtol=1e-13)
    assert system.ignorable == ("car.surge",)


def test_six_freedom_switches() -> None:
    at = OperatingPoint(30.0, 0.2)
    flat = linearize(replace(six_vehicle(), geometric_stiffness=False), at)
    np.testing.assert_allclose(np.diag(SIX_K - flat.K)[3:], [-4 * (0.7 * 11 + 0.4 * 50), -80.0, -4 * 0.7 * 11])
    straight = linearize(replace(six_vehicle(), drag_direction=False), at)
    assert straight.C[1, 1] == 0.0
    # Drag couples sway and roll to yaw through G_v and L_v only, once it does not turn with the velocity.
    np.testing.assert_allclose(straight.C[:, 5], [0, -1.96, 0, 3.136, 0, 4 * 0.49 * -0.3], atol=1e-12)


@pytest.mark.parametrize("mutate", ["wall", "lever", "drag"])
def test_six_freedom_mutants_are_caught(mutate) -> None:
    vehicle = six_vehicle()
    match mutate:
        case "wall":
            magnets = tuple(replace(m, side=-m.side) for m in vehicle.magnets)
        case "lever":
            magnets = tuple(replace(m, position=(*m.position[:2], -m.position[2])) for m in vehicle.magnets)
        case _:
            wrong = replace(SIX_FORCE, drag=tuple(-c for c in SIX_FORCE.drag))
            magnets = tuple(replace(m, force=wrong) for m in vehicle.magnets)
    system = linearize(replace(vehicle, magnets=magnets), OperatingPoint(30.0, 0.2))
    assert not np.allclose(system.K, SIX_K, rtol=1e-6, atol=1e-6)


def test_off_centre_thrust_cancels_the_yaw_term_of_drag() -> None:
    """With thrust at the magnets' level the pitch moment vanishes, and so does -4 c D0 in K64."""
    vehicle = replace(six_vehicle(), thrust_positions=(("car", (0.0, 0.0, -0.4)),))
    state = equilibrium(vehicle, OperatingPoint(30.0, 0.2))
    np.testing.assert_allclose(state.unbalanced, 0.0, atol=1e-9)
    K = linearize(vehicle, state).K
    assert K[5, 3] == pytest.approx(84.44 + 4 * 0.4 * 9.0, rel=1e-12)
