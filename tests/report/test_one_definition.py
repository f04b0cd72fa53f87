"""The dataclasses are the one definition of a result: whatever is in them is everywhere else."""

from __future__ import annotations

import dataclasses
import json
import math
import subprocess
import sys
from pathlib import Path
from typing import Annotated, Any, Dict, Optional

import jsonschema
import pytest

import quantify_client
from quantify_client import to_json
from quantify_client.report.document.measurement import flat_properties
from quantify_client.report.document.schemas import document_schema, schemas
from quantify_client.types import AreaResult, Measurement, Notice, Scaling
from quantify_client.types.json_records import Key, checked_document, record_of
from quantify_client.types.shapes import Flag, Maybe, Number, Record, Text

from . import scalings, surveys
from .schemas import closed, schema

RESULT = surveys.pile()
SCALING = scalings.everything()
PARTS = [
    surveys.everything(),
    RESULT,
    surveys.failure(),
    RESULT.slices[0],
    RESULT.budget[0],
    RESULT.checks[0],
    SCALING,
    SCALING.observations[0],
    SCALING.points[0],
    SCALING.direct[1],
]
FIELDS = [(part, item) for part in PARTS for item in record_of(type(part)).items if item.is_field]


def another(shape: Any, value: Any) -> Any:
    """Return another value that a field may have."""
    shape = shape.inner if isinstance(shape, Maybe) else shape
    if isinstance(shape, Flag):
        return not value
    if isinstance(shape, Text):
        return next((text for text in shape.among or () if text != value), f"{value}x")
    if isinstance(shape, Number):
        whole = isinstance(value, int)
        return (value or 0) + 1 if whole else 0.125 + 0.5 * (value or 0.0)
    return value


def through(kind: Any, value: Any) -> Any:
    """Return what comes back of a part that is written, stored, checked and read."""
    record = record_of(kind)
    return record.read(record.clean(json.loads(json.dumps(record.write(value))), ""))


@pytest.mark.parametrize(
    ("part", "item"), FIELDS, ids=[f"{type(p).__name__}.{i.name}" for p, i in FIELDS]
)
def test_each_field_travels_through_json_schema_check_and_back(part: Any, item: Any) -> None:
    value = another(item.shape, getattr(part, item.name))
    changed = dataclasses.replace(part, **{item.name: value})
    record = record_of(type(part))
    written = record.write(changed)
    for key in getattr(item.shape, "parts", [item.key.name]):
        assert key in document_schema(type(part), "", "")["properties"]
    if value != getattr(part, item.name):
        assert {key for key, v in record.write(part).items() if v != written[key]} >= {
            item.key.name
        }
    back = through(type(part), changed)
    assert record.write(back) == written
    if isinstance(value, (float, int, str)):
        assert getattr(back, item.name) == pytest.approx(value)


@pytest.mark.parametrize("none", [(), []])
def test_no_bases_are_null_and_come_back_as_none(none: Any) -> None:
    result = dataclasses.replace(RESULT, bases=none)
    assert record_of(AreaResult).write(result)["bases"] is None
    assert through(AreaResult, result).bases == ()


def test_rows_of_a_comparison_come_back_with_their_numbers() -> None:
    (first, *_) = through(AreaResult, surveys.hollow()).bases
    assert (first.base, first.volume_m3) == ("triangulate", -470.0)
    assert (first.slices, first.points_used, math.isnan(first.min_z_m)) == ((), 0, True)


def test_whole_document_comes_back_as_it_was() -> None:
    measurement = dataclasses.replace(surveys.everything(), scale=SCALING)
    document = json.loads(json.dumps(to_json(measurement)))
    checked = checked_document(Measurement, document, "it")
    assert checked == document
    assert to_json(record_of(Measurement).read(checked)) == document


@dataclasses.dataclass(frozen=True)
class Grown(AreaResult):
    """A result with one more number, by one line."""

    haul_m: Annotated[Optional[float], Number(0), Key("haul_distance_m"), "To the plant."] = None


def test_new_number_is_one_line() -> None:
    grown = Grown(**{**vars(RESULT), "haul_m": 120.0})
    told = document_schema(Grown, "", "")
    assert told["properties"]["haul_distance_m"]["minimum"] == 0
    assert told["properties"]["haul_distance_m"]["description"] == "To the plant."
    assert "haul_distance_m" in told["required"]
    row = record_of(Grown).write(grown)
    assert row["haul_distance_m"] == 120.0
    assert through(Grown, grown).haul_m == 120.0
    with pytest.raises(ValueError, match=r"\.haul_distance_m has to be at least 0"):
        record_of(Grown).clean({**row, "haul_distance_m": -1}, "a result")
    assert "haul_distance_m" in record_of(Grown).scalars()


