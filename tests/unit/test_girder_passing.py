"""The steady response to spans of one shape, critical speeds, single steps: against closed forms and integration."""

import itertools

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from maglev_ctrl.analysis.girder import passing
from maglev_ctrl.analysis.girder.critical import critical_speeds, worst_passing_speed
from maglev_ctrl.analysis.girder.drive import DrivenSystem
from maglev_ctrl.analysis.girder.passing import passing_response
from maglev_ctrl.analysis.girder.shapes import PieceShape, joint_shape
from maglev_ctrl.analysis.girder.transient import step_response_peak
from maglev_ctrl.errors import Agreement, NotStable
from maglev_ctrl.systems import SecondOrderSystem
from maglev_ctrl.vehicle.guideway_sources import girder_bow, measured_profile, stepped_joints

SAG = PieceShape.from_source(girder_bow("girder", span=25.0, rise=-0.004))
JUMPS = PieceShape.from_source(stepped_joints("joints", spacing=12.0, step=0.001, offset=1.3))
RAMPS = joint_shape(10.0, step=0.001, length=0.2)
MEASURED = PieceShape.from_source(measured_profile("segments", spacing=10.0, heights=[0.0, 1e-3, 3e-3, -2e-3]))
SHAPES = {"sag": SAG, "jumps": JUMPS, "ramps": RAMPS, "measured": MEASURED}


def car(*, damping: float = 1.0, guideway_damping: bool = True) -> SecondOrderSystem:
    """A body in heave and pitch on two elements, a mass on a spring over it, a fast lagged force."""
    felt = 1.0 if guideway_damping else 0.0
    return SecondOrderSystem.from_matrices(
        np.diag([1e3, 2e3, 200.0]),
        damping * np.array([[2e3, -5e2, 0.0], [-5e2, 5e2, 0.0], [0.0, 0.0, 1e3]]),
        np.array([[4e4, -1e4, 0.0], [-1e4, 1e4, 0.0], [0.0, 0.0, 3e4]]),
        dofs=("z", "c", "p"),
        internal=("lag",),
        A_internal=[[-300.0]],
        G_w=[[100.0, 0.0]],
        F=[[50.0], [0.0], [0.0]],
        guideway=("heave@f", "heave@r"),
        K_w=np.array([[2e4, 2e4], [0.0, 0.0], [3e3, -3e3]]),
        C_w=felt * np.array([[1e3, 1e3], [0.0, 0.0], [2e2, -2e2]]),
        outputs=("z.acceleration", "front.gap"),
        H_q=[[0.0, 0.0, 0.0], [1.0, 0.0, 3.0]],
        H_a=[[1.0, 0.0, 0.0], [0.0, 0.0, 0.0]],
        H_w=[[0.0, 0.0], [-1.0, 0.0]],
    )


PLACES = {"f": 3.0, "r": -3.1}


@pytest.mark.parametrize("name", SHAPES)
def test_fourier_coefficients_are_those_of_quadrature_and_within_their_bound(name: str) -> None:
    shape = SHAPES[name]
    found = shape.harmonics(2000)
    node, weight = np.polynomial.legendre.leggauss(80)
    for k in (1, 2, 7):
        at = 2.0 * np.pi * k / shape.span
        middle, half = 0.5 * (shape.breaks[1:] + shape.breaks[:-1]), 0.5 * np.diff(shape.breaks)
        s = middle[:, None] + half[:, None] * node
        wanted = 2.0 / shape.span * np.sum(half[:, None] * weight * shape.at(s) * np.exp(-1j * at * s))
        assert abs(found[k - 1] - wanted) < 1e-13
        assert abs(np.conj(found[k - 1]) - wanted) > 1e-9 or abs(found[k - 1].imag) < 1e-9
    order = np.arange(1, 2001)
    a, b = shape.tail()
    assert np.all(np.abs(found) <= (a / order + b / order**2) * (1 + 1e-9))
    # The bound of order one is there only for steps; without it steps would break the bound.
    assert (a > 0.0) == (name == "jumps")
    if name == "jumps":
        assert np.any(np.abs(found) > b / order**2)


