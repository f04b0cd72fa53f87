"""The page of a scaling alone: one file that needs nothing else."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Iterator, Mapping, Optional

from ...types import Scaling
from ..wording.units import Units
from ..wording.words import crs_words
from .markup import text
from .page import page_header, page_top, provenance_card
from .scaling import scale_section

__all__ = ["render_scale_html"]


def render_scale_html(
    document: Mapping[str, Any], scaling: Scaling, units: Units, picture: Optional[Path]
) -> Iterator[str]:
    """Yield the page in pieces.

    `document` is that of ``scale_json.scale_document``; `picture` is a PNG file.
    """
    chips = [
        ("CRS", text(crs_words(scaling.target_crs))),
        ("Units", text(units.length)),
        ("Mode", text(scaling.mode)),
    ]
    if document["out"] is not None:
        chips.append(("Scaled cloud", text(document["out"])))
    # Those of the scaling itself are in its card.
    said = [warning["text"] for warning in document["warnings"]]
    warnings = [warning for warning in said if warning not in scaling.warnings]
    yield page_top(f"Scale: {document['source']}")
    yield page_header("Scale report", document["source"], chips, warnings)
    yield scale_section(scaling, units, picture)
    yield provenance_card(document["provenance"], scaling.target_crs)
    yield "</body>\n</html>\n"
