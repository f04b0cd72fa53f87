"""All formats deliver the same points, whatever the chunk size and the order of tiles."""

from __future__ import annotations

from pathlib import Path
from typing import Tuple

import numpy as np
import pytest
from clouds import (
    in_order,
    points,
    read_all,
    write_copc,
    write_ept,
    write_las,
    write_ply,
    write_text,
)
from hypothesis import given
from hypothesis import strategies as st

from quantify_client.cloud import open_cloud
from quantify_client.errors import CloudError
from quantify_client.types import Window

HALF_MM = 0.5e-3

WRITERS = {
    "las": lambda d, x: write_las(d / "a.las", x),
    "las 1.1": lambda d, x: write_las(d / "a.las", x, 1, "1.1"),
    "laz": lambda d, x: write_las(d / "a.LAZ", x),
    "laz 1.4": lambda d, x: write_las(d / "a.laz", x, 7, "1.4"),
    "copc": lambda d, x: write_copc(d / "a.copc.laz", x),
    "ept": lambda d, x: write_ept(d / "ept", x),
    "ept binary": lambda d, x: write_ept(d / "ept", x, "binary"),
    "ply": lambda d, x: write_ply(d / "a.ply", x),
    "ply big": lambda d, x: write_ply(d / "a.ply", x, "binary_big_endian"),
    "ply ascii": lambda d, x: write_ply(d / "a.ply", x, "ascii"),
    "csv": lambda d, x: write_text(d / "a.csv", x, ",", "X,Y,Z"),
    "xyz": lambda d, x: write_text(d / "a.xyz", x, " "),
    "txt": lambda d, x: write_text(d / "a.txt", x, "\t", "easting\tnorthing\televation"),
    "semicolon": lambda d, x: write_text(d / "a.csv", x, ";"),
}


@pytest.mark.parametrize("kind", WRITERS)
def test_every_format_delivers_the_same_points(kind: str, tmp_path: Path) -> None:
    xyz = points(3001)
    cloud = open_cloud([WRITERS[kind](tmp_path, xyz)])
    delivered = read_all(cloud)
    assert np.abs(in_order(delivered) - in_order(xyz)).max() < HALF_MM
    assert cloud.info.point_count == 3001
    box = cloud.info.bounds
    assert box is not None
    low, high = (box.min_x, box.min_y, box.min_z), (box.max_x, box.max_y, box.max_z)
    assert np.allclose([low, high], [xyz.min(axis=0), xyz.max(axis=0)], rtol=0, atol=HALF_MM)


@pytest.mark.parametrize("kind", WRITERS)
def test_chunks_are_plain_finite_arrays_of_any_size_asked_for(kind: str, tmp_path: Path) -> None:
    xyz = points(1003)
    cloud = open_cloud([WRITERS[kind](tmp_path, xyz)])
    whole = read_all(cloud)
    for size in (1, 7, 100, 1003):
        if size == 1 and kind != "las":
            continue
        assert np.array_equal(in_order(read_all(cloud, size=size)), in_order(whole))
    for chunk in cloud.chunks(size=400):
        for axis in (chunk.x, chunk.y, chunk.z):
            assert axis.dtype == np.float64
            assert axis.flags.c_contiguous
            assert axis.shape == (len(chunk),)


@given(st.integers(1, 700), st.permutations(range(3)))
def test_tiles_give_the_same_points_in_any_order_and_chunk_size(
    tmp_path_factory: pytest.TempPathFactory, size: int, order: list
) -> None:
    folder = tmp_path_factory.mktemp("tiles")
    xyz = points(600)
    parts = [xyz[:100], xyz[100:101], xyz[101:]]
    files = [
        write_las(folder / "a.laz", parts[0]),
        write_ply(folder / "b.ply", parts[1]),
        write_text(folder / "c.csv", parts[2]),
    ]
    cloud = open_cloud([files[index] for index in order])
    assert cloud.info.format == "mixed"
    assert cloud.info.point_count == 600
    assert np.allclose(in_order(read_all(cloud, size=size)), in_order(xyz), rtol=0, atol=1e-6)


