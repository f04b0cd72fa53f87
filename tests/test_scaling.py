"""Clouds of the wrong size: control gives true volumes, and its error their budget."""

from __future__ import annotations

import json
import math
from pathlib import Path

import laspy
import numpy as np
import pyproj
import pytest
import shapely
import sized
from clouds import ORIGIN, write_las
from scipy.spatial.transform import Rotation
from shapely.geometry import mapping, shape
from solids import sphere
from terrains import CLEAN, cone, placed, survey, tilted

from quantify_client import AreaResult, measure, scale

DEMO = Path(__file__).parents[1] / "quantify_client" / "demo"
PILE = cone(radius=8.0, top=4.0).on(tilted)
TRUTH = PILE.volume / sized.ground_factor() ** 2


@pytest.fixture(scope="module")
def points():
    return survey(PILE.height, CLEAN, 60_000)


def shrunk(points, factor):
    return sized.CENTRE + factor * (points - sized.CENTRE)


def place(tmp_path, points, name="cloud.laz", crs=sized.UTM):
    return write_las(tmp_path / name, points, crs=crs)


def drawn(outline, crs=sized.UTM):
    document = {
        "type": "FeatureCollection",
        "features": [
            {"type": "Feature", "properties": {"name": "pile"}, "geometry": mapping(outline)}
        ],
    }
    if crs:
        document["crs"] = {"type": "name", "properties": {"name": crs}}
    return document


def one(measurement) -> AreaResult:
    (result,) = measurement.results
    assert isinstance(result, AreaResult), result
    return result


def item(result, source="scale"):
    (found,) = [entry for entry in result.budget if entry.source == source]
    return found


# --- a cloud that keeps its CRS


@pytest.mark.parametrize("gps", [None, 0.02, 3.0])
def test_a_shrunk_cloud_gives_the_true_volume(points, tmp_path, gps):
    cloud = place(tmp_path, shrunk(points, 0.83))
    truth = sized.marks(PILE.height)
    levels = 3 if gps == 0.02 else 0
    asked = sized.control(truth, shrunk(truth, 0.83), gps=gps, levels=levels)
    gcp = sized.write(tmp_path / "control.json", asked)
    outline = shapely.transform(PILE.area, lambda xy: shrunk2(xy, 0.83))
    measurement = measure(cloud, area=drawn(outline), gcp=gcp)
    scaling = measurement.scale
    assert scaling.factor == pytest.approx(1 / 0.83, abs=4 * scaling.std)
    assert scaling.std / scaling.factor < 2e-4
    assert scaling.mode == ("scale" if gps is None else "shift")
    assert scaling.target_crs == measurement.crs == sized.UTM
    result = one(measurement)
    assert result.cut_m3 == pytest.approx(TRUTH, rel=2e-3)
    assert abs(result.cut_m3 - TRUTH) < 3 * result.cut_std_m3


def shrunk2(xy, factor):
    return sized.CENTRE[:2] + factor * (xy - sized.CENTRE[:2])


def test_a_cloud_of_the_right_size_stays_as_it_is(points, tmp_path):
    cloud, truth = place(tmp_path, points), sized.marks(PILE.height)
    gcp = sized.write(tmp_path / "control.json", sized.control(truth, truth, noise=False))
    plain = one(measure(cloud, area=drawn(PILE.area)))
    measurement = measure(cloud, area=drawn(PILE.area), gcp=gcp)
    assert measurement.scale.factor == pytest.approx(1.0, abs=1e-6)
    np.testing.assert_allclose(measurement.scale.transform, np.eye(4), atol=1e-6 * 5e6)
    assert one(measurement).cut_m3 == pytest.approx(plain.cut_m3, rel=1e-4)


def test_elevations_in_the_clouds_frame_move_with_it(points, tmp_path):
    cloud = place(tmp_path, shrunk(points, 0.83))
    truth = sized.marks(PILE.height)
    gcp = sized.write(tmp_path / "c.json", sized.control(truth, shrunk(truth, 0.83), noise=False))
    outline = shapely.transform(PILE.area, lambda xy: shrunk2(xy, 0.83))
    level = float(shrunk(np.array([[0, 0, sized.LEVEL + 1.0]]), 0.83)[0, 2])
    scaled = one(measure(cloud, area=drawn(outline), gcp=gcp, base=level))
    true = place(tmp_path, points, "true.laz")
    plain = one(measure(true, area=drawn(PILE.area), base=sized.LEVEL + 1.0))
    assert scaled.volume_m3 == pytest.approx(plain.volume_m3, rel=2e-3)


