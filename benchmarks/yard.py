"""Stockpiles found without outlines: how many of them, and how far off their volumes are.

Run it with ``python benchmarks/yard.py --seeds 5``. Two simulated yards of known volumes. The first
is the one that the method was made with: five piles, two of them touching, one against a wall, a
conveyor over one. The second, which it was not, has elliptic and ridge-shaped piles of other angles
of repose at random places, with vehicles and walls. Each with and without relief of the ground.

Printed for each pile: the error of its volume, the half width of its 95 % interval (both in percent
of the volume), and whether the truth is inside. ``--time`` measures 20 million points as well, with
``--area auto`` and with one outline drawn over the whole cloud by turns.
"""

from __future__ import annotations

import argparse
import math
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Callable, Dict, List, Mapping, Sequence, Tuple

import laspy
import numpy as np
import shapely
from grounds import RELIEFS, Height
from pyproj import CRS

from quantify_client import measure
from quantify_client.types import AreaResult, FloatArray

EAST, NORTH, LEVEL = 500_000.0, 5_000_000.0, 100.0
WIDE, HIGH = 80.0, 60.0
DENSITY = 200.0
QUADRATURE = 0.02


@dataclass(frozen=True)
class Heap:
    """A pile: its height over flat ground, and roughly where it is.

    Attributes
    ----------
    height : of places, metres, 0 beyond its foot.
    x, y : of its summit.
    reach : no part of it is further from there, metres.
    """

    height: Height
    x: float
    y: float
    reach: float


