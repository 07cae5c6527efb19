"""A whole study: what it decides, that it does not depend on processes, and that nothing is dropped."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from maglev_ctrl.analysis.modes import modes
from maglev_ctrl.errors import Agreement, ModelError, ScenarioError, Verdict
from maglev_ctrl.scenario import Scenario
from maglev_ctrl.study import Comparison, OptionStudy, run

GRAVITY = 9.80665
Read = Callable[..., Scenario]


@pytest.fixture(scope="module")
def comparison(small_scenario: Read) -> Comparison:
    return run(small_scenario())


def option(comparison: Comparison, name: str) -> OptionStudy:
    return next(one for one in comparison.options if one.name == name)


def verdict(study: OptionStudy, requirement: str) -> Verdict:
    return next(r.verdict for r in study.requirements if r.name == requirement)


def value(study: OptionStudy, requirement: str) -> float:
    return next(r.value for r in study.requirements if r.name == requirement)


def test_every_requirement_is_judged_for_every_option(comparison: Comparison) -> None:
    for study in comparison.options:
        assert [r.name for r in study.requirements] == ["stable", "damping", "disk", "phase", "modulation", "overspeed"]
        assert all(r.reason for r in study.requirements if r.verdict is not Verdict.PASS)


def test_the_bare_vehicle_fails_because_of_its_magnets(comparison: Comparison) -> None:
    bare = option(comparison, "bare")
    assert bare.verdict is Verdict.FAIL
    assert verdict(bare, "stable") is Verdict.FAIL
    # no element, no loop: nothing to break, and that is said, not passed over
    assert verdict(bare, "disk") is Verdict.NOT_EVALUATED
    assert verdict(bare, "modulation") is Verdict.FAIL
    assert verdict(bare, "overspeed") is Verdict.FAIL


def test_growth_of_the_bare_vehicle_is_the_receding_image_damping(comparison: Comparison) -> None:
    """Two masses by hand: K_1 = mg/z0, damping -F w (v^2-w^2)/(v^2+w^2)^2 at the bogie, F = mg (v^2+w^2)/v^2."""
    w = 2.0 / (4e-7 * np.pi * 2.5e7 * 0.02)
    v, weight = 300.0 / 3.6, 13e3 * GRAVITY
    damping = -weight * (v**2 + w**2) / v**2 * w * (v**2 - w**2) / (v**2 + w**2) ** 2
    k, k_2 = weight / 0.1, 250e3
    M, C = np.diag([10e3, 3e3]), np.diag([0.0, damping])
    K = np.array([[k_2, -k_2], [-k_2, k_2 + k]])
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
    study = option(comparison, "bare")
    assert study.modes is not None
    assert study.modes.spectral_abscissa == pytest.approx(np.max(np.linalg.eigvals(A).real), rel=1e-9)
    flipped = np.block([[np.zeros((2, 2)), np.eye(2)], [-np.linalg.solve(M, K), np.linalg.solve(M, C)]])
    assert np.max(np.linalg.eigvals(flipped).real) < 0.0  # the mutant with the sign of the damping flipped


def test_the_damper_passes(comparison: Comparison) -> None:
    study = option(comparison, "damper")
    assert [r.verdict for r in study.requirements] == [Verdict.PASS] * 6
    assert study.margins is not None and study.margins.verified


def test_the_law_is_certified_and_closes_the_loop(comparison: Comparison) -> None:
    study = option(comparison, "active")
    assert study.design is not None and study.system is not None
    assert study.design.certificate.agreed is Agreement.AGREED
    assert study.design.certificate.stable
    assert modes(study.system).stable
    assert study.open_system is not None and not modes(study.open_system).stable
    assert study.notes == ()


def test_root_locus_ends_of_fading_are_the_bare_and_the_designed_vehicle(comparison: Comparison) -> None:
    study = option(comparison, "damper")
    assert study.locus is not None and study.modes is not None
    as_designed = study.locus.s[int(np.argmin(np.abs(study.locus.gain - 1.0)))]
    assert np.max(as_designed.real) == pytest.approx(study.modes.spectral_abscissa, rel=1e-9)
    bare = option(comparison, "bare")
    assert bare.modes is not None
    assert np.max(study.locus.s[0].real) == pytest.approx(bare.modes.spectral_abscissa, rel=1e-6)


def test_nyquist_curve_of_one_channel_is_its_return_ratio(comparison: Comparison) -> None:
    """A damper c on the stroke of two masses: L = c s (stroke per force), by hand from M, C, K."""
    study = option(comparison, "damper")
    bare = option(comparison, "bare")
    assert bare.system is not None
    (curve,) = study.nyquist
    k = len(curve.frequency) // 2
    s = 1j * curve.frequency[k]
    across = np.array([1.0, -1.0])
    receptance = np.linalg.inv(bare.system.M * s**2 + bare.system.C * s + bare.system.K)
    assert curve.response[k] == pytest.approx(30e3 * s * (across @ receptance @ across), rel=1e-9)


def test_periodic_forcing_of_the_bare_vehicle_is_unstable_and_of_the_damped_one_is_not(comparison: Comparison) -> None:
    bare, damped = option(comparison, "bare").floquet, option(comparison, "damper").floquet
    assert bare is not None and damped is not None
    assert bare.worst_depth == 0.0
    assert damped.at_design.agreement is Agreement.AGREED and damped.at_design.stable
    assert damped.open_loop is not None and damped.open_loop.stable is False
    assert value(option(comparison, "damper"), "modulation") >= 2.0


def test_two_processes_give_what_one_gives(comparison: Comparison, small_scenario: Read) -> None:
    heard: list[float] = []
    again = run(small_scenario(), jobs=2, progress=lambda what, fraction: heard.append(fraction))
    assert heard[0] == 0.0 and heard[-1] == 1.0 and heard == sorted(heard)
    for one, other in zip(comparison.options, again.options, strict=True):
        assert one.name == other.name
        assert [r.verdict for r in one.requirements] == [r.verdict for r in other.requirements]
        np.testing.assert_array_equal(
            [r.value for r in one.requirements], [r.value for r in other.requirements]
        )  # bit for bit, NaN included


def test_an_option_that_cannot_be_studied_keeps_its_requirements(
    small_scenario: Read, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise ModelError("the car stands on nothing")

    monkeypatch.setattr("maglev_ctrl.study.option.designed_option", refuse)
    study = option(run(small_scenario()), "active")
    assert study.failure == "the car stands on nothing"
    assert study.verdict is Verdict.NOT_EVALUATED
    assert [r.reason for r in study.requirements] == ["the car stands on nothing"] * 6


def test_a_requirement_without_its_sweep_is_not_evaluated(small_scenario: Read, small_text: str) -> None:
    text = small_text.replace('quantity = "damping_ratio"', 'quantity = "damping_ratio"\nover = "height"')
    try:
        study = option(run(small_scenario(text)), "damper")
    except ScenarioError as fault:
        assert "height" in str(fault)  # refused at the border, where it can be mended
    else:
        assert verdict(study, "damping") is Verdict.NOT_EVALUATED


def test_jobs_below_one_are_refused(small_scenario: Read) -> None:
    with pytest.raises(ValueError, match="jobs"):
        run(small_scenario(), jobs=0)
