"""Eddy-current forces from first principles against closed forms, reciprocity and the numbers of two other methods.

Plates are wide but not infinite, which leaves about 0.1 %; the numbers reached are in docs/field_validation.md.
"""

from __future__ import annotations

import importlib.util
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from maglev_ctrl.errors import OutOfDomain
from maglev_ctrl.fields.coil import RectangularCoil
from maglev_ctrl.fields.section import CrossSection
from maglev_ctrl.fields.solve import Fineness
from maglev_ctrl.forces.base import Domain
from maglev_ctrl.forces.eddy_current import EddyCurrentForce

spec = importlib.util.spec_from_file_location("closed_forms", Path(__file__).with_name("closed_forms.py"))
closed_forms = importlib.util.module_from_spec(spec)
sys.modules["closed_forms"] = closed_forms
spec.loader.exec_module(closed_forms)
MU_0, Placed, PlateCoils = closed_forms.MU_0, closed_forms.Placed, closed_forms.PlateCoils
corner_images, image_lift = closed_forms.corner_images, closed_forms.image_lift
perfect, slab, thin_sheet = closed_forms.perfect, closed_forms.slab, closed_forms.thin_sheet

THICKNESS, CONDUCTIVITY = 6.35e-3, 2.5e7
MAGNET = RectangularCoil(length=50.8e-3, width=25.4e-3, current=6000.0, lateral=12.7e-3, height=3.175e-3)
COIL = replace(MAGNET, lateral=0.0, height=0.0)
AT = (12.7e-3, 12.7e-3, 36.1)
IMAGES = ((5.0, 10.0, 21.1179, 19.805), (12.7, 15.9, 8.3459, 3.5326), (12.7, 30.0, 1.5816, 3.4278))
"""Gap and loop height, mm; lift and guidance, N."""


@pytest.fixture(scope="module")
def plate() -> EddyCurrentForce:
    """A plate solved for every coil within 32 mm of the middle and 9 to 20 mm above it."""
    section = CrossSection.plate(width=0.26, thickness=THICKNESS, conductivity=CONDUCTIVITY)
    return EddyCurrentForce.solve(
        section,
        (replace(COIL, width=64e-3),),
        height=(9e-3, 20e-3),
        gap=None,
        speed=(5.0, 40.0),
        frequency=320.0,
        accuracy="draft",
    )


@pytest.fixture(scope="module")
def corner() -> EddyCurrentForce:
    """The default guideway."""
    section = CrossSection.l_shape(leg=76.2e-3, thickness=THICKNESS, conductivity=CONDUCTIVITY)
    return EddyCurrentForce.solve(
        section, (MAGNET,), height=(5e-3, 26e-3), gap=(4.5e-3, 28e-3), speed=(5.0, 40.0), frequency=201.0,
        accuracy=Fineness(0.5, 0.6, 3, points=3, tolerance=1e-5, rates_per_decade=1.0),  # between draft and standard
    )  # fmt: skip


def over_plate(*coils: RectangularCoil, height: float, conductivity: float = CONDUCTIVITY) -> PlateCoils:
    """The same coils over an infinite plate."""
    placed = [Placed(coil, coil.lateral, height + coil.height) for coil in coils]
    return PlateCoils(placed, slab(THICKNESS, conductivity))


def lift_guidance_drag(model: EddyCurrentForce, height: float, gap: float | None, speed: float) -> np.ndarray:
    found = model.forces(height, gap, speed)
    return np.array([float(found.lift), float(found.guidance), float(found.drag)])


# -- Closed forms among themselves -----------------------------------------------------------------------------------


@pytest.mark.parametrize(("height", "published"), [(8e-3, 38.2735036), (15.875e-3, 9.4030458)])
def test_the_fourier_integral_of_a_perfect_plate_is_neumanns_force_of_the_image(
    height: float, published: float
) -> None:
    by_fourier = PlateCoils([Placed(COIL, 0.0, height)], perfect, count=16, reach=22.0).forces(30.0)[2]
    assert by_fourier == pytest.approx(image_lift(COIL, height), rel=1e-9)
    assert by_fourier == pytest.approx(published, rel=1e-8)
    assert by_fourier != pytest.approx(image_lift(COIL, height * (1.0 + 1e-8)), rel=1e-9)


def test_three_images_in_a_corner_give_the_published_forces() -> None:
    for y, z, lift, guidance in (
        (5.0, 10.0, 21.1179, 19.805),
        (12.7, 15.9, 8.3459, 3.5326),
        (12.7, 30.0, 1.5816, 3.4278),
    ):
        found = corner_images(COIL, (y + 12.7) * 1e-3, z * 1e-3)
        np.testing.assert_allclose(found, (guidance, lift), rtol=1e-4)


