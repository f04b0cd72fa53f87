"""Elevation rasters (DSM, DTM) in GeoTIFF: every valid pixel is a point at its centre.

Read by rasterio, as GeoTIFF alone: no other format, no file beside it and no server can be reached
through one. A raster's header has no heights, so opening reads it once.
"""

from __future__ import annotations

import warnings
from contextlib import contextmanager
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any, Iterator, Optional, Tuple

import numpy as np
import numpy.typing as npt

from ..crs.statements import MergedStatements, Statement, merge_statements
from ..crs.wkt import statement_of_wkt
from ..errors import CloudError, MissingExtraError
from ..files.reading import real_path, require_signature
from ..types import Chunk, CloudInfo, FloatArray, Window
from ..version import how_to_add
from .base import (
    DEFAULT_CHUNK,
    NODATA,
    count_and_bounds,
    measurable,
    naming,
    require_few_damaged,
    scale_warnings,
)

AGAIN = "expected a complete GeoTIFF: copy, download or export it again"
_MOST_PIXELS = 4_000_000_000
_MOST_BLOCK = 1 << 26  # pixels that are compressed together: GDAL takes the memory for all of them
_AT_ONCE = 4_000_000  # pixels read at a time
_ALONE = {
    "GDAL_DISABLE_READDIR_ON_OPEN": "EMPTY_DIR",  # no .ovr, .msk, .tfw beside it
    "GDAL_PAM_ENABLED": "NO",  # no .aux.xml
    "GTIFF_VIRTUAL_MEM_IO": "NO",  # never mapped into memory
    "GTIFF_REPORT_COMPD_CS": "YES",  # heights, whatever the version of the keys
}
#: What GDAL and others write as the unit of a band, in lower case: its name, metres.
_UNITS = {
    **dict.fromkeys(("m", "metre", "metres", "meter", "meters"), ("metre", 1.0)),
    **dict.fromkeys(("ft", "foot", "feet"), ("foot", 0.3048)),
    **dict.fromkeys(("us-ft", "ftus", "us survey foot"), ("US survey foot", 1200 / 3937)),
}

Pixels = Tuple[int, int, int, int]
"""First and last (exclusive) row, first and last (exclusive) column."""


class RasterCloud:
    """One GeoTIFF with a band of heights, and perhaps one of validity (alpha)."""

    def __init__(self, path: Path) -> None:
        self._path = path
        with naming(path, AGAIN), path.open("rb") as stream:
            require_signature(path, stream.read(16), CloudError, "as LAZ")
        with _opened(path) as raster:
            _require_elevations(path, raster)
            _require_place(path, raster)
            stated = _crs_of(raster)
            whole = np.dtype(raster.dtypes[0]).kind in "iu"
            steps = (0.0, 0.0, abs(raster.scales[0]) if whole else 0.0)
        count, bounds = count_and_bounds(self.chunks())
        if bounds is None:
            raise CloudError(
                f"{path}: holds no heights, all of its pixels are nodata; expected elevations: "
                "export it again"
            )
        self.info = CloudInfo(
            sources=(str(path),),
            format="geotiff",
            point_count=count,
            bounds=bounds,
            crs=stated.crs,
            crs_origin=stated.origin,
            warnings=(*stated.warnings, *scale_warnings(path, steps, bounds, count)),
            crs_parts=stated.parts,
            steps=steps,
        )

    def chunks(self, window: Optional[Window] = None, size: int = DEFAULT_CHUNK) -> Iterator[Chunk]:
        """Deliver the pixels from the first row on; of a window those of the rows that touch it."""
        return require_few_damaged(self._path, self._sorted(window, size))

    def _sorted(self, window: Optional[Window], size: int) -> Iterator[Chunk]:
        with _opened(self._path) as raster:
            for part in _parts(raster, _pixels(raster, window)):
                x, y, z, valid = _points(self._path, raster, part)
                for start in range(0, len(z), size):
                    some = slice(start, start + size)
                    yield _chunk(x[some], y[some], z[some], valid[some])


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """Open a GeoTIFF with rasterio, and nothing beside it."""
    rasterio = _rasterio(path)
    with _explained(path), warnings.catch_warnings(), rasterio.Env(**_ALONE):
        warnings.simplefilter("ignore")  # that it has no place, which is told below
        raster = rasterio.open(str(real_path(path)), driver="GTiff")
    with raster:
        yield raster


