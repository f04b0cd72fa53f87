"""The cloud's CRS and units, given with a measurement: checked, used, kept and shown."""

import importlib
import json
import sys
import types
from pathlib import Path

import pyproj
import pytest
from visitors import API, PLACE, ROUND, lon_lat

PLUGIN = Path(__file__).resolve().parents[2] / "plugin"
pytestmark = pytest.mark.one_python

UTM = "EPSG:32615"


@pytest.fixture(scope="module")
def checks():
    """The plugin's own check, without WebODM."""
    package = types.ModuleType("volcalc_crs")
    package.__path__ = [str(PLUGIN), str(PLUGIN.parent)]
    sys.modules["volcalc_crs"] = package
    yield importlib.import_module("volcalc_crs.web.requested_options")
    for name in [name for name in sys.modules if name.startswith("volcalc_crs")]:
        del sys.modules[name]


@pytest.fixture
def nowhere(host):
    """A task whose cloud and tiles do not say where they are."""
    task, assets = host.tasks["No rasters"], host.assets("No rasters")
    tiles = assets / "entwine_pointcloud" / "ept.json"
    cloud = assets / "odm_georeferencing" / "odm_georeferenced_model.laz"
    beside = [assets / "odm_georeferencing" / name for name in ("coords.txt", "proj.txt")]
    kept = {path: path.read_bytes() for path in (tiles, cloud, *beside) if path.is_file()}
    tiles.write_text(json.dumps({**json.loads(kept[tiles]), "srs": {}}))
    cloud.write_bytes(kept[cloud].replace(b"LASF_Projection", b"Somebody_else.."))
    for path in beside:
        path.unlink(missing_ok=True)
    yield task
    for path, data in kept.items():
        path.write_bytes(data)


@pytest.mark.parametrize(
    "given",
    [
        "EPSG:2255",
        "epsg:32615+5703",
        "+proj=utm +zone=15 +datum=WGS84 +units=us-ft +no_defs +type=crs",
        "+proj=lcc +lat_1=43.5 +lat_2=-4e1 +towgs84=1,2,-3,0,0,0,0 +nadgrids=@null",
        *(pyproj.CRS(2255).to_wkt(dialect) for dialect in ("WKT1_ESRI", "WKT1_GDAL", "WKT2_2019")),
        pyproj.CRS(3857).to_wkt("WKT1_GDAL"),  # which carries a PROJ text with +nadgrids=@null
    ],
)
def test_a_crs_is_taken(given, checks):
    assert checks.checked_options({"crs": f"  {given}\n"})["crs"] == " ".join(given.split())


@pytest.mark.parametrize(
    "given",
    [
        *("", "  ", "32615", "EPSG:", "EPSG:326150000", "ESRI:102100", "/etc/passwd", "a.prj"),
        *("EPSG:32615/../../etc/passwd", "file:///etc/passwd", "http://127.0.0.1/crs.wkt"),
        *("+init=epsg:32615", "+proj=utm +init=/etc/passwd:1", "+proj=pipeline +step +proj=utm"),
        *("+proj=longlat +nadgrids=/etc/passwd", "+proj=longlat +nadgrids=@x.gsb"),
        *(
            "+proj=longlat +geoidgrids=egm96.gtx",
            "+proj=vgridshift +grids=a.tif",
            "+proj=x +file=a",
        ),
        *("urn:ogc:def:crs:EPSG::32615", '{"type": "GeographicCRS"}', "PROJCS", "[PROJCS[]]"),
        'GEOGCS["a",EXTENSION["PROJ4","+proj=longlat +nadgrids=/etc/passwd"]]',
        'BOUNDCRS[SOURCECRS[],PARAMETERFILE["Latitude and longitude","/etc/passwd"]]',
        'PROJCS["a\u202eb",UNIT["metre",1]]',
        'PROJCS["' + "x" * 4000 + '"]',
        *(7, True, ["EPSG:32615"], {"a": 1}),
    ],
)
def test_what_is_no_crs_or_names_a_file_is_refused(given, checks):
    with pytest.raises(checks.MisshapenError, match=r"options\.crs has to"):
        checks.checked_options({"crs": given})


