"""The double-L vehicle and Table 1 of the paper come out of the general assembly; the printed slips do not.

Closed forms and numbers: corrected equations of the paper (the errata), evaluated with mpmath.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from maglev_ctrl.errors import OutOfDomain
from maglev_ctrl.forces import AbstractForceModel, Domain, MagnetDerivatives, MagnetForces
from maglev_ctrl.systems import SecondOrderSystem
from maglev_ctrl.vehicle import OperatingPoint, equilibrium, linearize
from maglev_ctrl.vehicle.models import double_l, double_l_geometry

G = 9.80665


@dataclass(frozen=True)
class PrescribedForce(AbstractForceModel):
    """Lift, guidance and drag linear in height, gap and speed about a point, with the partials given."""

    at: tuple[float, float, float]
    lift: tuple[float, float, float, float]
    guidance: tuple[float, float, float, float]
    drag: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)

    @property
    def domain(self) -> Domain:
        return Domain(height=(1e-6, 10.0), gap=(1e-6, 10.0), speed=(0.0, 1e4))

    def forces(self, height, gap, speed):
        self.domain.require(height, gap, speed)
        steps = [np.asarray(value) - start for value, start in zip((height, gap, speed), self.at, strict=True)]
        parts = [c[0] + sum(k * s for k, s in zip(c[1:], steps, strict=True)) for c in self._rows]
        return MagnetForces(*parts)

    def derivatives(self, height, gap, speed):
        shape = np.broadcast_shapes(np.shape(height), np.shape(gap), np.shape(speed))
        columns = [MagnetForces(*(np.full(shape, row[i]) for row in self._rows)) for i in (1, 2, 3)]
        zero = MagnetForces(*(np.zeros(shape) for _ in range(3)))
        return MagnetDerivatives(*columns, zero, zero)

    def scaled(self, factor):
        return PrescribedForce(self.at, *(tuple(factor * c for c in row) for row in self._rows))

    @property
    def _rows(self):
        return self.lift, self.guidance, self.drag


G0, H0, V0 = 0.0127, 0.02, 36.1
S1 = {"k_ll": -400.0, "k_lg": 20.0, "k_gl": -60.0, "k_gg": -300.0}
S2 = {"k_ll": -260.0, "k_lg": 100.0, "k_gl": -200.0, "k_gg": -50.0}
S3 = {"k_ll": -400.0, "k_lg": -60.0, "k_gl": -60.0, "k_gg": -300.0}
S4 = {"k_ll": -400.0, "k_lg": 20.0, "k_gl": -60.0, "k_gg": 40.0}
MODELS = {"P": ("paper", False), "C": ("consistent", False), "CG": ("consistent", True)}


def sample(k_ll: float, k_lg: float, k_gl: float, k_gg: float, L: float = 5.0, G: float = 4.0) -> PrescribedForce:
    return PrescribedForce((H0, G0, V0), (L, k_ll, k_lg, 0.0), (G, k_gl, k_gg, 0.0))


def double_l_system(force, model: str, *, damping=(0.0, 0.0, 0.0), right=None) -> SecondOrderSystem:
    kinematics, geometric = MODELS[model]
    vehicle = double_l(
        force, height=H0, speed=V0, gap=G0, kinematics=kinematics, geometric_stiffness=geometric, damping=damping,
        force_right=right,
    )  # fmt: skip
    return linearize(vehicle, equilibrium(vehicle, OperatingPoint(V0, H0), hold="frozen"))


def physical(matrix: np.ndarray) -> np.ndarray:
    """Our order (sway, heave, roll) to the theory's (z, theta, y)."""
    order = [1, 2, 0]
    return matrix[np.ix_(order, order)]


def squared_frequencies(system: SecondOrderSystem) -> np.ndarray:
    w2 = np.linalg.eigvals(np.linalg.solve(system.M, system.K)).astype(complex)
    rounded = np.round(w2.real, 6) + 1j * w2.imag
    return w2[np.lexsort((rounded.imag, rounded.real))]


