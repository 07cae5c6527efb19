from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.fields import delaunay
from maglev_ctrl.fields import mesh as mesh_module
from maglev_ctrl.fields.delaunay import NotMeshed
from maglev_ctrl.fields.mesh import AIR, Spacing, Triangulation, _corners, triangulate
from maglev_ctrl.fields.polygon import inner_angles, point_distances
from maglev_ctrl.fields.section import Conductor, CrossSection

SIGMA = 2.5e7
DEFAULT = CrossSection.l_shape(leg=76.2e-3, thickness=6.35e-3, conductivity=SIGMA)
SLANTED = CrossSection(
    (Conductor("slanted", np.array([[0.0, 0.0], [0.06, 0.02], [0.05, 0.035], [0.01, 0.025], [-0.01, 0.05]]), SIGMA),)
)
SLIT = CrossSection.plates([(0.0, 0.05, -5e-3, 0.0), (0.051, 0.1, -5e-3, 0.0)], conductivity=SIGMA)
CONTACT = CrossSection.plates([(0.0, 0.05, -5e-3, 0.0), (0.05, 0.1, -5e-3, 0.0)], conductivity=[SIGMA, 6e7])
THIN = CrossSection.plate(width=0.4, thickness=2e-3, conductivity=SIGMA)
LONG_LEGS = CrossSection.l_shape(leg=0.3, thickness=2e-3, conductivity=SIGMA)
CHANNEL = CrossSection.channel(width=0.1, wall=0.05, thickness=5e-3, conductivity=SIGMA)
SECTIONS = {
    "L": DEFAULT,
    "slanted": SLANTED,
    "slit": SLIT,
    "contact": CONTACT,
    "thin": THIN,
    "long legs": LONG_LEGS,
    "channel": CHANNEL,
}
SMALLEST = 25.0  # degrees
SIZES = {"finest": 0.5e-3, "in_conductor": 3e-3}


@pytest.fixture(scope="module", params=list(SECTIONS))
def meshed(request: pytest.FixtureRequest) -> tuple[CrossSection, Triangulation]:
    section = SECTIONS[request.param]
    return section, triangulate(section, **SIZES)


def area_errors(section: CrossSection, mesh: Triangulation) -> FloatArray:
    areas = mesh.areas()
    found = [areas[mesh.conductor == i].sum() for i in range(len(section.conductors))]
    return np.abs(np.array(found) / [one.area for one in section.conductors] - 1.0)


def edges_of(mesh: Triangulation) -> tuple[FloatArray, np.ndarray]:
    """Undirected edges (E, 2) and in how many triangles each occurs."""
    t = mesh.triangles
    pairs = np.sort(np.concatenate([t[[0, 1]].T, t[[1, 2]].T, t[[2, 0]].T]), axis=1)
    return np.unique(pairs, axis=0, return_counts=True)


def covered(mesh: Triangulation, start: FloatArray, end: FloatArray) -> float:
    """Length of a straight edge that mesh edges cover."""
    on = point_distances(mesh.points.T, start[None, :], end[None, :])[:, 0] <= 1e-13
    pairs, _ = edges_of(mesh)
    both = pairs[on[pairs[:, 0]] & on[pairs[:, 1]]]
    return float(np.sum(np.hypot(*(mesh.points[:, both[:, 0]] - mesh.points[:, both[:, 1]]))))


# --- a partition that follows the outlines ---------------------------------------------------------------------------


def test_conductor_areas_are_exact(meshed: tuple[CrossSection, Triangulation]) -> None:
    section, mesh = meshed
    assert area_errors(section, mesh).max() < 1e-12
    assert mesh.areas().min() > 0.0


def test_a_flipped_conductor_flag_is_caught(meshed: tuple[CrossSection, Triangulation]) -> None:
    section, mesh = meshed
    flipped = mesh.conductor.copy()
    flipped[np.argmin(np.where(flipped == 0, mesh.areas(), np.inf))] = AIR  # even the smallest one
    assert area_errors(section, replace(mesh, conductor=flipped)).max() > 1e-6


