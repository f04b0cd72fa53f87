"""What a header or an index says wrongly loses no points in silence."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Iterator, Tuple

import laspy
import numpy as np
import pytest
from clouds import in_order, points, read_all, write_copc, write_ept, write_las

from quantify_client.cloud import open_cloud
from quantify_client.cloud.base import scale_warnings
from quantify_client.cloud.ept.cloud import EptCloud
from quantify_client.cloud.las.header import read_layout
from quantify_client.errors import CloudError
from quantify_client.types import Window

# Servers, sizes and words: no different on a second Python.
pytestmark = pytest.mark.one_python


def with_count(path: Path, count: int) -> Path:
    """Change the number of points in a LAS header."""
    data = bytearray(path.read_bytes())
    if data[25] >= 4:
        struct.pack_into("<Q", data, 247, count)
    struct.pack_into("<I", data, 107, count)
    path.write_bytes(data)
    return path


def with_box(path: Path, low: np.ndarray, high: np.ndarray) -> Path:
    """Change the box in a LAS header."""
    data = bytearray(path.read_bytes())
    struct.pack_into("<6d", data, 179, *np.column_stack([high, low]).ravel().tolist())
    path.write_bytes(data)
    return path


KINDS = [(3, "1.2"), (1, "1.1"), (6, "1.4"), (7, "1.4")]


@pytest.mark.parametrize("ending", [".las", ".laz"])
@pytest.mark.parametrize(("point_format", "version"), KINDS)
@pytest.mark.parametrize("count", [0, 1, 900, 1950])
def test_a_header_that_counts_too_few_points_is_refused(
    count: int, point_format: int, version: str, ending: str, tmp_path: Path
) -> None:
    path = write_las(tmp_path / f"a{ending}", points(2000), point_format, version)
    with pytest.raises(CloudError, match=rf"(promises {count} points|for {count} points)"):
        open_cloud([with_count(path, count)])


@pytest.mark.parametrize("point_format", [3, 7])
@pytest.mark.parametrize("count", [1, 50_000, 100_000])
def test_whole_chunks_are_counted_as_they_are(
    count: int, point_format: int, tmp_path: Path
) -> None:
    version = "1.4" if point_format > 5 else "1.2"
    path = write_las(tmp_path / "a.laz", points(count), point_format, version)
    assert read_layout(path).count == count
    for backend in (laspy.LazBackend.Lazrs, laspy.LazBackend.LazrsParallel):
        laspy.read(path).write(tmp_path / "b.laz", laz_backend=backend)
        assert read_layout(tmp_path / "b.laz").count == count


@pytest.mark.parametrize("point_format", [3, 7])
def test_a_compressed_tile_without_points_is_one(point_format: int, tmp_path: Path) -> None:
    full = write_las(tmp_path / "a.laz", points(50))
    version = "1.4" if point_format > 5 else "1.2"
    none = write_las(tmp_path / "b.laz", points(50)[:0], point_format, version)
    assert len(read_all(open_cloud([none, full]))) == 50


@pytest.mark.parametrize("count", [40_000, 50_000, 50_001])
def test_whole_chunks_that_no_header_counts_are_refused(count: int, tmp_path: Path) -> None:
    path = write_las(tmp_path / "a.laz", points(60_000))
    with pytest.raises(CloudError, match=f"promises {count} points, its chunks hold more"):
        open_cloud([with_count(path, count)])


@pytest.mark.parametrize("tail", [bytes(1000), b"x" * 10, b"any text that is no record at all"])
def test_padding_and_remarks_behind_the_points_do_not_matter(tail: bytes, tmp_path: Path) -> None:
    path = write_las(tmp_path / "a.las", points(100))
    path.write_bytes(path.read_bytes() + tail)
    assert len(read_all(open_cloud([path]))) == 100


def test_extended_records_behind_the_points_are_no_points(tmp_path: Path) -> None:
    las = laspy.read(write_las(tmp_path / "a.las", points(100), 6, "1.4"))
    las.evlrs = laspy.vlrs.vlrlist.VLRList([laspy.VLR("me", 7, "", bytes(range(240)))])
    las.write(tmp_path / "b.las")
    assert len(read_all(open_cloud([tmp_path / "b.las"]))) == 100


@pytest.mark.parametrize("ending", [".las", ".laz"])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_box_that_holds_some_points_is_replaced_by_their_own(
    axis: int, ending: str, tmp_path: Path
) -> None:
    xyz = points(120_000)
    low, high = xyz.min(axis=0), xyz.max(axis=0)
    half = high.copy()
    half[axis] = (low[axis] + high[axis]) / 2
    cloud = open_cloud([with_box(write_las(tmp_path / f"a{ending}", xyz), low, half)])
    box = cloud.info.bounds
    assert [box.max_x, box.max_y, box.max_z] == pytest.approx(high.tolist(), abs=1e-6)
    (said,) = cloud.info.warnings
    assert "points lie outside the bounds in its header" in said


def test_a_box_elsewhere_is_refused(tmp_path: Path) -> None:
    xyz = points(200)
    low, high = xyz.min(axis=0) + 1e6, xyz.max(axis=0) + 1e6
    with pytest.raises(CloudError, match="no point lies within the bounds that its header gives"):
        open_cloud([with_box(write_las(tmp_path / "a.las", xyz), low, high)])


def test_a_tile_with_a_wrong_box_is_not_skipped(tmp_path: Path) -> None:
    """Its points lie in the window, its header says elsewhere."""
    xyz = points(3000)
    low, high = xyz.min(axis=0), xyz.max(axis=0)
    right = xyz[:, 0] > (low[0] + high[0]) / 2
    a = write_las(tmp_path / "a.laz", xyz[~right])
    b = with_box(write_las(tmp_path / "b.laz", xyz[right]), xyz[right].max(axis=0) - 1, high + 9)
    window = Window(*(xyz[right].min(axis=0)[:2] + 1), *(xyz[right].min(axis=0)[:2] + 9))
    delivered = read_all(open_cloud([a, b]), window)
    inside = (xyz[:, 0] > window.min_x) & (xyz[:, 0] < window.max_x)
    inside &= (xyz[:, 1] > window.min_y) & (xyz[:, 1] < window.max_y)
    wanted = {tuple(p) for p in np.round(xyz[inside], 3)}
    assert wanted
    assert wanted <= {tuple(p) for p in np.round(in_order(delivered), 3)}


def with_index(path: Path, **changes: list) -> Path:
    """Change boxes in ept.json."""
    about = json.loads(path.read_text())
    path.write_text(json.dumps({**about, **changes}))
    return path


SHIFTS = {  # cube -> a wrong one that still holds the bounds of the points
    "twice as large": lambda low, edge: (low, 2 * edge),
    "around another middle": lambda low, edge: (low - 30, edge + 30),
    "a third too large": lambda low, edge: (low - edge / 9, edge * 4 / 3),
}


def windows(xyz: np.ndarray, count: int = 20) -> Iterator[Tuple[Window, set]]:
    """Small windows all over the points, and the points in each."""
    low, high = xyz.min(axis=0), xyz.max(axis=0)
    for corner in np.random.default_rng(3).uniform(low[:2], high[:2] - 8, (count, 2)):
        inside = ((xyz[:, :2] >= corner) & (xyz[:, :2] <= corner + 8)).all(axis=1)
        yield Window(*corner, *(corner + 8)), {tuple(p) for p in np.round(xyz[inside], 3)}


@pytest.mark.parametrize("data_type", ["laszip", "binary"])
@pytest.mark.parametrize("cube", SHIFTS)
def test_ept_with_a_wrong_cube_loses_no_point_of_a_window(
    cube: str, data_type: str, tmp_path: Path
) -> None:
    xyz = points(3000)
    path = write_ept(tmp_path / "ept", xyz, data_type)
    bounds = np.array(json.loads(path.read_text())["bounds"])
    low, edge = SHIFTS[cube](bounds[:3], bounds[3] - bounds[0])
    cloud = open_cloud([with_index(path, bounds=[*low.tolist(), *(low + edge).tolist()])])
    assert "points lie outside the cubes of their tiles" in cloud.info.warnings[0]
    for window, wanted in windows(xyz):
        assert wanted <= {tuple(p) for p in np.round(read_all(cloud, window), 3)}


@pytest.mark.parametrize("data_type", ["laszip", "binary"])
def test_ept_whose_bounds_leave_out_points_is_read_for_their_own(
    data_type: str, tmp_path: Path
) -> None:
    xyz = points(3000)
    path = write_ept(tmp_path / "ept", xyz, data_type)
    half = xyz.max(axis=0) - [50, 0, 0]
    told = [*xyz.min(axis=0).tolist(), *half.tolist()]
    info = open_cloud([with_index(path, boundsConforming=told)]).info
    assert info.bounds.max_x == pytest.approx(xyz[:, 0].max())
    assert "points lie outside boundsConforming" in info.warnings[0]


@pytest.mark.parametrize("cube", SHIFTS)
def test_copc_with_a_wrong_cube_loses_no_point_of_a_window(cube: str, tmp_path: Path) -> None:
    xyz = points(3000)
    path = write_copc(tmp_path / "a.copc.laz", xyz)
    sound = open_cloud([path])
    assert sound.info.format == "copc"
    data = bytearray(path.read_bytes())
    *middle, half = struct.unpack_from("<4d", data, 375 + 54)
    low, edge = SHIFTS[cube](np.array(middle) - half, 2 * half)
    struct.pack_into("<4d", data, 375 + 54, *(low + edge / 2).tolist(), edge / 2)
    path.write_bytes(data)
    cloud = open_cloud([path])
    assert cloud.info.format == "laz"  # read from front to back
    for window, wanted in windows(xyz):
        assert wanted <= {tuple(p) for p in np.round(read_all(cloud, window), 3)}
        assert wanted <= {tuple(p) for p in np.round(read_all(sound, window), 3)}


def test_tiles_that_are_fetched_are_held_against_their_cubes(tmp_path: Path) -> None:
    xyz = points(3000)
    path = write_ept(tmp_path / "ept", xyz)
    bounds = np.array(json.loads(path.read_text())["bounds"])
    edge = bounds[3] - bounds[0]
    low = bounds[:3] - 30
    with_index(path, bounds=[*low.tolist(), *(low + edge + 30).tolist()])
    cloud = EptCloud(path, lambda files: None)
    around = Window(*xyz.min(axis=0)[:2], *xyz.max(axis=0)[:2])
    with pytest.raises(CloudError, match="points of tile 1-.* lie outside its cube"):
        read_all(cloud, around)


@pytest.mark.parametrize("ending", [".las", ".laz"])
def test_a_scale_coarser_than_the_spacing_is_told(ending: str, tmp_path: Path) -> None:
    xyz = points(40_000)  # a mean spacing of 0.5 m
    said = open_cloud([write_las(tmp_path / f"a{ending}", xyz, scale=1.0)]).info.warnings
    assert len(said) == 1
    assert "x in steps of 1, y in steps of 1, z in steps of 1, and the points' mean" in said[0]
    assert open_cloud([write_las(tmp_path / f"b{ending}", xyz, scale=0.1)]).info.warnings == ()


def test_a_scale_as_coarse_as_a_grid_is_no_fault(tmp_path: Path) -> None:
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(100.0), np.arange(100.0)))
    grid = np.column_stack([x + 576_700, y + 5_188_140, 110 + x / 7])
    assert open_cloud([write_las(tmp_path / "a.las", grid, scale=1.0)]).info.warnings == ()


def test_the_steps_of_heights_are_not_held_against_degrees(tmp_path: Path) -> None:
    x, y = np.random.default_rng(1).uniform(0, 4e-4, (2, 2000))
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = [1e-9, 1e-9, 0.01], [9.9, 48.4, 0.0]
    data = laspy.LasData(header)
    data.x, data.y, data.z = x + 9.9, y + 48.4, 1e4 * x
    path = tmp_path / "a.laz"
    data.write(path)
    assert open_cloud([path]).info.warnings == ()
    (said,) = scale_warnings(path, [1e-4, 1e-9, 0.01], open_cloud([path]).info.bounds, 2000)
    assert "has x in steps of 0.0001, and" in said
