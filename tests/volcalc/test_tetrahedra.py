"""Space is divided once, without overlap, and each face knows its sides and how wide it is."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from quantify_client.errors import InputError
from quantify_client.volcalc.body import tetrahedra
from quantify_client.volcalc.body.tetrahedra import tetrahedralize


def random_points(count, seed):
    return np.random.default_rng(seed).normal(size=(count, 3))


@pytest.fixture
def exact(monkeypatch):
    """Points stay where they are."""
    monkeypatch.setattr(tetrahedra, "_JOGGLE", 0.0)


@given(count=st.integers(5, 60), seed=st.integers(0, 1000))
@settings(max_examples=25)
def test_the_volumes_fill_the_convex_hull(count, seed):
    points = random_points(count, seed)
    space = tetrahedralize(points)
    assert space.volume[-1] == 0.0
    assert space.volume.sum() == pytest.approx(ConvexHull(space.points).volume, rel=1e-9)
    assert space.volume.sum() == pytest.approx(ConvexHull(points).volume, rel=0.3)


@given(count=st.integers(5, 60), seed=st.integers(0, 1000))
@settings(max_examples=25)
def test_each_face_appears_once_between_the_two_tetrahedra_that_have_it(count, seed):
    space = tetrahedralize(random_points(count, seed))
    assert len(np.unique(np.sort(space.faces, axis=1), axis=0)) == len(space.faces)
    sides = np.bincount(np.concatenate([space.first, space.second]), minlength=space.around + 1)
    assert np.all(sides[:-1] == 4)
    assert sides[-1] == len(ConvexHull(space.points).simplices)
    for tetrahedron in (space.first, space.second):
        inner = np.flatnonzero(tetrahedron < space.around)
        corners = space.corners[tetrahedron[inner]]
        shared = (space.faces[inner][:, :, None] == corners[:, None, :]).any(axis=2)
        assert shared.all()


def test_each_normal_points_from_the_first_to_the_second_tetrahedron():
    space = tetrahedralize(random_points(200, 0))
    a, b, c = (space.points[space.faces[:, i]] for i in range(3))
    normal = np.cross(b - a, c - a)
    middle = space.points[space.corners].mean(axis=1)
    inside = np.einsum("ij,ij->i", normal, middle[space.first] - a)
    assert np.all(inside < 0.0)
    inner = space.second < space.around
    beyond = np.einsum("ij,ij->i", normal[inner], middle[space.second[inner]] - a[inner])
    assert np.all(beyond > 0.0)
    assert np.all(np.einsum("ij,ij->i", normal, space.points.mean(axis=0) - a)[~inner] < 0.0)


@pytest.mark.parametrize(
    ("triangle", "width", "area"),
    [
        # Of a right triangle the longest side; of an obtuse one too, though its circumcircle is
        # larger; of an equilateral one the circumcircle; sides 13, 14, 15: R = 8 1/8, area 84.
        ([(0, 0), (3, 0), (0, 4)], 5.0, 6.0),
        ([(0, 0), (6, 0), (3, 1)], 6.0, 3.0),
        ([(0, 0), (1, 0), (0.5, math.sqrt(0.75))], 2.0 / math.sqrt(3.0), math.sqrt(0.75) / 2),
        ([(0, 0), (14, 0), (5, 12)], 16.25, 84.0),
    ],
    ids=["right", "obtuse", "equilateral", "acute"],
)
def test_the_width_of_a_face_is_the_smallest_circle_round_it(exact, triangle, width, area):
    corners = np.column_stack([triangle, np.zeros(3)])
    middle = corners.mean(axis=0)
    turn = Rotation.from_rotvec([0.3, -0.7, 0.4]).as_matrix()
    # One corner far above and one far below: the triangle is the face between them.
    far = np.array([0.0, 0.0, 100.0])
    points = np.vstack([corners, middle + far, middle - far]) @ turn
    space = tetrahedralize(points)
    (face,) = np.flatnonzero((np.sort(space.faces, axis=1) == [0, 1, 2]).all(axis=1))
    assert space.width[face] == pytest.approx(width, rel=1e-12)
    assert space.area[face] == pytest.approx(area, rel=1e-12)


def test_the_spacing_of_a_lattice_is_its_step():
    # Within a cubic lattice the six nearest neighbours are one step away.
    step = 0.25
    lattice = step * np.stack(np.meshgrid(*3 * [np.arange(5.0)]), axis=-1).reshape(-1, 3)
    within = np.all((lattice > 0) & (lattice < 4 * step), axis=1)
    space = tetrahedralize(lattice)
    np.testing.assert_allclose(space.spacing[within], step)
    assert np.abs(space.points - lattice).max() <= 0.01 * space.spacing.max()


def test_points_on_a_lattice_a_plane_and_a_sphere_are_divided_alike():
    # Exactly cospherical and coplanar points; the volume of 1 m3 is not moved by their joggling.
    lattice = np.stack(np.meshgrid(*3 * [np.linspace(0, 1, 9)]), axis=-1).reshape(-1, 3)
    surface = lattice[np.any((lattice == 0) | (lattice == 1), axis=1)]
    for points in (lattice, surface):
        assert tetrahedralize(points).volume.sum() == pytest.approx(1.0, rel=0.01)


def test_the_same_points_are_divided_the_same_way_twice():
    points = random_points(300, 1)
    one, other = tetrahedralize(points), tetrahedralize(points.copy())
    np.testing.assert_array_equal(one.corners, other.corners)
    np.testing.assert_array_equal(one.points, other.points)


FLAT = np.column_stack([random_points(50, 2)[:, :2], np.full(50, 3.0)])


@pytest.mark.parametrize(
    "points",
    [
        np.empty((0, 3)),
        random_points(4, 0),
        FLAT,
        FLAT @ Rotation.from_rotvec([0.4, 0.2, 0.0]).as_matrix(),
        np.outer(np.arange(9.0), [1.0, 2.0, 3.0]),
        np.ones((9, 3)),
    ],
    ids=["none", "four", "level", "tilted plane", "line", "one place"],
)
def test_points_that_span_no_body_are_refused_in_one_line(points):
    with pytest.raises(InputError, match=f"^{len(points)} distinct points span no body") as refused:
        tetrahedralize(points)
    assert "\n" not in str(refused.value)
