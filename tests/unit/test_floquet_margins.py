"""Floquet margins: exact Mathieu and Meissner edges, Hsu's widths, narrow tongues, honest bounds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import mathieu_a, mathieu_b

import maglev_ctrl.analysis.first_instability as search_module
import maglev_ctrl.analysis.floquet_margins as margins_module
from maglev_ctrl.analysis.critical_depth import critical_depth
from maglev_ctrl.analysis.floquet import Floquet, floquet
from maglev_ctrl.analysis.floquet_margins import (
    depth_margin,
    first_instability,
    floquet_margins,
    gain_margins,
    scaled_controller,
    speed_margins,
)
from maglev_ctrl.analysis.tongue_search import Crossing, Track, find_crossings, locate
from maglev_ctrl.errors import Agreement, ModelError, NotStable
from maglev_ctrl.systems import Controller, PeriodicSystem, SecondOrderSystem, close_loop, modulate

SUM = np.array([[0.5, 0.4], [0.3, 0.6]])


def mathieu(eps: float, damping: float, frequency: float) -> PeriodicSystem:
    return PeriodicSystem.from_matrices([[0, 1], [-1, -damping]], [[[0, 0], [-eps, 0]]], frequency=frequency)


def two_modes(frequency: float, eps: float, K_1: np.ndarray, damping: tuple[float, float]) -> PeriodicSystem:
    system = SecondOrderSystem.from_matrices(np.eye(2), np.diag(damping), np.diag([1.0, 2.89]))
    return modulate(system, [eps * K_1], frequency=frequency)


# ---- closed forms ----------------------------------------------------------------------------------------------------


def test_depth_of_the_damped_mathieu_equation() -> None:
    """Published threshold 0.04000087498952537 at zeta = 0.01 and W = 2 w."""
    found = depth_margin(lambda e: mathieu(e, 0.02, 2.0), largest=0.2)
    assert (found.bound, found.agreement, found.tongue.name) == ("exact", Agreement.AGREED, "2 w1/1")
    assert found.safe < 0.04000087498952537 < found.unsafe
    assert found.unsafe - found.safe < 2e-5 * found.safe
    assert floquet(mathieu(found.safe, 0.02, 2.0)).stable is True
    assert floquet(mathieu(found.unsafe, 0.02, 2.0)).stable is False


@pytest.mark.parametrize(("start", "end", "edge"), [(1.7, 2.4, 1.9496984382629277), (2.4, 1.7, 2.0496787731544197)])
def test_speed_margin_ends_at_the_exact_mathieu_edge(start: float, end: float, edge: float) -> None:
    found = first_instability(lambda W: mathieu(0.1, 1e-6, W), nominal=start, limit=end)
    assert found.value == pytest.approx(edge, rel=1e-6)
    assert found.bound == "exact"


def test_second_tongue_ends_at_mathieus_second_edges() -> None:
    """a = 4/W^2, q = 2 eps/W^2: the edges at fixed W in the square of the natural frequency, W = 2: a, q = eps/2."""

    def path(a: float) -> PeriodicSystem:
        return PeriodicSystem.from_matrices([[0, 1], [-a, -1e-7]], [[[0, 0], [-1.2, 0]]], frequency=2.0)

    up = first_instability(path, nominal=3.0, limit=5.0, samples=12)
    down = first_instability(path, nominal=5.0, limit=3.0, samples=12)
    assert up.value == pytest.approx(float(mathieu_b(2, 0.6)), rel=1e-6)
    assert down.value == pytest.approx(float(mathieu_a(2, 0.6)), rel=1e-6)
    assert up.tongue.name == down.tongue.name == "2 w1/2"


@pytest.mark.parametrize(
    ("eps", "lower", "upper"),
    [(0.05, 0.21764211572094974, 0.2812782431034174), (0.2, 0.11482074932538619, 0.3678177280508952)],
)
def test_meissner_edges(eps: float, lower: float, upper: float) -> None:
    """Square wave by its first eight odd harmonics: what is left out moves the edges by less than 1e-4 eps^2."""
    orders = np.arange(1, 16)
    wave = np.where(orders % 2, 4.0 / (np.pi * orders) * np.sin(0.5 * np.pi * orders), 0.0)
    A_cos = np.zeros((15, 2, 2))
    A_cos[:, 1, 0] = -eps * wave

    def path(delta: float) -> PeriodicSystem:
        return PeriodicSystem.from_matrices([[0, 1], [-delta, -1e-7]], A_cos, frequency=1.0)

    below = first_instability(path, nominal=0.08, limit=0.25, samples=5, max_order=1)
    above = first_instability(path, nominal=0.5, limit=0.25, samples=5, max_order=1)
    assert below.value == pytest.approx(lower, abs=1e-4 * eps**2 + 2e-7)
    assert above.value == pytest.approx(upper, abs=1e-4 * eps**2 + 2e-7)
    first_order = abs(0.25 - 2.0 * eps / np.pi - lower)
    assert abs(below.value - lower) < 0.01 * first_order  # the mutant that stops at first order is seen


def test_sum_tongue_has_hsus_width() -> None:
    """Coefficients a = b: half-width sqrt(eps^2 d12 d21/(4 w1 w2) - c^2), second-order corrections eps^2."""
    eps, c = 0.02, 2e-3
    half = np.sqrt(eps**2 * 0.12 / (4 * 1.7) - c**2)
    path = lambda W: two_modes(W, eps, SUM, (c, c))  # noqa: E731
    low = first_instability(path, nominal=2.55, limit=2.85, samples=7)
    high = first_instability(path, nominal=2.85, limit=2.55, samples=7)
    assert 0.5 * (high.value - low.value) == pytest.approx(half, rel=3 * eps)
    assert low.tongue.name.startswith("(w1 + w2)/1")
    mutant = np.sqrt(eps**2 * 0.12 / (4 * 1.7))  # without damping
    assert abs(0.5 * (high.value - low.value) - mutant) > 0.1 * half


# ---- gain ------------------------------------------------------------------------------------------------------------


def sky_hook(frequency: float, depth: float, law: Controller) -> PeriodicSystem:
    plant = SecondOrderSystem.from_matrices(
        [[1.0]], [[0.0]], [[1.0]], dofs=("heave",), inputs=("force",), B=[[1.0]]
    )  # fmt: skip
    return modulate(close_loop(plant, law), [[[depth]]], frequency=frequency)


def test_gain_margin_meets_the_critical_depth() -> None:
    law = Controller.static([[-0.05]], measured=("heave.velocity",), commands=("force",))
    path = lambda k: sky_hook(2.0, 0.06, scaled_controller(law, k))  # noqa: E731
    down, up = gain_margins(path, samples=16)
    # threshold eps = 2 c of the principal tongue, c = 0.05 k, corrections of second order in c
    assert down.value == pytest.approx(0.06 / 0.1, rel=2e-3)
    assert down.safe > down.unsafe
    edge = critical_depth(sky_hook(2.0, 1.0, scaled_controller(law, down.value)), depth_max=0.2)
    assert edge.depth == pytest.approx(0.06, rel=1e-5)
    assert up.bound == "lower" and up.safe == pytest.approx(10.0)
    assert np.isnan(up.unsafe) and "stable as far as 10" in up.text


def test_gain_that_destabilises_without_modulation_is_told_as_such() -> None:
    law = Controller.from_matrices(
        [[-4.0]], [[4.0]], [[-0.6]], [[0.0]], measured=("heave",), commands=("force",), name="lagging"
    )

    def path(factor: float) -> PeriodicSystem:
        plant = SecondOrderSystem.from_matrices(
            [[1.0]], [[0.2]], [[1.0]], dofs=("heave",), inputs=("force",), B=[[1.0]]
        )
        return modulate(close_loop(plant, scaled_controller(law, factor)), [[[1e-4]]], frequency=7.0)

    _, up = gain_margins(path, samples=16)
    s = np.linalg.eigvals(path(up.unsafe).A_0)
    assert up.unmodulated and up.bound == "exact" and "without modulation" in up.text
    # the mean loop by itself: its abscissa changes sign here, to second order in the depth
    assert abs(np.max(s.real)) < 1e-6


# ---- narrow tongues --------------------------------------------------------------------------------------------------

NARROW = np.array([[0.02, 0.01], [0.01, 0.02]])


def narrow(W: float) -> PeriodicSystem:
    return two_modes(W, 0.5, NARROW, (2e-4, 2e-4))


def test_a_tongue_a_hundred_times_narrower_than_the_step_is_found() -> None:
    found = first_instability(narrow, nominal=2.3, limit=3.1, samples=8)
    half = np.sqrt((0.5 * 0.01) ** 2 / (4 * 1.7) - 4e-8)
    assert found.tongue.name.startswith("(w1 + w2)/1")
    assert found.value == pytest.approx(2.7 - half, abs=5e-5)
    assert found.missed_width > 20 * half  # the scan alone says that it could have missed it
    assert any(t.name.startswith("(w1 + w2)/1") and t.onset < 1.0 for t in found.sought)


def test_without_predicted_crossings_the_tongue_is_missed(monkeypatch: pytest.MonkeyPatch) -> None:
    """The mutant that only scans: it finds nothing, so the test above tests the seeds."""
    monkeypatch.setattr(search_module, "find_crossings", lambda *_, **__: [])
    found = first_instability(narrow, nominal=2.3, limit=3.1, samples=8)
    assert found.bound == "lower"


def test_curve_that_only_touches_the_line_is_sought() -> None:
    """2 w(p) comes down to W at p = 0.47 and turns back: no change of sign, a narrow tongue all the same."""

    def path(p: float) -> PeriodicSystem:
        w = 1.0 + 0.3 * (p - 0.47) ** 2
        return PeriodicSystem.from_matrices([[0, 1], [-(w**2), -1e-5]], [[[0, 0], [-1e-4, 0]]], frequency=2.0)

    found = first_instability(path, nominal=0.0, limit=1.0, samples=9)
    # unstable where 2 |w - 1| < eps/2, first order: |p - 0.47| < sqrt(1e-4/(4 * 0.3)) (with the damping: 0.98 of it)
    assert found.value == pytest.approx(0.47 - np.sqrt(0.25e-4 * np.sqrt(1 - 0.04) / 0.3), abs=2e-5)


def test_tongue_that_the_depth_itself_shifts_into_place(monkeypatch: pytest.MonkeyPatch) -> None:
    """Strong coupling moves w2 with the square of the depth through W/2; the tongue there is a thin window in depth."""
    K_1, damping = np.array([[0.0, 1.0], [1.0, 0.004]]), (1e-4, 1e-4)
    path = lambda e: two_modes(3.41, e, K_1, damping)  # noqa: E731
    depths = np.linspace(0.3, 0.4, 201)
    growth = np.array([Track(path).point(float(e)).growth for e in depths])
    brute = depths[growth > 0.0]
    found = depth_margin(path, largest=0.6, samples=9)
    assert found.tongue.name.startswith("2 w2/1")
    assert brute[0] - 0.0005 < found.safe < found.unsafe <= brute[0]
    assert brute[-1] - brute[0] < 0.2 * 0.6 / 8  # the window against the step
    monkeypatch.setattr(margins_module, "_shifted_onto", lambda *_: ())
    assert depth_margin(path, largest=0.6, samples=9).bound == "lower"  # the mutant misses it


def test_located_width_is_hsus_however_narrow() -> None:
    for eps in (1e-2, 1e-4, 1e-6):
        track = Track(lambda W, e=eps: mathieu(e, 0.1 * e, W))
        found = locate(track, Crossing("parametric", (0, 0), 1, 2.002), lower=1.5, upper=2.5)
        assert found is not None
        assert found.width == pytest.approx(eps, rel=1e-3 + eps)
        assert found.growth == pytest.approx(eps / 4 - 0.05 * eps, rel=1e-3 + eps)
        assert len(track.points) < 40


def test_third_tongue_has_mathieus_width() -> None:
    """W = 2, q = eps/2: width a3 - b3 in the square of the frequency; no perturbation theory of second order has it."""
    q = 0.3

    def path(a: float) -> PeriodicSystem:
        return PeriodicSystem.from_matrices([[0, 1], [-a, -1e-8]], [[[0, 0], [-2 * q, 0]]], frequency=2.0)

    found = locate(Track(path), Crossing("parametric", (0, 0), 3, 9.0), lower=8.5, upper=9.5)
    low, high = float(mathieu_b(3, q)), float(mathieu_a(3, q))
    assert found is not None
    assert found.at == pytest.approx(0.5 * (low + high), abs=0.1 * (high - low))
    assert found.width == pytest.approx(high - low, rel=0.01)


def test_crossings_are_those_of_the_frequencies() -> None:
    track = Track(lambda W: two_modes(W, 1e-3, SUM, (1e-3, 1e-3)))
    found = find_crossings(track, np.linspace(0.3, 3.6, 40), max_order=2)
    places = sorted(c.at for c in found)
    wanted = sorted([*(x / k for k in (1, 2) for x in (2.0, 3.4, 2.7, 0.7))])
    np.testing.assert_allclose(places, wanted, atol=1e-5)


# ---- honesty ---------------------------------------------------------------------------------------------------------


def test_unstable_nominal_point_has_no_margin() -> None:
    with pytest.raises(NotStable, match=r"2 w1/1"):
        speed_margins(lambda W: mathieu(0.2, 0.01, W), speed=2.0, limits=(1.5, 2.5))


def test_model_that_ends_gives_a_lower_bound_with_its_reason() -> None:
    def path(W: float) -> PeriodicSystem:
        if W > 1.83:
            raise ModelError("no equilibrium")
        return mathieu(0.1, 0.01, W)

    found = first_instability(path, nominal=1.5, limit=2.5, samples=12)
    assert found.bound == "lower" and "no equilibrium" in found.reason
    assert found.safe == pytest.approx(1.83, abs=1e-4)
    assert np.isnan(found.unsafe)


def undecided(lower: float, upper: float) -> Callable[[PeriodicSystem], Floquet]:
    """The engines, disagreeing between two frequencies."""

    def engine(system: PeriodicSystem) -> Floquet:
        found = floquet(system)
        inside = lower <= float(system.frequency) <= upper
        return replace(found, agreement=Agreement.UNRESOLVED) if inside else found

    return engine


def test_engines_that_disagree_at_the_edge_are_unresolved(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(search_module, "floquet", undecided(1.9, 2.2))
    found = first_instability(lambda W: mathieu(0.1, 0.01, W), nominal=1.6, limit=2.1, samples=9)
    assert found.agreement is Agreement.UNRESOLVED
    assert np.isnan(found.value) and np.isnan(found.unsafe) and "UNRESOLVED" in found.text


def test_engines_that_disagree_before_the_edge_leave_an_upper_bound(monkeypatch: pytest.MonkeyPatch) -> None:
    """A second-order tongue at W = 1 that nearly grows and cannot be decided: the loss at W = 2 is the latest."""
    path = lambda W: mathieu(0.1, 6e-3, W)  # noqa: E731
    honest = first_instability(path, nominal=0.8, limit=2.2, samples=24)
    assert honest.bound == "exact"
    monkeypatch.setattr(search_module, "floquet", undecided(0.98, 1.02))
    found = first_instability(path, nominal=0.8, limit=2.2, samples=24)
    assert found.bound == "upper" and found.value == found.unsafe
    assert found.unsafe == pytest.approx(honest.unsafe, rel=1e-9)
    nothing_beyond = first_instability(path, nominal=0.8, limit=1.5, samples=24)
    assert nothing_beyond.bound == "lower" and nothing_beyond.safe < 0.98


def test_undamped_nominal_point_is_unresolved_not_stable() -> None:
    found = first_instability(lambda W: mathieu(0.1, 0.0, W), nominal=1.5, limit=1.8, samples=5)
    assert found.agreement is Agreement.UNRESOLVED and np.isnan(found.value)


def test_all_margins_of_a_loop() -> None:
    def loop(*, depth: float, gain: float, speed: float) -> PeriodicSystem:
        return mathieu(depth, 0.02 * gain, speed)

    found = floquet_margins(loop, depth=0.03, speed=2.0, largest_depth=0.1, speed_limits=(1.8, 2.2), samples=9)
    assert found.gain is not None and found.speed is not None
    assert found.gain[0].value == pytest.approx(0.75, rel=1e-2)
    assert [m.bound for m in found.speed] == ["lower", "lower"]
    unstable = floquet_margins(loop, depth=0.05, speed=2.0, largest_depth=0.1, speed_limits=(1.8, 2.2), samples=9)
    assert unstable.gain is None and unstable.speed is None
    assert unstable.depth.value == pytest.approx(0.04, rel=1e-3)
    with pytest.raises(ValueError, match="limits: expected"):
        floquet_margins(loop, depth=0.05, speed=2.0, largest_depth=0.1, speed_limits=(2.1, 2.2))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"nominal": 1.0, "limit": 1.0}, "limit: expected"),
        ({"nominal": 1.0, "limit": 2.0, "samples": 2}, "samples: expected"),
        ({"nominal": 1.0, "limit": -2.0, "spacing": "log"}, "positive factors"),
    ],
)
def test_wrong_searches_are_refused(options: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        first_instability(lambda W: mathieu(0.1, 0.1, W), **options)
