"""The command line as a contract: statuses, the JSON document, and what each option does."""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
import time
import zipfile
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from clouds import write_ept, write_las, write_text
from shapely.geometry import mapping
from terrains import EAST, LEVEL, NORTH, Errors, circle, cone, flat, placed, survey

import quantify_client
from quantify_client.cli import main

PILE = cone(radius=8.0, top=4.0).on(flat)
UTM = "EPSG:32615"
SCHEMA = json.loads((Path(quantify_client.__file__).parent / "report/schema.json").read_text())
DOCUMENT = {
    *("schema", "source", "crs", "length_unit", "shape", "method", "grid_scale_factor", "scale"),
    *("results", "warnings", "provenance"),
}
RESULT = {
    *("name", "volume_m3", "cut_m3", "fill_m3", "std_m3", "interval95_m3", "cut_std_m3"),
    *("cut_interval95_m3", "fill_std_m3", "fill_interval95_m3", "budget", "area_m2"),
    *("surface_area_m2", "perimeter_m", "min_z_m", "max_z_m", "max_height_m", "coverage"),
    *("points_used", "points_left_out", "slice_height_m", "slices", "mass_t", "mass_std_t"),
    *("base", "checks", "warnings"),
}


def features(*polygons, names=(), crs=UTM):
    """A GeoJSON text with one feature for each polygon."""
    names = [*names, *[None] * len(polygons)]
    document = {
        "type": "FeatureCollection",
        "features": [
            {
                "type": "Feature",
                "properties": {} if name is None else {"name": name},
                "geometry": mapping(polygon),
            }
            for polygon, name in zip(polygons, names)
        ],
    }
    if crs:
        document["crs"] = {"type": "name", "properties": {"name": crs}}
    return json.dumps(document)


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """A cone of 268.08 m3 as LAZ in UTM and without a CRS, and its outline."""
    folder = tmp_path_factory.mktemp("site")
    points = survey(PILE.height, Errors(0.01, 0.0), 30_000)
    write_las(folder / "pile.laz", points, crs=UTM)
    local = points - [EAST, NORTH, LEVEL] + [1000.0, 2000.0, 50.0]
    np.savetxt(folder / "plain.csv", local, "%.3f", ",", header="x,y,z", comments="")
    # Coordinates without two alike: rounding them in other units changes no order.
    body = np.random.default_rng(7).normal(size=(5000, 3))
    np.savetxt(folder / "body.xyz", body / np.linalg.norm(body, axis=1)[:, None], "%.15f")
    (folder / "pile.geojson").write_text(features(PILE.area, names=["pile"]))
    np.save(folder / "points.npy", points)
    return folder


@pytest.fixture
def run(capsys):
    """Run the command line in this process; return its status, stdout and stderr."""

    def runner(*arguments):
        status = main([str(argument) for argument in arguments])
        out, err = capsys.readouterr()
        return status, out, err

    return runner


@pytest.fixture
def document(run):
    """Run with --json; check everything that every such run must hold, and return the document."""

    def runner(*arguments, status=0):
        found, out, err = run(*arguments, "--json")
        assert found == status, err
        document = json.loads(out)  # which also refuses anything before or after it
        jsonschema.Draft202012Validator(SCHEMA).validate(document)
        assert document.keys() == DOCUMENT
        for result in document["results"]:
            assert result.keys() == {"name", "error"} or result.keys() >= RESULT
        if status == 0:
            assert err == ""
        return document

    return runner


def only(document):
    (result,) = document["results"]
    return result


# --- volume: numbers


