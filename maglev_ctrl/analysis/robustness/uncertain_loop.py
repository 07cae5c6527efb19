"""A closed loop with its uncertain parameters pulled out: a linear fractional form with real repeated blocks.

x' = A x + B w, z = C x + D w, w = diag(d_i I) z, with every |d_i| <= 1 inside the stated spreads. The form is exact,
mass included: forces of all changes act in M q'' + ... = L w, and w = d R (q, q', q'', xi, u), with L R the share of
the parameter factored to its rank (Zhou, Doyle & Glover, Robust and Optimal Control, Ch. 10).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from maglev_ctrl.analysis.robustness.parameters import ParameterShare, UncertainParameter, parameter_share
from maglev_ctrl.arrays import FloatArray, read_only
from maglev_ctrl.errors import ModelError
from maglev_ctrl.systems import Controller, SecondOrderSystem

_RANK = 1e-12


@dataclass(frozen=True, eq=False, slots=True)
class UncertainLoop:
    """Linear fractional form of an uncertain closed loop: A (n, n), B (n, r), C (r, n), D (r, r).

    `blocks` are the sizes of the repeated real blocks, one for each name, and add up to r; `spreads` what a change of
    one stands for, relative to nominal.
    """

    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray
    blocks: tuple[int, ...]
    names: tuple[str, ...]
    spreads: FloatArray

    @classmethod
    def from_affine(
        cls,
        A: ArrayLike,
        directions: Sequence[ArrayLike],
        *,
        names: tuple[str, ...] | None = None,
        spreads: ArrayLike | None = None,
    ) -> UncertainLoop:
        """x' = (A + sum of d_i spreads_i A_i) x for directions A_i (n, n).

        Raises
        ------
        ValueError : shapes do not fit, or a direction is zero

        Examples
        --------
        >>> loop = UncertainLoop.from_affine([[0.0, 1.0], [-4.0, -0.2]], [[[0.0, 0.0], [-4.0, 0.0]]])
        >>> loop.blocks, loop.state_matrix([0.5])[1].tolist()
        ((1,), [-6.0, -0.2])
        """
        nominal = read_only(A, name="A", shape=(None, None))
        n, count = nominal.shape[-1], len(directions)
        labels = names if names is not None else tuple(f"d{i + 1}" for i in range(count))
        sizes = read_only(np.ones(count) if spreads is None else spreads, name="spreads", shape=(count,))
        if len(labels) != count or count == 0:
            raise ValueError(f"names: expected one name for each of {count} directions (at least one), got {labels}")
        factors = []
        for label, direction, size in zip(labels, directions, sizes, strict=True):
            left, right = rank_factors(read_only(direction, name=label, shape=(n, n)))
            if not left.shape[1]:
                raise ValueError(f"{label}: expected a direction that changes the state matrix, got zeros")
            factors.append((left, size * right))
        B, C = np.hstack([f[0] for f in factors]), np.vstack([f[1] for f in factors])
        blocks = tuple(f[0].shape[1] for f in factors)
        return _form(nominal, B, C, np.zeros((C.shape[0], C.shape[0])), blocks, labels, sizes)

    def diagonal(self, changes: ArrayLike) -> FloatArray:
        """The changes (..., p) repeated over their blocks; (..., r)."""
        return np.repeat(np.asarray(changes, dtype=np.float64), self.blocks, axis=-1)

    def state_matrix(self, changes: ArrayLike) -> FloatArray:
        """Closed-loop state matrix at changes (..., p) in units of the spreads; (..., n, n).

        Raises
        ------
        numpy.linalg.LinAlgError : the changes make the loop ill posed (a mass falls to zero)
        """
        d = self.diagonal(changes)
        r = self.D.shape[0]
        inner = np.linalg.solve(np.eye(r) - d[..., :, None] * self.D, d[..., :, None] * self.C)
        return np.asarray(self.A + self.B @ inner)

    def recentred(self, centre: ArrayLike, half_widths: ArrayLike) -> UncertainLoop:
        """The same loop about another point of the box, with half widths (p,) as the new units.

        Examples
        --------
        >>> loop = UncertainLoop.from_affine([[-1.0]], [[[1.0]]])
        >>> loop.recentred([0.5], [0.25]).state_matrix([1.0]).tolist()
        [[-0.25]]
        """
        middle, half = self.diagonal(centre), self.diagonal(half_widths)
        r = self.D.shape[0]
        inner = np.linalg.solve(np.eye(r) - middle[:, None] * self.D, middle[:, None] * np.hstack([self.C, self.D]))
        n = self.A.shape[0]
        # w = centre z + w', z = C x + D w; w' = half d' z
        A, B = self.A + self.B @ inner[:, :n], self.B @ (np.eye(r) + inner[:, n:])
        back = np.linalg.inv(np.eye(r) - self.D * middle)
        C, D = back @ self.C, back @ self.D
        return _form(A, B, half[:, None] * C, half[:, None] * D, self.blocks, self.names,
                     self.spreads * np.asarray(half_widths, dtype=np.float64))  # fmt: skip

    def along(self, direction: ArrayLike) -> UncertainLoop:
        """One parameter t in place of all: changes = t direction (p,). Parameters that stand still are left out."""
        weights = self.diagonal(direction)
        kept = np.flatnonzero(weights)
        C, D = weights[kept, None] * self.C[kept], weights[kept, None] * self.D[np.ix_(kept, kept)]
        return _form(self.A, self.B[:, kept], C, D, (len(kept),), ("t",), np.ones(1))


def uncertain_loop(
    plant: SecondOrderSystem, controller: Controller | None, parameters: Sequence[UncertainParameter]
) -> UncertainLoop:
    """Closed loop of plant and controller (None: the plant alone) with its uncertain parameters pulled out, exactly.

    States are the plant's, then the controller's; delays are in the Pade form the plant carries.

    Raises
    ------
    ValueError : no parameters, a doubled name, two lags on one actuator, a sampled controller, batched matrices, or
        what `parameter_share` refuses
    ModelError : the nominal loop is not well posed

    Examples
    --------
    >>> plant = SecondOrderSystem.from_matrices([[2.0]], [[0.4]], [[8.0]])
    >>> loop = uncertain_loop(plant, None, [UncertainParameter("mass", "mass", 0.5, ("matrices",))])
    >>> loop.state_matrix([1.0])[1].round(12).tolist()
    [-2.6666..., -0.1333...]
    """
    if plant.M.ndim != 2:
        raise ValueError(f"plant: expected one system, got a batch of shape {plant.M.shape[:-2]}")
    if controller is not None and controller.dt is not None:
        raise ValueError(f"controller: {controller.name!r} is sampled; parameters are pulled out in continuous time")
    names = tuple(parameter.name for parameter in parameters)
    if not names or len(set(names)) < len(names):
        raise ValueError(f"parameters: expected distinct names, at least one, got {names}")
    shares = [parameter_share(plant, parameter) for parameter in parameters]
    slow = [i for share in shares for i in share.slow]
    if len(set(slow)) < len(slow):
        doubled = next(plant.internal[i] for i in slow if slow.count(i) > 1)
        raise ValueError(f"parameters: {doubled!r} would be slowed twice")
    return _pulled_out(plant, controller, shares, names)


def rank_factors(matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
    """L (m, r), R (r, n) of full rank with L R = matrix; rows and columns are evened out before the rank is judged."""
    rows = np.max(np.abs(matrix), axis=1, initial=0.0)
    rows = np.where(rows > 0.0, rows, 1.0)
    columns = np.max(np.abs(matrix / rows[:, None]), axis=0, initial=0.0)
    columns = np.where(columns > 0.0, columns, 1.0)
    left, values, right = np.linalg.svd(matrix / rows[:, None] / columns, full_matrices=False)
    rank = int(np.sum(values > _RANK * values[0])) if values.size and values[0] > 0.0 else 0
    root = np.sqrt(values[:rank])
    return rows[:, None] * left[:, :rank] * root, root[:, None] * right[:rank] * columns


def _pulled_out(
    plant: SecondOrderSystem, controller: Controller | None, shares: list[ParameterShare], names: tuple[str, ...]
) -> UncertainLoop:
    measured = () if controller is None else controller.measured
    commands = () if controller is None else controller.commands
    unknown = [name for name in commands if name not in plant.inputs]
    unknown += [name for name in measured if name not in plant.outputs and name not in plant.states]
    if unknown:
        raise ValueError(f"controller: {unknown[0]!r} is no input, output or state of the plant")
    n, n_xi, n_y, n_u = len(plant.dofs), len(plant.internal), len(measured), len(commands)
    kept = list(plant.positions)
    columns = [plant.inputs.index(name) for name in commands]
    n_q, n_c = len(kept), 0 if controller is None else len(controller.states)
    # Columns of everything a change may depend on: q, q', xi, controller | q'', xi', u, y
    H_x, H_a = _measured(plant, measured)
    factors = [_factors(plant, share, measured, columns) for share in shares]
    blocks = tuple(left.shape[1] + len(share.slow) for (left, _), share in zip(factors, shares, strict=True))
    r = sum(blocks)
    n_x, n_z = n_q + n + n_xi + n_c, n + n_xi + n_u + n_y
    v, xi, c = slice(n_q, n_q + n), slice(n_q + n, n_q + n + n_xi), slice(n_q + n + n_xi, n_x)
    a, rate, u, y = slice(0, n), slice(n, n + n_xi), slice(n + n_xi, n + n_xi + n_u), slice(n + n_xi + n_u, n_z)
    E, X, W = np.eye(n_z), np.zeros((n_z, n_x)), np.zeros((n_z, r))
    E[a, a], E[a, u] = plant.M, -plant.B[:, columns]
    X[a, :n_q], X[a, v], X[a, xi] = -plant.K[:, kept], -plant.C, plant.F
    E[rate, a], E[rate, u] = -plant.G_a, -plant.B_internal[:, columns]
    X[rate, :n_q], X[rate, v], X[rate, xi] = plant.G_q[:, kept], plant.G_v, plant.A_internal
    E[y, a], X[y, : n_q + n + n_xi] = -H_a, H_x
    if controller is not None:
        E[u, y], X[u, c] = -controller.D, controller.C
    Z_x, Z_a = np.zeros((r, n_x)), np.zeros((r, n_z))
    at = 0
    for (left, right), share in zip(factors, shares, strict=True):
        rows = slice(at, at + left.shape[1])
        W[a, rows], W[y, rows] = left[:n], left[n:]
        q_v = n_q + n
        Z_x[rows, : q_v + n_xi] = right[:, : q_v + n_xi]
        Z_a[rows, a], Z_a[rows, u] = right[:, q_v + n_xi : q_v + n_xi + n], right[:, q_v + n_xi + n :]
        at = rows.stop
        for state in share.slow:  # (1 + d) xi' = rest, so xi' = rest - d xi'
            W[n + state, at], Z_a[at, n + state] = -1.0, 1.0
            at += 1
    size = np.max(np.abs(E), axis=1)
    if np.linalg.cond(E / size[:, None] / np.max(np.abs(E / size[:, None]), axis=0)) > 1e13:
        raise ModelError("the loop is not well posed: mass matrix and feedthrough leave no acceleration")
    solved = np.linalg.solve(E, np.hstack([X, W]))
    by_x, by_w = solved[:, :n_x], solved[:, n_x:]
    A, B = np.zeros((n_x, n_x)), np.zeros((n_x, r))
    for row, column in enumerate(kept):
        A[row, n_q + column] = 1.0
    A[v], B[v] = by_x[a], by_w[a]
    A[xi], B[xi] = by_x[rate], by_w[rate]
    if controller is not None:
        A[c], B[c] = controller.B @ by_x[y], controller.B @ by_w[y]
        A[c, c] += controller.A
    C, D = Z_x + Z_a @ by_x, Z_a @ by_w
    spreads = np.array([share.spread for share in shares])
    weight = np.repeat(spreads, blocks)[:, None]
    return _form(A, B, weight * C, weight * D, blocks, names, spreads)


def _measured(plant: SecondOrderSystem, measured: tuple[str, ...]) -> tuple[FloatArray, FloatArray]:
    """Measurements by the states and by the accelerations, commands kept apart."""
    kept = list(plant.positions)
    H_x, H_a = np.zeros((len(measured), len(plant.states))), np.zeros((len(measured), len(plant.dofs)))
    for row, name in enumerate(measured):
        if name in plant.outputs:
            i = plant.outputs.index(name)
            H_x[row] = np.concatenate([plant.H_q[i, kept], plant.H_v[i], plant.H_internal[i]])
            H_a[row] = plant.H_a[i]
        else:
            H_x[row, plant.states.index(name)] = 1.0
    return H_x, H_a


def _factors(
    plant: SecondOrderSystem, share: ParameterShare, measured: tuple[str, ...], columns: list[int]
) -> tuple[FloatArray, FloatArray]:
    """Rank factors of [force; measurement] by (q, q', xi, q'', u), per unit change."""
    kept = list(plant.positions)
    force = np.hstack([-share.K[:, kept], -share.C, share.F, -share.M, share.B[:, columns]])
    seen = np.zeros((len(measured), force.shape[1]))
    for row, name in enumerate(measured):
        if name in plant.outputs:
            i = plant.outputs.index(name)
            rows = np.concatenate([share.H_q[i, kept], share.H_v[i], share.H_internal[i]])
            seen[row, : rows.size] = rows
    return rank_factors(np.vstack([force, seen]))


def _form(
    A: FloatArray, B: FloatArray, C: FloatArray, D: FloatArray, blocks: tuple[int, ...], names: tuple[str, ...],
    spreads: FloatArray,
) -> UncertainLoop:  # fmt: skip
    arrays = {key: read_only(value, name=key) for key, value in zip("ABCD", (A, B, C, D), strict=True)}
    return UncertainLoop(blocks=blocks, names=names, spreads=read_only(spreads, name="spreads"), **arrays)
