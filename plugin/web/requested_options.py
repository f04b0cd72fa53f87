"""The options that a request may ask for, checked before anything is started or written."""

import re
import unicodedata

from ..files.inputs import MOST_CRS
from ..quantify_client.options import OPTIONS
from ..quantify_client.types.shapes import (
    Flag,
    MisshapenError,
    Number,
    OneOf,
    Record,
    Shape,
    Text,
    Whole,
)

__all__ = ["checked_options"]

_EPSG = re.compile(r"EPSG:\d{1,6}(\+\d{1,6})?", re.IGNORECASE)
_WKT = re.compile(r"[A-Z_]{5,20} ?\[.*\]", re.IGNORECASE)
# PROJ opens the files that these name, in a PROJ text and in one that a WKT carries.
_NAMES_FILE = re.compile(
    r"PARAMETERFILE|\b(?:init|file|catalog) ?=|grids ?=(?! ?@null\b)|pipeline", re.IGNORECASE
)
_PROJ = re.compile(r"\+proj=\w{1,20}(?: \+?\w{1,12}(?:=[\w.,'+-]{1,120}|=@null)?)*")


class _Crs(Shape):
    """A CRS as a text that leads to no file: codes of EPSG, WKT, or PROJ's parameters."""

    def clean(self, value, where):
        """Return the text on one line."""
        text = " ".join(Text(MOST_CRS, 1).clean(value, where).split())
        written = any(shape.fullmatch(text) for shape in (_EPSG, _WKT, _PROJ))
        hidden = any(unicodedata.category(letter)[0] == "C" for letter in text)
        if not written or hidden or _NAMES_FILE.search(text):
            raise MisshapenError(
                f"{where} has to be EPSG:n, EPSG:n+m, WKT or a PROJ text (+proj=...), and may name "
                "no file"
            )
        return text


def _shape(option):
    """Return the shape of an option, with the limits that requests have."""
    if option.kind == "flag":
        return Flag()
    if option.kind == "text":
        return _Crs()
    if option.kind == "choice":
        return Text(among=option.choices)
    low, high = option.request
    if option.kind == "whole":
        number = Whole(low, high)
    else:
        number = Number(above=0, most=high) if option.above == 0 else Number(low, high)
    return OneOf(number, Text(among=option.choices)) if option.choices else number


_OPTIONS = Record(
    {name: _shape(option) for name, option in OPTIONS.items() if option.request is not None},
    required=(),
    others="refuse",
)


def checked_options(options):
    """Return the options without those that are null."""
    if options is None:
        return {}
    if isinstance(options, dict):
        options = {key: value for key, value in options.items() if value is not None}
    return _OPTIONS.clean(options, "options")
