"""Eigenvalues and stability boundaries of the double-L vehicle (Figs. 10 and 12 to 15), each boundary in two ways.

One way goes through the vehicle assembly and numerical eigenvalues, the other through closed conditions on the four
stiffnesses of a magnet: for the centred vehicle Delta^2 < 4 beta and det < 0 of the roll-sway block, off centre the
discriminant and the determinant of the 3 x 3 problem. The two share nothing but the force model.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq, linear_sum_assignment

from maglev_ctrl.arrays import ComplexArray, FloatArray, read_only_any
from maglev_ctrl.errors import Agreement
from maglev_ctrl.forces import AbstractForceModel
from maglev_ctrl.study.paper.records import Boundary, EigenSweep, Instability, Model, Parameter
from maglev_ctrl.vehicle import OperatingPoint, equilibrium, linearize
from maglev_ctrl.vehicle.models import STANDARD_GRAVITY, double_l, double_l_geometry
from maglev_ctrl.vehicle.vehicle import Kinematics

SWITCHES: dict[Model, tuple[Kinematics, bool]] = {
    "P": ("paper", False), "C": ("consistent", False), "CG": ("consistent", True),
}  # fmt: skip
DENSE = 2001  # points of the closed conditions
CHECKED = 25  # points at which the assembled vehicle is asked too
SAME_PLACE = 1e-6  # m: two boundaries nearer than this are one
BRACKET = 2e-5  # m: how far from the closed boundary the eigenvalues are asked


@dataclass(frozen=True, eq=False, slots=True)
class Line:
    """A line of states: the height or the lateral offset varies; the mass is 2 F_L(h0, g0)/g with h0 the height."""

    force: AbstractForceModel
    speed: float
    gap: float
    parameter: Parameter
    height: float | None = None

    def state(self, value: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Heights and lateral offsets at values of the parameter, m."""
        values = np.asarray(value, dtype=np.float64)
        if self.parameter == "height":
            return values, np.zeros_like(values)
        assert self.height is not None
        return np.full_like(values, self.height), values


def closed_matrices(line: Line, value: ArrayLike, model: Model) -> tuple[FloatArray, FloatArray]:
    """Masses (..., 3) and stiffness (..., 3, 3) of heave, roll, sway from the closed formulas, off centre too.

    Parameters
    ----------
    value : (...) heights or lateral offsets, m

    Examples
    --------
    >>> from maglev_ctrl.forces import CornerImageForce
    >>> coil = CornerImageForce(6000.0, length=50.8e-3, width=25.4e-3, thickness=6.35e-3)
    >>> mass, K = closed_matrices(Line(coil, 36.1, 12.7e-3, "height"), 0.019, "P")
    >>> bool(K[0, 1] == 0.0), round(float(K[0, 0] / mass[0]), 4)
    (True, 1167.6114)
    """
    width, body, a, b = double_l_geometry(line.gap)
    height, offset = line.state(value)
    kappa, gamma = {"P": (0.0, 0.0), "C": (1.0, 0.0), "CG": (1.0, 1.0)}[model]
    mass = 2.0 * line.force.forces(height, np.full_like(height, line.gap), line.speed).lift / STANDARD_GRAVITY
    inertia = mass * (width**2 + body**2) / 12.0
    sums: dict[str, FloatArray] = {}
    differences: dict[str, FloatArray] = {}
    sides = [_side(line, height, gap) for gap in (line.gap - offset, line.gap + offset)]
    for key in sides[0]:
        sums[key], differences[key] = sides[0][key] + sides[1][key], sides[0][key] - sides[1][key]
    s, d = sums, differences
    K = np.empty((*np.shape(height), 3, 3))
    K[..., 0, 0] = -s["ll"]
    K[..., 0, 1] = -b * d["ll"] + kappa * a * d["lg"]
    K[..., 0, 2] = d["lg"]
    K[..., 1, 0] = a * d["gl"] - b * d["ll"]
    K[..., 1, 1] = -(b**2) * s["ll"] + a * b * s["gl"] + kappa * (a * b * s["lg"] - a**2 * s["gg"])
    K[..., 1, 1] -= gamma * (a * s["L"] + b * s["G"])
    K[..., 1, 2] = b * s["lg"] - a * s["gg"]
    K[..., 2, 0] = d["gl"]
    K[..., 2, 1] = b * s["gl"] - kappa * a * s["gg"]
    K[..., 2, 2] = -s["gg"]
    return np.stack([mass, inertia, mass], axis=-1), K