def test_json_holds_the_volume_and_what_decides_it(site, document):
    told = document("volume", site / "pile.laz", "--area", site / "pile.geojson")
    result = only(told)
    assert (told["schema"], told["crs"], told["length_unit"]) == ("quantify-client/1", UTM, "m")
    assert (told["shape"], told["scale"], result["name"]) == ("terrain", None, "pile")
    k = told["grid_scale_factor"]
    # On the central meridian k is 0.9996; k R / (R + h) at 102 m is 16e-6 less.
    assert k == pytest.approx(0.999584, abs=2e-6)
    assert result["volume_m3"] == pytest.approx(PILE.volume / k**2, rel=0.01)
    assert result["volume_m3"] == pytest.approx(result["cut_m3"] - result["fill_m3"], rel=1e-9)
    squares = sum(item["std_m3"] ** 2 for item in result["budget"])
    assert result["std_m3"] == pytest.approx(math.sqrt(squares), rel=1e-9)
    low, high = result["interval95_m3"]
    assert low < PILE.volume / k**2 < high
    assert high - low == pytest.approx(2 * 1.96 * result["std_m3"], rel=1e-9)
    assert result["area_m2"] == pytest.approx(PILE.area.area / k**2, rel=1e-9)
    assert result["perimeter_m"] == pytest.approx(PILE.area.length / k, rel=1e-9)
    assert result["max_height_m"] == pytest.approx(4.0, abs=0.15)
    assert result["mass_t"] is None
    assert result["mass_std_t"] is None
    told_of = told["provenance"]
    assert told_of["version"] == "0.1.0"
    assert told_of["options"]["area"] == str(site / "pile.geojson")
    assert told_of["input"][0]["size"] == (site / "pile.laz").stat().st_size


def test_slices_sum_to_net_whatever_their_number(site, document):
    where = ("volume", site / "pile.laz", "--area", site / "pile.geojson")
    nets = []
    for choice in ([], ["--slices", 7], ["--slice-height", 0.25], ["--slices", 400]):
        result = only(document(*where, *choice))
        nets.append(result["volume_m3"])
        assert sum(part["volume_m3"] for part in result["slices"]) == pytest.approx(nets[-1])
    assert np.ptp(nets) < 1e-9 * nets[0]


def test_slice_height_counts_from_the_base(site, document):
    choice = ("--area", site / "pile.geojson", "--slice-height", 0.25)
    result = only(document("volume", site / "pile.laz", *choice))
    assert result["slice_height_m"] == 0.25
    for part in result["slices"]:
        edge = (part["z_m"] - part["height_m"] / 2) / 0.25
        assert edge == pytest.approx(round(edge), abs=1e-9)
        assert part["volume_m3"] * part["z_m"] >= 0


def test_number_of_slices_is_split_at_the_base(site, document):
    choice = ("--area", site / "pile.geojson", "--slices", 5)
    result = only(document("volume", site / "pile.laz", *choice))
    assert len(result["slices"]) == 6
    assert result["slice_height_m"] is None


def test_compare_lists_every_base(site, run, document):
    where = ("volume", site / "pile.laz", "--area", site / "pile.geojson", "--base")
    result = only(document(*where, "compare"))
    names = ["triangulate", "plane", "average", "lowest", "highest"]
    assert [row["base"] for row in result["bases"]] == names
    assert result["base"] == "triangulate"
    volumes = [row["volume_m3"] for row in result["bases"]]
    assert volumes[4] < volumes[2] < volumes[3]
    assert only(document(*where, "plane"))["volume_m3"] == pytest.approx(volumes[1], rel=1e-12)
    status, out, _ = run(*where, "compare")
    assert status == 0
    assert all(name in out for name in names)


def test_an_elevation_is_a_base(site, document):
    """A disc of radius 9 between the ground at 100 and a base 1 m below it is all cut."""
    where = ("volume", site / "pile.laz", "--area", site / "pile.geojson", "--grid", "--base")
    result = only(document(*where, LEVEL - 1))
    assert result["base"] == LEVEL - 1
    assert result["cut_m3"] == pytest.approx(PILE.volume + PILE.area.area, rel=0.005)
    assert result["fill_m3"] == 0


