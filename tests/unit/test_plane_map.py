"""Maps over two parameters: equal to single Floquet analyses within their bounds, verified, resumable, in rows."""

from __future__ import annotations

import tracemalloc
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

import maglev_ctrl.analysis.plane_panels as panel_module
import maglev_ctrl.analysis.stability_plane as plane_module
from maglev_ctrl.analysis.floquet import floquet
from maglev_ctrl.analysis.plane_panels import build_panels
from maglev_ctrl.analysis.plane_pixels import judge
from maglev_ctrl.analysis.plane_records import (
    NO_ANSWER,
    STABLE,
    UNRESOLVED,
    UNSTABLE,
    Coverage,
    MapAxis,
    StabilityPlane,
)
from maglev_ctrl.analysis.resonance_map import resonance_map
from maglev_ctrl.analysis.stability_plane import NothingKept, estimate, stability_plane
from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.errors import Agreement, ModelError, OutOfDomain
from maglev_ctrl.kernels.plane_series import Tails
from maglev_ctrl.systems import PeriodicSystem, SecondOrderSystem

SYSTEM = SecondOrderSystem.from_matrices(np.eye(2), np.diag([0.02, 0.03]), np.diag([1.0, 2.89]))
A_0 = SYSTEM.state_matrix()
A_1 = SYSTEM.modulated_state_matrix(np.array([[0.5, 0.4], [0.3, 0.6]]))
SPEED = MapAxis("speed", np.linspace(1.2, 3.9, 61), reciprocal=True)
DEPTH = MapAxis("depth", np.linspace(0.0, 0.5, 31), linear=True)


def pair(W: float, depth: float) -> PeriodicSystem:
    return PeriodicSystem.from_matrices(A_0, depth * A_1[None], frequency=W)


def stiffened(W: float, stiffness: float) -> PeriodicSystem:
    """Not linear in the second parameter: damping and stiffness change with it; the frequency does too."""
    system = SecondOrderSystem.from_matrices(
        np.eye(2), np.diag([0.02, 0.03]) * stiffness**2, np.diag([1.0, 2.89 * stiffness])
    )
    modulation = 0.4 * system.modulated_state_matrix(np.array([[0.5, 0.4], [0.3, 0.6]]))
    return PeriodicSystem.from_matrices(system.state_matrix(), modulation[None], frequency=W / stiffness)


@pytest.fixture(scope="module")
def plane() -> StabilityPlane:
    return stability_plane(pair, SPEED, DEPTH)


def same(one: StabilityPlane, other: StabilityPlane) -> bool:
    arrays = ("growth", "growth_error", "state", "interpolated", "tongue_index", "checked", "check_difference")
    return all(np.array_equal(getattr(one, a), getattr(other, a), equal_nan=True) for a in arrays)


def test_map_equals_floquet_within_its_bound(plane: StabilityPlane) -> None:
    rng = np.random.default_rng(1)
    for i, j in rng.integers(0, (61, 31), (40, 2)):
        single = floquet(pair(SPEED.values[i], DEPTH.values[j]))
        assert abs(single.growth_rate - plane.growth[i, j]) <= plane.growth_error[i, j] + single.growth_error
    assert np.max(plane.growth_error) < 1e-6
    assert np.median(plane.growth_error) < 1e-9
    assert plane.integrated < 0.5 * plane.evaluated


def test_map_equals_the_map_over_depths(plane: StabilityPlane) -> None:
    count = len(SPEED.values)
    older = resonance_map(
        np.broadcast_to(A_0, (count, 4, 4)), np.broadcast_to(A_1, (count, 1, 4, 4)), np.zeros((count, 1, 4, 4)),
        SPEED.values, DEPTH.values, parameter=SPEED.values, seeds=False,
    )  # fmt: skip
    assert np.array_equal(plane.state == UNSTABLE, older.unstable)
    assert np.max(np.abs(plane.growth - older.growth_rate)) < 1e-8
    assert [t.name for t in plane.tongues] == [t.name for t in older.tongues]
    assert np.array_equal(plane.tongue_index, older.tongue_index)


def test_map_is_verified_by_hill(plane: StabilityPlane) -> None:
    assert len(plane.checked) >= 24
    assert np.max(plane.check_difference) < 1e-7
    assert plane.share(UNRESOLVED) == 0.0
    assert plane.tongue_index.dtype == np.int16


def test_any_two_parameters() -> None:
    x = MapAxis("speed", np.linspace(1.5, 3.0, 40), reciprocal=True)
    y = MapAxis("stiffness", np.linspace(0.7, 1.6, 30))
    found = stability_plane(stiffened, x, y)
    rng = np.random.default_rng(2)
    for i, j in rng.integers(0, (40, 30), (25, 2)):
        single = floquet(stiffened(x.values[i], y.values[j]))
        assert abs(single.growth_rate - found.growth[i, j]) <= found.growth_error[i, j] + single.growth_error
    assert 0.02 < found.share(UNSTABLE) < 0.9


