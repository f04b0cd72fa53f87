"""A scaling in words and digits that the terminal, the page and the picture share."""

from __future__ import annotations

import math
from typing import List, Optional

from ...types import ControlledPoint, DirectHeight, ScaleObservation, Scaling
from .observations import UNCONTROLLED, Row
from .units import MINUS, NOTHING, Units, number
from .words import printable

__all__ = [
    "KIND_WORDS",
    "MARKS",
    "coordinates_words",
    "conflict_words",
    "contradicted",
    "error_words",
    "factor_words",
    "has_north",
    "height_note",
    "height_words",
    "mode_words",
    "observed_words",
    "percent",
    "remark",
    "residual_words",
    "rms_words",
    "row_words",
    "sigma_words",
    "sigmas_words",
    "signed_length",
    "source_words",
]

KIND_WORDS = {
    "distance": "tapes",
    "scale_bar": "scale bars",
    "gps": "positions",
    "elevation": "elevations",
    "cloud": "in the cloud",
}
MODE_WORDS = {
    "scale": "scale only; the cloud keeps its place and its directions",
    "shift": "scale, shift and heading; the cloud keeps its vertical",
    "full": "full: scale, shift and all three rotations",
}
# A letter for each grade, so that colour is never all there is.
MARKS = {"good": "\u2713", "doubtful": "?", "bad": "\u2717", "open": "\u25cb"}
COMPONENTS = {"east": "E", "north": "N"}
SMALL = 1e-3  # a relative error below it is also told in parts per million


def factor_words(scaling: Scaling) -> str:
    """Return the factor with its standard deviation, in the digits that this one supports."""
    shown = number(scaling.factor, std=scaling.std, digits=7)
    spread = number(scaling.std, std=scaling.std)
    return shown if spread == NOTHING else f"{shown} \u00b1 {spread}"


def error_words(scaling: Scaling) -> str:
    """Return the factor's relative standard deviation, or nothing where it is unknown."""
    share = scaling.std / scaling.factor if scaling.factor else math.nan
    if not math.isfinite(share):
        return ""
    words = f"{number(100.0 * share, digits=2)}\u00a0%"
    if 0.0 < share < SMALL:
        words += f", {number(1e6 * share, digits=2)}\u00a0ppm"
    return words


def mode_words(scaling: Scaling) -> str:
    """Return what was applied to the cloud."""
    words = MODE_WORDS.get(scaling.mode, printable(scaling.mode))
    if scaling.tilt_std_deg is None or not math.isfinite(scaling.tilt_std_deg):
        return words
    return f"{words}; the vertical is known to {number(scaling.tilt_std_deg, digits=2)}\u00b0"


def source_words(scaling: Scaling) -> str:
    """Return which observations the scale comes from, as a sentence without its full stop."""
    return _sentence(scaling.carried_by)


def conflict_words(scaling: Scaling) -> str:
    """Return the largest contradiction, as a sentence without its full stop."""
    return _sentence(scaling.conflict or "nothing contradicts the rest")


def contradicted(scaling: Scaling) -> bool:
    """Return whether anything contradicts the rest."""
    return bool(scaling.conflict)


def _sentence(words: str) -> str:
    # Of words that begin with the name of a point the first letter stays as it is.
    known = words.startswith(("the ", "tape ", "scale bar ", "nothing "))
    return printable(words[:1].upper() + words[1:] if known else words)


def has_north(scaling: Scaling) -> bool:
    """Return whether anything ties the control to the Earth, so that north is up in its plan."""
    return scaling.target_crs is not None or any(p.lon is not None for p in scaling.points)


def row_words(row: Row) -> str:
    """Return what was observed: ``tape A-C``, ``position A`` (with an en dash)."""
    names = NOTHING.join(printable(name) for name in row.names)
    pattern = {
        "distance": "tape {}",
        "scale_bar": "scale bar {}",
        "gps": "position {}",
        "elevation": "elevation {}",
        "cloud": "{} in the cloud",
    }.get(row.kind)
    return pattern.format(names) if pattern else f"{printable(row.kind)} {names}"


