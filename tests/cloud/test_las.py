"""LAS and LAZ: what is wrong with a file is said before memory is given away for it."""

from __future__ import annotations

import struct
from pathlib import Path

import laspy
import numpy as np
import pytest
from clouds import points, read_all, write_copc, write_las
from hypothesis import given
from hypothesis import strategies as st

from quantify_client.cloud import open_cloud
from quantify_client.errors import CloudError


def _patched(path: Path, offset: int, data: bytes) -> Path:
    content = bytearray(path.read_bytes())
    content[offset : offset + len(data)] = data
    path.write_bytes(content)
    return path


@pytest.mark.parametrize("ending", [".las", ".laz"])
@pytest.mark.parametrize("keep", [0.999, 0.5, 0.02])
def test_truncated_file_is_named_as_such(ending: str, keep: float, tmp_path: Path) -> None:
    path = write_las(tmp_path / f"a{ending}", points(5000))
    whole = path.read_bytes()
    path.write_bytes(whole[: int(len(whole) * keep)])
    with pytest.raises(CloudError, match="truncated.*again"):
        open_cloud([path])


@given(data=st.data())
def test_no_cut_or_corruption_of_a_laz_file_passes_for_another_error(
    data: st.DataObject, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = write_las(tmp_path_factory.mktemp("laz") / "a.laz", points(300))
    content = bytearray(path.read_bytes())
    if data.draw(st.booleans()):
        content = content[: data.draw(st.integers(0, len(content) - 1))]
    else:
        place = data.draw(st.integers(0, len(content) - 1))
        content[place] ^= data.draw(st.integers(1, 255))
    path.write_bytes(content)
    message = None
    try:
        cloud = open_cloud([path])
        read = sum(len(c) + sum(c.left_out.values()) for c in cloud.chunks())
    except CloudError as error:
        message = str(error)
    if message is None:
        assert read == cloud.info.point_count
    else:
        assert message.startswith(str(path))
        assert "\n" not in message


def test_file_cut_after_opening_is_an_error(tmp_path: Path) -> None:
    path = write_las(tmp_path / "a.las", points(5000))
    cloud = open_cloud([path])
    path.write_bytes(path.read_bytes()[:-1000])
    with pytest.raises(CloudError, match="shorter"):
        read_all(cloud)


@pytest.mark.parametrize("ending", [".las", ".laz"])
def test_overlong_count_is_refused_before_memory_is_reserved(ending: str, tmp_path: Path) -> None:
    path = write_las(tmp_path / f"a{ending}", points(100), 6, "1.4")
    _patched(path, 247, struct.pack("<Q", 2**60))
    with pytest.raises(CloudError, match="promises 1152921504606846976 points"):
        open_cloud([path])


def test_overlong_tables_are_refused(tmp_path: Path) -> None:
    path = write_las(tmp_path / "a.laz", points(100))
    offset = struct.unpack_from("<I", path.read_bytes(), 96)[0]
    table = struct.unpack_from("<q", path.read_bytes(), offset)[0]
    _patched(path, table + 4, b"\xff" * 4)
    with pytest.raises(CloudError, match="claims 4294967295 chunks"):
        open_cloud([path])
    _patched(write_las(path, points(100)), 100, b"\xff" * 4)
    with pytest.raises(CloudError, match="contradicts itself"):
        open_cloud([path])


def test_scale_that_is_no_number_is_refused(tmp_path: Path) -> None:
    for value in (float("nan"), float("inf"), 0.0, 1e308):
        path = write_las(tmp_path / "a.las", points(100))
        _patched(path, 131, struct.pack("<d", value))
        with pytest.raises(CloudError, match="scale"):
            open_cloud([path])


def test_bounds_that_are_no_box_are_measured_instead(tmp_path: Path) -> None:
    xyz = points(100)
    path = write_las(tmp_path / "a.laz", xyz)
    _patched(path, 179, struct.pack("<d", float("nan")))
    info = open_cloud([path]).info
    assert info.bounds is not None
    assert info.bounds.max_x == pytest.approx(xyz[:, 0].max(), abs=1e-6)
    assert any("bounds" in warning for warning in info.warnings)


def test_points_outside_the_header_bounds_still_come(tmp_path: Path) -> None:
    path = write_las(tmp_path / "a.laz", points(100))
    _patched(path, 179, struct.pack("<dd", 576_710.0, 576_705.0))
    assert len(read_all(open_cloud([path]))) == 100


def test_laz_with_huge_chunks_is_streamed(tmp_path: Path) -> None:
    import lazrs

    xyz = points(100)
    path = write_las(tmp_path / "a.laz", xyz)
    with laspy.open(path) as reader:
        record = bytearray(reader.header.vlrs.get("LasZipVlr")[0].record_data)
    content = path.read_bytes()
    place = content.index(bytes(record))
    assert lazrs.LazVlr(bytes(record)).chunk_size() == 50_000
    _patched(path, place + 12, struct.pack("<I", 4_000_000_000))
    assert np.allclose(read_all(open_cloud([path])), xyz, rtol=0, atol=1e-6)


def test_copc_index_that_lies_is_named(tmp_path: Path) -> None:
    path = write_copc(tmp_path / "a.copc.laz", points(500))
    content = path.read_bytes()
    _patched(path, len(content) - 4, struct.pack("<i", 3))
    cloud = open_cloud([path])
    from quantify_client.types import Window

    with pytest.raises(CloudError, match="COPC index"):
        read_all(cloud, Window(0, 0, 1e7, 1e7))


@pytest.mark.parametrize("count", [0, 1, 3])
def test_fewer_than_four_points_are_refused(count: int, tmp_path: Path) -> None:
    path = write_las(tmp_path / "a.laz", points(count))
    with pytest.raises(CloudError, match="expected at least 4"):
        open_cloud([path])


def test_version_that_does_not_exist_is_named(tmp_path: Path) -> None:
    path = _patched(write_las(tmp_path / "a.las", points(10)), 24, b"\x02\x00")
    with pytest.raises(CloudError, match=r"is LAS 2\.0"):
        open_cloud([path])
