"""The command as a whole: wrong usage, info and demo, the files it writes, and its process."""

from __future__ import annotations

import contextlib
import json
import math
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from commands import UTM, only
from terrains import EAST

from quantify_client.__main__ import main as start
from quantify_client.cli import parse
from quantify_client.commands.arguments import COMMANDS, PRESETS
from quantify_client.commands.messages import complain
from quantify_client.options import BASES
from quantify_client.version import package_version

# --- wrong usage

FOR_TERRAIN = "--base, --base-points, --stage, --toe and --layer go with --shape terrain"


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ("--slices 5 --slice-height 0.1", "--slices and --slice-height exclude each other"),
        ("--shape terrain --method polar", "--floor and --accuracy go with --shape object"),
        ("--base plane --center-caps", FOR_TERRAIN),
        ("--base plane --hollow", FOR_TERRAIN),
        ("--shape terrain --floor none", "--floor and --accuracy go with --shape object"),
        ("--method polar --hollow", "go with --method section, not polar"),
        ("--method polar --max-gap 1", "go with --method section, not polar"),
        ("--method section --center-caps", "--center-caps goes with --method polar"),
        ("--max-gap 0", "give a length above 0"),
        ("--floor cellar", "give auto, none, plane or an elevation"),
        ("--floor inf", "give auto, none, plane or an elevation"),
        ("--shape object --base plane", FOR_TERRAIN),
        ("--shape object --layer lower", FOR_TERRAIN),
        ("--layer middle", "argument --layer: invalid choice: 'middle'"),
        ("--shape object --area AREA", "--area goes with --shape terrain"),
        ("--base plateau", f"give {', '.join(BASES)}, compare, vertices, ground or"),
        ("--base nan", "ground or an elevation"),
        ("--slices 0", "give auto or 1 to 10000"),
        ("--slices many", "give auto or 1 to 10000"),
        ("--slice-height 0", "give a length above 0"),
        ("--slice-height inf", "give a length above 0"),
        ("--density 0", "above 0"),
        ("--density nan", "above 0"),
        ("--density 1:-1", "the sigma of --density is -1.0; give tonnes per cubic metre from 0"),
        ("--density x", "T_PER_M3"),
        ("--density 1600", "for 1600 kg/m3 give 1.6"),
        ("--threads 0", "give a number from 1 to 256"),
        ("--units imperial", "imperial"),
        ("--method hull", "hull"),
        ("--fence 3", "--fence 3"),
        ("--slice-heigth 3", "did you mean --slice-height"),
        ("--max-gap=3 --hallow", "did you mean --hollow"),
    ],
)
def test_wrong_usage_is_status_2(options, said, site, run):
    options = options.replace("AREA", str(site / "pile.geojson")).split()
    status, out, err = run("volume", site / "pile.laz", *options)
    assert (status, out) == (2, "")
    assert said in " ".join(err.split())
    assert "Traceback" not in err


@pytest.mark.parametrize("arguments", [[], ["volume"], ["measure", "x.laz"], ["info"]])
def test_incomplete_commands_are_status_2(arguments, run):
    status, out, err = run(*arguments)
    assert (status, out) == (2, "")
    assert "usage: quantify-client" in err


def test_a_mistyped_command_is_told_what_was_meant(run):
    status, out, err = run("volum", "x.laz")
    assert (status, out) == (2, "")
    assert "there is no command 'volum'; did you mean volume?" in err


def test_a_command_alone_shows_the_help(run):
    status, out, err = run()
    assert (status, out) == (2, "")
    assert err == run("--help")[1]


def test_help_is_status_0(run):
    for command in ([], *([name] for name in COMMANDS)):
        status, out, err = run(*command, "--help")
        assert (status, err) == (0, "")
        assert out.startswith("usage: quantify-client")
        assert "examples:\n  quantify-client" in out


def test_examples_of_the_help_are_commands_as_they_should_be():
    for name, command in COMMANDS.items():
        for example in command.examples:
            assert parse(example.split()).command == name


def test_version_is_the_package_s(run):
    assert run("--version") == (0, f"quantify-client {package_version()}\n", "")


def test_presets_are_the_servers():
    from quantify_client.sfm.servers import presets

    assert tuple(presets.PRESETS) == PRESETS


# --- info and demo


def test_info_tells_what_is_in_there(site, run):
    status, out, err = run("info", site / "pile.laz", "--json")
    assert (status, err) == (0, "")
    told = json.loads(out)
    assert (told["points"], told["format"], told["crs"]) == (30_000, "laz", UTM)
    assert told["mean_spacing_m"] == pytest.approx(40 / math.sqrt(30_000), rel=0.01)
    assert told["bounds"]["max_x"] == pytest.approx(EAST + 40, abs=0.01)
    assert told["files"][0]["path"] == str(site / "pile.laz")
    status, out, _ = run("info", site / "pile.laz")
    assert status == 0
    assert UTM in out
    assert "30000" in out
    assert re.search("OpenDroneMap +no$", out, re.MULTILINE)
    assert re.search("mean spacing, m +0.231$", out, re.MULTILINE)
    assert "_" not in out.replace(str(site), "")  # words, no keys of the JSON


