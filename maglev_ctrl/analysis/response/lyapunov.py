"""The same covariances from one Lyapunov equation and matrix exponentials, whatever the modes are like.

Every delay gets its own copy of the process's filter, so that the response to an impulse of the white noise runs free
between the delays. With the states z at the beginning and the end of every interval, P = integral of z z' solves
A P + P A' = sum (z_end z_end' - z_start z_start').
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from maglev_ctrl.analysis.response.channels import RideChannel
from maglev_ctrl.analysis.response.sources import Observed, Source, observed_rows
from maglev_ctrl.arrays import FloatArray


def covariance_by_lyapunov(
    channel: RideChannel,
    parts: Sequence[Source],
    wanted: Sequence[Observed],
    finite: tuple[NDArray[np.bool_], NDArray[np.bool_]],
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Covariance (N, N), variances of rates (N,), and variances by source (sources, N).

    Parameters
    ----------
    finite : (N,) which variances, and which rates', exist; others are returned as 0
    """
    count = len(wanted)
    total, rates, shares = np.zeros((count, count)), np.zeros(count), np.zeros((len(parts), count))
    for index, part in enumerate(parts):
        A, e, C, d, s = _with_weightings(channel, part, wanted)
        C, d, s = (np.where(finite[0][:, None], matrix, 0.0) for matrix in (C, d, s))
        added, added_rates = _one_source(A, e, C, d, s, part)
        total, rates = total + added, rates + np.where(finite[1], added_rates, 0.0)
        shares[index] = np.diag(added)
    return total, rates, shares


def _with_weightings(
    channel: RideChannel, part: Source, wanted: Sequence[Observed]
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """A, e, C, d, s with the states of every weighting appended, displacements referred to rates again."""
    A, e = channel.A, part.e
    rows = observed_rows(channel, wanted)
    count, nodes = len(wanted), len(part.delays)
    C, d, s = np.zeros((count, len(A))), np.zeros((count, nodes)), np.zeros((count, nodes))
    for j, (one, row) in enumerate(zip(wanted, rows, strict=True)):
        c = np.concatenate([channel.C[row], np.zeros(len(A) - len(channel.A))])
        if one.weighting is None:
            C[j], d[j], s[j] = c, part.d[row], part.s[row]
            continue
        A_w, B_w, C_w, D_w = one.weighting.state_space()
        # f' = A_w f + B_w (c x + d g + s h); f~ = f + A_w^-1 B_w s h
        settled = np.linalg.solve(A_w, B_w)
        A = np.block([[A, np.zeros((len(A), len(A_w)))], [B_w @ c[None], A_w]])
        e = np.vstack([e, B_w @ part.d[row][None] + settled @ part.s[row][None]])
        C = np.hstack([C, np.zeros((count, len(A_w)))])
        C[j] = np.concatenate([D_w[0, 0] * c, C_w[0]])
        d[j] = D_w[0, 0] * part.d[row]
        still = float(one.weighting.at(0.0).real)
        s[j] = still * part.s[row]
    return A, e, C, d, s


def _one_source(
    A: FloatArray, e: FloatArray, C: FloatArray, d: FloatArray, s: FloatArray, part: Source
) -> tuple[FloatArray, FloatArray]:
    n, m, nodes = len(A), len(part.A), len(part.delays)
    size = n + m * nodes
    full = np.zeros((size, size))
    full[:n, :n] = A
    rows = np.zeros((len(C), size))
    rows[:, :n] = C
    # h answers with C_rate A^-1 (exp(A t) - 1) B + through: a transient and the constant `static`
    settled = np.linalg.solve(part.A.T, part.C_rate.T).T if m else part.C_rate
    jumps = np.zeros((size, nodes))
    for k in range(nodes):
        block = slice(n + k * m, n + (k + 1) * m)
        full[block, block] = part.A
        full[:n, block] = e[:, k : k + 1] @ part.C_rate
        rows[:, block] = d[:, k : k + 1] @ part.C_rate + s[:, k : k + 1] @ settled
        jumps[:n, k] = e[:, k] * part.through
        jumps[block, k] = part.B[:, 0]
    scale = np.diag(scipy.linalg.matrix_balance(full, permute=False)[1])
    full, rows, jumps = full * scale / scale[:, None], rows * scale, jumps / scale[:, None]
    levels = np.cumsum(part.static * s, axis=1)
    levels[:, -1] = 0.0
    state = np.zeros(size)
    starts, ends = np.zeros((nodes, size)), np.zeros((nodes, size))
    standing = np.zeros((len(C), len(C)))
    steps = np.diff(part.delays)
    moves = {float(step): scipy.linalg.expm(full * step) for step in np.unique(steps)}
    for k in range(nodes):
        state = state + jumps[:, k]
        starts[k] = state
        state = moves[float(steps[k])] @ state if k < len(steps) else np.zeros(size)
        ends[k] = state
        if k < len(steps):
            standing += steps[k] * np.outer(levels[:, k], levels[:, k])
    P = scipy.linalg.solve_continuous_lyapunov(full, ends.T @ ends - starts.T @ starts)
    crossing = rows @ np.linalg.solve(full, (ends - starts).T) @ levels.T
    covariance = rows @ P @ rows.T + crossing + crossing.T + standing
    moving = rows @ full
    return covariance, np.einsum("ij,jk,ik->i", moving, P, moving)