def test_density_adds_tonnes_of_cut(site, document):
    choice = ("--area", site / "pile.geojson", "--density", "1.6:0.1")
    result = only(document("volume", site / "pile.laz", *choice))
    assert result["mass_t"] == pytest.approx(1.6 * result["cut_m3"], rel=1e-12)
    spread = math.hypot(1.6 * result["cut_std_m3"], 0.1 * result["cut_m3"])
    assert result["mass_std_t"] == pytest.approx(spread, rel=1e-12)


def test_us_units_are_for_people_only(site, run, document):
    where = ("volume", site / "pile.laz", "--area", site / "pile.geojson")
    metric = only(document(*where))
    assert only(document(*where, "--units", "us")) == metric
    _, out, _ = run(*where, "--units", "us")
    assert "yd³" in out
    assert "m³" not in out
    assert f"{metric['volume_m3'] / 0.9144**3:.0f}" in out


def test_grid_leaves_out_the_correction_to_the_ground(site, document):
    where = ("volume", site / "pile.laz", "--area", site / "pile.geojson")
    ground, grid = document(*where), document(*where, "--grid")
    assert grid["grid_scale_factor"] is None
    ratio = only(grid)["volume_m3"] / only(ground)["volume_m3"]
    assert ratio == pytest.approx(ground["grid_scale_factor"] ** 2, rel=1e-9)


@pytest.mark.parametrize(("unit", "metres"), [("ft", 0.3048), ("us-ft", 1200 / 3937), ("m", 1.0)])
def test_source_unit_scales_a_cloud_that_does_not_say(unit, metres, site, document):
    whole = ("volume", site / "body.xyz", "--method", "polar")
    unknown, known = document(*whole), document(*whole, "--source-unit", unit)
    assert (unknown["length_unit"], known["length_unit"]) == ("unknown", "m")
    assert any("--source-unit" in warning for warning in unknown["warnings"])
    ratio = only(known)["volume_m3"] / only(unknown)["volume_m3"]
    assert ratio == pytest.approx(metres**3, rel=1e-9)


def test_terrain_in_feet_is_measured_in_metres(site, tmp_path, document):
    plain = np.loadtxt(site / "plain.csv", delimiter=",", skiprows=1)
    write_text(tmp_path / "feet.xyz", plain / 0.3048, " ")
    result = only(
        document("volume", tmp_path / "feet.xyz", "--shape", "terrain", "--source-unit", "ft")
    )
    # without an area: the cloud's own outline, which reaches the flat edge
    assert result["volume_m3"] == pytest.approx(PILE.volume, rel=0.02)


# --- volume: sources


def test_tiles_are_one_survey(site, tmp_path, document):
    points = np.load(site / "points.npy")
    west = points[:, 0] < EAST + 20
    tiles = [
        write_las(tmp_path / "w.laz", points[west], crs=UTM),
        write_las(tmp_path / "e.las", points[~west], crs=UTM),
    ]
    area = ("--area", site / "pile.geojson")
    whole = only(document("volume", site / "pile.laz", *area))
    both = only(document("volume", *tiles, *area))
    assert both["volume_m3"] == pytest.approx(whole["volume_m3"], rel=1e-12)
    assert both["points_used"] == whole["points_used"]


@pytest.fixture(scope="module")
def project(site, tmp_path_factory):
    """An ODM project folder, and its all.zip."""
    root = tmp_path_factory.mktemp("odm") / "quarry"
    (root / "odm_georeferencing").mkdir(parents=True)
    model = root / "odm_georeferencing" / "odm_georeferenced_model.laz"
    write_las(model, np.load(site / "points.npy"))
    (root / "odm_georeferencing" / "coords.txt").write_text("WGS84 UTM 15N\n500000 5000000\n")
    with zipfile.ZipFile(root.parent / "all.zip", "w") as archive:
        for file in sorted((root / "odm_georeferencing").iterdir()):
            archive.write(file, f"odm_georeferencing/{file.name}")
        archive.writestr("odm_report/stats.json", "{}")
    return root