def test_info_gives_each_warning_its_own_line(tmp_path, run):
    path = tmp_path / "ground.xyz"
    grid = np.stack(np.meshgrid(np.arange(40.0), np.arange(40.0), [0.0]), axis=-1).reshape(-1, 3)
    grid[-3:, 2] = -9999.0
    np.savetxt(path, grid)
    _, out, _ = run("info", path)
    assert "min z 0.000" in out  # that all other heights are 0 makes no height of -9999
    assert re.search("^       warnings  3 points have the height -9999", out, re.MULTILINE)
    assert re.search("^ {17}the cloud has neither a CRS nor a unit", out, re.MULTILINE)
    assert re.search("^ +measured in  none$", out, re.MULTILINE)
    assert "-0.000" not in out


def test_info_of_an_archive_names_the_archive(project, run):
    told = json.loads(run("info", project.parent / "all.zip", "--json")[1])
    assert told["odm"] is True
    assert (told["crs"], told["crs_origin"]) == (UTM, "coords.txt")
    assert [file["path"] for file in told["files"]] == [str(project.parent / "all.zip")]


def test_demo_measures_the_bundled_cloud(document, tmp_path):
    told = document("demo", "--out", tmp_path / "demo")
    names = [result["name"] for result in told["results"]]
    assert names == ["round structure", "red car", "white car", "grassy hollow"]
    net = [result["volume_m3"] for result in told["results"]]
    assert net[1] == pytest.approx(8.6, abs=0.9)
    assert net[2] == pytest.approx(8.4, abs=0.9)
    assert net[3] < 0 < net[0]
    assert (tmp_path / "demo/report.html").stat().st_size > 100_000


# --- files


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_out_holds_every_file_of_the_report(site, tmp_path, document):
    where = ("volume", site / "pile.laz", "--area", site / "pile.geojson")
    told = document(*where, "--out", tmp_path / "a/b")
    names = ["area-01-pile.png", "areas.geojson", "report.html", "report.json"]
    assert sorted(contents(tmp_path / "a/b")) == [*names, "slices.csv"]
    assert json.loads((tmp_path / "a/b/report.json").read_text()) == told


@pytest.mark.one_python
def test_earlier_results_stay_until_new_ones_are_complete(site, tmp_path, run, monkeypatch):
    out = tmp_path / "out"
    where = ("volume", site / "pile.laz", "--area", site / "pile.geojson")
    assert run(*where, "--out", out)[0] == 0
    before = contents(out)

    (tmp_path / "short.laz").write_bytes((site / "pile.laz").read_bytes()[:-5000])
    assert run("volume", tmp_path / "short.laz", "--out", out)[0] == 1
    assert contents(out) == before

    def full(*args):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("quantify_client.report.figures.pictures.area_picture", full)
    status, _, err = run(*where, "--out", out)
    assert (status, err.count("\n")) == (1, 1)
    assert "No space left on device" in err
    assert contents(out) == before

    def stopped(*args):
        raise KeyboardInterrupt

    monkeypatch.setattr("quantify_client.report.figures.pictures.area_picture", stopped)
    status, _, err = run(*where, "--out", out)
    assert (status, err.count("\n")) == (130, 1)
    assert contents(out) == before


# --- as a process of its own

COMMAND = [sys.executable, "-m", "quantify_client"]


def test_a_process_says_the_same(site):
    where = [*COMMAND, "volume", site / "pile.laz", "--area", site / "pile.geojson", "--json"]
    done = subprocess.run(where, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert only(json.loads(done.stdout))["name"] == "pile"


def test_a_reader_that_goes_away_is_no_fault(site):
    process = subprocess.Popen(
        [*COMMAND, "info", site / "pile.laz"], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    process.stdout.close()
    assert process.stderr.read() == b""
    process.stderr.close()
    assert process.wait() == 1


def opened(process, path):
    """Whether a process has a file open (Linux)."""
    with contextlib.suppress(FileNotFoundError):  # a file that is closed meanwhile
        links = Path(f"/proc/{process.pid}/fd").glob("*")
        return any(os.path.realpath(link) == str(path) for link in links)
    return False


class Interrupted:
    """Reading the command line's module meets Ctrl-C."""

    @staticmethod
    def find_spec(name, *where):
        if name == "quantify_client.cli":
            raise KeyboardInterrupt


def test_ctrl_c_while_it_starts_is_one_line_too(monkeypatch, capsys):
    monkeypatch.delitem(sys.modules, "quantify_client.cli")
    monkeypatch.setattr(sys, "meta_path", [Interrupted, *sys.meta_path])
    assert start() == 130
    assert capsys.readouterr() == ("", "quantify-client: error: interrupted\n")


def test_nothing_slow_is_read_before_ctrl_c_is_caught():
    code = "import sys, quantify_client.__main__; sys.exit('numpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="needs /proc")
def test_ctrl_c_ends_it_at_once_and_leaves_nothing(site, tmp_path):
    block = (site / "plain.csv").read_bytes().split(b"\n", 1)[1]
    cloud, out = tmp_path.resolve() / "long.csv", tmp_path / "out"
    cloud.write_bytes(block * 80)
    process = subprocess.Popen(
        [*COMMAND, "volume", cloud, "--shape", "terrain", "--out", out],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    deadline = time.monotonic() + 60
    while not opened(process, cloud):
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    told, said = process.communicate(timeout=30)
    assert process.returncode == 130
    assert told == b""
    assert said == b"quantify-client: error: interrupted; no file is half written\n"
    assert not out.exists()


def test_a_word_that_no_screen_shows_is_told_by_both_its_ends(capsys):
    assert complain(f"far/{'1' * 5000}/cloud.laz: is empty", 1) == 1
    told = capsys.readouterr().err
    assert len(told) < 400
    assert told.startswith("quantify-client: error: far/111")
    assert told.endswith("11/cloud.laz: is empty\n")
