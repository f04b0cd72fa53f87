"""Piles whose outlines are drawn badly, or well, and what stands beside them; all at random.

A *scene* is around the origin, metres, heights over a plane with relief (`grounds`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Callable, Optional

import numpy as np
import shapely
from grounds import Height, gaussian_field, matern
from scipy.special import ndtr
from shapely import affinity
from shapely.geometry import Polygon, box
from shapely.ops import substring, unary_union
from sites import Gully, Joined, Outline, Pile, Profile, Star, integral, star
from surveys import Range, Rng, log_uniform

from quantify_client.types import FloatArray

#: Of piles: metres, and degrees at their foot.
_TOPS, _FLANKS = (1.0, 8.0), (20.0, 38.0)

#: From the foot of a pile to an outline that is drawn well, metres.
_ROOM = (0.3, 1.5)

#: Half of the side of a square that holds every scene, metres.
_FAR = 1000.0

#: Lines of `sites.integral`: 4e-5 of the volume.
_LINES = 500


@dataclass(frozen=True)
class Heap:
    """One pile, or several joined ones, `top` metres high, over one foot that holds the origin."""

    form: Height
    foot: Polygon
    top: float

    def moved(self, x: float, y: float) -> Heap:
        """Return the same at another place."""
        form = self.form
        return Heap(lambda e, n: form(e - x, n - y), affinity.translate(self.foot, x, y), self.top)


@dataclass(frozen=True)
class Scene:
    """What is to be measured, and what else is there.

    Attributes
    ----------
    outline : that was drawn.
    pile : height over the ground of what is to be measured, and of nothing else.
    foot : outline of all that is to be measured.
    surface : height of all that points are seen on, with what is irregular in it.
    upper : the upper one of two surfaces, where there are two.
    beside : outline of other piles, which the cloud holds, too.
    """

    outline: Polygon
    pile: Height
    foot: Polygon
    surface: Height
    upper: Optional[Height] = None
    beside: Outline = field(default_factory=Polygon)

    def truth(self, kind: str) -> float:
        """Return a volume over the true ground, m3; accurate to about 1e-4.

        Parameters
        ----------
        kind : "pile": all of the pile; "outline": what of it lies within the outline that was
            drawn; "upper": what is below the upper surface within the outline.
        """
        height = self.upper if kind == "upper" and self.upper else self.pile
        return integral(height, self.foot if kind == "pile" else self.outline, _LINES)


#: Returns a scene around a pile, or None where that pile is too small for it, or too odd.
Maker = Callable[[Rng, Heap], Optional[Scene]]


# --- piles


def random_heap(rng: Rng, tops: Range = _TOPS) -> Heap:
    """Return a cone, an ellipse or a star (pointed, truncated, rounded), or two or three joined."""
    top, tangent = log_uniform(rng, tops), math.tan(math.radians(rng.uniform(*_FLANKS)))
    bodies = [_body(rng, top, tangent)]
    if rng.random() < 0.3:
        radius = bodies[0].shape.polygon.exterior.distance(shapely.Point(0, 0))
        for _ in range(rng.integers(1, 3)):
            angle, away = rng.uniform(0, 2 * math.pi), rng.uniform(0.4, 0.9) * radius
            x, y = away * math.cos(angle), away * math.sin(angle)
            bodies.append(_body(rng, top * rng.uniform(0.5, 1), tangent, x, y))
    foot = unary_union([body.shape.polygon for body in bodies])
    form = bodies[0] if len(bodies) == 1 else Joined(tuple(bodies))
    return Heap(form, Polygon(foot.exterior), top)


def _body(rng: Rng, top: float, tangent: float, x: float = 0.0, y: float = 0.0) -> Pile:
    """Return a pile whose flank has that tangent at its foot, where its radius is the mean one."""
    profile = Profile(float(rng.choice([0.0, 0.0, rng.uniform(0.1, 0.4)])), rng.uniform(0, 0.4))
    radius = top * (1 + profile.round) / (tangent * (1 - profile.flat))
    shape = star(rng, radius, x, y)
    if rng.random() < 0.5:
        axes = math.sqrt(rng.choice([1.0, rng.uniform(1, 2)]))
        angle = 2 * np.pi * np.arange(len(shape.radii)) / len(shape.radii) - rng.uniform(0, np.pi)
        shape = Star(x, y, radius / np.hypot(np.cos(angle) / axes, np.sin(angle) * axes))
    return Pile(shape, 1.0, top, profile)


def _drawn(rng: Rng, foot: Polygon, room: Range = _ROOM) -> Polygon:
    """Return an outline that goes around a foot at some distance, with few corners."""
    return Polygon(foot.buffer(rng.uniform(*room), quad_segs=3).exterior)


def _along(x: FloatArray, y: FloatArray, angle: float) -> FloatArray:
    """Return how far places lie from the origin along a direction."""
    return np.asarray(x * math.cos(angle) + y * math.sin(angle))


def _half_plane(angle: float, least: float) -> Polygon:
    """Return where places lie `least` or more along a direction."""
    half = box(least, -_FAR, least + 2 * _FAR, _FAR)
    return affinity.rotate(half, angle, origin=(0, 0), use_radians=True)


def _extent(foot: Polygon, angle: float) -> Range:
    """Return how far a foot reaches along a direction, from the origin."""
    x, y = np.array(foot.exterior.coords).T
    along = _along(x, y, angle)
    return float(along.min()), float(along.max())


# --- scenes


def clean(rng: Rng, heap: Heap) -> Scene:
    """Return a pile with a good outline and nothing beside it."""
    return Scene(_drawn(rng, heap.foot), heap.form, heap.foot, heap.form)


def inside(distance: float) -> Maker:
    """Return the maker of outlines at a distance within the foot, at most halfway inwards."""

    def make(rng: Rng, heap: Heap) -> Optional[Scene]:
        outline = heap.foot.buffer(-distance)
        narrow = heap.foot.buffer(-2 * distance).is_empty or not isinstance(outline, Polygon)
        return None if narrow else Scene(outline, heap.form, heap.foot, heap.form)

    return make


@dataclass(frozen=True)
class Walls:
    """Upright walls around a place that is open on one side.

    Attributes
    ----------
    angles : in which directions the place lies from each wall, radians.
    offsets : of their faces from the origin, metres.
    top, thickness, behind : height and thickness of the walls, and height of the ground behind.
    end : up to where they go in the direction of the first angle.
    """

    angles: tuple[float, ...]
    offsets: tuple[float, ...]
    top: float = 0.0
    thickness: float = 0.0
    behind: float = 0.0
    end: float = math.inf

    def before(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the distance from the nearest wall; below zero it is in the wall or behind it."""
        faces = zip(self.angles, self.offsets)
        return np.asarray(np.min([_along(x, y, a) + offset for a, offset in faces], axis=0))

    def within(self, distance: float) -> Polygon:
        """Return the place at that distance from the walls and more."""
        halves = [_half_plane(a, distance - offset) for a, offset in zip(self.angles, self.offsets)]
        return shapely.intersection_all(halves)

    def around(self, form: Height) -> Height:
        """Return the height of walls with a pile before them."""

        def height(x: FloatArray, y: FloatArray) -> FloatArray:
            before = self.before(x, y)
            wall = np.where(before > -self.thickness, self.top, self.behind)
            past = _along(x, y, self.angles[0]) > self.end
            return np.where(past, 0.0, np.where(before > 0, form(x, y), wall))

        return height


