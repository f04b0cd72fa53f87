"""What an area was measured from, as cloud-optimised GeoTIFFs for a GIS."""

from __future__ import annotations

from typing import Any, Dict, Mapping, Optional, Tuple

import numpy as np

from ..errors import MissingExtraError
from ..files.writing import GENERATOR
from ..types import FloatArray, Relief
from ..version import how_to_add

__all__ = ["RASTERS", "raster_bytes", "rasters_of", "require_rasterio"]

#: What each raster holds, by the end of its name.
RASTERS: Mapping[str, str] = {
    "surface": "elevation of the surface",
    "base": "elevation of the base",
    "difference": "height of the surface above the base",
    "sigma": "standard deviation of a cell's height above the base",
}
_NODATA = -9999.0


def require_rasterio() -> Any:
    """Return rasterio; MissingExtraError where it is not installed."""
    try:
        import rasterio
    except ImportError as error:
        raise MissingExtraError(
            f"--rasters needs rasterio, which is missing: leave it out, or add rasterio "
            f"({how_to_add('raster')})"
        ) from error
    return rasterio


def rasters_of(relief: Relief) -> Dict[str, FloatArray]:
    """Return the values of each raster, (ny, nx) metres, NaN where nothing is known."""
    above = relief.above_base_m
    found = {"surface": relief.elevation_m, "base": relief.elevation_m - above, "difference": above}
    if relief.sigma_m is not None:
        found["sigma"] = relief.sigma_m
    return found


def raster_bytes(values: FloatArray, kind: str, relief: Relief, frame: Any) -> bytes:
    """Return one raster as a GeoTIFF, north up, in the CRS of the measuring frame.

    Its places are in the unit of that CRS, its values in metres (of a cloud whose unit nobody said:
    in that).

    Parameters
    ----------
    values : (ny, nx), row 0 is the southernmost.
    frame : a :class:`quantify_client.crs.Frame`; None for none.
    """
    rasterio = require_rasterio()
    from rasterio.crs import CRS
    from rasterio.io import MemoryFile
    from rasterio.transform import Affine

    crs, unit, length = _coordinates(frame)
    cell, top = relief.cell_m / unit, (relief.min_y + relief.cell_m * len(values)) / unit
    north_up = np.nan_to_num(values[::-1], nan=_NODATA).astype(np.float32)
    with rasterio.Env(), MemoryFile() as memory:
        with memory.open(
            driver="COG",
            height=north_up.shape[0],
            width=north_up.shape[1],
            count=1,
            dtype="float32",
            nodata=_NODATA,
            crs=None if crs is None else CRS.from_user_input(crs),
            transform=Affine(cell, 0.0, relief.min_x / unit, 0.0, -cell, top),
            compress="DEFLATE",
        ) as raster:
            raster.write(north_up, 1)
            raster.set_band_description(1, RASTERS[kind])
            raster.units = [length]
            raster.update_tags(TIFFTAG_SOFTWARE=GENERATOR)
        return bytes(memory.read())


def _coordinates(frame: Any) -> Tuple[Optional[str], float, str]:
    """Return the CRS, metres per unit of it, and the unit of heights."""
    if frame is None:
        return None, 1.0, "metre"
    return frame.grid, frame.unit_m, "metre" if frame.length_unit == "m" else ""
