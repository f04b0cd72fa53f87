"""The view of a body that can be turned on the page: its elements and its data."""

from __future__ import annotations

import base64
import hashlib
import json
from importlib import resources
from typing import Any, Dict, Iterable, List, Sequence

import numpy as np

from ...types import AreaResult, Body, FloatArray
from ..figures.body import Section, evenly_spaced, sections_of
from ..figures.look import nice_step
from ..wording.units import Units, count
from ..wording.words import gap_width, is_terrain
from .markup import Markup, join, tag

__all__ = ["script", "script_policy", "view_markup"]

MOST_POINTS = {"points": 20_000, "ground": 4_000, "outliers": 1_500}
AT_FULL = 4  # so many views of a page have that many points; more of them share
MOST_SECTIONS = 64
MOST_CORNERS = 30_000  # of all outlines together
MOST_GAPS = 60
LARGEST = 32767  # of int16
GRID_CELLS = 6  # along the longer side of a body, at least
# Views from fixed places: azimuth and elevation in degrees.
TURNS = {"From above": "0,90", "Front": "0,0", "Side": "90,0", "First view": ""}
LAYERS = (
    ("points", "Points of the body"),
    ("outlines", "Sections"),
    ("gaps", "Closed gaps"),
    ("ground", "Ground points"),
    ("outliers", "Outliers"),
)


def script() -> str:
    """Return the script of the page, one for all views."""
    return (resources.files(__package__) / "view.js").read_text("utf-8")


def script_policy() -> str:
    """Return the source expression that lets this script run on the page and no other."""
    digest = hashlib.sha256(script().encode("utf-8")).digest()
    return f"'sha256-{base64.b64encode(digest).decode('ascii')}'"


def view_markup(result: AreaResult, units: Units, *, north: bool, views: int = 1) -> Markup:
    """Return the canvas, its legend and its data; shown only where the script runs.

    `north`: y points north, so that the view may say so. `views` of the page share the points.
    """
    body = result.body
    if body is None or is_terrain(result):
        return Markup()
    sections = evenly_spaced(sections_of(result, body), MOST_SECTIONS)
    data = _view_data(result, body, sections, units, min(1.0, AT_FULL / views))
    if data is None:
        return Markup()
    written = json.dumps({**data, "north": north}, separators=(",", ":"), allow_nan=False)
    # Nothing in the data can end it: no letter of it starts a tag.
    written = written.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e")
    low, high = (
        units.elevation_text(z, result.max_z_m - result.min_z_m)
        for z in (result.min_z_m, result.max_z_m)
    )
    words = (
        f"{result.name} in three dimensions: {len(sections)} of its section outlines between "
        f"elevation {low} and {high}, "
        f"points of its surface, closed gaps: {len(body.gaps)}. "
        "The same sections are in the picture, the numbers in the tables."
    )
    hint = (
        "Drag or arrow keys turn, wheel or + and \u2212 zoom, Shift and drag move; double click or "
        f"0 brings back the first view. Grid {data['gridText']}."
    )
    without = "A view that can be turned needs JavaScript; the picture shows the same sections."
    buttons = [
        Markup(f'<button type="button" data-turn="{to}">{name}</button>')
        for name, to in TURNS.items()
    ]
    legend = _legend(data, result, body, len(sections))
    view = tag(
        "section",
        tag("h3", "Turn the body"),
        tag("canvas", words, tabindex="0", role="img", aria_label=words),
        tag("div", legend, tag("div", *buttons, class_="turns"), class_="bar-of-view"),
        tag("p", hint, class_="hint"),
        tag("script", Markup(written), type="application/json"),
        class_="view",
        hidden=True,
    )
    return join(tag("noscript", tag("p", without, class_="muted")), view)


