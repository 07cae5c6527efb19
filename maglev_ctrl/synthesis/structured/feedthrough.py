"""Laws whose closed loop passes no disturbance straight through, exactly; elsewhere the H2 norm is infinite."""

from __future__ import annotations

from fractions import Fraction
from math import frexp

import numpy as np

from maglev_ctrl.arrays import FloatArray, read_only
from maglev_ctrl.errors import ModelError
from maglev_ctrl.synthesis.structured.structure import Structure
from maglev_ctrl.systems.plant import Plant


def no_feedthrough(structure: Structure, plants: tuple[Plant, ...]) -> Structure:
    """The laws of a structure with D11 + D12 K D21 = 0 for every plant, in exact arithmetic.

    Elimination in rational numbers. A direction of gains is kept where floating-point gains along it keep the condition
    exactly (ratios that are powers of two: equal gains, opposite gains); a law that keeps it only up to rounding has an
    infinite norm and could not be proved. Sampled plants need no condition.

    Raises
    ------
    ModelError : no admissible law does so

    Examples
    --------
    >>> plant = Plant.from_matrices([[-1.0]], [[1.0]], [[1.0]], [[1.0]], [[1.0], [1.0]],
    ...                             D12=[[1.0]], D21=[[1.0], [1.0]])
    >>> no_feedthrough(Structure.full(plant), (plant,)).basis
    array([[[-1.,  1.]]])
    """
    if plants[0].dt is not None:
        return structure
    rows = [row for plant in plants for row in _conditions(structure, plant)]
    rows = [row for row in rows if any(row)]
    if not rows:
        return structure
    count = len(structure.basis)
    pivots = _eliminate(rows, count)
    if any(row[count] for row in rows[len(pivots) :]):
        raise ModelError(
            "the H2 norm is infinite: no admissible law makes D11 + D12 K D21 zero; roll off the disturbances or "
            "filter the measurements"
        )
    particular = np.zeros(count)
    for row, pivot in zip(rows, pivots, strict=False):
        value = float(row[count])
        if Fraction(value) != row[count]:
            raise ModelError("the H2 norm is infinite: D11 + D12 K D21 = 0 holds for no gains in floating point")
        particular[pivot] = value
    if np.any((particular < structure.lower) & (particular != 0.0)) or np.any(
        (particular > structure.upper) & (particular != 0.0)
    ):
        raise ModelError("the H2 norm is infinite: the bounds allow no law with D11 + D12 K D21 = 0")
    basis, lower, upper = [], [], []
    for free in (k for k in range(count) if k not in pivots):
        direction = [Fraction(0)] * count
        direction[free] = Fraction(1)
        for row, pivot in zip(rows, pivots, strict=False):
            direction[pivot] = -row[free]
        mixed = sum(x != 0 for x in direction) > 1
        if not all(_power_of_two(x) for x in direction) or (mixed and any(particular[k] for k in pivots)):
            continue
        low, high = structure.lower[free], structure.upper[free]
        for pivot in (k for k in pivots if direction[k] != 0):
            ratio = float(direction[pivot])
            ends = sorted((structure.lower[pivot] / ratio, structure.upper[pivot] / ratio))
            low, high = max(low, ends[0]), min(high, ends[1])
        if low <= high:
            basis.append(np.tensordot(np.array([float(x) for x in direction]), structure.basis, axes=1))
            lower.append(low)
            upper.append(high)
    base = read_only(structure.gain(particular), name="base")
    stacked = np.array(basis).reshape(len(basis), *base.shape)
    return Structure(
        base, read_only(stacked, name="basis"), _frozen(lower), _frozen(upper), structure.order
    )  # fmt: skip


def _conditions(structure: Structure, plant: Plant) -> list[list[Fraction]]:
    """Rows [coefficients, right side] of the condition for one plant.

    Raises
    ------
    ModelError : D22 makes the condition nonlinear
    """
    n_u, n_y = len(plant.commands), len(plant.measured)
    left, right = np.vectorize(Fraction, otypes=[object]), plant.D21
    D12, D21 = left(plant.D12), left(right)
    used_z = np.flatnonzero(np.any(plant.D12 != 0.0, axis=1))
    used_w = np.flatnonzero(np.any(plant.D21 != 0.0, axis=0))
    touched = used_z.size > 0 and used_w.size > 0
    if touched and np.any(plant.D22):
        raise ModelError(
            f"{plant.name}: the H2 norm may be infinite through D12 K D21, and D22 is not zero; filter the measurements"
        )
    outside = np.array(plant.D11, copy=True)
    outside[np.ix_(used_z, used_w)] = 0.0
    if np.any(outside):
        raise ModelError(f"{plant.name}: the H2 norm is infinite: D11 is not zero where no command can cancel it")
    if not touched:
        return []
    passed = [D12[used_z] @ left(one[:n_u, :n_y]) @ D21[:, used_w] for one in structure.basis]
    own = left(plant.D11[np.ix_(used_z, used_w)]) + D12[used_z] @ left(structure.base[:n_u, :n_y]) @ D21[:, used_w]
    return [
        [Fraction(one[i, j]) for one in passed] + [-Fraction(own[i, j])]
        for i in range(used_z.size)
        for j in range(used_w.size)
    ]


def _eliminate(rows: list[list[Fraction]], count: int) -> list[int]:
    """Reduced row echelon form in place; the pivot columns."""
    pivots: list[int] = []
    for column in range(count):
        top = len(pivots)
        chosen = next((i for i in range(top, len(rows)) if rows[i][column] != 0), None)
        if chosen is None:
            continue
        rows[top], rows[chosen] = rows[chosen], rows[top]
        lead = rows[top][column]
        rows[top] = [x / lead for x in rows[top]]
        for i in range(len(rows)):
            if i != top and rows[i][column] != 0:
                factor = rows[i][column]
                rows[i] = [x - factor * y for x, y in zip(rows[i], rows[top], strict=True)]
        pivots.append(column)
    return pivots


def _power_of_two(value: Fraction) -> bool:
    return value == 0 or (Fraction(float(value)) == value and abs(frexp(float(value))[0]) == 0.5)


def _frozen(values: list[float]) -> FloatArray:
    array = np.array(values, dtype=float)
    array.flags.writeable = False
    return array
