"""How a surface goes on over openings that were closed flat, and how little is known of that.

Where it is smooth it goes on as its normals at the rim tell, by as much as over any triangle
(facets.py), but not beyond its tangent planes there: what bulges lies below these. The normals are
means over what is near the rim, of many triangles, since noise turns those of single ones. Of an
opening of a sphere or an ellipsoid that is all. Where an edge lies within an opening the surface
leaves lids at a steep angle at all of their corners, and goes on farther.
"""

from __future__ import annotations

import math
from typing import Tuple

import numpy as np
from scipy.spatial import cKDTree

from ...types import FloatArray, IntArray
from .enclose import Enclosed
from .facets import bend, is_among, unit
from .tetrahedra import connected

__all__ = ["beyond_lids", "lids_of"]


def _middles(parts: int) -> FloatArray:
    """(P^2, 3) weights of the corners at the middles of equal triangles, P along each side."""
    upright = [(3 * i + 1, 3 * j + 1) for i in range(parts) for j in range(parts - i)]
    turned = [(3 * i + 2, 3 * j + 2) for i in range(parts) for j in range(parts - 1 - i)]
    two = np.array(upright + turned) / (3.0 * parts)
    return np.column_stack([two, 1.0 - two.sum(axis=1)])


#: Normals at the rim are means of triangles within this share of the lid's width, of this many at
#: most. The middle of half a disc lies 4 / (3 pi) of its radius behind its straight side, so that
#: they tell of a way that is longer than the lid is wide, at both ends.
_NEAR = 1.0 / 8.0
_TRIANGLES = 64
_LONGER = 1.0 + 2.0 * 4.0 / (3.0 * math.pi) * _NEAR

#: Places in a triangle, as weights of its corners: the middles of the 64 equal triangles in it.
_WITHIN = _middles(8)

_BLOCK = 4096  # lids at a time, for their triangles take memory

#: What edges within openings add, and its standard deviation, as shares of area times width times
#: the square of the sine of the angle between lid and surface, where that is least; and the
#: standard deviation from noise, as a share of area, width, and thickness of the skin by spacing:
#: of each opening by itself.
#: Most likely for benchmarks/openings.py and samplings.py (lines) are 0.17, 0.17 and 0.37; with
#: long tails, which errors have, 0.15, 0.12 and 0.28 (docs/method.md).
_OF_EDGES = 0.16
_OF_EDGES_STD = 0.17
_OF_NOISE = 0.35


def beyond_lids(body: Enclosed) -> Tuple[float, float]:
    """Return the volume beyond the lids of a body's openings and its standard deviation, m3."""
    surface = body.surface
    lid = is_among(surface.corners, body.patches)
    if not lid.any() or lid.all():
        return 0.0, 0.0
    corners, doubled = surface.corners[lid], surface.normals()
    width = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).max(axis=1)
    at_rim = _near(surface.corners[~lid], doubled[~lid], corners, _NEAR * width)
    area = 0.5 * np.linalg.norm(doubled, axis=1)
    lids = area[lid]
    angles = (at_rim * unit(doubled[lid])[:, None]).sum(axis=2)
    cosine = np.clip(angles.max(axis=1), -1.0, 1.0)
    smooth = float((lids * _bulge(corners, at_rim, unit(doubled[lid]))).sum()) / _LONGER
    steep = lids * width * (1.0 - cosine**2)
    thickness = body.skin / float(area[~lid].sum())
    noise = min(1.0, thickness / body.spacing) * lids * width
    opening = _openings(surface.number[lid])
    stds = [_OF_EDGES_STD * np.bincount(opening, steep), _OF_NOISE * np.bincount(opening, noise)]
    return smooth + _OF_EDGES * float(steep.sum()), float(np.linalg.norm(stds))


