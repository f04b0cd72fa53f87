"""Streams that are closed, full or gone, paths that are no files, files that shrink: one line."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from quantify_client import measure, to_json
from quantify_client.cloud import base, open_cloud
from quantify_client.errors import CloudError

QUANTIFY = f"{sys.executable} -m quantify_client"
FULL = "quantify-client: error: stdout: cannot be written (No space left on device); make room, "

pytestmark = [
    pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full"),
    pytest.mark.one_python,  # streams of the system
]


def shell(command, **environment):
    done = subprocess.run(
        ["/bin/bash", "-c", command],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, **environment},
    )
    return done.returncode, done.stdout, done.stderr


@pytest.mark.parametrize(
    ("redirection", "status", "said"),
    [
        (">&-", 0, ""),
        (">&- 2>&-", 0, ""),
        ("<&- >/dev/null", 0, ""),
        (">/dev/full", 1, FULL + "or redirect it elsewhere\n"),
        (">/dev/full 2>/dev/full", 1, ""),
        ("| true; exit ${PIPESTATUS[0]}", 1, ""),
    ],
)
def test_stdout_that_takes_nothing(redirection, status, said):
    command = f"{QUANTIFY} volume --help {redirection}"
    assert shell(command, PYTHONUNBUFFERED="") == (status, "", said)


def test_stdout_that_takes_nothing_at_once():
    found = shell(f"{QUANTIFY} --help >/dev/full", PYTHONUNBUFFERED="1")
    assert found == (1, "", FULL + "or redirect it elsewhere\n")


@pytest.mark.parametrize("redirection", ["2>&-", "2>/dev/full", "2>&1 >/dev/null | true"])
def test_stderr_that_takes_nothing(redirection):
    status, out, err = shell(f"{QUANTIFY} info gone.laz {redirection}; exit ${{PIPESTATUS[0]}}")
    assert (status, out, err) == (1, "", "")


def test_files_are_whole_though_nothing_can_be_said(site, tmp_path):
    where = f"{QUANTIFY} volume {site}/pile.laz --area {site}/pile.geojson --out {tmp_path}/out"
    assert shell(f"{where} >&- 2>&-") == (0, "", "")
    assert (tmp_path / "out/report.json").read_text("utf-8").startswith("{")
    assert (tmp_path / "out/report.html").read_text("utf-8").endswith("</html>\n")


# --- paths


@pytest.fixture
def odd(tmp_path):
    """Paths that are no files: a loop of links, a pipe, a device, a name that is too long."""
    (tmp_path / "loop").symlink_to("other")
    (tmp_path / "other").symlink_to("loop")
    os.mkfifo(tmp_path / "pipe")
    return [tmp_path / "loop", tmp_path / "pipe", "/dev/zero", tmp_path / ("x" * 300), "", "loop/x"]


TASK = "https://127.0.0.1:9/project/1/task/00000000-0000-0000-0000-000000000000/"


@pytest.mark.parametrize(
    "command",
    [
        "info PATH",
        "volume PATH",
        "volume PATH.laz PATH.laz",
        "volume PATH.zip",
        "volume SITE/plain.csv --gcp PATH",
        "volume SITE/pile.laz --area PATH",
        "volume SITE/pile.laz --area PATH.gpkg",
        "scale SITE/pile.laz --gcp PATH",
        "scale SITE/pile.laz --gcp gone.yaml --out PATH",
        "gcp PATH",
        f"info {TASK} --ca PATH",
        f"info {TASK} --token-file PATH",
        "submit PATH --node http://127.0.0.1:9 --out JOB",
        "submit SITE --node http://127.0.0.1:9 --out JOB --gcp PATH",
        "resume PATH",
    ],
)
def test_paths_that_are_no_files_are_one_line(command, odd, site, tmp_path, run):
    for path in odd:
        words = command.replace("SITE", str(site)).replace("JOB", str(tmp_path / "job")).split()
        status, out, err = run(*(word.replace("PATH", str(path)) for word in words))
        assert status in (1, 2), (command, path)
        assert out == ""
        assert err.count("\n") == 1, err
        assert "this is a bug" not in err


@pytest.mark.parametrize("name", [b"bad\xff", b"new\nline", "\u202ename".encode()])
def test_odd_names_are_read_and_shown(name, site, tmp_path, run, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = Path(f"{os.fsdecode(name)}.laz")
    path.write_bytes((site / "pile.laz").read_bytes())
    status, out, err = run("info", path)
    assert (status, err) == (0, "")
    assert out.isprintable() or set(filter(lambda c: not c.isprintable(), out)) == {"\n"}
    source = next(line for line in out.splitlines() if line.split()[0] == "source")
    assert source.endswith(".laz")


def test_secrets_that_are_no_text_are_refused_and_not_shown(run):
    status, _, err = run("info", TASK, "--token", "top\udcffsecret")
    assert (status, err.count("\n")) == (1, 1)
    assert "not UTF-8" in err
    assert "secret" not in err


@pytest.mark.parametrize("seconds", [-(10**12), 10**12])
def test_times_that_no_calendar_has(seconds, site, monkeypatch):
    stat = Path.stat

    def odd_time(self, **more):
        found = stat(self, **more)
        if self.suffix != ".laz":
            return found
        numbers = list(found)
        numbers[8] = seconds
        return os.stat_result(numbers)

    monkeypatch.setattr(Path, "stat", odd_time)
    document = to_json(measure(site / "pile.laz", area=str(site / "pile.geojson")))
    (read,) = document["provenance"]["input"]
    assert read["mtime"] is None
    assert read["size"] > 0


# --- files that shrink while they are read

HEADER = (
    "ply\nformat binary_little_endian 1.0\nelement vertex {count}\n"
    "property double x\nproperty double y\nproperty double z\nend_header\n"
)


def test_a_ply_that_shrinks_while_it_is_read_is_truncated(tmp_path):
    count, path = 200_000, tmp_path / "a.ply"
    points = np.random.default_rng(1).random((count, 3))
    path.write_bytes(HEADER.format(count=count).encode() + points.tobytes())
    cloud = open_cloud([path])
    chunks = cloud.chunks(size=1000)
    assert len(next(chunks)) == 1000
    os.truncate(path, 100_000)
    with pytest.raises(CloudError, match="truncated: its header promises 200000 points"):
        list(chunks)


def test_nothing_is_mapped_into_memory():
    # What is mapped ends the process when another shortens the file.
    package = Path(base.__file__).parents[1]
    text = "".join(path.read_text("utf-8") for path in package.rglob("*.py"))
    assert "mmap." not in text
    assert "memmap(" not in text
