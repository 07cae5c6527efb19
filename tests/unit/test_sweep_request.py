"""Points of a sweep: what may be asked for, and that a point does not depend on who asks for it."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from maglev_ctrl.scenario import load
from maglev_ctrl.study.sweep.block import block_size
from maglev_ctrl.study.sweep.request import sweep_request

WARWICK = "scenarios/compare/warwick_30t.toml"


@pytest.fixture(scope="module")
def scenario():
    return load(WARWICK)


def test_a_grid_has_every_pair_once_the_last_quantity_fastest(scenario):
    request = sweep_request(scenario, grid=["speed=20:150:3", "payload=0:20t:2"])
    speeds, payloads = [20.0, 85.0, 150.0], [0.0, 20000.0]
    assert request.values(0, 6).tolist() == [[v, m] for v in speeds for m in payloads]
    assert request.shape == (3, 2)
    assert request.points == 6


@pytest.mark.parametrize("method", ["random", "latin"])
def test_a_point_is_the_same_in_any_block(scenario, method):
    request = sweep_request(
        scenario, vary=["speed=20:150", "payload=0:20t", "vehicle.car.mass=20t~5%"], points=50, method=method, seed=7
    )
    whole = request.values(0, 50)
    again = pickle.loads(pickle.dumps(request))  # as another process gets it
    parts = np.concatenate([again.values(first, min(first + 7, 50)) for first in range(0, 50, 7)])
    assert np.array_equal(whole, parts)
    other = sweep_request(scenario, vary=["speed=20:150", "payload=0:20t", "vehicle.car.mass=20t~5%"], points=50,
                          method=method, seed=8)  # fmt: skip
    assert not np.array_equal(whole, other.values(0, 50))


def test_a_latin_hypercube_has_one_point_in_each_slice(scenario):
    request = sweep_request(scenario, vary=["speed=20:150", "payload=0:20t"], points=40, method="latin")
    values = request.values(0, 40)
    for k, (low, high) in enumerate(((20.0, 150.0), (0.0, 20000.0))):
        slices = np.floor((values[:, k] - low) / (high - low) * 40)
        assert sorted(slices.tolist()) == list(range(40))
    # the mutant: points drawn one by one leave slices empty
    drawn = sweep_request(scenario, vary=["speed=20:150", "payload=0:20t"], points=40, method="random").values(0, 40)
    assert len(set(np.floor((drawn[:, 0] - 20.0) / 130.0 * 40).tolist())) < 40


def test_drawn_values_have_the_distribution_asked_for(scenario):
    request = sweep_request(scenario, vary=["speed=20:150", "vehicle.car.mass=20t~5%"], points=20_000, method="random")
    speed, mass = request.values(0, 20_000).T
    # four standard errors of a mean and of a standard deviation
    assert abs(np.mean(speed) - 85.0) < 4.0 * 130.0 / np.sqrt(12.0 * 20_000)
    assert abs(np.mean(mass) - 20_000.0) < 4.0 * 1000.0 / np.sqrt(20_000)
    assert abs(np.std(mass) - 1000.0) < 4.0 * 1000.0 / np.sqrt(40_000)
    assert speed.min() >= 20.0
    assert speed.max() <= 150.0
    assert abs(np.corrcoef(speed, mass)[0, 1]) < 4.0 / np.sqrt(20_000)


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({}, "expected either --grid"),
        ({"grid": ["speed=20:150:3"], "vary": ["speed=20:150"]}, "both were given"),
        ({"grid": ["speed=20:150:3"], "points": 5}, "--points belongs to --vary"),
        ({"vary": ["speed=20:150"]}, "expected --points"),
        ({"grid": ["speed=20:150:3", "speed=30:40:3"]}, "speed twice"),
        ({"grid": ["speed=20:150:3", "operating.speed=30:40:3"]}, "speed and operating.speed are one"),
        (
            {"vary": ["vehicle.car.payload=0:1t", "payload=0:2t"], "points": 4},
            "payload and vehicle.car.payload are one",
        ),
        ({"grid": ["speed=20:150:3"], "seed": 3}, "--seed belongs to --vary"),
        ({"grid": ["speed=20:150:3"], "method": "random"}, "--method belongs to --vary"),
        ({"grid": ["spede=20:150:3"]}, 'did you mean "speed"'),
        ({"grid": ["speed=20:150"]}, "--grid: expected QUANTITY=FROM:TO:COUNT"),
        ({"vary": ["speed=20"], "points": 5}, "--vary: expected QUANTITY=FROM:TO"),
        ({"vary": ["speed=20~0"], "points": 5}, "standard deviation above zero"),
        ({"vary": ["speed=20:150"], "points": 10**8}, "--method random has no such limit"),
        ({"grid": ["speed=0:150:3"]}, "speed: expected values above zero"),
        ({"grid": ["vehicle.car.mass=-5t:20t:3"]}, "vehicle.car.mass"),
        ({"grid": ["speed=20:150:3"], "options": ["windings"]}, "--option: unknown option"),
        ({"grid": ["speed=20:150:3"], "parts": ["margin"]}, 'did you mean "margins"'),
        ({"grid": ["depth=0:0.2:3"], "parts": ["modes"]}, "add --compute floquet"),
        ({"grid": ["gain=0.5:2:3"], "options": ["bare"]}, "none of the options has a control law"),
    ],
)
def test_what_cannot_be_meant_is_told_in_one_sentence(scenario, asked, words):
    with pytest.raises(ValueError, match=words.replace("(", r"\(")) as caught:
        sweep_request(scenario, **asked)
    assert "\n" not in str(caught.value)


def test_no_requirement_is_judged_without_the_periodic_forces(scenario):
    """A vehicle that grows under modulation meets nothing, so requirements bring Floquet with them."""
    assert scenario.periodic is not None
    asked = sweep_request(scenario, grid=["speed=20:150:3"], parts=["margins", "requirements"])
    assert asked.parts == ("modes", "floquet", "margins", "requirements")


def test_blocks_are_short_beside_what_their_loss_costs():
    for points, seconds, workers in ((10**6, 0.005, 8), (10**4, 0.2, 2), (100, 0.01, 4), (3, 60.0, 2)):
        size = block_size(points, seconds, workers=workers)
        assert size >= 1
        assert size * seconds <= 2.0 or size == 1
        assert size == 1 or -(-points // size) >= 4 * workers
