"""Read files that somebody gives: of bounded size, and as the format that their ending names.

Libraries that open "whatever this is" look at the content alone, and some formats only name
another file or a server: an OGR VRT called ``areas.kml`` would read what it names. So, for every
reader that opens files through such a library (GDAL, by pyogrio or rasterio):

- the ending names the one format that is read, and the file begins as that format does;
- a library that accepts a driver is given it (rasterio: ``driver="GTiff"``); for one that does
  not, the beginning of the file fits no other driver (:func:`require_signature`);
- the library sees a copy, alone in a folder with the files that belong to it
  (:func:`private_copy`): no link leads elsewhere, nothing changes while it is read, and nothing
  is written beside the user's file. A raster may be too large for a copy: it is read in place,
  and GDAL told that the folder is empty (:mod:`quantify_client.cloud.raster`).
"""

from __future__ import annotations

import json
import os
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Iterator, Optional, Sequence, Type, Union

from ..errors import InputError, QuantifyError
from .writing import scratch

__all__ = [
    "count_values",
    "parsed_json",
    "private_copy",
    "read_small",
    "real_path",
    "require_signature",
]

#: Each has a zero byte early on, so that no search for text gets beyond it.
_SIGNATURES = {
    ".shp": (b"\x00\x00\x27\x0a",),
    ".gpkg": (b"SQLite format 3\x00",),
    ".fgb": (b"fgb\x03fgb\x00", b"fgb\x03fgb\x01"),
    **dict.fromkeys((".tif", ".tiff"), (b"II*\x00", b"MM\x00*", b"II+\x00", b"MM\x00+")),
}

#: What is often found in place of a file, by its beginning in lower case.
_NOT_THE_FILE = (
    (
        b"version https://git-lfs",
        "is a Git LFS pointer, not the file itself; fetch that with 'git lfs pull', or download it",
    ),
    (
        b"pk\x03\x04",
        "is a zip archive (as .kmz and .xlsx are), not {what}; unpack it, or export it",
    ),
    (
        (b"<!doctype html", b"<html"),
        "is a web page, not {what}; log in where it comes from and download the file",
    ),
    (
        (b"lasf", b"ply\n", b"ply\r"),
        "is a point cloud, not {what}; give it as the source, and {what} in another file",
    ),
)


def real_path(path: Union[str, Path]) -> Path:
    """Return a path without links; of links that lead in a circle, as far as they can be followed.

    ``Path.resolve`` raises a RuntimeError for such, before anybody can say what the file was for.
    """
    return Path(os.path.realpath(path))


def read_small(
    path: Path, *, most: int, what: str, error: Type[QuantifyError], label: Optional[str] = None
) -> bytes:
    """Read a file of at most `most` bytes, and name what is often found in its place.

    Parameters
    ----------
    what : what is expected, for messages.
    error : what is raised.
    label : the file's name in messages; its path when left out.
    """
    name = str(path)[:200] if label is None else label
    try:
        if not path.is_file():  # a device or pipe would never end
            state = "does not exist"
            if path.exists():
                state = "is a folder, not a file" if path.is_dir() else "is not a file"
            raise error(f"{name} {state}; expected {what}: check the path")
        with path.open("rb") as stream:
            data = stream.read(most + 1)
    except error:
        raise
    except (OSError, ValueError) as fault:
        said = getattr(fault, "strerror", None) or fault
        raise error(
            f"{name} cannot be read: {said}; check its path and permissions (expected {what})"
        ) from fault
    start = data[:512].lstrip(b"\xef\xbb\xbf \t\r\n").lower()
    if not start:
        raise error(f"{name} is empty; expected {what}")
    for beginnings, found in _NOT_THE_FILE:
        if start.startswith(beginnings):
            raise error(f"{name} {found.format(what=what)}")
    if len(data) > most:
        raise error(f"{name} is larger than {most // 1_000_000} MB; expected {what}")
    return data


def parsed_json(data: bytes, name: object, *, what: str, error: Type[QuantifyError]) -> Any:
    """Return the JSON that a file holds; `name`, `what` and `error` as for :func:`read_small`."""
    try:
        return json.loads(data)
    except RecursionError:
        raise error(
            f"{name} is nested too deeply; expected {what}: choose another, or get it once more"
        ) from None
    except UnicodeDecodeError:
        raise error(f"{name} is not in UTF-8; expected {what}: save it as UTF-8") from None
    except json.JSONDecodeError as fault:
        raise error(
            f"{name} is not valid JSON (line {fault.lineno}, column {fault.colno}: {fault.msg}); "
            f"expected {what}: choose another, or get it once more"
        ) from None
    except ValueError as fault:  # an integer of thousands of digits
        raise error(f"{name} holds a number that is none ({fault}); expected {what}") from None


def count_values(data: bytes) -> int:
    """Count at least as many values as a JSON text holds, before it is read: `[],` is 70 bytes."""
    return sum(map(data.count, (b",", b"[", b"{")))


def require_signature(
    path: Path, data: bytes, error: Type[InputError], instead: str = "as GeoJSON"
) -> None:
    """Raise `error` when a file does not begin as its ending says.

    `instead` says as what else it may be given.
    """
    ending = path.suffix.lower()
    if not data.startswith(_SIGNATURES[ending]):
        raise error(
            f"{path.name} is not a {ending} file: its first bytes are {data[:12]!r}; expected "
            f"those of the format that its ending names: export it again, or {instead}"
        )


@contextmanager
def private_copy(
    path: Path,
    data: bytes,
    *,
    beside: Sequence[str] = (),
    most: int,
    error: Type[InputError],
) -> Iterator[Path]:
    """Yield a copy of a file, in a folder of its own that is removed afterwards.

    Parameters
    ----------
    path : where it is, resolved.
    data : what it holds.
    beside : what is added to the name without its ending to get those of the files that belong
        to it, such as ``.dbf``; they may be missing or empty.
    most : bytes of each of these at most.
    error : what is raised when one of them is not in the file's own folder.
    """
    with scratch() as folder:
        copy = folder / f"file{path.suffix.lower()}"
        copy.write_bytes(data)
        for ending in beside:
            spellings = (path.with_name(path.stem + e) for e in (ending, ending.upper()))
            companion = next((p for p in spellings if p.is_file() and p.stat().st_size), None)
            if companion is None:
                continue
            if real_path(companion).parent != path.parent:
                raise error(
                    f"{companion.name} is a link to another folder; expected it beside "
                    f"{path.name}: copy it there"
                )
            part = read_small(companion, most=most, what=f"a part of {path.name}", error=error)
            (folder / f"file{ending}").write_bytes(part)
        yield copy
