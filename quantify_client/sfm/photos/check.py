"""Photographs, checked before any is sent: what hours of uploading must not end with.

Nothing is decoded: whether a file is whole, and what its header says, is told by its structure (see
`formats`), which takes milliseconds where decoding takes half a second.
"""

from __future__ import annotations

import os
import struct
import unicodedata
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Dict, Iterable, Iterator, List, Mapping, Optional, Sequence, Tuple, Union

from ...errors import InputError
from ...files.reading import real_path
from ...types import Notice
from ..redaction import plain
from .formats import KINDS, header, kind_of, truncation

__all__ = ["Photo", "PhotoSummary", "check_photos"]

SUFFIXES = (".jpg", ".jpeg", ".tif", ".tiff", ".dng", ".png")
FEWEST = 3  # fewer share no point
SHOWN = 3  # names in a message
_OTHERS: Mapping[str, str] = {
    **dict.fromkeys((".heic", ".heif", ".hif", ".avif", ".webp"), "HEIC, AVIF or WebP"),
    **dict.fromkeys(
        (".cr2", ".cr3", ".nef", ".arw", ".raf", ".orf", ".rw2", ".pef"), "a camera's raw data"
    ),
}
"""Photographs that are not sent, by their suffixes: OpenDroneMap does not take them everywhere."""
_MOST_LOOKED_AT = 20_000  # files in folders within a folder


@dataclass(frozen=True)
class Photo:
    """A photograph: its file, its size in bytes and pixels, and what its header says.

    `camera` is make and model; `lonlat` where it was taken, degrees on WGS84, or None, and
    `altitude`, metres, or None.
    """

    path: Path
    size: int
    mtime_ns: int
    width: int
    height: int
    camera: str
    lonlat: Optional[Tuple[float, float]]
    altitude: Optional[float]

    @property
    def has_gps(self) -> bool:
        """Whether latitude and longitude are there."""
        return self.lonlat is not None

    @property
    def name(self) -> str:
        """The name that the node is to know it by."""
        return self.path.name


@dataclass(frozen=True)
class PhotoSummary:
    """All photographs of a job, in the order of their names, and what is worth saying of them."""

    photos: Tuple[Photo, ...]
    ignored: Tuple[Path, ...]
    warnings: Tuple[Notice, ...]

    @property
    def size(self) -> int:
        """Bytes of all files."""
        return sum(photo.size for photo in self.photos)

    @property
    def with_gps(self) -> int:
        """How many photographs know where they were taken."""
        return sum(photo.has_gps for photo in self.photos)

    @property
    def words(self) -> str:
        """One line: how many there are, how large, and from which cameras."""
        cameras = ", ".join(f"{name} ({count})" for name, count in self.cameras.items())
        size = f"{len(self.photos)}, {self.size / 1e6:.1f} MB"
        return f"{size}, {self.with_gps} with GPS, from {cameras}"

    @property
    def cameras(self) -> Mapping[str, int]:
        """How many photographs each camera took, the busiest first."""
        return dict(Counter(photo.camera for photo in self.photos).most_common())


def check_photos(paths: Iterable[Union[str, Path]], *, allow_faulty: bool = False) -> PhotoSummary:
    """Return what the photographs' headers say; a folder stands for those directly in it.

    Parameters
    ----------
    paths : files and folders.
    allow_faulty : leave photographs that cannot be used out, with a warning, instead of raising.

    Raises
    ------
    InputError
        None or too few are there, some cannot be used, or two have the same name.
    """
    files, ignored = _expanded([Path(path) for path in paths])
    looked = {path: _look(path) for path in files}
    photos = [found for found in looked.values() if isinstance(found, Photo)]
    faults = {path: found for path, found in looked.items() if isinstance(found, str)}
    if faults and not allow_faulty:
        raise InputError(_told(faults, len(files)))
    _refuse_namesakes(photos)
    left_out = list(_left_out(ignored))
    if len(photos) < FEWEST:
        more = " ".join(("", *left_out)) if left_out else ""
        raise InputError(
            f"{len(photos)} photographs are there, expected at least {FEWEST} that overlap; give "
            f"files or folders of {', '.join(KINDS)}.{more}"
        )
    photos.sort(key=lambda photo: photo.name)
    notes = [*_notes(photos), *left_out]
    if faults:
        text = _told(faults, len(files)) + " They are left out."
        notes.insert(0, Notice("photographs-faulty", text, photographs=len(faults)))
    return PhotoSummary(tuple(photos), tuple(ignored), tuple(notes))


def _expanded(paths: Sequence[Path]) -> Tuple[List[Path], List[Path]]:
    """Return the files to look at, each once, and what in folders is no photograph."""
    files: Dict[Path, Path] = {}
    ignored: List[Path] = []
    for path in paths:
        if not path.is_dir():
            files.setdefault(real_path(path), path)
            continue
        try:
            inside = sorted(item for item in path.iterdir() if not item.name.startswith("."))
        except OSError as error:
            raise InputError(f"{path}: cannot be listed ({error.strerror or error})") from error
        for item in inside:
            if item.suffix.lower() in SUFFIXES and not item.is_dir():
                files.setdefault(real_path(item), item)
            else:
                ignored.append(item)
    return list(files.values()), ignored


