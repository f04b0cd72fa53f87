"""A mesh on the command line: measured by its faces, or told why it is not."""

from __future__ import annotations

import csv
import json
import re

import laspy
import numpy as np
import pytest
from clouds import write_ply
from commands import only, texts
from meshes import UTM, cube, joined, reversed_, soup, torus, torus_volume, write_mesh
from solids import sphere

#: Whole commands: what they are made of is tested on the second Python as well.
pytestmark = pytest.mark.one_python

FOOT = 0.3048
VOLUME = torus_volume(60, 40)
BALL = sphere()


@pytest.fixture
def ring(tmp_path):
    return write_mesh(tmp_path / "ring.ply", torus(60, 40), at=UTM)


def test_a_closed_mesh_is_measured_by_its_faces_and_without_an_interval(
    ring, document, run, tmp_path
):
    found = document("volume", ring, "--source-unit", "m", "--out", tmp_path / "out")
    result = only(found)
    assert (found["shape"], found["method"]) == ("object", "faces")
    assert result["volume_m3"] == pytest.approx(VOLUME, rel=1e-8)
    assert (result["std_m3"], result["interval95_m3"], result["budget"]) == (None, None, [])
    assert "--accuracy" in texts(result)[0]
    assert sum(part["volume_m3"] for part in result["slices"]) == pytest.approx(VOLUME, rel=1e-8)
    page = (tmp_path / "out" / "report.html").read_text("utf-8")
    assert "no interval" in page
    assert "the accuracy of the mesh is unknown" in page
    told = json.loads((tmp_path / "out" / "report.json").read_text())
    assert only(told)["interval95_m3"] is None
    with (tmp_path / "out" / "slices.csv").open() as rows:
        assert len(list(csv.reader(rows))) > 50
    _, out, _ = run("volume", ring, "--source-unit", "m")
    assert re.search(r"58\.867 +- ", out), out
    assert "the accuracy of the mesh is unknown" in " ".join(out.split())


def test_its_points_alone_would_not_do(ring, document):
    """What the same file said before: the vertices as a cloud, with an interval."""
    faces = only(document("volume", ring, "--source-unit", "m"))["volume_m3"]
    ring.write_bytes(ring.read_bytes().replace(b"element face", b"element skin"))
    points = only(document("volume", ring, "--source-unit", "m"))["volume_m3"]
    assert abs(points / faces - 1.0) > 1e-4


def test_accuracy_gives_an_interval(ring, document):
    result = only(document("volume", ring, "--source-unit", "m", "--accuracy", 0.01))
    std = 0.01 * result["surface_area_m2"]
    assert result["std_m3"] == pytest.approx(std)
    assert result["budget"] == [{"source": "survey", "std_m3": pytest.approx(std)}]
    low, high = result["interval95_m3"]
    assert high - low == pytest.approx(2 * 1.96 * std)
    assert texts(result) == []


@pytest.mark.parametrize(("unit", "metres"), [("ft", FOOT), ("mm", 0.001), ("us-ft", 1200 / 3937)])
def test_faces_follow_the_vertices_into_metres(unit, metres, ring, document):
    result = only(document("volume", ring, "--source-unit", unit))
    assert result["volume_m3"] == pytest.approx(VOLUME * metres**3, rel=1e-7)


def test_on_a_map_grid_the_volume_is_that_on_the_ground(ring, document):
    given = (ring, "--crs", "EPSG:32615", "--shape", "object")
    grid = document("volume", *given, "--grid")
    ground = document("volume", *given)
    assert only(grid)["volume_m3"] == pytest.approx(VOLUME, rel=1e-8)
    factor = ground["grid_scale_factor"]
    assert only(ground)["volume_m3"] == pytest.approx(VOLUME / factor**2, rel=1e-8)
    feet = document("volume", ring, "--crs", "EPSG:2226", "--shape", "object", "--grid")
    assert only(feet)["volume_m3"] == pytest.approx(VOLUME * (1200 / 3937) ** 3, rel=1e-7)