def test_odm_folder_and_archive_give_the_same(project, site, document):
    area = ("--area", site / "pile.geojson")
    folder = document("volume", project, *area)
    archive = document("volume", project.parent / "all.zip", *area)
    assert folder["crs"] == archive["crs"] == UTM
    # ODM's clouds are metric at their own height: k alone, without the way down to the ellipsoid
    assert folder["grid_scale_factor"] == pytest.approx(0.9996, abs=1e-6)
    assert folder["results"] == archive["results"]
    assert only(folder)["volume_m3"] == pytest.approx(PILE.volume / 0.9996**2, rel=0.01)


def test_result_without_polygons_is_named_after_the_source(project, document):
    assert only(document("volume", project))["name"] == "quarry"


def test_ept_is_read_where_the_area_is(site, tmp_path, document):
    ept = write_ept(tmp_path / "ept", np.load(site / "points.npy"))
    result = only(document("volume", ept, "--area", site / "pile.geojson", "--grid"))
    assert result["volume_m3"] == pytest.approx(PILE.volume, rel=0.01)


# --- volume: areas


def test_names_are_unique_and_a_failure_leaves_the_others_complete(site, tmp_path, run, document):
    far = placed(circle(5, 5000, 5000))
    drawn = [PILE.area, PILE.area, far, PILE.area]
    (tmp_path / "areas.geojson").write_text(features(*drawn, names=["p", "p", "far"]))
    where = ("volume", site / "pile.laz", "--area", tmp_path / "areas.geojson")
    told = document(*where, "--out", tmp_path / "out", status=1)
    first, second, failed, last = told["results"]
    assert [r["name"] for r in told["results"]] == ["p", "p-2", "far", "area-4"]
    assert first["volume_m3"] == second["volume_m3"] == last["volume_m3"]
    assert failed.keys() == {"name", "error"}
    assert "outside the cloud" in failed["error"]
    assert json.loads((tmp_path / "out/report.json").read_text()) == told
    status, out, err = run(*where)
    assert status == 1
    assert "far: not measured" in out
    assert err.count("\n") == 1
    assert err.startswith("quantify-client: error: far: lies outside the cloud")


def test_every_polygon_may_fail(site, tmp_path, document):
    (tmp_path / "a.geojson").write_text(features(placed(circle(5, 5000, 5000))))
    told = document("volume", site / "pile.laz", "--area", tmp_path / "a.geojson", status=1)
    assert only(told).keys() == {"name", "error"}


def test_area_in_degrees_is_moved_to_the_cloud(site, tmp_path, document):
    import pyproj
    import shapely

    back = pyproj.Transformer.from_crs(UTM, "OGC:CRS84", always_xy=True)
    lonlat = shapely.transform(PILE.area, lambda xy: np.column_stack(back.transform(*xy.T)))
    (tmp_path / "a.geojson").write_text(features(lonlat, crs=None))
    moved = only(document("volume", site / "pile.laz", "--area", tmp_path / "a.geojson"))
    drawn = only(document("volume", site / "pile.laz", "--area", site / "pile.geojson"))
    assert moved["volume_m3"] == pytest.approx(drawn["volume_m3"], rel=1e-3)


# --- object


def test_the_paper_s_method(site, document):
    whole = ("volume", site / "plain.csv", "--shape", "object", "--method", "polar")
    told = document(*whole, "--slices", 50)
    result = only(told)
    assert (told["shape"], told["method"], result["name"]) == ("object", "polar", "plain")
    assert len(result["slices"]) == 50
    assert sum(part["volume_m3"] for part in result["slices"]) == pytest.approx(result["volume_m3"])
    for key in ("cut_m3", "fill_m3", "std_m3", "interval95_m3", "coverage", "base", "bases"):
        assert result[key] is None
    assert result["budget"] == result["checks"] == []
    assert len(only(document(*whole, "--slice-height", 0.5))["slices"]) in (8, 9)
    assert only(document(*whole, "--density", 2))["mass_t"] == 2 * result["volume_m3"]
    assert only(document(*whole, "--density", 2))["mass_std_t"] is None


