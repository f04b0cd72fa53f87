"""Bodies as photographs show them: partly, on ground or cropped, with known volumes.

A scene is a body (a closed mesh, or a random union of `tests/solids.py`) that rests on a face of
its convex hull, as loose things do. Cameras stand on two rings around it. Of random points on it
and on the ground those are kept that one of the cameras sees: hidden points are removed as in Katz,
Tal and Basri 2007. Photographs show less: a point takes two or three cameras, none of which sees
its surface at a slant (`least`, `slant`). Errors of a reconstruction are smooth: all points are
moved by a random field.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Iterator

import numpy as np
from scipy.spatial import ConvexHull, cKDTree
from scipy.spatial.transform import Rotation

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
from solids import Body, mesh_body

FLIP = 100.0
"""Radius of the sphere that points are flipped at, times the farthest one's distance."""

DISTANCE = 2.5
"""Of the cameras from the body's middle, times its longest side."""

WAVES, LENGTHS = 40, (0.2, 0.6)
"""The smooth field's number of waves, and their lengths, shares of the longest side."""


@dataclass(frozen=True)
class Scene:
    """Points (N, 3) on a floor at 0, the camera that sees each, cameras (K, 3), and the truth."""

    name: str
    volume: float
    points: np.ndarray
    seen_by: np.ndarray
    cameras: np.ndarray
    share: float


def meshes(folder: Path) -> Iterator[Body]:
    """Yield the closed meshes of a folder, longest side 1; Open3D reads them."""
    import open3d

    for path in sorted(folder.iterdir()):
        mesh = open3d.io.read_triangle_mesh(str(path))
        mesh.remove_duplicated_vertices()
        if len(mesh.triangles) and mesh.is_edge_manifold(allow_boundary_edges=False):
            corners = np.asarray(mesh.vertices)
            corners, faces = corners / np.ptp(corners, axis=0).max(), np.asarray(mesh.triangles)
            a, b, c = (corners[faces[:, i]] for i in range(3))
            volume = abs(float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum())) / 6.0
            yield mesh_body(path.stem, corners, faces, volume)


def resting(body: Body, seed: int) -> Body:
    """Return the body on one of its stable faces, its lowest point at a height of 0."""
    rng = np.random.default_rng(seed)
    probe = body.surface(20_000, rng)
    hull = ConvexHull(probe)
    middle = probe.mean(axis=0)
    direction = rng.normal(size=3)
    direction /= np.linalg.norm(direction)
    for _ in range(100):  # it rolls over to the face below its middle until it stays
        away = -(hull.equations[:, :3] @ middle + hull.equations[:, 3])
        fall = hull.equations[:, :3] @ direction
        reach = np.where(fall > 1e-9, away / np.maximum(fall, 1e-9), np.inf)
        normal = hull.equations[int(np.argmin(reach)), :3]
        if np.allclose(normal, direction):
            break
        direction = normal
    turn, _ = Rotation.align_vectors([[0.0, 0.0, -1.0]], [direction])
    turned = body.turned(body.name, turn)
    low = float(turned.surface(200_000, np.random.default_rng(seed))[:, 2].min())
    draw = turned.surface

    def surface(count: int, rng: np.random.Generator) -> np.ndarray:
        return np.asarray(draw(count, rng) - [0.0, 0.0, low])

    return Body(body.name, body.volume, body.area, surface)


def visible(points: np.ndarray, camera: np.ndarray) -> np.ndarray:
    """(K,) numbers of the points that a camera sees."""
    away = points - camera
    length = np.linalg.norm(away, axis=1)[:, None]
    flipped = away + 2.0 * (FLIP * length.max() - length) * away / length
    seen = ConvexHull(np.vstack([flipped, np.zeros(3)])).vertices
    return np.asarray(seen[seen < len(points)])


def rings(count: int, middle: np.ndarray, side: float, rng: np.random.Generator) -> np.ndarray:
    """(count, 3) cameras on two rings, one low and one high."""
    around = 2.0 * np.pi * (np.arange(count) // 2 / (count // 2)) + rng.uniform(0, 2 * np.pi)
    around += np.where(np.arange(count) % 2, np.pi / (count // 2), 0.0)
    up = np.radians(np.where(np.arange(count) % 2, 50.0, 20.0))
    away = np.column_stack([np.cos(around) * np.cos(up), np.sin(around) * np.cos(up), np.sin(up)])
    return np.asarray(middle + DISTANCE * side * away)


def displaced(
    points: np.ndarray, amount: float, side: float, rng: np.random.Generator
) -> np.ndarray:
    """(N, 3) points moved by a smooth random field of a standard deviation along each axis."""
    moved = points.copy()
    for axis in range(3):
        length = side * rng.uniform(*LENGTHS, WAVES)
        direction = rng.normal(size=(3, WAVES))
        wave = 2.0 * np.pi * direction / np.linalg.norm(direction, axis=0) / length
        phase = points @ wave + rng.uniform(0, 2 * np.pi, WAVES)
        moved[:, axis] += amount * side * np.sqrt(2.0 / WAVES) * np.cos(phase).sum(axis=1)
    return moved


def slanted(points: np.ndarray, camera: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """(N,) angles between the line of sight and the surface, degrees."""
    away = camera - points
    cosine = np.abs((away * normals).sum(axis=1)) / np.linalg.norm(away, axis=1)
    return np.asarray(np.degrees(np.arcsin(np.minimum(cosine, 1.0))))


def normals_of(points: np.ndarray) -> np.ndarray:
    """(N, 3) unit normals of planes through twelve neighbours."""
    near = points[cKDTree(points).query(points, 12)[1]]
    near -= near.mean(axis=1, keepdims=True)
    return np.asarray(np.linalg.eigh(np.einsum("nki,nkj->nij", near, near))[1][:, :, 0])


def scene(
    body: Body,
    count: int,
    cameras: int,
    on_ground: bool,
    amount: float,
    seed: int,
    least: int = 1,
    slant: float = 0.0,
) -> Scene:
    """Return what some cameras see of a body: of `count` points on it, and of the ground.

    What fewer than `least` see, at no less than `slant` degrees to its surface, is left out.
    """
    rng = np.random.default_rng([seed, cameras])
    points = body.surface(count, rng)
    low, high = points.min(axis=0), points.max(axis=0)
    side, middle = float((high - low).max()), (low + high) / 2.0
    width = 1.8 * float((high - low)[:2].max())
    some = min(count, round(count / body.area * width**2))
    ground = rng.uniform(-0.5, 0.5, (some, 2)) * width + middle[:2]
    ground = np.column_stack([ground, np.zeros(len(ground))])
    everything = np.vstack([points, ground])
    places = rings(cameras, middle, side, rng)
    by, seen = np.full(len(everything), -1), np.zeros(len(everything), dtype=np.int64)
    normals = np.vstack([normals_of(points), np.tile([0.0, 0.0, 1.0], (some, 1))])
    for number in rng.permutation(cameras):
        shown = visible(everything, places[number])
        shown = shown[slanted(everything[shown], places[number], normals[shown]) >= slant]
        by[shown] = number
        seen[shown] += 1
    kept = seen >= least
    share = float(kept[:count].mean())
    if not on_ground:
        kept[count:] = False
    moved = displaced(everything[kept], amount, side, rng)
    return Scene(body.name, body.volume, moved, by[kept], places, share)
