"""Where the photographs of a body were taken: given in a file, or told by the ODM project."""

from __future__ import annotations

import re
import struct
from contextlib import suppress
from pathlib import Path
from typing import List, Optional

import numpy as np

from ..cloud import open_positions
from ..cloud.text import as_number, is_comment, is_number, opened, split
from ..crs import Frame, positions_to
from ..errors import ControlError, CrsError, InputError
from ..options import Options
from ..sfm.odm.json_files import features, numbers, read_object
from ..sfm.odm.layout import SHOTS
from ..sfm.photos.formats import header, kind_of
from ..source import Source
from ..types import MAX_COORDINATE, FloatArray

__all__ = ["cameras_of"]

_MOST = 20_000  # more is a cloud
_EXPECTED = (
    "positions of cameras: ODM's odm_report/shots.geojson, a text file of x, y, z, with or "
    "without the name of a photograph before them, or a folder of photographs with GPS"
)
#: GPS of photographs is known to some 3 m: a tenth of this distance from the cloud (chosen).
_LEAST_BY_GPS = 30.0
_WGS84 = "EPSG:4326"
_LISTS = (".csv", ".txt", ".xyz")
_LARGEST_LIST = 5_000_000  # bytes
_CRS = re.compile(r"EPSG:|\+(proj|init)=|WGS ?84|(PROJ|GEOG|COMPD?)_?(CS|CRS)", re.I)


def cameras_of(source: Source, frame: Frame, options: Options) -> Optional[FloatArray]:
    """Return where cameras stood (K, 3), metres of the measuring frame; None where nobody knows.

    Raises
    ------
    InputError
        The file that the user gave holds no positions, or they are far from the cloud.
    """
    if options.cameras is None:
        path = None if source.project is None else source.project / SHOTS
        if path is None or not path.is_file():
            return None
        try:
            return _moved(_of_shots(path), frame)
        except ControlError:  # an old version's, and nobody asked for it
            return None
    name, places = str(options.cameras), _of_file(Path(str(options.cameras)), frame)
    if not 0 < len(places) <= _MOST:
        raise InputError(f"{name}: {len(places):,} places; expected {_EXPECTED}, 1 to {_MOST:,}")
    moved = _moved(places, frame)
    _require_near(source, frame, moved, name, by_gps=Path(name).is_dir())
    return moved


def _moved(places: FloatArray, frame: Frame) -> FloatArray:
    return np.column_stack(frame.to_frame(*places.T.copy()))


def _of_file(path: Path, frame: Frame) -> FloatArray:
    if path.is_dir():
        return _of_folder(path, frame)
    if path.suffix.lower() in (".geojson", ".json"):
        try:
            return _of_shots(path)
        except ControlError as error:
            raise InputError(str(error)) from error
    if path.suffix.lower() in _LISTS:
        listed = _of_photographs(path, frame)
        if listed is not None:
            return listed
    chunks = [np.column_stack([c.x, c.y, c.z]) for c in open_positions(path).chunks()]
    return np.vstack([np.empty((0, 3)), *chunks])


def _of_folder(folder: Path, frame: Frame) -> FloatArray:
    """Return where the photographs in a folder were taken, in the cloud's own coordinates."""
    found: List[List[float]] = []
    for path in sorted(path for path in folder.iterdir() if path.is_file()):
        with suppress(ValueError, struct.error, OSError):
            kind = kind_of(path)
            told = kind and header(path, kind)
            if told and told.lonlat is not None and told.altitude is not None:
                found.append([*told.lonlat, told.altitude / frame.z_unit_m])
    if not found:
        raise InputError(
            f"{folder}: no photograph in it says where it was taken (GPS with an altitude); "
            f"expected {_EXPECTED}"
        )
    return _from_crs(np.unique(np.array(found), axis=0), _WGS84, frame, folder)


