"""From grid lengths to the ground, and geometries into the frame and out of it."""

import math

import numpy as np
import pytest
import shapely
from beach import BEACH_DEGREES, BESSEL, UTM15, frame_of
from hypothesis import given, settings
from hypothesis import strategies as st
from pyproj import Geod, Proj

from quantify_client.crs import (
    cloud_geometry_to_frame,
    geometry_to_frame,
    geometry_to_wgs84,
    grid_scale_factor,
    measuring_frame,
    transfer_accuracy_m,
)
from quantify_client.errors import CrsError
from quantify_client.types import Bounds

WGS84_GEOD = Geod(ellps="WGS84")


# --- grid to ground


def ground_polygon(frame, x, y, half_m=50.0):
    """A square in the frame and its geodesic area on the ellipsoid, m2."""
    square = shapely.box(x - half_m, y - half_m, x + half_m, y + half_m)
    lonlat = shapely.get_coordinates(geometry_to_wgs84(square, frame))
    area, _ = WGS84_GEOD.polygon_area_perimeter(lonlat[:, 0], lonlat[:, 1])
    return square.area, abs(area)


@pytest.mark.parametrize(
    ("crs", "x", "y"),
    [
        (UTM15, 500000, 5188139),
        (UTM15, 576710, 5188139),
        (UTM15, 166100, 100),  # a zone's edge on the equator
        (UTM15, 720000, 5188139),
        ("EPSG:3857", -10240000, 5913000),
        ("EPSG:3857", 20037508, 8399738),  # 60 N, on the date line
        ("EPSG:6933", 771890, 5614050),  # equal-area
        ("EPSG:3035", 4321000, 3210000),
        ("EPSG:2263", 300000, 59222),  # New York in metres of its feet
        ("EPSG:25832", 691000, 5335000),
        ("EPSG:32662", 1113195, 5565974),  # neither conformal nor equal-area
        ("EPSG:3413", 0, 0),  # the pole
    ],
)
def test_grid_area_over_factor_squared_is_the_geodesic_area(crs, x, y):
    frame = frame_of(crs)
    grid_area, geodesic_area = ground_polygon(frame, x, y)
    factor = grid_scale_factor(frame, x, y, 0.0, odm=True)
    assert grid_area / factor**2 == pytest.approx(geodesic_area, rel=1e-5)


@pytest.mark.parametrize("height_m", [-400.0, 0.0, 1600.0, 4000.0])
def test_factor_with_height_is_the_ratio_of_euclidean_lengths(height_m):
    """Truth: the distance of two points at that height in geocentric coordinates."""
    frame = measuring_frame("EPSG:32613", None, None)
    x, y, d = 480000.0, 4400000.0, 200.0
    line = shapely.LineString([(x - d, y - d), (x + d, y + d)])
    ends = shapely.get_coordinates(geometry_to_wgs84(line, frame))[[0, -1]]
    a, e2 = 6378137.0, 0.00669437999014
    lon, lat = np.radians(ends).T
    n = a / np.sqrt(1 - e2 * np.sin(lat) ** 2)
    ecef = np.array(
        [
            (n + height_m) * np.cos(lat) * np.cos(lon),
            (n + height_m) * np.cos(lat) * np.sin(lon),
            (n * (1 - e2) + height_m) * np.sin(lat),
        ]
    )
    ground_m = float(np.linalg.norm(ecef[:, 1] - ecef[:, 0]))
    factor = grid_scale_factor(frame, x, y, height_m, odm=False)
    assert line.length / factor == pytest.approx(ground_m, rel=2e-6)
    # ODM's own clouds are metric at their height: there h does not count.
    odm = grid_scale_factor(frame, x, y, height_m, odm=True)
    assert odm == grid_scale_factor(frame, x, y, 0.0, odm=False)


def test_utm_factor_by_the_textbook():
    frame = frame_of(UTM15)
    assert grid_scale_factor(frame, 500000, 5188139, 160, odm=True) == pytest.approx(
        0.9996, abs=1e-9
    )
    # +0.08 % of area at the central meridian, -0.2 % at a zone's edge on the equator
    edge = grid_scale_factor(frame, 833978.56, 0, 0, odm=True)
    assert edge**-2 - 1 == pytest.approx(-0.002, abs=1e-4)
    for easting in (400000, 576710, 650000):
        east = (easting - 500000) / 0.9996
        by_hand = 0.9996 * (1 + east**2 / (2 * 6378000.0**2))
        factor = grid_scale_factor(frame, easting, 5188139, 0, odm=True)
        assert factor == pytest.approx(by_hand, abs=1e-6)
        assert factor == pytest.approx(
            Proj(UTM15).get_factors(*Proj(UTM15)(easting, 5188139, inverse=True)).meridional_scale,
            abs=1e-8,
        )


def test_factor_of_a_geographic_cloud_is_that_of_its_utm_zone():
    frame = frame_of("EPSG:4326", bounds=BEACH_DEGREES)
    expected = grid_scale_factor(frame_of(UTM15), 576710, 5188139, 160, odm=False)
    assert grid_scale_factor(frame, 576710, 5188139, 160, odm=False) == pytest.approx(expected)


def test_no_crs_has_no_factor():
    assert grid_scale_factor(frame_of(None), 0, 0, 0, odm=True) is None
    assert grid_scale_factor(frame_of('LOCAL_CS["s",UNIT["metre",1]]'), 0, 0, 0, odm=True) is None


