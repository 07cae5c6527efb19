"""Vehicles with frequency-dependent magnets: internal states, p-k iteration and exact roots against known answers."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from sheet_loop import SheetLoop

from maglev_ctrl.analysis.frequency_dependent import compare_unsteady
from maglev_ctrl.analysis.modes import StabilityVerdict, modes
from maglev_ctrl.analysis.p_k import exact_root, p_k_modes
from maglev_ctrl.errors import Agreement, ModelError
from maglev_ctrl.forces import (
    AbstractForceModel,
    Domain,
    ImageForce,
    MagnetDerivatives,
    MagnetForces,
    characteristic_speed,
)
from maglev_ctrl.systems import Controller, close_loop
from maglev_ctrl.vehicle import Actuator, Body, Magnet, OperatingPoint, SpringDamper, Vehicle, linearize
from maglev_ctrl.vehicle.models import double_l, heave_surge
from maglev_ctrl.vehicle.unsteady import unsteady_vehicle, with_rational_magnets

G = 9.80665
AT = OperatingPoint(30.0, 0.1, gap=0.05)
BAND = (1.0, 200.0)


@dataclass(frozen=True)
class LaggedForce(AbstractForceModel):
    """Constant forces with stiffness matrix S (surge, sway away, heave up, roll) and lags c s/(1 + tau s) on top.

    Q(s) = S + sum over the lags of R s / (1 + tau s).
    """

    load: float = 1000.0
    drag: float = 40.0
    S: np.ndarray = field(default_factory=lambda: np.diag([0.0, 0.0, -4e4, 0.0]))
    lags: tuple[tuple[float, np.ndarray], ...] = ()
    strength: float = 1.0

    @property
    def domain(self) -> Domain:
        return Domain(height=(1e-3, 5.0), gap=None, speed=(0.0, 1e3))

    def forces(self, height, gap, speed):
        one = self.strength * np.ones(np.shape(height))
        return MagnetForces(self.load * one, 0.0 * one, self.drag * one)

    def derivatives(self, height, gap, speed):
        one = self.strength * np.ones(np.shape(height))

        def column(j: int) -> MagnetForces:
            return MagnetForces(self.S[2, j] * one, self.S[1, j] * one, -self.S[0, j] * one)

        nothing = MagnetForces(0.0 * one, 0.0, 0.0)
        return MagnetDerivatives(column(2), column(1), nothing, nothing, nothing)

    def scaled(self, factor):
        return replace(self, strength=self.strength * float(factor))

    def motion_stiffness(self, height, gap, speed, frequency):
        s = 1j * np.atleast_1d(frequency)[:, None, None]
        found = self.S + 0j * s
        for tau, R in self.lags:
            found = found + R * s / (1.0 + tau * s)
        return self.strength * found


def damping(c: float) -> np.ndarray:
    return np.diag([0.0, 0.0, -c, 0.0])


def cart(force, mass: float = 1000.0 / G, **extra) -> Vehicle:
    return Vehicle(
        "cart", (Body("car", mass),), magnets=(Magnet("magnet", "car", force=force),), reference_height=0.1, **extra
    )


def matched(found, expected):
    return np.array([found[np.argmin(np.abs(found - one))] for one in expected])


def test_a_lagging_magnet_is_the_lagging_damper() -> None:
    """The same L/R damper as a magnet's dynamic stiffness and as an element of the vehicle."""
    c, tau = 300.0, 0.02
    element = SpringDamper("winding", "car", damping=c, lag=tau)
    truth = modes(linearize(cart(LaggedForce(), connections=(element,)), AT)).s
    found = unsteady_vehicle(cart(LaggedForce(lags=((tau, damping(c)),))), AT, band=BAND, tolerance=1e-6)
    assert found.augmented.internal == ("magnet.current1",)
    np.testing.assert_allclose(modes(found.augmented).s, truth, rtol=1e-8)
    compared = compare_unsteady(found, complex_frequency=True)
    assert abs(compared.modes[0].exact - matched(truth, [compared.modes[0].exact])[0]) <= 1e-10 * abs(truth[-1])
    assert compared.verdict is StabilityVerdict.STABLE
    # Quasi-statically this magnet does not damp at all.
    assert compared.quasi_static_verdict is StabilityVerdict.UNRESOLVED
    assert compared.adequate is False


