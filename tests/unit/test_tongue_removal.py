"""Damping that removes a tongue, and the elements that feed it: Hsu's closed forms against the Floquet exponents."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from maglev_ctrl.analysis.damped_pair import DampedPair, Damping
from maglev_ctrl.analysis.floquet import floquet
from maglev_ctrl.analysis.tongue_removal import element_terms, feeding_shares, tongue_removal, tongue_removals
from maglev_ctrl.analysis.tongue_search import Crossing, exponents_of
from maglev_ctrl.errors import Agreement
from maglev_ctrl.forces import ImageForce
from maglev_ctrl.guideway import common_period
from maglev_ctrl.systems import PeriodicSystem, SecondOrderSystem, at_depth, modulate
from maglev_ctrl.vehicle import (
    OperatingPoint,
    Vehicle,
    element_modulation,
    equilibrium,
    linearize,
    models,
    stiffness_modulation,
)

SUM = np.array([[0.5, 0.4], [0.3, 0.6]])
DIFFERENCE = np.array([[0.5, 0.4], [-0.3, 0.6]])
W1, W2 = 1.0, 1.7


def two_modes(K_1: np.ndarray, damping: tuple[float, float], *, frequency: float = 2.7) -> PeriodicSystem:
    system = SecondOrderSystem.from_matrices(np.eye(2), np.diag(damping), np.diag([W1**2, W2**2]))
    return modulate(system, [K_1], frequency=frequency)


# ---- damping ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("eps", "c"), [(0.1, 0.01), (0.4, 0.02), (0.8, 0.0)])
def test_one_mode_is_removed_by_its_own_growth(eps: float, c: float) -> None:
    """With one mode, an added decay rate shifts every exponent by itself: the growth at the peak is what it takes."""
    system = PeriodicSystem.from_matrices([[0, 1], [-1, -c]], [[[0, 0], [-1.0, 0]]], frequency=2.0)
    found = tongue_removal(system, "parametric", (1, 1), order=1, depth=eps)
    assert found.equal.agreement is Agreement.AGREED and found.alone == ()
    assert found.equal.unsafe < found.growth < found.equal.safe  # |s| = 1
    assert found.equal.safe == pytest.approx(found.growth, rel=2e-4)
    # Hsu: zeta = eps/4 - c/2, corrections of second order in the depth
    assert found.equal.closed_form == pytest.approx(eps / 4 - c / 2, rel=1e-3)
    assert found.equal.safe == pytest.approx(found.equal.closed_form, rel=0.3 * eps**2 + 2e-4)
    assert found.equal.warning == ""


@pytest.mark.parametrize(("K_1", "kind"), [(SUM, "sum"), (DIFFERENCE, "difference")])
def test_combination_tongues_by_hsus_quadratic(K_1: np.ndarray, kind: str) -> None:
    eps, a, b = 0.1, 0.002, 0.006
    need = eps**2 * 0.12 / (16 * W1 * W2)
    found = tongue_removal(two_modes(K_1, (2 * a, 2 * b)), kind, (1, 2), order=1, depth=eps)
    roots = np.roots([W1 * W2, a * W2 + b * W1, a * b - need])
    assert found.equal.closed_form == pytest.approx(max(roots), rel=1e-4)
    one, two = found.alone
    assert (one.modes, two.modes) == ((1,), (2,))
    assert one.closed_form == pytest.approx((need / b - a) / W1, rel=1e-4)
    assert two.closed_form == pytest.approx((need / a - b) / W2, rel=1e-4)
    for removal in (found.equal, one, two):
        assert removal.agreement is Agreement.AGREED
        assert removal.safe == pytest.approx(removal.closed_form, rel=eps**2)
        assert removal.unsafe < removal.safe < removal.unsafe * (1.0 + 3e-4)
    mutant = (np.sqrt(need) - 0.5 * (a + b)) / (0.5 * (W1 + W2))  # the mean of the decay rates instead of their product
    assert abs(mutant - found.equal.safe) > 0.02 * found.equal.safe
    swapped = (need / a - b) / W1  # damping put on the other mode
    assert abs(swapped - one.safe) > 0.2 * one.safe


def test_error_of_the_closed_form_falls_with_the_square_of_the_depth() -> None:
    gaps = []
    for eps in (0.4, 0.2):
        found = tongue_removal(two_modes(SUM, (0.004, 0.004)), "sum", (1, 2), order=1, depth=eps)
        gaps.append(abs(found.equal.safe / found.equal.closed_form - 1.0))
    assert gaps[1] < 0.35 * gaps[0]


def test_damping_one_mode_alone_destabilises_before_it_stabilises() -> None:
    """The paradox 0.0066 against 0.0234: a speed stable with little damping is lost when mode 2 gets more of it."""
    system = two_modes(SUM, (4e-5, 4e-5))
    found = tongue_removal(system, "sum", (1, 2), order=1, depth=0.05)
    for removal in found.alone:
        assert removal.widening > 3.0
        assert "first widens the tongue" in removal.warning
    # equal ratios are not equal decay rates: (w1 + w2)/(2 sqrt(w1 w2)) = 1.035, no more
    assert found.equal.warning == "" and found.equal.widening < 1.036
    half = 0.0066421
    for c_2, stable in ((4e-5, True), (2e-3, False)):
        outside = two_modes(0.05 * SUM, (4e-5, c_2), frequency=2.7 + 2.0 * half)
        assert floquet(outside).stable is stable
    # a tongue of the same modes that is removed by little is not warned of
    even = tongue_removal(two_modes(SUM, (0.008, 0.008)), "sum", (1, 2), order=1, depth=0.1)
    assert all(r.widening < 1.2 for r in even.alone)


def test_an_undamped_partner_cannot_be_helped_from_the_other_side() -> None:
    found = tongue_removal(two_modes(SUM, (0.0, 0.01)), "sum", (1, 2), order=1, depth=0.05, largest=0.2)
    one, two = found.alone
    assert np.isinf(two.closed_form) and np.isinf(two.safe)
    assert two.unsafe == 0.2 and two.agreement is Agreement.AGREED
    assert np.isfinite(one.closed_form) and one.safe == pytest.approx(one.closed_form, rel=0.05)


def test_all_tongues_present_and_only_those() -> None:
    found = tongue_removals(two_modes(SUM, (0.004, 0.012)), depth=0.1)
    assert [t.name.split(" (q")[0] for t in found] == ["2 w1/1", "(w1 + w2)/1", "2 w2/1"]
    assert all(t.growth > 0.0 for t in found)
    calm = tongue_removals(two_modes(SUM, (0.2, 0.2)), depth=0.1)
    assert calm == ()


def test_second_order_tongue_is_removed_too() -> None:
    """No first-order term: the closed form takes the second-order coupling; Mathieu's second tongue, eps^2 = 4 c."""
    eps = 0.2
    system = PeriodicSystem.from_matrices([[0, 1], [-1, -1e-4]], [[[0, 0], [-1.0, 0]]], frequency=1.0)
    found = tongue_removal(system, "parametric", (1, 1), order=2, depth=eps)
    assert found.name == "2 w1/2"
    assert found.equal.safe == pytest.approx(0.5 * (eps**2 / 4 - 1e-4), rel=0.05)
    assert found.equal.closed_form == pytest.approx(found.equal.safe, rel=0.05)


