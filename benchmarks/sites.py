"""Piles, pits and gullies of known volume, and outlines around them.

Heights are metres over flat ground, places metres from somewhere near the middle of the outline.
A *gauge* of a shape is 0 in its middle, 1 on its boundary, and grows in proportion along each ray.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Protocol, Sequence, Union

import numpy as np
from grounds import Height
from shapely.geometry import MultiPolygon, Polygon
from shapely.geometry.polygon import orient

from quantify_client.types import FloatArray

Outline = Union[Polygon, MultiPolygon]

#: Corners of a star-shaped outline.
_CORNERS = 72


def integral(height: Height, outline: Outline, lines: int = 1000) -> float:
    """Return the integral of a height over an outline, m3.

    The midpoint rule over lines along x, and on each the trapezoidal rule between its exact
    crossings with the outline (Green's theorem: right boundaries count up, left ones down). The
    error falls with the square of the number of lines; at 1000 it is about 1e-5 of the volume
    (tests/test_coverage_benchmark.py).
    """
    left, bottom, right, top = outline.bounds
    dx, dy = (right - left) / lines, (top - bottom) / lines
    x, y = left + np.arange(lines + 1) * dx, bottom + (np.arange(lines) + 0.5) * dy
    z = height(*np.meshgrid(x, y))
    total = np.zeros_like(z)
    np.cumsum((z[:, 1:] + z[:, :-1]) * (dx / 2), axis=1, out=total[:, 1:])
    (x1, y1), (x2, y2) = _edges(outline)
    row, edge = np.nonzero((y1 <= y[:, None]) != (y2 <= y[:, None]))
    x1, y1, x2, y2 = x1[edge], y1[edge], x2[edge], y2[edge]
    crossing = (x1 + (y[row] - y1) / (y2 - y1) * (x2 - x1) - left) / dx
    node = np.clip(crossing.astype(int), 0, lines - 1)
    t, here, ahead = crossing - node, z[row, node], z[row, node + 1]
    until = total[row, node] + dx * t * (here + t / 2 * (ahead - here))
    return float((np.sign(y2 - y1) * until).sum() * dy)


def _edges(outline: Outline) -> tuple[FloatArray, FloatArray]:
    """Return the edges' starts and ends, (2, E) each, with the area on their left."""
    rings = []
    for part in parts_of(outline):
        turned = orient(part)
        rings += [np.array(ring.coords) for ring in (turned.exterior, *turned.interiors)]
    starts = np.concatenate([ring[:-1] for ring in rings])
    return starts.T, np.concatenate([ring[1:] for ring in rings]).T


def parts_of(outline: Outline) -> Sequence[Polygon]:
    """Return the polygons of an outline."""
    return outline.geoms if isinstance(outline, MultiPolygon) else [outline]


# --- footprints


class Footprint(Protocol):
    """A shape with a gauge."""

    @property
    def polygon(self) -> Polygon:
        """The shape, metres."""

    def gauge(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the gauge at places of any shape."""


@dataclass(frozen=True)
class Star:
    """A polygon whose corners lie at even angles around its middle.

    Attributes
    ----------
    x, y : of the middle, metres.
    radii : (n,) float64, of the corners, metres; the first lies east.
    """

    x: float
    y: float
    radii: FloatArray

    @property
    def polygon(self) -> Polygon:
        """The shape, metres."""
        angle = 2 * np.pi * np.arange(len(self.radii)) / len(self.radii)
        east, north = self.radii * np.cos(angle), self.radii * np.sin(angle)
        return Polygon(np.column_stack([self.x + east, self.y + north]))

    def gauge(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the distance from the middle over that of the polygon's side there."""
        step = 2 * np.pi / len(self.radii)
        angle = np.arctan2(y - self.y, x - self.x) % (2 * np.pi)
        first = np.minimum((angle / step).astype(int), len(self.radii) - 1)
        after = (first + 1) % len(self.radii)
        share = np.sin((first + 1) * step - angle) / self.radii[first]
        share = share + np.sin(angle - first * step) / self.radii[after]
        return np.asarray(np.hypot(x - self.x, y - self.y) * share / np.sin(step))


@dataclass(frozen=True)
class Rectangle:
    """A turned rectangle: its middle, half of its sides (metres), and the angle of the first."""

    x: float
    y: float
    halves: tuple[float, float]
    angle: float = 0.0

    @property
    def polygon(self) -> Polygon:
        """The shape, metres."""
        corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * self.halves
        c, s = math.cos(self.angle), math.sin(self.angle)
        return Polygon(corners @ np.array([[c, s], [-s, c]]) + [self.x, self.y])

    def gauge(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the larger of the distances from the middle lines, in halves of the sides."""
        c, s = math.cos(self.angle), math.sin(self.angle)
        u, v = c * (x - self.x) + s * (y - self.y), c * (y - self.y) - s * (x - self.x)
        return np.maximum(np.abs(u) / self.halves[0], np.abs(v) / self.halves[1])


def star(rng: np.random.Generator, radius: float, x: float = 0.0, y: float = 0.0) -> Star:
    """Return a smooth random outline whose radii are `radius` on average."""
    angle = 2 * np.pi * np.arange(_CORNERS) / _CORNERS
    waves = np.arange(2, 7)
    size = rng.normal(0, 0.18 / waves)
    bumps = np.sin(angle[:, None] * waves + rng.uniform(0, 2 * np.pi, len(waves))) @ size
    return Star(x, y, radius * np.exp(bumps))


# --- forms


@dataclass(frozen=True)
class Profile:
    """How a form falls from its top (gauge 0) to its foot (gauge 1).

    `flat` is the gauge up to which it is level; `round` 0 for straight sides, 1 for a paraboloid.
    """

    flat: float = 0.0
    round: float = 0.0

    def __call__(self, gauge: FloatArray) -> FloatArray:
        """Return the height of a form of height 1."""
        s = np.clip((gauge - self.flat) / (1 - self.flat), 0, 1)
        return np.asarray(1 - (1 - self.round) * s - self.round * s**2)

    @property
    def fullness(self) -> float:
        """Return the volume over that of the prism: the integral of 2 g height(g) dg.

        With g = f + (1 - f) s, f the flat share: 1 - (1-f)(f + 2 (1-f) / 3) for straight sides, and
        s**2 loses (1-f)(2 f / 3 + (1-f) / 2).
        """
        f, rest = self.flat, 1 - self.flat
        straight, curved = rest * (f + 2 * rest / 3), rest * (2 * f / 3 + rest / 2)
        return 1 - (1 - self.round) * straight - self.round * curved


CONE = Profile()


@dataclass(frozen=True)
class Pile:
    """A form over a footprint that is a share of another shape; pits have a negative height.

    Attributes
    ----------
    shape : whose gauge it has.
    fill : size of the footprint relative to the shape.
    height : metres.
    profile : of its sides.
    """

    shape: Footprint
    fill: float
    height: float
    profile: Profile = CONE

    def __call__(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return its height at places of any shape, 0 beyond its foot."""
        return self.height * self.profile(self.shape.gauge(x, y) / self.fill)

    @property
    def volume(self) -> float:
        """Return its volume, m3."""
        area = self.shape.polygon.area * self.fill**2
        return float(self.height * area * self.profile.fullness)


@dataclass(frozen=True)
class Gully:
    """A channel along y that winds: x = meander sin(2 pi y / period + phase), turned by an angle.

    Attributes
    ----------
    width, depth : metres.
    meander, period, phase : of its middle line, metres and radians.
    angle : by which all of it is turned.
    length : from end to end, between which its depth is half a sine; infinite without ends.
    profile : of its sides.
    """

    width: float
    depth: float
    meander: float
    period: float
    phase: float
    angle: float = 0.0
    length: float = math.inf
    profile: Profile = CONE

    def __call__(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return its height (negative) at places of any shape."""
        c, s = math.cos(self.angle), math.sin(self.angle)
        u, v = c * x + s * y, c * y - s * x
        off = u - self.meander * np.sin(2 * np.pi * v / self.period + self.phase)
        depth = self.depth * self.profile(np.abs(off) / (self.width / 2))
        if math.isfinite(self.length):
            depth = depth * np.cos(np.pi * np.clip(v / self.length, -0.5, 0.5))
        return np.asarray(-depth)

    def corridor(self, room: float, half_length: float) -> Polygon:
        """Return the outline that follows it at a distance (in x) from both of its edges."""
        v = np.linspace(-half_length, half_length, 40)
        middle = self.meander * np.sin(2 * np.pi * v / self.period + self.phase)
        half = self.width / 2 + room
        sides = [np.column_stack([middle - half, v]), np.column_stack([middle + half, v])[::-1]]
        ring = np.concatenate(sides)
        c, s = math.cos(self.angle), math.sin(self.angle)
        return Polygon(ring @ np.array([[c, s], [-s, c]]))


@dataclass(frozen=True)
class Joined:
    """The highest of several piles and the deepest of several pits at each place."""

    forms: tuple[Height, ...] = ()

    def __call__(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the height at places of any shape."""
        high = low = np.zeros(np.shape(x))
        for form in self.forms:
            z = form(x, y)
            high, low = np.maximum(high, z), np.minimum(low, z)
        return np.asarray(high + low)


@dataclass(frozen=True)
class Site:
    """What is to be measured.

    Attributes
    ----------
    outline : around it, metres.
    form : its height over the ground, and that of what stands beside the outline.
    truth : integral of the form over the outline, m3.
    """

    outline: Outline
    form: Joined
    truth: float

    def beside(self, others: Sequence[Height]) -> Site:
        """Return the site with other forms outside of its outline."""
        return replace(self, form=Joined((*self.form.forms, *others)))
