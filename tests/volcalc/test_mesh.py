"""The volume within the faces of a mesh: closed forms, and meshes that enclose none."""

from __future__ import annotations

import numpy as np
import pytest
from meshes import (
    UTM,
    box,
    cube,
    joined,
    moebius,
    reversed_,
    soup,
    tetrahedron,
    torus,
    torus_volume,
)
from scipy.spatial.transform import Rotation

from quantify_client.types import AreaResult, Faces
from quantify_client.volcalc.body_slices import BodyRecipe
from quantify_client.volcalc.mesh import measure as mesh_module
from quantify_client.volcalc.mesh.measure import measure_mesh

TURN = Rotation.from_euler("xyz", [20, 30, 40], degrees=True).as_matrix()


def measured(mesh, at=UTM, **recipe):
    points, faces = mesh
    sizes = np.array([len(face) for face in faces])
    faces = Faces(np.concatenate([*map(np.asarray, faces)]), sizes)
    return measure_mesh("a", np.asarray(points) + at, faces, BodyRecipe(**recipe))


def reason(mesh):
    found = measured(mesh)
    assert isinstance(found, str), found
    return found


@pytest.mark.parametrize(
    ("mesh", "volume", "area"),
    [
        (tetrahedron(), 1 / 6, 1.5 + 0.75**0.5),
        (cube(), 1.0, 6.0),
        (box((2.0, 3.0, 0.5)), 3.0, 17.0),
        (soup(cube()), 1.0, 6.0),
        (torus(40, 24), torus_volume(40, 24), None),
        (joined(cube(), cube(0.5, (3.0, 0.0, 0.0))), 1.125, 7.5),
        (joined(cube(), reversed_(cube(0.5, (0.25, 0.25, 0.25)))), 0.875, 7.5),
        (joined(cube(3.0), reversed_(cube(2.0, (0.5,) * 3)), cube(1.0, (1.0,) * 3)), 20.0, 84.0),
    ],
    ids=["tetrahedron", "cube", "quads", "soup", "torus", "two", "hollow", "nested"],
)
@pytest.mark.parametrize("at", [(0.0, 0.0, 0.0), UTM], ids=["origin", "utm"])
@pytest.mark.parametrize("turn", [np.eye(3), TURN], ids=["level", "turned"])
def test_closed_mesh_has_the_volume_within_its_faces(mesh, volume, area, at, turn):
    points, faces = mesh
    result = measured((points @ turn, faces), at)
    # Coordinates of 5e6 are rounded to 1e-9.
    assert result.volume_m3 == pytest.approx(volume, rel=1e-12 if at[0] == 0.0 else 1e-7)
    assert sum(part.volume_m3 for part in result.slices) == pytest.approx(
        result.volume_m3, rel=1e-9
    )
    assert result.std_m3 is None
    assert len(result.budget) == 0
    assert "--accuracy" in result.warnings[0]
    if area is not None:
        assert result.surface_area_m2 == pytest.approx(area, rel=1e-7)


def test_slices_of_a_tetrahedron_are_exact():
    result = measured(tetrahedron(), slices=4)
    below = [1.0 - (1.0 - z) ** 3 for z in (0.0, 0.25, 0.5, 0.75, 1.0)]
    parts = [part.volume_m3 for part in result.slices]
    np.testing.assert_allclose(parts, np.diff(below) / 6.0, rtol=1e-6)
    assert result.min_z_m == pytest.approx(UTM[2])
    assert len(measured(tetrahedron(), slice_height=0.3).slices) == 4


def test_ground_factor_divides_lengths_in_plan():
    assert measured(cube(), ground_factor=1.001).volume_m3 == pytest.approx(1 / 1.001**2, rel=1e-7)


def test_accuracy_times_surface_is_the_standard_deviation():
    """The surface moved outwards by sigma everywhere: the worst that any correlation can do."""
    sigma = 1e-4
    result = measured(cube(2.0), accuracy=sigma)
    grown = measured(cube(2.0 + 2 * sigma))
    assert result.std_m3 == pytest.approx(grown.volume_m3 - result.volume_m3, rel=1e-3)
    assert result.std_m3 == pytest.approx(sigma * 24.0)
    assert [item.source for item in result.budget] == ["survey"]
    assert not result.warnings
    assert "nearly as large as the body" in measured(cube(), accuracy=0.1).warnings[0]


def test_mesh_turned_inside_out_is_told():
    result = measured(reversed_(cube()))
    assert result.volume_m3 == pytest.approx(1.0)
    assert "point inwards" in result.warnings[1]
    assert sum(part.volume_m3 for part in result.slices) == pytest.approx(1.0)


def _one_face_turned():
    points, faces = cube()
    faces = faces.copy()
    faces[3] = faces[3, ::-1]
    return points, faces


def _bow(points):
    """Two corners of a cube through the opposite face."""
    points = points.copy()
    points[[1, 3], 2] = -0.5
    points[[0, 2], 2] = 0.5
    points[[0, 1], 0] = 0.4
    return points


