"""Budgets of counted work: one result on every machine; the found factor whatever the seed; words; exact delays."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from maglev_ctrl.analysis.robustness import (
    DelayedPlant,
    FactorBounds,
    ParameterKind,
    UncertainLoop,
    UncertainParameter,
    Work,
    WorstCase,
    delayed_loop,
    factor_bounds,
    prove_box,
    search,
    stability_range,
    stable_with_exact_delays,
    worst_case,
)
from maglev_ctrl.errors import Agreement, Verdict
from maglev_ctrl.scenario import load
from maglev_ctrl.study import robustness as study
from maglev_ctrl.study.law import designed_option
from maglev_ctrl.systems import Controller, SecondOrderSystem
from maglev_ctrl.vehicle.pade import pade_delay

EFFORT = 1.2e5


def told(record: Any) -> list[Any]:
    """Every number and word of a record, times left out."""
    if isinstance(record, tuple):
        return [told(one) for one in record]
    if is_dataclass(record):
        return [told(getattr(record, one.name)) for one in fields(record) if one.name != "seconds"]
    return [record.tobytes()] if isinstance(record, np.ndarray) else [repr(record)]


def small_plant() -> tuple[SecondOrderSystem, Controller, list[UncertainParameter]]:
    """Two masses in a row, braked by a command that reads one rate."""
    plant = SecondOrderSystem.from_matrices(
        np.diag([1.0, 3.0]), [[0.05, -0.03], [-0.03, 0.04]], [[9.0, -4.0], [-4.0, 6.0]], inputs=("force",),
        B=[[1.0], [0.0]],
    )  # fmt: skip
    controller = Controller.static([[-0.4]], measured=("q1.velocity",), commands=("force",))
    spreads: tuple[tuple[ParameterKind, float], ...] = (("mass", 0.2), ("stiffness", 0.3), ("damping", 0.5))
    return plant, controller, [UncertainParameter(kind, kind, size, ("matrices",)) for kind, size in spreads]


def example(*, effort: float = EFFORT, time_limit: float | None = None) -> tuple[WorstCase, FactorBounds]:
    """A worst case and the bounds of a loop whose proof takes all the work there is."""
    bounds = factor_bounds(mechanics(4, 2, 4), limit=20.0, effort=effort, time_limit=time_limit)
    return worst_case(*small_plant(), effort=effort, time_limit=time_limit), bounds


@contextmanager
def busy(count: int) -> Iterator[None]:
    """Other work on every core."""
    others = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]
    try:
        yield
    finally:
        for one in others:
            one.kill()
            one.wait()


def test_equal_to_the_last_bit_under_load_and_with_a_clock_that_jumps(monkeypatch: pytest.MonkeyPatch) -> None:
    first = example()
    quiet = told(first)
    assert 0.0 < first[1].proven < first[1].found / 1.02  # a proof that the budget ended
    with busy(2):
        assert told(example()) == quiet
    ticks = iter(np.arange(1, 10**6) * 1e4)
    monkeypatch.setattr(time, "perf_counter", lambda: float(next(ticks)))
    assert told(example()) == quiet
    monkeypatch.undo()
    less = factor_bounds(mechanics(4, 2, 4), limit=20.0, effort=0.2 * EFFORT)
    assert told(less) != told(first[1])  # the budget is what ends the search


def test_the_emergency_stop_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    loop = mechanics(4, 2, 4)
    assert "clock" not in factor_bounds(loop, limit=20.0, effort=1e4, time_limit=1e9).reason
    ticks = iter(np.arange(1, 10**6) * 1e4)
    monkeypatch.setattr(time, "perf_counter", lambda: float(next(ticks)))
    worst, bounds = example(time_limit=1e3)
    assert "emergency stop by the clock struck" in worst.reason
    assert "emergency stop by the clock struck" in bounds.reason
    assert worst.stable is not Verdict.PASS
    with pytest.raises(ValueError, match="time_limit: expected a positive time"):
        example(time_limit=0.0)
    with pytest.raises(ValueError, match="limit: expected a positive number of units"):
        example(effort=-1.0)


def mechanics(seed: int, dofs: int, parameters: int) -> UncertainLoop:
    """Lightly damped mechanics under changes of stiffness and damping that follow no symmetry."""
    rng = np.random.default_rng(seed)
    squares = [rng.normal(size=(dofs, dofs)) for _ in range(2)]
    K, C = (size * (X @ X.T / dofs + 0.1 * np.eye(dofs)) for size, X in zip((30.0, 0.3), squares, strict=True))
    zero = np.zeros((dofs, dofs))
    changes = []
    for k in range(parameters):
        q = np.outer(rng.normal(size=dofs), rng.normal(size=dofs))
        share = [[zero, zero], [-3.0 * q, zero]] if k % 2 else [[zero, zero], [zero, -0.1 * q]]
        changes.append(np.block(share))
    return UncertainLoop.from_affine(np.block([[zero, np.eye(dofs)], [-K, -C]]), changes)


def test_the_smallest_combination_does_not_depend_on_the_seed(monkeypatch: pytest.MonkeyPatch) -> None:
    loop = mechanics(4, 4, 9)

    def sizes() -> list[float]:
        found = [search.smallest_crossing(loop, limit=20.0, seed=seed) for seed in range(4)]
        assert all(one is not None for one in found)
        return [one.size for one in found if one is not None]

    full = sizes()
    assert max(full) <= 1.01 * min(full)
    # mutant: drawn corners alone, neighbours and the slopes of the poles left out
    monkeypatch.setattr(search, "_improved", lambda loop, best, *_: best)
    monkeypatch.setattr(search, "modal_corners", lambda loop, sizes: np.ones((1, len(loop.blocks))))
    poor = sizes()
    assert max(poor) > 1.2 * min(full)
    assert min(poor) >= min(full) * (1.0 - 1e-6)


def test_random_loops_hold_what_is_promised() -> None:
    rng = np.random.default_rng(3)
    agreed = 0
    for k in range(15):
        loop = mechanics(100 + k, int(rng.integers(1, 3)), int(rng.integers(1, 4)))
        bounds = factor_bounds(loop, limit=20.0, effort=2e5)
        directions = rng.uniform(-1.0, 1.0, (1000, len(loop.blocks)))
        directions /= np.max(np.abs(directions), axis=1)[:, None]
        assert np.all(search.growth_rates(loop, 0.9999 * bounds.proven * directions) < 0.0)
        if np.isfinite(bounds.found):
            assert bounds.proven <= bounds.found
            over = search.growth_rates(loop, (1.0 + 1e-6) * bounds.changes[None])
            assert over[0] >= 0.0 or search.growth_rates(loop, (1.0 - 1e-6) * bounds.changes[None])[0] >= 0.0
        if len(loop.blocks) == 1:
            exact = stability_range(loop, limit=20.0)
            truth = min(-exact.low, exact.high)
            assert bounds.proven <= truth * (1.0 + 1e-9)
            assert bounds.found == pytest.approx(truth, rel=1e-6) or truth > 20.0
        agreed += bounds.agreement is Agreement.AGREED
    assert agreed >= 10


def test_outcomes_read_clearly() -> None:
    plant = SecondOrderSystem.from_matrices([[1.0]], [[-0.1]], [[4.0]], inputs=("force",), B=[[1.0]])
    thin = Controller.static([[-0.12]], measured=("q1.velocity",), commands=("force",))
    failed = worst_case(plant, thin, [UncertainParameter("eddy drag", "damping", 0.5, ("matrices",))])
    assert failed.stable is Verdict.FAIL
    assert failed.reason.startswith("robustly unstable: already 0.4 of the spreads")
    assert failed.reason.endswith("eddy drag +20 %")
    poor = worst_case(*small_plant(), effort=1.0)  # nothing can be proven with that
    assert poor.stable is Verdict.NOT_EVALUATED
    assert poor.agreement is Agreement.UNRESOLVED
    assert poor.reason.startswith("UNRESOLVED: neither proven stable nor shown unstable within the spreads")
    assert poor.factor.reason.startswith("UNRESOLVED")
    assert prove_box(mechanics(4, 4, 9), factor=0.3, work=Work(1.0)).stable is None


def retarded(order: int, *, gain: float) -> tuple[SecondOrderSystem, Controller, DelayedPlant]:
    """v' = -gain v(t - 1 s), stable exactly for gain < pi/2: with a Pade form inside, and with the delay apart."""
    A, b, c, d = pade_delay(1.0, order)
    zero = [[0.0]]
    inside = SecondOrderSystem.from_matrices(
        [[1.0]], zero, zero, ignorable=("q1",), inputs=("force",), B=[[d]],
        internal=tuple(f"force.delay{i + 1}" for i in range(order)), A_internal=A, B_internal=b[:, None], F=c[None],
    )  # fmt: skip
    apart = SecondOrderSystem.from_matrices([[1.0]], zero, zero, ignorable=("q1",), inputs=("force",), B=[[1.0]])
    controller = Controller.static([[-gain]], measured=("q1.velocity",), commands=("force",))
    return inside, controller, DelayedPlant(apart, np.ones(1))