@pytest.mark.parametrize("c", [5.0, 300.0, -120.0])
def test_roots_of_one_freedom_are_those_of_the_cubic(c: float) -> None:
    """m s^2 (1 + tau s) + k (1 + tau s) + c s = 0."""
    m, k, tau = 1000.0 / G, 4e4, 0.02
    roots = np.roots([m * tau, m, k * tau + c, k])
    swinging = roots[np.argmax(roots.imag)]
    found = unsteady_vehicle(cart(LaggedForce(lags=((tau, damping(c)),))), AT, band=BAND, tolerance=1e-6)
    mode = p_k_modes(found)[0]
    assert mode.converged
    assert abs(mode.s - swinging) <= mode.error
    # The correction is worth having: the classical result is first order in the growth rate, this one third.
    assert abs(mode.s - swinging) < 0.2 * abs(mode.classical - swinging)
    assert abs(exact_root(found, mode.shape, mode.s) - swinging) <= 1e-10 * abs(swinging)
    np.testing.assert_allclose(matched(modes(found.augmented).s, [swinging]), swinging, rtol=1e-8)
    expected = StabilityVerdict.STABLE if c > 0.0 else StabilityVerdict.UNSTABLE
    assert compare_unsteady(found, complex_frequency=True).verdict is expected


def test_p_k_is_exact_on_the_stability_boundary() -> None:
    """A dashpot that balances the lag exactly: no growth, so the coefficients at iw are those at s."""
    m, k, tau, c = 1000.0 / G, 4e4, 0.02, -120.0
    # On the axis c s/(1 + tau s) damps by c/(1 + tau^2 w^2); find w and the dashpot d with D(iw) = 0.
    w = np.sqrt(k / m)
    for _ in range(100):
        w = np.sqrt((k + c * tau * w**2 / (1.0 + (tau * w) ** 2)) / m)
    d = -c / (1.0 + (tau * w) ** 2)
    vehicle = cart(LaggedForce(lags=((tau, damping(c)),)), connections=(SpringDamper("d", "car", damping=d),))
    found = unsteady_vehicle(vehicle, AT, band=BAND, tolerance=1e-6)
    mode = p_k_modes(found)[0]
    assert abs(mode.classical - 1j * w) < 1e-9 * w
    compared = compare_unsteady(found)
    assert compared.verdict is StabilityVerdict.UNRESOLVED
    assert compared.modes[0].agreement is Agreement.UNRESOLVED


def test_real_roots_carry_an_honest_error() -> None:
    """A magnet that repels less the higher it is pushed down diverges; its rate depends on the lag."""
    S, tau, c = np.diag([0.0, 0.0, 4e3, 0.0]), 0.02, 300.0
    m = 1000.0 / G
    roots = np.roots([m * tau, m, -4e3 * tau + c, -4e3])
    growing = roots[np.argmax(roots.real)].real
    found = unsteady_vehicle(cart(LaggedForce(S=S, lags=((tau, damping(c)),))), AT, band=BAND, tolerance=1e-6)
    mode = next(one for one in p_k_modes(found) if one.s.real > 0.0)
    assert abs(mode.s - growing) <= mode.error
    assert exact_root(found, mode.shape, mode.s) == pytest.approx(growing, rel=1e-10)
    assert compare_unsteady(found, complex_frequency=True).verdict is StabilityVerdict.UNSTABLE


def random_force(rng, *, active: float) -> LaggedForce:
    """Lags with random coupling of sway and heave; dissipative for active = 0."""
    S = np.zeros((4, 4))
    S[1:3, 1:3] = -np.diag(rng.uniform(2e4, 6e4, 2))
    S[1, 2] = S[2, 1] = 3e3 * rng.normal()
    lags = []
    for tau in rng.uniform(0.002, 0.05, 3):
        R, root = np.zeros((4, 4)), rng.normal(size=(3, 3))
        R[:3, :3] = -30.0 * root @ root.T + active * rng.normal(size=(3, 3))
        lags.append((float(tau), R))
    return LaggedForce(S=S, lags=tuple(lags))