def test_tongues_at_one_place_name_each_other() -> None:
    """Two bogies of nearly one frequency: 2 w1, w1 + w2 and 2 w2 lie within each other's width."""
    plant = SecondOrderSystem.from_matrices(np.eye(2), 1e-3 * np.eye(2), np.diag([1.0, 1.002]))
    unit = modulate(plant, [[[0.5, 0.2], [0.2, 0.6]]], frequency=2.0)
    found = tongue_removal(unit, "sum", (1, 2), order=1, depth=0.1)
    assert [name.split(" (")[0] for name in found.crowd] == ["2 w1/1", "2 w2/1"]
    assert tongue_removal(two_modes(SUM, (1e-3, 1e-3)), "sum", (1, 2), order=1, depth=0.05).crowd == ()


TWINS = (1.0, 1.0035)
TWIN_DEPTH, TWIN_COUPLING = 0.1, 0.658


def twins() -> PeriodicSystem:
    """Two bogies of nearly one frequency: 2 w1, w1 + w2 and 2 w2 at one place."""
    plant = SecondOrderSystem.from_matrices(np.eye(2), 0.0276 * np.eye(2), np.diag(np.square(TWINS)))
    return modulate(plant, [[[0.33, TWIN_COUPLING], [TWIN_COUPLING, -0.32]]], frequency=2.0)


