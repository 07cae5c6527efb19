"""The periodic law of an option: its own weights, its phase, its checks, and what is told where there is none."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import maglev_ctrl.study.periodic_law as law_module
from maglev_ctrl.analysis.floquet import floquet
from maglev_ctrl.analysis.plane_records import STABLE, UNSTABLE, PeriodicFamily, StabilityPlane
from maglev_ctrl.kernels.fourier_matrix import FourierMatrix
from maglev_ctrl.scenario import Scenario
from maglev_ctrl.study.forcing import Forcing, slowed_vehicle
from maglev_ctrl.study.law import design_law
from maglev_ctrl.study.map.option import _periodic_law
from maglev_ctrl.study.map.records import PeriodicLawStudy
from maglev_ctrl.study.map.request import map_request
from maglev_ctrl.study.periodic_law import (
    OWN,
    LawFamily,
    PhaseLockedLaw,
    open_plant,
    own_problem,
    periodic_law_study,
)
from maglev_ctrl.study.situation import OptionModel
from maglev_ctrl.synthesis.design import Design
from maglev_ctrl.synthesis.periodic import periodic_lqr, verify_periodic
from maglev_ctrl.synthesis.periodic_constant import periodic_cost
from maglev_ctrl.synthesis.periodic_problem import loop_multipliers
from maglev_ctrl.systems import at_depth

DEPTH = 0.4
Case = tuple[Scenario, OptionModel, Design]


def case(scenario: Scenario) -> Case:
    model = OptionModel(scenario, scenario.options[2])
    design = design_law(scenario, scenario.options[2], model)
    assert design is not None
    return scenario, model, design


@pytest.fixture(scope="module")
def shaken(small_scenario: Callable[..., Scenario], small_text: str) -> Case:
    """The active option where the girders pass with w1 + w2, deep modulation."""
    text = small_text.replace('speed = "300 km/h"', 'speed = "388 km/h"').replace("depth = 0.05", f"depth = {DEPTH}")
    return case(small_scenario(text))


@pytest.fixture(scope="module")
def studied(shaken: Case) -> PeriodicLawStudy:
    _, model, design = shaken
    found, reason = periodic_law_study(model, design)
    assert found is not None and reason == ""
    return found


def test_the_periodic_law_costs_least_and_the_own_gain_is_the_averaged_design(studied: PeriodicLawStudy) -> None:
    assert studied.unresolved == "" and studied.comparison is not None and len(studied.certificate) >= 5
    found = studied.comparison
    assert found.periodic.mean_cost_ratio == pytest.approx(1.0, abs=1e-9) and found.periodic.gain.harmonics > 0
    assert found.constants[0].name == f"{OWN} (LQR of the averaged system)"
    assert all(one.mean_cost_ratio > 1.0 + 1e-6 for one in found.constants)
    assert found.constants[-1].mean_cost_ratio <= found.constants[0].mean_cost_ratio * (1.0 + 1e-9)


def test_a_constant_gain_closes_the_very_loop_of_the_option(shaken: Case) -> None:
    scenario, model, design = shaken
    assert scenario.periodic is not None
    own = FourierMatrix.of(-design.controller.D, frequency=1.0)
    law = PhaseLockedLaw(own, design.controller.measured, design.controller.commands, DEPTH)
    forcing = Forcing.of(model, design.controller, scenario.periodic)
    for speed, depth in ((80.0, 0.1), (107.0, 0.5)):
        mine = LawFamily(model, model.vehicle(), law, {})(speed, depth)
        known = at_depth(forcing.at(speed), depth)
        scale = np.max(np.abs(known.A_0))
        np.testing.assert_allclose(mine.A_0, known.A_0, atol=1e-12 * scale)
        np.testing.assert_allclose(mine.A_cos, known.A_cos, atol=1e-12 * scale)
        assert float(mine.frequency) == float(known.frequency)


def test_the_family_is_the_certified_loop_at_the_design_point(shaken: Case, studied: PeriodicLawStudy) -> None:
    scenario, model, design = shaken
    assert studied.comparison is not None
    vehicle = model.vehicle()
    undelayed = replace(vehicle, actuators=tuple(replace(a, delay=0.0) for a in vehicle.actuators))
    law = PhaseLockedLaw(
        studied.comparison.periodic.gain, design.controller.measured, design.controller.commands, DEPTH
    )
    loop = LawFamily(model, undelayed, law, {})(scenario.operating.speed, DEPTH)
    assert floquet(loop).spectral_radius == pytest.approx(studied.comparison.periodic.spectral_radius, rel=1e-6)


def shifted(gain: FourierMatrix) -> FourierMatrix:
    """The gain a quarter of a girder late."""
    k = np.arange(1, gain.harmonics + 1)[:, None, None]
    turn = np.exp(-0.5j * np.pi * k) * (gain.cosine - 1j * gain.sine)
    return FourierMatrix.of(gain.mean, turn.real, -turn.imag, frequency=gain.frequency)


def test_the_wrong_phase_mutant_of_the_gain_is_caught_by_the_certificate(shaken: Case) -> None:
    scenario, model, design = shaken
    plant, unit = open_plant(model, model.vehicle(), scenario.operating.speed, pade_order=0)
    problem, _ = own_problem(design, plant, at_depth(unit, DEPTH))
    regulator = periodic_lqr(problem)
    assert verify_periodic(problem, regulator.P, regulator.gain).stable
    late = verify_periodic(problem, regulator.P, shifted(regulator.gain))
    assert not late.stable and any("simulated cost" in line for line in late.disagreements)


@pytest.mark.parametrize("wrong", ["sine", "late"])
def test_the_wrong_phase_lock_mutant_of_the_map_is_caught(
    shaken: Case, monkeypatch: pytest.MonkeyPatch, wrong: str
) -> None:
    """A map's loop that carries the gain with another phase than it was designed for is refused, without a plane."""
    _, model, design = shaken
    original = PhaseLockedLaw.close

    def close(self: PhaseLockedLaw, *given: object) -> object:
        return original(replace(self, gain=self.gain.reversed if wrong == "sine" else shifted(self.gain)), *given)  # type: ignore[arg-type]

    monkeypatch.setattr(PhaseLockedLaw, "close", close)
    found, _ = periodic_law_study(model, design, draw=lambda family: pytest.fail("a plane was drawn"), simulate=False)
    assert found is not None and found.plane is None and "as the map closes it" in found.unresolved


