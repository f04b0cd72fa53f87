"""The volume within a closed mesh, by its faces: exact, however few they are.

With `x` counted from the mesh's own middle, the volume is the sum of x . n dA / 3 over the faces
(divergence theorem), which is that of the tetrahedra from the middle to each face.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Iterator, List, Optional, Tuple, Union

import numpy as np

from ...types import AreaResult, BudgetItem, Check, Faces, FloatArray, IntArray, Slice, Solid
from ..body.sections import Surface
from ..slices import AUTO_SLABS, CONVERGENCE, slab_count, slab_edges
from .closed import MOST_FACES, Closed, Unfit, closed

__all__ = ["MeshRecipe", "measure_mesh"]

#: How many corners of a face are tried as the one that its triangles have in common: a face with
#: four always has one from which it splits well.
_STARTS = 8

#: Of a polygon's area: a triangle of less is taken for a line, not for a part of the polygon.
_NO_PART = 1e-9

#: A change of the volume by this share shows in the digits that are printed.
_SHOWN = 1e-4

_BLOCK = 200_000  # triangles whose shares are reckoned together

_MOST_POINTS = 20_000  # in the report's picture

_NO_INTERVAL = (
    "a mesh does not tell how good it is: the volume within its faces is exact, and it has no "
    "interval; give the standard deviation of its surface (--accuracy)"
)


@dataclass(frozen=True)
class MeshRecipe:
    """How a mesh is to be measured.

    Attributes
    ----------
    slices : ``"auto"`` or the number of slices.
    slice_height : of the slices at most, metres; it decides when given.
    accuracy : standard deviation of the surface's position along its normal, metres; or None.
    ground_factor : grid length / ground length at the site.
    """

    slices: Union[str, int] = "auto"
    slice_height: Optional[float] = None
    accuracy: Optional[float] = None
    ground_factor: float = 1.0


def measure_mesh(
    name: str, points: FloatArray, faces: Faces, recipe: MeshRecipe
) -> Union[AreaResult, str]:
    """Return the volume within a mesh, or the clause that says why its faces tell none.

    Parameters
    ----------
    points : (V, 3) float64, metres, measuring frame.
    faces : their corners are numbers of these points.
    """
    if len(faces.corners) - 2 * len(faces.sizes) > MOST_FACES:
        return f"more than {MOST_FACES:,} triangles are not searched for faces that meet"
    if not len(faces.corners):
        return "none of them has a corner"
    used = points[np.unique(faces.corners)]
    origin = 0.5 * (used.min(axis=0) + used.max(axis=0))
    here = (points - origin) / [recipe.ground_factor, recipe.ground_factor, 1.0]
    split = _split(here, faces)
    if isinstance(split, Unfit):
        return split.reason
    triangles, other_volume = split
    found = closed(here, triangles)
    if isinstance(found, Unfit):
        return found.reason + _where(points, triangles, found.face)
    return _result(name, here, origin, found, other_volume, recipe)


def _where(points: FloatArray, triangles: IntArray, face: Optional[int]) -> str:
    if face is None:
        return ""
    x, y, z = points[triangles[face]].mean(axis=0).tolist()
    return f" (one at {x:.2f}, {y:.2f}, {z:.2f})"


def _result(
    name: str,
    here: FloatArray,
    origin: FloatArray,
    mesh: Closed,
    split: Optional[float],
    recipe: MeshRecipe,
) -> AreaResult:
    volume = _volume(here, mesh.triangles)
    surface = surface_of_mesh(here, mesh.triangles)
    zero = float(origin[2])
    edges = _edges(surface, recipe)
    area = _area(here, mesh.triangles)
    std = None if recipe.accuracy is None else recipe.accuracy * area
    used = np.unique(mesh.triangles)
    checks = () if split is None else (Check("polygons split elsewhere", abs(split)),)
    return AreaResult(
        name=name,
        volume_m3=volume,
        cut_m3=None,
        fill_m3=None,
        std_m3=std,
        cut_std_m3=None,
        fill_std_m3=None,
        budget=() if std is None else (BudgetItem("survey", std),),
        area_m2=None,
        surface_area_m2=area,
        perimeter_m=None,
        min_z_m=surface.lowest + zero,
        max_z_m=surface.highest + zero,
        max_height_m=float(edges[-1] - edges[0]),
        coverage=None,
        points_used=len(used),
        points_left_out={"in no face that counts": len(here) - len(used)},
        slice_height_m=float(edges[1] - edges[0]),
        slices=_slices(surface, edges, here[used, 2], zero),
        checks=checks,
        warnings=_words(mesh, volume, std, checks),
        solid=_drawn(here[used], origin, surface, edges),
    )


def _words(
    mesh: Closed, volume: float, std: Optional[float], checks: Tuple[Check, ...]
) -> Tuple[str, ...]:
    """Return what there is to say of a mesh's volume."""
    out = [] if std is not None else [_NO_INTERVAL]
    if std is not None and 1.96 * std >= volume:
        out.append(
            "--accuracy is nearly as large as the body: the interval assumes an error that is "
            "small beside it, and is only a rough guide"
        )
    if mesh.inverted:
        out.append("all faces of the mesh point inwards; they are taken the other way round")
    for check in checks:
        if abs(check.volume_m3 - volume) > _SHOWN * volume:
            out.append(
                "faces with more than three corners are not flat: split from their next corner "
                f"they hold {check.volume_m3 / volume - 1.0:+.2%}; export triangles"
            )
    return tuple(out)


