"""The equilibrium of a vehicle: weight, magnets, springs, thrust and air in balance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from difflib import get_close_matches

import numpy as np

from maglev_ctrl.arrays import FloatArray, read_only, read_only_any
from maglev_ctrl.errors import ModelError, OutOfDomain
from maglev_ctrl.forces.base import MagnetForces
from maglev_ctrl.vehicle.kinematics import stance, stroke_between
from maglev_ctrl.vehicle.loads import (
    MagnetField,
    longitudinal_thrust,
    magnet_field,
    net_force,
    other_forces,
    require_unsaturated,
)
from maglev_ctrl.vehicle.operating import Equilibrium, Hold, OperatingPoint, Posture
from maglev_ctrl.vehicle.structure import structure
from maglev_ctrl.vehicle.tangent import tangent_stiffness
from maglev_ctrl.vehicle.vehicle import Vehicle

BALANCE_TOLERANCE = 1e-9
"""Largest force left over, as a share of the weight (moments: of the weight times the largest lever)."""

MAXIMUM_STEPS = 60
MAXIMUM_HALVINGS = 40


def equilibrium(
    vehicle: Vehicle, at: OperatingPoint, *, hold: Hold = "height", loads: Mapping[str, float] | None = None
) -> Equilibrium:
    """The static state of a vehicle at an operating point (Eqs. 16 and 17; Sec. 2.4 for off-centre states).

    Thrust on each body balances its drag, so the speed is held. The vehicle stands level in its reference posture:
    springs that touch a body without magnets carry its load there (least elastic energy), other springs are unloaded.

    Parameters
    ----------
    hold : "height": every magnet at `at.height` and its gap, all currents trimmed by one factor until the lift is the
        weight; "frozen": the same posture with the currents as they are. What remains is `unbalanced`: dead loads at
        the centres of mass supply it. "strength": the currents as they are, the posture solved by Newton's method
        from the reference height (`at.height` is where the search starts); a lateral offset that is not zero is then
        held by a side force, which `unbalanced` shows
    loads : dead loads at the centres of mass by coordinate, such as {"car.sway": 1e3}, N or N m

    Raises
    ------
    ModelError : there is no equilibrium; the message carries the forces
    OutOfDomain : the equilibrium lies outside a force model's data
    ValueError : a load names no coordinate of the vehicle

    Examples
    --------
    >>> from maglev_ctrl.vehicle import Body, SpringDamper
    >>> cart = Vehicle("cart", bodies=(Body("car", 10.0),), connections=(SpringDamper("leg", "car", stiffness=1e4),),
    ...                reference_height=0.1)
    >>> round(equilibrium(cart, OperatingPoint(0.0, 0.1)).preloads["leg"], 4)
    98.0665
    """
    if hold not in ("height", "strength", "frozen"):
        raise ValueError(f"hold: expected 'height', 'strength' or 'frozen', got {hold!r}")
    n = len(vehicle.dofs)
    level = Posture(
        speed=at.speed,
        height=vehicle.reference_height if hold == "strength" else at.height,
        gap=at.gap if at.gap is not None else vehicle.reference_gap,
        offset=at.lateral_offset,
        displacement=np.zeros(n),
        strength=1.0,
        static_forces={},
        thrust={},
        loads=_dead_loads(vehicle, loads or {}),
    )
    level = replace(level, static_forces=_carried_loads(vehicle, level))
    if hold == "strength":
        solved = _solve(vehicle, at, level)
        return _record(vehicle, at, hold, solved, _static_field(vehicle, solved))
    trimming = hold == "height" and bool(vehicle.magnets)
    field = _static_field(vehicle, level, trimmed=not trimming)
    if trimming:
        strength = _trim(vehicle, level, field)
        level, field = replace(level, strength=strength), field.scaled(strength)
        require_unsaturated(vehicle, level, field.heights)
    thrusting = replace(level, thrust=longitudinal_thrust(vehicle, level, field.drag))
    return _record(vehicle, at, hold, _with_support(vehicle, thrusting, field), field)


def _dead_loads(vehicle: Vehicle, loads: Mapping[str, float]) -> FloatArray:
    found = np.zeros(len(vehicle.dofs))
    for name, value in loads.items():
        if name not in vehicle.dofs:
            near = get_close_matches(name, vehicle.dofs, n=1)
            advice = f"did you mean {near[0]!r}?" if near else f"the coordinates are {', '.join(vehicle.dofs)}"
            raise ValueError(f"loads: there is no coordinate {name!r}; {advice}")
        found[vehicle.dofs.index(name)] = value
    return found


def _static_field(vehicle: Vehicle, posture: Posture, *, trimmed: bool = True) -> MagnetField:
    return magnet_field(vehicle, posture, stance(vehicle, posture.displacement), partials=False, trimmed=trimmed)


def _trim(vehicle: Vehicle, level: Posture, field: MagnetField) -> float:
    """Common factor on the magnets' forces that makes the lift carry the weight and the vertical dead loads."""
    lift = float(np.sum(field.lift))
    heave = [i for i, name in enumerate(vehicle.dofs) if name.endswith(".heave")]
    weight = vehicle.mass * vehicle.gravity - float(np.sum(level.loads[heave]))
    if not (lift > 0.0 and weight > 0.0):
        raise ModelError(
            f"no equilibrium at height {level.height:.6g} m and speed {level.speed:.6g} m/s: the magnets lift "
            f"{lift:.6g} N and have to carry {weight:.6g} N; no scaling of the currents can balance that"
        )
    return weight / lift