def test_the_cross_weight_is_part_of_the_problem(small_scenario: Callable[..., Scenario], small_text: str) -> None:
    """An actuator without lag drives the weighted acceleration directly: cost and gain still those of the option."""
    direct = small_text.replace('bandwidth = "20 Hz"\ndelay = "2 ms"\n', "")
    scenario, model, design = case(small_scenario(direct))
    assert design.weights is not None and np.max(np.abs(design.weights.N)) > 0.0
    plant, unit = open_plant(model, model.vehicle(), scenario.operating.speed, pade_order=0)
    problem, offset = own_problem(design, plant, at_depth(unit, 0.0))
    own = FourierMatrix.of(-design.controller.D - offset, frequency=problem.A.frequency)
    cost = periodic_cost(problem, own)
    assert cost is not None
    scale = np.sqrt(np.diag(design.riccati[0].P))
    np.testing.assert_allclose(
        cost.mean / np.outer(scale, scale), design.riccati[0].P / np.outer(scale, scale), atol=1e-8
    )  # fmt: skip
    found, _ = periodic_law_study(model, design, simulate=False)
    assert found is not None and found.comparison is not None and found.unresolved == ""
    assert found.comparison.constants[0].name.startswith(OWN)
    np.testing.assert_allclose(
        found.comparison.constants[0].gain.mean * scale**-1, -design.controller.D * scale**-1,
        atol=1e-6 * np.max(np.abs(design.controller.D * scale**-1)),
    )  # fmt: skip


def test_the_plane_is_drawn_of_a_family_over_speed_and_depth(shaken: Case) -> None:
    scenario, model, design = shaken
    seen: list[PeriodicFamily] = []
    plane = object.__new__(StabilityPlane)

    def draw(family: PeriodicFamily) -> StabilityPlane:
        seen.append(family)
        return plane

    found, _ = periodic_law_study(model, design, draw=draw, simulate=False)
    assert found is not None and found.plane is plane
    still = seen[0](scenario.operating.speed, 0.0)
    assert not np.any(still.A_cos) and np.max(np.linalg.eigvals(still.A_0).real) < 0.0


