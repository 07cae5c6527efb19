"""Closed loops in rounding-bounded or exact arithmetic, and the loops between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from itertools import combinations_with_replacement, permutations
from typing import Generic, TypeVar

import numpy as np

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.proofs.enclosure import Matrix
from maglev_ctrl.systems import Controller
from maglev_ctrl.systems.plant import Plant

M = TypeVar("M", bound=Matrix)

_INPUT_SIDE = ("B2", "D12")
_OUTPUT_SIDE = ("C2", "D21")


class Mismatch(Exception):
    """A claim cannot be about these plants and controllers; the text says why."""


@dataclass(frozen=True, eq=False, slots=True)
class Loop(Generic[M]):
    """Closed loop x' = A x + B w, z = C x + D w, u = U x without disturbance."""

    A: M
    B: M
    C: M
    D: M
    U: M


def closed_loop(kind: type[M], inputs: Plant, controller: Controller, outputs: Plant, base: Plant) -> Loop[M]:
    """Closed loop with the input side of one plant, the output side of another and the rest of a third.

    All three are one plant but for the products that arise where plants are blended.

    Raises
    ------
    ZeroDivisionError, NotDecided : the algebraic loop I - D22 D_k is singular, or may be

    Examples
    --------
    >>> from maglev_ctrl.proofs.enclosure import Enclosure
    >>> plant = Plant.from_matrices([[1.0]], [[1.0]], [[1.0]], [[1.0]])
    >>> law = Controller.static([[-3.0]], measured=("x1",), commands=("u1",))
    >>> closed_loop(Enclosure, plant, law, plant, plant).A.middle
    array([[-2.]])
    """

    def product(left: M, right: M, *, zero: bool) -> M:
        return kind.of(np.zeros((left.shape[0], right.shape[1]))) if zero else left @ right

    a, b1, c1, d11 = kind.of(base.A), kind.of(base.B1), kind.of(base.C1), kind.of(base.D11)
    b2, d12, c2, d21 = kind.of(inputs.B2), kind.of(inputs.D12), kind.of(outputs.C2), kind.of(outputs.D21)
    a_k, b_k, c_k, d_k = (kind.of(x) for x in (controller.A, controller.B, controller.C, controller.D))
    n_y, n_k = len(outputs.measured), controller.A.shape[0]
    static_law = bool(np.any(controller.D))
    if np.any(outputs.D22):
        d22 = kind.of(outputs.D22)
        solved = (kind.of(np.eye(n_y)) - d22 @ d_k).inverse() if static_law else kind.of(np.eye(n_y))
        y_x, y_k, y_w = solved @ c2, solved @ d22 @ c_k, solved @ d21
        u_k = c_k + d_k @ y_k
        a_kk = a_k + b_k @ y_k
    else:
        y_x, y_w, u_k, a_kk = c2, d21, c_k, a_k
    no_direct = not static_law
    u_x = d_k if outputs.measures_states else product(d_k, y_x, zero=no_direct)
    u_w = product(d_k, y_w, zero=no_direct or not np.any(outputs.D21))
    a_xx, b_x, c_x, d = a, b1, c1, d11
    if not no_direct:
        a_xx = a + b2 @ u_x
        if np.any(outputs.D21):
            b_x = b1 + b2 @ u_w
            d = d11 + product(d12, u_w, zero=not np.any(inputs.D12))
        if np.any(inputs.D12):
            c_x = c1 + d12 @ u_x
    if n_k == 0:
        return Loop(a_xx, b_x, c_x, d, u_x)
    return Loop(
        kind.blocks([[a_xx, b2 @ u_k], [b_k @ y_x, a_kk]]),
        kind.blocks([[b_x], [product(b_k, y_w, zero=not np.any(outputs.D21))]]),
        kind.blocks([[c_x, product(d12, u_k, zero=not np.any(inputs.D12))]]),
        d,
        kind.blocks([[u_x, u_k]]),
    )


def varying(records: Sequence[Plant | Controller], names: Sequence[str]) -> bool:
    """Some array of the records is not the same in all of them."""
    return any(
        not np.array_equal(getattr(records[0], name), getattr(one, name)) for one in records[1:] for name in names
    )


