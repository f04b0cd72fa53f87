"""What a web map shows of a measurement: a picture of cut and fill, and the slices' outlines."""

from __future__ import annotations

import base64
import json
import math
import struct
import zlib
from dataclasses import dataclass
from typing import Any, Dict, List, Optional, Sequence, Tuple

import numpy as np
import numpy.typing as npt
import shapely

from ..crs import Frame, apply_matrix
from ..crs.projection import WGS84, transform
from ..errors import CrsError
from ..report.figures import DIVERGING
from ..types import AreaFailure, AreaResult, Body, FloatArray, Measurement, Relief, Slice
from .contours import contour

__all__ = ["OnMap", "indexed_png", "map_layers", "measured_proposals", "on_map"]

Colour = Tuple[int, int, int, int]

LARGEST_PX = 1000
SMALLEST_PX = 240  # a small pile's cells are drawn with several pixels each
NODES = 33  # of the grid on which places are computed; between them a projection is straight
MOST_OUTLINES = 40
CONTOUR_CELLS = 400
SHORTEST_CELLS = 6.0  # what is shorter follows noise
MOST_VERTICES = 20_000
MOST_LINES = MOST_VERTICES // 4
DECIMALS = 8  # of degrees: a millimetre
NO_HEIGHT, LEVEL = 0, 128  # indices of the palette: nothing there, and the base itself


@dataclass(frozen=True)
class OnMap:
    """The way between a frame and longitude and latitude (WGS84, degrees).

    A cloud that control has moved is still shown where it was delivered, and so is all that is
    drawn on it: `back` and `there` are the (4, 4) matrices to the delivered cloud and from it.
    """

    frame: Frame
    back: FloatArray
    there: FloatArray
    height: float
    base_height: float

    def lon_lat(self, x: FloatArray, y: FloatArray) -> Tuple[FloatArray, FloatArray]:
        """Return longitudes and latitudes of (N,) places in the measuring frame, metres."""
        x, y, _ = apply_matrix(self.back, x, y, np.full(len(x), self.height))
        unit = self.frame.unit_m
        return transform(self.frame.grid or "", WGS84, x / unit, y / unit)

    def places(self, lon: FloatArray, lat: FloatArray) -> Tuple[FloatArray, FloatArray]:
        """Return the places in the measuring frame, metres, of (N,) longitudes and latitudes."""
        unit = self.frame.unit_m
        x, y = transform(WGS84, self.frame.grid or "", lon, lat)
        x, y, _ = apply_matrix(self.there, x * unit, y * unit, np.full(len(x), self.base_height))
        return x, y


def on_map(frame: Frame, x: float, y: float, height: float) -> Optional[OnMap]:
    """Return the way for places about (x, y, height) of the frame; None where it has no CRS."""
    own, there = frame.delivered, frame.matrix
    if own.grid is None:  # it has no place on a map but the one that control gave it
        own, there = frame, np.eye(4)
    if own.grid is None:
        return None
    back = np.asarray(np.linalg.inv(there), dtype=np.float64)
    base_height = float(back[2] @ [x, y, height, 1.0])
    return OnMap(own, back, there, height, base_height)


def map_layers(measurement: Measurement) -> List[Dict[str, Any]]:
    """Return the layers of each result, in order: plain JSON types only.

    ``relief`` is a PNG in base64 with its bounds ([south, west], [north, east]), in equal steps of
    Web Mercator; ``outlines`` a FeatureCollection of the slices' outlines at their middles, in
    longitude and latitude; ``proposal`` one of the outline to use instead, where there is one. All
    are empty for a cloud without a CRS and for a failure.
    """
    return [_layer(result, measurement.frame) for result in measurement.results]


def _layer(result: Any, frame: Optional[Frame]) -> Dict[str, Any]:
    layer: Dict[str, Any] = {
        "name": result.name,
        "relief": None,
        "outlines": _collection([]),
        "proposal": None,
    }
    if isinstance(result, AreaFailure) or frame is None:
        return layer
    try:
        if result.relief is not None:
            plane = _plane(frame, result.relief)
            if plane is not None:
                layer["relief"] = _picture(result.relief, plane)
                layer["outlines"] = _terrain_outlines(result, result.relief, plane)
                layer["proposal"] = _proposal(result, result.relief, plane)
        elif result.body is not None:
            layer["outlines"] = _body_outlines(result, result.body, frame)
    except CrsError:
        pass  # no map can show it; the numbers are complete without
    return layer


