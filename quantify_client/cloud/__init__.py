"""Files -> chunks of points.

:func:`open_cloud` is the front door; each format has a reader of its own behind it.
"""

from __future__ import annotations

from pathlib import Path
from typing import Callable, Dict, Mapping, Optional, Sequence

from ..errors import CloudError
from .base import DEFAULT_CHUNK, Cloud, Mesh, naming
from .ept.cloud import EptCloud
from .ept.index import Fetch
from .las.copc import open_las
from .nodata import without_placeholders
from .ply.cloud import PlyCloud
from .raster import RasterCloud
from .text import TextCloud
from .tiles import TiledCloud, require_distinct

__all__ = [
    "DEFAULT_CHUNK",
    "SUFFIXES",
    "Cloud",
    "Fetch",
    "Mesh",
    "open_cloud",
    "refuse_impostor",
    "require_readable",
]

_READERS: Dict[str, Callable[[Path], Cloud]] = {
    ".las": open_las,
    ".laz": open_las,
    ".ply": PlyCloud,
    ".csv": TextCloud,
    ".xyz": TextCloud,
    ".txt": TextCloud,
    ".tif": RasterCloud,
    ".tiff": RasterCloud,
}
SUFFIXES = tuple(_READERS)
"""The endings of the files that can be read (an EPT set is given by its ept.json)."""

_FEWEST = 4  # three points span a plane but no volume


def open_cloud(
    paths: Sequence[Path],
    fetchers: Optional[Mapping[Path, Fetch]] = None,
    *,
    any_crs: bool = False,
) -> Cloud:
    """Open a point cloud: one file, or several tiles of one survey in any mix of formats.

    LAS, LAZ, COPC and EPT are opened by their headers; PLY, text and GeoTIFF have no bounds
    in theirs and are read once here. An ept.json that has a fetcher is the only file of its set
    that has to be there. With `any_crs` tiles may name different CRSs: the user says in
    which they are.

    Raises
    ------
    CloudError
        A file that is missing, unreadable, damaged, of an unknown kind, given twice, in another
        CRS than the others; or fewer than 4 points in all.
    """
    files = [Path(path) for path in paths]
    if not files:
        raise CloudError("no point cloud is given; expected at least one file")
    require_distinct(files)
    clouds = [_open_one(path, (fetchers or {}).get(path)) for path in files]
    cloud = clouds[0] if len(clouds) == 1 else TiledCloud(clouds, any_crs=any_crs)
    count = cloud.info.point_count
    if count is not None and count < _FEWEST:
        held = "no points" if not count else f"only {count} point{'s' if count > 1 else ''}"
        raise CloudError(f"{files[0]}: holds {held}; expected at least {_FEWEST}")
    return without_placeholders(cloud, whole=not fetchers)


def open_positions(path: Path) -> Cloud:
    """Open a file of points that need not be a surface: any number of them, and at the origin, too.

    Raises
    ------
    CloudError
        A file that is missing, unreadable, damaged, or of an unknown kind.
    """
    return _open_one(path)


def _open_one(path: Path, fetch: Optional[Fetch] = None) -> Cloud:
    require_readable(path)
    if path.name.lower() == "ept.json":
        return EptCloud(path, fetch)
    return _READERS[path.suffix.lower()](path)


def require_readable(path: Path) -> None:
    """Raise CloudError for what is no file, has an unknown ending, or is an impostor."""
    with naming(path, "check the path"):
        if not path.exists():
            raise CloudError(f"{path}: does not exist; check the path")
        if not path.is_file():
            raise CloudError(f"{path}: is not a file; expected a point cloud")
    if path.suffix.lower() not in SUFFIXES and path.name.lower() != "ept.json":
        kinds = ", ".join(SUFFIXES)
        raise CloudError(
            f"{path}: has an unknown ending; expected {kinds}, an ept.json, an ODM project "
            "folder or an all.zip"
        )
    refuse_impostor(path)


def refuse_impostor(path: Path) -> None:
    """Raise CloudError for an empty file, a Git LFS pointer or a web page under another name."""
    with naming(path, "expected a file that can be read"), path.open("rb") as stream:
        head = stream.read(512)
    if not head:
        raise CloudError(f"{path}: is empty; copy, download or export it again")
    if head.startswith(b"version https://git-lfs"):
        raise CloudError(
            f"{path}: is a Git LFS pointer, not the file itself; run 'git lfs pull' where it "
            "comes from, or download the file itself"
        )
    start = head.lstrip(b"\xef\xbb\xbf \t\r\n").lower()
    if start.startswith((b"<!doctype", b"<html")):
        raise CloudError(
            f"{path}: is a web page (HTML), not a point cloud; log in where it comes from and "
            "download the file itself"
        )