def with_modal_damping(unit: PeriodicSystem, ratios: dict[int, float]) -> PeriodicSystem:
    """Decay rates zeta |s| added by the eigenvectors of A_0; modes counted from 1, in order of frequency."""
    s, right = np.linalg.eig(unit.A_0)
    frequencies = sorted(s.imag[s.imag > 0.0])
    moved = s.copy()
    for mode, ratio in ratios.items():
        own = np.abs(np.abs(s.imag) - frequencies[mode - 1]) < 1e-9
        moved[own] -= ratio * np.abs(s[own])
    return replace(at_depth(unit, TWIN_DEPTH), A_0=(right @ np.diag(moved) @ np.linalg.inv(right)).real)


def worst_about(system: PeriodicSystem) -> tuple[float, float]:
    """Largest growth of the whole loop over passing frequencies of the tongue's width, and where: brute force."""
    half = TWIN_DEPTH * TWIN_COUPLING / (2.0 * np.sqrt(TWINS[0] * TWINS[1]))  # 2 sqrt|g|
    places = sum(TWINS) + np.linspace(-half, half, 2001)
    growth = np.max(exponents_of([replace(system, frequency=np.asarray(W)) for W in places]).real, axis=1)
    k = int(np.argmax(growth))
    return float(growth[k]), float(places[k])


def test_a_tongue_in_a_crowd_is_gone_where_the_whole_loop_decays() -> None:
    unit = twins()
    found = tongue_removal(unit, "sum", (1, 2), order=1, depth=TWIN_DEPTH)
    assert sorted(name.split(" (")[0] for name in found.crowd) == ["2 w1/1", "2 w2/1"]
    for removal in (found.equal, *found.alone):
        assert removal.agreement is Agreement.AGREED
        assert removal.unsafe < removal.safe < removal.unsafe * 1.001
        for ratio, stable in ((removal.safe, True), (removal.unsafe, False)):
            damped = with_modal_damping(unit, dict.fromkeys(removal.modes, ratio))
            growth, W = worst_about(damped)
            assert (growth < 0.0) is stable
            there = floquet(replace(damped, frequency=np.asarray(W)))
            assert there.agreement is Agreement.AGREED and there.stable is stable


def test_asking_the_nearest_pair_alone_mutant_is_caught() -> None:
    """With one mode damped the other's own tongue remains, which the two exponents nearest to w1 + w2 do not tell."""
    unit = twins()
    found = tongue_removal(unit, "sum", (1, 2), order=1, depth=TWIN_DEPTH)
    pair = DampedPair.of(at_depth(unit, TWIN_DEPTH), found.crossing)
    for removal in found.alone:
        first, second = pair.weights_of(removal.modes[0])
        damping = Damping(pair, (first * pair.modulus[0], second * pair.modulus[1]))
        damping.span(0.1)
        mutant = damping.root(0.1)
        assert mutant < 0.5 * removal.safe
        damped = with_modal_damping(unit, {removal.modes[0]: 1.001 * mutant})
        growth, W = worst_about(damped)
        assert growth > 1e-3
        there = floquet(replace(damped, frequency=np.asarray(W)))
        assert there.agreement is Agreement.AGREED and not there.stable
        assert not damping.gone(1.001 * mutant, pair.within((pair.frequency, pair.frequency)))