def test_the_sag_has_the_coefficients_of_a_half_sine() -> None:
    k = np.arange(1, 50)
    closed = 0.004 * 4.0 / np.pi / (4.0 * k**2 - 1.0)
    assert np.max(np.abs(SAG.harmonics(49) - closed)) < 1e-17
    assert np.max(np.abs(SAG.harmonics(49) + closed)) > 1e-3  # the other sign is a hump


def test_periodic_integrals_have_coefficients_over_the_wavenumber() -> None:
    for shape in SHAPES.values():
        k = 2j * np.pi * np.arange(1, 9) / shape.span
        assert np.max(np.abs(shape.integral().harmonics(8) - shape.harmonics(8) / k)) < 1e-15
        assert abs(shape.integral().mean) < 1e-17


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("speed", [5.0, 30.0, 120.0])
def test_harmonics_and_exponentials_agree(name: str, speed: float) -> None:
    found = passing_response(
        car(), SHAPES[name], speed=speed, places=PLACES, outputs=["z.acceleration", "front.gap", "c"]
    )
    for one in found.peaks:
        assert one.agreement is Agreement.AGREED
        if name == "jumps" and one.name == "z.acceleration":
            assert one.peak == np.inf and "rate" in one.reason
            continue
        assert one.difference < 1e-8
        assert one.lowest < 0.0 < one.highest and one.rms < one.peak


def test_the_steady_response_is_what_integration_settles_to() -> None:
    loop, shape, speed = car(), MEASURED, 30.0
    A, E = loop.state_matrix(), loop.guideway_matrix()
    C, _, D = loop.output_rows(("z.acceleration", "front.gap", "c"))
    places = np.array([3.0, -3.1])
    period = shape.span / speed

    def drive(t: float) -> np.ndarray:
        where = speed * t + places
        return np.concatenate([shape.at(where), speed * shape.slope(where)])

    # Integrated from corner to corner, long enough for the slowest mode (0.13 1/s) to be gone.
    corners = np.unique(np.mod((shape.breaks[:-1, None] - places).ravel() / speed, period))
    x, t, cycles = np.zeros(len(A)), 0.0, int(400.0 / period)
    # The map over one period is affine: the state after many of them follows by squaring it.
    edges = np.unique(np.concatenate([[0.0], corners, [period]]))
    joined = np.eye(len(A) + 1)
    for low, high in itertools.pairwise(edges):
        middle_rate = drive(0.5 * (low + high))[2:]

        def rate(s: float, flat: np.ndarray, low: float = low, high: float = high) -> np.ndarray:
            s = min(max(s, low + 1e-13), high - 1e-13)
            X = flat.reshape(len(A) + 1, -1)
            out = np.zeros_like(X)
            out[:-1] = A @ X[:-1] + np.outer(E @ drive(s), X[-1])
            return out.ravel()

        assert np.all(np.isfinite(middle_rate))
        part = solve_ivp(rate, (low, high), np.eye(len(A) + 1).ravel(), method="DOP853", rtol=1e-12, atol=1e-15)
        joined = part.y[:, -1].reshape(len(A) + 1, -1) @ joined
    total = np.linalg.matrix_power(joined, cycles)
    x = total[:-1, -1]
    found = passing_response(loop, shape, speed=speed, places=PLACES, outputs=["z.acceleration", "front.gap", "c"])
    wanted = C @ x + D @ drive(t)
    scale = np.array([one.peak for one in found.peaks])
    assert np.max(np.abs(found.values[:, 0] - wanted) / scale) < 1e-8
    # Elements the wrong way round (rear first) are seen.
    other = passing_response(
        loop, shape, speed=speed, places={"f": -3.0, "r": 3.1}, outputs=["z.acceleration", "front.gap", "c"]
    )
    assert np.max(np.abs(other.values[:, 0] - wanted) / scale) > 1e-2


