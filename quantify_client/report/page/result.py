"""One result as HTML: headline, numbers with their inputs, budget, comparison, slices."""

from __future__ import annotations

import math
from typing import List, Optional, Sequence, Tuple

from ...types import AreaResult, Check, interval95
from ..wording.terms import VOLUME, Terms
from ..wording.units import NOTHING, Units, count, number, plus_minus
from ..wording.words import (
    base_words,
    changed_words,
    coverage_words,
    floor_words,
    gap_words,
    is_terrain,
    left_out_words,
    volumes,
)
from .markup import Markup, bar, details, facts, join, note, table, tag, tile

__all__ = ["result_body"]

SOURCES = {
    "coverage": "what no point shows: gaps, and what nobody saw",
    "scale": "how well the control knows the size of the whole cloud",
    "alignment": "how well it is known how the surveys lie on each other",
}


def result_body(
    result: AreaResult, units: Units, warnings: Sequence[str] = (), terms: Terms = VOLUME
) -> Tuple[Markup, Markup]:
    """Return the parts above the picture, with the warnings, and those below it."""
    above = [tag("dl", *_headline(result, units, terms), class_="headline"), note(warnings)]
    if result.body is not None:
        words = f"{floor_words(result.body, units)} {gap_words(result.body, units)}"
        above.append(tag("p", words, class_="stands"))
    columns = [tag("section", tag("h3", "Numbers and inputs"), facts(_facts(result, units, terms)))]
    if result.budget:
        columns.append(tag("section", tag("h3", "Error budget"), _budget(result, units)))
    below = [tag("div", *columns, class_="columns")]
    if result.bases:
        unit = units.volume
        head = ["Base", f"Net, {unit}", f"\u00b1 95 %, {unit}", f"Cut, {unit}", f"Fill, {unit}"]
        rows = [[base_words(row.base, units), *volumes(row, units)] for row in result.bases]
        below.append(details("Base surfaces compared", table(head, rows), opened=True))
    if result.slices:
        below.append(details(f"Slices ({len(result.slices)})", _slices(result, units, terms)))
    return join(*above), join(*below)


def _headline(result: AreaResult, units: Units, terms: Terms) -> List[Markup]:
    tiles = [_volume(terms.volume(result), result.volume_m3, result.std_m3, units)]
    if is_terrain(result):
        cut, fill = (result.cut_m3, result.cut_std_m3), (result.fill_m3, result.fill_std_m3)
        tiles.append(_volume(terms.cut_tile, *cut, units, kind="cut"))
        tiles.append(_volume(terms.fill_tile, *fill, units, kind="fill"))
    if result.mass_t is not None:
        of = f"of the {terms.cut.lower()}" if is_terrain(result) else "of the body"
        shown, unit = units.mass_text(result.mass_t, result.mass_std_t).rsplit("\u00a0", 1)
        spread = plus_minus(units.mass_half_width(result.mass_std_t))
        tiles.append(tile("Mass", shown, f"{spread} {unit}", f"{of}, \u00b1 95 %"))
    if result.body is not None:
        tiles += _body_tiles(result, units)
    return tiles


def _volume(
    name: str, value: Optional[float], std: Optional[float], units: Units, kind: str = ""
) -> Markup:
    """Return a volume with its interval; a cut or fill (`kind`) is never negative."""
    ends = interval95(value, std, least=0.0 if kind else -math.inf)
    interval = "no interval"
    if ends is not None:
        low, high = (units.volume_number(end, std) for end in ends)
        interval = f"95 %: {low} to {high} {units.volume}"
    shown = units.volume_number(value, std)
    spread = plus_minus(units.half_width(std))
    return tile(name, shown, f"{spread} {units.volume}", interval, kind)


