"""Closed bodies whose volumes are known, and how to draw random points on their surfaces.

`BODIES` are the shapes that methods are compared on; `random_body` joins boxes, balls and cylinders
at random. Each body is about one metre wide. scans.py scans them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Callable, Dict, Optional, Sequence, Tuple

import numpy as np
from scipy.ndimage import label
from scipy.spatial.transform import Rotation

BUNNY = Path(__file__).resolve().parents[2] / "shared/data/meshes/stanford-bunny.obj"
NO_BUNNY = f"the Stanford bunny is not there: {BUNNY} (it lies outside the repository)"

_TOUCH = 1e-9
"""Points this near another part are inside it: faces on which two parts touch are no surface."""

Surface = Callable[[int, np.random.Generator], np.ndarray]


@dataclass(frozen=True)
class Body:
    """A body, its volumes, and how to draw random points on its surface.

    `surface` draws (count, 3) points, evenly, in random order; `area` is that of the whole surface;
    `hollow` is the volume where voids that hold water, or are enclosed, are none of it; `parts` are
    those of a union.
    """

    name: str
    volume: float
    area: float
    surface: Surface
    hollow: Optional[float] = None
    volume_std: float = 0.0
    parts: Sequence[Part] = field(default=(), compare=False)
    corners: Optional[np.ndarray] = field(default=None, compare=False)
    faces: Optional[np.ndarray] = field(default=None, compare=False)

    def turned(self, name: str, rotation: Rotation) -> Body:
        """Return the same body, rotated."""
        turn = rotation.as_matrix().T
        return replace(
            self, name=name, surface=lambda n, rng: self.surface(n, rng) @ turn, parts=()
        )


def draw_until(count: int, draw: Callable[[int], np.ndarray]) -> np.ndarray:
    """Draw until there are `count` points; `draw` is asked for n and returns some of n."""
    found, asked, have = [], 0, 0
    while have < count:
        ask = 16 + math.ceil(1.05 * (count - have) * max(asked, 1) / max(have, 1))
        found.append(draw(min(ask, 4 * count + 16)))
        asked, have = asked + ask, have + len(found[-1])
    return np.concatenate(found)[:count]


def mixed(surfaces: Sequence[Surface], areas: Sequence[float]) -> Surface:
    """Return the surface that these make together; their points come in random order."""
    shares = np.asarray(areas, dtype=float) / np.sum(areas)

    def draw(count: int, rng: np.random.Generator) -> np.ndarray:
        each = rng.multinomial(count, shares)
        points = np.concatenate([one(n, rng) for one, n in zip(surfaces, each)])
        return points[rng.permutation(count)]

    return draw


# --- parts: boxes, balls and cylinders, turned any way


@dataclass(frozen=True)
class Part:
    """A `box`, `ball` or `cylinder` with its half extents, its rotation and its middle."""

    kind: str
    half: np.ndarray
    turn: np.ndarray
    middle: np.ndarray

    @property
    def volume(self) -> float:
        share = {"box": 8.0, "ball": 4 / 3 * np.pi, "cylinder": 2 * np.pi}
        return float(share[self.kind] * np.prod(self.half))

    @property
    def face_areas(self) -> np.ndarray:
        """Each pair of faces of a box; a ball's surface; a cylinder's side and both its ends."""
        a, b, c = self.half
        if self.kind == "ball":
            return np.array([4 * np.pi * a**2])
        if self.kind == "cylinder":
            return np.array([4 * np.pi * a * c, 2 * np.pi * a**2])
        return 8 * np.array([b * c, a * c, a * b])

    @property
    def reach(self) -> np.ndarray:
        """Half extents of an axis-aligned box that holds it."""
        return self.half if self.kind == "ball" else np.abs(self.turn) @ self.half

    def placed(self, local: np.ndarray) -> np.ndarray:
        return np.asarray(local @ self.turn.T + self.middle)

    def surface(self, count: int, rng: np.random.Generator) -> np.ndarray:
        areas = self.face_areas
        face = rng.choice(len(areas), count, p=areas / areas.sum())
        if self.kind == "ball":
            local = unit_vectors(count, rng)
        elif self.kind == "cylinder":
            angle, end = 2 * np.pi * rng.random(count), rng.choice([-1.0, 1.0], count)
            away = np.where(face == 0, 1.0, np.sqrt(rng.random(count)))
            height = np.where(face == 0, rng.uniform(-1, 1, count), end)
            local = np.column_stack([away * np.cos(angle), away * np.sin(angle), height])
        else:
            local = rng.uniform(-1, 1, (count, 3))
            local[np.arange(count), face] = rng.choice([-1.0, 1.0], count)
        return self.placed(local * self.half)

    def holds(self, points: np.ndarray, margin: float = _TOUCH) -> np.ndarray:
        """(N,) bool: the points inside, or within `margin` outside."""
        local = np.abs((points - self.middle) @ self.turn)
        if self.kind == "box":
            return np.asarray((local <= self.half + margin).all(axis=-1))
        if self.kind == "ball":
            return np.asarray((local**2).sum(axis=-1) <= (self.half[0] + margin) ** 2)
        round_about = local[..., 0] ** 2 + local[..., 1] ** 2 <= (self.half[0] + margin) ** 2
        return np.asarray(round_about & (local[..., 2] <= self.half[2] + margin))

    def inner_point(self, rng: np.random.Generator) -> np.ndarray:
        """Return a point well inside: not in the outer third."""
        local = rng.uniform(-1, 1, 3)
        if self.kind == "ball":
            local /= max(1.0, float(np.linalg.norm(local)))
        elif self.kind == "cylinder":
            local[:2] /= max(1.0, float(np.linalg.norm(local[:2])))
        return self.placed(2 / 3 * local * self.half)


def unit_vectors(count: int, rng: np.random.Generator) -> np.ndarray:
    vectors = rng.normal(size=(count, 3))
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1)[:, None])


def even_vectors(count: int) -> np.ndarray:
    """(count, 3) unit vectors on a golden spiral: as far from each other as anywhere else."""
    number = np.arange(count) + 0.5
    z, turn = 1 - 2 * number / count, math.pi * (1 + math.sqrt(5)) * number
    flat = np.sqrt(1 - z**2)
    return np.column_stack([flat * np.cos(turn), flat * np.sin(turn), z])


def box_part(low: Sequence[float], high: Sequence[float]) -> Part:
    low, high = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
    return Part("box", (high - low) / 2, np.eye(3), (low + high) / 2)


def ball_part(radius: float, middle: Sequence[float]) -> Part:
    return Part("ball", np.full(3, radius), np.eye(3), np.asarray(middle, dtype=float))


def union(name: str, parts: Sequence[Part], volume: float, volume_std: float = 0.0) -> Body:
    """Return the body that parts make together: the surface of each, outside all others."""
    areas = [float(part.face_areas.sum()) for part in parts]
    shares = np.asarray(areas) / np.sum(areas)

    def draw(count: int, rng: np.random.Generator) -> np.ndarray:
        found = []
        for i, (part, number) in enumerate(zip(parts, rng.multinomial(count, shares))):
            own = part.surface(number, rng)
            for other in (*parts[:i], *parts[i + 1 :]):
                own = own[~other.holds(own)]
            found.append(own)
        points = np.concatenate(found)
        return points[rng.permutation(len(points))]

    def surface(count: int, rng: np.random.Generator) -> np.ndarray:
        return draw_until(count, lambda n: draw(n, rng))

    tries = 200_000
    kept = len(draw(tries, np.random.default_rng(0))) / tries
    area = kept * sum(areas)
    return Body(name, volume, area, surface, volume_std=volume_std, parts=tuple(parts))


# --- the bodies


def sphere(radius: float = 0.5) -> Body:
    ball = ball_part(radius, (0, 0, 0))
    return Body("sphere", ball.volume, 4 * np.pi * radius**2, ball.surface)


def cube() -> Body:
    return Body("cube", 1.0, 6.0, box_part((0, 0, 0), (1, 1, 1)).surface)


def torus(ring: float = 0.35, tube: float = 0.15) -> Body:
    """A torus that lies."""

    def draw(count: int, rng: np.random.Generator) -> np.ndarray:
        around, across = 2 * np.pi * rng.random((2, count))
        away = ring + tube * np.cos(across)
        keep = rng.random(count) < away / (ring + tube)
        around, across, away = around[keep], across[keep], away[keep]
        x, y = away * np.cos(around), away * np.sin(around)
        return np.column_stack([x, y, tube * np.sin(across)])

    def surface(count: int, rng: np.random.Generator) -> np.ndarray:
        return draw_until(count, lambda n: draw(n, rng))

    return Body("torus", 2 * np.pi**2 * ring * tube**2, 4 * np.pi**2 * ring * tube, surface)


def prism() -> Body:
    """An L, upright."""
    parts = [box_part((0, 0, 0), (1, 0.5, 0.3)), box_part((0, 0, 0.3), (0.3, 0.5, 1))]
    return union("L-prism", parts, sum(part.volume for part in parts))


def table() -> Body:
    """A slab on four legs."""
    feet = [(x, y) for x in (0.0, 0.85) for y in (0.0, 0.45)]
    legs = [box_part((x, y, 0), (x + 0.15, y + 0.15, 0.5)) for x, y in feet]
    parts = [box_part((0, 0, 0.5), (1, 0.6, 0.8)), *legs]
    return union("four legs", parts, sum(part.volume for part in parts))


def two_spheres() -> Body:
    parts = [ball_part(0.3, (0, 0, 0)), ball_part(0.3, (0.8, 0.1, 0.2))]
    return union("two spheres", parts, sum(part.volume for part in parts))


def cup(outer: float = 0.5, inner: float = 0.4, height: float = 1.0, floor: float = 0.1) -> Body:
    """A cup that stands: solid it is a cylinder."""
    depth = height - floor

    def disc(least: float, most: float, z: float) -> Surface:
        def draw(count: int, rng: np.random.Generator) -> np.ndarray:
            away = np.sqrt(rng.uniform(least**2, most**2, count))
            return _about_z(away, np.full(count, z), rng)

        return draw

    def wall(radius: float, low: float) -> Surface:
        return lambda n, rng: _about_z(np.full(n, radius), rng.uniform(low, height, n), rng)

    surfaces = [wall(outer, 0), wall(inner, floor), disc(0, outer, 0), disc(0, inner, floor)]
    areas = [outer * height * 2, inner * depth * 2, outer**2, inner**2, outer**2 - inner**2]
    areas = [np.pi * area for area in areas]
    surface = mixed([*surfaces, disc(inner, outer, height)], areas)
    solid = np.pi * outer**2 * height
    return Body("cup", solid, sum(areas), surface, hollow=solid - np.pi * inner**2 * depth)


def _about_z(away: np.ndarray, z: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    angle = 2 * np.pi * rng.random(len(z))
    return np.column_stack([away * np.cos(angle), away * np.sin(angle), z])


def hollow_ball(outer: float = 0.5, inner: float = 0.3) -> Body:
    """A ball with a void in its middle."""
    parts = [ball_part(outer, (0, 0, 0)), ball_part(inner, (0, 0, 0))]
    areas = [4 * np.pi * radius**2 for radius in (outer, inner)]
    surface = mixed([part.surface for part in parts], areas)
    solid, void = (part.volume for part in parts)
    return Body("hollow ball", solid, sum(areas), surface, hollow=solid - void)


@lru_cache(maxsize=1)
def bunny_mesh() -> Tuple[np.ndarray, np.ndarray]:
    """(V, 3) corners and (F, 3) triangles of the Stanford bunny: z up, longest side 1."""
    lines = [line.split() for line in BUNNY.read_text(encoding="ascii").splitlines()]
    x, y, z = np.array([line[1:4] for line in lines if line[:1] == ["v"]], dtype=float).T
    corners = np.column_stack([x, -z, y])
    faces = [[field.split("/")[0] for field in line[1:4]] for line in lines if line[:1] == ["f"]]
    return corners / np.ptp(corners, axis=0).max(), np.array(faces, dtype=np.int64) - 1


def bunny() -> Body:
    """The Stanford bunny; the holes in its base count as closed flat."""
    return mesh_body("bunny", *bunny_mesh(), volume=0.20008)


def mesh_body(name: str, corners: np.ndarray, faces: np.ndarray, volume: float) -> Body:
    """Return the body whose surface (F, 3) triangles between (V, 3) corners are."""
    a, b, c = (corners[faces[:, i]] for i in range(3))
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2

    def draw(count: int, rng: np.random.Generator) -> np.ndarray:
        k = rng.choice(len(faces), count, p=areas / areas.sum())
        u, v = np.sqrt(rng.random((count, 1))), rng.random((count, 1))
        return np.asarray(a[k] * (1 - u) + b[k] * (u * (1 - v)) + c[k] * (u * v))

    return Body(name, volume, float(areas.sum()), draw, corners=corners, faces=faces)


def finer(corners: np.ndarray, faces: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
    """Return a mesh with each triangle divided into four, which stay flat."""
    sides = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    ends, side = np.unique(sides, axis=0, return_inverse=True)
    (a, b, c), (ab, bc, ca) = faces.T, len(corners) + side.reshape(-1, 3).T
    parts = ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))
    divided = np.concatenate([np.column_stack(part) for part in parts])
    return np.concatenate([corners, corners[ends].mean(axis=1)]), divided


_ASKEW = Rotation.from_rotvec([0.9, -0.5, 0.7])
"""Leaves no face of a cube near an axis."""

_UPRIGHT = Rotation.from_euler("x", 90, degrees=True)

BODIES: Dict[str, Callable[[], Body]] = {
    "cube": cube,
    "cube, rotated": lambda: cube().turned("cube, rotated", _ASKEW),
    "sphere": sphere,
    "torus, lying": lambda: replace(torus(), name="torus, lying"),
    "torus, standing": lambda: torus().turned("torus, standing", _UPRIGHT),
    "L-prism": prism,
    "four legs": table,
    "two spheres": two_spheres,
    "cup": cup,
    "hollow ball": hollow_ball,
    "bunny": bunny,
}


# --- random bodies

_CELLS = 4_200_000
_WATER_CELLS = 60_000

_MOST_WATER = 0.002
"""Share of its volume that a random body may hold of water before another one is drawn.

