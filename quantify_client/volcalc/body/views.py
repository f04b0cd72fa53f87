"""Which space is seen to be empty, and which side of a surface is outside.

A camera that sees a point sees that nothing stands before it. Which camera saw which point is not
told by a cloud: it is inferred from where cameras stood and from what hides what (a depth image for
each camera). Where their places are not known, others all round take their place: what stood in
their way would have been seen from beside, and be in the cloud. A point's normal points to where
most of those are that see it; a camera that sees a surface from behind looks through an opening and
tells nothing.

Free space from lines of sight: Curless and Levoy 1996; Labatut, Pons and Keriven 2009.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, List, Optional, Tuple

import numpy as np
import numpy.typing as npt
from scipy.ndimage import minimum_filter
from scipy.spatial import ConvexHull

from ...types import FloatArray, IntArray
from .patches import Patches
from .sights import Agreement, one_is_enough
from .spacing import spacings

__all__ = ["HIGHEST", "Views", "lowest_told", "places_all_round"]

#: Side of a depth image's pixels, in spacings: points of a surface leave no pixel between them out.
#: Cameras that stood there show more. Points sparser than pixels are wide cover 2, 4 or 8 to either
#: side: twice as many so many times.
_COARSE = 1.5
_PIXEL = 1.0
_MOST_DOUBLED = 3

#: Votes of places where perhaps no camera stood count for nothing beside those of cameras.
_NO_CAMERA = 1e-6

#: What is more pixels beside the line of sight, or behind the camera, is not in an image.
_WIDEST = 600

#: Space is empty that ends so many spacings before what is seen.
_BEFORE = 2.0

#: A surface is seen, or seen from behind, where the cosine of the angle to its normal is at least
#: this: along it nothing is sure.
_FRONT = 0.05
_BEHIND = 0.2

#: Side of a square of pixels of which none is empty beside what is seen from behind.
_BESIDE = 3

#: A camera looks into the body where it sees more than this share of what it sees from behind.
_INSIDE = 0.3

#: Heights of rings of places above the horizon, degrees, and how many stand on each, besides one of
#: `_AROUND` where the lowest cameras stood.
_RINGS = ((40, 10), (70, 5))
_AROUND = 12

#: Two more are less sure: one between these rings, and one so much lower than the lowest cameras.
#: From there more is seen, past what no camera saw, and with it some that is not empty.
_BETWEEN = (30, 8)
_LOWER = 12.0

#: Where nobody knows the lowest cameras stand no higher than this, and at this first, degrees.
HIGHEST = 40.0
_USUAL = 15.0

#: They see surfaces that overhang by up to 90 degrees less their height, but hardly those that they
#: see at less than this from along them, degrees. Fewer points than this share are noise.
_GRAZING = 20.0
_NOISE = 0.003

#: Their distance, in diagonals of the box round all points.
_DISTANCE = 1.7


def places_all_round(
    points: FloatArray, below: bool, lowest: float = _USUAL
) -> Tuple[FloatArray, npt.NDArray[np.bool_]]:
    """Return places that stand for cameras.

    Parameters
    ----------
    points : (N, 3) float64, metres, upright.
    below : some places look up.
    lowest : how high above the horizon the lowest cameras stood, degrees.

    Returns
    -------
    (K, 3) places; (K,) True for those that are less sure to be where a camera may stand.
    """
    sure = [(lowest, _AROUND), *_RINGS]
    rings = [(up, count, False) for up, count in sure]
    rings += [(max(lowest - _LOWER, 0.0), _AROUND, True), (*_BETWEEN, True)]
    if below:
        rings += [(-up, count, False) for up, count in sure]
    ways, unsure = [], []
    for number, (up, count, low) in enumerate(rings):
        around = 2.0 * np.pi * (np.arange(count) + 0.5 * (number % 2)) / count
        flat, rise = np.cos(np.radians(up)), np.full(count, np.sin(np.radians(up)))
        ways.append(np.column_stack([flat * np.cos(around), flat * np.sin(around), rise]))
        unsure.append(np.full(count, low))
    low_corner, high_corner = points.min(axis=0), points.max(axis=0)
    away = _DISTANCE * float(np.linalg.norm(high_corner - low_corner))
    places = 0.5 * (low_corner + high_corner) + away * np.vstack(ways)
    return places, np.concatenate(unsure)


def lowest_told(normals: FloatArray, share: float = _NOISE) -> float:
    """Return how high above the horizon the lowest cameras stood, or higher, degrees.

    From how far surfaces overhang that were seen; below 0 where they were seen from below.

    Parameters
    ----------
    normals : (N, 3) unit vectors to the outside.
    share : of them that may overhang more.
    """
    overhang = np.degrees(np.arcsin(np.clip(-normals[:, 2], -1.0, 1.0)))
    return 90.0 - _GRAZING - float(np.quantile(overhang, 1.0 - share))


class _View:
    """The depth image of one camera.

    ``reach`` are the pixels that each point covers to either side of its own; ``shown`` are the
    points in the image. ``axes`` has its axes and the line of sight as columns; ``corner`` is the
    number of its first pixel. Up to ``empty`` metres away there is nothing in a pixel (-inf: nobody
    knows); ``beyond`` is True where it shows nothing at all.
    """

    def __init__(
        self, place: FloatArray, points: FloatArray, pixel: float, reach: IntArray
    ) -> None:
        sight = 0.5 * (points.min(axis=0) + points.max(axis=0)) - place
        away = float(np.linalg.norm(sight))
        sight = sight / away
        side = np.cross(sight, [0.0, 0.0, 1.0])
        if np.linalg.norm(side) < 1e-6:
            side = np.array([1.0, 0.0, 0.0])
        side /= np.linalg.norm(side)
        self.place, self.pixel, self.reach = place, pixel / away, reach
        self.axes = np.column_stack([side, np.cross(sight, side), sight])
        pixels, self.depth = self.project(points)
        self.shown = (np.abs(pixels) < _WIDEST).all(axis=1)
        inside = pixels[self.shown] if self.shown.any() else np.zeros((1, 2), dtype=np.int64)
        self.corner = inside.min(axis=0) - 2
        self.size = tuple((inside.max(axis=0) - self.corner + 3).tolist())
        self.pixels = np.where(self.shown[:, None], pixels - self.corner, 0)
        self.nearest = self.image(self.shown)
        self.beyond = ~np.isfinite(self.nearest)
        self.empty = np.full(self.size, -np.inf)

    def project(self, points: FloatArray) -> Tuple[IntArray, FloatArray]:
        """Return pixels (N, 2), counted from the line of sight, and distances (N,)."""
        seen = (points - self.place) @ self.axes
        front = np.maximum(seen[:, 2:], 1e-12)
        pixels = np.clip(seen[:, :2] / front / self.pixel, -_WIDEST, _WIDEST)
        depth = np.sqrt(np.einsum("ni,ni->n", seen, seen))
        return np.floor(pixels).astype(np.int64), depth

    def image(self, some: npt.NDArray[np.bool_]) -> FloatArray:
        """Return the nearest of some points that cover each pixel, inf without any."""
        nearest = np.full(self.size, np.inf)
        some = some & self.shown
        for reach in np.unique(self.reach[some]):
            own, image = some & (self.reach == reach), np.full(self.size, np.inf)
            np.minimum.at(image, tuple(self.pixels[own].T), self.depth[own])
            nearest = np.minimum(nearest, minimum_filter(image, 2 * reach + 1))
        return nearest

    def sees(self, cosine: FloatArray) -> npt.NDArray[np.bool_]:
        """(N,) True for points that nothing hides: a slant surface is deeper at one side."""
        slope = np.sqrt(np.maximum(1.0 - cosine**2, 0.0)) / np.maximum(np.abs(cosine), 0.05)
        reach = self.reach * self.pixel * self.depth * np.minimum(0.5 + 2.0 * slope, 4.0)
        return np.asarray(self.shown & (self.depth <= self.nearest[tuple(self.pixels.T)] + reach))

    def meet(self, around: FloatArray) -> None:
        """Let lines of sight tell nothing that meet the ground where there is none in the cloud.

        What hides it there is not in the cloud, either.

        Parameters
        ----------
        around : (E, 3) of the hull of all points, seen from above: nx x + ny y + d <= 0 inside.
        """
        pixel = np.argwhere(self.beyond)
        across = (pixel + self.corner + 0.5) * self.pixel
        way = np.column_stack([across, np.ones(len(across))]) @ self.axes.T
        down = (way[:, 2] < 0.0) & (self.place[2] > 0.0)
        pixel, way = pixel[down], way[down]
        foot = self.place[:2] - self.place[2] / way[:, 2:] * way[:, :2]
        hidden = np.ones(len(foot), dtype=bool)
        for edge in around:
            hidden &= foot @ edge[:2] + edge[2] <= 0.0
        self.beyond[tuple(pixel[hidden].T)] = False

    def judge(self, seen: npt.NDArray[np.bool_], cosine: FloatArray, margin: float) -> None:
        """Find up to where each pixel is empty: not beside a surface that is seen from behind.

        Through an opening the ground shows where a wall ends, as pixels are coarse.
        """
        front, behind = self.image(seen & (cosine > _FRONT)), self.image(seen & (cosine < -_BEHIND))
        told = np.isfinite(front) & (minimum_filter(behind, _BESIDE) >= front)
        self.empty = np.where(told, self.nearest - margin, -np.inf)

    def shows_empty(self, points: FloatArray) -> Tuple[npt.NDArray[Any], npt.NDArray[Any]]:
        """Return which points lie before what is seen, and which where nothing is."""
        pixels, depth = self.project(points)
        pixels = pixels - self.corner
        within = ((pixels >= 0) & (pixels < self.beyond.shape)).all(axis=1)
        before = np.zeros(len(points), dtype=bool)
        beyond = ~within & (np.abs(pixels + self.corner) < _WIDEST).all(axis=1)
        place = tuple(pixels[within].T)
        before[within] = depth[within] < self.empty[place]
        beyond[within] = self.beyond[place]
        return before, beyond


def _reach(apart: FloatArray, pixel: float) -> IntArray:
    """(N,) pixels that points so far apart cover to either side: 1, 2, 4 or 8."""
    doubled = np.round(np.log2(np.maximum(apart / pixel, 1.0)))
    return np.asarray(2 ** np.minimum(doubled, _MOST_DOUBLED).astype(np.int64))


@dataclass
class Views:
    """What cameras see of points.

    Attributes
    ----------
    patches : of the points; their normals point to the outside.
    seen : (N,) int64, how many cameras see each.
    fair : (K,) False for cameras that look into the body through an opening, and are left out.
    inside : (K,) share of what each sees of the body that it sees from behind.
    in_need : (K,) True for cameras that tell of empty space only where they agree.
    """

    patches: Patches
    seen: IntArray
    views: List[_View]
    fair: npt.NDArray[np.bool_]
    inside: FloatArray
    in_need: npt.NDArray[np.bool_]

    @property
    def normals(self) -> FloatArray:
        """(N, 3) unit vectors to the outside."""
        return self.patches.normals

    @classmethod
    def of(
        cls,
        points: FloatArray,
        spacing: float,
        places: FloatArray,
        patches: Optional[Patches] = None,
        ground: int = 0,
        known: int = 0,
    ) -> Views:
        """Return what cameras at some places see of points (N, 3), metres.

        Parameters
        ----------
        patches : of the points, where they were found before.
        ground : how many of the points, the last ones, are ground at a height of 0.
        known : at how many of the places, the first ones, a camera did stand.
        """
        patches = patches or Patches.of(points)
        counts = np.where(np.arange(len(places)) < (known or len(places)), 1.0, _NO_CAMERA)
        apart, views = spacings(points), []
        apart[len(points) - ground :] = 0.0  # no body is behind the ground, however sparse
        for k, place in enumerate(places):
            pixel = spacing * (_PIXEL if k < known else _COARSE)
            views.append(_View(place, points, pixel, _reach(apart, pixel)))
        if ground:
            around = ConvexHull(points[:, :2]).equations
            for view in views:
                view.meet(around)
        cosine = np.array(
            [((v.place - points) * patches.normals).sum(axis=1) / v.depth for v in views]
        )
        seen = np.array([view.sees(own) for view, own in zip(views, cosine)])
        fair = np.ones(len(views), dtype=bool)
        while True:
            turned = patches.to_most(counts[fair] @ (seen[fair] * cosine[fair]))
            sign = (turned.normals * patches.normals).sum(axis=1)
            own = seen[:, : len(points) - ground]
            behind = (own & (sign * cosine < 0)[:, : own.shape[1]]).sum(axis=1)
            into = fair & (behind > _INSIDE * own.sum(axis=1))
            if not into.any() or into[fair].all():
                break
            fair &= ~into
        for number in np.flatnonzero(fair):
            views[number].judge(seen[number], sign * cosine[number], _BEFORE * spacing)
        behind = (own & (sign * cosine < -_BEHIND)[:, : own.shape[1]]).sum(axis=1)
        inside = behind / np.maximum(own.sum(axis=1), 1)
        in_need = fair & (np.arange(len(views)) < known)
        front = (seen & (sign * cosine > 0.0))[in_need, : own.shape[1]]
        in_need &= not one_is_enough(front)
        return cls(turned, seen[fair].sum(axis=0), views, fair, inside, in_need)

    def empty(
        self, points: FloatArray, some: npt.NDArray[np.bool_], enough: int
    ) -> Tuple[IntArray, IntArray]:
        """Return how many cameras see through points (N, 3) to something, and to nothing.

        Parameters
        ----------
        some : (K,) True for the cameras that are asked.
        enough : no more are asked of a point that so many see through to something, unless they
            have to agree.
        """
        before, beyond = np.zeros((2, len(points)), dtype=np.int64)
        open_to, asked = np.arange(len(points)), some & self.fair
        agreement = Agreement(points) if (asked & self.in_need).any() else None
        for number in np.flatnonzero(asked):
            one, other = self.views[number].shows_empty(points[open_to])
            before[open_to] += one
            beyond[open_to] += other
            if agreement is None:
                open_to = open_to[before[open_to] < enough]
            else:
                agreement.add(self.views[number].place, one | other)
        sure = True if agreement is None else agreement.empty()
        return before * sure, beyond * sure