def _side(line: Line, height: FloatArray, gap: FloatArray) -> dict[str, FloatArray]:
    slopes, forces = line.force.derivatives(height, gap, line.speed), line.force.forces(height, gap, line.speed)
    return {
        "ll": slopes.by_height.lift, "lg": slopes.by_gap.lift, "gl": slopes.by_height.guidance,
        "gg": slopes.by_gap.guidance, "L": forces.lift, "G": forces.guidance,
    }  # fmt: skip


def assembled_squares(line: Line, value: float, model: Model) -> ComplexArray:
    """The three squared frequencies (1/s^2) of the vehicle assembled by the general code, frozen where it stands.

    The other way: nothing of the closed formulas is used. Off centre, dead loads supply side force and roll moment.
    """
    kinematics, geometric = SWITCHES[model]
    height, offset = (float(part) for part in line.state(value))
    vehicle = double_l(
        line.force, height=height, speed=line.speed, gap=line.gap, kinematics=kinematics,
        geometric_stiffness=geometric,
    )  # fmt: skip
    at = OperatingPoint(line.speed, height, lateral_offset=offset)
    system = linearize(vehicle, equilibrium(vehicle, at, hold="frozen"))
    return np.asarray(np.linalg.eigvals(np.linalg.solve(system.M, system.K)), dtype=np.complex128)


def conditions(line: Line, value: ArrayLike, model: Model) -> tuple[FloatArray, FloatArray]:
    """Two closed functions of the state, negative where the vehicle flutters and where it diverges.

    Centred: Delta^2 - 4 beta and det of roll and sway, as shares of the trace; off centre the discriminant and the
    determinant of M^-1 K as shares of its mean eigenvalue.
    """
    mass, K = closed_matrices(line, value, model)
    A = K / mass[..., :, None]
    if line.parameter == "height":
        block = A[..., 1:, 1:]
        size = np.abs(block[..., 0, 0]) + np.abs(block[..., 1, 1])
        delta = block[..., 0, 0] - block[..., 1, 1]
        cross = block[..., 0, 1] * block[..., 1, 0]
        det = block[..., 0, 0] * block[..., 1, 1] - cross
        return (delta**2 + 4.0 * cross) / size**2, det / size**2
    e1, e2, e3 = _invariants(A)
    size = np.sum(np.abs(np.diagonal(A, axis1=-2, axis2=-1)), axis=-1)
    discriminant = 18 * e1 * e2 * e3 - 4 * e1**3 * e3 + (e1 * e2) ** 2 - 4 * e2**3 - 27 * e3**2
    return discriminant / size**6, e3 / size**3


