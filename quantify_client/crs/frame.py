"""The metric frame in which a cloud is measured, and the units that lead to it.

Metres, x and y on a map grid (or in no CRS at all), z up. A projected cloud keeps its grid, and
feet become metres by multiplication; a cloud in degrees moves to the UTM zone of its centre on its
own datum. z is never sent through a datum: it is only brought to metres.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, List, Optional, Sequence, Tuple

import numpy as np

from ..errors import CrsError
from ..types import Bounds, FloatArray, Window
from .projection import CRS, full_turn, parse, short, split, transform, unbound, utm_zone
from .same import identifier

__all__ = ["UNITS_M", "Frame", "measuring_frame"]

UNITS_M = {"m": 1.0, "cm": 0.01, "mm": 0.001, "ft": 0.3048, "us-ft": 1200 / 3937}
_UNIT_NAMES = "m, cm, mm, ft or us-ft"

# z may span this many times x and y before these are taken for degrees, of each of which a
# thousandth of relief makes 100 times. Where x and y are far from 0 as well for their span, as
# places in degrees are and bodies in their own coordinates are not, a fiftieth of that is enough.
_DEGREES, _FAR_DEGREES, _FAR = 1000.0, 20.0, 1000.0
# Files round the foot's length to 8 or more digits; the two feet differ by 2e-6.
_SAME_UNIT = 1e-7
# Enclosing boxes are sampled at 21 x 21 points and grown by this share of their width, which is
# more than a meridian or parallel bends between two samples up to a width of 500 km.
_ENCLOSE = 1e-3


@dataclass(frozen=True)
class Frame:
    """The metric frame in which a cloud is measured.

    Attributes
    ----------
    crs : ``EPSG:n`` where that is certain, else WKT; None for a cloud without one. For a grid in
        feet this is the cloud's CRS while the frame's coordinates are its metres (feet x factor).
    length_unit : ``"m"``, or ``"unknown"`` when nobody said.
    warnings : what was assumed, one line each.
    grid_crs : complete definition of the grid (WKT, with TOWGS84 if any); None means ``crs``.
    geographic_crs : the cloud's own CRS when its coordinates are angles, else None.
    unit_m, z_unit_m : metres per unit of the grid, and of the cloud's z (negative: depths).
    center_lon : longitude round which the cloud counts (geographic clouds only).
    """

    crs: Optional[str]
    length_unit: str
    warnings: Sequence[str] = ()
    grid_crs: Optional[str] = None
    geographic_crs: Optional[str] = None
    unit_m: float = 1.0
    z_unit_m: float = 1.0
    center_lon: float = 0.0

    @property
    def is_identity(self) -> bool:
        """True when the cloud's own coordinates are the frame's."""
        return self.geographic_crs is None and self.unit_m == 1.0 and self.z_unit_m == 1.0

    @property
    def grid(self) -> Optional[str]:
        """The grid's definition: frame coordinates / ``unit_m`` are coordinates in it."""
        return self.grid_crs if self.grid_crs is not None else self.crs

    @property
    def cloud_crs(self) -> Optional[str]:
        """The horizontal CRS of the cloud's own coordinates."""
        return self.geographic_crs if self.geographic_crs is not None else self.grid

    def to_frame(
        self, x: FloatArray, y: FloatArray, z: FloatArray
    ) -> Tuple[FloatArray, FloatArray, FloatArray]:
        """Bring coordinates of the cloud to the frame; safe to call from several threads.

        Parameters
        ----------
        x, y, z : (N,) float64, finite, in the cloud's own coordinates.

        Returns
        -------
        x, y, z : (N,) float64, metres. The very same arrays when :attr:`is_identity`.

        Raises
        ------
        CrsError
            When a point cannot be projected.
        """
        if self.is_identity:
            return x, y, z
        if self.geographic_crs is not None and self.grid is not None:
            x, y = transform(self.geographic_crs, self.grid, x, y)
        return _scaled(x, self.unit_m), _scaled(y, self.unit_m), _scaled(z, self.z_unit_m)

    def window_to_source(self, window: Window) -> Window:
        """Enclose a window of the frame (metres) in one of the cloud's own coordinates."""
        if self.geographic_crs is None or self.grid is None:
            if self.unit_m == 1.0:
                return window
            x, y = np.array([[window.min_x, window.max_x], [window.min_y, window.max_y]])
            return _window(x / self.unit_m, y / self.unit_m, grow=0.0)
        x, y = _samples(window)
        lon, lat = transform(self.grid, self.geographic_crs, x / self.unit_m, y / self.unit_m)
        turn = full_turn(self.geographic_crs)
        # Clouds count 0..360 or -180..180, and some lie across the date line.
        lon = (lon - self.center_lon + turn / 2) % turn + self.center_lon - turn / 2
        return _window(lon, lat, grow=_ENCLOSE)

    def bounds_to_frame(self, bounds: Bounds) -> Bounds:
        """Enclose bounds of the cloud's own coordinates in bounds of the frame (metres)."""
        if self.is_identity:
            return bounds
        low_z, high_z = sorted((bounds.min_z * self.z_unit_m, bounds.max_z * self.z_unit_m))
        window = Window(bounds.min_x, bounds.min_y, bounds.max_x, bounds.max_y)
        if self.geographic_crs is not None and self.grid is not None:
            x, y = transform(self.geographic_crs, self.grid, *_samples(window))
            window = _window(x, y, grow=_ENCLOSE)
        unit = self.unit_m
        return Bounds(
            window.min_x * unit,
            window.min_y * unit,
            low_z,
            window.max_x * unit,
            window.max_y * unit,
            high_z,
        )


