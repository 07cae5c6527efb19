"""Margins at inputs, outputs and both, skews side by side, zones of S, and the delay common to all channels."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg

from maglev_ctrl.analysis.common_delay import common_delay_margin
from maglev_ctrl.analysis.loops import Loop, return_ratio
from maglev_ctrl.analysis.margin_sites import loop_at, margin_sites, pole_distance, sensitivity_zone, site_margins
from maglev_ctrl.analysis.margins import loop_margins
from maglev_ctrl.errors import Agreement, NotStable
from maglev_ctrl.systems import Controller, SecondOrderSystem, close_loop


def plant() -> SecondOrderSystem:
    """Two coupled masses on weak springs, a force on each."""
    K = np.array([[5.0, -2.0], [-2.0, 3.0]])
    return SecondOrderSystem.from_matrices(
        np.diag([2.0, 1.0]), 0.02 * K, K, dofs=("a", "b"), inputs=("fa", "fb"), B=np.eye(2)
    )


def law() -> Controller:
    """Dynamic, reads a position and two rates."""
    return Controller.from_matrices(
        [[-8.0]], [[1.0, 0.5, 0.0]], [[2.0], [-1.0]], [[-1.0, -2.0, 0.3], [0.2, -0.1, -1.5]],
        measured=("a", "a.velocity", "b.velocity"), commands=("fa", "fb"),
    )  # fmt: skip


@pytest.mark.parametrize("site", ["input", "output", "both"])
def test_a_loop_broken_anywhere_closes_to_the_same_poles(site) -> None:
    loop = loop_at(plant(), law(), site)
    closed = loop.A - loop.B @ np.linalg.solve(np.eye(len(loop.channels)) + loop.D, loop.C)
    expected = np.sort_complex(np.linalg.eigvals(close_loop(plant(), law()).state_matrix()))
    assert np.allclose(np.sort_complex(np.linalg.eigvals(closed)), expected, rtol=1e-9)
    if site == "both":  # two signs flipped are none
        return
    flipped = loop.A + loop.B @ np.linalg.solve(np.eye(len(loop.channels)) - loop.D, loop.C)  # mutant: the other sign
    assert not np.allclose(np.sort_complex(np.linalg.eigvals(flipped)), expected, rtol=1e-3)


def test_sites_skews_and_replayed_poles() -> None:
    found = margin_sites(plant(), law())
    for site in found.sites:
        assert site.sigmas == (-1.0, 0.0, 1.0)
        assert all(disk.agreement is Agreement.AGREED for disk in site.skewed)
        assert np.all(site.pole_distances < 1e-6)
        assert len(site.zones) == len(site.margins.channels)
        # Skews of one loop know of each other: |1/alpha_S - 1/alpha_T| <= 1, as S + T = I.
        by_T, _, by_S = (1.0 / disk.alpha for disk in site.skewed)
        assert abs(by_S - by_T) <= 1.0 + 1e-9
    # Breaking everywhere at once can only be worse.
    for k in range(3):
        assert found.both.skewed[k].alpha <= min(found.input.skewed[k].alpha, found.output.skewed[k].alpha) * (1 + 1e-6)
    # K S against a dense grid of the open loops
    w = np.geomspace(1e-3, 1e3, 20001)
    C, _, _ = plant().output_rows(law().measured)
    P = C @ np.linalg.solve(1j * w[:, None, None] * np.eye(4) - plant().state_matrix(), plant().input_matrix() + 0j)
    K = law().D + law().C @ law().B / (1j * w[:, None, None] + 8.0)
    KS = np.abs(K @ np.linalg.inv(np.eye(3) - P @ K))
    assert np.allclose(found.command_peaks, np.max(KS, axis=0), rtol=1e-4)  # the grid ends at 1e3
    assert found.command_peaks.shape == (2, 3)


def test_a_perturbation_that_is_not_the_worst_leaves_the_axis() -> None:
    loop = loop_at(plant(), law(), "input")
    site = site_margins(loop, "input")
    other = loop_margins(Loop(loop.A, loop.B, 1.1 * loop.C, loop.D, loop.channels)).multi_loop
    assert pole_distance(loop, other) > 1e-4  # mutant: the worst perturbation of another loop
    assert site.pole_distances[1] < 1e-6
    with pytest.raises(ValueError, match="2 channels"):
        pole_distance(loop, site.margins.channels[0].disk)


@pytest.mark.parametrize(("peak", "zone"), [(0.0, "A"), (2.999, "A"), (3.0, "B"), (4.0, "C"), (5.0, "D"), (1e9, "D")])
def test_zones(peak: float, zone: str) -> None:
    assert sensitivity_zone(peak) == zone


def test_zone_limits_are_the_decibels_of_the_standard() -> None:
    """9.5, 12 and 14 dB, to a tenth."""
    assert [round(20.0 * np.log10(x), 1) for x in (3.0, 4.0, 5.0)] == [9.5, 12.0, 14.0]
    with pytest.raises(ValueError, match="peak"):
        sensitivity_zone(float("nan"))


def random_loop(seed: int) -> Loop:
    rng = np.random.default_rng(seed)
    n, m = int(rng.integers(2, 8)), int(rng.integers(1, 4))
    A, B = rng.normal(size=(n, n)), rng.normal(size=(n, m))
    X = scipy.linalg.solve_continuous_are(A, B, np.eye(n), np.eye(m))
    through = 0.1 * rng.normal(size=(m, m)) if seed % 3 == 0 else np.zeros((m, m))
    delays = [0.02] * m if seed % 4 == 1 and seed % 3 else None
    return Loop(A, B, B.T @ X, through, tuple(f"u{i}" for i in range(m)), delays)


@pytest.mark.parametrize("seed", range(8))
def test_common_delay_against_a_dense_grid(seed: int) -> None:
    loop = random_loop(seed)
    try:
        found = common_delay_margin(loop)
    except NotStable:
        pytest.skip("this random loop is not stable")
    assert found.agreement is Agreement.AGREED
    assert found.pole_distance < 1e-6
    w = np.geomspace(1e-3, 1e3, 40001)
    values = np.linalg.eigvals(return_ratio(loop, w))
    gaps = np.abs(np.exp(-1j * w[:, None] * found.delay) * values + 1.0)
    assert np.min(gaps) < 1e-3  # an eigenvalue reaches -1 at this delay
    for share in (0.3, 0.6, 0.9, 0.99):  # and none does before
        before = np.abs(np.exp(-1j * w[:, None] * share * found.delay) * values + 1.0)
        assert np.min(before) > 10.0 * np.min(gaps)


def test_common_delay_of_one_channel_is_its_delay_margin() -> None:
    loop = Loop.from_transfer_function([25.0], [1.0, 10.0, 10.0, 10.0])
    one = loop_margins(loop).channels[0].delay
    found = common_delay_margin(loop)
    assert (found.delay, found.frequency) == (
        pytest.approx(one.value, rel=1e-9),
        pytest.approx(one.frequency, rel=1e-9),
    )


def test_two_channels_delayed_together_are_not_two_channels_delayed_alone() -> None:
    """Rotating coupling: each channel alone has more room than both together, and the closed form is known."""
    g = 2.0  # L = g [[1, a], [-a, 1]] / s has eigenvalues g (1 +- j a)/s
    a = 0.5
    loop = Loop(np.zeros((2, 2)), np.eye(2), g * np.array([[1.0, a], [-a, 1.0]]), np.zeros((2, 2)), ("u", "v"))
    crossing = g * np.hypot(1.0, a)
    expected = (np.pi / 2.0 - np.arctan(a)) / crossing
    found = common_delay_margin(loop)
    assert found.delay == pytest.approx(expected, rel=1e-9)
    assert found.frequency == pytest.approx(crossing, rel=1e-9)
    assert found.delay < min(one.delay.value for one in loop_margins(loop).channels)


def test_limits_of_the_common_delay() -> None:
    assert common_delay_margin(Loop.from_transfer_function([0.5], [1.0, 1.0])).delay == np.inf
    assert common_delay_margin(Loop.from_transfer_function([2.0, 1.0], [1.0, 3.0])).delay == 0.0
    with pytest.raises(ValueError, match="continuous"):
        common_delay_margin(Loop.from_transfer_function([0.5], [1.0, 0.5], dt=0.1))


def test_sampled_and_unknown_are_refused() -> None:
    sampled = Controller.static([[-1.0]], measured=("a",), commands=("fa",), dt=0.1)
    with pytest.raises(ValueError, match="sampled"):
        loop_at(plant(), sampled, "input")
    with pytest.raises(ValueError, match="not an input"):
        loop_at(plant(), Controller.static([[-1.0]], measured=("a",), commands=("x",)), "output")
