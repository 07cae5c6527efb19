"""The fast map against the checked one, and what makes it wrong."""

import numpy as np
import pytest
from scipy import ndimage

from maglev_ctrl.analysis.floquet import floquet
from maglev_ctrl.analysis.plane_records import NO_ANSWER, STABLE, UNRESOLVED, UNSTABLE
from maglev_ctrl.guideway import passing_frequency
from maglev_ctrl.scenario import load
from maglev_ctrl.study.live import growth, speeds
from maglev_ctrl.study.live.designed import designed
from maglev_ctrl.study.live.fast_map import plane_of
from maglev_ctrl.study.live.growth import Columns, Sizes, growth_plane
from maglev_ctrl.study.live.speeds import OverSpeed
from maglev_ctrl.study.situation import Situation
from maglev_ctrl.systems import PeriodicSystem

TRAIN = "scenarios/compare/eds_135t.toml"


def over_speed(path, option, low=20.0, high=160.0):
    scenario = load(path)
    own = designed(scenario, option)
    return own, Situation.of_design(scenario), OverSpeed(own, Situation.of_design(scenario), low, high)


def source(own, over, *, frequency=1.0, sine=1.0):
    def at(v):
        here = over.at(v)
        turning = frequency * np.asarray(passing_frequency(v, own.modulation.wavelength))
        return Columns(here.mean, here.cosine, sine * here.sine, turning)

    return at


def wrong(fast, exact):
    """Pixels whose state is another, but for those within one pixel of an edge of the exact map."""
    unstable = exact == UNSTABLE
    square = np.ones((3, 3), dtype=bool)
    edge = ndimage.binary_dilation(unstable, square) & ndimage.binary_dilation(~unstable, square)
    return int(np.sum((fast != exact) & ~edge))


@pytest.mark.parametrize("path, option", [
    (TRAIN, "combined"), (TRAIN, "damper_windings"), (TRAIN, "active_secondary_skyhook"),
    ("scenarios/periodic/girder_passing.toml", "weak_windings"),
])  # fmt: skip
def test_the_states_are_those_of_the_checked_map(path, option):
    own, situation, over = over_speed(path, option)
    assert over.smooth
    v, e = np.linspace(20.0, 160.0, 70), np.linspace(0.0, 0.5, 50)
    fast = growth_plane(source(own, over), v, e)
    exact = plane_of(own, situation, v, e, checks=0)
    assert wrong(fast.state, exact.state) == 0
    rows = np.arange(0, 50, growth.STRIDE)
    assert np.allclose(fast.growth[:, rows], exact.growth[:, rows], atol=2e-3)
    assert fast.evaluated < 0.75 * fast.state.size


@pytest.mark.parametrize("change", [{"frequency": 1.05}, {"frequency": 0.5}])
def test_a_wrong_frequency_is_seen(change):
    own, situation, over = over_speed(TRAIN, "active_secondary_skyhook")
    v, e = np.linspace(20.0, 160.0, 70), np.linspace(0.0, 0.5, 50)
    exact = plane_of(own, situation, v, e, checks=0)
    assert wrong(growth_plane(source(own, over, **change), v, e).state, exact.state) > 0


def lopsided(v):
    """Two coupled masses whose springs are modulated out of phase: sine and cosine are not alike."""
    A = np.zeros((4, 4))
    A[:2, 2:] = np.eye(2)
    A[2:, :2] = [[-1.0, 0.3], [0.1, -2.1]]
    A[2:, 2:] = [[-0.02, 0.05], [-0.01, -0.03]]
    cosine, sine = np.zeros((1, 4, 4)), np.zeros((1, 4, 4))
    cosine[0, 2, :2], sine[0, 3, :2] = [0.7, -0.4], [0.5, 0.9]
    one = np.ones(len(v))[:, None, None]
    return Columns(one * A, one[..., None] * cosine, one[..., None] * sine, np.asarray(v, dtype=float))


def test_edges_between_rows_are_found_and_their_loss_is_seen(monkeypatch):
    v, e = np.linspace(0.7, 3.0, 60), np.linspace(0.0, 0.8, 60)
    fast = growth_plane(lopsided, v, e)
    with monkeypatch.context() as patched:
        patched.setattr(growth, "STRIDE", 1)
        every = growth_plane(lopsided, v, e)
    assert every.evaluated == every.state.size > fast.evaluated
    assert wrong(fast.state, every.state) == 0
    monkeypatch.setattr(growth._Pixels, "_open", lambda self, a, b: np.zeros(len(self.growth), dtype=bool))
    assert wrong(growth_plane(lopsided, v, e).state, every.state) > 0


@pytest.mark.parametrize("smooth", [True, False])
def test_growth_is_that_of_both_floquet_engines(smooth):
    v, e = np.linspace(0.7, 3.0, 25), np.linspace(0.0, 0.8, 9)
    found = growth_plane(lopsided, v, e, smooth=smooth)
    here = lopsided(v)
    for i, j in ((0, 8), (7, 4), (12, 8), (24, 8), (3, 0)):
        system = PeriodicSystem.from_matrices(
            here.mean[i], e[j] * here.cosine[i], e[j] * here.sine[i], frequency=v[i]
        )  # fmt: skip
        assert found.growth[i, j] == pytest.approx(floquet(system).growth_rate, abs=1e-4)


