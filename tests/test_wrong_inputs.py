"""Wrong inputs: one line that says what and what to do, exit status 1, no traceback."""

from __future__ import annotations

import io
import json
import re
import subprocess
import sys
import zipfile

import numpy as np
import pytest
from clouds import write_las, write_ply, write_text
from commands import PILE, UTM, features
from shapely.geometry import Polygon, box, mapping
from terrains import EAST, NORTH, Errors, circle, placed, survey

from quantify_client.cli import main

# Servers, sizes and words: no different on a second Python.
pytestmark = pytest.mark.one_python

POINTS = survey(PILE.height, Errors(0.01, 0.0), 20_000)
POINTER = "version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n"
PAGE = "<!DOCTYPE html>\n<html><head><title>Log in</title></head></html>\n"
HEAD = "ply\nformat ascii 1.0\nelement vertex 4\n"


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    return write_las(tmp_path_factory.mktemp("good") / "good.laz", POINTS, crs=UTM)


@pytest.fixture
def refused(capsys):
    """Run `volume`, which must fail in one line; return the line."""

    def runner(*arguments, json=True):
        status = main(["volume", *map(str, arguments), *(["--json"] if json else [])])
        out, err = capsys.readouterr()
        assert (status, out) == (1, ""), (out, err)
        assert re.fullmatch(r"quantify-client: error: [^\n]{20,500}\n", err), err
        assert "bug" not in err
        return err

    return runner


def archive(path, members):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        for name, data in members.items():
            file.writestr(name, data)
    return path


def geojson(path, *polygons, crs=UTM):
    """Write polygons; without a CRS when `crs` is None."""
    path.write_text(features(*polygons, crs=crs))
    return path


# --- clouds


def written(name, data):
    def make(folder):
        (folder / name).write_bytes(data if isinstance(data, bytes) else data.encode())
        return folder / name

    return make


def truncated(folder):
    path = write_las(folder / "short.laz", POINTS)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    return path


def cut(folder, size):
    path = write_las(folder / "cut.las", POINTS)
    path.write_bytes(path.read_bytes()[:size])
    return path


def shifted_bounds(folder):
    """A cloud whose header gives bounds a thousand kilometres from its points."""
    path = write_las(folder / "shifted.las", POINTS, crs=UTM)
    data = bytearray(path.read_bytes())
    bounds = np.frombuffer(data, "<f8", 6, offset=179)
    data[179:227] = (bounds + 1e6).tobytes()
    path.write_bytes(data)
    return path


def with_nan(folder):
    xyz = POINTS.copy()
    xyz[777:1500, 2] = np.nan
    return write_ply(folder / "nan.ply", xyz)


def laz_in_zip(folder):
    stream = io.BytesIO(truncated(folder).read_bytes())
    return archive(
        folder / "all.zip",
        {"odm_georeferencing/odm_georeferenced_model.laz": stream.getvalue()},
    )


def empty_folder(folder):
    (folder / "project/odm_report").mkdir(parents=True)
    return folder / "project"


def other_crs(folder):
    return [
        write_las(folder / "a.laz", POINTS, crs=UTM),
        write_las(folder / "b.laz", POINTS, crs="EPSG:32616"),
    ]