@contextmanager
def _explained(path: Path) -> Iterator[None]:
    """Turn errors of rasterio, whose causes say more than they do, into CloudErrors."""
    with naming(path, AGAIN):
        try:
            yield
        except OSError as fault:
            raise OSError(str(fault.__cause__ or fault)) from fault


def _rasterio(path: Path) -> Any:
    try:
        import rasterio
    except ImportError as error:
        raise MissingExtraError(
            f"{path.name} needs rasterio, which is missing: export the points as LAZ, or add it "
            f"({how_to_add('raster')})"
        ) from error
    return rasterio


def _require_elevations(path: Path, raster: Any) -> None:
    """Raise CloudError for what is no band of heights."""
    kinds = [kind.name for kind in raster.colorinterp]
    if raster.count > 2 or (raster.count == 2 and kinds[1] != "alpha"):
        raise CloudError(
            f"{path}: has {raster.count} bands; expected one of elevations: an orthophoto shows "
            "colours, give the DSM or DTM (a band alone: gdal_translate -b 1)"
        )
    if kinds[0] == "palette" or np.dtype(raster.dtypes[0]).kind not in "iuf":
        raise CloudError(
            f"{path}: its band has {kinds[0]} values of type {raster.dtypes[0]}; expected "
            "elevations: give the DSM or DTM"
        )
    scale, offset = raster.scales[0], raster.offsets[0]
    if np.dtype(raster.dtypes[0]).itemsize == 1 and scale == 1.0:
        raise CloudError(
            f"{path}: holds an image of 8 bits, as a hillshade is; expected elevations: give the "
            "DSM or DTM itself"
        )
    if not np.isfinite([scale, offset]).all() or not scale:
        raise CloudError(
            f"{path}: its heights have scale {scale} and offset {offset}; expected numbers, and "
            "no scale 0: export it again"
        )


def _require_place(path: Path, raster: Any) -> None:
    """Raise CloudError for a raster without a place, or one that is too large."""
    turn = _matrix(raster)
    if (turn == np.eye(3)).all() or not np.isfinite(turn).all() or not np.linalg.det(turn):
        raise CloudError(
            f"{path}: says nowhere where it lies (no geotransform); expected a GeoTIFF: export "
            "the raster with its georeferencing"
        )
    if raster.width * raster.height > _MOST_PIXELS:
        raise CloudError(
            f"{path}: has {raster.width} x {raster.height} pixels; expected at most "
            f"{_MOST_PIXELS:.0e}: cut out the site (gdal_translate -projwin)"
        )
    rows, columns = raster.block_shapes[0]
    if rows * columns > _MOST_BLOCK:
        raise CloudError(
            f"{path}: its blocks have {columns} x {rows} pixels; expected at most "
            f"{_MOST_BLOCK:.0e}: write it with tiles (gdal_translate -co TILED=YES)"
        )


def _matrix(raster: Any) -> FloatArray:
    """Return the (3, 3) matrix from column, row, 1 to x, y, 1."""
    return np.array(tuple(raster.transform)[:6] + (0.0, 0.0, 1.0)).reshape(3, 3)


def _crs_of(raster: Any) -> MergedStatements:
    """Return what the GeoTIFF keys say, and the unit of the band where they say none of heights."""
    unit = _UNITS.get(str(raster.units[0] or "").strip().lower())
    said = Statement("unit of the band")
    if raster.crs:
        said = statement_of_wkt(raster.crs.to_wkt(), "GeoTIFF keys")
    if unit is not None:
        said = replace(said, height_unit=unit, places={"vertical unit": "unit of the band"})
    return merge_statements([said])


