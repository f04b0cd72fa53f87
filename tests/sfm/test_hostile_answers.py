"""Answers that no honest server gives, and a disk with just enough room: errors of ours."""

import shutil
from collections import namedtuple

import pytest
from nodeodm import NodeODM
from photographs import all_zip

from quantify_client.errors import ServerError
from quantify_client.sfm.servers import limits
from quantify_client.sfm.servers.errors import OutageError
from quantify_client.sfm.servers.http import Server
from quantify_client.sfm.servers.nodeodm import NodeClient

# Servers, sizes and words: no different on a second Python.
pytestmark = pytest.mark.one_python

UUID = "6f1c2a34-0f3e-4b7a-9c55-0123456789ab"


@pytest.fixture
def server(tmp_path):
    with NodeODM(tmp_path / "node", archive=all_zip()).running() as server:
        yield server


@pytest.fixture
def node(server):
    return NodeClient(server.url, silence_s=0.5)


@pytest.mark.parametrize(
    "place", ["http://[::1", "http://h:abc/", "http://h:99999/", "http://\u0080\u00ff/"]
)
def test_redirect_to_an_address_that_is_none(server, node, place):
    server.fault("redirect", "/info", value=place)
    with pytest.raises(ServerError, match="an address that is none") as caught:
        node.info()
    assert not isinstance(caught.value, OutageError)


@pytest.mark.parametrize(
    "found",
    [
        {"status": {"code": 20}, "progress": 1.0, "imagesCount": float("inf")},
        {"status": {"code": 20}, "progress": 1.0, "processingTime": float("inf")},
        {"status": {"code": 20}, "progress": float("nan"), "processingTime": 5},
    ],
)
def test_numbers_that_are_none(server, node, monkeypatch, found):
    server.init(UUID, {"options": "[]"})
    server.commit(UUID)
    monkeypatch.setattr(server, "info", lambda task: found)
    with pytest.raises(OutageError, match="nothing that makes sense"):
        node.task(UUID)


def test_what_an_earlier_try_left_does_not_count_as_used(server, node, tmp_path, monkeypatch):
    # Enough room for one: a download that was cut must not stand in the way of the next.
    server.init(UUID, {"options": "[]"})
    server.commit(UUID)
    server.tasks[UUID].status = 40
    part = tmp_path / "all.zip.part"
    usage = namedtuple("usage", "free")
    room = limits.SPARE_BYTES + len(server.archive)
    monkeypatch.setattr(
        shutil,
        "disk_usage",
        lambda _: usage(room - (part.stat().st_size if part.exists() else 0)),
    )
    part.write_bytes(b"half of it")
    node.download(UUID, tmp_path / "all.zip")
    assert (tmp_path / "all.zip").read_bytes() == server.archive


def test_header_that_none_can_be_is_not_shown(server):
    with pytest.raises(ServerError) as caught:
        Server(server.url).identify({"Authorization": "JWT hush\r\nX: y"}, ["hush"])
    assert "hush" not in str(caught.value)
