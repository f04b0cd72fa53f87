"""The CRS of a cloud, as its records say it."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Dict

import laspy
import pyproj
import pytest
from clouds import points, write_ept, write_las

from quantify_client.cloud import open_cloud
from quantify_client.errors import CloudError
from quantify_client.types import CloudInfo

UTM = "EPSG:32615"


def _geotiff(keys: Dict[int, int]) -> laspy.VLR:
    data = struct.pack("<4H", 1, 1, 0, len(keys))
    for key, value in sorted(keys.items()):
        data += struct.pack("<4H", key, 0, 1, value)
    return laspy.VLR("LASF_Projection", 34735, "", data)


def _info(tmp_path: Path, keys: Dict[int, int]) -> CloudInfo:
    return open_cloud([write_las(tmp_path / "a.laz", points(10), vlrs=[_geotiff(keys)])]).info


def test_wkt_record_is_found(tmp_path: Path) -> None:
    path = write_las(tmp_path / "a.laz", points(10), 6, "1.4", crs=UTM)
    info = open_cloud([path]).info
    assert info.crs_origin == "LAS WKT record"
    assert pyproj.CRS.from_wkt(info.crs).to_epsg() == 32615


def test_compound_wkt_keeps_its_heights(tmp_path: Path) -> None:
    path = write_las(tmp_path / "a.laz", points(10), 6, "1.4", crs="EPSG:2277+6360")
    crs = pyproj.CRS.from_wkt(open_cloud([path]).info.crs)
    assert [axis.unit_name for axis in crs.axis_info] == ["US survey foot"] * 3


def test_wkt_after_the_points_is_found(tmp_path: Path) -> None:
    path = write_las(tmp_path / "a.laz", points(10), 6, "1.4")
    las = laspy.read(path)
    wkt = pyproj.CRS(UTM).to_wkt()
    las.evlrs.append(laspy.VLR("LASF_Projection", 2112, "", wkt.encode()))
    las.evlrs.append(laspy.VLR("other", 1, "", b"x" * 100_000))
    las.write(path)
    assert open_cloud([path]).info.crs == wkt
    path.write_bytes(path.read_bytes()[:-10])
    with pytest.raises(CloudError, match="truncated"):
        open_cloud([path])


def test_geotiff_keys_name_a_code(tmp_path: Path) -> None:
    info = _info(tmp_path, {1024: 1, 2048: 4326, 3072: 32615, 3076: 9001, 4099: 9001})
    assert (info.crs, info.crs_origin) == (UTM, "GeoTIFF keys")
    assert info.warnings == ()


def test_wkt_of_liblas_adds_what_the_keys_do_not_say(tmp_path: Path) -> None:
    """It is told, not believed, where keys contradict it: programs that change them leave it."""
    wkt = laspy.VLR("liblas", 2112, "", pyproj.CRS("EPSG:2277+6360").to_wkt("WKT1_GDAL").encode())
    feet = {1024: 1, 3072: 2277}
    for name, keys in (("alone", None), ("beside", feet), ("against", {1024: 1, 3072: 32615})):
        records = [wkt] if keys is None else [_geotiff(keys), wkt]
        info = open_cloud([write_las(tmp_path / f"{name}.las", points(10), vlrs=records)]).info
        crs = pyproj.CRS(info.crs)
        told = [text for text in info.warnings if "contradict" in text]
        if name == "against":
            assert crs.sub_crs_list[0].to_epsg() == 32615
            assert "GeoTIFF keys and libLAS WKT record contradict" in told[0]
        else:
            assert [axis.unit_name for axis in crs.axis_info] == ["US survey foot"] * 3
            assert not told


def test_height_unit_of_geotiff_keys_is_kept(tmp_path: Path) -> None:
    crs = pyproj.CRS(_info(tmp_path, {1024: 1, 3072: 32615, 4099: 9003}).crs)
    assert [axis.unit_name for axis in crs.axis_info] == ["metre", "metre", "US survey foot"]
    crs = pyproj.CRS(_info(tmp_path, {1024: 1, 3072: 32615, 4096: 5703}).crs)
    assert crs.sub_crs_list[1].to_epsg() == 5703


def test_height_unit_is_kept_where_old_wkt_cannot_say_the_rest(tmp_path: Path) -> None:
    """EPSG:4979 has three axes, EPSG:5041 points north along meridians: WKT 1 has neither."""
    for code in (4979, 5041):
        crs = pyproj.CRS(_info(tmp_path, {1024: 1, 3072: code, 4099: 9003}).crs)
        assert crs.axis_info[2].unit_name == "US survey foot"


def test_feet_without_height_keys_stay_a_plain_code(tmp_path: Path) -> None:
    assert _info(tmp_path, {1024: 1, 3072: 2277}).crs == "EPSG:2277"


@pytest.mark.parametrize(("projection", "code"), [(16032, 32632), (16117, 32717)])
def test_utm_spelled_out_in_keys_is_recognised(projection: int, code: int, tmp_path: Path) -> None:
    keys = {1024: 1, 2048: 4326, 3072: 32767, 3074: projection, 3076: 9001}
    assert _info(tmp_path, keys).crs == f"EPSG:{code}"


def test_unit_of_a_user_defined_projection_is_kept(tmp_path: Path) -> None:
    info = _info(tmp_path, {1024: 1, 2048: 4269, 3072: 32767, 3076: 9003})
    crs = pyproj.CRS(info.crs)
    assert crs.axis_info[0].unit_conversion_factor == pytest.approx(1200 / 3937, rel=1e-12)
    assert not crs.is_geographic
    assert "user-defined" in info.warnings[0]


@pytest.mark.parametrize(("size", "factor"), [(0.9144, 0.9144), (float("nan"), None)])
def test_unit_may_be_a_number_among_the_doubles(
    size: float, factor: object, tmp_path: Path
) -> None:
    keys = [(1024, 0, 1), (3072, 0, 32767), (3076, 0, 32767), (3077, 34736, 0)]
    data = struct.pack("<4H", 1, 1, 0, len(keys))
    data += b"".join(struct.pack("<4H", key, where, 1, value) for key, where, value in keys)
    vlrs = [
        laspy.VLR("LASF_Projection", 34735, "", data),
        laspy.VLR("LASF_Projection", 34736, "", struct.pack("<d", size)),
    ]
    crs = open_cloud([write_las(tmp_path / "a.laz", points(10), vlrs=vlrs)]).info.crs
    assert (crs and pyproj.CRS(crs).axis_info[0].unit_conversion_factor) == factor


def test_what_cannot_be_understood_is_a_warning(tmp_path: Path) -> None:
    info = _info(tmp_path, {1024: 1, 2048: 4269, 3072: 32767})
    assert (info.crs, len(info.warnings)) == (None, 1)
    assert _info(tmp_path, {1024: 1, 3072: 1030}).crs is None


@pytest.mark.parametrize("text", [b"PROJCS[nonsense", b'{"a":' * 10_000])
def test_wkt_that_is_none_is_a_warning(text: bytes, tmp_path: Path) -> None:
    bad = laspy.VLR("LASF_Projection", 2112, "", text)
    info = open_cloud([write_las(tmp_path / "b.laz", points(10), 6, "1.4", vlrs=[bad])]).info
    assert (info.crs, len(info.warnings)) == (None, 1)


def test_ept_names_its_crs(tmp_path: Path) -> None:
    wkt = pyproj.CRS(UTM).to_wkt()
    for index, (srs, crs) in enumerate(
        [
            ({"wkt": wkt, "authority": "EPSG", "horizontal": "1"}, wkt),
            ({"authority": "EPSG", "horizontal": "32615", "vertical": "5703"}, f"{UTM}+5703"),
            ({}, None),
        ]
    ):
        path = write_ept(tmp_path / str(index), points(50), srs=srs)
        assert open_cloud([path]).info.crs == crs


def test_tiles_must_agree_on_their_crs(tmp_path: Path) -> None:
    one = write_las(tmp_path / "a.laz", points(10), 6, "1.4", crs=UTM)
    same = write_las(tmp_path / "b.laz", points(10), vlrs=[_geotiff({1024: 1, 3072: 32615})])
    other = write_las(tmp_path / "c.laz", points(10), 6, "1.4", crs="EPSG:32616")
    silent = write_las(tmp_path / "d.laz", points(10))
    assert open_cloud([one, same]).info.warnings == ()
    info = open_cloud([silent, one]).info
    assert pyproj.CRS(info.crs).to_epsg() == 32615
    assert "name no CRS" in info.warnings[-1]
    with pytest.raises(CloudError, match="another CRS"):
        open_cloud([one, other])


def test_a_wkt_record_of_heights_alone_leaves_the_plane_to_the_keys(tmp_path: Path) -> None:
    heights = 'VERT_CS["local",VERT_DATUM["local",2005],UNIT["foot",0.3048],AXIS["Up",UP]]'
    wkt = laspy.VLR("LASF_Projection", 2112, "", heights.encode())
    keys = _geotiff({1024: 1, 3072: 32615})
    path = write_las(tmp_path / "a.laz", points(10), 6, "1.4", vlrs=[wkt, keys])
    crs = pyproj.CRS(open_cloud([path]).info.crs)
    assert [axis.unit_name for axis in crs.axis_info] == ["metre", "metre", "foot"]


@pytest.mark.parametrize("unit", [9040, 32767])
def test_a_unit_of_the_plane_that_is_not_known_is_told(tmp_path: Path, unit: int) -> None:
    info = _info(tmp_path, {1024: 1, 3072: 32615, 3076: unit})
    assert any(f"unit of x and y, {unit}, is not known" in text for text in info.warnings)
