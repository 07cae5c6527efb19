"""What cannot be analysed is refused in one sentence that names it, before any engine runs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from maglev_ctrl.analysis.floquet import floquet
from maglev_ctrl.kernels import hill_spectrum, periodic_multipliers, piecewise_propagators
from maglev_ctrl.kernels.taylor import TaylorPlan, propagators_over_depths
from maglev_ctrl.systems import PeriodicSystem, SecondOrderSystem, modulate

A_0, A_1 = np.array([[0.0, 1.0], [-1.0, -0.1]]), np.array([[[0.0, 0.0], [-0.1, 0.0]]])
SPRING = SecondOrderSystem.from_matrices([[1.0]], [[0.0]], [[4.0]])
BAD = (float("nan"), float("inf"))
FREQUENCIES = [(0.0, "positive"), (-2.0, "positive"), (float("nan"), "finite"), (float("inf"), "finite")]


def spoiled(matrix: np.ndarray, value: float) -> np.ndarray:
    copy = matrix.copy()
    copy.flat[1] = value
    return copy


@pytest.mark.parametrize("value", BAD)
def test_entries_that_are_not_finite(value: float) -> None:
    for named, parts in {"A_0": (spoiled(A_0, value), A_1, A_1), "A_cos": (A_0, spoiled(A_1, value), A_1),
                         "A_sin": (A_0, A_1, spoiled(A_1, value))}.items():  # fmt: skip
        with pytest.raises(ValueError, match=f"^{named}: every entry must be finite"):
            PeriodicSystem.from_matrices(*parts, frequency=2.0)
        system = replace(PeriodicSystem.from_matrices(A_0, A_1, frequency=2.0), **{named: dict(
            zip(("A_0", "A_cos", "A_sin"), parts, strict=True))[named]})  # fmt: skip
        with pytest.raises(ValueError, match=rf"^{named}: every entry must be finite, got (nan|inf) at \[0"):
            floquet(system)
        with pytest.raises(ValueError, match=f"^{named}: every entry"):
            hill_spectrum(*parts, frequency=2.0)
        with pytest.raises(ValueError, match=f"^{named}: every entry"):
            propagators_over_depths(*parts, frequency=2.0, depths=np.ones(1), plan=TaylorPlan(8, 20, 1e-16))
    with pytest.raises(ValueError, match=r"^K_cos: every entry must be finite"):
        modulate(SPRING, [[[value]]], frequency=2.0)
    with pytest.raises(ValueError, match=r"^factors: every entry must be finite"):
        periodic_multipliers(spoiled(np.stack([A_0, A_0]), value))
    with pytest.raises(ValueError, match=r"^matrices: every entry must be finite"):
        piecewise_propagators([spoiled(A_0, value)], [1.0])


@pytest.mark.parametrize(("frequency", "told"), FREQUENCIES)
def test_frequencies(frequency: float, told: str) -> None:
    with pytest.raises(ValueError, match=f"^frequency: .*{told}"):
        PeriodicSystem.from_matrices(A_0, A_1, frequency=frequency)
    with pytest.raises(ValueError, match=f"^frequency: .*{told}"):
        modulate(SPRING, [[[0.1]]], frequency=frequency)
    good = PeriodicSystem.from_matrices(A_0, A_1, frequency=2.0)
    with pytest.raises(ValueError, match=r"^frequency: expected a positive finite angular frequency in rad/s, got"):
        floquet(replace(good, frequency=np.array(frequency)))
    with pytest.raises(ValueError, match=r"^frequency: expected a positive finite"):
        hill_spectrum(A_0, A_1, A_1, frequency=frequency)


def test_nothing_to_work_on() -> None:
    none = np.zeros((0, 0))
    with pytest.raises(ValueError, match=r"^A_0: expected at least one state, got shape"):
        PeriodicSystem.from_matrices(none, none[None], frequency=2.0)
    with pytest.raises(ValueError, match=r"^A_0: expected a square matrix with at least one state"):
        hill_spectrum(none, none[None], none[None], frequency=2.0)
    with pytest.raises(ValueError, match=r"^A_cos: expected at least one harmonic"):
        hill_spectrum(A_0, A_1[:0], A_1[:0], frequency=2.0)
    with pytest.raises(ValueError, match=r"^K_cos: expected at least one harmonic"):
        modulate(SPRING, np.zeros((0, 1, 1)), frequency=2.0)
    with pytest.raises(ValueError, match=r"^factors: expected at least one factor"):
        periodic_multipliers(np.zeros((0, 2, 2)))
    with pytest.raises(ValueError, match=r"^matrices: expected at least one piece"):
        piecewise_propagators(np.zeros((0, 2, 2)), np.zeros(0))
    with pytest.raises(ValueError, match=r"^durations: expected positive times in s, got -1"):
        piecewise_propagators([A_0], [-1.0])


def test_a_system_without_harmonics_is_its_own_eigenvalues() -> None:
    found = floquet(PeriodicSystem.from_matrices(A_0, np.zeros((0, 2, 2)), frequency=7.0))
    assert np.allclose(np.sort_complex(found.exponents), np.sort_complex(np.linalg.eigvals(A_0)), atol=1e-12)