def test_axes_may_be_exchanged(plane: StabilityPlane) -> None:
    turned = stability_plane(lambda depth, W: pair(W, depth), DEPTH, SPEED)
    assert turned.x.name == "depth"
    assert np.array_equal(turned.state.T, plane.state)
    assert np.array_equal(turned.growth.T, plane.growth)
    assert turned.missed_width == pytest.approx(0.5 / 30)


def test_threads_change_nothing(plane: StabilityPlane, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plane_module, "_CHUNK", 200)
    told: list[float] = []
    found = stability_plane(pair, SPEED, DEPTH, threads=2, progress=lambda text, share: told.append(share))
    assert np.array_equal(found.state, plane.state)
    assert np.allclose(found.growth, plane.growth, atol=1e-12)
    assert told == sorted(told)
    assert told[-1] == 1.0


@pytest.mark.parametrize("coverage", ["every", "adaptive"])
def test_moduli_without_eigenvalues_give_the_same_map(plane: StabilityPlane, coverage: Coverage) -> None:
    pytest.importorskip("numba")
    found = stability_plane(pair, SPEED, DEPTH, backend="fast", coverage=coverage)
    computed = ~found.interpolated
    assert np.array_equal(found.state, plane.state)
    apart = np.abs(found.growth - plane.growth)
    assert np.all(apart[computed] <= (found.growth_error + plane.growth_error)[computed])
    if coverage == "every":
        assert np.all(found.growth_error * 2.0 * np.pi / SPEED.values[:, None] >= 1e-10)  # the engine's own error is in


def test_bound_of_a_wrong_series_is_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """Mutant: integration that is wrong by one part in 1e5; Hill's method disagrees and the map is unresolved."""
    honest = panel_module.monodromy_many

    def wrong(A_0: FloatArray, A_cos: FloatArray, A_sin: FloatArray, **named: FloatArray):
        return honest(A_0 * (1.0 + 1e-5), A_cos, A_sin, **named)

    monkeypatch.setattr(panel_module, "monodromy_many", wrong)
    found = stability_plane(pair, SPEED, DEPTH)
    assert found.share(UNRESOLVED) == 1.0
    assert np.max(found.check_difference) > 1e-7


