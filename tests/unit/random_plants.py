"""Random plants for property tests: ordinary ones, and ones that no law can stabilise; the seed is all they need."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from maglev_ctrl.systems.plant import Plant

SHARES = {
    "ordinary": 37,
    "unstable": 36,
    "scaled": 4,
    "uncontrollable, stable": 10,
    "unseen by the cost, stable": 10,
    "uncontrollable, unstable": 1,
    "uncontrollable, neutral": 1,
    "unseen by the cost, neutral": 1,
}
"""Kinds of plants, in percent."""

KINDS = tuple(kind for kind, share in SHARES.items() for _ in range(share))

HOPELESS = frozenset({"uncontrollable, unstable", "uncontrollable, neutral"})
"""Kinds that no law whatsoever stabilises."""


@dataclass(frozen=True, eq=False, slots=True)
class RandomPlant:
    """A plant and what was built into it."""

    plant: Plant
    kind: str
    seed: int


def random_plant(seed: int, *, dt: float | None = None, sensors: bool = False, direct: bool = False) -> RandomPlant:
    """Plant number `seed`: 1 to 8 states, 1 to 3 commands, cost rows on states and commands.

    What is hidden from commands or cost is hidden exactly, also after the rounding of stored numbers: the coordinates
    are mixed by whole numbers only, and scaled by powers of two.

    Parameters
    ----------
    dt : sampled where given
    sensors : measures fewer outputs with noise (else every state)
    direct : commands reach the measurements at once (D22), disturbances the performance (D11)
    """
    rng = np.random.default_rng([2026, seed])
    kind = KINDS[seed * 37 % len(KINDS)]  # kinds change from plant to plant
    hidden = int(kind.startswith(("uncontrollable", "unseen")))
    n, n_u = int(rng.integers(1 + hidden, 9)), int(rng.integers(1, 4))
    n_w, n_z = int(rng.integers(1, 4)), int(rng.integers(1, 4))
    A, B, C = (rng.standard_normal(shape) for shape in ((n, n), (n, n_u), (n_z, n)))
    if kind in ("unstable", "scaled"):
        A += rng.uniform(0.0, 2.0) * np.eye(n)
    if dt is not None:
        A *= rng.uniform(0.5, 1.6) / max(np.max(np.abs(np.linalg.eigvals(A))), 1e-3)
    pole = {"stable": -1.5, "unstable": 0.75, "neutral": 0.0}.get(kind.partition(", ")[2], 0.0)
    pole = pole if dt is None else {-1.5: 0.5, 0.75: 1.25, 0.0: 1.0}[pole]
    if kind.startswith("uncontrollable"):
        A[-1], B[-1] = 0.0, 0.0  # the last state goes its own way
        A[-1, -1] = pole
    if kind.startswith("unseen"):
        A[:, -1], C[:, -1] = 0.0, 0.0  # the last state moves nothing and is not weighted
        A[-1, -1] = pole
    if hidden:  # short numbers, so that mixing by whole numbers rounds nothing
        A, B, C = (np.round(x * 64.0) / 64.0 for x in (A, B, C))
        for _ in range(3):
            i, j = rng.choice(n, 2, replace=False)
            factor = float(rng.integers(-2, 3))
            A[i] += factor * A[j]
            B[i] += factor * B[j]
            A[:, j] -= factor * A[:, i]
            C[:, j] -= factor * C[:, i]
    order = rng.permutation(n)
    units = np.exp2(rng.integers(-20, 21, n)) if kind == "scaled" else np.ones(n)
    A = (A * units[:, None] / units)[np.ix_(order, order)]
    B, C = (B * units[:, None])[order], (C / units)[:, order]
    price = 10.0 ** rng.uniform(-2.0, 2.0)
    C1 = np.vstack([C, np.zeros((n_u, n))])
    D12 = np.vstack([np.zeros((n_z, n_u)), price * np.eye(n_u)])
    if rng.random() < 0.3:  # weights of states and commands together
        D12[:n_z] = 0.1 * rng.standard_normal((n_z, n_u))
    B1 = rng.standard_normal((n, n_w)) * units[order][:, None]
    if not sensors:
        return RandomPlant(Plant.from_matrices(A, B1, B, C1, D12=D12, dt=dt, name=f"{kind} {seed}"), kind, seed)
    n_y = int(rng.integers(1, 4))
    C2 = rng.standard_normal((n_y, n)) / units[order]
    B1 = np.hstack([B1, np.zeros((n, n_y))])
    D21 = np.hstack([np.zeros((n_y, n_w)), 0.3 * np.eye(n_y)])
    extra = {}
    if direct:
        extra = {"D22": 0.2 * rng.standard_normal((n_y, n_u)), "D11": 0.1 * rng.standard_normal((n_z + n_u, n_w + n_y))}
    plant = Plant.from_matrices(A, B1, B, C1, C2, D12=D12, D21=D21, dt=dt, name=f"{kind} {seed}", **extra)
    return RandomPlant(plant, kind, seed)