@pytest.mark.parametrize(
    ("gap_mm", "expected"),
    [(5.0, [0.2186, 0.19674, 0.09837, 0.0966]), (12.7, [0.2032, 0.18288, 0.09144, 0.0889]),
     (25.0, [0.1786, 0.16074, 0.08037, 0.0766])],
)  # fmt: skip
def test_double_l_geometry(gap_mm, expected) -> None:
    np.testing.assert_allclose(double_l_geometry(gap_mm * 1e-3), expected, rtol=1e-12)


S1_P = [715.1811049723757 - 283.13088509111276j, 715.1811049723757 + 283.13088509111276j, 784.532]


@pytest.mark.parametrize(
    ("point", "model", "expected"),
    [
        (S1, "P", S1_P),
        (S1, "CG", [249.76832194956913, 784.532, 1765.7740610821445]),
        (S2, "C", [310.4197532803867 - 254.42407894527528j, 310.4197532803867 + 254.42407894527528j, 509.9458]),
        (S3, "P", [715.1811049723757 - 238.1838141854375j, 715.1811049723757 + 238.1838141854375j, 784.532]),
        (S3, "CG", [271.26265668704906, 784.532, 1539.4778644662115]),
        (S4, "C", [-90.34032421328605, 784.532, 799.7241278044463]),
    ],
)
def test_double_l_squared_frequencies(point, model, expected) -> None:
    w2 = squared_frequencies(double_l_system(sample(**point), model))
    np.testing.assert_allclose(w2, expected, rtol=1e-8, atol=1e-6)