def _carried_loads(vehicle: Vehicle, level: Posture) -> dict[str, float]:
    """Static forces of the springs that carry bodies without magnets, least elastic energy."""
    known = structure(vehicle)
    static = {link.name: 0.0 for link in vehicle.links}
    carried = {*known.carriers, *(e.body for e in vehicle.coefficient_elements)}
    idle = known.index.keys() - carried
    rows = [i for i, name in enumerate(known.dofs) if name.rsplit(".", 1)[0] in idle and not name.endswith(".surge")]
    if not rows:
        return static
    chosen = [
        i for i, x in enumerate(known.links) if known.static_stiffness[i] > 0.0 and (x.body in idle or x.to in idle)
    ]
    links = [known.links[i] for i in chosen]
    wanted = -_without_magnets(vehicle, level)[rows]
    weights = np.sqrt(known.static_stiffness[chosen])
    columns = stance(vehicle, level.displacement).stroke[chosen].T
    # Rows are scaled by the body's weight and levers, so that newtons and newton metres count alike.
    scale = known.force_scale[rows]
    system = columns[rows] * weights / scale[:, None]
    solved = weights * np.linalg.lstsq(system, wanted / scale, rcond=1e-12)[0] if links else np.zeros(0)
    left = wanted - columns[rows] @ solved
    worst = int(np.argmax(np.abs(left) / scale))
    if abs(left[worst]) > BALANCE_TOLERANCE * scale[worst]:
        raise ModelError(
            f"no equilibrium: {vehicle.dofs[rows[worst]]} is left with {-left[worst]:.6g} N (or N m) that no spring "
            f"carries; the vehicle weighs {vehicle.mass * vehicle.gravity:.6g} N"
        )
    return static | {link.name: float(force) for link, force in zip(links, solved, strict=True)}


def _without_magnets(vehicle: Vehicle, level: Posture) -> FloatArray:
    """Net force on the bodies when the magnets are off: weight, dead loads, thrust and air."""
    thrusting = replace(level, thrust=longitudinal_thrust(vehicle, level, None))
    return other_forces(vehicle, thrusting, stance(vehicle, level.displacement))


def _with_thrust(vehicle: Vehicle, posture: Posture) -> Posture:
    return replace(posture, thrust=longitudinal_thrust(vehicle, posture, _static_field(vehicle, posture).drag))


def _with_support(vehicle: Vehicle, posture: Posture, field: MagnetField | None = None) -> Posture:
    """Bodies held by coefficient elements alone: the elements carry what is left there."""
    if vehicle.magnets or not vehicle.coefficient_elements:
        return posture
    held = {element.body for element in vehicle.coefficient_elements}
    rows = [i for i, name in enumerate(vehicle.dofs) if name.rsplit(".", 1)[0] in held]
    loads = posture.loads.copy()
    loads[rows] -= net_force(vehicle, posture, field=field)[rows]
    return replace(posture, loads=loads)