def test_wrong_coordinates_are_refused_in_a_line(host, beach_task):
    for options in ({"crs": "/etc/passwd"}, {"vertical_unit": "yard"}, {"source_unit": 1}):
        answer = host.owner.post(f"{API}/{beach_task}/jobs", {"area": ROUND, "options": options})
        assert answer.status == 400
        assert next(iter(options)) in answer.error


def test_a_code_that_nobody_knows_opens_no_file(host, beach_task):
    asked = {"area": ROUND, "options": {"crs": "EPSG:999999"}}
    job = host.owner.post(f"{API}/{beach_task}/jobs", asked).json["job"]
    state = host.owner.wait(beach_task, job)
    assert state["state"] == "failed"
    assert state["error"] == (
        "\u201cCoordinate system\u201d 'EPSG:999999' is not a CRS that is known here: give EPSG:n, "
        "WKT or a PROJ string"
    )


def test_a_cloud_that_does_not_say_is_given_its_crs(host, nowhere):
    assert host.other.get(f"{API}/{nowhere}/").json["has_crs"] is False
    (failure,) = host.other.measured(nowhere)["measurement"]["results"]
    assert "correct its CRS, or the cloud's (\u201cCoordinate system\u201d)" in failure["error"]
    # In feet the eaves of a roof are too near the ground to be told from it.
    options = {"crs": UTM, "layer": "mean"}
    document = host.other.measured(nowhere, options={**options, "vertical_unit": "us-ft"})
    assert document["measurement"]["crs"] == UTM
    said = {p["part"]: p for p in document["measurement"]["provenance"]["coordinates"]}
    assert said["CRS"]["source"] == "\u201cCoordinate system\u201d"
    assert (said["vertical unit"]["value"], said["vertical unit"]["source"]) == (
        "us-ft",
        "\u201cUnit of heights\u201d",
    )
    metres = host.other.measured(nowhere, options=options)
    ratio = (
        document["measurement"]["results"][0]["volume_m3"]
        / (metres["measurement"]["results"][0]["volume_m3"])
    )
    assert ratio == pytest.approx(1200 / 3937, rel=0.02)


def test_scale_bars_are_clicked_in_the_crs_that_was_given(host, nowhere):
    ends = lon_lat(PLACE)["coordinates"][0]
    bar = {"from": ends[0], "to": ends[16], "length_m": 10.0, "accuracy_m": 0.1}
    asked = {"control": {"scale_bars": [bar]}, "options": {"crs": UTM}}
    assert host.other.measured(nowhere, **asked)["measurement"]["scale"]["factor"] > 0


def test_a_saved_crs_is_shown_and_used_again(host, beach_task):
    wkt = pyproj.CRS(32615).to_wkt("WKT1_GDAL")
    kept = host.owner.saved(beach_task, options={"crs": wkt})
    address = f"{API}/{beach_task}/measurements"
    assert host.owner.get(f"{address}/{kept['id']}").json["options"]["crs"] == wkt
    row = next(r for r in host.owner.get(address).json if r["id"] == kept["id"])
    assert row["options"]["crs"] == wkt[:200]  # of a list's row
    assert row["problem"] is None
    page = host.owner.get(f"{address}/{kept['id']}/export?format=html").body.decode()
    assert "metre (\u201cCoordinate system\u201d)" in page
    started = host.owner.post(f"{address}/{kept['id']}/again").json
    assert host.owner.wait(beach_task, started["job"])["state"] == "done"
    again = host.owner.get(f"{API}/{beach_task}/jobs/{started['job']}/result").json
    assert again["options"]["crs"] == wkt
    assert host.owner.ask("DELETE", f"{address}/{kept['id']}").status == 204
