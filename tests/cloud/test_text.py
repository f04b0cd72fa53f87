"""Text: what is sniffed, and how a bad row is named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from clouds import read_all

from quantify_client.cloud import open_cloud
from quantify_client.errors import CloudError

ROWS = [(500_000.25 + i, 5_000_000.125 + 2 * i, 100.5 + i * i) for i in range(6)]


def _write(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    ("header", "row"),
    [
        ("", "{0},{1},{2}"),
        ("", "{0}, {1}, {2}, 17, red"),
        ("", "  {0}   {1} \t {2}"),
        ("", "{0};{1};{2}"),
        ("# a comment\n\n", "{0} {1} {2}"),
        ("//X,Y,Z,R\n", "{0},{1},{2},9"),
        ("# id x y z\n", "7 {0} {1} {2}"),
        ("#  POINT_ID, X, Y, Z, ERROR, SEEN[] as (PHOTO)\n# Points: 6\n", "7 {0} {1} {2} .5 1 2"),
        ("# columns: x y z r g\n", "{0} {1} {2} 3 4"),
        ("# written by a program\n", "{0} {1} {2} 3 4"),
        ("X,Y,Z\n", "{0},{1},{2}"),
        ('"X","Y","Z","Red"\n', "{0},{1},{2},3"),
        ("id;Northing;Easting;Elevation (m)\n", "a;{1};{0};{2}"),
        ("\ufeffz\ty\tx\n", "{2}\t{1}\t{0}"),
        ("", "{0} {1} {2} # a remark"),
    ],
)
def test_columns_are_found(header: str, row: str, tmp_path: Path) -> None:
    text = header + "".join(row.format(*values) + "\n" for values in ROWS)
    (tmp_path / "a.txt").write_text(text, encoding="utf-8")
    cloud = open_cloud([tmp_path / "a.txt"])
    assert np.array_equal(read_all(cloud, size=4), ROWS)
    assert cloud.info.point_count == 6


def test_comments_and_blank_lines_between_rows_are_skipped(tmp_path: Path) -> None:
    rows = [f"{x} {y} {z}" for x, y, z in ROWS]
    text = "\n".join([*rows[:2], "", "# here", "// there", *rows[2:]]) + "\n\n"
    for end in ("\n", "\r\n"):
        path = tmp_path / "a.xyz"
        path.write_bytes(text.replace("\n", end).encode())
        assert np.array_equal(read_all(open_cloud([path]), size=2), ROWS)


@pytest.mark.parametrize(
    ("header", "row"),
    [("# SHOT TIME LONGITUDE LATITUDE", "7 {0} {1} {2}"), ("//id,lat,lon,up", "7,{0},{1},{2}")],
)
def test_columns_named_otherwise_in_a_comment_are_no_coordinates(
    header: str, row: str, tmp_path: Path
) -> None:
    text = "\n".join(["# a survey", header, *(row.format(*values) for values in ROWS)])
    with pytest.raises(CloudError, match="the comment before the first row is"):
        open_cloud([_write(tmp_path / "a.txt", text)])


@pytest.mark.parametrize("bad", ["1,2", "1,2,what", "1,,3", "1;2;3"])
def test_bad_row_is_named_by_its_line(bad: str, tmp_path: Path) -> None:
    rows = [f"{x},{y},{z}" for x, y, z in ROWS]
    path = _write(tmp_path / "a.csv", "\n".join(["X,Y,Z", "# c", *rows[:3], bad, *rows[3:]]))
    with pytest.raises(CloudError, match=f"line 6 is {bad!r}"):
        open_cloud([path])


def test_decimal_commas_are_refused_and_named(tmp_path: Path) -> None:
    for text in ("1,5;2,5;3,5\n" * 5, "x;y;z\n" + "1,5;2,5;3,5\n" * 5, "1,5 2,5 3,5\n" * 5):
        with pytest.raises(CloudError, match="decimal commas"):
            open_cloud([_write(tmp_path / "a.csv", text)])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("# nothing\n\n", "holds no points"),
        ("lat,lon,when\n1,2,3\n", "expected numbers, or the names of columns"),
        ("1,2\n3,4\n", "has 2 columns"),
        ("x,y,z\n", "holds no points"),
        ("1 2 3\n4 5 6\n", "only 2 points"),
        ("1 2 3\n4 nan 6\n7 8 9\n1 2 3\n", "1 of 4 points have a coordinate that is NaN"),
        ("PK\0\0\0\0binary", "is not text"),
    ],
)
def test_what_is_no_table_of_points_is_named(text: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(CloudError, match=message):
        open_cloud([_write(tmp_path / "a.txt", text)])
