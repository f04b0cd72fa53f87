"""Where OpenDroneMap puts what, across its versions: finding the cloud and the CRS beside it."""

from __future__ import annotations

import html
import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, List, Mapping, Optional, Sequence, Tuple

from ...cloud import Fetch
from ...cloud.base import naming
from ...errors import CloudError
from ...files.reading import real_path
from ...types import Bounds, Notice

GEOREFERENCING, ENTWINE = "odm_georeferencing", "entwine_pointcloud"
MODELS = tuple(
    f"odm_georeferenced_model{suffix}" for suffix in (".laz", ".las", ".copc.laz", ".ply", ".csv")
)
SIDECARS = ("coords.txt", "proj.txt", "odm_georeferencing_model_geo.txt")
"""Files beside the model that name its CRS; the last one is coords.txt in old versions."""
SIDECAR_BYTES = 4096

SHOTS = "odm_report/shots.geojson"
CAMERAS = "cameras.json"
CONTROL_POSITIONS = f"{GEOREFERENCING}/ground_control_points.geojson"
"""Where the photographs were taken, with which cameras, and what became of the GCPs."""
CAMERA_FILES = (SHOTS, CAMERAS, CONTROL_POSITIONS)
CAMERA_BYTES = 100_000_000

MINIMAL_OUTPUTS: Tuple[str, ...] = (
    f"{GEOREFERENCING}/{MODELS[0]}",
    *(f"{GEOREFERENCING}/{name}" for name in SIDECARS[:2]),
    CONTROL_POSITIONS,
    SHOTS,
    CAMERAS,
    "odm_report/stats.json",
    "images.json",
    "log.json",
)
"""What measuring, scaling and an honest error need; a node leaves out what is missing."""

_FALLBACKS = (f"{ENTWINE}/ept.json", "odm_filterpoints/point_cloud.ply")
_TILES = (".laz", ".las")
_DEPTH = 2  # folders between the one given and a project
_UTM = re.compile(r"WGS84\s+UTM\s+(\d{1,2})\s*([NS])", re.IGNORECASE)
_PAM = re.compile(r"<SRS\b[^>]*>([^<]+)</SRS>")
_BESIDE_BYTES = 1 << 16
_FAR = 200_000.0  # metres: no survey reaches that far from ODM's offset


@dataclass(frozen=True)
class Sidecar:
    """A CRS found beside a cloud, and ODM's offset (easting, northing) where it is given."""

    crs: str
    origin: str
    offset: Optional[Tuple[float, float]] = None

    def fits(self, bounds: Optional[Bounds]) -> bool:
        """False when the cloud is nowhere near the offset, so in coordinates of its own."""
        if bounds is None or self.offset is None:
            return True
        middle = ((bounds.min_x + bounds.max_x) / 2, (bounds.min_y + bounds.max_y) / 2)
        return math.dist(middle, self.offset) <= _FAR


@dataclass(frozen=True)
class LocatedCloud:
    """The files of a cloud, and what is known of it beyond their contents.

    Attributes
    ----------
    paths : where the files are, for now.
    is_odm : whether OpenDroneMap made it.
    sidecar : the CRS found beside it.
    warnings : what is odd about it.
    inputs : what it was made of, as in ``Source.inputs``; None for the files themselves.
    alias : a temporary folder, and what users know it by.
    fetch : brings the other files of an EPT set.
    stem : a name for the result, where the files do not tell it.
    """

    paths: Tuple[Path, ...]
    is_odm: bool
    sidecar: Optional[Sidecar] = None
    warnings: Sequence[Notice] = ()
    inputs: Optional[Sequence[Mapping[str, Any]]] = None
    alias: Optional[Tuple[str, str]] = None
    fetch: Optional[Fetch] = None
    stem: Optional[str] = None


def find_cloud(folder: Path) -> LocatedCloud:
    """Return the cloud in a folder: an ODM project or a part of it, an EPT set, or tiles.

    Raises
    ------
    CloudError
        No cloud, or several projects; the message says what was looked for.
    """
    with naming(folder, "expected a folder that can be listed"):
        found = _in_project(folder)
        if found is None and real_path(folder).name in (GEOREFERENCING, ENTWINE):
            found = _in_project(folder.parent if folder.name else real_path(folder).parent)
        if found is None:
            found = _below(folder) or _as_tiles(folder)
    if found is None:
        raise CloudError(
            f"{folder}: holds no point cloud; looked for {GEOREFERENCING}/{', '.join(MODELS)}, "
            f"{', '.join(_FALLBACKS)} and .laz or .las tiles; give the folder of an ODM project "
            "whose processing has finished"
        )
    return found


