"""A body is found on its ground: what is left out is counted, and the foot is closed."""

from functools import cache

import numpy as np
import pytest
from scans import OFFSET, Flaws, scan
from scipy.spatial import cKDTree
from solids import box_part, cube, sphere

from quantify_client.errors import InputError
from quantify_client.volcalc.body.floor import on_lowest_points, stand

COUNT = 2000


@cache
def standing_scan(tilt=0.0, outliers=0.0):
    """A sphere of diameter 1 about the origin on ground 2.5 wide, and how many points that has."""
    flaws = Flaws(ground=2.5, tilt=tilt, noise=0.002, outliers=outliers)
    return scan(sphere(), COUNT, 7, flaws) - OFFSET


def stood(points, floor, counts=None):
    """Stand the points, and check that none is lost."""
    counts = np.ones(len(points), dtype=np.int64) if counts is None else counts
    found = stand(points, counts, floor)
    kept = len(found.points) + len(found.ground) + len(found.outliers)
    assert kept == len(points)
    total = found.counts.sum() + found.ground_count + found.outlier_count
    assert total == counts.sum()
    together = np.vstack([found.points, found.ground, found.outliers])
    away = cKDTree(points).query(found.as_found(together))[0]
    assert away.max() < 1e-9
    return found


@pytest.mark.parametrize("tilt", [0.0, 30.0])
@pytest.mark.parametrize("floor", ["auto", "plane"])
def test_a_ball_on_ground_is_stood_upright_on_it(tilt, floor):
    points = standing_scan(tilt)
    found = stood(points, floor)
    assert found.floor.found == "in the cloud"
    # scan tilts about x, then half as much about y.
    upright = np.cos(np.radians(tilt)) * np.cos(np.radians(tilt / 2))
    assert found.floor.tilt_degrees == pytest.approx(np.degrees(np.arccos(upright)), abs=0.4)
    assert found.floor.normal[2] == pytest.approx(upright, abs=0.005)
    # Heights count from the floor: the ball reaches from 0 to 1.
    assert found.points[:, 2].min() > 0.0
    assert found.points[:, 2].max() == pytest.approx(1.0, abs=0.01)
    assert np.abs(found.ground[:, 2]).max() < 0.03
    # What lies on the ground is a ball's foot: a cap lower than the ground's own noise, no more.
    assert len(found.points) == pytest.approx(COUNT, rel=0.03)
    assert found.floor.points == found.ground_count
    # Closed at its foot, where the ground ended.
    assert found.lid[:, 2].max() == pytest.approx(found.sure + found.unsure)
    assert found.sure + found.unsure < 0.03


def test_a_floor_is_given_by_its_elevation():
    points = standing_scan() + np.array([0.0, 0.0, 12.0])
    found = stood(points, 11.9)
    assert (found.floor.found, found.floor.tilt_degrees) == ("given", 0.0)
    assert found.floor.elevation == pytest.approx(11.9)
    assert found.floor.normal == (0.0, 0.0, 1.0)
    # Everything below is left out: ground and the lowest 0.4 m of the ball.
    below = points[:, 2] < 11.9
    assert found.ground_count == pytest.approx(below.sum(), rel=0.05)
    np.testing.assert_allclose(found.points[:, 2].max(), 0.6, atol=0.01)
    # The lid reaches as far as the ball, of radius 0.5, and two spacings beyond.
    assert 0.5 < np.hypot(*found.lid[:, :2].T).max() < 0.65


@pytest.mark.parametrize("floor", ["none", "auto"])
@pytest.mark.parametrize("body", [cube, sphere])
def test_a_body_without_ground_is_left_as_it_is(body, floor):
    points = scan(body(), COUNT, 1) - OFFSET
    found = stood(points, floor)
    assert found.floor is None
    assert found.pose is None
    assert (found.ground_count, found.outlier_count, len(found.lid)) == (0, 0, 0)
    np.testing.assert_array_equal(found.points, points)


def test_ground_is_body_when_no_floor_is_wanted():
    assert len(stood(standing_scan(), "none").points) > 1.5 * COUNT


def test_outliers_are_left_out_and_counted():
    points = standing_scan(outliers=0.01)
    clean = len(stood(standing_scan(), "auto").points)
    counts = np.arange(1, len(points) + 1)
    found = stood(points, "auto", counts)
    # Some lie below the floor and count as ground; those in the way of the surface stay.
    assert 3 <= len(found.outliers) <= 0.012 * COUNT
    assert len(found.points) == pytest.approx(clean, rel=0.01)
    assert found.outlier_count >= len(found.outliers)


def test_a_wanted_plane_that_is_not_there_is_an_error_in_one_line():
    # Two balls of points, one within the other: no plane has much of them and all on one side.
    points = np.random.default_rng(0).normal(size=(3000, 3))
    with pytest.raises(InputError, match="give the floor's elevation") as refused:
        stand(points, np.ones(3000, dtype=np.int64), "plane")
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("floor", [2.0, "plane"])
def test_a_floor_with_nothing_above_it_is_an_error_in_one_line(floor):
    points = np.random.default_rng(0).random((2000, 3)) * [1.0, 1.0, 1e-4]
    with pytest.raises(InputError, match="nothing stands above the floor") as refused:
        stand(points, np.ones(2000, dtype=np.int64), floor)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("floor", ["auto", "none", "plane", 0.0])
@pytest.mark.parametrize("count", [1, 4, 6])
def test_few_points_have_no_floor(floor, count):
    points = np.random.default_rng(0).normal(size=(count, 3))
    assert stood(points, floor).floor is None


def test_the_fewest_points_that_may_stand_have_a_lid():
    ground = np.stack(np.meshgrid(np.arange(9.0), np.arange(9.0), [0.0]), axis=-1).reshape(-1, 3)
    body = np.random.default_rng(0).uniform((3, 3, 1), (4, 4, 2), (7, 3))
    found = stood(np.vstack([ground, body]), 0.0)
    assert len(found.points) == 7
    assert len(found.lid)
    assert np.isfinite(found.lid).all()
    assert np.isfinite(on_lowest_points(stood(body[:6], "none")).lid).all()


def test_a_body_open_below_is_closed_at_its_lowest_points():
    box = box_part((0, 0, 3), (2, 1, 4)).surface(4000, np.random.default_rng(0))
    box = box[box[:, 2] > 3.0]
    closed = on_lowest_points(stood(box, "auto"))
    assert closed.floor.found == "lowest points"
    assert closed.floor.elevation == box[:, 2].min()
    assert closed.lid[0, 2] == pytest.approx(3.0, abs=0.02)
    assert closed.pose is None
    np.testing.assert_array_equal(closed.points, box)
    # The lid covers the base of 2 x 1.
    np.testing.assert_allclose(closed.lid[:, :2].min(axis=0), [0, 0], atol=0.15)
    np.testing.assert_allclose(closed.lid[:, :2].max(axis=0), [2, 1], atol=0.15)
    assert 0.0 < closed.unsure < 0.03
