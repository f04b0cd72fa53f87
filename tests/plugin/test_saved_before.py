"""Twelve documents saved by the plugin of commit 28418b1 are listed, shown and exported for good.

How they were made is in saved-28418b1/make.py.
"""

import csv
import importlib
import io
import json
import shutil
import sys
import types
from pathlib import Path

import pytest
from visitors import API

from quantify_client.report.document.saved_export import exported, saved_measurement

HERE = Path(__file__).parent
PLUGIN = HERE.parents[1] / "plugin"
SAVED = sorted((HERE / "saved-28418b1").glob("*.json"))
pytestmark = pytest.mark.parametrize("path", SAVED, ids=[path.stem for path in SAVED])


@pytest.fixture(scope="module")
def documents():
    """The plugin's modules of files, without WebODM."""
    package = types.ModuleType("volcalc_before")
    package.__path__ = [str(PLUGIN), str(PLUGIN.parent)]
    sys.modules["volcalc_before"] = package
    yield importlib.import_module("volcalc_before.files.saved")
    for name in [name for name in sys.modules if name.startswith("volcalc_before")]:
        del sys.modules[name]


def parts(measurement):
    """Return what may have warnings of its own: the whole, its scale, its results."""
    found = [measurement, measurement["scale"], *measurement["results"]]
    return [part for part in found if part is not None and "warnings" in part]


def test_numbers_stay_and_warnings_become_those_of_today(documents, path):
    before = json.loads(path.read_text())
    assert before["schema"] == "volcalc-measurement/1"
    after = documents.checked_document(json.loads(path.read_text()))
    assert after["schema"] == "volcalc-measurement/2"
    assert after["measurement"]["schema"] == "quantify-client/2"
    for old, new in zip(parts(before["measurement"]), parts(after["measurement"])):
        said = [{"code": "other", "text": text, "values": {}} for text in old.pop("warnings")]
        assert new.pop("warnings") == said
    for row in before["measurement"]["results"]:
        for check in row.get("checks", ()):
            check["margin_m3"] = 0.0
    for row in (before["measurement"]["scale"] or {}).get("observations", ()):
        row["contribution"] = row.pop("carries")
    before["measurement"]["method_revision"] = 1
    before["measurement"].update(proposals=[], kind="volume", alignment=None, series=[])
    for row in before["measurement"]["results"]:
        if "error" not in row:
            row.update(level_of_detection_m=None, area_changed_m2=None, stage=None)
    for layer in before["layers"]:
        layer["proposal"] = None
    before["measurement"]["schema"], before["schema"] = "quantify-client/2", after["schema"]
    assert after == before


def test_read_again_after_it_was_written_as_today(documents, path, tmp_path):
    document = documents.checked_document(json.loads(path.read_text()))
    file = tmp_path / f"{document['id']}.json"
    task = types.SimpleNamespace(id=document["task"], project=types.SimpleNamespace(pk=3))
    shutil.copy(path, file)
    assert documents.read_document(file, document["id"], task) == document
    documents.write_document(file, document)
    assert documents.read_document(file, document["id"], task) == document


def test_list_tells_of_it_with_and_without_a_head(documents, path, tmp_path):
    entries = importlib.import_module("volcalc_before.files.list_rows")
    document = documents.checked_document(json.loads(path.read_text()))
    file = tmp_path / f"{document['id']}.json"
    shutil.copy(path, file)
    old = entries.entry_of(file, document["id"], entries.Budget())
    results = [row for row in document["measurement"]["results"] if "error" not in row]
    assert old["name"] == path.stem
    assert old["summary"]["volume_m3"] == pytest.approx(sum(row["volume_m3"] for row in results))
    documents.write_document(file, document)
    assert entries.entry_of(file, document["id"], entries.Budget()) == old


@pytest.mark.parametrize("units", ["metric", "us"])
def test_it_is_exported(documents, path, units):
    document = documents.checked_document(json.loads(path.read_text()))
    measurement = document["measurement"]
    results = [row for row in measurement["results"] if "error" not in row]
    rows = list(csv.DictReader(io.StringIO(exported(document, "csv", units))))
    assert len(rows) == sum(len(row["slices"]) for row in results)
    features = json.loads(exported(document, "geojson", units))["features"]
    for feature, row in zip(features, measurement["results"]):
        assert feature["properties"]["name"] == row["name"]
        assert feature["properties"].get("volume_m3") == pytest.approx(row.get("volume_m3"))
    page = exported(document, "html", units)
    assert page.startswith("<!doctype html>")
    assert page.count("data:image/png;base64,") == sum(
        layer["relief"] is not None for layer in document["layers"]
    )
    assert saved_measurement(document).scale is None or 'id="scale"' in page


def test_webodm_lists_opens_renames_and_exports_it(host, path):
    saved = json.loads(path.read_text())["id"]
    task = host.tasks["Mine"]
    folder = host.assets("Mine") / "volcalc"
    folder.mkdir(exist_ok=True)
    shutil.copy(path, folder / f"{saved}.json")
    one = f"{API}/{task}/measurements/{saved}"
    try:
        rows = host.owner.get(f"{API}/{task}/measurements").json
        row = next(row for row in rows if row["id"] == saved)
        assert (row["readable"], row["name"], row["problem"]) == (True, path.stem, None)
        series = host.owner.get(f"{API}/{task}/series").json
        assert saved in {each["measurement"] for area in series["areas"] for each in area["rows"]}
        assert host.owner.get(one).json["measurement"]["schema"] == "quantify-client/2"
        for kind in ("csv", "geojson", "html"):
            assert host.owner.get(f"{one}/export?format={kind}").status == 200
        assert host.owner.ask("PATCH", one, {"name": "kept"}).status == 200
        assert host.owner.get(one).json["name"] == "kept"
    finally:
        host.owner.ask("DELETE", one)
