"""Random bodies of known volume, measured: how often, how far and how knowingly that goes wrong.

Each is 2 to 6 boxes, balls and cylinders, turned any way, that hang together (`random_body` in
tests/solids.py); its volume is known to some 0.01 %. With noise the same bodies are scanned again.
No threshold was chosen on these seeds.

    python benchmarks/random_bodies.py [--bodies 100] [--points 100000] [--noise 0 0.003 0.01]
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import List, Optional, Sequence

import numpy as np

from quantify_client.errors import QuantifyError

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
from scans import Flaws, scan, volume_of
from solids import random_body

FIRST_SEED = 5000
MISS = 2.0
"""Percent; an error above it should carry a warning."""


@dataclass(frozen=True)
class Trial:
    """One body measured: its error and its stated standard deviation, percent of the truth."""

    seed: int
    error: float
    std: Optional[float]
    seconds: float
    warnings: Sequence[str]

    @property
    def missed(self) -> bool:
        """Return whether the error, or no answer, calls for a warning."""
        return not abs(self.error) <= MISS

    def __str__(self) -> str:
        std = "-" if self.std is None else f"{self.std:.2f}"
        said = "; ".join(self.warnings) or "NO WARNING"
        return f"  seed {self.seed}: {self.error:+.2f} %, std {std} %: {said}"


def trial(seed: int, count: int, noise: float) -> Trial:
    body = random_body(seed)
    points = scan(body, count, seed, Flaws(noise=noise))
    start = time.perf_counter()
    try:
        result = volume_of(points)
    except QuantifyError as refusal:
        return Trial(seed, math.inf, None, time.perf_counter() - start, [f"refused: {refusal}"])
    error = 100 * (result.volume_m3 / body.volume - 1)
    std = None if result.std_m3 is None else 100 * result.std_m3 / body.volume
    return Trial(seed, error, std, time.perf_counter() - start, result.warnings)


def print_summary(noise: float, trials: List[Trial]) -> None:
    errors = np.abs([one.error for one in trials])
    known = [one for one in trials if one.std and math.isfinite(one.error)]
    rms = math.sqrt(np.mean([(one.error / one.std) ** 2 for one in known])) if known else math.nan
    print(
        f"noise {100 * noise:g} %: median error {np.median(errors):.2f} %, 95th percentile "
        f"{np.sort(errors)[math.ceil(0.95 * len(errors)) - 1]:.2f} %, mean "
        f"{np.mean([one.error for one in trials]):+.2f} %, RMS of (estimate - truth) / std "
        f"{rms:.2f}, {np.mean([one.seconds for one in trials]):.1f} s each"
    )
    missed = [one for one in trials if one.missed]
    unsaid = sum(not one.warnings for one in missed)
    warned = sum(bool(one.warnings) for one in trials)
    print(
        f" {len(missed)} of {len(trials)} off by more than {MISS:g} %, {unsaid} of them without "
        f"a warning; {warned} carry a warning at all"
    )
    far = sorted(known, key=lambda one: -abs(one.error / (one.std or math.nan)))[:5]
    print(" most stds off:", ", ".join(f"{o.seed}: {o.error / (o.std or 1):+.1f}" for o in far))
    for one in missed:
        print(one)
    sys.stdout.flush()


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--bodies", type=int, default=100)
    parser.add_argument("--points", type=int, default=100_000, help="on each body")
    parser.add_argument("--noise", type=float, nargs="+", default=[0.0, 0.003, 0.01],
                        help="standard deviation, share of the largest extent")  # fmt: skip
    parser.add_argument("--first-seed", type=int, default=FIRST_SEED)
    given = parser.parse_args()
    seeds = range(given.first_seed, given.first_seed + given.bodies)
    for noise in given.noise:
        trials = []
        for seed in seeds:
            trials.append(trial(seed, given.points, noise))
            print(f"{trials[-1].seed}: {trials[-1].error:+.2f} %", file=sys.stderr, flush=True)
        print_summary(noise, trials)


if __name__ == "__main__":
    main()
