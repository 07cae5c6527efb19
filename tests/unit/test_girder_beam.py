"""Girders under moving constant loads, against published closed forms and direct integration."""

import itertools

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from maglev_ctrl.analysis.girder.beam import (
    Girder,
    Loads,
    cancellation_speeds,
    deflection,
    impact_factor,
    modal_response,
    resonance_speeds,
)
from maglev_ctrl.analysis.girder.track import FlexibleGuideway


def girder(*, damping: float = 0.0, modes: int = 5) -> Girder:
    return Girder(25.0, bending_stiffness=2.5e10, mass_per_length=4e3, damping_ratio=damping, modes=modes)


def at_parameter(one: Girder, alpha: float) -> float:
    return alpha * 2.0 * one.first_frequency * one.span


def fryba(one: Girder, load: float, alpha: float, times: np.ndarray, place: float) -> np.ndarray:
    """Fryba (1999), Eq. 1.31: v0 sum of sin(j pi x/l) (sin j w t - (a/j) sin w_(j) t) / (j^2 (j^2 - a^2)), undamped."""
    v0 = 2.0 * load * one.span**3 / (np.pi**4 * one.bending_stiffness)
    drive = np.pi * at_parameter(one, alpha) / one.span
    total = np.zeros(len(times))
    for j in range(1, one.modes + 1):
        wave = np.sin(j * drive * times) - alpha / j * np.sin(one.frequencies[j - 1] * times)
        total += np.sin(j * np.pi * place / one.span) * wave / (j**2 * (j**2 - alpha**2))
    return v0 * total


@pytest.mark.parametrize("alpha", [0.1, 0.5, 0.62, 0.9, 1.7])
def test_the_published_solution_of_a_moving_force(alpha: float) -> None:
    one = girder()
    speed = at_parameter(one, alpha)
    times = np.linspace(0.0, one.span / speed, 301)
    for place in (6.0, 12.5):
        found = deflection(one, Loads.at(1e5, 0.0), speed=speed, place=place, times=times)
        closed = fryba(one, 1e5, alpha, times, place)
        size = np.max(np.abs(closed))
        assert np.max(np.abs(found - closed)) < 1e-12 * size
        # The sign of the free part is what makes it start from rest.
        assert np.max(np.abs(found - fryba(one, 1e5, -alpha, times, place))) > 1e-3 * size


def test_impact_factors_of_the_first_mode() -> None:
    """Closed: at alpha = 1/2 the top of (sin a - sin(2 a)/2)/(3/4) is sqrt 3; at alpha = 1 half of pi; see Fryba."""
    one = girder(modes=1)

    def factor(alpha: float) -> float:
        return impact_factor(one, Loads.at(1e5, 0.0), speed=at_parameter(one, alpha)).factor

    assert factor(0.5) == pytest.approx(np.sqrt(3.0), abs=1e-12)
    assert factor(1.0) == pytest.approx(0.5 * np.pi, abs=1e-12)
    t = np.linspace(0.0, 1.0, 20001)
    for alpha in (0.3, 0.6, 0.617, 0.8):
        curve = (np.sin(np.pi * t) - alpha * np.sin(np.pi * t / alpha)) / (1.0 - alpha**2)
        assert factor(alpha) == pytest.approx(np.max(np.abs(curve)), rel=1e-7)
    # The series has its largest amplification, 1.7684, near alpha = 0.62.
    curve = [factor(alpha) for alpha in np.arange(0.55, 0.70, 0.01)]
    assert max(curve) == pytest.approx(1.7684, abs=2e-4)
    assert np.arange(0.55, 0.70, 0.01)[int(np.argmax(curve))] == pytest.approx(0.62, abs=0.011)


def test_a_damped_girder_under_several_loads_is_what_integration_gives() -> None:
    one, speed = girder(damping=0.03, modes=3), 90.0
    loads = Loads.at([1e5, 6e4, -2e4], [0.0, -9.0, 3.0])
    times = np.linspace(-0.05, 0.6, 41)

    def rate(t: float, z: np.ndarray, loss: float = 0.03) -> np.ndarray:
        push = loads.force @ one.shape(speed * t + loads.lead)
        q, v = z[:3], z[3:]
        return np.concatenate([v, one.mobility * push - 2 * loss * one.frequencies * v - one.frequencies**2 * q])

    def integrated(loss: float) -> np.ndarray:
        edges = np.unique(np.concatenate([[-0.05, 0.6], -loads.lead / speed, (25.0 - loads.lead) / speed, times]))
        z, found = np.zeros(6), [np.zeros(3)]
        for low, high in itertools.pairwise(edges):
            z = solve_ivp(rate, (low, high), z, args=(loss,), method="DOP853", rtol=1e-11, atol=1e-16).y[:, -1]
            if np.any(np.isclose(high, times, rtol=0, atol=1e-15)):
                found.append(z[:3])
        return np.array(found)

    position, velocity = modal_response(one, loads, speed=speed, times=times)
    truth = integrated(0.03)
    size = np.max(np.abs(truth))
    assert np.max(np.abs(position - truth)) < 1e-9 * size
    assert np.max(np.abs(position - integrated(0.02))) > 1e-3 * size
    later, _ = modal_response(one, loads, speed=speed, times=times + 1e-6)
    assert np.max(np.abs((later - position) / 1e-6 - velocity)) < 1e-4 * np.max(np.abs(velocity))


