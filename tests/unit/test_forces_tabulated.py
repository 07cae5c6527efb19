from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from maglev_ctrl.errors import OutOfDomain
from maglev_ctrl.forces import ImageForce, MagnetDerivatives, MagnetForces, TabulatedForce

HEIGHT = np.linspace(0.008, 0.04, 9)
GAP = np.linspace(0.004, 0.02, 6)
SPEED = np.linspace(20.0, 60.0, 5)
METHODS = ["spline", "polynomial"]


def truth(h: Any, g: Any, v: Any) -> tuple[NDArray[np.float64], ...]:
    """Smooth stand-in forces of the right signs, N."""
    lift = 8.0 * np.exp(-(h - 0.008) / 0.012) * (1 + 0.1 * g / 0.02) * v**2 / (v**2 + 400.0)
    guidance = 4.0 * np.exp(-g / 0.01) * (1 + 5.0 * h / 0.04) * np.exp(-h / 0.03) * v**2 / (v**2 + 400.0)
    return lift, guidance, 20.0 * (lift + guidance) / v


def grid() -> dict[str, Any]:
    lift, guidance, drag = truth(HEIGHT[:, None, None], GAP[:, None], SPEED)
    return {"height": HEIGHT, "gap": GAP, "speed": SPEED, "lift": lift, "guidance": guidance, "drag": drag}


def rows() -> dict[str, Any]:
    places = [one.ravel() for one in np.meshgrid(HEIGHT, GAP, SPEED, indexing="ij")]
    return dict(zip(("height", "gap", "speed", "lift", "guidance", "drag"), [*places, *truth(*places)], strict=True))


SPLINE = TabulatedForce.from_samples(**grid())
POLYNOMIAL = TabulatedForce.from_samples(**rows(), method="polynomial", degree=5)
TABLES = {"spline": SPLINE, "polynomial": POLYNOMIAL}


def parts(forces: MagnetForces) -> NDArray[np.float64]:
    return np.array([forces.lift, forces.guidance, forces.drag])


@settings(deadline=None, max_examples=60)
@given(
    method=st.sampled_from(METHODS),
    h=st.floats(0.009, 0.039),
    g=st.floats(0.005, 0.019),
    v=st.floats(21.0, 59.0),
)
def test_partials_are_the_central_differences(method: str, h: float, g: float, v: float) -> None:
    table, at = TABLES[method], np.array([h, g, v])
    partials = table.derivatives(h, g, v)
    for axis, (exact, width) in enumerate(
        [(partials.by_height, 0.032), (partials.by_gap, 0.016), (partials.by_speed, 40.0)]
    ):
        step = np.zeros(3)
        step[axis] = 1e-5 * width
        numeric = (parts(table.forces(*(at + step))) - parts(table.forces(*(at - step)))) / (2e-5 * width)
        # a cubic's third derivative may jump between the two points: the error is then of second order in the step
        np.testing.assert_allclose(parts(exact), numeric, rtol=0, atol=1e-6 / width)


@pytest.mark.parametrize("method", METHODS)
def test_a_swapped_axis_mutant_is_caught(method: str) -> None:
    partials = TABLES[method].derivatives(0.02, 0.01, 40.0)
    assert abs(float(partials.by_height.lift - partials.by_gap.lift)) > 1.0
    assert abs(float(partials.by_height.guidance - partials.by_gap.guidance)) > 1.0


def test_a_spline_goes_through_its_samples_and_predicts_between_them() -> None:
    assert parts(SPLINE.quality.residual_max).max() < 1e-12
    h, g, v = 0.0217, 0.0093, 37.0
    np.testing.assert_allclose(parts(SPLINE.forces(h, g, v)), truth(h, g, v), rtol=2e-3)
    assert SPLINE.quality.check == "halved grid"
    assert SPLINE.quality.check_max is not None
    # the check is pessimistic: it bounds what the full grid gets wrong at the middle of the cells
    middles = [(axis[1:] + axis[:-1]) / 2 for axis in (HEIGHT, GAP, SPEED)]
    places = np.meshgrid(*middles, indexing="ij")
    wrong = np.abs(parts(SPLINE.forces(*places)) - np.array(truth(*places))).max(axis=(1, 2, 3))
    assert np.all(wrong < parts(SPLINE.quality.check_max))


