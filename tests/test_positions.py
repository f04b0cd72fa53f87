"""Positions of single points between CRSs, and the CRS line of OpenDroneMap's GCP file."""

from __future__ import annotations

import numpy as np
import pytest

from quantify_client.crs import PlaneCoordinates, odm_header, plane_of, positions_to
from quantify_client.errors import CrsError

SITE = "+proj=tmerc +lat_0=34 +lon_0=-119 +k=1 +x_0=0 +y_0=0 +ellps=GRS80 +units=us-ft"


@pytest.mark.parametrize(
    ("crs", "plane"),
    [
        ("EPSG:4326", PlaneCoordinates("EPSG:4326", None)),
        ("EPSG:4979", PlaneCoordinates("EPSG:4326", None)),
        ("EPSG:32611", PlaneCoordinates("EPSG:32611", 1.0)),
        ("EPSG:6340+5703", PlaneCoordinates("EPSG:6340", 1.0)),
        ("WGS84 UTM 11N", PlaneCoordinates("EPSG:32611", 1.0)),
    ],
)
def test_plane(crs: str, plane: PlaneCoordinates) -> None:
    assert plane_of(crs) == plane
    assert plane.geographic == (plane.unit_m is None)


def test_plane_in_feet() -> None:
    assert plane_of("EPSG:2229").unit_m == pytest.approx(1200 / 3937, rel=1e-12)
    assert plane_of(SITE).unit_m == pytest.approx(1200 / 3937, rel=1e-12)


@pytest.mark.parametrize(
    ("crs", "fragment"),
    [
        ("EPSG:4978", "expected longitude and latitude, such as EPSG:4326, or a map projection"),
        ("EPSG:5703", "expected longitude and latitude, such as EPSG:4326, or a map projection"),
        ('LOCAL_CS["site",UNIT["metre",1]]', "'site' is .*or a map projection"),
        ("EPSG:4807", "in grad: expected degrees"),
        ("nonsense", "unknown CRS"),
    ],
)
def test_no_plane(crs: str, fragment: str) -> None:
    with pytest.raises(CrsError, match=fragment):
        plane_of(crs)


def test_central_meridian_of_a_utm_zone() -> None:
    """500 km east by definition; north by k0 times the meridian's length from the equator."""
    x, y = positions_to(np.array([-117.0]), np.array([45.0]), "EPSG:4326", "EPSG:32611")
    assert x[0] == pytest.approx(500_000, abs=1e-6)
    assert y[0] == pytest.approx(0.9996 * 4_984_944.378, abs=1e-3)
    back = positions_to(x, y, "EPSG:32611+5773", "EPSG:4326")
    assert np.ravel(back) == pytest.approx([-117, 45], abs=1e-11)


def test_same_crs_leaves_positions_alone() -> None:
    x, y = np.array([0.1]), np.array([0.2])
    assert positions_to(x, y, "EPSG:4326", "+proj=longlat +datum=WGS84") == (x, y)
    none = np.empty(0)
    assert positions_to(none, none, "EPSG:4326", "EPSG:32611")[0].size == 0


def test_place_outside_a_crs_is_refused() -> None:
    with pytest.raises(CrsError, match="does not exist|cannot be transformed"):
        positions_to(np.array([9e9]), np.array([9e9]), "EPSG:32611", "EPSG:4326")


@pytest.mark.parametrize(
    ("crs", "header"),
    [
        ("EPSG:32611", "EPSG:32611"),
        ("+proj=utm +zone=11 +datum=WGS84", "EPSG:32611"),
        (SITE, f"{SITE} +no_defs"),
    ],
)
def test_header(crs: str, header: str) -> None:
    assert odm_header(crs, np.array([1000.0]), np.array([2000.0])) == header


def test_header_that_would_move_the_points_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    other = SITE.replace("+x_0=0", "+x_0=1")
    monkeypatch.setattr("pyproj.CRS.to_proj4", lambda self: other)
    with pytest.raises(CrsError, match="no PROJ4 string that means the same"):
        odm_header(SITE, np.array([1000.0]), np.array([2000.0]))
    monkeypatch.setattr("pyproj.CRS.to_proj4", lambda self: "")
    with pytest.raises(CrsError, match="no PROJ4 string that means the same"):
        odm_header(SITE, np.array([1000.0]), np.array([2000.0]))
