"""Requests that are wrong, or hostile: refused with a status and one line."""

import json

import pytest
from visitors import API, ROUND


def ring(corners):
    return {"type": "Polygon", "coordinates": [corners]}


MANY = [[-91.994 + i * 1e-9, 46.842] for i in range(10_001)]
SQUARE = [[-91.994, 46.8422], [-91.9938, 46.8422], [-91.9938, 46.8424]]
BAR = {"from": [-91.994, 46.842], "to": [-91.993, 46.842], "length_m": 2.0, "accuracy_m": 0.01}
DEEP = b'{"area": ' + b"[" * 100_000 + b"]" * 100_000 + b"}"
NESTED = {"type": "GeometryCollection", "geometries": []}
for _ in range(12):
    NESTED = {"type": "GeometryCollection", "geometries": [NESTED]}


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ({}, 'GeoJSON, "crop", "auto" or "whole"'),
        ({"area": "all"}, 'GeoJSON, "crop", "auto" or "whole"'),
        ({"area": 7}, "GeoJSON"),
        ({"area": {}}, "no polygon"),
        ({"area": {"type": "Point", "coordinates": [0, 0]}}, "no polygon"),
        ({"area": {"type": "FeatureCollection", "features": []}}, "holds no polygon"),
        ({"area": {"type": "FeatureCollection", "features": {}}}, "without features"),
        ({"area": {"type": "FeatureCollection", "features": [ROUND] * 101}}, "100 polygons"),
        ({"area": ring(SQUARE[:2])}, "fewer than 3 corners"),
        ({"area": ring([[576710.0, 5188138.0], *SQUARE])}, "EPSG:4326"),
        ({"area": ring([[46.8, -91.9], *SQUARE])}, "EPSG:4326"),
        ({"area": ring([["x", 1], *SQUARE])}, "longitude and latitude"),
        ({"area": ring([[10**400, 1], *SQUARE])}, "longitude and latitude"),
        ({"area": ring([[True, 1], *SQUARE])}, "longitude and latitude"),
        ({"area": ring(MANY)}, "10000"),
        ({"area": {**ROUND, "crs": {"properties": {"name": "EPSG:32615"}}}}, "EPSG:4326"),
        ({"area": NESTED}, "not GeoJSON"),
        ({"area": {**ROUND, "properties": {"name": "x" * 1_000_000}}}, "1000000 bytes"),
        ({"area": ROUND, "path": "/etc/passwd"}, "unknown key 'path'"),
        ({"area": ROUND, "options": []}, "options has to be an object"),
        ({"area": ROUND, "options": {"threads": 64}}, "unknown key 'threads'"),
        ({"area": ROUND, "options": {"gcp": "/etc/passwd"}}, "unknown key 'gcp'"),
        ({"area": ROUND, "options": {"density": -1}}, "above 0"),
        ({"area": ROUND, "options": {"density": "2"}}, "a number"),
        ({"area": ROUND, "options": {"density_sigma": 0.1}}, "goes with density"),
        ({"area": ROUND, "options": {"slices": 0}}, "at least 1"),
        ({"area": ROUND, "options": {"slices": 2.5}}, "a whole number"),
        ({"area": ROUND, "options": {"slices": 5, "slice_height": 1}}, "exclude"),
        ({"area": ROUND, "options": {"slice_height": 10**300}}, "absurdly large"),
        ({"area": ROUND, "options": {"base": "/etc/passwd"}}, "options.base"),
        ({"area": ROUND, "options": {"shape": "object"}}, "measured whole"),
        ({"area": ROUND, "options": {"hollow": True}}, "measured whole"),
        (
            {"area": "whole", "options": {"shape": "object", "base": "plane"}},
            "go with shape terrain",
        ),
        ({"area": ROUND, "options": {"scale_mode": "full"}}, "go with control: give"),
        (
            {"area": "whole", "options": {"method": "polar", "hollow": True}},
            "hollow, max-gap, cameras, floor and accuracy go with method",
        ),
        ({"area": ROUND, "control": "text"}, "an object"),
        ({"area": ROUND, "control": {"text": "x" * 200_001}}, "200000"),
        ({"area": ROUND, "control": {"text": "x", "name": "c.exe"}}, "has to end in"),
        ({"area": ROUND, "control": {"scale_bars": []}}, "1 to 50"),
        ({"area": ROUND, "control": {"scale_bars": [{**BAR, "length_m": 0}]}}, "above 0"),
        ({"area": ROUND, "control": {"scale_bars": [BAR], "text": "x"}}, "unknown key 'text'"),
        (b"[1, 2]", "a JSON object"),
        (b"{", "not valid JSON"),
        (b'{"area": NaN}', "NaN"),
        (b"\xff\xfe", "UTF-8"),
        (b'{"\\ud800": 1}', "UTF-8"),
        (b'{"\\ud83d\\ude00": 1}', "unknown key"),
        (DEEP, "nested too deeply"),
    ],
)
def test_wrong_request_is_told_in_one_line(host, beach_task, body, words):
    found = host.owner.ask("POST", f"{API}/{beach_task}/jobs", body)
    assert found.status == 400, found.body
    assert words in found.error
    assert "\n" not in found.error


def test_body_that_is_too_large_or_no_json_is_refused(host, beach_task):
    jobs = f"{API}/{beach_task}/jobs"
    assert host.owner.ask("POST", jobs, b'"' + b"x" * 2_600_000 + b'"').status == 413
    assert host.owner.ask("POST", jobs, b"area=1", kind="x-www-form-urlencoded").status == 415


def test_task_without_crop_says_so(host):
    task = host.tasks["Beach LAZ"]
    assert host.owner.post(f"{API}/{task}/jobs", {"area": {"type": "crop"}}).status == 400


@pytest.mark.parametrize("name", ["", "   ", "\x00\x01", 7, None, ["x"]])
def test_measurement_needs_a_name(host, beach_task, kept, name):
    one = f"{API}/{beach_task}/measurements/{kept['id']}"
    assert host.owner.ask("PATCH", one, {"name": name}).status == 400


def test_control_file_cannot_name_files_of_the_server(host, beach_task):
    secret = host.data / "db.sqlite3"
    for text in (f"images: {secret}\n", f"points: {secret}\n", "cloud: ../job.json\n"):
        asked = {"area": ROUND, "control": {"text": text, "name": "c.yaml"}}
        job = host.owner.post(f"{API}/{beach_task}/jobs", asked).json["job"]
        state = host.owner.wait(beach_task, job)
        assert state["state"] == "failed"
        assert "names another file" in state["error"]
        assert str(host.data) not in state["error"]


def test_what_the_library_refuses_is_told_without_paths_and_dashes(host, beach_task):
    asked = {"area": "whole", "options": {"shape": "object", "floor": 900.0}}
    job = host.owner.post(f"{API}/{beach_task}/jobs", asked).json["job"]
    state = host.owner.wait(beach_task, job)
    assert state["state"] == "failed"
    assert "give floor Z below it, or floor none, or shape terrain" in state["error"]
    result = host.owner.get(f"{API}/{beach_task}/jobs/{job}/result")
    assert (result.status, result.json["state"]) == (409, "failed")
    saved = host.owner.post(f"{API}/{beach_task}/measurements", {"job": job, "name": "x"})
    assert saved.status == 409
    assert json.loads(saved.body)["error"]
