"""Stability maps: accuracy, naming, verification by Hill's method, tongues narrower than the grid, speed."""

from __future__ import annotations

import time

import numpy as np
import pytest

import maglev_ctrl.analysis.resonance_map as map_module
from maglev_ctrl.analysis.critical_depth import critical_depth
from maglev_ctrl.analysis.depth_surrogate import depth_surrogate
from maglev_ctrl.analysis.floquet import floquet
from maglev_ctrl.analysis.resonance_map import ResonanceMap, resonance_map
from maglev_ctrl.systems import PeriodicSystem, SecondOrderSystem

HZ = 2 * np.pi
Arrays = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def vehicle(columns: int, *, zeta: float = 0.01, wavelength: float = 25.0) -> Arrays:
    """Six modes that stiffen with speed, an actuator pole at -125 and a filter at -60 rad/s; periods 0.1..1.5 s."""
    rng = np.random.default_rng(0)
    speed = np.linspace(wavelength / 1.5, 10.0 * wavelength, columns)
    w = HZ * np.array([0.9, 1.2, 1.5, 4.0, 5.5, 7.0])
    Q = np.linalg.qr(rng.standard_normal((6, 6)))[0]
    K_1 = w[:, None] * (Q @ np.diag(rng.uniform(0.2, 1.0, 6)) @ Q.T) * w
    K_1[0, 1] *= 1.3
    K_1[1, 0] *= 0.6
    A_0 = np.zeros((columns, 14, 14))
    A_0[:, :6, 6:12] = np.eye(6)
    A_0[:, 6:12, :6] = -np.diag(w**2) * (1.0 + 0.1 * speed / speed[-1])[:, None, None]
    A_0[:, 6:12, 6:12] = -2.0 * zeta * np.diag(w)
    A_0[:, 12, 12], A_0[:, 13, 13] = -125.0, -60.0
    A_0[:, 6:12, 12], A_0[:, 12, 6:12] = 0.2, 0.5
    A_0[:, 6:12, 13], A_0[:, 13, 6:12] = -0.1, 1.0
    d = np.array([1.0] * 12 + [2e4, 3e5])  # actuator states in newtons
    A_1 = np.zeros((columns, 1, 14, 14))
    A_1[:, 0, 6:12, :6] = -K_1
    return A_0 / d * d[:, None], A_1, np.zeros_like(A_1), HZ * speed / wavelength, speed


STATES = tuple(f"q{i}" for i in range(1, 7)) + tuple(f"q{i}.velocity" for i in range(1, 7)) + ("force", "filter")


def two_modes(W: np.ndarray, K_1: list[list[float]], damping: tuple[float, float]) -> tuple[np.ndarray, ...]:
    system = SecondOrderSystem.from_matrices(np.eye(2), np.diag(damping), np.diag([1.0, 2.89]))
    A_0 = np.broadcast_to(system.state_matrix(), (len(W), 4, 4))
    A_1 = np.broadcast_to(system.modulated_state_matrix(K_1), (len(W), 1, 4, 4))
    return A_0, A_1, np.zeros_like(A_1), W


@pytest.fixture(scope="module")
def atlas() -> ResonanceMap:
    A_0, A_cos, A_sin, W, speed = vehicle(40)
    return resonance_map(A_0, A_cos, A_sin, W, np.linspace(0.0, 0.2, 41), parameter=speed, states=STATES)


def test_map_equals_floquet_point_by_point(atlas: ResonanceMap) -> None:
    A_0, A_cos, _, W, _ = vehicle(40)
    for v, e in ((0, 40), (5, 30), (9, 17), (13, 40), (22, 3), (33, 40), (39, 25)):
        depth = atlas.depths[e]
        single = floquet(PeriodicSystem.from_matrices(A_0[v], depth * A_cos[v], frequency=W[v]))
        assert abs(single.growth_rate - atlas.growth_rate[v, e]) <= atlas.error_bound[v] + single.growth_error
        assert atlas.spectral_radius[v, e] == pytest.approx(single.spectral_radius, rel=1e-8)
    assert np.max(atlas.error_bound) < 1e-8


def test_map_is_verified_in_the_frequency_domain(atlas: ResonanceMap) -> None:
    assert len(atlas.checked) >= 24
    assert not np.any(atlas.unresolved)
    assert np.max(atlas.check_difference) < 1e-8
    marked = atlas.unstable[atlas.checked[:, 0], atlas.checked[:, 1]]
    assert np.any(marked)
    assert not np.all(marked)