def test_a_thin_sheet_drags_by_w_over_v_and_is_the_limit_of_slabs() -> None:
    w = 10.0
    sheet = PlateCoils([Placed(COIL, 0.0, 15.875e-3)], thin_sheet(w))
    for v in (1.0, 10.0, 1000.0):
        surge, _, heave, _ = sheet.forces(v)
        assert -surge / heave == pytest.approx(w / v, rel=1e-10)
    apart = []
    for d in (1e-4, 5e-5):
        thin = PlateCoils([Placed(COIL, 0.0, 15.875e-3)], slab(d, 2.0 / (MU_0 * w * d)))
        apart.append(thin.forces(15.0)[2] / sheet.forces(15.0)[2] - 1.0)
    assert apart[0] == pytest.approx(2.0 * apart[1], rel=0.01) and abs(apart[0]) < 0.01


def heave_damping(coil: RectangularCoil, share: float) -> float:
    """c of heave 15.9 mm over a thin sheet at v = share w; positive is negative damping."""
    sheet = PlateCoils([Placed(coil, 0.0, 15.875e-3)], thin_sheet(10.0))
    return float(sheet.motion_stiffness(10.0 * share, 0.5)[2, 2].imag)


def test_heave_damping_changes_sign_for_coils_wide_across_the_track() -> None:
    for width, share in ((50.8e-3, 2.0), (101.6e-3, 1.4)):
        across = replace(COIL, width=width, length=25.4e-3)
        assert heave_damping(across, share - 0.1) < 0.0 < heave_damping(across, share + 0.1)
    assert heave_damping(COIL, 2.1) < 0.0 and heave_damping(COIL, 20.0) < 0.0  # never for the magnet of the paper


# -- A wide plate ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("height", [10e-3, 15.875e-3])
def test_a_thick_plate_lifts_and_drags_as_the_slab_does(plate: EddyCurrentForce, height: float) -> None:
    magnet = replace(plate, coils=(COIL,))
    for v, rtol in ((10.0, 1e-3), (36.1, 1e-3)):
        surge, _, heave, _ = over_plate(COIL, height=height).forces(v)
        lift, _, drag = lift_guidance_drag(magnet, height, None, v)
        assert lift == pytest.approx(heave, rel=rtol) and drag == pytest.approx(-surge, rel=rtol)
        wrong = over_plate(COIL, height=height, conductivity=1.1 * CONDUCTIVITY).forces(v)
        assert lift != pytest.approx(wrong[2], rel=5.0 * rtol)


def test_a_moving_coil_over_a_plate_feels_the_closed_forms_dynamic_stiffness(plate: EddyCurrentForce) -> None:
    height = 13e-3
    magnet, closed = replace(plate, coils=(COIL,)), over_plate(COIL, height=height)
    for v in (5.0, 10.0, 36.1):
        w = 2.0 * np.pi * np.array([0.0, 5.0, 50.0])
        found = magnet.motion_stiffness(height, None, v, w)[:, :3, :3]
        exact = np.array([closed.motion_stiffness(v, one) for one in w])
        np.testing.assert_allclose(found, exact, rtol=0.0, atol=2e-3 * abs(exact[0, 2, 2]))
        np.testing.assert_allclose(found[:, 2, 2], exact[:, 2, 2], rtol=1.5e-3)
        np.testing.assert_allclose(found[1:, 2, 2].imag, exact[1:, 2, 2].imag, rtol=4e-3)
        mutant = np.array([closed.motion_stiffness(v, -one) for one in w])  # the sign of the motion's own frequency
        assert np.all(np.abs(found[1:, 2, 2].imag - mutant[1:, 2, 2].imag) > np.abs(exact[1:, 2, 2].imag))


def test_a_coil_across_the_track_is_damped_less_and_less(plate: EddyCurrentForce) -> None:
    across = replace(COIL, width=50.8e-3, length=25.4e-3)
    w = np.array([1.0])
    for height in (10e-3, 15.875e-3):
        for v in (10.0, 36.1):
            found = replace(plate, coils=(across,)).motion_stiffness(height, None, v, w)[0, 2, 2].imag
            exact = over_plate(across, height=height).motion_stiffness(v, w[0])[2, 2].imag
            along = over_plate(COIL, height=height).motion_stiffness(v, w[0])[2, 2].imag
            assert found == pytest.approx(exact, abs=0.005 * abs(along))