def measuring_frame(
    crs: Optional[str], source_unit: Optional[str], bounds: Optional[Bounds]
) -> Frame:
    """Choose the metric frame for a cloud.

    Parameters
    ----------
    crs : WKT (1 or 2), PROJ string, ``EPSG:n`` or ODM's ``WGS84 UTM 32N``; None or blank when
        the cloud does not say.
    source_unit : ``"m"``, ``"ft"`` or ``"us-ft"``, for a cloud that does not say; or None.
    bounds : of the cloud, in its own coordinates; only a geographic cloud needs them.

    Raises
    ------
    CrsError
        Unknown CRS or unit, a geocentric or vertical CRS, a ``source_unit`` that contradicts the
        CRS, a geographic cloud that is too wide for one UTM zone.
    """
    if source_unit is not None and source_unit not in UNITS_M:
        raise CrsError(f"unknown unit {short(source_unit)!r}: use --source-unit {_UNIT_NAMES}")
    if crs is None or not crs.strip("\x00 \t\r\n"):
        return _frame_without_crs(source_unit, bounds)
    horizontal, vertical = split(parse(crs))
    kind = unbound(horizontal)
    if kind.type_name.endswith("Engineering CRS"):
        return _local_frame(kind, vertical, source_unit)
    if kind.is_projected:
        return _projected_frame(horizontal, vertical, source_unit)
    if kind.is_geographic:
        return _geographic_frame(horizontal, vertical, source_unit, bounds)
    raise CrsError(
        f"the cloud's CRS {short(kind.name)!r} is a {kind.type_name}, which has no map plane; "
        "transform the cloud to a projected CRS such as its UTM zone first, or give the CRS of its "
        "coordinates (--crs)"
    )


def _frame_without_crs(source_unit: Optional[str], bounds: Optional[Bounds]) -> Frame:
    if source_unit is None:
        _refuse_degrees(bounds)
        note = (
            "the cloud has neither a CRS nor a unit: lengths, areas and volumes are in its own, "
            f"unknown unit; say it with --source-unit {_UNIT_NAMES}, or --crs"
        )
        return Frame(None, "unknown", (note,))
    unit_m = UNITS_M[source_unit]
    return Frame(None, "m", (), unit_m=unit_m, z_unit_m=unit_m)


def _refuse_degrees(bounds: Optional[Bounds]) -> None:
    """Raise where x and y look like longitude and latitude, and z like metres.

    A degree is 1e5 metres: terrain that rises by a hundredth of its width seems to rise by a
    thousand times its width.
    """
    if bounds is None:
        return
    across = max(bounds.max_x - bounds.min_x, bounds.max_y - bounds.min_y)
    relief = bounds.max_z - bounds.min_z
    on_earth = max(abs(bounds.min_x), abs(bounds.max_x)) <= 360.0
    on_earth &= max(abs(bounds.min_y), abs(bounds.max_y)) <= 90.0
    middle = ((bounds.min_x + bounds.max_x) / 2, (bounds.min_y + bounds.max_y) / 2)
    far = math.hypot(*middle) > _FAR * across
    if on_earth and across > 0.0 and relief > (_FAR_DEGREES if far else _DEGREES) * across:
        raise CrsError(
            f"the cloud has no CRS; z spans {relief:.4g} while x and y span {across:.4g}, which "
            "look like longitude and latitude; give their CRS (--crs EPSG:4326, say), or "
            "--source-unit if they are lengths"
        )


