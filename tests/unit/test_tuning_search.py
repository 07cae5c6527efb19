"""The search against fronts that are known, the knee against a curve whose knee is known."""

from dataclasses import dataclass

import numpy as np
import pytest
from pymoo.indicators.hv import HV

from maglev_ctrl.study.tuning.knee import knee
from maglev_ctrl.study.tuning.search import non_dominated, search


@dataclass
class Found:
    score: np.ndarray
    total: float = 0.0


def zdt1(x):
    """Front: f2 = 1 - sqrt(f1), where all variables but the first are zero (Zitzler, Deb & Thiele 2000)."""
    g = 1.0 + 9.0 * float(np.mean(x[1:]))
    return Found(np.array([x[0], g * (1.0 - np.sqrt(x[0] / g))]))


def damper(x):
    """Suspension of one mass on white velocity: clearance falls as 1/c, the damper's force rises with c.

    E[(z - w)^2] = S m / (2 c) on a spring k, E[force^2] proportional to c + m k / c; both known in closed form.
    """
    c = 10.0 ** (2.0 * x[0])
    return Found(np.array([1.0 / c, 0.01 * c + 1.0 / c]))


def run(assess, **changes):
    budget = {"upper": [1.0] * 3, "integral": [False] * 3, "objectives": 2, "population": 24, "generations": 60}
    return search(assess, **budget | {"seed": 1} | changes)


def scores(found, assess):
    return np.array([assess(tuple(found.places[i])).score for i in found.population])


def test_a_known_front_is_reached():
    found = run(zdt1)
    front = scores(found, zdt1)
    assert found.stopped == "generations" and found.generations == 60 and len(found.places) > 800
    exact = 1.1 * 1.1 - 1.0 / 3.0  # what the front 1 - sqrt(f1) dominates below (1.1, 1.1)
    reached = HV(ref_point=np.array([1.1, 1.1]))(front)
    assert 0.97 * exact < reached <= exact * (1.0 + 1e-12)
    assert np.max(np.abs(front[:, 1] - (1.0 - np.sqrt(front[:, 0])))) < 0.03


def test_random_places_of_the_same_number_do_not_reach_it():
    """The mutant of the test above: without breeding the same number of candidates stays away from the front."""
    draw = np.random.default_rng(1).random((1440, 3))
    front = np.array([zdt1(x).score for x in draw])
    reached = HV(ref_point=np.array([1.1, 1.1]))(front[list(non_dominated(front))])
    assert reached < 0.97 * (1.1 * 1.1 - 1.0 / 3.0)


def test_trade_off_of_a_damper():
    """Every damping below sqrt(mk) is dominated: less of it is worse in both. The front starts at c = 10."""
    found = search(damper, upper=[1.0], integral=[False], objectives=2, population=16, generations=20, seed=3)
    kept = 10.0 ** (2.0 * found.places[list(found.population), 0])
    assert np.min(kept) == pytest.approx(10.0, rel=0.05) and np.max(kept) == pytest.approx(100.0, rel=0.01)


def test_the_same_seed_gives_the_same_candidates_and_another_gives_others():
    one, again, other = (run(zdt1, generations=6, seed=seed) for seed in (1, 1, 2))
    assert np.array_equal(one.places, again.places) and one.population == again.population
    assert not np.array_equal(one.places[:24], other.places[:24])


def test_the_world_of_random_numbers_outside_does_not_matter():
    np.random.seed(5)  # noqa: NPY002
    one = run(zdt1, generations=5)
    np.random.seed(6)  # noqa: NPY002
    assert np.array_equal(one.places, run(zdt1, generations=5).places)


def test_missed_requirements_come_after_all_others():
    """Only f1 >= 0.5 is allowed: the survivors meet it and end at its edge."""

    def assess(x):
        return Found(zdt1(x).score, max(0.5 - x[0], 0.0))

    found = run(assess, generations=40)
    first = found.places[list(found.population), 0]
    assert np.min(first) >= 0.5 and np.min(first) < 0.52


