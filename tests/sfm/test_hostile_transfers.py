"""Transfers without an end, in whatever way: given up in time, with the disk and memory left."""

import gzip
import io
import json
import shutil
import socket
import struct
import threading
import time
import tracemalloc
import zipfile
from collections import namedtuple
from contextlib import contextmanager, suppress

import pytest
from photographs import all_zip

from quantify_client.errors import OutputError, ServerError
from quantify_client.jobs import waiting
from quantify_client.jobs.job import Job, SentFile
from quantify_client.sfm.odm.archive import zip_fault
from quantify_client.sfm.servers import limits
from quantify_client.sfm.servers.access import Access
from quantify_client.sfm.servers.errors import ArchiveError, OutageError
from quantify_client.sfm.servers.http import Server
from quantify_client.sfm.servers.nodeodm import NodeClient
from quantify_client.sfm.servers.webodm_tasks import WebODMTasks

# Servers, sizes and words: no different on a second Python.
pytestmark = pytest.mark.one_python

UUID = "6f1c2a34-0f3e-4b7a-9c55-0123456789ab"
OK = b"HTTP/1.1 200 OK\r\n"
JSON = OK + b"Content-Type: application/json\r\n"
PACKED = gzip.compress(bytes(40 << 20), 1)
ZIP = OK + b"Content-Type: application/zip\r\n"


@contextmanager
def answering(*pieces, pause_s=0.0):
    """A server that answers each request with pieces of bytes, the last one again and again."""
    listening = socket.create_server(("127.0.0.1", 0))
    over = threading.Event()

    def serve(client):
        with client:
            client.settimeout(2)
            try:
                client.recv(1 << 16)
                for piece in pieces[:-1]:
                    client.sendall(piece)
                while not over.is_set() and pieces[-1]:
                    client.sendall(pieces[-1])
                    over.wait(pause_s)
            except OSError:
                return

    def accept():
        while not over.is_set():
            try:
                client, _ = listening.accept()
            except OSError:
                return
            threading.Thread(target=serve, args=(client,), daemon=True).start()

    threading.Thread(target=accept, daemon=True).start()
    try:
        yield f"http://127.0.0.1:{listening.getsockname()[1]}"
    finally:
        over.set()
        listening.close()


def asking():
    """Threads that still wait for a server, a moment after they should have ended."""
    end = time.monotonic() + 2.0
    while True:
        names = [thread.name for thread in threading.enumerate() if "asking" in thread.name]
        if not names or time.monotonic() > end:
            return names
        time.sleep(0.01)


def peak_of(action):
    """What an action holds at most, in bytes, beside what it raises."""
    tracemalloc.start()
    try:
        with pytest.raises(ServerError) as caught:
            action()
        return caught.value, tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


# --- memory


def test_body_of_a_redirect_is_not_read():
    head = b"HTTP/1.1 302 Found\r\nLocation: ftp://elsewhere/\r\n\r\n"
    with answering(head, bytes(1 << 20)) as url:
        error, peak = peak_of(lambda: Server(url, silence_s=0.5).json("GET", "/info"))
    assert "sends elsewhere" in str(error)
    assert peak < 4 << 20


@pytest.mark.parametrize("kind", ["gzip", "GZIP, gzip", "br"])
@pytest.mark.parametrize("status", [200, 400, 502])
def test_what_is_packed_is_not_unpacked(kind, status):
    head = f"HTTP/1.1 {status} x\r\nContent-Encoding: {kind}\r\n".encode()
    head += b"Content-Type: application/json\r\nContent-Length: %d\r\n\r\n" % len(PACKED)
    with answering(head + PACKED, b"") as url:
        error, peak = peak_of(lambda: Server(url, silence_s=0.5).json("GET", "/info"))
    assert ("packs its answer" if status == 200 else str(status)) in str(error)
    assert peak < 4 << 20


def test_nothing_packed_is_asked_for():
    seen = []
    with socket.create_server(("127.0.0.1", 0)) as listening:

        def serve():
            client, _ = listening.accept()
            with client:
                seen.append(client.recv(1 << 16).lower())
                client.sendall(JSON + b"Content-Length: 2\r\n\r\n{}")

        threading.Thread(target=serve, daemon=True).start()
        Server(f"http://127.0.0.1:{listening.getsockname()[1]}").json("GET", "/info")
    assert b"accept-encoding: identity" in seen[0]


