"""A small share of the stress set of tests/hold: right or unresolved, never wrong; and its own truth is tested."""

from __future__ import annotations

import sys
import warnings
from collections import Counter
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).resolve().parents[1] / "hold"))

import stress_designs
import stress_linear
import stress_loops
import stress_periodic
import stress_truth as exact
from stress_record import UNRESOLVED, WRONG, Family, decision
from stress_systems import Sample, near_marginal

from maglev_ctrl.analysis import hurwitz, plane_pixels
from maglev_ctrl.analysis.modes import modes
from maglev_ctrl.analysis.norms import h2_norm, h_infinity_norm
from maglev_ctrl.analysis.plane_records import STABLE, UNSTABLE, MapAxis
from maglev_ctrl.analysis.spectrum import spectrum
from maglev_ctrl.analysis.stability_plane import stability_plane
from maglev_ctrl.errors import Agreement, ModelError
from maglev_ctrl.kernels.scaling import LARGEST_SCALE, balance, rescale
from maglev_ctrl.systems import PeriodicSystem, SecondOrderSystem

SEED = 20260101
ROUNDS = (
    (stress_linear.FAMILIES, 6), (stress_loops.FAMILIES, 5), (stress_periodic.FAMILIES, 2), (stress_designs.FAMILIES, 1)
)  # fmt: skip
EVERY = [(family, count) for families, count in ROUNDS for family in families]


@pytest.mark.parametrize(("family", "count"), EVERY, ids=[family.__name__ for family, _ in EVERY])
def test_no_engine_is_wrong_and_what_is_owed_is_decided(family: Family, count: int) -> None:
    owed, decided, asked = 0, 0, 0
    for k in range(count):
        for one in family(np.random.default_rng([SEED, k])):
            assert one.verdict != WRONG, (one, k)
            asked += 1
            owed, decided = owed + one.easy, decided + (one.easy and one.verdict != UNRESOLVED)
    assert asked and decided >= 0.95 * owed


def test_truth_by_routh_is_that_of_polynomials_put_together_by_hand() -> None:
    """(s + 1)(s - 2)(s^2 + 9)^2 (s^2 - 2 s + 5): three right of the axis, four on it."""
    one, factors = Fraction(1), ([1, 1], [-2, 1], [9, 0, 1], [9, 0, 1], [5, -2, 1])
    p = [one]
    for factor in factors:
        p = exact.times(p, [Fraction(c) for c in factor])
    assert exact.roots_right(p) == (3, 4)
    assert exact.roots_right([Fraction(0), Fraction(0), one]) == (0, 2)
    assert exact.roots_outside([Fraction(-1, 2), one]) == -1 and exact.roots_outside([one, one]) == 0
    A = [[Fraction(1), Fraction(2)], [Fraction(3), Fraction(4)]]
    assert exact.characteristic(A) == [Fraction(-2), Fraction(-5), Fraction(1)]


def test_a_dishonest_engine_is_caught() -> None:
    """Eigenvalues without their error bounds: some verdict is wrong, so the set can fail."""

    def bold(sample: Sample) -> int:
        assert sample.A is not None
        return -1 if np.max(np.linalg.eigvals(sample.A).real) < 0.0 else 1

    verdicts = Counter(
        decision("bold", sample, bold(sample)).verdict
        for sample in (near_marginal(np.random.default_rng([SEED, k])) for k in range(150))
    )
    assert verdicts[WRONG]