By the design water counts as body, which the volume of the union does not hold. Cells as large as
these show traces of it in every crease."""


@lru_cache(maxsize=128)
def random_body(seed: int, cells: int = _CELLS) -> Body:
    """Return 2 to 6 boxes, balls and cylinders that hang together; the volume has its own error."""
    rng = np.random.default_rng(seed)
    while True:
        parts = [_random_part(rng)]
        for _ in range(rng.integers(1, 6)):
            part, host = _random_part(rng), parts[rng.integers(len(parts))]
            shift = host.inner_point(rng) - part.inner_point(rng)
            parts.append(replace(part, middle=part.middle + shift))
        if water_share(parts) < _MOST_WATER:
            return union(f"random {seed}", parts, *union_volume(parts, cells))


def _random_part(rng: np.random.Generator) -> Part:
    kind = rng.choice(["box", "ball", "cylinder"])
    half = rng.uniform(0.12, 0.5, 3)
    if kind == "ball":
        half[:] = half[0]
    elif kind == "cylinder":
        half[1] = half[0]
    return Part(str(kind), half, Rotation.from_quat(rng.normal(size=4)).as_matrix(), np.zeros(3))


def union_volume(parts: Sequence[Part], cells: int = _CELLS, seed: int = 0) -> Tuple[float, float]:
    """Return the volume of a union and its standard deviation, by one random point in each cell.

    Only cells that the surface cuts are uncertain, which makes the error some 0.01 %: ten times
    smaller than that of as many points thrown anywhere.
    """
    inside, edge = _occupied(parts, cells, np.random.default_rng(seed))
    surface = sum(np.count_nonzero(np.diff(inside, axis=axis)) for axis in range(3))
    # A cut cell is right with a probability that is anything between 0 and 1: variance 1/6.
    return float(inside.sum() * edge**3), math.sqrt(surface / 6) * edge**3


def water_share(parts: Sequence[Part]) -> float:
    """Return the volume of water that a union holds, or encloses, as a share of its own.

    Water stays where no way leads out that does not rise.
    """
    inside, _ = _occupied(parts, _WATER_CELLS, None)
    void = np.pad(~inside, 1, constant_values=True)
    water = 0
    for layer in range(1, void.shape[2] - 1):
        # The layer below all is void, so number void[0, 0, 0] is that of everything that drains.
        number, _ = label(void[:, :, : layer + 1], np.ones((3, 3, 3)))
        stays = void[:, :, layer] & (number[:, :, layer] != number[0, 0, 0])
        water += np.count_nonzero(stays)
    return water / np.count_nonzero(inside)


def _occupied(
    parts: Sequence[Part], cells: int, rng: Optional[np.random.Generator]
) -> Tuple[np.ndarray, float]:
    """Return which cells hold a point of the union (a random one or, without `rng`, the middle)."""
    low = np.min([part.middle - part.reach for part in parts], axis=0)
    high = np.max([part.middle + part.reach for part in parts], axis=0)
    edge = float(np.prod(high - low) / cells) ** (1 / 3)
    shape = np.ceil((high - low) / edge).astype(int)
    place = np.full((*shape, 3), 0.5) if rng is None else rng.random((*shape, 3))
    for axis, first in enumerate(np.ix_(*map(np.arange, shape))):
        place[..., axis] += first
    place *= edge
    place += low
    inside = np.zeros(shape, dtype=bool)
    for part in parts:
        first = np.maximum(0, (part.middle - part.reach - low) // edge).astype(int)
        last = ((part.middle + part.reach - low) // edge).astype(int) + 1
        window = tuple(slice(a, b) for a, b in zip(first, last))
        inside[window] |= part.holds(place[window])
    return inside, edge
