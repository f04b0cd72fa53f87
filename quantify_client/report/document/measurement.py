"""Results as JSON documents of schema quantify-client/2, and flat for attribute tables.

What is in them is defined by the dataclasses in :mod:`quantify_client.types`; ``schema.json`` and
``scale_schema.json`` beside this module are made of the same by ``python -m
quantify_client.report.document.schemas``.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Dict, Mapping

from ...types import AreaResult, Measurement, document
from ...types.json_records import record_of

__all__ = ["flat_properties", "to_json"]


def to_json(measurement: Measurement) -> Dict[str, Any]:
    """Return the document: every key is present, null where it does not apply.

    Lengths, areas and volumes are metric. Only str, bool, int, finite float, None, list and
    dict occur; NaN and infinities become null. The warnings of a scale are also among those of the
    whole: some programs look there only.
    """
    scaling = () if measurement.scale is None else measurement.scale.warnings
    warnings = list(dict.fromkeys([*measurement.warnings, *scaling]))
    return document(replace(measurement, warnings=warnings))


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