def test_answer_without_end_fills_no_memory():
    with answering(JSON + b"\r\n[0", b",0" * 100_000) as url:
        error, peak = peak_of(lambda: Server(url, silence_s=5.0).json("GET", "/info"))
    assert "no end" in str(error)
    assert peak < 80 << 20


@pytest.mark.parametrize("depth", [300, 900, 960, 30_000])
@pytest.mark.parametrize("status", [b"200 OK", b"400 no"])
@pytest.mark.parametrize("key", [b"error", b"detail"])
def test_nesting_without_end(depth, status, key):
    text = b'{"' + key + b'":' + b"[" * depth + b"1" + b"]" * depth + b"}"
    head = b"HTTP/1.1 " + status + b"\r\nContent-Type: application/json\r\n"
    with answering(head + b"Content-Length: %d\r\n\r\n" % len(text) + text, b"") as url:
        server = Server(url, silence_s=0.5)
        with suppress(ServerError):
            server.json("GET", "/info")


# --- time


@pytest.mark.parametrize(
    "pieces",
    [
        (ZIP + b"Content-Length: 100000000\r\n\r\n", b"x"),
        (ZIP + b"\r\n", b"x"),
        (ZIP + b"Transfer-Encoding: chunked\r\n\r\n", b"1\r\nx\r\n"),
        (OK, b"X"),
        (b"HTTP/1.1 100 Continue\r\n\r\n",),
        (b"H",),
    ],
    ids=["length", "no length", "chunks", "header", "continue", "status"],
)
def test_download_that_drips_is_given_up(tmp_path, pieces):
    with answering(b"", *pieces, pause_s=0.05) as url:
        begun = time.monotonic()
        with pytest.raises(OutageError):
            Server(url, silence_s=0.1).download("/x", tmp_path / "part", lambda done, total: None)
        assert time.monotonic() - begun < 3.0
        assert not asking()  # nothing goes on in the background


def test_download_that_goes_on_may_take_longer_than_one_block(tmp_path):
    block = bytes(1 << 17)
    with answering(ZIP + b"Content-Length: %d\r\n\r\n" % (4 << 17), *[block] * 4, b"") as url:
        server = Server(url, silence_s=0.4)
        seen = []

        def slowly(done, total):
            seen.append(done)
            time.sleep(0.5)

        server.download("/x", tmp_path / "part", slowly)
    assert (tmp_path / "part").stat().st_size == 4 << 17


def test_upload_of_which_the_answer_drips_is_given_up(tmp_path):
    (tmp_path / "a.JPG").write_bytes(b"a" * 1000)
    with answering(JSON, b"X", pause_s=0.05) as url:
        begun = time.monotonic()
        with pytest.raises(OutageError):
            NodeClient(url, silence_s=0.1).upload(UUID, tmp_path / "a.JPG", "a.JPG")
    assert time.monotonic() - begun < 3.0


def test_headers_without_end():
    endless = answering(JSON, b"X-A: b\r\n")
    with endless as url, pytest.raises(OutageError, match="connection broke"):
        Server(url, silence_s=0.5).json("GET", "/info")


# --- the disk


def test_download_without_a_length_leaves_the_disk_its_reserve(tmp_path, monkeypatch):
    free, usage = 400 << 20, namedtuple("usage", "free")
    part = tmp_path / "part"

    def disk(_):
        return usage(free - (part.stat().st_size if part.exists() else 0))

    monkeypatch.setattr(shutil, "disk_usage", disk)
    monkeypatch.setattr(limits, "SPARE_BYTES", 380 << 20)
    seen = []
    words = r"MB have come, of an unknown number.*make room"
    endless = answering(ZIP + b"\r\n", bytes(1 << 20))
    with endless as url, pytest.raises(OutputError, match=words):
        Server(url, silence_s=2.0).download("/x", part, lambda done, _: seen.append(done))
    assert max(seen) <= (20 << 20) + limits.LOOK_BYTES
    assert not part.exists()


