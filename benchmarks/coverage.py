"""Whether the printed intervals hold, for each class of survey and each base.

Simulated surveys (surveys.py, on the ground of grounds.py with the piles and gullies of sites.py,
all drawn apart from what the library was calibrated on) are measured by the same stages as a file.
The truth is the volume of what was put on the ground or dug out of it: a closed form, or an
integral that is exact to 1e-5. With --kriging, the mean height of each base is held against
kriging that knows the true covariance of the ground (known_kriging.py).

    python benchmarks/coverage.py [--surveys N] [--classes NAME...] [--bases NAME...] [--jobs N]
                                  [--seed N] [--json FILE] [--against FILE] [--kriging]

Columns: surveys; refused or warned of their outline, percent, where that is not right (an outline
does cross a gully); warned of uneven ground, percent, without a criterion; bias and RMSE, m3; RMS
of z = (volume - truth) / std; coverage of the 95 % intervals, percent; RMS z in each third by half
width; mean interval score over that of +-1.96 RMSE for all, of volumes and of volumes over area;
median half width, m3, and over that of the same survey in an earlier run, --against its JSON (on
`triangulate`, where that has no such base). `!` marks a criterion
that is not met. "lowest", "highest" and "average" are levels, no estimates of the ground: they are
held against the same truth and listed apart, without criteria.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from collections import Counter
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Dict, Iterator, List, Optional, Sequence, Tuple

import known_kriging
import numpy as np
from chain import on_bases, run
from scores import LIMITS, Scores, scores
from surveys import CLASSES, make_survey

from quantify_client.volcalc.terrain.base import BASES

LEVELS = ("average", "lowest", "highest")

#: One survey on one base, as in the JSON.
Row = Dict[str, Any]

#: Class, number, seed, bases.
Task = Tuple[str, int, int, Sequence[str]]


def about_outline(code: str) -> bool:
    """Return whether a warning's code says that the outline is at fault."""
    return "outline" in code or code == "area-beyond-cloud"


def rows_of(task: Task) -> List[Row]:
    """Make and measure one survey."""
    name, number, seed, bases = task
    survey = make_survey(name, number, seed)
    start = time.perf_counter()
    found, why = on_bases(survey.points, survey.outline, bases)
    common = {
        "class": name,
        "number": number,
        "truth_m3": survey.truth,
        "area_m2": survey.outline.area,
        "seconds": time.perf_counter() - start,
        "facts": dict(survey.facts),
    }
    rows = []
    for base in bases:
        row: Row = {**common, "base": base, "refused": None, "warnings": []}
        result = found.get(base)
        if result is None or not result.std_m3 or result.interval95_m3 is None:
            row["refused"] = why or f"no interval on the base '{base}'"
        else:
            low, high = result.interval95_m3
            row.update(volume_m3=result.volume_m3, std_m3=result.std_m3, low_m3=low, high_m3=high)
            row["budget"] = {item.source: item.std_m3 for item in result.budget}
            row["warnings"] = [getattr(notice, "code", "other") for notice in result.warnings]
        rows.append(row)
    return rows


def key_of(row: Row, base: Optional[str] = None) -> Tuple[str, int, str]:
    """Return the class, number and base of a row, or another base."""
    return row["class"], row["number"], base or row["base"]


def scores_of(rows: Sequence[Row], earlier: Dict[Tuple[str, int, str], Row]) -> Scores:
    """Return the scores of the surveys of one class on one base."""
    right = CLASSES[rows[0]["class"]].true_warnings
    lost = [
        bool(row["refused"])
        or any(about_outline(code) and code not in right for code in row["warnings"])
        for row in rows
    ]
    some = [row for row in rows if not row["refused"]]
    names = ("volume_m3", "std_m3", "low_m3", "high_m3", "truth_m3", "area_m2")
    volume, std, low, high, truth, area = np.array(
        [[row[name] for name in names] for row in some]
    ).T.reshape(6, -1)
    found = scores(volume - truth, std, low - truth, high - truth, area, lost)
    ratios = [
        row["std_m3"] / before["std_m3"]
        for row in some
        for before in [earlier.get(key_of(row)) or earlier.get(key_of(row, "triangulate"))]
        if before and not before["refused"]
    ]
    uneven = [any(code.startswith("uneven") for code in row["warnings"]) for row in rows]
    return replace(
        found,
        uneven_percent=100 * float(np.mean(uneven)),
        against=float(np.median(ratios)) if ratios else None,
    )


# --- tables

#: Column's head, field of `Scores`, format.
COLUMNS = (
    ("n", "surveys", "d"),
    ("lost %", "lost_percent", ".1f"),
    ("uneven %", "uneven_percent", ".1f"),
    ("bias", "bias_m3", "+.3g"),
    ("RMSE", "rmse_m3", ".3g"),
    ("RMS z", "rms_z", ".2f"),
    ("held %", "coverage_percent", ".1f"),
    ("z narrow", "rms_z_narrow", ".2f"),
    ("z middle", "rms_z_middle", ".2f"),
    ("z wide", "rms_z_wide", ".2f"),
    ("score", "score_ratio", ".2f"),
    ("by height", "height_ratio", ".2f"),
    ("half width", "half_width_m3", ".3g"),
    ("/ earlier", "against", ".2f"),
)


