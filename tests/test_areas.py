"""Polygons into the frame: what can be given, in which coordinates, and under which name."""

import json
import math
import re
import struct

import numpy as np
import pytest
import shapely
from beach import BEACH
from drawn import HOLE, SQUARE, X, Y, collection, feature, lonlat, only, polygon
from hypothesis import given, settings
from hypothesis import strategies as st

from quantify_client.areas.read import Area, read_areas
from quantify_client.crs import measuring_frame
from quantify_client.errors import AreaError
from quantify_client.types import AreaFailure, Bounds

UTM15 = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::32615"}}
CRS84 = {"type": "name", "properties": {"name": "urn:ogc:def:crs:OGC:1.3:CRS84"}}


@pytest.fixture(scope="module")
def bare():
    return measuring_frame(None, None, BEACH)


# --- what can be given


@pytest.mark.parametrize(
    "document",
    [
        polygon(),
        feature(polygon(), name="pile"),
        collection(feature(polygon())),
        collection(feature(polygon()), crs=UTM15),
        collection(feature(polygon()), crs=None),
        collection({**feature(polygon()), "crs": UTM15}),
        collection(feature(polygon()), crs={"type": "EPSG", "properties": {"code": 32615}}),
        collection(feature(polygon()), crs={"type": "name", "properties": {"name": "EPSG:32615"}}),
        {"type": "GeometryCollection", "geometries": [polygon()]},
        {"type": "MultiPolygon", "coordinates": [[SQUARE]]},
        polygon(SQUARE[:-1]),  # not closed
        polygon([[*p, 160.0] for p in SQUARE]),
        polygon([tuple(p) for p in SQUARE]),
        polygon([*SQUARE[:2], SQUARE[1], *SQUARE[2:]]),  # a corner twice
        polygon(SQUARE[::-1]),
    ],
)
@pytest.mark.parametrize("as_file", [True, False])
def test_a_square_is_a_square_however_it_is_written(document, as_file, tmp_path, beach):
    path = tmp_path / "areas.geojson"
    path.write_text(json.dumps(document))
    area = only(read_areas(path if as_file else document, beach, BEACH))
    assert area.polygon.equals(shapely.box(X, Y, X + 10, Y + 10))
    assert not area.polygon.has_z


def test_paths_may_be_strings_and_bom_is_skipped(tmp_path, beach):
    path = tmp_path / "areas.json"
    path.write_bytes(b"\xef\xbb\xbf" + json.dumps(polygon()).encode())
    assert only(read_areas(str(path), beach, BEACH)).polygon.area == 100


def test_holes_take_area_away(beach):
    assert only(read_areas(polygon(SQUARE, HOLE), beach, BEACH)).polygon.area == 96


def test_shapely_polygon_is_in_the_frame(beach):
    given_polygon = shapely.Polygon([(*p, 5.0) for p in SQUARE])
    area = only(read_areas(given_polygon, beach, BEACH))
    assert (area.name, area.polygon.area, area.polygon.has_z) == ("area-1", 100, False)


@pytest.mark.parametrize(
    "given_area", [shapely.Point(X, Y), shapely.Polygon(), shapely.LineString(SQUARE), 7, [1], None]
)
def test_other_objects_are_no_areas(given_area, beach):
    with pytest.raises(AreaError, match="expected"):
        read_areas(given_area, beach, BEACH)


def test_far_or_crossing_shapely_polygon_fails(beach):
    assert "outside" in only(read_areas(shapely.box(0, 0, 1, 1), beach, BEACH)).error
    bow = shapely.Polygon([(X, Y), (X + 10, Y + 10), (X + 10, Y), (X, Y + 10)])
    assert "crosses itself" in only(read_areas(bow, beach, BEACH)).error
    wkb = shapely.to_wkb(shapely.Polygon(SQUARE)).replace(struct.pack("<d", X + 10), b"\xff" * 8)
    with np.errstate(invalid="ignore"):
        nan = shapely.from_wkb(wkb)
    assert "not a number" in only(read_areas(nan, beach, BEACH)).error


# --- the CRS of the coordinates


