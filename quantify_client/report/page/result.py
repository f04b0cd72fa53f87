"""One result as HTML: headline, numbers with their inputs, budget, comparison, slices."""

from __future__ import annotations

import math
from typing import List, Optional, Sequence, Tuple

from ...types import AreaResult, Check, interval95
from ..wording.body import floor_words, gap_words
from ..wording.units import NOTHING, Units, count, number
from ..wording.words import base_words, budget_words, coverage_words, is_terrain, volume_word
from .markup import bar, details, facts, note, table, text

__all__ = ["result_body"]


def result_body(result: AreaResult, units: Units, warnings: Sequence[str] = ()) -> Tuple[str, str]:
    """Return what goes above the picture, the warnings among it, and what goes below it."""
    below = [
        '<div class="columns">',
        _section("Numbers and inputs", facts(_facts(result, units))),
        _section("Error budget", _budget(result, units)),
        "</div>",
    ]
    if result.bases:
        below.append(details("Base surfaces compared", _bases(result, units), opened=True))
    if result.slices:
        below.append(details(f"Slices ({len(result.slices)})", _slices(result, units)))
    above = [_headline(result, units), note(list(warnings))]
    if result.solid is not None:
        words = f"{floor_words(result.solid, units)} {gap_words(result.solid, units)}"
        above.append(f'<p class="stands">{text(words)}</p>')
    return "".join(above), "".join(below)


def _section(title: str, markup: str) -> str:
    return f"<section><h3>{text(title)}</h3>{markup}</section>" if markup else ""


def _headline(result: AreaResult, units: Units) -> str:
    terrain = is_terrain(result)
    tiles = [_tile("", volume_word(result), result.volume_m3, result.std_m3, units)]
    if terrain:
        tiles += [
            _tile("cut", "Cut, above the base", result.cut_m3, result.cut_std_m3, units),
            _tile("fill", "Fill, below the base", result.fill_m3, result.fill_std_m3, units),
        ]
    if result.mass_t is not None:
        tiles.append(_mass_tile(result, units))
    if result.solid is not None:
        tiles += _body_tiles(result, units)
    return f'<dl class="headline">{"".join(tiles)}</dl>'


def _tile(kind: str, name: str, value: Optional[float], std: Optional[float], units: Units) -> str:
    spread = units.half_width(std)
    plus = "" if spread == NOTHING else f" \u00b1 {spread}"
    ends = interval95(value, std, least=0.0 if kind else -math.inf)
    interval = "no interval"
    if ends is not None:
        low, high = (units.volume_number(end, std) for end in ends)
        interval = f"95 %: {low} to {high} {text(units.volume)}"
    return (
        f'<div class="{kind}"><dt>{text(name)}</dt><dd><div class="big">'
        f"{units.volume_number(value, std)}<small>{plus} {text(units.volume)}</small></div>"
        f'<div class="interval">{interval}</div></dd></div>'
    )


def _mass_tile(result: AreaResult, units: Units) -> str:
    spread = units.mass_half_width(result.mass_std_t)
    plus = "" if spread == NOTHING else f" \u00b1 {spread}"
    shown, unit = units.mass_text(result.mass_t, result.mass_std_t).rsplit("\u00a0", 1)
    of = "of the cut" if is_terrain(result) else "of the body"
    return (
        f'<div><dt>Mass</dt><dd><div class="big">{shown}<small>{plus} {text(unit)}</small></div>'
        f'<div class="interval">{of}, \u00b1 95 %</div></dd></div>'
    )


def _body_tiles(result: AreaResult, units: Units) -> List[str]:
    height = units.length_number(result.max_height_m)
    surface, _, unit = units.area_text(result.surface_area_m2).partition("\u00a0")
    low, high = units.length_number(result.min_z_m), units.length_text(result.max_z_m)
    thick = units.length_text(result.slice_height_m)
    left_out = sum(result.points_left_out.values())
    return [
        _plain_tile("Height", height, units.length, f"elevation {low} to {high}"),
        _plain_tile("Surface area", surface, unit, "of the body"),
        _plain_tile(
            "Slices",
            count(len(result.slices)),
            "",
            "of uneven height" if thick == NOTHING else f"{thick} each",
        ),
        _plain_tile("Points used", count(result.points_used), "", f"{count(left_out)} left out"),
    ]


