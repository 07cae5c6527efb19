"""Modes: eigenvalues inside their bounds, kinds, labels, verdicts that two methods share."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

from maglev_ctrl.analysis.modes import (
    ModeKind,
    StabilityVerdict,
    modes,
    modes_of_stack,
    spectral_abscissa,
    state_abscissa,
    unstack,
)
from maglev_ctrl.analysis.spectrum import spectrum
from maglev_ctrl.errors import Agreement, ModelError
from maglev_ctrl.systems import Controller, SecondOrderSystem, close_loop

# Meijaard, Papadopoulos, Ruina & Schwab, Proc. R. Soc. A 463 (2007) 1955: the benchmark bicycle, M, C1, K0, K2 and
# the eigenvalues of their Table 2.
BICYCLE_M = np.array([[80.81722, 2.31941332208709], [2.31941332208709, 0.29784188199686]])
BICYCLE_C1 = np.array([[0.0, 33.86641391492494], [-0.85035641456978, 1.6854039739756]])
BICYCLE_K0 = np.array([[-80.95, -2.59951685249872], [-2.59951685249872, -0.80329488458618]])
BICYCLE_K2 = np.array([[0.0, 76.59734589573222], [0.0, 2.65431523794604]])
BICYCLE_TABLE = {
    0.0: [5.53094371765393, 3.13164324790656, -3.13164324790656, -5.53094371765393],
    4.0: [0.41325331521125 + 3.07910818603206j, -1.42944427361326, -12.1586142657645],
    5.0: [-0.77534188219585 + 4.46486771378823j, -0.32286642900409, -14.0783896927982],
    7.0: [-2.13875644258362 + 7.19525913329805j, 0.10268170574766, -18.1578846612526],
}


def bicycle(speed: float) -> SecondOrderSystem:
    stiffness = 9.81 * BICYCLE_K0 + speed**2 * BICYCLE_K2
    return SecondOrderSystem.from_matrices(BICYCLE_M, speed * BICYCLE_C1, stiffness, dofs=("roll", "steer"))


def oscillator(damping: float, stiffness: float) -> SecondOrderSystem:
    return SecondOrderSystem.from_matrices([[1.0]], [[damping]], [[stiffness]], dofs=("car.heave",))


@pytest.mark.parametrize("speed", sorted(BICYCLE_TABLE))
def test_published_bicycle_eigenvalues(speed: float) -> None:
    published = np.array(BICYCLE_TABLE[speed], dtype=complex)
    found = modes(bicycle(speed)).s
    assert len(found) == len(published)
    for value in published:  # Table 2 gives 14 decimals
        assert np.min(np.abs(found - value)) < 1e-11


def test_published_bicycle_eigenvalues_mutant_is_caught() -> None:
    swapped = SecondOrderSystem.from_matrices(BICYCLE_M, 5.0 * BICYCLE_C1.T, 9.81 * BICYCLE_K0 + 25.0 * BICYCLE_K2)
    assert np.min(np.abs(modes(swapped).s - BICYCLE_TABLE[5.0][0])) > 1e-3


def test_bicycle_verdicts() -> None:
    verdicts = [modes(bicycle(speed)).verdict for speed in (4.0, 5.0, 7.0)]
    assert verdicts == [StabilityVerdict.UNSTABLE, StabilityVerdict.STABLE, StabilityVerdict.UNSTABLE]
    assert ModeKind.DIVERGENCE in modes(bicycle(7.0)).kind


def test_oscillator_closed_form() -> None:
    found = modes(oscillator(0.4, 4.0))
    assert found.s[0] == pytest.approx(-0.2 + 3.96**0.5 * 1j, abs=float(found.error_bound[0]))
    assert found.natural_frequency[0] == pytest.approx(2.0, rel=1e-14)
    assert found.damping_ratio[0] == pytest.approx(0.1, rel=1e-13)
    assert found.frequency[0] == pytest.approx(3.96**0.5 / (2 * np.pi), rel=1e-14)
    assert found.stable
    assert found.agreement is Agreement.AGREED


@pytest.mark.parametrize(
    ("damping", "stiffness", "kind", "verdict"),
    [
        (0.4, 4.0, ModeKind.STABLE, StabilityVerdict.STABLE),
        (0.0, 4.0, ModeKind.NEUTRAL, StabilityVerdict.UNRESOLVED),
        (-0.4, 4.0, ModeKind.SINGLE_MODE_FLUTTER, StabilityVerdict.UNSTABLE),
        (0.4, -4.0, ModeKind.DIVERGENCE, StabilityVerdict.UNSTABLE),
    ],
)
def test_kinds(damping: float, stiffness: float, kind: ModeKind, verdict: StabilityVerdict) -> None:
    found = modes(oscillator(damping, stiffness))
    assert found.kind[found.critical] is kind
    assert found.verdict is verdict
    assert found.stable == (verdict is StabilityVerdict.STABLE)


def test_circulatory_flutter_and_its_mutant() -> None:
    circulatory = np.array([[4.0, 1.0], [-1.0, 4.0]])
    found = modes(SecondOrderSystem.from_matrices(np.eye(2), 0.05 * np.eye(2), circulatory))
    assert found.kind[found.critical] is ModeKind.COUPLED_MODE_FLUTTER
    symmetric = modes(SecondOrderSystem.from_matrices(np.eye(2), 0.05 * np.eye(2), np.abs(circulatory)))
    assert symmetric.stable  # one flipped sign and the flutter is gone


def test_conservative_gyroscopic_flutter_is_coupled_and_its_split_undefined() -> None:
    gyroscopic = SecondOrderSystem.from_matrices(np.eye(2), [[0.0, 1.9], [-1.9, 0.0]], -np.eye(2))
    found = modes(gyroscopic)
    assert found.kind[found.critical] is ModeKind.COUPLED_MODE_FLUTTER
    assert np.isnan(found.ledger.damping[:, found.critical]).all()
    assert found.verdict is StabilityVerdict.UNSTABLE


@pytest.mark.parametrize("seed", range(12))
def test_errors_stay_within_bounds_at_bad_scaling(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n = 4
    root = rng.standard_normal((n, n))
    units = 10.0 ** rng.uniform(-5, 5, n)  # kg, kg m^2, tonnes, millimetres mixed
    scale = np.outer(units, units)
    M, C, K = root @ root.T + np.eye(n), rng.standard_normal((n, n)), 50.0 * rng.standard_normal((n, n))
    system = SecondOrderSystem.from_matrices(scale * M, scale * C, scale * K)
    found = modes(system)
    exact = exact_eigenvalues(system)
    errors = np.array([np.min(np.abs(exact - s)) for s in found.s])
    assert np.all(errors <= found.error_bound)
    assert np.all(found.error_bound <= 1e-9 * np.abs(found.s))  # and the bound still says something


def exact_eigenvalues(system: SecondOrderSystem) -> np.ndarray:
    with mpmath.workdps(60):
        M, C, K = (mpmath.matrix(getattr(system, key).tolist()) for key in "MCK")
        n, inverse = M.rows, mpmath.inverse(M)
        A = mpmath.zeros(2 * n)
        for i in range(n):
            A[i, n + i] = 1
        A[n:, :n], A[n:, n:] = -inverse * K, -inverse * C
        return np.array([complex(value) for value in mpmath.eig(A)[0]])


def test_defective_triple_eigenvalue_claims_no_more_digits_than_it_has() -> None:
    jordan = np.array([[-1.0, 1.0, 0.0], [0.0, -1.0, 1.0], [0.0, 0.0, -1.0]])
    turn = np.array([[1.0, 2.0, 3.0], [0.0, 1.0, 4.0], [5.0, 6.0, 0.0]])
    found = spectrum(turn @ jordan @ np.linalg.inv(turn))
    assert np.all(np.abs(found.s + 1.0) <= found.error_bound)
    assert np.all(found.error_bound > 1e-7)
    assert found.clustered.all()


def test_growth_within_its_error_is_unresolved() -> None:
    system = oscillator(1e-6, 4.0)
    assert modes(system).verdict is StabilityVerdict.STABLE
    doubtful = modes(system, relative_data_error=1e-5)
    assert doubtful.verdict is StabilityVerdict.UNRESOLVED
    assert doubtful.kind == (ModeKind.NEUTRAL,)
    assert doubtful.agreement is Agreement.UNRESOLVED


def test_light_damping_over_a_wide_frequency_range_is_still_resolved() -> None:
    stiffness = np.diag([1.0, 1e4, 1e8])
    damping = 2e-6 * np.sqrt(stiffness)
    found = modes(SecondOrderSystem.from_matrices(np.eye(3), damping, stiffness))
    assert found.verdict is StabilityVerdict.STABLE


def test_labels_by_participation() -> None:
    K = np.array([[4.0, 0.3, 0.0], [0.3, 40.0, 0.0], [0.0, 0.0, 400.0]])
    names = ("car.heave", "car.pitch", "bogie_1.heave")
    found = modes(SecondOrderSystem.from_matrices(np.eye(3), 0.1 * np.eye(3), K, dofs=names))
    assert found.labels == ("car heave", "car pitch", "bogie_1 heave")
    np.testing.assert_allclose(found.participation.sum(axis=0), 1.0, rtol=1e-13)
    np.testing.assert_allclose(np.max(np.abs(found.shapes), axis=0), 1.0, rtol=1e-13)


def test_overdamped_pair_gets_two_labels() -> None:
    assert modes(oscillator(5.0, 4.0)).labels == ("car heave (1)", "car heave (2)")


def test_ignorable_coordinate_has_a_shape_but_no_zero_eigenvalue() -> None:
    system = SecondOrderSystem.from_matrices(
        np.eye(2), [[0.0, -0.3], [0.1, 0.2]], [[4.0, 0.0], [0.5, 0.0]],
        dofs=("car.heave", "car.surge"), ignorable=("car.surge",),
    )  # fmt: skip
    found = modes(system)
    assert len(found.s) == 2  # one pair, one real
    for s, a in zip(found.s, found.shapes.T, strict=True):
        residual = (s**2 * system.M + s * system.C + system.K) @ a
        assert np.max(np.abs(residual)) < 1e-13


def test_decoupled_internal_state_is_named_after_itself() -> None:
    system = SecondOrderSystem.from_matrices(
        [[1.0]], [[0.4]], [[4.0]], internal=("filter.x1",), A_internal=[[-3.0]], dofs=("car.heave",)
    )
    found = modes(system)
    assert set(found.labels) == {"car heave", "filter x1"}
    assert found.stable


def test_closed_loop_stabilises_and_ledger_names_the_actuator() -> None:
    plant = SecondOrderSystem.from_matrices(
        [[2.0]], [[-0.5]], [[8.0]], dofs=("car.heave",), internal=("magnet.force",), A_internal=[[-200.0]],
        F=[[1.0]], inputs=("magnet",), B_internal=[[200.0]],
    )  # fmt: skip
    law = Controller.static([[-3.0]], measured=("car.heave.velocity",), commands=("magnet",), name="law")
    assert modes(plant).verdict is StabilityVerdict.UNSTABLE
    closed = modes(close_loop(plant, law))
    assert closed.stable
    oscillating = int(np.argmax(closed.s.imag))
    assert abs(closed.ledger.residual[oscillating]) < 1e-10 * abs(closed.s[oscillating])


def test_stack_equals_singles() -> None:
    stack = SecondOrderSystem.from_matrices(np.eye(2), 0.1 * np.eye(2), [np.diag([1.0, k]) for k in (4.0, 9.0)])
    singles = [modes(one) for one in unstack(stack)]
    for a, b in zip(modes_of_stack(stack), singles, strict=True):
        np.testing.assert_array_equal(a.s, b.s)
    np.testing.assert_allclose(spectral_abscissa(stack), [m.spectral_abscissa for m in singles], atol=1e-14)


def test_wrong_use_is_named() -> None:
    stack = SecondOrderSystem.from_matrices([[1.0]], [[0.1]], [[[4.0]], [[9.0]]])
    with pytest.raises(ValueError, match="modes_of_stack"):
        modes(stack)
    with pytest.raises(ValueError, match="one batch axis"):
        modes_of_stack(oscillator(0.1, 4.0))
    with pytest.raises(ValueError, match="relative_data_error"):
        modes(oscillator(0.1, 4.0), relative_data_error=-1.0)
    with pytest.raises(ValueError, match="nx, nx"):
        state_abscissa(np.zeros((2, 3)))
    with pytest.raises(ModelError, match="mass matrix"):
        modes(SecondOrderSystem.from_matrices([[0.0]], [[0.1]], [[4.0]]))


def test_free_body_is_neutral_and_unresolved() -> None:
    found = modes(SecondOrderSystem.from_matrices([[3.0]], [[0.0]], [[0.0]], dofs=("car.surge",)))
    assert set(found.kind) == {ModeKind.NEUTRAL}  # a defective double zero: no finite condition, a finite bound
    assert np.all(np.isfinite(found.error_bound))
    assert found.verdict is StabilityVerdict.UNRESOLVED
    assert np.isnan(found.damping_ratio).all()


def test_two_names_of_twins_keep_the_order_of_coordinates() -> None:
    K = np.array([[4.0, 0.5], [0.5, 4.0]])
    found = modes(SecondOrderSystem.from_matrices(np.eye(2), 0.1 * np.eye(2), K, dofs=("front.heave", "rear.heave")))
    assert found.labels == ("front heave / rear heave (1)", "front heave / rear heave (2)")