def test_wrong_propagators_are_marked_unresolved(monkeypatch: pytest.MonkeyPatch) -> None:
    """A surrogate that is wrong by one part in 1e5 in a single column is found out."""
    W = np.linspace(1.8, 2.2, 9)
    original = depth_surrogate

    def wrong(A_0: np.ndarray, A_cos: np.ndarray, A_sin: np.ndarray, **named: float):
        factor = 1.0 + (1e-5 if abs(named["frequency"] - W[4]) < 1e-12 else 0.0)
        return original(A_0 * factor, A_cos, A_sin, **named)

    def check_true_matrices(column, depth, multiplier):
        true = original(A_0[4], A_1[4], A_2[4], frequency=column.frequency, depth_max=column.depth_max)
        return honest(true, depth, multiplier)

    A_0, A_1, A_2, _ = two_modes(W, [[0.5, 0.4], [0.3, 0.6]], (0.004, 0.012))
    honest = map_module._hill_difference
    monkeypatch.setattr(map_module, "depth_surrogate", wrong)
    monkeypatch.setattr(map_module, "_hill_difference", check_true_matrices)
    found = resonance_map(A_0, A_1, A_2, W, np.linspace(0.0, 0.2, 9), parameter=W, seeds=False)
    assert np.all(found.unresolved[4])
    assert not np.any(np.delete(found.unresolved, 4, axis=0))


def test_regions_are_named(atlas: ResonanceMap) -> None:
    names = {t.name for t in atlas.tongues}
    assert {"2 w1/1 (q1)", "2 w2/1 (q2)", "2 w3/1 (q3)", "2 w4/1 (q4)"} <= names | {s.name for s in atlas.seeded}
    assert np.array_equal(atlas.tongue_index >= 0, atlas.unstable)
    assert np.max(atlas.tongue_index) == len(atlas.tongues) - 1


def test_every_pixel_belongs_to_the_right_tongue() -> None:
    W = np.linspace(1.7, 3.7, 81)
    A_0, A_1, A_2, _ = two_modes(W, [[0.5, 0.4], [0.3, 0.6]], (0.004, 0.012))
    found = resonance_map(A_0, A_1, A_2, W, np.linspace(0.0, 0.25, 26), parameter=W)
    centres = {"2 w1/1": 2.0, "(w1 + w2)/1": 2.7, "2 w2/1": 3.4}
    assert {t.name for t in found.tongues} == set(centres)
    for v, e in zip(*np.nonzero(found.unstable), strict=True):
        name = found.tongues[found.tongue_index[v, e]].name
        assert name == min(centres, key=lambda c, at=W[v]: abs(centres[c] - at))


def test_difference_tongue_is_named() -> None:
    W = np.linspace(0.6, 0.8, 41)
    A_0, A_1, A_2, _ = two_modes(W, [[0.5, 0.4], [-0.3, 0.6]], (0.004, 0.012))
    found = resonance_map(A_0, A_1, A_2, W, np.linspace(0.0, 0.1, 11), parameter=W)
    assert "(w2 - w1)/1" in {t.name for t in found.tongues}
    assert found.unstable[20, 10]


@pytest.mark.parametrize("offset", [0.0, 0.013, 0.031])
def test_narrow_tongue_between_columns_is_seeded(offset: float) -> None:
    """A sum tongue 40 times narrower than the grid step: no pixel sees it, the seed does."""
    W = np.linspace(2.2, 3.2, 8) + offset
    A_0, A_1, A_2, _ = two_modes(W, [[0.02, 0.01], [0.01, 0.02]], (2e-4, 2e-4))
    found = resonance_map(A_0, A_1, A_2, W, np.linspace(0.0, 0.5, 11), parameter=W)
    seed = next(s for s in found.seeded if s.name == "(w1 + w2)/1")
    assert not np.any(found.unstable)
    assert not seed.resolved_by_grid
    assert seed.parameter == pytest.approx(2.7, abs=2e-3)
    at_centre = two_modes(np.array([seed.parameter]), [[0.02, 0.01], [0.01, 0.02]], (2e-4, 2e-4))
    exact = critical_depth(
        PeriodicSystem.from_matrices(at_centre[0][0], at_centre[1][0], frequency=seed.parameter), depth_max=0.5
    )
    assert seed.threshold == pytest.approx(exact.depth, rel=1e-6)
    # Hsu: eps^2 d12 d21/(4 w1 w2) = c1 c2
    assert seed.threshold == pytest.approx(2e-4 * np.sqrt(4 * 1.7) / 0.01, rel=0.02)


