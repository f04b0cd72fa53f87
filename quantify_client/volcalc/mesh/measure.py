"""The volume within a closed mesh, by its faces: exact, however few they are.

With `x` counted from the mesh's own middle, the volume is the sum of x . n dA / 3 over the faces
(divergence theorem), which is that of the tetrahedra from the middle to each face.
"""

from __future__ import annotations

import math
from typing import Iterator, List, Optional, Tuple, Union

import numpy as np

from ...types import AreaResult, Body, BudgetItem, Check, Faces, FloatArray, IntArray, Notice
from ..body.sections import BodySurface
from ..body.tetrahedra import face_normals
from ..body_slices import CONVERGENCE, TERRAIN_ONLY, BodyRecipe, slab_edges, slices_of
from .closed import MOST_FACES, NotClosedError, closed

__all__ = ["measure_mesh"]

#: How many corners of a face are tried as the one that its triangles have in common: a face with
#: four always has one from which it splits well.
_STARTS = 8

#: Of a polygon's area: a triangle of less is taken for a line, not for a part of the polygon.
_NO_PART = 1e-9

#: A change of the volume by this share shows in the digits that are printed.
_SHOWN = 1e-4

_MOST_POINTS = 20_000  # in the report's picture

_NO_INTERVAL = Notice(
    "no-interval-mesh",
    "the volume within the faces of the mesh is exact, but the accuracy of the mesh is unknown, so "
    "there is no interval; give the standard deviation of its surface (--accuracy)",
)


def measure_mesh(
    name: str, points: FloatArray, faces: Faces, recipe: BodyRecipe
) -> Union[AreaResult, str]:
    """Return the volume within a mesh, or the clause that says why its faces determine none.

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
    try:
        triangles, other_volume = _split(here, faces)
        counted, inverted = closed(here, triangles)
    except NotClosedError as fault:
        if fault.face is None:
            return fault.reason
        x, y, z = points[triangles[fault.face]].mean(axis=0).tolist()
        return f"{fault.reason} (one at {x:.2f}, {y:.2f}, {z:.2f})"
    checks = () if other_volume is None else (Check("polygons split elsewhere", abs(other_volume)),)
    return _result(name, here, origin, counted, inverted, checks, recipe)


def _result(
    name: str,
    here: FloatArray,
    origin: FloatArray,
    triangles: IntArray,
    inverted: bool,
    checks: Tuple[Check, ...],
    recipe: BodyRecipe,
) -> AreaResult:
    volume = _volume(here, triangles)
    area = 0.5 * float(np.linalg.norm(face_normals(here, triangles), axis=1).sum())
    std = None if recipe.accuracy is None else recipe.accuracy * area
    surface = BodySurface.of(here, triangles)
    zero, used = float(origin[2]), np.unique(triangles)
    low, high = surface.lowest, surface.highest
    edges = slab_edges(low, high, recipe.slab_count(high - low))
    held = np.histogram(np.clip(here[used, 2], edges[0], edges[-1]), edges)[0]
    return AreaResult(
        name=name,
        volume_m3=volume,
        std_m3=std,
        budget=() if std is None else (BudgetItem("survey", std),),
        surface_area_m2=area,
        min_z_m=low + zero,
        max_z_m=high + zero,
        max_height_m=float(edges[-1] - edges[0]),
        points_used=len(used),
        points_left_out={"in no face that counts": len(here) - len(used)},
        slice_height_m=float(edges[1] - edges[0]),
        slices=slices_of(edges, np.diff(surface.volume_below(edges)), held, zero),
        checks=checks,
        warnings=tuple(_warnings(volume, std, checks, inverted)),
        body=_drawn(here[used], origin, surface, edges),
        **TERRAIN_ONLY,
    )


def _warnings(
    volume: float, std: Optional[float], checks: Tuple[Check, ...], inverted: bool
) -> Iterator[Notice]:
    """Yield what the user should know of a mesh's volume."""
    if std is None:
        yield _NO_INTERVAL
    elif 1.96 * std >= volume:
        yield Notice(
            "accuracy-as-large-as-body",
            "--accuracy is nearly as large as the body: the interval assumes an error that is "
            "small beside it, and is only a rough guide",
            std_m3=std,
            volume_m3=volume,
        )
    if inverted:
        yield Notice(
            "faces-inverted",
            "all faces of the mesh point inwards: they were turned outwards",
        )
    for check in checks:
        difference = check.volume_m3 / volume - 1.0
        if abs(check.volume_m3 - volume) > _SHOWN * volume:
            yield Notice(
                "faces-not-flat",
                "faces with more than three corners are not flat: split into triangles from their "
                f"next corner they hold {difference:+.2%}; export triangles",
                share=difference,
            )


def _split(points: FloatArray, faces: Faces) -> Tuple[IntArray, Optional[float]]:
    """Split faces into triangles from one of their corners.

    It is the first from which all triangles turn as the whole face does; for a convex face that is
    the first corner, for a concave one with four the corner that lies inwards.

    Returns
    -------
    triangles : (T, 3) numbers of points.
    volume : where every face is split from the corner after that; None where all are triangles.

    Raises
    ------
    NotClosedError
        A face is too crooked, or none has three corners.
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
                raise NotClosedError(
                    f"{(start < 0).sum():,} {which} too crooked to be split into triangles"
                )
            roll = (start[:, None] + np.arange(size)) % size
            corners = np.take_along_axis(corners, roll, axis=1)
        parts.append(_fan(corners))
        others.append(_fan(np.roll(corners, -1, axis=1)))
    if not parts:
        raise NotClosedError("none of its faces has three corners")
    triangles = np.concatenate(parts)
    if faces.sizes.max() == 3:
        return triangles, None
    return triangles, _volume(points, np.concatenate(others))


def _fan(corners: IntArray) -> IntArray:
    """(F * (S - 2), 3) triangles of faces (F, S), all from the first corner."""
    first = np.repeat(corners[:, :1], corners.shape[1] - 2, axis=1)
    fans = np.stack([first, corners[:, 1:-1], corners[:, 2:]], axis=2)
    return np.asarray(fans.reshape(-1, 3))


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
    """Return the volume within triangles whose corners turn left seen from outside."""
    a, b, c = (points[triangles[:, corner]] for corner in range(3))
    return float(np.einsum("ti,ti->t", a, np.cross(b, c)).sum()) / 6.0


def _drawn(points: FloatArray, origin: FloatArray, surface: BodySurface, edges: FloatArray) -> Body:
    """Return what the pictures are drawn from."""
    none = np.zeros((0, 3), dtype=np.float32)
    step = max(1, math.ceil(len(points) / _MOST_POINTS))
    x, y, z = origin.tolist()
    return Body(
        origin=(x, y, z),
        points=points[::step].astype(np.float32),
        outliers=none,
        ground=none,
        outlines=surface.outlines_between(edges),
        gaps=(),
        convergence=surface.box_sums(CONVERGENCE),
    )
