"""A hundred damaged inputs, and what each run is judged by."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

RUN = Path(__file__).with_name("run.py")
pytestmark = pytest.mark.skipif(not hasattr(__import__("os"), "fork"), reason="forks processes")


def _fuzz(folder: Path, *arguments: str, script: str = "") -> subprocess.CompletedProcess[str]:
    command = [sys.executable, *(["-c", script] if script else [str(RUN)])]
    more = ["--keep", str(folder / "kept"), *arguments]
    return subprocess.run(
        [*command, *more], capture_output=True, text=True, cwd=folder, check=False
    )


@pytest.mark.one_python
def test_a_hundred_damaged_inputs_end_in_words(tmp_path):
    done = _fuzz(tmp_path, "--runs", "100", "--seed", "14")
    assert done.returncode == 0, done.stdout + done.stderr
    assert not (tmp_path / "kept").exists()


@pytest.mark.one_python
def test_undamaged_inputs_are_read(tmp_path):
    """A fifth of the commands, each kind among them; without --every N it is all."""
    done = _fuzz(tmp_path, "--honest", "--every", "5")
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.one_python
@pytest.mark.parametrize("runs", ["79 1684", "80 1745", "81 236 772"])
def test_what_once_failed_ends_in_words(runs, tmp_path):
    """A step of an adjustment that overflows; a closed line of no length; columns of EPT that are
    none; a chunk table that makes the decoder panic.
    """
    seed, *numbers = runs.split()
    done = _fuzz(tmp_path, "--seed", seed, *(f"--only={number}" for number in numbers))
    assert done.returncode == 0, done.stdout + done.stderr


_FAULTS = {
    "raise ValueError(1)": "Traceback",
    "print('quantify-client: error: this is a bug, x', file=sys.stderr); return 1": "is a bug",
    "os.abort()": "ended with -6",
    "print('RuntimeWarning: overflow', file=sys.stderr); return 0": "RuntimeWarning",
    "bytearray(2 << 30); return 0": "Traceback",
    "open('x', 'w').close(); return 0": "leaves x in its folder",
    "tempfile.mkdtemp(prefix='q'); return 0": "in TMPDIR",
    "open('../in/area.geojson', 'w').close(); return 0": "changes area.geojson",
    "return 3": "ended with 3",
    "return 1": "says no error in one line",
}
_BROKEN = """
import os, runpy, sys, tempfile
sys.argv[0] = {run!r}
sys.path[:0] = [{tests!r}, {root!r}]
import quantify_client.cli as cli
{functions}
def main(arguments):
    number = int(os.path.basename(os.path.dirname(os.getcwd()))[4:])
    return globals()["fault%d" % number](arguments)
cli.main = main
runpy.run_path({run!r}, run_name="__main__")
"""


def test_faults_are_seen(tmp_path):
    tests = RUN.parents[1]
    functions = "".join(
        f"def fault{number}(arguments):\n    {body}\n" for number, body in enumerate(_FAULTS)
    )
    about = {"run": str(RUN), "tests": str(tests), "root": str(tests.parent)}
    script = _BROKEN.format(functions=functions, **about)
    done = _fuzz(tmp_path, "--runs", str(len(_FAULTS)), script=script)
    assert done.returncode == 1, done.stdout + done.stderr
    for number, words in enumerate(_FAULTS.values()):
        told = done.stdout.split(f"run {number} (")[1].split("again:")[0]
        assert words in told, (number, told)
    assert "again: --seed 1 --only 0" in done.stdout
    assert (tmp_path / "kept" / "0-old.las" / "README.txt").exists()
