"""A file's ending decides what may open it, and its first bytes have to agree.

Libraries that open "whatever this is" look at the content alone, and some formats only name
another file or a server: an OGR VRT called ``areas.kml`` would read what it names. So, for every
reader that opens files through such a library (GDAL, by pyogrio or rasterio):

- the ending names the one format that is read, and the file begins as that format does;
- a library that can be told its driver is told (rasterio: ``driver="GTiff"``); for one that
  cannot, the beginning leaves no other driver a word to recognise (:func:`require_signature`);
- the library sees a copy, alone in a folder with the files that belong to it
  (:func:`private_copy`): no link leads elsewhere, nothing changes while it is read, and nothing
  is written beside the user's file.
"""

from __future__ import annotations

from contextlib import contextmanager
from pathlib import Path
from typing import Iterator, Sequence, Type

from ..errors import InputError
from .reading import read_small, real_path
from .writing import scratch

__all__ = ["private_copy", "require_signature"]

#: Each has a zero byte early on, so that no search for text gets beyond it.
_SIGNATURES = {
    ".shp": (b"\x00\x00\x27\x0a",),
    ".gpkg": (b"SQLite format 3\x00",),
    ".fgb": (b"fgb\x03fgb\x00", b"fgb\x03fgb\x01"),
    ".tif": (b"II*\x00", b"MM\x00*", b"II+\x00", b"MM\x00+"),
}


def require_signature(path: Path, data: bytes, error: Type[InputError]) -> None:
    """Raise `error` when a file does not begin as its ending says."""
    ending = path.suffix.lower()
    if not data.startswith(_SIGNATURES[ending]):
        raise error(
            f"{path.name} is no {ending} file: its first bytes are {data[:12]!r}; expected those "
            "of the format that its ending names: export it again, or as GeoJSON"
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
    """Give the copy of a file, in a folder of its own that is gone afterwards.

    Parameters
    ----------
    path : where it is, resolved.
    data : what it holds.
    beside : what is added to the name without its ending to get those of the files that belong
        to it, such as ``.dbf``; they may be missing or empty.
    most : bytes of each of these.
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
            (Path(folder) / f"file{ending}").write_bytes(part)
        yield copy
