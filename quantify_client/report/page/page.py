"""The report as one page that needs nothing else: no network, no other file.

A script only where a body can be turned, and the page's policy lets no other run.
"""

from __future__ import annotations

import string
from importlib import resources
from pathlib import Path
from typing import Any, Dict, Iterator, List, Mapping, Optional, Sequence, Set, Tuple, Union

from ...types import AreaFailure, AreaResult, Measurement, plain
from ..wording.kinds import in_units, kind_of, lines_of_kinds, said_of_results
from ..wording.scaling import factor_words
from ..wording.units import NOTHING, Units
from ..wording.words import coordinate_rows, crs_words, json_words, volume_word
from .markup import facts, figure, note, table, text
from .result import result_body
from .scaling import scale_section

__all__ = ["page_header", "page_top", "provenance_card", "render_html"]

Result = Union[AreaResult, AreaFailure]


def render_html(
    measurement: Measurement,
    units: Units,
    pictures: Mapping[int, Union[Path, bytes]],
    overview: Optional[Path] = None,
    scale_picture: Optional[Path] = None,
) -> Iterator[str]:
    """Yield the page in pieces, so that the pictures of many areas are not all in memory.

    `pictures` has the PNG (a file, or what is in one) of each result that has one, by its index.
    """
    views = sum(isinstance(r, AreaResult) and r.solid is not None for r in measurement.results)
    yield page_top(f"Volumes: {measurement.source}", views)
    yield _header(measurement, units)
    if measurement.scale is not None:
        yield scale_section(measurement.scale, units, scale_picture)
    shared, own = _said(measurement, units)
    if len(measurement.results) > 1:
        yield from _summary(measurement, units, overview, shared)
    for index, result in enumerate(measurement.results):
        view = ""
        if isinstance(result, AreaResult) and result.solid is not None:
            from .view import view_markup  # late: it draws, and most pages have nothing to turn

            view = view_markup(result, units, north=bool(measurement.crs), views=views)
        said = own.get(result.name, [])
        yield from _card(index, result, units, pictures.get(index), view, said)
    yield provenance_card(measurement.provenance, measurement.crs)
    if views:
        from .view import script

        yield f"<script>{script()}</script>\n"
    yield "</body>\n</html>\n"


def _said(measurement: Measurement, units: Units) -> Tuple[List[str], Dict[str, List[str]]]:
    """Return one line for each kind of warning of several areas, and the others of each area."""
    said = said_of_results(measurement, units)
    areas: Dict[str, Set[str]] = {}
    for name, sentence in said:
        areas.setdefault(kind_of(sentence), set()).add(name)
    shared = [row for row in said if len(areas[kind_of(row[1])]) > 1]
    own: Dict[str, List[str]] = {}
    for name, sentence in said:
        if len(areas[kind_of(sentence)]) == 1:
            own.setdefault(name, []).append(sentence)
    return lines_of_kinds(shared, named=True), own


def page_top(title: str, views: int = 0) -> str:
    """Return all up to the page's body; the script's policy only where a body can be turned."""
    folder = resources.files(__package__)
    template = string.Template((folder / "report.html").read_text("utf-8"))
    style = (folder / "report.css").read_text("utf-8")
    scripts = ""
    if views:
        from .view import script_policy

        style += (folder / "view.css").read_text("utf-8")
        scripts = f"; script-src {script_policy()}"
    return template.substitute(title=text(title), style=style, scripts=scripts)


def page_header(
    kicker: str, title: str, chips: Sequence[Tuple[str, str]], warnings: Sequence[str]
) -> str:
    """Return a page's heading; `chips` are names and markup values."""
    items = "".join(f"<li><span>{name}</span><b>{value}</b></li>" for name, value in chips)
    return (
        f'<header><p class="kicker">{text(kicker)}</p>'
        f'<h1>{text(title)}</h1><ul class="chips">{items}</ul></header>'
        f"{note(warnings)}\n"
    )


