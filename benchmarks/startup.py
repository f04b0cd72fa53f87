"""Processor time and memory of a command before and besides its work.

    python benchmarks/startup.py [--runs N] [--points N]

Each command is a process of its own; the lowest of some runs counts, as everything else on the
machine only adds to it. Linux: memory is what /proc tells of the process.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import List, Optional, Tuple

import laspy
import numpy as np

#: What is allowed: seconds of processor time, megabytes.
LIMITS = {"--help": (0.25, 40), "--version": (0.25, 40), "volume": (0.8, 250)}


# One thread; and what a first run has compiled is kept, as it is of an installed package.
_ALONE = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "PYTHONDONTWRITEBYTECODE": "",
    "PYTHONPYCACHEPREFIX": str(Path(tempfile.gettempdir()) / "quantify-startup"),
}


def cost(*arguments: str) -> Tuple[float, float]:
    """Return seconds of processor time and megabytes at most of one run of the command."""
    code = (
        "import re, runpy, sys; sys.argv[0] = 'quantify-client'\n"
        "try: runpy.run_module('quantify_client', run_name='__main__')\n"
        "finally: print(*re.findall('VmHWM: *([0-9]+)', open('/proc/self/status').read().replace("
        "chr(9), ' ')), file=sys.stderr)"
    )
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, **_ALONE},
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return seconds, int(done.stderr.split()[-1]) / 1024


def written(path: Path, count: int) -> Path:
    """Write a pile on flat ground as LAZ."""
    rng = np.random.default_rng(1)
    x, y = rng.uniform(0, 40, (2, count))
    height = np.clip(4 - 0.5 * np.hypot(x - 20, y - 20), 0, None) + rng.normal(0, 0.01, count)
    header = laspy.LasHeader(point_format=3, version="1.4")
    header.scales, header.offsets = [0.001] * 3, [500_000, 5_000_000, 0]
    cloud = laspy.LasData(header)
    cloud.x, cloud.y, cloud.z = 500_000 + x, 5_000_000 + y, 100 + height
    cloud.write(str(path))
    return path


def main(arguments: Optional[List[str]] = None) -> int:
    """Print a table; 1 where a command takes more than it may."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--points", type=int, default=10_000)
    given = parser.parse_args(arguments)
    over = 0
    with tempfile.TemporaryDirectory() as folder:
        cloud = str(written(Path(folder) / "pile.laz", given.points))
        commands = [
            ["--help"],
            ["--version"],
            ["volume", "--help"],
            ["info", cloud],
            ["volume", cloud, "--shape", "terrain"],
            ["volume", cloud, "--shape", "terrain", "--json"],
            ["volume", cloud, "--shape", "terrain", "--out", f"{folder}/report"],
        ]
        for command in commands:
            runs = [cost(*command) for _ in range(given.runs)]
            seconds, megabytes = min(runs)
            words = " ".join(command).replace(folder, "").replace("/pile", "pile")
            print(f"{seconds:6.2f} s  {megabytes:4.0f} MB  quantify-client {words}")
            most_s, most_mb = LIMITS.get(command[-1], LIMITS.get(command[0], (9e9, 9e9)))
            drawn = "--out" in command
            over += not drawn and (seconds > most_s or megabytes > most_mb)
    return int(over > 0)


if __name__ == "__main__":
    sys.exit(main())