def test_the_rear_lags_the_front() -> None:
    each = SecondOrderSystem.from_matrices(
        np.eye(2), np.diag([3.0, 3.0]), np.diag([100.0, 100.0]), dofs=("f", "r"), guideway=("heave@f", "heave@r"),
        K_w=np.diag([100.0, 100.0]),
    )  # fmt: skip
    found = passing_response(each, SAG, speed=40.0, places={"f": 4.0, "r": -3.0}, outputs=["f", "r"])
    front, rear = found.of("f"), found.of("r")
    assert rear.peak == pytest.approx(front.peak, rel=1e-9)
    assert np.mod(rear.time - front.time, found.period) == pytest.approx(7.0 / 40.0, abs=1e-6)


def test_a_single_harmonic_mode_has_its_transfer_function() -> None:
    """Elements half a span apart leave no odd harmonic in heave; then each harmonic is its own transfer function."""
    loop = SecondOrderSystem.from_matrices(
        [[2.0]], [[4.0]], [[800.0]], dofs=("z",), guideway=("heave@a", "heave@b"), K_w=[[400.0, 400.0]],
        C_w=[[2.0, 2.0]],
    )  # fmt: skip
    speed = 11.0
    found = passing_response(loop, SAG, speed=speed, places={"a": 6.25, "b": -6.25}, outputs=["z"])
    k = np.arange(2, 4001, 2)
    s = 2j * np.pi * k * speed / 25.0
    amplitude = SAG.harmonics(4000)[1::2] * np.exp(2j * np.pi * k * 0.25) * (4.0 * s + 800.0)
    amplitude = amplitude / (2.0 * s**2 + 4.0 * s + 800.0)
    t = np.linspace(0.0, found.period, 2001)
    wave = (amplitude @ np.exp(s[:, None] * t)).real
    assert found.of("z").highest == pytest.approx(np.max(wave), rel=1e-4)
    assert found.of("z").rms == pytest.approx(np.sqrt(0.5 * np.sum(np.abs(amplitude) ** 2)), rel=1e-6)
    one = passing_response(loop, SAG, speed=speed, places={"a": 0.0, "b": 0.0}, outputs=["z"])
    assert one.of("z").rms > 1.5 * found.of("z").rms


def test_a_wrong_sign_in_one_method_is_unresolved(monkeypatch: pytest.MonkeyPatch) -> None:
    exact = passing.periodic_solution

    def flipped(system: DrivenSystem, times: np.ndarray) -> object:
        return exact(
            DrivenSystem(
                system.A, system.E_w, -system.E_v, system.C, system.D_w, system.D_v, system.shapes, system.places,
                system.speed,
            ),
            times,
        )  # fmt: skip

    monkeypatch.setattr(passing, "periodic_solution", flipped)
    found = passing_response(car(), SAG, speed=30.0, places=PLACES, outputs=["front.gap"]).of("front.gap")
    assert found.agreement is Agreement.UNRESOLVED and np.isnan(found.peak) and "differ" in found.reason


def test_a_level_guideway_and_an_output_that_feels_nothing_are_zero() -> None:
    level = PieceShape.polyline([0.0, 10.0], [0.0, 0.0])
    found = passing_response(car(), level, speed=30.0, places=PLACES, outputs=["front.gap"])
    assert found.of("front.gap").peak == 0.0 and found.of("front.gap").agreement is Agreement.AGREED


def test_what_cannot_be_answered_is_refused() -> None:
    with pytest.raises(NotStable, match="root"):
        passing_response(car(damping=-1.0), SAG, speed=30.0, places=PLACES, outputs=["c"])
    with pytest.raises(ValueError, match="places: expected the position of 'r'"):
        passing_response(car(), SAG, speed=30.0, places={"f": 0.0}, outputs=["c"])
    with pytest.raises(ValueError, match="speed: expected a positive"):
        passing_response(car(), SAG, speed=0.0, places=PLACES, outputs=["c"])
    with pytest.raises(ValueError, match="smooth between its breaks"):
        PieceShape.from_source(
            girder_bow("x", span=1.0, rise=1.0).__class__(
                "kinked", 1.0, breaks=np.array([0.0, 1.0]), rise=lambda s: np.abs(s - 0.4)
            )
        )


