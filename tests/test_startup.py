"""What a command imports; benchmarks/startup.py measures how long that takes."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from clouds import write_las
from commands import UTM

# What is imported: no different on a second Python.
pytestmark = pytest.mark.one_python

#: Packages that take from a fiftieth to half a second to import.
SLOW = {
    *("numpy", "scipy", "pyproj", "shapely", "laspy", "lazrs", "matplotlib", "rich", "requests"),
    *("pyodm", "yaml", "plyfile", "pyogrio", "rasterio", "ezdxf", "PIL"),
    *("urllib.request", "http.client"),
}

CODE = """
import json, sys
from quantify_client.cli import main
status = main(sys.argv[1:])
print(json.dumps(sorted(sys.modules)), file=sys.stderr)
sys.exit(status)
"""


def imported(*arguments, status=0):
    """The modules that a command has imported when it ends."""
    command = [sys.executable, "-c", CODE, *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == status, done.stderr
    return set(eval(done.stderr.splitlines()[-1]))  # noqa: S307 - our own list


@pytest.mark.parametrize(
    ("arguments", "status"),
    [
        ([], 2),
        (["--help"], 0),
        (["--version"], 0),
        (["volume", "--help"], 0),
        (["submit", "--help"], 0),
        (["volum"], 2),
        (["volume", "x.laz", "--slice-heigth", "3"], 2),
    ],
)
def test_help_and_wrong_usage_import_nothing_slow(arguments, status):
    assert not imported(*arguments, status=status) & SLOW


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    rng = np.random.default_rng(5)
    x, y = rng.uniform(0, 40, (2, 10_000))
    points = np.column_stack([500_000 + x, 5_000_000 + y, 100 + 0.1 * np.sin(x)])
    return write_las(tmp_path_factory.mktemp("small") / "small.laz", points, crs=UTM)


def test_terrain_imports_no_statistics_pictures_or_servers(small):
    found = imported("volume", small, "--json")
    unused = {"scipy.stats", "scipy.optimize", "scipy.interpolate", "matplotlib", "rich", "pyodm"}
    assert not found & {*unused, "yaml", "plyfile", "pyogrio", "rasterio", "ezdxf", "PIL"}
    assert not {name for name in found if name.startswith("quantify_client.scaler")}
    assert not {name for name in found if name.startswith("quantify_client.volcalc.body")}


def test_a_body_imports_nothing_of_control(small):
    found = imported("volume", small, "--shape", "object", "--method", "polar", "--json")
    assert not found & {"scipy.stats", "scipy.optimize", "matplotlib", "rich", "pyodm", "yaml"}
    assert not {name for name in found if name.startswith("quantify_client.scaler")}


def test_info_imports_no_statistics(small):
    found = imported("info", small, "--json")
    assert not found & {"scipy.stats", "scipy.optimize", "matplotlib", "rich", "pyodm", "yaml"}


def test_what_names_a_file_is_completed_by_files():
    """Where shtab makes completions; it is asked nothing when the command runs."""
    from quantify_client.cli import parser

    (commands,) = (a for a in parser()._actions if a.dest == "command")
    for command, part in commands.choices.items():
        completed = {a.dest for a in part._actions if hasattr(a, "complete")}
        assert completed or command == "demo"
        assert completed >= {a.dest for a in part._actions if a.dest in ("sources", "area", "gcp")}


def test_completions_for_a_shell():
    shtab = pytest.importorskip("shtab")
    from quantify_client.cli import parser

    script = shtab.complete(parser(), "bash")
    assert "--slice-height" in script
    assert "_quantify_client_volume_" in script
