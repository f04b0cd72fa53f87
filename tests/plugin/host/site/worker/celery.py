"""A queue of files: a job waits in QUEUE, runs with its pid in RUNNING, ends in RESULTS."""

import contextlib
import json
import os
import signal
import uuid
from pathlib import Path

ROOT = Path(os.environ["HOST_DATA"])
QUEUE, RUNNING, RESULTS = (ROOT / name for name in ("queue", "running", "results"))
REVOKED = ROOT / "revoked"


class _Queued:
    def __init__(self, task_id):
        self.task_id = task_id


class _EvalAsync:
    def delay(self, source, name, *args, **kwargs):
        """Put a job into the queue, with nothing but JSON."""
        job = str(uuid.uuid4())
        text = json.dumps({"source": source, "name": name, "args": args, "kwargs": kwargs})
        partial = QUEUE / f"{job}.part"
        partial.write_text(text)
        partial.replace(QUEUE / f"{job}.json")
        return _Queued(job)


class _Control:
    def revoke(self, task_id, terminate=False):
        """Forget a job; with `terminate` kill the worker that runs it."""
        REVOKED.mkdir(exist_ok=True)
        (REVOKED / task_id).touch()
        pid = RUNNING / f"{task_id}.pid"
        if terminate and pid.exists():
            with contextlib.suppress(ProcessLookupError, ValueError):
                os.kill(int(pid.read_text()), signal.SIGTERM)


class _App:
    control = _Control()


eval_async, app = _EvalAsync(), _App()
