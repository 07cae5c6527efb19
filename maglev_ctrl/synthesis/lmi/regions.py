"""Regions of the complex plane for closed-loop poles: L + s M + conj(s) M' < 0 (Chilali & Gahinet, IEEE TAC 41, 1996).

A matrix A has all its poles in the region exactly if some X > 0 has L (x) X + M (x) (A X) + M' (x) (A X)' < 0.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import block_diag

from maglev_ctrl.arrays import FloatArray, read_only


@dataclass(frozen=True, eq=False, slots=True)
class Region:
    """Poles s with L + s M + conj(s) M' < 0; `L` (r, r) symmetric, `M` (r, r), `label` in words."""

    label: str
    L: FloatArray
    M: FloatArray


def half_plane(rate: float) -> Region:
    """Poles left of -rate: every mode decays at `rate` (1/s) or faster.

    Examples
    --------
    >>> bool(contains(half_plane(2.0), [-2.1 + 5.0j])[0])
    True
    """
    return _region(f"decay rate above {_finite('rate', rate):g} 1/s", [[2.0 * rate]], [[1.0]])


def strip(fastest: float) -> Region:
    """Poles right of -fastest: no mode decays faster than `fastest` (1/s); the law stays inside a bandwidth.

    Examples
    --------
    >>> bool(contains(strip(10.0), [-11.0])[0])
    False
    """
    return _region(f"decay rate below {_positive('fastest', fastest):g} 1/s", [[-2.0 * fastest]], [[-1.0]])


def damping(ratio: float) -> Region:
    """Sector about the negative real axis: every mode has a damping ratio above `ratio`, between 0 and 1.

    Raises
    ------
    ValueError : `ratio` is not between 0 and 1

    Examples
    --------
    >>> contains(damping(0.5), [-1.0 + 1.7j, -1.0 + 1.8j]).tolist()
    [True, False]
    """
    if not 0.0 < ratio < 1.0:
        raise ValueError(f"ratio: expected a damping ratio between 0 and 1, got {ratio!r}")
    sine, cosine = float(np.sqrt(1.0 - ratio * ratio)), float(ratio)
    return _region(f"damping ratio above {ratio:g}", np.zeros((2, 2)), [[sine, cosine], [-cosine, sine]])


def disk(centre: float, radius: float) -> Region:
    """Poles closer than `radius` to the point `centre` of the real axis (both 1/s).

    Examples
    --------
    >>> contains(disk(-5.0, 2.0), [-5.0 + 1.9j, -7.1]).tolist()
    [True, False]
    """
    _finite("centre", centre)
    label = f"distance below {_positive('radius', radius):g} 1/s from {centre:g} 1/s"
    return _region(label, [[-radius, -centre], [-centre, -radius]], [[0.0, 1.0], [0.0, 0.0]])


def intersection(*regions: Region) -> Region:
    """Poles in all of the regions at once.

    Raises
    ------
    ValueError : no region given

    Examples
    --------
    >>> intersection(half_plane(1.0), damping(0.3)).label
    'decay rate above 1 1/s and damping ratio above 0.3'
    """
    if not regions:
        raise ValueError("regions: expected at least one")
    label = " and ".join(region.label for region in regions)
    return _region(label, block_diag(*(r.L for r in regions)), block_diag(*(r.M for r in regions)))


def contains(region: Region, poles: ArrayLike) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """Whether each pole lies inside the region (not on its edge).

    Examples
    --------
    >>> contains(half_plane(0.0), [-1.0, 1.0]).tolist()
    [True, False]
    """
    s = np.atleast_1d(np.asarray(poles, dtype=complex))[:, None, None]
    return np.asarray(np.linalg.eigvalsh(region.L + s * region.M + np.conj(s) * region.M.T)[:, -1] < 0.0)


def _region(label: str, L: ArrayLike, M: ArrayLike) -> Region:
    return Region(label, read_only(L, name="L"), read_only(M, name="M"))


def _finite(name: str, value: float) -> float:
    if not np.isfinite(value):
        raise ValueError(f"{name}: expected a finite number in 1/s, got {value!r}")
    return float(value)


def _positive(name: str, value: float) -> float:
    if not (np.isfinite(value) and value > 0.0):
        raise ValueError(f"{name}: expected a positive number in 1/s, got {value!r}")
    return float(value)
