"""Control from a control file, a table of points, or ODM's gcp_list.txt."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import List, Mapping, Optional, Sequence, Tuple, Union

import numpy as np

from ...crs import PlaneCoordinates, plane_of
from ...crs.frame import UNITS_M
from ...errors import ControlError, CrsError
from ...types.notice import Notice
from .entries import Entry, near_miss
from .gcp_list import parse_gcp_list, points_and_picks, read_gcp_list, to_crs
from .keys import CONTROL_KEYS, MAX_POINTS, UNIT_WORDS, UNITS, Keys
from .model import Control, ControlPoint, Length, Pick
from .points_and_lengths import ControlFile, read_cloud, read_lengths, read_points
from .syntax import SyntaxNode, quoted, read_json, read_text, read_yaml
from .tables import is_point_table

__all__ = ["read_control", "require_self_contained"]

_WGS84 = PlaneCoordinates("EPSG:4326", None)
_ENDINGS = {".yaml": "yaml", ".yml": "yaml", ".json": "json", ".csv": "table"}
_CRS_LINE = re.compile(r"(EPSG:\d+|WGS\s*84\s+UTM|\+proj=|\+init=)", re.IGNORECASE)


def read_control(path: Union[str, Path]) -> Control:
    """Return relative control, checked in itself; lengths in metres, accuracies one sigma.

    A control file in YAML (``.yaml``, ``.yml``) or JSON (``.json``), OpenDroneMap's gcp_list.txt
    (``.txt``), or a CSV table of points alone (``.csv``, or ``.txt`` with such headings). With any
    other ending the content decides. Whether it fixes a scale is judged by the adjustment.

    Parameters
    ----------
    path : of the file. Paths in it are relative to it.

    Raises
    ------
    ControlError
        One line: the file, where in it, what was found, what was expected and what to do.
    """
    return _read(ControlFile(Path(path)))


def require_self_contained(path: Union[str, Path]) -> None:
    """Refuse a control file that names other files: of a stranger's, they are not to be read.

    Raises
    ------
    ControlError
        It does, or it cannot be read.
    """
    _read(ControlFile(Path(path), alone=True))


def _read(file: ControlFile) -> Control:
    text = read_text(file.path)
    form = _format(file.path, text)
    if form == "gcp_list":
        listed = parse_gcp_list(text, file.name)
        points, picks, notes = points_and_picks(listed, {}, None)
        positions = any(point.x is not None for point in points.values())
        return Control(
            label=str(file.path),
            crs=listed.plane.crs if positions else None,
            points=points,
            picks=tuple(picks),
            warnings=tuple(notes),
        )
    if form == "table":
        root = SyntaxNode(members={"points": SyntaxNode(file.path.name)})
        return _control(root, replace(file, alone=False))
    return _control((read_yaml if form == "yaml" else read_json)(text, file.name), file)


def _format(path: Path, text: str) -> str:
    """Return the format by the file's ending, else by how it begins."""
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


def _control(root: SyntaxNode, file: ControlFile) -> Control:
    """Put the parts of a control file together, and check what each says of the others."""
    nothing = ControlError(f"{file.name} is empty; expected points, distances or scale bars")
    if root.empty:
        raise nothing
    if root.members is None:
        raise ControlError(
            f"{file.name} is {root.described}: expected a mapping, with lines such as "
            "'crs: EPSG:4326'"
        )
    top = Entry(file.name, root.members, None)
    top.only(CONTROL_KEYS)
    unit = _unit(top)
    file = replace(file, unit=unit, unit_m=None if unit is None else UNITS_M[unit])
    top = replace(top, unit_m=file.unit_m)
    part = {key: root.members.get(key, SyntaxNode()) for key in CONTROL_KEYS}
    plane = _plane(top)
    points = read_points(part["points"], file, plane)
    plane = plane or _assumed_plane(points, file)
    cloud = read_cloud(part["cloud"], file)
    points, picks, plane = _with_images(part["images"], file, points, plane)
    known: Keys = dict.fromkeys([*points, *cloud], ())
    lengths = [
        length
        for key in ("distances", "scale_bars")
        for length in read_lengths(part[key], key, file, known)
    ]
    if not (points or cloud or lengths or picks):
        raise nothing
    return Control(
        label=str(file.path),
        crs=_checked_crs(points, plane, file.name),
        height_m=top.elevation_m("height"),
        points=points,
        lengths=tuple(lengths),
        cloud=cloud,
        picks=tuple(picks),
        warnings=(*file.notes, *_coarse(lengths, file.name)),
        named=tuple(file.named),
    )


