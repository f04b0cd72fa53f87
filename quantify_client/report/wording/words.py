"""Words that the terminal, the page and the pictures share, made safe to show."""

from __future__ import annotations

import json
import re
import unicodedata
from typing import Any, List, Mapping, Optional, Tuple, Union

from ...types import AreaResult
from .units import Units

__all__ = [
    "base_words",
    "budget_words",
    "coordinate_line",
    "coordinate_rows",
    "coverage_words",
    "crs_words",
    "encodable",
    "is_terrain",
    "json_words",
    "printable",
    "slug",
    "volume_word",
]

REPLACEMENT = "\ufffd"
# Direction overrides can make a text read as another one ("Trojan source").
BIDI_CONTROLS = frozenset(
    "\u061c\u200e\u200f\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069"
)
SPACES = frozenset("\t\n\r\v\f\x85\u2028\u2029")
WKT_NAME = re.compile(r'^\s*[A-Z_a-z]+\s*[\[(]\s*"((?:[^"]|"")*)"')
SLUG_LENGTH = 40
BUDGET_WORDS = {"scale": "how well the control knows the size of the whole cloud"}


def printable(text: object) -> str:
    r"""Return the text on one line, without anything that steers a terminal or the reader.

    Examples
    --------
    >>> printable("a\x1b[31mb\nc") == "a\ufffd[31mb c"
    True
    """
    return "".join(_printable_character(c) for c in str(text))


def _printable_character(character: str) -> str:
    if character in SPACES:
        return " "
    if character in BIDI_CONTROLS or unicodedata.category(character) in ("Cc", "Cs"):
        return REPLACEMENT
    return character


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
    """Return each part of the cloud's CRS, and what said it and what said otherwise.

    Examples
    --------
    >>> part = {"part": "horizontal unit", "value": "foot", "source": "GeoTIFF key 3076"}
    >>> other = [{"value": "metre", "source": "GeoTIFF key 3072"}]
    >>> coordinate_rows({"coordinates": [{**part, "contradicted_by": other}]})
    [('horizontal unit', 'foot (GeoTIFF key 3076; not metre, as GeoTIFF key 3072 says)')]
    """
    rows = []
    for part in provenance.get("coordinates", ()):
        not_believed = "".join(
            f"; not {other['value']}, as {other['source']} says"
            for other in part["contradicted_by"]
        )
        rows.append((part["part"], printable(f"{part['value']} ({part['source']}{not_believed})")))
    return rows


def coordinate_line(provenance: Mapping[str, Any]) -> str:
    """Return what a reader of a volume has to know of that: units, and what was contradicted."""
    told = [
        row
        for row, part in zip(coordinate_rows(provenance), provenance.get("coordinates", ()))
        if part["part"] in ("CRS", "horizontal unit", "vertical unit") or part["contradicted_by"]
    ]
    return "; ".join(f"{part} {said}" for part, said in told)


def base_words(base: Union[str, float, None], units: Units) -> str:
    """Return a base surface in words."""
    if base is None:
        return "none"
    if isinstance(base, str):
        return printable(base)
    return f"elevation {units.length_text(base)}"


def budget_words(source: str) -> str:
    """Return what an item of the error budget is, where its name alone does not tell."""
    return BUDGET_WORDS.get(source, "")


def coverage_words(coverage: Optional[float]) -> str:
    """Return a share as a percentage that says 100 only when it is."""
    if coverage is None:
        return "\u2013"
    percent = min(coverage * 100.0, 99.9) if coverage < 1.0 else 100.0
    return f"{percent:.0f}\u00a0%" if percent in (0.0, 100.0) else f"{percent:.1f}\u00a0%"


def is_terrain(result: AreaResult) -> bool:
    """Return whether a result has a base, and with it a cut and a fill."""
    return result.cut_m3 is not None


def volume_word(result: AreaResult) -> str:
    """Return what `volume_m3` is called: net for terrain, volume for a body."""
    return "Net" if is_terrain(result) else "Volume"


def json_words(value: Any) -> str:
    """Return a value of the provenance in one line."""
    if isinstance(value, str):
        return printable(value)
    return printable(json.dumps(value, ensure_ascii=False))