CLOUDS = {
    "empty file": (written("empty.laz", b""), "is empty; copy, download or export it again"),
    "truncated LAZ": (truncated, r"short\.laz: is truncated.*copy, download or export it again"),
    "truncated LAS": (lambda folder: cut(folder, 5000), r"cut\.las.*20000 points.*download"),
    "truncated header": (lambda folder: cut(folder, 150), r"cut\.las.*download or export it again"),
    "bounds elsewhere": (
        shifted_bounds,
        "no point .* the bounds .* header.*export it again",
    ),
    "pointer": (written("lfs.laz", POINTER), "Git LFS pointer.*git lfs pull"),
    "pointer as text": (written("lfs.txt", POINTER), "Git LFS pointer.*git lfs pull"),
    "web page": (written("all.zip", PAGE), r"all\.zip: is a web page.*log in.*download"),
    "no zip": (written("all.zip", b"\x1f\x8b" + bytes(99)), "is not a zip file.*download it again"),
    "zip bomb": (
        lambda folder: archive(
            folder / "all.zip",
            {"odm_georeferencing/odm_georeferenced_model.laz": bytes(30_000_000)},
        ),
        r"all\.zip: its member .* (bytes|times)",
    ),
    "zip that leads out": (
        lambda folder: archive(
            folder / "all.zip",
            {"odm_georeferencing/odm_georeferenced_model.laz": b"x", "../../etc/passwd": b"x"},
        ),
        "leads out of the folder.*download it again",
    ),
    "zip without a cloud": (
        lambda folder: archive(folder / "all.zip", {"odm_report/stats.json": "{}"}),
        "holds no point cloud; looked for odm_georeferencing/",
    ),
    "truncated LAZ in a zip": (laz_in_zip, r"all\.zip/odm_\S+: is truncated.*download"),
    "PLY without z": (
        written(
            "flat.ply", HEAD + "property float x\nproperty float y\nend_header\n" + "0 0\n" * 4
        ),
        r"flat\.ply.*\bz\b",
    ),
    "PLY without vertices": (
        written("mesh.ply", "ply\nformat ascii 1.0\nelement face 0\nend_header\n"),
        r"mesh\.ply.*(vertex|vertices)",
    ),
    "NaN": (with_nan, r"nan\.ply: 723 of 20000 points have a coordinate that is NaN.*remove"),
    "NaN in text": (
        written("nan.csv", "x,y,z\n" + "1,2,3\n" * 5 + "1,nan,3\n"),
        r"nan\.csv.*(NaN|number)",
    ),
    "too few points": (
        lambda folder: write_text(folder / "few.csv", POINTS[:3]),
        r"few\.csv: holds only 3 points; expected at least 4",
    ),
    "no points": (lambda folder: write_las(folder / "none.las", POINTS[:0]), "holds no points"),
    "text without numbers": (written("notes.txt", "to do:\n- buy milk\n"), r"notes\.txt"),
    "unknown kind": (written("cloud.e57", b"ASTM-E57"), "unknown ending; expected .las, .laz"),
    "folder without a cloud": (empty_folder, r"project.*(odm_georeferencing|point cloud)"),
    "missing file": (lambda folder: folder / "gone.laz", r"gone\.laz: does not exist; check the"),
    "tiles in two CRS": (other_crs, "is in another CRS .* reproject one of them"),
    "address": (lambda folder: "https://example.org/all.zip", "web address.*download the all.zip"),
    "all noise": (
        lambda folder: write_las(folder / "n.laz", POINTS, classes=np.full(len(POINTS), 7)),
        "noise or withheld.*check the classification",
    ),
}


@pytest.mark.parametrize("name", CLOUDS)
def test_a_cloud_that_cannot_be_measured(name, tmp_path, refused):
    make, said = CLOUDS[name]
    made = make(tmp_path)
    sources = made if isinstance(made, list) else [made]
    assert re.search(said, refused(*sources))
    assert re.search(said, refused(*sources, "--out", tmp_path / "out", json=False))
    assert not (tmp_path / "out").exists()


def test_the_same_file_twice(good, refused):
    assert "is given twice; give each tile once" in refused(good, good)


# --- degenerate clouds


def line(step_x, step_y):
    t = np.linspace(0, 1, 5000)[:, None]
    return POINTS[0] + t * [step_x, step_y, 1.0]


def one_place(_):
    return np.repeat(POINTS[:1], 1000, axis=0)


