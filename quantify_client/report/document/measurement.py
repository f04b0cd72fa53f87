"""The measurement as the JSON document ``quantify-client/1`` (see ``schema.json``)."""

from __future__ import annotations

import dataclasses
import math
from typing import Any, Dict, List, Optional, Sequence, Union

from ...types import AreaFailure, AreaResult, Measurement
from ..wording.units import INTERVAL95
from .plain import plain
from .scaling import SCHEMA, scale_json

__all__ = ["SCHEMA", "interval95", "to_json"]


def to_json(measurement: Measurement) -> Dict[str, Any]:
    """Return the document: every key is present, null where it does not apply.

    Lengths, areas and volumes are metric. Only str, bool, int, finite float, None, list and
    dict occur; NaN and infinities become null.
    """
    document = {
        "schema": SCHEMA,
        "source": measurement.source,
        "crs": measurement.crs,
        "length_unit": measurement.length_unit,
        "shape": measurement.shape,
        "method": measurement.method,
        "grid_scale_factor": measurement.grid_scale_factor,
        "scale": None if measurement.scale is None else scale_json(measurement.scale),
        "results": [_result(result) for result in measurement.results],
        "warnings": _warnings(measurement),
        "provenance": measurement.provenance,
    }
    return {key: plain(value) for key, value in document.items()}


def _warnings(measurement: Measurement) -> List[str]:
    """Return what concerns the whole cloud, its scale included: some programs look here only."""
    scaling = () if measurement.scale is None else measurement.scale.warnings
    return list(dict.fromkeys([*measurement.warnings, *scaling]))


def interval95(
    value: Optional[float], std: Optional[float], *, least: float = -math.inf
) -> Optional[List[float]]:
    """Return [value - 1.96 std, value + 1.96 std], or None without either.

    Of the digits that are written, so that whoever reads these finds the same interval.

    Parameters
    ----------
    least : below it no true value can lie: 0 for cut and fill, which are never negative. The
        interval ends there, and holds the truth as often as before.

    Examples
    --------
    >>> interval95(10.0, 1.0), interval95(1.0, 1.0, least=0.0)
    ([8.04, 11.96], [0.0, 2.96])
    """
    if value is None or std is None or not math.isfinite(value) or not math.isfinite(std):
        return None
    value, std = plain(value), plain(std)
    return [max(least, value - INTERVAL95 * std), value + INTERVAL95 * std]


def _result(result: Union[AreaResult, AreaFailure]) -> Dict[str, Any]:
    if isinstance(result, AreaFailure):
        return {"name": result.name, "error": result.error}
    return {
        "name": result.name,
        **_volumes(result),
        "budget": [{"source": item.source, "std_m3": item.std_m3} for item in result.budget],
        "area_m2": result.area_m2,
        "surface_area_m2": result.surface_area_m2,
        "perimeter_m": result.perimeter_m,
        "min_z_m": result.min_z_m,
        "max_z_m": result.max_z_m,
        "max_height_m": result.max_height_m,
        "coverage": result.coverage,
        "points_used": result.points_used,
        "points_left_out": result.points_left_out,
        "slice_height_m": result.slice_height_m,
        "slices": [dataclasses.asdict(piece) for piece in result.slices],
        "mass_t": result.mass_t,
        "mass_std_t": result.mass_std_t,
        "base": result.base,
        "cell_m": result.cell_m,
        "bases": _bases(result.bases),
        "checks": [{"method": c.method, "volume_m3": c.volume_m3} for c in result.checks],
        "warnings": list(result.warnings),
    }


def _volumes(result: AreaResult) -> Dict[str, Any]:
    return {
        "volume_m3": result.volume_m3,
        "cut_m3": result.cut_m3,
        "fill_m3": result.fill_m3,
        "std_m3": result.std_m3,
        "interval95_m3": interval95(result.volume_m3, result.std_m3),
        "cut_std_m3": result.cut_std_m3,
        "cut_interval95_m3": interval95(result.cut_m3, result.cut_std_m3, least=0.0),
        "fill_std_m3": result.fill_std_m3,
        "fill_interval95_m3": interval95(result.fill_m3, result.fill_std_m3, least=0.0),
    }


def _bases(bases: Sequence[AreaResult]) -> Optional[List[Dict[str, Any]]]:
    keys = ("base", "volume_m3", "cut_m3", "fill_m3", "std_m3")
    return [{key: getattr(row, key) for key in keys} for row in bases] or None