def test_a_tongue_that_this_damping_does_not_touch_leaves_it_unresolved() -> None:
    """2 w3 = w1 + w2 of a third mode that nothing couples to the two: no damping of these makes that place safe."""
    third = 0.5 * (W1 + W2) + 0.002
    plant = SecondOrderSystem.from_matrices(np.eye(3), 0.004 * np.eye(3), np.diag([W1**2, third**2, W2**2]))
    K = np.array([[0.1, 0.0, 0.4], [0.0, 0.3, 0.0], [0.3, 0.0, 0.1]])
    found = tongue_removal(modulate(plant, [K], frequency=2.7), "sum", (1, 3), order=1, depth=0.1)
    assert [name.split(" (")[0] for name in found.crowd] == ["2 w2/1"]
    for removal in (found.equal, *found.alone):
        assert removal.agreement is Agreement.UNRESOLVED and np.isnan(removal.safe) and np.isnan(removal.unsafe)
        assert "leaves something else growing" in removal.warning
    # the same without the third mode's own modulation
    K[1, 1] = 0.0
    alone = tongue_removal(modulate(plant, [K], frequency=2.7), "sum", (1, 3), order=1, depth=0.1)
    assert alone.crowd == () and alone.equal.agreement is Agreement.AGREED


def test_an_undamped_mode_that_stays_so_is_left_aside() -> None:
    plant = SecondOrderSystem.from_matrices(np.eye(3), np.diag([0.004, 0.004, 0.0]), np.diag([W1**2, W2**2, 9.0]))
    K = np.zeros((3, 3))
    K[:2, :2] = SUM
    found = tongue_removal(modulate(plant, [K], frequency=2.7), "sum", (1, 2), order=1, depth=0.1)
    without = tongue_removal(two_modes(SUM, (0.004, 0.004)), "sum", (1, 2), order=1, depth=0.1)
    assert found.equal.agreement is Agreement.AGREED
    assert found.equal.safe == pytest.approx(without.equal.safe, rel=1e-4)


def test_a_stable_pair_needs_nothing() -> None:
    found = tongue_removal(two_modes(SUM, (0.2, 0.2)), "sum", (1, 2), order=1, depth=0.05)
    assert found.equal.safe == 0.0 and found.equal.closed_form == 0.0


@pytest.mark.parametrize("wrong", [{"depth": 0.0}, {"largest": 0.0}, {"modes": (1, 3)}, {"order": 0}])
def test_wrong_tongues_are_refused(wrong: dict[str, object]) -> None:
    options = {"modes": (1, 2), "order": 1, "depth": 0.1, **wrong}
    with pytest.raises(ValueError, match="expected"):
        tongue_removal(two_modes(SUM, (0.01, 0.01)), "sum", **options)  # type: ignore[arg-type]


# ---- who feeds it ----------------------------------------------------------------------------------------------------


def parts_of(system: SecondOrderSystem, parts: dict[str, tuple[np.ndarray, np.ndarray]]) -> dict[str, tuple]:
    return {
        name: tuple(system.modulated_state_matrix(K)[None] for K in (cosine, sine))
        for name, (cosine, sine) in parts.items()
    }


