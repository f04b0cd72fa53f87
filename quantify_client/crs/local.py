"""East, north and up in metres on the ground about one place.

A tangent plane at the site's own height: a taped length is a length in it. The site's height
matters: 100 m at 2000 m above the ellipsoid are 3 cm longer than their shadow on it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Tuple

import numpy as np
from pyproj import Transformer

from ..errors import CrsError
from ..types import Bounds, FloatArray
from .projection import (
    WGS84,
    gaussian_radius,
    horizontal_wkt,
    parse,
    short,
    split,
    transform,
    unbound,
    unit_of,
    utm_zone,
)
from .same import identifier

__all__ = ["LocalFrame", "local_frame", "utm_grid"]

_STEP_M = 50.0  # of the differences that turn a grid into east and north: bends stay below 1e-10


@dataclass(frozen=True)
class LocalFrame:
    """A tangent plane: x to the east, y to the north, z up, in metres.

    Attributes
    ----------
    geographic : WKT of the geographic CRS whose ellipsoid and datum it is on.
    lon, lat, height : its origin, degrees and metres above the ellipsoid.
    radius_m : of the Earth here (Gaussian mean) at that height.
    """

    geographic: str
    lon: float
    lat: float
    height: float
    radius_m: float

    def to_local(self, x: FloatArray, y: FloatArray, height: FloatArray, crs: str) -> FloatArray:
        """Return (N, 3) east, north, up of places in any CRS (x, y order) at heights in metres.

        Raises
        ------
        CrsError
            When a place has no longitude and latitude.
        """
        lon, lat = transform(horizontal_wkt(crs), self.geographic, x, y)
        return np.column_stack(self._moved(lon, lat, np.broadcast_to(height, np.shape(lon))))

    def from_local(self, enu: FloatArray) -> Tuple[FloatArray, FloatArray, FloatArray]:
        """Return longitudes, latitudes (degrees, on this datum) and heights of (N, 3) places."""
        east, north, up = enu.T
        return self._moved(east, north, up, direction="INVERSE")

    def to_wgs84(self, enu: FloatArray) -> Tuple[FloatArray, FloatArray]:
        """Return longitudes and latitudes on WGS84 of (N, 3) places."""
        lon, lat, _ = self.from_local(enu)
        return transform(self.geographic, WGS84, lon, lat)

    def to_grid(self, enu: FloatArray, grid: str) -> FloatArray:
        """Return (N, 2) x and y in a CRS, in its own unit, of (N, 3) places."""
        lon, lat, _ = self.from_local(enu)
        return np.column_stack(transform(self.geographic, horizontal_wkt(grid), lon, lat))

    def grid_jacobian(self, grid: str, x: float, y: float, height: float) -> FloatArray:
        """Return (2, 2) d(east, north) / d(x, y) of a grid, in its own unit, at one place.

        The scale in it is that of the ground at this height; at height 0 it is 1 / k.
        """
        own = horizontal_wkt(grid)
        steps = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]]) * _STEP_M
        lon, lat = transform(own, self.geographic, x + steps[:, 0], y + steps[:, 1])
        middle = transform(own, self.geographic, np.array([x]), np.array([y]))
        here = local_frame(self.geographic, float(middle[0][0]), float(middle[1][0]), height)
        enu = here.to_local(lon, lat, np.full(4, height), self.geographic)[:, :2]
        return np.column_stack([enu[0] - enu[1], enu[2] - enu[3]]) / (2.0 * _STEP_M)

    def _moved(
        self, x: FloatArray, y: FloatArray, z: FloatArray, direction: str = "FORWARD"
    ) -> Tuple[FloatArray, FloatArray, FloatArray]:
        # As lists: an array of one number is none to pyproj 3.6, and numpy warns of that.
        xs, ys, zs = (np.atleast_1d(axis).tolist() for axis in (x, y, z))
        found = self._pipeline().transform(xs, ys, zs, direction=direction)
        return np.array(found[0]), np.array(found[1]), np.array(found[2])

    def _pipeline(self) -> Transformer:
        shape = _shape(self.geographic)
        return Transformer.from_pipeline(
            "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad "
            f"+step +proj=cart {shape} +step +proj=topocentric {shape} "
            f"+lon_0={self.lon!r} +lat_0={self.lat!r} +h_0={self.height!r}"
        )


def _shape(geographic: str) -> str:
    """PROJ's words for the ellipsoid."""
    ellipsoid = unbound(parse(geographic)).ellipsoid
    if ellipsoid is None:
        raise CrsError(f"{short(geographic)} has no ellipsoid; give EPSG:4326 or a projected CRS")
    a, b = ellipsoid.semi_major_metre, ellipsoid.semi_minor_metre
    return f"+a={a!r} +b={b!r}"


def local_frame(crs: str, x: float, y: float, height: float) -> LocalFrame:
    """Return the tangent plane at a place of any horizontal CRS, on that CRS's own datum.

    Raises
    ------
    CrsError
        Unknown CRS, or a place outside it.
    """
    geographic = _geographic(crs)
    lon, lat = transform(horizontal_wkt(crs), geographic, np.array([x]), np.array([y]))
    mean = gaussian_radius(unbound(parse(geographic)), math.radians(float(lat[0])))
    return LocalFrame(geographic, float(lon[0]), float(lat[0]), height, mean + height)


def utm_grid(frame: LocalFrame) -> str:
    """Return the UTM zone of a local frame, on its datum: ``EPSG:n`` where that is certain."""
    place = Bounds(frame.lon, frame.lat, 0.0, frame.lon, frame.lat, 0.0)
    return identifier(utm_zone(unbound(parse(frame.geographic)), frame.geographic, place))


def _geographic(crs: str) -> str:
    """The geographic CRS in degrees that a CRS is made on; its TOWGS84, if any, goes with it."""
    horizontal = split(parse(crs))[0]
    plain = unbound(horizontal).geodetic_crs
    if plain is None:
        raise CrsError(
            f"the CRS {short(crs)!r} has no place on the Earth; expected a geographic or projected "
            "one: EPSG:4326 for longitudes and latitudes"
        )
    if horizontal.is_bound or abs(unit_of(plain)[1] / math.radians(1.0) - 1.0) > 1e-9:
        # Bound to WGS84, or counted in gon: WGS84 itself is then the plainest place to be.
        return WGS84
    return str(plain.to_2d().to_wkt())
