"""East, north and up on the ground of one site, against the formulas of the ellipsoid."""

from __future__ import annotations

import math

import numpy as np
import pytest
from beach import frame_of
from hypothesis import given
from hypothesis import strategies as st

from quantify_client.crs import LocalFrame, grid_scale_factor, local_frame, positions_to, utm_grid
from quantify_client.errors import CrsError

A, E2 = 6378137.0, 0.0066943799901413165  # WGS84


def radii(lat: float):
    """Of the meridian and of the prime vertical."""
    w2 = 1.0 - E2 * math.sin(math.radians(lat)) ** 2
    return A * (1.0 - E2) / w2**1.5, A / math.sqrt(w2)


@given(
    lon=st.floats(-179, 179),
    lat=st.floats(-80, 80),
    height=st.floats(-400, 6000),
    enu=st.tuples(*[st.floats(-2000, 2000)] * 3),
)
def test_there_and_back(lon: float, lat: float, height: float, enu) -> None:
    frame = local_frame("EPSG:4326", lon, lat, height)
    place = np.array([enu])
    x, y, z = frame.from_local(place)
    assert np.abs(frame.to_local(x, y, z, "EPSG:4326") - place).max() < 1e-6
    back = frame.from_local(frame.to_local(x, y, z, "EPSG:4326"))
    assert np.abs(back[0] - x).max() < 1e-9
    assert np.abs(back[1] - y).max() < 1e-9
    assert np.abs(back[2] - z).max() < 1e-6


def test_origin_is_zero() -> None:
    frame = local_frame("EPSG:4326", -119.88, 34.41, 12.5)
    origin = np.array([-119.88]), np.array([34.41]), np.array([12.5])
    assert np.abs(frame.to_local(*origin, "EPSG:4326")).max() < 1e-8
    assert (frame.lon, frame.lat, frame.height) == (-119.88, 34.41, 12.5)


@pytest.mark.parametrize("lat", [-60.0, 0.0, 34.4, 78.0])
@pytest.mark.parametrize("height", [0.0, 2000.0])
def test_short_ways_are_arcs_at_that_height(lat: float, height: float) -> None:
    meridian, vertical = radii(lat)
    frame = local_frame("EPSG:4326", 9.0, lat, height)
    assert frame.radius_m == pytest.approx(math.sqrt(meridian * vertical) + height, rel=1e-12)
    step = 1e-4  # degrees, 11 m
    lon, lats = 9.0 + np.array([step, 0.0, 0.0]), lat + np.array([0.0, step, 0.0])
    found = frame.to_local(lon, lats, height + np.array([0.0, 0.0, 7.0]), "EPSG:4326")
    east = (vertical + height) * math.cos(math.radians(lat)) * math.radians(step)
    north = (meridian + height) * math.radians(step)
    assert found[0, 0] == pytest.approx(east, rel=1e-8)
    assert found[1, 1] == pytest.approx(north, rel=1e-6)
    assert found[2] == pytest.approx([0.0, 0.0, 7.0], abs=1e-8)
    # The Earth falls away below the plane by s^2 / 2R.
    assert found[1, 2] == pytest.approx(-(north**2) / (2 * (meridian + height)), abs=1e-8)


def test_ground_is_longer_than_its_shadow() -> None:
    """100 m at 2000 m of height are 3.1 cm more than on the ellipsoid."""
    places = np.array([9.0, 9.0]), np.array([48.0, 48.0 + 100.0 / 111_190.0])
    low, high = (
        local_frame("EPSG:4326", 9.0, 48.0, h).to_local(*places, np.full(2, h), "EPSG:4326")
        for h in (0.0, 2000.0)
    )
    shadow, ground = (math.dist(*ends) for ends in (low, high))
    assert ground / shadow - 1.0 == pytest.approx(2000.0 / radii(48.0)[0], rel=1e-5)
    assert ground - shadow == pytest.approx(0.0314, abs=2e-4)


GRIDS = [
    ("EPSG:32632", 500_000.0, 5_300_000.0),  # on the central meridian
    ("EPSG:32632", 720_000.0, 5_300_000.0),  # at the edge of the zone
    ("EPSG:32632", 166_100.0, 100.0),  # its edge on the equator
    ("EPSG:32719", 350_000.0, 6_250_000.0),  # in the south
    ("EPSG:2229", 6_480_000.0, 1_840_000.0),  # Los Angeles in US feet
    ("EPSG:31467", 3_500_000.0, 5_300_000.0),  # on Bessel's ellipsoid
]