@pytest.mark.parametrize("length", [b"", b"Content-Length: 90000000000\r\n"])
def test_download_that_is_larger_than_it_can_be(tmp_path, length):
    endless, words = answering(ZIP + length + b"\r\n", bytes(1 << 20)), r"the 5.0 MB.*--max-size"
    with endless as url, pytest.raises(ServerError, match=words) as caught:
        NodeClient(url, silence_s=2.0).download(UUID, tmp_path / "all.zip", most=5_000_000)
    assert not isinstance(caught.value, OutageError)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("length", [b"\xb2", b"9" * 5000, b"-1", b"1e3", b"12, 12"])
def test_lengths_that_are_none(tmp_path, length):
    with answering(ZIP + b"Content-Length: " + length + b"\r\n\r\nabc", b"") as url:
        try:
            Server(url, silence_s=0.5).download("/x", tmp_path / "part", lambda *_: None)
        except ServerError:
            return
    assert (tmp_path / "part").read_bytes() == b"abc"


def test_result_may_be_many_times_its_photographs():
    files = tuple(SentFile(f"{n}.JPG", "/x", 8_000_000, 0) for n in range(500))
    job = Job("http://host", "n", {}, (), files)
    assert waiting.most_bytes(job) == (4 << 30) + 20 * 500 * 8_000_000


# --- archives


def test_zip_that_unpacks_for_ever(tmp_path):
    path = tmp_path / "a.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a", bytes(60 << 20))
    begun = time.monotonic()
    assert "times its size" in zip_fault(path)
    assert time.monotonic() - begun < 0.2


@pytest.mark.parametrize("zip64", [False, True])
def test_zip_with_members_without_number(tmp_path, zip64):
    # What the end of the archive says is believed by zipfile, which reads all of it at once.
    path, size = tmp_path / "a.zip", 200 << 20
    end = struct.pack("<4sHHHHIIH", b"PK\x05\x06", 0, 0, 9, 9, size, 0, 0)
    if zip64:
        end = struct.pack("<4sHHHHIIH", b"PK\x05\x06", 0, 0, 9, 9, 0, 0, 0)
        wide = struct.pack("<4sQHHIIQQQQ", b"PK\x06\x06", 44, 45, 45, 0, 0, 9, 9, size, 0)
        end = wide + struct.pack("<4sIQI", b"PK\x06\x07", 0, size, 1) + end
    with path.open("wb") as file:
        file.seek(size)
        file.write(end)
    assert zip_fault(path) == "has more members than any result"


def test_honest_zips_pass(tmp_path):
    path = tmp_path / "a.zip"
    path.write_bytes(all_zip())
    assert zip_fault(path) is None
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        archive.comment = b"PK\x06\x06" * 50
        archive.writestr("a", b"b")
    path.write_bytes(out.getvalue())
    assert zip_fault(path) is None


# --- documents


@pytest.mark.parametrize("given", ["../../admin", 7, None, "", "x" * 36, {"a": 1}])
def test_task_s_id_that_is_none_goes_into_no_address(given):
    answers = {"/tasks/": {"id": given, "partial": True}}

    class Asked:
        name, is_anonymous = "host", False

        def json(self, method, path, **rest):
            return answers["/tasks/"] if method == "POST" else []

    tasks = WebODMTasks("http://127.0.0.1:9", 1, Access("me", "it"), marker="m")
    tasks._server = Asked()
    tasks._find = lambda uuid: None
    with pytest.raises(OutageError, match="no task's id"):
        tasks.init(UUID, "n", {})


@pytest.mark.parametrize("name", [None, 5, [], {}])
def test_option_without_a_name(name):
    text = json.dumps([{"name": name, "type": "bool"}]).encode()
    answer = answering(JSON + b"Content-Length: %d\r\n\r\n" % len(text) + text, b"")
    with answer as url, pytest.raises(OutageError, match="no list of options"):
        NodeClient(url, silence_s=0.5).options()


def test_damaged_archive_is_removed(tmp_path):
    answer = answering(ZIP + b"Content-Length: 3\r\n\r\nabc", b"")
    with answer as url, pytest.raises(ArchiveError):
        NodeClient(url, silence_s=0.5).download(UUID, tmp_path / "all.zip")
    assert not list(tmp_path.iterdir())
