"""Terrain whose volumes are known in closed form, and surveys of it, for tests.

A terrain is a height over local x and y in 0..40 m, with an outline and the volume that it encloses
against the ground. Surveys lie at UTM-sized coordinates.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Callable, Optional, Tuple

import numpy as np
import shapely.affinity
from shapely.geometry import MultiPolygon, Polygon, box

EAST, NORTH, LEVEL = 500_000.0, 5_000_000.0, 100.0
SIDE = 40.0
MIDDLE = 20.0

Height = Callable[[np.ndarray, np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Terrain:
    """What was put on (or dug out of) what ground, and where it is measured.

    `feature` and `ground` are heights over local coordinates; `volume` is the integral of the
    feature over the outline: cut positive, fill negative.
    """

    feature: Height
    outline: Polygon
    volume: float
    ground: Height

    def height(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return self.feature(x, y) + self.ground(x, y)

    def on(self, ground: Height) -> Terrain:
        return replace(self, ground=ground)

    @property
    def area(self) -> Polygon:
        """The outline where the survey is."""
        return placed(self.outline)


def placed(geometry: Polygon | MultiPolygon) -> Polygon | MultiPolygon:
    """Move a local outline to where the surveys are."""
    return shapely.affinity.translate(geometry, EAST, NORTH)


def circle(radius: float, x: float = MIDDLE, y: float = MIDDLE, sides: int = 96) -> Polygon:
    """Return a regular polygon whose corners are on the circle."""
    angle = np.arange(sides) * 2 * np.pi / sides
    return Polygon(np.column_stack([x + radius * np.cos(angle), y + radius * np.sin(angle)]))


# --- ground


def flat(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.zeros_like(x)


def tilted(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return 0.10 * x - 0.07 * y


def undulating(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return 0.10 * np.sin(2 * np.pi * x / 17 + 0.4) * np.cos(2 * np.pi * y / 25)


# --- what stands on it


def cone(radius: float = 8.0, top: float = 4.0, x: float = MIDDLE, y: float = MIDDLE) -> Terrain:
    def feature(px: np.ndarray, py: np.ndarray) -> np.ndarray:
        return top * np.clip(1 - np.hypot(px - x, py - y) / radius, 0, None)

    return Terrain(feature, circle(radius + 1, x, y), np.pi * radius**2 * top / 3, flat)


def pit(radius: float = 8.0, depth: float = 2.0) -> Terrain:
    """A paraboloid dug into the ground."""

    def feature(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return -depth * np.clip(1 - ((x - MIDDLE) ** 2 + (y - MIDDLE) ** 2) / radius**2, 0, None)

    return Terrain(feature, circle(radius + 1), -np.pi * radius**2 * depth / 2, flat)


def gully(meander: float = 0.0, crossing: bool = False) -> Terrain:
    """A V of 6 m width and 1.5 m depth that winds by `meander`.

    It either peters out inside the outline at both ends, its depth falling as half a sine over
    30 m, or crosses the outline at both.
    """

    def feature(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        middle = MIDDLE + meander * np.sin(y / 5)
        along = 1.0 if crossing else np.sin(np.pi * np.clip(y - 5, 0, 30) / 30)
        return -1.5 * np.clip(1 - np.abs(x - middle) / 3, 0, None) * along

    room = 4 + meander
    length = 34.0 if crossing else 60 / np.pi
    outline = box(MIDDLE - room, 3, MIDDLE + room, 37)
    return Terrain(feature, outline, -1.5 * 3 * length, flat)


def walled_box() -> Terrain:
    def feature(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return 3.0 * ((x > 14) & (x < 26) & (y > 15) & (y < 25))

    return Terrain(feature, box(13, 14, 27, 26), 360.0, flat)


PILES = ((16.0, 16.0, 3.0), (24.0, 16.0, 2.5), (16.0, 24.0, 2.0), (24.0, 24.0, 3.0))


def four_piles() -> Terrain:
    """Cones of 5 m radius, 8 m apart, so that each runs into two neighbours."""

    def feature(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        each = [top * np.clip(1 - np.hypot(x - px, y - py) / 5, 0, None) for px, py, top in PILES]
        return np.maximum.reduce(each)

    # Coarse, as it is done wherever this is read: off by less than a millionth.
    outline = box(10, 10, 30, 30)
    return Terrain(feature, outline, integral(feature, outline, 0.05), flat)


def integral(height: Height, outline: Polygon | MultiPolygon, step: float = 0.01) -> float:
    """Integrate a height over a local outline by the midpoint rule."""
    left, bottom, right, top = outline.bounds
    nx, ny = round((right - left) / step), round((top - bottom) / step)
    x = left + (np.arange(nx) + 0.5) * (right - left) / nx
    y = bottom + (np.arange(ny) + 0.5) * (top - bottom) / ny
    x, y = (grid.ravel() for grid in np.meshgrid(x, y))
    if outline.area < (right - left) * (top - bottom) * (1 - 1e-9):
        shapely.prepare(outline)
        inside = shapely.contains_xy(outline, x, y)
        x, y = x[inside], y[inside]
    return float(height(x, y).mean()) * outline.area


# --- surveys


@dataclass(frozen=True)
class Errors:
    """Of a survey: `noise` metres of white noise, and a share of points `stray` metres off.

    Strays on both sides are half above, half below.
    """

    noise: float = 0.02
    outliers: float = 0.01
    stray: Tuple[float, ...] = (5.0,)


USUAL, CLEAN = Errors(), Errors(0.0, 0.0)


def survey(
    height: Height,
    errors: Errors = USUAL,
    count: int = 200_000,
    seed: int = 0,
    keep: Optional[Callable[[np.ndarray, np.ndarray], np.ndarray]] = None,
) -> np.ndarray:
    """Return random points of a terrain, (N, 3), at UTM coordinates; `keep` picks local places."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(0, SIDE, (2, count))
    z = height(x, y) + errors.noise * rng.standard_normal(count)
    off = rng.random(count) < errors.outliers
    z[off] += rng.choice(errors.stray, np.count_nonzero(off))
    points = np.column_stack([x + EAST, y + NORTH, z + LEVEL])
    return points if keep is None else points[keep(x, y)]