def _invariants(A: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    e1 = np.trace(A, axis1=-2, axis2=-1)
    e2 = 0.5 * (e1**2 - np.trace(A @ A, axis1=-2, axis2=-1))
    return e1, e2, np.asarray(np.linalg.det(A))


def sweep(key: str, line: Line, model: Model, low: float, high: float, *, points: int = 241) -> EigenSweep:
    """Squared frequencies over a range of the parameter and every stability boundary in it.

    Parameters
    ----------
    low, high : range of the parameter, m
    points : of the curves
    """
    values = np.linspace(low, high, points)
    mass, K = closed_matrices(line, values, model)
    squared = _modes(line, K / mass[..., :, None])
    boundaries, intervals, faults = _closed_boundaries(line, model, low, high)
    boundaries, more = _confirmed(line, model, boundaries)
    faults += more + _disagreements(line, model, np.linspace(low, high, CHECKED), boundaries, intervals)
    return EigenSweep(
        key=key, model=model, parameter=line.parameter, height=line.height, gap=line.gap,
        values=read_only_any(values), squared=read_only_any(squared), boundaries=boundaries,
        flutter=intervals["flutter"], divergence=intervals["divergence"],
        agreement=Agreement.UNRESOLVED if faults else Agreement.AGREED, reason="; ".join(faults),
    )  # fmt: skip


def unstable(squared: ComplexArray, *, tolerance: float = 1e-7) -> tuple[bool, bool]:
    """Whether squared frequencies tell of flutter (complex) and of divergence (real and negative).

    Examples
    --------
    >>> unstable(np.array([4.0, 1.0 + 0.5j, 1.0 - 0.5j])), unstable(np.array([4.0, -1.0, 1.0]))
    ((True, False), (False, True))
    """
    size = tolerance * float(np.max(np.abs(squared)))
    complex_pair = np.abs(squared.imag) > size
    return bool(np.any(complex_pair)), bool(np.any(~complex_pair & (squared.real < -size)))


def _closed_boundaries(
    line: Line, model: Model, low: float, high: float
) -> tuple[tuple[Boundary, ...], dict[Instability, tuple[tuple[float, float], ...]], list[str]]:
    """Boundaries and intervals from the closed conditions alone."""
    grid = np.linspace(low, high, DENSE)
    found: list[Boundary] = []
    intervals: dict[Instability, tuple[tuple[float, float], ...]] = {}
    faults: list[str] = []
    flutter, determinant = conditions(line, grid, model)
    kinds: tuple[Instability, Instability] = ("flutter", "divergence")
    for which, (kind, samples) in enumerate(zip(kinds, (flutter, determinant), strict=True)):

        def function(x: float, place: int = which) -> float:
            return float(conditions(line, x, model)[place])

        edges = [
            (float(brentq(function, a, b, xtol=1e-13)), bool(fa > 0.0))
            for a, b, fa, fb in zip(grid, grid[1:], samples, samples[1:], strict=False)
            if (fa < 0.0) != (fb < 0.0)
        ]
        found += [Boundary(kind, begins, x, float("nan")) for x, begins in edges]
        ends = [low, *(x for x, _ in edges), high]
        start = bool(samples[0] < 0.0)
        intervals[kind] = tuple((a, b) for i, (a, b) in enumerate(pairwise(ends)) if (i % 2 == 0) == start)
    # A positive determinant beside two negative real roots would be a divergence this count does not see.
    mass, K = closed_matrices(line, grid, model)
    e1, e2, e3 = _invariants(K / mass[..., :, None])
    if np.any((flutter >= 0.0) & (e3 > 0.0) & ((e1 <= 0.0) | (e2 <= 0.0))):
        faults.append("two squared frequencies are negative at once, which the determinant does not show")
    return tuple(sorted(found, key=lambda one: one.value)), intervals, faults


def _confirmed(line: Line, model: Model, boundaries: tuple[Boundary, ...]) -> tuple[tuple[Boundary, ...], list[str]]:
    """Each boundary found again from the eigenvalues of the assembled vehicle."""
    confirmed: list[Boundary] = []
    faults: list[str] = []
    for one in boundaries:
        place = _eigenvalue_boundary(line, model, one)
        confirmed.append(Boundary(one.kind, one.begins, one.value, place))
        if not abs(place - one.value) <= SAME_PLACE:
            faults.append(f"{one.kind} boundary at {1e3 * one.value:.4f} mm is not confirmed by the eigenvalues")
    return tuple(confirmed), faults


def _eigenvalue_boundary(line: Line, model: Model, one: Boundary) -> float:
    """Root, near a closed boundary, of a smooth function of the assembled vehicle's eigenvalues; NaN without one.

    Flutter: the product of (l_i - l_j)^2, real and smooth through the meeting of a pair; divergence: the product of
    the eigenvalues.
    """

    def function(x: float) -> float:
        squares = assembled_squares(line, x, model)
        squares = squares / np.max(np.abs(squares))
        if one.kind == "divergence":
            return float(np.prod(squares).real)
        pairs = [(squares[i] - squares[j]) ** 2 for i, j in ((0, 1), (0, 2), (1, 2))]
        return float(np.prod(pairs).real)

    a, b = one.value - BRACKET, one.value + BRACKET
    if (function(a) > 0.0) == (function(b) > 0.0):
        return float("nan")
    return float(brentq(function, a, b, xtol=1e-10))


def _disagreements(
    line: Line, model: Model, grid: FloatArray, boundaries: tuple[Boundary, ...],
    intervals: dict[Instability, tuple[tuple[float, float], ...]],
) -> list[str]:  # fmt: skip
    """Places of a coarse grid where the assembled vehicle's eigenvalues tell another story than the intervals."""
    faults = []
    for x in grid:
        if any(abs(x - one.value) < BRACKET for one in boundaries):
            continue
        told = unstable(assembled_squares(line, float(x), model))
        expected = tuple(any(a <= x <= b for a, b in intervals[kind]) for kind in ("flutter", "divergence"))
        if told != expected:
            faults.append(f"at {1e3 * x:.3f} mm the eigenvalues say {_words(told)}, the conditions {_words(expected)}")
    return faults


def _words(flags: tuple[bool, ...]) -> str:
    return " and ".join(word for word, flag in zip(("flutter", "divergence"), flags, strict=True) if flag) or "neither"


def _modes(line: Line, A: FloatArray) -> ComplexArray:
    """Columns heave, roll, sway (the paper's first to third mode), named where the vehicle is centred."""
    if line.parameter == "height":
        coupled = _followed(np.linalg.eigvals(A[..., 1:, 1:]).astype(np.complex128))
        return np.column_stack([A[..., 0, 0], coupled])
    squared, vectors = np.linalg.eig(A[len(A) // 2])
    middle = _followed(np.linalg.eigvals(A).astype(np.complex128))
    heave = int(np.argmax(np.abs(vectors[0]) / np.linalg.norm(vectors, axis=0)))
    first = int(np.argmin(np.abs(middle[len(A) // 2] - squared[heave])))
    others = [k for k in range(3) if k != first]
    others.sort(key=lambda k: -middle[len(A) // 2, k].real)
    return np.asarray(middle[:, [first, *others]])


def _followed(squared: NDArray[np.complex128]) -> ComplexArray:
    """Columns put in order so that each is one continuous branch; the first point by falling real part."""
    ordered = np.array(squared, dtype=np.complex128)
    ordered[0] = ordered[0][np.lexsort((ordered[0].imag, -ordered[0].real))]
    for row in range(1, ordered.shape[0]):
        before = ordered[row - 1] if row == 1 else 2.0 * ordered[row - 1] - ordered[row - 2]
        _, columns = linear_sum_assignment(np.abs(before[:, None] - ordered[row][None, :]))
        ordered[row] = ordered[row][columns]
    return np.asarray(ordered)


def root(squared: ComplexArray) -> ComplexArray:
    """omega_R + i omega_I = sqrt(lambda) with both parts not negative (Eq. 51 as corrected), 1/s.

    Examples
    --------
    >>> root(np.array([4.0, -9.0])).tolist()
    [(2+0j), 3j]
    """
    values = np.sqrt(np.asarray(squared, dtype=np.complex128))
    return np.asarray(np.abs(values.real) + 1j * np.abs(values.imag))


def damped_growth(line: Line, value: float, model: Model, ratio: float) -> float:
    """Largest growth rate (1/s) of the assembled vehicle with dampers to the guideway in heave, roll and sway.

    Parameters
    ----------
    value : of the line's parameter, m
    ratio : of each damper to 2 sqrt(M |K|) of its own coordinate
    """
    kinematics, geometric = SWITCHES[model]
    height, offset = (float(part) for part in line.state(value))
    mass, K = closed_matrices(line, value, model)
    heave, roll, sway = (2.0 * ratio * np.sqrt(mass * np.abs(np.diagonal(K)))).tolist()
    vehicle = double_l(
        line.force, height=height, speed=line.speed, gap=line.gap, kinematics=kinematics,
        geometric_stiffness=geometric, damping=(heave, roll, sway),
    )  # fmt: skip
    at = OperatingPoint(line.speed, height, lateral_offset=offset)
    system = linearize(vehicle, equilibrium(vehicle, at, hold="frozen"))
    return float(np.max(np.linalg.eigvals(system.state_matrix()).real))


def equal_damping_that_ends_flutter(line: Line, value: float, model: Model) -> float:
    """Damping ratio, one rate in roll and sway, above which a centred vehicle no longer flutters; 0 if it never did.

    c^2 = (4 beta - Delta^2) / 2 (A11 + A22), as a share of twice the root of the mean squared frequency.
    """
    mass, K = closed_matrices(line, value, model)
    A = (K / mass[:, None])[1:, 1:]
    excess = -4.0 * A[0, 1] * A[1, 0] - (A[0, 0] - A[1, 1]) ** 2
    mean = 0.5 * (A[0, 0] + A[1, 1])
    return float(np.sqrt(excess / (4.0 * mean)) / (2.0 * np.sqrt(mean))) if excess > 0.0 else 0.0