def test_older_readers_keep_what_a_newer_version_writes() -> None:
    row = record_of(Grown).write(Grown(**{**vars(RESULT), "haul_m": 120.0}))
    row["haul_route"] = {"legs": [1.5, {"name": "gate"}]}
    document = {**to_json(surveys.measurement(RESULT)), "results": [row]}
    kept = checked_document(Measurement, document, "it")["results"][0]
    assert kept["haul_distance_m"] == 120.0
    assert kept["haul_route"] == row["haul_route"]


@pytest.mark.parametrize(
    "more",
    [
        {"Script": "x"},
        {"__proto__": {"a": 1}},
        {"x" * 61: 1},
        {"long": "x" * 2001},
        {"deep": [[0] * 101]},
        {"many": dict.fromkeys(map(str, range(101)), 0)},
        {"huge": 1e16},
    ],
)
def test_unknown_keys_beyond_what_is_kept_are_left_out(more: Dict[str, Any]) -> None:
    row = record_of(AreaResult).write(RESULT)
    assert record_of(AreaResult).clean({**row, **more}, "") == row


def test_so_many_unknown_keys_are_kept_and_no_more() -> None:
    row = record_of(AreaResult).write(RESULT)
    found = record_of(AreaResult).clean({**row, **{f"key_{n}": n for n in range(50)}}, "")
    assert len(found) == len(row) + 20


def test_warnings_have_a_code_a_text_and_values() -> None:
    said = Notice("gaps-interpolated", "points support 69 % of the area", share=0.69)
    result = dataclasses.replace(RESULT, warnings=(said, "a plain one"))
    row = to_json(surveys.measurement(result))["results"][0]
    assert row["warnings"] == [
        {"code": "gaps-interpolated", "text": str(said), "values": {"share": 0.69}},
        {"code": "other", "text": "a plain one", "values": {}},
    ]
    back = through(AreaResult, result).warnings
    assert back == result.warnings
    assert (back[0].code, back[0].values) == (said.code, said.values)
    assert flat_properties(row)["warnings"] == f"{said}; a plain one"


def test_values_of_a_warning_that_are_too_large_do_not_cost_the_document() -> None:
    said = Notice("many", "many", names=["x"] * 101, huge=1e99, share=0.5)
    back = through(AreaResult, dataclasses.replace(RESULT, warnings=(said,))).warnings[0]
    assert (back, back.code, back.values) == ("many", "many", {"share": 0.5})


def test_what_schema_1_had_is_read_as_schema_2() -> None:
    document = to_json(dataclasses.replace(surveys.everything(), scale=SCALING))
    old = json.loads(json.dumps({**document, "schema": "quantify-client/1"}))
    for row in [old, old["scale"], *old["results"][:2]]:
        row["warnings"] = [warning["text"] for warning in row["warnings"]]
    for row in old["scale"]["observations"]:
        row["carries"] = row.pop("contribution")
    for check in old["results"][0]["checks"]:
        del check["margin_m3"]
    del old["method_revision"]
    new = checked_document(Measurement, old, "it")
    assert {warning["code"] for warning in new["warnings"]} <= {"other"}
    for row in [new, new["scale"], *new["results"][:2]]:
        assert all(set(warning) == {"code", "text", "values"} for warning in row["warnings"])
    assert new["scale"]["observations"] == document["scale"]["observations"]
    assert new["schema"] == "quantify-client/2"
    assert new["results"][0]["checks"][0]["margin_m3"] == 0.0
    assert new["method_revision"] == 1
    jsonschema.Draft202012Validator(closed(schema("schema.json"))).validate(new)


@pytest.mark.parametrize("name", ["schema.json", "scale_schema.json"])
def test_published_schemas_are_those_of_the_dataclasses(name: str) -> None:
    told = "run python -m quantify_client.report.document.schemas, and commit what it writes"
    assert json.loads(schemas()[name]) == schema(name), told


def test_records_say_where_something_is_wrong() -> None:
    row = record_of(Scaling).write(SCALING)
    row["observations"][1]["sigma"] = "small"
    with pytest.raises(ValueError, match=r"^scale\.observations\[1\]\.sigma has to be a number"):
        record_of(Scaling).clean(row, "scale")
    with pytest.raises(ValueError, match="it lacks 'a'"):
        Record({"a": Flag()}).clean({}, "it")


def test_two_copies_of_the_library_know_their_own_marks() -> None:
    """As in a WebODM that has it installed beside the plugin's: typing shares equal annotations."""
    code = """
import importlib, sys, types
import quantify_client.types.json_records as first
package = types.ModuleType("copy_of")
package.__path__ = [sys.argv[1]]
sys.modules["copy_of"] = package
second = importlib.import_module("copy_of.quantify_client.types.json_records")
names = [m.__name__.replace("json_records", "scaling") for m in (first, second)]
found = [importlib.import_module(name) for name in names]
print(*(m.record_of(s.ScaleObservation).formerly for m, s in zip((first, second), found)))
"""
    root = str(Path(quantify_client.__file__).parents[1])
    done = subprocess.run([sys.executable, "-c", code, root], capture_output=True, text=True)
    assert done.stdout.split() == ["{'carries':", "'contribution'}"] * 2, done.stderr