def test_leave_one_out_equals_refitting_without_each_sample() -> None:
    rng = np.random.default_rng(3)
    h, v = rng.uniform(0.01, 0.03, 14), rng.uniform(20.0, 60.0, 14)
    lift, _, drag = truth(h, 0.01, v)
    table = TabulatedForce.from_samples(h, None, v, lift=lift, drag=drag, method="polynomial", degree=2)
    errors = []
    # hold the box with the extreme samples: only inner samples may be left out and still be inside the domain
    inner = [i for i in range(14) if h.min() < h[i] < h.max() and v.min() < v[i] < v.max()]
    for i in inner:
        rest = np.arange(14) != i
        part = TabulatedForce.from_samples(
            h[rest], None, v[rest], lift=lift[rest], drag=drag[rest], method="polynomial", degree=2
        )
        errors.append(abs(float(part.forces(h[i], None, v[i]).lift) - lift[i]))
    assert table.quality.check == "leave-one-out"
    assert table.quality.check_max is not None
    from maglev_ctrl.forces.polynomial import fit_polynomial

    points = np.stack([h, np.zeros(14), v], axis=-1)
    _, hat = fit_polynomial(points, np.stack([lift], axis=-1), degree=2)
    np.testing.assert_allclose(np.abs(hat[inner, 0]), errors, rtol=1e-8)
    assert float(table.quality.check_max.lift) == pytest.approx(np.abs(hat[:, 0]).max(), rel=1e-12)
    assert float(table.quality.check_max.lift) > float(table.quality.residual_max.lift)


def test_a_polynomial_reproduces_a_polynomial_and_its_slopes() -> None:
    rng = np.random.default_rng(5)
    h, g, v = rng.uniform(0.01, 0.03, 60), rng.uniform(0.005, 0.02, 60), rng.uniform(20.0, 60.0, 60)

    def force(h: Any, g: Any, v: Any) -> Any:
        return 3.0 - 100.0 * h + 2e3 * h * g + 0.01 * v - 5e4 * h**3

    value = force(h, g, v)
    table = TabulatedForce.from_samples(
        h, g, v, lift=value, guidance=2 * value, drag=-value, method="polynomial", degree=3
    )
    at = (0.02, 0.011, 33.0)
    assert parts(table.forces(*at)) == pytest.approx(np.array([1, 2, -1]) * force(*at), rel=1e-11)
    partials = table.derivatives(*at)
    assert float(partials.by_height.lift) == pytest.approx(-100.0 + 2e3 * at[1] - 15e4 * at[0] ** 2, rel=1e-9)
    assert float(partials.by_gap.lift) == pytest.approx(2e3 * at[0], rel=1e-9)
    assert float(partials.by_speed.guidance) == pytest.approx(0.02, rel=1e-9)


def test_rows_in_any_order_make_the_same_spline() -> None:
    given_rows = rows()
    order = np.random.default_rng(1).permutation(len(given_rows["lift"]))
    mixed = TabulatedForce.from_samples(**{name: column[order] for name, column in given_rows.items()})
    assert parts(mixed.forces(0.02, 0.01, 33.0)) == pytest.approx(parts(SPLINE.forces(0.02, 0.01, 33.0)), rel=1e-13)


@pytest.mark.parametrize("count", [2, 3, 4, 5])
def test_few_values_on_an_axis_lower_the_degree(count: int) -> None:
    degree = min(3, count - 1)
    h = np.linspace(0.01, 0.02, count)
    table = TabulatedForce.from_samples(h, None, 30.0, lift=(h / 0.01) ** degree, drag=h)
    assert float(table.forces(0.0137, None, 30.0).lift) == pytest.approx(1.37**degree, rel=1e-12)
    assert float(table.derivatives(0.0137, None, 30.0).by_height.lift) == pytest.approx(
        degree * 1.37 ** (degree - 1) / 0.01, rel=1e-10
    )
    assert table.quality.check == ("none" if count == 2 else "halved grid")


