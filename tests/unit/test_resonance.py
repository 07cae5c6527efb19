"""First-order resonance theory on the state matrix, and the naming of unstable points."""

from __future__ import annotations

import numpy as np
import pytest

from maglev_ctrl.analysis.critical_depth import critical_depth, critical_depth_curve
from maglev_ctrl.analysis.floquet import floquet
from maglev_ctrl.analysis.resonance import (
    hsu_tongues,
    pair_growth,
    pair_interval,
    pair_threshold,
    state_modes,
    state_tongues,
    tongues,
)
from maglev_ctrl.analysis.resonance_naming import exponent_participation, name_instability
from maglev_ctrl.errors import ModelError
from maglev_ctrl.systems import Controller, PeriodicSystem, SecondOrderSystem, close_loop, modulate

SUM = np.array([[0.5, 0.4], [0.3, 0.6]])
DIFFERENCE = np.array([[0.5, 0.4], [-0.3, 0.6]])


def two_modes(damping: tuple[float, float] = (0.004, 0.012)) -> SecondOrderSystem:
    return SecondOrderSystem.from_matrices(
        np.eye(2), np.diag(damping), np.diag([1.0, 2.89]), dofs=("car.heave", "car.pitch")
    )


@pytest.mark.parametrize(
    ("a", "b", "g"),
    [
        (0.01, 0.03, 0.002),
        (0.02, 0.02, 0.001 + 0.0005j),
        (0.005, 0.05, 0.0007 - 0.001j),
        (0.01, 0.02, -0.0002 + 0.001j),
    ],
)
def test_interval_and_threshold_are_where_growth_vanishes(a: float, b: float, g: complex) -> None:
    """The closed forms against the roots of the growth polynomial itself."""
    centre, half = pair_interval(a, b, g)
    assert half > 0.0
    for edge in (centre - half, centre + half):
        assert abs(pair_growth(a, b, g, edge)) < 1e-12
    assert pair_growth(a, b, g, centre) > 0.0
    for outside in (centre - 1.01 * half, centre + 1.01 * half):
        assert pair_growth(a, b, g, outside) < 0.0
    depth = pair_threshold(a, b, g)
    sweep = np.linspace(-1.0, 1.0, 4001)
    assert max(pair_growth(a, b, g * (0.999 * depth) ** 2, d) for d in sweep) < 0.0
    touching, width = pair_interval(a, b, g * (1.0001 * depth) ** 2)
    assert pair_growth(a, b, g * (1.0001 * depth) ** 2, touching) > 0.0
    assert width < half


def test_one_damped_mode_of_two_has_no_edge() -> None:
    assert pair_interval(0.0, 0.1, 0.001 + 0j) == (0.0, float("inf"))
    assert pair_interval(0.0, 0.1, -0.001 + 0j) == (0.0, 0.0)


def test_unstable_mode_has_threshold_zero() -> None:
    assert pair_threshold(-0.01, 0.1, 1.0 + 0j) == 0.0


def test_state_matrix_theory_tends_to_hsu_for_light_damping() -> None:
    """Difference of second order in the damping: ten times less damping, a hundred times less difference."""
    gaps = []
    for scale in (1.0, 0.1):
        C = scale * np.diag([0.02, 0.05])
        system = SecondOrderSystem.from_matrices(np.eye(2), C, np.diag([1.0, 2.89]))
        pair = zip(hsu_tongues(np.eye(2), system.K, SUM, C=C, depth=0.5), tongues(system, [SUM], depth=0.5),
                   strict=True)  # fmt: skip
        gaps.append(max(abs(f.half_width / h.half_width - 1.0) for h, f in pair if h.half_width > 0.0))
    assert gaps[1] < 0.02 * gaps[0]


def test_threshold_against_floquet_with_controller_and_lag() -> None:
    """A velocity loop through a lagging actuator: the modes are those of the closed loop, nothing else would do."""
    plant = SecondOrderSystem.from_matrices(
        np.diag([2.0, 5.0]), np.zeros((2, 2)), np.array([[8.0, 1.0], [1.0, 60.0]]), dofs=("heave", "pitch"),
        inputs=("force",), B=[[1.0], [0.4]],
    )  # fmt: skip
    law = Controller.from_matrices(
        [[-40.0]], [[40.0]], [[-0.5]], [[0.0]], measured=("heave.velocity",), commands=("force",), name="damper"
    )
    loop = close_loop(plant, law)
    K_1 = np.array([[8.0, 1.0], [1.0, 6.0]])
    found = tongues(loop, [K_1], depth=0.5)[1]
    assert found.resonance.name == "2 w1/1 (heave)"
    exact = critical_depth(modulate(loop, [K_1], frequency=found.resonance.frequency), depth_max=1.0)
    assert exact.resonance.name == found.resonance.name
    # first-order theory: the error is of the order of the depth itself, squared
    assert exact.depth == pytest.approx(found.threshold, rel=exact.depth**2)
    bare = tongues(plant, [K_1], depth=0.5)[1]
    assert bare.threshold == 0.0


