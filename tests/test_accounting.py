"""Nothing is lost in silence: what a header says wrongly costs no point of a measured volume."""

from __future__ import annotations

import json
import math
from pathlib import Path

import laspy
import numpy as np
import pytest
from clouds import write_copc, write_ept, write_text

from quantify_client import describe, measure
from quantify_client.cloud.las import points as las

pytestmark = pytest.mark.one_python

EAST, NORTH = 412_000.0, 5_712_000.0
BALL = 4 / 3 * math.pi * 27
CONE = math.pi * 64 * 4 / 3


def cone(count: int = 10_000, level: float = 100.0) -> np.ndarray:
    x, y = np.random.default_rng(1).uniform(-20, 20, (2, count))
    z = level + np.maximum(0, 4 * (1 - np.hypot(x, y) / 8))
    return np.column_stack([x + EAST, y + NORTH, z])


def ball(count: int = 5_000) -> np.ndarray:
    """Points on a sphere of radius 3, so many in a spiral that they are evenly spaced."""
    turn = np.arange(count) * math.pi * (3 - math.sqrt(5))
    z = 1 - (2 * np.arange(count) + 1) / count
    r = np.sqrt(1 - z * z)
    return 3 * np.column_stack([r * np.cos(turn), r * np.sin(turn), z]) + [EAST, NORTH, 100]


def write(path: Path, xyz: np.ndarray) -> Path:
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = [0.0001] * 3, [EAST, NORTH, 100.0]
    data = laspy.LasData(header)
    data.x, data.y, data.z = xyz.T
    data.write(path)
    return path


def with_half_box(path: Path, axis: int = 0, share: float = 0.5) -> Path:
    """Let the header's box end at a share of its length."""
    data = bytearray(path.read_bytes())
    box = np.frombuffer(data, "<f8", 6, offset=179).copy()
    box[2 * axis] = box[2 * axis + 1] + share * (box[2 * axis] - box[2 * axis + 1])
    data[179:227] = box.tobytes()
    path.write_bytes(data)
    return path


def circle(radius: float = 12.0) -> dict:
    turn = np.linspace(0, 2 * math.pi, 61)
    ring = np.column_stack([EAST + radius * np.cos(turn), NORTH + radius * np.sin(turn)])
    shape = {"type": "Polygon", "coordinates": [ring.tolist()]}
    feature = {"type": "Feature", "properties": {"name": "pile"}, "geometry": shape}
    return {"type": "FeatureCollection", "features": [feature]}


def only(measurement):
    (result,) = measurement.results
    return result


@pytest.fixture(params=["found when opened", "found when read"])
def seen(request, monkeypatch):
    """A few points of each file are looked at when it is opened, or happen to show nothing."""
    if request.param == "found when read":
        monkeypatch.setattr(las, "_sample_lies_within", lambda layout, bounds: True)


@pytest.mark.parametrize("method", ["section", "polar"])
def test_a_wrong_box_takes_nothing_from_a_body(method, seen, tmp_path):
    path = with_half_box(write(tmp_path / "a.laz", ball()))
    told = measure(path, shape="object", method=method, source_unit="m")
    sound = measure(write(tmp_path / "b.laz", ball()), shape="object", method=method)
    assert only(told).volume_m3 == pytest.approx(BALL, rel=0.003)
    assert only(told).volume_m3 == only(sound).volume_m3
    assert sum("outside the bounds" in text for text in told.warnings) == 1
    assert not only(told).points_left_out.get("far from all others")


@pytest.mark.parametrize(("share", "drawn"), [(0.3, True), (0.9, False)])
def test_a_wrong_box_takes_nothing_from_terrain(share, drawn, seen, tmp_path):
    path = with_half_box(write(tmp_path / "a.laz", cone()), share=share)
    options = {"shape": "terrain", "source_unit": "m", "area": circle() if drawn else None}
    told = measure(path, **options)
    sound = measure(write(tmp_path / "b.laz", cone()), **options)
    assert only(told).volume_m3 == pytest.approx(CONE, rel=0.01)
    assert only(told).volume_m3 == only(sound).volume_m3
    assert sum("outside the bounds" in text for text in told.warnings) == 1


def test_a_few_points_outside_the_box_are_counted_and_measured(tmp_path, monkeypatch):
    monkeypatch.setattr(las, "_sample_lies_within", lambda layout, bounds: True)
    path = with_half_box(write(tmp_path / "a.laz", ball()), axis=2, share=0.99)
    told = measure(path, shape="object", source_unit="m")
    assert only(told).volume_m3 == pytest.approx(BALL, rel=0.003)
    (said,) = (text for text in told.warnings if "outside" in text)
    assert "50 points lie outside the bounds that its header gives; all points were read" in said


def test_a_tile_with_a_wrong_box_takes_nothing_from_an_area(tmp_path):
    xyz = cone()
    right = xyz[:, 0] > EAST
    one = write(tmp_path / "a.laz", xyz[~right])
    other = with_half_box(write(tmp_path / "b.laz", xyz[right] + [0, 0, 0]), share=0.01)
    told = measure(one, other, area=circle(), source_unit="m")
    assert only(told).volume_m3 == pytest.approx(CONE, rel=0.01)


def test_info_tells_of_a_wrong_box_and_gives_the_points_own(tmp_path):
    path = with_half_box(write(tmp_path / "a.laz", cone()))
    told = describe(path, source_unit="m")
    assert told["bounds"]["max_x"] == pytest.approx(EAST + 20, abs=0.01)
    assert "outside the bounds in its header" in " ".join(told["warnings"])