def _plain_tile(name: str, value: str, unit: str, below: str) -> str:
    return (
        f'<div><dt>{text(name)}</dt><dd><div class="big">{text(value)}'
        f"<small> {text(unit)}</small></div>"
        f'<div class="interval">{text(below)}</div></dd></div>'
    )


def _facts(result: AreaResult, units: Units) -> List[Tuple[str, str]]:
    left_out = [f"{count(n)} {text(why)}" for why, n in result.points_left_out.items()]
    rows = [
        ("Area in plan", units.area_text(result.area_m2)),
        ("Surface area", units.area_text(result.surface_area_m2)),
        ("Perimeter", units.length_text(result.perimeter_m)),
        (
            "Lowest, highest",
            f"{units.length_number(result.min_z_m)} to {units.length_text(result.max_z_m)}",
        ),
        ("Greatest height", units.length_text(result.max_height_m)),
        ("Base", text(base_words(result.base, units)) if result.base is not None else NOTHING),
        ("Cell", units.length_text(result.cell_m)),
        ("Coverage by points", coverage_words(result.coverage)),
        ("Points used", count(result.points_used)),
        ("Points left out", ", ".join(left_out) or "none"),
        ("Slice height", _slice_height(result, units)),
    ]
    rows += [(f"Check: {c.method}", _check(result, c, units)) for c in result.checks]
    return [row for row in rows if row[1] != NOTHING]


def _slice_height(result: AreaResult, units: Units) -> str:
    if result.slice_height_m is not None:
        return units.length_text(result.slice_height_m)
    return "uneven" if result.slices else NOTHING


def _check(result: AreaResult, check: Check, units: Units) -> str:
    difference = units.volume_number(check.volume_m3 - result.volume_m3, result.std_m3)
    shown = text(units.volume_text(check.volume_m3, result.std_m3))
    chance = ""
    if check.margin_m3 > 0.0:
        chance = f"; by chance up to {units.volume_number(check.margin_m3, result.std_m3)}"
    return f'{shown} <span class="muted">(differs by {difference}{chance})</span>'


def _budget(result: AreaResult, units: Units) -> str:
    """Return the budget; bars show shares of the variance, since that is what adds up."""
    if not result.budget:
        return ""
    total = sum(item.std_m3**2 for item in result.budget)
    rows = []
    for item in sorted(result.budget, key=lambda item: -item.std_m3):
        share = item.std_m3**2 / total if total > 0 else 0.0
        shown = units.volume_number(item.std_m3, item.std_m3)
        percent = f'<span class="share">{share * 100:.0f}\u00a0%</span>'
        rows.append([_source(item.source), shown, f"{bar(share)} {percent}"])
    head = ["Source", f"1 \u03c3, {text(units.volume)}", "Share of variance"]
    foot = ["Together", units.volume_number(result.std_m3, result.std_m3), ""]
    return table(head, rows, foot=foot)


def _source(source: str) -> str:
    words = budget_words(source)
    return text(source) + (f' <small class="muted">{text(words)}</small>' if words else "")


def _bases(result: AreaResult, units: Units) -> str:
    rows = [
        [
            text(base_words(row.base, units)),
            units.volume_number(row.volume_m3, row.std_m3),
            units.half_width(row.std_m3),
            units.volume_number(row.cut_m3, row.cut_std_m3),
            units.volume_number(row.fill_m3, row.fill_std_m3),
        ]
        for row in result.bases
    ]
    unit = text(units.volume)
    return table(
        ["Base", f"Net, {unit}", f"\u00b1 95 %, {unit}", f"Cut, {unit}", f"Fill, {unit}"], rows
    )


def _slices(result: AreaResult, units: Units) -> str:
    middle = "Above base" if is_terrain(result) else "Elevation"
    head = [
        f"{middle}, {text(units.length)}",
        f"Thickness, {text(units.length)}",
        f"Area, {text(units.area)}",
        f"Volume, {text(units.volume)}",
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
