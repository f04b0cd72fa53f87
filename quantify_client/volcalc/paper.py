"""The paper's algorithm, kept faithful as the reference: ``--method polar``.

Source: "3D-Quantify" (Earlham College), the VolCalc module. The midpoint of the bounding box of a
slab's points goes to the origin, the points go to polar form and are sorted by angle, and the
shoelace formula over the ordered points is the slab's area. Here all slabs are ordered at once.

It holds all the points that it sorts. It is right only for bodies whose horizontal sections are
single outlines that every ray from the middle of their bounding box meets once, sampled on their
surface and cut so that no slab holds a floor or a roof.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import List, Sequence, Tuple

import numpy as np
import numpy.typing as npt

from ..errors import InputError
from ..types import AreaResult, FloatArray, IntArray, Notice, Slice
from .body_slices import TERRAIN_ONLY, BodyRecipe, slab_edges, slab_index

__all__ = [
    "PolarVolume",
    "bounding_midpoints",
    "measure_polar",
    "polar_order",
    "polar_volume",
    "ring_areas",
]

_FEWEST_POINTS = 4  # three points span no body
_FEWEST_IN_SLAB = 3  # two points span no outline

_KEY_BITS = 64
_MOST_ANGLE_BITS = 52  # more than a float64's fraction would only sort rounding

_NO_INTERVAL = Notice(
    "no-interval-polar",
    "the paper's method gives no interval; it is right for star-shaped bodies only",
)


@dataclass(frozen=True)
class PolarVolume:
    """Volume of a body by the paper's algorithm.

    Attributes
    ----------
    volume : cubic metres, the sum over ``slices``.
    slices : from the lowest to the highest; ``z_m`` is the elevation of a slab's middle.
    warnings : one line each.
    slab_height : metres, the same for every slab.
    """

    volume: float
    slices: Sequence[Slice]
    warnings: Sequence[Notice]
    slab_height: float


def measure_polar(
    name: str, x: FloatArray, y: FloatArray, z: FloatArray, recipe: BodyRecipe
) -> AreaResult:
    """Return the result for a body measured by the paper's method.

    Parameters
    ----------
    x, y, z : (N,) float64, points on the body's surface, metres, measuring frame.
    """
    lowest, highest = float(z.min()), float(z.max())
    found = polar_volume(
        (x - x.min()) / recipe.ground_factor,
        (y - y.min()) / recipe.ground_factor,
        z,
        recipe.slab_count(highest - lowest),
        center_caps=recipe.center_caps,
    )
    return AreaResult(
        name=name,
        volume_m3=found.volume,
        std_m3=None,
        budget=(),
        surface_area_m2=None,
        min_z_m=lowest,
        max_z_m=highest,
        max_height_m=highest - lowest,
        points_used=len(z),
        points_left_out={},
        slice_height_m=found.slab_height,
        slices=found.slices,
        warnings=(*found.warnings, _NO_INTERVAL),
        **TERRAIN_ONLY,
    )


def polar_volume(
    x: FloatArray, y: FloatArray, z: FloatArray, slabs: int, *, center_caps: bool = False
) -> PolarVolume:
    """Return the volume of a closed body from points on its surface, slab by slab.

    Parameters
    ----------
    x, y, z : (N,) float64
        Points in metres, in any order and with any offset.
    slabs : int
        Number of equal horizontal slabs from the lowest to the highest point. The slabs are
        half-open, the last one is closed.
    center_caps : bool
        Put the middles of the end slabs on the lowest and on the highest point; ``slabs`` is then
        at least 2.

    Returns
    -------
    PolarVolume
        A slab with fewer than three points counts 0, and a warning says how many did.

    Raises
    ------
    InputError
        For fewer than four points, NaN or infinite coordinates, points that all have one
        elevation, and a number of slabs out of range.

    Examples
    --------
    The eight corners of a box with sides 2, 3 and 4, in two slabs:

    >>> x, y, z = (side.ravel() for side in np.meshgrid([0.0, 2.0], [0.0, 3.0], [0.0, 4.0]))
    >>> polar_volume(x, y, z, 2).volume
    24.0
    """
    _refuse_unusable(x, y, z)
    edges = slab_edges(float(z.min()), float(z.max()), slabs, center_caps=center_caps)
    slab = slab_index(z, edges)
    counts: IntArray = np.bincount(slab, minlength=slabs)
    areas = np.where(counts < _FEWEST_IN_SLAB, 0.0, _slab_areas(x, y, slab, counts))
    height = float(edges[-1] - edges[0]) / slabs
    middles = edges[:-1] + 0.5 * height
    return PolarVolume(
        volume=float(np.sum(areas * height)),
        slices=tuple(
            Slice(z_m=middle, height_m=height, area_m2=area, volume_m3=area * height, points=held)
            for middle, area, held in zip(middles.tolist(), areas.tolist(), counts.tolist())
        ),
        warnings=tuple(_warnings(z, counts)),
        slab_height=height,
    )


def _refuse_unusable(x: FloatArray, y: FloatArray, z: FloatArray) -> None:
    if not len(x) == len(y) == len(z):
        raise InputError(f"{len(x)} x, {len(y)} y and {len(z)} z: give as many of each")
    if len(x) < _FEWEST_POINTS:
        raise InputError(
            f"{len(x)} points: a volume needs at least {_FEWEST_POINTS}; give the whole cloud"
        )
    if not all(np.isfinite(values).all() for values in (x, y, z)):
        raise InputError("the points hold NaN or infinite coordinates: remove those points first")


def _warnings(z: FloatArray, counts: IntArray) -> List[Notice]:
    """Return a warning for slabs that must be empty, and one for slabs with too few points."""
    slabs = len(counts)
    found: List[Notice] = []
    # Every occupied slab holds a height of its own, so distinct heights need counting (a sort)
    # only where a slab is empty.
    distinct = slabs if counts.all() else len(np.unique(z))
    if slabs > distinct:
        text = (
            f"{slabs} slices but only {distinct} distinct elevations: some slices must be "
            f"empty and the volume comes out too small; ask for at most {distinct}"
        )
        found.append(Notice("more-slices-than-elevations", text, slices=slabs, distinct=distinct))
    sparse = int(np.count_nonzero(counts < _FEWEST_IN_SLAB))
    if sparse:
        text = (
            f"{sparse} of {slabs} slices hold fewer than {_FEWEST_IN_SLAB} points and count as "
            "empty: the volume comes out too small; ask for fewer slices"
        )
        found.append(Notice("sparse-slices", text, sparse=sparse, slices=slabs))
    return found


def _slab_areas(x: FloatArray, y: FloatArray, slab: IntArray, counts: IntArray) -> FloatArray:
    """(slabs,) shoelace areas of the points' outlines; each slab's midpoint is its origin.

    The midpoint of a bounding box lies within the convex hull, so no step of the ordered outline
    turns by more than half a circle and no term of the shoelace is negative.
    """
    slabs = len(counts)
    middle_x, middle_y = bounding_midpoints(x, y, slab, slabs)
    u, v = x - middle_x[slab], y - middle_y[slab]
    order = polar_order(u, v, slab, slabs)
    return ring_areas(u[order], v[order], np.repeat(np.arange(slabs), counts), slabs)


def bounding_midpoints(
    x: FloatArray, y: FloatArray, slab: IntArray, slabs: int
) -> Tuple[FloatArray, FloatArray]:
    """Return the midpoint of the bounding box of each slab's points.

    Parameters
    ----------
    x, y : (N,) float64
        Metres, any origin.
    slab : (N,) int64
        In 0 .. ``slabs`` - 1, in any order.
    slabs : int
        Their number.

    Returns
    -------
    (slabs,) float64, (slabs,) float64
        Eastings and northings; 0 for an empty slab.
    """

    def middles(values: FloatArray) -> FloatArray:
        least, greatest = np.full(slabs, np.inf), np.full(slabs, -np.inf)
        np.minimum.at(least, slab, values)
        np.maximum.at(greatest, slab, values)
        return np.where(greatest < least, 0.0, least + 0.5 * np.abs(greatest - least))

    return middles(x), middles(y)


def polar_order(x: FloatArray, y: FloatArray, slab: IntArray, slabs: int) -> IntArray:
    """Return the order of points by slab, then by angle, then by radius.

    Parameters
    ----------
    x, y : (N,) float64
        Metres from the midpoint of the point's slab (:func:`bounding_midpoints`).
    slab : (N,) int64
        In 0 .. ``slabs`` - 1.
    slabs : int
        The bits of N and of ``slabs`` together must not exceed 64.

    Returns
    -------
    (N,) int64
        Indices in sorted order. The angle is ``atan2(y, x)`` in (-pi, pi], equal angles go by
        increasing radius, equal radii by x and y: only equal points by their position in the input.

    Notes
    -----
    Slab, angle and position share one 64-bit key, so that one plain sort of integers does nearly
    all the work. What it leaves of the angle (35 bits for 5 million points in 50 slabs) separates
    all but a few points; runs of equal keys are sorted again with their exact angles.

    Examples
    --------
    The corners of a square, given crosswise, come out in turn from the south-west one:

    >>> x, y = np.array([-1.0, 1.0, 1.0, -1.0]), np.array([-1.0, 1.0, -1.0, 1.0])
    >>> polar_order(x, y, np.zeros(4, np.int64), 1).tolist()
    [0, 2, 1, 3]
    """
    count = len(x)
    if count == 0:
        return np.zeros(0, np.int64)
    # Adding 0.0 turns -0.0 into 0.0, which atan2 would send to -pi instead of pi.
    theta = np.arctan2(y + 0.0, x + 0.0)
    position_bits = int(count - 1).bit_length()
    angle_bits = min(_MOST_ANGLE_BITS, _KEY_BITS - position_bits - int(slabs - 1).bit_length())
    steps = (1 << angle_bits) - 1
    key = ((theta + np.pi) * (steps / (2.0 * np.pi))).astype(np.uint64)
    np.minimum(key, np.uint64(steps), out=key)
    key |= slab.astype(np.uint64) << np.uint64(angle_bits)
    key <<= np.uint64(position_bits)
    key |= np.arange(count, dtype=np.uint64)
    key.sort()
    order = (key & np.uint64((1 << position_bits) - 1)).astype(np.int64)
    key >>= np.uint64(position_bits)
    _settle_ties(order, key, theta, x, y)
    return order


def _settle_ties(
    order: IntArray, key: npt.NDArray[np.uint64], theta: FloatArray, x: FloatArray, y: FloatArray
) -> None:
    """Sort each run of equal keys by exact angle and radius; changes ``order`` in place."""
    same = key[1:] == key[:-1]
    places = np.flatnonzero(np.append(same, False) | np.append(False, same))
    tied = order[places]
    radius = np.hypot(x[tied], y[tied])
    order[places] = tied[np.lexsort((y[tied], x[tied], radius, theta[tied], key[places]))]


def ring_areas(x: FloatArray, y: FloatArray, ring: IntArray, rings: int) -> FloatArray:
    """Return the signed areas of many polygons at once, by the shoelace formula.

    Parameters
    ----------
    x, y : (N,) float64
        Vertices in metres, polygon after polygon, each counted from an origin of its own nearby.
    ring : (N,) int64
        The polygon of each vertex, ascending, in 0 .. ``rings`` - 1.
    rings : int
        Number of polygons; those without vertices have area 0.

    Returns
    -------
    (rings,) float64
        Square metres, positive counter-clockwise.

    Examples
    --------
    >>> x = np.array([0.0, 2.0, 2.0, 0.0, 0.0, 1.0, 0.0])
    >>> y = np.array([0.0, 0.0, 2.0, 2.0, 0.0, 0.0, 1.0])
    >>> ring_areas(x, y, np.array([0, 0, 0, 0, 2, 2, 2]), 3).tolist()
    [4.0, 0.0, 0.5]
    """
    following = np.arange(1, len(x) + 1)
    counts = np.bincount(ring, minlength=rings)
    ends = np.cumsum(counts)
    held = counts > 0
    following[ends[held] - 1] = (ends - counts)[held]
    cross = x * y[following] - x[following] * y
    return np.asarray(0.5 * np.bincount(ring, weights=cross, minlength=rings), np.float64)
