from __future__ import annotations

from math import pi

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mpmath import mp
from numpy.typing import NDArray
from scipy.integrate import quad

from maglev_ctrl.errors import ModelError, OutOfDomain
from maglev_ctrl.forces import (
    ImageForce,
    MagnetForces,
    characteristic_speed,
    drag_ratio,
    drag_ratio_slope,
    lift_ratio,
    lift_ratio_slope,
    receding_image_ratio,
)

SHEET = {"conductivity": 2.5e7, "thickness": 0.02}
W = characteristic_speed(**SHEET)
EXPONENTS = [1.0, 0.5, 1 / 3, 0.2, 0.07, 2.5]
exponents = st.floats(0.05, 3.0)
ratios = st.floats(0.0, 100.0)
heights = st.floats(0.005, 0.5)


def coil(exponent: float = 1.0, *, current: float = 1e5, vertical: bool = False) -> ImageForce:
    return ImageForce(
        current, 1.5, **SHEET, exponent=exponent, vertical_velocity="receding_image" if vertical else "none"
    )


def parts(forces: MagnetForces) -> NDArray[np.float64]:
    return np.array([forces.lift, forces.guidance, forces.drag])


# --- ratios ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("n", EXPONENTS)
@pytest.mark.parametrize("x", [1e-150, 1e-20, 1e-9, 1e-4, 0.3, 1.7, 40.0, 1e6])
def test_ratios_keep_relative_accuracy_from_rest_to_high_speed(n: float, x: float) -> None:
    with mp.workdps(400):
        speed, power = mp.mpf(x), mp.mpf(n)
        lift = 1 - (1 + speed**2) ** -power
        slope = 2 * power * speed * (1 + speed**2) ** (-power - 1)
        drag_slope = slope / speed - lift / speed**2
        exact = [float(one) for one in (lift, lift / speed, slope, drag_slope)]
    got = [float(f(x, n)) for f in (lift_ratio, drag_ratio, lift_ratio_slope, drag_ratio_slope)]
    # the drag slope is a difference of terms of size n (1 + x^2)^-(n+1): relative accuracy holds away from its zero
    np.testing.assert_allclose(got, exact, rtol=1e-13, atol=0.0)


def test_the_textbook_form_loses_small_speeds() -> None:
    """Mutant: without expm1 and log1p the lift ratio at x = 1e-9 has no digit left."""
    x, n = 1e-9, 0.2
    plain = 1.0 - (1.0 + x * x) ** -n
    assert plain == 0.0
    assert float(lift_ratio(x, n)) == pytest.approx(n * x * x, rel=1e-12)


@pytest.mark.parametrize("n", EXPONENTS)
def test_at_rest_the_limits_are_exact(n: float) -> None:
    assert [float(f(0.0, n)) for f in (lift_ratio, drag_ratio, lift_ratio_slope, drag_ratio_slope)] == [0, 0, 0, n]
    rest = coil(n).derivatives(0.1, None, 0.0)
    image = 4e-7 * pi * 1e10 * 1.5 / (4 * pi * 0.1)
    assert float(rest.by_speed.drag) == pytest.approx(n * image / W, rel=1e-14)
    assert float(rest.by_speed.lift) == float(rest.by_height.lift) == float(rest.by_height.drag) == 0.0


@settings(deadline=None)
@given(x=st.floats(-1e3, 1e3), n=exponents)
def test_lift_is_even_and_drag_odd_in_speed(x: float, n: float) -> None:
    assert float(lift_ratio(x, n)) == float(lift_ratio(-x, n))
    assert float(drag_ratio(x, n)) == -float(drag_ratio(-x, n))
    assert float(lift_ratio_slope(x, n)) == -float(lift_ratio_slope(-x, n))
    assert float(drag_ratio_slope(x, n)) == float(drag_ratio_slope(-x, n))


# --- partials --------------------------------------------------------------------------------------------------------


