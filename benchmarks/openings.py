"""Openings that are closed flat: how often intervals hold for what nobody saw behind them.

Unions as in random_bodies.py, and smooth bodies: an ellipsoid with waves, whose volume is that of
an integral. Each has one opening, a ball's share of its surface without points, and is measured
with --hollow, so that nothing is completed. Constants were chosen on unions 9500 to 9515 and smooth
bodies 1 to 12.

    python benchmarks/openings.py [--bodies 12] [--points 20000] [--first-seed 14000]
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Callable, Dict, Tuple

import numpy as np
from samplings import held_of, limited, rms_of, union_volume

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
from scans import Flaws, scan, volume_of
from solids import Body, draw_until, random_body, unit_vectors

FIRST_SEED = 14_000
WIDTHS = (0.12, 0.2, 0.3)
"""Of openings, shares of the largest extent."""
NOISE = (0.0, 0.003, 0.01)


def smooth_body(seed: int) -> Body:
    """Return an ellipsoid whose radii have three to eight waves in as many directions."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(3, 9))
    lengths = rng.uniform(1.0, 5.0, count)
    waves, phase = unit_vectors(count, rng) * lengths[:, None], rng.uniform(0.0, 2.0 * np.pi, count)
    height, half = rng.uniform(0.02, 0.16, count) / np.sqrt(lengths), rng.uniform(0.25, 0.5, 3)

    def radii(ways: np.ndarray) -> np.ndarray:
        return np.maximum(0.15, 1.0 + np.sin(ways @ waves.T + phase) @ height)

    def placed(ways: np.ndarray) -> np.ndarray:
        ways = ways / np.linalg.norm(ways, axis=1)[:, None]
        return radii(ways)[:, None] * ways * half

    def spread(ways: np.ndarray) -> np.ndarray:
        """Area of the surface by that of the unit sphere."""
        one = np.cross(ways, [0.3, 0.5, 0.81])
        one /= np.linalg.norm(one, axis=1)[:, None]
        sides = [
            (placed(ways + h) - placed(ways - h)) / 2e-5
            for h in (1e-5 * one, 1e-5 * np.cross(ways, one))
        ]
        return np.linalg.norm(np.cross(*sides), axis=1)

    some = spread(unit_vectors(50_000, np.random.default_rng(0)))

    def draw(number: int, rng: np.random.Generator) -> np.ndarray:
        ways = unit_vectors(number, rng)
        return placed(ways[rng.random(number) * 1.3 * some.max() < spread(ways)])

    def surface(number: int, rng: np.random.Generator) -> np.ndarray:
        return draw_until(number, lambda missing: draw(missing, rng))

    nodes, weights = np.polynomial.legendre.leggauss(400)
    turn = (np.arange(800) + 0.5) * 2.0 * np.pi / 800
    flat = np.sqrt(1.0 - nodes**2)[:, None]
    ways = np.stack(
        [flat * np.cos(turn), flat * np.sin(turn), nodes[:, None] + 0.0 * turn], axis=-1
    )
    cubes = radii(ways.reshape(-1, 3)).reshape(400, 800) ** 3
    volume = float((weights[:, None] * cubes).sum() * 2.0 * np.pi / 800 / 3.0 * np.prod(half))
    return Body(f"smooth {seed}", volume, float(some.mean() * 4.0 * np.pi), surface)


def union(seed: int) -> Tuple[Body, float]:
    body = random_body(seed)
    return body, union_volume(body)


def smooth(seed: int) -> Tuple[Body, float]:
    body = smooth_body(seed)
    return body, body.volume


KINDS: Dict[str, Callable[[int], Tuple[Body, float]]] = {"unions": union, "smooth": smooth}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--bodies", type=int, default=12)
    parser.add_argument("--points", type=int, default=20_000)
    parser.add_argument("--first-seed", type=int, default=FIRST_SEED)
    given = parser.parse_args()
    print(
        "| bodies | noise % | number | median % | median std % | mean z | RMS z | held % | most |"
    )
    print("|---|--:|--:|--:|--:|--:|--:|--:|--:|")
    for kind, make in KINDS.items():
        bodies = [make(given.first_seed + number) for number in range(given.bodies)]
        for noise in NOISE:
            errors, stds = [], []
            for number, (body, truth) in enumerate(bodies):
                for width in WIDTHS:
                    points = scan(body, given.points, 10 * number, Flaws(noise=noise, hole=width))
                    result = volume_of(points, hollow=True)
                    errors.append(100 * (result.volume_m3 / truth - 1))
                    stds.append(100 * (result.std_m3 or np.nan) / truth)
            z = np.array(errors) / np.array(stds)
            print(
                f"| {kind} | {100 * noise:g} | {len(z)} | {np.median(np.abs(errors)):.3f} "
                f"| {np.median(stds):.3f} | {np.mean(z):+.2f} | {limited(rms_of, z, 2)} "
                f"| {limited(held_of, z, 0)} | {np.abs(z).max():.1f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
