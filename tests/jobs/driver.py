"""Drives one job in a process of its own, for tests that kill it: driver.py FOLDER [TOKEN]."""

import json
import sys
import time
from pathlib import Path

from quantify_client.jobs import Pace, run_job


def main(folder, token=None):
    start = time.perf_counter()
    path = run_job(
        Path(folder), token, patience_h=30 / 3600, pace=Pace(0.02, 0.01, 5.0), resubmit=False
    )
    seconds = time.perf_counter() - start
    print(json.dumps({"path": str(path), "peak_kb": _peak_kb(), "seconds": seconds}))


def _peak_kb():
    """The largest resident size; getrusage would tell that of the process that started this one."""
    status = Path("/proc/self/status")
    if not status.exists():
        return None
    return next(int(line.split()[1]) for line in status.open() if line.startswith("VmHWM"))


if __name__ == "__main__":
    main(*sys.argv[1:])