LATER = UncertainParameter("delay", "actuator_delay", 0.2, ("force",))


def test_the_stability_gate_knows_the_exact_limit_of_a_delay() -> None:
    _, controller, apart = retarded(1, gain=1.0)
    for change, stable in ((0.5 * np.pi - 1.0 - 0.01, True), (0.5 * np.pi - 1.0 + 0.01, False)):
        assert stable_with_exact_delays(delayed_loop(apart, controller, [LATER], [change])) is stable
    with pytest.raises(ValueError, match="cannot fall to zero"):
        delayed_loop(apart, controller, [LATER], [-1.0])
    with pytest.raises(ValueError, match="no command"):
        delayed_loop(apart, controller, [UncertainParameter("other", "actuator_delay", 0.2, ("coil",))], [0.1])


def test_points_found_are_looked_at_again_with_exact_delays() -> None:
    inside, controller, apart = retarded(4, gain=1.0)
    sound = worst_case(inside, controller, [LATER], delayed=apart)
    assert sound.factor.found == pytest.approx((0.5 * np.pi - 1.0) / 0.2, rel=1e-3)
    assert (sound.stable, sound.factor.agreement) == (Verdict.PASS, Agreement.AGREED)
    assert "0.1 % below the found factor stable, 0.1 % above it unstable" in sound.exact_delays
    assert not worst_case(inside, controller, [LATER]).exact_delays
    # A Pade form of first order is stable up to a gain of 2: it passes what the exact delay does not stand.
    inside, controller, apart = retarded(1, gain=1.5)
    blind = worst_case(inside, controller, [LATER])
    assert blind.stable is Verdict.PASS
    assert blind.factor.found == pytest.approx((2.0 / 1.5 - 1.0) / 0.2, rel=1e-6)
    seen = worst_case(inside, controller, [LATER], delayed=apart)
    assert seen.stable is Verdict.FAIL
    assert seen.reason.startswith("with exact delays robustly unstable")
    assert seen.factor.agreement is Agreement.UNRESOLVED
    assert "with exact delays the found combination is not where stability ends" in seen.factor.reason


def test_a_study_hands_over_the_exact_delays(monkeypatch: pytest.MonkeyPatch) -> None:
    scenario = load(Path(__file__).parents[2] / "scenarios" / "compare" / "eds_135t.toml")
    assert scenario.uncertainty is not None
    given: dict[str, Any] = {}
    monkeypatch.setattr(study, "worst_case", lambda *_, **named: given.update(named))
    option = next(one for one in scenario.options if one.name == "active_secondary_skyhook")
    model, design = designed_option(scenario, option)
    assert design is not None
    study.robustness_study(model, design.controller)
    assert np.all(given["delayed"].delays > 0.0)
    assert not any("delay" in name for name in given["delayed"].plant.internal)
    assert "time_limit" not in given  # a report says the same on every machine
