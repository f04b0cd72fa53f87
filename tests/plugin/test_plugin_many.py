"""A task with as many and as large measurements as an all.zip can bring: lists do not read them."""

import copy
import json
import os
import random
import subprocess
import sys
import time
from pathlib import Path

import pytest
from visitors import API

PLUGIN = Path(__file__).parents[2] / "plugin"
SIZE = 7_100_000
LISTED = """
import importlib, json, resource, sys, time, types

package = types.ModuleType("volcalc_alone")
package.__path__ = [sys.argv[1], sys.argv[1] + "/.."]
sys.modules["volcalc_alone"] = package
store = importlib.import_module("volcalc_alone.files.store")
entries = importlib.import_module("volcalc_alone.files.list_rows")
task = types.SimpleNamespace(assets_path=lambda *parts: "/".join([sys.argv[2], *parts]))
peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
began, budget, rows = time.process_time(), entries.Budget(), []
for saved, path, _ in store.saved_paths(task):
    try:
        rows.append(entries.entry_of(path, saved, budget))
    except (entries.UnreadError, entries.TooLargeError) as error:
        rows.append(str(error))
seconds = time.process_time() - began
grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - peak
print(json.dumps({"seconds": seconds, "kilobytes": grown, "rows": rows}))
"""


COMPARABLE = {
    **{"shape": "terrain", "method": "terrain", "method_revision": 1, "base": None},
    **{"scale": "cloud", "settings": {}},
}


def filled(document, kind):
    """Return a valid document of SIZE bytes: its bulk is lines on the map, or slices."""
    chance, document = random.Random(3), copy.deepcopy(document)
    if kind == "lines":
        feature = document["layers"][0]["outlines"]["features"][0]
        corner = [-91.9941234, 46.8421234]
        number = SIZE // 200 // (len(json.dumps(corner)) + 2)
        features = [copy.deepcopy(feature) for _ in range(40)]
        for feature in features:
            feature["geometry"]["coordinates"] = [
                [[round(x + chance.random() * 1e-4, 7) for x in corner] for _ in range(number)]
                for _ in range(5)
            ]
        document["layers"][0]["outlines"]["features"] = features
    else:
        (result,) = document["measurement"]["results"]
        piece = result["slices"][:1]
        number = SIZE // (len(json.dumps(piece)) + 1) // 60
        result["slices"] = piece * number
        document["measurement"]["results"] = [result] * 60
    return document


def plant(folder, document, *, head):
    """Write a hundred copies of a document as an all.zip would bring them."""
    folder.mkdir(exist_ok=True)
    if head:
        summary = {
            **dict.fromkeys(("volume_m3", "cut_m3", "fill_m3", "std_m3", "base")),
            **{"results": 1, "volume_m3": 1.5, "shape": "terrain", "comparable": COMPARABLE},
        }
        keys = ("id", "name", "date", "area_key", "options")
        document = {
            "entry": {**{key: document[key] for key in keys}, "summary": summary},
            **document,
        }
    text = json.dumps(document).encode()
    saved = [f"{place:032x}" for place in range(100)]
    for one in saved:
        (folder / f"{one}.json").write_bytes(text.replace(document["id"].encode(), one.encode()))
    return saved


@pytest.fixture(scope="module", params=["lines", "lines with heads", "slices"])
def crowded(request, host, kept):
    """The public task with a hundred large files; without heads an older version saved them."""
    kind = request.param.split()[0]
    document = filled(kept, kind)
    assert 0.9 * SIZE < len(json.dumps(document)) < 8_000_000
    folder = host.assets("Public") / "volcalc"
    before = set(folder.glob("*.json")) if folder.exists() else set()
    saved = plant(folder, document, head=request.param.endswith("heads"))
    yield host.tasks["Public"], saved, request.param
    for path in set(folder.glob("*.json")) - before:
        path.unlink()


def test_hundred_large_files_are_listed_in_no_time(host, crowded):
    _, saved, kind = crowded
    found = subprocess.run(
        [sys.executable, "-c", LISTED, str(PLUGIN), str(host.assets("Public"))],
        capture_output=True,
        text=True,
        check=True,
    )
    told = json.loads(found.stdout)
    assert told["seconds"] < 0.5
    assert told["kilobytes"] < 50_000
    assert len(told["rows"]) >= 100
    if kind == "lines with heads":
        told = {row["id"]: row for row in told["rows"]}
        assert {told[one]["summary"]["volume_m3"] for one in saved} == {1.5}
    elif kind == "slices":
        assert any("open it" in row for row in told["rows"])


def test_anybody_may_list_and_open_them(host, crowded):
    task, saved, kind = crowded
    root = f"{API}/{task}"
    for path in ("measurements", "series", ""):
        began = time.perf_counter()
        assert host.nobody.get(f"{root}/{path}").status == 200
        assert time.perf_counter() - began < 5.0  # 0.1 s on a machine that does nothing else
    rows = {row["id"]: row for row in host.nobody.get(f"{root}/measurements").json}
    assert all(rows[one]["readable"] for one in saved)
    one = host.nobody.get(f"{root}/measurements/{saved[-1]}")
    if kind == "slices":
        assert "open it" in rows[saved[0]]["problem"]
    if kind == "lines with heads":
        assert one.status == 422  # the heads are made up
    else:
        assert one.status == 200, one.error
        assert one.json["id"] == saved[-1]


