"""Signals end every command as Ctrl-C does: one line, the right status, and nothing left behind."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import textwrap
import time
import zipfile
from pathlib import Path

import pytest
import sized
import yaml
from commands import PILE
from nodeodm import TOKEN
from test_gcp_command import STEEP, with_picks

pytestmark = [
    pytest.mark.skipif(sys.platform == "win32", reason="signals"),
    pytest.mark.one_python,  # each takes a process of its own or two
]

# A command whose writing, which is its last step, says that it is there and then takes long.
SLOW = """
import sys, time, importlib
def slow(*args, **more):
    print("there", file=sys.stderr, flush=True)
    time.sleep(600)  # longer than other runs beside it take on a busy machine
module, name = sys.argv.pop(1).split(":")
holder = importlib.import_module(module)
assert hasattr(holder, name)
setattr(holder, name, slow)
from quantify_client.__main__ import main
sys.exit(main())
"""
WRITING = {
    "volume": "quantify_client.report.figures.pictures:area_picture",
    "demo": "quantify_client.report.figures.pictures:area_picture",
    "scale": "quantify_client.report.figures.control.figure:scale_picture",
    "gcp": "quantify_client.scaler.control.gcp_write:put_in_place",
    "plugin": "quantify_client.plugin_build:_write",
}


@pytest.fixture
def temporary(tmp_path):
    (tmp_path / "tmp").mkdir()
    return tmp_path / "tmp"


@pytest.fixture
def begin(temporary):
    """Start a command in a process of its own, with a TMPDIR of its own."""
    begun = []

    def beginner(command, *arguments, slow=None, prepare=None):
        head = [sys.executable, "-m", "quantify_client"]
        if slow:
            head = [sys.executable, "-c", SLOW, slow]
        process = subprocess.Popen(
            [*head, command, *map(str, arguments)],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ, "TMPDIR": str(temporary)},
            preexec_fn=prepare,
        )
        begun.append(process)
        if slow:
            assert process.stderr.readline() == "there\n", process.stderr.read()
        return process

    yield beginner
    for process in begun:
        process.kill()
        process.communicate()


@pytest.fixture
def arguments(site, tmp_path):
    """What each command is given; all write into the folder "out"."""
    out = tmp_path / "out"
    out.mkdir()
    marks = sized.marks(PILE.height)
    control = tmp_path / "scale.yaml"
    control.write_text(yaml.safe_dump(sized.control(marks, marks, gps=3.0), sort_keys=False))
    levels = with_picks(tmp_path, sized.marks(STEEP.height, 6, seed=2), tapes=15, levels=2)
    where = (site / "pile.laz", "--area", site / "pile.geojson")
    return {
        "volume": (*where, "--out", out / "report"),
        "demo": ("--out", out),
        "scale": (site / "pile.laz", "--gcp", control, "--out", out / "scaled.laz"),
        "gcp": (levels, "--to", "odm", "--out", out / "gcp.txt"),
        "plugin": ("--online", "--out", out / "dist"),  # what pip fetches takes long to pack
    }


@pytest.mark.parametrize(
    ("command", "number"),
    [*((command, signal.SIGTERM) for command in WRITING), ("gcp", signal.SIGHUP)],
)
def test_a_signal_ends_a_command_as_ctrl_c_does(
    command, number, begin, arguments, tmp_path, temporary
):
    process = begin(command, *arguments[command], slow=WRITING[command])
    assert list((tmp_path / "out").rglob(".quantify-*"))
    process.send_signal(number)
    said = process.communicate(timeout=30)
    assert process.returncode == 128 + number
    assert said == ("", "quantify-client: error: interrupted; no file is half written\n")
    assert list((tmp_path / "out").iterdir()) == []
    assert list(temporary.iterdir()) == []


def test_a_signal_while_points_are_read_removes_what_was_unpacked(begin, site, tmp_path, temporary):
    block = (site / "plain.csv").read_bytes().split(b"\n", 1)[1]
    with zipfile.ZipFile(tmp_path / "all.zip", "w") as archive:
        archive.writestr("cloud.csv", block * 60)
    process = begin("volume", tmp_path / "all.zip", "--shape", "terrain", "--threads", "3")
    deadline = time.monotonic() + 60
    while not any("cloud.csv" in path for path in descriptors(process, temporary)):
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.01)
    process.send_signal(signal.SIGTERM)
    said = process.communicate(timeout=30)
    assert process.returncode == 143
    assert said == ("", "quantify-client: error: interrupted; no file is half written\n")
    assert list(temporary.iterdir()) == []


def descriptors(process, below):
    """Files below a folder that a process reads (Linux); it opens and closes others meanwhile."""
    found = []
    for link in Path(f"/proc/{process.pid}/fd").glob("*"):
        with contextlib.suppress(OSError):
            found.append(str(link.readlink()))
    return [path for path in found if path.startswith(f"{below.resolve()}/quantify-")]


def test_under_nohup_a_hangup_is_no_end(begin, arguments):
    def ignore():
        signal.signal(signal.SIGHUP, signal.SIG_IGN)

    process = begin("volume", *arguments["volume"], slow=WRITING["volume"], prepare=ignore)
    process.send_signal(signal.SIGHUP)
    time.sleep(0.5)
    assert process.poll() is None
    process.send_signal(signal.SIGTERM)
    process.communicate(timeout=30)
    assert process.returncode == 143


def test_signals_while_it_cleans_up_do_not_stop_that(begin, arguments, tmp_path):
    process = begin("volume", *arguments["volume"], slow=WRITING["volume"])
    for _ in range(3):
        process.send_signal(signal.SIGTERM)
        process.send_signal(signal.SIGHUP)
    process.communicate(timeout=30)
    assert process.returncode in (143, 129)
    assert list((tmp_path / "out").iterdir()) == []


def python(code):
    """Run code in a process of its own; return its status, stdout and stderr."""
    command = [sys.executable, "-c", textwrap.dedent(code)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=30)
    return done.returncode, done.stdout, done.stderr


def test_signals_that_come_just_before_a_long_wait_end_it():
    # As if they came between Python's last look and the wait: taken, but by no interrupted call.
    code = """
        import signal, sys, threading, time
        from quantify_client.commands.process import Ending

        def send():
            for number in (signal.SIGTERM, signal.SIGHUP) * 3:
                signal.pthread_kill(threading.get_ident(), number)

        ending = Ending()
        try:
            with ending:
                threading.Timer(0.2, send).start()
                time.sleep(60)
        except KeyboardInterrupt:
            sys.exit(128 + ending.number)
        """
    assert python(code) in ((143, "", ""), (129, "", ""))


def test_a_signal_where_python_lets_no_exception_out_ends_what_follows():
    code = """
        import os, signal, sys, time
        from quantify_client.commands.process import Ending

        class Slow:
            def __del__(self):
                os.kill(os.getpid(), signal.SIGTERM)

        ending = Ending()
        try:
            with ending:
                Slow()
                print("goes on")
                time.sleep(60)
        except KeyboardInterrupt:
            sys.exit(128 + ending.number)
        """
    assert python(code) == (143, "goes on\n", "")


def test_signals_after_the_first_do_not_change_the_status():
    code = """
        import atexit, os, signal, sys
        import quantify_client.cli

        def end(*_):
            os.kill(os.getpid(), signal.SIGTERM)
            os.kill(os.getpid(), signal.SIGHUP)

        atexit.register(end)
        quantify_client.cli._run = end
        from quantify_client.__main__ import main
        sys.exit(main())
        """
    status, out, err = python(code)
    assert status in (143, 129)
    assert (out, err) == ("", "quantify-client: error: interrupted\n")


def test_a_signal_while_it_starts():
    code = """
        import os, signal, sys
        class Ending:
            @staticmethod
            def find_spec(name, *where):
                if name == "quantify_client.cli":
                    os.kill(os.getpid(), signal.SIGTERM)
        sys.meta_path.insert(0, Ending)
        from quantify_client.__main__ import main
        sys.exit(main())
        """
    assert python(code) == (143, "", "quantify-client: error: interrupted\n")


def test_what_runs_in_the_process_is_given_back_its_signals(monkeypatch):
    from quantify_client.__main__ import main

    before = signal.getsignal(signal.SIGTERM), sys.stdout, sys.stderr
    monkeypatch.setattr(sys, "argv", ["quantify-client", "--help"])
    assert main() == 0
    assert (signal.getsignal(signal.SIGTERM), sys.stdout, sys.stderr) == before


def test_a_signal_ends_pip_too(begin, tmp_path, temporary, monkeypatch):
    # A pip that leaves something in TMPDIR and then takes long.
    (tmp_path / "pip").mkdir()
    (tmp_path / "pip" / "__main__.py").write_text(
        "import os, tempfile, time, pathlib\n"
        "tempfile.mkdtemp()\n"
        f"pathlib.Path({str(tmp_path / 'pid.new')!r}).write_text(str(os.getpid()))\n"
        f"os.rename({str(tmp_path / 'pid.new')!r}, {str(tmp_path / 'pid')!r})\n"
        "time.sleep(60)\n"
    )
    (tmp_path / "pip" / "__init__.py").touch()
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=os.pathsep)
    process = begin("plugin", "--offline", "--out", tmp_path / "dist")
    deadline = time.monotonic() + 60
    while not (tmp_path / "pid").exists():
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.02)
    process.send_signal(signal.SIGTERM)
    process.communicate(timeout=30)
    assert process.returncode == 143
    assert _ends(int((tmp_path / "pid").read_text()))
    assert list(temporary.iterdir()) == []
    assert not (tmp_path / "dist").exists()


def _ends(pid: int) -> bool:
    """Whether a process that was killed is gone within some seconds: nobody waits for it."""
    deadline = time.monotonic() + 10
    while time.monotonic() < deadline:
        try:
            os.kill(pid, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.05)
    return False


# --- submit and resume


@pytest.mark.parametrize(
    ("during", "number"), [("uploading", signal.SIGTERM), ("processing", signal.SIGHUP)]
)
def test_a_signal_leaves_a_job_that_resumes(
    during, number, known, node, begin, tmp_path, monkeypatch
):
    monkeypatch.setenv("QUANTIFY_NODE_TOKEN", TOKEN)
    node.script = [(20, 5.0)] * 10_000
    node.slow_s = 0.5 if during == "uploading" else 0.0
    job = tmp_path / "job"
    where = ("--node", node.url, "--out", job, "--area", known.area)
    process = begin("submit", known.photos[0].parent, *where)
    deadline = time.monotonic() + 60
    while not (node.tasks if during == "processing" else node.seen.count("/upload/")):
        assert process.poll() is None, process.stderr.read()
        assert time.monotonic() < deadline
        time.sleep(0.02)
    process.send_signal(number)
    out, err = process.communicate(timeout=30)
    assert (process.returncode, out) == (128 + number, "")
    assert "quantify-client resume" in err.splitlines()[-1]
    assert "Traceback" not in err
    node.slow_s, node.script = 0.0, [(40, 100.0)]
    for task in node.tasks.values():
        task.script = [(40, 100.0)]
    process = begin("resume", job, "--json")
    out, err = process.communicate(timeout=120)
    assert process.returncode == 0, err
    assert len(json.loads(out)["results"]) == 1
    assert len(node.tasks) == 1


# --- what cannot clean up: SIGKILL


@pytest.mark.parametrize("command", ["scale", "plugin"])
def test_what_a_killed_run_left_is_swept_by_the_next(
    command, begin, arguments, tmp_path, temporary
):
    process = begin(command, *arguments[command], slow=WRITING[command])
    process.kill()
    process.communicate()
    left = list((tmp_path / "out").rglob(".quantify-*"))
    assert len(left) == 1
    process = begin(command, *arguments[command])
    _, err = process.communicate(timeout=120)
    assert (process.returncode, err) == (0, "")
    assert not list((tmp_path / "out").rglob(".quantify-*"))
    assert list(temporary.iterdir()) == []


def test_folders_of_a_run_that_lives_are_left_alone(begin, arguments, tmp_path, temporary):
    cloud, *more = arguments["scale"]
    with zipfile.ZipFile(tmp_path / "all.zip", "w") as archive:
        archive.write(cloud, "cloud.laz")  # to be unpacked, into a temporary folder
    given = (tmp_path / "all.zip", *more)
    living = begin("scale", *given, slow=WRITING["scale"])
    killed = begin("scale", *given, slow=WRITING["scale"])
    before = {path for path in tmp_path.rglob("*quantify-*") if path.is_dir()}
    assert len(before) == 4  # a hidden and a temporary one of each
    killed.kill()
    killed.communicate()
    third = begin("scale", *given)
    assert third.communicate(timeout=120)[1] == ""
    left = {path for path in tmp_path.rglob("*quantify-*") if path.is_dir()}
    assert len(left) == 2
    assert left < before
    living.terminate()
    living.communicate(timeout=30)
    assert not list(temporary.iterdir())
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [
        "scaled-report.html",
        "scaled.laz",
    ]
