"""A saved measurement as files: the same numbers as those written when it was measured."""

import io
import json

import pytest
import shapely
from beach import frame_of
from visitors import ROUND

from quantify_client import measure, to_json
from quantify_client.crs import geometry_to_wgs84
from quantify_client.errors import InputError
from quantify_client.report.document.geojson import to_geojson
from quantify_client.report.document.saved_export import exported, file_name, saved_measurement
from quantify_client.report.document.slices_csv import write_slices
from quantify_client.types import Scaling
from quantify_client.types.json_records import record_of
from quantify_client.webmap.clicked import bars_control
from quantify_client.webmap.layers import map_layers


def document_of(measurement, area=None, **more):
    document = {
        "schema": "volcalc-measurement/2",
        "id": "0" * 32,
        "name": "Pile 1",
        "date": "2024-05-01T10:00:00Z",
        "user": "anna",
        "area": area,
        "measurement": to_json(measurement),
        "layers": map_layers(measurement),
        **more,
    }
    return json.loads(json.dumps(document))  # as it comes back from a file


@pytest.fixture(scope="module")
def scaled(pytestconfig, tmp_path_factory):
    """The beach, compared over bases, with a bar clicked on the map."""
    cloud = pytestconfig.rootpath / "quantify_client" / "demo" / "brighton_beach.laz"
    line = shapely.LineString([[576_700, 5_188_140], [576_720, 5_188_140]])
    start, *_, end = geometry_to_wgs84(line, frame_of("EPSG:32615")).coords
    bar = {"from": start, "to": end, "length_m": 20.1, "accuracy_m": 0.01}
    path = tmp_path_factory.mktemp("control") / "control.json"
    path.write_text(json.dumps(bars_control(cloud, [bar])))
    return measure(cloud, area=ROUND, base="compare", gcp=path, density=1.5)


def test_csv_is_the_same(scaled):
    file = io.StringIO(newline="")
    write_slices(scaled, file)
    assert exported(document_of(scaled), "csv") == file.getvalue()


def test_geojson_has_the_drawn_area_and_the_same_numbers(scaled):
    area = {"type": "FeatureCollection", "features": [ROUND]}
    (found,) = json.loads(exported(document_of(scaled, area), "geojson"))["features"]
    wanted, *_ = to_geojson(scaled)["features"]  # others are only proposed
    assert found["geometry"] == ROUND["geometry"]
    assert found["properties"].pop("measured") == "2024-05-01T10:00:00Z"
    assert found["properties"] == json.loads(json.dumps(wanted["properties"]))


def test_numbers_come_back_as_they_were(scaled):
    document = document_of(scaled)
    again = to_json(saved_measurement(document))
    for key in ("results", "crs", "length_unit", "shape", "method", "grid_scale_factor"):
        assert again[key] == document["measurement"][key]
    assert (
        record_of(Scaling).write(saved_measurement(document).scale)
        == document["measurement"]["scale"]
    )


def test_page_shows_picture_scale_bases_and_who_saved_it(scaled):
    page = exported(document_of(scaled), "html")
    assert page.startswith("<!doctype html>")
    for words in ("Pile 1", "anna", "2024-05-01T10:00:00Z", "Base surfaces compared", 'id="scale"'):
        assert words in page
    assert page.count("data:image/png;base64,") == 1
    assert "<script" not in page
    assert "default-src 'none'" in page
    assert "http" not in page.replace("http-equiv", "")
    assert "yd³" in exported(document_of(scaled), "html", "us")


def test_failure_and_a_body_have_pages_too(site):
    body = measure(site / "body.xyz")
    page = exported(document_of(body), "html")
    assert "units³" in page
    failed = document_of(body)
    failed["measurement"]["results"].append({"name": "<b>", "error": "<i>"})
    page = exported(failed, "html")
    assert "Not measured: &lt;i&gt;" in page
    features = json.loads(exported(failed, "geojson"))["features"]
    assert [feature["geometry"] for feature in features] == [None, None]


def test_names_of_files_are_harmless():
    assert file_name('a"/../b\r\n.exe') == "a-b-exe"
    assert file_name("砂") == "unnamed"


def test_other_formats_are_refused(scaled):
    with pytest.raises(InputError, match="csv, geojson or html"):
        exported(document_of(scaled), "pdf")