def test_no_more_than_two_documents_are_read_at_once(host, beach_task, kept):
    """Each takes a part of a second and up to 150 MB, and anybody may ask."""
    import fcntl

    locks = [(host.jobs / f".reading{place}").open("w") for place in ("", "1")]
    try:
        for lock in locks:
            fcntl.flock(lock, fcntl.LOCK_EX)
        began = time.perf_counter()
        found = host.viewer.get(f"{API}/{beach_task}/measurements/{kept['id']}")
        assert found.status == 503
        assert time.perf_counter() - began < 3.0  # who waits keeps one of WebODM's few workers
        assert "try again" in found.error
        assert int(found.headers["Retry-After"]) > 0
        assert host.viewer.get(f"{API}/{beach_task}/measurements").status == 200
        fcntl.flock(locks[0], fcntl.LOCK_UN)
        assert host.viewer.get(f"{API}/{beach_task}/measurements/{kept['id']}").status == 200
    finally:
        for lock in locks:
            lock.close()


def test_what_lists_tell_is_checked_when_it_is_opened(host, beach_task, kept):
    path = host.assets("Beach") / "volcalc" / f"{'c' * 32}.json"
    text = (host.assets("Beach") / "volcalc" / f"{kept['id']}.json").read_text()
    assert text.startswith('{"entry": {"id"')
    lying = json.loads(text.replace(kept["id"], "c" * 32))
    lying["entry"]["summary"]["volume_m3"] += 1.0
    root = f"{API}/{beach_task}/measurements"
    try:
        path.write_text(json.dumps(lying))
        (row,) = (row for row in host.viewer.get(root).json if row["id"] == "c" * 32)
        assert row["readable"] is True
        found = host.viewer.get(f"{root}/{'c' * 32}")
        assert found.status == 422
        assert "what lists tell" in found.error
        for broken in ({"name": 7}, {"summary": {}}, {"id": "d" * 32}, {"options": {"a": {}}}):
            head = {**lying["entry"], **broken}
            path.write_text(json.dumps({**lying, "entry": head}))
            (row,) = (row for row in host.viewer.get(root).json if row["id"] == "c" * 32)
            assert row["readable"] is False
            assert host.viewer.get(f"{root}/{'c' * 32}").status == 422
    finally:
        path.unlink()


@pytest.mark.parametrize("dense", ["[],", "{},", "0,", '{"":0},', "[[[]]],"])
def test_file_that_would_fill_the_memory_is_refused(host, kept, dense):
    folder = host.assets("Beach") / "volcalc"
    path = folder / f"{'b' * 32}.json"
    path.write_text('{"x": [' + dense * (7_000_000 // len(dense)) + "0]}")
    began = time.perf_counter()
    try:
        found = host.viewer.get(f"{API}/{host.tasks['Beach']}/measurements/{'b' * 32}")
    finally:
        path.unlink()
    assert found.status == 422
    assert "too many values" in found.error
    assert time.perf_counter() - began < 5.0


def test_pipe_in_the_place_of_a_file_keeps_nobody_waiting(host, beach_task, kept):
    path = host.assets("Beach") / "volcalc" / f"{'a' * 32}.json"
    os.mkfifo(path)
    try:
        found = host.viewer.get(f"{API}/{beach_task}/measurements/{'a' * 32}")
        ids = [row["id"] for row in host.viewer.get(f"{API}/{beach_task}/measurements").json]
    finally:
        path.unlink()
    assert found.status == 404
    assert "a" * 32 not in ids


def test_link_in_the_place_of_the_folder_leads_nowhere(host, kept):
    task, place = host.tasks["Mine"], host.assets("Mine") / "volcalc"
    job = host.owner.measured(task)["id"]
    away = place.rename(place.with_name("away")) if place.exists() else None
    place.symlink_to(host.assets("Beach") / "volcalc")
    one = f"{API}/{task}/measurements/{kept['id']}"
    try:
        assert host.owner.get(f"{API}/{task}/measurements").json == []
        assert host.owner.get(one).status == 404
        assert host.owner.ask("DELETE", one).status == 409
        assert host.owner.post(f"{API}/{task}/measurements", {"job": job}).status == 409
    finally:
        place.unlink()
        if away:
            away.rename(place)


def test_folder_with_thousands_of_files_is_not_listed_whole(host, beach_task, kept):
    folder = host.assets("Beach") / "volcalc"
    junk = [folder / f"{place}.json" for place in range(2500)]
    job = host.owner.measured(beach_task)["id"]
    try:
        for path in junk:
            path.touch()
        assert host.viewer.get(f"{API}/{beach_task}/measurements").status == 200
        found = host.owner.post(f"{API}/{beach_task}/measurements", {"job": job})
        assert found.status == 409
        assert "2000 files" in found.error
    finally:
        for path in junk:
            path.unlink()
