from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from maglev_ctrl.fields.polygon import edge_distances, inner_angles, inside, point_distances, signed_area
from maglev_ctrl.fields.section import Conductor, CrossSection

SIGMA = 2.5e7
SQUARE = [[0.0, 0.0], [0.1, 0.0], [0.1, 0.1], [0.0, 0.1]]
D, LEG = 6.35e-3, 76.2e-3


def l_shape(*, outside: bool = True) -> CrossSection:
    return CrossSection.l_shape(leg=LEG, thickness=D, conductivity=SIGMA, outside=outside)


def rectangle(left: float, right: float, bottom: float, top: float, name: str = "b") -> Conductor:
    return Conductor(name, np.array([[left, bottom], [right, bottom], [right, top], [left, top]]), SIGMA)


# --- shapes ----------------------------------------------------------------------------------------------------------


def test_the_constructors_have_the_areas_of_their_drawings() -> None:
    wide, wall = 0.1, 0.05
    cases = [
        (l_shape(), LEG * D + (LEG - D) * D),
        (l_shape(outside=False), 2 * LEG * D + D * D),
        (CrossSection.plate(width=wide, thickness=D, conductivity=SIGMA), wide * D),
        (CrossSection.channel(width=wide, wall=wall, thickness=D, conductivity=SIGMA), (wide + 2 * D + 2 * wall) * D),
    ]
    for section, area in cases:
        assert sum(one.area for one in section.conductors) == pytest.approx(area, rel=1e-14)


def test_faces_lie_where_the_axes_say() -> None:
    low, high = l_shape().bounds
    np.testing.assert_allclose([low, high], [[-D, -D], [LEG - D, LEG - D]], rtol=1e-15)
    low, high = l_shape(outside=False).bounds
    np.testing.assert_allclose([low, high], [[-D, -D], [LEG, LEG]], rtol=1e-15)
    low, high = CrossSection.plate(width=0.2, thickness=D, conductivity=SIGMA, centre=0.3).bounds
    np.testing.assert_allclose([low, high], [[0.2, -D], [0.4, 0.0]], rtol=1e-15)
    channel = CrossSection.channel(width=0.1, wall=0.05, thickness=D, conductivity=SIGMA)
    np.testing.assert_allclose(channel.distance([[0.04, 0.03], [0.08, 0.03], [0.05, 0.01]]), [0.03, 0.02, 0.01])
    assert channel.size == pytest.approx(0.1 + 2 * D)


def test_plates_may_have_their_own_conductivities() -> None:
    boxes = [(0.0, 0.05, -2e-3, 0.0), (0.051, 0.1, -3e-3, 0.0)]
    split = CrossSection.plates(boxes, conductivity=[1e7, 2e7])
    assert [one.conductivity for one in split.conductors] == [1e7, 2e7]
    with pytest.raises(ValueError, match="expected one value or 2"):
        CrossSection.plates(boxes, conductivity=[1e7, 2e7, 3e7])
    with pytest.raises(ValueError, match="plate 1: expected left < right"):
        CrossSection.plates([(0.05, 0.0, -2e-3, 0.0)], conductivity=1e7)


def test_clockwise_outlines_are_turned_round() -> None:
    one = Conductor("square", np.array(SQUARE[::-1]), SIGMA)
    assert one.area == pytest.approx(0.01) and signed_area(one.outline) > 0.0
    assert not one.outline.flags.writeable


# --- refused outlines ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("outline", "message"),
    [
        (SQUARE[:2], "at least 3 vertices"),
        ([[0.0, 0.0], [0.1, np.nan], [0.1, 0.1]], "every entry must be finite"),
        ([[0.0, 0.0, 0.0]] * 3, "expected shape"),
        ([SQUARE[0], SQUARE[1], SQUARE[1], SQUARE[2]], "vertices 2 and 3 of the outline are the same point"),
        ([*SQUARE, SQUARE[0]], "vertices 1 and 5 of the outline are the same point"),
        ([[0.0, 0.0], [0.1, 0.1], [0.2, 0.2]], "no thickness"),
        ([[0.0, 0.0], [0.1, 0.0], [0.1, 1e-13], [0.0, 1e-13]], "the same point"),
        ([SQUARE[0], SQUARE[2], SQUARE[1], SQUARE[3]], "edges 1 and 3 of the outline cross or touch"),
        ([[0.0, 0.0], [0.1, 0.0], [0.05, 0.0], [0.0, 0.1]], "edges 1 and 3 of the outline cross or touch"),
        ([[0.0, 0.0], [0.1, 0.0], [0.1, 0.1], [0.05, 0.0], [0.0, 0.1]], "edges 1 and 3 of the outline cross or touch"),
    ],
)
def test_outlines_that_are_refused(outline: list[list[float]], message: str) -> None:
    with pytest.raises(ValueError, match=message) as caught:
        Conductor("rail", np.array(outline), SIGMA)
    assert str(caught.value).startswith("conductor 'rail': ") and "\n" not in str(caught.value)


