"""The broker as WebODM has it: a Redis that is killed, restarted, or stands still; Celery's worker.

Needs redis-server and WebODM's versions of Celery and its kin, which none of the other tests does:
`make broker` installs them into an environment of their own.
"""

import importlib
import importlib.util
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
import types
import uuid
from pathlib import Path

import pytest

pytest.importorskip("celery")
if shutil.which("redis-server") is None:
    pytest.skip("there is no redis-server", allow_module_level=True)

PLUGIN = Path(__file__).parents[2] / "plugin"
LONGEST_S = 5.0  # of a request
CELERY = """
import os
from celery import Celery

app = Celery("tasks")
app.conf.update(broker_url=os.environ["WO_BROKER"], result_backend=os.environ["WO_BROKER"])
"""
WORKER = """
from worker.celery import app

@app.task(bind=True)
def eval_async(self, source, name, *args):
    namespace = {}
    exec(compile(source, "file", "exec"), namespace)
    return namespace[name](*args)
"""
FUNCTIONS = """
def touch(path):
    open(path, "w").close()
    return {"output": 1}


def stuck(path, package):
    import importlib, os, sys, threading, types

    module = types.ModuleType("volcalc_stuck")
    module.__path__ = [package, os.path.dirname(package)]
    sys.modules["volcalc_stuck"] = module
    stop = importlib.import_module("volcalc_stuck.worker.stopping").stop_process
    threading.Timer(0.5, stop).start()
    open(path, "w").write(str(os.getpid()))
    while True:
        pass
"""


class Redis:
    """A Redis on a port of its own that keeps nothing on disk."""

    def __init__(self):
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        self.start()

    def start(self):
        command = ["redis-server", "--port", str(self.port), "--save", "", "--bind", "127.0.0.1"]
        self.process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
        ends = time.monotonic() + 20
        while time.monotonic() < ends:
            try:
                socket.create_connection(("127.0.0.1", self.port), 1).close()
            except OSError:
                time.sleep(0.05)
            else:
                return
        raise AssertionError("no Redis")

    def kill(self):
        self.process.kill()
        self.process.wait()

    def signal(self, number):
        self.process.send_signal(number)


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """What a plugin imports of WebODM, with its real Celery."""
    root = tmp_path_factory.mktemp("site")
    texts = {"worker/celery.py": CELERY, "app/plugins/worker.py": WORKER, "fn.py": FUNCTIONS}
    for name in ("worker", "app", "app/plugins"):
        (root / name).mkdir()
        (root / name / "__init__.py").touch()
    for name, text in texts.items():
        (root / name).write_text(text)
    redis = Redis()
    os.environ["WO_BROKER"] = f"redis://127.0.0.1:{redis.port}"
    sys.path.insert(0, str(root))
    package = types.ModuleType("volcalc_queue")
    package.__path__ = [str(PLUGIN), str(PLUGIN.parent)]
    sys.modules["volcalc_queue"] = package
    yield types.SimpleNamespace(
        root=root,
        redis=redis,
        broker=importlib.import_module("volcalc_queue.web.broker"),
        functions=importlib.import_module("fn"),
    )
    sys.path.remove(str(root))
    redis.signal(signal.SIGCONT)
    redis.kill()


def start(site, path):
    message = str(uuid.uuid4())
    site.broker.enqueue(site.functions.touch, str(path), message=message)
    return message


def test_message_is_there_until_it_is_lost(site, tmp_path):
    message = start(site, tmp_path / "a")
    assert site.broker.holds(message)
    assert not site.broker.holds(str(uuid.uuid4()))
    site.redis.kill()
    began = time.monotonic()
    for call in (lambda: start(site, tmp_path / "b"), lambda: site.broker.holds(message)):
        with pytest.raises(site.broker.BrokerError, match="refused"):
            call()
    assert time.monotonic() - began < LONGEST_S
    site.redis.start()
    # at the first try
    assert site.broker.holds(start(site, tmp_path / "c"))
    assert not site.broker.holds(message)


def test_broker_that_stands_still_is_not_waited_for(site, tmp_path):
    message = start(site, tmp_path / "a")
    site.redis.signal(signal.SIGSTOP)
    try:
        for call in (lambda: start(site, tmp_path / "b"), lambda: site.broker.holds(message)):
            began = time.monotonic()
            with pytest.raises(site.broker.BrokerError):
                call()
            assert time.monotonic() - began < LONGEST_S
    finally:
        site.redis.signal(signal.SIGCONT)
    assert site.broker.holds(start(site, tmp_path / "c"))
    assert site.broker.holds(message)


def test_message_among_thousands_is_found(site, tmp_path):
    message = start(site, tmp_path / "a")
    from redis import Redis as Client

    client = Client(port=site.redis.port)
    client.lpush("celery", *(["x" * 100] * 3000))
    began = time.monotonic()
    assert site.broker.holds(message)
    assert time.monotonic() - began < LONGEST_S
    client.lpush("celery", *(["x"] * 20_000))
    with pytest.raises(site.broker.BrokerError, match="too many"):
        site.broker.holds(message)
    client.delete("celery")


def test_worker_runs_what_was_queued_and_a_stopped_process_is_replaced(site, tmp_path):
    first = start(site, tmp_path / "a")
    stuck = str(uuid.uuid4())
    package = str(PLUGIN)
    site.broker.enqueue(site.functions.stuck, str(tmp_path / "stuck"), package, message=stuck)
    worker = subprocess.Popen(
        [sys.executable, "-m", "celery", "-A", "app.plugins.worker", "worker", "-c", "1"],
        cwd=site.root,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        wait_for(tmp_path / "a")
        wait_for(tmp_path / "stuck")
        start(site, tmp_path / "b")
        wait_for(tmp_path / "b")  # by another process of the same worker
        assert not site.broker.holds(first)
        assert worker.poll() is None
    finally:
        worker.terminate()
        worker.wait(30)


def wait_for(path):
    ends = time.monotonic() + 40
    while not path.exists() and time.monotonic() < ends:
        time.sleep(0.05)
    assert path.exists()
