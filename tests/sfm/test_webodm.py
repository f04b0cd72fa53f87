"""Requests to a WebODM in somebody's name: addresses, logins, what it says, what stays secret."""

import logging
import threading

import pytest
from webodm import PASSWORD, USER, VIEWER, WebODM

from quantify_client.errors import CloudError, ServerError, UsageError
from quantify_client.sfm.servers import webodm
from quantify_client.sfm.servers.access import Access
from quantify_client.sfm.servers.errors import OutageError, StatusError
from quantify_client.sfm.servers.webodm import WebODM as Client
from quantify_client.sfm.servers.webodm import task_address
from quantify_client.sfm.servers.webodm_tasks import WebODMTasks

# Servers, sizes and words: no different on a second Python.
pytestmark = pytest.mark.one_python

TASK = "7b0fd1cc-64a6-4c5a-8a5d-ae4b0c5c9f2e"
KNOWN = Access(USER, PASSWORD)


@pytest.fixture
def server():
    with WebODM().running() as server:
        yield server


@pytest.fixture
def client(server):
    return Client(server.url, KNOWN, silence_s=1.0)


@pytest.mark.parametrize(
    ("path", "prefix", "project"),
    [
        ("/project/1/task/{t}/map/", "", 1),
        ("/map/project/12/task/{t}/", "", 12),
        ("/3d/project/1/task/{t}/", "", 1),
        ("/project/1/task/{t}", "", 1),
        ("/api/projects/3/tasks/{t}/", "", 3),
        ("/api/projects/3/tasks/{t}/download/all.zip", "", 3),
        ("/public/task/{t}/map/", "", None),
        ("/public/task/{t}/iframe/3d/", "", None),
        ("/odm/map/project/1/task/{t}/?t=dsm#x", "/odm", 1),
        ("/a/b/public/task/{t}/json/", "/a/b", None),
    ],
)
def test_every_address_that_a_browser_shows_is_understood(path, prefix, project):
    url = "HTTPS://host.example:8443" + path.replace("{t}", TASK)
    found = task_address(url)
    assert found.server == f"https://host.example:8443{prefix}"
    assert (found.project, found.task) == (project, TASK)
    assert found.given == url.split("?")[0]


@pytest.mark.parametrize(
    "url",
    [
        f"https://host/map/project/x/task/{TASK}/",
        f"https://host/map/project/1/task/{TASK}x/",
        f"https://host/project/1/task/../{TASK}/",
        "https://host/public/project/1/map/",
        f"https:///project/1/task/{TASK}/",
        f"https://[host/project/1/task/{TASK}/",
        "https://host/",
    ],
)
def test_other_addresses_are_not(url):
    with pytest.raises(CloudError, match="is a web address, but no WebODM task's"):
        task_address(url)


def test_access_shows_nothing():
    access = Access("somebody", "s3cret", "ey.j.w.t")
    for secret in ("somebody", "s3cret", "ey.j.w.t"):
        assert secret not in repr(access)
        assert secret not in repr(Client("https://host", access))
    assert access.is_anonymous is False
    assert Access("somebody").is_anonymous is True


def test_environment_gives_both_or_neither():
    names = ("QUANTIFY_WEBODM_USER", "QUANTIFY_WEBODM_PASSWORD")
    assert Access.from_environment({}) == Access()
    assert Access.from_environment(dict(zip(names, "ab"))) == Access("a", "b")
    assert Access.from_environment({names[0]: "", names[1]: ""}).is_anonymous
    for given, missing in (names, names[::-1]):
        with pytest.raises(UsageError, match=f"{given} is set and {missing} is not"):
            Access.from_environment({given: "x"})


