"""Bodies of known volume whose points are evenly spaced: thinned, on grids, or placed so."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scans import apart, volume_of
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation
from solids import even_vectors, finer

from quantify_client.volcalc.body import estimate, pattern
from quantify_client.volcalc.body.enclose import Enclosed, Unseen, enclose
from quantify_client.volcalc.body.facets import facets_of
from quantify_client.volcalc.body.sections import BodySurface
from quantify_client.volcalc.body.spacing import Nearness

# Arithmetic of arrays: no different on a second Python.
pytestmark = pytest.mark.one_python

BALL, CUBE, TORUS = 4.0 * math.pi / 3.0, 1.0, 2.0 * math.pi**2 * 0.16


def ball(count, rng):
    points = rng.normal(size=(count, 3))
    return points / np.linalg.norm(points, axis=1)[:, None]


def cube(count, rng):
    places, face = rng.uniform(-0.5, 0.5, (count, 2)), rng.integers(0, 6, count)
    points = np.empty((count, 3))
    for axis in range(3):
        on = face // 2 == axis
        points[on] = np.insert(places[on], axis, 0.0, axis=1)
        points[on, axis] = face[on] % 2 - 0.5
    return points


def torus(count, rng):
    """Radii 1 and 0.4, evenly by area: by rejection."""
    u, v = rng.uniform(0.0, 2.0 * np.pi, (2, 2 * count))
    kept = rng.random(2 * count) < (1.0 + 0.4 * np.cos(v)) / 1.4
    u, v = u[kept][:count], v[kept][:count]
    away = 1.0 + 0.4 * np.cos(v)
    return np.column_stack([away * np.cos(u), away * np.sin(u), 0.4 * np.sin(v)])


def grid_on_cube(steps, ends):
    """Points at the ends of steps, or a share of a step from one."""
    side = (np.arange(steps + (ends == 0.0)) + ends) / steps - 0.5
    places = np.column_stack([axis.ravel() for axis in np.meshgrid(side, side)])
    faces = [np.insert(places, axis, at, axis=1) for axis in range(3) for at in (-0.5, 0.5)]
    return np.unique(np.vstack(faces), axis=0)


FORMS = {"ball": (ball, BALL), "cube": (cube, CUBE), "torus": (torus, TORUS)}


def in_voxels(points, side):
    """Means of the points of each voxel, as Open3D and PDAL thin."""
    place = np.floor(points / side).astype(np.int64)
    _, voxel = np.unique(place, axis=0, return_inverse=True)
    voxel = voxel.ravel()
    count = np.bincount(voxel)
    return np.column_stack([np.bincount(voxel, axis) / count for axis in points.T])


def holds(points, truth, rng, most, sigmas=2.5, **options):
    result = volume_of(rng.permutation(points), **options)
    assert result.volume_m3 == pytest.approx(truth, rel=most)
    assert abs(result.volume_m3 - truth) < sigmas * result.std_m3


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("noise", [0.0, 0.004])
def test_voxels(form, noise):
    rng = np.random.default_rng(8)
    make, truth = FORMS[form]
    points = make(200_000, rng)
    holds(in_voxels(points + noise * rng.normal(size=points.shape), 0.04), truth, rng, 0.004)


@pytest.mark.parametrize("place", [0.0, 0.004, 0.01, 0.017])
@pytest.mark.parametrize("sides", [(1.0, 1.0, 1.0), (1.0, 0.6, 0.3)])
def test_voxels_along_faces(place, sides):
    """Edges lie anywhere within voxels, and means tell nothing of it: z was up to 12."""
    rng = np.random.default_rng(8)
    points = cube(200_000, rng) * sides + place
    holds(in_voxels(points, 0.04), math.prod(sides), rng, 0.004, sigmas=2.2)


@pytest.mark.parametrize("form", FORMS)
def test_least_distance(form):
    rng = np.random.default_rng(9)
    make, truth = FORMS[form]
    holds(apart(make(60_000, rng), 0.05), truth, rng, 0.004)


@pytest.mark.parametrize("count", [2_000, 10_000])
def test_a_ball_of_golden_spirals(count):
    holds(even_vectors(count), BALL, np.random.default_rng(1), 2.5 / count)


@pytest.mark.parametrize("steps", [20, 50])
@pytest.mark.parametrize("ends", [0.0, 0.5])
def test_a_grid_on_a_cube(steps, ends):
    """Grids in the middles of steps cut every edge off, grids with points on the edges none."""
    holds(grid_on_cube(steps, ends), CUBE, np.random.default_rng(2), 0.8 / steps**2)


@pytest.mark.parametrize(("times", "most"), [(1, 0.55), (2, 0.3), (3, 0.05)])
def test_a_mesh_that_was_made_finer_cuts_nothing_off(times, most):
    """Its volume is that of its flat facets, not of what they are like: z was 7 to 41.

    It was too large by all that facets of its points would cut off of a smooth body.
    """
    rng = np.random.default_rng(times)
    points = ball(3_000 // 4**times, rng) * [1.0, 0.8, 0.6]
    hull = ConvexHull(points)
    made, triangles = hull.points, hull.simplices
    for _ in range(times):
        made, triangles = finer(made, triangles)
    holds(made, hull.volume, rng, most * (0.48 * BALL / hull.volume - 1.0) / 4**times)


def icosphere(times):
    """Points of an icosahedron whose triangles are divided, moved onto the ball each time."""
    golden = (1.0 + math.sqrt(5.0)) / 2.0
    one = np.array([[0.0, a, b * golden] for a in (-1.0, 1.0) for b in (-1.0, 1.0)])
    points = np.concatenate([np.roll(one, axis, axis=1) for axis in range(3)])
    for _ in range(times):
        points, _ = finer(points, ConvexHull(points).simplices)
        points /= np.linalg.norm(points, axis=1)[:, None]
    return points


def test_vertices_of_a_mesh_may_be_those_of_flat_facets_or_on_what_they_are_like():
    """Nothing tells. The mesh was outside of the interval by up to 26 of its sigmas."""
    for points in (icosphere(4), icosphere(5)):
        result = volume_of(np.random.default_rng(1).permutation(points))
        mesh = ConvexHull(points).volume
        assert mesh < result.volume_m3 < BALL
        for truth in (mesh, BALL):
            assert 0.5 * result.std_m3 < abs(result.volume_m3 - truth) < 1.5 * result.std_m3


def test_a_mesh_that_was_made_finer_and_rounded_is_measured():
    """All that turns lies between facets: a share of them was 1 + 2e-16, and its root none."""
    points = icosphere(2)
    made, _ = finer(points, ConvexHull(points).simplices)
    mesh = ConvexHull(points).volume
    for turn in Rotation.random(4, random_state=1):
        rounded = turn.apply(made).astype(np.float32).astype(np.float64)
        holds(rounded, mesh, np.random.default_rng(1), 1e-4)


@pytest.mark.parametrize("seed", range(4))
def test_edges_of_a_grid_that_lacks_points_have_no_points_along_them(seed):
    """They lie between flat faces, and were taken for those of a mesh's facets: z was -4."""
    rng = np.random.default_rng(seed)
    sides, faces = (0.8, 0.6, 0.5), []
    for axis in range(3):
        u, v = (np.linspace(0.0, side, round(side / 0.02) + 1) for side in np.delete(sides, axis))
        places = np.column_stack([some.ravel() for some in np.meshgrid(u, v)])
        faces += [np.insert(places, axis, at, axis=1) for at in (0.0, sides[axis])]
    points = np.unique(np.concatenate(faces), axis=0)
    askew = Rotation.from_rotvec([0.9, -0.5, 0.7]).as_matrix()
    holds(points[rng.random(len(points)) > 0.2] @ askew, math.prod(sides), rng, 0.004)


