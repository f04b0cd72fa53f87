"""A base surface that is given as triangles: a design, floor points, or an outline's elevations."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import shapely
from scipy import ndimage, special
from scipy.spatial import Delaunay, QhullError, cKDTree
from shapely.geometry import MultiPolygon, Polygon

from ...errors import SupportError
from ...types import INTERVAL95, FloatArray, IntArray, Window
from .grid import CellWindow, minmod, polygons_of
from .rim import dense_ring
from .robust import MAD, quantile
from .tin_surface import tin_means

__all__ = ["GivenBase", "blunders", "scatter_of", "stretched_between", "through_points"]

#: The surface goes on beyond its edge for so many cells: what an outline drawn along that edge cuts
#: in cells.
_BEYOND = 2.0

#: Share of an area that may lie beyond it, and of cells further out than that; more is refused.
_MOST_MISSING = 0.01

#: Places that lie in the midst of their neighbours, at least, for their scatter to be known.
_ENOUGH = 5

#: A plane through points has so many parameters.
_PLANE = 3

#: Points that lie off one line by less than this share of its length span no area.
_THIN = 1e-4

#: Residuals of floor points beyond this many robust standard deviations are told.
_BLUNDER = 6.0


@dataclass(frozen=True)
class GivenBase:
    """A base of triangles.

    Attributes
    ----------
    name : what results call it.
    points : (N, 3) float64, metres, in the coordinates of the area.
    triangles : (M, 3) int64, indices of points.
    std : standard deviation of each point's height, independent of the others', metres; 0 of a
        design, which is what it is.
    is_ground : whether it stands for the ground under the area, so that what the ground around
        tells is an error of it (`budget`); else it is an end in itself, as an elevation is.
    """

    name: str
    points: FloatArray
    triangles: IntArray
    std: float = 0.0
    is_ground: bool = False

    def shifted(self, x: float, y: float) -> GivenBase:
        """Return it moved in plan."""
        return replace(self, points=self.points + np.array([x, y, 0.0]))

    def near(self, window: Window) -> GivenBase:
        """Return it without the triangles that lie outside a window."""
        corner = self.points[self.triangles][:, :, :2]
        low, high = corner.min(axis=1), corner.max(axis=1)
        touched = (high >= (window.min_x, window.min_y)).all(axis=1)
        touched &= (low <= (window.max_x, window.max_y)).all(axis=1)
        kept, number = np.unique(self.triangles[touched], return_inverse=True)
        triangles: IntArray = number.reshape(-1, 3).astype(np.int64)
        return replace(self, points=self.points[kept], triangles=triangles)

    def footprint(self) -> shapely.Geometry:
        """Return the outline of all triangles."""
        edges = np.sort(self.triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2))
        each, count = np.unique(edges, axis=0, return_counts=True)
        lines = shapely.linestrings(self.points[each[count == 1]][:, :, :2])
        return shapely.build_area(shapely.geometrycollections(lines))

    def require_under(self, polygon: Polygon | MultiPolygon) -> float:
        """Return how much of an area it does not cover, m2; little of it only, as along an outline.

        Raises
        ------
        SupportError
            It is more than a hundredth of the area.
        """
        covered = shapely.make_valid(self.footprint()).intersection(polygon).area
        lost = max(0.0, float(polygon.area - covered))
        if lost > _MOST_MISSING * polygon.area:
            raise SupportError(
                f"{self.name} covers {covered / polygon.area:.1%} of the area; expected a base "
                "under all of it: draw the area within it and without its holes, or give one that "
                "reaches further"
            )
        return lost

    def over(self, window: CellWindow, covered: npt.NDArray[np.bool_]) -> FloatArray:
        """Return its mean heights over cells, (ny, nx) metres; NaN where it is not.

        Parameters
        ----------
        covered : (ny, nx) bool, the cells where it is needed.

        Raises
        ------
        SupportError
            It does not reach over these cells.
        DesignError
            See `tin_means`.
        """
        z, share = tin_means(self.points, self.triangles, window)
        z = _continued(z, share)
        missing = covered & np.isnan(z)
        lost = float(missing.sum()) / max(float(covered.sum()), 1.0)
        if lost > _MOST_MISSING:
            raise SupportError(
                f"{self.name} does not reach over {lost:.0%} of the cells of the area; expected a "
                "base under all of it: draw the area within it, or give one that reaches further"
            )
        if missing.any():
            row, column = ndimage.distance_transform_edt(
                np.isnan(z), return_distances=False, return_indices=True
            )
            z = np.where(missing, z[row, column], z)
        return z

    def errors(self, x: FloatArray, y: FloatArray, weights: FloatArray) -> FloatArray:
        """Return standard deviations (K,) of sums of heights: each place has its nearest point's.

        Parameters
        ----------
        x, y : (N,) places.
        weights : (K, N).
        """
        if not self.std:
            return np.zeros(len(weights))
        nearest = cKDTree(self.points[:, :2]).query(np.column_stack([x, y]))[1]
        each = np.stack([np.bincount(nearest, one, len(self.points)) for one in weights])
        return np.asarray(self.std * np.sqrt((each**2).sum(axis=1)))

    def below_ground(
        self, z: FloatArray, outside: npt.NDArray[np.bool_], window: CellWindow
    ) -> tuple[float, float, float]:
        """Return how far ground lies above it: the median, its robust scatter, and the area, m2.

        Parameters
        ----------
        z : (ny, nx) heights, NaN where nothing is known.
        outside : (ny, nx) bool, cells of the ground that is looked at.
        """
        mean, share = tin_means(self.points, self.triangles, window)
        off = (z - mean)[outside & (share == 1.0)]
        off = off[np.isfinite(off)]
        if not len(off):
            return 0.0, 0.0, 0.0
        middle = quantile(off, 0.5)
        scatter = MAD * quantile(np.abs(off - middle), 0.5)
        return float(middle), float(scatter), len(off) * window.cell**2


def through_points(name: str, points: FloatArray) -> GivenBase:
    """Return the Delaunay triangles of points, with their scatter as their error.

    Raises
    ------
    SupportError
        They are fewer than three, or on one line.
    """
    places, number = np.unique(points[:, :2], axis=0, return_inverse=True)
    mean = np.bincount(number.ravel(), points[:, 2] - points[0, 2]) / np.bincount(number.ravel())
    points = np.column_stack([places, mean + points[0, 2]])
    local = places - places.mean(axis=0)
    flat = SupportError(
        f"{name} holds {len(points)} points that span no area; expected three or more around the "
        "area"
    )
    size = np.linalg.svd(local, compute_uv=False)
    if len(points) < _PLANE or size[1] <= _THIN * size[0]:
        raise flat
    try:
        triangles = np.asarray(Delaunay(local).simplices, dtype=np.int64)
    except (QhullError, ValueError):
        raise flat from None
    return GivenBase(name, points, triangles, scatter_of(points, triangles))


def scatter_of(points: FloatArray, triangles: IntArray) -> float:
    """Return the RMS by which points of a TIN are off what their neighbours tell, metres.

    Each point that is in the midst of its neighbours is left out in turn, and compared with the
    plane through them (leave-one-out cross-validation). Where there are few such points, it is the
    scatter of all about one plane; of three points nothing is known. A standard deviation that few
    points tell is larger by Student's t, so that 1.96 of it hold the truth as often as of others.
    """
    off, degrees = _residuals(points, triangles)
    if degrees < 1:
        return 0.0
    wider = float(special.stdtrit(degrees, 0.975)) / INTERVAL95
    return max(1.0, wider) * float(np.sqrt((off**2).sum() / degrees))


def blunders(points: FloatArray, triangles: IntArray) -> tuple[IntArray, FloatArray]:
    """Return the points of a TIN that lie off all others far beyond their scatter, and by how much.

    As far as they are in the midst of others: the residuals of :func:`scatter_of`.
    """
    off, _ = _residuals(points, triangles)
    inner = np.setdiff1d(np.arange(len(points)), _hull(triangles))
    if len(off) != len(inner):
        return np.empty(0, dtype=np.int64), np.empty(0)
    scatter = MAD * quantile(np.abs(off), 0.5)
    # The neighbours of one are off by a share of it themselves: only the farthest is told of each.
    far = np.flatnonzero(np.abs(off) > max(_BLUNDER * scatter, 1e-9))
    return np.asarray(inner[far]), np.asarray(off[far])


def _residuals(points: FloatArray, triangles: IntArray) -> tuple[FloatArray, int]:
    """Return by how much points are off what the others tell, and degrees of freedom of these."""
    edges = np.unique(np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)), axis=0)
    one, other = np.concatenate([edges, edges[:, ::-1]]).T
    around = points[other] - points[one]
    count = len(points)

    def summed(values: FloatArray) -> FloatArray:
        return np.asarray(np.bincount(one, values, count), dtype=np.float64)

    terms = np.column_stack([np.ones(len(around)), around[:, :2]])
    normal = np.empty((count, _PLANE, _PLANE))
    right = np.empty((count, _PLANE))
    for i in range(_PLANE):
        right[:, i] = summed(terms[:, i] * around[:, 2])
        for j in range(_PLANE):
            normal[:, i, j] = summed(terms[:, i] * terms[:, j])
    inner = ~np.isin(np.arange(count), _hull(triangles))
    if inner.sum() >= _ENOUGH:
        # Inner points have three neighbours around them at least: planes are singular by rounding
        # only, which a little damping keeps away.
        size = np.trace(normal[inner], axis1=1, axis2=2)[:, None, None]
        damped = normal[inner] + 1e-12 * size * np.eye(_PLANE)
        off = -np.linalg.solve(damped, right[inner][:, :, None])[:, 0, 0]
        return off, int(inner.sum())
    local = points - points.mean(axis=0)
    plane = np.column_stack([np.ones(count), local[:, :2]])
    rest = local[:, 2] - plane @ np.linalg.lstsq(plane, local[:, 2], rcond=None)[0]
    return np.asarray(rest), count - _PLANE


def _hull(triangles: IntArray) -> IntArray:
    """Return the points on edges that only one triangle has."""
    edges = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2))
    each, count = np.unique(edges, axis=0, return_counts=True)
    return np.asarray(np.unique(each[count == 1]), dtype=np.int64)


def stretched_between(
    name: str, polygon: Polygon | MultiPolygon, corners: FloatArray, step: float
) -> GivenBase:
    """Return the triangles between the corners of an outline, whose elevations are given.

    Parameters
    ----------
    polygon : the outline; its outer rings count.
    corners : (K, 3) places with elevations. A corner of the outline without one, where an edge was
        cut to pieces, has that of the nearest two along the edge.
    step : edges are divided to this length, at which a corner goes on into the area.
    """
    rings = []
    for part in polygons_of(polygon):
        ring = dense_ring(part, step)
        rings.append(np.column_stack([ring, _along(ring, corners)]))
    points = np.concatenate(rings)
    found = through_points(name, points)
    return replace(found, std=0.0, is_ground=True)


def _along(ring: FloatArray, corners: FloatArray) -> FloatArray:
    """Return elevations of places on a ring, linear between the corners that have one."""
    following = np.roll(ring, -1, axis=0)
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*(following - ring).T))])
    distance, place = cKDTree(ring).query(corners[:, :2])
    mine = distance <= 1e-6 * along[-1]
    if not mine.any():
        raise SupportError(
            "no corner of the outline has an elevation; expected x, y and z of each: export it "
            "with its elevations, or give another base"
        )
    order = np.argsort(place[mine])
    at, z = along[place[mine]][order], corners[mine, 2][order]
    return np.asarray(np.interp(along[:-1], at, z, period=along[-1]))


def _continued(z: FloatArray, share: FloatArray) -> FloatArray:
    """Return heights that go on as planes for two cells beyond the cells that lie within."""
    within = share == 1.0
    if not within.any():
        return z
    distance, (row, column) = ndimage.distance_transform_edt(~within, return_indices=True)
    near = ~within & (distance <= _BEYOND * np.sqrt(2.0))
    inner = np.where(within, z, np.nan)
    row, column = row[near], column[near]
    found = z.copy()
    height = inner[row, column]
    for axis, off in enumerate(np.nonzero(near)):
        at = (row, column)[axis]
        before, after = _sides(inner, row, column, axis)
        height = height + minmod(before, after) * (off - at)
    found[near] = height
    return found


def _sides(
    z: FloatArray, row: IntArray, column: IntArray, axis: int
) -> tuple[FloatArray, FloatArray]:
    """Return the rise from the cell before and to the cell after.

    Where one of them is not known it is twice the other, and zero without either.
    """
    wide = np.pad(z, 1, constant_values=np.nan)
    step = (1, 0) if axis == 0 else (0, 1)
    row, column = row + 1, column + 1
    middle = wide[row, column]
    before = middle - wide[row - step[0], column - step[1]]
    after = wide[row + step[0], column + step[1]] - middle
    one = np.where(np.isfinite(before), before, np.nan_to_num(after))
    other = np.where(np.isfinite(after), after, np.nan_to_num(before))
    return one, other
