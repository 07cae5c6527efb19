"""Dynamic magnets in the coordinates of their vehicle."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from maglev_ctrl.arrays import ComplexArray, FloatArray, read_only_any
from maglev_ctrl.forces.dynamic import DynamicForceModel, static_stiffness
from maglev_ctrl.vehicle.loads import MagnetField
from maglev_ctrl.vehicle.operating import Equilibrium
from maglev_ctrl.vehicle.structure import structure
from maglev_ctrl.vehicle.vehicle import Vehicle


@dataclass(frozen=True, eq=False, slots=True)
class MagnetResponse:
    """One magnet's dynamic stiffness in the coordinates of its vehicle.

    Its generalised force is factor push^T Q motion q. `push`, `motion` (4, n) collect the force and make the motion
    (they differ in the paper's kinematics); the row of roll is zero unless tilt is in. `felt` names the guideway's
    inputs that move under it, with their motion (4,). `static` (4, 4) is Q(0).
    """

    name: str
    model: DynamicForceModel
    height: float
    gap: float | None
    speed: float
    factor: float
    push: FloatArray
    motion: FloatArray
    felt: Mapping[str, FloatArray]
    static: FloatArray

    @property
    def key(self) -> tuple[int, float, float | None, float]:
        """Magnets with the same key share one Q."""
        return id(self.model), self.height, self.gap, self.speed

    def on_vehicle(self, Q: ComplexArray | FloatArray) -> ComplexArray:
        """factor push^T Q motion for Q (..., 4, 4); (..., n, n)."""
        return np.asarray(self.factor * (self.push.T @ Q @ self.motion), dtype=np.complex128)


def magnet_responses(
    vehicle: Vehicle,
    state: Equilibrium,
    field: MagnetField,
    *,
    dynamic: DynamicForceModel | Mapping[str, DynamicForceModel] | None,
    tilt: bool,
) -> tuple[MagnetResponse, ...]:
    """The magnets of a vehicle that have a dynamic stiffness, at an equilibrium.

    Parameters
    ----------
    state, field : the equilibrium, and its magnets' quasi-static forces
    dynamic : dynamic stiffness of all magnets, or by magnet; what the magnets' own force models offer when left out
    tilt : whether Q's roll row and column act on the body's roll

    Raises
    ------
    ValueError : no magnet with a dynamic stiffness, or an unknown magnet
    """
    models = _models(vehicle, dynamic)
    known = structure(vehicle)
    blind = {i for group in known.groups if group.blind for i in group.members.tolist()}
    statics: dict[tuple[int, float, float | None, float], FloatArray] = {}
    found = []
    for i, magnet in enumerate(vehicle.magnets):
        if magnet.name not in models:
            continue
        model, away = models[magnet.name], -1.0 if magnet.side == 1 else 1.0
        height = float(field.heights[i])
        gap = None if i in blind or np.isnan(field.gaps[i]) else float(field.gaps[i])
        key = (id(model), height, gap, state.at.speed)
        if key not in statics:
            statics[key] = static_stiffness(model, height=height, gap=gap, speed=state.at.speed)
        # With the wall at +y the magnet's own frame is the mirror image: sway and roll change sign.
        turn = np.array([1.0, away, 1.0])[:, None]
        roll = away * known.pointwise[known.magnets][i][3] * tilt
        felt = {f"heave@{magnet.name}": np.array([0.0, 0.0, 1.0, 0.0])}
        if magnet.side != 0:
            felt[f"sway@{magnet.name}"] = np.array([0.0, away, 0.0, 0.0])
        found.append(
            MagnetResponse(
                name=magnet.name,
                model=model,
                height=height,
                gap=gap,
                speed=state.at.speed,
                factor=state.posture.strength * float(known.count[i]),
                push=read_only_any(np.vstack([turn * field.jacobian[i], roll])),
                motion=read_only_any(np.vstack([turn * field.motion[i], roll])),
                felt=felt,
                static=statics[key],
            )
        )
    return tuple(found)


def _models(
    vehicle: Vehicle, dynamic: DynamicForceModel | Mapping[str, DynamicForceModel] | None
) -> dict[str, DynamicForceModel]:
    names = [magnet.name for magnet in vehicle.magnets]
    found: dict[str, DynamicForceModel] = {}
    if dynamic is None:
        for magnet in vehicle.magnets:
            if isinstance(magnet.force, DynamicForceModel):
                found[magnet.name] = magnet.force
    elif isinstance(dynamic, Mapping):
        unknown = [name for name in dynamic if name not in names]
        if unknown:
            raise ValueError(f"dynamic: there is no magnet {unknown[0]!r}; the magnets are {', '.join(names)}")
        found = dict(dynamic)
    else:
        found = dict.fromkeys(names, dynamic)
    if not found:
        raise ValueError(f"dynamic: no magnet of vehicle {vehicle.name!r} has a dynamic stiffness")
    return found


def static_mismatch(vehicle: Vehicle, field: MagnetField, responses: tuple[MagnetResponse, ...]) -> float:
    """Largest |S - Q(0)| in height and gap relative to the largest |S|.

    Compared are the directions in which the magnet moves and pushes its vehicle; lateral ones only beside a wall.
    """
    index = {magnet.name: i for i, magnet in enumerate(vehicle.magnets)}
    worst = 0.0
    for one in responses:
        i = index[one.name]
        away = -1.0 if vehicle.magnets[i].side == 1 else 1.0
        turn = np.array([1.0, away, 1.0])
        share = field.by_position[i] * turn[:, None] * turn
        compared = np.outer((one.push[:3] != 0.0).any(axis=1), (one.motion[:3] != 0.0).any(axis=1))
        if vehicle.magnets[i].side == 0:
            compared[1], compared[:, 1] = False, False
        difference = float(np.max(np.abs(one.factor * one.static[:3, :3] - share)[compared], initial=0.0))
        largest = float(np.max(np.abs(share[compared]), initial=0.0))
        if difference > 0.0:
            worst = max(worst, difference / largest if largest > 0.0 else np.inf)
    return worst
