"""Whether outlines that are drawn badly are told, and told first: the rows of a table of faults.

Each survey is a random pile (1 to 8 m high, flanks of 20 to 38 degrees; cones, ellipses, stars,
truncated, rounded, joined) on ground that tilts by up to 10 % and has up to 0.03 m of relief, of 3
to 100 m wavelength; 3 to 20 points / m2 with 5 to 30 mm of white noise, for 5 to 12 m around all
piles; UTM coordinates. An outline holds 300 points or more. None of this is from the library, and
no threshold of the library was chosen on it.

    python benchmarks/outlines.py [--surveys N] [--rows NAME...] [--base NAME] [--points LOW HIGH]
                                  [--jobs N] [--seed N]

Columns: surveys; refused, percent; of those measured: first warning one of the right codes (or
none, in rows where none is due), one of the wrong ones, percent; without a warning, percent of all:
*silent* where the interval does not hold the truth or the error is beyond 2 %, else *quiet*; median
of error and of half width, percent of the truth; intervals that hold the truth of the row, and the
volume of the pile within the outline that was drawn, percent; RMS of z = (volume - truth) / std.
The check by a TIN, which is told when all of a run has been measured, is not among the warnings.
"""

from __future__ import annotations

import argparse
import math
from collections import Counter
from dataclasses import dataclass
from typing import FrozenSet, Iterator, List, Mapping, Optional, Sequence, Tuple

import numpy as np
import outline_sites as scenes
from chain import measure, run
from grounds import Sum
from scores import LIMITS, Z95, rms
from shapely import affinity
from surveys import (
    EAST,
    LEVEL,
    NORTH,
    Facts,
    Kind,
    Range,
    Rng,
    Survey,
    generator,
    log_uniform,
    make_ground,
    scattered,
    turned_box,
)

from quantify_client.types import AreaResult, FloatArray
from quantify_client.volcalc.terrain.base import BASES


@dataclass(frozen=True)
class Row:
    """A fault of outlines, or none.

    Attributes
    ----------
    scene : maker of surveys.
    truth : which volume is right (`outline_sites.Scene.truth`). "pile" where the outline shall
        hold a pile and does not, or holds more; "outline" where nothing of what is asked for lies
        elsewhere, or the outline ends where something else begins.
    right : codes of first warnings that say what is wrong. "uneven-ground" is neither right nor
        wrong where it is not among them.
    relief : RMS of the ground's heights about its plane, metres.
    warned : whether a warning is due. Without, silence is right, and so are the codes in `right`.
    known : whether the survey can show the fault; what it cannot is told in the documentation.
    """

    scene: scenes.Maker
    truth: str = "pile"
    right: FrozenSet[str] = frozenset()
    relief: Range = (0.0, 0.03)
    warned: bool = True
    known: bool = True

    @property
    def wrong(self) -> FrozenSet[str]:
        """Codes of first warnings that send the user the wrong way."""
        return OF_OUTLINES - self.right


#: Codes that say something of the outline or of what stands at it. In no survey are there gaps or
#: a cloud that ends at the area.
OF_OUTLINES = frozenset({
    "outline-on-pile", "outline-crosses-neighbour", "outline-crosses-channel",
    "outline-crosses-ridge", "outline-without-points", "outline-at-wall", "area-beyond-cloud",
    "two-surfaces",
})  # fmt: skip

_ON_PILE = frozenset({"outline-on-pile"})
_NEIGHBOUR = frozenset({"outline-crosses-neighbour", "uneven-ground"})
_WALL = _NEIGHBOUR | {"outline-at-wall"}

ROWS: Mapping[str, Row] = {
    "inside-0.3": Row(scenes.inside(0.3), "pile", _ON_PILE),
    "inside-0.8": Row(scenes.inside(0.8), "pile", _ON_PILE),
    "inside-1.5": Row(scenes.inside(1.5), "pile", _ON_PILE),
    "wall": Row(scenes.wall, "outline", _WALL),
    "bay": Row(scenes.bay, "outline", _WALL),
    "neighbour-1m": Row(scenes.neighbour, "pile", _NEIGHBOUR),
    "neighbour-deep": Row(scenes.neighbour_deep, "pile", _NEIGHBOUR),
    "bushes": Row(scenes.bushes, "pile", _NEIGHBOUR),
    "grass-all": Row(scenes.grass(True, True), known=False),
    "grass-ground": Row(scenes.grass(True, False), known=False),
    "grass-pile": Row(scenes.grass(False, True), known=False),
    "channel-open": Row(
        scenes.strip(-1.0), "outline", frozenset({"outline-crosses-channel"}), warned=False
    ),
    "dam-open": Row(
        scenes.strip(1.0), "outline", frozenset({"outline-crosses-ridge"}), warned=False
    ),
    "terrace": Row(scenes.terrace, "pile", _WALL),
    "touching": Row(scenes.touching, "outline", _NEIGHBOUR, (0.03, 0.03), warned=False),
    "crowns": Row(scenes.crowns, "upper", frozenset({"two-surfaces"})),
    "clean": Row(scenes.clean, relief=(0.0, 0.0), warned=False),
    "relief-only": Row(scenes.clean, relief=(0.01, 0.03), warned=False),
}

