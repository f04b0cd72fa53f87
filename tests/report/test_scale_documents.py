"""A scaling as JSON follows its schemas, and states residuals as adjusted - observed."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import Any, Dict, Optional

import jsonschema
import pytest

from quantify_client import to_json, types
from quantify_client.types import Scaled, Scaling
from quantify_client.types.json_records import record_of

from . import scalings, surveys
from .schemas import closed, schema, valid

PROVENANCE = surveys.measurement().provenance
KEYS = (
    "factor std transform mode target_crs observations check_rms_m rms_m warnings points direct "
    "carried_by conflict tilt_std_deg"
).split()
OBSERVATION_KEYS = (
    "kind component observed adjusted residual sigma redundancy contribution outlier check"
).split()


def document(scaling: Scaling, out: Optional[str] = None) -> Dict[str, Any]:
    return types.document(Scaled("all.zip", scaling, out, ("a warning",), PROVENANCE))


CASES = [
    scalings.everything(),
    scalings.least(),
    scalings.crowd(),
    scalings.in_a_line(2),
    scalings.unplaced(),
    scalings.scaling(),
]


@pytest.mark.parametrize("scaling", CASES)
def test_documents_follow_their_schemas(scaling: Scaling) -> None:
    valid(document(scaling), "scale_schema.json")
    valid(to_json(surveys.measurement(surveys.body(), scale=scaling)), "schema.json")


def test_keys_are_those_of_the_design() -> None:
    made = document(scalings.everything(), "out/scaled.laz")
    assert next(iter(made)) == "schema"
    assert set(made) == {
        *("schema", "source", "scale", "out", "areas", "failures", "warnings", "provenance"),
    }
    assert made["out"] == "out/scaled.laz"
    assert set(made["scale"]) == set(KEYS)
    for row in made["scale"]["observations"]:
        where = {"from", "to"} if row["kind"] in ("distance", "scale_bar") else {"point"}
        assert set(row) == where.union(OBSERVATION_KEYS)


def test_numbers_are_those_of_the_scaling() -> None:
    scale = record_of(Scaling).write(scalings.everything())
    wrong = next(row for row in scale["observations"] if row["outlier"])
    assert (wrong["from"], wrong["to"]) == ("A", "C")
    assert wrong["residual"] == 0.31
    assert wrong["adjusted"] - wrong["observed"] == pytest.approx(0.31, abs=1e-12)
    assert wrong["redundancy"] is wrong["contribution"] is None
    assert scale["points"][0]["name"] == "A"
    assert scale["points"][0]["std_m"] == [0.011, 0.012, 0.021]
    assert scale["direct"][1]["interval_m"] == [0.0, 2.1]
    assert scale["transform"][3] == [0.0, 0.0, 0.0, 1.0]


def test_nan_becomes_null_and_stays_valid() -> None:
    scaling = scalings.everything()
    odd = replace(
        scaling.observations[0], redundancy=math.nan, contribution=math.inf, residual=math.nan
    )
    point = replace(scaling.points[0], std=(math.nan, 0.1, math.inf), up=math.nan)
    scaling = replace(scaling, std=math.nan, rms_m=math.nan, observations=(odd,), points=(point,))
    made = document(scaling)
    json.dumps(made, allow_nan=False)
    valid(made, "scale_schema.json")
    assert made["scale"]["std"] is None
    assert made["scale"]["points"][0]["std_m"] == [None, 0.1, None]


@pytest.mark.parametrize(
    "place",
    [(), ("scale",), ("scale", "observations", 0), ("scale", "points", 0), ("scale", "direct", 0)],
)
def test_schema_refuses_a_missing_key_and_tests_an_unknown_one(place: Any) -> None:
    for change in ("add", "remove"):
        made = document(scalings.everything())
        part: Any = made
        for step in place:
            part = part[step]
        if change == "add":
            part["surprise"] = 1
        else:
            part.pop(next(iter(part)))
        told = schema("scale_schema.json")
        told = closed(told) if change == "add" else told
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.Draft202012Validator(told).validate(made)


def test_both_schemas_define_a_scale_alike() -> None:
    whole, scale = schema("schema.json")["$defs"], schema("scale_schema.json")["$defs"]
    assert scale == {name: whole[name] for name in scale}
    own, theirs = schema("scale_schema.json"), schema("schema.json")
    assert own["properties"]["provenance"] == theirs["properties"]["provenance"]
