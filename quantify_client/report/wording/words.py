"""Words that the terminal, the page and the pictures share, made safe to show."""

from __future__ import annotations

import re
import unicodedata
from typing import Any, List, Mapping, Optional, Tuple, Union

from ...types import AreaResult, Body, Gap
from .units import NOTHING, Units, count, number

__all__ = [
    "base_words",
    "changed_words",
    "coordinate_line",
    "coordinate_rows",
    "coverage_words",
    "crs_words",
    "encodable",
    "floor_words",
    "gap_width",
    "gap_words",
    "is_terrain",
    "left_out_words",
    "printable",
    "slug",
    "volumes",
]

REPLACEMENT = "\ufffd"
SPACES = re.compile("[\t\n\r\v\f\x85\u2028\u2029]")
# Control characters, halves of characters, and direction overrides, which can make a text read as
# another one ("Trojan source").
STEERING = re.compile(
    "[\x00-\x1f\x7f-\x9f\ud800-\udfff\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069]"
)
WKT_NAME = re.compile(r'^\s*[A-Z_a-z]+\s*[\[(]\s*"((?:[^"]|"")*)"')
SLUG_LENGTH = 40
LEVEL_DEGREES = 0.05  # a tilt below it is shown as level
FLOORS = {
    "in the cloud": "a plane found in the cloud",
    "given": "the plane that was given",
    "lowest points": "none in the cloud; the body is open below and was closed by a plane "
    "through its lowest points",
}


def printable(text: object) -> str:
    r"""Return the text on one line, without control characters and direction overrides.

    Examples
    --------
    >>> printable("a\x1b[31mb\nc") == "a\ufffd[31mb c"
    True
    """
    return STEERING.sub(REPLACEMENT, SPACES.sub(" ", str(text)))


def encodable(text: str) -> str:
    """Return the text without lone surrogates (undecodable file names), which no UTF-8 can hold."""
    return text.encode("utf-8", "replace").decode("utf-8")


def slug(name: str) -> str:
    """Return a part of a file name that is the same on every system.

    Examples
    --------
    >>> slug("Größe / Pile #3"), slug("../.."), slug("砂")
    ('groe-pile-3', 'unnamed', 'unnamed')
    """
    folded = unicodedata.normalize("NFKD", encodable(name)).encode("ascii", "ignore").decode()
    return re.sub(r"[^a-z0-9]+", "-", folded.lower())[:SLUG_LENGTH].strip("-") or "unnamed"


def crs_words(crs: Optional[str]) -> str:
    """Return a CRS in a few words: the name of a WKT, anything else as it is.

    Examples
    --------
    >>> crs_words('PROJCRS["WGS 84 / UTM zone 15N",BASEGEOGCRS[]]'), crs_words("EPSG:32615")
    ('WGS 84 / UTM zone 15N', 'EPSG:32615')
    """
    if not crs:
        return "none (cloud coordinates)"
    match = WKT_NAME.match(crs)
    return printable(match.group(1).replace('""', '"') if match else crs)


def coordinate_rows(provenance: Mapping[str, Any]) -> List[Tuple[str, str]]:
    """Return each part of the cloud's CRS, its source, and the sources that contradict it.

    Examples
    --------
    >>> part = {"part": "horizontal unit", "value": "foot", "source": "GeoTIFF key 3076"}
    >>> other = [{"value": "metre", "source": "GeoTIFF key 3072"}]
    >>> coordinate_rows({"coordinates": [{**part, "contradicted_by": other}]})
    [('horizontal unit', 'foot (GeoTIFF key 3076; not metre, as GeoTIFF key 3072 says)')]
    """
    rows = []
    for part in provenance.get("coordinates", ()):
        rejected = "".join(
            f"; not {other['value']}, as {other['source']} says"
            for other in part["contradicted_by"]
        )
        rows.append((part["part"], printable(f"{part['value']} ({part['source']}{rejected})")))
    return rows