def test_of_what_was_completed_grids_are_no_vertices_of_meshes():
    """Points are put where nobody saw, in rows: all that triangles cut off counts."""
    points = icosphere(4)
    body = enclose(points, hollow=True, max_gap=None)
    assert isinstance(body, Enclosed)
    unseen = Unseen(share=0.1, low=4.0, high=4.2, shift=0.0, std=0.1, cameras=0)
    less = estimate.estimate(body, None, 1).volume - body.within
    more = estimate.estimate(replace(body, unseen=unseen), None, 1).volume - body.within
    assert less == pytest.approx(0.6 * more, rel=0.05)


@pytest.mark.parametrize("seed", range(6))
def test_edges_lie_anywhere_within_a_step_of_grids(seed):
    """Each face with a phase of its own: z was up to 42, where only halves of steps were tried."""
    rng, step = np.random.default_rng(seed), 0.04
    sides, faces = rng.uniform(0.6, 1.6, 3), []
    for axis in range(3):
        for at in (0.0, sides[axis]):
            u, v = (np.arange(rng.random() * step, side, step) for side in np.delete(sides, axis))
            places = np.column_stack([some.ravel() for some in np.meshgrid(u, v)])
            faces.append(np.insert(places, axis, at, axis=1))
    points = np.concatenate(faces) @ Rotation.from_rotvec([0.9, -0.5, 0.7]).as_matrix()
    holds(points, math.prod(sides), rng, 0.003)


