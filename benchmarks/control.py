"""How well a control network knows the scale, and the volume: the tables in docs/field.md.

Each survey has 12 marks at random on 80 m x 80 m, heights within +- 3 m, in a cloud of a wrong
size; tapes join the pairs nearest to the length named, a bar lies at a random place. All errors
are normal ones of the sigmas named, those of GPS per axis and independent from point to point.
Every survey is adjusted by the library itself: where positions are observed the cloud is upright,
as with photographs that have GPS, but for the last row's, which is turned in space at random;
where they are not, by its lengths alone.

The second table is the direct step from a slope distance D and the ground distance d between both
positions to the difference in elevation, with d from GPS and D taped, 30 m +- 5 mm.

    python benchmarks/control.py [--surveys N] [--update docs/field.md]
"""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from quantify_client.scaler.adjustment.direct import direct_height
from quantify_client.scaler.adjustment.fit import fit
from quantify_client.scaler.adjustment.network import Network
from quantify_client.types import FloatArray, IntArray

SIDE, RELIEF, MARKS = 80.0, 6.0, 12
SHRINK = 0.83
PICKS = (0.01, 0.03)
BAR, BAR_SIGMA, TAPE_SIGMA = 2.0, 0.001, 0.005
SLOPES, TAPE = (0.02, 0.10, 0.30, 0.60), 30.0
GPS = {"phone, 3 m": 3.0, "averaged, 1 m": 1.0, "RTK, 2 cm": 0.02}
BEGIN, END = "<!-- control: begin -->", "<!-- control: end -->"


@dataclass(frozen=True)
class Recipe:
    """What is measured on a site."""

    name: str
    gps: float = 0.0
    tapes: int = 0
    length: float = 30.0
    bars: int = 0
    turned: bool = False


RECIPES = (
    Recipe("GPS alone, phone, 5 m", gps=5.0),
    Recipe("GPS alone, phone, 3 m", gps=3.0),
    Recipe("GPS alone, averaged, 1 m", gps=1.0),
    Recipe("GPS alone, RTK, 2 cm", gps=0.02),
    Recipe("one scale bar, 2 m ± 1 mm", bars=1),
    Recipe("two scale bars", bars=2),
    Recipe("one tape of 30 m ± 5 mm", tapes=1),
    Recipe("one tape of 60 m ± 5 mm", tapes=1, length=60.0),
    Recipe("five tapes of about 30 m", tapes=5),
    Recipe("twenty tapes of about 30 m", tapes=20),
    Recipe("twenty tapes, and GPS 3 m", tapes=20, gps=3.0),
    Recipe("the same, photographs without GPS", tapes=20, gps=3.0, turned=True),
)


def bars_at(generator: np.random.Generator, count: int) -> FloatArray:
    """(2 count, 3): both ends of bars that lie on the ground."""
    middle = generator.uniform(-SIDE / 2, SIDE / 2, (count, 3)) * [1, 1, RELIEF / SIDE]
    angle = generator.uniform(0, 2 * np.pi, count)
    half = BAR / 2 * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(count)])
    return np.stack([middle - half, middle + half], axis=1).reshape(-1, 3)


def taped(marks: FloatArray, recipe: Recipe) -> IntArray:
    """(tapes, 2): the pairs of marks nearest to the length that is taped."""
    first, second = np.triu_indices(len(marks), 1)
    apart = np.linalg.norm(marks[first] - marks[second], axis=1)
    chosen = np.argsort(np.abs(apart - recipe.length))[: recipe.tapes]
    return np.column_stack([first, second])[chosen]


