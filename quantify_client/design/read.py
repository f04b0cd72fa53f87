"""A design surface from a file, by its ending."""

from __future__ import annotations

from pathlib import Path

from ..errors import DesignError
from .dxf import read_dxf
from .landxml import read_landxml
from .surface import WHAT, Design

__all__ = ["DESIGN_SUFFIXES", "read_design"]

_READERS = {".xml": read_landxml, ".landxml": read_landxml, ".dxf": read_dxf}
DESIGN_SUFFIXES = tuple(_READERS)
"""The endings of the files that can be read."""


def read_design(path: Path) -> Design:
    """Read a design surface: the TIN of a LandXML file, or the faces of a DXF.

    Raises
    ------
    DesignError
        One line: what was found, what was expected, what to do.
    MissingExtraError
        When the library for a DXF is not installed.
    """
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        endings = ", ".join(DESIGN_SUFFIXES)
        raise DesignError(f"{path.name} has an unknown ending; expected {WHAT}: {endings}")
    return reader(path)
