"""Meshes whose volumes are known, and how to write them as PLY."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Sequence, Tuple

import numpy as np

Mesh = Tuple[np.ndarray, np.ndarray]
"""(V, 3) points, and (F, 3) or (F, 4) numbers of points: corners turn left seen from outside."""

UTM = (576_700.0, 5_188_140.0, 160.0)
_QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]


def box(edges: Sequence[float] = (1.0, 1.0, 1.0), at: Sequence[float] = (0.0, 0.0, 0.0)) -> Mesh:
    """Return a box of four-cornered faces with a corner at `at`."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
    return corners * edges + at, np.array(_QUADS)


def triangles(mesh: Mesh) -> Mesh:
    """Return a mesh with each four-cornered face split."""
    points, faces = mesh
    return points, np.concatenate([faces[:, [0, 1, 2]], faces[:, [0, 2, 3]]])


def cube(edge: float = 1.0, at: Sequence[float] = (0.0, 0.0, 0.0)) -> Mesh:
    """Return a cube of twelve triangles."""
    return triangles(box((edge, edge, edge), at))


def tetrahedron(at: Sequence[float] = (0.0, 0.0, 0.0)) -> Mesh:
    """Return a tetrahedron of 1/6."""
    points = np.vstack([np.zeros(3), np.eye(3)]) + at
    return points, np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])


def torus(around: int, across: int, large: float = 3.0, small: float = 1.0) -> Mesh:
    """Return a torus inscribed with rings of flat faces: see `torus_volume`."""
    u, v = np.meshgrid(np.arange(around), np.arange(across), indexing="ij")
    a, b = 2 * np.pi * u / around, 2 * np.pi * v / across
    reach = large + small * np.cos(b)
    points = np.stack([reach * np.cos(a), reach * np.sin(a), small * np.sin(b)], axis=-1)
    here, right = u * across + v, (u + 1) % around * across + v
    up, both = u * across + (v + 1) % across, (u + 1) % around * across + (v + 1) % across
    faces = np.stack([here, right, both, up], axis=-1).reshape(-1, 4)
    return triangles((points.reshape(-1, 3), faces))


def torus_volume(around: int, across: int, large: float = 3.0, small: float = 1.0) -> float:
    """Return the volume of `torus`: between two half planes a ring's section is linear.

    The section, a regular polygon of area P about the radius R, sweeps wedges of the angle a. A
    prism from one place of the section to the next, at radius r, is r^2 sin(a) / 2: each wedge has
    P R sin(a), as the first moment of P about the axis is P R.
    """
    section = 0.5 * across * small**2 * np.sin(2 * np.pi / across)
    return float(around * section * large * np.sin(2 * np.pi / around))


def joined(*meshes: Mesh) -> Mesh:
    """Return several meshes as one."""
    first = np.cumsum([0, *(len(points) for points, _ in meshes)])
    faces = [faces + start for (_, faces), start in zip(meshes, first)]
    return np.vstack([points for points, _ in meshes]), np.vstack(faces)


def reversed_(mesh: Mesh) -> Mesh:
    """Return a mesh whose faces point the other way."""
    return mesh[0], mesh[1][:, ::-1]


def soup(mesh: Mesh) -> Mesh:
    """Return a mesh in which every face has corners of its own, as in an STL file."""
    points, faces = mesh
    return points[faces.ravel()], np.arange(faces.size).reshape(faces.shape)


def moebius(around: int = 40) -> Mesh:
    """Return a strip with half a turn, which has one side only."""
    a = np.linspace(0.0, 2 * np.pi, around, endpoint=False)
    rows = [
        np.stack(
            [
                (3 + s * np.cos(a / 2)) * np.cos(a),
                (3 + s * np.cos(a / 2)) * np.sin(a),
                s * np.sin(a / 2),
            ],
            axis=1,
        )
        for s in (-1.0, 1.0)
    ]
    points = np.vstack(rows)
    faces = [(i, i + 1, around + i + 1, around + i) for i in range(around - 1)]
    faces.append((around - 1, around, 0, 2 * around - 1))  # the ends meet turned over
    return triangles((points, np.array(faces)))


def write_mesh(
    path: Path,
    mesh: Mesh,
    order: str = "binary_little_endian",
    at: Sequence[float] = (0.0, 0.0, 0.0),
    name: str = "vertex_indices",
) -> Path:
    """Write a mesh as PLY; faces may also be a list of lists of any lengths."""
    points, faces = mesh
    points = np.asarray(points) + at
    mark = ">" if "big" in order else "<"
    head = f"ply\nformat {order} 1.0\nelement vertex {len(points)}\n"
    head += "".join(f"property double {axis}\n" for axis in "xyz")
    head += f"element face {len(faces)}\nproperty uchar flag\nproperty list uchar int {name}\n"
    head += "end_header\n"
    rows: Any = [np.asarray(face) for face in faces]
    if order == "ascii":
        lines = [" ".join(repr(v) for v in row) for row in points.tolist()]
        lines += [" ".join(map(str, [7, len(face), *face.tolist()])) for face in rows]
        data = ("\n".join(lines) + "\n").encode()
    else:
        data = points.astype(mark + "f8").tobytes()
        data += b"".join(
            bytes([7, len(face)]) + face.astype(mark + "i4").tobytes() for face in rows
        )
    path.write_bytes(head.encode() + data)
    return path
