"""The equations of motion of a vehicle with its full force map, batched over runs.

    M q'' = Q(q, q', xi, u, w, w', t),    xi' = ...

M is that of the equilibrium; gyroscopic terms, second order in the rotations, are left out. Forces, strokes and
levers follow the finite rotation of the bodies (`frame`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maglev_ctrl.analysis.simulation.frame import Frame
from maglev_ctrl.analysis.simulation.magnets import MagnetSet
from maglev_ctrl.arrays import FloatArray, read_only_any
from maglev_ctrl.guideway import Modulation
from maglev_ctrl.systems import SecondOrderSystem
from maglev_ctrl.vehicle import Actuator, Equilibrium, SpringDamper, Vehicle
from maglev_ctrl.vehicle.loads import longitudinal_forces
from maglev_ctrl.vehicle.shares import coefficient_share, guideway_inputs
from maglev_ctrl.vehicle.structure import structure


@dataclass(frozen=True, eq=False, slots=True)
class Rates:
    """Accelerations (r, n), rates of internal states (r, n_xi), and what they came from.

    `force` (r, n) generalised; `places` (r, 3, m) heights, gaps, speeds; `closing` (r, 2, m) m/s rates of heights and
    gaps; `lift` (r, m) N; `strokes`, `stroke_rates` (r, l); `applied` (r, n_u) commands after saturation.
    """

    acceleration: FloatArray
    force: FloatArray
    internal: FloatArray
    places: FloatArray
    closing: FloatArray
    lift: FloatArray
    strokes: FloatArray
    stroke_rates: FloatArray
    applied: FloatArray


@dataclass(frozen=True, eq=False, slots=True)
class LinkSet:
    """Springs, dampers and actuators as arrays over l links.

    `felt` (nw, l): the guideway's part of the strokes; None where no link ends at the guideway.
    """

    stiffness: FloatArray
    damping: FloatArray
    tension: FloatArray
    felt: FloatArray | None
    lagged: NDArray[np.int64]
    lag_columns: NDArray[np.int64]
    lag: FloatArray
    lag_damping: FloatArray
    direct: NDArray[np.int64]
    direct_columns: NDArray[np.int64]
    slow: NDArray[np.int64]
    slow_columns: NDArray[np.int64]
    slow_states: NDArray[np.int64]
    bandwidth: FloatArray

    @classmethod
    def of(cls, vehicle: Vehicle, state: Equilibrium, system: SecondOrderSystem) -> LinkSet:
        """The links about an equilibrium."""
        known, links = structure(vehicle), vehicle.links
        felt = np.zeros((len(system.guideway), len(links)))
        for i, link in enumerate(links):
            for name, cosine in guideway_inputs(link.name, link.to, link.direction, angular=link.angular).items():
                felt[system.guideway.index(name), i] = cosine
        dampers = [(i, e) for i, e in enumerate(links) if isinstance(e, SpringDamper) and e.lag > 0.0]
        actuators = [(i, e) for i, e in enumerate(links) if isinstance(e, Actuator)]
        ideal = [(i, e) for i, e in actuators if e.bandwidth is None]
        slow = [(i, e) for i, e in actuators if e.bandwidth is not None]
        return cls(
            stiffness=known.link_stiffness,
            damping=known.link_damping,
            tension=read_only_any([state.posture.static_forces.get(link.name, 0.0) for link in links]),
            felt=read_only_any(felt) if np.any(felt) else None,
            lagged=_indices([i for i, _ in dampers]),
            lag_columns=_indices([system.internal.index(f"{e.name}.lag") for _, e in dampers]),
            lag=read_only_any(np.array([e.lag for _, e in dampers])),
            lag_damping=read_only_any(np.array([e.damping for _, e in dampers])),
            direct=_indices([i for i, _ in ideal]),
            direct_columns=_indices([system.inputs.index(e.name) for _, e in ideal]),
            slow=_indices([i for i, _ in slow]),
            slow_columns=_indices([system.inputs.index(e.name) for _, e in slow]),
            slow_states=_indices([system.internal.index(f"{e.name}.force") for _, e in slow]),
            bandwidth=read_only_any(np.array([e.bandwidth or 0.0 for _, e in slow])),
        )


def _indices(values: list[int]) -> NDArray[np.int64]:
    return read_only_any(np.array(values, dtype=np.int64))


@dataclass(frozen=True, eq=False, slots=True)
class Equations:
    """The equations of one vehicle about one equilibrium; `system` is its linear model without delays.

    `rest` (3, m): heights, gaps and speeds at rest; `opening` (2, m): how heights and gaps grow with motion up and to
    the left; `under` (nw, 2 m): how the guideway's motion narrows them. `low`, `high` (n_u,): what each input can give,
    beside what it carries at rest; `limited`: whether one has a limit.
    """

    system: SecondOrderSystem
    frame: Frame
    magnets: MagnetSet
    links: LinkSet
    rest: FloatArray
    opening: FloatArray
    under: FloatArray
    constant: FloatArray
    push: FloatArray
    drag_factor: FloatArray
    low: FloatArray
    high: FloatArray
    limited: bool
    measured_K: FloatArray
    measured_C: FloatArray
    measured_push: FloatArray
    measured_rate_push: FloatArray
    stations: FloatArray
    mass: FloatArray
    compliance: FloatArray
    """M^-1, (n, n)."""
    static: FloatArray
    """Forces (1, 3, m) that a track modulates, at rest."""

    @classmethod
    def of(
        cls,
        vehicle: Vehicle,
        state: Equilibrium,
        system: SecondOrderSystem,
        *,
        commands: dict[str, float] | None = None,
    ) -> Equations:
        """Gather what does not change.

        Parameters
        ----------
        system : `linearize(vehicle, state, pade_order=0)`
        commands : limits of inputs by name, beside the actuators' own
        """
        known, posture = structure(vehicle), state.posture
        n, w_names = len(known.dofs), system.guideway
        shares = [coefficient_share(e, vehicle, speed=posture.speed) for e in vehicle.coefficient_elements]
        K_e = np.array([share.K for share in shares]).reshape(-1, n, n)
        C_e = np.array([share.C for share in shares]).reshape(-1, n, n)
        K_w, C_w = np.zeros((len(shares), len(w_names), n)), np.zeros((len(shares), len(w_names), n))
        for i, share in enumerate(shares):
            for name in share.K_w:
                K_w[i, w_names.index(name)] = share.K_w[name]
                C_w[i, w_names.index(name)] = share.C_w[name]
        frame = Frame.of(vehicle, state.displacement)
        weight = np.zeros(n)
        for i, name in enumerate(known.dofs):
            body, freedom = name.rsplit(".", 1)
            if freedom == "heave":
                weight[i] = -vehicle.gravity * known.masses[known.index[body]]
        low, high = _input_limits(vehicle, state, system, commands or {})
        thrust = longitudinal_forces(vehicle, posture, 0.0)
        stations = [magnet.position[0] for magnet in vehicle.magnets]
        stations += [vehicle.body(element.body).position[0] for element in vehicle.coefficient_elements]
        still = np.sum(K_e, axis=0) @ posture.displacement if len(K_e) else np.zeros(n)
        magnets = MagnetSet.of(vehicle, state, system)
        opening = np.stack([magnets.upward, -magnets.side])
        rest = _rest(frame, opening, state)
        return cls(
            system=system,
            frame=frame,
            magnets=magnets,
            links=LinkSet.of(vehicle, state, system),
            rest=read_only_any(rest),
            opening=read_only_any(opening),
            under=read_only_any(_under(vehicle, w_names, opening)),
            constant=read_only_any(posture.loads + weight - state.unbalanced - still),
            push=read_only_any(thrust),
            drag_factor=known.drag_factor,
            low=low,
            high=high,
            limited=bool(np.any(np.isfinite(low)) or np.any(np.isfinite(high))),
            measured_K=read_only_any(K_e),
            measured_C=read_only_any(C_e),
            measured_push=read_only_any(K_w),
            measured_rate_push=read_only_any(C_w),
            stations=read_only_any(np.array(stations, dtype=np.float64)),
            mass=system.M,
            compliance=read_only_any(np.linalg.inv(system.M)),
            static=read_only_any(magnets.static(rest[None])),
        )

    def saturated(self, command: FloatArray) -> FloatArray:
        """What the inputs give of commands (r, n_u)."""
        if not self.limited:
            return command
        return np.asarray(np.minimum(np.maximum(command, self.low), self.high))

    def factors(self, modulation: Modulation | None, times: FloatArray) -> FloatArray | None:
        """The track's stiffness over its mean, less one, under each element at times (T,); (T, elements)."""
        if modulation is None:
            return None
        return modulation.at(self.magnets.speed * times[:, None] + self.stations) - 1.0

    def rates(
        self,
        state: tuple[FloatArray, FloatArray, FloatArray],
        applied: FloatArray,
        *,
        ground: tuple[FloatArray, FloatArray] | None,
        factor: FloatArray | None = None,
    ) -> Rates:
        """Accelerations and rates of the internal states.

        Parameters
        ----------
        state : q, q', xi: (r, n), (r, n), (r, n_xi) increments from the equilibrium
        applied : (r, n_u) commands after saturation and delay
        ground : w, w': (r or 1, nw) the guideway under the elements, and its rate; None: smooth and level
        factor : (elements,) of `factors`
        """
        q, v, xi = state
        frame, m = self.frame, self.frame.magnets
        lever, turned = frame.levers(q)
        moved, velocity = frame.moved(q, turned), frame.velocities(v, lever)
        places, closing, left = self._places(q, v, ground, moved, velocity)
        strokes, stroke_rates, tension, internal = self._tension(state, applied, ground, moved, velocity)
        # Five rows x, y, z, x, y, as of the levers.
        force = (tension @ frame.pull).reshape(len(q), 5, -1)
        Q = self.constant
        if m:
            magnetic, follow = self.magnets.forces(places, closing, left, xi, applied)
            if factor is not None:
                magnetic += factor[:m] * (self.magnets.static(places) - self.static)
            if follow is not None and frame.sway_rows is None:
                magnetic[:, 1] += follow
            elif follow is not None and frame.sway_rows is not None:
                Q = Q + follow @ frame.sway_rows.T
            force[:, :3, :m] = magnetic
        if frame.pushes:
            ahead = self.magnets.speed + velocity[:, 0, m : m + frame.pushes]
            force[:, 0, m : m + frame.pushes] = self.push - self.drag_factor * ahead * np.abs(ahead)
        force[:, 3:, : m + frame.pushes] = force[:, :2, : m + frame.pushes]
        if frame.twists:
            Q = Q + tension @ frame.angular_rows.T
        Q = Q + frame.gathered(force, lever)
        if len(self.measured_K):
            Q = Q + self._measured(q, v, ground, factor)
        self.magnets.circuits(places, closing, xi, applied, internal)
        return Rates(
            acceleration=Q @ self.compliance.T,
            force=Q,
            internal=internal,
            places=places,
            closing=closing,
            lift=force[:, 2, :m],
            strokes=strokes,
            stroke_rates=stroke_rates,
            applied=applied,
        )

    def _places(
        self,
        q: FloatArray,
        v: FloatArray,
        ground: tuple[FloatArray, FloatArray] | None,
        moved: FloatArray,
        velocity: FloatArray,
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Heights, gaps, speeds (r, 3, m), the rates of the first two (r, 2, m), and velocities left (r, m)."""
        frame, m = self.frame, self.frame.magnets
        places = np.empty((len(q), 3, m))
        # From the rows x, y, z: up, then left.
        shift, rate, left = moved[:, 2:0:-1, :m], velocity[:, 2:0:-1, :m], velocity[:, 1, :m]
        if frame.sway_rows is not None:
            left = v @ frame.sway_rows
            shift = np.stack([shift[:, 0], q @ frame.sway_rows], axis=1)
            rate = np.stack([rate[:, 0], left], axis=1)
        near, closing = self.opening * shift, self.opening * rate
        if ground is not None:
            near -= (ground[0] @ self.under).reshape(len(ground[0]), 2, m)
            closing -= (ground[1] @ self.under).reshape(len(ground[1]), 2, m)
        np.add(near, self.rest[:2], out=places[:, :2])
        np.add(velocity[:, 0, :m], self.magnets.speed, out=places[:, 2])
        return places, closing, left

    def _tension(
        self,
        state: tuple[FloatArray, FloatArray, FloatArray],
        applied: FloatArray,
        ground: tuple[FloatArray, FloatArray] | None,
        moved: FloatArray,
        velocity: FloatArray,
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Strokes, their rates and the links' tensions, (r, l) each, and the rates of internal states."""
        (q, v, xi), frame, links = state, self.frame, self.links
        r = len(q)
        internal = np.zeros(xi.shape)
        if not frame.links:
            none = np.zeros((r, 0))
            return none, none, none, internal
        strokes, stroke_rates = moved.reshape(r, -1) @ frame.ends, velocity.reshape(r, -1) @ frame.ends
        if frame.twists:
            strokes += q @ frame.angular_rows
            stroke_rates += v @ frame.angular_rows
        if ground is not None and links.felt is not None:
            strokes -= ground[0] @ links.felt
            stroke_rates -= ground[1] @ links.felt
        tension = links.tension - links.stiffness * strokes - links.damping * stroke_rates
        if len(links.lagged):
            lagging = xi[:, links.lag_columns]
            tension[:, links.lagged] -= links.lag_damping * lagging
            internal[:, links.lag_columns] = (stroke_rates[:, links.lagged] - lagging) / links.lag
        if len(links.slow):
            given = xi[:, links.slow_states]
            tension[:, links.slow] += given
            internal[:, links.slow_states] = links.bandwidth * (applied[:, links.slow_columns] - given)
        if len(links.direct):
            tension[:, links.direct] += applied[:, links.direct_columns]
        return strokes, stroke_rates, tension, internal

    def _measured(
        self,
        q: FloatArray,
        v: FloatArray,
        ground: tuple[FloatArray, FloatArray] | None,
        factor: FloatArray | None,
    ) -> FloatArray:
        """Generalised force (r, n) of the measured coefficients."""
        total = np.zeros_like(q)
        for i, (K, C) in enumerate(zip(self.measured_K, self.measured_C, strict=True)):
            share = 0.0 if factor is None else factor[self.frame.magnets + i]
            if ground is not None:
                total += ground[0] @ self.measured_push[i] + ground[1] @ self.measured_rate_push[i]
            total -= (1.0 + share) * (q @ K.T) + v @ C.T
        return total


def _rest(frame: Frame, opening: FloatArray, state: Equilibrium) -> FloatArray:
    """Heights, gaps and speeds (3, m) of the magnets at rest."""
    posture, m = state.posture, frame.magnets
    aside = frame.shift[1, :m] if frame.sway_rows is None else frame.sway_shift
    rest = np.empty((3, m))
    rest[0] = posture.height + opening[0] * frame.shift[2, :m]
    rest[1] = (np.nan if posture.gap is None else posture.gap) + opening[1] * (posture.offset + aside)
    rest[2] = posture.speed
    return rest


def _under(vehicle: Vehicle, names: Sequence[str], opening: FloatArray) -> FloatArray:
    """How much of guideway inputs `names` heights, then gaps, lose with the magnets' own motion the other way."""
    found = np.zeros((len(names), 2, len(vehicle.magnets)))
    for i, magnet in enumerate(vehicle.magnets):
        found[names.index(f"heave@{magnet.name}"), 0, i] = opening[0, i]
        if magnet.side:
            found[names.index(f"sway@{magnet.name}"), 1, i] = opening[1, i]
    return found.reshape(len(names), -1)


def _input_limits(
    vehicle: Vehicle, state: Equilibrium, system: SecondOrderSystem, commands: dict[str, float]
) -> tuple[FloatArray, FloatArray]:
    """Least and largest command of each input, increments from what it gives at rest."""
    low, high = np.full(len(system.inputs), -np.inf), np.full(len(system.inputs), np.inf)
    for actuator in vehicle.actuators:
        if actuator.force_limit is not None:
            i, bias = system.inputs.index(actuator.name), state.posture.static_forces.get(actuator.name, 0.0)
            low[i], high[i] = -actuator.force_limit - bias, actuator.force_limit - bias
    for name, limit in commands.items():
        if name not in system.inputs:
            raise ValueError(f"limits: {name!r} is not an input; the inputs are {', '.join(system.inputs) or 'none'}")
        i = system.inputs.index(name)
        low[i], high[i] = max(low[i], -limit), min(high[i], limit)
    return read_only_any(low), read_only_any(high)
