"""GeoTIFF as a source: volumes in closed form, and what is refused."""

from __future__ import annotations

import sys

import numpy as np
import pytest
import rasterio
from clouds import read_all
from commands import UTM, features
from rasterio.enums import ColorInterp
from rasterio.transform import Affine
from terrains import EAST, LEVEL, NORTH, cone, flat

from quantify_client import measure
from quantify_client.cloud import open_cloud
from quantify_client.cloud.writing.sources import open_sources
from quantify_client.errors import CloudError, MissingExtraError
from quantify_client.types import Window

PILE = cone(radius=8.0, top=4.0).on(flat)
FOOT = 1200 / 3937


def write_tif(path, bands, transform, crs=UTM, **more):
    alpha = more.pop("alpha", False)
    tags = {name: more.pop(name) for name in ("scales", "offsets", "units") if name in more}
    bands = np.atleast_3d(bands) if np.ndim(bands) == 3 else np.asarray(bands)[None]
    count, height, width = bands.shape
    about = {"count": count, "height": height, "width": width, "dtype": bands.dtype}
    with rasterio.open(path, "w", "GTiff", crs=crs, transform=transform, **about, **more) as out:
        if alpha:
            out.colorinterp = [ColorInterp.gray, ColorInterp.alpha]
        for name, value in tags.items():
            setattr(out, name, value)
        out.write(bands)
    return path


def dsm(pixel, off=(0.0, 0.0), turn=0.0, unit=1.0):
    """Heights of the pile at pixel centres, and where the pixels are; both in `unit` metres."""
    c, s = pixel * np.cos(np.radians(turn)), pixel * np.sin(np.radians(turn))
    place = Affine(c, s, EAST + off[0], s, -c, NORTH + 40 + off[1])
    n = int(40 / pixel)
    column, row = np.meshgrid(np.arange(n) + 0.5, np.arange(n) + 0.5)
    x, y = (a * column + b * row + at for a, b, at in (place[:3], place[3:6]))
    z = LEVEL + PILE.height(x - EAST, y - NORTH)
    return (z / unit).astype(np.float32), Affine(*(term / unit for term in place[:6]))


def volume(path, tmp_path, **more):
    areas = tmp_path / "areas.geojson"
    areas.write_text(features(PILE.area))
    return measure(path, area=areas, grid=True, **more).results[0]


@pytest.mark.parametrize(
    ("pixel", "off", "turn"),
    [(0.1, (0.0, 0.0), 0.0), (0.137, (0.04, -0.03), 0.0), (0.11, (0, 0), 7)],
)
def test_cone_volume_matches_formula(tmp_path, pixel, off, turn):
    path = write_tif(tmp_path / "dsm.tif", *dsm(pixel, off, turn), tiled=True, compress="deflate")
    found = volume(path, tmp_path)
    assert found.volume_m3 == pytest.approx(PILE.volume, rel=1e-3)
    low, high = found.interval95_m3
    assert low < PILE.volume < high
    assert high - low < 0.02 * PILE.volume


@pytest.mark.parametrize("metre", [False, True])
def test_feet_of_the_grid_and_of_the_band(tmp_path, metre):
    z, place = dsm(0.13, unit=FOOT)
    if metre:
        z = z * np.float32(FOOT)
    crs = "+proj=utm +zone=15 +datum=WGS84 +units=us-ft"
    path = write_tif(tmp_path / "dsm.tif", z, place, crs, units=["metre" if metre else "us-ft"])
    assert volume(path, tmp_path).volume_m3 == pytest.approx(PILE.volume, rel=1e-3)


def test_centres_scale_and_what_is_left_out(tmp_path):
    raw = np.array([[10, 20, -9999], [30, 40, 50]], np.int16)
    place = Affine(2, 0, EAST, 0, -2, NORTH)
    cloud = open_cloud(
        [write_tif(tmp_path / "a.TIFF", raw, place, nodata=-9999, scales=[0.5], offsets=[100])]
    )
    assert (cloud.info.format, cloud.info.point_count) == ("geotiff", 6)
    expected = [[1, -1, 105], [3, -1, 110], [1, -3, 115], [3, -3, 120], [5, -3, 125]]
    assert read_all(cloud).tolist() == np.add(expected, [EAST, NORTH, 0]).tolist()
    assert [dict(c.left_out) for c in cloud.chunks()] == [{"nodata": 1}]
    assert max(len(c) for c in cloud.chunks(size=2)) == 2
    window = Window(EAST + 1, NORTH - 1, EAST + 1, NORTH - 1)
    assert sum(map(len, cloud.chunks(window))) < 6
    box = cloud.info.bounds
    assert (box.min_x, box.max_y, box.min_z, box.max_z) == (EAST + 1, NORTH - 1, 105, 125)


def test_nan_and_alpha_are_nodata(tmp_path):
    z, alpha = np.full((2, 4, 4), 7.0, np.float32)
    z[0, :2], alpha[:] = np.nan, 255
    alpha[3] = 0
    path = write_tif(tmp_path / "a.tif", [z, alpha], Affine(1, 0, EAST, 0, -1, NORTH), alpha=True)
    (chunk,) = open_cloud([path]).chunks()
    assert (len(chunk), dict(chunk.left_out)) == (10, {"nodata": 6})