@pytest.mark.parametrize(
    ("source", "options", "shape"),
    [
        ("plain.csv", [], "object"),
        ("plain.csv", ["--base", "plane"], "terrain"),
        ("plain.csv", ["--area"], "terrain"),
        ("plain.csv", ["--shape", "terrain"], "terrain"),
        ("pile.laz", [], "terrain"),
        ("pile.laz", ["--shape", "object"], "object"),
        ("pile.laz", ["--center-caps"], "object"),
        ("pile.laz", ["--method", "polar"], "object"),
    ],
)
def test_auto_shape_is_chosen_by_options_and_source(
    source, options, shape, site, tmp_path, document, run
):
    if options == ["--area"]:
        local = circle(9, 1020, 2020)
        (tmp_path / "local.geojson").write_text(features(local, crs=None))
        options = ["--area", tmp_path / "local.geojson"]
    assert document("volume", site / source, *options)["shape"] == shape
    assert f"shape {shape}" in " ".join(run("volume", site / source, *options)[1].split())


def test_an_odm_source_without_a_crs_is_terrain(site, tmp_path, document):
    (tmp_path / "p/odm_georeferencing").mkdir(parents=True)
    model = tmp_path / "p/odm_georeferencing/odm_georeferenced_model.laz"
    write_las(model, np.load(site / "points.npy"))
    told = document("volume", tmp_path / "p")
    assert (told["shape"], told["crs"], told["length_unit"]) == ("terrain", None, "unknown")


# --- wrong usage


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ("--slices 5 --slice-height 0.1", "--slices and --slice-height exclude each other"),
        ("--shape terrain --method polar", "--method and --center-caps go with --shape object"),
        ("--base plane --center-caps", "--base with terrain"),
        ("--shape object --base plane", "--base goes with --shape terrain"),
        ("--shape object --area AREA", "--area goes with --shape terrain"),
        ("--base plateau", "give triangulate, plane, average, lowest, highest, compare or"),
        ("--base nan", "no elevation"),
        ("--slices 0", "give auto or 1 to 10000"),
        ("--slices many", "not auto or a whole number"),
        ("--slice-height 0", "give a length above 0"),
        ("--slice-height inf", "give a length above 0"),
        ("--density 0", "above 0"),
        ("--density nan", "above 0"),
        ("--density 1:-1", "not 0 or more"),
        ("--density x", "T_PER_M3"),
        ("--threads 0", "not from 1 to 256"),
        ("--units imperial", "invalid choice"),
        ("--method section", "invalid choice"),
        ("--fence 3", "unrecognized arguments"),
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


def test_help_is_status_0(run):
    for command in ([], ["volume"], ["info"], ["demo"]):
        status, out, err = run(*command, "--help")
        assert (status, err) == (0, "")
        assert out.startswith("usage: quantify-client")


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

    monkeypatch.setattr("quantify_client.report.pictures.area_picture", full)
    status, _, err = run(*where, "--out", out)
    assert (status, err.count("\n")) == (1, 1)
    assert "No space left on device" in err
    assert contents(out) == before

    def stopped(*args):
        raise KeyboardInterrupt

    monkeypatch.setattr("quantify_client.report.pictures.area_picture", stopped)
    status, _, err = run(*where, "--out", out)
    assert (status, err.count("\n")) == (130, 1)
    assert contents(out) == before


# --- as a process of its own

COMMAND = [sys.executable, "-m", "quantify_client.cli"]


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
    links = Path(f"/proc/{process.pid}/fd").glob("*")
    return any(os.path.realpath(link) == str(path) for link in links)


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