@pytest.mark.parametrize("corner", [(0.0, 0.0), (80.0, 0.0), (0.0, 80.0), (80.0, 80.0)])
@pytest.mark.parametrize("kind", ["copc", "ept", "ept binary"])
def test_indexed_clouds_deliver_a_window_without_the_rest(
    kind: str, corner: Tuple[float, float], tmp_path: Path
) -> None:
    xyz = points(5000)
    cloud = open_cloud([WRITERS[kind](tmp_path, xyz)])
    x, y = xyz[:, :2].min(axis=0) + corner
    window = Window(x, y, x + 20, y + 20)
    delivered = in_order(np.round(read_all(cloud, window, 500), 3))
    inside = (abs(xyz[:, 0] - x - 10) <= 10) & (abs(xyz[:, 1] - y - 10) <= 10)
    wanted = xyz[inside]
    assert {tuple(p) for p in wanted} <= {tuple(p) for p in delivered}
    assert 100 < len(wanted) < len(delivered) < 2500
    assert len(read_all(cloud, Window(0, 0, 1, 1))) == 0


def test_tiles_outside_the_window_are_not_read(tmp_path: Path) -> None:
    near = write_las(tmp_path / "near.laz", points(100))
    far = write_las(tmp_path / "far.laz", points(100) + np.array([5000, 0, 0]))
    cloud = open_cloud([near, far])
    far.write_bytes(b"gone")
    x = points(100)
    window = Window(x[:, 0].min(), x[:, 1].min(), x[:, 0].max(), x[:, 1].max())
    assert len(read_all(cloud, window)) == 100
    with pytest.raises(CloudError, match="far.laz"):
        read_all(cloud)


@pytest.mark.parametrize(
    ("point_format", "version"), [(1, "1.2"), (3, "1.2"), (6, "1.4"), (7, "1.4")]
)
@pytest.mark.parametrize("ending", [".las", ".laz"])
def test_noise_and_withheld_points_are_left_out_and_counted(
    point_format: int, version: str, ending: str, tmp_path: Path
) -> None:
    xyz = points(1000)
    classes = np.full(1000, 2)
    classes[:10], classes[10:15] = 7, 18
    withheld = np.zeros(1000)
    withheld[5:25] = 1
    path = write_las(tmp_path / f"a{ending}", xyz, point_format, version, classes, withheld)
    cloud = open_cloud([path])
    chunks = list(cloud.chunks(size=500))
    assert dict(chunks[0].left_out) == {"noise class": 15, "withheld": 10}
    assert dict(chunks[1].left_out) == {}
    assert np.allclose(read_all(cloud), xyz[25:], rtol=0, atol=1e-6)
    assert cloud.info.point_count == 1000


def test_classes_count_in_text_too(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    rows = [f"{i},{i},{i},{7 if i < 3 else 2}\n" for i in range(10)]
    path.write_text('"X","Y","Z","Classification"\n' + "".join(rows))
    (chunk,) = open_cloud([path]).chunks()
    assert len(chunk) == 7
    assert dict(chunk.left_out) == {"noise class": 3}


@pytest.mark.parametrize("kind", ["copc", "laz"])
def test_chunks_of_size_zero_are_of_any_size(kind: str, tmp_path: Path) -> None:
    """LASzip and what is built on it write 0 for it as well; others write 2**32 - 1."""
    xyz = points(2000)
    path = write_copc(tmp_path / "a.laz", xyz)
    data = path.read_bytes()
    record = data.index(b"laszip encoded") - 2 + 54
    data = data[: record + 12] + bytes(4) + data[record + 16 :]
    if kind == "laz":
        data = data.replace(b"copc".ljust(16, b"\0"), b"none".ljust(16, b"\0"))
    path.write_bytes(data)
    cloud = open_cloud([path])
    assert cloud.info.format == kind
    assert np.abs(in_order(read_all(cloud)) - in_order(xyz)).max() < HALF_MM


def test_the_same_cloud_can_be_read_twice_at_once(tmp_path: Path) -> None:
    cloud = open_cloud([write_las(tmp_path / "a.laz", points(500))])
    one, two = cloud.chunks(size=100), cloud.chunks(size=100)
    for first, second in zip(one, two):
        assert np.array_equal(first.x, second.x)


def test_real_cloud_is_complete() -> None:
    import quantify_client

    path = Path(quantify_client.__file__).parent / "demo" / "brighton_beach.laz"
    cloud = open_cloud([path])
    assert cloud.info.crs == "EPSG:32615"
    assert sum(map(len, cloud.chunks(size=300_000))) == cloud.info.point_count == 940393