def swaying(force, *, side: int = -1, second: float = 1.0) -> Vehicle:
    body = Body("car", 2000.0 / G, inertia=(20.0, 1.0, 1.0), dofs=("surge", "sway", "heave", "roll"))
    return Vehicle(
        "swaying", (body,), reference_height=0.1, reference_gap=0.05,
        magnets=(
            Magnet("one", "car", force=force, position=(0.0, -0.4 * side, -0.3), side=-side),
            Magnet("two", "car", force=force, position=(0.0, 0.4 * side, -0.3), side=side, count=second),
        ),
        connections=(
            SpringDamper("righting", "car", direction=(1.0, 0.0, 0.0), angular=True, stiffness=3e3),
        ),
    )  # fmt: skip


@pytest.mark.parametrize("active", [0.0, 400.0])
@pytest.mark.parametrize("seed", range(4))
def test_three_methods_agree_on_random_magnets(seed: int, active: float) -> None:
    rng = np.random.default_rng(seed)
    found = unsteady_vehicle(swaying(random_force(rng, active=active)), AT, band=BAND, tolerance=1e-6)
    compared = compare_unsteady(found, complex_frequency=True)
    resolved = [one for one in compared.modes if one.agreement is Agreement.AGREED]
    assert len(resolved) >= 3
    for one in resolved:
        assert abs(one.exact - one.rational) <= 1e-6 * abs(one.exact) + one.rational_error
        assert abs(one.p_k - one.exact) <= one.p_k_error
        assert abs(np.linalg.det(found.dynamic_stiffness(one.exact))) < 1e-6 * np.prod(
            np.linalg.norm(found.dynamic_stiffness(one.exact), axis=1)
        )
    if active == 0.0:
        assert all(one.s.real < 0.0 for one in compared.modes)


def test_both_sides_of_a_track_are_mirror_images() -> None:
    """Whichever side the wall is on, the vehicle is the same; a wrong sign of sway would couple it to heave."""
    force = random_force(np.random.default_rng(5), active=100.0)
    left, right = (
        unsteady_vehicle(swaying(force, side=side, second=2.0), AT, band=BAND, tolerance=1e-6) for side in (1, -1)
    )
    mirror = np.diag([1.0, -1.0, 1.0, -1.0])
    D = left.dynamic_stiffness(20j)
    np.testing.assert_allclose(mirror @ D @ mirror, right.dynamic_stiffness(20j), rtol=1e-12, atol=1e-9)
    A, B = (np.sort(modes(one.augmented).s[-4:]) for one in (left, right))
    np.testing.assert_allclose(A, B, rtol=1e-9)
    sway, heave = left.rest.dofs.index("car.sway"), left.rest.dofs.index("car.heave")
    assert abs(D[sway, heave]) > 1e-3 * abs(D[heave, heave])
    D = unsteady_vehicle(swaying(force), AT, band=BAND, tolerance=1e-6).dynamic_stiffness(20j)
    assert abs(D[sway, heave]) < 1e-9 * abs(D[heave, heave])


def test_wrong_signs_and_another_magnet_are_caught() -> None:
    force = random_force(np.random.default_rng(5), active=0.0)
    turned = replace(force, S=force.S * np.array([1.0, -1.0, 1.0, 1.0]))  # sway towards the wall
    with pytest.raises(ModelError, match="not the same magnet, or another sign convention"):
        unsteady_vehicle(swaying(force), AT, band=BAND, dynamic=turned)
    with pytest.raises(ModelError, match="not the same magnet"):
        unsteady_vehicle(swaying(force), AT, band=BAND, dynamic=force.scaled(1.1))


