"""A scaling as JSON: SCALE of the measurement's document, and the document of its own."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Dict, Mapping, Optional, Sequence, Union

from ...types import AreaFailure, ControlledPoint, DirectHeight, ScaleObservation, Scaling
from .plain import plain

__all__ = ["SCHEMA", "scale_document", "scale_json"]

SCHEMA = "quantify-client/1"


def scale_json(scaling: Scaling) -> Dict[str, Any]:
    """Return a scaling in JSON's own types; a residual is adjusted - observed, NaN is null."""
    document = {
        "factor": scaling.factor,
        "std": scaling.std,
        "transform": [list(row) for row in scaling.transform],
        "mode": scaling.mode,
        "target_crs": scaling.target_crs,
        "observations": [_observation(o) for o in scaling.observations],
        "check_rms_m": scaling.check_rms_m,
        "rms_m": scaling.rms_m,
        "warnings": list(scaling.warnings),
        "points": [_point(p) for p in scaling.points],
        "direct": [_direct(d) for d in scaling.direct],
        "carried_by": scaling.carried_by,
        "conflict": scaling.conflict,
        "tilt_std_deg": scaling.tilt_std_deg,
    }
    return {key: plain(value) for key, value in document.items()}


def scale_document(
    scaling: Scaling,
    source: str,
    provenance: Mapping[str, Any],
    warnings: Sequence[str],
    out: Optional[Union[str, Path]],
    areas: Optional[str] = None,
    failures: Sequence[AreaFailure] = (),
) -> Dict[str, Any]:
    """Return the document of the ``scale`` command (see ``scale_schema.json``).

    `out` is the scaled cloud that was written, `areas` the moved polygons; else None.
    """
    return {
        "schema": SCHEMA,
        "source": plain(source),
        "scale": scale_json(scaling),
        "out": None if out is None else plain(str(out)),
        "areas": plain(areas),
        "failures": [{"name": plain(f.name), "error": plain(f.error)} for f in failures],
        "warnings": plain(list(warnings)),
        "provenance": plain(provenance),
    }


def _observation(observation: ScaleObservation) -> Dict[str, Any]:
    names = observation.names
    where = {"from": names[0], "to": names[1]} if len(names) == 2 else {"point": names[0]}
    return {
        "kind": observation.kind,
        **where,
        "component": observation.component,
        "observed": observation.observed,
        "adjusted": observation.adjusted,
        "residual": observation.residual,
        "sigma": observation.sigma,
        "redundancy": observation.redundancy,
        "carries": observation.carries,
        "outlier": observation.outlier,
        "check": observation.check,
    }


def _point(point: ControlledPoint) -> Dict[str, Any]:
    return {
        "name": point.name,
        "east_m": point.east,
        "north_m": point.north,
        "up_m": point.up,
        "std_m": point.std,
        "lon": point.lon,
        "lat": point.lat,
        "elevation_m": point.elevation_m,
        "gps_residual_m": point.gps_residual,
        "cloud_residual_m": point.cloud_residual,
    }


def _direct(height: DirectHeight) -> Dict[str, Any]:
    return {
        "from": height.start,
        "to": height.end,
        "slope_m": height.slope_m,
        "ground_m": height.ground_m,
        "dz_m": height.dz_m,
        "std_m": height.std_m,
        "interval_m": height.interval_m,
        "note": height.note,
    }