def test_critical_speeds_and_the_worst_one() -> None:
    loop = SecondOrderSystem.from_matrices(
        [[1.0]], [[0.02]], [[100.0]], dofs=("z",), guideway=("heave@a",), K_w=[[100.0]]
    )  # fmt: skip
    f = np.sqrt(100.0 - 1e-4) / (2.0 * np.pi)
    found = critical_speeds(loop, span=25.0, speeds=(9.0, 50.0), harmonics=8)
    assert [one.order for one in found] == [4, 3, 2, 1]
    assert [one.speed for one in found] == pytest.approx([25.0 * f / k for k in (4, 3, 2, 1)])
    assert found[0].damping_ratio == pytest.approx(0.001)
    scan = worst_passing_speed(loop, SAG, speeds=(9.0, 50.0), places={"a": 0.0}, outputs=["z"], points=12)
    (worst,) = scan.worst
    assert not worst.at_limit and worst.nearest is not None and worst.nearest.order == 1
    assert worst.peak.peak >= 0.999999 * np.max(scan.peaks)
    # At resonance one harmonic rules: |c_1| / (2 zeta).
    assert worst.peak.peak == pytest.approx(abs(SAG.harmonics(1)[0]) / 0.002, rel=5e-3)
    assert worst.speed == pytest.approx(25.0 * f, rel=1e-4)
    dense = [
        passing_response(loop, SAG, speed=v, places={"a": 0.0}, outputs=["z"]).of("z").peak for v in (39.7, 39.78, 39.9)
    ]
    assert max(dense) <= worst.peak.peak * (1 + 1e-9)


def test_critical_speeds_of_a_loop_that_changes_with_the_speed() -> None:
    def loop(speed: float) -> SecondOrderSystem:
        return SecondOrderSystem.from_matrices([[1.0]], [[0.1]], [[(2.0 * speed) ** 2]], dofs=("z",))

    # w = 2 v never meets 2 pi k v / L except where L = pi k; off it there is none.
    assert critical_speeds(loop, span=25.0, speeds=(10.0, 50.0), harmonics=3) == ()

    def stiffer(speed: float) -> SecondOrderSystem:
        return SecondOrderSystem.from_matrices([[1.0]], [[1e-9]], [[(3.0 + 0.2 * speed) ** 2]], dofs=("z",))

    (one,) = critical_speeds(stiffer, span=25.0, speeds=(30.0, 80.0), harmonics=1)
    assert one.speed == pytest.approx(3.0 / (2.0 * np.pi / 25.0 - 0.2), rel=1e-9)


def test_an_abrupt_step_overshoots_as_a_damped_oscillator_does() -> None:
    zeta = 0.1
    loop = SecondOrderSystem.from_matrices(
        [[1.0]], [[2.0 * zeta]], [[1.0]], dofs=("z",), guideway=("heave@a",), K_w=[[1.0]]
    )  # fmt: skip
    found = step_response_peak(loop, height=-0.002, length=0.0, speed=50.0, places={"a": 0.0}, outputs=["z"])
    closed = 0.002 * (1.0 + np.exp(-np.pi * zeta / np.sqrt(1.0 - zeta**2)))
    assert found.peaks[0].peak == pytest.approx(closed, rel=1e-9)
    assert found.peaks[0].time == pytest.approx(np.pi / np.sqrt(1.0 - zeta**2), rel=1e-5)
    assert found.peaks[0].settled == pytest.approx(-0.002) and found.peaks[0].reason == ""
    wrong = 0.002 * (1.0 - np.exp(-np.pi * zeta / np.sqrt(1.0 - zeta**2)))
    assert abs(found.peaks[0].peak - wrong) > 1e-4


