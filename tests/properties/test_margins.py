"""A margin's worst perturbation puts a closed-loop pole on the axis; a smaller one does not: eigenvalues say so."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from maglev_ctrl.analysis.loops import Loop, return_ratio
from maglev_ctrl.analysis.margins import Margins, loop_margins
from maglev_ctrl.arrays import ComplexArray, FloatArray
from maglev_ctrl.errors import NotStable

SEEDS = st.integers(min_value=0, max_value=10**6)


def random_loop(seed: int, *, channels: int, delayed: bool = False) -> tuple[Loop, Margins]:
    """A random loop of an often unstable plant, its gain halved until the closed loop is stable."""
    generator = np.random.default_rng(seed)
    n = int(generator.integers(2, 7))
    A = generator.normal(size=(n, n)) * 2.0
    A -= (np.max(np.linalg.eigvals(A).real) + 10.0 ** generator.uniform(-3.0, 0.0)) * np.eye(n)
    B, C = generator.normal(size=(n, channels)), generator.normal(size=(channels, n))
    D = np.zeros((channels, channels)) if delayed or seed % 2 else 0.2 * generator.normal(size=(channels, channels))
    names = tuple("abcd"[:channels])
    gain = 4.0
    while True:
        delays = generator.uniform(0.01, 0.4, channels) if delayed else None
        loop = Loop(A, B, gain * C, gain * D if gain < 1.0 else 0.0 * D, names, delays)
        try:
            return loop, loop_margins(loop)
        except NotStable:
            gain *= 0.5


def poles_with(loop: Loop, factors: ComplexArray) -> ComplexArray:
    """Closed-loop poles with constant (complex) factors on the channels."""
    F = np.diag(factors)
    inner = np.linalg.solve(np.eye(len(factors)) + loop.D @ F, loop.C + 0j)
    return np.asarray(np.linalg.eigvals(loop.A - loop.B @ F @ inner))


def distance(poles: ComplexArray, frequency: float) -> float:
    """Distance of the nearest pole to +-j frequency."""
    return float(min(np.min(np.abs(poles - 1j * frequency)), np.min(np.abs(poles + 1j * frequency))))


def one_factor(count: int, i: int, value: complex) -> ComplexArray:
    factors = np.ones(count, dtype=complex)
    factors[i] = value
    return factors


@settings(max_examples=25, deadline=None)
@given(SEEDS, st.integers(min_value=1, max_value=3))
def test_gain_and_phase_margins_reach_the_axis_and_not_before(seed: int, channels: int) -> None:
    loop, margins = random_loop(seed, channels=channels)
    for i, one in enumerate(margins.channels):
        assert one.verified, seed
        for margin in (one.gain_reduction, one.gain_increase):
            if not 1e-6 < margin.value < 1e6 or not np.isfinite(margin.frequency):
                continue
            at = poles_with(loop, one_factor(channels, i, margin.value))
            assert distance(at, margin.frequency) < 1e-5 * max(1.0, margin.frequency)
            for part in np.linspace(0.0, 0.999, 12):
                assert np.max(poles_with(loop, one_factor(channels, i, margin.value**part)).real) < 0.0
            mutant = poles_with(loop, one_factor(channels, i, margin.value**0.9))
            assert distance(mutant, margin.frequency) > distance(at, margin.frequency)
        if np.isfinite(one.phase.value):
            angle = np.radians(one.phase.value)
            ends = [poles_with(loop, one_factor(channels, i, np.exp(1j * turn))) for turn in (angle, -angle)]
            assert min(distance(end, one.phase.frequency) for end in ends) < 1e-5 * max(1.0, one.phase.frequency)
            for part in np.linspace(0.0, 0.999, 12):
                assert np.max(poles_with(loop, one_factor(channels, i, np.exp(1j * angle * part))).real) < 0.0


@settings(max_examples=25, deadline=None)
@given(SEEDS, st.integers(min_value=1, max_value=4), st.sampled_from([0.0, 0.5, -1.0, 1.0]))
def test_worst_disk_perturbation_reaches_the_axis(seed: int, channels: int, sigma: float) -> None:
    loop, _ = random_loop(seed, channels=channels)
    disk = loop_margins(loop, sigma=sigma).multi_loop
    if not disk.verified and channels == 4:
        return  # bounds may differ for four blocks; then the result says UNRESOLVED
    assert disk.verified, (seed, disk.reason)
    assert np.allclose(np.abs(disk.perturbation), disk.alpha_reached, rtol=1e-6)
    factors = disk.factors
    if np.isfinite(disk.frequency) and np.all(np.abs(factors) < 1e4):
        reached = distance(poles_with(loop, factors), disk.frequency)
        assert reached < 1e-4 * max(1.0, disk.frequency)
        opposite = (2.0 - disk.perturbation * (1.0 - sigma)) / (2.0 + disk.perturbation * (1.0 + sigma))
        missed = distance(poles_with(loop, opposite), disk.frequency)  # mutant: the sign of the perturbation
        assert missed > 10.0 * max(reached, 1e-9)
    generator = np.random.default_rng(seed)
    for _ in range(30):  # no smaller perturbation destabilises
        delta = 0.999 * disk.alpha * np.exp(2j * np.pi * generator.uniform(size=channels))
        if np.any(np.abs(2.0 - delta * (1.0 + sigma)) < 1e-2):
            continue
        inside = (2.0 + delta * (1.0 - sigma)) / (2.0 - delta * (1.0 + sigma))
        assert np.max(poles_with(loop, inside).real) < 1e-9


def poles_with_dynamics(loop: Loop, gains: FloatArray, corners: FloatArray, sigma: float) -> ComplexArray:
    """Closed-loop poles with real all-pass perturbations delta = gain (a - s)/(a + s) as states."""
    m = len(gains)
    R = np.linalg.inv(np.eye(m) + loop.D)
    A, B, C = loop.A - loop.B @ R @ loop.C, loop.B @ R, -R @ loop.C
    N = R + (sigma - 1.0) / 2.0 * np.eye(m)
    # delta: p' = -a p + z, w = gain (2 a p - z); z = C x + N w; a corner of 0 is the constant +gain
    sign = np.where(corners > 0.0, -1.0, 1.0)
    static, states = np.diag(gains * sign), np.diag(2.0 * gains * corners)
    loop_gain = np.linalg.inv(np.eye(m) - static @ N)
    w_x, w_p = loop_gain @ static @ C, loop_gain @ states
    z_x, z_p = C + N @ w_x, N @ w_p
    kept = corners > 0.0
    full = np.block([[A + B @ w_x, B @ w_p], [z_x, z_p - np.diag(corners)]])
    rows = np.r_[np.ones(A.shape[0], dtype=bool), kept]
    return np.asarray(np.linalg.eigvals(full[np.ix_(rows, rows)]))


@settings(max_examples=25, deadline=None)
@given(SEEDS, st.integers(min_value=1, max_value=3))
def test_real_dynamic_perturbation_reaches_the_axis(seed: int, channels: int) -> None:
    loop, margins = random_loop(seed, channels=channels)
    disk = margins.multi_loop
    gains, corners = (np.array([getattr(d, key) for d in disk.dynamics]) for key in ("gain", "corner"))
    if not np.isfinite(disk.frequency) or np.any(np.abs(1.0 - np.abs(gains) / 2.0) < 1e-3):
        return
    poles = poles_with_dynamics(loop, gains, corners, 0.0)
    assert distance(poles, disk.frequency) < 1e-4 * max(1.0, disk.frequency)
    assert distance(poles_with_dynamics(loop, 0.9 * gains, corners, 0.0), disk.frequency) > 1e-5
    # growing from nothing, the perturbation meets the axis at its full size only
    for part in np.linspace(0.0, 0.999, 8):
        assert np.max(poles_with_dynamics(loop, part * gains, corners, 0.0).real) < 0.0


@settings(max_examples=6, deadline=None)
@given(SEEDS, st.integers(min_value=1, max_value=3))
def test_delayed_margins_solve_the_exact_equation(seed: int, channels: int) -> None:
    """det(I + L F) = 0 with the exact delay, for gain, phase and delay; the delayed gate holds just before."""
    loop, margins = random_loop(seed, channels=channels, delayed=True)
    for i, one in enumerate(margins.channels):
        assert one.verified, (seed, one.channel)
        for margin, factor in (
            (one.gain_increase, one.gain_increase.value),
            (one.gain_reduction, one.gain_reduction.value),
            (
                one.delay,
                np.exp(-1j * one.delay.frequency * one.delay.value) if np.isfinite(one.delay.value) else np.nan,
            ),
        ):
            if not np.isfinite(margin.frequency):
                continue
            ratio = return_ratio(loop, margin.frequency)
            perturbed = np.eye(channels) + ratio @ np.diag(one_factor(channels, i, factor))
            assert abs(np.linalg.det(perturbed)) < 1e-6 * max(1.0, np.linalg.norm(ratio) ** channels)
        if np.isfinite(one.delay.value) and one.delay.value > 0.0:
            before, after = loop.delays.copy(), loop.delays.copy()
            before[i] += 0.99 * one.delay.value
            after[i] += 1.01 * one.delay.value
            loop_margins(Loop(loop.A, loop.B, loop.C, loop.D, loop.channels, before))
            with pytest.raises(NotStable):
                loop_margins(Loop(loop.A, loop.B, loop.C, loop.D, loop.channels, after))