def test_double_l_in_paper_coordinates() -> None:
    system = double_l_system(sample(**S1), "P")
    m, inertia, b = system.M[0, 0], system.M[2, 2], 0.0889
    T = np.array([[0.5, 0.5, 0], [0.5 / b, -0.5 / b, 0], [0, 0, 1]])
    S = np.diag([2 / m, -2 * b / inertia, 1 / m])
    expected = [
        784.532, 784.532, 0, -841.9632099447514, 841.9632099447514, -1635.570424723757, -58.8399, 58.8399, 588.399,
    ]  # fmt: skip
    np.testing.assert_allclose((S @ physical(system.K) @ T).ravel(), expected, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(S @ physical(system.M) @ T, [[1, 1, 0], [-1, 1, 0], [0, 0, 1]], rtol=1e-12, atol=1e-12)


def test_printed_equations_48_to_50_are_refuted() -> None:
    literal = [715.1811049723757 - 261.6243752332721j, 715.1811049723757 + 261.6243752332721j, 784.532]
    for model in MODELS:
        w2 = squared_frequencies(double_l_system(sample(**S1), model))
        assert np.max(np.abs(w2 - literal)) > 10.0


def test_mirrored_double_l_has_the_same_frequencies_and_a_mixed_convention_has_not() -> None:
    force = sample(**S1)
    vehicle = double_l(force, height=H0, speed=V0, kinematics="paper", geometric_stiffness=False)
    left, right = vehicle.magnets
    mirrored = replace(vehicle, magnets=(
        replace(left, position=right.position, side=-1), replace(right, position=left.position, side=1),
    ))  # fmt: skip
    at = OperatingPoint(V0, H0)
    np.testing.assert_allclose(squared_frequencies(linearize(mirrored, at)), S1_P, rtol=1e-8)
    # Mixed: side 1 at -y, where F_G1 = G(h, g0 + y) pushes to +y, but the roll moment still +a (F_G1 + F_G2).
    K = physical(linearize(vehicle, at).K).copy()
    a, b, s = 0.09144, 0.0889, S1
    K[1, 2] = -(2 * b * s["k_lg"] + 2 * a * s["k_gg"])  # the correct one, mirrored, is -2 b k_lg + 2 a k_gg
    K[2, 1] = -2 * b * s["k_gl"]
    K[1, 1] = -2 * b * b * s["k_ll"] - 2 * a * b * s["k_gl"]
    M = physical(linearize(vehicle, at).M)
    mixed = np.linalg.eigvals(np.linalg.solve(M, K))
    assert np.max(np.abs(np.sort_complex(mixed) - np.sort_complex(np.array(S1_P)))) > 10.0


def general_K(one: dict[str, float], two: dict[str, float], *, kappa: float, gamma: float) -> np.ndarray:
    """Sec. 2.4's off-centre formulas in (z, theta, y)."""
    _, _, a, b = double_l_geometry(G0)

    def s(key: str) -> float:
        return one[key] + two[key]

    def d(key: str) -> float:
        return one[key] - two[key]

    roll = -(b**2) * s("k_ll") + a * b * s("k_gl") + kappa * (a * b * s("k_lg") - a**2 * s("k_gg"))
    roll -= gamma * (a * s("L") + b * s("G"))
    return np.array([
        [-s("k_ll"), -b * d("k_ll") + kappa * a * d("k_lg"), d("k_lg")],
        [a * d("k_gl") - b * d("k_ll"), roll, b * s("k_lg") - a * s("k_gg")],
        [d("k_gl"), b * s("k_gl") - kappa * a * s("k_gg"), -s("k_gg")],
    ])  # fmt: skip


OFF_1 = {"k_ll": -400.0, "k_lg": 20.0, "k_gl": -60.0, "k_gg": -300.0, "L": 5.0, "G": 4.0}
OFF_2 = {"k_ll": -380.0, "k_lg": 12.0, "k_gl": -45.0, "k_gg": -210.0, "L": 5.0, "G": 2.0}


def test_off_centre_double_l() -> None:
    for model, (kappa, gamma) in {"P": (0, 0), "C": (1, 0), "CG": (1, 1)}.items():
        system = double_l_system(sample(**OFF_1), model, right=sample(**OFF_2))
        np.testing.assert_allclose(
            physical(system.K), general_K(OFF_1, OFF_2, kappa=kappa, gamma=gamma), rtol=1e-11, atol=1e-11
        )
    w2 = squared_frequencies(double_l_system(sample(**OFF_1), "C", right=sample(**OFF_2)))
    np.testing.assert_allclose(w2, [275.97381070187305, 765.185666375699, 1772.5905475080633], rtol=1e-8)
    # Mutant: sides exchanged in the roll-sway coupling.
    mutant = general_K(OFF_2, OFF_1, kappa=1, gamma=0)
    assert not np.allclose(mutant, general_K(OFF_1, OFF_2, kappa=1, gamma=0))


def test_roll_sway_determinants() -> None:
    for model, expected in {"P": 1043.22372, "C": 1043.22372, "CG": 880.66372}.items():
        K = physical(double_l_system(sample(**S2), model).K)[1:, 1:]
        assert np.linalg.det(K) == pytest.approx(expected, rel=1e-9)


def test_roll_sway_block_and_critical_damping() -> None:
    system = double_l_system(sample(**S1), "P")
    A = physical(np.linalg.solve(system.M, system.K))[1:, 1:]
    np.testing.assert_allclose(
        A.ravel(), [841.9632099447514, 9198.933772349588, -10.46173422, 588.399], rtol=1e-9
    )  # fmt: skip
    m, inertia, e = system.M[0, 0], system.M[2, 2], 3.3321052564723406
    for factor, stable in ((1 + 1e-6, True), (1 - 1e-6, False)):
        damping = (0.0, factor * e * inertia, factor * 10 * e * m)
        damped = double_l_system(sample(**S1), "P", damping=damping)
        np.testing.assert_allclose(np.diag(physical(damped.C)), damping)
        growth = np.max(np.sort(np.linalg.eigvals(physical_state(damped)).real))
        assert bool(growth < 0.0) is stable


def physical_state(system: SecondOrderSystem) -> np.ndarray:
    """State matrix of roll and sway alone (heave is undamped here and sits on the axis)."""
    M, C, K = (physical(matrix)[1:, 1:] for matrix in (system.M, system.C, system.K))
    return np.block([[np.zeros((2, 2)), np.eye(2)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])


# --- Table 1 -----------------------------------------------------------------------------------------------------

# R = v1/v3 of modes 2 and 3; the columns at 25 mm are real and imaginary part of one complex vector.
RATIOS = {
    15: (-1.0 / 0.009, -0.545),
    25: ((0.586 - 0.810j) / (-0.332 + 0.060j), (0.586 + 0.810j) / (-0.332 - 0.060j)),
    37: (1.0 / 0.205, 1.0 / 0.448),
}


def table_1_sample(height_mm: int, k_lg: float = 0.0) -> tuple[PrescribedForce, float, float]:
    """Partials with k_gl = -1 that have the mode ratios of Table 1 under the paper's kinematics; k_ll, k_gg."""
    width, body_height, a, b = double_l_geometry(G0)
    mass_ratio = 12.0 / (width**2 + body_height**2)
    first, second = RATIOS[height_mm]
    S, P = (first + second).real, (first * second).real
    k_gg = (P + mass_ratio * b * b * k_lg) / (mass_ratio * a * b)
    k_ll = (mass_ratio * a * b + k_gg - S) / (mass_ratio * b * b)
    return sample(-k_ll, -k_lg, -1.0, -k_gg), k_ll, k_gg


@pytest.mark.parametrize(
    ("height_mm", "P", "k_gg", "expected"),
    [
        (15, 60.55555555555556, 46.393885949441504, [1.0, 1.2542576501184293, 0.37378786634616823]),
        (25, 8.781065504638741, 6.7275041538184635,
         [1.0, 0.9140854704716328 - 0.21179095305834944j, 0.9140854704716328 + 0.21179095305834944j]),
        (37, 10.888501742160278, 8.342090223623325, [1.0, 1.7325915798406488, 3.055980574773816]),
    ],
)  # fmt: skip
def test_table_1(height_mm, P, k_gg, expected) -> None:
    force, k_ll, implied = table_1_sample(height_mm)
    assert implied == pytest.approx(k_gg, rel=1e-9)
    system = double_l_system(force, "P")
    K, M = physical(system.K), physical(system.M)
    # v1 = z + b theta = b theta in these modes, so P = b^2 (theta1 theta2)/(y1 y2) = -b^2 (m/I) K_thy / K_yth.
    assert -(0.0889**2) * M[2, 2] / M[1, 1] * K[1, 2] / K[2, 1] == pytest.approx(P, rel=1e-10)
    w2, vectors = np.linalg.eig(np.linalg.solve(M, K))
    ratios = w2 / (2.0 * k_ll / M[0, 0])
    for value, mode in zip(expected, (None, *RATIOS[height_mm]), strict=True):
        k = int(np.argmin(np.abs(ratios - value)))
        assert ratios[k] == pytest.approx(value, rel=1e-9)
        if mode is not None:
            found = 0.0889 * vectors[1, k] / vectors[2, k]
            assert min(abs(found - mode), abs(found - np.conj(mode))) < 1e-9 * abs(mode)


def test_table_1_column_is_one_complex_vector() -> None:
    assert abs(0.586 - 0.810j) == pytest.approx(0.999747968239996, rel=1e-12)


def test_table_1_flutter_needs_a_large_k_lg_once_the_kinematics_is_right() -> None:
    threshold = -5.919718558213277
    for t, sign in ((threshold * (1 + 1e-8), 1.0), (threshold * (1 - 1e-8), -1.0)):
        system = double_l_system(table_1_sample(25, k_lg=t)[0], "C")
        assert np.sign(physical(system.K)[2, 1] * physical(system.K)[1, 2]) == -sign
    for t in (0.0, 1.0, -5.0):
        assert np.max(np.abs(squared_frequencies(double_l_system(table_1_sample(25, k_lg=t)[0], "C")).imag)) < 1e-9
    assert np.max(np.abs(squared_frequencies(double_l_system(table_1_sample(25)[0], "P")).imag)) > 1.0


def test_a_conservative_field_flutters_only_in_the_papers_kinematics() -> None:
    """k_gl = k_lg is a field with a potential: no undamped flutter, whatever the sample."""
    rng = np.random.default_rng(7)
    for _ in range(50):
        k_ll, k_lg, k_gg = rng.uniform(-500.0, 100.0, 3)
        system = double_l_system(sample(k_ll, k_lg, k_lg, k_gg), "CG")
        np.testing.assert_allclose(system.K, system.K.T, atol=1e-9)
    assert not np.allclose(double_l_system(sample(**S3), "P").K, double_l_system(sample(**S3), "P").K.T, atol=1e-3)


def test_outside_the_samples_nothing_is_extrapolated() -> None:
    vehicle = double_l(sample(**S1), height=H0, speed=V0)
    with pytest.raises(OutOfDomain):
        linearize(vehicle, OperatingPoint(V0, 20.0))
