"""The end of a measurement that hears nothing: it is in the middle of one long computation."""

import os
import signal
import sys

__all__ = ["stop_process"]


def stop_process():
    """End this process in the middle of whatever it does: Celery starts another one.

    Celery's own way, a message to the worker that runs the job, is lost without the broker. A
    worker that runs jobs in its main process is left alone: it would be gone for good.
    """
    pool = sys.modules.get("billiard.process")
    if pool is not None and pool.current_process().name != "MainProcess":
        os.kill(os.getpid(), signal.SIGTERM)
