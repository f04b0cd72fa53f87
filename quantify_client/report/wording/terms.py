"""What the parts of a result are called: those of a volume, and those of a change."""

from __future__ import annotations

from dataclasses import dataclass

from ...types import AreaResult, Measurement
from .words import is_terrain

__all__ = ["CHANGE", "VOLUME", "Terms", "terms_of"]


@dataclass(frozen=True)
class Terms:
    """The words of one kind of measurement, for the terminal, the page and the pictures.

    Attributes
    ----------
    title, report : of the page: before the source's name, and above it.
    net, cut, fill : headings of columns.
    cut_tile, fill_tile : names of the large numbers.
    base : the surface that heights are measured from, as the name of a fact.
    upper_line, lower_line : the two lines of a section.
    height : of a slice, in a table.
    height_axis : likewise, on an axis.
    colours : of the colour bar, from below to above.
    changed : the area of cells beyond their level of detection.
    """

    title: str
    report: str
    net: str
    cut: str
    fill: str
    cut_tile: str
    fill_tile: str
    base: str
    upper_line: str
    lower_line: str
    height: str
    height_axis: str
    colours: str
    changed: str

    def volume(self, result: AreaResult) -> str:
        """Return what `volume_m3` is called: net for terrain, volume for a body."""
        return self.net if is_terrain(result) else "Volume"


VOLUME = Terms(
    title="Volumes",
    report="Volume report",
    net="Net",
    cut="Cut",
    fill="Fill",
    cut_tile="Cut, above the base",
    fill_tile="Fill, below the base",
    base="Base",
    upper_line="terrain",
    lower_line="base",
    height="Above base",
    height_axis="height above base",
    colours="below base (fill)  \u00b7  above (cut)",
    changed="Area beyond that level",
)

CHANGE = Terms(
    title="Change",
    report="Change report",
    net="Net change",
    cut="Gain",
    fill="Loss",
    cut_tile="Gain, higher than before",
    fill_tile="Loss, lower than before",
    base="Before",
    upper_line="after",
    lower_line="before",
    height="Above before",
    height_axis="change of height",
    colours="lower (loss)  \u00b7  higher (gain)",
    changed="Area that changed",
)


def terms_of(measurement: Measurement) -> Terms:
    """Return the words for a measurement."""
    return CHANGE if measurement.kind == "change" else VOLUME
