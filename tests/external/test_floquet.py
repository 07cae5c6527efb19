"""Published periodic systems, read from the shared collection where there is one."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq, minimize_scalar
from scipy.special import mathieu_a, mathieu_b

from maglev_ctrl.analysis.critical_depth import critical_depth
from maglev_ctrl.analysis.floquet import Floquet, floquet
from maglev_ctrl.errors import Agreement
from maglev_ctrl.kernels import periodic_multipliers
from maglev_ctrl.systems import PeriodicSystem

COLLECTION = Path(__file__).resolve().parents[2].parent / "shared" / "data" / "external" / "floquet.json"
O2 = np.zeros((2, 2))

# A(t) of each case as Fourier coefficients: A_0, cosine and sine harmonics, frequency
SYSTEMS: dict[str, tuple[Any, Any, Any, float]] = {
    "lpv-colaneri-stiff": ([[0, 1], [0, -24]], [[[0, 0], [-10, 0]]], [[[0, 0], [0, -10]]], 1.0),
    # sin^2 2t = (1 - cos 4t)/2: with W = 2 everything sits in the second harmonic
    "lpv-zhou-hagiwara-pi": (
        [[-1.5, 2], [-2, -1.5]], [O2, [[0.5, 0], [0, -0.5]]], [O2, [[0, -0.5], [-0.5, 0]]], 2.0,
    ),
    "lpv-markus-yamabe": (
        [[-0.25, 1], [-1, -0.25]], [O2, [[0.75, 0], [0, -0.75]]], [O2, [[0, -0.75], [-0.75, 0]]], 1.0,
    ),
    "approxfun-coupled-mathieu": (
        [[0, 0, 1, 0], [0, 0, 0, 1], [-2, 1, 0, 0], [1, -2, 0, 0]],
        [[[0, 0, 0, 0], [0, 0, 0, 0], [-0.15, 0, 0, 0], [0, -0.15, 0, 0]]], [np.zeros((4, 4))], 2.0,
    ),
}  # fmt: skip


def cases() -> dict[str, dict[str, Any]]:
    if not COLLECTION.exists():
        pytest.skip(
            f"the collection of published problems is not here (looked for {COLLECTION.name} beside the project)"
        )
    return {case["id"]: case for case in json.loads(COLLECTION.read_text())["cases"]}


def solved(name: str) -> Floquet:
    A_0, cosine, sine, W = SYSTEMS[name]
    return floquet(PeriodicSystem.from_matrices(A_0, cosine, sine, frequency=W))


def complex_of(entry: Any) -> complex:
    return complex(entry["re"], entry["im"]) if isinstance(entry, dict) else complex(entry)


def test_every_case_of_the_collection_is_covered() -> None:
    others = {"mathieu-characteristic-values", "damped-mathieu-principal", "slicot-MB03WD"}
    assert set(cases()) == set(SYSTEMS) | others


@pytest.mark.parametrize("name", [n for n in SYSTEMS if n != "approxfun-coupled-mathieu"])
def test_exponents_within_their_error_bound(name: str) -> None:
    expected = np.array(cases()[name]["exponents"], dtype=float)
    result = solved(name)
    assert result.agreement is Agreement.AGREED
    assert result.period == pytest.approx(cases()[name]["T"], rel=1e-15)
    error = np.abs(result.exponents - expected)
    assert np.all(error <= result.error_bound)
    assert np.all(error <= 1e-11 * np.maximum(1.0, np.abs(expected)))


@pytest.mark.parametrize("name", list(SYSTEMS))
def test_multipliers(name: str) -> None:
    expected = np.array([complex_of(m) for m in cases()[name]["multipliers"]])
    found = solved(name).multipliers
    for value in expected:
        assert np.min(np.abs(found - value)) <= 1e-10 * abs(value)


def test_stiff_multiplier_is_not_lost() -> None:
    """3e-66 beside 1: the explicit product has nothing left of it."""
    found = solved("lpv-colaneri-stiff")
    cases()
    assert found.multipliers[1].real == pytest.approx(np.exp(-48 * np.pi), rel=1e-12)
    assert abs(found.exponents[0]) < 1e-12


def test_markus_yamabe_is_unstable_although_every_frozen_matrix_is_stable() -> None:
    cases()
    A_0, cosine, sine, _ = SYSTEMS["lpv-markus-yamabe"]
    for t in np.linspace(0.0, np.pi, 7):
        frozen = np.array(A_0) + np.array(cosine[1]) * np.cos(2 * t) + np.array(sine[1]) * np.sin(2 * t)
        assert np.max(np.linalg.eigvals(frozen).real) == pytest.approx(-0.25, abs=1e-12)
    assert solved("lpv-markus-yamabe").stable is False


def test_flipped_sine_mutant_is_caught() -> None:
    cases()
    A_0, cosine, sine, W = SYSTEMS["lpv-markus-yamabe"]
    mutant = floquet(PeriodicSystem.from_matrices(A_0, cosine, -np.asarray(sine, dtype=float), frequency=W))
    assert abs(mutant.growth_rate - 0.5) > 0.1


def test_mathieu_characteristic_values() -> None:
    def trace(a: float, q: float) -> float:
        system = PeriodicSystem.from_matrices([[0, 1], [-a, 0]], [[[0, 0], [2 * q, 0]]], frequency=2.0)
        return float(np.sum(floquet(system).multipliers).real)

    for value in cases()["mathieu-characteristic-values"]["values"]:
        order, q = value["order"], float(value["q"])
        published = value["published"]
        reference = (mathieu_a if value["kind"] == "a" else mathieu_b)(order, q)
        assert reference == pytest.approx(published, abs=6e-9)
        # at the edge the multiplier is double: +1 for even order, -1 for odd
        size = 1.0 if order % 2 == 0 else -1.0
        steep = abs(trace(published + 1e-6, q) - trace(published - 1e-6, q)) / 2e-6
        assert abs(trace(published, q) - 2.0 * size) <= 6e-9 * steep + 1e-9  # eight published decimals


@pytest.mark.parametrize("name", [("a", 0, 5), ("a", 1, 5), ("b", 2, 10), ("b", 1, 25)])
def test_mathieu_edges_by_root_finding(name: tuple[str, int, int]) -> None:
    _, order, q = name
    value = next(v for v in cases()["mathieu-characteristic-values"]["values"]
                 if (v["kind"], v["order"], v["q"]) == name)  # fmt: skip

    def edge(a: float) -> float:
        system = PeriodicSystem.from_matrices([[0, 1], [-a, 0]], [[[0, 0], [2 * q, 0]]], frequency=2.0)
        return float(np.sum(floquet(system).multipliers).real) - 2.0 * (-1.0) ** order

    step = 1e-7 * abs(value["published"])
    found = brentq(edge, value["published"] - step, value["published"] + step, xtol=1e-13)
    assert found == pytest.approx(value["hill"], rel=1e-9)


def damped(zeta: float, W: float) -> PeriodicSystem:
    return PeriodicSystem.from_matrices([[0, 1], [-1, -2 * zeta]], [[[0, 0], [-1, 0]]], frequency=W)


def test_damped_mathieu_thresholds() -> None:
    for point in cases()["damped-mathieu-principal"]["points"]:
        zeta = point["zeta"]
        found = critical_depth(damped(zeta, 2.0), depth_max=1.0)
        assert found.depth == pytest.approx(point["h_crit_at_Omega2"], rel=1e-8)
        assert found.resonance.name == "2 w1/1"
        assert found.depth == pytest.approx(point["leading_order"], rel=zeta)
        if point["h_min"] is not None:
            lowest = minimize_scalar(
                lambda W, z=zeta: critical_depth(damped(z, W), depth_max=1.0).depth,
                bounds=(1.9, 2.05), method="bounded", options={"xatol": 1e-7},
            )  # fmt: skip
            assert lowest.fun == pytest.approx(point["h_min"], rel=1e-8)
            assert lowest.x == pytest.approx(point["Omega_at_min"], abs=1e-4)


def test_slicot_periodic_product() -> None:
    case = cases()["slicot-MB03WD"]
    expected = np.array([complex_of(m) for m in case["multipliers"]])
    published = np.array([complex_of(m) for m in case["multipliers_published"]])
    factors = np.array(case["A"], dtype=float)
    both = [np.exp(periodic_multipliers(f).logs) for f in (factors, factors[::-1])]
    # the listing does not say from which side the factors act; either way round the product is the same square
    assert np.array_equal(factors[0], factors[1])
    for found in both:
        assert np.allclose(np.sort_complex(found), np.sort_complex(expected), rtol=1e-11)
        assert np.allclose(np.sort_complex(found), np.sort_complex(published), atol=1e-6)