ROW = (
    replace(COIL, lateral=-18e-3, width=20e-3),
    replace(COIL, lateral=-18e-3, width=20e-3, forward=50.8e-3, current=-4000.0),
    replace(COIL, lateral=-18e-3, width=20e-3, forward=-50.8e-3, current=-4000.0),
    replace(COIL, lateral=18e-3, width=20e-3, height=2e-3, roll=0.2),
)


def test_a_row_of_coils_beside_a_tilted_one_acts_as_one_magnet(plate: EddyCurrentForce) -> None:
    magnet, height, v = replace(plate, coils=ROW), 14e-3, 36.1
    surge, sway, heave, roll = over_plate(*ROW, height=height).forces(v)
    found = np.array([*lift_guidance_drag(magnet, height, None, v), float(magnet.roll_torque(height, None, v))])
    np.testing.assert_allclose(found, (heave, sway, -surge, roll), rtol=0.0, atol=1e-3 * heave)
    assert found[3] == pytest.approx(roll, rel=5e-3)
    apart = sum(over_plate(coil, height=height).forces(v) for coil in ROW)
    assert abs(found[0] / apart[2] - 1.0) > 0.05  # coils that did not feel one another would be seen


def turned(coils: tuple[RectangularCoil, ...], angle: float) -> tuple[RectangularCoil, ...]:
    """The coils of a magnet after a roll about the first one's middle."""
    first, c, s = coils[0], np.cos(angle), np.sin(angle)
    return tuple(
        replace(
            coil, roll=coil.roll + angle,
            lateral=first.lateral + c * (coil.lateral - first.lateral) - s * (coil.height - first.height),
            height=first.height + s * (coil.lateral - first.lateral) + c * (coil.height - first.height),
        )
        for coil in coils
    )  # fmt: skip


def test_roll_torque_and_stiffness_are_slopes_of_the_energy_of_the_whole_magnet(plate: EddyCurrentForce) -> None:
    height, v, step = 14e-3, 20.0, 1e-4
    magnet = replace(plate, coils=ROW)
    up, down = (replace(plate, coils=turned(ROW, sign * step)) for sign in (1.0, -1.0))
    torque = (up.energy(height, None, v)[0] - down.energy(height, None, v)[0]) / (2.0 * step)
    assert float(magnet.roll_torque(height, None, v)) == pytest.approx(float(torque), rel=1e-6)
    static = magnet.motion_stiffness(height, None, v, 0.0)[0].real
    by_roll = (lift_guidance_drag(up, height, None, v) - lift_guidance_drag(down, height, None, v)) / (2.0 * step)
    np.testing.assert_allclose(static[[2, 1, 0], 3], by_roll * [1, 1, -1], rtol=1e-5, atol=1e-6 * abs(static[2, 2]))
    twice = (up.roll_torque(height, None, v) - down.roll_torque(height, None, v)) / (2.0 * step)
    assert static[3, 3] == pytest.approx(float(twice), rel=1e-5)
    alone = tuple(replace(coil, roll=coil.roll + step) for coil in ROW)  # each about its own middle
    wrong = (replace(plate, coils=alone).energy(height, None, v)[0] - magnet.energy(height, None, v)[0]) / step
    assert float(wrong) != pytest.approx(float(torque), rel=0.1)


# -- The default guideway --------------------------------------------------------------------------------------------

PUBLISHED = {
    (7e-3, 5e-3, 36.1): (9.382, 4.088, 4.972),
    AT: (4.142, 1.281, 1.844),
    (25e-3, 12.7e-3, 36.1): (1.082, 1.116, 0.732),
    (12.7e-3, 12.7e-3, 5.0): (0.4046, 0.0899, 1.151),
}


def test_the_published_forces(corner: EddyCurrentForce) -> None:
    for place, forces in PUBLISHED.items():
        digit = 10.0 ** -np.array([3 if f >= 0.5 else 4 for f in forces])
        found = lift_guidance_drag(corner, *place)
        assert np.all(np.abs(found - forces) <= 1e-3 * np.array(forces) + digit), (place, found)
        assert not np.all(np.abs(found[[1, 0, 2]] - forces) <= 1e-3 * np.array(forces) + digit)


def test_another_conductivity_would_not_give_the_published_forces(corner: EddyCurrentForce) -> None:
    # only the product of conductivity and speed matters to lift
    found = lift_guidance_drag(corner, *AT[:2], 1.1 * AT[2])
    assert abs(found[0] / PUBLISHED[AT][0] - 1.0) > 0.02


