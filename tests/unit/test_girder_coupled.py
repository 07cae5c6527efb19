"""Vehicles on bending girders, against a span-by-span integration written here, limits, and the balance of energy."""

import itertools
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from maglev_ctrl.analysis.girder.beam import Girder, Loads, modal_response
from maglev_ctrl.analysis.girder.contacts import VehicleOnGuideway, element_places, vehicle_on_guideway
from maglev_ctrl.analysis.girder.coupled import coupled_passage, entry_passage, require_stable, static_midspan
from maglev_ctrl.analysis.girder.drive import periodic_solution
from maglev_ctrl.analysis.girder.moving import moving_system
from maglev_ctrl.analysis.girder.passage import by_collocation
from maglev_ctrl.analysis.girder.passing import driven_system, passing_response
from maglev_ctrl.analysis.girder.shapes import PieceShape, shifted_breaks
from maglev_ctrl.analysis.girder.track import FlexibleGuideway
from maglev_ctrl.analysis.simulation.run import simulate
from maglev_ctrl.errors import Agreement, NotStable
from maglev_ctrl.forces import ImageForce
from maglev_ctrl.forces.electromagnet import Electromagnet
from maglev_ctrl.systems import Controller
from maglev_ctrl.vehicle import (
    Actuator,
    Body,
    Magnet,
    OperatingPoint,
    Sensor,
    SpringDamper,
    Vehicle,
    equilibrium,
    models,
)
from maglev_ctrl.vehicle.guideway_sources import girder_bow

SPEED = 60.0
OUTPUTS = ("car.heave.acceleration", "front_magnet_1.gap", "car.heave")


@lru_cache(maxsize=1)
def train() -> VehicleOnGuideway:
    """Two levitated bogies with dampers to the guideway under a car, longer than a span of 12 m."""
    coil = ImageForce(1e5, 1.0, 2.5e7, 0.02, 1.0)
    vehicle = models.two_stage(
        Body("car", 15e3, inertia=(0.0, 2e5, 0.0), dofs=("heave", "pitch")),
        [Body("front", 2e3, position=(6.0, 0.0, 0.0)), Body("rear", 3e3, position=(-7.0, 0.0, 0.0))],
        magnets=models.MagnetRow(coil, 4, length=5.0), secondary=models.Secondary(2e5, 2e4), reference_height=0.1,
    )  # fmt: skip
    dampers = (
        SpringDamper("front_damper", "front", position=(6.0, 0.0, 0.0), damping=2e4),
        SpringDamper("rear_damper", "rear", position=(-7.0, 0.0, 0.0), damping=2e4),
    )
    vehicle = replace(vehicle, connections=(*vehicle.connections, *dampers))
    return vehicle_on_guideway(vehicle, OperatingPoint(SPEED, 0.1))


def bridge(*, modes: int = 2, stiffness: float = 1.2e9, damping: float = 0.02, mass: float = 1.5e3) -> Girder:
    return Girder(12.0, bending_stiffness=stiffness, mass_per_length=mass, damping_ratio=damping, modes=modes)