@pytest.mark.parametrize("members", [{}, {"crs": CRS84}])
def test_degrees_are_wgs84(members, beach):
    area_set = read_areas(collection(feature(polygon(lonlat(beach))), **members), beach, BEACH)
    assert area_set.warnings == ()
    assert only(area_set).polygon.equals_exact(shapely.Polygon(SQUARE), 1e-6)


def test_cloud_coordinates_are_taken_with_a_warning(beach):
    area_set = read_areas(polygon(), beach, BEACH)
    assert "taken to be in the cloud's own (EPSG:32615)" in area_set.warnings[0]
    assert read_areas(collection(feature(polygon()), crs=UTM15), beach, BEACH).warnings == ()


@pytest.mark.parametrize(("x", "y"), [(181, 40), (-181, 40), (100, 91), (100, -91)])
def test_beyond_180_or_90_are_no_degrees(x, y):
    bounds = Bounds(-300, -300, 0, 300, 300, 10)
    frame = measuring_frame("EPSG:32615", None, bounds)
    ring = [[x - 1, y - 1], [x, y - 1], [x, y], [x - 1, y]]
    if x < 0 or y < 0:
        ring = [[x, y], [x + 1, y], [x + 1, y + 1], [x, y + 1]]
    assert only(read_areas(polygon(ring), frame, bounds)).polygon.area == 1


def test_crs_member_wins_over_degrees(beach):
    """Coordinates that look like degrees but are said to be UTM are metres, far away."""
    small = collection(feature(polygon([[0, 0], [9, 0], [9, 9]])), crs=UTM15)
    assert "lies outside the cloud" in only(read_areas(small, beach, BEACH)).error


def test_cloud_without_crs_takes_coordinates_as_they_are(bare):
    small = polygon([[0, 0], [9, 0], [9, 9], [0, 9]])
    area_set = read_areas(small, bare, Bounds(-1, -1, 0, 10, 10, 5))
    assert only(area_set).polygon.equals(shapely.box(0, 0, 9, 9))
    assert area_set.warnings == ()


@pytest.mark.parametrize(("unit", "metres"), [("ft", 0.3048), ("us-ft", 1200 / 3937)])
def test_cloud_coordinates_are_in_the_clouds_unit(unit, metres):
    frame = measuring_frame(None, unit, BEACH)
    area = only(read_areas(polygon(), frame, BEACH))
    assert area.polygon.area == pytest.approx(100 * metres**2, rel=1e-6)
    assert area.polygon.bounds[0] == X * metres


def test_cloud_in_feet_takes_its_own_coordinates_as_feet():
    bounds = Bounds(984250, 194305, 0, 985250, 195305, 30)
    frame = measuring_frame("EPSG:2263", None, bounds)
    ring = [[984300, 194400], [984400, 194400], [984400, 194500], [984300, 194500]]
    area = only(read_areas(polygon(ring), frame, bounds))
    assert area.polygon.area == pytest.approx((100 * 1200 / 3937) ** 2, rel=1e-6)
    assert area.polygon.bounds[0] == pytest.approx(984300 * 1200 / 3937, abs=1e-6)


def test_geographic_cloud_measures_in_utm(beach):
    ring = lonlat(beach)
    bounds = Bounds(-91.997, 46.842, 156, -91.994, 46.844, 169)
    frame = measuring_frame("EPSG:4979", None, bounds)
    area = only(read_areas(polygon(ring), frame, bounds))
    assert area.polygon.equals_exact(shapely.Polygon(SQUARE), 1e-6)


def test_neither_degrees_nor_on_the_cloud_is_an_error_with_both_ranges(beach):
    far = polygon([[x + 50000, y] for x, y in SQUARE])
    with pytest.raises(AreaError) as caught:
        read_areas(far, beach, BEACH)
    for words in ("626700.00 to 626710.00", "5188114.06 to 5188211.70", "export it in WGS84"):
        assert words in str(caught.value)


@pytest.mark.parametrize("members", [{}, {"crs": UTM15}, {"crs": CRS84}])
@pytest.mark.parametrize("degrees", [True, False])
def test_swapped_coordinates_are_named(members, degrees, beach):
    ring = [[y, x] for x, y in (lonlat(beach) if degrees else SQUARE)]
    said = ""
    try:
        said = only(read_areas(collection(feature(polygon(ring)), **members), beach, BEACH)).error
    except AreaError as error:
        said = str(error)
    consistent = not members or degrees == (members["crs"] is CRS84)
    assert ("lat, lon" in said or "swapped" in said) == consistent


