"""Damaged job folders: whatever stands in their files, one sentence, and nothing done by halves."""

import copy
import json
import os
import random
import shutil

import pytest
from nodeodm import TOKEN, NodeODM
from pace import PACE
from photographs import all_zip, photographs

from quantify_client.cli import main
from quantify_client.jobs import create_job, plan_job, run_job

# Servers, sizes and words: no different on a second Python.
pytestmark = pytest.mark.one_python

SEEDS = int(os.environ.get("QUANTIFY_DAMAGE", "1"))
VALUES = [
    *(None, True, False, -1, 0, 1, 3, 0.5, 10**30, -(10**400), 1e308, float("nan"), float("inf")),
    *("", "x", "../../../etc/passwd", "a\x00b", "\x1b[31m\n", "\ud800", "a" * 5000, "http://[::1"),
    *("done", "ready", "waiting", "fetching", "uploading", "spoiled", "webodm", "node", "area"),
    *(
        [],
        {},
        [[]],
        [None],
        {"a": [1]},
        [{"name": 1}],
        {"options": []},
        {"options": {"slices": {}}},
    ),
    {"options": {"density": -5, "floor": 10**400}},
    {"options": {"base": 10**400, "shape": "round"}, "units": []},
]


def places(document, path=()):
    """Every place in a document, as the keys that lead to it."""
    yield path
    if isinstance(document, (dict, list)):
        pairs = document.items() if isinstance(document, dict) else enumerate(document)
        for key, value in pairs:
            yield from places(value, (*path, key))


def changed(document, path, value, *, drop):
    """The document with one value replaced or left out."""
    document = copy.deepcopy(document)
    if not path:
        return value
    parent = document
    for key in path[:-1]:
        parent = parent[key]
    if drop:
        del parent[path[-1]]
    else:
        parent[path[-1]] = value
    return document


def damaged_texts(text, rng, count):
    """Journals with one value replaced or missing, or with damaged bytes."""
    document = json.loads(text)
    spots = list(places(document))
    for _ in range(count):
        kind = rng.random()
        if kind < 0.75:
            value, path = rng.choice(VALUES), rng.choice(spots)
            yield json.dumps(changed(document, path, value, drop=kind < 0.1)).encode()
        elif kind < 0.9:
            data = bytearray(text.encode())
            for _ in range(rng.randint(1, 6)):
                data[rng.randrange(len(data))] = rng.randrange(256)
            yield bytes(data)
        else:
            yield text.encode()[: rng.randrange(len(text))]
    yield b'{"schema":' + b"[" * 200_000
    yield b'{"schema": "quantify-job/1", "state": ' + b"9" * 10_000 + b"}"


@pytest.fixture(scope="module")
def jobs(tmp_path_factory):
    """A job at its beginning, one that waits and one that is finished; and their node."""
    root = tmp_path_factory.mktemp("damaged")
    images = photographs(root / "photos", 3)
    with NodeODM(root / "node", archive=all_zip(size=2000), token=TOKEN).running() as node:
        plan = plan_job(images, node.url, TOKEN)
        then = {"options": {"shape": "auto", "slices": 5, "gcp": None}, "units": "metric"}
        for name in ("ready", "waiting", "done"):
            create_job(plan, root / name, then)
        run_job(root / "done", TOKEN, pace=PACE)
        (root / "done" / "report").mkdir()
        (root / "done/report/report.json").write_text('{"results": [{"name": "a", "error": "e"}]}')
        node.script = [(30, 1.0, "out of memory")]
        with pytest.raises(RuntimeError):
            run_job(root / "waiting", TOKEN, pace=PACE)
        yield root, node


def resumed(folder, node, capsys, *more):
    """Go on as somebody does who knows the server and where the photographs are."""
    named = ("--node", node.url, "--images", folder.parent / "photos", "--patience", "0")
    status = main([str(part) for part in ("resume", folder, *named, "--token", TOKEN, *more)])
    out, err = capsys.readouterr()
    assert status in (0, 1), (status, err)
    assert "bug" not in err
    assert "Traceback" not in err
    if status:
        assert err.splitlines()[-1].startswith("quantify-client: error: ")
    return status, out, err