DEGENERATE = {
    "all at one place": one_place,
    "in a line to the east": lambda _: line(40.0, 0.0),
    "in a line to the north": lambda _: line(0.0, 40.0),
    "in a line across": lambda _: line(40.0, 30.0),
    "in a nearly straight line": lambda rng: line(40.0, 0.0) + rng.normal(0, 1e-3, (5000, 3)),
    "in a vertical line": lambda _: POINTS[0] + np.linspace(0, 1, 500)[:, None] * [0, 0, 9.0],
    "four": lambda _: POINTS[0] + np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 1.0]]),
}


@pytest.mark.parametrize("name", DEGENERATE)
def test_points_that_form_no_surface(name, tmp_path, capsys):
    xyz = DEGENERATE[name](np.random.default_rng(3))
    path = write_las(tmp_path / "odd.las", xyz, crs=UTM)
    status = main(["volume", str(path), "--json"])
    out, err = capsys.readouterr()
    (result,) = json.loads(out)["results"] if out else [{"error": err}]
    assert status == 1
    assert re.search(r"(draw|give|reconstruct|check|export)", result["error"])
    assert (err.count("\n"), "bug" in err) == (1, False)


@pytest.mark.parametrize("name", ["all at one place", "in a line to the east"])
def test_no_body_from_points_that_form_none(name, tmp_path, capsys):
    xyz = DEGENERATE[name](np.random.default_rng(3))
    path = write_las(tmp_path / "odd.las", xyz)
    assert main(["volume", str(path), "--shape", "object", "--json"]) in (0, 1)
    out, err = capsys.readouterr()
    assert "bug" not in err
    if out:
        (result,) = json.loads(out)["results"]
        assert result["volume_m3"] == pytest.approx(0.0, abs=1e-6)


def test_a_perfectly_flat_cloud_has_no_volume(tmp_path, capsys):
    xyz = POINTS * [1, 1, 0] + [0, 0, 100.0]
    path = write_las(tmp_path / "flat.laz", xyz, crs=UTM)
    assert main(["volume", str(path), "--json"]) == 0
    (result,) = json.loads(capsys.readouterr().out)["results"]
    for key in ("volume_m3", "cut_m3", "fill_m3"):
        assert result[key] == pytest.approx(0.0, abs=1e-9)


# --- areas

BOW = Polygon([(EAST + 5, NORTH + 5), (EAST + 35, NORTH + 35), (EAST + 35, NORTH + 5),
               (EAST + 5, NORTH + 35)])  # fmt: skip
HERE = placed(box(10, 10, 30, 30))


def test_area_files_that_cannot_be_used(good, tmp_path, refused):
    for name, text, said in (
        ("gone.geojson", None, r"gone\.geojson.*(does not exist|check the path)"),
        ("empty.geojson", "", r"empty\.geojson.*(is empty|JSON)"),
        ("broken.geojson", '{"type": "Feat', r"broken\.geojson.*JSON"),
        ("none.geojson", '{"type": "FeatureCollection", "features": []}', "no polygon; draw"),
        ("lfs.geojson", POINTER, r"lfs\.geojson.*LFS"),
        ("page.geojson", PAGE, r"page\.geojson"),
        ("line.geojson", json.dumps(mapping(HERE.boundary)), "no polygon; draw"),
    ):
        if text is not None:
            (tmp_path / name).write_text(text)
        assert re.search(said, refused(good, "--area", tmp_path / name)), name


def test_a_polygon_in_a_crs_that_cannot_be_told(good, tmp_path, refused):
    elsewhere = Polygon([(x + 70_000, y) for x, y in HERE.exterior.coords])
    path = geojson(tmp_path / "a.geojson", elsewhere, crs=None)
    assert re.search("names no CRS.*export it in WGS84 or in the", refused(good, "--area", path))
    path = geojson(tmp_path / "b.geojson", HERE, crs="EPSG:999999")
    assert re.search("unknown CRS.*expected EPSG", refused(good, "--area", path))


def test_a_crs_is_of_no_use_with_a_cloud_without_one(tmp_path, refused):
    cloud = write_las(tmp_path / "plain.laz", POINTS)
    path = geojson(tmp_path / "a.geojson", HERE)
    assert re.search("the cloud has no CRS: give it one", refused(cloud, "--area", path))