def _body_tiles(result: AreaResult, units: Units) -> List[Markup]:
    surface, _, unit = units.area_text(result.surface_area_m2).partition("\u00a0")
    thick = units.length_text(result.slice_height_m)
    left_out = sum(result.points_left_out.values())
    elevations = f"elevation {_elevations(result, units)}"
    return [
        tile("Height", units.length_number(result.max_height_m), f" {units.length}", elevations),
        tile("Surface area", surface, f" {unit}", "of the body"),
        tile(
            "Slices",
            count(len(result.slices)),
            " ",
            "of uneven height" if thick == NOTHING else f"{thick} each",
        ),
        tile("Points used", count(result.points_used), " ", f"{count(left_out)} left out"),
    ]


def _elevations(result: AreaResult, units: Units) -> str:
    low, high = result.min_z_m, result.max_z_m
    height = 0.0 if low is None or high is None else high - low
    return f"{units.elevation_number(low, height)} to {units.elevation_text(high, height)}"


def _facts(result: AreaResult, units: Units, terms: Terms) -> List[Tuple[str, object]]:
    uneven = "uneven" if result.slices else NOTHING
    even = units.length_text(result.slice_height_m)
    rows: List[Tuple[str, object]] = [
        ("Area in plan", units.area_text(result.area_m2)),
        ("Surface area", units.area_text(result.surface_area_m2)),
        ("Perimeter", units.length_text(result.perimeter_m)),
        ("Lowest, highest", _elevations(result, units)),
        ("Greatest height", units.length_text(result.max_height_m)),
        (terms.base, NOTHING if result.base is None else base_words(result.base, units)),
        ("Cell", units.length_text(result.cell_m)),
        ("Coverage by points", coverage_words(result.coverage)),
        ("Points used", count(result.points_used)),
        ("Points left out", left_out_words(result)),
        ("Slice height", uneven if result.slice_height_m is None else even),
        ("Level of detection of a cell", units.length_text(result.level_of_detection_m)),
        (terms.changed, changed_words(result, units)),
    ]
    return rows + [
        (f"Check: {check.method}", _check(result, check, units)) for check in result.checks
    ]


def _check(result: AreaResult, check: Check, units: Units) -> Markup:
    words = f"differs by {units.volume_number(check.volume_m3 - result.volume_m3, result.std_m3)}"
    if check.margin_m3 > 0.0:
        words += f"; by chance up to {units.volume_number(check.margin_m3, result.std_m3)}"
    shown = units.volume_text(check.volume_m3, result.std_m3)
    return join(shown, " ", tag("span", f"({words})", class_="muted"))


def _budget(result: AreaResult, units: Units) -> Markup:
    """Return the error budget; bars show shares of the variance, since variances add up."""
    total = sum(item.std_m3**2 for item in result.budget)
    rows = []
    for item in sorted(result.budget, key=lambda item: -item.std_m3):
        share = item.std_m3**2 / total if total > 0 else 0.0
        words = SOURCES.get(item.source)
        source = join(item.source, *([" ", tag("small", words, class_="muted")] if words else []))
        shown = units.volume_number(item.std_m3, item.std_m3)
        rows.append([source, shown, bar(share, f"{share * 100:.0f}\u00a0%")])
    head = ["Source", f"1 \u03c3, {units.volume}", "Share of variance"]
    foot = ["Together", units.volume_number(result.std_m3, result.std_m3), ""]
    return table(head, rows, foot=foot)


def _slices(result: AreaResult, units: Units, terms: Terms) -> Markup:
    middle = terms.height if is_terrain(result) else "Elevation"
    head = [
        f"{middle}, {units.length}",
        f"Thickness, {units.length}",
        f"Area, {units.area}",
        f"Volume, {units.volume}",
        "Points",
    ]
    rows = [
        [
            number(piece.z_m * units.length_per_m, digits=5),
            number(piece.height_m * units.length_per_m),
            number(piece.area_m2 * units.area_per_m2, digits=5),
            units.volume_number(piece.volume_m3),
            count(piece.points),
        ]
        for piece in sorted(result.slices, key=lambda piece: -piece.z_m)
    ]
    return table(head, rows, left=0)