def test_unknown_bounds_pass_everything(beach):
    far = polygon([[x + 50000, y] for x, y in SQUARE])
    area_set = read_areas(far, beach, None)
    assert isinstance(only(area_set), Area)
    assert "no CRS" in area_set.warnings[0]


@pytest.mark.parametrize(
    ("crs", "words"),
    [
        ({"type": "name", "properties": {"name": "EPSG:999999"}}, "unknown CRS"),
        ({"type": "link", "properties": {"href": "http://example.com"}}, "not understood"),
        ("EPSG:32615", "not understood"),
        ({"type": "name", "properties": {"name": 5}}, "not understood"),
    ],
)
def test_useless_crs_member_is_refused(crs, words, beach):
    with pytest.raises(AreaError, match=words):
        read_areas(collection(feature(polygon()), crs=crs), beach, BEACH)


def test_known_crs_is_of_no_use_with_a_cloud_without(bare):
    with pytest.raises(AreaError, match="the cloud has no CRS"):
        read_areas(collection(feature(polygon()), crs=UTM15), bare, BEACH)


def test_coarse_datum_is_said():
    frame = measuring_frame("EPSG:26715", None, BEACH)  # NAD27
    area_set = read_areas(polygon(lonlat(frame)), frame, BEACH)
    assert "datums differ" in area_set.warnings[0]
    assert isinstance(only(area_set), Area)


# --- polygons that cannot be used


def moved(*corners):
    return [[X + dx, Y + dy] for dx, dy in corners]


BOW = moved((0, 0), (10, 10), (10, 0), (0, 10))
NAN, INFINITY = math.nan, math.inf


@pytest.mark.parametrize(
    ("geometry", "words"),
    [
        (polygon(BOW), "crosses itself near 576705.00, 5188145.00; redraw it"),
        (polygon(SQUARE, moved((20, 0), (22, 0), (22, 2))), "a hole outside its outline"),
        (polygon(SQUARE, HOLE, HOLE), "near 57670[46].00, 518814[46].00; redraw it"),
        (polygon(moved((0, 0), (10, 0))), "a ring of 2 corners"),
        (polygon([]), "a ring of 0 corners"),
        (polygon(moved((0, 0), (0, 0), (0, 0), (0, 0))), "no area"),
        (polygon(moved((0, 0), (5, 5), (10, 10), (0, 0))), "no area"),
        (polygon(SQUARE, moved((4, 4), (6, 6), (5, 5), (4, 4))), "hole|itself|area|valid"),
        ({"type": "Polygon", "coordinates": []}, "is empty"),
        ({"type": "Polygon"}, "not lists"),
        ({"type": "Polygon", "coordinates": None}, "not lists"),
        ({"type": "Polygon", "coordinates": "abc"}, "not lists"),
        ({"type": "Polygon", "coordinates": {"a": 1}}, "not lists"),
        ({"type": "Polygon", "coordinates": SQUARE}, "not a number|not .x, y."),
        ({"type": "MultiPolygon", "coordinates": []}, "is empty"),
        (polygon([*SQUARE[:2], [NAN, Y], *SQUARE[3:]]), "not a number"),
        (polygon([*SQUARE[:2], [INFINITY, Y], *SQUARE[3:]]), "infinite"),
        (polygon([*SQUARE[:2], [1e300, Y], *SQUARE[3:]]), "absurdly large"),
        (polygon([*SQUARE[:2], [10**400, Y], *SQUARE[3:]]), "absurdly large"),
        (polygon([*SQUARE[:2], ["576710", Y], *SQUARE[3:]]), "not a number"),
        (polygon([*SQUARE[:2], [True, Y], *SQUARE[3:]]), "not a number"),
        (polygon([*SQUARE[:2], [None, Y], *SQUARE[3:]]), "not a number"),
        (polygon([*SQUARE[:2], [X], *SQUARE[3:]]), r"not \[x, y\]"),
        ({"type": "Point", "coordinates": [X, Y]}, "is a Point, not a polygon"),
        ({"type": "LineString", "coordinates": SQUARE}, "is a LineString, not a polygon"),
        ({"type": "Circle", "coordinates": [X, Y]}, "'Circle', not a polygon"),
        (None, "has no geometry"),
        (7, "not a GeoJSON feature"),
        ({"type": "GeometryCollection", "geometries": []}, "collection without polygons"),
        (polygon(moved((900, 0), (910, 0), (910, 10))), "lies outside the cloud: it covers x"),
        (
            {
                "type": "MultiPolygon",
                "coordinates": [[SQUARE], [moved((5, 5), (15, 5), (15, 15), (5, 15))]],
            },
            "has parts that overlap near",
        ),
        ({"type": "MultiPolygon", "coordinates": [[SQUARE], [SQUARE]]}, "overlap|part|ring"),
    ],
)
def test_one_bad_polygon_fails_alone_in_one_line(geometry, words, beach):
    document = collection(feature(geometry, name="bad"), feature(polygon(), name="good"))
    bad, good = read_areas(document, beach, BEACH).areas
    assert isinstance(bad, AreaFailure)
    assert bad.name == "bad"
    assert re.search(words, bad.error)
    assert "\n" not in bad.error
    assert (good.name, good.polygon.area) == ("good", 100)


