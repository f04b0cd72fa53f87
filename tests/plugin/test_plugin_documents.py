"""Whatever passes the check of a saved document can be listed, shown and exported."""

import copy
import gc
import importlib
import json
import random
import sys
import types
from pathlib import Path

import pytest
from visitors import ROUND

from quantify_client import measure, to_json
from quantify_client.options import DEFAULT_BASE, METHOD_REVISION
from quantify_client.report.document.saved_export import exported
from quantify_client.webmap.layers import map_layers

PLUGIN = Path(__file__).parents[2] / "plugin"
VALUES = [
    *(0, -0.0, 1, -1, 0.5, 1e15, -1e15, 1e-300, 1e-9, 10**15, 10**16, 1e300, None, True),
    *("", "x", "\u202e<b>", "=1+1", "scale", "distance", [], {}, [None]),
]


@pytest.fixture(scope="module")
def documents():
    """The plugin's module, without WebODM."""
    package = types.ModuleType("volcalc_alone")
    package.__path__ = [str(PLUGIN), str(PLUGIN.parent)]
    sys.modules["volcalc_alone"] = package
    yield importlib.import_module("volcalc_alone.files.saved")
    for name in [name for name in sys.modules if name.startswith("volcalc_alone")]:
        del sys.modules[name]


@pytest.fixture(scope="module")
def entries(documents):
    """The plugin's module of what lists tell."""
    return importlib.import_module("volcalc_alone.files.list_rows")


CONTROL = """
unit: m
points: {A: {lat: 46.84237, lon: -91.99386, accuracy: 3.0, elevation: 160.8,
             elevation_accuracy: 0.05}, B: {lat: 46.8425, lon: -91.994, accuracy: 3.0}}
distances: [{from: A, to: B, length: 18.2, accuracy: 0.02}]
cloud: {A: {xyz: [576716.8, 5188138.9, 160.8], accuracy: 0.05},
        B: {xyz: [576705.9, 5188153.2, 161.2], accuracy: 0.05}}
"""


@pytest.fixture(scope="module")
def document(pytestconfig, tmp_path_factory):
    cloud = pytestconfig.rootpath / "quantify_client" / "demo" / "brighton_beach.laz"
    control = tmp_path_factory.mktemp("control") / "control.yaml"
    control.write_text(CONTROL)
    found = measure(cloud, area=ROUND, base="compare", gcp=control, scale_mode="scale", slices=6)
    made = {
        "schema": "volcalc-measurement/2",
        "id": "0" * 32,
        "name": "Pile 1",
        "date": "2024-05-01T10:00:00Z",
        "task": "t",
        "project": 1,
        "area": {"type": "FeatureCollection", "features": [ROUND]},
        "options": {"base": "compare", "slices": 6},
        "source": "laz",
        "measurement": to_json(found),
        "layers": map_layers(found),
    }
    return json.loads(json.dumps(made))


def places(node, path=()):
    """Yield the way to every value."""
    inner = node.items() if isinstance(node, dict) else enumerate(node[:4])
    for key, value in inner:
        yield (*path, key)
        if isinstance(value, (dict, list)):
            yield from places(value, (*path, key))


def test_what_was_made_passes_the_check(documents, document):
    found = documents.checked_document(copy.deepcopy(document))
    assert found["measurement"] == document["measurement"]
    assert found["layers"] == document["layers"]


def test_what_passes_the_check_can_be_shown(documents, entries, document):
    chance = random.Random(5)
    everywhere = list(places(document))
    shown = 0
    for _ in range(250):
        changed = copy.deepcopy(document)
        *way, last = chance.choice(everywhere)
        node = changed
        for key in way:
            node = node[key]
        node[last] = copy.deepcopy(chance.choice(VALUES))
        try:
            checked = documents.checked_document(changed)
        except documents.MisshapenError:
            continue
        shown += 1
        json.dumps(entries.entry_from(checked), allow_nan=False)
        for kind in ("csv", "geojson", "html"):
            exported(checked, kind, chance.choice(["metric", "us"])).encode()
    assert shown > 20


@pytest.fixture(scope="module")
def comparable_of(documents):
    return importlib.import_module("volcalc_alone.files.summary").comparable_of