@pytest.mark.one_python
def test_surveyed_areas_stay_where_they_are(points, tmp_path):
    cloud = place(tmp_path, shrunk(points, 0.83))
    truth = sized.marks(PILE.height)
    asked = sized.control(truth, shrunk(truth, 0.83), gps=0.02, noise=False)
    gcp = sized.write(tmp_path / "control.json", asked)
    result = one(measure(cloud, area=drawn(PILE.area), gcp=gcp, area_frame="control"))
    assert result.cut_m3 == pytest.approx(TRUTH, rel=2e-3)


# --- the budget


def test_the_scales_share_is_three_times_its_own(points, tmp_path):
    cloud, truth = place(tmp_path, points), sized.marks(PILE.height)
    gcp = sized.write(tmp_path / "control.json", sized.control(truth, truth, tapes=1))
    measurement = measure(cloud, area=drawn(PILE.area), gcp=gcp, density=1.6)
    result, scaling = one(measurement), measurement.scale
    ratio = scaling.std / scaling.factor
    found = item(result)
    assert found.std_m3 == pytest.approx(3 * ratio * abs(result.volume_m3))
    assert found.cut_std_m3 == pytest.approx(3 * ratio * result.cut_m3)
    assert found.fill_std_m3 == pytest.approx(3 * ratio * result.fill_m3)
    total = math.sqrt(sum(entry.std_m3**2 for entry in result.budget))
    assert result.std_m3 == pytest.approx(total)
    cut = math.sqrt(sum(entry.cut_std_m3**2 for entry in result.budget))
    assert result.cut_std_m3 == pytest.approx(cut)
    assert result.mass_std_t == pytest.approx(1.6 * cut)


@pytest.mark.one_python
def test_surveyed_areas_take_the_scales_share_by_derivative(tmp_path):
    """On a step a fixed area A holds V = A (m + s (z - m) - level), m being the control's middle.

    The derivative is A (z - m): here much less than the 3 V of an area that grows along.
    """

    def step(x, y):
        return np.where(x > 15.0, 4.0, 0.0)

    truth = sized.marks(step)
    asked = sized.control(truth, truth, tapes=1, gps=0.02, levels=8, level=0.0005)
    gcp = sized.write(tmp_path / "control.json", asked)
    outline = placed(shapely.box(24, 10, 34, 30))
    measurement = measure(
        place(tmp_path, survey(step, CLEAN, 60_000)),
        area=drawn(outline),
        gcp=gcp,
        base=sized.LEVEL + 1.0,
        area_frame="control",
    )
    ratio = measurement.scale.std / measurement.scale.factor
    middle = truth[:, 2].mean() - sized.LEVEL
    area = 200.0 / sized.ground_factor() ** 2
    found = item(one(measurement))
    # and its height above the level, by hand: eight marks, their elevations and their picks
    height = area * math.hypot(0.0005, 0.005) / math.sqrt(8)
    by_scale = ratio * area * (4.0 - middle)
    assert found.std_m3 == pytest.approx(math.hypot(by_scale, height), rel=0.1)


# --- a cloud in a frame of its own


def turned(points, rotation, factor=0.83):
    return factor * (points - sized.CENTRE) @ rotation.as_matrix().T + ORIGIN


def test_a_cloud_in_any_pose_is_set_upright_and_true(points, tmp_path):
    rotation = Rotation.from_euler("zyx", [70, 25, -35], degrees=True)
    cloud = place(tmp_path, turned(points, rotation), crs=None)
    truth = sized.marks(PILE.height, 10)
    asked = sized.control(truth, turned(truth, rotation), gps=0.02, levels=6, height=100.0)
    gcp = sized.write(tmp_path / "control.json", asked)
    measurement = measure(cloud, area=drawn(PILE.area), gcp=gcp, area_frame="control")
    assert measurement.scale.mode == "full"
    assert measurement.crs == sized.UTM
    assert measurement.scale.tilt_std_deg < 0.1
    assert one(measurement).cut_m3 == pytest.approx(TRUTH, rel=5e-3)
    assert one(measurement).max_z_m == pytest.approx(points[:, 2].max(), abs=0.1)


def test_an_outline_drawn_on_a_tilted_cloud_moves_with_it(points, tmp_path):
    rotation = Rotation.from_euler("zyx", [70, 8, -12], degrees=True)
    cloud = place(tmp_path, turned(points, rotation), crs=None)
    truth = sized.marks(PILE.height, 10)
    asked = sized.control(truth, turned(truth, rotation), gps=0.02, levels=6, height=100.0)
    gcp = sized.write(tmp_path / "control.json", asked)
    ring = np.array(shapely.get_coordinates(PILE.area))
    x, y = ring[:, 0] - sized.EAST, ring[:, 1] - sized.NORTH
    on_surface = np.column_stack([ring, PILE.height(x, y) + sized.LEVEL])
    outline = shapely.Polygon(turned(on_surface, rotation)[:, :2])
    result = one(measure(cloud, area=drawn(outline, None), gcp=gcp, shape="terrain"))
    assert result.cut_m3 == pytest.approx(TRUTH, rel=5e-3)
    assert result.area_m2 == pytest.approx(PILE.area.area / sized.ground_factor() ** 2, rel=5e-3)