def by_spans(on: VehicleOnGuideway, girder: Girder, spans: int, *, sign: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """State of the vehicle (spans, n) at the end of each span and mid-span deflections then: all girders, all the time.

    `sign` -1: the girder feels the force with the wrong sign.
    """
    A, E = on.closed.state_matrix(), on.closed.guideway_matrix()
    n, N, L, count = len(A), girder.modes, girder.span, spans + 1
    front = max(np.max(on.places), np.max(on.input_places))
    order = np.pi * np.arange(1, N + 1) / L

    def rate(t: float, z: np.ndarray, middle: float) -> np.ndarray:
        x, G = z[:n], z[n:].reshape(count, 2, N)
        w, moving = np.zeros(len(on.input_places)), np.zeros(len(on.input_places))
        for i, place in enumerate(on.input_places):
            j = int(np.floor((SPEED * middle + place - front) / L))
            s = SPEED * t + place - front - j * L
            if 0 <= j < count:
                w[i] = -G[j, 0] @ np.sin(order * s)
                moving[i] = -G[j, 1] @ np.sin(order * s) - SPEED * G[j, 0] @ (order * np.cos(order * s))
        force = on.weight + sign * (on.by_state @ x + on.by_guideway @ w + on.by_rate @ moving)
        out = np.zeros_like(G)
        out[:, 0] = G[:, 1]
        out[:, 1] = -2.0 * girder.damping_ratio * girder.frequencies * G[:, 1] - girder.frequencies**2 * G[:, 0]
        for i, place in enumerate(on.places):
            j = int(np.floor((SPEED * middle + place - front) / L))
            s = SPEED * t + place - front - j * L
            if 0 <= j < count:
                out[j, 1] += girder.mobility * force[i] * np.sin(order * s)
        return np.concatenate([A @ x + E @ np.concatenate([w, moving]), out.ravel()])

    z, states, middles = np.zeros(n + 2 * N * count), [], []
    meets = np.unique(np.mod(front - np.concatenate([on.places, on.input_places]), L).round(9)) / SPEED
    for k in range(spans):
        edges = np.unique(np.concatenate([[0.0], meets, [L / SPEED]])) + k * L / SPEED
        for low, high in itertools.pairwise(edges):
            z = solve_ivp(
                rate, (low, high), z, args=(0.5 * (low + high),), method="DOP853", rtol=1e-9, atol=1e-12
            ).y[:, -1]  # fmt: skip
        states.append(z[:n])
        middles.append(girder.shape(0.5 * L) @ z[n:].reshape(count, 2, N)[k, 0])
    return np.array(states), np.array(middles)


def test_contact_forces_add_up_to_all_vertical_momentum() -> None:
    """Forces between bodies cancel: what presses on the guideway is what all bodies' heave takes up."""
    on = train()
    X, _, W = on.closed.acceleration_rows()
    heave = [i for i, name in enumerate(on.closed.dofs) if name.endswith(".heave")]
    bodies = sum(part.M for part in on.closed.contributions if part.kind == "body")
    taken = np.sum(bodies[heave] @ X, axis=0), np.sum(bodies[heave] @ W, axis=0)
    assert np.allclose(np.sum(on.by_state, axis=0), taken[0], rtol=0, atol=1e-9 * np.max(np.abs(taken[0])))
    both = np.concatenate([np.sum(on.by_guideway, axis=0), np.sum(on.by_rate, axis=0)])
    assert np.allclose(both, taken[1], rtol=0, atol=1e-9 * np.max(np.abs(taken[1])))
    assert np.max(np.abs(on.by_state + 0.0)) > 1.0
    assert np.sum(on.weight) == pytest.approx(20e3 * 9.80665)


@pytest.mark.parametrize("drive", ["current", "voltage"])
def test_contact_forces_of_controlled_magnets_and_actuators(drive: str) -> None:
    coil = Electromagnet.for_lift(5e3, 0.01, turns=300, pole_area=0.03, resistance=1.0)
    coil = replace(coil, drive=drive)
    vehicle = Vehicle(
        "car", (Body("car", 1e3, dofs=("heave",)),), magnets=(Magnet("lift", "car", force=coil, count=2),),
        actuators=(Actuator("push", "car"),),
        sensors=(Sensor("above", "gap", body="car"), Sensor("felt", "acceleration", body="car")),
        reference_height=0.01,
    )  # fmt: skip
    commands = (f"lift.{drive}", "push")
    law = Controller.from_matrices(
        [[-50.0]], [[1.0, 0.0, 0.0]], [[300.0], [4.0]], [[900.0, 50.0, 0.7], [-2e5, -3e3, 20.0]],
        measured=("above", "car.heave.velocity", "felt"), commands=commands,
    )  # fmt: skip
    on = vehicle_on_guideway(vehicle, OperatingPoint(0.0, 0.01), controller=law)
    X, _, W = on.closed.acceleration_rows()
    assert on.names == ("lift", "push")
    assert np.allclose(np.sum(on.by_state, axis=0), 1e3 * X[0], rtol=1e-10, atol=1e-6)
    both = np.concatenate([np.sum(on.by_guideway, axis=0), np.sum(on.by_rate, axis=0)])
    assert np.allclose(both, 1e3 * W[0], rtol=1e-10, atol=1e-6)
    # Without the law's own push the sums differ.
    bare = vehicle_on_guideway(vehicle, OperatingPoint(0.0, 0.01))
    assert not np.allclose(np.sum(bare.by_guideway, axis=0), both[: len(on.closed.guideway)], rtol=1e-3)


def test_entry_onto_girders_is_what_integration_of_every_girder_gives() -> None:
    on, girder = train(), bridge()
    states, middles = by_spans(on, girder, 4)
    wrong, _ = by_spans(on, girder, 4, sign=-1.0)
    found = entry_passage(on, girder, speed=SPEED, outputs=["car.heave", "front.heave"], spans=4)
    n, N = states.shape[1], girder.modes
    whole = moving_system(on, girder, speed=SPEED)
    assert whole.spans == 3
    z = np.zeros(whole.size)
    for k in range(4):
        passage = by_collocation(moving_system(on, girder, speed=SPEED, rigid=max(2 - k, 0)))
        end = (passage.end @ np.append(z, 1.0))[:-1]
        scale = np.max(np.abs(states), axis=0)
        assert np.max(np.abs(end[:n] - states[k]) / scale) < 1e-7
        assert np.max(np.abs(end[:n] - wrong[k]) / scale) > 1e-3
        assert girder.shape(6.0) @ end[n : n + N] == pytest.approx(middles[k], rel=1e-6)
        assert found.peaks[0, k] >= abs(states[k, 0]) * (1 - 1e-9)
        z = np.concatenate([end[:n], np.zeros(2 * N), end[n : n + 2 * N * 2]])
    assert np.all(found.deflection > np.abs(middles))


def test_the_steady_passage_is_where_entries_lead() -> None:
    on, girder = train(), bridge()
    found = coupled_passage(on, girder, speed=SPEED, outputs=OUTPUTS)
    assert found.stable and found.agreement is Agreement.AGREED and found.difference < 1e-8
    late = entry_passage(on, girder, speed=SPEED, outputs=OUTPUTS, spans=40)
    assert late.peaks[:, -1] == pytest.approx(found.peaks, rel=3e-3)
    assert np.max(np.abs(late.peaks[:, 0] / found.peaks - 1.0)) > 0.05
    assert np.allclose(found.values[:, 0], found.values[:, -1], rtol=0, atol=1e-9 * found.peaks[:, None].max())
    assert 1.0 < found.impact < 1.3
    assert found.deflection == pytest.approx(found.impact * static_midspan(on, girder))
    assert found.midspan[0] == 0.0 and found.life[-1] == pytest.approx((12.0 + 15.5) / SPEED, rel=0.02)


def test_constant_loads_give_the_moving_load_solution() -> None:
    on, girder = train(), bridge(modes=3)
    dead = replace(
        on, by_state=0.0 * on.by_state, by_guideway=0.0 * on.by_guideway, by_rate=0.0 * on.by_rate
    )  # fmt: skip
    found = coupled_passage(dead, girder, speed=SPEED, outputs=OUTPUTS, check=False)
    loads = Loads.at(on.weight, on.places - np.max(on.places))
    wanted, _ = modal_response(girder, loads, speed=SPEED, times=found.life)
    assert np.max(np.abs(found.midspan - wanted @ girder.shape(6.0))) < 1e-8 * found.deflection
    assert found.agreement is Agreement.UNRESOLVED and found.reason == "one integration only"


def test_a_stiff_girder_is_a_rigid_guideway() -> None:
    on = train()
    sag = PieceShape.from_source(girder_bow("girder", span=12.0, rise=-0.003))
    places = dict(zip([name.partition("@")[2] for name in on.closed.guideway], on.input_places.tolist(), strict=True))
    system = driven_system(on.closed, sag, speed=SPEED, places=places, outputs=OUTPUTS)
    rigid = periodic_solution(system, shifted_breaks(system.shapes, system.places, speed=SPEED))
    wanted = np.array(
        [one.peak for one in passing_response(on.closed, sag, speed=SPEED, places=places, outputs=OUTPUTS).peaks]
    )
    errors = []
    for stiffness in (1e13, 1e14):
        # A heavy girder keeps its frequency; ten times stiffer and heavier bends a tenth.
        stiff = bridge(modes=1, stiffness=stiffness, mass=1e-6 * stiffness, damping=0.3)
        found = coupled_passage(on, stiff, speed=SPEED, outputs=OUTPUTS, shape=sag, check=False)
        # Times count from the entry of the front there, from the vehicle's origin here.
        since = np.mod(found.times[:-1] - np.max(on.places) / SPEED, found.period)
        apart = np.abs(found.values[:, :-1] - rigid.outputs_at(since))
        errors.append(np.max(apart / wanted[:, None]))
        growth = np.max(np.linalg.eigvals(on.closed.state_matrix()).real)
        assert found.growth_rate == pytest.approx(growth, rel=1e12 / stiffness)
    assert errors[1] < 1e-3 and errors[0] / errors[1] == pytest.approx(10.0, rel=0.2)
    level = coupled_passage(on, bridge(modes=1, stiffness=1e16, mass=1e10), speed=SPEED, outputs=OUTPUTS, check=False)
    assert np.all(level.peaks < 1e-5 * wanted)


def test_a_light_girder_sags_statically_under_the_load_it_carries() -> None:
    """Creeping over a light girder the wheel stands in the sag of its own weight, P sin^2(pi s/L) 2/(m L w_1^2)."""
    leg = SpringDamper("leg", "car", stiffness=1e6, damping=2e5)
    cart = Vehicle("cart", bodies=(Body("car", 10e3),), connections=(leg,), reference_height=0.1)
    on = vehicle_on_guideway(cart, OperatingPoint(2.0, 0.1))
    light = Girder(20.0, bending_stiffness=4e9, mass_per_length=1e3, damping_ratio=0.3, modes=1)
    found = coupled_passage(on, light, speed=1.0, outputs=["car.heave"], check=False)
    sag = 9.80665e4 * light.mobility / light.frequencies[0] ** 2 * np.sin(np.pi * found.times / 20.0) ** 2
    assert np.max(np.abs(found.values[0] + sag)) < 2e-3 * np.max(sag)
    assert np.max(np.abs(found.values[0] - sag)) > np.max(sag)


def test_the_energy_of_a_girder_is_what_the_loads_have_put_in() -> None:
    on, girder = train(), bridge()
    system = moving_system(on, girder, speed=SPEED)
    passage = by_collocation(system)
    n, N = len(on.closed.states), girder.modes
    node, weight = np.polynomial.legendre.leggauss(12)
    del node
    z = np.zeros(system.size + 1)
    z[-1], z[0], z[4] = 1.0, 2e-3, -0.05
    start, work, lost = z.copy(), 0.0, 0.0
    modal = 1.0 / girder.mobility

    def energy(state: np.ndarray) -> float:
        parts = [
            state[n + 2 * N * j + N : n + 2 * N * (j + 1)] ** 2
            + (girder.frequencies * state[n + 2 * N * j : n + 2 * N * j + N]) ** 2
            for j in range(3)
        ]
        return float(0.5 * modal * np.sum(parts))

    for k, (begin, step, middle) in enumerate(zip(passage.starts, passage.steps, passage.middles, strict=True)):
        inside = 0.5 * (1.0 + np.polynomial.legendre.leggauss(12)[0])
        for i in range(12):
            now, t = passage.stages[k, i] @ z, begin + step * inside[i]
            W, w, R, r = system.surface(t, middle=middle)
            g, part = now[n:-1], 0.5 * weight[i] * step
            lift = on.weight + on.by_state @ now[:n] + on.by_guideway @ (W @ g + w) + on.by_rate @ (R @ g + r)
            index, s = system.placed(on.places, t, middle)
            for P, j, place in zip(lift, index, s, strict=True):
                work += part * P * (girder.shape(place) @ g[2 * N * j + N : 2 * N * (j + 1)])
            speeds = np.concatenate([g[2 * N * j + N : 2 * N * (j + 1)] for j in range(3)])
            lost += part * modal * np.sum(2.0 * 0.02 * np.tile(girder.frequencies, 3) * speeds**2)
        z = passage.maps[k] @ z
    assert energy(z) - energy(start) == pytest.approx(work - lost, rel=1e-7)
    assert abs(energy(z) - energy(start) - work) > 1e-4 * abs(work)


def test_an_unstable_loop_stays_unstable_and_shows_no_passage() -> None:
    leg = SpringDamper("leg", "car", stiffness=1e6, damping=-2e3)
    cart = Vehicle("cart", bodies=(Body("car", 10e3),), connections=(leg,), reference_height=0.1)
    found = coupled_passage(
        vehicle_on_guideway(cart, OperatingPoint(30.0, 0.1)), bridge(modes=1), speed=30.0, outputs=["car.heave"]
    )
    assert found.stable is False and np.isnan(found.peaks[0]) and "not stable" in found.reason
    with pytest.raises(NotStable, match="growth rate"):
        require_stable(found)


def test_what_does_not_fit_is_refused() -> None:
    on = train()
    with pytest.raises(ValueError, match="speed: expected"):
        coupled_passage(on, bridge(), speed=-1.0, outputs=OUTPUTS)
    with pytest.raises(ValueError, match="shape: expected a periodic shape of span 12 m"):
        coupled_passage(on, bridge(), speed=SPEED, outputs=OUTPUTS, shape=PieceShape.polyline([0.0, 5.0], [0.0, 0.0]))
    with pytest.raises(ValueError, match="spans: expected"):
        entry_passage(on, bridge(), speed=SPEED, outputs=OUTPUTS, spans=0)
    leg = SpringDamper("leg", "car", stiffness=1e6)
    cart = Vehicle("cart", bodies=(Body("car", 10e3),), connections=(leg,), reference_height=0.1)
    with pytest.raises(ValueError, match="'wheel' presses on no guideway"):
        vehicle_on_guideway(cart, OperatingPoint(30.0, 0.1), loads={"wheel": 1.0})
    assert vehicle_on_guideway(cart, OperatingPoint(30.0, 0.1), loads={"leg": 5.0}).weight.tolist() == [5.0]
    assert element_places(cart) == {"leg": 0.0}


def test_the_nonlinear_simulation_on_a_bending_guideway_comes_to_the_same_passage() -> None:
    """A stiff bridge keeps the motion small, so the linear passage is that of the simulation."""
    coil = ImageForce(1e5, 1.0, 2.5e7, 0.02, 1.0)
    legs = tuple(SpringDamper(f"leg{i}", "car", position=(x, 0.0, 0.0), damping=1e5) for i, x in enumerate((3.0, -3.0)))
    vehicle = models.heave_pitch_surge(20e3, pitch_inertia=1e5, spacing=6.0, force=coil, reference_height=0.1)
    body = Body("car", 20e3, inertia=(0.0, 1e5, 0.0), dofs=("heave", "pitch"))
    vehicle = replace(vehicle, bodies=(body,), connections=legs)
    state = equilibrium(vehicle, OperatingPoint(SPEED, 0.1))
    on = vehicle_on_guideway(vehicle, state)
    # The simulation tells the track what magnets load it with, and nothing of links.
    lifting = np.array([name.startswith("magnet") for name in on.names])[:, None]
    on = replace(on, by_state=on.by_state * lifting, by_guideway=on.by_guideway * lifting, by_rate=on.by_rate * lifting)
    stiff = Girder(12.0, bending_stiffness=3e10, mass_per_length=3e4, damping_ratio=0.02, modes=2)
    wanted = coupled_passage(on, stiff, speed=SPEED, outputs=["car.heave"], check=False).values[0]
    track = FlexibleGuideway(stiff, speed=SPEED, support=3.0)
    run = simulate(vehicle, state, duration=1.6, track=track, sampling=0.002, signals=("car.heave",), step=2e-3)
    found = run.of("car.heave").ravel()[-101:]
    assert np.min(found) == pytest.approx(np.min(wanted), rel=5e-3)
    assert np.max(found) == pytest.approx(np.max(wanted), rel=5e-3)