def _in_project(root: Path) -> Optional[LocatedCloud]:
    for name in MODELS:
        for path in (root / GEOREFERENCING / name, root / name):
            if path.is_file():
                return LocatedCloud((path,), True, read_sidecar(path))
    entwine, filtered = (root / name for name in _FALLBACKS)
    if entwine.is_file():
        return LocatedCloud((entwine,), True, read_sidecar(entwine))
    if filtered.is_file():
        note = Notice(
            "cloud-before-georeferencing",
            f"{filtered}: no georeferenced model was found, so the cloud before georeferencing is "
            "used; its coordinates are local and belong to no CRS",
            file=str(filtered),
        )
        return LocatedCloud((filtered,), True, warnings=(note,))
    return None


def _below(folder: Path) -> Optional[LocatedCloud]:
    """Return the one project in the folders below, such as an unpacked all.zip."""
    level = [folder]
    for _ in range(_DEPTH):
        level = sorted(path for parent in level for path in parent.iterdir() if path.is_dir())
        projects = [found for found in map(_in_project, level) if found is not None]
        if len(projects) > 1:
            names = ", ".join(str(found.paths[0]) for found in projects[:3])
            raise CloudError(
                f"{folder}: holds {len(projects)} ODM projects ({names}); give one of them"
            )
        if projects:
            return projects[0]
    return None


def _as_tiles(folder: Path) -> Optional[LocatedCloud]:
    ept = folder / "ept.json"
    files = [ept] if ept.is_file() else sorted(folder.iterdir())
    tiles = tuple(path for path in files if path == ept or path.suffix.lower() in _TILES)
    return LocatedCloud(tiles, False, read_sidecar(tiles[0])) if tiles else None


def belongs_to_odm(path: Path) -> bool:
    """Whether a single file is ODM's georeferenced model or its EPT, by its name or its folder."""
    real = real_path(path)
    return path.name in MODELS or GEOREFERENCING in real.parts or _is_entwine(real)


def _is_entwine(real: Path) -> bool:
    return real.name == "ept.json" and real.parent.name == ENTWINE


def project_of(path: Path) -> Optional[Path]:
    """Return the folder of the ODM project that a cloud's file is in; None where it is in none."""
    folder = real_path(path).parent
    inner = (GEOREFERENCING, *(Path(name).parts[0] for name in _FALLBACKS))
    for parent in (folder.parent if folder.name in inner else folder, folder.parent.parent):
        if any((parent / name).is_file() for name in CAMERA_FILES):
            return parent
    return None


def read_sidecar(cloud: Path) -> Optional[Sidecar]:
    """Return the CRS in the files that ODM writes beside its model, or GIS programs beside a cloud.

    The model is already in full coordinates: the offset in coords.txt is not to be added, it only
    tells whether the CRS can be that of the cloud.
    """
    if not belongs_to_odm(cloud):
        return _crs_beside(cloud)
    real = real_path(cloud)
    folder = real.parent.parent / GEOREFERENCING if _is_entwine(real) else real.parent
    for name in SIDECARS:
        lines = [line.strip() for line in _read_head(folder / name, SIDECAR_BYTES).splitlines()]
        lines = [line for line in lines if line]
        crs = _crs(lines[0]) if lines else None
        if crs is not None:
            return Sidecar(crs, name, _offset(lines))
    return None


def _crs_beside(cloud: Path) -> Optional[Sidecar]:
    """Return what cloud.prj (ESRI) or cloud.laz.aux.xml (GDAL) says."""
    for path in (cloud.with_suffix(".prj"), cloud.with_name(f"{cloud.name}.aux.xml")):
        text = _read_head(path, _BESIDE_BYTES).strip()
        if path.suffix == ".xml":
            found = _PAM.search(text)
            text = html.unescape(found.group(1)).strip() if found else ""
        if text:
            return Sidecar(text, path.name)
    return None


def _read_head(path: Path, most: int) -> str:
    """Return the beginning of a small text file; nothing where there is none."""
    with naming(path, "expected a small text file that names a CRS"):
        if not path.is_file():
            return ""
        with path.open("rb") as stream:
            return stream.read(most).decode("utf-8-sig", "replace")


def _crs(line: str) -> Optional[str]:
    utm = _UTM.fullmatch(line)
    if utm and 1 <= int(utm.group(1)) <= 60:
        return f"EPSG:{'326' if utm.group(2) in 'Nn' else '327'}{int(utm.group(1)):02d}"
    return line if line.startswith("+") or line.upper().startswith("EPSG:") else None


def _offset(lines: List[str]) -> Optional[Tuple[float, float]]:
    try:
        east, north = (float(value) for value in lines[1].split()[:2])
    except (IndexError, ValueError):
        return None
    return (east, north) if math.isfinite(east) and math.isfinite(north) else None
