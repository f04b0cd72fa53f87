"""Results as JSON documents of schema quantify-client/2, and flat for attribute tables.

What is in them is defined by the dataclasses in :mod:`quantify_client.types`; ``schema.json`` and
``scale_schema.json`` beside this module are made of the same by ``python -m
quantify_client.report.document.schemas``.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, Dict, Mapping, Optional, Sequence, Union

from ...types import AreaFailure, AreaResult, Measurement, Scaled, Scaling, document
from ...types.json_records import record_of

__all__ = ["flat_properties", "scale_document", "scale_json", "to_json"]


def to_json(measurement: Measurement) -> Dict[str, Any]:
    """Return the document: every key is present, null where it does not apply.

    Lengths, areas and volumes are metric. Only str, bool, int, finite float, None, list and
    dict occur; NaN and infinities become null. The warnings of a scale are also among those of the
    whole: some programs look there only.
    """
    scaling = () if measurement.scale is None else measurement.scale.warnings
    warnings = list(dict.fromkeys([*measurement.warnings, *scaling]))
    return document(replace(measurement, warnings=warnings))


def scale_json(scaling: Scaling) -> Dict[str, Any]:
    """Return a scaling in JSON's own types; a residual is adjusted - observed, NaN is null."""
    return record_of(Scaling).write(scaling)


def scale_document(
    scaling: Scaling,
    source: str,
    provenance: Mapping[str, Any],
    warnings: Sequence[str],
    out: Optional[Union[str, Path]],
    areas: Optional[str] = None,
    failures: Sequence[AreaFailure] = (),
) -> Dict[str, Any]:
    """Return the document of the ``scale`` command.

    `out` is the scaled cloud that was written, `areas` the moved polygons; else None.
    """
    path = None if out is None else str(out)
    return document(Scaled(source, scaling, path, warnings, provenance, areas, failures))


def flat_properties(row: Mapping[str, Any]) -> Dict[str, Any]:
    """Return a result of the document without lists and objects.

    An interval becomes two numbers, and the warnings one text.
    """
    if "error" in row:
        return {"name": row["name"], "error": row["error"]}
    record = record_of(AreaResult)
    flat: Dict[str, Any] = {key: row[key] for key in record.scalars()}
    for key in record.fields:
        if "interval95" in key:
            part = key[: -len("interval95_m3")]
            ends = row[key] or (None, None)
            flat[f"{part}interval95_low_m3"], flat[f"{part}interval95_high_m3"] = ends
    flat["warnings"] = "; ".join(warning["text"] for warning in row["warnings"])
    return flat