def observed_words(row: Row, units: Units) -> str:
    """Return a length or an elevation as it was observed; coordinates tell nobody anything."""
    part = row.parts[0]
    if part.component is not None:
        return ""
    return units.length_by_error(part.observed, part.sigma)


def residual_words(row: Row, units: Units) -> List[str]:
    """Return the residuals, each with the name of its direction where there are several."""
    return [_residual(part, units) for part in row.parts]


def _residual(part: ScaleObservation, units: Units) -> str:
    shown = signed_length(part.residual, part.sigma, units)
    if part.component is None:
        return shown
    return f"{COMPONENTS.get(part.component, printable(part.component))}\u00a0{shown}"


def signed_length(value_m: Optional[float], std_m: Optional[float], units: Units) -> str:
    """Return a length that may be negative, with its sign and without its unit."""
    shown = units.length_by_error(value_m, std_m)
    unsigned = shown == NOTHING or shown.startswith(MINUS) or not shown.strip("0.")
    return shown if unsigned else f"+{shown}"


def sigma_words(row: Row, units: Units) -> str:
    """Return the sigma, or all of them where they differ."""
    shown = [units.length_by_error(part.sigma, part.sigma) for part in row.parts]
    return " ".join(dict.fromkeys(shown))


def sigmas_words(row: Row) -> str:
    """Return how large the residual is, in sigmas; of several the largest."""
    value = row.in_sigmas
    return NOTHING if value is None else number(abs(value), std=1.0 if abs(value) < 100 else 10.0)


def percent(share: Optional[float]) -> str:
    """Return a share in whole percent, except where it is small.

    Examples
    --------
    >>> [percent(v).replace("\u00a0", " ") for v in (0.714, 0.0042, 0.0)]
    ['71 %', '0.4 %', '0 %']
    """
    if share is None or not math.isfinite(share):
        return NOTHING
    tenths = 0.0005 <= abs(share) < 0.00995
    return f"{number(100.0 * share, std=1.0 if tenths else 10.0)}\u00a0%"


def remark(row: Row) -> str:
    """Return what has to be known of it besides its numbers."""
    words = []
    if row.outlier:
        words.append("left out: contradicts the rest")
    if row.check:
        words.append("check, not in the fit")
    redundancy = row.redundancy
    if redundancy is not None and redundancy < UNCONTROLLED:
        words.append("nothing controls it")
    return "; ".join(words)


def rms_words(scaling: Scaling, units: Units) -> str:
    """Return the RMS of the residuals, and that of what was left out to check them."""
    words = []
    if scaling.rms_m is not None:
        lengths = any(o.kind in ("distance", "scale_bar") for o in scaling.observations)
        of = "the lengths" if lengths else "the positions"
        words.append(f"RMS of {of} {_rms(scaling.rms_m, units)}")
    if scaling.check_rms_m is not None:
        words.append(f"RMS of the checks {_rms(scaling.check_rms_m, units)}")
    return "; ".join(words)


def _rms(value_m: float, units: Units) -> str:
    return f"{units.length_by_error(value_m, value_m)}\u00a0{units.length}"


def height_words(height: DirectHeight, units: Units) -> str:
    """Return an elevation difference with its standard deviation, or its interval, or a dash."""
    if height.interval_m is not None:
        low, high = (units.length_number(end) for end in height.interval_m)
        return f"{low} to {high}"
    if height.dz_m is None:
        return NOTHING
    shown = signed_length(height.dz_m, height.std_m, units)
    spread = units.length_by_error(height.std_m, height.std_m)
    return shown if spread == NOTHING else f"{shown} \u00b1 {spread}"


def height_note(height: DirectHeight) -> str:
    """Return what is wrong with an elevation difference, beginning with its pair."""
    pair = f"{height.start}-{height.end}"
    return height.note if height.note.startswith(pair) else f"{pair}: {height.note}"


def coordinates_words(point: ControlledPoint) -> str:
    """Return latitude and longitude to a millimetre or so."""
    if point.lat is None or point.lon is None:
        return NOTHING
    return f"{point.lat:.8f}, {point.lon:.8f}"