def test_parts_that_share_an_edge_are_joined(beach):
    neighbours = [[SQUARE], [moved((10, 0), (20, 0), (20, 10), (10, 10))]]
    area = only(read_areas({"type": "MultiPolygon", "coordinates": neighbours}, beach, BEACH))
    assert area.polygon.is_valid
    assert area.polygon.area == pytest.approx(200, rel=1e-12)


def test_polygons_of_a_collection_count_and_the_rest_is_said(beach):
    point = {"type": "Point", "coordinates": [X, Y]}
    mixed = {"type": "GeometryCollection", "geometries": [point, polygon(), polygon(HOLE)]}
    area_set = read_areas(collection(feature(mixed, name="pile")), beach, BEACH)
    assert [(a.name, a.polygon.area) for a in area_set.areas] == [("pile", 100), ("pile-2", 4)]
    assert any("pile: 1 members of its collection" in warning for warning in area_set.warnings)


# --- names


@pytest.mark.parametrize(
    ("labels", "names"),
    [
        ([None, None], ["area-1", "area-2"]),
        (["pile", "pile", "pile"], ["pile", "pile-2", "pile-3"]),
        (["pile", "pile", "pile-2"], ["pile", "pile-2", "pile-2-2"]),
        (["area-2", None], ["area-2", "area-2-2"]),
        ([7, 2.5], ["7", "2.5"]),
        ([True, {"a": 1}, ["x"], "", " \t"], ["area-1", "area-2", "area-3", "area-4", "area-5"]),
        ([NAN, 10**400], ["area-1", "area-2"]),
        (["a\x00b\x1b[31m", "\u202eevil", "two\nlines"], ["ab[31m", "evil", "two lines"]),
        (["\ud800x"], ["x"]),
        (["Кучка 1", "<b>&"], ["Кучка 1", "<b>&"]),
        (["n" * 500], ["n" * 80]),
    ],
)
def test_names_are_clean_and_unique(labels, names, beach):
    document = collection(*(feature(polygon(), name=label) for label in labels))
    assert [area.name for area in read_areas(document, beach, BEACH).areas] == names


def test_features_without_properties_have_names(beach):
    document = collection({"type": "Feature", "geometry": polygon(), "properties": None})
    assert only(read_areas(document, beach, BEACH)).name == "area-1"


@settings(deadline=None)
@given(
    st.lists(st.tuples(st.floats(0, 90), st.floats(0, 80)), min_size=3, max_size=12, unique=True)
)
def test_area_through_wgs84_is_what_was_drawn(corners):
    """Through WGS84 and back: edges below 100 m bend by 0.2 mm at most."""
    frame = measuring_frame("EPSG:32615", None, BEACH)
    hull = shapely.MultiPoint(np.add(corners, (576665, 5188120))).convex_hull
    if hull.geom_type != "Polygon" or hull.area < 1:
        return
    area = only(read_areas(polygon(lonlat(frame, hull.exterior.coords)), frame, BEACH))
    assert area.polygon.area == pytest.approx(hull.area, abs=2e-4 * hull.length)