def test_free_vibration_and_its_cancellation() -> None:
    one = girder(modes=1)
    static = 2.0 * 1e5 * one.span**3 / (np.pi**4 * one.bending_stiffness)

    def amplitude(speed: float) -> float:
        t = one.span / speed + np.array([0.1])
        q, v = modal_response(one, Loads.at(1e5, 0.0), speed=speed, times=t)
        return float(np.hypot(q, v / one.frequencies[0])[0, 0])

    for alpha in (0.3, 0.45, 0.7, 1.4):
        closed = 2.0 * alpha * abs(np.cos(np.pi / (2.0 * alpha))) / abs(1.0 - alpha**2)
        assert amplitude(at_parameter(one, alpha)) == pytest.approx(static * closed, rel=1e-10)
    for speed in cancellation_speeds(one, orders=3):
        assert amplitude(float(speed)) < 1e-12 * static
        assert amplitude(1.05 * float(speed)) > 1e-2 * static


def test_trains_resonate_where_their_loads_follow_in_step() -> None:
    one, spacing = girder(modes=1), 18.0
    for speed in resonance_speeds(one, spacing=spacing, orders=3).tolist():

        def left(count: int, speed: float = speed) -> float:
            t = np.array([(one.span + spacing * (count - 1)) / speed + 0.01])
            q, v = modal_response(one, Loads.train(1e5, count=count, spacing=spacing), speed=speed, times=t)
            return float(np.hypot(q, v / one.frequencies[0])[0, 0])

        assert left(10) == pytest.approx(10.0 * left(1), rel=1e-9)
        assert left(10, 1.07 * speed) < 5.0 * left(1, 1.07 * speed)


def test_creeping_loads_bend_the_girder_statically() -> None:
    one = girder(damping=0.3, modes=25)
    for at in (5.0, 12.5, 21.0):
        found = deflection(one, Loads.at(1e5, 0.0), speed=1e-3, place=10.0, times=[at / 1e-3])[0]
        assert found == pytest.approx(one.static_deflection(1e5, place=at, at=10.0), rel=2e-4)
    assert one.static_deflection(1e5, place=30.0, at=10.0) == 0.0


def test_a_guideway_told_of_its_loads_step_by_step_is_exact() -> None:
    one, speed = girder(damping=0.02), 70.0
    loads = Loads.at([1e5, 6e4], [0.0, -11.0])
    track = FlexibleGuideway(one, speed=speed, support=100.0)
    step, time = 0.0031, -0.01
    for _ in range(220):
        track.advance(time, 100.0 + speed * time + loads.lead, loads.force, step)
        time += step
    for index in (0, 1):
        wanted, moving = modal_response(one, loads, speed=speed, times=[time - index * one.span / speed])
        at = 100.0 + index * one.span + np.array([4.0, 12.5, 20.0])
        local = np.array([4.0, 12.5, 20.0])
        size = np.max(np.abs(one.shape(12.5) @ wanted[0]))
        assert np.max(np.abs(track.under(at, 0.0)[0] + one.shape(local) @ wanted[0])) < 1e-10 * size
        slope = -(one.shape_slope(local) @ wanted[0] + one.shape(local) @ moving[0] / speed)
        assert np.max(np.abs(track.slopes(at, 0.0)[0] - slope)) < 1e-10 * size
        late, _ = modal_response(one, loads, speed=speed, times=[time + 0.003 - index * one.span / speed])
        assert np.max(np.abs(track.under(at, 0.0)[0] + one.shape(local) @ late[0])) > 1e-4 * size
    assert track.responds and np.all(track.fresh().under([101.0, 160.0], [0.0, 1.0])[0] == 0.0)


def test_rigid_irregularity_lies_on_the_girders() -> None:
    class Bump:
        def under(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            return 1e-3 * x + y, 2.0 * x

        def slopes(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            return 1e-3 + 0.0 * x, 2.0 + 0.0 * x

    track = FlexibleGuideway(girder(), speed=50.0, below=Bump())
    track.advance(0.0, np.array([5.0]), np.array([1e5]), 0.05)
    bare = FlexibleGuideway(girder(), speed=50.0)
    bare.advance(0.0, np.array([5.0]), np.array([1e5]), 0.05)
    x, y = np.array([3.0, 40.0]), np.array([0.5, 0.5])
    assert np.allclose(track.under(x, y)[0] - bare.under(x, y)[0], 1e-3 * x + y)
    assert np.allclose(track.slopes(x, y)[0] - bare.slopes(x, y)[0], 1e-3) and np.allclose(track.under(x, y)[1], 2 * x)
    assert bare.under(x, y)[0][0] < 0.0 and bare.midspan(0) > 0.0


def test_bad_girders_and_loads_are_refused() -> None:
    with pytest.raises(ValueError, match="span: expected a positive"):
        Girder(0.0, bending_stiffness=1.0, mass_per_length=1.0)
    with pytest.raises(ValueError, match="damping_ratio: expected"):
        Girder(1.0, bending_stiffness=1.0, mass_per_length=1.0, damping_ratio=1.0)
    with pytest.raises(ValueError, match="as many of each"):
        Loads.at([1.0, 2.0], [0.0])
    with pytest.raises(ValueError, match="speed: expected"):
        modal_response(girder(), Loads.at(1.0, 0.0), speed=0.0, times=[0.0])
    with pytest.raises(ValueError, match="as many of each"):
        FlexibleGuideway(girder(), speed=1.0).advance(0.0, np.zeros(2), np.zeros(1), 0.1)