@settings(deadline=None)
@given(z=heights, x=st.floats(-100.0, 100.0), n=exponents)
def test_partials_are_the_central_differences(z: float, x: float, n: float) -> None:
    magnet, v = coil(n), x * W
    exact = magnet.derivatives(z, None, v)
    image = 4e-7 * pi * 1e10 * 1.5 / (4 * pi * z)
    dz, dv = 1e-5 * z, 1e-5 * W
    by_height = (parts(magnet.forces(z + dz, None, v)) - parts(magnet.forces(z - dz, None, v))) / (2 * dz)
    by_speed = (parts(magnet.forces(z, None, v + dv)) - parts(magnet.forces(z, None, v - dv))) / (2 * dv)
    # central differences of step 1e-5: truncation 1e-10, rounding 1e-16 / 1e-5, of the natural scale
    np.testing.assert_allclose(parts(exact.by_height), by_height, rtol=0, atol=1e-8 * image / z)
    np.testing.assert_allclose(parts(exact.by_speed), by_speed, rtol=0, atol=1e-8 * image / W)


def test_the_printed_drag_slope_mutant_is_caught() -> None:
    """The printed C_xx bracket, (w^2 - (2n-1) v^2)/(w^2 + v^2), is the slope of another drag law unless n = 1."""
    z, x = 0.1, 2.0
    for n, agrees in ((1.0, True), (1 / 3, False)):
        forces = coil(n).forces(z, None, x * W)
        printed = float(forces.drag) / (x * W) * (1 - (2 * n - 1) * x * x) / (1 + x * x)
        exact = float(coil(n).derivatives(z, None, x * W).by_speed.drag)
        assert (abs(printed - exact) < 1e-9 * abs(exact)) is agrees


# --- receding images -------------------------------------------------------------------------------------------------


def receding_image_force(v: float, u: float, *, w: float, z: float, recession: float) -> tuple[float, float]:
    """Lift and drag per F(z) on a line current, by adding up what is left of every past step of the source.

    At a time tau ago the source moved by (v, u) d tau: it left an opposite image at its new mirror place and one of
    its own sign at the old; both have since receded by w tau. Parallel currents attract as 1/r.
    `recession` is the vertical speed at which the distance to those images grows: w - u.
    """
    step = np.array([v, -u])

    def pull(tau: float) -> NDArray[np.float64]:
        d = np.array([v * tau, 2 * z + recession * tau])
        square = float(d @ d)
        return -(step / square - 2 * d * float(d @ step) / square**2)

    scale = 2 * z / max(abs(v), w)  # the unit of time in which the images leave
    sums = [
        quad(lambda t, i=i: scale * pull(scale * t)[i], 0.0, np.inf, epsabs=1e-12, epsrel=1e-11, limit=400)[0]
        for i in (0, 1)
    ]
    unit = 1 / (2 * z)  # the perfect image at distance 2z
    return sums[1] / unit, -sums[0] / unit


@pytest.mark.parametrize("x", [0.0, 0.3, 1.0, 2.5, -2.5, 12.0])
@pytest.mark.parametrize("u", [0.0, 0.2, -0.35])
def test_the_force_ratio_is_the_sum_of_the_receding_images(x: float, u: float) -> None:
    lift, drag = receding_image_force(x * W, u * W, w=W, z=0.1, recession=W - u * W)
    ratio = complex(receding_image_ratio(x * W, u * W, characteristic=W))
    np.testing.assert_allclose([ratio.real, -ratio.imag], [lift, drag], rtol=1e-8, atol=1e-9)


@pytest.mark.parametrize("x", [0.0, 0.3, 1.0, 2.5, -2.5, 12.0])
def test_the_vertical_velocity_partials_are_those_of_the_receding_images(x: float) -> None:
    z, du = 0.1, 1e-3 * W
    up = np.array(receding_image_force(x * W, du, w=W, z=z, recession=W - du))
    down = np.array(receding_image_force(x * W, -du, w=W, z=z, recession=W + du))
    numeric = (up - down) / (2 * du)
    magnet = coil(vertical=True)
    climbing = magnet.derivatives(z, None, x * W).by_vertical_velocity
    image = 4e-7 * pi * 1e10 * 1.5 / (4 * pi * z)
    exact = np.array([float(climbing.lift), float(climbing.drag)]) / image
    np.testing.assert_allclose(exact, numeric, rtol=0, atol=3e-6 / W)  # truncation (du/w)^2
    assert float(climbing.guidance) == 0.0


