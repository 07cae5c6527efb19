"""The equations of motion of a vehicle with its full force map, batched over runs.

    M q'' = Q(q, q', xi, u, w, w', t),    xi' = ...

M is that of the equilibrium; gyroscopic terms, second order in the rotations, are left out. Forces, strokes and
levers follow the finite rotation of the bodies (`frame`).
"""

from __future__ import annotations

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

    `places` (r, 3, m) heights, gaps, speeds; `closing` (r, 2, m) m/s rates of heights and gaps; `lift` (r, m) N;
    `strokes`, `stroke_rates` (r, l); `applied` (r, n_u) commands after saturation.
    """

    acceleration: FloatArray
    internal: FloatArray
    places: FloatArray
    closing: FloatArray
    lift: FloatArray
    strokes: FloatArray
    stroke_rates: FloatArray
    applied: FloatArray


@dataclass(frozen=True, eq=False, slots=True)
class LinkSet:
    """Springs, dampers and actuators as arrays over l links; columns of states and inputs are -1 where there are none.

    `felt` (nw, l): the guideway's part of the strokes.
    """

    stiffness: FloatArray
    damping: FloatArray
    tension: FloatArray
    felt: FloatArray
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
            felt=read_only_any(felt),
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

    `low`, `high` (n_u,): what each input can give, beside what it carries at rest.
    """

    system: SecondOrderSystem
    frame: Frame
    magnets: MagnetSet
    links: LinkSet
    posture_height: float
    posture_gap: float
    offset: float
    constant: FloatArray
    push: FloatArray
    drag_factor: FloatArray
    low: FloatArray
    high: FloatArray
    heave_columns: NDArray[np.int64]
    sway_columns: NDArray[np.int64]
    measured_K: FloatArray
    measured_C: FloatArray
    measured_push: FloatArray
    measured_rate_push: FloatArray
    stations: FloatArray
    mass: FloatArray
    compliance: FloatArray
    """M^-1, (n, n)."""

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
        return cls(
            system=system,
            frame=frame,
            magnets=MagnetSet.of(vehicle, state, system),
            links=LinkSet.of(vehicle, state, system),
            posture_height=posture.height,
            posture_gap=np.nan if posture.gap is None else posture.gap,
            offset=posture.offset,
            constant=read_only_any(posture.loads + weight - state.unbalanced - still),
            push=read_only_any(thrust),
            drag_factor=known.drag_factor,
            low=low,
            high=high,
            heave_columns=_indices([w_names.index(f"heave@{magnet.name}") for magnet in vehicle.magnets]),
            sway_columns=_indices(
                [w_names.index(f"sway@{magnet.name}") if magnet.side else -1 for magnet in vehicle.magnets]
            ),
            measured_K=read_only_any(K_e),
            measured_C=read_only_any(C_e),
            measured_push=read_only_any(K_w),
            measured_rate_push=read_only_any(C_w),
            stations=read_only_any(np.array(stations, dtype=np.float64)),
            mass=system.M,
            compliance=read_only_any(np.linalg.inv(system.M)),
        )

    def saturated(self, command: FloatArray) -> FloatArray:
        """What the inputs give of commands (r, n_u)."""
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
        ground: tuple[FloatArray, FloatArray],
        factor: FloatArray | None = None,
    ) -> Rates:
        """Accelerations and rates of the internal states.

        Parameters
        ----------
        state : q, q', xi: (r, n), (r, n), (r, n_xi) increments from the equilibrium
        applied : (r, n_u) commands after saturation and delay
        ground : w, w': (r or 1, nw) the guideway under the elements, and its rate
        factor : (elements,) of `factors`
        """
        (q, v, xi), (w, w_rate) = state, ground
        frame, links, m = self.frame, self.links, self.frame.magnets
        lever = frame.levers(q)
        moved, velocity = frame.shifts(q, lever), frame.velocities(v, lever)
        places, rates = self._places(q, v, w, w_rate, moved, velocity)
        force = np.zeros((len(q), 3, moved.shape[-1]))
        own, far = m + frame.pushes, m + frame.pushes + frame.links
        Q = self.constant
        if m:
            force[:, :, :m], follow = self.magnets.forces(places, rates, xi, applied)
            if factor is not None:
                force[:, :, :m] += factor[:m] * (self.magnets.static(places) - self._rest())
            if frame.sway_rows is None:
                force[:, 1, :m] += follow
            else:
                Q = Q + follow @ frame.sway_rows.T
        lift = force[:, 2, :m]
        ahead = self.magnets.speed + velocity[:, 0, m:own]
        force[:, 0, m:own] = self.push - self.drag_factor * ahead * np.abs(ahead)
        strokes, stroke_rates = frame.along(moved - frame.shift), frame.along(velocity)
        if frame.twists:
            strokes = strokes + q @ frame.angular_rows
            stroke_rates = stroke_rates + v @ frame.angular_rows
        strokes, stroke_rates = strokes - w @ links.felt, stroke_rates - w_rate @ links.felt
        tension = links.tension - links.stiffness * strokes - links.damping * stroke_rates
        internal = np.zeros_like(xi)
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
        if frame.links:
            force[:, :, own:far] = tension[:, None, :] * frame.direction
            force[:, :, far:] = -(tension * frame.apart)[:, None, :] * frame.direction
            if frame.twists:
                Q = Q + tension @ frame.angular_rows.T
        Q = Q + frame.gathered(force, lever)
        if len(self.measured_K):
            Q = Q + self._measured(q, v, w, w_rate, factor)
        self.magnets.circuits(places, rates, xi, applied, internal)
        return Rates(
            acceleration=Q @ self.compliance.T,
            internal=internal,
            places=places,
            closing=np.stack([self.magnets.upward * rates[:, 1], -self.magnets.side * rates[:, 0]], axis=1),
            lift=lift,
            strokes=strokes,
            stroke_rates=stroke_rates,
            applied=applied,
        )

    def _places(
        self, q: FloatArray, v: FloatArray, w: FloatArray, w_rate: FloatArray, moved: FloatArray, velocity: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Heights, gaps, speeds (r, 3, m); velocities over the guideway as in `MagnetSet`."""
        frame, magnets, m = self.frame, self.magnets, self.frame.magnets
        walled = self.sway_columns >= 0
        aside, left = moved[:, 1, :m], velocity[:, 1, :m]
        if frame.sway_rows is not None:
            aside, left = frame.sway_shift + q @ frame.sway_rows, v @ frame.sway_rows
        places, rates = np.empty((len(q), 3, m)), np.empty((len(q), 3, m))
        places[:, 0] = self.posture_height + magnets.upward * (moved[:, 2, :m] - w[:, self.heave_columns])
        beside = np.where(walled, w[:, self.sway_columns], 0.0) if len(w[0]) else 0.0
        places[:, 1] = self.posture_gap - magnets.side * (self.offset + aside - beside)
        places[:, 2] = magnets.speed + velocity[:, 0, :m]
        beside_rate = np.where(walled, w_rate[:, self.sway_columns], 0.0) if len(w[0]) else 0.0
        rates[:, 0] = left - beside_rate
        rates[:, 1] = velocity[:, 2, :m] - w_rate[:, self.heave_columns]
        rates[:, 2] = left
        return places, rates

    def _rest(self) -> FloatArray:
        """Forces that `MagnetSet.static` gives at the equilibrium, (1, 3, m)."""
        frame, m = self.frame, self.frame.magnets
        aside = frame.shift[1, :m] if frame.sway_rows is None else frame.sway_shift
        places = np.empty((1, 3, m))
        places[0, 0] = self.posture_height + self.magnets.upward * frame.shift[2, :m]
        places[0, 1] = self.posture_gap - self.magnets.side * (self.offset + aside)
        places[0, 2] = self.magnets.speed
        return self.magnets.static(places)

    def _measured(
        self, q: FloatArray, v: FloatArray, w: FloatArray, w_rate: FloatArray, factor: FloatArray | None
    ) -> FloatArray:
        """Generalised force (r, n) of the measured coefficients."""
        total = np.zeros_like(q)
        for i, (K, C) in enumerate(zip(self.measured_K, self.measured_C, strict=True)):
            share = 0.0 if factor is None else factor[self.frame.magnets + i]
            total += w @ self.measured_push[i] + w_rate @ self.measured_rate_push[i]
            total -= (1.0 + share) * (q @ K.T) + v @ C.T
        return total


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
