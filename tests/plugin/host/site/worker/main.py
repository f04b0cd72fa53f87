"""Workers: one job after the other in one process, until it is killed; then another is forked."""

import json
import os
import sys
import time
import types
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
os.environ.setdefault("DJANGO_SETTINGS_MODULE", "webodm.settings")

import django

django.setup()

# Here once, rather than in every worker: these take seconds to load.
import laspy  # noqa: F401, E402
import pyproj  # noqa: F401, E402
import scipy.sparse.linalg  # noqa: E402
import scipy.spatial  # noqa: F401, E402
import shapely  # noqa: F401, E402

from worker.celery import QUEUE, RESULTS, ROOT, RUNNING  # noqa: E402


def keep_working():
    """Fork a worker, and another one whenever it has died."""
    server = int(sys.argv[1])
    while os.getppid() == server:
        for stale in RUNNING.glob("*.pid"):
            stale.unlink()
        worker = os.fork()
        if not worker:
            work()
            os._exit(0)
        os.waitpid(worker, 0)


def work():
    """Run what is in the queue, the oldest first."""
    sys.modules["billiard.process"] = _pool_process()
    parent, server = os.getppid(), int(sys.argv[1])
    (ROOT / "worker.pid").write_text(str(os.getpid()))
    while os.getppid() == parent and _lives(server):
        waiting = sorted(QUEUE.glob("*.json"), key=lambda path: path.stat().st_mtime)
        if waiting:
            _run(waiting[0])
        else:
            time.sleep(0.05)


def _pool_process():
    """Return what tells a process of Celery's pool that it is one."""
    module = types.ModuleType("billiard.process")
    module.current_process = lambda: types.SimpleNamespace(name="ForkPoolWorker-1")
    return module


def _lives(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def _run(path):
    job = path.stem
    asked = json.loads(path.read_text())
    pid = RUNNING / f"{job}.pid"
    pid.write_text(str(os.getpid()))
    path.unlink()
    try:
        result = _evaluate(asked)
        (RESULTS / f"{job}.json").write_text(json.dumps(result, allow_nan=False))
    finally:
        pid.unlink()


def _evaluate(asked):
    """Run a function from its text in an empty namespace, and nothing else."""
    namespace = {}
    exec(compile(asked["source"], "file", "exec"), namespace)  # noqa: S102
    return namespace[asked["name"]](*asked["args"])


if __name__ == "__main__":
    keep_working()
