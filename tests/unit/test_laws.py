"""Laws from engineering terms on a quarter car with magnet, secondary spring and lagged actuator."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from maglev_ctrl.errors import Agreement, ModelError, Status
from maglev_ctrl.synthesis.gaussian import GuidewayNoise, SensorNoise, noise_model
from maglev_ctrl.synthesis.laws import design_lqg, design_lqr
from maglev_ctrl.synthesis.neutral import hidden_modes
from maglev_ctrl.synthesis.skyhook import SkyHook, sky_hook
from maglev_ctrl.synthesis.weights import InputWeight, OutputWeight, quadratic_weights
from maglev_ctrl.systems import SecondOrderSystem, close_loop

OUTPUTS = [
    OutputWeight("car.heave.acceleration", 0.3),
    OutputWeight("secondary.stroke", 0.03),
    OutputWeight("magnet.gap", 0.01),
]
INPUTS = [InputWeight("secondary", 2000.0)]
SENSORS = [SensorNoise("car.heave.acceleration", 1e-3), SensorNoise("magnet.gap", 1e-5)]


def _quarter_car(*, direct: bool = False, damping: float = -150.0) -> SecondOrderSystem:
    """Bogie on a magnet with negative damping, car on a soft spring; the actuator lags or acts directly."""
    actuator = (
        {"B": [[-1.0], [1.0]]}
        if direct
        else {
            "internal": ("secondary.force",), "A_internal": [[-60.0]], "F": [[-1.0], [1.0]], "B_internal": [[60.0]],
        }
    )  # fmt: skip
    return SecondOrderSystem.from_matrices(
        [[1000.0, 0.0], [0.0, 4000.0]], [[damping, 0.0], [0.0, 0.0]], [[2.4e5, -4e4], [-4e4, 4e4]],
        dofs=("bogie.heave", "car.heave"), inputs=("secondary",), guideway=("heave@magnet",), K_w=[[2e5], [0.0]],
        outputs=("car.heave.acceleration", "secondary.stroke", "magnet.gap"),
        H_q=[[0.0, 0.0], [-1.0, 1.0], [1.0, 0.0]], H_a=[[0.0, 1.0], [0.0, 0.0], [0.0, 0.0]],
        H_w=[[0.0], [0.0], [-1.0]], **actuator,
    )  # fmt: skip


@pytest.mark.parametrize("direct", [False, True])
def test_weights_are_the_scaled_squares_of_the_outputs(direct):
    plant = _quarter_car(direct=direct)
    cost = quadratic_weights(plant, OUTPUTS, INPUTS)
    rng = np.random.default_rng(1)
    x, u = rng.standard_normal(len(plant.states)), rng.standard_normal(1)
    C, D, _ = plant.output_rows(tuple(w.output for w in OUTPUTS))
    z = C @ x + D @ u
    expected = np.sum((z / [0.3, 0.03, 0.01]) ** 2) + (u[0] / 2000.0) ** 2
    assert x @ cost.Q @ x + u @ cost.R @ u + 2 * x @ cost.N @ u == pytest.approx(expected, rel=1e-12)
    assert np.any(cost.N) == direct  # the acceleration feels a direct force at once, a lagged one through its state
    if direct:  # the mutant without the cross weight is a different cost
        assert x @ cost.Q @ x + u @ cost.R @ u != pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("direct", [False, True])
def test_lqr_stabilises_and_reports_itself(direct):
    plant = _quarter_car(direct=direct)
    assert np.max(np.linalg.eigvals(plant.state_matrix()).real) > 0.0
    design = design_lqr(plant, OUTPUTS, INPUTS, name="ride")
    assert design.require() is design
    assert design.status is Status.SOLVED
    assert design.controller.measured == plant.states
    assert design.controller.name == "ride"
    assert design.riccati[0].residual < 1e-13
    closed = close_loop(plant, design.controller)
    assert np.max(np.linalg.eigvals(closed.state_matrix()).real) < 0.0
    np.testing.assert_allclose(
        np.sort_complex(design.riccati[0].closed_loop_poles),
        np.sort_complex(design.certificate.closed_loop_eigenvalues), rtol=1e-8,
    )  # fmt: skip


def test_lqr_cost_falls_when_its_allowance_grows():
    plant = _quarter_car()
    tight = design_lqr(plant, OUTPUTS, INPUTS)
    loose = design_lqr(plant, OUTPUTS, [InputWeight("secondary", 20000.0)])
    assert np.linalg.norm(loose.controller.D) > np.linalg.norm(tight.controller.D)


@pytest.mark.parametrize(
    ("outputs", "inputs", "words"),
    [
        ([OutputWeight("car.heave.accelration", 1.0)], INPUTS, "did you mean 'car.heave.acceleration'"),
        (OUTPUTS, [InputWeight("secondry", 1.0)], "did you mean 'secondary'"),
        ([], INPUTS, "at least one"),
        ([OUTPUTS[0], OUTPUTS[0]], INPUTS, "given twice"),
    ],
)
def test_wrong_weights_are_named(outputs, inputs, words):
    with pytest.raises(ValueError, match=words):
        design_lqr(_quarter_car(), outputs, inputs)


@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf])
def test_allowed_values_are_positive(value):
    with pytest.raises(ValueError, match="positive finite"):
        OutputWeight("x", value)
    with pytest.raises(ValueError, match="positive finite"):
        InputWeight("x", value)


def _with_sway(*, damping: float = 0.0, stiffness: float = 0.0, reach: float = 0.0) -> SecondOrderSystem:
    """Heave on a spring and a sway of its own that the actuator reaches only through `reach`."""
    return SecondOrderSystem.from_matrices(
        [[2.0, 0.0], [0.0, 1.0]], [[0.1, 0.0], [0.0, damping]], [[8.0, 0.0], [0.0, stiffness]],
        dofs=("car.heave", "car.sway"), inputs=("lift",), B=[[1.0], [reach]],
        ignorable=() if stiffness else ("car.sway",),
    )  # fmt: skip


def test_an_unseen_neutral_mode_is_regularised_and_told():
    design = design_lqr(
        _with_sway(reach=0.5), [OutputWeight("car.heave", 0.1)], [InputWeight("lift", 1.0)], neutral_rate=0.02
    )
    assert "car.sway.velocity" in design.notes[0]
    assert design.certificate.stable
    # The neutral mode decays at the promised rate: coupling to the weighted mode moves it only a little.
    assert design.certificate.spectral_abscissa == pytest.approx(-0.02, rel=0.02)


def test_an_unseen_undamped_oscillation_is_regularised():
    plant = _with_sway(stiffness=9.0, reach=0.5)
    design = design_lqr(plant, [OutputWeight("car.heave", 0.1)], [InputWeight("lift", 1.0)], neutral_rate=0.02)
    assert design.certificate.spectral_abscissa == pytest.approx(-0.02, rel=0.05)
    assert "+-" in design.notes[0]


def test_a_growing_mode_that_no_weight_sees_is_mirrored_and_told():
    plant = _with_sway(damping=-0.4, reach=0.5)
    design = design_lqr(plant, [OutputWeight("car.heave", 0.1)], [InputWeight("lift", 1.0)])
    assert "grows" in design.notes[0]
    assert np.min(np.abs(design.certificate.closed_loop_eigenvalues + 0.4)) < 1e-9


def test_a_slowly_decaying_mode_without_actuator_is_no_obstacle():
    plant = _with_sway(damping=1e-4)
    design = design_lqr(plant, [OutputWeight("car.heave", 0.1)], [InputWeight("lift", 1.0)])
    assert design.require().notes == ()
    assert design.certificate.spectral_abscissa == pytest.approx(-1e-4)


def test_a_mode_without_actuator_is_refused_or_left_in_the_open():
    plant = _with_sway()
    with pytest.raises(ModelError, match=r"cannot move .*car\.sway\.velocity"):
        design_lqr(plant, [OutputWeight("car.heave", 0.1)], [InputWeight("lift", 1.0)])
    left = design_lqr(plant, [OutputWeight("car.heave", 0.1)], [InputWeight("lift", 1.0)], uncontrollable="leave")
    assert "stays as it is" in left.notes[0]
    assert not left.certificate.stable
    heave = SecondOrderSystem.from_matrices([[2.0]], [[0.1]], [[8.0]], dofs=("car.heave",), inputs=("lift",), B=[[1.0]])
    alone = design_lqr(heave, [OutputWeight("car.heave", 0.1)], [InputWeight("lift", 1.0)])
    np.testing.assert_allclose(
        left.controller.D[0, [0, 1]], alone.controller.D[0], rtol=1e-9
    )  # the other mode is controlled as if the left one were not there


def test_a_free_drift_without_weight_is_refused():
    plant = SecondOrderSystem.from_matrices(
        np.diag([2.0, 1.0]), np.diag([0.1, 0.0]), np.diag([8.0, 0.0]), dofs=("car.heave", "car.sway"),
        inputs=("lift",), B=[[1.0], [0.5]],
    )  # fmt: skip
    with pytest.raises(ModelError, match="drifts freely"):
        design_lqr(plant, [OutputWeight("car.heave", 0.1)], [InputWeight("lift", 1.0)])


def test_hidden_modes_see_through_bad_scaling():
    A = np.array([[0.0, 1.0, 0.0], [0.0, -1.0, 1e9], [0.0, 0.0, -1.0]])
    assert hidden_modes(A, np.array([[1e-9, 0.0, 0.0]]), ("a", "b", "c")) == ()
    assert len(hidden_modes(A, np.array([[0.0, 1.0, 1e-9]]), ("a", "b", "c"))) == 1


@pytest.mark.parametrize("direct", [False, True])
@pytest.mark.parametrize("guideway", [None, GuidewayNoise(1e-3)])
def test_lqg_poles_are_regulator_and_observer(direct, guideway):
    plant = _quarter_car(direct=direct)
    design = design_lqg(plant, OUTPUTS, INPUTS, sensors=SENSORS, disturbance=0.1, guideway=guideway)
    assert design.require() is design
    assert design.controller.measured == ("car.heave.acceleration", "magnet.gap")
    regulator, observer = (s.closed_loop_poles for s in design.riccati)
    # The guideway state is uncontrollable: its own pole, -corner, stands among the regulator's but not in the loop.
    kept = [p for p in regulator if guideway is None or abs(p + guideway.corner) > 1e-6]
    expected = np.concatenate([kept, observer])
    found = design.certificate.closed_loop_eigenvalues
    assert len(found) == len(expected)
    assert max(np.min(np.abs(found - p)) for p in expected) < 1e-6 * np.max(np.abs(expected))


def test_lqg_is_the_best_of_its_kind():
    """Stationary cost of the closed loop, by simulation-free algebra, grows for any change of the compensator."""
    plant = _quarter_car()
    design = design_lqg(plant, OUTPUTS, INPUTS, sensors=SENSORS, disturbance=0.1)
    best = _stationary_cost(plant, design.controller, 0.1)
    rng = np.random.default_rng(4)
    for _ in range(5):
        for key in "BC":
            changed = np.array(getattr(design.controller, key))
            changed *= 1.0 + 0.02 * rng.standard_normal(changed.shape)
            assert _stationary_cost(plant, replace(design.controller, **{key: changed}), 0.1) > best
    # The mutant that ignores the correlation of accelerometer and process noise is worse.
    assert _stationary_cost(plant, _without_cross_covariance(plant), 0.1) > 1.0001 * best


def _without_cross_covariance(plant):
    from maglev_ctrl.synthesis.lq import lqg
    from maglev_ctrl.systems import Controller

    weights = quadratic_weights(plant, OUTPUTS, INPUTS)
    m = noise_model(plant, weights, SENSORS, disturbance=0.1, guideway=None)
    made = lqg(
        m.A, m.B, m.C, m.D, weights=(weights.Q, weights.R, weights.N), noise=(m.process, m.measurement, 0.0 * m.cross)
    )
    return Controller.from_matrices(
        made.A, made.B, made.C, np.zeros((1, 2)), measured=m.measured, commands=("secondary",)
    )


def _stationary_cost(plant, controller, disturbance):
    """E of the quadratic cost from the joint covariance of plant and compensator (Kronecker algebra)."""
    weights = quadratic_weights(plant, OUTPUTS, INPUTS)
    A, B = plant.state_matrix(), plant.input_matrix()
    C, D, _ = plant.output_rows(controller.measured)
    n, k = A.shape[0], controller.A.shape[0]
    closed = np.block([[A, B @ controller.C], [controller.B @ C, controller.A + controller.B @ D @ controller.C]])
    shaken = np.zeros((n, 2))
    shaken[2:4] = np.eye(2)  # accelerations enter the velocity rows
    felt = plant.H_a[[plant.outputs.index(x) for x in controller.measured]]
    noise = np.diag([s.density for s in SENSORS])
    drive = np.block(
        [[disturbance * shaken, np.zeros((n, 2))], [disturbance * controller.B @ felt, controller.B @ noise]]
    )
    one = np.eye(n + k)
    flat = np.linalg.solve(np.kron(closed, one) + np.kron(one, closed), -(0.5 * drive @ drive.T).ravel())
    covariance = flat.reshape(n + k, n + k)
    if np.max(np.linalg.eigvals(closed).real) >= 0.0:
        return np.inf
    spread = np.block([[np.eye(n), np.zeros((n, k))], [np.zeros((1, n)), controller.C]])
    joint = spread @ covariance @ spread.T
    cost = np.block([[weights.Q, weights.N], [weights.N.T, weights.R]])
    return float(np.trace(cost @ joint))


def test_lqg_refuses_blind_sensors_and_bad_densities():
    plant = SecondOrderSystem.from_matrices(
        [[1.0]], [[0.0]], [[0.0]], dofs=("car.heave",), inputs=("force",), B=[[1.0]], outputs=("a",), H_a=[[1.0]]
    )
    outputs, inputs = [OutputWeight("car.heave", 1.0)], [InputWeight("force", 1.0)]
    with pytest.raises(ModelError, match=r"do not see .*car\.heave"):
        design_lqg(plant, outputs, inputs, sensors=[SensorNoise("a", 1e-3)], disturbance=1.0)
    with pytest.raises(ValueError, match="sensor: 'aa' is unknown"):
        design_lqg(plant, outputs, inputs, sensors=[SensorNoise("aa", 1e-3)], disturbance=1.0)
    with pytest.raises(ValueError, match="density of 'a'"):
        design_lqg(plant, outputs, inputs, sensors=[SensorNoise("a", 0.0)], disturbance=1.0)
    with pytest.raises(ValueError, match="disturbance"):
        design_lqg(plant, outputs, inputs, sensors=[SensorNoise("car.heave", 1.0)], disturbance=0.0)


def test_skyhook_velocity_difference_is_a_damper_between_the_masses():
    plant = _quarter_car(direct=True)
    hook = SkyHook("secondary", "car.heave.velocity", 5000.0, minus="bogie.heave.velocity")
    design = sky_hook(plant, [hook])
    damped = close_loop(plant, design.controller)
    np.testing.assert_allclose(damped.C - plant.C, 5000.0 * np.array([[1.0, -1.0], [-1.0, 1.0]]))
    assert design.certificate.agreed is Agreement.AGREED
    flipped = sky_hook(plant, [SkyHook("secondary", "bogie.heave.velocity", 5000.0, minus="car.heave.velocity")])
    assert flipped.certificate.spectral_abscissa > 0.0


def test_skyhook_from_accelerometers_approaches_the_ideal_one():
    plant = SecondOrderSystem.from_matrices(
        [[1.0]], [[0.0]], [[40.0]], dofs=("car.heave",), inputs=("force",), B=[[1.0]], outputs=("a",), H_a=[[1.0]]
    )
    ideal = sky_hook(plant, [SkyHook("force", "car.heave.velocity", 3.0)])
    integrated = sky_hook(plant, [SkyHook("force", "a", 3.0)], corner=0.01)
    assert integrated.certificate.stable
    assert "integrated" in integrated.notes[0]
    fast = integrated.certificate.closed_loop_eigenvalues
    ideal_pole = ideal.certificate.closed_loop_eigenvalues[0]
    assert np.min(np.abs(fast - ideal_pole)) < 0.02 * abs(ideal_pole)
    jw = 1j * 6.0
    c = integrated.controller
    response = (c.C @ np.linalg.solve(jw * np.eye(2) - c.A, c.B))[0, 0]
    assert response == pytest.approx(-3.0 * jw / (jw + 0.01) ** 2, rel=1e-12)
    assert np.allclose(c.C @ np.linalg.solve(-c.A, c.B), 0.0)  # an offset of the accelerometer gives no force


@pytest.mark.parametrize(
    ("hook", "words"),
    [
        (SkyHook("secondary", "magnet.gap", 1.0), "neither an absolute velocity"),
        (SkyHook("secondary", "car.heave", 1.0), "neither an absolute velocity"),
        (SkyHook("secondary", "car.heave.velocty", 1.0), "did you mean 'car.heave.velocity'"),
        (SkyHook("secondary", "car.heave.velocity", -1.0), "at least 0"),
    ],
)
def test_skyhook_refuses_what_is_no_skyhook(hook, words):
    with pytest.raises(ValueError, match=words):
        sky_hook(_quarter_car(), [hook])
