"""Uploading beside a bare HTTP client, and the memory that it takes.

Run it with ``python benchmarks/upload.py --images 500 --mb 5``. A NodeODM stand-in (that of the
tests, in a process of its own) takes the same photographs from a bare client of four connections
and from a job with its journal; they take turns, each line is one round, the last one all of them.
``--discard`` has the stand-in throw away what it is sent, so that its disk is not measured.
"""

from __future__ import annotations

import argparse
import http.client
import json
import os
import queue
import subprocess
import sys
import tempfile
import threading
import time
import uuid
from pathlib import Path
from typing import Tuple

from quantify_client.jobs import create_job, plan_job
from quantify_client.sfm.servers.nodeodm import NodeClient

TESTS = Path(__file__).resolve().parents[1] / "tests"
CONNECTIONS = 4
BLOCK = 1 << 18

SERVER = """
import sys, time
sys.path.insert(0, sys.argv[1])
from nodeodm import NodeODM
from nodeodm_http import Handler
from photographs import all_zip

def swallow(self, place, length, path, name):
    left = length
    while left:
        left -= len(self.rfile.read(min(1 << 18, left)))

if len(sys.argv) > 3:
    Handler._receive = swallow
node = NodeODM(sys.argv[2], archive=all_zip())
node.start()
print(node.url, flush=True)
time.sleep(1e6)
"""

JOB = """
import sys, time
from pathlib import Path
from quantify_client.jobs import run_job

begun = []

def told(event):
    now = time.perf_counter()
    if event.kind == "upload":
        begun.append(now)
    if event.kind == "upload" and event.done >= event.total:
        with open("/proc/self/status") as file:
            peak = next(line.split()[1] for line in file if line.startswith("VmHWM"))
        print(now - begun[0], int(peak) // 1000, flush=True)
        raise SystemExit

run_job(Path(sys.argv[1]), report=told, patience_h=0.01)
"""


def photographs(folder: Path, count: int, size: int) -> None:
    """Write small pictures, made as long as photographs are."""
    sys.path.insert(0, str(TESTS))
    from photographs import photograph

    first = photograph(folder / "IMG_0000.JPG").read_bytes()
    for number in range(count):
        path = folder / f"IMG_{number:04}.JPG"
        path.write_bytes(first)
        os.truncate(path, size)


def bare(url: str, folder: Path) -> float:
    """Send all files with nothing but http.client; seconds."""
    task = str(uuid.uuid4())
    NodeClient(url).init(task, "bare", {})
    files: queue.SimpleQueue[Path] = queue.SimpleQueue()
    for path in sorted(folder.iterdir()):
        files.put(path)

    def work() -> None:
        while True:
            try:
                path = files.get_nowait()
            except queue.Empty:
                return
            send(url, task, path)

    threads = [threading.Thread(target=work) for _ in range(CONNECTIONS)]
    begun = time.perf_counter()
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return time.perf_counter() - begun


def send(url: str, task: str, path: Path) -> None:
    """Post one file."""
    about = f'Content-Disposition: form-data; name="images"; filename="{path.name}"'
    head, tail = f"--xx\r\n{about}\r\n\r\n".encode(), b"\r\n--xx--\r\n"
    connection = http.client.HTTPConnection(url.split("//")[1])
    connection.putrequest("POST", f"/task/new/upload/{task}")
    connection.putheader("Content-Type", "multipart/form-data; boundary=xx")
    connection.putheader("Content-Length", str(len(head) + path.stat().st_size + len(tail)))
    connection.endheaders()
    connection.send(head)
    with path.open("rb") as file:
        while block := file.read(BLOCK):
            connection.send(block)
    connection.send(tail)
    answer = json.loads(connection.getresponse().read())
    connection.close()
    if answer.get("success") is not True:
        raise SystemExit(f"the stand-in does not take {path.name}: {answer}")


def job(url: str, folder: Path, out: Path) -> Tuple[float, int]:
    """Send the same as a job does; seconds and peak memory in MB."""
    create_job(plan_job([folder], url), out)
    command = [sys.executable, "-c", JOB, str(out)]
    said = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()
    return float(said[0]), int(said[1])


def main() -> None:
    """Compare, round by round."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--images", type=int, default=500)
    parser.add_argument("--mb", type=float, default=5.0)
    parser.add_argument("--rounds", type=int, default=4)
    parser.add_argument("--discard", action="store_true")
    given = parser.parse_args()
    total = given.images * given.mb
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        (folder / "photos").mkdir()
        photographs(folder / "photos", given.images, int(given.mb * 1e6))
        server = subprocess.Popen(
            [sys.executable, "-c", SERVER, str(TESTS), str(folder / "node")]
            + ["discard"] * given.discard,
            stdout=subprocess.PIPE,
            text=True,
        )
        try:
            url = server.stdout.readline().strip()  # type: ignore[union-attr]
            spent = [0.0, 0.0]
            for turn in range(given.rounds):
                plain = bare(url, folder / "photos")
                ours, peak = job(url, folder / "photos", folder / f"job{turn}")
                print(
                    f"bare {total / plain:.0f} MB/s, job {total / ours:.0f} MB/s: "
                    f"{100 * plain / ours:.0f} % of it; peak {peak} MB"
                )
                spent = [spent[0] + plain, spent[1] + ours]
            print(f"in all {100 * spent[0] / spent[1]:.0f} %")
        finally:
            server.kill()


if __name__ == "__main__":
    main()
