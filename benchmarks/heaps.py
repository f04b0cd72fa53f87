"""Random heaps of known volume on floors: measured as bodies and as terrain.

Cones, caps of balls, truncated cones, all also oblong, windrows and two cones that overlap, with
flanks of 8 to 38 degrees and floors that are 1.5 to 3 times as wide and slope by up to 10 degrees;
5,000 to 100,000 points at random or on shaken grids, a third of them clean, the others with noise
of up to 1 % of the height. No constant was chosen on seeds from 50000 on. With --smooth: heaps that
taper off into the floor, a normal curve, a cosine, or a cone with a foot that fades.

    python benchmarks/heaps.py [--heaps 40] [--first-seed 50000] [--terrain] [--most-points 100000]
                               [--smooth]
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
from pathlib import Path
from typing import List, Sequence

import numpy as np

import quantify_client
from quantify_client.errors import QuantifyError

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
from clouds import write_ply
from mounds import KINDS, SMOOTH, random_heap, sampled

FIRST_SEED = 50_000


def line_of(
    seed: int, kinds: Sequence[str], most: int, shapes: List[str], folder: Path
) -> List[float]:
    """Measure one heap, print it, and return errors in percent and standardized by shape."""
    rng = np.random.default_rng(seed)
    heap = random_heap(rng, kinds[seed % len(kinds)])
    points, noise = sampled(heap, rng, most)
    path = write_ply(folder / "heap.ply", points)
    told = f"{seed} {heap.kind:10s} {len(points):7,} height / width {heap.top / heap.half / 2:.3f}"
    told += f" noise {100 * noise:.2f} %"
    found: List[float] = []
    for shape in shapes:
        try:
            results = quantify_client.measure(path, source_unit="m", shape=shape).results
        except QuantifyError as error:
            print(told, shape, "refused:", error)
            found += [math.nan, math.nan, math.nan]
            continue
        # Two that overlap may be told apart as terrain.
        volume = math.fsum(result.volume_m3 for result in results)
        error, std = volume - heap.volume, math.hypot(*(result.std_m3 for result in results))
        found += [100 * error / heap.volume, error / std, 100 * std / heap.volume]
        told += f"  {shape} {found[-3]:+.3f} +- {found[-1]:.3f} %, z {found[-2]:+.2f}"
        slices = math.fsum(piece.volume_m3 for result in results for piece in result.slices)
        if abs(slices / volume - 1.0) > 1e-9:
            told += " (slices!)"
    print(told, flush=True)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--heaps", type=int, default=40)
    parser.add_argument("--first-seed", type=int, default=FIRST_SEED)
    parser.add_argument("--most-points", type=int, default=100_000)
    parser.add_argument(
        "--terrain", action="store_true", help="measure as terrain (--shape auto), too"
    )
    parser.add_argument("--smooth", action="store_true", help="heaps that taper off")
    given = parser.parse_args()
    kinds = SMOOTH if given.smooth else KINDS
    shapes = ["object", "auto"] if given.terrain else ["object"]
    with tempfile.TemporaryDirectory() as folder:
        seeds = range(given.first_seed, given.first_seed + given.heaps)
        rows = [line_of(seed, kinds, given.most_points, shapes, Path(folder)) for seed in seeds]
    for number, shape in enumerate(shapes):
        percent, z, std = np.array(rows)[:, 3 * number : 3 * number + 3].T
        kept = np.isfinite(z)
        percent, z, std = percent[kept], z[kept], std[kept]
        print(
            f"{shape}: {len(z)} of {len(kept)} measured, median |error| "
            f"{np.median(np.abs(percent)):.3f} %, mean {percent.mean():+.3f} %, worst "
            f"{np.abs(percent).max():.3f} %, median std {np.median(std):.3f} %, RMS z "
            f"{math.sqrt(np.mean(z**2)):.2f}, median |z| {np.median(np.abs(z)):.2f}, held "
            f"{100 * np.mean(np.abs(z) < 1.96):.0f} %"
        )
    if given.terrain:
        one, other = np.array(rows)[:, :3], np.array(rows)[:, 3:]
        apart = (one[:, 0] - other[:, 0]) / np.hypot(one[:, 2], other[:, 2])
        print(f"object against terrain: RMS z {math.sqrt(np.nanmean(apart**2)):.2f}")


if __name__ == "__main__":
    main()