def _proposal(result: AreaResult, relief: Relief, plane: OnMap) -> Optional[Dict[str, Any]]:
    """Return the outline to use instead of the one that was drawn; None without."""
    if relief.proposal_wkb is None:
        return None
    return _collection([_area(result.name, relief.proposal_wkb, plane)])


def measured_proposals(measurement: Measurement) -> Optional[Dict[str, Any]]:
    """Return the outlines that were proposed and measured, in the order of the results.

    A FeatureCollection in longitude and latitude; None where one of the results has none, or where
    the cloud has no place on a map.
    """
    outlines = {one.name: one for one in measurement.proposals if one.measured}
    features, frame = [], measurement.frame
    for result in measurement.results:
        relief = getattr(result, "relief", None)
        plane = _plane(frame, relief) if frame is not None and relief is not None else None
        if plane is None or result.name not in outlines:
            return None
        one = outlines[result.name]
        feature = _area(result.name, one.polygon_wkb, plane)
        # So that what is measured again knows its outline no better.
        feature["properties"].update(
            proposed=True, kind=one.kind, height_m=one.height_m, outline_std_m3=one.outline_std_m3
        )
        features.append(feature)
    return _collection(features)


def _area(name: str, wkb: bytes, plane: OnMap) -> Dict[str, Any]:
    """Return an outline in the measuring frame as a feature in longitude and latitude."""

    def placed(places: FloatArray) -> FloatArray:
        lon_lat: FloatArray = np.column_stack(plane.lon_lat(*places.T)).round(DECIMALS + 1)
        return lon_lat

    geometry = shapely.transform(shapely.from_wkb(wkb), placed)
    return {
        "type": "Feature",
        "properties": {"name": name},
        "geometry": json.loads(shapely.to_geojson(geometry)),
    }


def _plane(frame: Frame, relief: Relief) -> Optional[OnMap]:
    x, y = shapely.from_wkb(relief.polygon_wkb).centroid.coords[0]
    known = relief.elevation_m[np.isfinite(relief.elevation_m)]
    return on_map(frame, x, y, float(known.mean()) if known.size else 0.0)


