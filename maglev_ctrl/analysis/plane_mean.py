"""Growth without modulation over a map: what a resonance is not needed for."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RegularGridInterpolator

from maglev_ctrl.analysis.plane_records import MapAxis, PeriodicFamily
from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.errors import ModelError, OutOfDomain

_LATTICE = 25  # points per axis at which the mean system is asked


def growth_without_modulation(family: PeriodicFamily, x: MapAxis, y: MapAxis, where: NDArray[np.bool_]) -> FloatArray:
    """Spectral abscissa of the mean system over a map (p, q), 1/s, interpolated from a coarse lattice.

    For names, not for verdicts. Only lattice points next to `where` are computed; -inf elsewhere and where the model
    has no answer.

    Parameters
    ----------
    family : see `stability_plane`
    x, y : the axes; the mean system does not depend on an axis that is `linear`
    where : (p, q) points of interest

    Examples
    --------
    >>> from maglev_ctrl.systems import PeriodicSystem
    >>> family = lambda x, y: PeriodicSystem.from_matrices([[y]], [[[0.1]]], frequency=x)
    >>> x, y = MapAxis("frequency", np.array([1.0, 2.0])), MapAxis("rate", np.array([-1.0, 0.0, 1.0]))
    >>> growth_without_modulation(family, x, y, np.ones((2, 3), dtype=bool)).tolist()
    [[-1.0, 0.0, 1.0], [-1.0, 0.0, 1.0]]
    """
    result = np.full(where.shape, -np.inf)
    if not np.any(where):
        return result
    rows, columns = _lattice(x), _lattice(y)
    own = np.full((len(rows), len(columns)), -np.inf)
    for a in range(len(rows)):
        for b in range(len(columns)):
            if np.any(where[_cell(rows, a, len(x.values)), _cell(columns, b, len(y.values))]):
                own[a, b] = _abscissa(family, float(x.values[rows[a]]), float(y.values[columns[b]]))
    own = np.repeat(own, 2, axis=0) if len(rows) == 1 else own
    own = np.repeat(own, 2, axis=1) if len(columns) == 1 else own
    places = [_ends(axis, chosen) for axis, chosen in ((x, rows), (y, columns))]
    known = np.where(np.isfinite(own), own, -1e300)  # an interpolation that meets one of these stays far below zero
    interpolate = RegularGridInterpolator((places[0], places[1]), known)
    i, j = np.nonzero(where)
    result[i, j] = interpolate(np.column_stack([x.values[i], y.values[j]]))
    return result


def _lattice(axis: MapAxis) -> NDArray[np.intp]:
    """Indices asked along an axis."""
    if axis.linear or len(axis.values) == 1:
        return np.zeros(1, dtype=np.intp)
    return np.unique(np.round(np.linspace(0, len(axis.values) - 1, _LATTICE)).astype(np.intp))


def _cell(chosen: NDArray[np.intp], k: int, count: int) -> slice:
    """Points that use lattice point k."""
    first = chosen[k - 1] if k else 0
    last = chosen[k + 1] if k + 1 < len(chosen) else count - 1
    return slice(int(first), int(last) + 1)


def _ends(axis: MapAxis, chosen: NDArray[np.intp]) -> FloatArray:
    """Places of the lattice; both ends of an axis that does not matter."""
    if len(chosen) > 1:
        return np.asarray(axis.values[chosen])
    low, high = float(axis.values[0]), float(axis.values[-1])
    return np.array([low, high if high > low else low + 1.0])


def _abscissa(family: PeriodicFamily, x: float, y: float) -> float:
    try:
        return float(np.max(np.linalg.eigvals(family(x, y).A_0).real))
    except (ModelError, OutOfDomain):
        return float("-inf")