def _local_frame(crs: CRS, vertical: Any, source_unit: Optional[str]) -> Frame:
    """Frame of a plane that has a unit, and no place on the Earth: a site grid."""
    notes: List[str] = []
    unit_m = _length_unit(crs.axis_info[0], source_unit)
    z_unit_m = _z_unit(vertical, unit_m, crs, notes)
    return Frame(None, "m", tuple(notes), unit_m=unit_m, z_unit_m=z_unit_m)


def _projected_frame(horizontal: CRS, vertical: Any, source_unit: Optional[str]) -> Frame:
    plane = _local_frame(horizontal, vertical, source_unit)
    return replace(plane, crs=identifier(horizontal), grid_crs=horizontal.to_wkt())


def _geographic_frame(
    horizontal: CRS, vertical: Any, source_unit: Optional[str], bounds: Optional[Bounds]
) -> Frame:
    """Frame of a cloud in degrees: the UTM zone of its centre, on its own datum."""
    if bounds is None:
        raise CrsError(
            f"the cloud is in degrees ({short(horizontal.name)}) and its bounds are unknown; "
            "transform it to a projected CRS such as its UTM zone first"
        )
    own = horizontal.to_wkt()
    grid = utm_zone(horizontal, own, bounds)
    notes = [
        f"the cloud is in degrees ({short(horizontal.name)}); it is measured in "
        f"{short(identifier(grid))}"
    ]
    if vertical is None and source_unit is not None:
        z_unit_m = UNITS_M[source_unit]
    else:
        z_unit_m = _z_unit(vertical, 1.0, horizontal, notes)
        if source_unit is not None:
            _agree(abs(z_unit_m), vertical.unit_name, source_unit)
    return Frame(
        identifier(grid),
        "m",
        tuple(notes),
        grid_crs=grid.to_wkt(),
        geographic_crs=own,
        z_unit_m=z_unit_m,
        center_lon=(bounds.min_x + bounds.max_x) / 2,
    )


def _length_unit(axis: Any, source_unit: Optional[str]) -> float:
    """Metres per unit of an axis; the two feet exactly, however the file rounds them."""
    unit_m = float(axis.unit_conversion_factor)
    if not (math.isfinite(unit_m) and unit_m > 0):
        raise CrsError(
            f"the cloud's CRS gives its unit {short(axis.unit_name)!r} no length; "
            "give one with metres or feet (--crs)"
        )
    for exact in UNITS_M.values():
        if abs(unit_m / exact - 1) < _SAME_UNIT:
            unit_m = exact
    if source_unit is not None:
        _agree(unit_m, axis.unit_name, source_unit)
    return unit_m


def _agree(unit_m: float, name: str, source_unit: str) -> None:
    if unit_m != UNITS_M[source_unit]:
        raise CrsError(
            f"--source-unit {source_unit} contradicts the cloud's CRS, whose unit is the {name}; "
            "leave the option out, or give another CRS (--crs)"
        )


def _z_unit(vertical: Any, unit_m: float, crs: CRS, notes: List[str]) -> float:
    """Metres per unit of z, negative where the CRS counts depths; assumptions go to notes."""
    if vertical is None:
        if unit_m != 1.0:
            name = crs.axis_info[0].unit_name
            notes.append(
                f"the cloud's CRS says nothing about heights: z is taken in the {name}, "
                "like x and y; --vertical-unit sets another"
            )
        return unit_m
    z_unit_m = _length_unit(vertical, None)
    if vertical.direction == "down":
        notes.append("the cloud's CRS counts z as depths: the sign is turned, up is positive")
        return -z_unit_m
    return z_unit_m


def _scaled(values: FloatArray, factor: float) -> FloatArray:
    return values if factor == 1.0 else values * factor


def _samples(window: Window) -> Tuple[FloatArray, FloatArray]:
    """(441,) x and y, spread over a window with its edges."""
    x, y = np.meshgrid(
        np.linspace(window.min_x, window.max_x, 21), np.linspace(window.min_y, window.max_y, 21)
    )
    return x.ravel(), y.ravel()


def _window(x: FloatArray, y: FloatArray, grow: float) -> Window:
    """Box round coordinates, grown by a share of its size and by the rounding of the division."""
    sides = []
    for values in (x, y):
        low, high = float(values.min()), float(values.max())
        more = grow * (high - low) + 4 * max(np.spacing(abs(low)), np.spacing(abs(high)))
        sides.append((float(low - more), float(high + more)))
    return Window(sides[0][0], sides[1][0], sides[0][1], sides[1][1])