def test_nothing_is_doubled() -> None:
    """The static limit is the quasi-static vehicle; damping is Q's own, without the drag-direction term."""
    force = random_force(np.random.default_rng(7), active=50.0)
    vehicle = swaying(force)
    found = unsteady_vehicle(vehicle, AT, band=BAND, tolerance=1e-6)
    np.testing.assert_allclose(found.augmented.K, found.quasi_static.K, rtol=1e-9, atol=1e-6)
    sway = vehicle.dofs.index("car.sway")
    assert found.quasi_static.C[sway, sway] == pytest.approx(2.0 * force.drag / AT.speed)
    assert found.rest.C[sway, sway] == 0.0
    total = -2.0 * sum(R[1, 1] for _, R in force.lags)
    slow = found.dynamic_stiffness(0.01j)
    assert slow[sway, sway].imag / 0.01 == pytest.approx(total, rel=1e-5)
    modes(found.augmented)  # raises unless the contributions add up


def test_a_doubled_share_is_refused() -> None:
    force = LaggedForce(lags=((0.02, damping(300.0)),))
    vehicle = cart(force)
    once = unsteady_vehicle(vehicle, AT, band=BAND)
    with pytest.raises(ValueError, match="expected the quasi-static share of 'magnet'"):
        unsteady_vehicle(vehicle, AT, band=BAND, system=once.augmented)
    base = once.quasi_static
    doubled = replace(base, contributions=tuple(replace(c, K=2.0 * c.K) for c in base.contributions), K=2.0 * base.K)
    with pytest.raises(ValueError, match="expected the quasi-static share"):
        unsteady_vehicle(vehicle, AT, band=BAND, system=doubled)
    # The mutant that adds Q to the quasi-static share has another frequency than the cubic.
    mutant = replace(once.augmented, K=once.augmented.K + base.K)
    mutated, right = (np.max(np.linalg.eigvals(one.state_matrix()).imag) for one in (mutant, once.augmented))
    assert abs(mutated / right - np.sqrt(2.0)) < 0.01


def test_vehicle_and_guideway_moving_together_feel_nothing() -> None:
    found = unsteady_vehicle(swaying(random_force(np.random.default_rng(2), active=50.0)), AT, band=BAND)
    system = found.augmented
    for freedom in ("heave", "sway"):
        along = np.zeros(len(system.dofs))
        along[system.dofs.index(f"car.{freedom}")] = 1.0
        under = np.array([float(name.startswith(f"{freedom}@")) for name in system.guideway])
        for left, right in ((system.K, system.K_w), (system.C, system.C_w)):
            np.testing.assert_allclose(left @ along, right @ under, atol=1e-7 * np.max(np.abs(left)))
        np.testing.assert_allclose(system.G_v @ along + system.G_wv @ under, 0.0, atol=1e-12)


def test_strength_and_count_scale_the_response() -> None:
    force = LaggedForce(lags=((0.02, damping(300.0)),))
    single = unsteady_vehicle(cart(force, 3000.0 / G), AT, band=BAND)  # trimmed: three times the strength
    triple = unsteady_vehicle(
        replace(cart(force, 3000.0 / G), magnets=(Magnet("magnet", "car", force=force, count=3.0),)), AT, band=BAND
    )
    np.testing.assert_allclose(single.dynamic_stiffness(15j), triple.dynamic_stiffness(15j), rtol=1e-12)
    assert single.responses[0].factor == pytest.approx(3.0)


def test_tilt_adds_the_roll_rows_only_when_asked() -> None:
    force = LaggedForce(S=np.diag([0.0, -3e4, -4e4, -500.0]), lags=((0.02, np.diag([0.0, -20.0, -30.0, -7.0])),))
    vehicle = swaying(force)
    roll = vehicle.dofs.index("car.roll")
    points, plates = (
        unsteady_vehicle(vehicle, AT, band=BAND, tilt=tilt).dynamic_stiffness(10j) for tilt in (False, True)
    )
    added = plates - points
    expected = -2.0 * (-500.0 - 7.0 * 10j / (1.0 + 0.2j))
    assert added[roll, roll] == pytest.approx(expected, rel=1e-9)
    added[roll, roll] = 0.0
    assert np.max(np.abs(added)) < 1e-9