@dataclass(frozen=True)
class Yard:
    """Piles, what stands on or beside them, and the volume of each pile.

    Attributes
    ----------
    objects : each the height of its top over flat ground, -inf beside it.
    volumes : m3; of touching piles the part to which the higher one is.
    """

    heaps: Sequence[Heap]
    objects: Sequence[Height]
    volumes: Sequence[float]

    def __call__(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the height of what is seen from above, over flat ground."""
        heights = [heap.height(x, y) for heap in self.heaps]
        return np.maximum.reduce([*heights, *(thing(x, y) for thing in self.objects)])


def yard_of(heaps: Sequence[Heap], objects: Sequence[Height]) -> Yard:
    """Return a yard with the volumes of its piles: the midpoint rule in steps of 2 cm."""
    volumes = []
    for number, heap in enumerate(heaps):
        count = round(2 * heap.reach / QUADRATURE)
        step = (np.arange(count) + 0.5) * QUADRATURE - heap.reach
        x, y = np.meshgrid(heap.x + step, heap.y + step)
        own = heap.height(x, y)
        others = [other.height(x, y) for place, other in enumerate(heaps) if place != number]
        higher = np.logical_and.reduce([own > other for other in others])
        volumes.append(float(own[higher].sum() * QUADRATURE**2))
    return Yard(heaps, objects, volumes)


# --- the first yard


def cone(x: float, y: float, radius: float, height: float) -> Heap:
    """Return a cone."""

    def over(px: FloatArray, py: FloatArray) -> FloatArray:
        return np.maximum(0.0, height * (1 - np.hypot(px - x, py - y) / radius))

    return Heap(over, x, y, radius)


def box(x: float, y: float, halves: Tuple[float, float], angle: float, top: Height) -> Height:
    """Return the top of something with vertical sides; `angle` of its first half side."""
    c, s = math.cos(angle), math.sin(angle)

    def over(px: FloatArray, py: FloatArray) -> FloatArray:
        u, v = c * (px - x) + s * (py - y), c * (py - y) - s * (px - x)
        inside = (np.abs(u) < halves[0]) & (np.abs(v) < halves[1])
        return np.where(inside, top(px, py), -np.inf)

    return over


def level(height: float) -> Height:
    """Return a level top."""
    return lambda x, y: np.full(np.shape(x), height)


def first_yard(rng: np.random.Generator) -> Yard:
    """Return five piles: two touching, one against a wall, a conveyor over one; and a car."""
    wall_x, wall_y = 62.0 + rng.uniform(-1, 1), 44.0 + rng.uniform(-1, 1)
    leaning = cone(wall_x, wall_y, 5.0, 3.2)
    before_wall = Heap(
        lambda x, y: np.where(x < wall_x, leaning.height(x, y), 0.0), wall_x, wall_y, 5.0
    )
    carried = cone(58.0, 17.0, 7.0, 4.5)
    conveyor = box(64.5, 17.0, (7.5, 0.5), 0.0, lambda x, y: 1.5 + (72.0 - x) * 5.0 / 15.0)
    heaps = [
        cone(14.0 + rng.uniform(-1, 1), 44.0 + rng.uniform(-1, 1), 6.0, 4.0),
        cone(16.0, 16.0, 5.0, 3.2),
        cone(24.0, 16.0 + rng.uniform(-1, 1), 4.5, 2.88),
        before_wall,
        carried,
    ]
    wall = box(wall_x + 0.2, wall_y, (0.2, 7.0), 0.0, level(4.5))
    car = box(38.0, 44.0 + rng.uniform(-1, 1), (2.2, 0.9), rng.uniform(0, 3), level(1.5))
    return yard_of(heaps, [wall, conveyor, car])


# --- the second yard


def ridge(
    x: float, y: float, halves: Tuple[float, float], height: float, angle: float, top: float
) -> Heap:
    """Return a pile with a ridge: equal slopes at a height by the distance from a line.

    Parameters
    ----------
    halves : half of the length of the ridge line, and the distance from it to the foot, metres.
    top : share of the height that is rounded off: the slope falls to 0 there, as a parabola.
    """
    c, s = math.cos(angle), math.sin(angle)

    def over(px: FloatArray, py: FloatArray) -> FloatArray:
        u, v = c * (px - x) + s * (py - y), c * (py - y) - s * (px - x)
        away = np.hypot(np.maximum(np.abs(u) - halves[0], 0.0), v) / halves[1]
        near = np.minimum(away, top)
        # Of the slope of the flank, and joined to it smoothly.
        return np.asarray(height * np.maximum(0.0, 1 - away - (top - near) ** 2 / (2 * top)))

    return Heap(over, x, y, sum(halves))


def ellipse(x: float, y: float, halves: Tuple[float, float], height: float, angle: float) -> Heap:
    """Return an elliptic cone; `halves`: of its axes."""
    c, s = math.cos(angle), math.sin(angle)

    def over(px: FloatArray, py: FloatArray) -> FloatArray:
        u, v = c * (px - x) + s * (py - y), c * (py - y) - s * (px - x)
        return np.asarray(height * np.maximum(0.0, 1 - np.hypot(u / halves[0], v / halves[1])))

    return Heap(over, x, y, max(halves))


#: A car, a lorry, a wall and a block: half sides and height, metres.
_THINGS = [((2.3, 0.9), 1.5), ((4.0, 1.2), 3.2), ((3.0, 0.15), 2.0), ((2.0, 2.0), 2.5)]


def second_yard(rng: np.random.Generator) -> Yard:
    """Return elliptic and ridge-shaped piles of 30 to 37 degrees at random, two of them touching.

    And what of two vehicles, a wall that stands by itself and a block there is room for.
    """
    heaps: List[Heap] = []
    for column in range(3):
        for row in range(2):
            x, y = 14 + 26 * column + rng.uniform(-2, 2), 15 + 30 * row + rng.uniform(-2, 2)
            slope, angle = math.tan(math.radians(rng.uniform(30, 37))), rng.uniform(0, math.pi)
            across = rng.uniform(3.0, 6.5)
            if rng.random() < 0.5:
                halves = rng.uniform(1.0, 4.0), across
                heaps.append(ridge(x, y, halves, slope * across, angle, rng.uniform(0.05, 0.4)))
            else:
                # The steepest flank, across the longer axis, is at the angle of repose.
                halves = across * rng.uniform(1.0, 1.6), across
                heaps.append(ellipse(x, y, halves, slope * across, angle))
    # A cone that overlaps the foot of the first pile.
    one = heaps[0]
    away, angle = one.reach + rng.uniform(2.0, 3.0), rng.uniform(0.2, 1.2)
    heaps.append(cone(one.x + away * math.cos(angle), one.y + away * math.sin(angle), 4.5, 2.9))
    objects = []
    for place, (halves, top) in enumerate(_THINGS):
        x, y = 8 + 20 * place + rng.uniform(-2, 2), 30 + rng.uniform(-1, 1)
        if all(math.hypot(heap.x - x, heap.y - y) > heap.reach + 5 for heap in heaps):
            objects.append(box(x, y, halves, rng.uniform(0, math.pi), level(top)))
    return yard_of(heaps, objects)


YARDS: Mapping[str, Callable[[np.random.Generator], Yard]] = {
    "first": first_yard,
    "second": second_yard,
}


# --- points


def points_of(
    yard: Yard, rng: np.random.Generator, relief: float, noise: float, density: float = DENSITY
) -> FloatArray:
    """Return the points (N, 3) of a survey, in map coordinates; the ground slopes by 1 %."""
    count = int(WIDE * HIGH * density)
    x, y = rng.uniform(0, WIDE, count), rng.uniform(0, HIGH, count)
    z = LEVEL + 0.01 * x - 0.005 * y + yard(x, y) + rng.normal(0, noise, count)
    if relief:
        name = list(RELIEFS)[int(rng.integers(len(RELIEFS)))]
        wavelength = float(np.exp(rng.uniform(math.log(3), math.log(30))))
        z += relief * RELIEFS[name](rng, max(WIDE, HIGH), wavelength)(x - WIDE / 2, y - HIGH / 2)
    return np.column_stack([x + EAST, y + NORTH, z])


# --- measuring


@dataclass(frozen=True)
class Row:
    """One pile of one survey, volumes in m3; NaN where it was not found."""

    pile: int
    truth: float
    volume: float
    half_width: float

    @property
    def error(self) -> float:
        """Error of the volume, share of the true one."""
        return self.volume / self.truth - 1.0

    @property
    def inside(self) -> bool:
        """Whether the interval holds the truth."""
        return abs(self.volume - self.truth) <= self.half_width


def measured(path: Path, yard: Yard) -> Tuple[List[Row], List[str]]:
    """Return a row for each pile, and the names of all other proposals."""
    found = measure(path, area="auto", shape="terrain", grid=True)
    outlines = {one.name: shapely.from_wkb(one.polygon_wkb) for one in found.proposals}
    rows, used = [], set()
    for number, (heap, truth) in enumerate(zip(yard.heaps, yard.volumes), 1):
        summit = shapely.Point(EAST + heap.x - 0.5, NORTH + heap.y)  # which a wall may end at
        names = [r.name for r in found.results if outlines[r.name].covers(summit)]
        result = found[names[0]] if names else None
        used.update(names)
        if isinstance(result, AreaResult):
            rows.append(Row(number, truth, result.volume_m3, 1.96 * (result.std_m3 or 0.0)))
        else:
            rows.append(Row(number, truth, math.nan, math.nan))
    return rows, [name for name in outlines if name not in used]


def survey(kind: str, seed: int, relief: float) -> Tuple[List[Row], List[str]]:
    """Return the rows of one survey, and what else was proposed."""
    rng = np.random.default_rng(seed)
    yard = YARDS[kind](rng)
    xyz = points_of(yard, rng, relief, rng.uniform(0.01, 0.02))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "yard.las"
        write(path, xyz)
        return measured(path, yard)


def write(path: Path, xyz: FloatArray) -> None:
    """Write a cloud."""
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = [0.001] * 3, [EAST, NORTH, 0.0]
    header.add_crs(CRS.from_epsg(32633))
    las = laspy.LasData(header)
    las.x, las.y, las.z = xyz.T
    las.write(path)


def report(kind: str, seeds: int) -> None:
    """Print a line for each pile, and the sums."""
    print(f"{kind} yard", "  relief seed pile    m3   error %  half width %", sep="\n")
    rows: List[Row] = []
    for relief in (0.0, 0.03):
        for seed in range(seeds):
            found, others = survey(kind, seed, relief)
            rows += found
            for row in found:
                told = "not found" if math.isnan(row.volume) else "" if row.inside else "outside"
                print(
                    f"  {relief:6.2f} {seed:4} {row.pile:4} {row.truth:6.1f} {100 * row.error:8.2f}"
                    f" {100 * row.half_width / row.truth:10.2f}  {told}"
                )
            print(f"    also proposed: {', '.join(others)}", flush=True)
    errors = np.array([row.error for row in rows])
    print(
        f"{len(rows)} piles: {np.isfinite(errors).sum()} found, largest error "
        f"{100 * np.nanmax(np.abs(errors)):.2f} %, {sum(row.inside for row in rows)} inside their "
        "intervals"
    )


def compare_times(points: int, repeat: int) -> None:
    """Print the times of proposing and measuring piles, and of one outline over everything."""
    rng = np.random.default_rng(1)
    yard = first_yard(rng)
    around = shapely.box(EAST + 1, NORTH + 1, EAST + WIDE - 1, NORTH + HIGH - 1)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "yard.laz"
        write(path, points_of(yard, rng, 0.03, 0.015, points / (WIDE * HIGH)))
        times: Dict[str, List[Tuple[float, float]]] = {"auto": [], "one outline": []}
        for turn in range(2 * repeat):
            kind = list(times)[turn % 2]
            start = time.perf_counter(), time.process_time()
            measure(path, area="auto" if kind == "auto" else around, shape="terrain")
            end = time.perf_counter(), time.process_time()
            times[kind].append((end[0] - start[0], end[1] - start[1]))
    print(f"{points:,} points")
    for place, clock in enumerate(("elapsed", "processor")):
        auto, one = (float(np.median([row[place] for row in times[kind]])) for kind in times)
        print(f"  {clock}: auto {auto:.1f} s, one outline {one:.1f} s, ratio {auto / one:.2f}")


def main() -> None:
    """Run what is asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--time", type=int, nargs="?", const=20_000_000, metavar="POINTS")
    parser.add_argument("--repeat", type=int, default=3, help="of the timing")
    given = parser.parse_args()
    for kind in YARDS if given.seeds else ():
        report(kind, given.seeds)
    if given.time:
        compare_times(given.time, given.repeat)


if __name__ == "__main__":
    main()
