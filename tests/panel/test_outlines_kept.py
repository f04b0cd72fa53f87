"""Outlines that were found and are taken into the form: what is known of them stays with them."""

import json
import shutil
import subprocess

import pytest

from .conftest import REPOSITORY

pytestmark = pytest.mark.one_python

GEOMETRY = REPOSITORY / "plugin" / "panel" / "src" / "geometry.js"
SQUARE = [[[8.0, 50.0], [8.001, 50.0], [8.001, 50.001], [8.0, 50.001], [8.0, 50.0]]]
KNOWN = {"proposed": True, "kind": "pile", "height_m": 4.2, "outline_std_m3": 3.5}


def in_the_form(features, edit=""):
    """Return the properties of areas that were taken into the form, edited, and sent."""
    node = shutil.which("node")
    if node is None:
        pytest.skip("no node on this machine: the panel's sources cannot be run")
    source = GEOMETRY.read_text().replace(
        'import { _, fill } from "./gettext";', "const _ = String;"
    )
    collection = json.dumps({"type": "FeatureCollection", "features": features})
    script = f"{source}\nconst areas = toAreas({collection});\n{edit}\n"
    script += "console.log(JSON.stringify(toGeoJSON(areas)));"
    run = subprocess.run(
        [node, "--input-type=module"], input=script, capture_output=True, text=True, check=True
    )
    return [feature["properties"] for feature in json.loads(run.stdout)["features"]]


def feature(geometry, **properties):
    return {"type": "Feature", "properties": properties, "geometry": geometry}


@pytest.fixture
def pile():
    return feature({"type": "Polygon", "coordinates": SQUARE}, name="pile-1", **KNOWN, area_m2=1.0)


def test_an_outline_that_was_found_stays_one(pile):
    assert in_the_form([pile]) == [{"name": "pile-1", **KNOWN}]


def test_one_that_is_edited_is_drawn(pile):
    assert in_the_form([pile], "areas[0].rings[0][2][0] += 1e-5;") == [{"name": "pile-1"}]


def test_objects_are_not_taken_and_drawn_areas_have_their_name(pile):
    car = feature(pile["geometry"], **{**KNOWN, "kind": "vehicle"})
    assert in_the_form([car, feature(pile["geometry"], name="pit")]) == [{"name": "pit"}]
