"""Forces of a vehicle's magnets, batched over runs: the full force models, circuits and the track's modulation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maglev_ctrl.analysis.simulation.evaluation import Answering, answering
from maglev_ctrl.arrays import FloatArray, read_only_any
from maglev_ctrl.forces.base import AbstractForceModel
from maglev_ctrl.forces.electromagnet import Electromagnet
from maglev_ctrl.systems import SecondOrderSystem
from maglev_ctrl.vehicle import Equilibrium, Vehicle
from maglev_ctrl.vehicle.circuits import circuit_input, circuit_state, magnet_circuits
from maglev_ctrl.vehicle.structure import structure

SMALLEST_HEIGHT = 1e-3
"""Heights and gaps are not let below this share of the posture's within the step in which a magnet touches."""

PROBES = (0.7, 0.85, 1.0, 1.15, 1.3)
"""Shares of the equilibrium height at which a force model is asked whether it has partials by lateral velocities."""


LATERAL = (".sway", ".roll", ".yaw")
"""Coordinates that move magnets sideways; without them drag has no lateral part."""


@dataclass(frozen=True, eq=False, slots=True)
class Winding:
    """An electromagnet in its vehicle: `member`, its rest state, and the column of its input and state (-1: none)."""

    model: Electromagnet
    member: int
    count: float
    current: float
    voltage: float
    limit: float | None
    command: int
    state: int


@dataclass(frozen=True, eq=False, slots=True)
class MagnetGroup:
    """Magnets of one force model: where they are among all, and whether their gaps do not matter (`bare`)."""

    force: AbstractForceModel
    members: slice | NDArray[np.int64]
    bare: bool
    answer: Answering


@dataclass(frozen=True, eq=False, slots=True)
class MagnetSet:
    """m magnets ready for batches of runs.

    `low`, `high` (3, m): where heights, gaps and speeds are inside the force models' data; `least` the larger of `low`
    and a `floor` above contact.
    """

    groups: tuple[MagnetGroup, ...]
    windings: tuple[Winding, ...]
    share: FloatArray
    side: FloatArray
    upward: FloatArray
    low: FloatArray
    high: FloatArray
    floor: FloatArray
    least: FloatArray
    speed: float
    following: bool

    @classmethod
    def of(cls, vehicle: Vehicle, state: Equilibrium, system: SecondOrderSystem) -> MagnetSet:
        """The magnets about an equilibrium; `system` names inputs and internal states."""
        known, m = structure(vehicle), len(vehicle.magnets)
        low, high = np.full((3, m), -np.inf), np.full((3, m), np.inf)
        groups = []
        for group in known.groups:
            members, span = group.members, group.force.domain
            low[0, members], high[0, members] = span.height
            low[2, members], high[2, members] = span.speed
            bare = group.blind or bool(np.isnan(state.magnet_gaps[members]).any())
            if span.gap is not None and not bare:
                low[1, members], high[1, members] = span.gap
            if not isinstance(group.force, Electromagnet):
                kinetic = _kinetic(group.force, state, members, bare)
                answer = answering(group.force, kinetic=kinetic)
                groups.append(MagnetGroup(group.force, _consecutive(members), bare, answer))
        posture = state.posture
        rest = np.array([posture.height, posture.gap or 1.0, 0.0])
        floor = np.where(rest[:, None] > 0.0, SMALLEST_HEIGHT * rest[:, None], -np.inf)
        return cls(
            groups=tuple(groups),
            windings=_windings(vehicle, state, system),
            share=read_only_any(posture.strength * known.count),
            side=known.side,
            upward=known.upward,
            low=read_only_any(low),
            high=read_only_any(high),
            floor=read_only_any(np.broadcast_to(floor, low.shape)),
            least=read_only_any(np.maximum(low, floor)),
            speed=posture.speed,
            following=vehicle.drag_direction and any(name.endswith(LATERAL) for name in known.dofs),
        )

    def forces(
        self, places: FloatArray, closing: FloatArray, left: FloatArray, xi: FloatArray, applied: FloatArray
    ) -> tuple[FloatArray, FloatArray | None]:
        """Forces (r, 3, m) forward, left, up on the magnets, and the lateral force (r, m) of drag that follows, if any.

        Parameters
        ----------
        places : (r, 3, m) heights, gaps and speeds over the guideway
        closing : (r, 2, m) m/s rates of heights and gaps
        left : (r, m) m/s velocity to the left in space
        xi, applied : (r, n_xi) internal states and (r, n_u) commands
        """
        inside = np.minimum(np.maximum(places, self.least), self.high)
        found = np.zeros(places.shape)
        follow = np.zeros(left.shape) if self.following else None
        for group in self.groups:
            members = group.members
            height, speed = inside[:, 0, members], inside[:, 2, members]
            gap = None if group.bare else inside[:, 1, members]
            lift, guidance, drag, moving = group.answer(
                height, gap, speed, closing[:, 0, members], closing[:, 1, members]
            )
            found[:, 0, members] = -moving
            if guidance is not None:
                found[:, 1, members] = -self.side[members] * guidance
            found[:, 2, members] = lift
            if follow is not None:
                follow[:, members] = _following(group.force, height, gap, speed, drag)
        found *= self.share
        for winding in self.windings:
            i = winding.member
            current = winding.current + extra_current(winding, xi, applied)
            # The standing current has the strength in it already.
            found[:, 2, i] = found[:, 2, i] + winding.count * winding.model.pull(inside[:, 0, i], current)
        return found, None if follow is None else -self.share * follow * left

    def static(self, places: FloatArray) -> FloatArray:
        """Forces (r, 3, m) of passive magnets at the equilibrium speed, of position alone: what a track modulates."""
        still = places.copy()
        still[:, 2] = self.speed
        r = len(places)
        columns = max((w.state for w in self.windings), default=-1) + 1
        inputs = max((w.command for w in self.windings), default=-1) + 1
        nothing = np.zeros(places.shape)
        return self.forces(still, nothing, nothing[:, 0], np.zeros((r, columns)), np.zeros((r, inputs)))[0]

    def circuits(
        self, places: FloatArray, closing: FloatArray, xi: FloatArray, applied: FloatArray, out: FloatArray
    ) -> None:
        """Put the rates of the currents of magnets driven by voltage into `out` (r, n_xi): v = R i + d(L i)/dt."""
        for winding in self.windings:
            if winding.state < 0:
                continue
            i, model = winding.member, winding.model
            gap = np.maximum(places[:, 0, i], self.floor[0, i])
            current = winding.current + xi[:, winding.state]
            voltage = winding.voltage + applied[:, winding.command]
            opening = closing[:, 0, i]
            # dL/dg = -2 (L - L_leak) / l
            slope = -2.0 * (model.inductance(gap) - model.leakage) / model.path(gap)
            change = (voltage - model.resistance * current - slope * current * opening) / model.inductance(gap)
            out[:, winding.state] = change