@pytest.mark.parametrize(("x", "y", "z"), [(1e12, 1e12, 0), (math.nan, 0, 0), (5e5, 5e6, math.nan)])
def test_factor_outside_the_projection_is_an_error(x, y, z):
    with pytest.raises(CrsError, match="CRS"):
        grid_scale_factor(frame_of(UTM15), x, y, z, odm=False)


# --- geometries


def test_wgs84_polygon_lands_where_utm_says():
    frame = frame_of(UTM15)
    moved = geometry_to_frame(shapely.Point(-92.0, 46.8), "EPSG:4326", frame)
    assert (moved.x, moved.y) == pytest.approx((576308.5661, 5183424.6828), abs=1e-3)


def test_polygon_in_feet_lands_in_metres():
    frame = frame_of("EPSG:2263")
    drawn = shapely.Point(984250.0, 194305.0)
    metres = (984250.0 * 1200 / 3937, 194305.0 * 1200 / 3937)
    assert geometry_to_frame(drawn, "EPSG:2263", frame).coords[0] == pytest.approx(metres, abs=1e-6)
    assert cloud_geometry_to_frame(drawn, frame).coords[0] == pytest.approx(metres, abs=1e-6)
    lonlat = geometry_to_wgs84(shapely.Point(metres), frame)
    assert (lonlat.x, lonlat.y) == pytest.approx((-74.0, 40.7), abs=2e-3)


def test_long_edges_stay_straight_where_they_were_drawn():
    frame = frame_of(UTM15)
    parallel = shapely.LineString([(-92.1, 46.8), (-91.9, 46.8)])
    moved = geometry_to_frame(parallel, "OGC:CRS84", frame)
    middle = geometry_to_frame(shapely.Point(-92.03, 46.8), "OGC:CRS84", frame)
    assert moved.distance(middle) < 1e-3
    chord = shapely.LineString([moved.coords[0], moved.coords[-1]])
    assert chord.distance(middle) > 1  # what the cut is for


def test_short_edges_keep_their_corners_and_z_is_dropped():
    polygon = shapely.Polygon([(-92, 46.8, 5), (-91.9995, 46.8, 5), (-91.9995, 46.8005, 5)])
    moved = geometry_to_frame(polygon, "EPSG:4326", frame_of(UTM15))
    assert len(moved.exterior.coords) == 4
    assert not moved.has_z


def test_absurdly_long_edges_have_bounded_pieces():
    world = shapely.box(-100, -60, -80, 60)
    assert shapely.get_num_coordinates(geometry_to_frame(world, "EPSG:4326", frame_of(UTM15))) < 2e5


def test_no_crs_has_no_longitude():
    with pytest.raises(CrsError, match="no CRS"):
        geometry_to_wgs84(shapely.Point(0, 0), frame_of(None))
    with pytest.raises(CrsError, match="no CRS"):
        geometry_to_frame(shapely.Point(0, 0), "EPSG:4326", frame_of(None))


@pytest.mark.parametrize(
    ("cloud", "bounds"),
    [
        ("+proj=tmerc +lat_0=0 +lon_0=9 +k=1 +x_0=3500000 +units=m " + BESSEL, None),
        ("+proj=longlat " + BESSEL, Bounds(9, 50, 0, 9.01, 50.01, 10)),
    ],
)
def test_towgs84_is_obeyed(cloud, bounds):
    """TOWGS84 of Germany moves a point by about 120 m; without it the place would stay."""
    frame = measuring_frame(cloud, None, bounds)
    plain = measuring_frame(
        cloud.replace("+towgs84=598.1,73.7,418.2,0.202,0.045,-2.455,6.7", ""), None, bounds
    )
    x, y = np.array([[9.005 if bounds else 3500000.0], [50.005 if bounds else 5540000.0]])
    if bounds:
        x, y, _ = frame.to_frame(x, y, np.zeros(1))
    moved, unmoved = (geometry_to_wgs84(shapely.Point(x[0], y[0]), f) for f in (frame, plain))
    _, _, metres = WGS84_GEOD.inv(moved.x, moved.y, unmoved.x, unmoved.y)
    assert 50 < metres < 300
    assert geometry_to_frame(moved, "EPSG:4326", frame).distance(shapely.Point(x[0], y[0])) < 0.01


def test_accuracy_of_the_datum_is_known_or_said_to_be_unknown():
    assert transfer_accuracy_m("EPSG:4326", frame_of(UTM15), -92, 46.8) == 0
    assert transfer_accuracy_m(UTM15, frame_of(UTM15), 576710, 5188139) == 0
    assert transfer_accuracy_m("EPSG:4326", frame_of("EPSG:26715"), -92, 46.8) > 1  # NAD27
    assert math.isnan(
        transfer_accuracy_m("EPSG:4326", frame_of("+proj=utm +zone=15 " + BESSEL), -92, 46)
    )


@settings(deadline=None)
@given(
    st.floats(-95.9, -90.1), st.floats(-79, 83), st.sampled_from([UTM15, "EPSG:3857", "EPSG:26915"])
)
def test_round_trip_to_wgs84(lon, lat, crs):
    frame = frame_of(crs)
    there = geometry_to_frame(shapely.Point(lon, lat), "EPSG:4326", frame)
    back = geometry_to_wgs84(there, frame)
    assert (back.x, back.y) == pytest.approx((lon, lat), abs=1e-9)
