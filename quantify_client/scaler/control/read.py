"""The front door for control: a control file, a table of points, or ODM's gcp_list.txt."""

from __future__ import annotations

import re
from pathlib import Path
from typing import List, Mapping, Optional, Sequence, Tuple, Union

from ...crs import Plane, plane_of
from ...crs.frame import UNITS_M
from ...errors import ControlError, CrsError
from .entries import Entry, Keys, near_miss
from .gcp_list import control_of
from .gcp_rows import parse_gcp_rows, read_gcp_rows
from .model import Control, ControlPoint, Length, Pick
from .parts import (
    MAX_POINTS,
    Source,
    read_bars,
    read_cloud,
    read_distances,
    read_points,
    require_known,
)
from .places import to_crs
from .sightings import control_points, sightings
from .syntax import Node, quoted, read_json, read_yaml
from .tables import is_point_table
from .text_files import read_text

__all__ = ["read_control", "require_self_contained"]

_WGS84 = Plane("EPSG:4326", None)
_KEYS: Keys = {
    "crs": ("srs", "epsg"),
    "unit": ("units",),
    "height": (),
    "points": ("gcps",),
    "distances": ("lengths", "tapes"),
    "cloud": (),
    "images": ("picks", "photographs"),
    "scale_bars": ("bars", "scalebars"),
}
_ENDINGS = {".yaml": "yaml", ".yml": "yaml", ".json": "json", ".csv": "table"}
_CRS_LINE = re.compile(r"(EPSG:\d+|WGS\s*84\s+UTM|\+proj=|\+init=)", re.IGNORECASE)
_UNITS = ["m", "ft", "us-ft"]  # what tapes and surveys come in
_UNIT_WORDS = {
    **dict.fromkeys(("metre", "metres", "meter", "meters"), "m"),
    **dict.fromkeys(("foot", "feet", "ift", "international foot"), "ft"),
    **dict.fromkeys(("us-foot", "usft", "ftus", "us_ft", "us ft", "survey foot"), "us-ft"),
}


def read_control(path: Union[str, Path]) -> Control:
    """Read relative control.

    A control file in YAML (``.yaml``, ``.yml``) or JSON (``.json``), OpenDroneMap's gcp_list.txt
    (``.txt``), or a CSV table of points alone (``.csv``, or ``.txt`` with such headings). With any
    other ending the content decides.

    Parameters
    ----------
    path : of the file. Paths in it are relative to it.

    Returns
    -------
    Control, checked in itself; lengths in metres, accuracies one standard deviation. Whether it
    fixes a scale is judged by the adjustment.

    Raises
    ------
    ControlError
        One line: the file, where in it, what was found, what was expected and what to do.
    """
    path = Path(path)
    text = read_text(path)
    kind = _kind(path, text)
    source = Source(path, None, None)
    if kind == "gcp_list":
        return control_of(parse_gcp_rows(text, source.file), str(path))
    if kind == "table":
        root = Node(members={"points": Node(path.name)})
    else:
        root = _tree(kind, text, source)
    return _control(path, root, source)


def require_self_contained(path: Union[str, Path]) -> None:
    """Refuse a control file that names other files: of a stranger's, they are not to be read.

    Raises
    ------
    ControlError
        It does, or it cannot be read.
    """
    path = Path(path)
    text = read_text(path)
    kind = _kind(path, text)
    if kind in ("gcp_list", "table"):
        return
    source = Source(path, None, None)
    root = _tree(kind, text, source)
    for key in ("points", "distances", "cloud", "images"):
        if _part(root, key).text is not None:
            raise ControlError(
                f"{source.file}: {key} names another file, which is not read here: write what it "
                "holds into this one"
                + ("; picks in photographs go as a gcp_list.txt" if key == "images" else "")
            )


def _tree(kind: str, text: str, source: Source) -> Node:
    return (read_yaml if kind == "yaml" else read_json)(text, source.file)


def _kind(path: Path, text: str) -> str:
    """Tell the format by its ending, else by how it begins."""
    ending = path.suffix.lower()
    if ending in _ENDINGS:
        return _ENDINGS[ending]
    if is_point_table(text):
        return "table"
    if ending == ".txt":
        return "gcp_list"
    if text.lstrip().startswith(("{", "[")):
        return "json"
    lines = (line.strip() for line in text.splitlines())
    first = next((line for line in lines if line and not line.startswith("#")), "")
    return "gcp_list" if _CRS_LINE.match(first) else "yaml"


