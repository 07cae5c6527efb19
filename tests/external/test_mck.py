"""Published second-order problems: eigenvalues and thresholds, read from the shared collection where there is one."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mpmath
import numpy as np
import pytest

from maglev_ctrl.analysis.boundary import stability_boundaries
from maglev_ctrl.analysis.modes import ModeKind, StabilityVerdict, modes, spectral_abscissa
from maglev_ctrl.systems import SecondOrderSystem

COLLECTION = Path(__file__).resolve().parents[2].parent / "shared" / "data" / "external" / "mck.json"
ROUNDOFF = float(np.finfo(np.float64).eps)

EIGENVALUE_CASES = ("nlevp-damped_beam20", "nlevp-qep2", "nlevp-sleeper10", "nlevp-wiresaw1_10", "nlevp-wiresaw2_10")
CIRCULATORY_CASES = ("circulatory-equal-frequency-c0.1-k1.0", "circulatory-equal-frequency-c1.0-k25.0")
ROTOR_CASES = ("rotor-internal-damping-0.02-0.01-10.0", "rotor-internal-damping-0.1-0.1-1.0")
COUPLING_CASES = ("mode-coupling-flutter-2.0-1.0-0.5", "mode-coupling-flutter-1.2-1.0-0.1")
BICYCLE = "whipple-bicycle-benchmark"
GYROSCOPIC = "gyroscopic-stabilisation-1-1"


def cases() -> dict[str, dict[str, Any]]:
    if not COLLECTION.exists():
        pytest.skip(
            f"the collection of published problems is not here (looked for {COLLECTION.name} beside the project)"
        )
    return {case["id"]: case for case in json.loads(COLLECTION.read_text())["cases"]}


def complex_values(entries: list[dict[str, float]]) -> np.ndarray:
    return np.array([complex(entry["re"], entry["im"]) for entry in entries])


def crossing(growth: Callable[[SecondOrderSystem], float], at: Callable[[float], SecondOrderSystem], lower: float,
             upper: float, *, neutral: float = 0.0) -> list[tuple[float, str]]:  # fmt: skip
    found = stability_boundaries(
        lambda x: growth(at(x)), lower, upper, samples=60, tolerance=1e-12 * (upper - lower), neutral=neutral
    )
    return [(c.value, c.direction) for c in found.crossings]


def abscissa(system: SecondOrderSystem) -> float:
    return float(spectral_abscissa(system))


def test_every_case_of_the_collection_is_covered_here() -> None:
    covered = {*EIGENVALUE_CASES, *CIRCULATORY_CASES, *ROTOR_CASES, *COUPLING_CASES, BICYCLE, GYROSCOPIC}
    assert set(cases()) == covered


@pytest.mark.parametrize("name", EIGENVALUE_CASES)
def test_eigenvalues(name: str) -> None:
    case = cases()[name]
    system = SecondOrderSystem.from_matrices(case["M"], case["C"], case["K"])
    found = modes(system)
    published = complex_values(case["eigs"])
    own = np.concatenate([found.s, found.s[found.s.imag > 0.0].conj()])
    assert len(own) == len(published)
    bound = np.concatenate([found.error_bound, found.error_bound[found.s.imag > 0.0]])
    reference = reference_error(case, system, published)
    for value, error in zip(published, reference, strict=True):
        nearest = int(np.argmin(np.abs(own - value)))
        assert abs(own[nearest] - value) <= bound[nearest] + error
    assert abs(found.spectral_abscissa - case["spectral_abscissa"]) <= np.max(bound) + np.max(reference)


def reference_error(case: dict[str, Any], system: SecondOrderSystem, s: np.ndarray) -> np.ndarray:
    """How far the listed values may be off: their backward error times the normwise condition, or their digits.

    A value computed with 30 digits (`mp_vs_double`) carries only the rounding of the file.
    """
    if "max_backward_err" not in case:
        return np.maximum(ROUNDOFF * np.abs(s), case["mp_vs_double"] * np.abs(s))
    sizes = [np.linalg.norm(matrix) for matrix in (system.M, system.C, system.K)]
    errors = []
    for value in s:
        U, _, Vh = np.linalg.svd(value**2 * system.M + value * system.C + system.K)
        slope = abs(U[:, -1].conj() @ (2 * value * system.M + system.C) @ Vh[-1].conj())
        weight = abs(value) ** 2 * sizes[0] + abs(value) * sizes[1] + sizes[2]
        errors.append(case["max_backward_err"] * weight / slope)
    return np.array(errors)


def test_damped_beam_against_roots_of_the_determinant() -> None:
    """The listed values of this case carry seven decimals at best; the roots at 40 digits carry the bound."""
    case = cases()["nlevp-damped_beam20"]
    found = modes(SecondOrderSystem.from_matrices(case["M"], case["C"], case["K"]))
    with mpmath.workdps(40):
        M, C, K = (mpmath.matrix(case[key]) for key in "MCK")
        for k in (0, 1, 8, 19):
            start = mpmath.mpc(complex(found.s[k]))
            root = mpmath.findroot(
                lambda z: mpmath.det(z * z * M + z * C + K), (start, start * (1 + mpmath.mpf(10) ** -10)), verify=False
            )
            assert float(abs(root - start)) <= found.error_bound[k]


@pytest.mark.parametrize("name", EIGENVALUE_CASES)
def test_eigenvalues_mutant_is_caught(name: str) -> None:
    case = cases()[name]
    C = -np.array(case["C"]) if np.any(case["C"]) else np.array(case["C"])
    K = np.array(case["K"])
    K[0, 0] *= 1.001
    found = modes(SecondOrderSystem.from_matrices(case["M"], C, K))
    published = complex_values(case["eigs"])
    distance = [np.min(np.abs(published - s)) / (1e-12 + abs(s)) for s in found.s]
    assert max(distance) > 1e-5


def test_half_of_the_damped_beam_is_neutral() -> None:
    case = cases()["nlevp-damped_beam20"]
    found = modes(SecondOrderSystem.from_matrices(case["M"], case["C"], case["K"]))
    assert found.kind.count(ModeKind.NEUTRAL) == len(found.s) // 2
    assert found.verdict is StabilityVerdict.UNRESOLVED


def test_defective_triple_claims_no_digits_it_has_not() -> None:
    case = cases()["nlevp-qep2"]
    found = modes(SecondOrderSystem.from_matrices(case["M"], case["C"], case["K"]))
    triple = np.abs(found.s - 1.0) < 1e-3
    assert np.all(found.error_bound[triple] > ROUNDOFF ** (1 / 3))
    assert np.all(np.abs(found.s[triple] - 1.0) <= found.error_bound[triple])
    lone = ~triple
    assert np.all(found.error_bound[lone] < 1e-12)


def test_sleeper_against_its_exact_eigenvalues() -> None:
    case = cases()["nlevp-sleeper10"]
    found = modes(SecondOrderSystem.from_matrices(case["M"], case["C"], case["K"]))
    exact = complex_values(case["eigs_exact_published"])
    for s, bound in zip(found.s, found.error_bound, strict=True):
        assert np.min(np.abs(exact - s)) <= bound + case["exact_err"]
    assert found.stable


def test_bicycle_table_and_speeds() -> None:
    case = cases()[BICYCLE]

    def at(speed: float) -> SecondOrderSystem:
        C, K = speed * np.array(case["C1"]), case["g"] * np.array(case["K0"]) + speed**2 * np.array(case["K2"])
        return SecondOrderSystem.from_matrices(case["M"], C, K, dofs=("roll", "steer"))

    for row in case["table"]:
        found = modes(at(row["v"]))
        for value in complex_values(row["eigs_published"]):
            near = np.minimum(np.abs(found.s - value), np.abs(found.s - np.conj(value)))
            assert np.min(near) <= 1e-11  # 14 decimals are printed
    found_speeds = crossing(abscissa, at, 0.0, 10.0)
    published = case["published"]
    assert [direction for _, direction in found_speeds] == ["gains", "loses"]
    np.testing.assert_allclose(
        [value for value, _ in found_speeds], [published["v_weave"], published["v_capsize"]], atol=1e-10
    )
    double = modes(at(published["v_double_root"]))
    nearest = int(np.argmin(np.abs(double.s - published["double_root"])))
    # 14 decimals of a parameter leave a double root about seven digits; the bound must say so
    assert abs(double.s[nearest] - published["double_root"]) <= max(double.error_bound[nearest], 1e-6)
    assert double.error_bound[nearest] > 1e-9


@pytest.mark.parametrize("name", CIRCULATORY_CASES)
def test_circulatory_threshold(name: str) -> None:
    case = cases()[name]

    def at(p: float) -> SecondOrderSystem:
        return SecondOrderSystem.from_matrices(np.eye(2), case["c"] * np.eye(2), [[case["k"], p], [-p, case["k"]]])

    [(value, direction)] = crossing(abscissa, at, 0.0, 3.0 * case["p_crit"])
    assert direction == "loses"
    assert value == pytest.approx(case["p_crit"], rel=1e-9)
    beyond = modes(at(1.01 * case["p_crit"]))
    assert beyond.kind[beyond.critical] is ModeKind.COUPLED_MODE_FLUTTER
    assert [abscissa(at(f * case["p_crit"])) for f in (0.999, 1.001)] == pytest.approx(case["check"], rel=1e-6)


@pytest.mark.parametrize("name", ROTOR_CASES)
def test_rotor_threshold(name: str) -> None:
    case = cases()[name]

    def at(speed: float) -> SecondOrderSystem:
        stiffness, cross = case["w0"] ** 2, case["ci"] * speed
        C = (case["ci"] + case["ce"]) * np.eye(2)
        return SecondOrderSystem.from_matrices(np.eye(2), C, [[stiffness, cross], [-cross, stiffness]])

    [(value, direction)] = crossing(abscissa, at, 0.0, 3.0 * case["Omega_crit"])
    assert direction == "loses"
    assert value == pytest.approx(case["Omega_crit"], rel=1e-9)
    assert modes(at(0.99 * case["Omega_crit"])).stable


@pytest.mark.parametrize("name", COUPLING_CASES)
def test_mode_coupling_threshold(name: str) -> None:
    case = cases()[name]

    def at(c: float) -> SecondOrderSystem:
        return SecondOrderSystem.from_matrices(np.eye(2), np.zeros((2, 2)), [[case["a"], case["b"]], [c, case["d"]]])

    c = case["c_flutter"]
    [(value, direction)] = crossing(abscissa, at, 3.0 * c, 0.0, neutral=1e-7)  # undamped: on the axis within rounding
    assert direction == "gains"
    assert value == pytest.approx(c, rel=1e-9)
    beyond = modes(at(c * (1.0 + 1e-6)))
    assert beyond.kind[beyond.critical] is ModeKind.COUPLED_MODE_FLUTTER
    assert beyond.s[beyond.critical].imag == pytest.approx(case["freq"], rel=1e-6)


def test_gyroscopic_stabilisation() -> None:
    case = cases()[GYROSCOPIC]

    def at(g: float, c: float = 0.0) -> SecondOrderSystem:
        C = g * np.array([[0.0, 1.0], [-1.0, 0.0]]) + c * np.eye(2)
        return SecondOrderSystem.from_matrices(np.eye(2), C, -np.diag(case["k"]).astype(float))

    [(value, direction)] = crossing(abscissa, at, 0.5, 4.0, neutral=1e-6)
    assert direction == "gains"
    assert value == pytest.approx(case["g_crit"], rel=1e-9)
    assert set(modes(at(1.01 * case["g_crit"])).kind) == {ModeKind.NEUTRAL}
    damped = modes(at(1.5 * case["g_crit"], 0.01))  # Thomson, Tait, Chetaev: any damping destroys it
    assert damped.verdict is StabilityVerdict.UNSTABLE