def test_volumes_of_one_quantity_are_comparable(documents, comparable_of, document):
    checked = documents.checked_document(copy.deepcopy(document))
    assert comparable_of(checked) == {
        "shape": "terrain",
        "method": "terrain",
        "base": DEFAULT_BASE,
        "method_revision": METHOD_REVISION,
        "scale": "control",
        "settings": {},
    }
    later = copy.deepcopy(checked)
    later.update(id="1" * 32, date="2025-05-01T10:00:00Z", source="ept")
    later["options"].update(slices=9, density=1.7, density_sigma=0.1, base=DEFAULT_BASE)
    later["options"].update(hollow=False, floor="auto", area_frame="cloud")
    later["measurement"]["provenance"]["version"] = "0.2.0"
    later["measurement"]["results"][0]["volume_m3"] += 5.0
    assert comparable_of(later) == comparable_of(checked)


@pytest.mark.parametrize(
    ("way", "value", "key"),
    [
        (("measurement", "results", 0, "base"), "plane", "base"),
        (("measurement", "results", 0, "base"), 160.0, "base"),
        (("measurement", "method_revision"), METHOD_REVISION + 1, "method_revision"),
        (("measurement", "scale"), None, "scale"),
        (("measurement", "method"), "polar", "method"),
        (("measurement", "shape"), "object", "shape"),
        (("options", "grid"), True, "settings"),
        (("options", "hollow"), True, "settings"),
        (("options", "layer"), "lower", "settings"),
        (("options", "floor"), 0.0, "settings"),
        (("options", "area_frame"), "control", "settings"),
    ],
)
def test_volumes_of_other_quantities_are_not(documents, comparable_of, document, way, value, key):
    checked = documents.checked_document(copy.deepcopy(document))
    other = copy.deepcopy(checked)
    node = other
    for step in way[:-1]:
        node = node[step]
    node[way[-1]] = value
    one, two = comparable_of(checked), comparable_of(other)
    assert [name for name in one if one[name] != two[name]] == [key]


def test_areas_on_different_bases_are_told_each(documents, comparable_of, document):
    checked = documents.checked_document(copy.deepcopy(document))
    (result,) = checked["measurement"]["results"]
    failed = {"name": "b", "error": "no points", "base": {"of": "a stranger"}}
    for results, base in [
        ([result, {**result, "base": "plane"}], [DEFAULT_BASE, "plane"]),
        ([result, failed], [DEFAULT_BASE, None]),
        ([failed, failed], None),
        ([result, result], DEFAULT_BASE),
    ]:
        checked["measurement"]["results"] = results
        assert comparable_of(checked)["base"] == base


def test_elevation_of_a_base_counts_to_the_millimetre(documents, comparable_of, document):
    found = []
    for elevation in (160.0, 160.0 + 1e-9, 160.001):
        other = documents.checked_document(copy.deepcopy(document))
        other["measurement"]["results"][0]["base"] = elevation
        found.append(comparable_of(other))
    assert found[0] == found[1] != found[2]


def test_result_of_a_version_that_told_no_revision_is_of_the_first(
    documents, entries, document, tmp_path
):
    """Also where such a version wrote a head: it does not tell what is comparable."""
    path = tmp_path / f"{document['id']}.json"
    old = copy.deepcopy(document)
    del old["measurement"]["method_revision"]
    head = entries.entry_from(documents.checked_document(copy.deepcopy(document)))
    del head["summary"]["comparable"]
    path.write_text(json.dumps({"head": head, **old}))
    entry = entries.entry_of(path, document["id"], entries.Budget())
    assert entry["summary"]["comparable"]["method_revision"] == 1
    task = types.SimpleNamespace(id="t", project=types.SimpleNamespace(pk=1))
    found = documents.read_document(path, document["id"], task)
    assert found["measurement"]["method_revision"] == 1
    assert "head" not in found


def test_entry_comes_from_the_head_of_a_file(documents, entries, document, tmp_path):
    path = tmp_path / f"{document['id']}.json"
    checked = documents.checked_document(copy.deepcopy(document))
    documents.write_document(path, checked)
    budget = entries.Budget()
    before = budget.left
    entry = entries.entry_of(path, document["id"], budget)
    assert entry == json.loads(json.dumps(entries.entry_from(checked)))
    assert entry["summary"]["volume_m3"] == document["measurement"]["results"][0]["volume_m3"]
    assert budget.left == before
    with pytest.raises(documents.MisshapenError, match="another id"):
        entries.entry_of(path, "1" * 32, budget)