#: Percent: least share of first warnings that are right, most that are wrong, most sound surveys
#: that are warned of their outline or refused.
_RIGHT, _WRONG, _LOST = 80.0, 5.0, 2.0

#: Errors beyond this share of the truth are not to be silent.
_SMALL = 0.02

#: Points within an outline, and of a survey.
_FEWEST, _MOST = 300, 60_000

#: Piles that are tried for a survey: about two in three fit.
_TRIES = 1000

#: Of the ground: tilt, degrees (10 %), and of points: their own noise, metres.
_TILT, _WHITE = (0.0, math.degrees(math.atan(0.1))), (0.005, 0.03)

#: Row, number, seed, points / m2, base.
Task = Tuple[str, int, int, Range, str]


# --- surveys


def make_survey(name: str, number: int, seed: int, points: Range) -> Survey:
    """Return one survey of a row; its facts hold the pile's volume within the outline (m3)."""
    rng, row = generator(name, number, seed), ROWS[name]
    scene, angle, corner, sides, density = _placed(rng, row, points)
    x, y = scattered(rng, angle, corner, sides, round(sides.prod() * density))
    facts: Facts = {"density": density, "within": scene.truth("outline")}
    kind = Kind(relief=(rng.uniform(*row.relief),), slope=_TILT)
    ground = make_ground(rng, kind, 2 * float(np.abs([x, y]).max()), facts)
    facts["white"] = white = rng.uniform(*_WHITE)
    z = LEVEL + Sum(((1.0, ground), (1.0, scene.surface)))(x, y)
    z += white * rng.standard_normal(z.shape)
    outline = affinity.translate(scene.outline, EAST, NORTH)
    return Survey(np.stack([x + EAST, y + NORTH, z]), outline, scene.truth(row.truth), facts)


def _placed(
    rng: Rng, row: Row, points: Range
) -> Tuple[scenes.Scene, float, FloatArray, FloatArray, float]:
    """Return a scene, the angle, corner and sides of its cloud, metres, and points / m2."""
    for _ in range(_TRIES):
        scene = row.scene(rng, scenes.random_heap(rng))
        if scene is None:
            continue
        angle, margin = rng.uniform(0, math.pi / 2), rng.uniform(5.0, 12.0)
        corner, sides = turned_box(scene.outline.union(scene.beside), angle)
        corner, sides = corner - margin, sides + 2 * margin
        density = log_uniform(rng, points)
        if scene.outline.area * density >= _FEWEST and sides.prod() * density <= _MOST:
            return scene, angle, corner, sides, density
    raise SystemExit(f"no pile holds {_FEWEST} points and its cloud {_MOST}: change --points")


# --- measured


@dataclass(frozen=True)
class Outcome:
    """What one survey gave; numbers are relative to the size of the truth.

    Attributes
    ----------
    refused : why there is no volume with an interval.
    first : code of the first warning.
    error, std : of the volume.
    within : volume within the outline that was drawn, less the truth.
    proposed : whether the result holds another outline to use.
    """

    refused: str = ""
    first: Optional[str] = None
    error: float = math.nan
    std: float = math.nan
    within: float = math.nan
    proposed: bool = False

    def held(self, off: float = 0.0) -> bool:
        """Return whether the interval holds the truth, or what is off it by so much."""
        return abs(self.error - off) <= Z95 * self.std

    @property
    def quiet(self) -> bool:
        """Whether nothing is told, and there is no error to be told of."""
        return self.first is None and self.held() and abs(self.error) <= _SMALL

    @property
    def silent(self) -> bool:
        """Whether nothing is told of an error."""
        return not (self.refused or self.first or self.quiet)


def outcome_of(task: Task) -> Outcome:
    """Make and measure one survey; whatever the measurement raises counts as refused."""
    name, number, seed, points, base = task
    survey = make_survey(name, number, seed, points)
    try:
        result = measure(survey.points, survey.outline, base)
    except Exception as refusal:
        return Outcome(refused=f"{type(refusal).__name__}: {refusal}")
    if not result.std_m3:
        return Outcome(refused=f"no interval on the base '{base}'")
    size = abs(survey.truth)
    codes = [getattr(notice, "code", "other") for notice in result.warnings]
    return Outcome(
        first=codes[0] if codes else None,
        error=(result.volume_m3 - survey.truth) / size,
        std=result.std_m3 / size,
        within=(float(survey.facts["within"]) - survey.truth) / size,
        proposed=proposed(result),
    )


def proposed(result: AreaResult) -> bool:
    """Return whether a result holds another outline to use."""
    return result.relief is not None and result.relief.proposal_wkb is not None


# --- tables


