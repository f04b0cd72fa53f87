"""Shapefile, GeoPackage, KML, DXF and FlatGeobuf -> outlines, through pyogrio when installed."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any, List, Optional, Tuple

import numpy as np
import shapely

from .errors import AreaError, MissingExtraError
from .geojson import MAX_POLYGONS, MAX_VERTICES, Outline, check_file
from .version import how_to_add

__all__ = ["VECTOR_SUFFIXES", "read_vector"]

# Formats that hold their data themselves: others (GML, VRT) can point to files and servers.
VECTOR_SUFFIXES = (".shp", ".gpkg", ".kml", ".dxf", ".fgb")


def read_vector(path: Path) -> Tuple[List[Outline], List[str]]:
    """Read every layer of a vector file.

    Returns
    -------
    outlines : in file order; the CRS is the layer's own, None where it has none.
    warnings : what the reader had to say.

    Raises
    ------
    AreaError
        When the file cannot be read or is too large.
    MissingExtraError
        When pyogrio is not installed.
    """
    check_file(path)
    path = path.resolve()
    try:
        import pyogrio
        from pyogrio.raw import read
    except ImportError as error:
        raise MissingExtraError(
            f"{path.name} needs pyogrio, which is missing: export the polygons as GeoJSON, or "
            f"add it ({how_to_add('vector')})"
        ) from error
    outlines: List[Outline] = []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            for layer, geometry_type in pyogrio.list_layers(path):
                if geometry_type is not None:
                    table = read(path, layer=layer, force_2d=True, max_features=MAX_POLYGONS + 1)
                    outlines += _layer_outlines(path, *table)
        except (ValueError, RuntimeError) as error:  # pyogrio's own errors are among them
            raise _unreadable(path, error) from error
    _check_size(path, outlines)
    # What pyogrio says of the file; not what numpy says to pyogrio's programmers.
    said = [w.message for w in caught if not issubclass(w.category, DeprecationWarning)]
    notes = {" ".join(str(message).split())[:200] for message in said}
    return outlines, [f"{path.name}: {note}" for note in sorted(notes)]


def _unreadable(path: Path, error: Exception) -> AreaError:
    said = " ".join(str(error).split())[:200]
    return AreaError(f"{path.name} cannot be read: {said}; export the polygons as GeoJSON")


def _check_size(path: Path, outlines: List[Outline]) -> None:
    vertices = sum(int(shapely.get_num_coordinates(outline.polygon)) for outline in outlines)
    if len(outlines) > MAX_POLYGONS or vertices > MAX_VERTICES:
        raise AreaError(
            f"{path.name} holds more than {MAX_POLYGONS:,} polygons or {MAX_VERTICES:,} vertices; "
            "keep only the polygons to be measured, or simplify them"
        )


def _layer_outlines(
    path: Path, meta: Any, fids: Any, geometries: Any, columns: Any
) -> List[Outline]:
    """Turn one layer as pyogrio reads it (WKB, columns) into outlines."""
    lines_may_close = path.suffix.lower() == ".dxf"
    names = _name_column(list(meta["fields"]), columns)
    crs: Optional[str] = meta["crs"]
    outlines = []
    for number, geometry in enumerate(shapely.from_wkb(geometries, on_invalid="ignore")):
        label = None if names is None else names[number]
        outlines.append(_outline(geometry, label, crs, lines_may_close))
    return outlines


def _name_column(fields: List[str], columns: Any) -> Any:
    for number, field in enumerate(fields):
        if field.lower() == "name":
            return columns[number]
    return None


def _outline(geometry: Any, label: Any, crs: Optional[str], lines_may_close: bool) -> Outline:
    if isinstance(label, np.generic):
        label = label.item()
    if geometry is None or geometry.is_empty:
        return Outline(label, None, crs, "has no geometry; draw its polygon", foreign=True)
    if lines_may_close and _is_outline(geometry):
        geometry = shapely.Polygon(geometry)  # DXF has closed polylines and no polygons
    if geometry.geom_type in ("Polygon", "MultiPolygon"):
        return Outline(label, geometry, crs)
    if geometry.geom_type == "GeometryCollection":
        parts = [part for part in geometry.geoms if part.geom_type == "Polygon"]
        if parts:
            dropped = len(geometry.geoms) - len(parts)
            return Outline(label, shapely.MultiPolygon(parts), crs, dropped=dropped)
    kind = geometry.geom_type
    return Outline(label, None, crs, f"is a {kind}, not a polygon; draw a polygon", foreign=True)


def _is_outline(geometry: Any) -> bool:
    return geometry.geom_type == "LineString" and geometry.is_closed and len(geometry.coords) > 3