def test_every_outline_edge_is_a_chain_of_mesh_edges(meshed: tuple[CrossSection, Triangulation]) -> None:
    section, mesh = meshed
    for one in section.conductors:
        for start, end in zip(one.outline, np.roll(one.outline, -1, axis=0), strict=True):
            assert covered(mesh, start, end) == pytest.approx(np.hypot(*(end - start)), rel=1e-12)
    # A line that the mesh does not follow is not covered.
    start, end = section.conductors[0].outline[:2]
    assert covered(mesh, start, start + (end - start) @ np.array([[0.8, 0.6], [-0.6, 0.8]])) < 1e-6


def test_no_triangle_straddles_a_face(meshed: tuple[CrossSection, Triangulation]) -> None:
    section, mesh = meshed
    corners = mesh.points.T[mesh.triangles.T]
    weights = np.random.default_rng(5).dirichlet([1.0, 1.0, 1.0], 20)
    samples = np.einsum("sk,tkd->tsd", weights, corners)
    assert np.array_equal(section.contains(samples), np.repeat((mesh.conductor != AIR)[:, None], 20, axis=1))
    # Each in its own conductor and in no other.
    for i, one in enumerate(section.conductors):
        alone = CrossSection((one,))
        middles = corners.mean(axis=1)
        assert np.array_equal(alone.contains(middles), mesh.conductor == i)


def test_the_triangles_fill_a_disk_once(meshed: tuple[CrossSection, Triangulation]) -> None:
    section, mesh = meshed
    pairs, count = edges_of(mesh)
    assert count.max() == 2
    rim = pairs[count == 1]
    low, high = section.bounds
    radius = max(0.5, 6.0 * section.size)
    away = np.hypot(*(mesh.points - 0.5 * (low + high)[:, None]))
    np.testing.assert_allclose(away[np.unique(rim)], radius, rtol=1e-12)
    turn = 2.0 * np.arcsin(0.5 * np.hypot(*(mesh.points[:, rim[:, 0]] - mesh.points[:, rim[:, 1]])) / radius)
    assert turn.sum() == pytest.approx(2.0 * np.pi, rel=1e-12)
    assert mesh.areas().sum() == pytest.approx(0.5 * radius**2 * np.sin(turn).sum(), rel=1e-12)
    # Euler: one connected disk, no point left over.
    assert mesh.points.shape[1] - len(pairs) + mesh.triangles.shape[1] == 1
    assert np.array_equal(np.unique(mesh.triangles), np.arange(mesh.points.shape[1]))


# --- shape and size --------------------------------------------------------------------------------------------------


def test_angles(meshed: tuple[CrossSection, Triangulation]) -> None:
    section, mesh = meshed
    poor = np.degrees(mesh.smallest_angles()) < SMALLEST - 1e-9
    outlines = [one.outline for one in section.conductors]
    sharp = np.concatenate([one[np.cos(inner_angles(one)) > 0.5] for one in outlines])
    # Only in a corner of less than 60 degrees may triangles be worse, and there no worse than half of it.
    middles = mesh.points.T[mesh.triangles.T].mean(axis=1)[poor]
    assert not len(middles) or np.hypot(*(middles[:, None] - sharp).transpose(2, 0, 1)).min(axis=1).max() < 5e-3
    if len(sharp):
        own = min(inner_angles(one).min() for one in outlines)
        assert mesh.smallest_angles().min() > 0.5 * own


def spacing_of(section: CrossSection, *, finest: float, in_conductor: float) -> Spacing:
    coarsest = max(0.5, 6.0 * section.size) / 6.0
    return Spacing(section, _corners(section), finest, in_conductor, 0.3, 0.6, coarsest)


def oversize(section: CrossSection, mesh: Triangulation, **sizes: float) -> FloatArray:
    """Circumradius over that of an equilateral triangle of the edge length wanted."""
    shapes = delaunay.shapes_of(np.ascontiguousarray(mesh.points.T), np.ascontiguousarray(mesh.triangles.T))
    return shapes.circumradius * np.sqrt(3.0) / spacing_of(section, **sizes)(shapes.middle)