def _split(points: FloatArray, faces: Faces) -> Union[Unfit, Tuple[IntArray, Optional[float]]]:
    """Split faces into triangles from one of their corners.

    It is the first from which all triangles turn as the whole face does; for a convex face that is
    the first corner, for a concave one with four the corner that lies inwards.

    Returns
    -------
    triangles : (T, 3) numbers of points.
    volume : where every face is split from the corner after that; None where all are triangles.
    """
    ends = np.cumsum(faces.sizes)
    parts: List[IntArray] = []
    others: List[IntArray] = []
    for size in np.unique(faces.sizes[faces.sizes >= 3]).tolist():
        number = np.flatnonzero(faces.sizes == size)
        corners = faces.corners[(ends[number] - size)[:, None] + np.arange(size)]
        if size > 3:
            start = _start(points, corners)
            if (start < 0).any():
                which = f"faces with {size} corners are" if (start < 0).sum() > 1 else "face is"
                return Unfit(
                    f"{(start < 0).sum():,} {which} too crooked to be split into triangles"
                )
            roll = (start[:, None] + np.arange(size)) % size
            corners = np.take_along_axis(corners, roll, axis=1)
        parts.append(_fan(corners))
        others.append(_fan(np.roll(corners, -1, axis=1)))
    if not parts:
        return Unfit("none of its faces has three corners")
    triangles = np.concatenate(parts)
    if faces.sizes.max() == 3:
        return triangles, None
    return triangles, _volume(points, np.concatenate(others))


def _fan(corners: IntArray) -> IntArray:
    """(F * (S - 2), 3) triangles of faces (F, S), all from the first corner."""
    first = np.repeat(corners[:, :1], corners.shape[1] - 2, axis=1)
    fan: IntArray = np.stack([first, corners[:, 1:-1], corners[:, 2:]], axis=2).reshape(-1, 3)
    return fan


def _start(points: FloatArray, corners: IntArray) -> IntArray:
    """(F,) the corner to split each face from; -1 where none of those tried will do."""
    start: IntArray = np.full(len(corners), -1)
    left = np.arange(len(corners))
    size = corners.shape[1]
    for first in range(min(size, _STARTS)):
        fan = _fan(np.roll(corners[left], -first, axis=1))
        a, b, c = points[fan].transpose(1, 0, 2)
        normals = np.cross(b - a, c - a).reshape(len(left), size - 2, 3)
        whole = normals.sum(axis=1)
        along = np.einsum("fti,fi->ft", normals, whole)
        good = (along > _NO_PART * np.einsum("fi,fi->f", whole, whole)[:, None]).all(axis=1)
        start[left[good]] = first
        left = left[~good]
    return start