@dataclass(frozen=True, slots=True)
class Blend:
    """How loops depend on the weights of a blend: as a polynomial of `degree`, or not as a polynomial (0).

    `split_plant`, `split_law`: the output side and the law carry weights of their own.
    """

    degree: int
    split_plant: bool
    split_law: bool


def blend_of(plants: Sequence[Plant], controllers: Sequence[Controller]) -> Blend:
    """How the closed loops of blended plants and laws (same weights) depend on the weights.

    A + B2 D_k C2, B2 C_k and B_k C2 are products: each factor that varies adds a degree. With D22 the loop is affine
    only while D22, the law and one side of the plant are common.
    """
    inputs, outputs = varying(plants, _INPUT_SIDE), varying(plants, _OUTPUT_SIDE)
    law = varying(controllers, ("A", "B", "C", "D"))
    direct = any(bool(np.any(one.D)) for one in controllers)
    if any(bool(np.any(one.D22)) for one in plants) and (varying(plants, ("D22",)) or law or (inputs and outputs)):
        return Blend(0, False, False)
    split_plant = inputs and outputs and direct
    split_law = law and (inputs or outputs)
    return Blend(1 + split_plant + split_law, split_plant, split_law)


def control_points(
    kind: type[M], plants: Sequence[Plant], controllers: Sequence[Controller], blend: Blend
) -> list[Loop[M]]:
    """Loops whose convex hull holds every blend: Bernstein coefficients of the closed loop in the weights.

    For two plants they come in the order of the parameter: degree + 1 of them.
    """
    count, made = len(plants), {}
    points = []
    for chosen in combinations_with_replacement(range(count), blend.degree):
        orders = sorted(set(permutations(chosen)))
        parts = []
        for order in orders:
            i = order[0]
            output = order[1] if blend.split_plant else i
            law = order[-1] if blend.split_law else i
            if (i, law, output) not in made:
                made[i, law, output] = closed_loop(kind, plants[i], controllers[law], plants[output], plants[i])
            parts.append(made[i, law, output])
        points.append(_mean(parts))
    return points


def _mean(loops: Sequence[Loop[M]]) -> Loop[M]:
    if len(loops) == 1:
        return loops[0]
    total = loops[0]
    for one in loops[1:]:
        total = Loop(*(getattr(total, f.name) + getattr(one, f.name) for f in fields(Loop)))
    return Loop(*(getattr(total, f.name).over(len(loops)) for f in fields(Loop)))


def check_fit(plants: Sequence[Plant], controllers: Sequence[Controller]) -> float | None:
    """Sampling period common to all plants and laws.

    Raises
    ------
    Mismatch : names, sizes or sampling periods do not fit
    """
    first = plants[0]
    for plant, law in zip(plants, controllers, strict=True):
        if law.measured != plant.measured or law.commands != plant.commands:
            raise Mismatch(
                f"the law joins {_list(law.measured)} to {_list(law.commands)}, the plant {plant.name!r} "
                f"{_list(plant.measured)} to {_list(plant.commands)}"
            )
        if law.dt != plant.dt or plant.dt != first.dt:
            raise Mismatch(f"sampling periods differ: law {law.dt}, plant {plant.dt}, first plant {first.dt}")
        if (
            any(getattr(plant, name) != getattr(first, name) for name in _NAMES)
            or law.A.shape != controllers[0].A.shape
        ):
            raise Mismatch(
                f"{plant.name!r} and {first.name!r} have different states, signals or laws of different order"
            )
        for array in (*_arrays(plant, _PLANT), *_arrays(law, ("A", "B", "C", "D"))):
            if not np.isfinite(array).all():
                raise Mismatch("a matrix holds a number that is not finite")
        if plant.dt is not None and not (np.isfinite(plant.dt) and plant.dt > 0.0):
            raise Mismatch(f"the sampling period {plant.dt} is not a positive number")
    return first.dt


_NAMES = ("states", "disturbances", "commands", "performance", "measured")
_PLANT = ("A", "B1", "B2", "C1", "D11", "D12", "C2", "D21", "D22")


def _arrays(record: Plant | Controller, names: Sequence[str]) -> list[FloatArray]:
    return [getattr(record, name) for name in names]


def _list(names: Sequence[str]) -> str:
    return ", ".join(names) or "nothing"