class TestMended:
    """Faults that the stress set found, each by the smallest system that shows it."""

    def test_scales_of_a_triangular_matrix_do_not_run_away(self) -> None:
        """LAPACK's scales of such a matrix overflow, and SciPy warned of a cast."""
        A = -np.diag([1.0, 2.0, 3.0]) + np.triu(np.full((3, 3), 2.0**60), 1)
        wild = -np.diag([1.0, 2.0, 3.0, 4.0]) + np.triu(np.full((4, 4), 2.0**300), 1)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            scale = balance(wild)
            found = spectrum(A)
        assert np.all((scale >= 1.0 / LARGEST_SCALE) & (scale <= LARGEST_SCALE))
        assert np.array_equal(np.diag(rescale(wild, scale)), np.diag(wild))
        assert np.all(found.s.real < -found.error_bound)

    def test_a_pole_that_is_weakly_hidden_is_not_called_absent(self) -> None:
        """1 / (s + 1) + weak^2 / s: the norm is infinite for any weak but zero, and known only there."""
        for norm, rest in ((h_infinity_norm, 1.0), (h2_norm, float(np.sqrt(0.5)))):
            for weak in (1e-12, 1e-16):
                found = norm(np.diag([-1.0, 0.0]), [[1.0], [weak]], [[1.0, weak]], [[0.0]])
                assert found.agreed is Agreement.UNRESOLVED and "weak" in found.message
            absent = norm(np.diag([-1.0, 0.0]), [[1.0], [0.0]], [[1.0, 1.0]], [[0.0]])
            assert absent.agreed is Agreement.AGREED and absent.value == pytest.approx(rest, rel=1e-12)

    def test_a_peak_sharper_than_rounding_is_not_told_as_known(self) -> None:
        """1 / (s^2 + c s + 1) has the peak 1 / c; of c = 1e-13 two digits are left, of 1e-6 nine."""
        B, C, D = [[0.0], [1.0]], [[1.0, 0.0]], [[0.0]]
        sharp = h_infinity_norm([[0.0, 1.0], [-1.1, -1e-13]], B, C, D)
        assert sharp.agreed is Agreement.UNRESOLVED and "rounding" in sharp.message
        plain = h_infinity_norm([[0.0, 1.0], [-1.0, -1e-6]], B, C, D)
        assert plain.agreed is Agreement.AGREED and plain.value == pytest.approx(1e6, rel=1e-9)

    def test_a_lyapunov_equation_that_was_changed_to_have_an_answer_is_none(self) -> None:
        found = h2_norm([[0.0, 1.0], [-1.0, -1e-15]], [[0.0], [1.0]], [[1.0, 0.0]], [[0.0]])
        assert found.agreed is Agreement.UNRESOLVED or found.value == np.inf

    def test_slow_growth_beyond_its_error_is_unstable_in_maps(self) -> None:
        """A mean system within 1e-6 of undamped was called stable whatever it did."""

        def family(x: float, y: float) -> PeriodicSystem:
            A = np.array([[-x, 2.0], [-2.0, -x]])
            return PeriodicSystem.from_matrices(A, [y * A], frequency=3.0)

        axes = MapAxis("damping", np.array([-1e-8, -1e-9, 1e-9, 1e-8])), MapAxis("depth", np.array([0.0, 1.0]))
        plane = stability_plane(family, *axes, checks=4)
        assert plane.state.tolist() == [[UNSTABLE] * 2] * 2 + [[STABLE] * 2] * 2

    def test_the_edge_of_an_undamped_tongue_is_not_decided(self) -> None:
        period, wide = np.ones(2), np.array([1e-7, 1e-12])
        judged = plane_pixels.judge(np.zeros(2), wide, np.ones(2, dtype=bool), period)
        assert judged.tolist() == [0, STABLE]

    def test_a_mass_next_to_singular_is_told_in_one_way(self) -> None:
        M = np.array([[1.0, 1.0], [1.0, 1.0 + 2.0**-52]])
        system = SecondOrderSystem.from_matrices(M * 3.0, np.eye(2), np.eye(2))
        with pytest.raises(ModelError, match="mass matrix"):
            modes(SecondOrderSystem.from_matrices(np.ones((2, 2)), np.eye(2), np.eye(2)))
        assert modes(system).verdict is not None

    def test_inertia_proves_nothing_on_the_axis(self) -> None:
        """A Jordan block of a pair on the axis, and the same moved by less than its entries are apart."""
        A = np.array([[0.0, 1.0, 1.0, 0.0], [-1.0, 0.0, 0.0, 1.0], [0.0, 0.0, 0.0, 1.0], [0.0, 0.0, -1.0, 0.0]])
        assert not hurwitz.lyapunov_inertia(A).certified
        nudged = [hurwitz.lyapunov_inertia(A + shift * np.eye(4)).certified for shift in (-1e-17, 1e-17)]
        assert not any(nudged)
