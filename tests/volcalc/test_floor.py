"""The plane that a body stands on is found, is ground only beside it, and becomes level."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scans import OFFSET, Flaws, scan
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation
from solids import cube, sphere, table

from quantify_client.volcalc.body.floor import lid, stand
from quantify_client.volcalc.body.plane import FloorPlane, Pose, find_plane, is_ground


def spacing_of(points):
    return float(np.median(cKDTree(points).query(points, [7])[0]))


def on_ground(body=sphere, tilt=0.0, noise=0.002, count=2500, **flaws):
    """A scan about the origin, its spacing, and its ground's true normal and height."""
    points = scan(body(), count, 7, Flaws(ground=2.5, tilt=tilt, noise=noise, **flaws)) - OFFSET
    turn = Rotation.from_euler("xy", [tilt, tilt / 2], degrees=True).as_matrix()
    return points, spacing_of(points), turn[:, 2], -0.5 if body is sphere else 0.0


@pytest.mark.parametrize("body", [sphere, cube, table])
@pytest.mark.parametrize("tilt", [0.0, 30.0])
@pytest.mark.parametrize("outliers", [0.0, 0.01])
def test_the_ground_is_found(body, tilt, outliers):
    points, spacing, normal, height = on_ground(body, tilt, outliers=outliers)
    plane = find_plane(points, spacing)
    assert np.degrees(np.arccos(min(1.0, plane.normal @ normal))) < 0.3
    assert plane.offset == pytest.approx(height, abs=0.004)
    # Four sigma of 2 mm times the extent of the body, and not much more.
    assert 0.2 * spacing <= plane.reach < 0.02
    assert is_ground(points, plane, spacing)


def test_noisy_ground_is_found():
    points, spacing, normal, height = on_ground(noise=0.01)
    plane = find_plane(points, spacing)
    assert np.degrees(np.arccos(min(1.0, plane.normal @ normal))) < 1.5
    assert plane.offset == pytest.approx(height, abs=0.02)
    assert is_ground(points, plane, spacing)


def test_ground_of_one_height_is_found_exactly():
    # A box on a level lattice: no noise at all.
    x, y = np.meshgrid(np.arange(-2, 2.01, 0.1), np.arange(-2, 2.01, 0.1))
    flat = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, 3.0)])
    box = cube().surface(1500, np.random.default_rng(0)) - [0.5, 0.5, 0.0]
    box = box[box[:, 2] > 0.06] + [0, 0, 3.0]  # beyond half a spacing from it
    points = np.vstack([flat[np.abs(flat[:, :2]).max(axis=1) > 0.5], box])
    plane = find_plane(points, 0.1)
    np.testing.assert_allclose(plane.normal, [0, 0, 1], atol=1e-9)
    assert plane.offset == pytest.approx(3.0, abs=1e-9)
    np.testing.assert_allclose(plane.height(np.array([[9.0, 9.0, 5.0]])), [2.0], atol=1e-9)


@pytest.mark.parametrize("noise", [0.0, 0.003])
@pytest.mark.parametrize("least", [-1.5, 0.5])
def test_ground_on_one_side_stays_level_below_a_wall(noise, least):
    """Points of the far wall are within the plane's reach: with them it tilts by 0.3 degrees."""
    rng = np.random.default_rng(4)
    box = cube().surface(6_000, rng)
    box = box[box[:, 2] > 1e-9]
    flat = np.column_stack([rng.uniform(-1.5, 2.5, (16_000, 2)), np.zeros(16_000)])
    flat = flat[(flat[:, 0] < 0.0) & (flat[:, 1] > least)]
    points = np.vstack([box, flat])
    points += rng.normal(scale=noise, size=points.shape) if noise else 0.0
    standing = stand(points, np.ones(len(points), dtype=np.int64), "auto")
    assert standing.floor.tilt_degrees < 0.05
    # What lies over the far edge of the box tells how far the plane has sunk or risen there.
    assert standing.upright(np.array([[1.0, 0.5, 1.0]]))[0, 2] == pytest.approx(1.0, abs=0.002)


@pytest.mark.parametrize("turned", [False, True])
def test_the_faces_of_a_cube_support_it_but_are_no_ground(turned):
    points = scan(cube(), 4000, 7) - OFFSET
    if turned:
        points = points @ Rotation.from_rotvec([0.9, -0.5, 0.7]).as_matrix()
    spacing = spacing_of(points)
    plane = find_plane(points, spacing)
    assert plane is not None
    assert plane.height(points).min() > -spacing
    assert not is_ground(points, plane, spacing)


def test_a_ball_stands_on_no_plane():
    points = scan(sphere(), 4000, 7) - OFFSET
    spacing = spacing_of(points)
    plane = find_plane(points, spacing)
    assert plane is None or not is_ground(points, plane, spacing)


@pytest.mark.parametrize("seed", [3, 4, 9])
def test_half_a_ball_is_no_ground(seed):
    points = scan(sphere(), 3000, seed) - OFFSET
    points = points[points[:, 2] > 0]
    points = points[np.lexsort(points.T)]
    spacing = spacing_of(points)
    plane = find_plane(points, spacing, 60.0)
    assert plane is None or not is_ground(points, plane, spacing)


