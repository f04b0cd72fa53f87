"""Bodies of known volume, measured four ways from the same clouds: the table in README.md.

Each cloud is random points on a body (see tests/solids.py) at UTM-sized coordinates. The rivals
are the paper's method with its default slabs, the convex hull (scipy), and a Poisson mesh (Open3D,
where it is installed: `pip install open3d`) of depth 8 on normals that it estimates from 30
neighbours and orients along its consistent tangent planes. None of them knows ground, stray points
or what is hollow: each gets the whole cloud.

    python benchmarks/objects.py [--points N] [--seed N] [--update README.md]
    python benchmarks/objects.py --time 1 20         millions of points: time and memory instead

The seed is none that a threshold was chosen on.
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Callable, Dict, Iterator, Optional, Tuple

import laspy
import numpy as np
import scale
from scipy.spatial import ConvexHull

from quantify_client.errors import QuantifyError
from quantify_client.types import FloatArray
from quantify_client.volcalc.paper import polar_volume

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
from scans import CLEAN, Flaws, scan, volume_of
from solids import BODIES, BUNNY, NO_BUNNY, Body

try:
    import open3d
except ImportError:
    open3d = None

SEED = 4711
SLABS = 50
NEIGHBOURS, TANGENTS, DEPTH = 30, 10, 8
JOGGLE = 1e-6
BEGIN, END = "<!-- objects: begin -->", "<!-- objects: end -->"

#: For the times: a boulder of this radius, with this noise, metres.
RADIUS, NOISE = 10.0, 0.02


@dataclass(frozen=True)
class Row:
    """A body, what is wrong with its cloud, and whether its voids count."""

    body: Body
    flaws: Flaws = CLEAN
    said: str = ""
    hollow: bool = False

    @property
    def truth(self) -> float:
        """Return the volume that is asked for, m3."""
        return self.body.hollow if self.hollow and self.body.hollow else self.body.volume

    @property
    def name(self) -> str:
        """Return what the row is called."""
        return self.body.name + self.said


FLAWED = (
    (", noise of 1 %", Flaws(noise=0.01), ("sphere", "four legs", "bunny")),
    (", 1 % outliers", Flaws(outliers=0.01), ("sphere", "four legs", "bunny")),
    (", density 10:1", Flaws(gradient=10.0), ("sphere", "L-prism", "bunny")),
    (", hole of 20 %", Flaws(hole=0.2), ("sphere", "torus, lying", "bunny")),
    (" on the ground, lowest 10 % missing", Flaws(missing=0.1, ground=3.0), ("sphere", "bunny")),
    (" on the ground, lowest 30 % missing", Flaws(missing=0.3, ground=3.0), ("sphere",)),
    (" on ground tilted by 10°, 10 % missing", Flaws(missing=0.1, ground=3.0, tilt=10.0),
     ("sphere",)),
)  # fmt: skip


def rows() -> Iterator[Row]:
    bodies = {name: make() for name, make in BODIES.items() if name != "bunny" or BUNNY.exists()}
    for body in bodies.values():
        yield Row(body)
        if body.hollow is not None:
            yield Row(body, said=", voids left out", hollow=True)
    for said, flaws, names in FLAWED:
        for name in names:
            if name in bodies:
                yield Row(bodies[name], flaws, said)


def paper(points: FloatArray) -> float:
    return polar_volume(*(points - points.min(axis=0)).T, SLABS).volume


def hull(points: FloatArray) -> float:
    return float(ConvexHull(points - points.mean(axis=0)).volume)


def poisson(points: FloatArray) -> float:
    """Volume inside a Poisson mesh, as the signed sum over its triangles.

    Without being moved by a millionth of their extent, points on plane faces keep the orientation
    of the normals busy for hours.
    """
    local = points - points.mean(axis=0)
    local += JOGGLE * np.ptp(local) * np.random.default_rng(0).standard_normal(local.shape)
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(local))
    cloud.estimate_normals(open3d.geometry.KDTreeSearchParamKNN(NEIGHBOURS))
    cloud.orient_normals_consistent_tangent_plane(TANGENTS)
    mesh, _ = open3d.geometry.TriangleMesh.create_from_point_cloud_poisson(cloud, depth=DEPTH)
    a, b, c = np.asarray(mesh.vertices)[np.asarray(mesh.triangles)].transpose(1, 0, 2)
    return abs(float(np.einsum("ij,ij->", a, np.cross(b, c)))) / 6


def timed(method: Callable[[], float], truth: float) -> str:
    """Return the error in percent and the seconds, or why there is none."""
    start = time.perf_counter()
    try:
        error = 100 * (method() - truth) / truth
    except QuantifyError:
        return "refused"
    # 0.001 % would be more than the seeds agree on; + 0.0 makes -0.00 a 0.00.
    digits = 2 if abs(error) < 10 else 0
    return f"{round(error, digits) + 0.0:+.{digits}f} % ({time.perf_counter() - start:.1f} s)"


def line(row: Row, count: int, seed: int) -> str:
    points = scan(row.body, count, seed, row.flaws)
    found: Dict[str, Any] = {}

    def ours() -> float:
        found["result"] = volume_of(points, hollow=row.hollow)
        return float(found["result"].volume_m3)

    cells = [timed(lambda: paper(points), row.truth), timed(lambda: hull(points), row.truth)]
    cells.append(timed(lambda: poisson(points), row.truth) if open3d else "-")
    cells.append(timed(ours, row.truth))
    result = found.get("result")
    std = result.std_m3 if result is not None else None
    cells.append("-" if std is None else f"± {196 * std / row.truth:.2f} %")
    cells.append(str(len(result.warnings)) if result is not None else "-")
    return f"| {row.name} | " + " | ".join(cells) + " |"


def table(count: int, seed: int) -> str:
    """Print the markdown table while it grows, and return it."""
    head = ["cloud", "paper's method", "convex hull", "Poisson mesh", "ours"]
    head += ["its 95 % interval", "warnings"]
    lines = ["| " + " | ".join(head) + " |", "|---|" + "--:|" * (len(head) - 1)]
    print("\n".join(lines), flush=True)
    for row in rows():
        lines.append(line(row, count, seed))
        print(lines[-1], flush=True)
    return "\n".join(lines)


def update(path: Path, text: str) -> None:
    """Replace what is between the markers."""
    before, rest = path.read_text(encoding="utf-8").split(BEGIN)
    after = rest.split(END)[1]
    path.write_text(f"{before}{BEGIN}\n{text}\n{END}{after}", encoding="utf-8")


# --- time and memory


def make_boulder(path: Path, points: int) -> None:
    """Write a noisy sphere band by band, round and round, so that memory does not grow with it."""
    rng = np.random.default_rng(SEED)
    header = laspy.LasHeader(point_format=3, version="1.2")
    header.scales, header.offsets = [0.001] * 3, [scale.EAST, scale.NORTH, 0.0]
    bands = math.ceil(points / scale.WRITTEN_AT_ONCE)
    with laspy.open(path, "w", header=header) as writer:
        for band in range(bands):
            count = points // bands + (band < points % bands)
            # Equal bands of height have equal areas on a sphere.
            z = 2 * (band + rng.random(count)) / bands - 1
            angle = 2 * np.pi * np.sort(rng.random(count))
            away = np.sqrt(1 - z**2)
            unit = np.stack([away * np.cos(angle), away * np.sin(angle), z])
            x, y, z = RADIUS * unit + NOISE * rng.standard_normal(unit.shape)
            record = laspy.ScaleAwarePointRecord.zeros(count, header=header)
            record.x, record.y, record.z = scale.EAST + x, scale.NORTH + y, 100.0 + z
            record.intensity = rng.integers(0, 4096, count)
            grey = np.clip(30_000 + 4_000 * np.sin(x) + rng.normal(0, 1_500, count), 0, 65_535)
            record.red, record.green, record.blue = grey, 0.9 * grey, 0.8 * grey
            writer.write_points(record)


def measure(cloud: Path) -> None:
    from quantify_client import measure as measure_cloud

    (result,) = measure_cloud(cloud, shape="object", floor="none", threads=1).results
    truth = 4 / 3 * np.pi * RADIUS**3
    if abs(result.volume_m3 / truth - 1) > 0.01:
        raise SystemExit(f"wrong volume: {result.volume_m3} instead of {truth}")


scale.KINDS["object"] = measure


def run_apart(kind: str, cloud: Path) -> Tuple[float, float]:
    """Run one kind in a fresh process; return its seconds and peak memory in MB."""
    command = [sys.executable, __file__, "--one", kind, str(cloud)]
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
    seconds, peak = json.loads(done.stdout.strip().splitlines()[-1])
    return seconds, peak


def print_times(millions: list[float]) -> None:
    print("| million points | decode | object | decode x 3 + 15 s | peak, decode | peak, object |")
    print("|" + "--:|" * 6, flush=True)
    for size in millions:
        with tempfile.TemporaryDirectory() as folder:
            cloud = Path(folder) / "boulder.laz"
            make_boulder(cloud, round(size * 1e6))
            decoding, least = run_apart("decode", cloud)
            seconds, peak = run_apart("object", cloud)
        print(
            f"| {size:g} | {decoding:.1f} s | {seconds:.1f} s | {3 * decoding + 15:.1f} s "
            f"| {least:.0f} MB | {peak:.0f} MB |",
            flush=True,
        )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--points", type=int, default=100_000, help="on each body")
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--update", type=Path, metavar="FILE", help="rewrite the table in a file")
    parser.add_argument("--time", type=float, nargs="+", metavar="MILLIONS")
    parser.add_argument("--one", nargs=2, metavar=("KIND", "CLOUD"), help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one:
        scale.run_here(given.one[0], Path(given.one[1]))
        return
    if given.time:
        print_times(given.time)
        return
    without: Optional[str] = None if open3d else "Open3D is not installed: no Poisson meshes."
    for missing in (without, None if BUNNY.exists() else NO_BUNNY):
        if missing:
            print(missing, file=sys.stderr)
    text = table(given.points, given.seed)
    if given.update:
        update(given.update, text)


if __name__ == "__main__":
    main()