@pytest.mark.parametrize("method", METHODS)
def test_one_speed_is_only_that_speed_unless_said_to_be_constant(method: Any) -> None:
    h = np.linspace(0.01, 0.03, 8)
    given_table = {"height": h, "gap": None, "speed": 36.1, "lift": 0.1 / h, "drag": 0.05 / h, "method": method}
    table = TabulatedForce.from_samples(**given_table)
    assert table.domain.speed == (36.1, 36.1)
    assert float(table.derivatives(0.02, None, 36.1).by_speed.lift) == 0.0
    with pytest.raises(OutOfDomain, match=r"speed 36\.2 m/s"):
        table.forces(0.02, None, 36.2)
    same = TabulatedForce.from_samples(**given_table, constant=("speed",))
    assert float(same.forces(0.02, None, 90.0).lift) == float(table.forces(0.02, None, 36.1).lift)


def test_one_sample_is_a_constant_force_at_one_point() -> None:
    table = TabulatedForce.from_samples(0.01, None, 30.0, lift=[[[5.0]]], drag=[[[2.0]]])
    assert parts(table.forces([0.01, 0.01], None, 30.0)).tolist() == [[5.0, 5.0], [0.0, 0.0], [2.0, 2.0]]
    assert parts(table.derivatives(0.01, None, 30.0).by_height).tolist() == [0.0, 0.0, 0.0]


def test_without_guidance_and_gap_the_table_needs_no_gap() -> None:
    h = np.linspace(0.01, 0.03, 6)
    table = TabulatedForce.from_samples(h, None, [30.0] * 6, lift=0.1 / h, drag=0.05 / h)
    assert table.domain.gap is None
    assert float(table.forces(0.02, None, 30.0).guidance) == 0.0
    assert table.forces(0.02, np.zeros(4), 30.0).lift.shape == (4,)
    with pytest.raises(ValueError, match="depends on the guidance gap"):
        SPLINE.forces(0.02, None, 30.0)


@pytest.mark.parametrize("method", METHODS)
def test_nothing_is_extrapolated_and_the_edges_are_data(method: str) -> None:
    table = TABLES[method]
    for corner in ((0.008, 0.004, 20.0), (0.04, 0.02, 60.0)):
        assert np.isfinite(parts(table.forces(*corner))).all()
    table.forces(0.04 * (1 + 1e-14), 0.02, 60.0)
    for outside in ((0.0079, 0.01, 30.0), (0.02, 0.021, 30.0), (0.02, 0.01, 61.0)):
        with pytest.raises(OutOfDomain):
            table.forces(*outside)
        with pytest.raises(OutOfDomain):
            table.derivatives(*outside)


@pytest.mark.parametrize("method", METHODS)
def test_batches_scale_and_broadcast(method: str) -> None:
    table = TABLES[method]
    h, v = np.array([0.01, 0.02])[:, None], np.array([25.0, 35.0, 45.0])
    forces = table.forces(h, 0.01, v)
    assert forces.lift.shape == (2, 3)
    assert float(forces.drag[1, 2]) == pytest.approx(float(table.forces(0.02, 0.01, 45.0).drag), rel=1e-13)
    factor = np.array([1.0, 2.0, 3.0])
    np.testing.assert_allclose(parts(table.scaled(factor).forces(h, 0.01, v)), parts(forces) * factor, rtol=1e-14)
    partials: MagnetDerivatives = table.scaled(2.0).scaled(3.0).derivatives(h, 0.01, v)
    np.testing.assert_allclose(parts(partials.by_gap), 6.0 * parts(table.derivatives(h, 0.01, v).by_gap), rtol=1e-13)
    assert partials.by_vertical_velocity.lift.shape == (2, 3)


