"""A design document: read back to the last bit, proved again from itself alone, and refused once tampered with."""

from __future__ import annotations

import copy
import json
import subprocess
import sys
from typing import Any

import numpy as np
import pytest

from maglev_ctrl.errors import ModelError
from maglev_ctrl.proofs.claims import DecayClaim, EllipsoidClaim, ParameterClaim, RegionClaim, SegmentClaim
from maglev_ctrl.proofs.file import DesignFile, Schedule, from_document, recheck, to_document
from maglev_ctrl.proofs.makers import bounded_real_claim, energy_claim, lyapunov_claim
from maglev_ctrl.systems import Controller
from maglev_ctrl.systems.plant import Plant, plant_fields


def design() -> DesignFile:
    plants = tuple(
        Plant.from_matrices(
            [[0.0, 1.0], [k, -0.1]], [[0.0], [1.0]], [[0.0], [1.0]], [[1.0, 0.0]], name=f"{k:g}",
            states=("gap", "gap.velocity"), commands=("force",),
        )
        for k in (1.0, 1.2)
    )  # fmt: skip
    law = Controller.static(
        [[-4.0 / 3.0, -1.1]], measured=plants[0].measured, commands=plants[0].commands, name="state feedback"
    )
    A = plants[0].A + plants[0].B2 @ law.D
    claims = (
        lyapunov_claim(plants, [law], rate=0.1),
        bounded_real_claim(plants[0], law, 3.002),
        energy_claim(plants[0], law, 2.0),
        EllipsoidClaim((0,), (0,), lyapunov_claim(plants[:1], [law]).P, (100.0,)),
        RegionClaim(
            (0,), (0,), "left half plane", np.zeros((1, 1)), np.ones((1, 1)),
            np.linalg.inv(lyapunov_claim(plants[:1], [law]).P),
        ),
        SegmentClaim((0, 0), (0, 0), np.repeat(lyapunov_claim(plants[:1], [law]).P, 2, axis=0), 1.0, 0.1),
    )  # fmt: skip
    assert np.linalg.eigvals(A).real.max() < -0.1
    return DesignFile(
        "hover", "h_infinity", plants, (law,), claims, created="2026-01-01", versions={"maglev_ctrl": "0"},
        scenario={"text": "a = 1\n"}, performance=({"quantity": "H-infinity norm", "reported": float("nan")},),
        notes=("one",), extra={"anything": [1, {"goes": np.float64(0.5)}]},
    )  # fmt: skip


def written() -> dict[str, Any]:
    found: dict[str, Any] = json.loads(json.dumps(to_document(design()), allow_nan=False))
    return found


def test_read_back_to_the_last_bit() -> None:
    first, again = design(), from_document(written())
    for one, other in zip(first.plants, again.plants, strict=True):
        assert all(np.array_equal(getattr(one, key), getattr(other, key)) for key in plant_fields())
        assert (one.states, one.commands, one.name, one.dt) == (other.states, other.commands, other.name, other.dt)
    assert np.array_equal(first.controllers[0].D, again.controllers[0].D)
    assert [type(one) for one in first.claims] == [type(one) for one in again.claims]
    assert np.array_equal(first.claims[0].P, again.claims[0].P)  # type: ignore[union-attr]
    assert again.extra == {"anything": [1, {"goes": 0.5}]} and again.performance[0]["reported"] is None
    assert to_document(again) == written()
    assert all(proof.holds for proof in recheck(again)), [proof.reason for proof in recheck(again)]
    assert [proof.statement for proof in recheck(again)] == [proof.statement for proof in recheck(first)]


def test_dynamic_sampled_and_scheduled() -> None:
    plant = Plant.from_matrices([[0.5]], [[1.0]], [[1.0]], [[1.0]], dt=0.1)
    laws = tuple(
        Controller.from_matrices([[0.1]], [[1.0]], [[k]], [[0.0]], measured=("x1",), commands=("u1",), dt=0.1)
        for k in (0.1, 0.2)
    )
    claim = lyapunov_claim([plant, plant], laws)
    made = DesignFile("s", "l", (plant, plant), laws, (claim,), schedule=Schedule("speed", "m/s", (10.0, 20.0)))
    again = from_document(json.loads(json.dumps(to_document(made))))
    assert again.schedule is not None and again.schedule.nodes == (10.0, 20.0)
    assert all(proof.holds for proof in recheck(again))
    broken = to_document(made)
    broken["schedule"]["nodes"] = [20.0, 10.0]
    with pytest.raises(ModelError, match=r"schedule\.nodes"):
        from_document(broken)


