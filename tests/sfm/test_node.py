"""The client's side of the node's API: what pyodm's transport gets wrong, and what others send."""

import shutil
import ssl
import subprocess

import pytest
from nodeodm import TOKEN, NodeODM
from photographs import all_zip

from quantify_client.errors import InputError, OutputError, QuantifyError, ServerError
from quantify_client.sfm.odm.archive import zip_fault
from quantify_client.sfm.servers import http, limits
from quantify_client.sfm.servers.access import split_token
from quantify_client.sfm.servers.errors import (
    ArchiveError,
    OutageError,
    RefusedError,
    TaskLostError,
)
from quantify_client.sfm.servers.http import Server
from quantify_client.sfm.servers.nodeodm import NodeClient, TaskStatus

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


def test_info_and_options_are_pyodms(node):
    assert node.info().engine == "odm"
    assert {option.name for option in node.options()} >= {"dsm", "pc-quality"}


@pytest.mark.parametrize("prefix", ["", "/odm", "/a/b"])
def test_path_prefix_is_kept(tmp_path, prefix):
    # pyodm drops it.
    with NodeODM(tmp_path, archive=b"", prefix=prefix).running() as server:
        assert NodeClient(server.url).info().version == "2.2.4"
        assert NodeClient(server.url + "/").info().version == "2.2.4"


@pytest.fixture(scope="module")
def certificate(tmp_path_factory):
    if shutil.which("openssl") is None:
        pytest.skip("no openssl to make a certificate with")
    folder = tmp_path_factory.mktemp("tls")
    subprocess.run(
        [
            *("openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2"),
            *("-keyout", folder / "key.pem", "-out", folder / "cert.pem", "-subj", "/CN=127.0.0.1"),
            *("-addext", "subjectAltName=IP:127.0.0.1"),
        ],
        check=True,
        capture_output=True,
    )
    return folder


def test_https_on_any_port_and_the_certificate_counts(tmp_path, certificate):
    # pyodm speaks http to every port but 443.
    server = NodeODM(tmp_path, archive=b"", prefix="/odm")
    server.context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    server.context.load_cert_chain(certificate / "cert.pem", certificate / "key.pem")
    with server.running():
        assert server.url.startswith("https://127.0.0.1:")
        assert NodeClient(server.url, ca=certificate / "cert.pem").info().engine == "odm"
        assert NodeClient(server.url, insecure=True).info().engine == "odm"
        with pytest.raises(ServerError, match="--ca FILE") as caught:
            NodeClient(server.url).info()
        assert not isinstance(caught.value, OutageError)


def test_http_where_https_is_meant_is_said(server):
    with pytest.raises(ServerError, match=r"try http://"):
        NodeClient(server.url.replace("http:", "https:")).info()


def test_file_that_is_no_certificate(tmp_path, server):
    (tmp_path / "ca.pem").write_text("no certificate")
    for name in ("ca.pem", "missing.pem"):
        with pytest.raises(ServerError, match="expected a PEM file"):
            NodeClient(server.url, ca=tmp_path / name)


@pytest.mark.parametrize(
    "url",
    [
        "host:3000",
        "ftp://host",
        "http://",
        "http://host:99999",
        "http://host/?a=b",
        "http://[1",
        "",
    ],
)
def test_address_that_is_none(url):
    with pytest.raises(ServerError, match=r"expected http|after '\?'"):
        NodeClient(url)


def test_password_in_the_address_is_refused_and_not_shown():
    with pytest.raises(ServerError, match="do not belong into a URL") as caught:
        NodeClient("http://me:hush@host:3000")
    assert "hush" not in str(caught.value)


def test_token_in_the_address_is_taken_out():
    assert split_token("https://host/p?token=a%2Bb") == ("https://host/p", "a+b")
    assert split_token("https://host/p?token=a", "b") == ("https://host/p", "b")
    assert split_token("https://host/p") == ("https://host/p", None)
    node = NodeClient("http://host:3000?token=hush")
    assert node.url == "http://host:3000"
    assert "hush" not in repr(node)


def test_token_of_one_node_is_not_given_to_the_next(tmp_path):
    # pyodm's mutable default does that.
    with NodeODM(tmp_path, archive=b"", token=TOKEN).running() as server:
        assert NodeClient(server.url, TOKEN).info().engine == "odm"
        with pytest.raises(RefusedError, match="QUANTIFY_NODE_TOKEN"):
            NodeClient(server.url).info()
        assert "token" not in server.seen.lines[-1][1]