def _picture(relief: Relief, plane: OnMap) -> Optional[Dict[str, Any]]:
    """Return the heights above the base in colours; None where there are none."""
    inside = np.isfinite(relief.above_base_m) & (relief.fraction > 0.0)
    if not inside.any():
        return None
    heights, cell, corner = _cropped(relief, inside)
    found = heights[np.isfinite(heights)]
    limit = float(np.percentile(np.abs(found), 99.0)) or 1.0
    lon, lat = plane.lon_lat(*_rim(heights.shape, cell, corner))
    west, east = float(lon.min()), float(lon.max())
    south, north = float(lat.min()), float(lat.max())
    ny, nx = heights.shape
    times = max(1, SMALLEST_PX // max(ny, nx))  # of each cell: a small pile has few
    shape = ny * times, nx * times
    x, y = _places(plane, (west, east), (south, north), shape)
    column = np.floor((x - corner[0]) / cell).astype(np.int64)
    row = np.floor((y - corner[1]) / cell).astype(np.int64)
    hit = (row >= 0) & (row < ny) & (column >= 0) & (column < nx)
    value = np.where(hit, heights[np.clip(row, 0, ny - 1), np.clip(column, 0, nx - 1)], np.nan)
    known = np.isfinite(value)
    scaled = np.clip(np.where(known, value, 0.0) / limit, -1.0, 1.0)
    index = np.where(known, np.round(LEVEL + 127.0 * scaled), NO_HEIGHT).astype(np.uint8)
    png = indexed_png(index, _palette())
    return {
        "png": base64.b64encode(png).decode("ascii"),
        "bounds": [[south, west], [north, east]],
        "max_m": float(found.max()),
        "min_m": float(found.min()),
        "limit_m": limit,
    }


def _cropped(
    relief: Relief, inside: npt.NDArray[np.bool_]
) -> Tuple[FloatArray, float, Tuple[float, float]]:
    """Return the heights within the area's box, averaged until a picture can hold them."""
    rows, columns = np.flatnonzero(inside.any(axis=1)), np.flatnonzero(inside.any(axis=0))
    box = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    # Hide cells that are mostly outside, unless the area is so narrow that it has no others.
    shown = inside & (relief.fraction >= min(0.5, float(relief.fraction.max())))
    heights = np.where(shown, relief.above_base_m, np.nan)[box]
    factor = max(1, -(-max(heights.shape) // LARGEST_PX))
    corner = (
        relief.min_x + columns[0] * relief.cell_m,
        relief.min_y + rows[0] * relief.cell_m,
    )
    return _averaged(heights, factor), relief.cell_m * factor, corner


def _averaged(values: FloatArray, factor: int) -> FloatArray:
    """Return the means of the finite values of blocks."""
    if factor == 1:
        return values
    ny, nx = (-(-n // factor) for n in values.shape)
    padded = np.full((ny * factor, nx * factor), np.nan)
    padded[: values.shape[0], : values.shape[1]] = values
    blocks = padded.reshape(ny, factor, nx, factor)
    count = np.isfinite(blocks).sum(axis=(1, 3))
    total = np.nan_to_num(blocks).sum(axis=(1, 3))
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _rim(
    shape: Tuple[int, ...], cell: float, corner: Tuple[float, float]
) -> Tuple[FloatArray, FloatArray]:
    """Return places along the four sides of a grid's box."""
    along = np.linspace(0.0, 1.0, NODES)
    none, all_ = np.zeros(NODES), np.ones(NODES)
    across = np.concatenate([along, along, none, all_])
    up = np.concatenate([none, all_, along, along])
    return corner[0] + across * shape[1] * cell, corner[1] + up * shape[0] * cell


def _places(
    plane: OnMap, west_east: Tuple[float, float], south_north: Tuple[float, float], shape: Any
) -> Tuple[FloatArray, FloatArray]:
    """Return x and y of each pixel's middle, the top row first: (rows, columns) each."""
    south, north = (_mercator(lat) for lat in south_north)
    west, east = west_east
    up, across = np.linspace(south, north, NODES), np.linspace(west, east, NODES)
    lat = np.degrees(2.0 * np.arctan(np.exp(up)) - math.pi / 2.0)
    grid_lon, grid_lat = np.meshgrid(across, lat)
    at = plane.places(grid_lon.ravel(), grid_lat.ravel())
    rows = (NODES - 1) * (1.0 - (np.arange(shape[0]) + 0.5) / shape[0])
    columns = (NODES - 1) * (np.arange(shape[1]) + 0.5) / shape[1]
    x, y = (_between(values.reshape(NODES, NODES), rows, columns) for values in at)
    return x, y


def _between(nodes: FloatArray, rows: FloatArray, columns: FloatArray) -> FloatArray:
    """Interpolate between nodes, linearly in both directions."""
    row = np.minimum(rows.astype(np.int64), NODES - 2)
    column = np.minimum(columns.astype(np.int64), NODES - 2)
    up, across = (rows - row)[:, None], (columns - column)[None, :]
    south = nodes[row][:, column] * (1 - across) + nodes[row][:, column + 1] * across
    north = nodes[row + 1][:, column] * (1 - across) + nodes[row + 1][:, column + 1] * across
    return np.asarray(south * (1 - up) + north * up)


def _mercator(lat: float) -> float:
    return math.log(math.tan(math.pi / 4.0 + math.radians(lat) / 2.0))


def _palette() -> List[Colour]:
    """Blue below the base, red above, pale and more transparent at it."""
    stops = [stop for stop, _ in DIVERGING]
    shades = np.array(
        [[int(colour[i : i + 2], 16) for i in (1, 3, 5)] for _, colour in DIVERGING], dtype=float
    )
    share = (np.arange(1, 256) - LEVEL) / 127.0
    at = np.clip(share, -1.0, 1.0) / 2.0 + 0.5
    rgb = [np.interp(at, stops, shades[:, channel]) for channel in range(3)]
    alpha = 120.0 + 110.0 * np.minimum(3.0 * np.abs(share), 1.0)
    rows = np.round(np.column_stack([*rgb, alpha])).astype(int).tolist()
    return [(0, 0, 0, 0), *((r, g, b, min(a, 255)) for r, g, b, a in rows)]


def _terrain_outlines(result: AreaResult, relief: Relief, plane: OnMap) -> Dict[str, Any]:
    factor = max(1, -(-max(relief.above_base_m.shape) // CONTOUR_CELLS))
    heights, cell = _averaged(relief.above_base_m, factor), relief.cell_m * factor
    drawn, corner = [], np.array([relief.min_x, relief.min_y])
    for piece in _evenly(result.slices):
        lines = [line for line in contour(heights, piece.z_m) if line.length >= SHORTEST_CELLS]
        rings = [(shapely.get_coordinates(line) + 0.5) * cell for line in lines]
        drawn.append((piece, [ring + corner for ring in rings]))
    return _outlines(drawn, plane, 0.2 * cell)


def _body_outlines(result: AreaResult, body: Body, frame: Frame) -> Dict[str, Any]:
    x, y, z = body.origin
    plane = on_map(frame, x, y, z)
    if plane is None:
        return _collection([])
    pieces = sorted(result.slices, key=lambda piece: piece.z_m)
    outlines = {id(piece): rings for piece, rings in zip(pieces, body.outlines)}
    drawn = [
        (
            piece,
            [
                np.vstack([ring, ring[:1]]) + np.array([x, y])
                for ring in outlines[id(piece)]
                if len(ring)
            ],
        )
        for piece in _evenly(pieces)
        if id(piece) in outlines
    ]
    width = max((float(np.ptp(ring)) for _, rings in drawn for ring in rings), default=0.0)
    return _outlines(drawn, plane, width / 2000.0)


def _evenly(slices: Sequence[Slice]) -> List[Slice]:
    """Return some of the slices, as evenly over them as can be."""
    if len(slices) <= MOST_OUTLINES:
        return list(slices)
    return [slices[i] for i in np.linspace(0, len(slices) - 1, MOST_OUTLINES).round().astype(int)]


def _outlines(
    drawn: Sequence[Tuple[Slice, List[FloatArray]]], plane: OnMap, tolerance: float
) -> Dict[str, Any]:
    """Return outlines as features: lines that are few enough for a file and for a map."""
    lines = _longest([[shapely.linestrings(ring) for ring in rings] for _, rings in drawn])
    simple = iter(_simplified([line for found in lines for line in found], tolerance))
    features = []
    for (piece, _), found in zip(drawn, lines):
        some = [next(simple) for _ in found]
        shown = [_degrees(line, plane) for line in some if line.length > 0.0]
        if not shown:
            continue
        about = {
            "z_m": float(piece.z_m),
            "height_m": float(piece.height_m),
            "area_m2": float(piece.area_m2),
        }
        geometry = {"type": "MultiLineString", "coordinates": shown}
        features.append({"type": "Feature", "properties": about, "geometry": geometry})
    return _collection(features)


def _longest(lines: List[List[Any]]) -> List[List[Any]]:
    """Return the longest lines of each slice, where all are too many."""
    if sum(map(len, lines)) <= MOST_LINES:
        return lines
    quota = MOST_LINES // len(lines)
    return [sorted(found, key=lambda line: -line.length)[:quota] for found in lines]


def _simplified(lines: List[Any], tolerance: float) -> List[Any]:
    """Return the lines simplified until all together have few enough vertices.

    Without keeping topology this ends: at some tolerance no line has more than three vertices.
    """
    simple = shapely.simplify(lines, tolerance, preserve_topology=False)
    while shapely.get_num_coordinates(simple).sum() > MOST_VERTICES:
        tolerance = 2.0 * tolerance or 1e-3
        simple = shapely.simplify(lines, tolerance, preserve_topology=False)
    return list(simple)


def _degrees(line: Any, plane: OnMap) -> List[List[float]]:
    lon, lat = plane.lon_lat(*shapely.get_coordinates(line).T)
    rounded: List[List[float]] = np.round(np.column_stack([lon, lat]), DECIMALS).tolist()
    return rounded


def _collection(features: List[Dict[str, Any]]) -> Dict[str, Any]:
    return {"type": "FeatureCollection", "features": features}


def indexed_png(indices: npt.NDArray[np.uint8], palette: Sequence[Colour]) -> bytes:
    """Return the PNG of a picture.

    Parameters
    ----------
    indices : (rows, columns) uint8 into the palette, the top row first.
    palette : red, green, blue and alpha of each index, 0 to 255.
    """
    rows, columns = indices.shape
    header = struct.pack(">IIBBBBB", columns, rows, 8, 3, 0, 0, 0)
    colours = bytes(value for colour in palette for value in colour[:3])
    alpha = bytes(colour[3] for colour in palette)
    # Each row begins with the number of its filter: none.
    lines = np.pad(indices, ((0, 0), (1, 0)))
    return b"".join(
        [
            b"\x89PNG\r\n\x1a\n",
            _chunk(b"IHDR", header),
            _chunk(b"PLTE", colours),
            _chunk(b"tRNS", alpha),
            _chunk(b"IDAT", zlib.compress(lines.tobytes(), 9)),
            _chunk(b"IEND", b""),
        ]
    )


def _chunk(kind: bytes, data: bytes) -> bytes:
    body = kind + data
    return struct.pack(">I", len(data)) + body + struct.pack(">I", zlib.crc32(body))
