"""The nonlinear equations of motion against the linear model, the vehicle's own forces, and energy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from simulation_vehicles import COIL, full_vehicle

from maglev_ctrl.analysis.simulation.frame import Frame
from maglev_ctrl.analysis.simulation.motion import Equations
from maglev_ctrl.forces import Electromagnet
from maglev_ctrl.guideway import Modulation
from maglev_ctrl.vehicle import Body, Magnet, OperatingPoint, Vehicle, equilibrium, linearize, models
from maglev_ctrl.vehicle.assembly import stiffness_modulation
from maglev_ctrl.vehicle.loads import generalized_force

LINEAR_AGREEMENT = 1e-6
"""Of central differences with steps of 1e-6, relative to the largest entry of a row."""


def _hanging(drive: str) -> tuple:
    coil = Electromagnet.for_lift(5e3, 0.01, turns=300, pole_area=0.03, resistance=1.0, drive=drive)
    car = Body("car", 2e3, inertia=(0.0, 900.0, 0.0), dofs=("heave", "pitch"))
    magnets = tuple(Magnet(f"m{i}", "car", force=coil, position=(x, 0.0, 0.0), count=2) for i, x in enumerate((-1, 1)))
    vehicle = Vehicle("hanging", (car,), magnets=magnets, reference_height=0.01)
    return vehicle, equilibrium(vehicle, OperatingPoint(0.0, 0.01))


def _receding() -> tuple:
    car = models.heave_pitch_surge(20e3, pitch_inertia=1e5, spacing=6.0, force=COIL, reference_height=0.1)
    return car, equilibrium(car, OperatingPoint(40.0, 0.1))


CASES = {
    "full": full_vehicle,
    "levers held": lambda: full_vehicle(geometric=False),
    "paper": lambda: full_vehicle(geometric=False, kinematics="paper"),
    "receding image": _receding,
    "voltage": lambda: _hanging("voltage"),
    "current": lambda: _hanging("current"),
}


def _partials(vehicle, state) -> tuple[np.ndarray, np.ndarray]:
    """Central differences of forces and internal rates by q, q', xi, u, w, w', and the linear model's matrices."""
    system = linearize(vehicle, state, pade_order=0)
    equations = Equations.of(vehicle, state, system)
    n = len(system.dofs)
    sizes = [n, n, len(system.internal), len(system.inputs), len(system.guideway), len(system.guideway)]
    step, total = 1e-6, sum(sizes)

    def answer(x: np.ndarray) -> np.ndarray:
        q, v, xi, u, w, rate = np.split(x, np.cumsum(sizes)[:-1], axis=1)
        found = equations.rates((q, v, xi), u, ground=(w, rate))
        return np.hstack([found.acceleration @ system.M.T, found.internal])

    values = answer(step * np.vstack([np.eye(total), -np.eye(total)]))
    linear = np.block(
        [
            [-system.K, -system.C, system.F, system.B, system.K_w, system.C_w],
            [system.G_q, system.G_v, system.A_internal, system.B_internal, system.G_w, system.G_wv],
        ]
    )
    return (values[:total] - values[total:]).T / (2.0 * step), linear


