"""A measurement that was saved as JSON, as CSV, GeoJSON or a page: nothing is measured again.

Needs no point cloud, no drawing and no geometry library. The document is one that was checked: its
structure is right, and every text in it may still have been written by anybody.
"""

from __future__ import annotations

import base64
import io
import json
import math
from typing import Any, Dict, List, Mapping, Optional, Sequence, Tuple, Union

from ...errors import InputError
from ...types import (
    AreaFailure,
    AreaResult,
    BudgetItem,
    Check,
    ControlledPoint,
    DirectHeight,
    Measurement,
    ScaleObservation,
    Scaling,
    Slice,
)
from ..page.page import render_html
from ..wording.units import display_units
from ..wording.words import slug
from .flat import flat_properties
from .plain import plain
from .slices_csv import write_slices

__all__ = ["exported", "file_name", "saved_measurement"]

Document = Mapping[str, Any]


def exported(document: Document, kind: str, units: str = "metric") -> str:
    """Return a saved measurement as the text of a file.

    Parameters
    ----------
    document : ``volcalc-measurement/1``, checked: see docs/webodm.md.
    kind : ``"csv"``, ``"geojson"`` or ``"html"``; only the page has `units`, others are metric.
    """
    if kind == "csv":
        file = io.StringIO(newline="")
        write_slices(saved_measurement(document), file)
        return file.getvalue()
    if kind == "geojson":
        return json.dumps(_geojson(document), indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    if kind == "html":
        return _page(document, units)
    raise InputError(f"A measurement is no {kind!r}; give csv, geojson or html.")


def file_name(name: str) -> str:
    """Return a name for the file, without its ending, that is the same on every system."""
    return slug(name)


def _geojson(document: Document) -> Dict[str, Any]:
    """Return the areas with their numbers; a body's feature has no geometry."""
    results = document["measurement"]["results"]
    drawn = [] if document["area"] is None else document["area"]["features"]
    features = [
        {
            "type": "Feature",
            "geometry": drawn[i]["geometry"] if i < len(drawn) else None,
            "properties": plain({**flat_properties(result), "measured": document["date"]}),
        }
        for i, result in enumerate(results)
    ]
    return {"type": "FeatureCollection", "features": features}


def _page(document: Document, units: str) -> str:
    measurement = saved_measurement(document)
    pictures: Dict[int, bytes] = {}
    for index, layer in enumerate(document["layers"][: len(measurement.results)]):
        if layer["relief"] is not None:
            pictures[index] = base64.b64decode(layer["relief"]["png"])
    shown = display_units(measurement, units)
    return "".join(render_html(measurement, shown, pictures))


def saved_measurement(document: Document) -> Measurement:
    """Return the numbers of a saved measurement as what the reports are made of.

    It has no relief, no body and no frame: what is drawn from these is not saved.
    """
    told = document["measurement"]
    by = {"saved as": document["name"], "date": document["date"]}
    if document.get("user"):
        by["by"] = document["user"]
    return Measurement(
        source=f"{document['name']} ({told['source']})",
        crs=told["crs"],
        length_unit=told["length_unit"],
        shape=told["shape"],
        method=told["method"],
        grid_scale_factor=told["grid_scale_factor"],
        results=tuple(_result(row) for row in told["results"]),
        warnings=tuple(told["warnings"]),
        provenance={**by, **told["provenance"]},
        scale=None if told["scale"] is None else _scaling(told["scale"]),
    )


_NUMBERS = (
    *("volume_m3", "cut_m3", "fill_m3", "std_m3", "cut_std_m3", "fill_std_m3", "area_m2"),
    *("surface_area_m2", "perimeter_m", "min_z_m", "max_z_m", "max_height_m", "coverage"),
    *("points_used", "slice_height_m", "mass_t", "mass_std_t", "base", "cell_m"),
)


def _result(row: Mapping[str, Any]) -> Union[AreaResult, AreaFailure]:
    if "error" in row:
        return AreaFailure(row["name"], row["error"])
    return AreaResult(
        name=row["name"],
        **{key: row[key] for key in _NUMBERS},
        budget=tuple(BudgetItem(item["source"], item["std_m3"]) for item in row["budget"]),
        points_left_out=dict(row["points_left_out"]),
        slices=tuple(Slice(**piece) for piece in row["slices"]),
        checks=tuple(Check(check["method"], check["volume_m3"]) for check in row["checks"]),
        warnings=tuple(row["warnings"]),
        bases=tuple(_base(base) for base in row["bases"] or ()),
    )


def _base(row: Mapping[str, Any]) -> AreaResult:
    """Return a row of the comparison, of which only these numbers are saved."""
    empty = dict.fromkeys(_NUMBERS)
    known = {key: row[key] for key in ("base", "volume_m3", "cut_m3", "fill_m3", "std_m3")}
    heights = dict.fromkeys(("min_z_m", "max_z_m", "max_height_m"), math.nan)
    return AreaResult(
        name="",
        **{**empty, **heights, "points_used": 0, **known},
        budget=(),
        points_left_out={},
        slices=(),
    )


def _scaling(scale: Mapping[str, Any]) -> Scaling:
    """Return a scaling; what JSON has as null was no number."""
    return Scaling(
        factor=scale["factor"],
        std=_number(scale["std"]),
        transform=tuple(tuple(row) for row in scale["transform"]),
        mode=scale["mode"],
        target_crs=scale["target_crs"],
        observations=tuple(_observation(row) for row in scale["observations"]),
        points=tuple(_point(row) for row in scale["points"]),
        direct=tuple(_direct(row) for row in scale["direct"]),
        rms_m=scale["rms_m"],
        check_rms_m=scale["check_rms_m"],
        carried_by=scale["carried_by"],
        conflict=scale["conflict"],
        tilt_std_deg=scale["tilt_std_deg"],
        warnings=tuple(scale["warnings"]),
    )


def _observation(row: Mapping[str, Any]) -> ScaleObservation:
    names = [str(row[key]) for key in ("from", "to", "point") if row.get(key) is not None]
    # A length has two ends, everything else is of one point; a stranger's file may say otherwise.
    wanted = 2 if row["kind"] in ("distance", "scale_bar") else 1
    return ScaleObservation(
        kind=row["kind"],
        component=row.get("component"),
        names=tuple([*names, "?", "?"][:wanted]),
        observed=_number(row.get("observed")),
        adjusted=_number(row.get("adjusted")),
        residual=_number(row.get("residual")),
        sigma=_number(row.get("sigma")),
        redundancy=row.get("redundancy"),
        carries=row.get("carries"),
        outlier=row["outlier"],
        check=row["check"],
    )


def _point(row: Mapping[str, Any]) -> ControlledPoint:
    std = _vector(row["std_m"], 3) or [math.nan] * 3
    gps, cloud = _vector(row["gps_residual_m"], 2), _vector(row["cloud_residual_m"], 3)
    return ControlledPoint(
        name=row["name"],
        east=_number(row["east_m"]),
        north=_number(row["north_m"]),
        up=_number(row["up_m"]),
        std=(std[0], std[1], std[2]),
        gps_residual=None if gps is None else (gps[0], gps[1]),
        cloud_residual=None if cloud is None else (cloud[0], cloud[1], cloud[2]),
        lon=row["lon"],
        lat=row["lat"],
        elevation_m=row["elevation_m"],
    )


def _direct(row: Mapping[str, Any]) -> DirectHeight:
    ends = _vector(row["interval_m"], 2)
    interval: Optional[Tuple[float, float]] = None if ends is None else (ends[0], ends[1])
    return DirectHeight(
        start=row["from"],
        end=row["to"],
        slope_m=_number(row["slope_m"]),
        ground_m=_number(row["ground_m"]),
        dz_m=row["dz_m"],
        std_m=row["std_m"],
        interval_m=interval,
        note=row["note"],
    )


def _number(value: Optional[float]) -> float:
    return math.nan if value is None else float(value)


def _vector(values: Optional[Sequence[Optional[float]]], size: int) -> Optional[List[float]]:
    if values is None:
        return None
    return ([_number(value) for value in values] + [math.nan] * size)[:size]
