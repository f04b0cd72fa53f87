"""Files of polygons: those that are none, those that are too large, and other formats."""

import json
import sys
import warnings

import numpy as np
import pytest
import shapely
from beach import BEACH
from drawn import SQUARE, X, Y, collection, feature, lonlat, only, polygon
from hypothesis import given, settings
from hypothesis import strategies as st
from pyogrio import raw

from quantify_client.areas.read import read_areas
from quantify_client.areas.vector import read_vector
from quantify_client.crs import measuring_frame
from quantify_client.errors import AreaError, MissingExtraError, QuantifyError

# --- files that are none


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "is empty"),
        (b" \n", "is empty"),
        (b"\xef\xbb\xbf", "is empty"),
        (b"{", "not valid JSON"),
        (b"hello", "not valid JSON"),
        (bytes(range(256)), "is not in UTF-8|not valid JSON"),
        (b"SQLite format 3\x00\x10\x00", "not valid JSON"),
        ('{"type": "Kücken"}'.encode("latin-1"), "UTF-8"),
        (b"LASF\x00\x00" + bytes(300), "is a point cloud, not polygons; give it as the source"),
        (b"ply\nformat binary_little_endian 1.0\n\xff\xfe", "is a point cloud, not polygons"),
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 1\n", "git lfs pull"),
        (b"<!DOCTYPE html><html></html>", "web page"),
        (b"PK\x03\x04" + bytes(26), "zip archive"),
        (b"[" * 100_000, "nested too deeply"),
        (b'{"type":"GeometryCollection","geometries":[' * 30 + b"]}" * 30, "nested too deeply"),
        (b"9" * 5000, "a number that is none|is not GeoJSON"),
        (b"null", "is not GeoJSON"),
        (b"[]", "is not GeoJSON"),
        (b'{"type": 5}', "is not GeoJSON"),
        (b'{"type": "Topology"}', "expected a FeatureCollection"),
        (b'{"type": "FeatureCollection"}', "without 'features'"),
        (b'{"type": "FeatureCollection", "features": {}}', "without 'features'"),
        (b'{"type": "FeatureCollection", "features": []}', "holds no polygon"),
        (b'{"type": "Point", "coordinates": [1, 2]}', "holds no polygon"),
        (b'{"type": "Feature", "geometry": null, "properties": null}', "holds no polygon"),
    ],
)
def test_file_without_polygons_is_refused_in_one_line(content, words, tmp_path, beach):
    path = tmp_path / "areas.geojson"
    path.write_bytes(content)
    with pytest.raises(AreaError, match=words) as caught:
        read_areas(path, beach, BEACH)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["missing.geojson", "", ".", "n" * 300, "a\x00b"])
def test_path_that_is_no_file_is_refused(name, tmp_path, beach):
    with pytest.raises(AreaError, match="not a file|not exist|cannot be read"):
        read_areas(str(tmp_path) + "/" + name, beach, BEACH)


def test_too_large_files_are_refused(tmp_path, beach, monkeypatch):
    path = tmp_path / "areas.geojson"
    path.write_text(json.dumps(polygon()))
    monkeypatch.setattr("quantify_client.areas.geojson.MAX_BYTES", 50)
    with pytest.raises(AreaError, match="larger than"):
        read_areas(path, beach, BEACH)


def test_too_many_vertices_and_polygons_are_refused(tmp_path, beach, monkeypatch):
    path = tmp_path / "areas.geojson"
    path.write_text("[" + "[]," * 3_000_000 + "[]]")
    with pytest.raises(AreaError, match="more than"):
        read_areas(path, beach, BEACH)
    monkeypatch.setattr("quantify_client.areas.geojson.MAX_POLYGONS", 3)
    with pytest.raises(AreaError, match="more than 3 polygons"):
        read_areas(collection(*[feature(polygon())] * 4), beach, BEACH)
    monkeypatch.setattr("quantify_client.areas.geojson.MAX_VERTICES", 12)
    with pytest.raises(AreaError, match="or 12 vertices"):
        read_areas(collection(*[feature(polygon())] * 3), beach, BEACH)


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=4)
    | st.dictionaries(
        st.sampled_from(
            "type features geometry geometries coordinates properties name crs".split()
        ),
        inner | st.sampled_from("FeatureCollection Feature Polygon GeometryCollection".split()),
        max_size=4,
    ),
    max_leaves=20,
)


