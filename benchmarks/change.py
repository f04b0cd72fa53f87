"""Whether intervals and levels of detection of change hold, on simulated pairs of surveys.

Undulating ground of 200 m, three places where something was added or lost (closed forms), 0.02 m of
white noise and, in each survey, noise of 1 to 5 cm that neighbours over 5 to 30 m share. The later
survey lies up to 2 m off, half a metre higher or lower, and is tilted. With --still nothing was
added or lost, and areas lie anywhere.

    python benchmarks/change.py [--pairs N] [--still] [--white] [--jobs N] [--seed N]

Prints areas; RMS of z = (volume - truth) / std; intervals that hold the truth, percent; median
error and median std, m3; without change also cells below their level of detection, percent.
"""

from __future__ import annotations

import argparse
import tempfile
import warnings
from pathlib import Path
from typing import Any, Dict, List, Tuple

import laspy
import numpy as np
from chain import run
from pyproj import CRS
from shapely.geometry import Point, mapping

import quantify_client
from quantify_client.types import AreaResult, FloatArray

EAST, NORTH, SIDE, COUNT, WHITE = 500_000.0, 5_100_000.0, 200.0, 150_000, 0.02

#: Middle, radius and height: h (1 - (d / r)^2)^2 has the volume pi r^2 h / 3.
FORMS = ((-30.0, -20.0, 18.0, 3.0), (25.0, 30.0, 15.0, -4.0), (35.0, -40.0, 12.0, 1.5))
_WAVES = 64

#: Number, seed, whether anything changed, whether noise is shared.
Task = Tuple[int, int, bool, bool]
Row = Tuple[float, float, float]


def ground(x: FloatArray, y: FloatArray) -> FloatArray:
    """Return heights of ground that did not change."""
    wide, narrow = np.sin(x / 23 + 0.3) * np.cos(y / 31), np.sin(x / 7) * np.sin(y / 9 + 1)
    return np.asarray(300 + 0.08 * x + 6 * wide + 1.5 * narrow)


def changed(x: FloatArray, y: FloatArray) -> FloatArray:
    """Return what was added to heights."""
    each = [
        h * np.clip(1 - ((x - a) ** 2 + (y - b) ** 2) / r**2, 0, None) ** 2 for a, b, r, h in FORMS
    ]
    return np.asarray(np.sum(each, axis=0))


def shared(rng: Any, x: FloatArray, y: FloatArray, std: float, length: float) -> FloatArray:
    """Return noise with the covariance std^2 exp(-d^2 / (2 length^2))."""
    u, v = rng.normal(0, 1 / length, (2, _WAVES))
    phase = rng.uniform(0, 2 * np.pi, _WAVES)
    total = np.zeros_like(x)
    for number in range(_WAVES):
        total += np.cos(u[number] * x + v[number] * y + phase[number])
    return np.asarray(std * total * np.sqrt(2 / _WAVES))


def write(path: Path, x: FloatArray, y: FloatArray, z: FloatArray) -> None:
    """Write a survey."""
    header = laspy.LasHeader(point_format=3, version="1.4")
    header.scales, header.offsets = [0.001] * 3, [EAST, NORTH, 300.0]
    header.add_crs(CRS.from_epsg(32632))
    las = laspy.LasData(header)
    las.x, las.y, las.z = x + EAST, y + NORTH, z
    las.write(str(path))


def areas(rng: Any, still: bool) -> Dict[str, Any]:
    """Return the places that changed with 2 m around, or three anywhere."""
    places = [(a, b, r + 2.0) for a, b, r, _ in FORMS]
    if still:
        places = [(*rng.uniform(-60, 60, 2), rng.uniform(4, 16)) for _ in FORMS]
    found = [
        {
            "type": "Feature",
            "properties": {"name": str(number)},
            "geometry": mapping(Point(EAST + a, NORTH + b).buffer(r)),
        }
        for number, (a, b, r) in enumerate(places)
    ]
    return {"type": "FeatureCollection", "features": found}


def rows_of(task: Task) -> List[Row]:
    """Return error, std and share of the area beyond the level of detection, of three areas."""
    number, seed, still, white = task
    warnings.simplefilter("ignore")
    rng = np.random.default_rng([seed, number])
    std, length = (0.0, 1.0) if white else (rng.uniform(0.01, 0.05), rng.uniform(5, 30))
    east, north, up = (*rng.uniform(-2, 2, 2), rng.uniform(-0.5, 0.5))
    a, b = rng.uniform(-3e-4, 3e-4, 2)
    with tempfile.TemporaryDirectory() as folder:
        before, after = Path(folder) / "before.laz", Path(folder) / "after.laz"
        for path in (before, after):
            x, y = rng.uniform(-SIDE / 2, SIDE / 2, (2, COUNT))
            z = ground(x, y) + shared(rng, x, y, std, length) + WHITE * rng.standard_normal(COUNT)
            if path == after:
                z = z if still else z + changed(x, y)
                x, y = x + east, y + north
                z = z + up + a * x + b * y
            write(path, x, y, z)
        found = quantify_client.change(before, after, area=areas(rng, still), threads=1)
    factor = found.grid_scale_factor or 1.0
    rows = []
    for result, (_, _, r, h) in zip(found.results, FORMS):
        if isinstance(result, AreaResult) and result.std_m3 and result.area_m2:
            truth = 0.0 if still else np.pi * r * r * h / 3 / factor**2
            beyond = (result.area_changed_m2 or 0.0) / result.area_m2
            rows.append((result.volume_m3 - truth, result.std_m3, beyond))
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0] if __doc__ else "")
    parser.add_argument("--pairs", type=int, default=100)
    parser.add_argument("--still", action="store_true")
    parser.add_argument("--white", action="store_true")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    tasks = [(number, given.seed, given.still, given.white) for number in range(given.pairs)]
    rows = np.array([row for found in run(rows_of, tasks, given.jobs) for row in found])
    error, std, beyond = rows.T
    z = error / std
    print(
        f"{len(rows)} areas of {3 * given.pairs}: RMS z {np.sqrt(np.mean(z**2)):.2f}, "
        f"{np.mean(np.abs(z) < 1.96):.1%} held, median error {np.median(np.abs(error)):.3g} m3, "
        f"std {np.median(std):.3g} m3"
    )
    if given.still:
        print(f"{1 - np.mean(beyond):.1%} of the cells below their level of detection")


if __name__ == "__main__":
    main()
