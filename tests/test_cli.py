"""`volume` as a contract: the JSON document, its numbers, and what each option does."""

from __future__ import annotations

import json
import math
import re

import numpy as np
import pytest
import shapely
import shapely.affinity
from clouds import write_ept, write_las, write_text
from commands import PILE, UTM, features, only, texts
from shapely.geometry import box
from terrains import EAST, LEVEL, NORTH, circle, placed

from quantify_client.options import BASES

# --- volume: numbers


def test_json_holds_the_volume_and_what_decides_it(site, document):
    told = document("volume", site / "pile.laz", "--area", site / "pile.geojson")
    result = only(told)
    assert (told["schema"], told["crs"], told["length_unit"]) == ("quantify-client/2", UTM, "m")
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
    # The highest cell is a quarter of a metre wide: the mean of a tip.
    assert result["max_height_m"] == pytest.approx(4.0, abs=0.2)
    assert result["mass_t"] is None
    assert result["mass_std_t"] is None
    told_of = told["provenance"]
    assert told_of["version"] == "0.1.0"
    assert told_of["options"]["area"] == str(site / "pile.geojson")
    assert told_of["input"][0]["size"] == (site / "pile.laz").stat().st_size


@pytest.mark.one_python
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
    assert tuple(row["base"] for row in result["bases"]) == BASES
    assert result["base"] == BASES[0]
    volumes = {row["base"]: row["volume_m3"] for row in result["bases"]}
    assert volumes["highest"] < volumes["average"] < volumes["lowest"]
    plane = only(document(*where, "plane"))["volume_m3"]
    assert plane == pytest.approx(volumes["plane"], rel=1e-12)
    status, out, _ = run(*where, "compare")
    assert status == 0
    assert all(name in out for name in BASES)


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


@pytest.fixture(scope="module")
def tree(tmp_path_factory):
    """A yard 12 m wide under a closed row of trees 3 m high, of which half of the points are."""
    folder, rng = tmp_path_factory.mktemp("tree"), np.random.default_rng(3)
    x, y = rng.uniform(0, 40, (2, 25_000))
    crown = (np.abs(x - 20) < 9) & (np.abs(y - 20) < 9) & (rng.random(len(x)) < 0.5)
    z = LEVEL + 3.0 * crown + rng.normal(0, 0.01, len(x))
    write_las(folder / "tree.las", np.column_stack([EAST + x, NORTH + y, z]), crs=UTM)
    yard = placed(box(14, 14, 26, 26))
    (folder / "yard.geojson").write_text(features(yard, names=["yard"]))
    return (
        "volume",
        folder / "tree.las",
        "--area",
        folder / "yard.geojson",
        "--base",
        LEVEL,
        "--grid",
    )


def test_the_surface_that_is_measured_where_there_are_two(tree, document):
    results = {}
    for layer, height in (("upper", 3.0), ("lower", 0.0), ("mean", 1.5)):
        told = document(*tree, "--layer", layer)
        result = results[layer] = only(told)
        assert told["provenance"]["options"]["layer"] == layer
        assert result["volume_m3"] == pytest.approx(height * 144, abs=12)
        (notice,) = (one for one in result["warnings"] if one["code"] == "two-surfaces")
        assert notice["values"]["layer"] == layer
        assert notice["values"]["apart_m"] == pytest.approx(3.0, abs=0.1)
        assert ("layer" in {item["source"] for item in result["budget"]}) == (layer != "mean")
    assert only(document(*tree))["volume_m3"] == results["upper"]["volume_m3"]


def test_two_surfaces_are_told_to_people(tree, run):
    status, out, err = run(*tree)
    assert status == 0
    assert "there are two surfaces, one about 3 m above the other" in " ".join((out + err).split())


def test_us_units_are_for_people_only(site, run, document):
    where = ("volume", site / "pile.laz", "--area", site / "pile.geojson")
    metric = only(document(*where))
    assert only(document(*where, "--units", "us")) == metric
    _, out, _ = run(*where, "--units", "us")
    assert "yd³" in out
    assert "m³" not in out
    shown = [float(number) for number in re.findall(r"\d+\.\d+", out)]
    assert min(abs(number - metric["volume_m3"] / 0.9144**3) for number in shown) < 0.06