@pytest.mark.parametrize("depth", [0.05, 0.1])
def test_width_against_floquet_growth(depth: float) -> None:
    """At first order inside the edge the point is unstable, outside it is stable."""
    for K_1, kind in ((SUM, "parametric"), (DIFFERENCE, "difference"), (SUM, "sum")):
        chosen = [t for t in tongues(two_modes(), [K_1], depth=depth) if t.resonance.kind == kind and t.half_width > 0]
        for tongue in chosen:
            for factor, unstable in ((0.85, True), (-0.85, True), (1.2, False), (-1.2, False)):
                W = tongue.centre + factor * tongue.half_width
                result = floquet(modulate(two_modes(), [depth * K_1], frequency=W))
                if tongue.half_width > depth**2:  # beyond the second-order shift of the centre
                    assert result.stable is not unstable


def test_labels_come_from_the_coordinates() -> None:
    names = [t.resonance.name for t in tongues(two_modes(), [SUM], depth=0.1)]
    assert names == [
        "(w2 - w1)/1 (car heave, car pitch)", "2 w1/1 (car heave)", "(w1 + w2)/1 (car heave, car pitch)",
        "2 w2/1 (car pitch)",
    ]  # fmt: skip


def test_flutter_is_refused_by_the_undamped_theory() -> None:
    with pytest.raises(ModelError, match="natural frequencies"):
        hsu_tongues(np.eye(2), [[1.0, 1.0], [-1.0, 1.0]], np.eye(2), depth=0.1)


def test_left_vectors_matter_mutant_is_caught() -> None:
    """With circulatory stiffness, right vectors used on both sides give another width."""
    K, K_1 = np.array([[2.0, 1.1], [-0.4, 5.0]]), np.array([[0.4, 0.9], [0.1, 0.7]])
    system = SecondOrderSystem.from_matrices(np.eye(2), np.zeros((2, 2)), K)
    unit = modulate(system, [K_1], frequency=1.0)
    right = next(t for t in state_tongues(unit.A_0, unit.A_cos, unit.A_sin, depth=0.1) if t.resonance.kind == "sum")
    hsu = next(t for t in hsu_tongues(np.eye(2), K, K_1, depth=0.1) if t.resonance.kind == "sum")
    assert right.half_width == pytest.approx(hsu.half_width, rel=1e-9)
    squares, R = np.linalg.eig(K)
    R = R[:, np.argsort(squares)]
    w = np.sqrt(np.sort(squares))
    mutant = R.T @ K_1 @ R
    wrong = 0.05 * np.sqrt(abs(mutant[0, 1] * mutant[1, 0]) / (w[0] * w[1]))
    assert abs(wrong - right.half_width) > 0.05 * right.half_width


NAMED = [  # K_1, W, depth, name: one point well inside each tongue
    (SUM, 2.0, 0.1, "2 w1/1"),
    (SUM, 3.4, 0.2, "2 w2/1"),
    (SUM, 2.7, 0.1, "(w1 + w2)/1"),
    (DIFFERENCE, 0.7, 0.1, "(w2 - w1)/1"),
    (np.diag([1.0, 0.0]), 0.985, 0.5, "2 w1/2"),
]


@pytest.mark.parametrize(("K_1", "W", "depth", "name"), NAMED)
def test_unstable_points_get_their_names(K_1: np.ndarray, W: float, depth: float, name: str) -> None:
    system = modulate(two_modes(), [depth * K_1], frequency=W)
    result = floquet(system)
    assert result.stable is False
    resonance = name_instability(system, result)
    assert resonance.name.startswith(name)
    assert abs(resonance.detuning) < 0.03


def test_every_unstable_point_of_a_sweep_is_named_after_the_nearest_tongue() -> None:
    centres = {"2 w1/1": 2.0, "(w1 + w2)/1": 2.7, "2 w2/1": 3.4}
    seen = set()
    for W in np.linspace(1.8, 3.6, 61):
        system = modulate(two_modes(), [0.2 * SUM], frequency=W)
        result = floquet(system)
        name = name_instability(system, result).name
        if result.stable is False:
            nearest = min(centres, key=lambda c, at=W: abs(centres[c] - at))
            assert name.startswith(nearest)
            seen.add(nearest)
    assert seen == set(centres)


