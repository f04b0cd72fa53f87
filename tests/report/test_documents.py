"""report.json, slices.csv and areas.geojson state the results, and nothing that harms."""

from __future__ import annotations

import csv
import dataclasses
import io
import json
import math
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any, List

import jsonschema
import numpy as np
import pytest
import shapely

from quantify_client import to_json
from quantify_client.crs import Frame
from quantify_client.errors import CrsError
from quantify_client.report.document import geojson
from quantify_client.report.document.slices_csv import write_slices
from quantify_client.types import Slice

from . import scalings, surveys
from .schemas import closed, schema, valid

DOCUMENT_KEYS = (
    "schema source crs length_unit shape method grid_scale_factor scale results warnings "
    "provenance method_revision proposals kind alignment series"
).split()
RESULT_KEYS = (
    "name volume_m3 cut_m3 fill_m3 std_m3 interval95_m3 cut_std_m3 cut_interval95_m3 fill_std_m3 "
    "fill_interval95_m3 budget area_m2 surface_area_m2 perimeter_m min_z_m max_z_m max_height_m "
    "coverage points_used points_left_out slice_height_m slices mass_t mass_std_t base checks "
    "warnings level_of_detection_m area_changed_m2 stage"
).split()


def test_keys_are_those_of_the_design() -> None:
    document = to_json(surveys.everything())
    assert next(iter(document)) == "schema"
    assert set(document) == set(DOCUMENT_KEYS)
    for row in (document["results"][0], document["results"][1]):
        assert set(row) - {"cell_m", "bases"} == set(RESULT_KEYS)
    assert document["schema"] == "quantify-client/2"
    assert set(document["results"][2]) == {"name", "error"}


@pytest.mark.parametrize(
    "measurement",
    [
        surveys.everything(),
        surveys.measurement(surveys.body(), shape="object", method="polar", crs=None),
        surveys.measurement(
            scale=scalings.everything(), length_unit="unknown", grid_scale_factor=None
        ),
    ],
)
def test_documents_follow_the_schema(measurement: Any) -> None:
    valid(to_json(measurement), "schema.json")


@pytest.mark.parametrize("place", [(), ("results", 0), ("results", 0, "slices", 0), ("results", 2)])
def test_schema_refuses_a_missing_key_and_tests_an_unknown_one(place: Any) -> None:
    for change in ("add", "remove"):
        document = to_json(surveys.everything())
        part: Any = document
        for step in place:
            part = part[step]
        if change == "add":
            part["surprise"] = 1
        else:
            part.pop(next(iter(part)))
        told = closed(schema("schema.json")) if change == "add" else schema("schema.json")
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.Draft202012Validator(told).validate(document)


def test_interval_is_1_96_standard_deviations() -> None:
    row = to_json(surveys.measurement(surveys.body(volume_m3=10.0, std_m3=2.0)))["results"][0]
    assert row["interval95_m3"] == pytest.approx([6.08, 13.92], abs=1e-12)
    assert row["cut_m3"] is None
    assert row["cut_interval95_m3"] is None


def test_intervals_of_cut_and_fill_end_at_zero() -> None:
    """0.008 +- 0.165 m3: no cut is negative, and net stays symmetric."""
    result = surveys.body(
        volume_m3=-0.1, std_m3=0.1, cut_m3=0.008, cut_std_m3=0.084, fill_m3=0.108, fill_std_m3=0.05
    )
    row = to_json(surveys.measurement(result))["results"][0]
    assert row["cut_interval95_m3"] == pytest.approx([0.0, 0.17264], abs=1e-12)
    assert row["fill_interval95_m3"] == pytest.approx([0.01, 0.206], abs=1e-12)
    assert row["interval95_m3"] == pytest.approx([-0.296, 0.096], abs=1e-12)


def test_nan_and_numpy_numbers_never_reach_json() -> None:
    result = surveys.body(
        std_m3=math.nan, min_z_m=np.float64(1.5), points_used=np.int64(7), max_z_m=math.inf
    )
    row = to_json(surveys.measurement(result, provenance={"path": Path("a"), "n": np.arange(2)}))
    text = json.dumps(row, allow_nan=False)
    assert json.loads(text)["provenance"] == {"path": "a", "n": [0, 1]}
    assert row["results"][0]["std_m3"] is None
    assert row["results"][0]["interval95_m3"] is None
    assert type(row["results"][0]["points_used"]) is int


def test_undecodable_file_names_stay_writable() -> None:
    document = to_json(surveys.measurement(source="pile\udcff.laz"))
    assert document["source"] == "pile?.laz"


def test_no_number_of_any_document_has_the_digits_of_rounding() -> None:
    piece = Slice(z_m=0.1 + 0.2, height_m=0.2, area_m2=3 * 0.1, volume_m3=-3 * 0.1, points=3)
    result = surveys.pile("a", slices=(piece,), cut_std_m3=0.1 + 0.2, coverage=1.1 * 1.1 - 0.91)
    measurement = surveys.measurement(result)
    rows = to_json(measurement)["results"]
    rows += [feature["properties"] for feature in geojson.to_geojson(measurement)["features"]]
    assert not re.search(r"0{8}\d|9{8}", json.dumps(rows))
    assert to_json(measurement)["results"][0]["slices"][0]["z_m"] == 0.3


def test_bases_become_rows_of_five_numbers() -> None:
    rows = to_json(surveys.everything())["results"]
    assert rows[0]["bases"] is None
    assert [row["base"] for row in rows[1]["bases"]] == ["triangulate", "plane", "average", 329.5]
    assert set(rows[1]["bases"][0]) == {"base", "volume_m3", "cut_m3", "fill_m3", "std_m3"}


