"""Partly seen bodies, measured: how far off, and how often the interval holds.

Scenes are made by seen.py: random unions (tests/solids.py) and, with --meshes, closed meshes of
a folder, at rest on ground or cropped, as 12 and 24 cameras at two heights see them, moved by a
smooth field of 0.3 % of their longest side. Rivals: Open3D's Poisson mesh (depth 9, normals of 30
neighbours turned to the cameras, closed at the floor) and the convex hull, likewise. Open3D is
needed for Poisson and to read meshes.

    python benchmarks/scans.py [--bodies 20] [--meshes FOLDER] [--points 20000] [--known-cameras]
                               [--least 2 --slant 20]

Constants were set with seeds 9000 to 9020, 40000 to 40009, 50000 to 50009 and 76400 to 76413 and
with 26 meshes in sight; the table of docs/method.md is of other seeds (from 90000), and of meshes
that nothing was looked at with.
How uncertain the figures are is told by drawing the bodies again (bootstrap): 95 % of draws lie
within the limits.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Dict, List, Tuple

import numpy as np
from scipy.spatial import ConvexHull
from seen import Scene, meshes, resting, scene

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
from scans import OFFSET, volume_of
from solids import random_body

from quantify_client.errors import QuantifyError

try:
    import open3d
except ImportError:
    open3d = None

FIRST_SEED = 60_000
DEPTH, NEIGHBOURS = 9, 30
DRAWS = 2_000
DISPLACED = 0.003
KINDS = [(cameras, ground) for ground in (True, False) for cameras in (12, 24)]


@dataclass(frozen=True)
class Trial:
    """A scene measured: errors of this, of Poisson and of the hull, and the std, in percent."""

    error: float
    std: float
    poisson: float
    hull: float
    seconds: float


def poisson(view: Scene) -> float:
    """Return the volume above the floor of Open3D's Poisson mesh, m3; nan without Open3D."""
    if open3d is None:
        return math.nan
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(view.points))
    cloud.estimate_normals(open3d.geometry.KDTreeSearchParamKNN(NEIGHBOURS))
    normals = np.asarray(cloud.normals).copy()
    away = view.cameras[view.seen_by] - view.points
    normals *= np.where((normals * away).sum(axis=1) < 0, -1.0, 1.0)[:, None]
    cloud.normals = open3d.utility.Vector3dVector(normals)
    mesh, _ = open3d.geometry.TriangleMesh.create_from_point_cloud_poisson(
        cloud, depth=DEPTH, n_threads=1
    )
    return above_floor(np.asarray(mesh.vertices), np.asarray(mesh.triangles))


def hull(view: Scene) -> float:
    """Return the volume of the convex hull of all points above the floor's noise, m3."""
    body = view.points[view.points[:, 2] > 0.01]
    return float(ConvexHull(np.vstack([body, body * [1.0, 1.0, 0.0]])).volume)


def above_floor(vertices: np.ndarray, triangles: np.ndarray) -> float:
    """Return the volume within a mesh that is cut at a height of 0 and closed there, m3."""
    vertices = vertices.copy()
    vertices[:, 2] = np.maximum(vertices[:, 2], 0.0)
    a, b, c = (vertices[triangles[:, i]] for i in range(3))
    upright = 0.5 * np.cross(b - a, c - a)[:, 2]
    return abs(float((upright * (a + b + c)[:, 2] / 3.0).sum()))


def trial(view: Scene, known_cameras: bool) -> Trial:
    """Measure a scene."""
    started = time.perf_counter()
    options = {"cameras": view.cameras + OFFSET} if known_cameras else {}
    try:
        result = volume_of(view.points + OFFSET, **options)
        volume, std = result.volume_m3, result.std_m3 or math.nan
    except QuantifyError as refusal:
        print(f"  {view.name}: refused: {refusal}")
        volume = std = math.nan
    seconds = time.perf_counter() - started
    errors = [100.0 * (v / view.volume - 1.0) for v in (volume, poisson(view), hull(view))]
    return Trial(errors[0], 100.0 * std / view.volume, errors[1], errors[2], seconds)