def test_wide_tongue_is_resolved_by_the_grid() -> None:
    W = np.linspace(1.7, 2.3, 30)
    A_0, A_1, A_2, _ = two_modes(W, [[0.5, 0.0], [0.0, 0.6]], (0.004, 0.012))
    found = resonance_map(A_0, A_1, A_2, W, np.linspace(0.0, 0.3, 31), parameter=W)
    seed = next(s for s in found.seeded if s.name == "2 w1/1")
    assert seed.resolved_by_grid
    assert seed.threshold == pytest.approx(0.016, rel=0.01)  # eps d11 = 4 zeta w^2


def test_second_order_tongue_is_seeded() -> None:
    """The tongue at W = w1 (order 2) has no first-order width at all."""
    W = np.linspace(0.85, 1.15, 8)
    A_0, A_1, A_2, _ = two_modes(W, [[1.0, 0.0], [0.0, 0.1]], (1e-3, 1e-3))
    found = resonance_map(A_0, A_1, A_2, W, np.linspace(0.0, 0.3, 7), parameter=W)
    seed = next(s for s in found.seeded if s.name == "2 w1/2")
    assert 0.0 < seed.threshold < 0.3
    # Mathieu, second tongue: a2 - b2 = q^2/2 with a = 4 w^2/W^2, q = 2 eps/W^2, damped threshold eps^2 = 4 c
    assert seed.threshold == pytest.approx(np.sqrt(4 * 1e-3), rel=0.05)


def test_unstable_without_modulation_is_unstable_everywhere_and_unnamed() -> None:
    W = np.linspace(4.0, 5.0, 5)
    A_0, A_1, A_2, _ = two_modes(W, [[0.1, 0.0], [0.0, 0.1]], (-0.01, 0.01))
    found = resonance_map(A_0, A_1, A_2, W, np.linspace(0.0, 0.05, 4), parameter=W)
    assert np.all(found.unstable)
    assert [t.kind for t in found.tongues] == ["none"]
    assert found.seeded == ()


def test_undamped_system_is_not_called_unstable_by_rounding() -> None:
    W = np.linspace(1.7, 1.9, 6)  # the first one sits on the tongue 2 w2/2, the others between tongues
    A_0, A_1, A_2, _ = two_modes(W, [[0.5, 0.0], [0.0, 0.5]], (0.0, 0.0))
    found = resonance_map(A_0, A_1, A_2, W, np.linspace(0.0, 0.1, 6), parameter=W)
    assert not np.any(found.unstable[1:])
    assert np.all(found.unstable[0, 1:])
    assert [t.name for t in found.tongues] == ["2 w2/2"]


def test_tail_estimate_and_direct_fallback() -> None:
    A_0, A_cos, A_sin, W, _ = vehicle(3)
    probe = np.linspace(0.0, 0.3, 23)
    for v in range(3):
        surrogate = depth_surrogate(A_0[v], A_cos[v], A_sin[v], frequency=float(W[v]), depth_max=0.3)
        assert surrogate.series is not None
        exact = surrogate.direct(probe)
        error = np.max(np.linalg.norm(surrogate.monodromy(probe) - exact, axis=(1, 2)))
        assert error <= surrogate.error * np.max(np.linalg.norm(exact, axis=(1, 2))) * 10.0
    strict = depth_surrogate(A_0[0], A_cos[0], A_sin[0], frequency=float(W[0]), depth_max=0.3, tolerance=0.0)
    assert strict.series is None
    assert np.array_equal(strict.monodromy(probe[:2]), strict.direct(probe[:2]))


@pytest.mark.parametrize(
    ("depths", "parameter", "message"),
    [
        ([0.1, 0.0], [1.0, 2.0], "depths: expected ascending"),
        ([0.0, 0.1], [2.0, 1.0], "parameter: expected ascending"),
        ([0.0], [1.0, 2.0], "depths: expected ascending"),
    ],
)
def test_wrong_axes_are_refused(depths: list[float], parameter: list[float], message: str) -> None:
    A_0, A_1, A_2, W = two_modes(np.array([1.0, 2.0]), [[0.1, 0.0], [0.0, 0.1]], (0.0, 0.0))
    with pytest.raises(ValueError, match=message):
        resonance_map(A_0, A_1, A_2, W, np.array(depths), parameter=np.array(parameter))


def test_map_of_ten_thousand_points_is_fast() -> None:
    """100 x 100 points, 14 states, a pole at -125 rad/s, verification and seeds included: CPU time of one core."""
    A_0, A_cos, A_sin, W, speed = vehicle(100)
    best = float("inf")
    for _ in range(2):
        start = time.process_time()
        resonance_map(A_0, A_cos, A_sin, W, np.linspace(0.0, 0.2, 100), parameter=speed, states=STATES)
        best = min(best, time.process_time() - start)
    assert best < 6.0  # 1.2-1.9 s on an idle core of 2.5 GHz; the bound leaves room for a loaded machine