def test_a_closed_loop_keeps_its_controller() -> None:
    force = LaggedForce(lags=((0.02, damping(-100.0)),))
    vehicle = cart(force).with_elements(actuators=(Actuator("push", "car"),))
    dashpot = Controller.from_matrices(
        np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), [[-400.0]],
        measured=("car.heave.velocity",), commands=("push",),
    )  # fmt: skip
    opened = unsteady_vehicle(vehicle, AT, band=BAND)
    closed = unsteady_vehicle(vehicle, AT, band=BAND, system=close_loop(linearize(vehicle, AT), dashpot))
    assert compare_unsteady(opened, complex_frequency=True).verdict is StabilityVerdict.UNSTABLE
    assert compare_unsteady(closed, complex_frequency=True).verdict is StabilityVerdict.STABLE


def test_methods_that_disagree_leave_the_mode_unresolved() -> None:
    """Mutant: internal states with the residues' sign turned, as a wrong sign of Im Q in one method would make."""
    found = unsteady_vehicle(cart(LaggedForce(lags=((0.02, damping(300.0)),))), AT, band=BAND)
    fits = tuple(replace(fit, residues=-fit.residues, damping=-fit.damping) for fit in found.fits)
    wrong = replace(found, augmented=with_rational_magnets(found.quasi_static, found.responses, fits))
    for complex_frequency in (False, True):
        compared = compare_unsteady(wrong, complex_frequency=complex_frequency)
        assert compared.verdict is StabilityVerdict.UNRESOLVED
        assert compared.adequate is None
        assert "the methods leave" in compared.modes[0].note


def test_what_is_not_settled_or_above_the_band_is_unresolved() -> None:
    force = LaggedForce(lags=((0.02, damping(300.0)),))
    low = unsteady_vehicle(cart(force), AT, band=(0.5, 10.0))
    compared = compare_unsteady(low)
    assert compared.verdict is StabilityVerdict.UNRESOLVED
    assert "above the band" in compared.modes[0].note
    hasty = p_k_modes(unsteady_vehicle(cart(force), AT, band=BAND), iterations_at_most=1)
    assert not hasty[0].converged
    assert hasty[0].error == np.inf


def test_quasi_static_theory_is_adequate_where_the_lag_does_nothing() -> None:
    dashpot = (SpringDamper("d", "car", damping=200.0),)
    weak = unsteady_vehicle(cart(LaggedForce(lags=((0.02, damping(2.0)),)), connections=dashpot), AT, band=BAND)
    assert compare_unsteady(weak).adequate is True
    strong = unsteady_vehicle(cart(LaggedForce(lags=((0.02, damping(90.0)),)), connections=dashpot), AT, band=BAND)
    assert compare_unsteady(strong).adequate is False
    assert compare_unsteady(strong, share=0.9).adequate is True


# ---- the loop over a thin sheet, in closed form -------------------------------------------------------------


def test_the_sheet_loop_is_right() -> None:
    """Perfect conductor: image force; slow motion: partials of the steady force."""
    ideal = SheetLoop(w=1e-9)
    assert ideal.steady(8e-3, 36.0)[0] == pytest.approx(38.2735036, rel=1e-6)
    assert ideal.steady(15.875e-3, 36.0)[0] == pytest.approx(9.4030458, rel=1e-6)
    loop, h, v, w = SheetLoop(), 15.9e-3, 36.1, 0.02
    Q = loop.motion_stiffness(h, None, v, [0.0, w])
    by = loop.derivatives(h, None, v)
    assert Q[0, 2, 2].real == pytest.approx(float(by.by_height.lift), rel=1e-6)
    assert Q[0, 0, 2].real == pytest.approx(-float(by.by_height.drag), rel=1e-6)
    assert Q[1, 2, 0].imag / w == pytest.approx(float(by.by_speed.lift), rel=1e-4)
    assert Q[1, 0, 0].imag / w == pytest.approx(-float(by.by_speed.drag), rel=1e-4)


def sheet_vehicle(flip: bool = False):
    vehicle = heave_surge(0.3, force=SheetLoop(flip=flip), reference_height=15.9e-3, drag_factor=1e-2)
    return unsteady_vehicle(vehicle, OperatingPoint(36.1, 15.9e-3), band=(0.5, 400.0))


