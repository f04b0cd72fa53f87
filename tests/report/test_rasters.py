"""The GeoTIFFs of a report: a known pile, north up, in the units of the CRS."""

import numpy as np
import pytest
import rasterio
from clouds import write_las, write_text
from commands import UTM, features
from terrains import CLEAN, EAST, LEVEL, NORTH, Errors, cone, flat, survey

from quantify_client import measure, write_report
from quantify_client.files.writing import is_ours

FOOT = 1200 / 3937
FEET = "+proj=utm +zone=15 +datum=WGS84 +units=us-ft"
ASIDE = cone(radius=5.0, top=4.0, x=24.0, y=26.0).on(flat)


@pytest.mark.parametrize(("crs", "unit"), [(UTM, 1.0), (FEET, FOOT)])
def test_rasters_of_a_cone(tmp_path, crs, unit):
    cloud = write_text(tmp_path / "a.csv", survey(ASIDE.height, CLEAN, 60_000) / unit, ",", "x,y,z")
    areas = tmp_path / "areas.geojson"
    areas.write_text(features(ASIDE.area, names=["Pile"]))
    measured = measure(cloud, area=areas, grid=True, crs=crs)
    write_report(measured, tmp_path / "out", rasters=True)
    held = {}
    for kind in ("surface", "base", "difference", "sigma"):
        path = tmp_path / "out" / f"area-01-pile-{kind}.tif"
        assert is_ours(path)
        with rasterio.open(path) as raster:
            held[kind] = raster.read(1, masked=True).astype(float)
            assert raster.units == ("metre",)
            assert raster.tags(ns="IMAGE_STRUCTURE")["LAYOUT"] == "COG"
            place, crs_units = raster.transform, raster.crs.linear_units_factor[1]
    assert crs_units == pytest.approx(unit)
    row, column = np.unravel_index(held["difference"].argmax(), held["difference"].shape)
    x, y = place.c + (column + 0.5) * place.a, place.f + (row + 0.5) * place.e
    assert (x * unit - EAST, y * unit - NORTH) == pytest.approx((24.0, 26.0), abs=0.3)
    assert held["difference"].sum() * (place.a * unit) ** 2 == pytest.approx(ASIDE.volume, rel=0.01)
    assert np.ma.median(held["base"]) == pytest.approx(LEVEL, abs=0.02)
    assert np.ma.allclose(held["surface"] - held["base"], held["difference"], atol=1e-4)
    assert 0 <= held["sigma"].min() <= held["sigma"].max() < 0.2


def test_the_mark_is_found_in_large_rasters_and_again_replaced(tmp_path):
    from quantify_client.report.rasters import raster_bytes
    from quantify_client.types import Relief

    z = np.random.default_rng(3).normal(size=(1500, 1400))
    relief = Relief(EAST, NORTH, 0.1, z, z, z, z > 0, b"")
    path = tmp_path / "a.tif"
    path.write_bytes(raster_bytes(z, "surface", relief, None))
    assert is_ours(path)
    with rasterio.Env(), rasterio.open(path) as raster:
        assert raster.read(1)[-1, 0] == pytest.approx(z[0, 0])
        assert raster.overviews(1)


def test_rasters_need_rasterio_and_a_folder(tmp_path, monkeypatch, capsys):
    import sys

    from quantify_client.cli import main

    assert main(["volume", "no.laz", "--rasters"]) != 0
    assert "--rasters has no place to go" in capsys.readouterr().err
    monkeypatch.setitem(sys.modules, "rasterio", None)
    assert main(["volume", "no.laz", "--rasters", "--out", str(tmp_path / "o")]) != 0
    assert "--rasters needs rasterio" in capsys.readouterr().err
    assert not (tmp_path / "o").exists()


def test_sigma_is_how_far_heights_are_from_the_truth(tmp_path):
    """Of a known pile under known noise: cells are off by sigma, as root mean square."""
    pile = cone(radius=5.0, top=4.0).on(flat)
    points = survey(pile.height, Errors(0.05, 0.0), 60_000)
    (tmp_path / "areas.geojson").write_text(features(pile.area))
    cloud = write_las(tmp_path / "a.laz", points, crs=UTM)
    relief = measure(cloud, area=tmp_path / "areas.geojson", grid=True).results[0].relief
    whole = relief.fraction == 1
    row, column = (at + 0.5 for at in np.nonzero(whole))
    x, y = relief.min_x + column * relief.cell_m, relief.min_y + row * relief.cell_m
    error = relief.above_base_m[whole] - pile.feature(x - EAST, y - NORTH)
    assert np.sqrt(np.mean((error / relief.sigma_m[whole]) ** 2)) == pytest.approx(1, abs=0.15)
