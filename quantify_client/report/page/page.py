"""The reports as pages that need nothing else: no network, no other file.

A script only where a body can be turned, and the page's policy lets no other run.
"""

from __future__ import annotations

import html
import json
import string
from collections import Counter
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any, Iterator, List, Mapping, Optional, Sequence, Tuple, Union

from ...types import AreaFailure, AreaResult, Measurement, Scaled, plain
from ..wording.alignment import earlier_survey, others_than_moved, spread_words
from ..wording.notices import in_units, kind_of, lines_of_kinds, warnings_of_results
from ..wording.scaling import factor_words
from ..wording.terms import terms_of
from ..wording.units import NOTHING, Units
from ..wording.words import coordinate_rows, crs_words, printable, volumes
from .change import alignment_card, series_card
from .markup import Markup, facts, figure, join, note, table, tag
from .result import result_body
from .scaling import scale_section
from .stage import stage_section

__all__ = ["Pictures", "render_html", "render_scale_html"]

Result = Union[AreaResult, AreaFailure]
Picture = Union[Path, bytes]
END = "</body>\n</html>\n"


@dataclass(frozen=True)
class Pictures:
    """The PNGs of a page, each a file or what is in one; what is None has none.

    Attributes
    ----------
    areas, stages : of results, by their index.
    """

    areas: Mapping[int, Picture] = field(default_factory=dict)
    stages: Mapping[int, Picture] = field(default_factory=dict)
    overview: Optional[Picture] = None
    scale: Optional[Picture] = None
    alignment: Optional[Picture] = None
    series: Optional[Picture] = None


def render_html(measurement: Measurement, units: Units, pictures: Pictures) -> Iterator[str]:
    """Yield the page of a measurement in pieces, which saves memory where areas are many."""
    terms = terms_of(measurement)
    views = sum(isinstance(r, AreaResult) and r.body is not None for r in measurement.results)
    scale = measurement.scale
    of_scale = () if scale is None else scale.warnings  # shown in the card of the scale
    told = [w for w in others_than_moved(measurement) if w not in of_scale]
    warnings = [in_units(w, units) for w in told]
    yield _top(f"{terms.title}: {measurement.source}", views)
    yield _header(terms.report, measurement.source, _chips(measurement, units), warnings)
    if scale is not None:
        yield scale_section(scale, units, pictures.scale)
    of_areas = warnings_of_results(measurement, units)
    own = _own(of_areas)
    if len(measurement.results) > 1:
        lines = lines_of_kinds(of_areas, named=True)
        yield _summary(measurement, units, pictures.overview, lines, bodies=views > 0)
    if measurement.series:
        yield series_card(measurement, units, pictures.series)
    yield from _cards(measurement, units, pictures, own, views)
    if measurement.alignment is not None:
        yield alignment_card(measurement.alignment, units, pictures.alignment)
    yield _provenance(measurement.provenance, measurement.crs)
    if views:
        from .view import script

        yield f"<script>{script()}</script>\n"
    yield END


def _cards(
    measurement: Measurement,
    units: Units,
    pictures: Pictures,
    own: Sequence[Tuple[str, str]],
    views: int,
) -> Iterator[str]:
    """Yield the card of each result; `own` are names of areas and warnings that only they have."""
    terms = terms_of(measurement)
    for index, result in enumerate(measurement.results):
        if isinstance(result, AreaFailure):
            reason = join("Not measured: ", in_units(result.error, units))
            yield _card(index, result, tag("p", reason), kind="card failed")
            continue
        view = Markup()
        if result.body is not None:
            from .view import view_markup  # late: it draws, and most pages have nothing to turn

            view = view_markup(result, units, north=bool(measurement.crs), views=views)
        said = [text for name, text in own if name == result.name]
        above, below = result_body(result, units, said, terms)
        words = f"{terms.volume(result)} of {result.name}: views"
        drawn = figure(pictures.areas.get(index), words)
        stage = stage_section(result, units, pictures.stages.get(index))
        yield _card(index, result, above, drawn, view, stage, below)


def render_scale_html(scaled: Scaled, units: Units, picture: bytes) -> Iterator[str]:
    """Yield the page of a scaling alone, in pieces; `picture` is a PNG."""
    scaling = scaled.scaling
    chips = [
        ("CRS", crs_words(scaling.target_crs)),
        ("Units", units.length),
        ("Mode", scaling.mode),
    ]
    if scaled.out is not None:
        chips.append(("Scaled cloud", scaled.out))
    # Those of the scaling itself are in its card.
    others = [warning for warning in scaled.warnings if warning not in scaling.warnings]
    yield _top(f"Scale: {scaled.source}")
    yield _header("Scale report", scaled.source, chips, others)
    yield scale_section(scaling, units, picture)
    yield _provenance(scaled.provenance, scaling.target_crs)
    yield END


