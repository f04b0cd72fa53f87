"""The published schemas, made of the dataclasses in :mod:`quantify_client.types`.

``python -m quantify_client.report.document.schemas`` writes ``schema.json`` (of ``volume``) and
``scale_schema.json`` (of ``scale``) beside this file; a test compares them.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Dict

from ...types import Measurement, Scaled
from ...types.records import document_schema

__all__ = ["schemas"]

WIDTH = 100


def schemas() -> Dict[str, str]:
    """Return the text of each schema by the name of its file."""
    made = {
        "schema.json": document_schema(Measurement, "urn:quantify-client:schema:2", "volume"),
        "scale_schema.json": document_schema(Scaled, "urn:quantify-client:scale-schema:2", "scale"),
    }
    return {name: _text(schema) + "\n" for name, schema in made.items()}


def _text(value: Any, indent: str = "") -> str:
    """Return JSON with as much on a line as a page is wide."""
    line = json.dumps(value)
    if len(indent) + len(line) < WIDTH or not isinstance(value, (dict, list)):
        return line
    inner = indent + "  "
    if isinstance(value, list):
        rows, ends = [_text(item, inner) for item in value], "[]"
    else:
        rows = [f"{json.dumps(key)}: {_text(item, inner)}" for key, item in value.items()]
        ends = "{}"
    return ends[0] + ",".join(f"\n{inner}{row}" for row in rows) + f"\n{indent}{ends[1]}"


if __name__ == "__main__":
    for name, text in schemas().items():
        Path(__file__).with_name(name).write_text(text, encoding="utf-8")