def test_one_login_serves_many_requests_and_threads(server, client):
    threads = [
        threading.Thread(target=client.json, args=("GET", "/api/projects/1/")) for _ in range(8)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert server.seen.count("token-auth") == 1
    assert server.seen.count("projects/1") == 8


def test_threads_that_find_the_token_expired_log_in_once(server, client):
    client.json("GET", "/api/projects/1/")
    server.expire()
    failures = []

    def ask():
        try:
            client.json("GET", "/api/projects/1/")
        except ServerError as error:
            failures.append(error)

    threads = [threading.Thread(target=ask) for _ in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not failures
    assert server.seen.count("token-auth") <= 3  # a late one may find the new token in use already


def test_login_is_renewed_before_it_is_old(server, client, monkeypatch):
    monkeypatch.setattr(webodm, "LOGIN_S", 0.0)
    client.json("GET", "/api/projects/1/")
    client.json("GET", "/api/projects/1/")
    assert server.seen.count("token-auth") == 2


def test_user_who_may_not_is_told_the_variables(server, client, monkeypatch):
    monkeypatch.setattr(server, "who", lambda header: (None, "You do not have permission."))
    with pytest.raises(StatusError, match=r"do not have permission.*QUANTIFY_WEBODM_USER"):
        client.json("GET", "/api/projects/1/")
    assert server.seen.count("token-auth") == 2  # once more, and no further


def test_login_that_answers_nonsense_is_an_outage(server, client, monkeypatch):
    monkeypatch.setattr(server, "log_in", lambda given: (200, {"token": None}))
    with pytest.raises(OutageError, match="no token"):
        client.json("GET", "/api/projects/1/")


def test_nothing_secret_in_logs_or_messages(server, client, caplog):
    caplog.set_level(logging.DEBUG)
    for status in (400, 403, 404, 502):
        server.fault("status", "/projects/1/", value=status, times=2)
        with pytest.raises(ServerError) as caught:
            client.json("GET", "/api/projects/1/")
        server.faults.clear()
        chain = f"{caught.value!r} {caught.value.__context__!r} {caught.value.__cause__!r}"
        for secret in (PASSWORD, *server.tokens):
            assert secret not in chain
    for secret in (PASSWORD, *server.tokens):
        assert secret not in caplog.text


def test_server_that_echoes_a_token_shows_stars(server, client, monkeypatch):
    client.json("GET", "/api/projects/1/")
    token = next(iter(server.tokens))
    monkeypatch.setattr(server, "listed_or_made", lambda *_: (400, {"options": [f"bad {token}"]}))
    with pytest.raises(StatusError, match=r"refuses that \(bad \*\*\*\)"):
        client.json("POST", "/api/projects/1/tasks/", json={})


def test_project_of_somebody_else_is_told(server):
    tasks = WebODMTasks(server.url, 7, KNOWN)
    with pytest.raises(ServerError, match=r"has no project 7, or the user may not see it"):
        tasks.info()
    with pytest.raises(ServerError, match="may look at project 1, not add"):
        WebODMTasks(server.url, 1, Access(VIEWER, "look")).engine()
    with pytest.raises(UsageError, match="needs a user"):
        WebODMTasks(server.url, 1, Access()).info()


def test_pages_of_a_list_are_taken_as_lists(server, monkeypatch):
    tasks = WebODMTasks(server.url, 1, KNOWN)
    monkeypatch.setattr(server, "nodes", {"count": 1, "results": server.nodes})
    assert tasks.engine().max_images == 500
    monkeypatch.setattr(server, "nodes", {"results": [1]})
    with pytest.raises(OutageError, match="no list"):
        tasks.engine()


@pytest.mark.parametrize(
    "changes",
    [{"status": 99}, {"status": []}, {"running_progress": "x"}, {"images_count": None}],
)
def test_task_that_makes_no_sense_is_an_outage(server, tmp_path, monkeypatch, changes):
    task = server.add(tmp_path)
    document = server.document
    monkeypatch.setattr(server, "document", lambda t: {**document(t), **changes})
    with pytest.raises(OutageError, match="nothing that makes sense"):
        WebODMTasks(server.url, 1, KNOWN).task(task.id)