def test_token_goes_to_no_other_host(tmp_path, server):
    with NodeODM(tmp_path / "other", archive=b"").running() as other:
        target = f"{other.url}/info?token=hush&signature=x"
        server.fault("redirect", "/info", value=target)
        asked = Server(server.url, query={"token": "hush"})
        asked.identify({"Authorization": "JWT hush"}, ["hush"])
        assert asked.json("GET", "/info")["engine"] == "odm"
        assert server.seen.headers[0]["Authorization"] == "JWT hush"
        assert "Authorization" not in other.seen.headers[0]
        assert other.seen.lines[0] == ("GET", "/info?signature=x")


def test_token_stays_on_a_redirect_within_the_host(server):
    server.fault("redirect", "/info", value="/info?again=1")
    asked = Server(server.url)
    asked.identify({"Authorization": "JWT hush"}, ["hush"])
    asked.json("GET", "/info")
    assert server.seen.headers[1]["Authorization"] == "JWT hush"


def test_upload_is_never_redirected(server, node, tmp_path):
    (tmp_path / "a.JPG").write_bytes(b"a")
    server.fault("redirect", "/task/new/upload", value="http://127.0.0.1:9/elsewhere?token=x")
    with pytest.raises(ServerError, match=r"sends elsewhere, to http://127.0.0.1:9/elsewhere;"):
        node.upload(UUID, tmp_path / "a.JPG", "a.JPG")


def test_redirects_without_end(server, node):
    server.fault("redirect", "/info", times=100, value="/info")
    with pytest.raises(ServerError, match="sends elsewhere"):
        node.info()


def test_netrc_is_not_asked(tmp_path, server, node, monkeypatch):
    (tmp_path / "netrc").write_text("machine 127.0.0.1 login me password hush\n")
    monkeypatch.setenv("NETRC", str(tmp_path / "netrc"))
    node.info()
    assert "Authorization" not in server.seen.headers[0]


@pytest.mark.parametrize("status", [401, 403, 404, 413, 418])
def test_status_that_will_not_change_is_no_outage(server, node, status):
    server.fault("status", "/info", value=status)
    with pytest.raises(ServerError, match=str(status)) as caught:
        node.info()
    assert not isinstance(caught.value, OutageError)


@pytest.mark.parametrize("kind", ["drop", "html", "stopped"])
def test_exception_leads_to_no_url(server, kind):
    # requests' exceptions hold the URL, and with it the token.
    if kind == "stopped":
        server.stop()
    server.fault(kind, "/info")
    with pytest.raises(OutageError) as caught:
        NodeClient(server.url, TOKEN).info()
    error = caught.value
    while error is not None:
        assert isinstance(error, ServerError)
        assert "token" not in repr(error)
        error = error.__cause__ or error.__context__


@pytest.mark.parametrize(
    ("kind", "value", "unsent"),
    [("status", 500, False), ("status", 429, True), ("drop", None, False), ("html", None, False)],
)
def test_outage_says_whether_something_was_sent(server, node, kind, value, unsent):
    server.fault(kind, "/info", value=value)
    with pytest.raises(OutageError) as caught:
        node.info()
    assert caught.value.unsent is unsent


def test_node_that_is_not_there_got_nothing(server, node):
    server.stop()
    with pytest.raises(OutageError, match="cannot be reached") as caught:
        node.info()
    assert caught.value.unsent


def test_answer_without_end_is_given_up(server, node):
    server.fault("loris", "/info")
    with pytest.raises(OutageError, match="in full within"):
        node.info()


def test_answer_too_large_is_given_up(server, node, monkeypatch):
    monkeypatch.setattr(http, "ANSWER_BYTES", 100)
    with pytest.raises(OutageError, match="no end"):
        node.options()


@pytest.mark.parametrize("document", [None, 1, "text", {"a": 1}, [1]])
def test_json_of_another_kind(server, node, monkeypatch, document):
    monkeypatch.setattr("nodeodm.OPTIONS", document)
    with pytest.raises(OutageError, match="no list of options"):
        node.options()


@pytest.mark.parametrize(
    "found",
    [{}, {"status": {"code": 77}}, {"status": 5}, {"status": {"code": 20}, "progress": "x"}],
)
def test_task_that_makes_no_sense(server, node, monkeypatch, found):
    server.init(UUID, {"options": "[]"})
    server.commit(UUID)
    monkeypatch.setattr(server, "info", lambda task: found)
    with pytest.raises(OutageError, match="nothing that makes sense"):
        node.task(UUID)