def _legend(data: Dict[str, Any], result: AreaResult, body: Body, sections: int) -> Markup:
    """Return a check box for each kind that the view has."""
    shown = {key: layer["count"] for key, layer in data["layers"].items()}
    shown.update(outlines=sections, gaps=len(data["gaps"]))
    totals = {
        "points": result.points_used,
        "ground": body.floor.points if body.floor else 0,
        "outlines": len(result.slices),
        "gaps": len(body.gaps),
    }
    boxes = []
    for key, words in LAYERS:
        number, total = shown.get(key, 0), totals.get(key, 0)
        if number:
            how = f"{count(number)} of {count(total)}" if total > number else count(number)
            box = Markup(f'<input type="checkbox" data-layer="{key}" checked>')
            dot = tag("i", class_=f"dot {key}")
            boxes.append(tag("label", box, dot, words, " ", tag("small", how)))
    return tag("div", *boxes, class_="legend", role="group", aria_label="What is shown")


def _view_data(
    result: AreaResult, body: Body, sections: Sequence[Section], units: Units, share: float
) -> Any:
    """Return the data that the script draws, or None when there is nothing."""
    points = {
        key: _some(getattr(body, key), int(most * share)) for key, most in MOST_POINTS.items()
    }
    corners = [np.column_stack([r, np.full(len(r), s.z)]) for s in sections for r in s.rings]
    drawn = np.vstack([points["points"], *corners])
    if not len(drawn):
        return None
    low, high = drawn.min(axis=0), drawn.max(axis=0)
    if body.floor is not None:
        low[2] = min(low[2], 0.0)
    wide = max(float(np.max(high[:2] - low[:2])), 1e-6 * max(float(np.ptp(drawn[:, 2])), 1.0))
    shown_step = nice_step(wide * units.length_per_m / GRID_CELLS)
    return {
        "low": _rounded(low),
        "high": _rounded(high),
        "layers": {
            key: {"count": len(xyz), **_packed(xyz)} for key, xyz in points.items() if len(xyz)
        },
        "outlines": _outlines(sections, share),
        # x, y, z, width and what is written at the gap
        "gaps": [
            [*_rounded((gap.x, gap.y, gap.z, gap.width)), gap_width(gap, units)]
            for gap in body.gaps[:MOST_GAPS]
        ],
        "grid": shown_step / units.length_per_m,
        "gridText": f"{shown_step:g} {units.length}",
        "tall": _rounded([z - body.origin[2] for z in (result.min_z_m, result.max_z_m)]),
        "heightText": units.length_text(result.max_z_m - result.min_z_m),
    }


def _rounded(values: Iterable[float]) -> List[float]:
    """Return numbers rounded to seven digits, more than a picture can show."""
    return [float(f"{value:.7g}") for value in values]


def _some(points: Any, at_most: int) -> FloatArray:
    """Return at most so many of the points, the same ones each time."""
    known: FloatArray = np.asarray(points, dtype=np.float64).reshape(-1, 3)
    rows = np.flatnonzero(np.isfinite(known).all(axis=1))
    if len(rows) > at_most:
        rows = np.sort(np.random.default_rng(0).choice(rows, at_most, replace=False))
    return np.take(known, rows, axis=0)


def _packed(values: FloatArray) -> Dict[str, Any]:
    """Return columns of numbers as whole steps of 16 bits from their middle, in base64."""
    middle = (values.min(axis=0) + values.max(axis=0)) / 2
    # Rounded before use: both sides then work with the same numbers.
    middle = np.asarray(_rounded(middle), dtype=np.float64)
    step = _rounded([max(float(np.abs(values - middle).max()) / LARGEST, 1e-12) * (1 + 1e-6)])[0]
    whole = np.rint((values - middle) / step).astype("<i2")
    data = base64.b64encode(whole.tobytes()).decode("ascii")
    return {"middle": middle.tolist(), "step": step, "data": data}


def _outlines(sections: Sequence[Section], share: float) -> Dict[str, Any]:
    """Return heights, the sections' rings as (section, number of corners), and all corners."""
    rings = [(i, ring) for i, section in enumerate(sections) for ring in section.rings]
    corners = sum(len(ring) for _, ring in rings)
    every = max(1, -(-corners // max(int(MOST_CORNERS * share), 1)))
    thinned = [(i, ring[::every] if len(ring) >= 3 * every else ring[:3]) for i, ring in rings]
    return {
        "z": _rounded([section.z for section in sections]),
        "share": [round(section.share, 4) for section in sections],
        "rings": [[i, len(ring)] for i, ring in thinned],
        **(_packed(np.vstack([ring for _, ring in thinned])) if thinned else {}),
    }