@pytest.mark.parametrize(
    ("mesh", "words"),
    [
        ((cube()[0], cube()[1][1:]), "3 edges belong to one face only"),
        (moebius(), "belong to one face only"),
        (_one_face_turned(), "3 edges belong to two faces that are oriented differently"),
        (joined(cube(), cube(1.0, (0.5, 0.5, 0.5))), "faces cross or touch"),
        (joined(cube(), cube(1.0, (0.5, 0.0, 0.0))), "faces cross or touch"),
        (joined(cube(), cube(1.0, (1.0, 0.5, 0.0))), "faces cross or touch"),
        (joined(cube(), cube(0.5, (0.0, 0.0, 0.0))), "faces cross or touch"),
        ((_bow(cube()[0]), cube()[1]), "faces cross or touch"),
        (joined(cube(), cube(0.5, (0.25, 0.25, 0.25))), "oriented like them"),
        (joined(cube(), reversed_(cube(1.0, (3.0, 0.0, 0.0)))), "inwards, others outwards"),
        (joined(cube(), cube()), "the same corners as another"),
        ((np.zeros((4, 3)), tetrahedron()[1]), "none of its faces has an area"),
        ((np.eye(3), np.array([[0, 1, 2], [0, 2, 1]])), "back to back"),
        ((np.eye(3), [[0, 1]]), "none of its faces has three corners"),
    ],
    ids=[
        "open",
        "moebius",
        "turned",
        "overlapping",
        "sharing planes",
        "touching",
        "in a corner",
        "through itself",
        "shell not turned",
        "shell outside",
        "twice",
        "a point",
        "leaf",
        "lines",
    ],
)
def test_mesh_that_encloses_no_volume_is_refused_with_the_reason(mesh, words):
    assert words in reason(mesh)


def test_reason_says_where():
    hole = reason((cube()[0], cube()[1][1:]))
    x, y, z = (float(text) for text in hole.rpartition("at ")[2].rstrip(")").split(", "))
    assert np.all(np.abs(np.array([x, y, z]) - UTM - 0.5) <= 0.51)


def test_bodies_that_share_corners_edges_and_whole_faces_are_one_mesh():
    for at in ((1.0, 1.0, 1.0), (1.0, 1.0, 0.0), (1.0, 0.0, 0.0)):
        assert measured(joined(cube(), cube(1.0, at))).volume_m3 == pytest.approx(2.0)


def test_face_without_area_between_neighbours_is_told():
    """A vertex in the middle of an edge, closed by a face that is a line."""
    points, faces = cube()
    edge = next(i for i, face in enumerate(faces) if {0, 1} <= set(face.tolist()))
    a, b, c = np.roll(
        faces[edge], -next(k for k in range(3) if {*np.roll(faces[edge], -k)[:2]} == {0, 1})
    )
    middle = len(points)
    points = np.vstack([points, 0.5 * (points[a] + points[b])])
    more = np.array([[a, middle, c], [middle, b, c], [a, b, middle]])
    assert "1 face has no area" in reason((points, np.vstack([np.delete(faces, edge, 0), more])))


def test_faces_whose_corners_fall_together_are_left_out():
    points, faces = cube()
    assert measured(
        (points, np.vstack([faces, [[0, 0, 1], [2, 2, 2]]]))
    ).volume_m3 == pytest.approx(1)


def test_concave_faces_are_split_from_the_corner_that_lies_inwards():
    """A prism over an arrowhead; its area is 1 - 1/4."""
    outline = np.array([[0.5, 0.5], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.0, 0.0]])[[1, 2, 3, 0]]
    points = np.vstack([np.column_stack([outline, np.full(4, z)]) for z in (0.0, 1.0)])
    sides = [[i, (i + 1) % 4, 4 + (i + 1) % 4, 4 + i] for i in range(4)]
    result = measured((points, [[3, 2, 1, 0], [4, 5, 6, 7], *sides]))
    assert result.volume_m3 == pytest.approx(0.5)
    assert result.checks[0].volume_m3 == pytest.approx(0.5)


def test_faces_that_are_not_flat_are_told():
    points, faces = box()
    points = points.copy()
    points[7] += 0.3
    result = measured((points, faces))
    low, high = sorted([result.volume_m3, result.checks[0].volume_m3])
    assert high - low > 0.05
    assert "not flat" in result.warnings[1]


def test_star_shaped_by_no_corner_is_refused():
    """A flat cross: none of its twelve corners sees all others."""
    arm = np.array(
        [
            [1, 0],
            [2, 0],
            [2, 1],
            [3, 1],
            [3, 2],
            [2, 2],
            [2, 3],
            [1, 3],
            [1, 2],
            [0, 2],
            [0, 1],
            [1, 1],
        ],
        dtype=float,
    )
    points = np.vstack([np.column_stack([arm, np.full(12, z)]) for z in (0.0, 1.0)])
    sides = [[i, (i + 1) % 12, 12 + (i + 1) % 12, 12 + i] for i in range(12)]
    faces = [list(range(12))[::-1], list(range(12, 24)), *sides]
    assert "2 faces with 12 corners are too crooked" in reason((points, faces))


def test_too_many_faces_are_told(monkeypatch):
    monkeypatch.setattr(mesh_module, "MOST_FACES", 11)
    assert "more than 11 triangles" in reason(cube())


def test_result_is_complete():
    result = measured(cube())
    assert isinstance(result, AreaResult)
    assert (result.points_used, result.coverage, result.body.floor) == (8, None, None)
    assert all(len(rings) == 1 for rings in result.body.outlines)


def test_faces_without_corners_enclose_nothing():
    none = Faces(np.empty(0, dtype=np.int64), np.zeros(3, dtype=np.int64))
    assert measure_mesh("a", np.eye(3), none, BodyRecipe()) == "none of them has a corner"


def test_the_place_of_a_fault_is_that_of_a_face_that_is_at_fault():
    """Faces without an area are left out before, and must not shift the count."""
    points, faces = cube()
    points, faces = np.vstack([points, np.full((3, 3), 9.0)]), [list(face) for face in faces]
    degenerate = [[8, 9, 10]] * 3
    told = reason((points, [*degenerate, *faces[:-1]]))
    x, y, z = (float(number) for number in told.split("(one at ")[1].rstrip(")").split(", "))
    assert "open" in told
    assert np.all(np.array([x, y, z]) - UTM < 2.0)
