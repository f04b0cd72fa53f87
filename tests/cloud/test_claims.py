"""What a header or an index says wrongly loses no points in silence."""

from __future__ import annotations

import struct
from pathlib import Path

import laspy
import numpy as np
import pytest
from clouds import in_order, points, read_all, write_las

from quantify_client.cloud import open_cloud
from quantify_client.errors import CloudError
from quantify_client.types import Window


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