def _solve(vehicle: Vehicle, at: OperatingPoint, level: Posture) -> Posture:
    """Newton's method on the posture, steps halved until the next Newton step shrinks (a scale-free measure)."""
    level = _with_support(vehicle, level)
    held = ("surge", "sway") if at.lateral_offset != 0.0 else ("surge",)
    free = [i for i, name in enumerate(vehicle.dofs) if name.rsplit(".", 1)[1] not in held]
    start = np.zeros(len(vehicle.dofs))
    higher = at.height - level.height
    start[[i for i, name in enumerate(vehicle.dofs) if name.endswith(".heave")]] = -higher if vehicle.hangs else higher
    posture, scale = _at(vehicle, level, start), structure(vehicle).force_scale[free]
    force = net_force(vehicle, posture)[free]
    for _ in range(MAXIMUM_STEPS):
        stiffness = tangent_stiffness(vehicle, posture)[np.ix_(free, free)]
        step = np.asarray(np.linalg.lstsq(stiffness, force, rcond=1e-13)[0], dtype=np.float64)
        if np.max(np.abs(force) / scale, initial=0.0) < 1e-3 * BALANCE_TOLERANCE:
            return posture
        tried = _shorten(vehicle, level, posture, free=free, step=step, stiffness=stiffness)
        if tried is None:
            break
        posture = tried
        force = net_force(vehicle, posture)[free]
    worst = int(np.argmax(np.abs(force) / scale))
    if abs(force[worst]) <= BALANCE_TOLERANCE * scale[worst]:
        return posture
    raise ModelError(
        f"no equilibrium found with the magnets as they are: {vehicle.dofs[free[worst]]} keeps {force[worst]:.6g} N "
        f"(or N m) of {scale[worst]:.6g} after Newton's method came to displacement "
        f"{posture.displacement[free[worst]]:.6g} m (or rad) from height {level.height:.6g} m"
    )


def _shorten(
    vehicle: Vehicle,
    level: Posture,
    posture: Posture,
    *,
    free: list[int],
    step: FloatArray,
    stiffness: FloatArray,
) -> Posture | None:
    """The first of the step, half of it, ... that brings the posture nearer; None when none does."""
    refused: OutOfDomain | None = None
    full = np.linalg.norm(step)
    for halving in range(MAXIMUM_HALVINGS):
        moved = posture.displacement.copy()
        share = 0.5**halving
        moved[free] += share * step
        try:
            tried = _at(vehicle, level, moved)
            following = np.linalg.lstsq(stiffness, net_force(vehicle, tried)[free], rcond=1e-13)[0]
        except OutOfDomain as error:
            refused = error
            continue
        if np.linalg.norm(following) <= (1.0 - 0.25 * share) * full:
            # Creeping along the edge of the data means that the balance lies outside it.
            if refused is not None and share < 1e-6:
                raise refused
            return tried
    if refused is not None:
        raise refused
    return None


def _at(vehicle: Vehicle, level: Posture, displacement: FloatArray) -> Posture:
    """The level posture moved: springs take up their strokes, thrust balances the drag there."""
    start, now = stance(vehicle, level.displacement), stance(vehicle, displacement)
    known = structure(vehicle)
    taken = known.static_stiffness * stroke_between(vehicle, start, now, displacement)
    static = {
        link.name: level.static_forces[link.name] - share
        for link, share in zip(known.links, taken.tolist(), strict=True)
    }
    return _with_thrust(vehicle, replace(level, displacement=displacement, static_forces=static))


def _record(vehicle: Vehicle, at: OperatingPoint, hold: Hold, posture: Posture, field: MagnetField) -> Equilibrium:
    return Equilibrium(
        at=at,
        hold=hold,
        displacement=read_only(posture.displacement, name="displacement"),
        magnet_heights=read_only(field.heights, name="magnet_heights"),
        magnet_gaps=read_only_any(field.gaps),
        forces=MagnetForces(lift=field.lift, guidance=field.guidance, drag=field.drag),
        strength=posture.strength,
        unbalanced=read_only(net_force(vehicle, posture, field=field), name="unbalanced"),
        preloads=dict(posture.static_forces),
        posture=posture,
    )
