"""Places where passive dampers may sit, and the family of vehicle models they act on.

Damper j opposes the rate r_j of its own stroke with the force -c_j r_j, c_j >= 0: A(c) = A_0 - sum c_j B_j R_j. In
second-order form M q'' + (C_0 + sum c_j b_j b_j') q' + K q = 0 with R = [0, b'] and B = [0; M^-1 b] (collocated).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from maglev_ctrl.arrays import FloatArray, read_only
from maglev_ctrl.errors import ModelError
from maglev_ctrl.kernels import scaling
from maglev_ctrl.synthesis.neutral import hidden_modes
from maglev_ctrl.synthesis.weights import require_distinct, require_known, require_single
from maglev_ctrl.systems import Controller, SecondOrderSystem
from maglev_ctrl.systems.plant import Plant


@dataclass(frozen=True, eq=False, slots=True)
class DampingPlace:
    """Where a damper may sit.

    `direction` b (n,) with the stroke b'q of a second-order system, or `port` (command, rate output) of plants; `cost`
    per N s/m (any unit of cost), `limit` the largest damping that fits, N s/m.
    """

    name: str
    direction: ArrayLike | None = None
    port: tuple[str, str] | None = None
    cost: float = 1.0
    limit: float = np.inf

    def __post_init__(self) -> None:
        if (self.direction is None) == (self.port is None):
            raise ValueError(f"place {self.name!r}: expected either a direction or a port")
        for label, value, finite in (("cost", self.cost, True), ("limit", self.limit, False)):
            if not value > 0.0 or (finite and not np.isfinite(value)):
                raise ValueError(f"place {self.name!r}: {label}: expected a positive number, got {value!r}")


@dataclass(frozen=True, eq=False, slots=True)
class DampedFamily:
    """Vertices of a family with dampers at the same places: A (v, n, n), B (v, n, k), R (v, k, n), N s/m.

    `mass`, `damping`, `stiffness` (v, m, m) and `directions` (m, k) of vertices in second-order form without internal
    states, None otherwise; `plants` carry the ports as commands and rates.
    """

    A: FloatArray
    B: FloatArray
    R: FloatArray
    cost: FloatArray
    limit: FloatArray
    places: tuple[str, ...]
    plants: tuple[Plant, ...]
    mass: FloatArray | None = None
    damping: FloatArray | None = None
    stiffness: FloatArray | None = None
    directions: FloatArray | None = None

    def loops(self, c: FloatArray) -> FloatArray:
        """A(c) of every vertex; (v, n, n)."""
        return np.asarray(self.A - (self.B * c) @ self.R)

    def abscissae(self, c: FloatArray) -> FloatArray:
        """Largest real part of the poles of every vertex; (v,) 1/s."""
        return np.asarray(np.max(np.linalg.eigvals(self.loops(c)).real, axis=-1))

    def law(self, c: FloatArray, *, name: str = "passive dampers") -> Controller:
        """The dampers as a feedback law from stroke rates to forces."""
        return Controller.static(
            -np.diag(c), measured=self.plants[0].measured, commands=self.plants[0].commands, name=name
        )

    def only(self, place: int) -> DampedFamily:
        """The same family with dampers at one place alone."""
        one = slice(place, place + 1)
        return DampedFamily(
            A=self.A, B=self.B[:, :, one], R=self.R[:, one], cost=self.cost[one], limit=self.limit[one],
            places=self.places[one], plants=tuple(_one_port(plant, place) for plant in self.plants), mass=self.mass,
            damping=self.damping, stiffness=self.stiffness,
            directions=None if self.directions is None else self.directions[:, one],
        )  # fmt: skip


@dataclass(frozen=True, eq=False, slots=True)
class Scales:
    """Units in which the family is of order one: x = T x^ (diagonal), time 1/`rate`, damping `damping` (k,), `cost`."""

    T: FloatArray
    rate: float
    damping: FloatArray
    cost: float


def damped_family(
    vertices: Sequence[SecondOrderSystem] | Sequence[Plant], places: Sequence[DampingPlace]
) -> DampedFamily:
    """Vertices and places as one family.

    Parameters
    ----------
    vertices : second-order systems with `direction` places, or continuous plants with `port` places; equal states

    Raises
    ------
    ValueError : no vertex or place, doubled or unknown names, shapes that differ, a sampled plant, a rate that its own
        command reaches directly
    ModelError : a mode that grows or is neutral moves no damper (it is named)

    Examples
    --------
    >>> mass = SecondOrderSystem.from_matrices([[2.0]], [[0.0]], [[8.0]])
    >>> family = damped_family([mass], [DampingPlace("leg", [1.0])])
    >>> family.loops(np.array([4.0]))[0]
    array([[ 0.,  1.],
           [-4., -2.]])
    """
    if not vertices or not places:
        raise ValueError("vertices, places: expected at least one of each")
    require_distinct((place.name for place in places), what="place")
    plants = tuple(
        _second_order_plant(x, places) if isinstance(x, SecondOrderSystem) else _port_plant(x, places) for x in vertices
    )
    if len({plant.states for plant in plants}) != 1:
        raise ValueError("vertices: expected the same states at every vertex")
    for plant in plants:
        unseen = hidden_modes(plant.A, plant.C2, plant.states)
        if unseen:
            raise ModelError(f"no damper moves with {unseen[0].label} of {plant.name}: add a place that strokes in it")
    second_order: dict[str, FloatArray] = {}
    systems = [x for x in vertices if isinstance(x, SecondOrderSystem)]
    if systems and not any(x.internal or x.ignorable for x in systems):
        second_order = {
            key: read_only(np.stack([getattr(x, letter) for x in systems]), name=letter)
            for key, letter in (("mass", "M"), ("damping", "C"), ("stiffness", "K"))
        }
        second_order["directions"] = read_only(np.stack([_direction(p, systems[0]) for p in places], -1), name="b")
    return DampedFamily(
        A=read_only(np.stack([p.A for p in plants]), name="A"), B=read_only(np.stack([p.B2 for p in plants]), name="B"),
        R=read_only(np.stack([p.C2 for p in plants]), name="R"), cost=read_only([p.cost for p in places], name="cost"),
        limit=np.array([p.limit for p in places]), places=tuple(p.name for p in places), plants=plants, **second_order,
    )  # fmt: skip


def scaled(family: DampedFamily) -> tuple[DampedFamily, Scales]:
    """The family in units where its matrices are of order one, and those units."""
    typical = np.max(np.abs(family.A), axis=0)
    T = scaling.balance(typical)
    A = family.A * T / T[:, None]
    rate = float(max(np.max(np.abs(np.linalg.eigvals(A))), 1e-300))
    push = np.mean(np.abs(np.einsum("vnk,vkn->vk", family.B, family.R)), axis=0)
    reach = np.max(np.linalg.norm(family.B / T[:, None], axis=1) * np.linalg.norm(family.R * T, axis=2), axis=0)
    damping = rate / np.maximum(push, 1e-3 * reach)
    cost = float(np.sum(family.cost * damping))
    smaller = DampedFamily(
        A=A / rate, B=family.B / T[:, None] * np.sqrt(damping / rate),
        R=family.R * T * np.sqrt(damping / rate)[:, None], cost=family.cost * damping / cost,
        limit=family.limit / damping, places=family.places, plants=family.plants,
    )  # fmt: skip
    return smaller, Scales(T, rate, damping, cost)


def _direction(place: DampingPlace, system: SecondOrderSystem) -> FloatArray:
    if place.direction is None:
        raise ValueError(f"place {place.name!r}: expected a direction on a second-order system, got a port")
    vector = read_only(place.direction, name=f"place {place.name!r}: direction")
    if vector.shape != (len(system.dofs),) or not np.any(vector):
        raise ValueError(f"place {place.name!r}: direction: expected {len(system.dofs)} numbers, not all zero")
    return vector


def _second_order_plant(system: SecondOrderSystem, places: Sequence[DampingPlace]) -> Plant:
    require_single(system)
    b = np.stack([_direction(place, system) for place in places], axis=-1)
    pushed = np.linalg.solve(system.M, b)
    n_q, n_xi = len(system.positions), len(system.internal)
    B = np.vstack([np.zeros((n_q, len(places))), pushed, system.G_a @ pushed])
    R = np.hstack([np.zeros((len(places), n_q)), b.T, np.zeros((len(places), n_xi))])
    return _plant(system.state_matrix(), B, R, system.states, tuple(p.name for p in places), "vertex")


def _port_plant(plant: Plant, places: Sequence[DampingPlace]) -> Plant:
    if plant.dt is not None:
        raise ValueError(f"vertices: plant {plant.name!r} is sampled; a damper acts in continuous time")
    columns, rows = [], []
    for place in places:
        if place.port is None:
            raise ValueError(f"place {place.name!r}: expected a port (command, rate) on a plant, got a direction")
        require_known(place.port[0], plant.commands, what="command")
        require_known(place.port[1], plant.measured, what="measured")
        columns.append(plant.commands.index(place.port[0]))
        rows.append(plant.measured.index(place.port[1]))
    if np.any(plant.D22[np.ix_(rows, columns)]):
        raise ValueError(f"vertices: plant {plant.name!r}: a command reaches a stroke rate directly")
    names = tuple(place.name for place in places)
    return _plant(plant.A, plant.B2[:, columns], plant.C2[rows], plant.states, names, plant.name)


def _plant(A: FloatArray, B: FloatArray, R: FloatArray, states: tuple[str, ...], names: tuple[str, ...], name: str,
           ) -> Plant:  # fmt: skip
    """Forces at the places in, stroke rates out; the same channel is disturbance and performance."""
    rates = tuple(f"{x}.rate" for x in names)
    return Plant.from_matrices(
        A, B, B, R, R, states=states, disturbances=tuple(f"{x}.push" for x in names), commands=names,
        performance=tuple(f"{x}.stroke_rate" for x in names), measured=rates, name=name,
    )  # fmt: skip


def _one_port(plant: Plant, place: int) -> Plant:
    one = slice(place, place + 1)
    return _plant(plant.A, plant.B2[:, one], plant.C2[one], plant.states, plant.commands[one], plant.name)