def _of_photographs(path: Path, frame: Frame) -> Optional[FloatArray]:
    """Return the places in a list of photographs, in the cloud's own coordinates.

    In each line a name, x, y and z; the first one may be a CRS, as in ODM's geo.txt. None for what
    is no such list, or has named columns.
    """
    if not path.is_file() or path.stat().st_size > _LARGEST_LIST:
        return None
    with opened(path) as stream:
        numbered = [(n, line.strip()) for n, line in enumerate(stream, 1) if not is_comment(line)]
    crs = numbered[0][1] if numbered and _CRS.match(numbered[0][1]) else None
    numbered = numbered[0 if crs is None else 1 :]
    delimiter = next((sign for sign in ",;\t" if numbered and sign in numbered[0][1]), None)
    rows = [split(line, delimiter) for _, line in numbered]
    named = [len(r) > 3 and not is_number(r[0]) and all(map(is_number, r[1:4])) for r in rows]
    if not named or not named[0]:
        return None
    if not all(named):
        number, line = numbered[named.index(False)]
        raise InputError(
            f"{path}: line {number} is {line[:60]!r}, and no name, x, y and z; expected {_EXPECTED}"
        )
    found = np.array([[as_number(field) for field in row[1:4]] for row in rows])
    places: FloatArray = found[(np.abs(found) < MAX_COORDINATE).all(axis=1)]
    if crs is not None and len(places):
        places = _from_crs(places, crs, frame, path)
    return places


def _from_crs(places: FloatArray, crs: str, frame: Frame, path: Path) -> FloatArray:
    """Return places with x and y in the cloud's own CRS."""
    if frame.cloud_crs is None:
        raise InputError(
            f"{path}: its places are in {crs[:60]!r}, and the cloud has no CRS; give positions in "
            "the cloud's own coordinates, or the CRS of the cloud (--crs)"
        )
    try:
        x, y = places[:, :2].T.copy()
        return np.column_stack([*positions_to(x, y, crs, frame.cloud_crs), places[:, 2]])
    except CrsError as error:
        raise InputError(f"{path}: {error}") from error


def _of_shots(path: Path) -> FloatArray:
    """Return the places in a file as ODM writes it, in the cloud's own coordinates."""
    found: List[List[float]] = []
    for number, feature in enumerate(features(path, read_object(path, _EXPECTED), _EXPECTED)):
        place = numbers(feature["properties"].get("translation"), 3)
        if place is None:
            raise ControlError(
                f"{path}: feature {number + 1} has no translation of three numbers; expected "
                f"{_EXPECTED}"
            )
        found.append(list(place))
    return np.array(found)


def _require_near(
    source: Source, frame: Frame, cameras: FloatArray, name: str, by_gps: bool
) -> None:
    """Refuse cameras that cannot have taken this cloud: other coordinates, or another cloud.

    And, by GPS, those nearer to it than that can tell, or below it.
    """
    if source.cloud.info.bounds is None:
        return
    box = frame.bounds_to_frame(source.cloud.info.bounds)
    low, high = np.array([box.min_x, box.min_y]), np.array([box.max_x, box.max_y])
    room = 100.0 * float(np.max(high - low))
    away = np.median(cameras[:, :2], axis=0)
    if (away < low - room).any() or (away > high + room).any():
        raise InputError(
            f"{name}: its cameras are around x {away[0]:.2f}, y {away[1]:.2f} m, far from the "
            f"cloud (x {low[0]:.2f} to {high[0]:.2f}, y {low[1]:.2f} to {high[1]:.2f} m); give "
            "positions in the cloud's own coordinates"
        )
    highest = float(cameras[:, 2].max())
    if by_gps and highest < box.min_z:
        raise InputError(
            f"{name}: its photographs were taken at up to {highest:.0f} m (GPS), below "
            f"the cloud ({box.min_z:.0f} to {box.max_z:.0f} m); give the positions that the "
            "reconstruction found (odm_report/shots.geojson), in the cloud's own heights"
        )
    middle = [0.5 * (box.min_x + box.max_x), 0.5 * (box.min_y + box.max_y), box.max_z]
    distance = float(np.median(np.linalg.norm(cameras - middle, axis=1)))
    if by_gps and distance < _LEAST_BY_GPS:
        raise InputError(
            f"{name}: its photographs were taken {distance:.0f} m from the cloud, and their GPS is "
            f"known to some metres; expected {_LEAST_BY_GPS:.0f} m and more; give the positions "
            "that the reconstruction found (odm_report/shots.geojson)"
        )
