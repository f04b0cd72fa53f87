"""A cloud written through a move: LAS in, LAS out, nothing lost."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any, Optional

import laspy
import numpy as np
import pyproj
import pytest
from clouds import points, write_copc, write_las
from rewriting import PIVOT, UTM, box, move, moved

from quantify_client.cloud import open_cloud
from quantify_client.cloud.writing import RewriteReport, rewrite_cloud
from quantify_client.errors import CrsError
from quantify_client.types import Bounds

# Servers, sizes and words: no different on a second Python.
pytestmark = pytest.mark.one_python


def rewritten(path: Path, crs: Optional[str] = UTM, ending: str = "laz") -> Any:
    """Move the points of a file. Returns what laspy reads, and the report."""
    before = laspy.read(path).xyz
    out = path.parent / f"out.{ending}"
    report = rewrite_cloud([path], out, move, box(moved(before)), crs)
    assert sorted(path.parent.glob(".*")) == []
    return laspy.read(out), report


def require_alike(one: Any, other: Any, apart: Any = ()) -> None:
    """All dimensions but X, Y and Z are the same, bit by bit."""
    for name in one.point_format.dimension_names:
        if name not in ("X", "Y", "Z", *apart):
            assert other[name].dtype == one[name].dtype, name
            assert np.array_equal(np.asarray(one[name]), np.asarray(other[name])), name


def full_las(path: Path, point_format: int, version: str, count: int = 3000) -> Path:
    """A file whose every bit is random, with extra bytes of several types."""
    generator = np.random.default_rng(point_format)
    header = laspy.LasHeader(point_format=point_format, version=version)
    header.scales, header.offsets = [0.001] * 3, np.floor(PIVOT)
    header.add_extra_dims(
        [
            laspy.ExtraBytesParams("height above", "f8", "metres over ground"),
            laspy.ExtraBytesParams("amplitude", "u2", offsets=[2.0], scales=[0.01]),
            laspy.ExtraBytesParams("three", "3i2"),
            laspy.ExtraBytesParams("no", "i4", no_data=[-1]),
        ]
    )
    las = laspy.LasData(header)
    las.x, las.y, las.z = points(count).T
    rows = las.points.array
    places = [rows[axis].copy() for axis in "XYZ"]
    rows[:] = np.frombuffer(generator.bytes(rows.nbytes), rows.dtype)
    for axis, values in zip("XYZ", places):
        rows[axis] = values
    if "gps_time" in rows.dtype.names:
        rows["gps_time"] = generator.normal(size=count) * 1e8
    rows["height above"] = generator.normal(size=count)
    las.write(path)
    return path


FORMATS = [(i, v) for i in (0, 1, 2, 3) for v in ("1.2", "1.3", "1.4")]
FORMATS += [(i, "1.4") for i in (6, 7, 8)]


@pytest.mark.parametrize("ending", ["las", "laz"])
@pytest.mark.parametrize(("point_format", "version"), FORMATS)
def test_everything_but_the_place_is_kept(
    point_format: int, version: str, ending: str, tmp_path: Path
) -> None:
    path = full_las(tmp_path / "a.laz", point_format, version)
    before = laspy.read(path)
    after, report = rewritten(path, ending=ending)
    assert after.point_format == before.point_format
    assert str(after.header.version) == "1.4"
    require_alike(before, after)
    off = np.abs(np.asarray(after.xyz) - moved(np.asarray(before.xyz)))
    assert off.max() <= 0.0005 + 1e-8
    assert np.array_equal(after.header.scales, [0.001] * 3)
    assert np.array_equal(after.header.offsets, np.floor(after.header.offsets))
    assert np.array_equal(after.header.mins, np.min(after.xyz, axis=0))
    assert np.array_equal(after.header.maxs, np.max(after.xyz, axis=0))
    assert report == RewriteReport(3000, tmp_path / f"out.{ending}", box(np.array(after.xyz)), ())
    numbers = np.bincount(np.asarray(before.return_number), minlength=16)[1:]
    assert np.array_equal(after.header.number_of_points_by_return, numbers)
    records = [vlr.get("ExtraBytesVlr")[0] for vlr in (before.header.vlrs, after.header.vlrs)]
    assert records[0].record_data_bytes() == records[1].record_data_bytes()


@pytest.mark.parametrize(("point_format", "kept"), [(4, 1), (5, 3), (9, 6), (10, 8)])
def test_wave_forms_are_left_out_with_a_warning(
    point_format: int, kept: int, tmp_path: Path
) -> None:
    path = full_las(tmp_path / "a.las", point_format, "1.4")
    after, report = rewritten(path)
    assert after.point_format.id == kept
    waves = [
        n for n in laspy.read(path).point_format.dimension_names if "wave" in n or n[1:] == "_t"
    ]
    require_alike(laspy.read(path), after, (*waves, "return_point_wave_location"))
    assert "waveforms are not written" in report.warnings[0]


@pytest.mark.parametrize("crs", [UTM, "EPSG:2277+6360", "EPSG:4979", None])
@pytest.mark.parametrize("point_format", [3, 7])
def test_crs_is_read_back(crs: Optional[str], point_format: int, tmp_path: Path) -> None:
    version = "1.4" if point_format == 7 else "1.2"
    path = write_las(tmp_path / "a.laz", points(500), point_format, version, crs="EPSG:32632")
    after, _ = rewritten(path, crs)
    found = open_cloud([tmp_path / "out.laz"]).info.crs
    assert after.header.global_encoding.wkt == (crs is not None or point_format == 7)
    assert str(after.header.version) == ("1.4" if crs or point_format == 7 else "1.2")
    if crs is None:
        assert found is None
        assert "LASF_Projection" not in [record.user_id for record in after.header.vlrs]
        return
    same = pyproj.CRS(found).equals(pyproj.CRS(crs), ignore_axis_order=True)
    assert same or pyproj.CRS(found).to_epsg(20) == pyproj.CRS(crs).to_epsg(20) is not None
    (wkt,) = after.header.vlrs.get("WktCoordinateSystemVlr")
    assert wkt.string.startswith("GEOGCRS" if crs == "EPSG:4979" else ("PROJCS", "COMPD_CS"))
    assert not after.header.vlrs.get("GeoKeyDirectoryVlr")


def test_unknown_crs_is_refused_before_anything_is_written(tmp_path: Path) -> None:
    path = write_las(tmp_path / "a.laz", points(10))
    with pytest.raises(CrsError, match="unknown CRS"):
        rewritten(path, "EPSG:1")
    assert list(tmp_path.iterdir()) == [path]


def test_las_1_0_becomes_1_2(tmp_path: Path) -> None:
    path = write_las(tmp_path / "a.las", points(50), 1, "1.1", classes=np.arange(50) % 32)
    content = bytearray(path.read_bytes())
    offset = struct.unpack_from("<I", content, 96)[0]
    content[25] = 0
    content[offset:offset] = b"\xdd\xcc"  # what 1.0 has before its points
    struct.pack_into("<I", content, 96, offset + 2)
    old = tmp_path / "old.las"
    old.write_bytes(content)
    report = rewrite_cloud([old], tmp_path / "out.las", move, box(moved(points(50))), None)
    after = laspy.read(tmp_path / "out.las")
    require_alike(laspy.read(path), after)
    assert str(after.header.version) == "1.2"
    assert report.warnings == ()


def test_records_of_others_are_kept_and_those_of_places_are_not(tmp_path: Path) -> None:
    names = laspy.VLR("LASF_Spec", 0, "Classification Lookup", b"\x02Ground".ljust(16, b"\0"))
    index = laspy.VLR("LAStools", 30, "spatial index", b"LASX")
    path = write_las(tmp_path / "a.laz", points(500), 6, "1.4", crs=UTM, vlrs=[names, index])
    las = laspy.read(path)
    long = bytes(range(256)) * 8192  # 2 MB: copied in blocks
    las.evlrs.append(laspy.VLR("someone", 7, "much", long))
    las.evlrs.append(laspy.VLR("LASF_Projection", 2112, "", pyproj.CRS(2277).to_wkt().encode()))
    las.write(path)
    after, report = rewritten(path)
    kept = {(v.user_id, v.record_id, v.description) for v in after.header.vlrs}
    assert ("LASF_Spec", 0, "Classification Lookup") in kept
    assert "LAStools" not in {user for user, _, _ in kept}
    (record,) = after.evlrs
    assert (record.user_id, record.record_data) == ("someone", long)
    assert report.warnings == (
        "records of the cloud that hold the old positions of points, and are left out: LAStools 30",
    )


def test_records_with_names_of_full_length_are_kept(tmp_path: Path) -> None:
    path = write_las(tmp_path / "a.laz", points(50), vlrs=[laspy.VLR("fifteen_letters", 5)])
    name, text = b"sixteen_letters!", b"with 32 bytes and no end \xe9 of it"[:32]
    head = bytearray(path.read_bytes())
    at = head.index(b"fifteen_letters")
    head[at : at + 16], head[at + 20 : at + 52] = name, text
    path.write_bytes(head)
    rewritten(path)
    assert name + head[at + 16 : at + 20] + text in (tmp_path / "out.laz").read_bytes()


def test_readers_of_old_versions_find_the_counts(tmp_path: Path) -> None:
    path = write_las(tmp_path / "a.laz", points(50))
    after, _ = rewritten(path)
    assert str(after.header.version) == "1.4"
    counts = struct.unpack_from("<6I", (tmp_path / "out.laz").read_bytes(), 107)
    assert counts == (50, *after.header.number_of_points_by_return[:5])
    assert sum(counts[1:]) == sum(np.asarray(after.return_number) > 0)


def test_header_keeps_what_identifies_the_survey(tmp_path: Path) -> None:
    path = write_las(tmp_path / "a.laz", points(10), 6, "1.4")
    las = laspy.read(path)
    las.header.file_source_id, las.header.system_identifier = 77, "scanner"
    las.header.global_encoding.gps_time_type = laspy.header.GpsTimeType.STANDARD
    las.write(path)
    header = rewritten(path)[0].header
    assert header.uuid == las.header.uuid
    assert (header.file_source_id, header.system_identifier) == (77, "scanner")
    assert header.global_encoding.gps_time_type == laspy.header.GpsTimeType.STANDARD
    assert header.generating_software == "quantify-client"


def test_copc_becomes_plain_laz(tmp_path: Path) -> None:
    path = write_copc(tmp_path / "a.copc.laz", points(2000))
    after, _ = rewritten(path)
    assert open_cloud([tmp_path / "out.laz"]).info.format == "laz"
    assert not [record for record in (*after.header.vlrs, *after.evlrs) if record.user_id == "copc"]
    off = np.abs(np.asarray(after.xyz) - moved(np.asarray(laspy.read(path).xyz)))
    assert off.max() <= 0.0005 + 1e-8


def test_noise_and_withheld_points_are_kept(tmp_path: Path) -> None:
    classes, held = np.arange(100) % 20, np.arange(100) % 3 == 0
    path = write_las(tmp_path / "a.laz", points(100), classes=classes, withheld=held)
    after, report = rewritten(path)
    assert report.points == len(after) == 100
    assert np.array_equal(after.classification, classes)
    assert np.array_equal(after.withheld, held)


def test_extra_bytes_that_nothing_describes_are_kept(tmp_path: Path) -> None:
    path = full_las(tmp_path / "a.las", 3, "1.2", 200)
    content = path.read_bytes()
    path.write_bytes(content.replace(b"LASF_Spec\0", b"other_one\0", 1))
    before = laspy.read(path)
    assert list(before.point_format.extra_dimension_names) == ["ExtraBytes"]
    after, _ = rewritten(path)
    require_alike(before, after)


def test_steps_grow_with_a_warning_where_the_box_is_too_wide(tmp_path: Path) -> None:
    xyz = np.array([[0.0, 0, 0], [1e6, 0, 0], [0, 1e6, 0], [5, 5, 5]])
    path = write_las(tmp_path / "a.laz", xyz + PIVOT)
    report = rewrite_cloud(
        [path],
        tmp_path / "o.laz",
        lambda x, y, z: ((x - PIVOT[0]) * 10, (y - PIVOT[1]) * 10, z),
        Bounds(0, 0, 160, 1e7, 1e7, 165),
        None,
    )
    assert laspy.read(tmp_path / "o.laz").header.scales.tolist() == [0.01] * 3
    assert "steps of 0.01 instead of 0.001" in report.warnings[0]


@pytest.mark.parametrize(("scale", "factor", "step"), [
    (0.01, 1.0, 0.001), (0.001, 1.2, 0.001), (1e-4, 0.7, 1e-4), (0.001, 0.01, 1e-5),
    (1e-4, 100.0, 0.001),
])  # fmt: skip
def test_step_is_as_fine_as_the_file_and_a_millimetre(
    scale: float, factor: float, step: float, tmp_path: Path
) -> None:
    las = laspy.LasData(laspy.LasHeader(point_format=0, version="1.2"))
    las.header.scales = [scale] * 3
    las.x, las.y, las.z = (points(100) - PIVOT).T
    las.write(tmp_path / "a.las")
    rewrite_cloud(
        [tmp_path / "a.las"],
        tmp_path / "o.las",
        lambda x, y, z: (factor * x, factor * y, factor * z),
        box(factor * (points(100) - PIVOT)),
        None,
    )
    found = laspy.read(tmp_path / "o.las")
    assert found.header.scales == pytest.approx([step] * 3)
    assert np.abs(np.asarray(found.xyz) - factor * np.asarray(las.xyz)).max() <= step * 0.5001