def test_a_ramp_follows_the_shock_spectrum() -> None:
    """Undamped: the peak under a ramp that rises in t_r is 1 + |sin(pi t_r/T)| / (pi t_r/T)."""
    loop = SecondOrderSystem.from_matrices(
        [[1.0]], [[2e-7]], [[1.0]], dofs=("z",), guideway=("heave@a",), K_w=[[1.0]]
    )  # fmt: skip
    for ratio in (0.3, 0.8, 1.5):
        rise = ratio * 2.0 * np.pi
        found = step_response_peak(loop, height=1.0, length=50.0 * rise, speed=50.0, places={"a": 0.0}, outputs=["z"])
        closed = 1.0 + abs(np.sin(np.pi * ratio)) / (np.pi * ratio)
        assert found.peaks[0].peak == pytest.approx(closed, rel=1e-5)


def test_a_step_under_two_elements_is_what_integration_gives() -> None:
    loop = car()
    A, E = loop.state_matrix(), loop.guideway_matrix()
    C, _, D = loop.output_rows(("z.acceleration", "front.gap"))
    places, speed, length, height = np.array([3.0, -3.1]), 40.0, 0.8, 0.003

    def drive(t: float) -> np.ndarray:
        begun = t - (3.0 - places) / speed
        inside = (begun > 0.0) & (begun < length / speed)
        return np.concatenate([np.clip(begun * speed / length, 0.0, 1.0) * height, inside * height * speed / length])

    edges = [0.0, 0.02, 6.1 / 40.0, 6.1 / 40.0 + 0.02, 3.0]
    x, top = np.zeros(len(A)), np.zeros(2)
    for low, high in itertools.pairwise(edges):
        at = np.linspace(low, high, 3001)
        inner = np.clip(at, low + 1e-12, high - 1e-12)
        part = solve_ivp(
            lambda t, z, a=low, b=high: A @ z + E @ drive(min(max(t, a + 1e-12), b - 1e-12)), (low, high), x,
            method="DOP853", rtol=1e-11, atol=1e-14, t_eval=at,
        )  # fmt: skip
        values = C @ part.y + D @ np.array([drive(t) for t in inner]).T
        top = np.maximum(top, np.max(np.abs(values), axis=1))
        x = part.y[:, -1]
    found = step_response_peak(
        loop, height=height, length=length, speed=speed, places=PLACES, outputs=["z.acceleration", "front.gap"]
    )
    assert [one.peak for one in found.peaks] == pytest.approx(list(top), rel=2e-6)
    turned = step_response_peak(
        loop, height=height, length=length, speed=speed, places={"f": -3.0, "r": 3.1},
        outputs=["z.acceleration", "front.gap"],
    )  # fmt: skip
    assert abs(turned.peaks[1].peak / found.peaks[1].peak - 1.0) > 1e-3


def test_an_abrupt_step_pushes_dampers_at_once() -> None:
    """A damper to the guideway turns a step h into the velocity c h / m; the acceleration is infinite."""
    loop = SecondOrderSystem.from_matrices(
        [[2.0]], [[3.0]], [[10.0]], dofs=("z",), guideway=("heave@a",), K_w=[[10.0]], C_w=[[3.0]],
        outputs=("acceleration",), H_a=[[1.0]],
    )  # fmt: skip
    found = step_response_peak(
        loop, height=0.001, length=0.0, speed=50.0, places={"a": 0.0}, outputs=["z.velocity", "acceleration"]
    )
    assert found.values[0, 0] == pytest.approx(3.0 * 0.001 / 2.0)
    assert found.peaks[1].peak == np.inf and "infinite" in found.peaks[1].reason
    short = step_response_peak(
        loop, height=0.001, length=1e-5, speed=50.0, places={"a": 0.0}, outputs=["z.velocity"]
    )  # fmt: skip
    assert short.peaks[0].peak == pytest.approx(found.peaks[0].peak, rel=1e-4)
