"""Profiles of the place: interpolation and slopes, girders, joints, steps, and tracks made of them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad

from maglev_ctrl.errors import OutOfDomain
from maglev_ctrl.guideway.features import GirderSag, SlantedJoints, Steps
from maglev_ctrl.guideway.profile import Profile, ProfileLike, TrackProfile, surveyed
from maglev_ctrl.guideway.realisation import realisation
from maglev_ctrl.guideway.spectra import inverse_square
from maglev_ctrl.vehicle.guideway_sources import DisplacedGuideway, girder_bow, stepped_joints

PERIOD, COUNT = 60.0, 120


def _wave(x: np.ndarray, order: int, phase: float) -> np.ndarray:
    return np.cos(2.0 * np.pi * order * x / PERIOD + phase)


def _sampled(order: int, phase: float, *, count: int = COUNT, **options: object) -> Profile:
    x = np.linspace(0.0, PERIOD, count + 1)
    return Profile(x, _wave(x, order, phase), periodic=True, **options)  # type: ignore[arg-type]


# Interpolation


@pytest.mark.parametrize("count", [120, 121])
@pytest.mark.parametrize("order", [1, 17, 40, 59])
def test_a_band_limited_profile_is_the_wave_between_its_samples(order: int, count: int) -> None:
    profile = _sampled(order, 0.3, count=count, interpolation="band_limited")
    x = np.random.default_rng(0).uniform(-PERIOD, 2.0 * PERIOD, 500)
    wavenumber = 2.0 * np.pi * order / PERIOD
    # Fifth-order Hermite pieces of length h: (W h)^6 / 46080 of the amplitude, (W h)^5 / (1920 sqrt 5) of the slope.
    travel = wavenumber * PERIOD / count / 4.0
    assert np.max(np.abs(profile.at(x) - _wave(x, order, 0.3))) < travel**6 / 46080.0 * 1.01 + 1e-12
    slope = wavenumber * _wave(x, order, 0.3 + np.pi / 2.0)
    assert np.max(np.abs(profile.slope(x) - slope)) < wavenumber * (travel**5 / 4000.0 + 1e-11)


def test_a_cubic_profile_would_not_be() -> None:
    profile = _sampled(40, 0.3)
    x = np.random.default_rng(0).uniform(0.0, PERIOD, 500)
    assert np.max(np.abs(profile.at(x) - _wave(x, 40, 0.3))) > 0.01


def test_the_shortest_wave_of_even_samples_stays_real() -> None:
    """A wave of two steps: its samples alternate, and between them nothing tells its phase but the even choice."""
    x = np.arange(9) * 1.0
    profile = Profile(x, np.cos(np.pi * x), periodic=True, interpolation="band_limited")
    assert np.max(np.abs(profile.at(x) - np.cos(np.pi * x))) < 1e-14
    assert abs(float(profile.at(0.5))) < 1e-14


def test_a_cubic_profile_passes_its_samples_and_holds_a_cubic() -> None:
    x = np.array([0.0, 0.7, 1.5, 3.0, 3.2, 5.0])
    cubic = np.poly1d([0.3, -1.0, 0.5, 2.0])
    profile = Profile(x, cubic(x))
    inner = np.linspace(0.0, 5.0, 41)
    assert np.allclose(profile.at(inner), cubic(inner), rtol=0.0, atol=1e-12)
    assert np.allclose(profile.slope(inner), cubic.deriv()(inner), rtol=0.0, atol=1e-11)


def test_a_profile_is_not_extrapolated_but_a_periodic_one_repeats() -> None:
    profile = surveyed([0.0, 1.0, 2.0, 3.0], [0.0, 1.0, 0.0, 1.0], name="survey of 1998")
    with pytest.raises(OutOfDomain, match="survey of 1998"):
        profile.at([1.0, 3.1])
    with pytest.raises(OutOfDomain):
        profile.slope(-0.1)
    ring = _sampled(3, 0.1)
    assert np.allclose(ring.at([1.0, 1.0 + PERIOD, 1.0 - 2 * PERIOD]), ring.at(1.0), rtol=1e-12)


@pytest.mark.parametrize(
    ("positions", "heights", "options", "message"),
    [
        ([0.0, 1.0, 2.0], [0.0, 1.0, 2.0], {}, "at least 4"),
        ([0.0, 1.0, 1.0, 2.0], [0.0, 1.0, 2.0, 3.0], {}, "ascend"),
        ([0.0, 1.0, 2.0, 3.0], [0.0, 1.0, 2.0, 3.0], {"periodic": True}, "last to be the first"),
        ([0.0, 1.0, 2.0, 3.0], [0.0, 1.0, 2.0, 0.0], {"interpolation": "band_limited"}, "periodic profile"),
        ([0.0, 1.0, 2.5, 3.0], [0.0, 1.0, 2.0, 0.0], {"interpolation": "band_limited", "periodic": True}, "even"),
        ([0.0, 1.0, 2.0, 3.0], [0.0, 1.0, float("nan"), 0.0], {}, "finite"),
    ],
)
def test_samples_that_make_no_profile_are_refused(
    positions: list[float], heights: list[float], options: dict[str, object], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        Profile(positions, heights, **options)  # type: ignore[arg-type]


def test_a_levelled_survey_has_neither_mean_nor_trend() -> None:
    x = np.linspace(0.0, 100.0, 201)
    bumps = 1e-3 * np.sin(2.0 * np.pi * x / 20.0)
    plain, level = surveyed(x, bumps + 0.5 + 0.01 * x), surveyed(x, bumps + 0.5 + 0.01 * x, levelled=True)
    assert abs(np.mean(level.heights)) < 1e-15 and abs(np.polyfit(x, level.heights, 1)[0]) < 1e-15
    assert np.mean(plain.heights) > 0.5


# Features


FEATURES: list[ProfileLike] = [
    GirderSag(25.0, rise=-0.004, offset=3.0),
    SlantedJoints(10.0, step=0.002, ramp=0.4, offset=1.0),
    Steps([5.0, 20.0, 20.2], heights=[0.003, -0.001, -0.002], ramp=0.5),
    surveyed(np.linspace(-5.0, 65.0, 141), 1e-3 * np.sin(np.linspace(-5.0, 65.0, 141))),
    realisation(inverse_square(), length=50.0, step=0.25, seed=3),
]


@pytest.mark.parametrize("feature", FEATURES, ids=lambda one: type(one).__name__)
def test_the_slope_integrates_to_the_height(feature: ProfileLike) -> None:
    # Between the knots of the splines, the supports and the ends of the ramps every slope is smooth: Gauss is exact.
    edges = np.union1d(np.linspace(0.0, 60.0, 961), [0.8, 1.2, 10.8, 11.2, 20.7, 20.2, 20.5, 20.8, 21.2])
    edges = np.union1d(edges, np.concatenate([np.arange(10.8, 60.0, 10.0), np.arange(11.2, 60.0, 10.0)]))
    node, weight = np.polynomial.legendre.leggauss(8)
    half, middle = 0.5 * np.diff(edges), 0.5 * (edges[1:] + edges[:-1])
    rise = half * (feature.slope(middle[:, None] + half[:, None] * node) @ weight)
    gained = np.diff(feature.at(edges))
    assert np.max(np.abs(rise - gained)) < 1e-15
    assert np.max(np.abs(-rise - gained)) > 1e-6


@pytest.mark.parametrize("source", [girder_bow("girder", span=25.0, rise=-0.004, offset=3.0)])
def test_girders_are_those_of_the_periodic_sources(source: DisplacedGuideway) -> None:
    s = np.linspace(0.0, 24.9, 50)
    sag = GirderSag(25.0, rise=-0.004, offset=3.0)
    assert np.allclose(sag.at(s + 3.0), source.displaced(s)[0], rtol=0.0, atol=1e-15)
    assert not np.allclose(GirderSag(25.0, rise=0.004, offset=3.0).at(s + 3.0), source.displaced(s)[0], atol=1e-4)
    assert quad(lambda x: float(sag.at(x)), 3.0, 28.0)[0] == pytest.approx(0.0, abs=1e-14)


def test_joints_are_those_of_the_periodic_sources_outside_their_ramps() -> None:
    joints, source = SlantedJoints(10.0, step=0.002, ramp=0.4), stepped_joints("joint", spacing=10.0, step=0.002)
    s = np.linspace(0.2, 9.8, 97)
    for period in (-1.0, 0.0, 3.0):
        assert np.allclose(joints.at(s + 10.0 * period), source.displaced(s)[0], rtol=0.0, atol=1e-15)
    # Half a ramp before the joint the next segment is not met yet.
    assert float(joints.at(-0.2)) == pytest.approx(-0.00096, abs=1e-15)
    assert float(joints.at(0.2) - joints.at(-0.2)) == pytest.approx(0.002 * (1.0 - 0.4 / 10.0), abs=1e-15)


def test_the_steepest_place_of_a_step_is_amid_its_ramp() -> None:
    step = Steps([10.0], heights=[0.002], ramp=0.5)
    x = np.linspace(9.0, 12.0, 3001)
    assert x[np.argmax(step.slope(x))] == pytest.approx(10.25, abs=1e-9)
    assert np.max(step.slope(x)) == pytest.approx(0.5 * np.pi * 0.002 / 0.5, rel=1e-9)
    assert step.at([9.99, 10.25, 10.51, 500.0]).tolist() == pytest.approx([0.0, 0.001, 0.002, 0.002])


@pytest.mark.parametrize(
    "make",
    [
        lambda: GirderSag(0.0, rise=1.0),
        lambda: GirderSag(1.0, rise=float("nan")),
        lambda: SlantedJoints(10.0, step=0.1, ramp=0.0),
        lambda: SlantedJoints(10.0, step=0.1, ramp=11.0),
        lambda: Steps([0.0, 1.0], heights=[1.0], ramp=1.0),
        lambda: Steps([0.0], heights=[1.0], ramp=0.0),
    ],
)
def test_features_without_a_length_are_refused(make: object) -> None:
    with pytest.raises(ValueError, match="expected"):
        make()  # type: ignore[operator]


# Tracks


def test_a_track_is_the_sum_of_its_profiles_and_tilts_with_its_cross_level() -> None:
    sag, joints, step = FEATURES[0], FEATURES[1], FEATURES[2]
    track = TrackProfile(vertical=(sag, joints), lateral=(step,), cross_level=(joints,))
    x, y = np.array([4.0, 11.0, 26.0])[:, None], np.array([1.2, -1.2])
    vertical, lateral = track.under(x, y)
    assert vertical.shape == lateral.shape == (3, 2)
    assert np.allclose(vertical, sag.at(x) + joints.at(x) + y * joints.at(x), rtol=0.0, atol=1e-18)
    assert np.allclose(lateral, step.at(x) + 0.0 * y, rtol=0.0, atol=1e-18)
    # The left side (y > 0) rises with the cross level; the other sign is another track.
    middle = track.under(x[:, 0])[0]
    assert np.allclose(vertical[:, 0] - middle, 1.2 * joints.at(x[:, 0]), rtol=1e-9, atol=1e-17)
    assert not np.allclose(vertical[:, 1] - middle, 1.2 * joints.at(x[:, 0]), rtol=0.0, atol=1e-5)


def test_the_slopes_of_a_track_are_its_derivatives() -> None:
    track = TrackProfile(
        vertical=(FEATURES[0], FEATURES[4]),
        lateral=(FEATURES[4],),
        cross_level=(SlantedJoints(10.0, step=1e-3, ramp=2.0),),
    )
    x, y, h = np.array([4.1, 13.3, 30.7]), 1.2, 1e-5
    ahead, behind = track.under(x + h, y), track.under(x - h, y)
    for part in range(2):
        difference = (ahead[part] - behind[part]) / (2.0 * h)
        assert np.allclose(track.slopes(x, y)[part], difference, rtol=1e-6, atol=1e-10)
    assert not np.allclose(track.slopes(x, -y)[0], (ahead[0] - behind[0]) / (2.0 * h), rtol=1e-3)


def test_a_flat_track_is_flat() -> None:
    flat = TrackProfile()
    assert [one.tolist() for one in flat.under([1.0, 2.0], 1.0)] == [[0.0, 0.0], [0.0, 0.0]]
    assert [one.tolist() for one in flat.slopes(0.0)] == [0.0, 0.0]