def _volume(points: FloatArray, triangles: IntArray) -> float:
    a, b, c = (points[triangles[:, corner]] for corner in range(3))
    return float(np.einsum("ti,ti->t", a, np.cross(b, c)).sum()) / 6.0


def _area(points: FloatArray, triangles: IntArray) -> float:
    a, b, c = (points[triangles[:, corner]] for corner in range(3))
    return 0.5 * float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())


def surface_of_mesh(points: FloatArray, triangles: IntArray) -> Surface:
    """Return the surface that sections are taken from; level triangles bound none.

    Parameters
    ----------
    triangles : (T, 3) numbers of points; the corners turn left seen from outside.
    """
    z = points[triangles, 2]
    kept = z.min(axis=1) < z.max(axis=1)
    triangles, z = triangles[kept], z[kept]
    order = np.argsort(z, axis=1, kind="stable")
    number = np.take_along_axis(triangles, order, axis=1)
    corners = points[number]
    # The body lies to the left where the corners, from the lowest up, turn left seen from outside.
    sign = np.where((order[:, 1] - order[:, 0]) % 3 == 1, 1.0, -1.0)
    return Surface(corners, number, sign, corners[:, 0, 2], corners[:, 2, 2])


def _parts(surface: Surface) -> Iterator[Surface]:
    """Yield some triangles at a time: areas and volumes of all are the sums of theirs."""
    for start in range(0, len(surface.sign), _BLOCK):
        part = slice(start, start + _BLOCK)
        yield Surface(
            surface.corners[part],
            surface.number[part],
            surface.sign[part],
            surface.bottom[part],
            surface.top[part],
        )


def _edges(surface: Surface, recipe: MeshRecipe) -> FloatArray:
    height = surface.highest - surface.lowest
    count = slab_count(height, recipe.slices, recipe.slice_height, AUTO_SLABS)
    return slab_edges(surface.lowest, surface.highest, count)


def _slices(
    surface: Surface, edges: FloatArray, heights: FloatArray, zero: float
) -> Tuple[Slice, ...]:
    below: FloatArray = np.sum([part.volume_below(edges) for part in _parts(surface)], axis=0)
    volumes = np.diff(below)
    held = np.histogram(np.clip(heights, edges[0], edges[-1]), edges)[0]
    middles, height = 0.5 * (edges[1:] + edges[:-1]) + zero, float(edges[1] - edges[0])
    return tuple(
        Slice(z_m=z_m, height_m=height, area_m2=volume / height, volume_m3=volume, points=count)
        for z_m, volume, count in zip(middles.tolist(), volumes.tolist(), held.tolist())
    )


def _drawn(points: FloatArray, origin: FloatArray, surface: Surface, edges: FloatArray) -> Solid:
    """Return what the pictures are drawn from."""
    rows = []
    for count in CONVERGENCE:
        some = np.linspace(surface.lowest, surface.highest, count + 1)
        middles = 0.5 * (some[1:] + some[:-1])
        areas = sum(float(part.areas(middles).sum()) for part in _parts(surface))
        rows.append((count, areas * float(some[1] - some[0])))
    none = np.zeros((0, 3), dtype=np.float32)
    step = max(1, math.ceil(len(points) / _MOST_POINTS))
    x, y, z = origin.tolist()
    return Solid(
        origin=(x, y, z),
        points=points[::step].astype(np.float32),
        strays=none,
        ground=none,
        outlines=tuple(
            tuple(surface.outlines(z)) for z in (0.5 * (edges[1:] + edges[:-1])).tolist()
        ),
        gaps=(),
        convergence=tuple(rows),
    )
