"""What a file claims is held against the file before memory is taken for it."""

from __future__ import annotations

import json
import struct
import tracemalloc
from pathlib import Path
from typing import Any, Iterator

import numpy as np
import pytest
from clouds import in_order, points, read_all, write_copc, write_ept, write_las, write_ply

from quantify_client.cloud import open_cloud
from quantify_client.cloud.ept import index as ept_index
from quantify_client.cloud.las import chunks as laz_chunks
from quantify_client.cloud.las import copc
from quantify_client.cloud.writing.sources import open_sources
from quantify_client.errors import CloudError
from quantify_client.types import Window

MB = 1 << 20


@pytest.fixture
def frugal() -> Iterator[None]:
    """Fail when more than 150 MB of Python's and numpy's memory are taken at any time."""
    tracemalloc.start()
    yield
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most < 150 * MB


def _read(path: Path) -> Any:
    return read_all(open_cloud([path]))


# --- text


@pytest.mark.parametrize("name", ["a.csv", "a.xyz", "a.txt"])
@pytest.mark.parametrize("lead", [b"1,2,3\n", b"x,y,z\n1,2,3\n", b"# a comment\n1 2 3\n"])
def test_line_without_end_is_refused_after_a_block(name, lead, tmp_path, frugal):
    path = tmp_path / name
    with path.open("wb") as stream:
        stream.write(lead)
        for _ in range(40):
            stream.write(b"7" * 10 * MB)
    with pytest.raises(CloudError, match="line of more than 65,536 characters"):
        open_cloud([path])


def test_line_without_end_in_ascii_ply_is_refused(tmp_path, frugal):
    path = write_ply(tmp_path / "a.ply", points(100), "ascii")
    head = path.read_bytes().split(b"end_header\n")[0] + b"end_header\n"
    path.write_bytes(head)
    with path.open("ab") as stream:
        for _ in range(40):
            stream.write(b"7 " * 5 * MB)
    with pytest.raises(CloudError, match="line of more than 65,536 characters"):
        open_cloud([path])


def test_lines_longer_than_a_block_in_all_and_without_a_last_end_are_read(tmp_path, monkeypatch):
    monkeypatch.setattr("quantify_client.cloud.text._BLOCK", 1000)
    xyz = points(500)
    rows = [" ".join(f"{v:.3f}" for v in row) + " " * (i % 300) for i, row in enumerate(xyz)]
    for ends in ("\n", "\r\n", "\r"):
        (tmp_path / "a.xyz").write_bytes(ends.join(rows).encode())
        np.testing.assert_array_equal(_read(tmp_path / "a.xyz"), xyz)


def test_columns_without_number_in_ply_are_refused(tmp_path):
    more = "".join(f"property uchar p{i}\n" for i in range(60_000))
    (tmp_path / "a.ply").write_text(
        f"ply\nformat ascii 1.0\nelement vertex 9\nproperty float x\n{more}end_header\n"
    )
    with pytest.raises(CloudError, match="more than 1000 properties"):
        open_cloud([tmp_path / "a.ply"])


# --- LAZ


def _first_chunk(data: bytes) -> int:
    """Where the sizes of the first chunk's layers are, in point format 6."""
    return int(struct.unpack_from("<I", data, 96)[0]) + 8 + 30 + 4


@pytest.mark.parametrize("layer", range(9))
@pytest.mark.parametrize("make", [lambda p, xyz: write_las(p, xyz, 6, "1.4"), write_copc])
def test_layer_larger_than_its_chunk_is_refused(make, layer, tmp_path):
    path = make(tmp_path / "a.laz", points(9000))
    data = bytearray(path.read_bytes())
    struct.pack_into("<I", data, _first_chunk(data) + 4 * layer, 0xFFFFFFFF)
    path.write_bytes(data)
    for window in (None, Window(0, 0, 1e9, 1e9)):
        with pytest.raises(CloudError, match="a compressed chunk promises 4[0-9]{9} bytes"):
            read_all(open_cloud([path]), window)
    with pytest.raises(CloudError, match="a compressed chunk promises"):
        list(open_sources(path)[0].blocks(1000))


def test_each_chunk_is_looked_at_before_it_is_decoded(tmp_path):
    path = write_las(tmp_path / "a.laz", points(120_000), 6, "1.4")  # three chunks
    data = path.read_bytes()
    layout = open_cloud([path])._layout  # type: ignore[attr-defined]
    assert [held for held, _ in layout.chunks.table] == [50_000] * 3
    last = layout.chunks.start + sum(length for _, length in layout.chunks.table[:2]) + 34
    path.write_bytes(data[:last] + b"\xff\xff\xff\x7f" + data[last + 4 :])
    chunks = open_cloud([path]).chunks(size=50_000)
    assert len(next(chunks)) + len(next(chunks)) == 100_000
    with pytest.raises(CloudError, match="a compressed chunk promises 2[0-9]{9} bytes"):
        next(chunks)


def test_huge_chunks_are_not_decoded_side_by_side(tmp_path, monkeypatch):
    xyz = points(60_000)
    path = write_las(tmp_path / "a.laz", xyz)
    assert open_cloud([path])._layout.chunks.parallel  # type: ignore[attr-defined]
    monkeypatch.setattr(laz_chunks, "LARGEST_CHUNK", 1_000_000)
    assert not open_cloud([path])._layout.chunks.parallel  # type: ignore[attr-defined]
    np.testing.assert_allclose(_read(path), xyz, atol=1e-6)


