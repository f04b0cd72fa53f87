"""Exports a saved measurement as CSV, GeoJSON or a page, without measuring again.

Needs no point cloud, no drawing and no geometry library. The document is one that was checked: its
structure is right, but every text in it may have been written by anybody.
"""

from __future__ import annotations

import base64
import io
import json
from dataclasses import replace
from typing import Any, Dict, Mapping

from ...errors import InputError
from ...types import Measurement, plain
from ...types.json_records import record_of
from ..page.page import Pictures, render_html
from ..wording.units import display_units
from ..wording.words import slug
from .measurement import flat_properties
from .slices_csv import write_slices

__all__ = ["exported", "file_name", "saved_measurement"]

Document = Mapping[str, Any]


def exported(document: Document, kind: str, units: str = "metric") -> str:
    """Return a saved measurement as the text of a file.

    Parameters
    ----------
    document : ``volcalc-measurement/2``, checked: see docs/webodm.md.
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
    return "".join(render_html(measurement, shown, Pictures(pictures)))


def saved_measurement(document: Document) -> Measurement:
    """Return the numbers of a saved measurement as what the reports are made of.

    It has no relief, no body and no frame: what is drawn from these is not saved.
    """
    by = {"saved as": document["name"], "date": document["date"]}
    if document.get("user"):
        by["by"] = document["user"]
    found: Measurement = record_of(Measurement).read(document["measurement"])
    return replace(
        found,
        source=f"{document['name']} ({found.source})",
        provenance={**by, **found.provenance},
    )
