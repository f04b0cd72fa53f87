"""Which frame a cloud is measured in: its CRS, its units, and windows there and back."""

import math
import threading

import numpy as np
import pytest
from beach import BEACH, BEACH_DEGREES, BESSEL, UTM15, frame_of
from pyproj import CRS

from quantify_client.crs import Frame, is_geographic, measuring_frame
from quantify_client.errors import CrsError
from quantify_client.types import Bounds, Window

UTM15_PROJ = "+proj=utm +zone=15 +datum=WGS84 +units=m +no_defs"


def points(*rows):
    return tuple(np.array(column, dtype=float) for column in zip(*rows))


def utm(lon, lat, zone, f=1 / 298.257223563):
    """Krueger's series to the fourth order, written without pyproj; sub-micrometre in a zone."""
    n = f / (2 - f)
    radius = 6378137.0 / (1 + n) * (1 + n**2 / 4 + n**4 / 64)
    alpha = [
        n / 2 - 2 * n**2 / 3 + 5 * n**3 / 16 + 41 * n**4 / 180,
        13 * n**2 / 48 - 3 * n**3 / 5 + 557 * n**4 / 1440,
        61 * n**3 / 240 - 103 * n**4 / 140,
        49561 * n**4 / 161280,
    ]
    phi, lam = math.radians(lat), math.radians((lon - (6 * zone - 183) + 180) % 360 - 180)
    s = 2 * math.sqrt(n) / (1 + n)
    t = math.sinh(math.atanh(math.sin(phi)) - s * math.atanh(s * math.sin(phi)))
    xi, eta = math.atan2(t, math.cos(lam)), math.asinh(math.sin(lam) / math.hypot(t, math.cos(lam)))
    east = eta + sum(
        a * math.cos(2 * j * xi) * math.sinh(2 * j * eta) for j, a in enumerate(alpha, 1)
    )
    north = xi + sum(
        a * math.sin(2 * j * xi) * math.cosh(2 * j * eta) for j, a in enumerate(alpha, 1)
    )
    return 500000 + 0.9996 * radius * east, 0.9996 * radius * north + (0 if lat >= 0 else 1e7)


# --- which CRS


@pytest.mark.parametrize(
    ("text", "crs"),
    [
        (UTM15, UTM15),
        (UTM15_PROJ, UTM15),
        (CRS(UTM15_PROJ).to_wkt("WKT1_GDAL"), UTM15),
        (CRS(UTM15).to_wkt("WKT2_2019"), UTM15),
        (CRS(UTM15).to_wkt("WKT1_ESRI"), UTM15),
        (CRS(UTM15).to_wkt() + "\x00", UTM15),
        ("WGS84 UTM 15N", UTM15),
        ("WGS84 UTM 15N\n576661 5188114\n", UTM15),
        ("WGS84 UTM 32S", "EPSG:32732"),
        ("+init=epsg:32615", UTM15),
        ("EPSG:32615+5703", UTM15),
        ("EPSG:2263+6360", "EPSG:2263"),
        ("urn:ogc:def:crs:EPSG::25832", "EPSG:25832"),
    ],
)
def test_epsg_code_is_found_however_the_crs_is_written(text, crs):
    assert frame_of(text).crs == crs
    assert frame_of(text).length_unit == "m"


@pytest.mark.parametrize(
    "text",
    [
        "+proj=utm +zone=15 +ellps=GRS80 +units=m +no_defs",  # which datum?
        "+proj=utm +zone=15 +datum=WGS84 +units=us-ft +no_defs",  # not 32615: feet
        CRS(UTM15).to_wkt("WKT1_GDAL").replace("0.9996", "0.9999"),
    ],
)
def test_a_crs_that_merely_resembles_an_epsg_code_stays_wkt(text):
    assert frame_of(text).crs.startswith("PROJCRS[")
    assert CRS(frame_of(text).crs) == CRS(frame_of(text).crs)


@pytest.mark.parametrize("text", [None, "", "  \x00\n"])
def test_no_crs_and_no_unit_is_unknown_and_said(text):
    frame = frame_of(text)
    assert (frame.crs, frame.length_unit, frame.is_identity) == (None, "unknown", True)
    assert "--source-unit" in frame.warnings[0]


@pytest.mark.parametrize(
    ("text", "unit", "words"),
    [
        ("nonsense", None, "unknown CRS 'nonsense'"),
        ("EPSG:999999", None, "expected EPSG:n"),
        ("WGS84 UTM 61N", None, "unknown CRS"),
        ("EPSG:4978", None, "which has no map plane"),
        ("EPSG:5703", None, "which has no map plane"),
        (UTM15, "ft", "contradicts"),
        ("EPSG:2263", "ft", "US survey foot"),  # not the international one
        (None, "yd", "--source-unit m, cm, mm, ft or us-ft"),
        ("EPSG:4326", None, "x, 576662 to 576768, are no longitudes"),
        ("EPSG:4979", "ft", "contradicts"),
    ],
)
def test_unusable_crs_is_refused_in_one_line(text, unit, words):
    bounds = BEACH_DEGREES if text == "EPSG:4979" else BEACH
    with pytest.raises(CrsError, match=words.replace("(", r"\(")) as caught:
        measuring_frame(text, unit, bounds)
    assert "\n" not in str(caught.value)


