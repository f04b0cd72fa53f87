"""all.zip: the cloud comes out, nothing else does, and nothing stays behind."""

from __future__ import annotations

import shutil
import stat
import struct
import tempfile
import tracemalloc
import zipfile
from pathlib import Path
from typing import Iterator

import numpy as np
import pytest
from clouds import ORIGIN, points, read_all, write_las

from quantify_client.errors import CloudError
from quantify_client.sfm.odm import archive
from quantify_client.source import open_source

# Servers, sizes and words: no different on a second Python.
pytestmark = pytest.mark.one_python

MODEL = "odm_georeferencing/odm_georeferenced_model.laz"
COORDS = f"WGS84 UTM 15N\n{ORIGIN[0]:.0f} {ORIGIN[1]:.0f}\n"


@pytest.fixture(autouse=True)
def scratch(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Temporary files go here, and none may be left at the end of any test."""
    folder = tmp_path / "scratch"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    yield folder
    assert list(folder.iterdir()) == []


def _laz(count: int = 100) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        return write_las(Path(folder) / "a.laz", points(count)).read_bytes()


def _zip(path: Path, **members: bytes) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as out:
        for name, content in members.items():
            out.writestr(name, content)
    return path


def _refused(path: Path, message: str) -> str:
    with pytest.raises(CloudError, match=message) as caught, open_source([path]) as source:
        read_all(source.cloud)
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize("prefix", ["", "task/", "a/b/c/"])
def test_cloud_and_its_crs_come_out(prefix: str, tmp_path: Path, scratch: Path) -> None:
    members = {
        f"{prefix}{MODEL}": _laz(),
        f"{prefix}odm_georeferencing/coords.txt": COORDS.encode(),
        f"{prefix}odm_orthophoto/odm_orthophoto.tif": b"x" * 1000,
    }
    path = _zip(tmp_path / "all.zip", **members)
    with open_source([path]) as source:
        assert np.allclose(read_all(source.cloud), points(100), rtol=0, atol=1e-6)
        assert (source.stem, source.is_odm, source.label) == ("all", True, str(path))
        assert source.cloud.info.crs == "EPSG:32615"
        assert source.cloud.info.sources == (f"{path}/{MODEL}",)
        assert source.inputs[0]["path"] == str(path)
        assert source.inputs[0]["size"] == path.stat().st_size
        unpacked = [item.name for item in scratch.rglob("*") if item.is_file()]
        assert sorted(unpacked) == ["coords.txt", "odm_georeferenced_model.laz"]


def test_the_one_cloud_of_another_zip_is_taken(tmp_path: Path) -> None:
    path = _zip(tmp_path / "p.zip", **{"tiles/a.laz": _laz(), "readme.txt": b"hello"})
    with open_source([path]) as source:
        assert len(read_all(source.cloud)) == 100
        assert not source.is_odm
    _refused(_zip(path, **{"a.laz": _laz(), "b.laz": _laz()}), "holds 2 point clouds")


@pytest.mark.parametrize("stop", [KeyboardInterrupt, ValueError])
def test_nothing_stays_behind_when_work_is_broken_off(stop: type, tmp_path: Path) -> None:
    path = _zip(tmp_path / "all.zip", **{MODEL: _laz()})
    with pytest.raises(stop), open_source([path]):
        raise stop


def test_errors_name_the_archive_and_not_a_temporary_file(tmp_path: Path, scratch: Path) -> None:
    path = _zip(tmp_path / "all.zip", **{MODEL: _laz()[:-50]})
    assert str(scratch) not in _refused(path, f"all.zip/{MODEL}: is truncated")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"<!DOCTYPE html><html></html>", "web page"),
        (b"version https://git-lfs.github.com/spec/v1\n", "git lfs pull"),
        (b"", "is empty"),
        (b"Rar!", "is not a zip file"),
    ],
)
def test_what_is_no_zip_is_named(content: bytes, message: str, tmp_path: Path) -> None:
    path = tmp_path / "all.zip"
    path.write_bytes(content)
    _refused(path, message)


@pytest.mark.parametrize("keep", [0.1, 0.5, 0.99])
def test_truncated_zip_is_named(keep: float, tmp_path: Path) -> None:
    path = _zip(tmp_path / "all.zip", **{MODEL: _laz(2000)})
    content = path.read_bytes()
    path.write_bytes(content[: int(len(content) * keep)])
    _refused(path, "is truncated")


def test_damaged_member_is_found_by_its_checksum(tmp_path: Path) -> None:
    path = tmp_path / "all.zip"
    with zipfile.ZipFile(path, "w") as out:
        out.writestr(MODEL, _laz(2000))
    content = bytearray(path.read_bytes())
    content[1000] ^= 255
    path.write_bytes(content)
    _refused(path, "CRC")


@pytest.mark.parametrize(
    "name", ["../evil.laz", "a/../../evil", "/etc/passwd", "C:/x", "..\\evil", "\\\\host\\x"]
)
def test_names_that_lead_out_refuse_the_whole_archive(name: str, tmp_path: Path) -> None:
    path = _zip(tmp_path / "all.zip", **{MODEL: _laz(), name: b"x"})
    _refused(path, "leads out")


def test_links_refuse_the_whole_archive(tmp_path: Path) -> None:
    path = _zip(tmp_path / "all.zip", **{MODEL: _laz()})
    with zipfile.ZipFile(path, "a") as out:
        link = zipfile.ZipInfo("link")
        link.external_attr = (stat.S_IFLNK | 0o777) << 16
        out.writestr(link, "/etc/passwd")
    _refused(path, "is a link")


def test_bomb_is_refused_before_it_is_unpacked(tmp_path: Path) -> None:
    path = _zip(tmp_path / "all.zip", **{MODEL: bytes(20 << 20)})
    _refused(path, "times its size")


def test_size_that_no_disk_holds_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = _zip(tmp_path / "all.zip", **{MODEL: _laz()})
    monkeypatch.setattr(archive, "_MAX_SIZE", 10)
    _refused(path, "more than the")


def test_full_disk_is_told_before(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = _zip(tmp_path / "all.zip", **{MODEL: _laz()})
    usage = type(shutil.disk_usage(tmp_path))(10, 10, 0)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage)
    _refused(path, "are free")


def test_member_that_claims_to_be_smaller_is_found(tmp_path: Path) -> None:
    laz = _laz(2000)
    path = _zip(tmp_path / "all.zip", **{MODEL: laz})
    content = path.read_bytes()
    size = len(laz).to_bytes(4, "little")
    path.write_bytes(content.replace(size, (100).to_bytes(4, "little")))
    _refused(path, "CRC|larger|bytes")


def test_encrypted_member_is_named(tmp_path: Path) -> None:
    path = _zip(tmp_path / "all.zip", **{MODEL: _laz()})
    content = bytearray(path.read_bytes())
    for signature, place in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        content[content.index(signature) + place] |= 1
    path.write_bytes(content)
    _refused(path, "is encrypted")


def test_archive_without_a_cloud_says_what_was_looked_for(tmp_path: Path) -> None:
    path = _zip(tmp_path / "all.zip", **{"odm_report/stats.json": b"{}"})
    _refused(path, "looked for odm_georeferencing")
    path = _zip(tmp_path / "all.zip", **{"entwine_pointcloud/ept.json": b"{}"})
    _refused(path, "unpack it and give the folder")


def test_oversized_sidecar_is_ignored(tmp_path: Path) -> None:
    members = {MODEL: _laz(), "odm_georeferencing/coords.txt": COORDS.encode() + bytes(1 << 20)}
    with open_source([_zip(tmp_path / "all.zip", **members)]) as source:
        assert source.cloud.info.crs is None


def test_lfs_pointer_within_the_archive_is_named(tmp_path: Path) -> None:
    pointer = b"version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 1\n"
    _refused(_zip(tmp_path / "all.zip", **{MODEL: pointer}), "git lfs pull")


def test_small_member_is_no_zip_bomb_whatever_its_ratio(tmp_path: Path) -> None:
    path = tmp_path / "a.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as out:
        out.writestr("a", bytes(1 << 20))
    with zipfile.ZipFile(path) as opened:
        info = opened.getinfo("a")
    assert info.file_size > 100 * info.compress_size
    archive._require_sound(path, info, tmp_path)


def _listing(members: int) -> bytes:
    """An archive that is nothing but a list of empty members, with its end in both forms."""
    entry = b"PK\x01\x02" + bytes(24) + struct.pack("<HHH", 1, 0, 0) + bytes(12) + b"a"
    listed = entry * members
    numbers = (44, 45, 45, 0, 0, members, members, len(listed), 0)
    end64 = struct.pack("<4sQHHIIQQQQ", b"PK\x06\x06", *numbers)
    place64 = struct.pack("<4sIQI", b"PK\x06\x07", 0, len(listed), 1)
    full = (0, 0, 0xFFFF, 0xFFFF, 0xFFFFFFFF, 0xFFFFFFFF, 0)
    return listed + end64 + place64 + struct.pack("<4s4H2LH", b"PK\x05\x06", *full)


def test_four_million_members_are_refused_before_they_are_read(tmp_path: Path) -> None:
    (tmp_path / "all.zip").write_bytes(_listing(4_000_000))
    tracemalloc.start()
    _refused(tmp_path / "all.zip", "a list of members of more than 10 MB")
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most < 40 << 20


def test_twenty_thousand_members_are_many_and_honest(tmp_path: Path) -> None:
    many = {f"entwine_pointcloud/ept-data/12-{i:05}-{i:05}-0.laz": b"" for i in range(20_000)}
    path = _zip(tmp_path / "all.zip", **many, **{MODEL: _laz()})
    with open_source([path]) as source:
        assert len(read_all(source.cloud)) == 100


@pytest.mark.parametrize("method", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_methods_that_unpack_without_bounds_are_refused(method: int, tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "all.zip", "w", method) as out:
        out.writestr(MODEL, bytes(30 << 20))
    _refused(tmp_path / "all.zip", rf"packed by method {method}; expected 8 \(deflate\)")


def test_sidecar_packed_without_bounds_is_ignored(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "all.zip", "w", zipfile.ZIP_DEFLATED) as out:
        out.writestr(MODEL, _laz())
        info = zipfile.ZipInfo("odm_georeferencing/coords.txt")
        info.compress_type = zipfile.ZIP_LZMA
        out.writestr(info, COORDS)
    with open_source([tmp_path / "all.zip"]) as source:
        assert source.cloud.info.crs is None


def test_ratio_counts_what_is_there_not_what_is_claimed(tmp_path: Path) -> None:
    """A member that claims to be packed into a gigabyte is still a bomb."""
    path = _zip(tmp_path / "all.zip", **{MODEL: bytes(60 << 20)})
    data = bytearray(path.read_bytes())
    listed = data.rindex(b"PK\x01\x02")
    struct.pack_into("<I", data, listed + 20, 1 << 30)
    path.write_bytes(data)
    _refused(path, "times its size, which no point cloud does")
