"""Read polygons from Shapefile, GeoPackage, DXF and FlatGeobuf, with pyogrio when installed."""

from __future__ import annotations

import os
import re
import sqlite3
import warnings
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, Iterator, List, Optional, Tuple

import numpy as np
import shapely

from ..errors import AreaError, MissingExtraError
from ..files.reading import private_copy, real_path, require_signature
from ..types import Notice
from ..version import how_to_add
from .geojson import MAX_BYTES, MAX_POLYGONS, DrawnPolygon, bounded, check_file

__all__ = ["VECTOR_SUFFIXES", "read_vector"]

# Formats that hold their data themselves: others (GML, VRT) can point to files and servers.
VECTOR_SUFFIXES = (".shp", ".gpkg", ".dxf", ".fgb")

#: What belongs to a file: a shapefile's columns, index and CRS, a GeoPackage's latest changes.
_BESIDE = {".shp": (".shx", ".dbf", ".prj", ".cpg"), ".gpkg": (".gpkg-wal",)}

#: How a DXF begins, perhaps after comments (group 999).
_DXF = re.compile(rb"(?:\xef\xbb\xbf)?(?:\s*999[ \t]*\r?\n[^\n]*\n)*\s*0[ \t]*\r?\n[ \t]*SECTION\s")

#: Comments put before a DXF's own: GDAL recognises other formats by words in the first kilobytes.
_DXF_LEAD = b"999\noutlines\n" * 10_000

#: The only virtual table that a GeoPackage needs: the index of its geometries.
_VIRTUAL = re.compile(r"create\s+virtual\s+table\s.*\susing\s+\W?rtree\W", re.I | re.S)


def read_vector(path: Path) -> Tuple[List[DrawnPolygon], List[Notice]]:
    """Read every layer of a vector file.

    Returns
    -------
    polygons : in file order; the CRS is the layer's own, None where it has none.
    warnings : what the reader had to say.

    Raises
    ------
    AreaError
        When the file cannot be read or is too large.
    MissingExtraError
        When pyogrio is not installed.
    """
    data = check_file(path)
    path = real_path(path)
    try:
        import pyogrio
        from pyogrio.raw import read
    except ImportError as error:
        raise MissingExtraError(
            f"{path.name} needs pyogrio, which is missing: export the polygons as GeoJSON, or "
            f"add it ({how_to_add('vector')})"
        ) from error
    polygons: List[DrawnPolygon] = []
    with _readable(path, data) as copy, warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            for layer, geometry_type in pyogrio.list_layers(copy):
                if geometry_type is not None:
                    table = read(copy, layer=layer, force_2d=False, max_features=MAX_POLYGONS + 1)
                    polygons += _layer_polygons(path, *table)
        # pyogrio's own errors are among them; NameError is a fault of its at a damaged .prj.
        except (ValueError, RuntimeError, NameError) as error:
            fault = str(error).replace(f"{copy.parent}{os.sep}file", path.stem)
            raise _unreadable(path, fault) from error
    # What pyogrio says of the file; not what numpy says to pyogrio's programmers.
    said = [str(w.message) for w in caught if not issubclass(w.category, DeprecationWarning)]
    notes = {" ".join(text.replace(str(copy), path.name).split())[:200] for text in said}
    told = [Notice("area-file-warning", f"{path.name}: {n}", file=path.name) for n in sorted(notes)]
    return bounded(polygons, path.name), told


@contextmanager
def _readable(path: Path, data: bytes) -> Iterator[Path]:
    """Yield a copy that only the driver of its ending opens, and that refers to no other file."""
    ending = path.suffix.lower()
    if ending != ".dxf":
        require_signature(path, data, AreaError)
    elif _DXF.match(data):
        data = _DXF_LEAD + data.lstrip(b"\xef\xbb\xbf \t\r\n")
    else:
        raise AreaError(
            f"{path.name} is not a DXF in text form: it begins with {data[:12]!r}, expected a "
            "section; export it as ASCII DXF or GeoJSON"
        )
    journal = path.with_name(f"{path.name}-journal")
    if ending == ".gpkg" and journal.is_file() and journal.stat().st_size:
        raise AreaError(
            f"{path.name} is being changed by another program, or was when that broke off "
            f"({journal.name}); open and close it there first, or export the polygons as GeoJSON"
        )
    beside = _BESIDE.get(ending, ())
    with private_copy(path, data, beside=beside, most=MAX_BYTES, error=AreaError) as copy:
        if ending == ".gpkg":
            _require_tables(path, copy)
        if ending == ".shp" and not copy.with_suffix(".shx").is_file():
            raise AreaError(
                f"{path.name}: {path.stem}.shx is missing beside it; copy the whole set (.shp, "
                ".shx, .dbf, .prj), or export the polygons as GeoJSON"
            )
        yield copy