def test_geographic_cloud_without_bounds_is_refused():
    with pytest.raises(CrsError, match="bounds"):
        measuring_frame("EPSG:4326", None, None)


def test_is_geographic():
    assert is_geographic("urn:ogc:def:crs:OGC:1.3:CRS84")
    assert is_geographic("+proj=longlat " + BESSEL)
    assert not is_geographic(UTM15)


# --- units


@pytest.mark.parametrize(
    ("crs", "unit", "xy", "z"),
    [
        (None, "m", 1.0, 1.0),
        (None, "ft", 0.3048, 0.3048),
        (None, "us-ft", 1200 / 3937, 1200 / 3937),
        ("EPSG:2263", None, 1200 / 3937, 1200 / 3937),  # New York, US survey foot
        ("EPSG:2263", "us-ft", 1200 / 3937, 1200 / 3937),
        ("EPSG:2263+5703", None, 1200 / 3937, 1.0),  # heights in metres
        ("EPSG:32615+6360", None, 1.0, 1200 / 3937),  # NAVD88 in US survey feet
        ("EPSG:2256", None, 0.3048, 0.3048),  # Montana, international foot
        ("EPSG:32615+5715", None, 1.0, -1.0),  # depths
        ('LOCAL_CS["site",UNIT["foot",0.3048]]', None, 0.3048, 0.3048),
        ('LOCAL_CS["site",UNIT["US survey foot",0.304800609601219]]', None, *[1200 / 3937] * 2),
    ],
)
def test_feet_become_metres_exactly(crs, unit, xy, z):
    x, y, height = frame_of(crs, unit).to_frame(*points((984250.0, 194305.5, 30.0), (0, 1, -2)))
    assert np.array_equal(x, np.array([984250.0, 0]) * xy)
    assert np.array_equal(y, np.array([194305.5, 1]) * xy)
    assert np.array_equal(height, np.array([30.0, -2]) * z)


def test_assumed_height_unit_is_said_only_when_it_is_not_the_metre():
    assert "z is taken in the US survey foot" in frame_of("EPSG:2263").warnings[0]
    assert frame_of("EPSG:2263+5703").warnings == ()
    assert frame_of(UTM15).warnings == ()


def test_local_crs_has_a_unit_and_no_place():
    frame = frame_of('LOCAL_CS["site",UNIT["metre",1]]')
    assert (frame.crs, frame.length_unit, frame.is_identity) == (None, "m", True)


def test_identity_returns_the_very_same_arrays():
    arrays = points((576710.5, 5188139.0, 160.0))
    assert all(a is b for a, b in zip(arrays, frame_of(UTM15).to_frame(*arrays)))
    assert all(a is b for a, b in zip(arrays, Frame(None, "unknown").to_frame(*arrays)))


# --- clouds in degrees


def test_geographic_cloud_goes_to_its_utm_zone():
    frame = frame_of("EPSG:4979", bounds=BEACH_DEGREES)
    assert frame.crs == UTM15
    assert "degrees" in frame.warnings[0]
    x, y, z = frame.to_frame(*points((-93.0, 0.0, 7.0), (-92.0, 46.8, 8.0)))
    assert (x[0], y[0]) == pytest.approx((500000, 0), abs=1e-6)
    assert (x[1], y[1]) == pytest.approx(utm(-92.0, 46.8, 15), abs=1e-6)
    assert (x[1], y[1]) == pytest.approx((576308.566, 5183424.683), abs=1e-3)
    assert z.tolist() == [7.0, 8.0]


@pytest.mark.parametrize(
    ("crs", "lon", "lat", "expected"),
    [
        ("EPSG:4326", 9.1, -46.8, "EPSG:32732"),
        ("EPSG:4326", 179.99, 10, "EPSG:32660"),
        ("EPSG:4326", 190.0, 10, "EPSG:32602"),  # counted 0..360
        ("EPSG:4258", 9.1, 46.8, "EPSG:25832"),
        ("EPSG:4269", -93, 46.8, "EPSG:26915"),
    ],
)
def test_utm_zone_keeps_the_datum(crs, lon, lat, expected):
    bounds = Bounds(lon, lat, 0, lon + 0.001, lat + 0.001, 10)
    frame = measuring_frame(crs, None, bounds)
    assert frame.crs == expected
    x, y, _ = frame.to_frame(*points((lon, lat, 0)))
    f = 1 / (298.257223563 if crs == "EPSG:4326" else 298.257222101)  # GRS80: 0.1 mm apart
    assert (x[0], y[0]) == pytest.approx(utm(lon, lat, int(expected[-2:]), f), abs=2e-6)