def test_sizes_obey_the_spacing(meshed: tuple[CrossSection, Triangulation]) -> None:
    section, mesh = meshed
    ratio = oversize(section, mesh, **SIZES)
    assert ratio.max() <= delaunay.LARGE + 1e-9
    # A mesh made for twice the spacing does not pass.
    assert oversize(section, triangulate(section, finest=1e-3, in_conductor=6e-3), **SIZES).max() > delaunay.LARGE


def test_the_edges_at_every_corner_are_as_fine_as_asked(meshed: tuple[CrossSection, Triangulation]) -> None:
    section, mesh = meshed
    pairs, _ = edges_of(mesh)
    length = np.hypot(*(mesh.points[:, pairs[:, 0]] - mesh.points[:, pairs[:, 1]]))
    for corner in _corners(section):
        vertex = np.argmin(np.hypot(*(mesh.points.T - corner).T))
        assert length[(pairs == vertex).any(axis=1)].max() < 2.5 * SIZES["finest"]


def test_the_spacing_grows_from_the_corners_and_is_continuous_at_a_face() -> None:
    spacing = spacing_of(DEFAULT, finest=0.4e-3, in_conductor=3e-3)
    at = np.array([[0.0, 0.0], [0.035, -3e-3], [0.035, -1e-9], [0.035, 1e-9], [0.035, 0.01], [5.0, 5.0]])
    np.testing.assert_allclose(spacing(at), [0.4e-3, 3e-3, 3e-3, 3e-3, 3e-3 + 0.6 * 0.01, 0.5 / 6.0], rtol=1e-6)


def test_few_triangles_quickly_for_the_default_guideway() -> None:
    started = time.perf_counter()
    mesh = triangulate(DEFAULT, finest=0.4e-3, in_conductor=3e-3)
    assert np.sum(mesh.conductor == 0) <= 600 and mesh.conductor.size <= 1500
    assert time.perf_counter() - started < 15.0  # about 0.4 s; ten times and more for a busy machine


def test_nearly_straight_vertices_are_not_corners() -> None:
    turn = np.linspace(0.0, 2.0 * np.pi, 60, endpoint=False)
    round_bar = CrossSection((Conductor("bar", 0.05 * np.stack([np.cos(turn), np.sin(turn)], axis=-1), SIGMA),))
    assert len(_corners(round_bar)) == 0
    mesh = triangulate(round_bar, finest=0.1e-3, in_conductor=8e-3)
    assert area_errors(round_bar, mesh).max() < 1e-12 and mesh.conductor.size < 1500


# --- repeatable, and any polygon -------------------------------------------------------------------------------------


def test_the_same_section_gives_the_same_mesh() -> None:
    first, second = (triangulate(SLIT, **SIZES) for _ in range(2))
    assert np.array_equal(first.points, second.points)
    assert np.array_equal(first.triangles, second.triangles)
    assert np.array_equal(first.conductor, second.conductor)
    assert not first.points.flags.writeable


def test_a_sharp_wedge_is_meshed_with_its_own_angle_only_at_the_tip() -> None:
    wedge = CrossSection((Conductor("wedge", np.array([[0.0, 0.0], [0.1, 0.0], [0.1, 0.01]]), SIGMA),))
    mesh = triangulate(wedge, **SIZES)
    assert area_errors(wedge, mesh).max() < 1e-12
    poor = np.degrees(mesh.smallest_angles()) < 20.0
    tip = np.hypot(*mesh.points.T[mesh.triangles.T].mean(axis=1).T) < 0.012
    assert poor.any() and np.all(tip[poor])


def test_a_narrow_slit_stays_open() -> None:
    slit = CrossSection.plates([(0.0, 0.05, -5e-3, 0.0), (0.0501, 0.1, -5e-3, 0.0)], conductivity=SIGMA)
    mesh = triangulate(slit, **SIZES)
    middles = mesh.points.T[mesh.triangles.T].mean(axis=1)
    between = (middles[:, 0] > 0.05) & (middles[:, 0] < 0.0501) & (np.abs(middles[:, 1] + 2.5e-3) < 2.5e-3)
    assert np.all(mesh.conductor[between] == AIR)
    assert mesh.areas()[between].sum() == pytest.approx(0.1e-3 * 5e-3, rel=0.05)
    assert np.degrees(mesh.smallest_angles()).min() >= 25.0 - 1e-9