def _against(rng: Rng, heap: Heap, walls: int, retaining: bool) -> Optional[Scene]:
    """Return a pile that is cut by walls, with an outline 0.1 to 0.5 m off them."""
    first = rng.uniform(0, 2 * math.pi)
    angles = tuple(first + turn for turn in (0.0, np.pi / 2, -np.pi / 2)[:walls])
    offsets = tuple(-rng.uniform(0.3, 0.8) * _extent(heap.foot, angle)[0] for angle in angles)
    place = Walls(angles, offsets)
    outline = _drawn(rng, heap.foot).intersection(place.within(rng.uniform(0.1, 0.5)))
    foot = heap.foot.intersection(place.within(0.0))
    if not isinstance(outline, Polygon) or not isinstance(foot, Polygon):
        return None
    # A pile does not lean on a wall that is lower than itself.
    contact = heap.form(*shapely.get_coordinates(foot.exterior.segmentize(0.1)).T)
    top = float(contact.max()) + rng.uniform(0.2, 1.5)
    end = _extent(outline, first)[1] + rng.uniform(0.0, 2.0)
    behind = top if retaining else -rng.uniform(0, 1.5) * (walls == 1)
    built = replace(place, top=top, thickness=rng.uniform(0.2, 0.8), behind=behind, end=end)
    return Scene(outline, heap.form, foot, built.around(heap.form))


def wall(rng: Rng, heap: Heap) -> Optional[Scene]:
    """Return a pile against a wall; behind it the ground is lower, or as high as the wall."""
    return _against(rng, heap, 1, rng.random() < 0.5)


def bay(rng: Rng, heap: Heap) -> Optional[Scene]:
    """Return a pile in the corner of two walls, or between three."""
    return _against(rng, heap, int(rng.integers(2, 4)), False)


