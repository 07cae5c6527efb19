"""Table 1 and Fig. 11: mode vectors in the paper's coordinates, v1 and v2 the magnets' heave, v3 the sway."""

from __future__ import annotations

from typing import Final

import numpy as np

from maglev_ctrl.arrays import ComplexArray, read_only_any
from maglev_ctrl.forces import AbstractForceModel
from maglev_ctrl.study.paper.double_l import Line, closed_matrices
from maglev_ctrl.study.paper.records import Model, ModeTable
from maglev_ctrl.vehicle.models import double_l_geometry

# v3/v1 of the two coupled modes as printed; the columns at 25 mm are real and imaginary part of one complex vector.
PRINTED: Final[dict[float, tuple[complex, complex]]] = {
    0.015: (-0.009, 1.0 / -0.545),
    0.025: ((-0.332 + 0.060j) / (0.586 - 0.810j), (-0.332 - 0.060j) / (0.586 + 0.810j)),
    0.037: (0.205, 0.448),
}


def mode_table(force: AbstractForceModel, *, height: float, gap: float, speed: float, model: Model) -> ModeTable:
    """The three modes at one height: heave first, then the coupled ones, the one with less sway first.

    Parameters
    ----------
    height, gap : m
    speed : m/s

    Examples
    --------
    >>> from maglev_ctrl.forces import CornerImageForce
    >>> coil = CornerImageForce(6000.0, length=50.8e-3, width=25.4e-3, thickness=6.35e-3)
    >>> found = mode_table(coil, height=0.019, gap=0.0127, speed=36.1, model="P")
    >>> found.vectors[:, 0].tolist(), round(found.squared[1].real)
    ([(1+0j), (1+0j), 0j], 1533)
    """
    mass, K = closed_matrices(Line(force, speed, gap, "height"), height, model)
    _, _, _, b = double_l_geometry(gap)
    to_paper = np.array([[1.0, b, 0.0], [1.0, -b, 0.0], [0.0, 0.0, 1.0]])  # (z, theta, y) to (v1, v2, v3)
    heave = K[0, 0] / mass[0]
    squared, vectors = np.linalg.eig((K / mass[:, None])[1:, 1:])
    coupled = to_paper[:, 1:] @ vectors.astype(np.complex128)
    order = np.argsort(np.abs(coupled[2] / coupled[0]), kind="stable")
    if np.any(np.abs(squared.imag) > 0.0):
        order = np.argsort(squared.imag)[::-1]
    squared, coupled = squared[order], coupled[:, order]
    return ModeTable(
        height, model,
        read_only_any(np.concatenate([[heave], squared]).astype(np.complex128)),
        read_only_any(np.column_stack([[1.0, 1.0, 0.0], *(_normalised(column) for column in coupled.T)])),
    )  # fmt: skip


def _normalised(column: ComplexArray) -> ComplexArray:
    """Largest modulus 1, that entry real and positive; the rule leaves the phase of a complex vector free."""
    return np.asarray(column / column[int(np.argmax(np.abs(column)))])


def ratios(table: ModeTable) -> tuple[complex, complex]:
    """v3/v1 of the two coupled modes."""
    first, second = table.vectors[2, 1:] / table.vectors[0, 1:]
    return complex(first), complex(second)
