"""CRSs whose datum is not named: ordinary ones, which are measured, with a word about it."""

import json

import laspy
import numpy as np
import pyproj
import pytest
import shapely
from clouds import write_las
from commands import PILE, UTM, features, texts
from pyogrio.raw import write
from terrains import Errors, survey

from quantify_client.crs import label

#: Whole commands: what they are made of is tested on the second Python as well.
pytestmark = pytest.mark.one_python

GEOGCS = (
    'GEOGCS["GCS_Not_specified",DATUM["D_Not_specified",SPHEROID["GRS_1980",6378137.0,'
    '298.257222101]],PRIMEM["Greenwich",0.0],UNIT["Degree",0.0174532925199433]]'
)
ESRI = (
    f'PROJCS["NAD_1983_UTM_Zone_15N",{GEOGCS},PROJECTION["Transverse_Mercator"],'
    'PARAMETER["False_Easting",500000.0],PARAMETER["False_Northing",0.0],'
    'PARAMETER["Central_Meridian",-93.0],PARAMETER["Scale_Factor",0.9996],'
    'PARAMETER["Latitude_Of_Origin",0.0],UNIT["Meter",1.0]]'
)
ODM = "+proj=utm +zone=15 +ellps=WGS84"
BALLPARK = ["+proj=utm +zone=15 +ellps=GRS80", "+proj=utm +zone=15 +a=6378137 +b=6356752.3"]
UNNAMED = [ODM, ESRI, *BALLPARK]


@pytest.fixture(scope="module")
def points():
    return survey(PILE.height, Errors(0.01, 0.0), 30_000)


def _as_las(path, points, crs):
    wkt = crs if crs.startswith("PROJCS") else pyproj.CRS(crs).to_wkt("WKT1_GDAL")
    record = laspy.VLR("LASF_Projection", 2112, "", wkt.encode() + b"\0")
    return write_las(path, points, 6, "1.4", vlrs=[record])


def _in_degrees():
    to = pyproj.Transformer.from_crs(UTM, 4326, always_xy=True)
    return shapely.transform(PILE.area, lambda xy: np.column_stack(to.transform(*xy.T)))


def _volume(document, *arguments):
    found = document("volume", *arguments)
    (result,) = found["results"]
    return result["volume_m3"], texts(found)


@pytest.mark.parametrize("crs", UNNAMED)
def test_cloud_on_an_unnamed_datum_is_measured_by_outlines_in_wgs84(
    crs, points, document, tmp_path
):
    cloud = _as_las(tmp_path / "a.las", points, crs)
    (tmp_path / "a.geojson").write_text(features(_in_degrees(), crs=None))
    volume, warnings = _volume(document, cloud, "--area", tmp_path / "a.geojson")
    assert volume == pytest.approx(PILE.volume, rel=0.02)
    (note,) = [text for text in warnings if "placed on the cloud" in text]
    assert "an unknown accuracy: no way between their datums is known, or one is not named" in note
    assert "PROJCRS[" not in note


@pytest.mark.parametrize("crs", UNNAMED)
@pytest.mark.parametrize("kind", ["geojson", "shp"])
def test_outlines_on_an_unnamed_datum_are_placed_on_a_cloud_in_utm(
    kind, crs, points, document, tmp_path
):
    cloud = write_las(tmp_path / "a.las", points, crs=UTM)
    area = tmp_path / f"a.{kind}"
    if kind == "shp":
        shape = shapely.to_wkb(np.array([PILE.area]))
        about = {"field_data": [], "fields": [], "geometry_type": "Polygon", "crs": crs}
        write(area, geometry=shape, **about)
    else:
        area.write_text(features(PILE.area, crs=crs))
    volume, warnings = _volume(document, cloud, "--area", area)
    assert volume == pytest.approx(PILE.volume, rel=0.02)
    assert any("an unknown accuracy" in text for text in warnings)


@pytest.mark.parametrize("crs", UNNAMED)
def test_cloud_and_outlines_in_one_such_crs_need_no_word(crs, points, document, tmp_path):
    cloud = _as_las(tmp_path / "a.las", points, crs)
    (tmp_path / "a.geojson").write_text(features(PILE.area, crs=crs))
    volume, warnings = _volume(document, cloud, "--area", tmp_path / "a.geojson")
    assert volume == pytest.approx(PILE.volume, rel=0.02)
    assert warnings == []


def test_report_has_the_outline_in_degrees(points, run, tmp_path):
    cloud = _as_las(tmp_path / "a.las", points, ODM)
    (tmp_path / "a.geojson").write_text(features(PILE.area, crs=ODM))
    status, _, err = run("volume", cloud, "--area", tmp_path / "a.geojson", "--out", tmp_path / "o")
    assert (status, err) == (0, "")
    (feature,) = json.loads((tmp_path / "o" / "areas.geojson").read_text())["features"]
    found = shapely.from_geojson(json.dumps(feature["geometry"])).centroid
    assert found.distance(_in_degrees().centroid) < 1e-6


def test_control_in_such_a_crs_is_read(run, tmp_path):
    rows = [
        f"{500000 + 10 * i} {5000000 + i * i} {100 + i} 700 800 I{i}.jpg M{i}" for i in range(4)
    ]
    (tmp_path / "gcp_list.txt").write_text("\n".join([ODM, *rows]) + "\n")
    out = tmp_path / "out.txt"
    status, _, err = run("gcp", tmp_path / "gcp_list.txt", "--to", "odm", "--out", out)
    assert (status, err) == (0, "")
    assert out.read_text().startswith("+proj=utm +zone=15 +ellps=WGS84")


@pytest.mark.parametrize(
    ("crs", "words"),
    [
        (ODM, ODM),
        ("EPSG:32615", "EPSG:32615"),
        (ESRI, "NAD83 / UTM zone 15N"),
        (pyproj.CRS(ODM).to_wkt(), "a Projected CRS on the datum 'Unknown based on WGS 84"),
    ],
)
def test_crs_has_a_name_in_messages(crs, words):
    assert label(crs).startswith(words)
    assert len(label(crs)) <= 60
