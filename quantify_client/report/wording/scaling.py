"""A scaling in words and digits that the terminal, the page and the picture share."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Dict, List, Optional, Sequence, Tuple

from ...types import DirectHeight, ScaleObservation, Scaling
from .units import MINUS, NOTHING, Units, number, plus_minus
from .words import printable

__all__ = [
    "BAD",
    "GOOD",
    "GRADES",
    "KINDS",
    "MARKS",
    "Observation",
    "conflict_words",
    "error_words",
    "factor_words",
    "height_words",
    "in_sigmas",
    "mode_words",
    "name_words",
    "observation_words",
    "observations_of",
    "percent",
    "rms_words",
    "signed_length",
    "source_words",
    "worst",
]

GOOD = 2.0  # a residual below this many sigmas needs no attention ...
BAD = 3.3  # ... and one beyond this happens once in a thousand
UNCONTROLLED = 1e-4  # a redundancy below it: the residual is zero whatever was observed

# Kinds of observations in the order in which they are shown: what one and several are called.
KINDS = {
    "distance": ("tape {}", "tapes"),
    "scale_bar": ("scale bar {}", "scale bars"),
    "gps": ("position {}", "positions"),
    "elevation": ("elevation {}", "elevations"),
    "cloud": ("{} in the cloud", "in the cloud"),
}
# A mark for each grade, so that colour is never all there is.
MARKS = {"good": "\u2713", "doubtful": "?", "bad": "\u2717", "open": "\u25cb"}
GRADES = {
    "good": f"below {GOOD:g} \u03c3",
    "doubtful": f"below {BAD:g} \u03c3",
    "bad": "beyond, or left out",
    "open": "nothing controls it",
}
MODES = {
    "scale": "scale only; the cloud keeps its place and its directions",
    "shift": "scale, shift and heading; the cloud keeps its vertical",
    "full": "full: scale, shift and all three rotations",
}
COMPONENTS = {"east": "E", "north": "N"}
SMALL = 1e-3  # a relative error below it is also told in parts per million


@dataclass(frozen=True)
class Observation:
    """One observation: a length, two coordinates of a position, three of a point in the cloud.

    Attributes
    ----------
    parts : one number each, all of one kind and of the same names.
    kind, names : as in ScaleObservation.
    outlier : left out because it contradicts the rest.
    check : left out to check the fit.
    in_sigmas : the residual that is largest in sigmas, with its sign; None without any.
    redundancy : mean over the parts; None where none was in the fit.
    contribution : sum over the parts, their share of the scale's information; None where none was
        in the fit.
    grade : ``"good"``, ``"doubtful"``, ``"bad"``, or ``"open"`` where nothing controls it.
    """

    parts: Tuple[ScaleObservation, ...]
    kind: str
    names: Tuple[str, ...]
    outlier: bool
    check: bool
    in_sigmas: Optional[float]
    redundancy: Optional[float]
    contribution: Optional[float]
    grade: str


def in_sigmas(observation: ScaleObservation) -> Optional[float]:
    """Return residual / sigma, or None where either is unknown or the sigma is 0."""
    if not observation.sigma > 0.0:
        return None
    value = observation.residual / observation.sigma
    return value if math.isfinite(value) else None


def observations_of(scaling: Scaling) -> List[Observation]:
    """Return all observations: by kind, and within a kind the worst first."""
    groups: List[List[ScaleObservation]] = []
    latest: Dict[Tuple[str, Tuple[str, ...]], List[ScaleObservation]] = {}
    for part in scaling.observations:
        key = (part.kind, tuple(part.names))
        group = latest.get(key)
        # The same length may have been taped twice, and then is two observations.
        if group is None or part.component in (None, *(other.component for other in group)):
            group = latest[key] = []
            groups.append(group)
        group.append(part)
    return _sorted([_observation(group) for group in groups])


def _observation(parts: Sequence[ScaleObservation]) -> Observation:
    outlier = any(part.outlier for part in parts)
    sizes = [size for size in map(in_sigmas, parts) if size is not None]
    largest = max(sizes, key=abs, default=None)
    redundancies = _known([part.redundancy for part in parts])
    redundancy = sum(redundancies) / len(redundancies) if redundancies else None
    shares = _known([part.contribution for part in parts])
    if outlier:
        grade = "bad"
    elif largest is None or (redundancy is not None and redundancy < UNCONTROLLED):
        grade = "open"
    else:
        size = abs(largest)
        grade = "good" if size < GOOD else "doubtful" if size < BAD else "bad"
    return Observation(
        tuple(parts),
        parts[0].kind,
        parts[0].names,
        outlier,
        any(part.check for part in parts),
        largest,
        redundancy,
        min(sum(shares), 1.0) if shares else None,
        grade,
    )


def _known(values: Sequence[Optional[float]]) -> List[float]:
    return [value for value in values if value is not None and math.isfinite(value)]


def worst(rows: Sequence[Observation], count: int) -> List[Observation]:
    """Return the worst of all kinds, in the order of :func:`observations_of`."""
    return _sorted(sorted(rows, key=_badness)[:count])


def _sorted(rows: List[Observation]) -> List[Observation]:
    place = {kind: index for index, kind in enumerate(KINDS)}
    return sorted(rows, key=lambda row: (place.get(row.kind, len(KINDS)), *_badness(row)))


def _badness(row: Observation) -> Tuple[bool, float]:
    return (not row.outlier, -abs(row.in_sigmas or 0.0))


@dataclass(frozen=True)
class ObservationWords:
    """The cells of an observation's row in a table, without units and grade."""

    name: str
    remark: str
    observed: str
    residuals: List[str]
    sigmas: List[str]
    in_sigmas: str
    redundancy: str
    contribution: str