def test_files_beside_it_are_not_read(tmp_path):
    path = write_tif(tmp_path / "a.tif", *dsm(2.0))
    before = read_all(open_cloud([path]))
    with rasterio.Env(GDAL_TIFF_INTERNAL_MASK=False), rasterio.open(path, "r+") as out:
        out.write_mask(np.zeros(out.shape, bool))
    assert (tmp_path / "a.tif.msk").exists()
    (tmp_path / "a.tif.aux.xml").write_text(
        "<PAMDataset><GeoTransform>0, 1, 0, 0, 0, -1</GeoTransform><PAMRasterBand band='1'>"
        "<NoDataValue>100</NoDataValue><Offset>50</Offset></PAMRasterBand></PAMDataset>"
    )
    (tmp_path / "a.tfw").write_text("9\n0\n0\n-9\n1\n1\n")
    assert (read_all(open_cloud([path])) == before).all()


def test_what_is_no_elevation_raster_is_refused(tmp_path):
    z, place = dsm(4.0)
    photo = write_tif(tmp_path / "photo.tif", [z.astype(np.uint8)] * 3, place)
    with pytest.raises(CloudError, match="has 3 bands; expected one of elevations: an orthophoto"):
        open_cloud([photo])
    with pytest.warns(rasterio.errors.NotGeoreferencedWarning):
        nowhere = write_tif(tmp_path / "nowhere.tif", z, Affine.identity(), None)
    with pytest.raises(CloudError, match="no geotransform"):
        open_cloud([nowhere])
    other = tmp_path / "other.tif"
    other.write_text("<VRTDataset/>")
    with pytest.raises(CloudError, match=r"is not a \.tif file.*as LAZ"):
        open_cloud([other])
    whole = write_tif(tmp_path / "cut.tif", *dsm(0.5)).read_bytes()
    other.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(CloudError, match="expected a complete GeoTIFF"):
        open_cloud([other])


def test_without_rasterio_the_extra_is_named(tmp_path, monkeypatch):
    path = write_tif(tmp_path / "a.tif", *dsm(4.0))
    monkeypatch.setitem(sys.modules, "rasterio", None)
    with pytest.raises(MissingExtraError, match=r"needs rasterio.*\[raster\]"):
        open_cloud([path])


def test_pixels_that_are_no_heights_are_refused(tmp_path):
    z, place = dsm(4.0)
    name = tmp_path / "a.tif"
    for path, said in (
        (write_tif(tmp_path / "shade.tif", z.astype(np.uint8), place), "image of 8 bits"),
        (write_tif(tmp_path / "void.tif", z * 0 - 9, place, nodata=-9), "all of its pixels"),
        (write_tif(tmp_path / "flat.tif", z, place, scales=[0.0]), "scale 0.0"),
    ):
        with pytest.raises(CloudError, match=said):
            open_cloud([path])
    about = {"width": 64, "height": 64, "count": 1, "dtype": "float32", "crs": UTM}
    tiles = {"tiled": True, "blockxsize": 32, "blockysize": 32, "sparse_ok": True}
    for nodata in (None, -9.0):
        with rasterio.open(
            name, "w", "GTiff", transform=place, nodata=nodata, **about, **tiles
        ) as out:
            out.write(np.full((32, 32), 7.0, np.float32), 1, window=((0, 32), (0, 32)))
        if nodata is None:
            with pytest.raises(CloudError, match="block 1, 0 was never written"):
                open_cloud([name])
    assert sum(map(len, open_cloud([name]).chunks())) == 32 * 32


def test_a_mask_in_the_file_and_nodata_count_both(tmp_path):
    z = np.arange(16, dtype=np.float32).reshape(4, 4)
    path = write_tif(tmp_path / "a.tif", z, Affine(1, 0, EAST, 0, -1, NORTH), nodata=5)
    with rasterio.Env(GDAL_TIFF_INTERNAL_MASK=True), rasterio.open(path, "r+") as out:
        out.write_mask(z < 12)
    (chunk,) = open_cloud([path]).chunks()
    assert chunk.z.tolist() == [0, 1, 2, 3, 4, 6, 7, 8, 9, 10, 11]


def test_the_unit_of_heights_is_found_and_whole_metres_are_told(tmp_path):
    z, place = dsm(0.5)
    old = write_tif(tmp_path / "old.tif", z, place, "EPSG:26915+6360", geotiff_version="1.0")
    parts = {part.part: part.value for part in open_cloud([old]).info.crs_parts}
    assert (parts["heights"], parts["vertical unit"]) == ("NAVD88 height (ftUS)", "US survey foot")
    bare = write_tif(tmp_path / "bare.tif", z, place, None, units=["ft"])
    assert [one.code for one in open_cloud([bare]).info.warnings] == ["only-height-unit-known"]
    whole = write_tif(tmp_path / "whole.tif", z.astype(np.int16), place)
    info = open_cloud([whole]).info
    assert info.steps == (0.0, 0.0, 1.0)
    assert [one.code for one in info.warnings] == ["scale-coarse"]


def test_a_raster_has_no_points_to_scale(tmp_path):
    path = write_tif(tmp_path / "dsm.tif", *dsm(0.5))
    with pytest.raises(CloudError, match=r"dsm\.tif: is a raster, which has no points to move"):
        open_sources(path)