def test_a_flipped_sine_is_seen():
    v, e = np.linspace(0.7, 3.0, 25), np.linspace(0.0, 0.8, 9)

    def flipped(at):
        here = lopsided(at)
        return Columns(here.mean, here.cosine, -here.sine, here.frequency)

    assert np.max(np.abs(growth_plane(flipped, v, e).growth - growth_plane(lopsided, v, e).growth)) > 1e-2


def test_speeds_without_a_system_have_no_answer_and_spoil_no_other():
    v, e = np.linspace(0.7, 3.0, 25), np.linspace(0.0, 0.8, 9)

    def holed(at):
        here = lopsided(at)
        mean = np.where((at > 2.0)[:, None, None], np.nan, here.mean)
        return Columns(mean, here.cosine, here.sine, here.frequency)

    whole, found = growth_plane(lopsided, v, e), growth_plane(holed, v, e)
    assert np.all(found.state[v > 2.0] == NO_ANSWER)
    assert wrong(found.state[v <= 2.0], whole.state[v <= 2.0]) == 0


def test_sizes_that_were_enough_are_used_again_and_still_checked():
    v, e = np.linspace(0.7, 3.0, 25), np.linspace(0.0, 0.8, 9)
    sizes = Sizes()
    first = growth_plane(lopsided, v, e, sizes=sizes)
    assert sizes.known
    sizes.known[next(iter(sizes.known))] = (4, 7)  # far too few: the tails say so
    second = growth_plane(lopsided, v, e, sizes=sizes)
    assert np.allclose(first.growth, second.growth, atol=1e-5)


@pytest.mark.parametrize("path, option", [
    (TRAIN, "combined"), (TRAIN, "active_primary_lqg"), ("scenarios/design/ems_hover.toml", "lqg"),
    ("scenarios/paper/six_dof.toml", "all_dampers"), ("scenarios/compare/payload_and_speed.toml", "fixed"),
])  # fmt: skip
def test_the_loop_at_any_speed_is_the_assembled_one(path, option):
    scenario = load(path)
    v = scenario.operating.speed * np.linspace(0.9, 1.1, 7)
    _, _, over = over_speed(path, option, float(v[0]), float(v[-1]))
    found = over.at(v)
    for k in np.flatnonzero(found.answered):
        exact = over._source.exact(float(v[k]))
        size = np.max(np.abs(exact)) if exact.size else 1.0
        n = found.full.shape[-1]
        assert np.allclose(found.full[k].ravel(), exact[: n * n], rtol=1e-4, atol=1e-9 * size)
    assert np.any(found.answered)


def test_too_few_nodes_are_not_accepted_and_would_be_wrong(monkeypatch):
    monkeypatch.setattr(speeds, "COUNTS", (3,))
    _, _, over = over_speed(TRAIN, "bare")
    assert not over.smooth
    monkeypatch.setattr(speeds, "TOLERANCE", 1e3)
    _, _, blind = over_speed(TRAIN, "bare")
    assert blind.smooth
    v = np.array([35.0])
    exact, guessed = over.at(v).full, blind.at(v).full
    known = exact != 0.0
    assert np.max(np.abs(guessed[known] / exact[known] - 1.0)) > 1e-4


def test_a_series_that_its_nodes_flatter_is_caught_by_a_speed_that_is_no_node(monkeypatch):
    kept = speeds._Source.exact
    monkeypatch.setattr(speeds._Source, "exact", lambda self, v: kept(self, v) * (1.0 + 1e-3))
    _, _, over = over_speed(TRAIN, "bare")
    assert not over.smooth


def test_beside_fierce_growth_nothing_is_decided_that_cannot_be_seen():
    """One speed grows by e^30 in a period: what decays elsewhere is below the noise of the common series."""

    def source(v):
        growth = 30.0 * v / (2.0 * np.pi) * np.exp(-(((v - 2.0) / 0.35) ** 2)) - 0.02
        A = np.array([[[g, 1.0], [-1.0, g]] for g in growth])
        none = np.zeros((len(v), 1, 2, 2))
        return Columns(A, none, none, v)

    speed, depth = np.linspace(1.0, 3.0, 60), np.linspace(0.0, 0.2, 9)
    found = growth_plane(source, speed, depth)
    exact = source(speed).mean[:, 0, 0]
    for k, value in enumerate(exact):
        assert set(found.state[k]) <= ({UNSTABLE, UNRESOLVED} if value > 0.0 else {STABLE, UNRESOLVED}), speed[k]
    fierce = exact > 0.9 * np.max(exact)
    assert np.all(found.state[fierce] == UNSTABLE)
    np.testing.assert_allclose(found.growth[fierce], exact[fierce][:, None] * np.ones(len(depth)), rtol=1e-4)