def test_shares_are_the_sensitivity_of_the_exact_growth() -> None:
    """Undamped at resonance growth is the root of the product: d ln growth/d ln (element) is its share."""
    plant = SecondOrderSystem.from_matrices(np.eye(2), np.zeros((2, 2)), np.diag([W1**2, W2**2]))
    zero = np.zeros((2, 2))
    parts = {
        "front": (np.array([[0.5, 0.5], [0.4, 0.1]]), zero),
        "middle": (np.array([[0.1, -0.2], [0.05, 0.2]]), zero),
        "rear": (np.array([[0.0, 0.1], [0.15, 0.0]]), zero),
    }
    eps, crossing = 1e-3, Crossing("sum", (0, 1), 1, W1 + W2)

    def growth(scale: dict[str, float]) -> float:
        K_c, K_s = (eps * sum(scale.get(n, 1.0) * p[k] for n, p in parts.items()) for k in (0, 1))
        return floquet(modulate(plant, [K_c], [K_s], frequency=W1 + W2)).growth_rate

    unit = modulate(plant, [sum(p[0] for p in parts.values())], [sum(p[1] for p in parts.values())], frequency=2.7)
    shares = feeding_shares(unit, parts_of(plant, parts), crossing)
    assert sum(shares.values()) == pytest.approx(1.0, abs=1e-12)
    assert shares["middle"] < 0.0  # it works against the tongue
    step = 0.01
    for name in parts:
        slope = (growth({name: 1.0 + step}) - growth({name: 1.0 - step})) / (2.0 * step * growth({}))
        assert slope == pytest.approx(shares[name], abs=2e-3)
    diagonal = {name: p[0][0, 0] / 0.6 for name, p in parts.items()}  # the mutant that looks at one entry of K
    assert abs(diagonal["middle"] - shares["middle"]) > 0.1


def test_shares_of_a_second_order_tongue_add_up() -> None:
    plant = SecondOrderSystem.from_matrices(np.eye(2), np.zeros((2, 2)), np.diag([W1**2, W2**2]))
    zero = np.zeros((2, 2))
    parts = {"a": (np.diag([0.3, 0.1]), zero), "b": (np.diag([0.6, 0.3]), zero)}
    unit = modulate(plant, [parts["a"][0] + parts["b"][0]], frequency=1.0)
    shares = feeding_shares(unit, parts_of(plant, parts), Crossing("parametric", (0, 0), 2, 1.0))
    # the coupling is the square of the one entry (0.3 + 0.6): each part has its share of it
    assert shares["a"] == pytest.approx(1.0 / 3.0, rel=1e-9)
    assert sum(shares.values()) == pytest.approx(1.0, abs=1e-12)


def test_shares_that_do_not_add_up_are_refused() -> None:
    system = two_modes(SUM, (0.01, 0.01))
    half = {"half": (0.5 * system.A_cos, 0.5 * system.A_sin)}
    with pytest.raises(ValueError, match="add up"):
        feeding_shares(system, half, Crossing("sum", (0, 1), 1, 2.7))
    whole = {"whole": (system.A_cos, system.A_sin)}
    with pytest.raises(ValueError, match="couples"):
        uncoupled = two_modes(np.diag([0.5, 0.6]), (0.01, 0.01))
        feeding_shares(uncoupled, {"whole": (uncoupled.A_cos, uncoupled.A_sin)}, Crossing("sum", (0, 1), 1, 2.7))
    with pytest.raises(ValueError, match="oscillating modes"):
        feeding_shares(system, whole, Crossing("sum", (0, 4), 1, 2.7))


def car() -> Vehicle:
    coil, weak = ImageForce(1e5, 1.0, 2.5e7, 0.02, 1.0), ImageForce(0.9e5, 1.0, 2.5e7, 0.02, 1.0)
    return models.heave_pitch_surge(
        20e3, pitch_inertia=1e5, spacing=6.0, force=coil, rear_force=weak, reference_height=0.1
    )


AT = OperatingPoint(60.0, 0.1)


def test_element_modulation_is_the_modulation_in_parts() -> None:
    vehicle = car()
    for wavelength in (7.0, 12.0):
        parts = element_modulation(vehicle, AT, wavelength=wavelength, harmonics=(1.0, 0.25))
        K_cos, K_sin = stiffness_modulation(vehicle, AT, wavelength=wavelength, harmonics=(1.0, 0.25))
        assert parts.names == ("magnet_front", "magnet_rear")
        scale = np.max(np.abs(K_cos)) + np.max(np.abs(K_sin))
        np.testing.assert_allclose(parts.K_cos.sum(axis=0), K_cos, atol=1e-12 * scale)
        np.testing.assert_allclose(parts.K_sin.sum(axis=0), K_sin, atol=1e-12 * scale)
    shares = {c.name: c.K for c in linearize(vehicle, AT).contributions}
    phase = 2.0 * np.pi * 3.0 / 12.0
    np.testing.assert_allclose(parts.K_sin[0, 0], -np.sin(phase) * shares["magnet_front"], rtol=1e-12)
    np.testing.assert_allclose(parts.K_sin[1, 0], np.sin(phase) * shares["magnet_rear"], rtol=1e-12)
    with pytest.raises(ValueError, match="wavelength"):
        element_modulation(vehicle, AT, wavelength=-1.0)