def slices_csv(*names: str) -> List[List[str]]:
    file = io.StringIO(newline="")
    write_slices(surveys.measurement(*(surveys.body(name) for name in names)), file)
    return list(csv.reader(io.StringIO(file.getvalue(), newline="")))


def test_slices_are_written_without_the_digits_of_rounding() -> None:
    piece = Slice(z_m=0.1 + 0.2, height_m=0.2, area_m2=1e9 / 7, volume_m3=-3 * 0.1, points=3)
    file = io.StringIO(newline="")
    write_slices(surveys.measurement(surveys.body("a", slices=(piece,))), file)
    assert file.getvalue().splitlines()[1] == "a,0.3,0.2,142857142.857,-0.3,3"


@pytest.mark.parametrize(
    "name", ["=cmd()", "+1", "-1", "@SUM(A1)", "\tx", "\r=1", "\n=1", " =1", '=HYPERLINK("x")']
)
def test_formulas_in_names_are_text(name: str) -> None:
    rows = slices_csv(name)
    assert {row[0] for row in rows[1:]} == {f"'{name}"}


def test_csv_has_one_row_a_slice_and_plain_numbers() -> None:
    rows = slices_csv('a "b", c\r\nd', "e")
    assert rows[0] == ["name", "z_m", "height_m", "area_m2", "volume_m3", "points"]
    assert len(rows) == 81
    assert rows[1][0] == 'a "b", c\r\nd'
    assert float(rows[1][1]) == 0.025
    file = io.StringIO(newline="")
    write_slices(surveys.measurement(surveys.hollow()), file)
    assert "'-" not in file.getvalue()
    assert any(float(row[4]) < 0 for row in list(csv.reader(file.getvalue().splitlines()))[1:])


def shrink(geometry: Any, _frame: Any) -> Any:
    """Stand in for the projection; shapely's buffers have clockwise outer rings, so must turn."""
    east, north = surveys.EASTING, surveys.NORTHING
    return shapely.transform(
        geometry, lambda xy: np.column_stack([xy[:, 0] - east, xy[:, 1] - north]) * 1e-5
    )


def signed_area(ring: Any) -> float:
    x, y = np.asarray(ring).T
    return float(np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]) / 2)


def test_geojson_is_wgs84_with_right_hand_rings(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(geojson, "_to_wgs84", shrink)
    frame: Any = SimpleNamespace(crs="EPSG:32615")
    collection = geojson.to_geojson(dataclasses.replace(surveys.everything(), frame=frame))
    assert set(collection) == {"type", "generator", "features"}
    outer, hole = collection["features"][0]["geometry"]["coordinates"]
    assert signed_area(outer) > 0 > signed_area(hole)
    assert outer[0] == outer[-1]
    assert np.abs(outer).max() < 1
    failed = collection["features"][2]
    assert failed["geometry"] is None
    assert failed["properties"]["name"] == surveys.HOSTILE
    assert "crosses itself" in failed["properties"]["error"]


def test_geojson_properties_are_flat() -> None:
    measurement = surveys.everything()
    collection = geojson.to_geojson(measurement)
    for feature in collection["features"]:
        assert not any(isinstance(v, (list, dict)) for v in feature["properties"].values())
    properties = collection["features"][1]["properties"]
    volume, std = measurement.results[1].volume_m3, measurement.results[1].std_m3
    assert properties["interval95_low_m3"] == pytest.approx(volume - 1.96 * std, abs=1e-9)
    assert properties["warnings"].startswith("3.2 % of the cells were interpolated.; odd")


def test_geojson_without_crs_says_so() -> None:
    collection = geojson.to_geojson(surveys.measurement(surveys.pile(), crs=None))
    remark = "cloud coordinates, no CRS"
    assert collection["coordinate_reference"] == remark
    assert collection["features"][0]["properties"]["coordinate_reference"] == remark
    x, y = collection["features"][0]["geometry"]["coordinates"][0][0]
    assert x > surveys.EASTING
    assert y > surveys.NORTHING


def test_geojson_of_a_crs_that_cannot_be_transformed_keeps_the_polygons(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def refuse(_geometry: Any, _frame: Any) -> Any:
        raise CrsError("an engineering CRS")

    monkeypatch.setattr(geojson, "_to_wgs84", refuse)
    frame: Any = SimpleNamespace(crs="LOCAL")
    collection = geojson.to_geojson(
        dataclasses.replace(surveys.measurement(surveys.pile()), frame=frame)
    )
    assert collection["coordinate_reference"] == "cloud coordinates: an engineering CRS"
    assert collection["features"][0]["geometry"]["coordinates"][0][0][0] > surveys.EASTING


def test_multipolygons_stay_whole() -> None:
    pile = surveys.pile()
    parts = shapely.union_all([shapely.box(0, 0, 1, 1), shapely.box(5, 5, 7, 7)])
    relief = dataclasses.replace(pile.relief, polygon_wkb=shapely.to_wkb(parts))
    pile = dataclasses.replace(pile, relief=relief)
    geometry = geojson.to_geojson(surveys.measurement(pile))["features"][0]["geometry"]
    assert geometry["type"] == "MultiPolygon"
    assert len(geometry["coordinates"]) == 2


@pytest.mark.parametrize("name", ["pile"])
def test_real_projection_lands_on_the_beach(name: str) -> None:
    frame = Frame(crs="EPSG:32615", length_unit="m")
    collection = geojson.to_geojson(
        dataclasses.replace(surveys.measurement(surveys.pile(name)), frame=frame)
    )
    lon, lat = collection["features"][0]["geometry"]["coordinates"][0][0]
    assert lon == pytest.approx(-91.99, abs=0.02)
    assert lat == pytest.approx(46.84, abs=0.02)