def test_a_plane_through_the_body_supports_nothing():
    # A disc with a ball on either side of it.
    rng = np.random.default_rng(0)
    angle, away = 2 * np.pi * rng.random(2000), 2 * np.sqrt(rng.random(2000))
    disc = np.column_stack([away * np.cos(angle), away * np.sin(angle), np.zeros(2000)])
    balls = sphere().surface(2000, rng) + np.where(rng.random((2000, 1)) < 0.5, 0.6, -0.6)
    points = np.vstack([disc, balls])
    plane = find_plane(points, spacing_of(points))
    assert plane is None or abs(plane.normal[2]) < 0.9


def test_a_wall_is_a_floor_only_when_floors_may_be_as_steep():
    points, spacing, _, _ = on_ground()
    upright = points @ Rotation.from_euler("x", 90, degrees=True).as_matrix()
    plane = find_plane(upright, spacing, steepest=180.0)
    assert abs(plane.normal[2]) < 0.01
    other = find_plane(upright, spacing, steepest=60.0)
    assert other is None or not is_ground(upright, other, spacing)


def test_a_ceiling_is_a_floor_only_when_asked_for():
    points, spacing, _, _ = on_ground()
    hanging = points * [1, -1, -1]
    assert find_plane(hanging, spacing, steepest=180.0).normal[2] < -0.999
    other = find_plane(hanging, spacing, steepest=60.0)
    assert other is None or not is_ground(hanging, other, spacing)


# --- pose

_UNIT = st.tuples(*3 * [st.floats(-1, 1)]).filter(lambda v: np.linalg.norm(v) > 0.1)


@given(normal=_UNIT, offset=st.floats(-5, 5), seed=st.integers(0, 100))
@settings(max_examples=40)
def test_a_pose_makes_the_plane_level_and_can_be_undone(normal, offset, seed):
    normal = np.array(normal) / np.linalg.norm(normal)
    points = np.random.default_rng(seed).normal(loc=(300.0, -200.0, 50.0), size=(20, 3))
    plane = FloorPlane(normal, offset, 0.0)
    pose = Pose.on(plane, points)
    turned = pose.apply(points)
    np.testing.assert_allclose(turned[:, 2], points @ normal - offset, atol=1e-9)
    np.testing.assert_allclose(pose.undo(turned), points, atol=1e-9)
    # A rotation, no reflection.
    assert np.linalg.det(pose.rotation) == pytest.approx(1.0, abs=1e-9)
    np.testing.assert_allclose(pose.rotation @ pose.rotation.T, np.eye(3), atol=1e-9)
    # About the foot of the middle, whose x and y stay.
    foot = points.mean(axis=0) - normal * (points.mean(axis=0) @ normal - offset)
    np.testing.assert_allclose(pose.apply(foot[None])[0], [*foot[:2], 0.0], atol=1e-9)


@pytest.mark.parametrize("normal", [(0, 0, 1), (0, 0, -1), (1, 0, 0), (0, -0.6, 0.8)])
def test_a_pose_turns_no_further_than_the_plane_is_tilted(normal):
    points = np.random.default_rng(0).normal(size=(20, 3))
    pose = Pose.on(FloorPlane(np.array(normal, dtype=float), 0.3, 0.0), points)
    np.testing.assert_allclose(pose.rotation @ normal, [0, 0, 1], atol=1e-12)
    angle = np.arccos(np.clip((np.trace(pose.rotation) - 1) / 2, -1, 1))
    assert angle == pytest.approx(np.arccos(normal[2]), abs=1e-7)


# --- lid


def test_a_lid_lies_under_the_whole_foot_and_little_beyond():
    rng = np.random.default_rng(0)
    away, angle = np.sqrt(rng.random(2000)), 2 * np.pi * rng.random(2000)
    foot = np.column_stack([2 * away * np.cos(angle), away * np.sin(angle), rng.random(2000)])
    far = np.array([[9.0, 9.0, 1.5]])
    spacing = 0.1
    found = lid(np.vstack([foot, far]), 0.25, 1.0, spacing)
    assert np.all(found[:, 2] == 0.25)
    assert cKDTree(found[:, :2]).query(foot[:, :2])[0].max() < 0.6 * spacing
    beyond = np.hypot(found[:, 0] / 2, found[:, 1])
    assert 1.0 < beyond.max() < 1.0 + 3 * spacing
    # One for each cell of 0.6 x 0.6 spacings; the ellipse of 2 x 1 and two spacings round it.
    area = np.pi * (2 + 2 * spacing) * (1 + 2 * spacing)
    assert len(found) == pytest.approx(area / (0.6 * spacing) ** 2, rel=0.06)
    # As dense as the surface: no ball slips through.
    neighbour = cKDTree(found).query(found, [2])[0]
    assert neighbour.max() < spacing


def test_a_lid_lies_under_what_is_low_only():
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [50, 50, 2.0]])
    found = lid(points, 0.0, 1.0, 0.1)
    assert np.abs(found[:, :2] - 0.5).max() < 1.0


@pytest.mark.parametrize("count", [0, 1, 2])
def test_so_few_points_have_no_foot(count):
    assert lid(np.zeros((count, 3)), 0.0, 1.0, 0.1).shape == (0, 3)
