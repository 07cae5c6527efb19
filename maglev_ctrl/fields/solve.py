"""Solve a conducting guideway once: formulation A (vector potential, electric potential in the metal) per wavenumber.

With fields e^{ikx}, A = (a_x, i a_y, i a_z), V = -s phi and the reaction potential a as unknown,
(-lap + k^2) a + i s mu_0 sigma (a + source + grad phi) = 0, div J = 0 in the metal, no flux of J through its surface.
The basis of the reduction is made of solutions at real positive rates (i s -> p), where the matrices are positive
definite, and of the sources themselves, which hold most of what rates above the range would add.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import scipy.linalg
import scipy.sparse as sparse
from scipy.sparse.linalg import splu
from scipy.special import k0, k1

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.fields.discretize import MU_0, Discretization, discretize
from maglev_ctrl.fields.mesh import Triangulation, triangulate
from maglev_ctrl.fields.response import GuidewayResponse, Region
from maglev_ctrl.fields.section import CrossSection
from maglev_ctrl.fields.spread import Progress, Spread, in_order, one_by_one
from maglev_ctrl.fields.wavenumbers import gauss_points, panels

_SKIN_DEPTHS = 2.5
"""Edge length in metal as a share of the skin depth, before `Fineness.in_conductor`."""
_AIR_GROWTH = 0.7
"""How fast edges grow with the distance from metal."""


@dataclass(frozen=True, slots=True)
class Fineness:
    """How finely a guideway is solved.

    Parameters
    ----------
    finest, in_conductor : edge lengths at corners, as a share of the coils' least clearance, and elsewhere, as a share
        of the distance from where coils may be, and of 2.5 times the skin depth of waves of that length at top speed
    order : polynomial order of the elements
    points : Gauss points on each panel of wavenumbers
    tolerance : relative error of a coil's potential in the basis of sources
    rates_per_decade : how many real rates per factor of ten in speed and frequency
    """

    finest: float
    in_conductor: float
    order: int
    points: int
    tolerance: float
    rates_per_decade: float


def solve_guideway(
    section: CrossSection,
    *,
    regions: Sequence[Region],
    speeds: tuple[float, float],
    frequency: float,
    fineness: Fineness,
    spread: Spread = one_by_one,
    progress: Progress | None = None,
) -> GuidewayResponse:
    """Current patterns of a guideway for every coil whose lines stay in the regions.

    Parameters
    ----------
    regions : boxes of the cross-section, clear of every conductor
    speeds : least and largest speed, m/s
    frequency : largest angular frequency of the coil's own motion, rad/s
    spread : shares the wavenumbers out; by default they are solved one by one
    progress : called with the fraction done

    Raises
    ------
    ValueError : a region that touches a conductor, a speed that is not positive
    """
    ends, k, task = _prepared(section, regions, speeds, frequency, fineness, fineness.order)
    found: list[Pattern] = in_order(task, k.tolist(), spread=spread, progress=progress)
    modes = max(len(pattern.time_constants) for pattern in found)
    projections = np.zeros((len(k), found[0].projection.shape[1], modes))
    time_constants = np.zeros((len(k), modes))
    for i, pattern in enumerate(found):
        projections[i, :, : len(pattern.time_constants)] = pattern.projection.T
        time_constants[i, : len(pattern.time_constants)] = pattern.time_constants
    return GuidewayResponse(
        panels=ends, wavenumbers=k, samples=task.args[0].samples,
        projections=projections, time_constants=time_constants,
        regions=tuple(regions), speeds=speeds, frequency=frequency,
    )  # fmt: skip


def refined_patterns(
    section: CrossSection,
    response: GuidewayResponse,
    indices: Sequence[int],
    *,
    fineness: Fineness,
    spread: Spread = one_by_one,
    progress: Progress | None = None,
) -> list[Pattern]:
    """Some wavenumbers of a response solved again: elements of one order more, twice the rates, a finer basis."""
    finer = replace(
        fineness,
        tolerance=0.03 * fineness.tolerance,
        rates_per_decade=2.0 * fineness.rates_per_decade,
    )
    _, k, task = _prepared(
        section, response.regions, response.speeds, response.frequency, finer, min(fineness.order + 1, 4)
    )
    return in_order(task, k[list(indices)].tolist(), spread=spread, progress=progress)


def _prepared(
    section: CrossSection,
    regions: Sequence[Region],
    speeds: tuple[float, float],
    frequency: float,
    fineness: Fineness,
    order: int,
) -> tuple[FloatArray, FloatArray, partial[Pattern]]:
    """Panels, wavenumbers, and the task that solves one of them."""
    if not 0.0 < speeds[0] <= speeds[1]:
        raise ValueError(f"speed: expected positive speeds, the least first, got {speeds}; at rest there is no force")
    clearance = _least_clearance(section, regions)
    ends = panels(clearance, section.size)
    conductivities = np.array([conductor.conductivity for conductor in section.conductors])
    mesh = guideway_mesh(section, regions=regions, speeds=speeds, frequency=frequency, fineness=fineness)
    task = partial(
        current_patterns, discretize(mesh, conductivities, order=order),
        candidates=np.concatenate([_dipole_places(region, clearance) for region in regions], axis=1),
        speeds=speeds, frequency=frequency, fineness=fineness,
    )  # fmt: skip
    return ends, gauss_points(ends, fineness.points), task


def guideway_mesh(
    section: CrossSection,
    *,
    regions: Sequence[Region],
    speeds: tuple[float, float],
    frequency: float,
    fineness: Fineness,
) -> Triangulation:
    """The mesh a guideway is solved on, fine where coils come near.

    Parameters
    ----------
    regions, speeds, frequency, fineness : as for `solve_guideway`

    Raises
    ------
    ValueError : a region that touches a conductor
    """
    clearance = _least_clearance(section, regions)
    conductivity = max(conductor.conductivity for conductor in section.conductors)
    spacing = partial(
        _local_spacing,
        section=section,
        regions=tuple(regions),
        share=fineness.in_conductor,
        induction=MU_0 * conductivity * (speeds[1] + frequency * clearance),
    )
    coarsest = max(8.0 * clearance, 0.1 * section.size)
    return triangulate(section, finest=fineness.finest * clearance, in_conductor=coarsest, growth=0.5, local=spacing)


def _least_clearance(section: CrossSection, regions: Sequence[Region]) -> float:
    return min(_clearance(section, region) for region in regions)


def _local_spacing(
    points: FloatArray, *, section: CrossSection, regions: tuple[Region, ...], share: float, induction: float
) -> FloatArray:
    """Edge length at points (n, 2): fields of length d, the distance from the coils, and their skin depth; m."""
    away = np.full(len(points), np.inf)
    for (left, right), (low, high) in regions:
        y, z = points.T
        dy, dz = np.maximum(np.maximum(left - y, y - right), 0.0), np.maximum(np.maximum(low - z, z - high), 0.0)
        away = np.minimum(away, np.hypot(dy, dz))
    in_metal = share * np.minimum(away, _SKIN_DEPTHS * np.sqrt(2.0 * away / induction))
    # The reaction field in the air, also between the coils, is the smoother the farther from the metal.
    return np.asarray(in_metal + _AIR_GROWTH * np.maximum(section.distance(points), 0.0))


def _rates(wavenumber: float, speeds: tuple[float, float], frequency: float, per_decade: float) -> list[float]:
    """Real rates over the range of |w + k v|, evenly on a logarithmic scale."""
    low, high = wavenumber * speeds[0], wavenumber * speeds[1] + frequency
    count = 2 + int(np.ceil(per_decade * np.log10(high / low) - 1e-9))
    # One rate less than a quarter decade outside each end: the ends are approached from both sides.
    return [float(rate) for rate in np.geomspace(low / 1.5, high * 1.5, count)]


def _outline(region: Region, points: int) -> FloatArray:
    (left, right), (low, high) = region
    t = np.linspace(0.0, 1.0, points)
    y, z = left + (right - left) * t, low + (high - low) * t
    one = np.ones_like(t)
    sides = ((y, low * one), (y, high * one), (left * one, z), (right * one, z))
    return np.concatenate([np.stack(side) for side in sides], axis=1)


def _clearance(section: CrossSection, region: Region) -> float:
    """Least distance of a region from any conductor; refuses regions that touch one."""
    least = float(np.min(section.distance(_outline(region, 60).T)))
    (left, right), (low, high) = region
    corners = np.concatenate([c.outline for c in section.conductors])
    held = (corners[:, 0] > left) & (corners[:, 0] < right) & (corners[:, 1] > low) & (corners[:, 1] < high)
    if least <= 0.0 or np.any(held):
        raise ValueError(
            f"coil: a coil that moves through y = {left * 1e3:.4g} to {right * 1e3:.4g} mm, z = {low * 1e3:.4g} to "
            f"{high * 1e3:.4g} mm touches the guideway; expected a gap between them everywhere"
        )
    return least


def _dipole_places(region: Region, clearance: float) -> FloatArray:
    """Places for dipole lines on a region's outline, close enough to stand for any coil inside it; (2, c)."""
    (left, right), (low, high) = region
    longest = max(right - left, high - low)
    return np.unique(_outline(region, int(np.clip(np.ceil(2.0 * longest / clearance), 12, 60))), axis=1)