@pytest.mark.parametrize("data_type", ["laszip", "binary"])
def test_ept_with_a_wrong_cube_measures_the_same(data_type, tmp_path):
    xyz = np.round(np.add(cone(), [576_700 - EAST + 20, 5_188_140 - NORTH + 20, 0]), 3)
    path = write_ept(tmp_path / "ept", xyz, data_type)
    area = json.loads(json.dumps(circle()))
    ring = area["features"][0]["geometry"]["coordinates"][0]
    for place in ring:
        place[0], place[1] = place[0] + 576_700 - EAST + 20, place[1] + 5_188_140 - NORTH + 20
    area["crs"] = {"type": "name", "properties": {"name": "EPSG:32615"}}
    sound = only(measure(path, area=area, grid=True))
    about = json.loads(path.read_text())
    low, edge = about["bounds"][:3], about["bounds"][3] - about["bounds"][0]
    about["bounds"] = [*low, *(corner + 2 * edge for corner in low)]
    path.write_text(json.dumps(about))
    told = measure(path, area=area, grid=True)
    assert only(told).volume_m3 == pytest.approx(sound.volume_m3, rel=1e-6)
    assert any("outside the cubes" in text for text in told.warnings)


def test_rows_without_numbers_are_told_of_in_every_mode(tmp_path):
    xyz = ball()
    xyz[500:3500:30], xyz[7, 1], xyz[9, 2] = np.nan, np.inf, 1e12
    path = write_text(tmp_path / "a.xyz", xyz, " ")
    said = "left out and not measured: 100 points (NaN in all coordinates), 1 point (NaN or "
    for options in ({"shape": "object"}, {"shape": "object", "method": "polar"}):
        told = measure(path, source_unit="m", **options)
        (notice,) = (text for text in told.warnings if text.startswith(said))
        assert notice.code == "points-left-out"
        assert notice.values["points"]["NaN in all coordinates"] == 100
        assert only(told).volume_m3 == pytest.approx(BALL, rel=0.005)
        assert only(told).points_left_out["NaN in all coordinates"] == 100
    assert any(text.startswith(said) for text in describe(path)["warnings"])


@pytest.mark.parametrize("level", [-3.0, 0.0, 100.0, -9999.0, 1310.0])
@pytest.mark.parametrize("void", [-9999.0, -32767.0, 0.0])
def test_a_hole_of_nodata_takes_nothing_from_a_pile(void, level, tmp_path):
    step = np.arange(-20, 20.01, 0.25)
    x, y = (axis.ravel() for axis in np.meshgrid(step, step))
    z = level + np.maximum(0, 4 * (1 - np.hypot(x, y) / 8))
    if abs(level - void) > 10:
        z[np.hypot(x - 3, y) < 1] = void
    path = write_text(tmp_path / "a.xyz", np.column_stack([x + EAST, y + NORTH, z]), " ")
    told = measure(path, area=circle(), source_unit="m")
    assert only(told).volume_m3 == pytest.approx(CONE, rel=0.002)
    assert only(told).points_left_out.get("nodata", 0) == (45 if abs(level - void) > 10 else 0)


@pytest.mark.parametrize("drawn", [False, True])
def test_points_at_the_origin_take_nothing_and_are_told(drawn, tmp_path):
    xyz = cone()
    xyz[::200] = 0.0  # half a percent
    path = write_text(tmp_path / "a.xyz", xyz, " ")
    area = circle() if drawn else None
    told = measure(path, shape="terrain", source_unit="m", area=area)
    assert only(told).volume_m3 == pytest.approx(CONE, rel=0.01)
    assert only(told).points_left_out["at the origin (0, 0, 0)"] == 50
    assert any("50 points lie at the origin" in text for text in told.warnings)


def test_points_outside_the_box_are_told_once_and_as_so_many_at_least(tmp_path, monkeypatch):
    """Of a window only a part of them is seen."""
    monkeypatch.setattr(las, "_sample_lies_within", lambda layout, bounds: True)
    path = with_half_box(write_copc(tmp_path / "a.copc.laz", cone()), share=0.6)
    area = circle(4.0)
    for place in area["features"][0]["geometry"]["coordinates"][0]:
        place[0], place[1] = place[0] - 12, place[1] - 12
    (said,) = (w for w in measure(path, area=area, source_unit="m").warnings if "outside" in w)
    assert "at least 787 points lie outside the bounds that its header gives" in said


@pytest.mark.parametrize("steps", [1e-6, 0.3, 0.99, 1.5])
@pytest.mark.parametrize("shape", ["terrain", "object"])
def test_a_box_that_was_rounded_apart_from_the_points_is_no_wrong_box(shape, steps, seen, tmp_path):
    path = write(tmp_path / "a.laz", ball(2000) if shape == "object" else cone(2000))
    sound = only(measure(path, shape=shape, source_unit="m"))
    data = bytearray(path.read_bytes())
    box = np.frombuffer(data, "<f8", 6, offset=179) - np.tile([0.0001 * steps, 0.0], 3)
    data[179:227] = box.tobytes()
    path.write_bytes(data)
    told = measure(path, shape=shape, source_unit="m")
    if shape == "object" or steps < 1.0:  # terrain is read with a thousandth of its box to spare
        assert any("outside the bounds" in text for text in told.warnings) == (steps > 1.0)
    assert only(told).volume_m3 == pytest.approx(sound.volume_m3, rel=1e-6)
    assert only(told).points_used == sound.points_used
