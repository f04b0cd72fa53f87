"""OpenDroneMap's gcp_list.txt, written."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Dict, Mapping, Sequence, Tuple, Union

import numpy as np

from ...crs import odm_header, plane_of
from ...errors import ControlError, CrsError, OutputError
from ...files.writing import GENERATOR, put_in_place, require_replaceable, staging
from .model import Pick
from .syntax import printable, quoted

__all__ = ["write_gcp_list"]

_DECIMALS_GRID = 4  # of coordinates in metres or feet, and of heights
_DECIMALS_DEGREES = 10
_Place = Tuple[float, float, float]


def write_gcp_list(
    path: Union[str, Path],
    crs: str,
    coordinates: Mapping[str, _Place],
    picks: Sequence[Pick],
) -> Sequence[str]:
    """Write a gcp_list.txt for OpenDroneMap: one row for each pick of a point with coordinates.

    Blanks in names of points become ``_``, since columns end at blanks. The file appears complete
    or not at all, and replaces nothing but an earlier one of ours, which its second line, a
    comment, tells.

    Parameters
    ----------
    crs : of the coordinates.
    coordinates : x, y in the CRS's own unit (longitude, latitude in degrees) and height in metres.
    picks : where points were seen.

    Returns
    -------
    names : points that are left out, for want of picks or (of picks' points) of coordinates.

    Raises
    ------
    ControlError
        When a coordinate is not finite, all heights are 0 (OpenDroneMap takes them as heights of
        0, not as unknown), two points cannot be told apart, a photograph's name has blanks, no
        point has both coordinates and picks, or OpenDroneMap cannot read such a CRS.
    OutputError
        When the file cannot be written.
    """
    path = Path(path)
    seen = {pick.name for pick in picks}
    used = {name: place for name, place in coordinates.items() if name in seen}
    _require_places(used)
    places = np.array(list(used.values()), dtype=np.float64).reshape(-1, 3)
    try:
        header = odm_header(crs, places[:, 0], places[:, 1])
        decimals = _DECIMALS_DEGREES if plane_of(crs).geographic else _DECIMALS_GRID
    except CrsError as error:
        raise ControlError(f"no gcp_list.txt: {error}") from None
    written = {
        name: f"{x:.{decimals}f} {y:.{decimals}f} {z:.{_DECIMALS_GRID}f}"
        for name, (x, y, z) in used.items()
    }
    names = {name: "_".join(name.split()) for name in used}
    _require_distinct(
        written,
        "have the same coordinates ({}), by which OpenDroneMap tells points apart; correct them, "
        "or leave one out",
    )
    _require_distinct(
        {n: quoted(w) for n, w in names.items()}, "would both be written {}; rename one"
    )
    rows = [_row(written[pick.name], pick, names[pick.name]) for pick in picks if pick.name in used]
    _put(path, "\n".join([header, f"# {GENERATOR}", *rows]) + "\n")
    left_out = [name for name in coordinates if name not in seen]
    return [*left_out, *dict.fromkeys(pick.name for pick in picks if pick.name not in used)]


def _require_places(used: Mapping[str, _Place]) -> None:
    if not used:
        raise ControlError(
            "no point has both coordinates and picks in photographs, so there is nothing that "
            "OpenDroneMap could use; add 'images: gcp_list.txt' to the control file"
        )
    for name, place in used.items():
        if not all(map(math.isfinite, place)):
            listed = ", ".join(f"{value:.10g}" for value in place)
            raise ControlError(
                f"{quoted(name)} has no finite coordinates ({listed}); OpenDroneMap takes each of "
                "its picks for another point: solve its elevation first, or leave it out"
            )
    if all(place[2] == 0 for place in used.values()):
        raise ControlError(
            "the height of every point is 0, which OpenDroneMap takes for its height and not for "
            "unknown: solve the elevations first, from taped distances, or give real ones"
        )


def _require_distinct(texts: Mapping[str, str], problem: str) -> None:
    """Refuse two points that would be written alike."""
    owners: Dict[str, str] = {}
    for name, text in texts.items():
        owner = owners.setdefault(text, name)
        if owner != name:
            raise ControlError(f"{quoted(owner)} and {quoted(name)} {problem.format(text)}")


def _row(place: str, pick: Pick, name: str) -> str:
    if not pick.image or pick.image.split() != [pick.image] or not pick.image.isprintable():
        raise ControlError(
            f"the photograph {quoted(pick.image)} has blanks in its name, at which OpenDroneMap "
            "ends the column; rename it, here and on disk"
        )
    if not (math.isfinite(pick.px) and math.isfinite(pick.py)):
        raise ControlError(f"{quoted(name)} has no pixel in {quoted(pick.image)}; pick it again")
    return f"{place} {float(pick.px)!r} {float(pick.py)!r} {pick.image} {name}"


def _put(path: Path, text: str) -> None:
    """Write a file beside its place and move it there."""
    try:
        require_replaceable(path)
        with staging(path.parent) as working:
            (working / path.name).write_bytes(text.encode("utf-8"))
            put_in_place(working, [path.name])
    except OutputError:
        raise
    except (OSError, ValueError) as error:
        said = getattr(error, "strerror", None) or error
        raise OutputError(
            f"{printable(path)} cannot be written: {said}; give another path, or make room"
        ) from error
