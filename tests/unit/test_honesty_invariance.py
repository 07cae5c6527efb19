"""The same physics in other units, coordinates, orders and processes: the same verdicts, figures to stated digits."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import design_fixture
import numpy as np
import pytest

sys.path.append(str(Path(__file__).resolve().parents[1] / "hold"))

import stress_child
import stress_invariance
from threadpoolctl import threadpool_limits

from maglev_ctrl.analysis.modes import modes
from maglev_ctrl.report.serialise import to_plain
from maglev_ctrl.scenario import Scenario
from maglev_ctrl.study.law import designed_option
from maglev_ctrl.study.option import study_option
from maglev_ctrl.study.run import run
from maglev_ctrl.systems import SecondOrderSystem

VEHICLE, _, _ = design_fixture.VEHICLE.partition("sweep.speed")
BARE = '\n[[option]]\nname = "bare"\nkind = "baseline"\n'
REQUIREMENT = '\n[[requirement]]\nname = "no_growth"\nquantity = "growth_rate"\nat_most = "0 1/s"\nover = "nominal"\n'
TEXT = VEHICLE + BARE + design_fixture.LQR + REQUIREMENT
CHANGING = ("seconds", "created", "versions", "scenario_path")
OTHER_UNITS = (
    ('mass = "24 t"', 'mass = "24000 kg"'),
    ('mass = "6 t"', 'mass = "6000000 g"'),
    ('"0.75 MN/m"', '"750 N/mm"'),
    ('"135 m/s"', '"486 km/h"'),
    ('"98.07 mm"', '"9.807 cm"'),
    ('"20 mm"', '"2 cm"'),
    ('"8 m"', '"8000 mm"'),
    ('"20 kN"', '"0.02 MN"'),
    ('"2 ms"', '"0.002 s"'),
    ('"10 mm"', '"0.01 m"'),
    ('"8 kN"', '"8000 N"'),
)


def kept(value: Any) -> Any:
    """A record without what changes from run to run."""
    if isinstance(value, dict):
        return {key: kept(one) for key, one in value.items() if key not in CHANGING}
    return [kept(one) for one in value] if isinstance(value, list) else value


def option_of(scenario: Scenario, name: str) -> Any:
    return next(one for one in scenario.options if one.name == name)


def test_other_units_of_the_same_physics_change_no_verdict_and_nine_digits_stay(tmp_path: Path) -> None:
    """Conversions round once or twice, 2e-16; a dense eigenvalue problem of condition below 1e4 keeps eleven digits,
    the Riccati equation of these weights two fewer."""
    text = TEXT
    for one, other in OTHER_UNITS:
        assert one in text, one
        text = text.replace(one, other)
    first, second = design_fixture.read(TEXT, tmp_path), design_fixture.read(text, tmp_path)
    for name in ("bare", "lqr"):
        before, after = (study_option(one, option_of(one, name)) for one in (first, second))
        assert before.verdict is after.verdict and before.modes is not None and after.modes is not None
        assert before.modes.verdict is after.modes.verdict and before.modes.labels == after.modes.labels
        size = float(np.max(np.abs(before.modes.s)))
        assert np.max(np.abs(before.modes.s - after.modes.s)) <= 1e-11 * size
        if before.design is not None and after.design is not None:
            np.testing.assert_allclose(before.design.controller.D, after.design.controller.D, rtol=1e-9)
            assert before.design.status is after.design.status
    heavier = design_fixture.read(TEXT.replace('mass = "24 t"', 'mass = "24.001 t"'), tmp_path)
    moved = study_option(heavier, option_of(heavier, "bare"))
    assert moved.modes is not None and np.max(np.abs(moved.modes.s - before.modes.s[: len(moved.modes.s)])) > 1e-11


def coupled() -> SecondOrderSystem:
    """Four unlike coordinates, coupled, gyroscopic and damped, one mode lightly."""
    random = np.random.default_rng(4)
    T = random.standard_normal((4, 4))
    M, G = T @ T.T + np.eye(4), random.standard_normal((4, 4))
    K = np.diag([4.0, 30.0, 110.0, 400.0]) + 0.5 * (T + T.T)
    return SecondOrderSystem.from_matrices(M, 1e-4 * K + 0.2 * (G - G.T), K, dofs=("heave", "pitch", "sway", "roll"))


def changed(system: SecondOrderSystem, T: np.ndarray, names: tuple[str, ...]) -> SecondOrderSystem:
    """The system in coordinates q = T p."""
    return SecondOrderSystem.from_matrices(*(T.T @ X @ T for X in (system.M, system.C, system.K)), dofs=names)


@pytest.mark.parametrize("change", ["order", "mirror", "powers of two", "wild units"])
def test_other_coordinates_give_the_same_modes(change: str) -> None:
    """Exact changes (order, signs, powers of two) move eigenvalues by what rounding in another order does, within their
    own error bounds; so do units of 1e-6 to 1e6, which round every entry once more."""
    system, order = coupled(), [2, 0, 3, 1]
    T = {
        "order": np.eye(4)[:, order], "mirror": np.diag([1.0, 1.0, -1.0, -1.0]),
        "powers of two": np.diag(2.0 ** np.array([20.0, -20.0, 3.0, -7.0])),
        "wild units": np.diag([1e6, 1e-6, 39.37007874, 0.3048]),
    }[change]  # fmt: skip
    names = tuple(system.dofs[i] for i in order) if change == "order" else system.dofs
    before, after = modes(system), modes(changed(system, T, names))
    assert before.verdict is after.verdict and before.kind == after.kind and before.labels == after.labels
    assert np.all(np.abs(before.s - after.s) <= before.error_bound + after.error_bound)
    assert np.max(after.error_bound) < 1e-9 * np.max(np.abs(after.s))  # and these bounds say something


def test_the_order_of_options_and_the_number_of_processes_change_not_one_bit(tmp_path: Path) -> None:
    first = design_fixture.read(TEXT, tmp_path)
    second = design_fixture.read(VEHICLE + design_fixture.LQR + BARE + REQUIREMENT, tmp_path)
    runs = [run(first), run(second, jobs=2)]
    told = [{one["name"]: json.dumps(kept(one)) for one in to_plain(found)["options"]} for found in runs]
    assert list(told[0]) == ["bare", "lqr"] and list(told[1]) == ["lqr", "bare"]
    assert told[0] == told[1]


def test_another_process_another_kernel_other_threads_and_another_locale() -> None:
    """Bit for bit where nothing but the process changes; to the digits of the conditioning with other kernels."""
    with threadpool_limits(limits=1):
        base = stress_child.answers()
    again = stress_invariance.child({"PYTHONHASHSEED": "7", "TZ": "Asia/Tokyo", "LC_ALL": "C"})
    assert again is not None
    words, held = stress_invariance.difference(base, again, bitwise=True)
    assert held, words
    other = stress_invariance.child({
        "OPENBLAS_CORETYPE": "Nehalem", "OPENBLAS_NUM_THREADS": "2", "OMP_NUM_THREADS": "2",
    })  # fmt: skip
    if other is not None:
        words, held = stress_invariance.difference(base, other, bitwise=False)
        assert held, words
    wrong = {**base, "modes": {**base["modes"], "figures": [1.001 * x for x in base["modes"]["figures"]]}}
    assert not stress_invariance.difference(base, wrong, bitwise=False)[1]


def test_a_law_is_the_same_law_twice(tmp_path: Path) -> None:
    scenario = design_fixture.read(TEXT, tmp_path)
    laws = [designed_option(scenario, option_of(scenario, "lqr"))[1] for _ in range(2)]
    assert laws[0] is not None and laws[1] is not None
    assert np.array_equal(laws[0].controller.D, laws[1].controller.D)
