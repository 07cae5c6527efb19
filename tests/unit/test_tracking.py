"""Tracks keep their identity through crossings, veerings and pairs that split into real roots."""

from __future__ import annotations

import numpy as np
import pytest

from maglev_ctrl.analysis.modes import ModeKind, modes, modes_of_stack
from maglev_ctrl.analysis.tracking import frequency_crossings, track
from maglev_ctrl.systems import SecondOrderSystem

NAMES = ("car.heave", "car.pitch")


def sweep(coupling: float, points: int, *, damping: float = 0.02) -> tuple[np.ndarray, SecondOrderSystem]:
    """Two oscillators whose stiffnesses meet at x = 0.5."""
    x = np.linspace(0.0, 1.0, points)
    K = [np.array([[9.0 + 8 * p, coupling], [coupling, 17.0 - 8 * p]]) for p in x]
    return x, SecondOrderSystem.from_matrices(np.eye(2), damping * np.eye(2), K, dofs=NAMES)


@pytest.mark.parametrize("points", [7, 8, 50, 51])
def test_crossing_lines_keep_their_labels(points: int) -> None:
    """An odd number of points puts one sample exactly on the crossing, where the vectors are arbitrary."""
    x, system = sweep(0.0, points)
    tracks = track(system, parameter=x)
    assert tracks.labels == ("car heave", "car pitch")
    heave, pitch = np.sqrt(9.0 + 8 * x - 1e-4), np.sqrt(17.0 - 8 * x - 1e-4)
    np.testing.assert_allclose(tracks.s[:, 0].imag, heave, atol=1e-7)
    np.testing.assert_allclose(tracks.s[:, 1].imag, pitch, atol=1e-7)


def test_crossing_mutant_sorted_by_frequency_is_caught() -> None:
    x, system = sweep(0.0, 50)
    by_frequency = np.stack([m.s for m in modes_of_stack(system)])
    assert np.max(np.abs(by_frequency[:, 0].imag - np.sqrt(9.0 + 8 * x - 1e-4))) > 0.5


def test_weakly_coupled_crossing_seen_by_coarse_steps_follows_the_shapes() -> None:
    x, system = sweep(1e-4, 40)
    tracks = track(system, parameter=x)
    np.testing.assert_allclose(tracks.s[:, 0].imag, np.sqrt(9.0 + 8 * x), atol=1e-3)


def test_resolved_veering_does_not_cross() -> None:
    x, system = sweep(0.6, 201)
    tracks = track(system, parameter=x)
    assert np.all(tracks.s[:, 0].imag < tracks.s[:, 1].imag)
    assert np.max(np.abs(np.diff(tracks.s, axis=0))) < 0.02
    assert np.min(tracks.confidence) > 0.98


def test_pair_splits_into_two_reals_and_joins_again() -> None:
    c = np.linspace(3.0, 5.0, 21)
    c = np.concatenate([c, c[-2::-1]])
    system = SecondOrderSystem.from_matrices([[1.0]], c[:, None, None], [[4.0]], dofs=("car.heave",))
    tracks = track(system, parameter=np.arange(len(c)))
    assert tracks.s.shape[1] == 2
    overdamped = c > 4.0
    assert not np.isnan(tracks.s[:, 0]).any()
    np.testing.assert_array_equal(np.isnan(tracks.s[:, 1]), c < 4.0 - 1e-9)
    roots = np.sqrt(c[overdamped] ** 2 / 4 - 4.0)
    found = np.sort(tracks.s[overdamped].real, axis=1)
    np.testing.assert_allclose(found, -c[overdamped, None] / 2 + roots[:, None] * [-1.0, 1.0], rtol=1e-12)
    # each real line is smooth: none jumps from one branch to the other
    assert np.max(np.abs(np.diff(tracks.s[overdamped, 0].real))) < 0.5
    assert tracks.kinds[0] == (ModeKind.STABLE, None)


def test_flutter_onset_keeps_both_lines() -> None:
    p = np.linspace(-0.5, 2.0, 101)
    K = [np.array([[2.0, 0.5], [-q, 1.0]]) for q in p]
    system = SecondOrderSystem.from_matrices(np.eye(2), 0.01 * np.eye(2), K, dofs=NAMES)
    tracks = track(system, parameter=p)
    assert tracks.s.shape == (101, 2)
    assert not np.isnan(tracks.s).any()
    after = [ModeKind.COUPLED_MODE_FLUTTER in row for row in tracks.kinds]
    assert after[-1]
    assert not after[0]


def test_six_crossing_modes_with_random_shapes() -> None:
    rng = np.random.default_rng(5)
    n, points = 6, 120
    root = rng.standard_normal((n, n)) + 2 * np.eye(n)  # one fixed modal basis, non-symmetric problem
    inverse = np.linalg.inv(root)
    start, end = np.arange(1.0, n + 1) ** 2, np.arange(1.0, n + 1)[::-1] ** 2 + 0.3
    x = np.linspace(0.0, 1.0, points)
    w2 = [start + (end - start) * q for q in x]
    K = [root @ np.diag(values) @ inverse for values in w2]
    tracks = track(SecondOrderSystem.from_matrices(np.eye(n), np.zeros((n, n)), K), parameter=x)
    np.testing.assert_allclose(tracks.s.imag, np.sqrt(np.stack(w2)), rtol=1e-7)


def test_frequency_crossings_become_candidates() -> None:
    x, system = sweep(0.0, 24)
    np.testing.assert_allclose(frequency_crossings(track(system, parameter=x)), [0.5], atol=1e-3)


def test_wrong_use_is_named() -> None:
    one = modes(SecondOrderSystem.from_matrices([[1.0]], [[0.1]], [[4.0]]))
    two = modes(SecondOrderSystem.from_matrices(np.eye(2), np.eye(2), np.eye(2)))
    with pytest.raises(ValueError, match="at least one"):
        track([])
    with pytest.raises(ValueError, match="different numbers"):
        track([one, two])
    with pytest.raises(ValueError, match="parameter"):
        track([one, one], parameter=[1.0])