def _control(path: Path, root: Node, source: Source) -> Control:
    """Put the parts of a control file together, and check what each says of the others."""
    if root.empty:
        raise ControlError(f"{source.file} is empty; expected points, distances or scale bars")
    if root.members is None:
        raise ControlError(
            f"{source.file} is {root.said}: expected a mapping, with lines such as "
            "'crs: EPSG:4326'"
        )
    top = Entry(source.file, root.members, None)
    top.only(_KEYS)
    unit = _unit(top)
    source = Source(path, unit, None if unit is None else UNITS_M[unit])
    top = Entry(source.file, root.members, source.unit_m)
    plane = _plane(top)
    points, assumed = read_points(_part(root, "points"), source, plane)
    if assumed:
        plane = _WGS84
        source.notes.append(
            f"{source.file}: no crs is given; lat and lon are taken as WGS84 (EPSG:4326)"
        )
    cloud = read_cloud(_part(root, "cloud"), source)
    distances = read_distances(_part(root, "distances"), source)
    bars = read_bars(_part(root, "scale_bars"), source)
    lengths = [*distances, *bars]
    points, picks, plane = _with_images(root, source, points, plane)
    require_known(lengths, list(dict.fromkeys([*points, *cloud])))
    if not (points or cloud or lengths or picks):
        raise ControlError(f"{source.file} is empty; expected points, distances or scale bars")
    return Control(
        label=str(path),
        crs=_checked_crs(points, plane, source),
        height_m=top.elevation_m("height"),
        points=points,
        lengths=tuple(length for length, _ in lengths),
        cloud=cloud,
        picks=tuple(picks),
        warnings=(*source.notes, *_coarse([length for length, _ in lengths], source)),
        named=tuple(source.named),
    )


def _part(root: Node, key: str) -> Node:
    return (root.members or {}).get(key, Node())


def _unit(top: Entry) -> Optional[str]:
    if not top.has("unit"):
        return None
    node = top.fields["unit"]
    if node.text in _UNITS:
        return node.text
    meant = _UNIT_WORDS.get((node.text or "").strip().lower())
    hint = f"did you mean {quoted(meant)}?" if meant else near_miss(node.text or "", _UNITS)
    raise top.error(f"unit is {node.said}: {hint}; it may be m, ft or us-ft")


def _plane(top: Entry) -> Optional[Plane]:
    if not top.has("crs"):
        return None
    text = top.fields["crs"].text
    if text is None:
        raise top.error(f"crs is {top.fields['crs'].said}: expected EPSG:n, WKT or a PROJ string")
    try:
        return plane_of(text)
    except CrsError as error:
        raise top.error(f"crs: {error}") from None


def _with_images(
    root: Node,
    source: Source,
    points: Mapping[str, ControlPoint],
    plane: Optional[Plane],
) -> Tuple[Mapping[str, ControlPoint], Sequence[Pick], Optional[Plane]]:
    """Add what was seen in photographs; points of the control file keep what it says of them."""
    node = _part(root, "images")
    if node.empty:
        return points, (), plane
    if node.text is None:
        raise ControlError(
            f"{source.file}: images is {node.said}: expected the path of a gcp_list.txt"
        )
    listed = read_gcp_rows(source.beside(node.text, "images"))
    seen = sightings(listed, points, plane)
    rows = {name: row for name, row in seen.points.items() if name not in points}
    if len(points) + len(rows) > MAX_POINTS:
        raise ControlError(f"{source.file}: more than {MAX_POINTS:,} points with those of images")
    plane = listed.plane if plane is None else plane
    added, warnings = control_points(listed, rows, plane)
    source.notes.extend([*seen.warnings, *warnings])
    return {**points, **added}, seen.picks, plane


def _checked_crs(
    points: Mapping[str, ControlPoint], plane: Optional[Plane], source: Source
) -> Optional[str]:
    """Return the CRS of positions that exist on the Earth; None when there are no positions."""
    x = [point.x for point in points.values() if point.x is not None]
    y = [point.y for point in points.values() if point.y is not None]
    if plane is None or not x:
        return None
    to_crs(x, y, plane.crs, _WGS84.crs, source.file)
    return plane.crs


def _coarse(lengths: Sequence[Length], source: Source) -> List[str]:
    """Warn of accuracies that are more than what they are of."""
    coarse = [
        f"{length.start}-{length.end}"
        for length in lengths
        if length.accuracy_m is not None and length.accuracy_m >= length.length_m
    ]
    if not coarse:
        return []
    return [
        f"{source.file}: the accuracy is as large as the length itself ({', '.join(coarse[:5])}); "
        "it is one standard deviation, in the same unit"
    ]
