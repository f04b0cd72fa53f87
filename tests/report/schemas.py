"""The published schemas, and the same as strict as what this version writes."""

from __future__ import annotations

import json
from importlib import resources
from typing import Any, Dict

import jsonschema


def schema(name: str) -> Dict[str, Any]:
    folder = resources.files("quantify_client.report.document")
    return json.loads((folder / name).read_text("utf-8"))


def closed(node: Any) -> Any:
    """Return a schema that knows no other keys and no other kinds: /2 may grow, by a decision."""
    if isinstance(node, list):
        return [closed(item) for item in node]
    if not isinstance(node, dict):
        return node
    made = {key: closed(item) for key, item in node.items()}
    # A provenance and the values of a warning hold what there was to be told.
    if made.get("properties") and "version" not in made["properties"]:
        made["additionalProperties"] = False
    if "examples" in made:
        made["enum"] = [*made["examples"], *([None] if "null" in made["type"] else [])]
    return made


def valid(document: Dict[str, Any], name: str) -> None:
    jsonschema.Draft202012Validator.check_schema(schema(name))
    jsonschema.Draft202012Validator(schema(name)).validate(document)
    jsonschema.Draft202012Validator(closed(schema(name))).validate(document)