@pytest.fixture(scope="module")
def maps(shaken: Case) -> tuple[PeriodicLawStudy, PeriodicLawStudy]:
    """The law with its map over speed and depth, and over depth and speed."""
    scenario, model, design = shaken
    axes = ("speed=370km/h:400km/h:7", "depth=0:0.5:6")
    requests = [map_request(scenario, x=x, y=y, periodic_law=True) for x, y in (axes, axes[::-1])]
    first, second = (_periodic_law(model, request, design, 1)[0] for request in requests)
    assert first is not None and second is not None
    return first, second


def test_the_plane_of_the_law_agrees_with_both_engines(
    shaken: Case, maps: tuple[PeriodicLawStudy, PeriodicLawStudy]
) -> None:
    _, model, design = shaken
    law = maps[0]
    assert law.plane is not None and law.comparison is not None and law.unresolved == ""
    vehicle = slowed_vehicle(model.vehicle())
    measured, commands = design.controller.measured, design.controller.commands
    family = LawFamily(model, vehicle, PhaseLockedLaw(law.comparison.periodic.gain, measured, commands, DEPTH), {})
    for i in (0, 3, 6):
        for j in (1, 5):
            known = floquet(family(float(law.plane.x.values[i]), float(law.plane.y.values[j])))
            assert law.plane.state[i, j] == (STABLE if known.stable else UNSTABLE)
            assert law.plane.growth[i, j] == pytest.approx(known.growth_rate, abs=1e-3)


def test_the_axes_of_the_laws_map_may_be_turned(maps: tuple[PeriodicLawStudy, PeriodicLawStudy]) -> None:
    first, second = maps
    assert first.plane is not None and second.plane is not None
    assert second.plane.x.name == "depth"
    np.testing.assert_array_equal(first.plane.state, second.plane.state.T)
    np.testing.assert_allclose(first.plane.growth, second.plane.growth.T, atol=1e-6)


def test_over_other_quantities_the_law_is_compared_without_a_map(shaken: Case) -> None:
    scenario, model, design = shaken
    request = map_request(scenario, x="speed=370km/h:400km/h:3", y="payload=0t:3t:3", periodic_law=True)
    found, note = _periodic_law(model, request, design, 1)
    assert found is not None and found.comparison is not None and found.plane is None
    assert "over speed and depth only" in note


def test_a_certificate_that_fails_leaves_no_plane(shaken: Case, monkeypatch: pytest.MonkeyPatch) -> None:
    _, model, design = shaken
    monkeypatch.setattr(law_module, "periodic_lqr", lambda problem, simulate: _disturbed(problem))
    found, _ = periodic_law_study(model, design, draw=lambda family: pytest.fail("a plane was drawn"))
    assert found is not None and found.plane is None and "residual" in found.unresolved


def _disturbed(problem: object) -> object:
    """A regulator whose P is a per cent off."""
    good = periodic_lqr(problem)  # type: ignore[arg-type]
    P = good.P.plus(good.P, 0.01)
    return replace(good, P=P, certificate=verify_periodic(good.problem, P, good.gain))


def test_who_gets_no_law_learns_why(shaken: Case, small_scenario: Callable[..., Scenario], small_text: str) -> None:
    _, model, design = shaken
    assert periodic_law_study(model, None) == (None, "No periodic law: the option has no controller.")
    assert "LQG" in periodic_law_study(model, replace(design, law="LQG"))[1]
    _, still, calm = case(small_scenario(small_text.replace("depth = 0.05", "depth = 0.0")))
    assert "zero" in periodic_law_study(still, calm)[1]


def test_the_loop_of_the_periodic_law_has_the_multipliers_of_its_series(shaken: Case) -> None:
    scenario, model, design = shaken
    plant, unit = open_plant(model, model.vehicle(), scenario.operating.speed, pade_order=0)
    problem, _ = own_problem(design, plant, at_depth(unit, DEPTH))
    regulator = periodic_lqr(problem, simulate=False)
    law = PhaseLockedLaw(regulator.gain, plant.states, design.controller.commands, DEPTH)
    loop = floquet(law.close(plant, unit, DEPTH))
    assert loop.spectral_radius == pytest.approx(
        float(np.max(np.abs(loop_multipliers(problem.closed(regulator.gain))))), rel=1e-9
    )
