"""Growth, boundaries, limit cycles, attraction and root mean squares against closed forms and the linear theory."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats
from simulation_vehicles import cart

from maglev_ctrl.analysis.simulation.attraction import attraction, axes_of
from maglev_ctrl.analysis.simulation.cycles import limit_cycle
from maglev_ctrl.analysis.simulation.ensemble import ensemble_rms
from maglev_ctrl.analysis.simulation.measure import boundary_check, fitted_modes, measured_growth
from maglev_ctrl.analysis.simulation.records import Limits
from maglev_ctrl.analysis.simulation.run import simulate
from maglev_ctrl.errors import Agreement
from maglev_ctrl.forces import CornerImageForce, ImageForce
from maglev_ctrl.forces.tabulated import TabulatedForce
from maglev_ctrl.guideway import Modulation
from maglev_ctrl.systems import Controller
from maglev_ctrl.vehicle import Actuator, OperatingPoint, equilibrium, models

BOUNDARY = 0.01
"""Agreement of a boundary in the simulation with that of the linear model."""


@pytest.fixture(scope="module")
def corner() -> TabulatedForce:
    """A polynomial through the forces of a coil in a perfectly conducting corner, about the paper's gap."""
    coil = CornerImageForce(6000.0, length=0.0508, width=0.0254, thickness=0.00635)
    h, g = (part.ravel() for part in np.meshgrid(np.linspace(0.012, 0.046, 12), np.linspace(0.0105, 0.015, 6)))
    forces = coil.forces(h, g, np.full(h.size, 36.1))
    return TabulatedForce.from_samples(
        h, g, np.full(h.size, 36.1), lift=forces.lift, guidance=forces.guidance, drag=np.zeros(h.size),
        method="polynomial", degree=6, constant=("speed",),
    )  # fmt: skip


def _double_l(force: TabulatedForce, *, paper: bool):
    switches = {"kinematics": "paper", "geometric_stiffness": False} if paper else {}
    car = models.double_l(force, height=0.015, speed=36.1, **switches)
    return lambda height: (car, equilibrium(car, OperatingPoint(36.1, height, gap=0.0127)), None)


@pytest.mark.parametrize(("paper", "low", "high"), [(True, 0.0165, 0.0182), (False, 0.037, 0.0405)])
def test_flutter_and_divergence_of_the_double_l(corner: TabulatedForce, paper: bool, low: float, high: float) -> None:
    make = _double_l(corner, paper=paper)
    found = boundary_check(
        make, (low, high), duration=0.6, coordinates=("car.sway", "car.roll"), runs=2, tolerance=0.012, step=0.005,
        neutral=0.05,
    )  # fmt: skip
    assert found.agreement is Agreement.AGREED and found.difference < BOUNDARY, found.reason
    assert (found.frequency > 30.0) if paper else (found.frequency == 0.0)
    # Mutant: the same vehicle with the other kinematics has no boundary there.
    with pytest.raises(ValueError, match="growth at one end only"):
        boundary_check(
            _double_l(corner, paper=not paper), (low, high), duration=0.3, coordinates=("car.sway", "car.roll"), runs=2,
            step=0.005, neutral=0.05,
        )  # fmt: skip


def test_growth_of_an_unstable_loop_and_its_boundary() -> None:
    def make(gain: float):
        vehicle, rest = cart(damping=20.0, elements={"actuators": (Actuator("push", "car"),)})
        law = Controller.static([[gain]], measured=("car.heave.velocity",), commands=("push",))
        return vehicle, rest, law

    vehicle, rest, law = make(60.0)
    found = measured_growth(vehicle, rest, controller=law, duration=1.0, runs=2)
    assert found.rate == pytest.approx(2.0, rel=1e-3) and found.frequency == pytest.approx(np.sqrt(396.0), rel=1e-3)
    assert found.spread < 1e-2 and found.residual < 1e-3
    check = boundary_check(make, (15.0, 26.0), duration=0.5, runs=2, tolerance=0.03, neutral=1e-3, step=0.01)
    assert check.boundary == pytest.approx(20.0, rel=0.02) and check.linear == pytest.approx(20.0, rel=0.003)


def test_fit_of_several_modes() -> None:
    t = 0.02 * np.arange(120)
    s = np.array([-0.3 + 9j, 0.2 + 4j, -1.0])
    random = np.random.default_rng(0)
    shapes, starts = (random.standard_normal((n, 3)) + 1j * random.standard_normal((n, 3)) for n in (4, 3))
    shapes[:, 2] = shapes[:, 2].real
    samples = np.einsum("rm,cm,sm->rsc", starts, shapes, np.exp(np.outer(t, s))).real
    modes, residual = fitted_modes(samples, 0.02)
    assert np.max(np.abs(modes - s[[1, 0, 2]])) < 1e-6 and residual < 1e-8


