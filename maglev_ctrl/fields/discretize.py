"""Finite elements of a guideway's cross-section: the scalar matrices every wavenumber is put together from.

One scalar space serves the three components of the vector potential (everywhere) and the electric potential (conductor
only). The air is needed for the vector potential alone, whose three components obey the same scalar equation there; it
is condensed onto the conductor's surface once per wavenumber.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sparse
from numpy.typing import NDArray
from scipy.sparse.linalg import splu
from skfem import Basis, BilinearForm, ElementTriP2, ElementTriP3, ElementTriP4, MeshTri
from skfem.helpers import dot, grad

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.fields.mesh import Triangulation

IndexArray = NDArray[np.intp]
MU_0 = 4e-7 * np.pi
_ELEMENTS = {2: ElementTriP2, 3: ElementTriP3, 4: ElementTriP4}


@dataclass(frozen=True, eq=False, slots=True)
class Discretization:
    """Scalar matrices of one mesh; n conductor nodes, of them b on the surface, and a air nodes.

    `nodes` (2, n) m; `surface` (b,) indices of surface nodes among the conductor's;
    `laplace_conductor`, `mass_conductor` (n, n): of the metal alone, the part of the scalar operator the metal gives;
    `laplace_air`, `mass_air` (a + b, a + b): of the air, air nodes first, then the surface nodes;
    `weighted_mass`, `weighted_laplace`, `along_y`, `along_z` (n, n): with mu_0 sigma as weight, the last two
    Int test d(trial)/dy and /dz;
    `samples` (2, m) points on the conductors' surface and `sample_weights` (m,) their share of its length.
    """

    nodes: FloatArray
    surface: IndexArray
    laplace_conductor: Any
    mass_conductor: Any
    laplace_air: Any
    mass_air: Any
    weighted_mass: Any
    weighted_laplace: Any
    along_y: Any
    along_z: Any
    samples: FloatArray
    sample_weights: FloatArray

    def condensed(self, wavenumber: float) -> Any:
        """The scalar operator -lap + k^2 on the conductor's nodes with the air condensed; dense on the surface, sparse
        inside; (n, n) CSC."""
        k2 = wavenumber**2
        air = (self.laplace_air + k2 * self.mass_air).tocsr()
        a = air.shape[0] - len(self.surface)
        inner, coupling = air[:a, :a].tocsc(), air[:a, a:].tocsc()
        # Only nodes beside the surface are coupled to it, but every one of the inner ones answers.
        lu = splu(inner, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
        schur = air[a:, a:].toarray() - coupling.T @ lu.solve(coupling.toarray())
        schur = 0.5 * (schur + schur.T)
        own = (self.laplace_conductor + k2 * self.mass_conductor).tocoo()
        rows, columns = (grid.ravel() for grid in np.meshgrid(self.surface, self.surface, indexing="ij"))
        return sparse.coo_matrix(
            (
                np.concatenate([own.data, schur.ravel()]),
                (np.concatenate([own.row, rows]), np.concatenate([own.col, columns])),
            ),
            shape=own.shape,
        ).tocsc()


def discretize(mesh: Triangulation, conductivities: FloatArray, *, order: int) -> Discretization:
    """Assemble the scalar matrices.

    Parameters
    ----------
    conductivities : (c,) of each conductor, S/m
    order : polynomial order of the elements, 2 to 4
    """
    grid = MeshTri(np.ascontiguousarray(mesh.points), np.ascontiguousarray(mesh.triangles))
    element = _ELEMENTS[order]()
    metal = np.flatnonzero(mesh.conductor >= 0)
    air = np.flatnonzero(mesh.conductor < 0)
    inside = Basis(grid, element, elements=metal, intorder=2 * order)
    outside = Basis(grid, element, elements=air, intorder=2 * order)
    in_metal = np.unique(inside.element_dofs)
    in_air = np.unique(outside.element_dofs)
    boundary = Basis(grid, element).get_dofs().all()
    surface = np.intersect1d(in_metal, in_air)
    free_air = np.setdiff1d(np.setdiff1d(in_air, surface), boundary)
    order_air = np.concatenate([free_air, surface])

    weight = np.repeat((MU_0 * conductivities[mesh.conductor[metal]])[:, None], inside.X.shape[1], axis=1)
    weighted = {"weight": weight}
    lap_in, mass_in = BilinearForm(_laplace).assemble(inside), BilinearForm(_mass).assemble(inside)
    lap_out, mass_out = BilinearForm(_laplace).assemble(outside), BilinearForm(_mass).assemble(outside)

    def cut(matrix: Any, index: IndexArray) -> Any:
        return matrix.tocsr()[index][:, index].tocsc()

    samples, sample_weights = _surface_samples(mesh)
    return Discretization(
        nodes=inside.doflocs[:, in_metal],
        surface=np.searchsorted(in_metal, surface),
        laplace_conductor=cut(lap_in, in_metal),
        mass_conductor=cut(mass_in, in_metal),
        laplace_air=cut(lap_out, order_air),
        mass_air=cut(mass_out, order_air),
        weighted_mass=cut(BilinearForm(_weighted_mass).assemble(inside, **weighted), in_metal),
        weighted_laplace=cut(BilinearForm(_weighted_laplace).assemble(inside, **weighted), in_metal),
        along_y=cut(BilinearForm(_along_y).assemble(inside, **weighted), in_metal),
        along_z=cut(BilinearForm(_along_z).assemble(inside, **weighted), in_metal),
        samples=samples,
        sample_weights=sample_weights,
    )


def _surface_samples(mesh: Triangulation, points: int = 2) -> tuple[FloatArray, FloatArray]:
    """Gauss points on the edges between metal and air, and their weights."""
    edges = np.sort(mesh.triangles[[[0, 1], [1, 2], [2, 0]]].transpose(0, 2, 1).reshape(-1, 2), axis=1)
    metal = np.tile(mesh.conductor >= 0, 3)
    unique, place = np.unique(edges, axis=0, return_inverse=True)
    in_metal = np.bincount(place, weights=metal) > 0
    in_air = np.bincount(place, weights=~metal) > 0
    ends = mesh.points[:, unique[in_metal & in_air]]
    x, w = np.polynomial.legendre.leggauss(points)
    start, along = ends[:, :, 0], ends[:, :, 1] - ends[:, :, 0]
    samples = start[:, :, None] + 0.5 * (x + 1.0) * along[:, :, None]
    weights = 0.5 * w * np.hypot(*along)[:, None]
    return samples.reshape(2, -1), weights.ravel()


def _laplace(u: Any, v: Any, w: Any) -> Any:
    return dot(grad(u), grad(v))


def _mass(u: Any, v: Any, w: Any) -> Any:
    return u * v


def _weighted_laplace(u: Any, v: Any, w: Any) -> Any:
    return w.weight * dot(grad(u), grad(v))


def _weighted_mass(u: Any, v: Any, w: Any) -> Any:
    return w.weight * u * v


def _along_y(u: Any, v: Any, w: Any) -> Any:
    return w.weight * v * grad(u)[0]


def _along_z(u: Any, v: Any, w: Any) -> Any:
    return w.weight * v * grad(u)[1]