def test_a_fine_table_of_the_image_force_has_its_partials() -> None:
    """Second engine: the spline of a table of Eq. 15 against Eq. 15 itself."""
    magnet = ImageForce(1e5, 1.0, 2.5e7, 0.02, 1.0)
    h, v = np.linspace(0.05, 0.15, 31), np.linspace(5.0, 45.0, 41)
    forces = magnet.forces(h[:, None, None], None, v)
    table = TabulatedForce.from_samples(h, [0.01], v, lift=forces.lift, drag=forces.drag, guidance=forces.guidance)
    got, exact = table.derivatives(0.0973, 0.01, 21.7), magnet.derivatives(0.0973, None, 21.7)
    np.testing.assert_allclose(got.by_height.lift, exact.by_height.lift, rtol=1e-5)
    np.testing.assert_allclose(got.by_height.drag, exact.by_height.drag, rtol=1e-4)
    np.testing.assert_allclose(got.by_speed.drag, exact.by_speed.drag, rtol=1e-3)


def changed(name: str, row: int, value: float) -> dict[str, Any]:
    table = {key: np.array(column) for key, column in rows().items()}
    table[name][row] = value
    return table


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", ["height", "gap", "speed", "lift", "guidance", "drag"])
def test_a_missing_number_is_named_with_its_row(name: str, method: Any) -> None:
    with pytest.raises(ValueError, match=f"{name}: expected finite numbers, got nan in row 3"):
        TabulatedForce.from_samples(**changed(name, 2, np.nan), method=method)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({**grid(), "height": HEIGHT[::-1]}, "height: expected a strictly increasing axis"),
        ({**grid(), "speed": np.full(5, 30.0)}, "speed: expected a strictly increasing axis"),
        ({**grid(), "gap": GAP[:-1]}, r"gap: expected an axis of shape \(6,\)"),
        ({**grid(), "drag": np.zeros(3)}, "drag: expected the shape of lift"),
        ({**grid(), "gap": None}, "gap: a table with guidance needs the gap"),
        ({**grid(), "method": "cubic"}, "method: expected 'spline' or 'polynomial', got 'cubic'"),
        ({**grid(), "constant": ("speed",)}, "constant: expected an axis with one value, got 'speed'"),
        ({**grid(), "constant": ("pitch",)}, "constant: expected names out of"),
        ({name: column[1:] for name, column in rows().items()}, "a spline needs every combination of 9 heights"),
        ({**rows(), "height": rows()["height"][1:]}, "height: expected 270 rows like lift"),
        (changed("height", 0, -0.01), r"height: expected positive heights, got -0\.01 m"),
        ({name: np.append(column, column[4]) for name, column in rows().items()}, r"height 0\.008 .* is given twice"),
        ({**{n: c[::9] for n, c in rows().items()}, "method": "polynomial"}, "has 35 terms here and needs at least 36"),
        ({**rows(), "method": "polynomial", "degree": 0}, "degree: expected at least 1"),
        ({"height": [], "gap": None, "speed": [], "lift": [], "drag": []}, "expected at least one sample"),
        ({"height": 0.1, "gap": None, "speed": 1.0, "lift": 1.0, "drag": 1.0}, "lift: expected rows"),
    ],
)
def test_a_table_that_makes_no_sense_is_refused_in_one_sentence(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message) as caught:
        TabulatedForce.from_samples(**arguments)
    assert "\n" not in str(caught.value)


def test_samples_on_a_line_do_not_determine_a_plane() -> None:
    h = np.linspace(0.01, 0.02, 12)
    with pytest.raises(ValueError, match="do not determine every term"):
        TabulatedForce.from_samples(h, None, 1e3 * h, lift=h, drag=h, method="polynomial", degree=2)


def test_a_sample_that_alone_fixes_a_term_is_refused() -> None:
    h, v = np.append(np.linspace(0.01, 0.02, 12), 0.015), np.append(np.full(12, 30.0), 40.0)
    with pytest.raises(ValueError, match="lower the degree or add samples"):
        TabulatedForce.from_samples(h, None, v, lift=h, drag=h, method="polynomial", degree=1)