def test_heave_over_a_sheet_is_damped_more_than_quasi_static_theory_says() -> None:
    found = sheet_vehicle()
    assert found.augmented.ignorable == ("car.surge",)
    compared = compare_unsteady(found, complex_frequency=True)
    heave = next(one for one in compared.modes if one.label == "car heave")
    assert heave.agreement is Agreement.AGREED
    assert abs(heave.p_k - heave.exact) <= heave.p_k_error
    assert abs(heave.rational - heave.exact) <= heave.rational_error
    # From the closed form: -c/2m of heave alone, -0.0798 N s/m at 6 Hz, comes on top of the coupling with surge.
    c = found.responses[0].model.motion_stiffness(15.9e-3, None, 36.1, [37.7])[0, 2, 2].imag / 37.7
    own = found.responses[0].factor * c / (2.0 * 0.3)
    assert heave.exact.real - heave.quasi_static.real == pytest.approx(own, rel=0.02)
    assert heave.adequate is False


def test_a_flipped_sign_of_the_phase_turns_damping_into_growth() -> None:
    def change(found) -> float:
        mode = next(one for one in p_k_modes(found) if one.label == "car heave")
        return mode.s.real - mode.start.real

    vehicle = Vehicle(
        "heave", (Body("car", 0.3),), magnets=(Magnet("magnet", "car", force=SheetLoop()),), reference_height=15.9e-3
    )
    at = OperatingPoint(36.1, 15.9e-3)
    right = unsteady_vehicle(vehicle, at, band=(1.0, 400.0))
    # The mutant's response leads where the true one lags.
    wrong = replace(
        right, responses=tuple(replace(one, model=replace(one.model, flip=True)) for one in right.responses)
    )
    assert change(right) < 0.0 < change(wrong)
    assert change(wrong) == pytest.approx(-change(right), rel=1e-2)
    assert compare_unsteady(wrong).verdict is StabilityVerdict.UNRESOLVED


def test_a_force_model_without_dynamic_stiffness_is_refused() -> None:
    class Still(LaggedForce):
        motion_stiffness = None

    with pytest.raises(ValueError, match="has a dynamic stiffness"):
        unsteady_vehicle(cart(Still()), AT, band=BAND)
    with pytest.raises(ValueError, match="there is no magnet 'magnit'"):
        unsteady_vehicle(cart(LaggedForce()), AT, band=BAND, dynamic={"magnit": LaggedForce()})
    with pytest.raises(ValueError, match="band: expected"):
        unsteady_vehicle(cart(LaggedForce()), AT, band=(10.0, 1.0))
    with pytest.raises(ValueError, match="agreement: expected"):
        compare_unsteady(unsteady_vehicle(cart(LaggedForce()), AT, band=BAND), agreement=0.0)


def test_the_double_l_vehicle_runs_through() -> None:
    """Sway and roll coupled through magnets below the centre of mass."""
    S = np.zeros((4, 4))
    S[1, 1], S[2, 2], S[1, 2], S[2, 1] = -149.0, -546.0, -2.8, -2.8
    R = np.zeros((4, 4))
    R[1, 1], R[2, 2], R[1, 2], R[2, 1] = -0.153, -0.098, 0.014, 0.014
    force = LaggedForce(load=4.142, drag=1.844, S=S, lags=((1e-3, R),))
    vehicle = double_l(force, height=12.7e-3, speed=36.1, gap=12.7e-3, drag_direction=True)
    found = unsteady_vehicle(vehicle, OperatingPoint(36.1, 12.7e-3, gap=12.7e-3), band=(1.0, 200.0))
    compared = compare_unsteady(found, complex_frequency=True)
    assert all(one.agreement is Agreement.AGREED for one in compared.modes)
    assert compared.static_mismatch < 1e-12


