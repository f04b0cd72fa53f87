"""Whatever a server's JSON holds: an answer that makes sense, or an error of ours."""

import copy
import itertools
import random

import pytest
from nodeodm import OPTIONS

from quantify_client.errors import QuantifyError
from quantify_client.sfm.servers.access import Access
from quantify_client.sfm.servers.nodeodm import NodeClient
from quantify_client.sfm.servers.presets import choose_options
from quantify_client.sfm.servers.webodm_tasks import WebODMTasks

# Servers, sizes and words: no different on a second Python.
pytestmark = pytest.mark.one_python

UUID = "6f1c2a34-0f3e-4b7a-9c55-0123456789ab"
VALUES = [
    *(None, True, False, -1, 0, 10, 40, 0.5, 10**30, 10**400, -1e308, float("nan"), float("inf")),
    *("", "x", "40", "\x1b[31m", "\ud800", "a" * 100_000, [], {}, [[]], [None], [1, 2], {"a": [1]}),
    *({"code": {}}, {"code": 10**400}, [{"id": []}], {"results": 5}, {"results": [3]}),
]
INFO = {"version": "2.2.4", "taskQueueCount": 1, "maxImages": 10, "engine": "odm", "cpuCores": 4}
NODE = {
    "/info": INFO,
    "/options": OPTIONS,
    "/task/new/init": {"uuid": UUID},
    f"/task/new/commit/{UUID}": {"uuid": UUID},
    f"/task/{UUID}/info": {
        **{"uuid": UUID, "status": {"code": 20, "errorMessage": "x"}, "processingTime": 5},
        **{"imagesCount": 3, "progress": 2.0},
    },
    f"/task/{UUID}/output": ["a", "b"],
    "/task/cancel": {"success": True},
}
TASK = {
    **{"id": UUID, "project": 1, "name": "m", "partial": True, "status": 20, "last_error": None},
    **{"pending_action": None, "upload_progress": 0.5, "running_progress": 0.5, "images_count": 3},
    **{"processing_time": 5, "processing_node": 1},
}
WEBODM = {
    "/api/projects/1/": {"id": 1, "permissions": ["change"]},
    "/api/processingnodes/": [
        {"id": 1, "online": True, "engine": "odm", "engine_version": "3", "max_images": 5}
    ],
    "/api/processingnodes/options/": OPTIONS,
    "/api/projects/1/tasks/": [TASK],
    f"/api/projects/1/tasks/{UUID}/": TASK,
    f"/api/projects/1/tasks/{UUID}/output/": "a\nb",
}


class Answering:
    """Stands for `Server`: one of its answers is replaced by, or holds, any value."""

    name, url, is_anonymous = "host", "http://host", False

    def __init__(self, answers, path, rng):
        self.answers = dict(answers)
        self.answers[path] = spoiled(answers[path], rng)

    def json(self, method, path, **rest):
        return self.answers.get(path, {"success": True})


def spoiled(document, rng):
    document = copy.deepcopy(document)
    where, key = None, None
    while isinstance(document if where is None else where[key], (dict, list)):
        inner = document if where is None else where[key]
        if not inner or rng.random() < 0.2:
            break
        where, key = (
            inner,
            rng.choice(list(inner) if isinstance(inner, dict) else range(len(inner))),
        )
    if where is None:
        return rng.choice(VALUES)
    if isinstance(where, dict) and rng.random() < 0.2:
        del where[key]
    else:
        where[key] = rng.choice(VALUES)
    return document


CALLS = {
    "info": lambda server: server.info(),
    "engine": lambda server: server.engine().words,
    "options": lambda server: choose_options(server.options(), given={"crop": "1", "split": "3"}),
    "init": lambda server: server.init(UUID, "n", {"dsm": True}),
    "commit": lambda server: server.commit(UUID),
    "is_committed": lambda server: server.is_committed(UUID),
    "task": lambda server: server.task(UUID),
    "output": lambda server: server.output(UUID),
    "cancel": lambda server: server.cancel(UUID),
    "discard": lambda server: server.discard(UUID),
    "restart": lambda server: server.restart(UUID),
}


@pytest.mark.parametrize("call", CALLS)
@pytest.mark.parametrize("kind", ["node", "webodm"])
def test_answers_of_any_kind(call, kind):
    rng = random.Random(f"{call} {kind}")
    answers = NODE if kind == "node" else WEBODM
    for path, _ in itertools.product(answers, range(60)):
        if kind == "node":
            server = NodeClient("http://host")
        else:
            server = WebODMTasks("http://host", 1, Access("me", "it"), marker="m")
        server._server = Answering(answers, path, rng)
        try:
            found = CALLS[call](server)
        except QuantifyError as error:
            found = str(error)
            assert len(found) < 1000
        assert len(repr(found)) < (300 if call == "engine" else 200_000)