def _look(path: Path) -> Union[Photo, str]:
    """Return a photograph, or what is wrong with it."""
    try:
        if not path.is_file():
            return "is not a file" if path.exists() else "does not exist"
        status = path.stat()
        if status.st_size == 0:
            return "is empty"
        if any(c == "\\" or unicodedata.category(c) in ("Cc", "Cs") for c in path.name):
            return "has a name that no server can keep; rename it"
        kind = kind_of(path)
        other = _OTHERS.get(path.suffix.lower())
        if other is not None:
            return f"is {other}, which is not sent; convert it to JPEG, with its EXIF"
        if kind is None:
            return f"is no {', '.join(KINDS)}"
        if path.suffix.lower() not in SUFFIXES:
            return f"is a {kind} without its suffix, which OpenDroneMap goes by; rename it"
        cut = truncation(path, kind)
        if cut is not None:
            return cut
        found = header(path, kind)
    except OSError as error:
        return f"cannot be read ({error.strerror or plain(error, 60)})"
    except (ValueError, struct.error) as error:
        return f"has a damaged header ({error})"
    return Photo(path, status.st_size, status.st_mtime_ns, *found)


def _told(faults: Mapping[Path, str], count: int) -> str:
    told = [f"{path} {fault}" for path, fault in list(faults.items())[:SHOWN]]
    more = f"; and {len(faults) - SHOWN} more" if len(faults) > SHOWN else ""
    return (
        f"{len(faults)} of {count} photographs cannot be used: {'; '.join(told)}{more}; replace "
        "or leave out these files."
    )


def _refuse_namesakes(photos: Sequence[Photo]) -> None:
    """Raise InputError for two photographs of one name: nodes rename one, capitals do not count."""
    first: Dict[str, Photo] = {}
    for photo in photos:
        other = first.setdefault(photo.name.casefold(), photo)
        if other is not photo:
            raise InputError(
                f"{other.path} and {photo.path} have the same name, which a node cannot keep "
                "apart (capitals do not count); rename one"
            )


def _notes(photos: Sequence[Photo]) -> Iterator[Notice]:
    missing = sum(not photo.has_gps for photo in photos)
    if missing == len(photos):
        yield Notice(
            "photographs-without-gps",
            "No photograph has a GPS position: without control the result has no true size.",
            photographs=missing,
        )
    elif missing:
        yield Notice(
            "photographs-without-gps",
            f"{missing} of {len(photos)} photographs have no GPS position.",
            photographs=missing,
        )
    cameras = sorted({photo.camera for photo in photos})
    if len(cameras) > 1:
        yield Notice(
            "photographs-of-several-cameras",
            f"The photographs are from {len(cameras)} cameras: {', '.join(cameras)}.",
            cameras=cameras,
        )


def _left_out(ignored: Sequence[Path]) -> Iterator[Notice]:
    """Yield a notice of what in the folders may have been meant, and is not sent."""
    texts = [path for path in ignored if path.suffix.lower() == ".txt"]
    if texts:
        yield Notice(
            "text-files-not-sent",
            f"Not sent, because a node takes any text file for GCPs: {_names(texts)}.",
            files=len(texts),
        )
    for other in dict.fromkeys(_OTHERS.values()):
        found = [path for path in ignored if _OTHERS.get(path.suffix.lower()) == other]
        if found:
            yield Notice(
                "photographs-to-be-converted",
                f"Not sent, because they are {other}: {len(found)} files ({_names(found)}); "
                "convert them to JPEG, with their EXIF.",
                files=len(found),
                format=other,
            )
    inside = {folder: _photographs_in(folder) for folder in ignored if folder.is_dir()}
    inside = {folder: count for folder, count in inside.items() if count}
    if inside:
        count = sum(inside.values())
        yield Notice(
            "folders-not-searched",
            f"Not sent: {count} photographs in {len(inside)} folders within the one given "
            f"({_names(list(inside))}); give these folders, too, if they belong to it.",
            photographs=count,
            folders=len(inside),
        )


def _names(paths: Sequence[Path]) -> str:
    more = ", ..." if len(paths) > SHOWN else ""
    return plain(", ".join(path.name for path in paths[:SHOWN]) + more)


def _photographs_in(folder: Path) -> int:
    """Count what may be photographs in a folder and in those within it; not all of a large disk."""
    count = seen = 0
    for _, _, names in os.walk(folder):
        seen += len(names) + 1
        count += sum(Path(name).suffix.lower() in (*SUFFIXES, *_OTHERS) for name in names)
        if seen > _MOST_LOOKED_AT:
            break
    return count
