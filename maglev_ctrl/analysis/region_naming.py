"""What every stability map does with its growth rates: names of regions, points to verify, and Hill's verdict."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from maglev_ctrl.analysis.resonance import Resonance
from maglev_ctrl.analysis.resonance_naming import central_copy
from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.kernels import hill_matrix, hill_pair

HILL_AGREEMENT = 1e-7  # agreement of an exponent with Hill's method, relative to W
_MOST_NAMES = 60


def name_regions(
    growth: FloatArray, unstable: NDArray[np.bool_], name: Callable[[int, int], Resonance]
) -> tuple[NDArray[np.int64], tuple[Resonance, ...]]:
    """Tongue index of each unstable point (-1 elsewhere): each belongs to the peak that steepest ascent leads to.

    Parameters
    ----------
    growth : (p, q) 1/s, finite where `unstable`
    unstable : (p, q)
    name : the resonance behind the point with these two indices; asked at the highest peaks only

    Examples
    --------
    >>> from maglev_ctrl.analysis.resonance import NO_RESONANCE
    >>> growth = np.array([[0.1, 0.2, -0.1]])
    >>> index, found = name_regions(growth, growth > 0.0, lambda v, e: NO_RESONANCE)
    >>> index.tolist(), len(found)
    ([[0, 0, -1]], 1)
    """
    index = np.full(growth.shape, -1, dtype=np.int64)
    if not np.any(unstable):
        return index, ()
    root = ascend(growth, unstable)
    regions, _ = ndimage.label(unstable, structure=np.ones((3, 3)))
    peaks = np.unique(root[unstable])
    peaks = peaks[np.argsort(-growth.ravel()[peaks])]
    tongues: list[Resonance] = []
    numbers: dict[str, int] = {}
    of_region: dict[int, int] = {}
    number_of_peak = np.empty(len(peaks), dtype=np.int64)
    for rank, peak in enumerate(peaks):
        v, e = divmod(int(peak), growth.shape[1])
        region = int(regions[v, e])
        if rank < _MOST_NAMES or region not in of_region:
            resonance = name(v, e)
            if resonance.name not in numbers:
                numbers[resonance.name] = len(tongues)
                tongues.append(resonance)
            number_of_peak[rank] = numbers[resonance.name]
            of_region.setdefault(region, int(number_of_peak[rank]))
        else:
            number_of_peak[rank] = of_region[region]
    ordered = np.argsort(peaks)
    place = ordered[np.searchsorted(peaks[ordered], root[unstable])]
    index[unstable] = number_of_peak[place]
    return index, tuple(tongues)


def ascend(growth: FloatArray, unstable: NDArray[np.bool_]) -> NDArray[np.int64]:
    """For each point the flat index of the local maximum of growth it climbs to among unstable neighbours."""
    height = np.where(unstable, growth, -np.inf)
    padded = np.pad(height, 1, constant_values=-np.inf)
    rows, cols = growth.shape
    flat_index = np.arange(growth.size).reshape(growth.shape)
    best, target = height.copy(), flat_index.copy()
    for dv in (-1, 0, 1):
        for de in (-1, 0, 1):
            neighbour = padded[1 + dv : 1 + dv + rows, 1 + de : 1 + de + cols]
            better = neighbour > best
            best[better] = neighbour[better]
            target[better] = flat_index[better] + dv * cols + de
    flat = target.ravel()
    while True:
        further = flat[flat]
        if np.array_equal(further, flat):
            return np.asarray(flat.reshape(growth.shape), dtype=np.int64)
        flat = further


def check_points(growth: FloatArray, unstable: NDArray[np.bool_], count: int) -> NDArray[np.int64]:
    """Points to verify (k, 2): half along the edge of the unstable regions, half spread over the map, and the worst.

    Examples
    --------
    >>> growth = np.linspace(-1.0, 1.0, 12).reshape(3, 4)
    >>> check_points(growth, growth > 0.0, 6).shape
    (6, 2)
    """
    chosen = [int(np.argmax(growth))]
    edge = np.nonzero((unstable ^ ndimage.binary_erosion(unstable, border_value=1)).ravel())[0]
    near = edge if len(edge) else np.argsort(np.abs(growth).ravel(), kind="stable")[: 4 * count]
    half = max(count // 2, 1)
    chosen += [int(k) for k in near[np.linspace(0, len(near) - 1, min(half, len(near))).astype(int)]]
    golden = 0.5 * (np.sqrt(5.0) - 1.0)
    extra = 0
    while len(set(chosen)) < min(count, growth.size):
        v = int((extra + 0.5) / count * growth.shape[0]) % growth.shape[0]
        e = int(((extra + 1) * golden % 1.0) * growth.shape[1])
        chosen.append(v * growth.shape[1] + e)
        extra += 1
    flat = np.unique(chosen)
    return np.asarray(np.stack(np.divmod(flat, growth.shape[1]), axis=1), dtype=np.int64)


def hill_difference(
    A_0: FloatArray, A_cos: FloatArray, A_sin: FloatArray, *, frequency: float, multiplier: complex
) -> float:
    """Distance of a multiplier's exponent to the nearest eigenvalue of the Hill matrix, 1/s; inf when none is near.

    Parameters
    ----------
    A_0 : (n, n); A_cos, A_sin : (H, n, n) at the actual depth, in balanced coordinates, 1/s
    frequency : rad/s

    Examples
    --------
    >>> A_0, none = np.array([[0.0, 1.0], [-1.0, 0.0]]), np.zeros((1, 2, 2))
    >>> hill_difference(A_0, none, none, frequency=4.0, multiplier=1j) < 1e-9
    True
    """
    exponent = complex(np.log(multiplier) * frequency / (2.0 * np.pi))
    guess = central_copy(exponent, np.linalg.eigvals(A_0).astype(np.complex128), frequency)
    harmonics = len(A_cos)
    apart = float("inf")
    for reach in (6 * harmonics, 12 * harmonics):
        matrix = hill_matrix(A_0, A_cos, A_sin, frequency=frequency, harmonics=reach)
        value, _, _, residual = hill_pair(matrix, guess)
        size = float(np.max(np.abs(np.diag(matrix))))
        apart = abs(value - guess) if residual <= 1e-9 * size else float("inf")
        if apart <= 0.1 * HILL_AGREEMENT * frequency:
            break
    return apart