def _header(measurement: Measurement, units: Units) -> str:
    factor, scale = measurement.grid_scale_factor, measurement.scale
    chips = [
        ("CRS", text(crs_words(measurement.crs))),
        ("Units", f"{text(units.length)}, {text(units.area)}, {text(units.volume)}"),
        ("Shape", text(measurement.shape)),
        ("Method", text(measurement.method)),
        ("Grid scale factor", "not applied" if factor is None else f"{factor:.6f}"),
    ]
    if scale is not None:
        chips.append(("Scaled by", text(factor_words(scale))))
    told = [] if scale is None else list(scale.warnings)  # in the card of the scale
    warnings = [in_units(w, units) for w in measurement.warnings if w not in told]
    return page_header("Volume report", measurement.source, chips, warnings)


def _summary(
    measurement: Measurement, units: Units, overview: Optional[Path], shared: Sequence[str]
) -> Iterator[str]:
    """Yield the table of all areas, each a link to its own part, and what several share."""
    unit = text(units.volume)
    if any(isinstance(r, AreaResult) and r.solid is not None for r in measurement.results):
        rows = [_body_row(i, result, units) for i, result in enumerate(measurement.results)]
        head = ["Body", f"Volume, {unit}", f"\u00b1 95 %, {unit}", "Height", "Surface area"]
        listed = table(head, rows) + note(shared)
        yield f'<section class="card"><h2>All bodies</h2>{listed}</section>\n'
        return
    rows = [_summary_row(i, result, units) for i, result in enumerate(measurement.results)]
    head = ["Area", f"Net, {unit}", f"\u00b1 95 %, {unit}", f"Cut, {unit}", f"Fill, {unit}"]
    if all(isinstance(r, AreaFailure) or r.cut_m3 is None for r in measurement.results):
        head[1] = f"Volume, {unit}"
    yield f'<section class="card"><h2>All areas</h2>{table(head, rows)}{note(shared)}'
    if overview is not None:
        yield from figure(overview, "Plan of all areas")
    yield "</section>\n"


def _summary_row(index: int, result: Result, units: Units) -> List[str]:
    link = f'<a href="#area-{index + 1}">{text(result.name)}</a>'
    if isinstance(result, AreaFailure):
        failed = '<span class="error">not measured</span>'
        return [link, failed, NOTHING, NOTHING, NOTHING]
    return [
        link,
        units.volume_number(result.volume_m3, result.std_m3),
        units.half_width(result.std_m3),
        units.volume_number(result.cut_m3, result.cut_std_m3),
        units.volume_number(result.fill_m3, result.fill_std_m3),
    ]


def _body_row(index: int, result: Result, units: Units) -> List[str]:
    row = _summary_row(index, result, units)[:3]
    if isinstance(result, AreaFailure):
        return [*row, NOTHING, NOTHING]
    surface = units.area_text(result.surface_area_m2)
    return [*row, units.length_text(result.max_height_m), surface]


def _card(
    index: int,
    result: Result,
    units: Units,
    picture: Optional[Union[Path, bytes]],
    view: str,
    warnings: Sequence[str],
) -> Iterator[str]:
    failed = isinstance(result, AreaFailure)
    yield f'<article class="card{" failed" if failed else ""}" id="area-{index + 1}">'
    yield f"<h2>{text(result.name)}</h2>"
    if isinstance(result, AreaFailure):
        yield f"<p>Not measured: {text(in_units(result.error, units))}</p>"
    else:
        top, rest = result_body(result, units, warnings)
        yield top
        if picture is not None:
            yield from figure(picture, f"{volume_word(result)} of {result.name}: views")
        yield view
        yield rest
    yield "</article>\n"


def provenance_card(provenance: Mapping[str, Any], crs: Optional[str]) -> str:
    """Return where the numbers come from, as in the JSON document."""
    rows = [
        (key, f"<code>{text(json_words(value))}</code>")
        for key, value in plain(provenance).items()
        if key != "coordinates"
    ]
    of_parts = coordinate_rows(provenance)
    if crs and "CRS" not in dict(of_parts):
        rows.append(("CRS", f"<code>{text(crs)}</code>"))
    rows += [(part, text(said)) for part, said in of_parts]
    return f'<footer class="card"><h3>Provenance</h3>{facts(rows)}</footer>\n'