@pytest.mark.parametrize("corners", [5, 6, 8])
def test_edges_of_which_some_seem_to_have_points_along_them(corners):
    """A prism has them on all, but its caps' grid is not along these: z was up to 31."""
    step, height = 0.04, 0.8
    turn = 2.0 * math.pi * np.arange(corners + 1) / corners
    outline = 0.7 * np.column_stack([np.cos(turn), np.sin(turn)])
    count = round(1.4 * math.sin(math.pi / corners) / step)
    share = np.arange(count)[:, None] / count
    rim = np.concatenate([a + share * (b - a) for a, b in zip(outline[:-1], outline[1:])])
    levels = np.linspace(0.0, height, round(height / step) + 1)
    points = [np.insert(rim, 2, level, axis=1) for level in levels]
    grid = np.arange(-0.7, 0.7, step) + 0.013
    inner = np.column_stack([some.ravel() for some in np.meshgrid(grid, grid + 0.007)])
    apothem = 0.7 * math.cos(math.pi / corners)
    out = 0.5 * (outline[:-1] + outline[1:]) / apothem
    inner = inner[(inner @ out.T < apothem - 1e-6).all(axis=1)]
    points += [np.insert(inner, 2, level, axis=1) for level in (0.0, height)]
    area = 0.5 * corners * 0.49 * math.sin(2.0 * math.pi / corners)
    askew = Rotation.from_rotvec([0.9, -0.5, 0.7]).as_matrix()
    holds(np.concatenate(points) @ askew, area * height, np.random.default_rng(1), 0.003)


def test_even_points_mixed_with_points_at_random_are_no_means_of_voxels():
    """As far from both: the nearest distances of means are not so short. z was 9."""
    points = np.vstack([even_vectors(4_000), ball(1_000, np.random.default_rng(3))])
    holds(points, BALL, np.random.default_rng(1), 0.001)


@pytest.mark.parametrize("form", ["ball", "torus"])
def test_scan_lines(form):
    """A third of the points, thinned along the lines, tells nothing of the gaps between them.

    Where lines run around a pole they leave openings, which are completed.
    """
    rng = np.random.default_rng(3)
    make, truth = FORMS[form]
    points = make(300_000, rng)
    height = points @ np.array([0.6, 0.0, 0.8]) / 0.08
    holds(apart(points[np.abs(height - np.round(height)) < 0.05], 0.016), truth, rng, 0.025)


def test_means_of_many_points():
    """Means of voxels lie below a curved surface."""
    rng = np.random.default_rng(4)
    holds(in_voxels(ball(300_000, rng), 0.08), BALL, rng, 0.0006)


@pytest.mark.parametrize("thickness", [0.06, 0.1])
def test_means_in_a_plate_that_fewer_points_do_not_find(thickness):
    """A third of them, or a half, cannot tell the sides of a wall of 3 and 4 spacings apart."""
    rng = np.random.default_rng(5)
    points, side = rng.uniform(-0.5, 0.5, (200_000, 3)), rng.integers(0, 2, 200_000) - 0.5
    face = rng.choice(3, len(side), p=np.array([thickness, 1.0, thickness]) / (1 + 2 * thickness))
    points[np.arange(len(side)), face] = side
    turned = Rotation.from_euler("xyz", [20, 30, 40], degrees=True).apply(
        points * [1.0, thickness, 1.0]
    )
    holds(in_voxels(turned, 0.0225), thickness, rng, 0.0015, sigmas=1.6)


@pytest.mark.parametrize("count", [60_000, 400_000])
def test_what_is_merged_while_it_streams_lies_no_deeper_than_is_known(count):
    """A few points to a cube, or many: their means lie below the surface by other shares."""
    rng = np.random.default_rng(10)
    holds(torus(count, rng), TORUS, rng, 0.0004, thin_to=15_000)


