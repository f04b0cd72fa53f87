"""PLY: what it may hold, and how it fails."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from clouds import points, read_all, write_ply

from quantify_client.cloud import open_cloud
from quantify_client.errors import CloudError

CAMERAS = "element camera 2\nproperty float f\nproperty list uchar short ids\n"


@pytest.mark.parametrize("lengths", [(2, 2), (3, 1), (0, 5)])
@pytest.mark.parametrize("order", ["binary_little_endian", "binary_big_endian"])
def test_elements_before_the_points_are_skipped(order: str, lengths: tuple, tmp_path: Path) -> None:
    mark = "<" if "little" in order else ">"
    data = b"".join(
        np.array([1.5], mark + "f4").tobytes()
        + np.uint8(n).tobytes()
        + np.arange(n, dtype=mark + "i2").tobytes()
        for n in lengths
    )
    xyz = points(50)
    path = write_ply(tmp_path / "a.ply", xyz, order, before=CAMERAS, before_data=data)
    assert np.array_equal(read_all(open_cloud([path])), xyz)


def test_elements_before_ascii_points_are_skipped(tmp_path: Path) -> None:
    xyz = points(50)
    data = b"1.5 2 7 8\n1.5 0\n"
    path = write_ply(tmp_path / "a.ply", xyz, "ascii", before=CAMERAS, before_data=data)
    assert np.array_equal(read_all(open_cloud([path]), size=7), xyz)


@pytest.mark.parametrize("order", ["ascii", "binary_little_endian"])
def test_truncated_ply_is_named_as_such(order: str, tmp_path: Path) -> None:
    path = write_ply(tmp_path / "a.ply", points(500), order)
    path.write_bytes(path.read_bytes()[:-2000])
    with pytest.raises(CloudError, match="truncated: its header promises 500 points, it holds 4"):
        open_cloud([path])


def test_ply_without_coordinates_is_named(tmp_path: Path) -> None:
    path = tmp_path / "a.ply"
    head = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
    path.write_text(head + "property float height\nend_header\n1 2 3\n")
    with pytest.raises(CloudError, match=r"have no z \(properties: x, y, height\)"):
        open_cloud([path])
    path.write_text("ply\nformat ascii 1.0\nelement face 0\nend_header\n")
    with pytest.raises(CloudError, match="no 'vertex' element"):
        open_cloud([path])


@pytest.mark.parametrize(
    "header",
    [
        "nonsense",
        "ply\n",
        "ply\nformat ascii 1.0\nelement vertex many\nend_header\n",
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty quad x\nend_header\n",
        "ply\nformat binary_middle_endian 1.0\nelement vertex 1\nproperty float x\nend_header\n",
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty list uchar int x\nend_header\n",
        "ply\nformat ascii 1.0\nproperty float x\nend_header\n",
    ],
)
def test_broken_header_is_one_line(header: str, tmp_path: Path) -> None:
    path = tmp_path / "a.ply"
    path.write_text(header)
    with pytest.raises(CloudError) as caught:
        open_cloud([path])
    assert "\n" not in str(caught.value)


def test_overlong_count_is_refused(tmp_path: Path) -> None:
    path = write_ply(tmp_path / "a.ply", points(10))
    content = path.read_bytes().replace(b"vertex 10\n", b"vertex 1000000000000000\n")
    path.write_bytes(content)
    with pytest.raises(CloudError, match="promises 1000000000000000 points, it holds 1"):
        open_cloud([path])


def test_bad_value_in_ascii_is_one_line(tmp_path: Path) -> None:
    path = write_ply(tmp_path / "a.ply", points(10), "ascii")
    lines = path.read_text().splitlines()
    lines[-3] = "1 2 what 0 0"
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(CloudError, match="what"):
        open_cloud([path])


@pytest.mark.parametrize("order", ["ascii", "binary_big_endian"])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_coordinates_that_are_no_numbers_are_counted(
    order: str, value: float, tmp_path: Path
) -> None:
    xyz = points(100)
    xyz[40, 2] = value
    xyz[60, 0] = value
    path = write_ply(tmp_path / "a.ply", xyz, order)
    with pytest.raises(CloudError, match="2 of 100 points have a coordinate that is NaN"):
        open_cloud([path])


def test_single_precision_far_from_the_origin_is_warned_of(tmp_path: Path) -> None:
    far = open_cloud([write_ply(tmp_path / "a.ply", points(10), kind="float")]).info
    assert "resolve only 0.5" in far.warnings[0]
    near = points(10) - points(10).min(axis=0)
    assert open_cloud([write_ply(tmp_path / "b.ply", near, kind="float")]).info.warnings == ()


def test_empty_lines_in_place_of_points_are_missing_points(tmp_path: Path) -> None:
    path = write_ply(tmp_path / "cloud.ply", points(5), "ascii")
    header = path.read_bytes().partition(b"end_header\n")
    path.write_bytes(b"".join(header[:2]) + b"\n \n\n\n\n")
    with pytest.raises(CloudError, match="promises 5 points"):
        open_cloud([path])


def test_very_many_rows_of_differing_length_before_the_points_are_not_gone_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("quantify_client.cloud.ply.rows._MOST_WALKED", 1000)
    faces = "element face {}\nproperty list uchar uchar ids\n"
    for count, even in ((1000, False), (1002, True)):
        data = b"\0\0" * (count // 2) if even else b"\0\1\7" * (count // 2)
        path = write_ply(
            tmp_path / "cloud.ply", points(5), before=faces.format(count), before_data=data
        )
        assert len(read_all(open_cloud([path]))) == 5
    path = write_ply(
        tmp_path / "cloud.ply",
        points(5),
        before=faces.format(1002),
        before_data=b"\0\1\7" * 501,
    )
    with pytest.raises(CloudError, match="1002 rows of 'face' of differing length"):
        open_cloud([path])