def test_flipped_receding_image_mutants_are_caught() -> None:
    """Neither a wrong sense of recession nor a flipped sign of a partial passes the quadrature."""
    x, z, du = 2.5, 0.1, 1e-3 * W
    up = np.array(receding_image_force(x * W, du, w=W, z=z, recession=W + du))
    down = np.array(receding_image_force(x * W, -du, w=W, z=z, recession=W - du))
    wrong_recession = (up - down) / (2 * du)
    climbing = coil(vertical=True).derivatives(z, None, x * W).by_vertical_velocity
    image = 4e-7 * pi * 1e10 * 1.5 / (4 * pi * z)
    exact = np.array([float(climbing.lift), float(climbing.drag)]) / image
    assert np.abs(exact - wrong_recession).min() > 1e-2 / W
    assert np.abs(exact).min() > 1e-2 / W  # so a flipped sign is off by far more than the tolerance above


def test_heave_damping_turns_negative_above_the_characteristic_speed() -> None:
    """Davis & Wilkie, J. Appl. Phys. 42 (1971): rising magnets gain lift above w, lose it below."""
    magnet = coil(vertical=True)
    slope = magnet.derivatives(0.1, None, np.array([0.5, 0.999, 1.001, 10.0]) * W).by_vertical_velocity.lift
    assert np.sign(slope).tolist() == [-1.0, -1.0, 1.0, 1.0]
    still = coil().derivatives(0.1, None, 10.0 * W).by_vertical_velocity
    assert float(still.lift) == float(still.drag) == 0.0


def test_a_source_that_outruns_its_images_has_no_steady_force() -> None:
    with pytest.raises(ModelError, match="not below the characteristic speed"):
        receding_image_ratio(10.0, 1.0, characteristic=1.0)


# --- the record ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("n", EXPONENTS)
def test_a_coil_for_a_lift_lifts_it(n: float) -> None:
    magnet = ImageForce.for_lift(196133.0, 0.1, 55.0, length=2.0, **SHEET, exponent=n)
    forces = magnet.forces(0.1, None, 55.0)
    assert float(forces.lift) == pytest.approx(196133.0, rel=1e-13)
    assert float(forces.drag) == pytest.approx(196133.0 * W / 55.0, rel=1e-13)  # drag/lift = w/v for every n
    assert isinstance(magnet.current, float)


def test_scaling_scales_every_force_and_partial_also_by_an_array() -> None:
    magnet, speed = coil(0.3), np.array([5.0, 50.0])
    factor = np.array([0.25, 4.0])
    np.testing.assert_allclose(
        parts(magnet.scaled(factor).forces(0.1, None, speed)),
        parts(magnet.forces(0.1, None, speed)) * factor,
        rtol=1e-14,
    )
    np.testing.assert_allclose(
        parts(magnet.scaled(factor).derivatives(0.1, None, speed).by_speed),
        parts(magnet.derivatives(0.1, None, speed).by_speed) * factor,
        rtol=1e-14,
    )


def test_arguments_broadcast_and_the_gap_does_not_matter() -> None:
    forces = coil().forces(np.array([0.1, 0.2])[:, None], np.full(3, 0.01), np.array([1.0, 2.0, 3.0]))
    assert forces.lift.shape == forces.guidance.shape == (2, 3)
    assert not forces.guidance.any()
    assert coil().forces(0.1, None, 1.0).lift.shape == ()
    assert coil().domain.gap is None


@pytest.mark.parametrize("height", [0.0, -0.1, np.nan])
def test_contact_is_out_of_the_domain(height: float) -> None:
    with pytest.raises(OutOfDomain, match="height"):
        coil().forces(height, None, 10.0)


def test_wrong_use_is_refused() -> None:
    with pytest.raises(ValueError, match="exponent: expected a positive number, got 0"):
        coil(0.0)
    with pytest.raises(ValueError, match=r"line current, exponent 1; got 0\.5"):
        coil(0.5, vertical=True)
    with pytest.raises(ValueError, match="vertical_velocity: expected 'none' or 'receding_image'"):
        ImageForce(1.0, 1.0, **SHEET, exponent=1.0, vertical_velocity="both")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="current: expected finite"):
        coil(current=np.nan)
    with pytest.raises(ValueError, match="thickness: expected a positive number, got -1"):
        characteristic_speed(1e7, -1.0)
    with pytest.raises(ModelError, match="no lift at rest"):
        ImageForce.for_lift(1e4, 0.1, 0.0, length=1.0, **SHEET, exponent=1.0)
    with pytest.raises(ValueError, match="lift: expected a positive number"):
        ImageForce.for_lift(0.0, 0.1, 10.0, length=1.0, **SHEET, exponent=1.0)