POLYGONS = {
    "crossing itself": ([BOW], UTM, r"crosses itself near 500020\.00, 5000020\.00; redraw it"),
    "in the wrong CRS": ([HERE], "EPSG:32616", r"outside the cloud.*or the cloud's \(--crs\)$"),
    "far outside": ([placed(box(900, 900, 950, 950))], UTM, "outside the cloud.*draw it on"),
    "x and y swapped": (
        [Polygon([(y, x) for x, y in HERE.exterior.coords])],
        UTM, r"\(--crs\); its x and y seem to be swapped$",
    ),
    "in the box's empty corner": ([placed(box(30, 0, 39, 9))], UTM, "points support 0%"),
    "without an area": ([placed(Polygon([(1, 1), (9, 9), (5, 5)]))], UTM, "has no area"),
}  # fmt: skip


@pytest.mark.parametrize("name", POLYGONS)
def test_a_polygon_that_fails(name, tmp_path, capsys):
    polygons, crs, said = POLYGONS[name]
    x, y = POINTS[:, 0] - EAST, POINTS[:, 1] - NORTH
    cloud = write_las(tmp_path / "c.laz", POINTS[(x < 28) | (y > 12)], crs=UTM)
    areas = geojson(tmp_path / "a.geojson", *polygons, placed(circle(9)), crs=crs)
    status = main(["volume", str(cloud), "--area", str(areas), "--json"])
    out, err = capsys.readouterr()
    failed, measured = json.loads(out)["results"]
    assert status == 1
    assert re.search(said, failed["error"])
    assert "bug" not in err
    assert re.search(said, err.splitlines()[0])
    if crs == UTM:
        assert err.count("\n") == 1
        assert measured["volume_m3"] > 200


def test_a_polygon_smaller_than_a_cell(good, tmp_path, capsys):
    """It is measured with an interval that says how little that is worth, or it is refused."""
    tiny = placed(box(20.0, 20.0, 20.03, 20.03))
    areas = geojson(tmp_path / "a.geojson", tiny)
    status = main(["volume", str(good), "--area", str(areas), "--json"])
    out, err = capsys.readouterr()
    (result,) = json.loads(out)["results"]
    assert "bug" not in err
    if status == 0:
        assert abs(result["volume_m3"]) < 0.03**2 * 4
    else:
        assert (status, err.count("\n")) == (1, 1)
        assert re.search("(draw|give)", result["error"])


# --- out


def test_out_that_cannot_be_written_is_found_before_the_cloud_is_read(good, tmp_path, refused):
    (tmp_path / "file").write_text("mine")
    assert "is a file, not a folder; give another --out" in refused(
        good, "--out", tmp_path / "file"
    )
    for out in (tmp_path / "file/below", "/proc/quantify"):
        assert re.search(
            "cannot be written into .* give another --out", refused(good, "--out", out)
        )
    # ... whatever else is wrong
    assert "--out" in refused(tmp_path / "gone.laz", "--out", tmp_path / "file")
    assert (tmp_path / "file").read_text() == "mine"


def test_escape_codes_in_names_do_not_reach_the_terminal(tmp_path, refused):
    assert "\x1b" not in refused(tmp_path / "a\x1b[31mb.laz")


def test_one_line_in_a_process_of_its_own_too(tmp_path):
    (tmp_path / "lfs.laz").write_text(POINTER)
    command = [sys.executable, "-m", "quantify_client", "volume", str(tmp_path / "lfs.laz")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.count("\n") == 1
    assert "git lfs pull" in done.stderr


def test_a_package_that_is_missing_is_named_in_one_line(tmp_path):
    code = "import sys; sys.modules['requests'] = None; from quantify_client.cli import main; "
    code += f"sys.exit(main(['resume', {str(tmp_path)!r}]))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (1, "", 1)
    assert "the package requests, which this needs, is not installed; install" in done.stderr
