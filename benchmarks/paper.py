"""Tables 1, 2 and 6 of the paper ("3D-Quantify", Earlham College) beside our numbers.

Run it with ``python benchmarks/paper.py``; it takes some seconds, and all but the times are the
same on every run. Our clouds are drawn at random on the same surfaces, so the last
digits differ from the paper's. A dash stands where no number of the paper is at hand.
"""

from __future__ import annotations

import math
import time
from typing import Optional

import numpy as np

from quantify_client.types import FloatArray
from quantify_client.volcalc.paper import polar_volume

SEED = 20
SPHERE = math.pi / 6.0
CUBE_PAPER = {10: 0.902733, 36: 0.972945, 50: 0.980506}
SPHERE_PAPER = {10: 0.490252, 50: 0.522469, 100: 0.451873}


def cube_surface(count: int) -> FloatArray:
    """(3, count): points spread evenly at random over the faces of the unit cube."""
    rng = np.random.default_rng(SEED)
    face = rng.integers(0, 6, count)
    points = rng.random((count, 3))
    points[np.arange(count), face % 3] = face // 3
    return points.T


def sphere_surface(count: int) -> FloatArray:
    """(3, count): points spread evenly at random over the sphere of radius 0.5."""
    points = np.random.default_rng(SEED).normal(size=(3, count))
    return 0.5 * points / np.linalg.norm(points, axis=0)


def cell(value: Optional[float]) -> str:
    return f"{value:14.6f}" if value is not None else f"{'-':>14}"


def print_table_1() -> None:
    points = cube_surface(100_000)
    print("Table 1: unit cube, volume 1, by number of slabs; 100,000 points")
    print(f"{'slabs':>8}{'paper':>14}{'ours':>14}{'centred caps':>14}")
    for slabs, paper in CUBE_PAPER.items():
        ours = polar_volume(*points, slabs).volume
        centred = polar_volume(*points, slabs, center_caps=True).volume
        print(f"{slabs:8d}{cell(paper)}{cell(ours)}{cell(centred)}")
    print()


def print_table_2() -> None:
    thin, dense = sphere_surface(2_000), sphere_surface(100_000)
    print(f"Table 2: sphere of radius 0.5, volume {SPHERE:.6f}, by number of slabs")
    print(f"{'slabs':>8}{'paper':>14}{'ours, 2,000':>14}{'100,000':>14}{'centred caps':>14}")
    for slabs, paper in SPHERE_PAPER.items():
        row = (
            paper,
            polar_volume(*thin, slabs).volume,
            polar_volume(*dense, slabs).volume,
            polar_volume(*dense, slabs, center_caps=True).volume,
        )
        print(f"{slabs:8d}" + "".join(cell(value) for value in row))
    print("With 2,000 points the slabs run out of points: the more slabs, the smaller the sphere.")
    print()


def print_table_6() -> None:
    print("Table 6: time of one measurement of the cube with 50 slabs")
    print(f"{'points':>10}{'paper':>14}{'ours, s':>14}{'CPU, s':>14}{'volume':>14}")
    for count in (10_000, 100_000, 1_000_000, 5_000_000):
        points = cube_surface(count)
        wall, cpu = time.perf_counter(), time.process_time()
        volume = polar_volume(*points, 50).volume
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
        print(f"{count:10d}{cell(None)}{wall:14.3f}{cpu:14.3f}{cell(volume)}")


if __name__ == "__main__":
    print_table_1()
    print_table_2()
    print_table_6()