@dataclass(frozen=True, eq=False, slots=True)
class Pattern:
    """Patterns of one wavenumber: `projection` (modes, m) from samples to weights, `time_constants` (modes,) s."""

    projection: FloatArray
    time_constants: FloatArray


@dataclass(frozen=True, eq=False, slots=True)
class SourceBasis:
    """Potentials that span those of every coil in a region: `values` (4 n, r) at the nodes, `projection` (r, m)."""

    values: FloatArray
    projection: FloatArray


def current_patterns(
    mesh: Discretization,
    wavenumber: float,
    *,
    candidates: FloatArray,
    speeds: tuple[float, float],
    frequency: float,
    fineness: Fineness,
) -> Pattern:
    """Patterns and time constants of one wavenumber.

    Parameters
    ----------
    wavenumber : 1/m
    candidates : (2, c) m; dipole lines here span the potentials of every coil of the regions
    speeds, frequency : ranges the basis is made for, m/s and rad/s
    """
    rates = _rates(wavenumber, speeds, frequency, fineness.rates_per_decade)
    sources = source_basis(mesh, wavenumber, candidates=candidates, tolerance=fineness.tolerance)
    K, N = field_matrices(mesh, wavenumber)
    load = N @ sources.values
    parts = [sources.values]
    for rate in rates:
        lu = splu((K + rate * N).tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0,
                  options={"SymmetricMode": True})  # fmt: skip
        parts.append(rate * lu.solve(load))
    basis = np.concatenate(parts, axis=1)
    middle = float(np.exp(np.mean(np.log(rates))))
    weights, time_constants = _reduced(K, N, basis, load, middle)
    return Pattern(projection=weights.T @ sources.projection, time_constants=time_constants)