@pytest.mark.parametrize("number", [1e18, 1e300, float("nan"), float("inf")])
@pytest.mark.parametrize("at", [131, 139, 155, 171])  # scales and offsets of x, y, z
def test_header_that_puts_points_beyond_any_map_is_refused(number, at, tmp_path):
    path = write_las(tmp_path / "a.las", points(100))
    data = bytearray(path.read_bytes())
    struct.pack_into("<d", data, at, number)
    path.write_bytes(data)
    with pytest.raises(CloudError, match="expected no scale 0, and coordinates of at most 1e"):
        open_cloud([path])


@pytest.mark.parametrize("number", [1e18, -1e300, float("nan")])
def test_box_in_the_header_beyond_any_map_is_found_anew(number, tmp_path):
    path = write_las(tmp_path / "a.las", points(100))
    told = open_cloud([path]).info.bounds
    data = bytearray(path.read_bytes())
    struct.pack_into("<d", data, 179, number)
    path.write_bytes(data)
    info = open_cloud([path]).info
    assert info.bounds == told
    assert "bounds in its header are invalid" in info.warnings[0]


def test_records_without_end_before_the_points_are_refused(tmp_path):
    path = write_las(tmp_path / "a.las", points(100))
    data = bytearray(path.read_bytes())
    struct.pack_into("<I", data, 96, 300 * MB)
    path.write_bytes(data)
    with path.open("r+b") as stream:
        stream.truncate(400 * MB)
    with pytest.raises(CloudError, match="300 MB of records before its points"):
        open_cloud([path])


# --- indexes


def _entry(path: Path, at: int, **changes: int) -> None:
    """Change a line of a COPC's index, which is the last thing in its file."""
    data = bytearray(path.read_bytes())
    start = len(data) - copc._ENTRY.itemsize * at
    row = np.frombuffer(data, copc._ENTRY, 1, start).copy()
    for name, value in changes.items():
        row[name] = value
    data[start : start + copc._ENTRY.itemsize] = row.tobytes()
    path.write_bytes(data)


def test_copc_pages_that_go_round_are_refused(tmp_path):
    path = write_copc(tmp_path / "a.laz", points(2000))
    size = path.stat().st_size
    for offset in range(size - 200, size - 100):
        _entry(path, 1, points=-1, offset=offset, bytes=96)
        with pytest.raises(CloudError, match="COPC index"):
            read_all(open_cloud([path]), Window(0, 0, 1e9, 1e9))


def test_copc_part_of_more_points_than_fit_into_memory_is_refused(tmp_path):
    path = write_copc(tmp_path / "a.laz", points(2000))
    data = bytearray(path.read_bytes())
    struct.pack_into("<Q", data, 247, 2**31 - 1 + 1600)
    path.write_bytes(data)
    with pytest.raises(CloudError, match="its chunks hold"):
        open_cloud([path])


@pytest.mark.parametrize("number", [float("nan"), 1e18, 0.0])
def test_copc_with_a_cube_elsewhere_loses_no_point(number, tmp_path):
    xyz = points(2000)
    path = write_copc(tmp_path / "a.laz", xyz)
    window = Window(*xyz.min(axis=0)[:2], *xyz.max(axis=0)[:2])
    data = bytearray(path.read_bytes())
    struct.pack_into("<d", data, 375 + 54, number)
    path.write_bytes(data)
    cloud = open_cloud([path])
    assert cloud.info.format == "laz"
    np.testing.assert_allclose(in_order(read_all(cloud, window)), in_order(xyz), atol=1e-6)


def test_ept_whose_points_reach_beyond_its_cube_is_refused(tmp_path):
    path = write_ept(tmp_path / "ept", points(2000))
    about = json.loads(path.read_text())
    about["bounds"][0], about["bounds"][3] = about["bounds"][0] + 1e6, about["bounds"][3] + 1e6
    path.write_text(json.dumps(about))
    with pytest.raises(CloudError, match="reach beyond its cube"):
        open_cloud([path])


def test_ept_index_of_values_without_number_is_refused(tmp_path, frugal, monkeypatch):
    path = write_ept(tmp_path / "ept", points(2000))
    (tmp_path / "ept" / "ept-hierarchy" / "0-0-0-0.json").write_bytes(
        b'{"x": [' + b"[]," * 15_000_000 + b"[]]}"
    )
    with pytest.raises(CloudError, match="more than 3000000 values"):
        open_cloud([path])
    assert ept_index._MAX_JSON > 45_000_000


def test_ept_columns_scaled_beyond_any_map_say_nothing_on_stderr(tmp_path):
    path = write_ept(tmp_path / "ept", points(2000), "binary")
    about = json.loads(path.read_text())
    about["schema"][0]["scale"] = 1e305
    path.write_text(json.dumps(about))
    with pytest.raises(CloudError, match="NaN or infinite"):  # a numpy warning would be an error
        _read(path)


def test_nan_of_single_precision_says_nothing_on_stderr(tmp_path):
    path = write_ply(tmp_path / "a.ply", points(100), kind="float", extra=False)
    data = path.read_bytes()
    at = data.index(b"end_header\n") + 11
    path.write_bytes(data[:at] + b"\x01\x00\x80\x7f" + data[at + 4 :])  # a signalling NaN
    (chunk,) = open_cloud([path]).chunks()  # a numpy warning would be an error
    assert (len(chunk), chunk.left_out) == (99, {"NaN or infinite coordinate": 1})