def lids_of(body: Enclosed) -> Tuple[FloatArray, FloatArray]:
    """Return the area of each of a body's O openings, m2, and how wide it is on average, metres.

    Twice the area by the length of the rim, (O,) both: the width of a long one, the radius of a
    round one.
    """
    surface = body.surface
    lid = is_among(surface.corners, body.patches)
    if not lid.any():
        return np.empty(0), np.empty(0)
    number, opening = surface.number[lid], _openings(surface.number[lid])
    area = np.bincount(opening, 0.5 * np.linalg.norm(surface.normals()[lid], axis=1))
    sides = np.sort(number[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    _, first, count = np.unique(sides, axis=0, return_index=True, return_counts=True)
    corners = surface.corners[lid][:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2, 3)
    rim = first[count == 1]
    length = np.linalg.norm(corners[rim, 1] - corners[rim, 0], axis=1)
    around = np.bincount(opening[rim // 3], length, len(area))
    width = 2.0 * area / np.maximum(around, np.finfo(float).tiny)
    return np.asarray(area, dtype=np.float64), np.asarray(width, dtype=np.float64)


def _bulge(corners: FloatArray, at_rim: FloatArray, normals: FloatArray) -> FloatArray:
    """(L,) how far a smooth surface lies above lids on average, metres.

    What bulges lies below all of its tangent planes, what is hollow above them. Where a lid goes on
    along the surface at one corner, as in a flat face, and leaves it at an edge at another, that is
    much less than the normals would have a smooth surface do.

    Parameters
    ----------
    corners, at_rim, normals : (L, 3, 3), (L, 3, 3) and (L, 3): lids, the surface's unit normals
        at their corners, and their own.
    """
    bulges = bend(corners, at_rim)
    sign = np.where(bulges < 0.0, -1.0, 1.0)[:, None, None]
    along = np.einsum("lij,lj->li", at_rim, normals)[:, :, None]
    # Of each corner's plane at all three, and from these, for it is flat, anywhere.
    rise = np.einsum("lij,likj->lik", at_rim, corners[:, :, None] - corners[:, None])
    with np.errstate(divide="ignore", invalid="ignore"):
        planes = np.where(along > 0.0, (sign * rise / along) @ _WITHIN.T, np.inf)
    within = np.maximum(planes.min(axis=1), 0.0).mean(axis=1)
    return np.asarray(np.clip(bulges, -within, within))


def _openings(number: IntArray) -> IntArray:
    """(L,) the opening that each lid belongs to: lids (L, 3) that share a corner are of one.

    What a surface does over one is all the same way, and nothing tells of another.
    """
    corner = np.unique(number, return_inverse=True)[1].reshape(-1, 3)
    one, other = corner[:, [0, 0]].ravel(), corner[:, 1:].ravel()
    part = connected(one, other, int(corner.max()) + 1)[corner[:, 0]]
    return np.asarray(np.unique(part, return_inverse=True)[1])


def _near(
    corners: FloatArray, doubled: FloatArray, places: FloatArray, reach: FloatArray
) -> FloatArray:
    """(L, 3, 3) unit normals of a surface at the corners of lids.

    Parameters
    ----------
    corners, doubled : (K, 3, 3) and (K, 3), the surface's triangles and normals twice their areas.
    places, reach : (L, 3, 3) and (L,), corners of lids, and how far away triangles count, metres.
    """
    count = min(_TRIANGLES, len(corners))
    tree, found = cKDTree(corners.mean(axis=1)), []
    for some in np.array_split(np.arange(len(places)), math.ceil(len(places) / _BLOCK)):
        away, which = tree.query(places[some].reshape(-1, 3), count)
        away, which = away.reshape(-1, count), which.reshape(-1, count)
        counts = away <= np.maximum(np.repeat(reach[some], 3), away[:, 0])[:, None]
        found.append(np.einsum("nk,nki->ni", counts.astype(np.float64), doubled[which]))
    return unit(np.concatenate(found)).reshape(-1, 3, 3)
