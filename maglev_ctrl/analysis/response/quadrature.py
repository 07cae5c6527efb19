"""Adaptive Gauss-Kronrod integration of many functions at once, in rounds of whole batches."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from maglev_ctrl.arrays import FloatArray, read_only

_HALF = (
    (0.991455371120812639206854697526329, 0.022935322010529224963732008058970),
    (0.949107912342758524526189684047851, 0.063092092629978553290700663189204),
    (0.864864423359769072789712788640926, 0.104790010322250183839876322541518),
    (0.741531185599394439863864773280788, 0.140653259715525918745189590510238),
    (0.586087235467691130294144838258730, 0.169004726639267902826583426598550),
    (0.405845151377397166906606412076961, 0.190350578064785409913256402421014),
    (0.207784955007898467600689403773245, 0.204432940075298892414161999234649),
)
_INNER = (0.129484966168869693270611432679082, 0.279705391489276667901467771423780, 0.381830050505118944950369775488975)
NODES: FloatArray = read_only(
    [-x for x, _ in _HALF] + [0.0] + [x for x, _ in reversed(_HALF)], name="NODES"
)  # fmt: skip
KRONROD: FloatArray = read_only(
    [w for _, w in _HALF] + [0.209482141084727828012999174891714] + [w for _, w in reversed(_HALF)], name="KRONROD"
)
GAUSS: FloatArray = read_only(
    np.insert([*_INNER, 0.417959183673469387755102040816327, *reversed(_INNER)], np.arange(8), 0.0),
    name="GAUSS",
)
"""The rule of 15 nodes and the one of 7 within it."""


@dataclass(frozen=True, eq=False, slots=True)
class Integral:
    """Integrals of m functions: `value` and estimated `error` (m,); `evaluations` of the integrand."""

    value: FloatArray
    error: FloatArray
    evaluations: int


def adaptive_integral(
    function: Callable[[FloatArray], FloatArray],
    edges: FloatArray,
    *,
    tolerance: float,
    floor: FloatArray | float = 0.0,
    rounds: int = 48,
    at_most: int = 150_000,
) -> Integral:
    """Integral of f from edges[0] to edges[-1], pieces halved until their errors are small.

    Parameters
    ----------
    function : from points (N,) to values (N, m)
    edges : increasing, the first pieces
    tolerance : relative to the integral of |f|, or to `floor` (m,) where that is larger
    rounds, at_most : where it stops, with the error it has then

    Examples
    --------
    >>> found = adaptive_integral(lambda x: np.sqrt(x)[:, None], np.array([0.0, 1.0]), tolerance=1e-10)
    >>> bool(abs(found.value[0] - 2.0 / 3.0) < 1e-10)
    True
    """
    left, right = edges[:-1], edges[1:]
    done = done_error = done_size = np.zeros(1)
    evaluations = 0
    for turn in range(rounds):
        half, middle = 0.5 * (right - left), 0.5 * (right + left)
        points = middle[:, None] + half[:, None] * NODES
        values = function(points.ravel()).reshape(len(left), len(NODES), -1)
        evaluations += points.size
        whole = half[:, None] * np.einsum("pkm,k->pm", values, KRONROD)
        inner = half[:, None] * np.einsum("pkm,k->pm", values, GAUSS)
        size = half[:, None] * np.einsum("pkm,k->pm", np.abs(values), KRONROD)
        rough = np.abs(whole - inner)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            # The rule of 15 is far better than its difference from that of 7 (Piessens and others, QUADPACK, 1983).
            error = np.where(size > 0.0, size * np.minimum(1.0, (200.0 * rough / size) ** 1.5), rough)
        error = np.maximum(error, 50.0 * np.finfo(float).eps * size)
        total = done_size + np.sum(size, axis=0)
        allowed = tolerance * np.maximum(total, floor)
        open_error = np.sum(error, axis=0) + done_error
        last = turn == rounds - 1 or evaluations >= at_most
        if last or np.all(open_error <= allowed):
            return Integral(done + np.sum(whole, axis=0), open_error, evaluations)
        share = np.max(np.where(allowed > 0.0, error / np.where(allowed > 0.0, allowed, 1.0), 0.0), axis=1)
        split = share > 0.3 / (len(left) + 30.0)
        if not np.any(split):
            split = share >= np.max(share)
        kept = ~split
        done = done + np.sum(whole[kept], axis=0)
        done_error = done_error + np.sum(error[kept], axis=0)
        done_size = done_size + np.sum(size[kept], axis=0)
        left, right, middle = left[split], right[split], middle[split]
        left, right = np.concatenate([left, middle]), np.concatenate([middle, right])
    raise AssertionError("unreachable")
