"""The base `ground`: by the class of points, and by a filter; on ground that is known."""

from __future__ import annotations

import laspy
import numpy as np
import pytest
from pyproj import CRS
from test_given_bases import EAST, NORTH, areas, the_only

import quantify_client
from quantify_client.cloud import open_cloud
from quantify_client.cloud.base import GroundOnly
from quantify_client.errors import UsageError
from quantify_client.types import AreaFailure

# Arithmetic of arrays: no different on a second Python.
pytestmark = pytest.mark.one_python

#: Half sides and height of a house, middle, radius and height of half a ball of leaves.
HOUSE, BUSH = (5.0, 4.0, 4.0), (-20.0, 10.0, 5.0)


def ground(x, y):
    return 300.0 + 0.05 * x + 1.5 * np.sin(x / 17) * np.cos(y / 23)


def scene(path, classified=True, noise=0.02, count=150_000, seed=1):
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-50, 50, (2, count))
    z = ground(x, y) + noise * rng.standard_normal(count)
    classes = np.full(count, 2, dtype=np.uint8)
    wide, deep, tall = HOUSE
    house = (np.abs(x - 20) < wide) & (np.abs(y) < deep)
    z[house] += tall
    classes[house] = 6
    a, b, r = BUSH
    away = np.hypot(x - a, y - b)
    # Between the leaves the ground is seen.
    bush = (away < r) & (rng.random(count) < 0.6)
    z[bush] += np.sqrt(r**2 - away[bush] ** 2)
    classes[bush] = 5
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = [1e-3] * 3, [EAST, NORTH, 0.0]
    header.add_crs(CRS.from_user_input("EPSG:32632"))
    las = laspy.LasData(header)
    las.x, las.y, las.z = x + EAST, y + NORTH, z
    if classified:
        las.classification = classes
    las.write(str(path))
    return str(path)


def box(x, y, half):
    ring = [(x - half, y - half), (x + half, y - half), (x + half, y + half), (x - half, y + half)]
    return [[EAST + a, NORTH + b] for a, b in [*ring, ring[0]]]


@pytest.mark.parametrize("classified", [True, False])
def test_a_house_on_ground_that_is_seen_around_it(tmp_path, classified):
    cloud = scene(tmp_path / "house.laz", classified)
    found = quantify_client.measure(cloud, area=areas(box(20, 0, 9.0)), base="ground", grid=True)
    result = the_only(found)
    assert result.base == "ground"
    low, high = result.interval95_m3
    truth = 4.0 * HOUSE[0] * HOUSE[1] * HOUSE[2]
    assert low < truth < high
    assert result.volume_m3 == pytest.approx(truth, rel=0.02)
    assert high - low < 0.08 * truth
    told = [notice.code for notice in found.warnings]
    assert ("ground-filtered" in told) == (not classified)


def test_leaves_are_measured_on_the_ground_between_them(tmp_path):
    cloud = scene(tmp_path / "bush.laz")
    found = quantify_client.measure(cloud, area=areas(box(-20, 10, 7.5)), base="ground", grid=True)
    result = the_only(found)
    ball = 2.0 * np.pi * BUSH[2] ** 3 / 3.0
    low, high = result.interval95_m3
    assert low < ball < high
    assert result.fill_m3 < 0.01 * result.cut_m3


def test_nothing_is_measured_where_nothing_stands(tmp_path):
    cloud = scene(tmp_path / "bare.laz")
    found = quantify_client.measure(cloud, area=areas(box(-20, -25, 9.0)), base="ground", grid=True)
    result = the_only(found)
    assert result.volume_m3 == pytest.approx(0.0, abs=1e-6)
    whole = the_only(quantify_client.measure(cloud, base="ground", grid=True))
    assert whole.volume_m3 > 500.0  # house and bush, and no relief


def test_ground_that_is_not_seen_is_refused_with_the_way_out(tmp_path):
    cloud = scene(tmp_path / "house.laz")
    (failed,) = quantify_client.measure(cloud, area=areas(box(20, 0, 5.0)), base="ground").results
    assert isinstance(failed, AreaFailure)
    assert "less than half" in failed.error
    assert "--base kriged" in failed.error
    with pytest.raises(UsageError, match="--base ground goes with areas that were drawn"):
        quantify_client.measure(cloud, area="auto", base="ground")


def test_only_points_of_class_2_are_ground(tmp_path):
    cloud = open_cloud([(tmp_path / scene(tmp_path / "scene.laz", count=5_000))])
    kept = sum(len(chunk) for chunk in GroundOnly(cloud, cloud.info).chunks())
    classes = laspy.read(tmp_path / "scene.laz").classification
    assert kept == np.count_nonzero(np.asarray(classes) == 2) < 5_000
    bare = open_cloud([(tmp_path / scene(tmp_path / "bare.laz", False, count=5_000))])
    assert not sum(len(chunk) for chunk in GroundOnly(bare, bare.info).chunks())
