"""Compiled loops of the `fast` extra against their NumPy equivalents, and what is said where numba is missing."""

from __future__ import annotations

import importlib.util
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.errors import ModelError
from maglev_ctrl.kernels import compiled
from maglev_ctrl.kernels.accelerated import FastRadius, monodromy_many
from maglev_ctrl.kernels.radius_engines import radius_engine
from maglev_ctrl.kernels.radius_lanes import LANES_UP_TO, block_size
from maglev_ctrl.kernels.spectral_radius import NumpyRadius
from maglev_ctrl.kernels.taylor import monodromy_over_depths, taylor_plan

needs_numba = pytest.mark.skipif(
    importlib.util.find_spec("numba") is None, reason="numba (extra fast) is not installed: compiled loops not tested"
)


def systems(n: int, count: int, harmonics: int, seed: int = 0) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Random second-order systems, modulated in a few columns."""
    rng = np.random.default_rng(seed)
    half = n // 2
    A_0, cosine = np.zeros((count, n, n)), np.zeros((count, harmonics, n, n))
    A_0[:, :half, half:] = np.eye(half)
    A_0[:, half:, :half] = -np.eye(half) * np.linspace(0.8, 1.6, half) + 0.1 * rng.standard_normal((count, half, half))
    A_0[:, half:, half:] = -0.05 * np.eye(half)
    sine = cosine.copy()
    cosine[..., half:, 0] = 0.2 * rng.standard_normal((count, harmonics, half))
    sine[..., half:, half - 1] = 0.2 * rng.standard_normal((count, harmonics, half))
    return A_0, cosine, sine, rng.uniform(1.0, 2.5, count)


@needs_numba
@pytest.mark.parametrize(("n", "harmonics"), [(2, 1), (4, 3), (6, 2), (12, 1), (20, 2)])
def test_monodromy_equals_that_of_numpy(n: int, harmonics: int) -> None:
    A_0, cosine, sine, frequency = systems(n, 5, harmonics)
    norms = np.max(np.linalg.norm(cosine, 2, axis=(2, 3)) + np.linalg.norm(sine, 2, axis=(2, 3)), axis=0)
    worst = float(np.max(np.linalg.norm(A_0, 2, axis=(1, 2))))
    plan = taylor_plan(worst, norms, frequency=float(frequency.min()), tolerance=1e-15)
    found = monodromy_many(A_0, cosine, sine, frequency, plan.segments, plan.order)
    for k in range(5):
        expected = monodromy_over_depths(
            A_0[k], cosine[k], sine[k], frequency=float(frequency[k]), depths=np.ones(1), plan=plan
        )[0]
        assert np.max(np.abs(found[k] - expected)) < 1e-13 * np.max(np.abs(expected))


@needs_numba
def test_monodromy_of_constant_systems_is_the_exponential() -> None:
    A_0, cosine, _, frequency = systems(6, 4, 2)
    for harmonics in (0, 2):
        none = np.zeros_like(cosine[:, :harmonics])
        found = monodromy_many(A_0, none, none, frequency, 12, 24)
        for k in range(4):
            expected = expm(2.0 * np.pi / frequency[k] * A_0[k])
            assert np.max(np.abs(found[k] - expected)) < 1e-12 * np.max(np.abs(expected))


def _integrated(A_0: FloatArray, cosine: FloatArray, sine: FloatArray, frequency: float) -> FloatArray:
    n = len(A_0)
    h = np.arange(1, len(cosine) + 1)[:, None, None]

    def rate(t: float, x: FloatArray) -> FloatArray:
        turned = np.sum(cosine * np.cos(h * frequency * t) + sine * np.sin(h * frequency * t), axis=0)
        return np.asarray(((A_0 + turned) @ x.reshape(n, n)).ravel())

    end = solve_ivp(rate, (0.0, 2.0 * np.pi / frequency), np.eye(n).ravel(), method="DOP853", rtol=1e-12, atol=1e-14)
    return np.asarray(end.y[:, -1].reshape(n, n))


@needs_numba
def test_monodromy_against_an_integrator_and_sign_mutants_are_caught() -> None:
    A_0, cosine, sine, frequency = systems(4, 1, 2, seed=3)
    expected = _integrated(A_0[0], cosine[0], sine[0], float(frequency[0]))
    found = monodromy_many(A_0, cosine, sine, frequency, 16, 24)[0]
    assert np.max(np.abs(found - expected)) < 1e-10
    mutants = ((A_0, cosine, -sine), (A_0, cosine[:, ::-1], sine), (A_0, -cosine, sine), (A_0, cosine, sine[:, ::-1]))
    for mutant in mutants:
        assert np.max(np.abs(monodromy_many(*mutant, frequency, 16, 24)[0] - expected)) > 1e-3


@needs_numba
def test_monodromy_does_not_depend_on_segments_beyond_its_tolerance() -> None:
    args = systems(6, 3, 3, seed=8)
    fine = monodromy_many(*args, 61, 30)
    for segments in (17, 24, 40):
        assert np.max(np.abs(monodromy_many(*args, segments, 34) - fine)) < 1e-12 * np.max(np.abs(fine))


@needs_numba
def test_monodromy_refuses_what_does_not_fit() -> None:
    A_0, cosine, sine, frequency = systems(4, 2, 1)
    with pytest.raises(ValueError, match="A_0, A_cos, A_sin, frequency: expected shapes"):
        monodromy_many(A_0, cosine, sine[:1], frequency, 8, 8)
    with pytest.raises(ValueError, match=r"A_cos: expected shape \(2, H, 4, 4\)"):
        monodromy_many(A_0, cosine[:, 0], sine[:, 0], frequency, 8, 8)
    with pytest.raises(ValueError, match="segments, order: expected at least 1, got 0 and 8"):
        monodromy_many(A_0, cosine, sine, frequency, 0, 8)


@needs_numba
def test_monodromy_of_a_system_that_is_not_finite_is_not_finite() -> None:
    A_0, cosine, sine, frequency = systems(4, 3, 1)
    A_0[1, 2, 2] = np.nan
    found = monodromy_many(A_0, cosine, sine, frequency, 10, 20)
    assert np.isnan(found[1]).any()
    assert np.isfinite(found[[0, 2]]).all()


@needs_numba
@pytest.mark.parametrize("n", [1, 2, 3, 5, LANES_UP_TO, LANES_UP_TO + 1, 13])
@pytest.mark.parametrize("count", [1, 7, 129, 300])
def test_fast_engine_equals_numpy(n: int, count: int) -> None:
    """Whatever the number of matrices leaves in the last block, and on both sides of the change to BLAS."""
    rng = np.random.default_rng(n + count)
    coefficients = rng.standard_normal((4, n, n)) / np.sqrt(n)
    basis = rng.uniform(-0.7, 0.7, (count, 4))
    fast, plain = FastRadius(), NumpyRadius()
    modulus, sure = fast.moduli(coefficients, basis)
    expected, also = plain.moduli(coefficients, basis)
    assert np.max(np.abs(modulus - expected) / expected) < 1e-9
    assert np.mean(sure != also) < 0.02
    found = fast.decide(coefficients, basis, 1.0 - 1e-9, 1.0 + 1e-9)
    assert np.array_equal(found, plain.decide(coefficients, basis, 1.0 - 1e-9, 1.0 + 1e-9))


@needs_numba
def test_a_matrix_that_is_not_finite_does_not_disturb_its_neighbours() -> None:
    rng = np.random.default_rng(1)
    matrices = rng.standard_normal((20, 4, 4))
    basis = np.eye(20)
    basis[3] = np.nan
    fast = FastRadius()
    modulus, sure = fast.moduli(matrices, basis)
    clean = fast.moduli(matrices, np.eye(20))[0]
    others = np.arange(20) != 3
    assert np.isnan(modulus[3]) and not sure[3]
    assert np.allclose(modulus[others], clean[others], rtol=1e-12)
    decisions = fast.decide(matrices, basis, 1.0, 1.0)
    assert decisions[3] == 0 and np.all(decisions[others] != 0)


@needs_numba
def test_threads_get_the_same_answers() -> None:
    rng = np.random.default_rng(2)
    coefficients, basis = rng.standard_normal((3, 6, 6)) * 0.3, rng.uniform(-1.0, 1.0, (800, 3))
    fast = radius_engine("fast")
    alone = fast.moduli(coefficients, basis)[0]
    with ThreadPoolExecutor(2) as pool:
        parts = list(pool.map(lambda rows: fast.moduli(coefficients, rows)[0], np.split(basis, 4)))
    assert np.allclose(np.concatenate(parts), alone, rtol=1e-12)


def test_blocks_fit_the_cache() -> None:
    assert block_size(LANES_UP_TO + 1) == 1
    assert [block_size(n) for n in (1, 4, 8)] == [128, 128, 64]


def test_no_numba_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compiled, "njit", None)
    with pytest.raises(ModelError, match=r'^backend fast: numba is not installed; .*"maglev-ctrl\[fast\]".*numpy$'):
        radius_engine("fast")
    with pytest.raises(ModelError, match="numba is not installed"):
        monodromy_many(np.eye(2)[None], np.zeros((1, 0, 2, 2)), np.zeros((1, 0, 2, 2)), np.ones(1), 2, 4)


def test_source_of_compiled_loops_runs_without_numba(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compiled, "njit", None)

    def twice(x: float) -> float:
        return 2.0 * x

    assert compiled.compiled(twice) is twice
    assert compiled.compiled_sum(twice) is twice