@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf])
def test_a_conductivity_must_be_positive_and_finite(value: float) -> None:
    with pytest.raises(ValueError, match="conductor 'rail': expected a positive conductivity"):
        Conductor("rail", np.array(SQUARE), value)


@pytest.mark.parametrize("value", [0.0, -1e-3, np.nan, np.inf])
def test_lengths_must_be_positive(value: float) -> None:
    with pytest.raises(ValueError, match="thickness: expected a positive length"):
        CrossSection.l_shape(leg=LEG, thickness=value, conductivity=SIGMA)
    with pytest.raises(ValueError, match="width: expected a positive length"):
        CrossSection.plate(width=value, thickness=D, conductivity=SIGMA)
    with pytest.raises(ValueError, match="wall: expected a positive length"):
        CrossSection.channel(width=0.1, wall=value, thickness=D, conductivity=SIGMA)


def test_an_outside_leg_must_exceed_the_thickness() -> None:
    with pytest.raises(ValueError, match="leg: an outside length must exceed the thickness"):
        CrossSection.l_shape(leg=D, thickness=D, conductivity=SIGMA)
    assert CrossSection.l_shape(leg=D, thickness=D, conductivity=SIGMA, outside=False).size == pytest.approx(2 * D)


# --- several conductors ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "other",
    [
        rectangle(0.05, 0.15, 0.05, 0.15),  # edges cross
        rectangle(0.0, 0.1, 0.0, 0.1),  # the same
        rectangle(0.02, 0.05, 0.02, 0.05),  # inside
        rectangle(-0.1, 0.2, -0.1, 0.2),  # around
        Conductor("b", np.array([[0.0, 0.0], [0.1, 0.0], [0.05, 0.05]]), SIGMA),  # inside, one edge in common
        Conductor("b", np.array([[0.0, 0.0], [0.1, 0.0], [0.05, 0.2]]), SIGMA),  # out through the far side
    ],
)
def test_conductors_must_not_overlap(other: Conductor) -> None:
    with pytest.raises(ValueError, match="conductors 'a' and 'b' overlap"):
        CrossSection((Conductor("a", np.array(SQUARE), SIGMA), other))


@pytest.mark.parametrize(
    "other",
    [
        rectangle(0.1, 0.2, 0.1, 0.2),  # corner on corner
        rectangle(0.1, 0.2, 0.0, 0.05),  # half an edge
        rectangle(0.05, 0.2, 0.0, 0.1),  # along one line
        Conductor("b", np.array([[0.1, 0.05], [0.2, 0.0], [0.2, 0.1]]), SIGMA),  # a corner on an edge
    ],
)
def test_conductors_that_touch_must_share_whole_edges(other: Conductor) -> None:
    with pytest.raises(ValueError, match=r"touch or overlap at edge \d of the first and edge \d of the second"):
        CrossSection((Conductor("a", np.array(SQUARE), SIGMA), other))


def test_conductors_in_contact_are_one_piece_of_metal() -> None:
    pair = CrossSection((rectangle(0.0, 0.1, 0.0, 0.1, "a"), rectangle(0.1 + 1e-16, 0.2, 1e-17, 0.1)))
    assert pair.conductors[1].outline[0].tolist() == [0.1, 0.0]  # rounding is taken out
    whole = CrossSection((rectangle(0.0, 0.2, 0.0, 0.1),))
    points = np.random.default_rng(3).uniform(-0.1, 0.3, (200, 2))
    points[:20, 0] = 0.1  # on the line of the common edge
    np.testing.assert_allclose(pair.distance(points), whole.distance(points), rtol=1e-14)


def test_at_least_one_conductor() -> None:
    with pytest.raises(ValueError, match="at least one conductor"):
        CrossSection(())