@dataclass(frozen=True)
class Line:
    """The figures of one row, in percent where not said otherwise (see the top)."""

    surveys: int
    refused: float
    right: float
    wrong: float
    silent: float
    quiet: float
    error: float
    half_width: float
    held: float
    held_within: float
    rms_z: float
    answered: float
    lost: float


def percent(found: Sequence[bool]) -> float:
    """Return the share of those that are true, NaN for none at all."""
    return 100 * float(np.mean(found)) if len(found) else math.nan


def line_of(row: Row, outcomes: Sequence[Outcome]) -> Line:
    """Return the figures of a row.

    `answered` is the share of surveys that were refused, whose interval holds, or whose result has
    a proposal; `lost` that of those refused or warned of their outline.
    """
    some = [one for one in outcomes if not one.refused]
    told = [one.first in row.right or not (row.warned or one.first) for one in some]
    none = [math.nan]
    return Line(
        len(outcomes),
        percent([bool(one.refused) for one in outcomes]),
        percent(told),
        percent([one.first in row.wrong for one in some]),
        percent([one.silent for one in outcomes]),
        percent([one.quiet for one in outcomes]),
        100 * float(np.median([one.error for one in some] or none)),
        100 * Z95 * float(np.median([one.std for one in some] or none)),
        percent([one.held() for one in some]),
        percent([one.held(one.within) for one in some]),
        rms(np.array([one.error / one.std for one in some] or none)),
        percent([bool(one.refused) or one.held() or one.proposed for one in outcomes]),
        percent([bool(one.refused) or one.first in OF_OUTLINES for one in outcomes]),
    )


#: Column's head, field of `Line`, format.
COLUMNS = (
    ("n", "surveys", "d"),
    ("refused %", "refused", ".0f"),
    ("right %", "right", ".0f"),
    ("wrong %", "wrong", ".0f"),
    ("silent %", "silent", ".0f"),
    ("quiet %", "quiet", ".0f"),
    ("error %", "error", "+.2f"),
    ("half width %", "half_width", ".2f"),
    ("held %", "held", ".0f"),
    ("held within %", "held_within", ".0f"),
    ("RMS z", "rms_z", ".2f"),
)


def head() -> str:
    """Return the head of the markdown table."""
    return f"| row | {' | '.join(name for name, _, _ in COLUMNS)} |\n|---|" + "--:|" * len(COLUMNS)


def failures(row: Row, line: Line) -> Iterator[str]:
    """Yield what a row fails in; shares of none at all fail in nothing."""
    if not row.known:
        if line.wrong > _WRONG:
            yield f"{line.wrong:.0f} % told wrongly"
        return
    if not row.right and line.lost > _LOST:
        yield f"{line.lost:.0f} % warned of their outline or refused"
    least, _ = LIMITS["coverage_percent"]
    if line.answered < least:
        yield f"{100 - line.answered:.0f} % outside of the interval, without a proposal"
    if row.right and line.right < _RIGHT:
        yield f"{line.right:.0f} % told rightly"
    if row.right and line.wrong > _WRONG:
        yield f"{line.wrong:.0f} % told wrongly"
    if row.warned and line.silent > 0:
        yield f"{line.silent:.0f} % silent"


def reasons(outcomes: Sequence[Outcome]) -> str:
    """Return how often each first warning or refusal came."""
    count = Counter(one.refused or one.first or "no warning" for one in outcomes)
    return ", ".join(f"{number} x {text}" for text, number in count.most_common())


# --- the run


def arguments(given: Optional[Sequence[str]] = None) -> argparse.Namespace:
    """Return the options."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--surveys", type=int, default=100, help="of each row")
    parser.add_argument("--rows", nargs="+", choices=ROWS, default=list(ROWS), metavar="NAME")
    parser.add_argument("--base", choices=BASES, default="kriged")
    parser.add_argument("--points", nargs=2, type=float, default=(3.0, 20.0), help="for each m2")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--seed", type=int, default=0, help="of all random numbers")
    return parser.parse_args(given)


def main() -> None:
    """Run from the command line."""
    given = arguments()
    told: List[str] = []
    failed: List[str] = []
    print(head(), flush=True)
    for name in given.rows:
        points = (given.points[0], given.points[1])
        tasks = [(name, n, given.seed, points, given.base) for n in range(given.surveys)]
        outcomes = list(run(outcome_of, tasks, given.jobs))
        line = line_of(ROWS[name], outcomes)
        cells = [format(getattr(line, column), form) for _, column, form in COLUMNS]
        print(f"| {name} | {' | '.join(cells)} |", flush=True)
        told.append(f"{name}: {reasons(outcomes)}")
        failed += [f"{name}: {failure}" for failure in failures(ROWS[name], line)]
    print("\nFirst warnings and refusals:\n" + "\n".join(told))
    print("\nVerdict: " + ("\n".join(["", *failed]) if failed else "all criteria are met"))


if __name__ == "__main__":
    main()