def _pixels(raster: Any, window: Optional[Window]) -> Pixels:
    """Return the pixels that a window may touch; all without one."""
    ends = (raster.height, raster.width)
    if window is None:
        return 0, ends[0], 0, ends[1]
    corners = product((window.min_x, window.max_x), (window.min_y, window.max_y))
    places = np.array([(x, y, 1.0) for x, y in corners])
    columns, rows, _ = np.linalg.inv(_matrix(raster)) @ places.T
    found = []
    for values, end in ((rows, ends[0]), (columns, ends[1])):
        low, high = np.clip([values.min() - 1, values.max() + 2], 0, end)
        found += [int(low), int(high)]
    return found[0], found[1], found[2], found[3]


def _parts(raster: Any, pixels: Pixels) -> Iterator[Pixels]:
    """Divide pixels into parts that are read at a time, along the blocks of the file."""
    first, last, left, right = pixels
    rows, columns = (min(side, _AT_ONCE) for side in raster.block_shapes[0])
    across = max(columns, _AT_ONCE // rows // columns * columns)
    down = max(1, _AT_ONCE // min(across, max(right - left, 1)))
    down = max(down // rows * rows, min(down, rows))
    for row in range(first // down * down, last, down):
        for column in range(left // across * across, right, across):
            yield (
                max(row, first),
                min(row + down, last),
                max(column, left),
                min(column + across, right),
            )


def _points(
    path: Path, raster: Any, part: Pixels
) -> Tuple[FloatArray, FloatArray, FloatArray, npt.NDArray[np.bool_]]:
    """Return x, y, z and validity of the pixels of a part, (N,), row by row."""
    import rasterio

    first, last, left, right = part
    window = ((first, last), (left, right))
    with _explained(path), rasterio.Env(**_ALONE):
        raw = raster.read(1, window=window)
        valid = raster.read_masks(1, window=window) > 0
        if raster.count == 2:
            valid &= raster.read(2, window=window) > 0
        if raster.nodata is None:
            _require_blocks(path, raster, part)
    if raster.nodata is not None:  # a mask in the file goes before it
        with np.errstate(over="ignore", invalid="ignore"):
            valid &= raw != np.float64(raster.nodata).astype(raw.dtype)
    z = raw.astype(np.float64) * raster.scales[0] + raster.offsets[0]
    valid &= ~np.isnan(z)
    turn = raster.transform
    row, column = np.arange(first, last)[:, None] + 0.5, np.arange(left, right) + 0.5
    x = turn.a * column + turn.b * row + turn.c
    y = turn.d * column + turn.e * row + turn.f
    return x.ravel(), y.ravel(), z.ravel(), valid.ravel()


def _require_blocks(path: Path, raster: Any, part: Pixels) -> None:
    """Raise CloudError where a block was never written: it would be read as heights of 0."""
    first, last, left, right = part
    rows, columns = raster.block_shapes[0]
    for down in range(first // rows, -(-last // rows)):
        for across in range(left // columns, -(-right // columns)):
            if raster.get_tag_item(f"BLOCK_OFFSET_{across}_{down}", "TIFF", bidx=1) is None:
                raise CloudError(
                    f"{path}: its block {across}, {down} was never written, and it has no value "
                    "for nodata; expected a complete GeoTIFF: export it again, or set the value"
                )


def _chunk(x: FloatArray, y: FloatArray, z: FloatArray, valid: npt.NDArray[np.bool_]) -> Chunk:
    """Return the valid points of some pixels, the others counted."""
    points = measurable(x[valid], y[valid], z[valid])
    lost = len(valid) - int(valid.sum())
    if not lost:
        return points
    kept = valid.copy()
    if points.kept is not None:
        kept[valid] = points.kept
    return replace(points, left_out={NODATA: lost, **points.left_out}, kept=kept)