def test_one_point_stays_an_array_of_one():
    frame = frame_of("EPSG:4326", bounds=BEACH_DEGREES)
    assert [len(v) for v in frame.to_frame(*points((-92.0, 46.8, 8.0)))] == [1, 1, 1]


def test_angles_other_than_degrees_and_greenwich():
    # NTF (Paris): grads east of Paris (2.33722917 deg E); 52 grad = 46.8 deg.
    frame = measuring_frame("EPSG:4807", None, Bounds(0, 52, 0, 0.001, 52.001, 1))
    x, _, _ = frame.to_frame(*points((3 / 0.9 - 2.5969213, 52.0, 0)))
    assert frame.crs == "EPSG:32631"  # UTM counts from Greenwich
    # 3 deg E is the zone's central meridian; NTF and WGS84 are 51 m apart here
    assert x[0] == pytest.approx(500000, abs=60)


def test_source_unit_is_for_the_heights_of_a_geographic_cloud_that_says_none():
    frame = measuring_frame("EPSG:4326", "ft", BEACH_DEGREES)
    assert frame.to_frame(*points((-92.0, 46.8, 10.0)))[2][0] == pytest.approx(3.048, rel=1e-15)


def test_a_place_that_does_not_exist_is_an_error():
    frame = frame_of("EPSG:4326", bounds=BEACH_DEGREES)
    with pytest.raises(CrsError, match="y 95"):
        frame.to_frame(*points((-92, 46, 0), (-92, 95, 0)))


# --- windows


@pytest.mark.parametrize(
    ("crs", "bounds"),
    [
        (UTM15, BEACH),
        (None, BEACH),
        ("EPSG:2263", Bounds(984250, 194305, 0, 985250, 195305, 30)),
        ("EPSG:4326", BEACH_DEGREES),
        ("EPSG:4326", Bounds(179.95, -16, 0, 180.05, -15.9, 10)),
        ("EPSG:4807", Bounds(1, 52, 0, 1.01, 52.01, 10)),
        ("EPSG:4326", Bounds(190, 60, 0, 190.2, 60.1, 10)),
        ("EPSG:4326", Bounds(-93.3, 60, 0, -92.0, 60.1, 10)),  # lowest between two samples
    ],
)
def test_windows_and_bounds_enclose_both_ways(crs, bounds):
    frame = frame_of(crs, bounds=bounds)
    rng = np.random.default_rng(7)
    lows = np.array([bounds.min_x, bounds.min_y, bounds.min_z])
    highs = np.array([bounds.max_x, bounds.max_y, bounds.max_z])
    inside = rng.uniform(lows, highs, (4000, 3))
    for axis, side in ((0, lows), (0, highs), (1, lows), (1, highs)):  # and on the four edges
        inside[rng.choice(4000, 900, replace=False), axis] = side[axis]
    cloud = np.vstack([lows, highs, inside])
    x, y, z = frame.to_frame(*cloud.T.copy())
    box = frame.bounds_to_frame(bounds)
    low = np.array([box.min_x, box.min_y, box.min_z])
    high = np.array([box.max_x, box.max_y, box.max_z])
    assert (low <= np.min([x, y, z], axis=1)).all()
    assert (np.max([x, y, z], axis=1) <= high).all()
    back = frame.window_to_source(Window(x.min(), y.min(), x.max(), y.max()))
    assert (np.array([back.min_x, back.min_y]) <= lows[:2]).all()
    assert (highs[:2] <= np.array([back.max_x, back.max_y])).all()
    assert back.max_x - back.min_x <= 1.2 * (bounds.max_x - bounds.min_x)


def test_depths_keep_bounds_in_order():
    box = frame_of("EPSG:32615+5715").bounds_to_frame(BEACH)
    assert (box.min_z, box.max_z) == (-168.92, -156.06)


def test_threads_agree_with_each_other():
    frame = frame_of("EPSG:4326", bounds=BEACH_DEGREES)
    rng = np.random.default_rng(1)
    lon, lat = rng.uniform(-91.997, -91.995, 20000), rng.uniform(46.842, 46.844, 20000)
    expected = frame.to_frame(lon, lat, np.zeros(20000))
    outcomes = []

    def work():
        for _ in range(5):
            got = frame.to_frame(lon, lat, np.zeros(20000))
            outcomes.append(all(np.array_equal(a, b) for a, b in zip(got, expected)))

    threads = [threading.Thread(target=work) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert outcomes == [True] * 40