@pytest.mark.parametrize("seed", range(SEEDS))
@pytest.mark.parametrize(
    ("state", "name"),
    [
        *(("ready", "job.json"), ("waiting", "job.json"), ("done", "job.json")),
        *(("waiting", "sent-1.jsonl"), ("done", "sent-1.jsonl"), ("done", "report/report.json")),
    ],
)
def test_damage_is_told_in_one_sentence(jobs, capsys, monkeypatch, seed, state, name):
    root, node = jobs
    monkeypatch.setattr("quantify_client.commands.jobs.PACE", PACE)
    source, folder = root / state, root / "damaged"
    rng = random.Random(f"{seed} {state} {name}")
    text = (source / name).read_text().rstrip(" ")
    lines = text.splitlines()
    text = json.dumps([json.loads(line) for line in lines]) if "jsonl" in name else text
    for data in damaged_texts(text, rng, 40):
        shutil.copytree(source, folder)
        if "jsonl" in name:
            data = data.strip(b"[]").replace(b"}, ", b"}\n")
        (folder / name).write_bytes(data)
        before = sorted(os.listdir(root))
        more = rng.choice([(), (), ("--cancel",), ("--resubmit",), ("--json",)])
        resumed(folder, node, capsys, *more)
        assert sorted(os.listdir(root)) == before
        shutil.rmtree(folder)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"attempt": -3}, "job.attempt has to be at least 0"),
        ({"attempt": "../../x"}, "job.attempt has to be a whole number, not str"),
        ({"attempt": True}, "job.attempt has to be a whole number, not bool"),
        ({"uuid": "../../admin"}, "expected a UUID"),
        ({"state": "unknown"}, "job.state has to be one of ready"),
        ({"state": {}}, "job.state has to be a text, not dict"),
        ({"url": "file:///etc/passwd"}, "the address of a server"),
        ({"url": "http://me:hush@host"}, "the address of a server"),
        ({"files": [{"name": "a"}]}, "job.files[0] lacks 'path'"),
        (
            {"files": [{"name": "../a.JPG", "path": "/a", "size": 1, "mtime_ns": 1}]},
            "a file's name",
        ),
        ({"files": [{"name": "a\x1b.JPG", "path": "/a", "size": 1, "mtime_ns": 1}]}, "file's name"),
        ({"files": 2 * [{"name": "a", "path": "/a", "size": 1, "mtime_ns": 1}]}, "the same name"),
        ({"then": {"a": float("nan")}}, "job.then.a has to be finite"),
        ({"options": {"dsm": {"a": 1}}}, "job.options.dsm has to be a text, not dict"),
        ({"project": 3}, "its project is 3, which its server is not"),
        ({"archive_bytes": -1}, "job.archive_bytes has to be at least 0"),
        ({"outputs": "all"}, "job.outputs has to be a list, not str"),
        ({"colour": "red"}, "'colour', which this version does not know"),
        ({"then": {"units": "furlongs"}}, "'units'"),
        ({"then": {"options": {"area": 5}}}, "'area'"),
        ({"then": {"options": {"slices": 0}}}, "--slices is 0"),
        ({"then": {"options": {"threads": 1_000_000}}}, "--threads is 1000000"),
    ],
)
def test_what_is_wrong_is_named(jobs, capsys, changes, said):
    root, node = jobs
    folder = root / "named"
    shutil.copytree(root / "ready", folder)
    try:
        document = json.loads((folder / "job.json").read_text())
        (folder / "job.json").write_text(json.dumps({**document, **changes}))
        status, out, err = resumed(folder, node, capsys)
        assert (status, out, err.count("\n")) == (1, "", 1)
        assert said in err
        assert "hush" not in err
        assert "\x1b" not in err
    finally:
        shutil.rmtree(folder)
