"""The electromagnet alone: force, flux, their partials, energy, saturation."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from maglev_ctrl.errors import OutOfDomain
from maglev_ctrl.forces import Electromagnet, circuit

MU0 = 4e-7 * np.pi
GRAVITY = 9.80665
GAP = 0.010
MAGNET = Electromagnet(
    34.5, turns=300, pole_area=0.0967, resistance=4.0, leakage=0.055, iron_gap=0.25e-3, flux_limit=1.2
)
IDEAL = Electromagnet(34.5, turns=300, pole_area=0.0967, resistance=4.0)


def slope(function, at, step):
    """Central difference with one extrapolation: error of the fourth order."""
    one = (function(at + step) - function(at - step)) / (2.0 * step)
    half = (function(at + 0.5 * step) - function(at - 0.5 * step)) / step
    return (4.0 * half - one) / 3.0


def test_the_textbook_force_and_inductance_of_two_air_gaps() -> None:
    i, N, S = 34.5, 300, 0.0967
    assert float(IDEAL.forces(GAP, None, 0.0).lift) == pytest.approx(MU0 * N**2 * i**2 * S / (4.0 * GAP**2), rel=1e-14)
    assert float(IDEAL.inductance(GAP)) == pytest.approx(MU0 * N**2 * S / (2.0 * GAP), rel=1e-14)
    # The same force from the flux density: two pole faces with B^2 / (2 mu0) each.
    B = float(IDEAL.flux_density(GAP))
    assert float(IDEAL.forces(GAP, None, 0.0).lift) == pytest.approx(2.0 * S * B**2 / (2.0 * MU0), rel=1e-14)


@pytest.mark.parametrize("magnet", [IDEAL, MAGNET], ids=["ideal", "leaking, with iron"])
def test_the_force_is_the_slope_of_the_coenergy(magnet: Electromagnet) -> None:
    i = float(magnet.current)
    by_gap = slope(lambda g: 0.5 * float(magnet.inductance(g)) * i**2, GAP, 1e-4)
    assert float(magnet.pull(GAP, i)) == pytest.approx(-by_gap, rel=1e-8)


@pytest.mark.parametrize("magnet", [IDEAL, MAGNET], ids=["ideal", "leaking, with iron"])
def test_partials_are_those_of_the_nonlinear_force_and_flux(magnet: Electromagnet) -> None:
    i, found = float(magnet.current), circuit(magnet, GAP)
    assert found.force_by_current == pytest.approx(slope(lambda x: float(magnet.pull(GAP, x)), i, 0.1), rel=1e-9)
    by_gap = slope(lambda g: float(magnet.pull(g, i)), GAP, 1e-4)
    assert found.force_by_closing == pytest.approx(-by_gap, rel=1e-7)
    assert float(magnet.derivatives(GAP, None, 50.0).by_height.lift) == pytest.approx(by_gap, rel=1e-7)
    by_current = slope(lambda x: float(magnet.flux_linkage(GAP, x)), i, 0.1)
    assert found.inductance == pytest.approx(by_current, rel=1e-9)
    assert found.force_by_closing > 0.0 and by_gap < 0.0


@pytest.mark.parametrize("magnet", [IDEAL, MAGNET], ids=["ideal", "leaking, with iron"])
def test_force_per_current_is_the_voltage_per_speed(magnet: Electromagnet) -> None:
    i = float(magnet.current)
    flux_by_gap = slope(lambda g: float(magnet.flux_linkage(g, i)), GAP, 1e-4)
    assert circuit(magnet, GAP).force_by_current == pytest.approx(-flux_by_gap, rel=1e-7)


def test_without_leakage_stiffness_times_inductance_is_the_square_of_the_force_per_current() -> None:
    for magnet, leakage in ((IDEAL, 0.0), (MAGNET, 0.055)):
        found = circuit(magnet, GAP)
        main = found.inductance - leakage
        assert found.force_by_closing * main == pytest.approx(found.force_by_current**2, rel=1e-13)


@pytest.mark.parametrize("wrong", [1.0, 2.0, -1.0])
def test_a_cycle_of_current_and_gap_gives_back_what_the_winding_took(wrong: float) -> None:
    """Around any closed cycle the charge of energy through the winding is the work of the force: i dpsi = -F dg."""
    corners = [(0.008, 20.0), (0.012, 20.0), (0.012, 40.0), (0.008, 30.0), (0.008, 20.0)]
    node, weight = np.polynomial.legendre.leggauss(24)
    taken = work = 0.0
    for (g0, i0), (g1, i1) in pairwise(corners):
        share = 0.5 * (node + 1.0)
        g, i = g0 + share * (g1 - g0), i0 + share * (i1 - i0)
        # d psi along the side by the chain rule on differences of the model's own flux.
        step = 1e-5
        ahead = MAGNET.flux_linkage(g + step * (g1 - g0), i + step * (i1 - i0))
        behind = MAGNET.flux_linkage(g - step * (g1 - g0), i - step * (i1 - i0))
        taken += 0.5 * float(weight @ (i * (ahead - behind) / (2.0 * step)))
        work += 0.5 * float(weight @ (-wrong * MAGNET.pull(g, i) * (g1 - g0)))
    assert abs(taken) > 1.0
    agrees = taken == pytest.approx(work, rel=1e-8)
    assert agrees == (wrong == 1.0)


def test_the_energy_balance_holds_at_any_state_of_motion() -> None:
    """d/dt (L i^2 / 2 + m z'^2 / 2 + m g z) = v i - R i^2 along the nonlinear equations of motion."""
    rng, mass = np.random.default_rng(1), 2000.0
    for _ in range(5):
        g, i, rise, v = 0.006 + 0.008 * rng.random(), 50.0 * rng.random() + 5.0, rng.normal(), 200.0 * rng.normal()
        flux_by_gap = slope(lambda x, at=i: float(MAGNET.flux_linkage(x, at)), g, 1e-4)
        current_rate = (v - 4.0 * i + flux_by_gap * rise) / float(MAGNET.inductance(g))  # g' = -z'
        acceleration = float(MAGNET.pull(g, i)) / mass - GRAVITY
        stored = slope(lambda x, at=i: 0.5 * float(MAGNET.inductance(x)) * at**2, g, 1e-4) * -rise
        stored += float(MAGNET.inductance(g)) * i * current_rate
        moving = mass * rise * (acceleration + GRAVITY)
        assert stored + moving == pytest.approx(v * i - 4.0 * i**2, rel=1e-6, abs=1e-3)


def test_for_lift_carries_the_weight_and_costs_the_heat_of_its_current() -> None:
    weight = 53e3 * GRAVITY / 16.0
    magnet = Electromagnet.for_lift(weight, GAP, turns=300, pole_area=0.0967, resistance=4.0)
    found = circuit(magnet, GAP)
    assert found.force == pytest.approx(weight, rel=1e-14)
    # By hand: B = sqrt(F mu0 / S) = 0.6497 T, i = 2 g B / (mu0 N) = 34.47 A.
    assert found.current == pytest.approx(34.47, abs=0.01)
    assert found.voltage == pytest.approx(4.0 * found.current) and found.power == pytest.approx(4.0 * found.current**2)
    assert found.power == pytest.approx(4752.0, rel=1e-3)


def test_twice_the_strength_takes_the_root_of_two_times_the_current() -> None:
    one, two = circuit(MAGNET, GAP), circuit(MAGNET, GAP, strength=2.0)
    assert two.force == pytest.approx(2.0 * one.force) and two.current == pytest.approx(np.sqrt(2.0) * one.current)
    assert two.force_by_current == pytest.approx(np.sqrt(2.0) * one.force_by_current)
    assert two.force_by_closing == pytest.approx(2.0 * one.force_by_closing)
    assert two.inductance == one.inductance
    many = MAGNET.unlimited().scaled([1.0, 4.0])
    np.testing.assert_allclose(many.forces([GAP, GAP], None, 0.0).lift / one.force, [1.0, 4.0], rtol=1e-14)
    with pytest.raises(ValueError, match="one magnet"):
        circuit(many, GAP)


def test_saturated_iron_is_refused() -> None:
    at_limit = MU0 * 300 * 34.5 / 1.2  # 2 g + c
    gap = 0.5 * (at_limit - 0.25e-3)
    assert float(MAGNET.forces(gap, None, 0.0).lift) > 0.0
    with pytest.raises(OutOfDomain, match=r"1\.21\d+ T in the gap is above the 1\.2 T"):
        MAGNET.forces(0.99 * gap, None, 0.0)
    assert float(MAGNET.unlimited().forces(0.99 * gap, None, 0.0).lift) > 0.0
    with pytest.raises(OutOfDomain, match="saturates"):
        Electromagnet.for_lift(1e6, GAP, turns=300, pole_area=0.0967, resistance=4.0, flux_limit=1.2)


def test_a_closed_gap_is_refused() -> None:
    with pytest.raises(OutOfDomain, match="zero is contact"):
        IDEAL.forces(0.0, None, 0.0)


def test_shapes_follow_the_arguments() -> None:
    found = IDEAL.forces(np.full((3, 1), GAP), None, np.zeros(4))
    assert found.lift.shape == found.drag.shape == (3, 4)
    assert IDEAL.derivatives(np.full((3, 1), GAP), None, np.zeros(4)).by_height.lift.shape == (3, 4)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"turns": 0}, "turns: expected a positive number, got 0"),
        ({"pole_area": -1.0}, "pole_area: expected a positive number"),
        ({"resistance": -1.0}, "resistance: expected a number that is not negative"),
        ({"leakage": float("nan")}, "leakage: expected"),
        ({"flux_limit": 0.0}, "flux_limit: expected a positive number"),
        ({"drive": "power"}, "drive: expected 'voltage' or 'current'"),
    ],
)
def test_wrong_parameters_are_refused(change: dict[str, object], message: str) -> None:
    right: dict[str, object] = {"turns": 300, "pole_area": 0.1, "resistance": 1.0}
    with pytest.raises(ValueError, match=message):
        Electromagnet(10.0, **(right | change))  # type: ignore[arg-type]


def test_a_current_or_lift_that_is_not_positive_is_refused() -> None:
    with pytest.raises(ValueError, match="current: expected a positive current"):
        Electromagnet(0.0, turns=300, pole_area=0.1, resistance=1.0)
    with pytest.raises(ValueError, match="lift: expected a positive number"):
        Electromagnet.for_lift(-1.0, GAP, turns=300, pole_area=0.1, resistance=1.0)