# --- distances -------------------------------------------------------------------------------------------------------


def test_distances_to_a_plate_are_those_of_a_rectangle() -> None:
    plate = CrossSection.plate(width=0.1, thickness=0.02, conductivity=SIGMA)
    points = np.random.default_rng(1).uniform(-0.1, 0.1, (500, 2))
    # Distance to a box about (0, -0.01) in closed form.
    out = np.abs(points - [0.0, -0.01]) - [0.05, 0.01]
    expected = np.hypot(*np.maximum(out, 0.0).T) + np.minimum(out.max(axis=-1), 0.0)
    np.testing.assert_allclose(plate.distance(points), expected, rtol=1e-12, atol=1e-16)
    assert plate.distance(points.reshape(10, 50, 2)).shape == (10, 50)
    mutant = -plate.distance(points)  # the sign matters: metal is negative
    assert not np.allclose(mutant, expected)


def test_a_magnet_above_the_guideway_is_clear_and_one_in_it_is_not() -> None:
    guideway = l_shape()
    guideway.require_clear([[5e-3, 10e-3]], [[30e-3, 10e-3]], margin=4e-3)
    with pytest.raises(ValueError, match=r"magnet: the piece .* comes within 0.005 m of the guideway's metal"):
        guideway.require_clear([5e-3, 10e-3], [30e-3, 10e-3], margin=6e-3, name="magnet")
    with pytest.raises(ValueError, match=r"meets the guideway's metal"):
        guideway.require_clear([-5e-3, 10e-3], [-4e-3, 10e-3])  # wholly inside the wall
    with pytest.raises(ValueError, match=r"meets the guideway's metal"):
        guideway.require_clear([[0.03, 0.03], [-20e-3, 10e-3]], [[0.04, 0.03], [30e-3, 10e-3]])  # through the wall
    # The ends alone would not show it.
    assert guideway.distance([[-20e-3, 10e-3], [30e-3, 10e-3]]).min() > 0.0


coordinates = st.floats(-1.0, 1.0).map(lambda value: round(value, 3))
places = st.tuples(coordinates, coordinates)


@given(places, places, places, places)
def test_edge_distances_against_dense_sampling(a: object, b: object, c: object, d: object) -> None:
    start, end, other_start, other_end = (np.array([p], dtype=float) for p in (a, b, c, d))
    share = np.linspace(0.0, 1.0, 401)[:, None]
    sampled = point_distances(start + share * (end - start), other_start, other_end).min()
    exact = edge_distances(start, end, other_start, other_end)[0, 0]
    step = np.hypot(*(end - start)[0]) / 400
    assert exact <= sampled + 1e-12 and sampled <= exact + step + 1e-12


def test_points_inside_and_angles_of_an_l() -> None:
    outline = l_shape().conductors[0].outline
    # From (-d, -d): five outer right angles and the inner corner.
    assert sorted(np.degrees(inner_angles(outline)).round(9).tolist()) == [90.0] * 5 + [270.0]
    points = np.random.default_rng(2).uniform(-0.02, 0.08, (1000, 2))
    y, z = points.T
    face = LEG - D
    in_wall = (y > -D) & (y < 0) & (z > -D) & (z < face)
    in_floor = (z > -D) & (z < 0) & (y > -D) & (y < face)
    assert np.array_equal(inside(points, outline), in_wall | in_floor)


# --- digest ----------------------------------------------------------------------------------------------------------


def test_the_digest_tells_sections_apart_and_nothing_else() -> None:
    base = l_shape().digest()
    outline = l_shape().conductors[0].outline
    same = [
        CrossSection((Conductor("other name", np.roll(outline, 2, axis=0), SIGMA),)),
        CrossSection((Conductor("L", outline[::-1], SIGMA),)),
        CrossSection((Conductor("L", outline * (1.0 + 1e-15), SIGMA * (1.0 + 1e-15)),)),
    ]
    assert all(one.digest() == base for one in same)
    different = [
        l_shape(outside=False),
        CrossSection.l_shape(leg=LEG, thickness=D + 1e-9, conductivity=SIGMA),
        CrossSection.l_shape(leg=LEG, thickness=D, conductivity=SIGMA * 1.000001),
        CrossSection((Conductor("L", outline + np.array([1e-6, 0.0]), SIGMA),)),
    ]
    assert len({base, *(one.digest() for one in different)}) == 1 + len(different)