def observation_words(row: Observation, units: Units) -> ObservationWords:
    """Return an observation with its residuals and remarks in words."""
    part, size = row.parts[0], row.in_sigmas
    observed = "" if part.component else units.length_by_error(part.observed, part.sigma)
    uncontrolled = row.redundancy is not None and row.redundancy < UNCONTROLLED
    remarks = {
        "left out: contradicts the rest": row.outlier,
        "check, not in the fit": row.check,
        "nothing controls it": uncontrolled,
    }
    shown = NOTHING if size is None else number(abs(size), std=1.0 if abs(size) < 100 else 10.0)
    sigmas = [units.length_by_error(part.sigma, part.sigma) for part in row.parts]
    return ObservationWords(
        name_words(row),
        "; ".join(remark for remark, applies in remarks.items() if applies),
        observed,
        [_residual(part, units) for part in row.parts],
        list(dict.fromkeys(sigmas)),
        shown,
        percent(row.redundancy),
        percent(row.contribution),
    )


def _residual(part: ScaleObservation, units: Units) -> str:
    shown = signed_length(part.residual, part.sigma, units)
    if part.component is None:
        return shown
    return f"{COMPONENTS.get(part.component, printable(part.component))}\u00a0{shown}"


def name_words(row: Observation) -> str:
    """Return what was observed: ``tape A-C``, ``position A`` (with an en dash)."""
    pattern = KINDS.get(row.kind, (f"{printable(row.kind)} {{}}",))[0]
    return pattern.format(NOTHING.join(map(printable, row.names)))


def signed_length(value_m: Optional[float], std_m: Optional[float], units: Units) -> str:
    """Return a length that may be negative, with its sign and without its unit."""
    shown = units.length_by_error(value_m, std_m)
    unsigned = shown == NOTHING or shown.startswith(MINUS) or not shown.strip("0.")
    return shown if unsigned else f"+{shown}"


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


def factor_words(scaling: Scaling) -> str:
    """Return the factor with its standard deviation, in the digits that this one supports."""
    shown = number(scaling.factor, std=scaling.std, digits=7)
    return shown + plus_minus(number(scaling.std, std=scaling.std))


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
    words = MODES.get(scaling.mode, printable(scaling.mode))
    if scaling.tilt_std_deg is None or not math.isfinite(scaling.tilt_std_deg):
        return words
    return f"{words}; the vertical is known to {number(scaling.tilt_std_deg, digits=2)}\u00b0"


def source_words(scaling: Scaling) -> str:
    """Return which observations the scale comes from, without a full stop."""
    return _sentence(scaling.carried_by)


def conflict_words(scaling: Scaling) -> str:
    """Return the largest contradiction between observations, without a full stop."""
    return _sentence(scaling.conflict or "nothing contradicts the rest")


def _sentence(words: str) -> str:
    # Of words that begin with the name of a point the first letter stays as it is.
    known = words.startswith(("the ", "tape ", "scale bar ", "nothing "))
    return printable(words[:1].upper() + words[1:] if known else words)


def rms_words(scaling: Scaling, units: Units) -> str:
    """Return the RMS of the residuals, and that of the check observations."""
    lengths = any(o.kind in ("distance", "scale_bar") for o in scaling.observations)
    values = {
        "the lengths" if lengths else "the positions": scaling.rms_m,
        "the checks": scaling.check_rms_m,
    }
    return "; ".join(
        f"RMS of {of} {units.length_by_error(rms, rms)}\u00a0{units.length}"
        for of, rms in values.items()
        if rms is not None
    )


def height_words(height: DirectHeight, units: Units) -> str:
    """Return an elevation difference with its standard deviation, or its interval, or a dash."""
    if height.interval_m is not None:
        low, high = (units.length_number(end) for end in height.interval_m)
        return f"{low} to {high}"
    if height.dz_m is None:
        return NOTHING
    shown = signed_length(height.dz_m, height.std_m, units)
    return shown + plus_minus(units.length_by_error(height.std_m, height.std_m))
