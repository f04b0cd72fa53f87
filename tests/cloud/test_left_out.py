"""What is no point of the surface is left out and counted: in any format, order and chunks."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Callable, Dict

import numpy as np
import pytest
from clouds import (
    ORIGIN,
    points,
    read_all,
    write_copc,
    write_ept,
    write_las,
    write_ply,
    write_text,
)

from quantify_client.cloud import open_cloud
from quantify_client.cloud.writing import rewrite_cloud
from quantify_client.errors import CloudError
from quantify_client.types import Bounds

ALL, SOME = "NaN in all coordinates", "NaN or infinite coordinate"

FLOATS: Dict[str, Callable[[Path, np.ndarray], Path]] = {
    "ply": lambda d, x: write_ply(d / "a.ply", x),
    "ply ascii": lambda d, x: write_ply(d / "a.ply", x, "ascii"),
    "text": lambda d, x: write_text(d / "a.csv", x),
    "ept binary": lambda d, x: float_ept(d / "ept", x),
}
ANY: Dict[str, Callable[[Path, np.ndarray], Path]] = {
    "las": lambda d, x: write_las(d / "a.las", x),
    "laz 1.4": lambda d, x: write_las(d / "a.laz", x, 7, "1.4"),
    "copc": lambda d, x: write_copc(d / "a.copc.laz", x),
    "ept": lambda d, x: write_ept(d / "ept", x),
    "ply": FLOATS["ply"],
    "text": FLOATS["text"],
}


def float_ept(root: Path, xyz: np.ndarray) -> Path:
    """Write EPT whose one tile has coordinates as floats, which can be NaN."""
    import json

    known = xyz[np.isfinite(xyz).all(axis=1)]
    path = write_ept(root, known, "binary")
    about = json.loads(path.read_text())
    about["schema"] = [{"name": axis, "type": "float", "size": 8} for axis in "XYZ"]
    about["points"] = len(xyz)
    path.write_text(json.dumps(about))
    (root / "ept-hierarchy/0-0-0-0.json").write_text(json.dumps({"0-0-0-0": len(xyz)}))
    (root / "ept-data/0-0-0-0.bin").write_bytes(np.ascontiguousarray(xyz, "<f8").tobytes())
    return path


def counts(cloud: Any, size: int = 1_000_000) -> Dict[str, int]:
    found: Dict[str, int] = {}
    for chunk in cloud.chunks(size=size):
        for reason, count in chunk.left_out.items():
            found[reason] = found.get(reason, 0) + count
    return found


@pytest.mark.parametrize("kind", FLOATS)
def test_rows_without_numbers_are_left_out_and_counted(kind: str, tmp_path: Path) -> None:
    xyz = points(1000)
    xyz[300:900] = np.nan  # an organised cloud has as many as it wants
    xyz[10, 2], xyz[20, 0], xyz[30, 1] = np.nan, np.inf, -np.inf
    cloud = open_cloud([FLOATS[kind](tmp_path, xyz)])
    for size in (7, 250, 1000):
        assert counts(cloud, size) == {ALL: 600, SOME: 3}
        delivered = read_all(cloud, size=size)
        assert np.allclose(delivered, xyz[np.isfinite(xyz).all(axis=1)], rtol=0, atol=6e-4)
    assert cloud.info.point_count == 1000
    assert cloud.info.bounds.max_z < ORIGIN[2] + 11


@pytest.mark.parametrize("kind", FLOATS)
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_more_than_one_percent_of_half_numbers_is_an_error(
    kind: str, value: float, tmp_path: Path
) -> None:
    xyz = points(1000)
    xyz[::99, 2] = value  # 11 of them
    with pytest.raises(CloudError, match="11 of 1000 points have a coordinate that is NaN or inf"):
        read_all(open_cloud([FLOATS[kind](tmp_path, xyz)]))


@pytest.mark.parametrize("kind", ANY)
@pytest.mark.parametrize("void", [-9999.0, -32767.0, -32768.0, -99999.0, 32767.0, 0.0])
def test_heights_for_no_data_are_left_out_and_counted(
    kind: str, void: float, tmp_path: Path
) -> None:
    xyz = points(2000)
    xyz[100:400, 2] = void
    cloud = open_cloud([ANY[kind](tmp_path, xyz)])
    for size in (150, 2000):
        assert counts(cloud, size) == {"nodata": 300}
        assert len(read_all(cloud, size=size)) == 1700
    assert cloud.info.point_count == 2000
    box = cloud.info.bounds
    assert (box.min_z, box.max_z) == pytest.approx((ORIGIN[2], ORIGIN[2] + 10), abs=0.1)
    assert f"300 points have the height {void:.0f}, far from all others" in cloud.info.warnings[-1]


@pytest.mark.parametrize("void", ["1.70141e+38", "-3.4028235e+38", "3.40282e38", "1e20", "9.97e36"])
def test_heights_beyond_any_map_stand_for_no_data(void: str, tmp_path: Path) -> None:
    path = write_text(tmp_path / "a.xyz", points(100), " ")
    path.write_text(path.read_text() + f"576700 5188140 {void}\n")
    assert counts(open_cloud([path])) == {"nodata beyond any map": 1}


@pytest.mark.parametrize("level", [-9999.0, -32767.0, 0.0, 9999.0])
@pytest.mark.parametrize("relief", [0.0, 1.0, 300.0])
def test_a_site_at_such_a_height_loses_nothing(level: float, relief: float, tmp_path: Path) -> None:
    """Ground exactly there, and a body of that height on a tenth of it."""
    xyz = points(1000)
    xyz[:, 2] = level
    xyz[:100, 2] += relief * np.linspace(0.01, 1, 100)
    cloud = open_cloud([write_text(tmp_path / "a.xyz", xyz, " ")])
    assert counts(cloud) == {}
    assert len(read_all(cloud)) == 1000


def test_a_flat_roof_over_a_floor_at_zero_loses_nothing(tmp_path: Path) -> None:
    xyz = points(1000)
    xyz[:, 2] = 0.0
    xyz[:100, 2] = 30.0
    cloud = open_cloud([write_text(tmp_path / "a.xyz", xyz, " ")])
    assert counts(cloud) == {}
    assert "1000" not in cloud.info.warnings[0]
    assert "900 points have the height 0 exactly, and the others 30 to 30" in cloud.info.warnings[0]


def test_a_deep_sea_with_whole_metres_loses_nothing(tmp_path: Path) -> None:
    xyz = points(5000)
    xyz[:, 2] = np.round(np.linspace(-10_900, 0, 5000))
    assert counts(open_cloud([write_text(tmp_path / "a.xyz", xyz, " ")])) == {}


def test_a_stray_hides_no_nodata(tmp_path: Path) -> None:
    xyz = points(2000)
    xyz[5:50, 2], xyz[3, 2] = -9999.0, 60_000.0
    assert counts(open_cloud([write_text(tmp_path / "a.xyz", xyz, " ")])) == {"nodata": 45}


def test_nodata_is_judged_over_all_tiles(tmp_path: Path) -> None:
    void = points(200)
    void[:, 2] = -9999.0
    files = [write_las(tmp_path / "a.laz", points(900)), write_las(tmp_path / "b.laz", void)]
    assert counts(open_cloud(files)) == {"nodata": 200}


FAR = {**FLOATS, "laz": lambda d, x: write_las(d / "a.laz", x, scale=0.01)}
FAR.pop("ept binary")


@pytest.mark.parametrize("kind", FAR)
def test_points_at_the_origin_are_left_out_and_counted(kind: str, tmp_path: Path) -> None:
    xyz = points(2000)
    xyz[::200] = 0.0
    cloud = open_cloud([FAR[kind](tmp_path, xyz)])
    assert counts(cloud, 500) == {"at the origin (0, 0, 0)": 10}
    assert cloud.info.bounds.min_x > 500_000
    assert "10 points lie at the origin (0, 0, 0), far from all others" in cloud.info.warnings[-1]


def test_a_cloud_around_its_origin_loses_nothing(tmp_path: Path) -> None:
    xyz = points(2000) - points(2000).min(axis=0)
    xyz[:5] = 0.0
    assert counts(open_cloud([write_ply(tmp_path / "a.ply", xyz)])) == {}


@pytest.mark.parametrize("kind", ["ply", "text", "ept binary"])
def test_scaling_leaves_out_rows_without_a_place_and_says_so(kind: str, tmp_path: Path) -> None:
    xyz = points(1000)
    xyz[300:900] = np.nan
    xyz[10, 2] = np.inf
    path = FLOATS[kind](tmp_path, xyz)
    low, high = np.nanmin(xyz[:10], axis=0) - 100, np.nanmax(xyz[:10], axis=0) + 100
    box = Bounds(*low.tolist(), *high.tolist())
    written = rewrite_cloud([path], tmp_path / "b.laz", lambda *xyz: xyz, box, None)
    assert written.points == 399
    assert "601 points have a coordinate that is NaN or infinite: left out" in written.warnings[-1]
    again = read_all(open_cloud([tmp_path / "b.laz"]))
    assert np.allclose(again, xyz[np.isfinite(xyz).all(axis=1)], rtol=0, atol=2e-3)


WORDS = ["nan", "NaN", "NA", "null", "-nan(ind)", "1.#QNAN", "-1.#IND00", "N/A"]


@pytest.mark.parametrize("word", WORDS)
def test_words_for_no_number_are_no_numbers(word: str, tmp_path: Path) -> None:
    path = write_text(tmp_path / "a.csv", points(1000), ",", "x,y,z")
    path.write_text(path.read_text() + f"576700,5188140,{word}\n{word},{word},{word}\n")
    cloud = open_cloud([path])
    assert counts(cloud) == ({SOME: 1, ALL: 1})
    assert len(read_all(cloud)) == 1000
    box = Bounds(576_000, 5_188_000, 0, 577_000, 5_189_000, 1000)
    written = rewrite_cloud([path], tmp_path / "b.laz", lambda *xyz: xyz, box, None)
    assert written.points == 1000


def test_other_words_are_named_with_their_line(tmp_path: Path) -> None:
    path = write_text(tmp_path / "a.csv", points(1000))
    path.write_text(path.read_text() + "576700,5188140,NA\n576700,5188140,END\n")
    with pytest.raises(CloudError, match="line 1002 is '576700,5188140,END'"):
        open_cloud([path])
