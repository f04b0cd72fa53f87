"""Faces in PLY files: every way to write them, and what is wrong with some."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path

import numpy as np
import plyfile
import pytest
from meshes import UTM, box, cube, joined, tetrahedron, write_mesh

from quantify_client.cloud import Mesh, open_cloud
from quantify_client.cloud.ply import rows as ply_rows
from quantify_client.errors import CloudError

ORDERS = ["ascii", "binary_little_endian", "binary_big_endian"]
MIXED = (box()[0], [*box()[1][1:].tolist(), [0, 1, 3], [0, 3, 2]])


def faces_in(path: Path) -> list:
    cloud = open_cloud([path])
    assert isinstance(cloud, Mesh)
    faces = cloud.faces()
    assert faces is not None
    return [part.tolist() for part in np.split(faces.corners, np.cumsum(faces.sizes))[:-1]]


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("mesh", [cube(), box(), MIXED], ids=["triangles", "quads", "mixed"])
@pytest.mark.parametrize("name", ["vertex_indices", "vertex_index"])
def test_faces_are_those_of_the_file(order, mesh, name, tmp_path):
    path = write_mesh(tmp_path / "a.ply", mesh, order, UTM, name)
    assert open_cloud([path]).info.faces == len(mesh[1])
    assert sorted(faces_in(path)) == sorted(np.asarray(face).tolist() for face in mesh[1])


@pytest.mark.parametrize("text", [True, False])
def test_faces_written_by_plyfile_come_back(text, tmp_path):
    points, faces = cube()
    vertex = np.array([*map(tuple, points)], dtype=[(axis, "f4") for axis in "xyz"])
    face = np.empty(len(faces), dtype=[("vertex_indices", "i4", (3,)), ("red", "u1")])
    face["vertex_indices"], face["red"] = faces, 9
    elements = [
        plyfile.PlyElement.describe(face, "face"),
        plyfile.PlyElement.describe(vertex, "vertex"),
    ]
    plyfile.PlyData(elements, text=text, byte_order=">").write(str(tmp_path / "a.ply"))
    assert faces_in(tmp_path / "a.ply") == faces.tolist()


@pytest.mark.parametrize("order", ORDERS)
def test_strips_are_their_triangles(order, tmp_path):
    """Strips turn every other triangle, end at -1, and are sewn together by corners that repeat."""
    points = np.random.default_rng(1).random((9, 3))
    path = write_mesh(
        tmp_path / "a.ply", (points, [[0, 1, 2, 3, 4, -1, 5, 6, 7, 8], [8, 7, 6]]), order
    )
    path.write_bytes(path.read_bytes().replace(b"element face", b"element tristrips"))
    assert faces_in(path) == [
        [0, 1, 2], [2, 1, 3], [2, 3, 4], [5, 6, 7], [7, 6, 8], [8, 7, 6],
    ]  # fmt: skip


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("wrong", [8, -1, 2**31 - 1])
def test_corner_that_is_no_point_is_named(order, wrong, tmp_path):
    points, faces = cube()
    faces = faces.copy()
    faces[4, 1] = wrong
    path = write_mesh(tmp_path / "a.ply", (points, faces), order)
    with pytest.raises(CloudError, match=f"face 5 of it has the corner {wrong}; .* from 0 to 7"):
        faces_in(path)


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("mesh", [cube(), MIXED], ids=["even", "mixed"])
def test_missing_faces_are_an_error(order, mesh, tmp_path):
    path = write_mesh(tmp_path / "a.ply", mesh, order)
    data = path.read_bytes()
    path.write_bytes(data[:-9] if order != "ascii" else data[: data.rindex(b"\n", 0, -1) + 1])
    with pytest.raises(CloudError, match="truncated: its header promises .* rows of 'face'"):
        faces_in(path)


@pytest.mark.parametrize("count", [10**15, 3_000_000])
def test_faces_that_a_file_has_no_room_for_cost_nothing(count, tmp_path):
    path = write_mesh(tmp_path / "a.ply", cube())
    data = path.read_bytes().replace(b"element face 12\n", b"element face %d\n" % count)
    path.write_bytes(data)
    with pytest.raises(CloudError, match="truncated"):
        faces_in(path)


def test_list_longer_than_the_file_costs_nothing(tmp_path):
    path = write_mesh(tmp_path / "a.ply", MIXED)
    data = path.read_bytes().replace(b"list uchar int", b"list uint int")
    path.write_bytes(data)
    with pytest.raises(CloudError, match="truncated"):
        faces_in(path)


def test_more_than_a_file_has_left_is_never_asked_for():
    class Stream(BytesIO):
        def read(self, count=-1):
            assert 0 <= count <= 10
            return super().read(count)

    stream = ply_rows._Headed(b"ply", Stream(b"0123456789"), 10)
    assert [stream.read(9), stream.read(4), stream.read(7), stream.read(-1)] == [
        b"ply", b"0123", b"", b""
    ]  # fmt: skip
    assert stream.read(6) == b"456789"


def test_faces_of_differing_length_beyond_the_limit_are_told(tmp_path, monkeypatch):
    monkeypatch.setattr(ply_rows, "_MOST_WALKED", 5)
    with pytest.raises(CloudError, match="7 rows of 'face' of differing length"):
        faces_in(write_mesh(tmp_path / "a.ply", MIXED))


def test_faces_are_read_a_part_at_a_time(tmp_path, monkeypatch):
    monkeypatch.setattr(ply_rows, "_ROWS", 2)
    monkeypatch.setattr(ply_rows, "_TABLE", 5)
    for order in ORDERS:
        for mesh in (MIXED, cube()):
            found = faces_in(write_mesh(tmp_path / "a.ply", mesh, order))
            assert sorted(found) == sorted(np.asarray(face).tolist() for face in mesh[1])


@pytest.mark.parametrize(("name", "kind"), [("corners", "int"), ("vertex_indices", "float")])
def test_faces_without_a_list_of_corners_are_told(name, kind, tmp_path):
    path = write_mesh(tmp_path / "a.ply", cube(), name=name)
    path.write_bytes(path.read_bytes().replace(b"uchar int", b"uchar " + kind.encode()))
    info = open_cloud([path]).info
    assert info.faces == 0
    assert "12 faces whose corners cannot be read" in info.warnings[0]


@pytest.mark.parametrize("line", ["3 0 1", "x 0 1 2", "3 0 1 2.5", ""])
def test_row_that_is_no_face_is_one_line(line, tmp_path):
    path = write_mesh(tmp_path / "a.ply", joined(tetrahedron()), "ascii")
    lines = path.read_text().split("\n")
    lines[-2] = f"7 {line}" if line else ""
    path.write_text("\n".join(lines))
    with pytest.raises(CloudError) as caught:
        faces_in(path)
    assert "\n" not in str(caught.value)


def test_no_file_is_mapped_into_memory(tmp_path, monkeypatch):
    """One that shrinks while it is mapped ends the process."""

    def mapped(*given: object, **more: object) -> None:
        raise AssertionError("mapped")

    monkeypatch.setattr(np, "memmap", mapped)
    for order in ORDERS:
        for mesh in (MIXED, cube()):
            faces_in(write_mesh(tmp_path / "a.ply", mesh, order))


def test_without_plyfile_a_cloud_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "plyfile", None)
    with pytest.raises(CloudError, match="pip install plyfile"):
        open_cloud([write_mesh(tmp_path / "a.ply", cube())])