def _unit(top: Entry) -> Optional[str]:
    if not top.has("unit"):
        return None
    node = top.fields["unit"]
    if node.text in UNITS:
        return node.text
    meant = UNIT_WORDS.get((node.text or "").strip().lower())
    hint = f"did you mean {quoted(meant)}?" if meant else near_miss(node.text or "", UNITS)
    raise top.error(f"unit is {node.described}: {hint}; it may be m, ft or us-ft")


def _plane(top: Entry) -> Optional[PlaneCoordinates]:
    if not top.has("crs"):
        return None
    node = top.fields["crs"]
    if node.text is None:
        raise top.error(f"crs is {node.described}: expected EPSG:n, WKT or a PROJ string")
    try:
        return plane_of(node.text)
    except CrsError as error:
        raise top.error(f"crs: {error}") from None


def _assumed_plane(
    points: Mapping[str, ControlPoint], file: ControlFile
) -> Optional[PlaneCoordinates]:
    """Return WGS 84 for positions that are given without a CRS, and note it; None without any."""
    if all(point.x is None for point in points.values()):
        return None
    text = f"{file.name}: no crs is given; lat and lon are taken as WGS84 (EPSG:4326)"
    file.notes.append(Notice("crs-assumed", text, crs=_WGS84.crs))
    return _WGS84


def _with_images(
    node: SyntaxNode,
    file: ControlFile,
    points: Mapping[str, ControlPoint],
    plane: Optional[PlaneCoordinates],
) -> Tuple[Mapping[str, ControlPoint], Sequence[Pick], Optional[PlaneCoordinates]]:
    """Add what was seen in photographs; points of the control file keep what it says of them."""
    if node.empty:
        return points, (), plane
    if node.text is None:
        raise ControlError(
            f"{file.name}: images is {node.described}: expected the path of a gcp_list.txt"
        )
    listed = read_gcp_list(file.beside(node.text, "images"))
    added, picks, notes = points_and_picks(listed, points, plane)
    if len(points) + len(added) > MAX_POINTS:
        raise ControlError(f"{file.name}: more than {MAX_POINTS:,} points with those of images")
    file.notes.extend(notes)
    return {**points, **added}, picks, listed.plane if plane is None else plane


def _checked_crs(
    points: Mapping[str, ControlPoint], plane: Optional[PlaneCoordinates], label: str
) -> Optional[str]:
    """Return the CRS of positions that exist on the Earth; None when there are no positions."""
    positions = [(point.x, point.y) for point in points.values() if point.x is not None]
    if plane is None or not positions:
        return None
    x, y = np.array(positions, dtype=np.float64).T.copy()
    to_crs(x, y, plane.crs, _WGS84.crs, label)
    return plane.crs


def _coarse(lengths: Sequence[Length], label: str) -> List[Notice]:
    """Return a warning of accuracies that are more than what they are of."""
    coarse = [
        f"{length.start}-{length.end}"
        for length in lengths
        if length.accuracy_m is not None and length.accuracy_m >= length.length_m
    ]
    text = (
        f"{label}: the accuracy is as large as the length itself ({', '.join(coarse[:5])}); it is "
        "one standard deviation, in the same unit"
    )
    return [Notice("accuracy-coarse", text, lengths=coarse)] if coarse else []