def test_instability_without_modulation_has_no_name() -> None:
    system = PeriodicSystem.from_matrices([[0, 1], [-1, 0.02]], [[[0, 0], [-0.001, 0]]], frequency=7.0)
    assert name_instability(system).kind == "none"


def test_naming_with_second_harmonic() -> None:
    """Modulation in the second harmonic only: the principal tongue sits at W = w, order 2."""
    K_1 = np.diag([1.0, 0.0])
    system = modulate(two_modes(), [np.zeros((2, 2)), 0.2 * K_1], frequency=1.0)
    assert name_instability(system).name == "2 w1/2 (car heave)"
    found = [t for t in tongues(two_modes(), [np.zeros((2, 2)), K_1], depth=0.2) if t.half_width > 0.0]
    assert [t.resonance.name for t in found] == ["2 w1/2 (car heave)"]
    assert found[0].centre == pytest.approx(1.0, abs=1e-5)


def test_participations_add_up_and_split_evenly_at_the_centre() -> None:
    unit = modulate(two_modes((0.01, 0.01)), [0.1 * SUM], frequency=2.7)
    result = floquet(unit)
    modes = state_modes(unit.A_0)
    share, _ = exponent_participation(
        unit.A_0, unit.A_cos, unit.A_sin, frequency=2.7, exponent=complex(result.exponents[0]), modes=modes
    )
    assert np.sum(share) == pytest.approx(1.0, abs=1e-9)
    largest = np.sort(np.abs(share).ravel())[::-1]
    assert largest[0] == pytest.approx(0.5, abs=0.05)
    assert largest[1] == pytest.approx(0.5, abs=0.05)
    assert largest[2] < 0.05


def test_critical_depth_says_what_it_found() -> None:
    calm = modulate(two_modes(), [SUM], frequency=9.0)
    assert critical_depth(calm, depth_max=0.1).text == "stable up to depth 0.1"
    bad = PeriodicSystem.from_matrices([[0, 1], [-1, 0.02]], [[[0, 0], [-1, 0]]], frequency=2.0)
    found = critical_depth(bad, depth_max=0.1)
    assert (found.depth, found.unstable_at_zero, found.text) == (0.0, True, "unstable without modulation")
    with pytest.raises(ValueError, match="depth_max: expected a positive depth"):
        critical_depth(calm, depth_max=0.0)


def test_critical_depth_curve_equals_single_points() -> None:
    W = np.array([1.9, 2.0, 2.7, 5.0])
    systems = [modulate(two_modes(), [SUM], frequency=w) for w in W]
    curve = critical_depth_curve(
        np.array([s.A_0 for s in systems]), np.array([s.A_cos for s in systems]),
        np.array([s.A_sin for s in systems]), W, depth_max=0.5, parameter=W, states=two_modes().states,
    )  # fmt: skip
    for k, system in enumerate(systems):
        single = critical_depth(system, depth_max=0.5)
        assert curve.depth[k] == pytest.approx(single.depth, rel=1e-7)
        assert curve.resonances[k].name == single.resonance.name
        if np.isfinite(single.depth):
            for factor, stable in ((0.999, True), (1.001, False)):
                scaled = modulate(two_modes(), [factor * single.depth * SUM], frequency=W[k])
                assert floquet(scaled).stable is stable
    assert np.isinf(curve.depth[3])


def test_free_rigid_motion_does_not_stop_the_analysis() -> None:
    """A coordinate without stiffness: a defective pair of eigenvalues at zero beside two oscillating modes."""
    A = np.zeros((6, 6))
    A[:3, 3:] = np.eye(3)
    A[3:, :3] = -np.diag([0.0, 1.0, 2.89])
    A[4, 4], A[5, 5] = -0.004, -0.012
    A_1 = np.zeros((1, 6, 6))
    A_1[0, 4:, 1:3] = -SUM
    found = {t.resonance.name: t for t in state_tongues(A, A_1, 0 * A_1, depth=0.1)}
    alone = {t.resonance.name: t for t in tongues(two_modes(), [SUM], depth=0.1, labels=("", ""))}
    assert set(found) == set(alone)
    for name, tongue in found.items():
        assert tongue.half_width == pytest.approx(alone[name].half_width, rel=1e-9, abs=1e-12)