def test_a_lateral_stiffness_that_was_left_out_makes_a_free_coordinate_matter() -> None:
    """A magnet over a plate without a wall: quasi-static theory knows no lateral force, Q does."""
    force = LaggedForce(S=np.diag([0.0, -2e3, -4e4, 0.0]), lags=((0.01, np.diag([-5.0, -20.0, -30.0, 0.0])),))
    body = Body("car", 1000.0 / G, dofs=("surge", "sway", "heave"))
    vehicle = Vehicle("plate", (body,), magnets=(Magnet("magnet", "car", force=force),), reference_height=0.1)
    found = unsteady_vehicle(vehicle, AT, band=BAND, tolerance=1e-6)
    assert found.quasi_static.ignorable == ("car.surge", "car.sway")
    assert found.augmented.ignorable == ("car.surge",)
    compared = compare_unsteady(found, complex_frequency=True)
    sway = next(one for one in compared.modes if one.label == "car sway")
    assert sway.s.imag == pytest.approx(np.sqrt(2e3 / (1000.0 / G)), rel=1e-2)
    assert sway.agreement is Agreement.AGREED


class LineCurrent:
    """A line current across the track that heaves over a thin sheet: the 2-D limit, in closed form."""

    def __init__(self, current: float, length: float, w: float) -> None:
        self.current, self.length, self.w = current, length, w

    def motion_stiffness(self, height, gap, speed, frequency):
        node, weight = np.polynomial.laguerre.laggauss(60)
        k, s = node / (2.0 * height), 1j * np.asarray(frequency)[:, None]

        def reflected(rate):
            return -sum(r / (k * self.w + r) for r in (rate + 1j * k * speed, rate - 1j * k * speed)) / 2.0

        Q = np.zeros((len(s), 4, 4), dtype=complex)
        factor = 2e-7 * self.current**2 * self.length / (2.0 * height)
        Q[:, 2, 2] = factor * np.sum(weight * k * (reflected(0.0) + reflected(s)), axis=1)
        return Q


@pytest.mark.parametrize("ratio", [0.5, 1.0, 3.0])
def test_slow_heave_of_a_line_current_is_the_receding_image(ratio: float) -> None:
    """Q(0) is the image force's stiffness, Im Q/w its receding-image damping, which changes sign at v = w."""
    image = ImageForce(1e5, 1.0, 2.5e7, 0.02, 1.0, vertical_velocity="receding_image")
    w = characteristic_speed(2.5e7, 0.02)
    slow = 1e-6
    Q = LineCurrent(1e5, 1.0, w).motion_stiffness(0.1, None, ratio * w, np.array([0.0, slow]))[:, 2, 2]
    by = image.derivatives(0.1, None, ratio * w)
    assert Q[0].real == pytest.approx(float(by.by_height.lift), rel=1e-9)
    scale = abs(float(by.by_height.lift)) * 0.1 / w
    assert Q[1].imag / slow == pytest.approx(float(by.by_vertical_velocity.lift), abs=1e-5 * scale)


def test_drag_follows_the_velocity_only_for_a_coil_without_a_direction() -> None:
    """D/v as lateral damping: nearly right for a square coil, a factor of two wrong for one twice as long as wide."""
    for a, c, low, high in ((25.4e-3, 25.4e-3, 0.97, 1.03), (25.4e-3, 12.7e-3, 2.0, 2.6), (12.7e-3, 25.4e-3, 0.3, 0.5)):
        loop, h, v, w = SheetLoop(a=a, c=c), 15.9e-3, 36.1, 0.5
        lateral = -loop.motion_stiffness(h, None, v, [w])[0, 1, 1].imag / w
        assert low < lateral / (loop.steady(h, v)[1] / v) < high


def test_a_band_is_found_from_the_quasi_static_modes() -> None:
    found = unsteady_vehicle(cart(LaggedForce(lags=((0.02, damping(30.0)),))), AT)
    assert found.band == pytest.approx((0.1 * np.sqrt(4e4 * G / 1000.0), 2.0 * np.sqrt(4e4 * G / 1000.0)))
    assert compare_unsteady(found).verdict is StabilityVerdict.STABLE
    falling = cart(LaggedForce(S=np.diag([0.0, 0.0, 4e3, 0.0])))
    with pytest.raises(ValueError, match="no mode swings"):
        unsteady_vehicle(falling, AT)