def survey(recipe: Recipe, pick: float, seed: int) -> Network:
    """A site with every error that is made on it."""
    generator = np.random.default_rng(seed)
    sides = np.array([SIDE, SIDE, RELIEF]) / 2
    truth = generator.uniform(-sides, sides, (MARKS, 3))
    pairs = taped(truth, recipe)
    truth = np.vstack([truth, bars_at(generator, recipe.bars)])
    bars = MARKS + np.arange(2 * recipe.bars).reshape(-1, 2)
    ends, bar = np.vstack([pairs, bars]), np.arange(len(pairs) + len(bars)) >= len(pairs)
    sigma = np.where(bar, BAR_SIGMA, TAPE_SIGMA)
    apart = np.linalg.norm(truth[ends[:, 0]] - truth[ends[:, 1]], axis=1)
    count = len(truth)
    seen = truth[:, :2] + generator.normal(0, 1, (count, 2)) * recipe.gps
    known = (np.arange(count) < MARKS) & (recipe.gps > 0)
    # the cloud's own unit is taken for the metre: a pick's error shrinks with it
    turn = Rotation.random(random_state=seed).as_matrix() if recipe.turned else np.eye(3)
    cloud = SHRINK * (truth + generator.normal(0, pick, truth.shape)) @ turn.T
    return Network(
        names=tuple(f"P{i}" for i in range(count)),
        horizontal=np.where(known[:, None], seen, np.nan),
        horizontal_sigma=np.full(count, recipe.gps or 1.0),
        elevation=np.full(count, np.nan),
        elevation_sigma=np.ones(count),
        cloud=cloud,
        cloud_covariance=np.tile((SHRINK * pick) ** 2 * np.eye(3), (count, 1, 1)),
        ends=ends,
        length=apart + generator.normal(0, 1, len(ends)) * sigma,
        length_sigma=sigma,
        bar=bar,
        check=np.zeros(len(ends), dtype=bool),
        higher=np.zeros(len(ends), dtype=np.int64),
    )


def trial(recipe: Recipe, pick: float, surveys: int) -> tuple[float, float]:
    """RMS error of the scale, and the mean standard deviation reported: both relative."""
    rows = []
    for seed in range(surveys):
        upright = recipe.gps > 0 and not recipe.turned
        found = fit(survey(recipe, pick, seed), "auto", georeferenced=upright)
        rows.append((found.factor * SHRINK - 1.0, found.std * SHRINK))
    error, std = np.array(rows).T
    return float(np.sqrt((error**2).mean())), float(std.mean())


def percent(value: float) -> str:
    """Two significant digits."""
    digits = max(0, 1 - math.floor(math.log10(100 * value)))
    return f"{100 * value:.{digits}f} %"


def scale_table(surveys: int) -> str:
    """The markdown table of scales and volumes."""
    columns = [
        f"scale, picks {100 * pick:.0f} cm | reported | volume, picks {100 * pick:.0f} cm"
        for pick in PICKS
    ]
    lines = [f"| control | {' | '.join(columns)} |", "|---|" + "--:|" * 3 * len(PICKS)]
    for recipe in RECIPES:
        cells = []
        for pick in PICKS:
            error, std = trial(recipe, pick, surveys)
            cells += [percent(error), percent(std), percent(3 * error)]
        lines.append(f"| {recipe.name} | {' | '.join(cells)} |")
    return "\n".join(lines)


def direct(slope: float, gps: float) -> str:
    """The standard deviation of a height difference, or that it cannot be told."""
    across = TAPE / math.hypot(1.0, slope)
    both = (TAPE, TAPE_SIGMA), (across, math.sqrt(2.0) * gps)
    found = direct_height(("A", "B"), *both, 1)
    if found.std_m is not None and found.interval_m is None:
        return f"± {found.std_m:.2f} m"
    least, most = found.interval_m or (0.0, math.inf)
    return f"no: {least:.0f} to {most:.1f} m"


def direct_table() -> str:
    """The markdown table of the direct step."""
    lines = [f"| slope | dz over {TAPE:.0f} m | {' | '.join(GPS)} |", "|--:|" + "--:|" * 4]
    for slope in SLOPES:
        cells = [direct(slope, gps) for gps in GPS.values()]
        height = TAPE * slope / math.hypot(1.0, slope)
        lines.append(f"| {100 * slope:.0f} % | {height:.2f} m | {' | '.join(cells)} |")
    return "\n".join(lines)


def update(path: Path, text: str) -> None:
    """Replace what is between the markers."""
    before, rest = path.read_text(encoding="utf-8").split(BEGIN)
    after = rest.split(END)[1]
    path.write_text(f"{before}{BEGIN}\n{text}\n{END}{after}", encoding="utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--surveys", type=int, default=100, help="simulated surveys of each row")
    parser.add_argument("--update", type=Path, metavar="FILE", help="rewrite the tables in a file")
    given = parser.parse_args()
    text = f"{scale_table(given.surveys)}\n\n{direct_table()}"
    print(text)
    if given.update:
        update(given.update, text)


if __name__ == "__main__":
    main()