def neighbour(rng: Rng, heap: Heap) -> Optional[Scene]:
    """Return a pile whose outline, 1.2 to 2.5 m off its foot, crosses another pile by 1 m."""
    outline, angle = _drawn(rng, heap.foot, (1.3, 2.5)), rng.uniform(0, 2 * math.pi)
    other = _beside(rng, heap, outline.buffer(-1.0), angle)
    if other is None or other.foot.intersects(heap.foot):
        return None
    both = Joined((heap.form, other.form))
    return Scene(outline, heap.form, heap.foot, both, beside=other.foot)


def neighbour_deep(rng: Rng, heap: Heap) -> Optional[Scene]:
    """Return a pile whose outline holds another pile, too, up to a third of its width."""
    angle = rng.uniform(0, 2 * math.pi)
    other = _beside(rng, heap, heap.foot.buffer(rng.uniform(0.2, 1.0)), angle)
    if other is None:
        return None
    near, far = _extent(other.foot, angle)
    near_third = _drawn(rng, other.foot).difference(_half_plane(angle, near + (far - near) / 3))
    outline = _drawn(rng, heap.foot).union(near_third).convex_hull
    both = Joined((heap.form, other.form))
    return Scene(outline, heap.form, heap.foot, both, beside=other.foot)


def _beside(rng: Rng, heap: Heap, place: Polygon, angle: float) -> Optional[Heap]:
    """Return another pile that just touches a place, in a direction.

    It is half as high to 1.2 times as high as the first, and 3 m wide or more.
    """
    other = random_heap(rng, (0.5 * heap.top, 1.2 * heap.top))
    if other.foot.buffer(-1.5).is_empty:
        return None
    east, north = math.cos(angle), math.sin(angle)
    near, far = 0.0, _FAR
    while far - near > 0.001:
        middle = (near + far) / 2
        meets = affinity.translate(other.foot, middle * east, middle * north).intersects(place)
        near, far = (middle, far) if meets else (near, middle)
    return other.moved(far * east, far * north)


def bushes(rng: Rng, heap: Heap) -> Scene:
    """Return a pile with bushes, 0.2 to 0.8 m high, along a third of its outline."""
    outline = _drawn(rng, heap.foot, (0.5, 1.5))
    start = rng.uniform(0, 2 / 3)
    third = substring(outline.exterior, start, start + 1 / 3, normalized=True)
    band = third.buffer(rng.uniform(0.4, 1.0)).difference(heap.foot)
    width = 2 * float(np.abs(band.bounds).max())
    clumps = gaussian_field(rng, matern(1.5), width, rng.uniform(1, 3))

    def plants(x: FloatArray, y: FloatArray) -> FloatArray:
        # Between clumps, and for one point in five within them, the ground is seen.
        share = np.clip(2 * ndtr(clumps(x, y)) - 0.6, 0, None) / 1.4
        seen = shapely.contains_xy(band, x, y) & (share > 0) & (rng.random(x.shape) < 0.8)
        return np.where(seen, (0.2 + 0.6 * share) * rng.uniform(0.5, 1, x.shape), 0.0)

    return Scene(outline, heap.form, heap.foot, lambda x, y: heap.form(x, y) + plants(x, y))


def grass(on_ground: bool, on_pile: bool) -> Maker:
    """Return the maker of piles where 20 % of the points are on grass, 0.1 to 0.3 m up."""

    def make(rng: Rng, heap: Heap) -> Scene:
        def surface(x: FloatArray, y: FloatArray) -> FloatArray:
            z = heap.form(x, y)
            grown = (rng.random(x.shape) < 0.2) & np.where(z > 0, on_pile, on_ground)
            return z + np.where(grown, rng.uniform(0.1, 0.3, x.shape), 0.0)

        return Scene(_drawn(rng, heap.foot), heap.form, heap.foot, surface)

    return make


def strip(sign: float) -> Maker:
    """Return the maker of a channel (-1) or a dam (1) 10 m wide that goes on beyond the outline.

    The outline is 20 m long, straight or along the winding edges, 0.5 to 2 m off them.
    """

    def make(rng: Rng, heap: Heap) -> Scene:
        profile = Profile(float(rng.choice([0.0, 0.3])), rng.uniform(0, 0.4))
        steep = math.tan(math.radians(rng.uniform(10, 30)))
        depth = 5.0 * (1 - profile.flat) / (1 + profile.round) * steep
        meander, period, phase = rng.uniform(0, 1), rng.uniform(20, 60), rng.uniform(0, 2 * math.pi)
        angle, room = rng.uniform(0, math.pi), rng.uniform(0.5, 2.0)
        gully = Gully(10.0, -sign * depth, meander, period, phase, angle, profile=profile)
        straight = replace(gully, meander=0.0).corridor(room + meander, 10.0)
        outline = straight if rng.random() < 0.5 else gully.corridor(room, 10.0)
        return Scene(outline, gully, outline, gully)

    return make