def _reduced(K: Any, N: Any, basis: FloatArray, load: FloatArray, rate: float) -> tuple[FloatArray, FloatArray]:
    """Weights (r, modes) and time constants of the pencil (K, N) on a basis, by the definite pencil (K, K + rate N)."""
    K_r, N_r = basis.T @ (K @ basis), basis.T @ (N @ basis)
    total = K_r + rate * N_r
    scale = 1.0 / np.sqrt(np.diag(total))
    values, vectors = np.linalg.eigh(scale[:, None] * total * scale)
    kept = values > 1e-12 * values[-1]
    V = scale[:, None] * vectors[:, kept] / np.sqrt(values[kept])
    share, turned = np.linalg.eigh(V.T @ K_r @ V)  # 0: all induction, 1: no current at all
    share = np.clip(share, 1e-15, 1.0)
    felt = (basis.T @ load).T @ V @ turned
    active = 1.0 - share > 1e-12
    share, felt = share[active], felt[:, active]
    weights = felt * np.sqrt(rate / (1.0 - share))
    return weights, (1.0 - share) / (share * rate)


def field_matrices(mesh: Discretization, wavenumber: float) -> tuple[Any, Any]:
    """K and N of (K + i s N) u = -i s N source, unknowns a_x, a_y, a_z, phi at the conductor's nodes."""
    k = wavenumber
    S = mesh.condensed(k)
    n = S.shape[0]
    m, y, z = mesh.weighted_mass, mesh.along_y, mesh.along_z
    N = sparse.block_array(
        [[m, None, None, -k * m],
         [None, m, None, y],
         [None, None, m, z],
         [-k * m, y.T, z.T, mesh.weighted_laplace + k * k * m]], format="csc",
    )  # fmt: skip
    return sparse.block_diag([S, S, S, sparse.csc_matrix((n, n))], format="csc"), N


def source_basis(mesh: Discretization, wavenumber: float, *, candidates: FloatArray, tolerance: float) -> SourceBasis:
    """Combinations of dipole lines, orthonormal on the conductors' surface, that span the region's sources."""
    k = wavenumber
    dy, dz, radius = _offsets(mesh.samples, candidates)
    f1 = -k * k1(k * radius) / radius / (2.0 * np.pi)
    root = np.sqrt(mesh.sample_weights)[:, None]
    sampled = root * np.concatenate([-dy * f1, -dz * f1], axis=1)
    norms = 1.0 / np.linalg.norm(sampled, axis=0)
    U, sigma, Vt = scipy.linalg.svd(sampled * norms, full_matrices=False)
    rank = int(np.sum(sigma > tolerance * sigma[0]))
    mix = norms[:, None] * Vt[:rank].T / sigma[:rank]

    dy, dz, radius = _offsets(mesh.nodes, candidates)
    f0 = MU_0 * k0(k * radius) / (2.0 * np.pi)
    f1 = -MU_0 * k * k1(k * radius) / radius / (2.0 * np.pi)
    nothing = np.zeros_like(f0)
    # A dipole along y and one along z: A = mu_0 curl (m G).
    along_y = np.concatenate([-dz * f1, nothing, k * f0, nothing])
    along_z = np.concatenate([dy * f1, -k * f0, nothing, nothing])
    return SourceBasis(values=np.concatenate([along_y, along_z], axis=1) @ mix, projection=U[:, :rank].T * root[:, 0])


def _offsets(points: FloatArray, sources: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    dy, dz = points[:, :, None] - sources[:, None, :]
    return dy, dz, np.hypot(dy, dz)