def coordinate_line(provenance: Mapping[str, Any]) -> str:
    """Return the CRS and units in one line, and every other part that a source contradicts."""
    return "; ".join(
        f"{name} {words}"
        for (name, words), part in zip(
            coordinate_rows(provenance), provenance.get("coordinates", ())
        )
        if name in ("CRS", "horizontal unit", "vertical unit") or part["contradicted_by"]
    )


def base_words(base: Union[str, float, None], units: Units) -> str:
    """Return a base surface in words."""
    if base is None:
        return "none"
    if isinstance(base, str):
        return printable(base)
    return f"elevation {units.length_text(base)}"


def coverage_words(coverage: Optional[float]) -> str:
    """Return a share as a percentage that says 100 only when it is."""
    if coverage is None:
        return NOTHING
    percent = min(coverage * 100.0, 99.9) if coverage < 1.0 else 100.0
    return f"{percent:.0f}\u00a0%" if percent in (0.0, 100.0) else f"{percent:.1f}\u00a0%"


def changed_words(result: AreaResult, units: Units) -> str:
    """Return the area of cells beyond their level of detection, and its share of the area."""
    changed, area = result.area_changed_m2, result.area_m2
    share = ""
    if changed is not None and area:
        share = f" ({coverage_words(min(changed / area, 1.0))})"
    return units.area_text(changed) + share


def is_terrain(result: AreaResult) -> bool:
    """Return whether a result has a base, and with it a cut and a fill."""
    return result.cut_m3 is not None


def volumes(result: AreaResult, units: Units) -> List[str]:
    """Return the volume, half the width of its 95 % interval, cut and fill."""
    return [
        units.volume_number(result.volume_m3, result.std_m3),
        units.half_width(result.std_m3),
        units.volume_number(result.cut_m3, result.cut_std_m3),
        units.volume_number(result.fill_m3, result.fill_std_m3),
    ]


def floor_words(body: Body, units: Units) -> str:
    """Return one sentence about the ground that a body stands on."""
    floor = body.floor
    if floor is None:
        return "Ground: none; the surface was taken as closed all round."
    tilt = (
        "level" if floor.tilt_degrees < LEVEL_DEGREES else f"tilted {floor.tilt_degrees:.1f}\u00b0"
    )
    points = "no point was left out for it"
    if floor.points:
        noun = "point" if floor.points == 1 else "points"
        points = f"{count(floor.points)} {noun} taken for it and left out"
    found = FLOORS.get(floor.found, printable(floor.found))
    where = units.elevation_text(floor.elevation, _height(body))
    return f"Ground: {found}, at elevation {where}, {tilt}; {points}."


def _height(body: Body) -> float:
    """Return how high a body's points reach above each other, metres; 0 without any."""
    z = body.points[:, 2]
    return float(z.max() - z.min()) if len(z) else 0.0


def gap_words(body: Body, units: Units) -> str:
    """Return one sentence: how many gaps were closed, how wide the widest is, and where."""
    if not body.gaps:
        return "Gaps: none had to be closed."
    widest = max(body.gaps, key=lambda gap: gap.width)
    number_of = len(body.gaps)
    closed = "1 closed," if number_of == 1 else f"{count(number_of)} closed, the widest"
    where = units.elevation_text(body.origin[2] + widest.z, _height(body))
    return f"Gaps: {closed} {gap_width(widest, units)} wide, at elevation {where}."


def gap_width(gap: Gap, units: Units) -> str:
    """Return the width of a gap with its unit: two digits, as a gap has no sharp edge."""
    return f"{number(gap.width * units.length_per_m, digits=2)}\u00a0{units.length}"


def left_out_words(result: AreaResult) -> str:
    """Return how many points were left out, by reason."""
    parts = [f"{count(n)} {printable(why)}" for why, n in result.points_left_out.items() if n]
    return ", ".join(parts) or "none"