@pytest.mark.parametrize("ends", [0.0, 0.5])
def test_grids_that_are_thinned_while_they_stream(ends):
    """Voxels hide whether points lie along edges: with their ends, or half a step from them."""
    rng = np.random.default_rng(12)
    turn = Rotation.from_euler("xyz", [20, 30, 40], degrees=True)
    holds(turn.apply(grid_on_cube(90, ends)), CUBE, rng, 0.0004, thin_to=15_000)


@pytest.mark.parametrize("hollow", [True, False])
@pytest.mark.parametrize("between", [0.08, 0.05])
def test_gaps_between_lines_are_no_openings(between, hollow):
    """The surface goes on over them, and what they may have bulged by is a part of it.

    A torus of which a part was not seen would be known to 20 %.
    """
    rng = np.random.default_rng(11)
    points = torus(600_000, rng)
    height = points @ np.array([0.6, 0.0, 0.8]) / between
    lines = apart(points[np.abs(height - np.round(height)) < 0.05], between / 5.0)
    result = volume_of(rng.permutation(lines), hollow=hollow)
    assert result.volume_m3 == pytest.approx(TORUS, rel=0.006)
    assert abs(result.volume_m3 - TORUS) < 2.5 * result.std_m3 < 0.02 * TORUS


def ring(radius, height, along):
    turn = np.linspace(0.0, 2.0 * math.pi, max(3, round(2.0 * math.pi * radius / along)), False)
    return np.column_stack([radius * np.cos(turn), radius * np.sin(turn), 0.0 * turn + height])


def test_lines_much_farther_apart_than_their_points_are_thinned_along():
    """A ball in latitudes 5 times and more as far apart was 10 % too small, z -2, and a torus in
    rings 12 times as far apart was refused: space between lines was seen through.
    """
    rng = np.random.default_rng(4)
    levels = np.linspace(-0.98, 0.98, 40)
    ball_lines = np.concatenate([ring(math.sqrt(1.0 - z**2), z, 0.01) for z in levels])
    holds(ball_lines, BALL, rng, 0.003)
    upright = ring(0.4, 0.0, 2.0 * math.pi / 60 / 12)[:, [0, 2, 1]]
    turns = Rotation.from_euler("z", np.arange(60)[:, None] * 6.0, degrees=True)
    rings = np.concatenate([turn.apply(upright + np.array([1.0, 0.0, 0.0])) for turn in turns])
    holds(rings, TORUS, rng, 0.02)


def surface_of(points):
    """Triangles of a convex body, as `enclose` returns them."""
    hull = ConvexHull(points)
    a, b, c = (points[hull.simplices[:, i]] for i in range(3))
    outward = (np.cross(b - a, c - a) * hull.equations[:, :3]).sum(axis=1) > 0.0
    return BodySurface.of(points, hull.simplices.astype(np.int64), outward)


def test_facets_of_a_ball_are_what_it_lacks():
    surface = surface_of(ball(3_000, np.random.default_rng(5)))
    found = facets_of(surface, np.empty((0, 3, 3)))
    lack = BALL - surface.volume()
    assert found.smooth == pytest.approx(lack, rel=0.02)
    assert found.smooth_by_turn == pytest.approx(lack, rel=0.02)
    assert found.curvature == pytest.approx(4.0 * math.pi, rel=0.01)
    assert found.edges == found.edges_by_turn == 0.0


def test_facets_that_close_openings_cut_nothing_off():
    surface = surface_of(ball(3_000, np.random.default_rng(6)))
    above = surface.corners[:, 0, 2] >= 0.0
    lids = surface.corners[~above][:, [2, 0, 1]]
    found = facets_of(surface, lids)
    assert found == facets_of(surface, np.empty((0, 3, 3)), above=0.0)
    assert found.area == pytest.approx(2.0 * math.pi, rel=0.1)


def test_nothing_is_cut_off_along_an_edge_with_points_on_it():
    steps = 16
    side = np.linspace(-0.5, 0.5, steps + 1)
    places = np.stack(np.meshgrid(side, side, indexing="ij"), axis=-1).reshape(-1, 2)
    first = (np.arange(steps)[:, None] * (steps + 1) + np.arange(steps)).ravel()[:, None]
    halves = np.vstack(
        [first + np.array(corners) for corners in ((0, steps + 1, steps + 2), (0, steps + 2, 1))]
    )
    faces = [places[halves], places[halves[:, ::-1]]]
    # Seen along an axis the other two turn left in cyclic order.
    triangles = [np.insert(faces[axis % 2 == out], axis, out - 0.5, axis=2)
                 for axis in range(3) for out in (0, 1)]  # fmt: skip
    points, number = np.unique(np.vstack(triangles).reshape(-1, 3), axis=0, return_inverse=True)
    askew = Rotation.from_rotvec([0.9, -0.5, 0.7]).as_matrix()
    surface = BodySurface.of(points @ askew, number.reshape(-1, 3))
    assert surface.volume() == pytest.approx(1.0)
    found = facets_of(surface, np.empty((0, 3, 3)))
    assert found.curvature == pytest.approx(3.0 * math.pi)
    assert found.sharp == pytest.approx(1.0)
    assert found.volume == pytest.approx(0.0, abs=1e-12)
    assert found.edges_by_turn == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("closer", [1.0, 3.0])