@pytest.mark.parametrize(("grid", "x", "y"), GRIDS)
@pytest.mark.parametrize("height", [0.0, 2000.0])
def test_grid_turns_and_stretches_into_east_and_north(
    grid: str, x: float, y: float, height: float
) -> None:
    """By 1 / F of the ground, in the grid's own unit, and without shear on a conformal grid."""
    frame = frame_of(grid)
    factor = grid_scale_factor(frame, x * frame.unit_m, y * frame.unit_m, height, odm=False)
    assert factor is not None
    anywhere = local_frame(grid, x + 800.0, y - 900.0, 55.0)
    found = anywhere.grid_jacobian(grid, x, y, height)
    stretch = frame.unit_m / factor
    assert math.sqrt(np.linalg.det(found)) == pytest.approx(stretch, rel=1e-7)
    # At height the two radii of the ellipsoid differ by 0.7 %, of 2000 m / R: 2e-6.
    assert found.T @ found == pytest.approx(stretch**2 * np.eye(2), abs=4e-6 * stretch**2)
    point_scale = grid_scale_factor(frame, x * frame.unit_m, y * frame.unit_m, 0.0, odm=True)
    at_zero = anywhere.grid_jacobian(grid, x, y, 0.0)
    assert math.sqrt(np.linalg.det(at_zero)) == pytest.approx(frame.unit_m / point_scale, rel=1e-7)


def test_grid_is_not_turned_on_its_central_meridian() -> None:
    frame = local_frame("EPSG:32632", 500_000.0, 5_300_000.0, 0.0)
    found = frame.grid_jacobian("EPSG:32632", 500_000.0, 5_300_000.0, 0.0)
    assert found == pytest.approx(np.eye(2) / 0.9996, abs=1e-7)


def test_grid_is_turned_by_its_convergence() -> None:
    """tan(gamma) = tan(dlon) sin(lat), to first orders; east of the middle grid north lies east."""
    lon, lat = 11.5, 48.0
    (x,), (y,) = positions_to(np.array([lon]), np.array([lat]), "EPSG:4326", "EPSG:32632")
    frame = local_frame("EPSG:4326", lon, lat, 0.0)
    east, north = frame.grid_jacobian("EPSG:32632", float(x), float(y), 0.0)[:, 1]
    gamma = math.atan(math.tan(math.radians(lon - 9.0)) * math.sin(math.radians(lat)))
    assert math.atan2(east, north) == pytest.approx(gamma, abs=2e-6)


@pytest.mark.parametrize(("grid", "x", "y"), GRIDS)
def test_places_go_back_to_their_grid(grid: str, x: float, y: float) -> None:
    frame = local_frame(grid, x, y, 300.0)
    xs, ys = x + np.array([0.0, 120.0, -80.0]), y + np.array([0.0, 30.0, 210.0])
    local = frame.to_local(xs, ys, np.full(3, 300.0), grid)
    assert np.abs(local[0]).max() < 1e-6
    assert frame.to_grid(local, grid) == pytest.approx(np.column_stack([xs, ys]), abs=1e-5)
    lon, lat = frame.to_wgs84(local)
    assert np.isfinite(lon).all()
    assert np.isfinite(lat).all()


def test_place_on_another_datum_is_moved_to_wgs84() -> None:
    """Bessel's longitudes and latitudes lie some 100 m off in Germany, and not some kilometres."""
    frame = local_frame("EPSG:31467", 3_500_000.0, 5_300_000.0, 0.0)
    lon, lat = frame.to_wgs84(np.zeros((1, 3)))
    east = (lon[0] - frame.lon) * 111_320.0 * math.cos(math.radians(frame.lat))
    north = (lat[0] - frame.lat) * 111_190.0
    assert 50.0 < math.hypot(east, north) < 250.0
    assert frame.lon == pytest.approx(9.0, abs=1e-9)


@pytest.mark.parametrize(
    ("crs", "x", "y", "zone"),
    [
        ("EPSG:4326", -119.88, 34.41, "EPSG:32611"),
        ("EPSG:4326", 151.2, -33.9, "EPSG:32756"),
        ("EPSG:25832", 500_000.0, 5_300_000.0, "EPSG:25832"),
        ("EPSG:2229", 6_480_000.0, 1_840_000.0, "EPSG:26911"),
    ],
)
def test_utm_zone_of_a_site(crs: str, x: float, y: float, zone: str) -> None:
    assert utm_grid(local_frame(crs, x, y, 0.0)) == zone


@pytest.mark.parametrize(
    ("crs", "x", "y"),
    [("nonsense", 0.0, 0.0), ("EPSG:32632", 1e12, 1e12), ('LOCAL_CS["site"]', 0.0, 0.0)],
)
def test_place_that_is_nowhere_is_refused(crs: str, x: float, y: float) -> None:
    with pytest.raises(CrsError) as caught:
        local_frame(crs, x, y, 0.0)
    assert str(caught.value).isprintable()


def test_frame_is_a_value() -> None:
    assert local_frame("EPSG:4326", 9.0, 48.0, 1.0) == local_frame("EPSG:4326", 9.0, 48.0, 1.0)
    assert isinstance(local_frame("EPSG:4326", 9.0, 48.0, 1.0), LocalFrame)
