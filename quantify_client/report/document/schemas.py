"""The published schemas, made of the dataclasses in :mod:`quantify_client.types`.

``python -m quantify_client.report.document.schemas`` writes ``schema.json`` (of ``volume``) and
``scale_schema.json`` (of ``scale``) beside this file; a test compares them.
"""

from __future__ import annotations

import inspect
import json
import textwrap
from pathlib import Path
from typing import Any, Dict

from ...types import SCHEMA, Measurement, Scaled
from ...types.json_records import DataRecord, Spread, record_of
from ...types.shapes import (
    Either,
    Flag,
    Listed,
    Mapped,
    Maybe,
    Number,
    OneOf,
    Record,
    Shape,
    Text,
    Whole,
)

__all__ = ["document_schema", "schemas"]

WIDTH = 100

Schema = Dict[str, Any]


def schemas() -> Dict[str, str]:
    """Return the text of each schema by the name of its file."""
    return {
        "schema.json": _text(document_schema(Measurement, "schema:2", "volume")) + "\n",
        "scale_schema.json": _text(document_schema(Scaled, "scale-schema:2", "scale")) + "\n",
    }


def document_schema(kind: Any, urn: str, title: str) -> Schema:
    """Return the JSON Schema of a dataclass's documents."""
    definitions: Schema = {}
    told = _object(record_of(kind), definitions)
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": f"urn:quantify-client:{urn}",
        "title": f"{SCHEMA}, {title}",
        **told,
        "properties": {"schema": {"const": SCHEMA}, **told["properties"]},
        "required": ["schema", *told["required"]],
        "$defs": definitions,
    }


def _schema(shape: Shape, definitions: Schema) -> Schema:
    """Return the schema of a shape; that of a dataclass is a definition, and referred to."""
    if isinstance(shape, DataRecord) and not shape.only:
        name = shape.kind.__name__
        if name not in definitions:
            definitions[name] = {}  # its place, before those that it refers to
            definitions[name] = _object(shape, definitions)
        return {"$ref": f"#/$defs/{name}"}
    if isinstance(shape, Record):
        return _object(shape, definitions)
    if isinstance(shape, Maybe):
        found = _schema(shape.inner, definitions)
        if "type" not in found:
            return {"anyOf": [found, {"type": "null"}]}
        kinds = found["type"] if isinstance(found["type"], list) else [found["type"]]
        return {**found, "type": [*kinds, "null"]}
    if isinstance(shape, Either):
        return {"anyOf": [_schema(record, definitions) for record in shape.classes.values()]}
    if isinstance(shape, OneOf):
        return {"type": [_schema(inner, definitions)["type"] for inner in shape.shapes]}
    if isinstance(shape, Listed):
        size = {"minItems": shape.most, "maxItems": shape.most} if shape.fixed else {}
        return {"type": "array", **size, "items": _schema(shape.inner, definitions)}
    if isinstance(shape, Mapped):
        return {"type": "object", "additionalProperties": _schema(shape.inner, definitions)}
    return _scalar(shape)


def _scalar(shape: Shape) -> Schema:
    if isinstance(shape, Number):
        kind = "integer" if isinstance(shape, Whole) else "number"
        ends = {
            "minimum": shape.least,
            "maximum": shape.most,
            "exclusiveMinimum": shape.above,
        }
        return {"type": kind, **{key: end for key, end in ends.items() if end is not None}}
    if isinstance(shape, Text) and shape.among is not None:
        return {"enum": list(shape.among)}
    if isinstance(shape, Text):
        # A later version may have others.
        return {"type": "string", **({"examples": list(shape.known)} if shape.known else {})}
    return {"type": "boolean"} if isinstance(shape, Flag) else {}


def _object(record: Record, definitions: Schema) -> Schema:
    """Return the schema of an object, which may have more keys: quantify-client/2 may grow."""
    properties = {key: _schema(shape, definitions) for key, shape in record.fields.items()}
    always = {*record.required, *record.defaults}
    told: Schema = {
        "type": "object",
        "properties": properties,
        "required": [key for key in record.fields if key in always],
    }
    if isinstance(record, DataRecord):
        told["description"] = inspect.cleandoc(record.kind.__doc__).partition("\n\n")[0]
        for item in record.items:
            if isinstance(item.shape, Spread):
                told.update(item.shape.rule)
            elif item.about:
                properties[item.key.name]["description"] = item.about
    return told


def _text(value: Any, indent: str = "") -> str:
    """Return JSON with as much on a line as a page is wide."""
    line = json.dumps(value)
    if len(indent) + len(line) < WIDTH or not isinstance(value, (dict, list)):
        return line
    inner = indent + "  "
    if isinstance(value, list):
        words = " ".join([f"{_text(item, inner)}," for item in value])[:-1]
        rows = textwrap.fill(words, WIDTH, initial_indent=inner, subsequent_indent=inner)
        return f"[\n{rows}\n{indent}]"
    pairs = [f"{inner}{json.dumps(key)}: {_text(item, inner)}" for key, item in value.items()]
    return "{\n" + ",\n".join(pairs) + f"\n{indent}}}"


if __name__ == "__main__":
    for name, text in schemas().items():
        Path(__file__).with_name(name).write_text(text, encoding="utf-8")
