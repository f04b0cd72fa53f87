"""The report as one page that needs nothing else: no network, no other file.

A script only where a body can be turned, and the page's policy lets no other run.
"""

from __future__ import annotations

import base64
import string
from importlib import resources
from pathlib import Path
from typing import Iterator, List, Mapping, Optional, Tuple, Union

from ..types import AreaFailure, AreaResult, Measurement
from .jsonout import to_json
from .markup import details, facts, note, table, text
from .result_markup import result_body
from .units import NOTHING, Units, number
from .view import script, script_policy, view_markup
from .words import crs_words, json_words, volume_word

__all__ = ["render_html"]

Result = Union[AreaResult, AreaFailure]


def render_html(
    measurement: Measurement,
    units: Units,
    pictures: Mapping[int, Path],
    overview: Optional[Path] = None,
) -> Iterator[str]:
    """Yield the page in pieces, so that the pictures of many areas are not all in memory.

    `pictures` has the PNG file of each result that has one, by its index.
    """
    views = sum(isinstance(r, AreaResult) and r.solid is not None for r in measurement.results)
    yield _top(measurement, views)
    yield _header(measurement, units)
    if len(measurement.results) > 1:
        yield from _summary(measurement, units, overview)
    for index, result in enumerate(measurement.results):
        view = ""
        if isinstance(result, AreaResult):
            view = view_markup(result, units, north=bool(measurement.crs), views=views)
        yield from _card(index, result, units, pictures.get(index), view)
    yield _provenance(measurement)
    if views:
        yield f"<script>{script()}</script>\n"
    yield "</body>\n</html>\n"


def _top(measurement: Measurement, views: int) -> str:
    folder = resources.files(__package__)
    template = string.Template((folder / "report.html").read_text("utf-8"))
    style = (folder / "report.css").read_text("utf-8")
    scripts = ""
    if views:
        style += (folder / "view.css").read_text("utf-8")
        scripts = f"; script-src {script_policy()}"
    title = f"Volumes: {text(measurement.source)}"
    return template.substitute(title=title, style=style, scripts=scripts)


def _header(measurement: Measurement, units: Units) -> str:
    factor = measurement.grid_scale_factor
    chips = [
        ("CRS", text(crs_words(measurement.crs))),
        ("Units", f"{text(units.length)}, {text(units.area)}, {text(units.volume)}"),
        ("Shape", text(measurement.shape)),
        ("Method", text(measurement.method)),
        ("Grid scale factor", "not applied" if factor is None else f"{factor:.6f}"),
        *_scale_chip(measurement),
    ]
    items = "".join(f"<li><span>{name}</span><b>{value}</b></li>" for name, value in chips)
    return (
        '<header><p class="kicker">Volume report</p>'
        f'<h1>{text(measurement.source)}</h1><ul class="chips">{items}</ul></header>'
        f"{note(list(measurement.warnings))}\n"
    )


def _scale_chip(measurement: Measurement) -> List[Tuple[str, str]]:
    factor = (measurement.scale or {}).get("factor")
    if not isinstance(factor, (int, float)):
        return []
    std = (measurement.scale or {}).get("std")
    spread = f" \u00b1 {number(std, std=std)}" if isinstance(std, (int, float)) else ""
    return [("Scaled by", f"{number(factor, std=std, digits=7)}{spread}")]


def _summary(measurement: Measurement, units: Units, overview: Optional[Path]) -> Iterator[str]:
    """Yield the table of all areas, each a link to its own part."""
    unit = text(units.volume)
    if any(isinstance(r, AreaResult) and r.solid is not None for r in measurement.results):
        rows = [_body_row(i, result, units) for i, result in enumerate(measurement.results)]
        head = ["Body", f"Volume, {unit}", f"\u00b1 95 %, {unit}", "Height", "Surface area"]
        yield f'<section class="card"><h2>All bodies</h2>{table(head, rows)}</section>\n'
        return
    rows = [_summary_row(i, result, units) for i, result in enumerate(measurement.results)]
    head = ["Area", f"Net, {unit}", f"\u00b1 95 %, {unit}", f"Cut, {unit}", f"Fill, {unit}"]
    if all(isinstance(r, AreaFailure) or r.cut_m3 is None for r in measurement.results):
        head[1] = f"Volume, {unit}"
    yield f'<section class="card"><h2>All areas</h2>{table(head, rows)}'
    if overview is not None:
        yield from _picture(overview, "Plan of all areas")
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
    index: int, result: Result, units: Units, picture: Optional[Path], view: str
) -> Iterator[str]:
    failed = isinstance(result, AreaFailure)
    yield f'<article class="card{" failed" if failed else ""}" id="area-{index + 1}">'
    yield f"<h2>{text(result.name)}</h2>"
    if isinstance(result, AreaFailure):
        yield f"<p>Not measured: {text(result.error)}</p>"
    else:
        top, rest = result_body(result, units)
        yield top
        if picture is not None:
            yield from _picture(picture, f"{volume_word(result)} of {result.name}: views")
        yield view
        yield rest
    yield "</article>\n"


def _picture(path: Path, words: str) -> Iterator[str]:
    yield f'<figure><img alt="{text(words)}" src="data:image/png;base64,'
    yield base64.b64encode(path.read_bytes()).decode("ascii")
    yield '"></figure>'


def _provenance(measurement: Measurement) -> str:
    """Return where the numbers come from, as in report.json."""
    document = to_json(measurement)
    rows = [
        (key, f"<code>{text(json_words(v))}</code>") for key, v in document["provenance"].items()
    ]
    if measurement.crs:
        rows.append(("crs", f"<code>{text(measurement.crs)}</code>"))
    parts = ['<footer class="card"><h3>Provenance</h3>', facts(rows)]
    if document["scale"] is not None:
        code = f"<pre>{text(json_words(document['scale']))}</pre>"
        parts.append(details("Scaling", code))
    return "".join([*parts, "</footer>\n"])