def _require_tables(path: Path, copy: Path) -> None:
    """Refuse a GeoPackage that computes what it shows: SQL functions can read files and servers.

    Views and triggers that no layer needs are dropped from the copy.
    """
    try:
        with closing(sqlite3.connect(str(copy))) as database:
            database.execute("PRAGMA trusted_schema = OFF")
            entries = database.execute("SELECT type, name, sql FROM sqlite_master").fetchall()
            layers = {name.lower() for (name,) in database.execute(_LAYERS)}
            for kind, name, sql in entries:
                computed = kind == "table" and not _is_plain(database, name, sql or "")
                if computed or (kind == "view" and name.lower() in layers):
                    raise AreaError(
                        f"{path.name}: {name[:60]!r} is computed by the database (a view, a "
                        "virtual table or a generated column); expected a table of polygons: "
                        "export them as GeoJSON"
                    )
            for kind, name, _ in entries:
                if kind in ("view", "trigger"):
                    quoted = name.replace('"', '""')
                    database.execute(f'DROP {kind} IF EXISTS "{quoted}"')
            database.commit()
    except AreaError:
        raise
    except (sqlite3.Error, ValueError) as error:
        raise _unreadable(path, str(error)) from error


_LAYERS = "SELECT table_name FROM gpkg_contents WHERE table_name IS NOT NULL"


def _is_plain(database: sqlite3.Connection, name: str, sql: str) -> bool:
    """Whether a table holds its values, none of them generated when asked for."""
    if sql.lower().split()[:2] == ["create", "virtual"]:
        return _VIRTUAL.match(sql) is not None
    hidden = database.execute("SELECT 1 FROM pragma_table_xinfo(?) WHERE hidden > 1", (name,))
    return hidden.fetchone() is None


def _unreadable(path: Path, said: str) -> AreaError:
    said = " ".join(said.split())[:200]
    return AreaError(f"{path.name} cannot be read: {said}; export the polygons as GeoJSON")


def _layer_polygons(
    path: Path, meta: Any, fids: Any, geometries: Any, columns: Any
) -> Iterator[DrawnPolygon]:
    """Yield the polygons of one layer as pyogrio reads it (WKB, columns)."""
    fields: List[str] = list(meta["fields"])
    named = next(
        (column for field, column in zip(fields, columns) if field.lower() == "name"), None
    )
    for number, geometry in enumerate(shapely.from_wkb(geometries, on_invalid="ignore")):
        label = None if named is None else named[number]
        if isinstance(label, np.generic):
            label = label.item()
        if path.suffix.lower() == ".dxf" and _is_closed_line(geometry):
            geometry = shapely.Polygon(geometry.coords)  # DXF has closed polylines, not polygons
        properties = {field: column[number] for field, column in zip(fields, columns)}
        yield replace(_drawn(geometry, label, meta["crs"]), properties=properties)


def _drawn(geometry: Any, label: Any, crs: Optional[str]) -> DrawnPolygon:
    if geometry is None or geometry.is_empty:
        problem = "has no geometry; draw its polygon"
        return DrawnPolygon(label, None, crs, problem, not_polygon=True)
    kind = geometry.geom_type
    if kind in ("Polygon", "MultiPolygon"):
        return DrawnPolygon(label, geometry, crs)
    parts = [p for p in shapely.get_parts(geometry) if p.geom_type == "Polygon"]
    if parts:
        dropped = len(geometry.geoms) - len(parts)
        return DrawnPolygon(label, shapely.MultiPolygon(parts), crs, dropped=dropped)
    problem = f"is a {kind}, not a polygon; draw a polygon"
    return DrawnPolygon(label, None, crs, problem, not_polygon=True)


def _is_closed_line(geometry: Any) -> bool:
    if geometry is None or geometry.geom_type != "LineString":
        return False
    return bool(geometry.is_closed and len(geometry.coords) > 3)