stars = st.lists(st.tuples(st.floats(0.2, 1.0), st.floats(0.3, 1.0)), min_size=3, max_size=8)


@settings(max_examples=15)
@given(stars, st.floats(-1.0, 1.0))
@example([(1.0, 1.0), (1.0, 0.3), (1.0, 1.0), (1.0, 0.3), (1.0, 1.0), (1.0, 0.3)], 0.0)  # a three-pointed star
def test_any_polygon(star: list[tuple[float, float]], shift: float) -> None:
    steps, radii = np.array(star).T
    turn = 2.0 * np.pi * np.cumsum(steps) / steps.sum()
    outline = shift + 0.04 * radii[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    try:
        section = CrossSection((Conductor("any", outline, SIGMA),))
    except ValueError:
        assume(False)
    own = inner_angles(section.conductors[0].outline)
    assume(np.minimum(own, 2.0 * np.pi - own).min() > np.radians(10.0))
    mesh = triangulate(section, finest=2e-3, in_conductor=6e-3)
    assert area_errors(section, mesh).max() < 1e-12
    for start, end in zip(outline, np.roll(outline, -1, axis=0), strict=True):
        assert covered(mesh, start, end) == pytest.approx(np.hypot(*(end - start)), rel=1e-12)
    least = np.degrees(np.minimum(own, 2.0 * np.pi - own)).min()
    if least > 60.0:
        assert np.degrees(mesh.smallest_angles()).min() >= 20.0


# --- refused ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"finest": 0.0}, "finest: expected a positive value"),
        ({"in_conductor": np.nan}, "in_conductor: expected a positive value"),
        ({"growth": -0.1}, "growth: expected a positive value"),
        ({"finest": 4e-3}, "finest: expected at most in_conductor"),
        ({"growth": 0.3, "air_growth": 0.2}, "air_growth: expected at least growth"),
        ({"air_radius": 0.05}, "air_radius: expected at least the section's diagonal"),
        ({"air_radius": np.inf}, "air_radius: expected at least the section's diagonal"),
        ({"finest": 1e-5, "in_conductor": 1e-5}, "needs more than 20000 mesh points"),
    ],
)
def test_sizes_that_are_refused(change: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        triangulate(DEFAULT, **{**SIZES, **change})


def test_a_foil_too_thin_to_mesh_is_refused_at_once() -> None:
    foil = CrossSection.plate(width=0.4, thickness=1e-6, conductivity=SIGMA)
    with pytest.raises(ValueError, match="its narrowest part or gap is 1e-06 m wide"):
        triangulate(foil, **SIZES)


def test_a_mesh_that_fails_is_tried_again_a_little_finer(monkeypatch: pytest.MonkeyPatch) -> None:
    section = CrossSection.plate(width=0.05, thickness=5e-3, conductivity=2.5e7)
    tried = []
    whole = mesh_module._mesh

    def once(section: CrossSection, spacing: Spacing, ring: object) -> Triangulation:
        tried.append(spacing.shrink)
        if len(tried) < 3:
            raise NotMeshed("no luck")
        return whole(section, spacing, ring)  # type: ignore[arg-type]

    monkeypatch.setattr(mesh_module, "_mesh", once)
    mesh = triangulate(section, finest=2e-3, in_conductor=4e-3)
    assert tried == [1.0, 0.93, 0.85]
    assert abs(mesh.areas()[mesh.conductor == 0].sum() / (0.05 * 5e-3) - 1.0) < 1e-12
    tried.append(0.0)
    monkeypatch.setattr(mesh_module, "_mesh", lambda *_: (_ for _ in ()).throw(NotMeshed("never")))
    with pytest.raises(NotMeshed, match="never"):
        triangulate(section, finest=2e-3, in_conductor=4e-3)
