"""Stiffness modulation by a guideway's sources, against closed forms."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import pi, sqrt

import numpy as np
import pytest

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.errors import ModelError, OutOfDomain
from maglev_ctrl.forces import CoefficientTable, ImageForce
from maglev_ctrl.forces.corner_image import CornerImageForce
from maglev_ctrl.vehicle import (
    Body,
    CoefficientElement,
    Magnet,
    OperatingPoint,
    Vehicle,
    equilibrium,
    generalized_force,
    linearize,
    models,
    stiffness_modulation,
)
from maglev_ctrl.vehicle import guideway_modulation as module
from maglev_ctrl.vehicle.guideway_modulation import (
    GuidewayPattern,
    guideway_elements,
    guideway_modulation,
    guideway_pattern,
    heave_shares,
    total_depth,
)
from maglev_ctrl.vehicle.guideway_sources import (
    DisplacedGuideway,
    GuidewaySource,
    StiffnessRipple,
    girder_bow,
    girder_softness,
    measured_profile,
    open_joints,
    pitch_ripple,
    stepped_joints,
)
from maglev_ctrl.vehicle.kinematics import stance
from maglev_ctrl.vehicle.loads import magnet_field, position_slopes

HEIGHT, SPEED, SPAN, MASS = 0.1, 60.0, 20.0, 10e3
AT = OperatingPoint(SPEED, HEIGHT)
COIL = ImageForce(1e5, 1.0, 2.5e7, 0.02, 1.0)


def single(x: float = 0.0, *more: float) -> Vehicle:
    """A car that only heaves, with magnets at x, ..."""
    places = (x, *more)
    magnets = tuple(Magnet(f"magnet_{i}", "car", force=COIL, position=(at, 0.0, 0.0)) for i, at in enumerate(places))
    return Vehicle("car", bodies=(Body("car", MASS),), magnets=magnets, reference_height=HEIGHT)


def wave(rise: Callable[[FloatArray], FloatArray], *, name: str = "wave", offset: float = 0.0) -> DisplacedGuideway:
    """A smooth profile of one span, told in its phase."""
    return DisplacedGuideway(
        name, SPAN, breaks=np.array([0.0, SPAN]), rise=lambda s: rise(2 * pi * s / SPAN), offset=offset
    )


def image_series(eta: float, orders: int) -> FloatArray:
    """Harmonics of 1/(1 - eta cos)^2: 2 beta^k (1 + k r) / r^3 with r = sqrt(1 - eta^2), beta = (1 - r)/eta."""
    r = sqrt(1.0 - eta * eta)
    k = np.arange(1, orders + 1)
    return np.asarray(2.0 * ((1.0 - r) / eta) ** k * (1.0 + k * r) / r**3)


def stiffness(vehicle: Vehicle) -> float:
    return float(linearize(vehicle, AT).K[0, 0])


@pytest.mark.parametrize("eta", [1e-3, 0.05, 0.4])
def test_a_cosine_of_height_under_an_image_force_has_its_closed_series(eta: float) -> None:
    vehicle = single()
    pattern = guideway_pattern([wave(lambda phase: eta * HEIGHT * np.cos(phase))], harmonics=5)
    K_cos, K_sin = guideway_modulation(vehicle, AT, pattern)
    K = stiffness(vehicle)
    np.testing.assert_allclose(K_cos[:, 0, 0] / K, image_series(eta, 5), rtol=1e-7, atol=1e-12)
    assert np.max(np.abs(K_sin)) < 1e-12 * K
    # First order: eps d = 2 eta w^2; the second harmonic is of second order, 3 eta^2 / 2.
    first, second = K_cos[0, 0, 0] / MASS, K_cos[1, 0, 0] / MASS
    assert first == pytest.approx(2.0 * eta * K / MASS, rel=2.0 * eta**2)
    assert second == pytest.approx(1.5 * eta**2 * K / MASS, rel=3.0 * eta**2)
    (share,) = heave_shares(vehicle, AT, pattern)
    assert share.mean_change == pytest.approx((1.0 - eta**2) ** -1.5 - 1.0, rel=1e-6, abs=1e-12)


@pytest.mark.parametrize("kind", ["girder", "steps", "profile"])
def test_the_stiffness_at_any_instant_is_that_of_the_displaced_force(kind: str) -> None:
    """Parseval and the sum of the series against the force model's own central difference at moved heights."""
    source: DisplacedGuideway = {
        "girder": girder_bow("girder", span=SPAN, rise=-0.008),
        "steps": stepped_joints("steps", spacing=SPAN, step=0.004),
        "profile": measured_profile("profile", spacing=SPAN, heights=[0.0, 0.004, -0.003, 0.001, 0.002]),
    }[kind]  # fmt: skip
    vehicle, state = single(), equilibrium(single(), AT)
    pattern = guideway_pattern([source], harmonics=60)
    K_cos, K_sin = guideway_modulation(vehicle, state, pattern)
    (share,) = heave_shares(vehicle, state, pattern)
    at, weight = source.stations(240 // (len(source.breaks) - 1))
    rise, _ = source.displaced(at)
    step = 1e-6

    def force(height: FloatArray) -> FloatArray:
        return np.array([float(generalized_force(vehicle, state, np.array([z - HEIGHT]))[0]) for z in height])

    K = -(force(HEIGHT - rise + step) - force(HEIGHT - rise - step)) / (2.0 * step)
    order = np.arange(1, 61)[:, None]
    phase = 2 * pi * order * at / SPAN
    mean = float(weight @ K)
    scale = float(np.max(np.abs(K - mean)))
    # Each coefficient, by projection of the differenced force; then energy: kept + rest = all of it.
    np.testing.assert_allclose(2.0 * (np.cos(phase) * K) @ weight, K_cos[:, 0, 0], atol=2e-6 * scale + 1e-7 * mean)
    np.testing.assert_allclose(2.0 * (np.sin(phase) * K) @ weight, K_sin[:, 0, 0], atol=2e-6 * scale + 1e-7 * mean)
    variance = float(weight @ (K - mean) ** 2)
    kept = 0.5 * float(np.sum(K_cos[:, 0, 0] ** 2 + K_sin[:, 0, 0] ** 2))
    assert kept / variance == pytest.approx(1.0 - share.rest, abs=1e-5)
    assert 1.0 - share.rest > (0.98 if kind == "steps" else 0.9999)
    assert mean / stiffness(vehicle) - 1.0 == pytest.approx(share.mean_change, abs=1e-6)


def test_a_magnet_ahead_meets_the_guideway_earlier() -> None:
    """K(t) = K(v t + x - s0), followed in time, for a profile that is not even; a flipped phase is seen."""
    ahead, offset = 3.0, 1.7
    # In first order the profile is that of the stiffness itself, -2/z of it.
    small = 1e-7
    source = wave(lambda phase: small * (np.cos(phase) + 0.5 * np.sin(2 * phase)), offset=offset)
    vehicle = single(ahead)
    K_cos, K_sin = guideway_modulation(vehicle, AT, guideway_pattern([source], harmonics=3))
    K = stiffness(vehicle)
    W = 2 * pi * SPEED / SPAN
    worst = 0.0
    for time in np.linspace(0.0, 0.3, 7):
        s = 2 * pi * (SPEED * time + ahead - offset) / SPAN
        wanted = 2.0 * K * small / HEIGHT * (np.cos(s) + 0.5 * np.sin(2 * s))
        order = np.arange(1, 4)
        found = K_cos[:, 0, 0] @ np.cos(order * W * time) + K_sin[:, 0, 0] @ np.sin(order * W * time)
        mutant = K_cos[:, 0, 0] @ np.cos(order * W * time) - K_sin[:, 0, 0] @ np.sin(order * W * time)
        assert found == pytest.approx(wanted, abs=1e-5 * K * small / HEIGHT)
        worst = max(worst, abs(mutant - wanted))
    assert worst > 0.1 * K * small / HEIGHT


def test_a_ripple_with_one_cosine_is_the_prescribed_pattern() -> None:
    vehicle = models.heave_pitch_surge(20e3, pitch_inertia=1e5, spacing=6.0, force=COIL, reference_height=HEIGHT)
    pattern = guideway_pattern([pitch_ripple("coils", pitch=7.0, ripple=0.3, harmonics=(1.0, 0.25))], harmonics=2)
    found = guideway_modulation(vehicle, AT, pattern)
    wanted = stiffness_modulation(vehicle, AT, wavelength=7.0, harmonics=(1.0, 0.25))
    for one, other in zip(found, wanted, strict=True):
        np.testing.assert_allclose(one, 0.3 * other, atol=1e-9)
    assert total_depth(heave_shares(vehicle, AT, pattern)) == pytest.approx(0.3)


def test_magnets_half_a_period_apart_cancel_odd_harmonics() -> None:
    vehicle = single(0.0, SPAN / 2)
    K_cos, K_sin = guideway_modulation(
        vehicle, AT, guideway_pattern([girder_bow("girder", span=SPAN, rise=-0.01)], harmonics=4)
    )
    size = np.hypot(K_cos[:, 0, 0], K_sin[:, 0, 0])
    assert np.max(size[[0, 2]]) < 1e-12 * size[1]
    apart = guideway_modulation(
        single(0.0, SPAN / 2.2), AT, guideway_pattern([girder_bow("girder", span=SPAN, rise=-0.01)], harmonics=4)
    )[0]
    assert abs(apart[0, 0, 0]) > 1e-3 * size[1]


def test_every_magnets_share_adds_up() -> None:
    vehicle = single(1.0, -4.0, 7.5)
    pattern = guideway_pattern(
        [girder_bow("girder", span=SPAN, rise=-0.01), open_joints("joint", spacing=8.0, opening=0.1, harmonics=3)],
        harmonics=3,
    )  # fmt: skip
    parts = guideway_elements(vehicle, AT, pattern)
    K_cos, K_sin = guideway_modulation(vehicle, AT, pattern)
    assert parts.names == ("magnet_0", "magnet_1", "magnet_2") and parts.K_cos.shape == (3, 15, 1, 1)
    np.testing.assert_allclose(np.sum(parts.K_cos, axis=0), K_cos, rtol=1e-13)
    np.testing.assert_allclose(np.sum(parts.K_sin, axis=0), K_sin, rtol=1e-13)


@pytest.mark.parametrize("opening", [0.02, 0.5, 3.0])
def test_open_joints_are_a_rectangular_pulse(opening: float) -> None:
    spacing = 8.0
    joints = open_joints("joint", spacing=spacing, opening=opening, harmonics=400)
    s = np.array([0.0, 0.4 * opening, 0.5 * spacing, spacing - 0.4 * opening])
    wave = 1.0 + (joints.coefficients.real @ np.cos(2 * pi * np.arange(1, 401)[:, None] * s / spacing))
    if opening == 3.0:  # 400 harmonics resolve it
        np.testing.assert_allclose(wave, [0.0, 0.0, 1.0 / (1.0 - opening / spacing), 0.0], atol=0.02)
    first = -2.0 * np.sin(pi * opening / spacing) / pi / (1.0 - opening / spacing)
    assert joints.coefficients[0].real == pytest.approx(first, rel=1e-14)
    # Parseval: the variance of a pulse of share w is w (1 - w), here over the mean squared.
    share = opening / spacing
    assert joints.mean_square == pytest.approx(share * (1.0 - share) / (1.0 - share) ** 2, rel=1e-12)
    kept = 0.5 * float(np.sum(np.abs(joints.coefficients) ** 2))
    assert kept < joints.mean_square
    missing = spacing / (400 * pi**2 * opening) * share / (1.0 - share)  # sum over k > 400 of 2 sin^2 / (pi k)^2
    assert joints.mean_square - kept < 2.0 * missing / (1.0 - share)


def test_a_soft_girder_has_the_series_of_a_half_sine() -> None:
    soft = girder_softness("girder", span=SPAN, variation=0.2, harmonics=6)
    at, weight = girder_bow("shape", span=SPAN, rise=1.0).stations(64)
    K = 1.0 - 0.2 * np.sin(pi * at / SPAN)
    for k, c in enumerate(soft.coefficients, start=1):
        wanted = 2.0 * weight @ (K * np.exp(-2j * pi * k * at / SPAN)) / (weight @ K)
        assert c == pytest.approx(wanted, abs=1e-13)
    assert soft.mean_square == pytest.approx(weight @ (K / (weight @ K) - 1.0) ** 2, rel=1e-12)


def test_a_wall_that_comes_nearer_turns_the_guidance_and_not_the_lift_alone() -> None:
    force = CornerImageForce(6000.0, length=0.0508, width=0.0254, thickness=0.00635)
    car = Body("car", 0.8, inertia=(0.005, 0.0, 0.0), dofs=("sway", "heave", "roll"))
    magnets = tuple(
        Magnet(name, "car", force=force, position=(0.0, side * 0.09, 0.0), side=side)
        for name, side in (("left", 1), ("right", -1))
    )
    vehicle = Vehicle("double_l", bodies=(car,), magnets=magnets, reference_height=0.02, reference_gap=0.0127)
    at = OperatingPoint(36.0, 0.02, gap=0.0127)
    small = 1e-7
    wall = measured_profile("wall", spacing=2.0, gaps=[small, -small, small, -small])
    K_cos, K_sin = guideway_modulation(vehicle, at, guideway_pattern([wall], harmonics=3))
    # The profile is a triangle wave of two cycles: harmonic 2 is 8/pi^2 of its amplitude.
    narrow, wide = (linearize(vehicle, OperatingPoint(36.0, 0.02, gap=0.0127 - d)) for d in (1e-6, -1e-6))
    state = equilibrium(vehicle, at)
    trimmed = [equilibrium(vehicle, OperatingPoint(36.0, 0.02, gap=0.0127 - d)).strength for d in (1e-6, -1e-6)]
    magnet_K = [
        sum(c.K for c in system.contributions if c.kind == "magnet") * state.strength / strength
        for system, strength in zip((narrow, wide), trimmed, strict=True)
    ]
    slope = (magnet_K[0] - magnet_K[1]) / 2e-6
    wanted = 8.0 / pi**2 * small * slope
    np.testing.assert_allclose(K_cos[1], wanted, atol=1e-4 * float(np.max(np.abs(wanted))))
    assert np.max(np.abs(K_cos[[0, 2]])) < 1e-9 * np.max(np.abs(K_cos[1]))
    assert np.max(np.abs(K_sin)) < 1e-9 * np.max(np.abs(K_cos[1]))
    assert abs(K_cos[1][0, 0]) > 0.0


def test_averaging_over_a_magnet_takes_the_sinc_of_its_length() -> None:
    sources = [girder_bow("girder", span=SPAN, rise=-0.01), pitch_ripple("coils", pitch=2.0, ripple=0.1)]
    point, long = (guideway_pattern(sources, harmonics=2, magnet_length=length) for length in (0.0, 1.5))
    a, b = (guideway_modulation(single(), AT, one)[0][:, 0, 0] for one in (point, long))
    assert point.orders == 20 and point.cycles == (1, 10)
    for order, ratio in ((1, np.sinc(1.5 / 20)), (2, np.sinc(3.0 / 20)), (10, np.sinc(1.5 / 2.0))):
        assert b[order - 1] / a[order - 1] == pytest.approx(ratio, rel=1e-12)
    # A row of point magnets over the same length averages alike.
    row = single(*(1.5 * ((i + 0.5) / 200 - 0.5) for i in range(200)))
    spread = guideway_modulation(row, AT, point)[0][:, 0, 0]
    np.testing.assert_allclose(spread[[0, 1, 9]], b[[0, 1, 9]], rtol=1e-3)


def test_two_sources_share_a_period_or_the_slower_one_is_kept() -> None:
    girder, joint = girder_bow("girder", span=25.0, rise=-0.005), pitch_ripple("sheets", pitch=10.0, ripple=0.01)
    both = guideway_pattern([joint, girder], harmonics=2)
    assert both.wavelength == 50.0 and both.cycles == (5, 2) and both.sources == (joint, girder)
    K_cos, _ = guideway_modulation(single(), AT, both)
    alone = guideway_modulation(single(), AT, guideway_pattern([joint], harmonics=2))[0]
    assert K_cos[4, 0, 0] == pytest.approx(alone[0, 0, 0], rel=1e-13)
    assert np.max(np.abs(K_cos[[0, 2, 5, 6, 7]])) == 0.0
    odd = pitch_ripple("coils", pitch=10.0 * sqrt(2.0), ripple=0.01)
    with pytest.raises(ValueError, match=r"girder and coils: wavelengths 25 m and 14\.1421 m have no common period"):
        guideway_pattern([odd, girder])
    kept = guideway_pattern([odd, girder], on_incommensurate="slower")
    assert kept.sources == (girder,) and kept.left_out == (odd,) and kept.wavelength == 25.0
    three = guideway_pattern([odd, girder, joint], on_incommensurate="slower")
    assert three.sources == (girder, joint) and three.left_out == (odd,)
    with pytest.raises(ValueError, match="takes 96 harmonics, above 60"):
        guideway_pattern([girder, pitch_ripple("coils", pitch=25.0 / 12.0, ripple=0.01)], harmonics=8)


def test_contributions_are_added_and_the_depth_is_that_of_the_sum() -> None:
    first = girder_bow("girder", span=SPAN, rise=-0.005)
    second = pitch_ripple("supports", pitch=SPAN, ripple=0.02)
    shares = [heave_shares(single(), AT, guideway_pattern([one]))[0] for one in (first, second)]
    both = guideway_pattern([first, second])
    assert both.cycles == (1, 1)
    assert total_depth(heave_shares(single(), AT, both)) == pytest.approx(
        abs(shares[0].coefficients[0] + shares[1].coefficients[0]), rel=1e-12
    )
    # Half a period apart they work against each other.
    against = pitch_ripple("supports", pitch=SPAN, ripple=0.02, offset=SPAN / 2)
    apart = total_depth(heave_shares(single(), AT, guideway_pattern([first, against])))
    assert apart == pytest.approx(abs(shares[0].coefficients[0] - shares[1].coefficients[0]), rel=1e-9)


def test_the_positions_are_doubled_until_nothing_changes(monkeypatch: pytest.MonkeyPatch) -> None:
    pattern = guideway_pattern([girder_bow("girder", span=SPAN, rise=-0.06)])
    (share,) = heave_shares(single(), AT, pattern)
    assert share.change <= module.CONVERGED and share.positions >= 32
    exact = heave_shares(single(), AT, pattern)[0].coefficients
    monkeypatch.setattr(module, "FIRST_POSITIONS", 3)
    monkeypatch.setattr(module, "CONVERGED", np.inf)  # the first doubling is taken: too coarse to be right
    coarse = heave_shares(single(), AT, pattern)[0]
    assert np.max(np.abs(coarse.coefficients - exact)) > 1e-6


def measured(stiffness: float) -> Vehicle:
    K = np.zeros((6, 6))
    K[2, 2] = stiffness
    table = CoefficientTable(
        speeds=np.array([SPEED]), mass=np.zeros((1, 6, 6)), damping=np.zeros((1, 6, 6)), stiffness=K[None],
        constant=True,
    )  # fmt: skip
    element = CoefficientElement("car_magnets", "car", table=table)
    return Vehicle("car", bodies=(Body("car", MASS),), coefficient_elements=(element,), reference_height=HEIGHT)


def test_measured_coefficients_take_ripples_and_refuse_heights() -> None:
    ripple = guideway_pattern([pitch_ripple("coils", pitch=2.0, ripple=0.1)], harmonics=1)
    assert guideway_modulation(measured(5e5), AT, ripple)[0][0, 0, 0] == pytest.approx(5e4)
    assert total_depth(heave_shares(measured(5e5), AT, ripple)) == pytest.approx(0.1)
    with pytest.raises(ModelError, match="girder: measured coefficients do not tell"):
        guideway_modulation(measured(5e5), AT, guideway_pattern([girder_bow("girder", span=SPAN, rise=-0.01)]))
    with pytest.raises(ModelError, match="heave stiffness is -500000 N/m"):
        heave_shares(measured(-5e5), AT, ripple)


def test_a_guideway_that_meets_the_magnets_is_refused() -> None:
    deep = guideway_pattern([girder_bow("girder", span=SPAN, rise=-0.2)])
    with pytest.raises(
        OutOfDomain, match=r"girder: the guideway stands -72\.68 to 127\.3 mm about its mean; there the"
    ):
        guideway_modulation(single(), AT, deep)
    # Two thirds of a half sine below its mean: the same bow upwards does not touch.
    guideway_modulation(single(), AT, guideway_pattern([girder_bow("girder", span=SPAN, rise=0.2)]))


WRONG: list[tuple[Callable[[], object], str]] = [
    (lambda: girder_bow("girder", span=0.0, rise=0.01), "girder: span: expected a positive length in m, got 0"),
    (lambda: girder_bow("girder", span=np.inf, rise=0.01), "girder: span: expected a positive length"),
    (lambda: girder_bow("girder", span=20.0, rise=np.nan), "girder: rise: expected a finite length"),
    (lambda: girder_bow("girder", span=20.0, rise=0.1, offset=np.inf), "girder: offset: expected a finite length"),
    (lambda: girder_softness("g", span=20.0, variation=1.0, harmonics=2), "variation: expected a fraction between"),
    (lambda: open_joints("joint", spacing=2.0, opening=2.0, harmonics=2), "opening: expected a length above zero"),
    (lambda: stepped_joints("joint", spacing=2.0, step=np.nan), "joint: step: expected a finite length"),
    (lambda: measured_profile("s", spacing=2.0, heights=[0.0, np.nan, 0.1]), "s: heights: every entry must be finite"),
    (lambda: StiffnessRipple("r", 2.0, coefficients=np.zeros(0, dtype=complex)), "r: coefficients: expected at least"),
    (lambda: pitch_ripple("r", pitch=2.0, ripple=np.nan), "r: coefficients: expected at least one finite number"),
    (lambda: DisplacedGuideway("s", 2.0, breaks=np.array([0.0, 1.0])), "s: breaks: expected positions from 0 to 2 m"),
    (lambda: DisplacedGuideway("s", 2.0, breaks=np.array([0.0, 2.0, 1.0])), "s: breaks: expected ascending positions"),
    (lambda: guideway_pattern([]), "expected at least one of each, got 0"),
    (lambda: guideway_pattern([girder_bow("g", span=2.0, rise=0.1)], magnet_length=-1.0), "magnet_length: expected"),
]  # fmt: skip


@pytest.mark.parametrize(("make", "words"), WRONG, ids=[words[:24] for _, words in WRONG])
def test_wrong_use_is_refused_in_a_sentence(make: Callable[[], object], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        make()


def test_patterns_are_records() -> None:
    sources: tuple[GuidewaySource, ...] = (pitch_ripple("coils", pitch=2.0, ripple=0.1),)
    found = guideway_pattern(sources, harmonics=3)
    assert isinstance(found, GuidewayPattern) and found.orders == 3 and found.cycles == (1,)


def test_an_undisplaced_guideway_leaves_every_magnets_slopes_as_they_are() -> None:
    """Walls, strengths, a tilted and offset posture: the displaced slopes are those of the loads."""
    force = CornerImageForce(6000.0, length=0.0508, width=0.0254, thickness=0.00635)
    car = Body("car", 0.8, inertia=(0.005, 0.01, 0.01), dofs=("sway", "heave", "roll", "pitch", "yaw"))
    magnets = tuple(
        Magnet(f"magnet_{i}", "car", force=force, position=(0.1 * i, side * 0.09, -0.01), side=side, count=1.0 + i)
        for i, side in enumerate((1, -1, 0))
    )
    vehicle = Vehicle("rich", bodies=(car,), magnets=magnets, reference_height=0.02, reference_gap=0.0127)
    state = equilibrium(vehicle, OperatingPoint(36.0, 0.02, gap=0.0127), hold="frozen")
    posture = replace(state.posture, offset=0.001, displacement=np.array([5e-4, 1e-4, 0.01, -0.02, 0.005]))
    here = stance(vehicle, posture.displacement)
    wanted = magnet_field(vehicle, posture, here).by_position
    lower = magnet_field(vehicle, replace(posture, height=posture.height - 1e-3), here).by_position
    nearer = magnet_field(vehicle, replace(posture, gap=0.0127 - 1e-3), here).by_position
    found = position_slopes(
        vehicle, posture, here, rise=np.array([0.0, 1e-3, 0.0]), narrowing=np.array([0.0, 0.0, 1e-3])
    )
    for one, other in zip(found, (wanted, lower, nearer), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-12 * float(np.max(np.abs(wanted))))
    assert np.max(np.abs(lower - wanted)) > 0.01 * np.max(np.abs(wanted))