def test_no_objectives_where_requirements_are_missed():
    def assess(x):
        return Found(np.full(2, np.nan), 1.0) if x[0] < 0.5 else zdt1(x)

    found = run(assess, generations=10)
    assert np.all(found.places[list(found.population), 0] >= 0.5)


def test_whole_numbers():
    def assess(x):
        assert float(x[0]).is_integer()
        return Found(np.array([abs(x[0] - 2.0) + x[1], 1.0 - x[1]]))

    found = run(assess, upper=[4.0, 1.0], integral=[True, False], generations=12)
    assert {float(x) for x in found.places[:, 0]} == {0.0, 1.0, 2.0, 3.0, 4.0}
    assert np.all(found.places[list(found.population), 0] == 2.0)


def test_the_start_is_among_the_first():
    found = run(zdt1, generations=1, start=[0.123, 0.456, 0.789])
    assert found.places[0].tolist() == [0.123, 0.456, 0.789]


def test_time_limit_ends_between_two_candidates():
    found = run(zdt1, time_limit=0.0)
    assert found.stopped == "time limit" and len(found.places) == 1 and found.population == (0,)


def test_progress_and_interruption():
    told = []

    def tell(generation, evaluations):
        told.append((generation, evaluations))
        if generation == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(zdt1, tell=tell)
    assert [generation for generation, _ in told] == [1, 2, 3]


def test_nothing_to_search():
    with pytest.raises(ValueError, match="expected a variable"):
        run(zdt1, upper=[], integral=[])


# ------------------------------------------------------------------------------------------------------- knee
def test_knee_of_known_curves():
    """x^p + y^p = 1 bends towards the ideal point for p < 1; its knee is where x = y. A skewed one has it elsewhere."""
    x = np.linspace(0.0, 1.0, 2001)
    even = np.column_stack([x, (1.0 - np.sqrt(x)) ** 2])
    assert even[knee(even)] == pytest.approx([0.25, 0.25], abs=1e-3)
    skewed = np.column_stack([x, (1.0 - x) ** 4])  # farthest from the chord where the slope is -1: 4 (1 - x)^3 = 1
    assert skewed[knee(skewed), 0] == pytest.approx(1.0 - 0.25 ** (1.0 / 3.0), abs=1e-3)


def test_knee_does_not_depend_on_units():
    x = np.linspace(0.0, 1.0, 201)
    front = np.column_stack([x, (1.0 - x) ** 4])
    assert knee(front) == knee(front * [1e6, 1e-3] + [7.0, -2.0])


def test_knee_is_not_the_far_side():
    """A front that bends away from the ideal point has no knee inside: an end is returned, not the bulge."""
    x = np.linspace(0.0, 1.0, 101)
    assert knee(np.column_stack([x, np.sqrt(1.0 - x**2)])) in (0, 100)


def test_knee_in_three_objectives():
    """On sqrt(x) + sqrt(y) + sqrt(z) = 1 the point with all three equal is the knee."""
    u, v = np.meshgrid(np.linspace(0.0, 1.0, 61), np.linspace(0.0, 1.0, 61))
    inside = u + v <= 1.0 + 1e-12
    roots = np.column_stack([u[inside], v[inside], np.maximum(1.0 - u[inside] - v[inside], 0.0)])
    assert roots[knee(roots**2)] == pytest.approx([1 / 3] * 3, abs=0.02)


def test_knee_of_small_and_flat_fronts():
    assert knee(np.array([[1.0, 2.0]])) == 0
    assert knee(np.array([[1.0, 5.0], [2.0, 5.0]])) == 0  # the second objective does not vary
    assert knee(np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.4, 0.4, 0.0]])) == 2  # nor does the third
    with pytest.raises(ValueError, match="finite rows"):
        knee(np.array([[np.nan, 1.0]]))


def test_non_dominated():
    score = np.array([[0.0, 3.0], [1.0, 1.0], [1.0, 2.0], [3.0, 0.0], [1.0, 1.0]])
    assert non_dominated(score) == (0, 1, 3)