def summary(by_body: Dict[str, List[Trial]]) -> str:
    """Return a row of the table: figures, and the limits of two of them by bootstrap."""
    bodies = list(by_body.values())
    trials = [one for trials in bodies for one in trials]
    error = np.array([one.error for one in trials])
    rms, held = scores(trials)
    rng = np.random.default_rng(0)
    draws = np.array(
        [
            scores([one for i in rng.integers(0, len(bodies), len(bodies)) for one in bodies[i]])
            for _ in range(DRAWS)
        ]
    )
    (low, low_held), (high, high_held) = np.nanquantile(draws, [0.025, 0.975], axis=0)
    medians = [np.median(np.abs([getattr(t, n) for t in trials])) for n in ("poisson", "hull")]
    return (
        f"{np.nanmedian(np.abs(error)):.2f} | {np.nanmean(error):+.2f} | "
        f"{np.nanmax(np.abs(error)):.1f} | {rms:.2f} ({low:.2f} to {high:.2f}) | {held:.0f} "
        f"({low_held:.0f} to {high_held:.0f}) | {np.isnan(error).sum()} | {medians[0]:.2f} | "
        f"{medians[1]:.1f} | {np.mean([one.seconds for one in trials]):.1f}"
    )


def scores(trials: List[Trial]) -> Tuple[float, float]:
    """Return the RMS of z, and how many in a hundred 95 % intervals hold."""
    z = np.array([one.error / one.std for one in trials])
    z = z[np.isfinite(z)]
    return float(np.sqrt(np.mean(z**2))), 100.0 * float(np.mean(np.abs(z) < 1.96))


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--bodies", type=int, default=20)
    parser.add_argument("--meshes", type=Path)
    parser.add_argument("--points", type=int, default=20_000, help="on the whole surface")
    parser.add_argument("--first-seed", type=int, default=FIRST_SEED)
    parser.add_argument("--known-cameras", action="store_true")
    parser.add_argument("--least", type=int, default=1, help="cameras that a point takes")
    parser.add_argument(
        "--slant", type=float, default=0.0, help="least angle to the surface, degrees"
    )
    given = parser.parse_args()
    bodies = list(meshes(given.meshes)) if given.meshes else []
    bodies += [random_body(given.first_seed + k) for k in range(given.bodies)]
    found: Dict[Tuple[int, bool], Dict[str, List[Trial]]] = {kind: {} for kind in KINDS}
    for number, body in enumerate(bodies):
        still = resting(body, given.first_seed + number)
        for cameras, ground in KINDS:
            seed = given.first_seed + number
            view = scene(
                still, given.points, cameras, ground, DISPLACED, seed, given.least, given.slant
            )
            one = trial(view, given.known_cameras)
            found[cameras, ground].setdefault(f"{number}", []).append(one)
            print(
                f"  {body.name}, {cameras} cameras, {'on ground' if ground else 'cropped'}, "
                f"{view.share:.0%} seen: {one.error:+.2f} +- {one.std:.2f}, Poisson "
                f"{one.poisson:+.1f}",
                file=sys.stderr,
                flush=True,
            )
    print("| seen by | median % | mean | worst | RMS z | held % | refused | Poisson | hull | s |")
    print("|---|--:|--:|--:|---|---|--:|--:|--:|--:|")
    for (cameras, ground), by_body in found.items():
        print(f"| {cameras}, {'on ground' if ground else 'cropped'} | {summary(by_body)} |")
    together: Dict[str, List[Trial]] = {}
    for by_body in found.values():
        for name, trials in by_body.items():
            together.setdefault(name, []).extend(trials)
    print(f"| all | {summary(together)} |")


if __name__ == "__main__":
    main()