def test_the_published_stiffnesses_and_dampings(corner: EddyCurrentForce) -> None:
    slopes = corner.derivatives(*AT)
    k_ll, k_lg, k_gg = (float(x) for x in (slopes.by_height.lift, slopes.by_gap.lift, slopes.by_gap.guidance))
    assert k_ll == pytest.approx(-546.1, rel=3e-3) and k_gg == pytest.approx(-148.7, rel=3e-3)
    assert k_lg == pytest.approx(-2.84, abs=1e-4 * 546.1)
    _, damping, stiffness = corner.coefficients(*AT, [2.0])
    found = damping[0, [2, 1, 1, 0], [2, 1, 2, 0]]
    np.testing.assert_allclose(found, (-0.098, -0.153, 0.014, 0.019), rtol=0.04, atol=5e-4)
    assert np.max(np.abs(corner.coefficients(*AT, [200.0])[0][0, 1:3, 1:3])) < 1e-4  # kg
    np.testing.assert_allclose(stiffness[0, 1:3, 1:3], [[k_gg, k_lg], [k_lg, k_ll]], rtol=1e-9)


@pytest.mark.parametrize("speed", [5.0, 18.5, 36.1])
def test_lift_and_guidance_are_the_gradient_of_one_energy(corner: EddyCurrentForce, speed: float) -> None:
    h, g, step = 11e-3, 9e-3, 1e-6
    slopes = corner.derivatives(h, g, speed)
    apart = float(slopes.by_gap.lift) - float(slopes.by_height.guidance)
    assert abs(apart) <= 1e-10 * abs(float(slopes.by_height.lift))
    lift, guidance, _ = lift_guidance_drag(corner, h, g, speed)
    for value, dh, dg in ((lift, step, 0.0), (guidance, 0.0, step)):
        slope = (corner.energy(h + dh, g + dg, speed)[0] - corner.energy(h - dh, g - dg, speed)[0]) / (2.0 * step)
        assert value == pytest.approx(float(slope), rel=1e-6)


def test_partials_are_the_slopes_of_the_forces(corner: EddyCurrentForce) -> None:
    slopes = corner.derivatives(*AT)
    for by, move in ((slopes.by_height, (1e-6, 0, 0)), (slopes.by_gap, (0, 1e-6, 0)), (slopes.by_speed, (0, 0, 1e-3))):
        ahead, behind = (lift_guidance_drag(corner, *(np.add(AT, np.multiply(s, move)))) for s in (1.0, -1.0))
        found = np.array([float(by.lift), float(by.guidance), float(by.drag)])
        np.testing.assert_allclose(
            found, (ahead - behind) / (2.0 * sum(move)), rtol=1e-5, atol=1e-6 * np.abs(found).max()
        )


def test_slow_motion_is_quasi_static(corner: EddyCurrentForce) -> None:
    static = corner.motion_stiffness(*AT, 0.0)[0]
    slopes = corner.derivatives(*AT)
    assert np.all(static.imag == 0.0) and np.all(static[:, 0] == 0.0)
    for column, by in ((1, slopes.by_gap), (2, slopes.by_height)):
        steady = [-float(by.drag), float(by.guidance), float(by.lift)]
        np.testing.assert_allclose(static[:3, column].real, steady, rtol=1e-9)
    # a surge at a constant velocity u' changes the speed
    surge = corner.motion_stiffness(*AT, 1e-3)[0, :3, 0].imag / 1e-3
    by = slopes.by_speed
    np.testing.assert_allclose(surge, [-float(by.drag), float(by.guidance), float(by.lift)], rtol=1e-6)
    assert surge[0] > 0.0 > -float(corner.derivatives(*AT[:2], 10.0).by_speed.drag)  # either side of the drag peak


def test_the_answer_to_a_motion_is_real(corner: EddyCurrentForce) -> None:
    ahead, behind = corner.motion_stiffness(*AT, [-60.0, 60.0])
    np.testing.assert_allclose(ahead, np.conj(behind), rtol=1e-12)
    # surge couples with a sign: what it gives heave it takes with the other sign at the reversed passage
    Q = corner.motion_stiffness(*AT, 60.0)[0]
    np.testing.assert_allclose(Q[1:, 1:], Q[1:, 1:].T, rtol=1e-10)


def test_extrema_of_guidance(corner: EddyCurrentForce) -> None:
    heights = np.arange(6e-3, 14e-3, 0.1e-3)
    for gap, peak in ((5e-3, 7.3e-3), (12.7e-3, 11.9e-3)):
        guidance = corner.forces(heights, gap, 36.1).guidance
        assert heights[np.argmax(guidance)] == pytest.approx(peak, abs=0.15e-3)
    gaps = np.arange(20e-3, 26e-3, 0.1e-3)
    for height, trough in ((7e-3, 21.8e-3), (12.7e-3, 23.8e-3)):
        guidance = corner.forces(height, gaps, 36.1).guidance
        assert gaps[np.argmin(guidance)] == pytest.approx(trough, abs=0.15e-3)