def test_a_body_is_scaled_by_one_bar(tmp_path):
    body = sphere()
    rng = np.random.default_rng(1)
    surface = body.surface(20_000, rng)
    np.savetxt(tmp_path / "ball.xyz", 2.5 * surface + [3.0, 4.0, 5.0], "%.9f")
    ends = surface[[int(np.argmax(surface[:, 0])), int(np.argmin(surface[:, 0]))]]
    length = float(np.linalg.norm(ends[1] - ends[0]))
    document = {
        "unit": "m",
        "cloud": {
            name: {"xyz": [float(v) for v in 2.5 * end + [3.0, 4.0, 5.0]], "accuracy": 1e-4}
            for name, end in zip("PQ", ends)
        },
        "scale_bars": [{"from": "P", "to": "Q", "length": length, "accuracy": 0.001}],
    }
    gcp = sized.write(tmp_path / "control.json", document)
    measurement = measure(tmp_path / "ball.xyz", gcp=gcp)
    assert measurement.shape == "object"
    assert measurement.length_unit == "m"
    assert measurement.scale.mode == "scale"
    assert measurement.scale.factor == pytest.approx(0.4, rel=1e-6)
    # by hand: the bar's own sigma and both ends' in the cloud, over its length
    ratio = math.hypot(0.001, math.sqrt(2) * 1e-4 * 0.4) / length
    assert measurement.scale.std / measurement.scale.factor == pytest.approx(ratio, rel=1e-3)
    result = one(measurement)
    assert result.volume_m3 == pytest.approx(body.volume, rel=1e-3)
    assert item(result).std_m3 == pytest.approx(3 * ratio * result.volume_m3, rel=1e-3)


# --- units, and clouds in degrees


def test_a_cloud_in_feet_keeps_its_unit(points, tmp_path):
    feet = "EPSG:2222"  # Arizona East, international feet
    origin = pyproj.Transformer.from_crs(4326, feet, always_xy=True).transform(-110.0, 34.0)
    grid, marked = (
        (places - sized.CENTRE) / 0.3048 + [*origin, 300.0]
        for places in (points, sized.marks(PILE.height))
    )
    middle = grid.mean(axis=0)
    cloud = write_feet(tmp_path / "ft.las", middle + 0.9 * (grid - middle), feet)
    document = {
        "unit": "ft",
        "cloud": {
            name: {"xyz": [float(v) for v in middle + 0.9 * (place - middle)], "accuracy": 0.01}
            for name, place in zip("AB", marked)
        },
        "distances": [
            {
                "from": "A",
                "to": "B",
                "length": float(np.linalg.norm(marked[1] - marked[0])),
                "accuracy": 0.01,
            }
        ],
    }
    gcp = sized.write(tmp_path / "control.json", document)
    scaled = scale(cloud, gcp=gcp, out=tmp_path / "scaled.laz")
    # a grid length is not a ground length: 1e-4 here
    assert scaled.scaling.factor == pytest.approx(1 / 0.9, rel=3e-4)
    written = laspy.read(scaled.out).xyz
    np.testing.assert_allclose(np.ptp(written, axis=0) / np.ptp(grid, axis=0), 1.0, atol=4e-4)
    np.testing.assert_allclose(written.mean(axis=0), middle, atol=5.0)
    matrix = np.array(scaled.scaling.transform)
    moved = laspy.read(cloud).xyz @ matrix[:3, :3].T + matrix[:3, 3]
    np.testing.assert_allclose(written, moved, atol=2e-3)


def write_feet(path, points, crs):
    header = laspy.LasHeader(point_format=3, version="1.4")
    header.scales, header.offsets = [0.001] * 3, np.floor(points.min(axis=0))
    header.add_crs(pyproj.CRS.from_user_input(crs))
    las = laspy.LasData(header)
    las.x, las.y, las.z = points.T
    las.write(str(path))
    return path


def test_a_cloud_in_degrees_goes_to_its_utm_zone(points, tmp_path):
    to_degrees = pyproj.Transformer.from_crs(sized.UTM, 4326, always_xy=True)
    truth = sized.marks(PILE.height)
    clouds = []
    for places in (points, truth):
        small = shrunk(places, 0.9)
        lon, lat = to_degrees.transform(small[:, 0], small[:, 1])
        clouds.append(np.column_stack([lon, lat, small[:, 2]]))
    header = laspy.LasHeader(point_format=3, version="1.4")
    header.scales, header.offsets = [1e-9, 1e-9, 0.001], np.floor(clouds[0].min(axis=0))
    header.add_crs(pyproj.CRS.from_epsg(4326))
    las = laspy.LasData(header)
    las.x, las.y, las.z = clouds[0].T
    las.write(str(tmp_path / "degrees.laz"))
    asked = sized.control(truth, clouds[1], noise=False)
    for given in asked["cloud"].values():
        given["accuracy"] = 0.01  # metres: degrees are no unit of accuracy
    gcp = sized.write(tmp_path / "control.json", asked)
    scaled = scale(tmp_path / "degrees.laz", gcp=gcp, out=tmp_path / "scaled.laz")
    assert scaled.scaling.factor == pytest.approx(1 / 0.9, rel=1e-5)
    assert scaled.scaling.target_crs == sized.UTM
    written = laspy.read(scaled.out).xyz
    size = np.ptp(written, axis=0) / np.ptp(points, axis=0)
    np.testing.assert_allclose(size, 1.0, atol=1e-4)


