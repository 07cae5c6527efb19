"""Spectral radii without eigenvalues: against high precision, eigenvalue solvers and closed forms."""

from __future__ import annotations

import importlib.util

import mpmath
import numpy as np
import pytest

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.errors import ModelError
from maglev_ctrl.kernels import spectral_radius
from maglev_ctrl.kernels.device import device_engine
from maglev_ctrl.kernels.radius_engines import radius_engine
from maglev_ctrl.kernels.spectral_radius import (
    NumpyRadius,
    RadiusEngine,
    first_power,
    next_power,
    series_rounding,
)

PROMISE = 1e-10


def _engines() -> list[str]:
    return ["numpy", *(["fast"] if importlib.util.find_spec("numba") else [])]


@pytest.fixture(params=_engines())
def engine(request: pytest.FixtureRequest) -> RadiusEngine:
    return radius_engine(request.param)


def one_each(matrices: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Coefficients and basis whose products are exactly these matrices."""
    return np.asarray(matrices, dtype=np.float64), np.eye(len(matrices))


def damped(n: int, count: int, seed: int, *, spread: float = 0.5) -> FloatArray:
    """Monodromy-like matrices: rotations with moduli exp(-0.6) to exp(0.02), turned by a random basis."""
    rng = np.random.default_rng(seed)
    blocks = np.zeros((count, n, n))
    for k in range(0, n - 1, 2):
        modulus, angle = np.exp(rng.uniform(-0.6, 0.02, count)), rng.uniform(0.0, np.pi, count)
        blocks[:, k, k] = blocks[:, k + 1, k + 1] = modulus * np.cos(angle)
        blocks[:, k, k + 1] = modulus * np.sin(angle)
        blocks[:, k + 1, k] = -blocks[:, k, k + 1]
    if n % 2:
        blocks[:, -1, -1] = rng.uniform(-1.0, 1.0, count)
    turn = np.eye(n) + spread * rng.standard_normal((count, n, n)) / np.sqrt(n)
    return np.asarray(turn @ blocks @ np.linalg.inv(turn))


def exact_radius(matrix: FloatArray) -> float:
    """Spectral radius in 40 digits."""
    with mpmath.workdps(40):
        values, _ = mpmath.eig(mpmath.matrix(matrix.tolist()))
        return float(max(abs(v) for v in values))


def wrong_by(found: float, exact: float) -> float:
    return abs(found - exact) / exact


@pytest.mark.parametrize("n", [2, 3, 5, 8, 12])
def test_moduli_are_right_to_the_promise(engine: RadiusEngine, n: int) -> None:
    matrices = damped(n, 8 if n < 6 else 2, seed=n)
    modulus, sure = engine.moduli(*one_each(matrices))
    exact = [exact_radius(m) for m in matrices]
    errors = [wrong_by(a, b) for a, b, s in zip(modulus, exact, sure, strict=True) if s]
    assert max(errors) < PROMISE
    assert np.mean(sure) > 0.8


@pytest.mark.parametrize("n", [2, 4, 6, 9, 12, 20, 40])
def test_moduli_agree_with_eigenvalues_over_a_series(engine: RadiusEngine, n: int) -> None:
    rng = np.random.default_rng(n)
    coefficients = damped(n, 5, seed=3) * np.array([1.0, 0.1, 0.05, 0.02, 0.01])[:, None, None]
    basis = np.concatenate([np.ones((300, 1)), rng.uniform(-1.0, 1.0, (300, 4))], axis=1)
    modulus, sure = engine.moduli(coefficients, basis)
    values = np.abs(engine.multipliers(coefficients, basis))
    # eigenvalues of nearly double roots are themselves no better than this at n = 2
    assert np.max(np.abs(modulus / values - 1.0)) < 1e-9
    assert np.mean(sure) > 0.95
    assert np.median(np.abs(modulus / values - 1.0)) < 1e-13


def test_cluster_of_many_equal_moduli_is_not_called_sure(engine: RadiusEngine) -> None:
    """Undamped modes, and cyclic matrices whose low traces all vanish, cannot be told from two multipliers."""
    angles = np.array([0.3, 0.9, 1.7])
    undamped = np.zeros((6, 6))
    for k, angle in enumerate(angles):
        undamped[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = [
            [np.cos(angle), np.sin(angle)],
            [-np.sin(angle), np.cos(angle)],
        ]
    cyclic = np.zeros((6, 6))
    cyclic[np.arange(5), (np.arange(5) + 1) % 5] = 1.0
    cyclic[5, 5] = 0.9999  # the only multiplier the first four traces see
    modulus, sure = engine.moduli(*one_each(np.array([undamped, cyclic])))
    assert not sure.any()
    assert np.allclose(modulus, 1.0, rtol=1e-12)


def test_hidden_multipliers_are_found_by_the_residual_only(monkeypatch: pytest.MonkeyPatch) -> None:
    """Mutant: without the matrix residual the cyclic matrix is taken for its small real multiplier."""
    cyclic = np.zeros((1, 6, 6))
    cyclic[0, np.arange(5), (np.arange(5) + 1) % 5] = 1.0
    cyclic[0, 5, 5] = 0.9999
    assert not NumpyRadius().moduli(cyclic, np.eye(1))[1][0]

    norm = spectral_radius._norm

    def blind(xp: object, matrices: FloatArray) -> FloatArray:
        return norm(xp, matrices) * (np.max(np.abs(matrices), axis=(1, 2)) > 1e3)

    original = spectral_radius.verified_modulus

    def without_residual(*args: object) -> object:
        monkeypatch.setattr(spectral_radius, "_norm", blind)
        try:
            return original(*args)  # type: ignore[arg-type]
        finally:
            monkeypatch.setattr(spectral_radius, "_norm", norm)

    monkeypatch.setattr(spectral_radius, "verified_modulus", without_residual)
    modulus, sure = NumpyRadius().moduli(cyclic, np.eye(1))
    assert sure[0] and modulus[0] < 0.99995


def test_close_pairs_and_opposite_signs(engine: RadiusEngine) -> None:
    """Two real multipliers 1e-3 apart, a pair of opposite sign, a complex pair close to the real axis."""
    rng = np.random.default_rng(1)
    turn = np.eye(4) + 0.3 * rng.standard_normal((4, 4))
    near_real = np.array([[np.cos(1e-4), np.sin(1e-4)], [-np.sin(1e-4), np.cos(1e-4)]])
    blocks = []
    for pair in (np.diag([1.0, 0.999]), np.diag([0.8, -0.8]), 0.9 * near_real):
        block = np.diag([0.0, 0.0, 0.5, -0.3])
        block[:2, :2] = pair
        blocks.append(turn @ block @ np.linalg.inv(turn))
    matrices = np.array(blocks)
    modulus, sure = engine.moduli(*one_each(matrices))
    for k in range(3):
        assert wrong_by(modulus[k], exact_radius(matrices[k])) < (PROMISE if sure[k] else 1e-7)
    assert sure[0]


def test_jordan_blocks_are_never_sure_and_wrong(engine: RadiusEngine) -> None:
    """A defective leading multiplier loses half the digits in any method; it must not be called sure."""
    rng = np.random.default_rng(5)
    turn = np.linalg.qr(rng.standard_normal((4, 4)))[0]
    for size in (2, 3, 4):
        block = np.diag([0.9] * size + [0.2] * (4 - size)) + np.diag([1.0] * (size - 1) + [0.0] * (4 - size), 1)
        matrix = turn @ block @ turn.T
        modulus, sure = engine.moduli(*one_each(matrix[None]))
        assert wrong_by(modulus[0], exact_radius(matrix)) < PROMISE or not sure[0]
        assert wrong_by(modulus[0], 0.9) < 1e-3


def test_projectors_that_cancel_at_one_level_do_not_hide_the_condition(engine: RadiusEngine) -> None:
    """Complex pairs of condition 2000: after some squarings P looks like the identity, and its norm tells nothing."""
    rng = np.random.default_rng(17)
    angle, modulus = rng.uniform(0.0, np.pi, 30_000), rng.uniform(0.5, 1.0, 30_000)
    turn = np.array([[1.0, 1.0], [1.0, 1.002]])
    blocks = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]).transpose(2, 0, 1)
    matrices = turn @ (modulus[:, None, None] * blocks) @ np.linalg.inv(turn)
    a, b, c, d = (matrices[:, i, j].astype(np.longdouble) for i, j in ((0, 0), (0, 1), (1, 0), (1, 1)))
    distance = (a - d) ** 2 + 4.0 * b * c
    pairs = distance < 0.0
    exact = np.sqrt(np.abs(a * d - b * c))
    basis = matrices.reshape(-1, 4)
    found, sure = engine.moduli(np.eye(4).reshape(4, 2, 2), basis)
    error = np.abs(found / exact - 1.0)[sure & pairs]
    assert len(error) > 50
    assert np.max(error) < PROMISE


def test_not_normal_matrices(engine: RadiusEngine) -> None:
    """Large transient growth costs digits: what is still sure is right."""
    rng = np.random.default_rng(11)
    matrices = np.array([damped(6, 1, seed=k, spread=3.0)[0] + np.triu(10.0**k * np.ones((6, 6)), 3) for k in range(6)])
    turn = np.linalg.qr(rng.standard_normal((6, 6)))[0]
    upper = np.array([turn @ (np.diag(rng.uniform(0.1, 1, 6)) + 10.0**k * np.eye(6, k=1)) @ turn.T for k in range(5)])
    modulus, sure = engine.moduli(*one_each(np.concatenate([matrices, upper])))
    for value, certain, matrix in zip(modulus, sure, np.concatenate([matrices, upper]), strict=True):
        if certain:
            assert wrong_by(value, exact_radius(matrix)) < PROMISE


@pytest.mark.parametrize("scale", [1e-300, 1e-250, 1e-150, 1e150, 1e250, 1e300])
def test_huge_and_tiny_matrices(engine: RadiusEngine, scale: float) -> None:
    matrices = damped(4, 6, seed=2)
    one, sure = engine.moduli(*one_each(matrices))
    scaled, also = engine.moduli(*one_each(scale * matrices))
    assert np.array_equal(sure, also)
    assert np.max(np.abs(scaled[sure] / scale / one[sure] - 1.0)) < 1e-12
    assert (engine.decide(*one_each(scale * matrices), 0.5 * scale * one.min(), 2.0 * scale * one.max()) == 0).all()
    assert (engine.decide(*one_each(scale * matrices), 2.0 * scale * one.max(), np.inf) == -1).all()
    assert (engine.decide(*one_each(scale * matrices), 0.0, 0.5 * scale * one.min()) == 1).all()


def test_zero_nilpotent_and_not_finite(engine: RadiusEngine) -> None:
    matrices = np.zeros((5, 4, 4))
    matrices[1] = np.diag([1.0, 2.0, 3.0], 1)
    matrices[2, 0, 0], matrices[3, 1, 2] = np.nan, np.inf
    matrices[4] = 0.5 * np.eye(4)
    basis = np.eye(5)
    modulus, sure = np.empty(5), np.empty(5, dtype=bool)
    for k in range(5):  # one by one, because a NaN spreads over a product of all coefficients
        modulus[k : k + 1], sure[k : k + 1] = engine.moduli(matrices[k : k + 1], np.ones((1, 1)))
    assert modulus[0] == 0.0 and sure[0]
    assert modulus[1] < 1e-3 and not sure[1]
    assert np.isnan(modulus[2:4]).all() and not sure[2:4].any()
    assert modulus[4] == 0.5
    found = [int(engine.decide(matrices[k : k + 1], np.ones((1, 1)), 0.9, 1.1)[0]) for k in range(5)]
    assert found == [-1, -1, 0, 0, -1]
    assert np.isnan(engine.multipliers(matrices, basis)).all()
    assert engine.multipliers(matrices[4:], np.ones((1, 1)))[0] == 0.5


@pytest.mark.parametrize("n", [2, 4, 7, 12, 20])
def test_decisions_are_right_and_nearly_complete(engine: RadiusEngine, n: int) -> None:
    matrices = damped(n, 400, seed=n + 100)
    exact = np.max(np.abs(np.linalg.eigvals(matrices)), axis=1)
    matrices /= np.where(np.arange(400) % 2, exact, 1.0)[:, None, None]
    matrices[1::2] *= (1.0 + np.logspace(-9, -1, 200) * np.where(np.arange(200) % 2, 1.0, -1.0))[:, None, None]
    radius = np.max(np.abs(np.linalg.eigvals(matrices)), axis=1)
    found = engine.decide(*one_each(matrices), 1.0, 1.0)
    clear = np.abs(radius - 1.0) > 1e-11
    assert not np.any((found == 1) & (radius < 1.0) & clear)
    assert not np.any((found == -1) & (radius > 1.0) & clear)
    assert np.mean(found[np.abs(radius - 1.0) > 1e-3] != 0) > 0.99
    assert np.mean(found[np.abs(radius - 1.0) > 1e-6] != 0) > 0.9


def test_exactly_neutral_systems_stay_undecided(engine: RadiusEngine) -> None:
    angles = np.linspace(0.1, 3.0, 30)
    matrices = np.zeros((30, 4, 4))
    matrices[:, 0, 0] = matrices[:, 1, 1] = np.cos(angles)
    matrices[:, 0, 1], matrices[:, 1, 0] = np.sin(angles), -np.sin(angles)
    matrices[:, 2, 2] = 0.5
    assert (engine.decide(*one_each(matrices), 1.0 - 1e-12, 1.0 + 1e-12) == 0).all()
    assert (engine.decide(*one_each(matrices), 1.0, 1.0) == 0).all()


def test_levels_within_the_rounding_of_the_series_stay_undecided(engine: RadiusEngine) -> None:
    """Two huge coefficients that cancel leave a matrix known to 1e-4 only."""
    small = damped(4, 1, seed=9)[0]
    small /= np.max(np.abs(np.linalg.eigvals(small)))
    coefficients = np.array([1e12 * np.eye(4), small, 1e12 * np.eye(4)])
    basis = np.array([[1.0, 1.0, -1.0]])
    assert engine.decide(coefficients, basis, 1.0 - 1e-6, 1.0 + 1e-6)[0] == 0
    assert engine.decide(coefficients, basis, 1.2, 1.3)[0] == -1


def test_error_of_powers_is_bounded() -> None:
    """The bound E_k holds against 60 digits, and is not more than a few orders too wide."""
    matrices = damped(5, 4, seed=21)
    powers = first_power(np, matrices, series_rounding(*one_each(matrices)))
    with mpmath.workdps(60):
        exact = [mpmath.matrix(m.tolist()) for m in matrices]
        for _ in range(9):
            for k, matrix in enumerate(exact):
                scale = mpmath.mpf(2) ** int(powers.exponent[k])
                held = mpmath.matrix(powers.matrix[k].tolist())
                difference = mpmath.sqrt(sum(abs(x) ** 2 for x in (matrix / scale - held)))
                assert difference <= powers.error[k]
            powers = next_power(np, powers)
            exact = [m * m for m in exact]
    assert np.max(powers.error) < 1e-3


def test_forgotten_rounding_mutant_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the rounding terms a neutral system whose rounded powers shrink is "proved" stable."""
    rng = np.random.default_rng(0)
    turn = np.eye(6) + 0.4 * rng.standard_normal((200, 6, 6))
    angles = np.array([0.4, 1.1, 2.3])
    block = np.zeros((6, 6))
    for k, angle in enumerate(angles):
        block[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = [
            [np.cos(angle), np.sin(angle)],
            [-np.sin(angle), np.cos(angle)],
        ]
    matrices = turn @ block @ np.linalg.inv(turn)
    assert (NumpyRadius().decide(*one_each(matrices), 1.0, 1.0) == 0).all()
    monkeypatch.setattr(spectral_radius, "ROUNDING", 0.0)
    monkeypatch.setattr(spectral_radius, "TINY", 0.0)
    assert (NumpyRadius().decide(*one_each(matrices), 1.0, 1.0) != 0).any()


def test_missing_dimension_mutant_is_caught(engine: RadiusEngine) -> None:
    """The trace proof needs |tr M^N| > n r^N: with r^N alone, four stable multipliers 0.9 would count as unstable."""
    matrices = np.array([0.9 * np.eye(4)])
    assert engine.decide(*one_each(matrices), 1e-9, 1.0)[0] == 0
    assert abs(np.trace(matrices[0])) > 1.0


def test_multipliers_are_leading_with_rising_phase(engine: RadiusEngine) -> None:
    found = engine.multipliers(*one_each(np.array([[[0.0, 1.0], [-4.0, 0.0]], [[-3.0, 0.0], [0.0, 2.0]]])))
    assert np.allclose(found, [2.0j, -3.0])


def test_no_points(engine: RadiusEngine) -> None:
    none = np.empty((0, 1))
    assert engine.moduli(np.eye(3)[None], none)[0].shape == (0,)
    assert engine.decide(np.eye(3)[None], none, 1.0, 1.0).shape == (0,)
    assert engine.multipliers(np.eye(3)[None], none).shape == (0,)


def test_one_by_one_matrices(engine: RadiusEngine) -> None:
    coefficients, basis = np.ones((1, 1, 1)), np.array([[0.5], [-2.0], [0.0]])
    modulus, sure = engine.moduli(coefficients, basis)
    assert np.allclose(modulus, [0.5, 2.0, 0.0], rtol=1e-12) and sure[2]
    assert engine.decide(coefficients, basis, 1.0, 1.0).tolist() == [-1, 1, -1]


@pytest.mark.parametrize(
    ("coefficients", "basis", "words"),
    [
        (np.ones((2, 3)), np.ones((1, 2)), "coefficients: expected shape"),
        (np.ones((2, 3, 4)), np.ones((1, 2)), "coefficients: expected shape"),
        (np.ones((2, 3, 3)), np.ones((1, 3)), "basis: expected shape"),
    ],
)
def test_wrong_shapes_are_refused(coefficients: FloatArray, basis: FloatArray, words: str) -> None:
    for call in (NumpyRadius().moduli, NumpyRadius().multipliers):
        with pytest.raises(ValueError, match=words):
            call(coefficients, basis)


def test_levels_out_of_order_are_refused(engine: RadiusEngine) -> None:
    for levels in ((1.1, 0.9), (np.nan, 1.0)):
        with pytest.raises(ValueError, match="stable_below"):
            engine.decide(np.eye(2)[None], np.ones((1, 1)), *levels)


def test_unknown_engine_is_refused() -> None:
    with pytest.raises(ValueError, match="expected numpy, fast or gpu, got 'cuda'"):
        radius_engine("cuda")  # type: ignore[arg-type]


class TestDevice:
    """The array functions on a JAX device; its processor serves where there is no other."""

    def test_moduli_and_decisions_equal_those_of_numpy(self) -> None:
        jax = pytest.importorskip("jax", reason="JAX (extra gpu) is not installed: the device engine is not tested")
        before = jax.config.jax_enable_x64
        try:
            self._compare(device_engine(jax.default_backend()))
        finally:
            jax.config.update("jax_enable_x64", before)

    @staticmethod
    def _compare(device: RadiusEngine) -> None:
        matrices = damped(6, 40, seed=4)
        matrices[7] = 0.0
        matrices[8] = np.eye(6)
        reference = NumpyRadius()
        modulus, sure = device.moduli(*one_each(matrices))
        expected, also = reference.moduli(*one_each(matrices))
        assert np.array_equal(sure, also)
        assert np.allclose(modulus, expected, rtol=1e-12)
        found = device.decide(*one_each(matrices), 1.0 - 1e-9, 1.0 + 1e-9)
        assert np.array_equal(found, reference.decide(*one_each(matrices), 1.0 - 1e-9, 1.0 + 1e-9))
        assert device.moduli(matrices[:1], np.empty((0, 1)))[0].shape == (0,)

    def test_no_device_is_one_sentence(self) -> None:
        jax = pytest.importorskip("jax", reason="JAX (extra gpu) is not installed: no device can be asked for")
        if jax.default_backend() == "gpu":
            pytest.skip("there is a device here")
        with pytest.raises(ModelError, match=r"^backend gpu: JAX finds no gpu device on this machine; use .* fast$"):
            radius_engine("gpu")

    def test_no_jax_is_one_sentence(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setitem(__import__("sys").modules, "jax", None)
        with pytest.raises(ModelError, match=r'^backend gpu: JAX is not installed; .*"maglev-ctrl\[gpu\]"'):
            radius_engine("gpu")