def test_facets_of_a_cylinder_whose_rims_have_points_are_what_it_lacks(closer):
    """Rings of points, as close along them or farther: a prism cuts off segments of a circle."""
    count = 48
    turn = 2.0 * math.pi * np.arange(count) / count
    rings = np.linspace(-0.5, 0.5, round(closer * count / (2.0 * math.pi)) + 1)
    points = np.concatenate([np.column_stack([np.cos(turn), np.sin(turn), 0.0 * turn + z])
                             for z in rings] + [[[0.0, 0.0, -0.5], [0.0, 0.0, 0.5]]])  # fmt: skip
    first = np.arange(len(points) - count - 2).reshape(-1, count)
    after = np.roll(first, -1, axis=1)
    halves = [(first, after, after + count), (first, after + count, first + count)]
    sides = np.concatenate([np.stack(half, axis=-1).reshape(-1, 3) for half in halves])
    middle = np.full(count, len(points) - 2)
    bottom = np.stack([middle, after[0], first[0]], axis=-1)
    top = np.stack([middle + 1, first[-1] + count, after[-1] + count], axis=-1)
    askew = Rotation.from_rotvec([0.9, -0.5, 0.7]).as_matrix()
    surface = BodySurface.of(points @ askew, np.concatenate([sides, bottom, top]))
    inscribed = 0.5 * count * math.sin(2.0 * math.pi / count)
    assert surface.volume() == pytest.approx(inscribed)
    found = facets_of(surface, np.empty((0, 3, 3)))
    assert found.volume == pytest.approx(math.pi - inscribed, rel=0.01)


def test_what_is_chamfered_is_told_by_normals_and_by_turning():
    """A cube without points along its edges, half a step from them: s^2 / 8 of each edge's length.

    Its corners lack a little more.
    """
    steps = 24
    middles = (np.arange(steps) + 0.5) / steps - 0.5
    places = np.stack(np.meshgrid(middles, middles), axis=-1).reshape(-1, 2)
    points = np.concatenate([np.insert(places, axis, at, axis=1)
                             for axis in range(3) for at in (-0.5, 0.5)])  # fmt: skip
    # A little curved, since a hull has no corners in the middle of planes.
    points *= 1.0 + 1e-6 * (0.75 - (points**2).sum(axis=1, keepdims=True))
    found = facets_of(surface_of(points), np.empty((0, 3, 3)))
    lack = 1.0 - ConvexHull(points).volume
    assert lack == pytest.approx(12.0 / 8.0 / steps**2, rel=0.1)
    assert found.smooth == pytest.approx(0.0, abs=0.01 * lack)
    assert found.volume == pytest.approx(lack, rel=0.2)
    assert found.edges == pytest.approx(lack, rel=0.2)
    assert found.edges_by_turn == pytest.approx(lack, rel=0.2)


def sampling_std(points):
    budget = volume_of(points).budget
    return next(one.std_m3 for one in budget if one.source == "sampling")


@cache
def small_ball():
    """Random points, and how well their sampling is known."""
    points = 0.5 * ball(6_000, np.random.default_rng(2))
    return points, sampling_std(points)


@pytest.mark.parametrize("ratios", [(0.5, 0.8), (2 / 3, 0.65)])
def test_of_points_in_groups_facets_are_known_less_well(monkeypatch, ratios):
    """As of vertices of marching cubes, however coarse the triangles of a third of them are."""
    points, alone = small_ball()
    facets = math.pi / 6.0 - ConvexHull(points).volume
    monkeypatch.setattr(pattern, "nearness", lambda _: Nearness(*ratios, 6 / 7, 0.01, 0.5))
    more = math.sqrt(sampling_std(points) ** 2 - alone**2)
    assert more == pytest.approx(0.6 * 4 / 27 * facets, rel=0.1)