# --- writing


def test_the_written_cloud_measures_like_the_one_on_the_way(points, tmp_path):
    cloud = place(tmp_path, shrunk(points, 0.83))
    truth = sized.marks(PILE.height)
    asked = sized.control(truth, shrunk(truth, 0.83), gps=0.02, levels=3)
    gcp = sized.write(tmp_path / "control.json", asked)
    before = cloud.read_bytes()
    scaled = scale(cloud, gcp=gcp, out=tmp_path / "scaled.laz")
    assert cloud.read_bytes() == before
    assert scaled.out == str(tmp_path / "scaled.laz")
    one_go = one(measure(cloud, area=drawn(PILE.area), gcp=gcp, area_frame="control"))
    two_steps = one(measure(scaled.out, area=drawn(PILE.area)))
    assert two_steps.cut_m3 == pytest.approx(one_go.cut_m3, rel=1e-3)
    assert two_steps.cut_m3 == pytest.approx(TRUTH, rel=2e-3)


def test_the_transform_is_what_was_done(points, tmp_path):
    cloud = place(tmp_path, shrunk(points, 0.83))
    truth = sized.marks(PILE.height)
    asked = sized.control(truth, shrunk(truth, 0.83), gps=0.02, levels=3, noise=False)
    gcp = sized.write(tmp_path / "control.json", asked)
    scaled = scale(cloud, gcp=gcp, out=tmp_path / "scaled.las")
    matrix = np.array(scaled.scaling.transform)
    source = laspy.read(cloud).xyz
    target = laspy.read(scaled.out).xyz
    moved = source @ matrix[:3, :3].T + matrix[:3, 3]
    np.testing.assert_allclose(target, moved, atol=6e-4)
    np.testing.assert_allclose(target, points, atol=5e-3)


# --- the demo


@pytest.fixture(scope="module")
def beach_truth():
    return measure(DEMO / "brighton_beach.laz", area=DEMO / "areas.geojson")


@pytest.mark.one_python
@pytest.mark.parametrize("pivot", ["middle", "corner"])
def test_the_shrunk_beach_gives_its_volumes_back(beach_truth, tmp_path, pivot):
    las = laspy.read(DEMO / "brighton_beach.laz")
    whole = np.array(las.xyz)
    centre = whole.mean(axis=0) if pivot == "middle" else whole.min(axis=0)
    las.xyz = centre + 0.95 * (whole - centre)
    las.write(tmp_path / "shrunk.laz")
    frame = beach_truth.frame
    areas = json.loads((DEMO / "areas.geojson").read_text())
    for feature in areas["features"]:
        outline = shapely.transform(
            shape(feature["geometry"]), lambda xy: centre[:2] + 0.95 * (xy - centre[:2])
        )
        feature["geometry"] = mapping(outline)
    factor = beach_truth.grid_scale_factor
    rng = np.random.default_rng(3)
    chosen = rng.choice(len(whole), 8, replace=False)
    truth = (whole[chosen] - centre) / [factor, factor, 1.0]
    names = "ABCDEFGH"
    document = {
        "unit": "m",
        "cloud": {
            n: {"xyz": list(map(float, centre + 0.95 * (whole[i] - centre))), "accuracy": 0.01}
            for n, i in zip(names, chosen)
        },
        "distances": [
            {
                "from": names[i],
                "to": names[j],
                "length": float(np.linalg.norm(truth[i] - truth[j]) + rng.normal(0, 0.005)),
                "accuracy": 0.005,
            }
            for i in range(8)
            for j in range(i + 1, 8)
        ],
    }
    gcp = sized.write(tmp_path / "control.json", document)
    again = measure(tmp_path / "shrunk.laz", area=areas, gcp=gcp)
    assert frame is not None
    for before, after in zip(beach_truth.results, again.results):
        # Cells and blocks of ground begin elsewhere: well within the interval.
        near = max(3e-3 * abs(before.volume_m3), 0.5 * before.std_m3)
        assert after.volume_m3 == pytest.approx(before.volume_m3, abs=near), before.name