def terrace(rng: Rng, heap: Heap) -> Scene:
    """Return a pile over a step of 2 m off its middle."""
    angle, run = rng.uniform(0, 2 * math.pi), rng.uniform(0.01, 0.3)
    off = rng.uniform(0.1, 0.5) * _extent(heap.foot, angle)[1]

    def surface(x: FloatArray, y: FloatArray) -> FloatArray:
        return heap.form(x, y) + 2.0 * np.clip((_along(x, y, angle) - off) / run + 0.5, 0, 1)

    return Scene(_drawn(rng, heap.foot), heap.form, heap.foot, surface)


def touching(rng: Rng, heap: Heap) -> Optional[Scene]:
    """Return one of four piles that run into each other, with an outline through the saddles."""
    if not isinstance(heap.form, Pile):
        return None
    own, radius = heap.form, math.sqrt(heap.foot.area / math.pi)
    # In a square or in a row; the feet overlap by a tenth to a third of the radii or so.
    middles = [[1, 0], [1, 1], [0, 1]] if rng.random() < 0.5 else [[-1, 0], [1, 0], [2, 0]]
    others = []
    for x, y in np.array(middles) * 2 * radius * rng.uniform(0.7, 0.9, (3, 1)):
        foot = star(rng, radius * rng.uniform(0.9, 1.1), x, y)
        others.append(replace(own, shape=foot, height=own.height * rng.uniform(0.8, 1.1)))
    outline = _through_saddles(own, Joined(tuple(others)), rng.uniform(*_ROOM))
    beside = unary_union([other.shape.polygon for other in others])
    return Scene(outline, own, outline, Joined((own, *others)), beside=beside)


def _through_saddles(own: Pile, others: Height, room: float) -> Polygon:
    """Return the outline to where others are higher, or to some room beyond the foot."""
    angle = np.linspace(0, 2 * np.pi, 240, endpoint=False)[:, None]
    r = np.arange(0.0, own.shape.polygon.hausdorff_distance(shapely.Point(0, 0)) + room, 0.02)
    x, y = r * np.cos(angle), r * np.sin(angle)
    z = own(x, y)
    ended = (others(x, y) > z) | (r > r[np.argmax(z <= 0, axis=1)][:, None] + room)
    last = np.where(ended.any(axis=1), ended.argmax(axis=1), len(r) - 1)[:, None]
    return Polygon(np.hstack([np.take_along_axis(v, last, axis=1) for v in (x, y)]))


@dataclass(frozen=True)
class Tree:
    """A crown: its middle and radius, where it begins above the ground, and how thick it is."""

    x: float
    y: float
    radius: float
    start: float
    thickness: float

    def __call__(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the height of its upper half ellipsoid, 0 beside it."""
        away = np.hypot(x - self.x, y - self.y) / self.radius
        crown = self.start + self.thickness * np.sqrt(np.clip(1 - away**2, 0, 1))
        return np.where(away < 1, crown, 0.0)


def crowns(rng: Rng, heap: Heap) -> Optional[Scene]:
    """Return a pile under tree crowns: a tenth to a third of its outline, all within it.

    Of the points there, 30 to 70 % are on the crowns, and the others on the pile and the ground.
    """
    outline, shown = _drawn(rng, heap.foot), rng.uniform(0.3, 0.7)
    trees, feet, share = [], Polygon(), rng.uniform(0.1, 1 / 3)
    while feet.area < share * outline.area:
        radius = rng.uniform(1.0, 2.5)
        room = outline.buffer(-radius)
        if room.is_empty or radius**2 * math.pi > outline.area / 4:
            return None
        x, y = (rng.uniform(low, high) for low, high in zip(room.bounds[:2], room.bounds[2:]))
        if room.contains(shapely.Point(x, y)):
            start = float(heap.form(x, y)) + rng.uniform(2, 5)
            trees.append(Tree(x, y, radius, start, radius * rng.uniform(0.5, 1)))
            feet = feet.union(shapely.Point(x, y).buffer(radius))
    upper = Joined((heap.form, *trees))

    def surface(x: FloatArray, y: FloatArray) -> FloatArray:
        return np.where(rng.random(x.shape) < shown, upper(x, y), heap.form(x, y))

    return Scene(outline, heap.form, heap.foot, surface, upper)