def extra_current(winding: Winding, xi: FloatArray, applied: FloatArray) -> FloatArray:
    """Current above the standing one, (r,) A."""
    return np.asarray(xi[:, winding.state] if winding.state >= 0 else applied[:, winding.command])


def _consecutive(members: NDArray[np.int64]) -> slice | NDArray[np.int64]:
    """A slice where the members stand side by side, which copies nothing."""
    first = int(members[0])
    return slice(first, first + len(members)) if np.all(np.diff(members) == 1) else members


def _following(
    force: AbstractForceModel, height: FloatArray, gap: FloatArray | None, speed: FloatArray, drag: FloatArray
) -> FloatArray:
    """Drag over speed, which at rest is the drag's slope."""
    if not speed.min(initial=np.inf) <= 0.0:
        return drag / speed
    still = force.derivatives(height, gap, speed).by_speed.drag
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.where(speed > 0.0, drag / speed, still))


def _kinetic(force: AbstractForceModel, state: Equilibrium, members: NDArray[np.int64], bare: bool) -> bool:
    """Whether a model has partials by vertical or lateral velocity anywhere it is asked."""
    span = force.domain.height
    heights = np.clip(np.outer(PROBES, state.magnet_heights[members]), *span)
    gaps = None if bare else np.broadcast_to(state.magnet_gaps[members], heights.shape)
    slopes = force.derivatives(heights, gaps, np.full_like(heights, state.at.speed))
    parts = (slopes.by_vertical_velocity, slopes.by_lateral_velocity)
    return any(bool(np.any(getattr(part, name))) for part in parts for name in ("lift", "guidance", "drag"))


def _windings(vehicle: Vehicle, state: Equilibrium, system: SecondOrderSystem) -> tuple[Winding, ...]:
    found = magnet_circuits(vehicle, state)
    return tuple(
        Winding(
            model=magnet.force.unlimited(),
            member=i,
            count=magnet.count,
            current=found[magnet.name].current,
            voltage=found[magnet.name].voltage,
            limit=magnet.force.flux_limit,
            command=system.inputs.index(circuit_input(magnet)[0]),
            state=system.internal.index(circuit_state(magnet)[0]) if circuit_state(magnet) else -1,
        )
        for i, magnet in enumerate(vehicle.magnets)
        if isinstance(magnet.force, Electromagnet)
    )