def test_which_magnet_feeds_the_heave_tongue() -> None:
    """In phase both magnets feed heave by their stiffness; half a wave apart they work against one another."""
    vehicle = car()
    state = equilibrium(vehicle, AT)
    plant = linearize(vehicle, state)
    found = {}
    for wavelength in (6.0, 12.0 + 1e-9, 11.0):
        K_cos, K_sin = stiffness_modulation(vehicle, state, wavelength=wavelength)
        system = modulate(plant, K_cos, K_sin, frequency=1.0)
        terms = element_terms(plant, element_modulation(vehicle, state, wavelength=wavelength))
        found[wavelength] = feeding_shares(system, terms, Crossing("parametric", (0, 0), 1, 1.0))
        assert sum(found[wavelength].values()) == pytest.approx(1.0, abs=1e-9)
    assert min(found[6.0].values()) > 0.3
    assert found[11.0]["magnet_front"] > 1.0 > 0.0 > found[11.0]["magnet_rear"] or min(found[11.0].values()) < 0.3


# ---- two periods -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("first", "second", "length", "cycles"),
    [(25.0, 10.0, 50.0, (2, 5)), (10.0, 25.0, 50.0, (5, 2)), (3.0, 3.0, 3.0, (1, 1)), (1.2, 14.4, 14.4, (12, 1))],
)
def test_common_period(first: float, second: float, length: float, cycles: tuple[int, int]) -> None:
    found = common_period(first, second)
    assert found.wavelength == pytest.approx(length, rel=1e-12) and found.cycles == cycles
    assert cycles[0] * first == pytest.approx(cycles[1] * second, rel=1e-12)


def test_irrational_ratio_is_refused_with_advice() -> None:
    with pytest.raises(ValueError, match=r"treat the slower one \(25 m, the lower passing frequency\) alone"):
        common_period(25.0 / np.sqrt(2.0), 25.0)
    with pytest.raises(ValueError, match="no common period"):
        common_period(13.0, 1.0)  # a larger whole number than allowed
    assert common_period(13.0, 1.0, largest=13).cycles == (1, 13)
    near = 2.0 * (1.0 + 1e-4)
    with pytest.raises(ValueError, match="no common period"):
        common_period(near, 1.0)
    assert common_period(near, 1.0, tolerance=1e-3).mismatch == pytest.approx(1e-4, rel=1e-3)
    with pytest.raises(ValueError, match="wavelength"):
        common_period(-1.0, 1.0)


def test_two_periods_by_their_common_one() -> None:
    """Modulations of periods 2 and 3 by their common period 6: the tongue of each alone is where it was."""
    found = common_period(2.0, 3.0)
    H = np.zeros((3, 2, 2))
    H[found.cycles[0] - 1, 1, 0] = -0.1
    H[found.cycles[1] - 1, 1, 0] = -0.05
    for order, W in ((found.cycles[0], 2.0 / found.cycles[0]), (found.cycles[1], 2.0 / found.cycles[1])):
        system = PeriodicSystem.from_matrices([[0, 1], [-1, -1e-3]], H, frequency=W)
        alone = replace(system, A_cos=system.A_cos * (np.arange(3) == order - 1)[:, None, None])
        assert floquet(system).growth_rate == pytest.approx(floquet(alone).growth_rate, rel=0.02)
        assert floquet(system).stable is False