@pytest.fixture
def control(tmp_path):
    """A tape says that the mesh is 1.1 times as large as it says."""
    (tmp_path / "bar.json").write_text(
        json.dumps(
            {
                "unit": "m",
                "cloud": {
                    "P": {"xyz": [-2, 0, 0], "accuracy": 1e-3},
                    "Q": {"xyz": [2, 0, 0], "accuracy": 1e-3},
                },
                "scale_bars": [{"from": "P", "to": "Q", "length": 4.4, "accuracy": 0.002}],
            }
        )
    )
    return tmp_path / "bar.json"


def test_control_scales_the_faces_with_their_vertices(control, document, run, tmp_path):
    ring = write_mesh(tmp_path / "ring.ply", torus(60, 40))
    found = document("volume", ring, "--gcp", control, "--shape", "object", "--accuracy", 0.001)
    assert only(found)["volume_m3"] == pytest.approx(VOLUME * 1.331, rel=1e-6)
    assert [item["source"] for item in only(found)["budget"]] == ["survey", "scale"]
    assert found["method"] == "faces"


def test_scaling_a_mesh_writes_its_vertices(control, run, tmp_path):
    points, _ = torus(60, 40)
    ring = write_mesh(tmp_path / "ring.ply", torus(60, 40))
    status, _, err = run("scale", ring, "--gcp", control, "--out", tmp_path / "out.laz")
    assert status == 0, err
    np.testing.assert_allclose(laspy.read(tmp_path / "out.laz").xyz, 1.1 * points, atol=1e-3)


def test_mesh_in_pieces_as_from_stl_is_closed_where_corners_are_the_same(document, tmp_path):
    path = write_mesh(tmp_path / "a.ply", soup(cube(2.0)), "ascii", UTM)
    assert only(document("volume", path))["volume_m3"] == pytest.approx(8.0, rel=1e-7)


def test_hollow_body_is_told_by_the_orientation_of_its_inner_shell(document, run, tmp_path):
    inner = cube(0.5, (0.25,) * 3)
    good = write_mesh(tmp_path / "a.ply", joined(cube(), reversed_(inner)))
    found = document("volume", good, "--hollow")
    assert only(found)["volume_m3"] == pytest.approx(0.875)
    assert any("without effect: --hollow" in text for text in texts(found))
    bad = write_mesh(tmp_path / "b.ply", joined(cube(), inner))
    status, _, told = run("volume", bad)
    assert status == 1
    assert "only the 16 vertices of the mesh count" in told
    assert "oriented like them" in told
    assert "the box round them all holds 1 m3" in told  # 3.7 m3 were told


def test_where_vertices_span_no_body_either_both_reasons_are_told(run, tmp_path):
    points, faces = cube()
    status, out, err = run("volume", write_mesh(tmp_path / "a.ply", (points, faces[1:])))
    assert (status, out, err.count("\n")) == (1, "", 1)
    assert "3 edges belong to one face only" in err
    assert "the points enclose no space" in err


@pytest.fixture(scope="module")
def holed(tmp_path_factory):
    """A sphere of many triangles, one of them missing."""
    from scipy.spatial import ConvexHull

    points = BALL.surface(4000, np.random.default_rng(1))
    hull = ConvexHull(points)
    a, b, c = (points[hull.simplices[:, corner]] for corner in range(3))
    inwards = np.einsum("ti,ti->t", np.cross(b - a, c - a), a - points.mean(axis=0)) < 0.0
    faces = np.where(inwards[:, None], hull.simplices[:, ::-1], hull.simplices)
    return write_mesh(tmp_path_factory.mktemp("holed") / "ball.ply", (points, faces[1:]))