def test_a_finer_solution_agrees(corner: EddyCurrentForce) -> None:
    near = {"height": (12.5e-3, 13e-3), "gap": (12.5e-3, 13e-3), "speed": (36.0, 36.2)}
    finer = EddyCurrentForce.solve(corner.section, (MAGNET,), **near)
    np.testing.assert_allclose(lift_guidance_drag(corner, *AT), lift_guidance_drag(finer, *AT), rtol=2e-3)
    assert len(finer.response.panels) - 1 == len(finer.response.wavenumbers) // 4  # four points a panel, not three


# -- Other sections --------------------------------------------------------------------------------------------------


def small(section: CrossSection, *, height: float = 10e-3, gap: float | None = None) -> np.ndarray:
    coil = replace(COIL, length=30e-3, width=20e-3)
    beside = None if gap is None else (gap, gap)
    model = EddyCurrentForce.solve(
        section, (coil,), height=(height, height), gap=beside, speed=(30.0, 30.0), accuracy="draft"
    )
    return lift_guidance_drag(model, height, gap, 30.0)


def test_a_slit_matters_and_a_far_conductor_does_not() -> None:
    joined = small(CrossSection.plates([(-0.05, 0.05, -8e-3, 0.0)], conductivity=2e7))
    split = small(CrossSection.plates([(-0.05, -1e-3, -8e-3, 0.0), (1e-3, 0.05, -8e-3, 0.0)], conductivity=2e7))
    touching = small(CrossSection.plates([(-0.05, 0.0, -8e-3, 0.0), (0.0, 0.05, -8e-3, 0.0)], conductivity=2e7))
    far = small(CrossSection.plates([(-0.05, 0.05, -8e-3, 0.0), (0.25, 0.29, -8e-3, 0.0)], conductivity=2e7))
    scale = np.abs(joined).max()
    assert split[0] < 0.95 * joined[0]
    np.testing.assert_allclose(touching, joined, rtol=0.0, atol=3e-3 * scale)
    np.testing.assert_allclose(far, joined, rtol=0.0, atol=3e-3 * scale)
    np.testing.assert_allclose((joined[1], split[1]), 0.0, atol=2e-3 * scale)


def test_a_channel_is_the_same_from_both_walls() -> None:
    section = CrossSection.channel(width=0.08, wall=0.04, thickness=8e-3, conductivity=2e7)
    left, right = (small(section, gap=y) for y in (0.025, 0.055))
    np.testing.assert_allclose(left * [1, -1, 1], right, rtol=3e-3)
    assert left[1] > 0.03 * left[0]  # the nearer wall repels


# -- Maps ------------------------------------------------------------------------------------------------------------


def test_a_map_is_as_good_as_it_says(corner: EddyCurrentForce) -> None:
    model = replace(corner, domain=Domain(height=(8e-3, 20e-3), gap=(6e-3, 20e-3), speed=(36.1, 36.1)))
    mapped = model.map()
    rng = np.random.default_rng(7)
    h, g = 8e-3 + 12e-3 * rng.random(60), 6e-3 + 14e-3 * rng.random(60)
    true, found = model.forces(h, g, 36.1), mapped.forces(h, g, 36.1)
    scale = np.maximum(np.abs(true.lift), np.abs(true.guidance))
    worst = max(float(np.max(np.abs(getattr(found, n) - getattr(true, n)) / scale)) for n in ("lift", "guidance"))
    assert worst <= 2.0 * mapped.quality.forces and mapped.quality.worst < 5e-3
    slopes, exact = mapped.derivatives(h, g, 36.1), model.derivatives(h, g, 36.1)
    np.testing.assert_allclose(slopes.by_gap.lift, slopes.by_height.guidance, rtol=1e-12)
    misses = np.abs(slopes.by_height.lift - exact.by_height.lift) / np.abs(exact.by_height.lift)
    assert float(misses.max()) <= 2.0 * mapped.quality.stiffness
    with pytest.raises(OutOfDomain):
        mapped.forces(7.9e-3, 10e-3, 36.1)
    with pytest.raises(OutOfDomain):
        model.forces(10e-3, 10e-3, 37.0)
    wrong = replace(mapped, log_energy=mapped.log_energy * 1.003).forces(h, g, 36.1)
    assert float(np.max(np.abs(wrong.lift - true.lift) / scale)) > 2.0 * mapped.quality.forces
