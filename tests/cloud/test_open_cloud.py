"""The front door: what is not a cloud is told by name."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from clouds import points, write_las

from quantify_client.cloud import open_cloud
from quantify_client.cloud.base import naming
from quantify_client.errors import CloudError

LFS = b"version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 1\n"


@pytest.mark.parametrize("name", ["a.laz", "a.las", "a.ply", "a.csv", "ept.json"])
@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is empty"),
        (LFS, "git lfs pull"),
        (b"\n<!DOCTYPE html><html>", "web page"),
        (b"<HTML>", "web page"),
    ],
)
def test_impostors_are_named(name: str, content: bytes, message: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(CloudError, match=message):
        open_cloud([path])


def test_what_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(CloudError, match="does not exist"):
        open_cloud([tmp_path / "a.laz"])
    with pytest.raises(CloudError, match="is not a file"):
        open_cloud([tmp_path])
    with pytest.raises(CloudError, match="at least one"):
        open_cloud([])
    (tmp_path / "a.jpg").write_bytes(b"x")
    with pytest.raises(CloudError, match="unknown ending"):
        open_cloud([tmp_path / "a.jpg"])


def test_a_tile_given_twice_would_count_twice(tmp_path: Path) -> None:
    path = write_las(tmp_path / "a.laz", points(10))
    (tmp_path / "b.laz").symlink_to(path)
    with pytest.raises(CloudError, match="twice"):
        open_cloud([path, tmp_path / "b.laz"])


def test_a_tile_without_points_does_no_harm(tmp_path: Path) -> None:
    full = write_las(tmp_path / "a.laz", points(10))
    empty = write_las(tmp_path / "b.laz", np.empty((0, 3)))
    cloud = open_cloud([full, empty])
    assert sum(map(len, cloud.chunks())) == cloud.info.point_count == 10


def test_a_panic_in_a_library_becomes_one_line() -> None:
    class PanicException(BaseException):
        pass

    advice = naming(Path("a.laz"), "copy it again")
    with pytest.raises(CloudError, match="index out of range"), advice:
        raise PanicException("index out of range\nbacktrace")
    advice = naming(Path("a.laz"), "copy it again")
    with pytest.raises(KeyboardInterrupt), advice:
        raise KeyboardInterrupt
    advice = naming(Path("a.laz"), "copy it again")
    with pytest.raises(CloudError, match="no permission"), advice:
        raise PermissionError(13, "Permission denied")