def test_toe_moves_the_outline_to_where_the_pile_ends(site, document, tmp_path):
    """A cone of radius 8 m, drawn with 6 m and with 9 m."""
    outline = json.loads((site / "pile.geojson").read_text())
    small = tmp_path / "small.geojson"
    polygon = shapely.affinity.scale(shapely.from_geojson(json.dumps(outline)), 6 / 9, 6 / 9)
    small.write_text(shapely.to_geojson(polygon))
    asked = only(document("volume", site / "pile.laz", "--area", site / "pile.geojson"))
    moved = only(document("volume", site / "pile.laz", "--area", small, "--toe", "auto"))
    limited = only(document("volume", site / "pile.laz", "--area", small, "--toe", 0.5))
    assert moved["volume_m3"] == pytest.approx(asked["volume_m3"], rel=0.005)
    (notice,) = moved["warnings"]
    assert notice["code"] == "outline-moved"
    assert notice["values"]["drawn_m2"] == pytest.approx(asked["area_m2"] * (6 / 9) ** 2, rel=1e-6)
    assert notice["values"]["area_m2"] == moved["area_m2"]
    assert limited["volume_m3"] < 0.95 * moved["volume_m3"]
    assert limited["warnings"][0]["code"] == "outline-on-pile"


def test_toe_needs_an_outline(site, run):
    status, _, err = run("volume", site / "pile.laz", "--toe", "auto")
    assert status == 2
    assert "--toe moves outlines that were drawn; give them by --area" in " ".join(err.split())


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
    assert any("--source-unit" in warning for warning in texts(unknown))
    ratio = only(known)["volume_m3"] / only(unknown)["volume_m3"]
    assert ratio == pytest.approx(metres**3, rel=1e-9)


@pytest.mark.one_python
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


@pytest.mark.one_python
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
    mass = only(document(*whole, "--density", 2))["mass_t"]
    assert mass == pytest.approx(2 * result["volume_m3"], rel=1e-14)
    assert only(document(*whole, "--density", 2))["mass_std_t"] is None


@pytest.mark.parametrize(
    ("source", "options", "shape"),
    [
        ("plain.csv", [], "terrain"),  # a heap on ground that goes on around it
        pytest.param("plain.csv", ["--shape", "object"], "object", marks=pytest.mark.one_python),
        ("plain.csv", ["--base", "plane"], "terrain"),
        ("plain.csv", ["--area"], "terrain"),
        pytest.param("plain.csv", ["--shape", "terrain"], "terrain", marks=pytest.mark.one_python),
        ("pile.laz", [], "terrain"),
        ("pile.laz", ["--shape", "object"], "object"),
        ("pile.laz", ["--center-caps"], "object"),
        ("pile.laz", ["--method", "polar"], "object"),
    ],
)
def test_auto_shape_is_chosen_by_options_and_source(
    source, options, shape, site, tmp_path, document
):
    if options == ["--area"]:
        local = circle(9, 1020, 2020)
        (tmp_path / "local.geojson").write_text(features(local, crs=None))
        options = ["--area", tmp_path / "local.geojson"]
    assert document("volume", site / source, *options)["shape"] == shape


@pytest.mark.parametrize(
    ("options", "shape"),
    [
        pytest.param(["--shape", "object"], "object", marks=pytest.mark.one_python),
        ([], "terrain"),
    ],
)
def test_shape_that_was_chosen_is_said(options, shape, site, run):
    out = run("volume", site / "plain.csv", *options)[1]
    assert f"shape {shape}" in " ".join(out.split())


def test_an_odm_source_without_a_crs_is_terrain(site, tmp_path, document):
    (tmp_path / "p/odm_georeferencing").mkdir(parents=True)
    model = tmp_path / "p/odm_georeferencing/odm_georeferenced_model.laz"
    write_las(model, np.load(site / "points.npy"))
    told = document("volume", tmp_path / "p")
    assert (told["shape"], told["crs"], told["length_unit"]) == ("terrain", None, "unknown")