def test_tail_that_lies_is_found_out_at_points_that_are_no_nodes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Mutant: seven nodes and a tail that claims to be zero. Probing in between refuses it; without, it passes."""
    x = MapAxis("speed", np.linspace(1.5, 3.0, 30), reciprocal=True)
    y = MapAxis("stiffness", np.linspace(0.7, 1.6, 30))
    honest = panel_module.plane_series
    monkeypatch.setattr(panel_module, "bessel_terms", lambda phase: 7)
    monkeypatch.setattr(
        panel_module, "plane_series", lambda values, **named: replace(honest(values, **named), error=0.0)
    )
    monkeypatch.setattr(panel_module, "tails", lambda coefficients: Tails(0.0, 0.0, 1.0))
    places = np.random.default_rng(3).integers(0, 30, (20, 2))
    single = [floquet(stiffened(x.values[i], y.values[j])) for i, j in places]

    def worst() -> float:
        found = stability_plane(stiffened, x, y, checks=0)
        return max(abs(one.growth_rate - found.growth[i, j]) for one, (i, j) in zip(single, places, strict=True))

    assert worst() < 1e-9
    monkeypatch.setattr(panel_module._Source, "verified", lambda *args: True)
    assert worst() > 1e-6


def test_a_kink_is_computed_pixel_by_pixel_beside_it() -> None:
    """A controller table with a corner at x = 1.47: panels shrink towards it, the answer stays right."""

    def kinked(x: float, y: float) -> PeriodicSystem:
        gain = 1.0 + 0.5 * max(0.0, x - 1.47)
        return PeriodicSystem.from_matrices([[0, 1], [-gain, -0.1]], [[[0, 0], [-y, 0]]], frequency=2.1)

    x, y = MapAxis("x", np.linspace(1.0, 2.0, 80)), MapAxis("depth", np.linspace(0.0, 0.5, 40), linear=True)
    found = stability_plane(kinked, x, y)
    panels = list(build_panels(kinked, x, y, store=NothingKept(), prefix=""))
    assert len(panels) > 2
    assert sum(p.rectangle.pixels for p in panels) == 80 * 40
    for i in (38, 39, 40, 41, 60):
        single = floquet(kinked(x.values[i], y.values[25]))
        assert abs(single.growth_rate - found.growth[i, 25]) <= found.growth_error[i, 25] + single.growth_error
    assert found.share(UNRESOLVED) < 0.01


@pytest.mark.parametrize("fault", [ModelError, OutOfDomain])
def test_points_without_an_answer(fault: type[Exception]) -> None:
    def partial(W: float, depth: float) -> PeriodicSystem:
        if W + depth > 3.0:
            raise fault("speed: the force table ends at 3 m/s")
        return pair(W, depth)

    found = stability_plane(partial, SPEED, DEPTH)
    W, depth = np.meshgrid(SPEED.values, DEPTH.values, indexing="ij")
    assert np.array_equal(found.state == NO_ANSWER, W + depth > 3.0)
    assert np.array_equal(np.isnan(found.growth), W + depth > 3.0)
    assert found.faults == ("speed: the force table ends at 3 m/s",)
    whole = stability_plane(pair, SPEED, DEPTH)
    answered = found.state != NO_ANSWER
    assert np.array_equal(found.state[answered], whole.state[answered])


def test_no_answer_anywhere() -> None:
    def never(x: float, y: float) -> PeriodicSystem:
        raise ModelError("gap: no equilibrium")

    axis = MapAxis("x", np.linspace(0.0, 1.0, 12))
    found = stability_plane(never, axis, axis)
    assert np.all(found.state == NO_ANSWER)
    assert found.tongues == ()
    assert len(found.checked) == 0


def test_undamped_system_is_not_called_unstable_by_rounding() -> None:
    def undamped(W: float, depth: float) -> PeriodicSystem:
        return PeriodicSystem.from_matrices([[0, 1], [-1, 0]], [[[0, 0], [-depth, 0]]], frequency=W)

    x = MapAxis("W", np.linspace(2.4, 3.0, 31), reciprocal=True)
    found = stability_plane(undamped, x, MapAxis("depth", np.linspace(0.0, 0.1, 11), linear=True))
    assert np.all(found.state == STABLE)


def test_bound_straddling_zero_is_unresolved() -> None:
    """Damped, but by less than the bound: neither stable nor unstable."""
    growth = np.array([-1e-12, 1e-12, -1e-3])
    assert judge(growth, np.full(3, 1e-10), np.zeros(3, dtype=bool), np.ones(3)).tolist() == [0, 0, -1]


class Interrupted:
    """A store that stops the map after so many parts."""

    def __init__(self, parts: int) -> None:
        self.kept: dict[str, dict[str, FloatArray]] = {}
        self.left = parts
        self.written: list[str] = []

    def get(self, key: str) -> Mapping[str, FloatArray] | None:
        return self.kept.get(key)

    def put(self, key: str, arrays: Mapping[str, FloatArray]) -> None:
        if self.left == 0:
            raise KeyboardInterrupt
        self.left -= 1
        self.written.append(key)
        self.kept[key] = {name: np.array(values) for name, values in arrays.items()}


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("coverage", ["every", "adaptive"])
def test_interrupted_map_goes_on_where_it_was(
    threads: int, coverage: Coverage, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(plane_module, "_CHUNK", 300)
    calls: list[tuple[float, float]] = []

    def counted(W: float, depth: float) -> PeriodicSystem:
        calls.append((W, depth))
        return pair(W, depth)

    whole = stability_plane(counted, SPEED, DEPTH, coverage=coverage, threads=threads)
    all_calls = len(calls)
    store = Interrupted(2)
    with pytest.raises(KeyboardInterrupt):
        stability_plane(counted, SPEED, DEPTH, coverage=coverage, threads=threads, store=store)
    assert len(store.kept) == 2
    finished = list(store.written)
    store.left = -1
    calls.clear()
    resumed = stability_plane(counted, SPEED, DEPTH, coverage=coverage, threads=threads, store=store)
    assert same(resumed, whole)
    assert len(set(store.written)) == len(store.written)
    assert set(finished) <= set(store.written)
    assert len(calls) < 0.6 * all_calls  # the panel's nodes were not asked for again
    store.written.clear()
    again = stability_plane(counted, SPEED, DEPTH, coverage=coverage, threads=threads, store=store)
    assert same(again, whole)
    assert store.written == []


def test_memory_does_not_grow_with_the_stack_of_matrices() -> None:
    """The matrices of all pixels would take rows * columns * n^2 numbers; only a chunk of rows is ever held."""
    x = MapAxis("speed", np.linspace(1.2, 3.9, 300), reciprocal=True)
    y = MapAxis("depth", np.linspace(0.0, 0.5, 300), linear=True)
    tracemalloc.start()
    stability_plane(pair, x, y, coverage="every", checks=0)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    own = 300 * 300 * 120  # bytes of the map's arrays and of naming its regions
    assert peak < own + 40e6


def test_estimate_counts_points_and_memory() -> None:
    found = estimate(pair, SPEED, DEPTH)
    assert found.points == 61 * 31
    assert 0.0 < found.seconds < 60.0
    big = MapAxis("speed", np.linspace(1.2, 3.9, 2000), reciprocal=True)
    many = estimate(pair, big, MapAxis("depth", np.linspace(0.0, 0.5, 2000), linear=True))
    assert many.points == 4_000_000
    assert many.seconds > found.seconds
    assert many.bytes < 4 * 2**30


@pytest.mark.parametrize(
    ("axis", "coverage", "message"),
    [
        (MapAxis("speed", np.array([2.0, 1.0])), "auto", "speed: expected ascending values"),
        (MapAxis("speed", np.array([0.0, 1.0]), reciprocal=True), "auto", "speed: expected positive values"),
        (MapAxis("speed", np.array([1.0, np.nan])), "auto", "speed: every entry must be finite"),
        (MapAxis("speed", np.array([1.0, 2.0])), "all", "coverage: expected auto, every or adaptive"),
    ],
)
def test_wrong_input_is_refused(axis: MapAxis, coverage: Coverage, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        stability_plane(pair, axis, DEPTH, coverage=coverage)


def test_growth_of_its_own_is_no_tongue() -> None:
    """Below zero damping everything grows by itself; the tongue that reaches above keeps its name all the way."""

    def family(frequency: float, damping: float) -> PeriodicSystem:
        return PeriodicSystem.from_matrices([[0, 1], [-1, -damping]], [[[0, 0], [-0.3, 0]]], frequency=frequency)

    x, y = MapAxis("frequency", np.linspace(1.6, 2.8, 61)), MapAxis("damping", np.linspace(-0.02, 0.2, 45))
    plane = stability_plane(family, x, y)
    names = np.array([tongue.name for tongue in plane.tongues])

    def named(frequency: float, damping: float) -> str:
        i, j = int(np.argmin(np.abs(x.values - frequency))), int(np.argmin(np.abs(y.values - damping)))
        assert plane.state[i, j] == UNSTABLE
        return str(names[plane.tongue_index[i, j]])

    assert named(2.6, -0.02) == "none" and named(2.6, -0.01) == "none"
    assert named(2.0, 0.05) == named(2.0, -0.02) == "2 w1/1"


def test_a_disagreement_of_hill_is_appealed_to_both_engines(monkeypatch: pytest.MonkeyPatch) -> None:
    """Hill's method with few harmonics may miss; the point counts as undecided only where both engines do not agree."""

    def family(frequency: float, depth: float) -> PeriodicSystem:
        return PeriodicSystem.from_matrices([[0, 1], [-1, -0.02]], [[[0, 0], [-depth, 0]]], frequency=frequency)

    x, y = MapAxis("frequency", np.linspace(1.8, 2.2, 11)), MapAxis("depth", np.linspace(0.0, 0.2, 9))
    monkeypatch.setattr(plane_module, "hill_difference", lambda *arrays, **words: float("inf"))
    assert stability_plane(family, x, y).share(UNRESOLVED) == 0.0
    real = floquet
    monkeypatch.setattr(plane_module, "floquet", lambda system: replace(real(system), agreement=Agreement.UNRESOLVED))
    assert stability_plane(family, x, y).share(UNRESOLVED) == 1.0
    monkeypatch.setattr(
        plane_module, "floquet", lambda system: replace(real(system), exponents=real(system).exponents + 1e-3)
    )
    assert stability_plane(family, x, y).share(UNRESOLVED) == 1.0


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("coverage", ["every", "adaptive"])
def test_growth_beyond_the_range_of_numbers_is_never_called_stable(coverage: Coverage) -> None:
    """e^949 per period: no number holds the multiplier."""

    def fierce(W: float, depth: float) -> PeriodicSystem:
        A = np.array([[0.0, 1.0], [9.0e5, 0.0]])
        return PeriodicSystem.from_matrices(A, depth * np.array([[[0.0, 0.0], [-1.0, 0.0]]]), frequency=2.0 * np.pi * W)

    speed = MapAxis("speed", np.linspace(1.0, 2.0, 24), reciprocal=True)
    found = stability_plane(fierce, speed, DEPTH, coverage=coverage, threads=2)
    assert set(np.unique(found.state)) <= {UNSTABLE, UNRESOLVED, NO_ANSWER}
    known = np.isfinite(found.growth)
    assert np.any(known) and np.min(found.growth[known]) > 900.0