def line_of(name: str, base: str, found: Scores) -> str:
    """Return a line of the markdown table; ! marks a criterion that is not met."""
    failed = [] if base in LEVELS else found.failures()
    cells = []
    for _, column, form in COLUMNS:
        value = getattr(found, column)
        text = "-" if value is None else format(value, form)
        cells.append(text + (" !" if column in failed else ""))
    return f"| {name} | {base} | " + " | ".join(cells) + " |"


def head() -> List[str]:
    """Return the head of the table."""
    names = ["class", "base", *(column for column, _, _ in COLUMNS)]
    return ["| " + " | ".join(names) + " |", "|---|---|" + "--:|" * len(COLUMNS)]


def verdict(table: Dict[Tuple[str, str], Scores], bases: Sequence[str]) -> Iterator[str]:
    """Yield one line for each base that says which criteria fail where."""
    for base in bases:
        if base in LEVELS:
            continue
        failed: Dict[str, List[str]] = {}
        for (name, of), found in table.items():
            for criterion in found.failures() if of == base else ():
                failed.setdefault(criterion, []).append(name)
        if not failed:
            yield f"{base}: all criteria are met"
        for criterion, names in failed.items():
            low, high = LIMITS[criterion]
            yield f"{base}: {criterion} not within {low:g} to {high:g}: {', '.join(names)}"


def reasons(rows: Sequence[Row]) -> Iterator[str]:
    """Yield what surveys were refused or warned of for, by class and base."""
    count: Counter[Tuple[str, str, str]] = Counter()
    for row in rows:
        told = [row["refused"]] if row["refused"] else row["warnings"]
        count.update((row["class"], row["base"], text) for text in told)
    for (name, base, text), number in sorted(count.items()):
        if base not in LEVELS:
            yield f"{name}, {base}: {number} x {text}"


# --- the run


def load(path: Optional[Path]) -> Dict[Tuple[str, int, str], Row]:
    """Return the rows of an earlier run by class, number and base."""
    if path is None:
        return {}
    rows = json.loads(path.read_text(encoding="utf-8"))["rows"]
    return {key_of(row): row for row in rows}


def coverage(given: argparse.Namespace) -> Dict[str, Any]:
    """Run the classes, print the table as it grows, and return all of it for JSON."""
    earlier = load(given.against)
    table: Dict[Tuple[str, str], Scores] = {}
    levels, rows = [], []
    print("\n".join(head()), flush=True)
    for name in given.classes:
        tasks = [(name, number, given.seed, given.bases) for number in range(given.surveys)]
        of_class = [row for some in run(rows_of, tasks, given.jobs) for row in some]
        rows += of_class
        for base in given.bases:
            some = [row for row in of_class if row["base"] == base]
            table[name, base] = scores_of(some, earlier)
            line = line_of(name, base, table[name, base])
            if base in LEVELS:
                levels.append(line)
            else:
                print(line, flush=True)
    if levels:
        print("\nLevels, against the same truth:\n")
        print("\n".join([*head(), *levels]))
    print("\n" + "\n".join(verdict(table, given.bases)))
    print("\nRefused and warned of:\n" + "\n".join(reasons(rows)))
    seconds = [row["seconds"] for row in rows[:: len(given.bases)]]
    print(f"\nseconds for a survey: median {np.median(seconds):.3f}, mean {np.mean(seconds):.3f}")
    lines = [
        {"class": name, "base": base, **asdict(found), "failures": list(found.failures())}
        for (name, base), found in table.items()
    ]
    return {"seed": given.seed, "surveys": given.surveys, "table": lines, "rows": rows}


def arguments(given: Optional[Sequence[str]] = None) -> argparse.Namespace:
    """Return the options."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--surveys", type=int, default=300, help="of each class (or wavelength)")
    parser.add_argument("--classes", nargs="+", choices=CLASSES, default=list(CLASSES))
    parser.add_argument("--bases", nargs="+", choices=BASES, default=list(BASES))
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--seed", type=int, default=0, help="of all random numbers")
    parser.add_argument("--json", type=Path, metavar="FILE", help="every survey and the table")
    parser.add_argument("--against", type=Path, metavar="FILE", help="JSON of an earlier run")
    parser.add_argument("--kriging", action="store_true", help="bases against kriging instead")
    return parser.parse_args(given)


def not_finite_as_null(value: Any) -> Any:
    """Return the same for JSON, which has no NaN."""
    if isinstance(value, dict):
        return {key: not_finite_as_null(item) for key, item in value.items()}
    if isinstance(value, list):
        return [not_finite_as_null(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def main() -> None:
    """Run from the command line."""
    given = arguments()
    made = known_kriging.compare(given) if given.kriging else coverage(given)
    if given.json:
        given.json.write_text(json.dumps(not_finite_as_null(made)), encoding="utf-8")


if __name__ == "__main__":
    main()
