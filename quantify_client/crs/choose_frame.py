"""Choose the metric frame in which a cloud is measured.

A projected cloud keeps its grid, and feet become metres by multiplication; a cloud in degrees
moves to the UTM zone of its centre on its own datum. z is never sent through a datum: it is only
brought to metres.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, List, Optional

from ..errors import CrsError
from ..types import Bounds, Notice
from .frame import UNITS_M, Frame
from .projection import CRS, parse, short, split, unbound, unit_of, utm_zone
from .same import identifier, same_metres

__all__ = ["measuring_frame"]

_UNIT_NAMES = "m, cm, mm, ft or us-ft"

# z may span this many times x and y before these are taken for degrees, of each of which a
# thousandth of relief makes 100 times. Where x and y are far from 0 as well for their span, as
# places in degrees are and bodies in their own coordinates are not, a fiftieth of that is enough.
_DEGREES, _FAR_DEGREES, _FAR = 1000.0, 20.0, 1000.0


def measuring_frame(
    crs: Optional[str], source_unit: Optional[str], bounds: Optional[Bounds]
) -> Frame:
    """Return the metric frame in which a cloud is measured.

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
    if kind.is_geographic:
        return _geographic_frame(horizontal, vertical, source_unit, bounds)
    if kind.is_projected or kind.type_name.endswith("Engineering CRS"):
        frame = _planar_frame(horizontal, vertical, source_unit)
        if not kind.is_projected:
            return frame  # a site grid has a unit, and no place on the Earth
        return replace(frame, crs=identifier(horizontal), grid_crs=horizontal.to_wkt())
    raise CrsError(
        f"the cloud's CRS {short(kind.name)!r} is a {kind.type_name}, which has no map plane; "
        "transform the cloud to a projected CRS such as its UTM zone first, or give the CRS of its "
        "coordinates (--crs)"
    )


def _frame_without_crs(source_unit: Optional[str], bounds: Optional[Bounds]) -> Frame:
    if source_unit is not None:
        unit_m = UNITS_M[source_unit]
        return Frame(None, "m", unit_m=unit_m, z_unit_m=unit_m)
    if bounds is not None:
        _refuse_degrees(bounds)
    text = (
        "the cloud has neither a CRS nor a unit: lengths, areas and volumes are in its own, "
        f"unknown unit; say it with --source-unit {_UNIT_NAMES}, or --crs"
    )
    return Frame(None, "unknown", (Notice("unit-unknown", text),))


def _refuse_degrees(bounds: Bounds) -> None:
    """Raise where x and y look like longitude and latitude, and z like metres.

    A degree is 1e5 metres: terrain that rises by a hundredth of its width seems to rise by a
    thousand times its width.
    """
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


def _planar_frame(horizontal: CRS, vertical: Any, source_unit: Optional[str]) -> Frame:
    """Return the frame of a plane in some unit of length, without its place on the Earth."""
    notes: List[Notice] = []
    unit_m = _length_unit(unbound(horizontal).axis_info[0], source_unit)
    z_unit_m = _z_unit(vertical, unit_m, horizontal, notes)
    return Frame(None, "m", tuple(notes), unit_m=unit_m, z_unit_m=z_unit_m)


def _geographic_frame(
    horizontal: CRS, vertical: Any, source_unit: Optional[str], bounds: Optional[Bounds]
) -> Frame:
    """Return the frame of a cloud in degrees: the UTM zone of its centre, on its own datum."""
    degrees = f"the cloud is in degrees ({short(horizontal.name)})"
    if bounds is None:
        raise CrsError(
            f"{degrees} and its bounds are unknown; "
            "transform it to a projected CRS such as its UTM zone first"
        )
    own = horizontal.to_wkt()
    grid = utm_zone(horizontal, own, bounds)
    name = identifier(grid)
    text = f"{degrees}; it is measured in {short(name)}"
    notes = [Notice("measured-in-utm", text, own=horizontal.name, grid=name)]
    if vertical is None and source_unit is not None:
        z_unit_m = UNITS_M[source_unit]
    else:
        z_unit_m = _z_unit(vertical, 1.0, horizontal, notes)
        if source_unit is not None:
            _agree(abs(z_unit_m), vertical.unit_name, source_unit)
    return Frame(
        name,
        "m",
        tuple(notes),
        grid_crs=grid.to_wkt(),
        geographic_crs=own,
        z_unit_m=z_unit_m,
        center_lon=(bounds.min_x + bounds.max_x) / 2,
    )


def _length_unit(axis: Any, source_unit: Optional[str]) -> float:
    """Return metres per unit of an axis; the two feet exactly, however the file rounds them."""
    unit_m = float(axis.unit_conversion_factor)
    if not (math.isfinite(unit_m) and unit_m > 0):
        raise CrsError(
            f"the cloud's CRS gives its unit {short(axis.unit_name)!r} no length; "
            "give one with metres or feet (--crs)"
        )
    unit_m = next((m for m in UNITS_M.values() if same_metres(unit_m, m)), unit_m)
    if source_unit is not None:
        _agree(unit_m, axis.unit_name, source_unit)
    return unit_m


def _agree(unit_m: float, name: str, source_unit: str) -> None:
    if unit_m != UNITS_M[source_unit]:
        raise CrsError(
            f"--source-unit {source_unit} contradicts the cloud's CRS, whose unit is the {name}; "
            "leave the option out, or give another CRS (--crs)"
        )


def _z_unit(vertical: Any, unit_m: float, horizontal: CRS, notes: List[Notice]) -> float:
    """Return metres per unit of z, negative where the CRS counts depths; note what was assumed."""
    if vertical is None:
        if unit_m != 1.0:
            text = (
                "the cloud's CRS says nothing about heights: z is taken in the "
                f"{unit_of(horizontal)[0]}, like x and y; --vertical-unit sets another"
            )
            notes.append(Notice("height-unit-assumed", text, unit_m=unit_m))
        return unit_m
    z_unit_m = _length_unit(vertical, None)
    if vertical.direction == "down":
        text = "the cloud's CRS counts z as depths: the sign is turned, up is positive"
        notes.append(Notice("depths-turned", text))
        return -z_unit_m
    return z_unit_m