def _own(warnings: Sequence[Tuple[str, str]]) -> List[Tuple[str, str]]:
    """Return the warnings whose kind only one area has, each with that area's name."""
    areas = Counter(kind for _, kind in {(name, kind_of(text)) for name, text in warnings})
    return [(name, text) for name, text in warnings if areas[kind_of(text)] == 1]


def _top(title: str, views: int = 0) -> str:
    """Return everything before the contents; scripts are allowed only for views of bodies."""
    folder = resources.files(__package__)
    template = string.Template((folder / "report.html").read_text("utf-8"))
    style = (folder / "report.css").read_text("utf-8")
    scripts = ""
    if views:
        from .view import script_policy

        style += (folder / "view.css").read_text("utf-8")
        scripts = f"; script-src {script_policy()}"
    return template.substitute(title=html.escape(printable(title)), style=style, scripts=scripts)


def _header(
    kicker: str, title: str, chips: Sequence[Tuple[str, str]], warnings: Sequence[str]
) -> str:
    """Return a page's heading; `chips` are names and values."""
    items = [tag("li", tag("span", name), tag("b", value)) for name, value in chips]
    heading = tag("p", kicker, class_="kicker"), tag("h1", title)
    return join(tag("header", *heading, tag("ul", *items, class_="chips")), note(warnings)) + "\n"


def _chips(measurement: Measurement, units: Units) -> List[Tuple[str, str]]:
    factor, before = measurement.grid_scale_factor, earlier_survey(measurement)
    chips = [] if before is None else [("Before", before)]
    chips += [
        ("CRS", crs_words(measurement.crs)),
        ("Units", f"{units.length}, {units.area}, {units.volume}"),
        ("Shape", measurement.shape),
        ("Method", measurement.method),
        ("Grid scale factor", "not applied" if factor is None else f"{factor:.6f}"),
    ]
    if measurement.alignment is not None:
        left = spread_words(measurement.alignment.stable_rms_m, units)
        chips.append(("Surveys differ by", f"{left} on stable ground"))
    if measurement.scale is not None:
        chips.append(("Scaled by", factor_words(measurement.scale)))
    return chips


def _summary(
    measurement: Measurement,
    units: Units,
    overview: Optional[Picture],
    warnings: Sequence[str],
    *,
    bodies: bool,
) -> str:
    """Return the table of all areas, with links to them, and all their warnings."""
    unit, terms = units.volume, terms_of(measurement)
    title, head = "All areas", ["Area", terms.net, f"{terms.cut}, {unit}", f"{terms.fill}, {unit}"]
    if bodies:
        title, head = "All bodies", ["Body", "Volume", "Height", "Surface area"]
    elif all(isinstance(r, AreaFailure) or r.cut_m3 is None for r in measurement.results):
        head[1] = "Volume"
    head[1:2] = [f"{head[1]}, {unit}", f"\u00b1 95 %, {unit}"]
    rows: List[List[str]] = []
    for index, result in enumerate(measurement.results):
        link = tag("a", result.name, href=f"#area-{index + 1}")
        if isinstance(result, AreaFailure):
            cells = [tag("span", "not measured", class_="error"), *[NOTHING] * 3]
        else:
            cells = volumes(result, units)
            if bodies:
                height = units.length_text(result.max_height_m)
                cells[2:] = [height, units.area_text(result.surface_area_m2)]
        rows.append([link, *cells])
    drawn = Markup() if bodies else figure(overview, "Plan of all areas")
    parts = (tag("h2", title), table(head, rows), note(warnings), drawn)
    return tag("section", *parts, class_="card") + "\n"


def _card(index: int, result: Result, *parts: Markup, kind: str = "card") -> str:
    title = tag("h2", result.name)
    return tag("article", title, *parts, class_=kind, id=f"area-{index + 1}") + "\n"


def _provenance(provenance: Mapping[str, Any], crs: Optional[str]) -> str:
    """Return where the numbers come from, as in the JSON document."""
    rows: List[Tuple[str, object]] = []
    for key, value in plain(provenance).items():
        if key != "coordinates":
            told = value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)
            rows.append((key, tag("code", told)))
    of_parts = coordinate_rows(provenance)
    if crs and "CRS" not in dict(of_parts):
        rows.append(("CRS", tag("code", crs)))
    title = tag("h3", "Provenance")
    return tag("footer", title, facts([*rows, *of_parts]), class_="card") + "\n"