def test_open_mesh_is_measured_as_a_cloud_and_told(holed, document, run):
    found = document("volume", holed, "--accuracy", 0.01)
    assert found["method"] == "section"
    assert only(found)["volume_m3"] == pytest.approx(BALL.volume, rel=0.02)
    told = next(text for text in texts(found) if "vertices of the mesh count" in text)
    assert "only the 4,000 vertices" in told
    assert ": it is open: 3 edges belong to one face only (one at " in told
    assert told.endswith("--accuracy has no effect")
    about = json.loads(run("info", holed, "--json")[1])
    assert about["faces"] > 7000
    assert any("3 edges belong to one face only" in text for text in texts(about))


def test_info_tells_the_faces_of_a_closed_mesh_and_no_floor(ring, run):
    about = json.loads(run("info", ring, "--json")[1])
    assert (about["faces"], about["floor"]) == (4800, None)
    assert not any("vertices" in text for text in texts(about))


def test_points_asked_for_are_points(ring, document):
    found = document("volume", ring, "--method", "polar")
    assert found["method"] == "polar"
    assert any("--method polar takes points" in text for text in texts(found))


def test_faces_of_several_files_are_told(tmp_path, document):
    halves = [
        write_mesh(tmp_path / f"{name}.ply", torus(60, 40), at=(0.0, 0.0, 3.0 * name))
        for name in range(2)
    ]
    found = document("volume", *halves)
    assert any("its 9,600 faces: they are those of several files" in w for w in texts(found))


def test_terrain_is_measured_from_points_and_says_so(site, document, tmp_path):
    path = write_ply(tmp_path / "pile.ply", np.load(site / "points.npy"))
    found = document("volume", path, "--crs", "EPSG:32615", "--area", site / "pile.geojson")
    assert any("not its 1 face: terrain is measured from points" in w for w in texts(found))


def test_accuracy_of_a_cloud_has_no_effect_and_is_told(site, document):
    found = document("volume", site / "body.xyz", "--accuracy", 0.1)
    assert sum("the cloud has none: it has no effect" in text for text in texts(found)) == 1


def test_accuracy_does_not_make_terrain_an_object(site, document):
    found = document("volume", site / "pile.laz", "--accuracy", 0.1)
    assert found["shape"] == "terrain"
    assert sum("--accuracy is that of a closed mesh" in text for text in texts(found)) == 1


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ("--accuracy 0", "--accuracy is 0.0"),
        ("--accuracy nan", "--accuracy is nan"),
        ("--accuracy 1 --shape terrain", "go with --shape object"),
        ("--accuracy 1 --base plane", "go with --shape object"),
        ("--accuracy 1 --method polar", "go with --method section, not polar"),
    ],
)
def test_accuracy_that_makes_no_sense_is_refused(options, words, ring, run):
    status, _, err = run("volume", ring, *options.split())
    assert status != 0
    assert words in err


def test_face_with_a_corner_that_is_no_point_is_one_line(ring, run):
    data = ring.read_bytes()
    ring.write_bytes(data[:-4] + b"\xff\xff\xff\x00")
    status, out, err = run("volume", ring)
    assert (status, out, err.count("\n")) == (1, "", 1)
    assert "has the corner 16777215" in err


@pytest.mark.parametrize("place", [(np.nan,) * 3, (0.0, 0.0, 0.0)])
@pytest.mark.parametrize("before", [0, 7, 2400])
def test_vertices_without_a_face_that_are_left_out_do_not_matter(place, before, document, tmp_path):
    points, faces = torus(60, 40)
    points = np.insert(points + UTM, [0, before], [place, place], axis=0)
    numbers = np.asarray(faces) + 1 + (np.asarray(faces) >= before)
    found = document("volume", write_mesh(tmp_path / "a.ply", (points, numbers)))
    assert found["method"] == "faces"
    assert only(found)["volume_m3"] == pytest.approx(VOLUME, rel=1e-8)
    assert sum(only(found)["points_left_out"].values()) == 2


def test_a_vertex_of_a_face_that_is_left_out_matters(document, tmp_path):
    points, faces = torus(60, 40)
    points[7] = np.nan
    found = document("volume", write_mesh(tmp_path / "a.ply", (points, faces)))
    assert found["method"] == "section"
    assert any("1 vertex is left out" in text for text in texts(found))