@pytest.mark.one_python
@settings(deadline=None)
@given(json_values.filter(lambda value: isinstance(value, dict)))
def test_no_document_escapes_the_error_tree(document):
    frame = measuring_frame("EPSG:32615", None, BEACH)
    try:
        read_areas(document, frame, BEACH)
    except QuantifyError as error:
        assert "\n" not in str(error)  # noqa: PT017


# --- other formats


def ignore_missing_crs(write):
    def quietly(*args, **kwargs):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # pyogrio: 'crs' was not provided
            write(*args, **kwargs)

    return quietly


def test_other_formats_need_the_extra(tmp_path, beach, monkeypatch):
    path = tmp_path / "areas.gpkg"
    path.write_bytes(b"SQLite format 3\x00")
    monkeypatch.setitem(sys.modules, "pyogrio", None)
    with pytest.raises(MissingExtraError, match=r"export.* as GeoJSON, or .*\[vector\]") as caught:
        read_areas(path, beach, BEACH)
    assert "quantify-client[" not in str(caught.value)  # the index has another project of that name


@pytest.mark.parametrize(
    ("suffix", "driver", "crs"),
    [
        (".shp", "ESRI Shapefile", "EPSG:32615"),
        (".shp", "ESRI Shapefile", None),
        (".gpkg", "GPKG", "EPSG:32615"),
        (".gpkg", "GPKG", "EPSG:4326"),
        (".fgb", "FlatGeobuf", "EPSG:32615"),
        (".kml", "KML", "EPSG:4326"),
    ],
)
def test_vector_formats(suffix, driver, crs, tmp_path, beach):
    ring = lonlat(beach) if crs == "EPSG:4326" else SQUARE
    path = tmp_path / f"areas{suffix}"
    geometry = np.array([shapely.to_wkb(shapely.Polygon(ring))], dtype=object)
    names = [np.array(["Pile"], dtype=object)]
    write = ignore_missing_crs(raw.write) if crs is None else raw.write
    write(path, geometry, names, ["Name"], geometry_type="Polygon", driver=driver, crs=crs)
    area_set = read_areas(path, beach, BEACH)
    assert only(area_set).name == "Pile"
    assert only(area_set).polygon.symmetric_difference(shapely.Polygon(SQUARE)).area < 1e-3
    assert bool(area_set.warnings) == (crs is None)


def test_dxf_closed_polyline_is_a_polygon(tmp_path, beach):
    path = tmp_path / "areas.dxf"
    lines = [shapely.to_wkb(shapely.LineString(SQUARE)), shapely.to_wkb(shapely.Point(X, Y))]
    ignore_missing_crs(raw.write)(
        path, np.array(lines, dtype=object), [], [], geometry_type="Unknown", driver="DXF", crs=None
    )
    square, point = read_areas(path, beach, BEACH).areas
    assert square.polygon.area == pytest.approx(100)
    assert "is a Point" in point.error


@pytest.mark.parametrize("suffix", [".shp", ".gpkg", ".kml", ".dxf", ".fgb"])
def test_broken_vector_files_are_refused_in_one_line(suffix, tmp_path, beach):
    path = tmp_path / f"areas{suffix}"
    path.write_bytes(b"\x00\x01 not what it says" * 50)
    with pytest.raises(AreaError) as caught:
        read_areas(path, beach, BEACH)
    assert "\n" not in str(caught.value)


def test_a_fault_of_the_reader_of_vector_files_is_told_in_words(monkeypatch, tmp_path):
    """A damaged .prj makes pyogrio itself stumble (found by tests/fuzz, seed 21, run 398)."""

    def stumbles(*_path, **_more):
        raise UnboundLocalError("local variable 'wkt' referenced before assignment")

    monkeypatch.setattr(raw, "read", stumbles)
    pyogrio = pytest.importorskip("pyogrio")
    monkeypatch.setattr(pyogrio, "list_layers", lambda _path: [("a", "Polygon")])
    (tmp_path / "a.fgb").write_bytes(b"fgb\x03fgb\x00" + bytes(100))
    with pytest.raises(AreaError, match="export the polygons as GeoJSON"):
        read_vector(tmp_path / "a.fgb")