def test_file_of_an_older_version_is_read_once_until_it_is_another(
    documents, entries, document, tmp_path
):
    path, budget = tmp_path / f"{document['id']}.json", entries.Budget()
    path.write_text(json.dumps(document))
    before = budget.left
    first = entries.entry_of(path, document["id"], budget)
    assert first["summary"]["volume_m3"] == document["measurement"]["results"][0]["volume_m3"]
    first["summary"].clear()
    assert budget.left == before - path.stat().st_size
    assert entries.entry_of(path, document["id"], budget)["summary"]
    assert budget.left == before - path.stat().st_size
    path.write_text(json.dumps({**document, "name": "another"}))
    assert entries.entry_of(path, document["id"], budget)["name"] == "another"
    path.write_text("{}")
    with pytest.raises(documents.MisshapenError):
        entries.entry_of(path, document["id"], budget)
    path.unlink()
    with pytest.raises(importlib.import_module("volcalc_alone.files.store").UnreadableError):
        entries.entry_of(path, document["id"], budget)


def test_list_ends_reading_at_its_budget_and_goes_on_with_the_next(entries, document, tmp_path):
    paths = [tmp_path / f"{place:032x}.json" for place in range(170)]
    for path in paths:
        path.write_text(json.dumps({**document, "id": path.stem}))
    size, told, requests = paths[0].stat().st_size, [], 0
    while len(told) < len(paths):
        requests, budget, told = requests + 1, entries.Budget(), []
        assert requests < 20
        for path in paths:
            try:
                told.append(entries.entry_of(path, path.stem, budget))
            except entries.UnreadError:
                continue
    assert requests == -(-len(paths) // (entries._BUDGET // size)) > 1


def told(entries, paths):
    """Return what one request is told of each file: its name, or the kind of error."""
    budget, found = entries.Budget(), []
    for path in paths:
        try:
            found.append(entries.entry_of(path, path.stem, budget)["name"])
        except Exception as error:
            found.append(type(error).__name__)
    return found


def with_slices(document, number):
    """Return a valid document whose bulk, the slices, comes before its layers."""
    document = copy.deepcopy(document)
    (result,) = document["measurement"]["results"]
    whole, rest = divmod(number, 2000)
    document["measurement"]["results"] = [
        {**result, "slices": result["slices"][:1] * some} for some in [2000] * whole + [rest]
    ]
    return document


def test_long_files_of_an_older_version_are_all_told_in_the_end(
    entries, documents, document, tmp_path
):
    long = with_slices(document, 6000)
    documents.checked_document(copy.deepcopy(long))
    paths = [tmp_path / f"{place:032x}.json" for place in range(20)]
    for path in paths:
        path.write_text(json.dumps({**long, "id": path.stem}))
    assert 300_000 < paths[0].stat().st_size < 1_000_000
    before, requests = 0, 0
    while before < len(paths):
        requests += 1
        now = told(entries, paths).count(document["name"])
        assert now > before  # each request goes on, whatever the one before left
        before = now
    assert requests <= 10


def test_files_that_nothing_can_be_told_of_do_not_keep_the_others_from_it(
    entries, document, tmp_path
):
    bad = json.dumps({**with_slices(document, 1000), "schema": "another"})
    huge = json.dumps(with_slices(document, 30_000))
    assert len(bad) < 256_000 < 2_000_000 < len(huge) < 8_000_000
    paths = [tmp_path / f"{place:032x}.json" for place in range(60)]
    good = json.dumps({**document, "id": paths[-1].stem})
    for place, path in enumerate(paths):
        path.write_text(bad if place < 30 else huge if place < 59 else good)
    answers = [told(entries, paths) for _ in range(20)]
    assert answers[0].count("UnreadError") > 20
    assert answers[-1] == [*["MisshapenError"] * 30, *["TooLargeError"] * 29, document["name"]]


def test_collector_is_away_while_a_file_is_parsed_and_back_afterwards(documents):
    """In a web process, whose heap is large, it took longer than the parsing."""
    data = b"[" + b"[-91.1234567, 46.1234567]," * 100_000 + b"0]"
    before = gc.get_stats()[0]["collections"]
    documents.parsed(data)
    assert gc.get_stats()[0]["collections"] - before < 10
    with pytest.raises(documents.MisshapenError):
        documents.parsed(data[:-1])
    assert gc.isenabled()


def test_number_of_a_million_digits_takes_no_time(documents):
    """Python takes minutes to read one, or a limit that older ones lack."""
    data = b'{"a": ' + b"1" * 1_000_000 + b"}"
    with pytest.raises(documents.MisshapenError, match="absurdly large"):
        documents.parsed(data)