def test_a_parametric_tongue_is_there_and_ends() -> None:
    coil = ImageForce.for_lift(1e5, 0.1, 40.0, length=1.0, conductivity=2.5e7, thickness=0.02, exponent=1.0)
    car = models.heave_surge(1e5 / 9.80665, force=coil, reference_height=0.1)
    rest = equilibrium(car, OperatingPoint(40.0, 0.1))
    heave = np.sqrt(9.80665 / 0.1)

    def growth(ratio: float) -> float:
        """Passing frequency over twice the heave frequency."""
        wave = Modulation(wavelength=2.0 * np.pi * 40.0 / (2.0 * heave * ratio), depth=0.4)
        found = measured_growth(car, rest, duration=7.0, modulation=wave, coordinates=("car.heave",), runs=3, step=0.02)
        return found.rate

    # Mathieu's principal tongue: at its middle the rate is depth w / 4, its half width depth / 4 (first order).
    inside, outside = growth(1.0), growth(1.25)
    assert inside == pytest.approx(0.4 * heave / 4.0, rel=0.05)
    assert outside < 0.1 * inside


def test_limit_cycle_of_a_saturated_force() -> None:
    vehicle, rest = cart(damping=20.0, elements={"actuators": (Actuator("push", "car", force_limit=5.0),)})
    law = Controller.static([[1e4]], measured=("car.heave.velocity",), commands=("push",))
    found = simulate(vehicle, rest, controller=law, duration=8.0, start={"car.heave": 0.02}, sampling=0.01, step=0.01)
    cycle = limit_cycle(found, "car.heave", share=0.25)
    # A relay against a damper: 4 F / pi feeds the fundamental, c w A takes it (harmonics are filtered to 1 %).
    assert cycle.periodic, cycle.reason
    assert cycle.amplitude == pytest.approx(4.0 * 5.0 / (np.pi * 20.0 * 20.0), rel=0.02)
    assert cycle.frequency == pytest.approx(20.0, rel=0.01) and abs(cycle.mean) < 1e-4
    assert found.saturation["push"][0] > 0.9
    decaying = limit_cycle(simulate(vehicle, rest, duration=4.0, start={"car.heave": 0.02}, sampling=0.01), "car.heave")
    assert not decaying.periodic and "amplitude changes" in decaying.reason


def test_attraction_of_a_saturated_unstable_mass() -> None:
    # m z'' = k z + u, |u| <= F: from rest it returns where |z| < F / k, and never from beyond.
    elements = {"actuators": (Actuator("push", "car", force_limit=40.0),), "gravity": 0.0}
    vehicle, rest = cart(stiffness=-4000.0, elements=elements)
    law = Controller.static([[-12000.0, -500.0]], measured=("car.heave", "car.heave.velocity"), commands=("push",))
    found = attraction(
        vehicle, rest, controller=law, coordinates={"car.heave": 0.01}, sizes=[0.5, 0.95, 1.05, 1.5], duration=1.0,
        directions=axes_of(("car.heave",)), limits=Limits(travel=1.0), sampling=0.01, step=0.005,
    )  # fmt: skip
    assert found.share.tolist() == [1.0, 1.0, 0.0, 0.0] and found.surest == 0.95
    interval = stats.binomtest(2, 2).proportion_ci(0.95, "exact")
    assert (found.lower[0], found.upper[0]) == pytest.approx((interval.low, interval.high))
    assert (found.lower[-1], found.upper[-1]) == pytest.approx((1.0 - interval.high, 1.0 - interval.low))
    assert len(found.events) == 4 and all(event.run >= 4 for event in found.events)
    with pytest.raises(ValueError, match="rising, positive"):
        attraction(vehicle, rest, coordinates={"car.heave": 1.0}, sizes=[1.0, 0.5], duration=1.0)


def test_bands_cover_as_often_as_they_say() -> None:
    # First-order autoregressive noise of unit variance: rho_k = a^k, so N (1 - a^2) / (1 + a^2) samples count.
    random, a, hits, wide = np.random.default_rng(5), 0.9, 0, 0
    for _ in range(120):
        noise = random.standard_normal((30, 600))
        x = np.empty_like(noise)
        x[:, 0] = noise[:, 0]
        for k in range(1, 600):
            x[:, k] = a * x[:, k - 1] + np.sqrt(1.0 - a * a) * noise[:, k]
        found = ensemble_rms(x)
        hits += found.band[0] <= 1.0 <= found.band[1]
        wide += found.scatter_band[0] <= 1.0 <= found.scatter_band[1]
        assert found.agreement is Agreement.AGREED
    # 120 trials at 95 %: within three binomial standard deviations.
    assert 107 <= hits <= 120 and 107 <= wide <= 120
    assert found.freedom == pytest.approx(18000 * (1 - a * a) / (1 + a * a), rel=0.15)
    # Mutant: samples taken for independent ones give a band a third as wide, which the scatter of the runs tells.
    naive = np.sqrt(18000 / stats.chi2.ppf([0.975, 0.025], 18000))
    assert (naive[1] - naive[0]) < 0.4 * (found.band[1] - found.band[0])
    uneven = random.standard_normal((10, 500)) * np.linspace(0.5, 1.5, 10)[:, None]
    assert ensemble_rms(uneven).agreement is Agreement.UNRESOLVED
    with pytest.raises(ValueError, match="ended early"):
        ensemble_rms(np.full((3, 10), np.nan))