@pytest.mark.parametrize("name", CASES)
def test_the_linear_model_is_the_derivative(name: str) -> None:
    found, linear = _partials(*CASES[name]())
    scale = np.max(np.abs(linear), axis=1, keepdims=True)
    assert np.max(np.abs(found - linear) / scale) < LINEAR_AGREEMENT
    # Mutant: any entry of a tenth of its row's largest, flipped, is seen.
    large = np.argwhere(np.abs(linear) > 0.1 * scale)
    row, column = large[len(large) // 2]
    assert abs(found[row, column] + linear[row, column]) / scale[row, 0] > 1e3 * LINEAR_AGREEMENT


@pytest.mark.parametrize("name", ["full", "receding image"])
def test_equals_the_generalised_force_of_one_posture(name: str) -> None:
    vehicle, state = CASES[name]()
    if name == "full":
        # `generalized_force` leaves internal states and commands out, as they are zero here; so does the lag's damper.
        vehicle = replace(vehicle, kinematics="consistent")
    system = linearize(vehicle, state, pade_order=0)
    equations = Equations.of(vehicle, state, system)
    random = np.random.default_rng(3)
    n, runs = len(system.dofs), 5
    q, v = 3e-3 * random.standard_normal((runs, n)), 0.05 * random.standard_normal((runs, n))
    still = [np.zeros((runs, len(names))) for names in (system.internal, system.inputs)]
    ground = np.zeros((1, len(system.guideway)))
    found = equations.rates((q, v, still[0]), still[1], ground=(ground, ground)).acceleration @ system.M.T
    expected = np.array([generalized_force(vehicle, state, one, rate) for one, rate in zip(q, v, strict=True)])
    scale = np.max(np.abs(expected))
    assert np.max(np.abs(found - expected)) < 1e-12 * scale
    # Mutant: levers that do not turn are seen.
    if name == "full":
        held = replace(equations, frame=Frame.of(replace(vehicle, geometric_stiffness=False), state.displacement))
        other = held.rates((q, v, still[0]), still[1], ground=(ground, ground)).acceleration @ system.M.T
        assert np.max(np.abs(other - expected)) > 1e-6 * scale


def test_a_rigid_shift_of_vehicle_and_guideway_changes_nothing() -> None:
    vehicle, state = full_vehicle()
    system = linearize(vehicle, state, pade_order=0)
    equations = Equations.of(vehicle, state, system)
    q, v = np.zeros((1, 9)), np.zeros((1, 9))
    q[0, [1, 2, 6]] = [0.004, -0.003, -0.003]  # the bogie has no sway: the wall under its magnet stays
    w = np.array([[-0.003 if name.startswith("heave") else 0.004 for name in system.guideway]])
    bogie = [system.guideway.index(name) for name in ("sway@m3", "sway@side")]
    w[0, bogie] = 0.0
    internal, inputs = np.zeros((1, len(system.internal))), np.zeros((1, len(system.inputs)))
    found = equations.rates((q, v, internal), inputs, ground=(w, 0.0 * w)).acceleration
    assert np.max(np.abs(found)) < 1e-9
    # Mutant: a guideway of the wrong sign drives the vehicle.
    assert np.max(np.abs(equations.rates((q, v, internal), inputs, ground=(-w, 0.0 * w)).acceleration)) > 0.1


def test_modulation_linearises_to_the_stiffness_modulation() -> None:
    vehicle, state = _receding()
    system = linearize(vehicle, state, pade_order=0)
    equations = Equations.of(vehicle, state, system)
    wave = Modulation(wavelength=7.0, depth=0.2, harmonics=(1.0, 0.4))
    K_cos, K_sin = stiffness_modulation(vehicle, state, wavelength=7.0, harmonics=wave.harmonics)
    W = float(wave.frequency(40.0))
    n, step = len(system.dofs), 1e-6
    shifts = step * np.vstack([np.eye(n), -np.eye(n)])
    still = np.zeros((2 * n, n))
    empty = np.zeros((2 * n, 0))
    ground = np.zeros((1, len(system.guideway)))
    for time in (0.0, 0.013, 0.09):
        factor = equations.factors(wave, np.array([time]))[0]
        forces = (
            equations.rates((shifts, still, empty), empty, ground=(ground, ground), factor=factor).acceleration
            @ system.M.T
        )
        K = -(forces[:n] - forces[n:]).T / (2.0 * step)
        k = np.arange(1, 3)[:, None, None]
        expected = system.K + 0.2 * np.sum(K_cos * np.cos(k * W * time) + K_sin * np.sin(k * W * time), axis=0)
        scale = np.max(np.abs(system.K))
        assert np.max(np.abs(K - expected)) < 1e-6 * scale
        mirrored = system.K + 0.2 * np.sum(K_cos * np.cos(k * W * time) - K_sin * np.sin(k * W * time), axis=0)
        assert time == 0.0 or np.max(np.abs(K - mirrored)) > 1e-3 * scale
        # A vehicle at rest in its equilibrium feels nothing of it, at any depth.
        at_rest = equations.rates((still[:1], still[:1], empty[:1]), empty[:1], ground=(ground, ground), factor=factor)
        assert np.max(np.abs(at_rest.acceleration)) < 1e-12