def test_errors_come_with_status_200(node):
    with pytest.raises(TaskLostError, match="not found"):
        node.task(UUID)
    with pytest.raises(RefusedError, match="Invalid set-uuid"):
        node.init("no uuid", "name", {})
    with pytest.raises(RefusedError, match="not in enum"):
        node.init(UUID, "name", {"pc-quality": "insane"})


def test_what_a_node_says_steers_no_terminal(server, node, monkeypatch):
    monkeypatch.setattr("nodeodm.OPTIONS", {"error": "a\x1b[31m\nb\u202e" + "x" * 1000})
    with pytest.raises(RefusedError) as caught:
        node.options()
    text = str(caught.value)
    assert "\x1b" not in text
    assert "\n" not in text
    assert len(text) < 400


def test_task_from_init_to_archive(server, node, tmp_path):
    for name in ("a.JPG", 'b "q" ü.JPG'):
        (tmp_path / "f").write_bytes(name.encode())
        node.init(UUID, "pile", {"dsm": True})
        sent = []
        node.upload(UUID, tmp_path / "f", name, sent=sent.append)
        assert sum(sent) == len(name.encode())
    node.commit(UUID)
    assert server.files(UUID)["a.JPG"] == b"a.JPG"
    assert node.task(UUID).status == TaskStatus.RUNNING
    assert node.task(UUID).status == TaskStatus.COMPLETED
    assert node.output(UUID, 1) == ["[INFO] done"]
    node.download(UUID, tmp_path / "all.zip")
    assert (tmp_path / "all.zip").read_bytes() == server.archive
    node.cancel(UUID)
    assert node.task(UUID).status == TaskStatus.CANCELED
    node.remove(UUID)
    with pytest.raises(TaskLostError):
        node.task(UUID)


def test_download_is_as_long_as_it_said(server, node, tmp_path, monkeypatch):
    # Also where what has come is a whole zip by chance.
    server.init(UUID, {"options": "[]"})
    server.commit(UUID)
    server.tasks[UUID].status = 40
    monkeypatch.setattr(server, "archive", server.archive + bytes(2 * len(server.archive)))
    server.fault("cut", "download")
    with pytest.raises(OutageError) as caught:
        node.download(UUID, tmp_path / "all.zip")
    assert not isinstance(caught.value, ArchiveError)


@pytest.mark.parametrize("kind", ["application/json", "text/html; charset=utf-8"])
def test_other_kinds_are_no_archive(server, node, tmp_path, monkeypatch, kind):
    server.init(UUID, {"options": "[]"})
    server.commit(UUID)
    server.tasks[UUID].status = 40
    server.kind = kind
    with pytest.raises(ServerError) as caught:
        node.download(UUID, tmp_path / "all.zip")
    assert not isinstance(caught.value, ArchiveError)
    assert not list(tmp_path.glob("all.zip*"))


def test_download_that_has_no_room_is_not_begun(server, node, tmp_path, monkeypatch):
    monkeypatch.setattr(limits, "SPARE_BYTES", 1 << 60)
    server.init(UUID, {"options": "[]"})
    server.commit(UUID)
    server.tasks[UUID].status = 40
    with pytest.raises(OutputError, match="make room"):
        node.download(UUID, tmp_path / "all.zip")
    assert not list(tmp_path.glob("all.zip*"))


def test_archive_before_the_end_is_refused(server, node, tmp_path):
    server.init(UUID, {"options": "[]"})
    server.commit(UUID)
    with pytest.raises(RefusedError, match="Asset not ready"):
        node.download(UUID, tmp_path / "all.zip")


@pytest.mark.parametrize("data", [b"", b"PK\x03\x04", b"<html>", b"PK\x05\x06" + bytes(18)])
def test_zip_that_is_none(tmp_path, data):
    (tmp_path / "a.zip").write_bytes(data)
    assert zip_fault(tmp_path / "a.zip")


def test_zip_damaged_at_every_tenth_place_is_found_or_still_whole(tmp_path):
    whole = all_zip(size=3000)
    path = tmp_path / "a.zip"
    for place in range(0, len(whole), 97):
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 0x55]) + whole[place + 1 :])
        zip_fault(path)  # never raises
    path.write_bytes(whole)
    assert zip_fault(path) is None


def test_all_errors_are_ours():
    for error in (OutageError("x"), RefusedError("x", "y"), TaskLostError("x", "y")):
        assert isinstance(error, QuantifyError)
        assert isinstance(error, OSError)
        assert not isinstance(error, InputError)