def test_parameter_claim_and_empty_matrices() -> None:
    plant = Plant.from_matrices([[-1.0]], np.zeros((1, 0)), np.zeros((1, 0)), np.zeros((0, 1)))
    law = Controller.static(np.zeros((0, 1)), measured=("x1",), commands=())
    claims = (
        ParameterClaim((0,), (0,), 0.2, np.ones((1, 1, 1)), np.full((1, 1), 0.55)),
        DecayClaim((0,), (0,), 0.9, np.ones((1, 1, 1))),
    )
    again = from_document(json.loads(json.dumps(to_document(DesignFile("e", "l", (plant,), (law,), claims)))))
    assert again.plants[0].B1.shape == (1, 0) and again.plants[0].C1.shape == (0, 1)
    assert [proof.holds for proof in recheck(again)] == [True, True]


@pytest.mark.parametrize(
    ("claim", "path", "value"),
    [
        (0, ("controllers", 0, "D", 0, 1), 1.1),  # one gain flipped
        (1, ("controllers", 0, "D", 0, 0), -1.3),  # one gain changed by 2.5 %
        (0, ("plants", 1, "A", 1, 0), 9.0),
        (0, ("claims", 0, "P", 0, 0, 1), 9.0),
        (0, ("claims", 0, "rate"), 0.6),
        (1, ("claims", 1, "gamma"), 2.9),
        (1, ("claims", 1, "P", 0, 1, 1), 99.0),
        (1, ("plants", 0, "B1", 1, 0), 1.01),
        (1, ("plants", 0, "C1", 0, 0), -1.01),
        (2, ("claims", 2, "level"), 1.0),
        (3, ("claims", 3, "limits", 0), 0.5),
        (4, ("claims", 4, "M", 0, 0), -1.0),
        (5, ("claims", 5, "P", 1, 0, 0), 50.0),
    ],
)
def test_tampered_documents_are_not_proved(claim: int, path: tuple[Any, ...], value: float) -> None:
    document = written()
    assert recheck(from_document(document))[claim].holds
    place = document
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    proof = recheck(from_document(document))[claim]
    assert not proof.holds and proof.reason


@pytest.mark.parametrize(
    ("path", "value", "said"),
    [
        (("format",), "design 2", "format: expected 'maglev_ctrl design 1', got 'design 2'"),
        (("plants", 0, "A"), [[1.0]], r"plants\[0\].A: expected 2 rows of 2 numbers"),
        (("plants", 0, "A", 0, 0), "1", r"plants\[0\].A: expected a number, got '1'"),
        (("plants", 0, "A", 0, 0), True, r"plants\[0\].A: expected a number, got True"),
        (("plants", 0, "A", 0, 0), float("nan"), "finite"),
        (("plants", 0, "A", 0, 0), 2**53 + 1, "finite double-precision"),
        (("plants", 0, "dt"), 0.0, "positive sampling period"),
        (("plants", 0, "states"), ["gap", "gap"], "a name stands twice"),
        (("controllers", 0, "D"), None, r"controllers\[0\].D: expected a list"),
        (("claims", 0, "kind"), "faith", r"claims\[0\].kind: expected one of decay"),
        (("claims", 0, "plants"), [0, 7], "whole numbers below 2, got 7"),
        (("claims", 0, "plants"), [0], "as many plants as controllers"),
        (("claims", 0, "P"), [], "one or more square matrices"),
        (("claims", 0, "cross"), 0, "true or false"),
        (("claims", 0, "rate"), None, "expected a number, got None"),
        (("notes",), "one", "notes: expected a list"),
    ],
)
def test_faults_are_named(path: tuple[Any, ...], value: Any, said: str) -> None:
    document = written()
    place = document
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    with pytest.raises(ModelError, match=said):
        from_document(document)


def test_missing_and_unknown_keys_are_named() -> None:
    document = written()
    for path in ((), ("plants", 0), ("controllers", 0), ("claims", 0)):
        for key in list(_at(document, path)):
            if key in ("format", "kind"):
                continue
            broken = copy.deepcopy(document)
            del _at(broken, path)[key]
            with pytest.raises(ModelError, match=f"the key '{key}' is missing"):
                from_document(broken)
        broken = copy.deepcopy(document)
        _at(broken, path)["surplus"] = 1
        with pytest.raises(ModelError, match="the key 'surplus' is unknown"):
            from_document(broken)
    with pytest.raises(ModelError, match="keys with values"):
        from_document([])


def _at(document: dict[str, Any], path: tuple[Any, ...]) -> dict[str, Any]:
    place: Any = document
    for key in path:
        place = place[key]
    found: dict[str, Any] = place
    return found


def test_proving_again_needs_no_solver() -> None:
    code = "import sys, maglev_ctrl.proofs.file; print(sorted({name.split('.')[0] for name in sys.modules}))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not {"scipy", "cvxpy", "clarabel", "osqp", "control"} & set(eval(done.stdout))
