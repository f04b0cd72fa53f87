"""An all.zip: whether it is sound, and the point cloud in it, unpacked into a temporary folder.

An archive is somebody else's: names may lead out of the folder, a small file may unpack to a
huge one, the list of members may be longer than memory, and the end may be missing. All of that is
found before or while a member is written.
"""

from __future__ import annotations

import io
import re
import shutil
import stat
import zipfile
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Iterator, Optional, Sequence, Tuple

from ...cloud import SUFFIXES, refuse_impostor
from ...cloud.base import naming
from ...errors import CloudError
from ...files.writing import scratch
from ..redaction import plain
from .layout import (
    CAMERA_BYTES,
    CAMERA_FILES,
    GEOREFERENCING,
    MODELS,
    SIDECAR_BYTES,
    SIDECARS,
    LocatedCloud,
    read_sidecar,
)

__all__ = ["unpacked", "zip_fault"]

LIST = 10 << 20
"""Bytes of a zip's list of members: some 80,000; each takes a kilobyte of memory."""

_GIB = 1 << 30
_MAX_SIZE = 200 * _GIB
_MAX_RATIO = 100  # pictures and clouds, of which results are made, hardly pack at all
_SMALL = 10 << 20  # bytes: below this any ratio is harmless
_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)  # others unpack blocks of any size at once
_SPARE = 64 << 20  # bytes to leave free on the disk
_BLOCK = 1 << 20
_MAX_DEPTH = 6  # folders around odm_georeferencing
_DRIVE = re.compile(r"^[A-Za-z]:")
_AGAIN = "expected the complete all.zip of a task: download it again"


class _LongListError(Exception):
    """A zip's list of members is longer than any result's."""


class _Bounded(io.FileIO):
    """A file of which no more is read at once than a list of members may have.

    That list is what zipfile reads whole, at the length that the end of the file gives.
    """

    def read(self, size: Optional[int] = -1) -> bytes:
        data: bytes = super().read(LIST + 1 if size is None or size < 0 else min(size, LIST + 1))
        if len(data) > LIST:
            raise _LongListError
        return data


def zip_fault(path: Path) -> Optional[str]:
    """Return what is wrong with a zip, reading all of it; None when it is sound and not empty."""
    try:
        with _Bounded(str(path)) as file, zipfile.ZipFile(file) as archive:
            members = archive.infolist()
            whole, size = sum(member.file_size for member in members), path.stat().st_size
            if whole > _SMALL and whole > _MAX_RATIO * size:
                return f"unpacks to {whole // size} times its size, which no result does"
            broken = archive.testzip()
    except _LongListError:
        return "has more members than any result"
    except zipfile.BadZipFile:
        return "is no zip, or its end is missing"
    except (OSError, RuntimeError, NotImplementedError, EOFError, ValueError) as error:
        return f"cannot be read ({plain(error, 80)})"
    except Exception as error:  # zlib.error, lzma.LZMAError: what damaged data makes of them
        return f"is damaged ({type(error).__name__})"
    if broken is not None:
        return f"is damaged: {plain(broken, 80)} does not have its checksum"
    return None if members else "is empty"


@contextmanager
def unpacked(path: Path, *, cameras: bool = False) -> Iterator[LocatedCloud]:
    """Unpack the point cloud of an archive, which is there within the ``with`` block.

    With `cameras` the files that tell where the photographs were taken come out beside it.

    Raises
    ------
    CloudError
        No zip, truncated, encrypted, hostile, too large for the disk, or without a cloud.
    """
    refuse_impostor(path)
    with scratch() as folder:
        with naming(path, _AGAIN), _opened(path) as archive:
            members = archive.infolist()
            for member in members:
                _refuse_unsafe(path, member)
            chosen = _choose(path, members)
            parts = _parts(chosen)
            target = folder / "/".join(parts[-2:])
            _require_sound(path, chosen, folder)
            _write(path, archive, chosen, target, chosen.file_size)
            for place, member, most in _beside(members, parts, cameras):
                if place in CAMERA_FILES:
                    _require_sound(path, member, folder)
                _write(path, archive, member, folder / place, most)
        is_odm = target.parent.name.startswith("odm_")
        alias = (str(folder if is_odm else target.parent), str(path))
        yield LocatedCloud((target,), is_odm, read_sidecar(target), alias=alias)


@contextmanager
def _opened(path: Path) -> Iterator[zipfile.ZipFile]:
    with _Bounded(str(path)) as stream:
        try:
            archive = zipfile.ZipFile(stream)
        except _LongListError:
            raise CloudError(
                f"{path}: has a list of members of more than {LIST >> 20} MB, some 80,000 of "
                f"them; {_AGAIN}, or unpack it yourself and give the folder"
            ) from None
        except zipfile.BadZipFile:
            stream.seek(0)
            if stream.read(4) == b"PK\x03\x04":
                raise CloudError(
                    f"{path}: is truncated: the end of the zip is missing; {_AGAIN}"
                ) from None
            raise CloudError(f"{path}: is not a zip file, whatever its name; {_AGAIN}") from None
        with archive:
            yield archive


def _parts(member: zipfile.ZipInfo) -> Sequence[str]:
    """Folders and name; "/" first where it leads to the root, as pathlib has it, but faster."""
    name = member.filename.replace("\\", "/")
    parts = [part for part in name.split("/") if part not in ("", ".")]
    return ["/", *parts] if name.startswith("/") else parts


def _refuse_unsafe(path: Path, member: zipfile.ZipInfo) -> None:
    """One such member is reason enough to trust none of the archive."""
    parts, reason = _parts(member), None
    if ".." in parts or (parts and parts[0].startswith("/")) or _DRIVE.match(member.filename):
        reason = "leads out of the folder it is unpacked to"
    elif stat.S_ISLNK(member.external_attr >> 16):
        reason = "is a link"
    if reason:
        raise CloudError(
            f"{path}: its member {member.filename[:60]!r} {reason}, so all of it is refused; "
            f"{_AGAIN}"
        )


def _choose(path: Path, members: Sequence[zipfile.ZipInfo]) -> zipfile.ZipInfo:
    """Return the georeferenced model; else the one cloud there is."""
    files = [member for member in members if not member.is_dir() and _parts(member)]
    inside = [m for m in files if GEOREFERENCING in m.filename and len(_parts(m)) <= _MAX_DEPTH + 2]
    for name in MODELS:
        found = [m for m in inside if tuple(_parts(m)[-2:]) == (GEOREFERENCING, name)]
        if found:
            return _only(path, found)
    # Text files are none: ODM's outputs carry notes (task_output.txt, proj.txt). Rasters and
    # photographs have the same ending.
    suffixes = set(SUFFIXES) - {".txt", ".tif", ".tiff"}
    clouds = [m for m in files if Path(_parts(m)[-1]).suffix.lower() in suffixes]
    if clouds and not any(part.startswith("odm_") for m in files for part in _parts(m)):
        return _only(path, clouds)
    entwine = any(_parts(member)[-1] == "ept.json" for member in files)
    hint = "unpack it and give the folder, for its ept.json" if entwine else _AGAIN
    raise CloudError(
        f"{path}: holds no point cloud; looked for {GEOREFERENCING}/{', '.join(MODELS)}; {hint}"
    )


def _only(path: Path, found: Sequence[zipfile.ZipInfo]) -> zipfile.ZipInfo:
    if len(found) == 1:
        return found[0]
    names = ", ".join(repr(member.filename[:80]) for member in found[:3])
    raise CloudError(
        f"{path}: holds {len(found)} point clouds ({names}); unpack it and give the one meant, or "
        "all tiles of one survey"
    )


def _require_sound(path: Path, member: zipfile.ZipInfo, folder: Path) -> None:
    """Refuse what must not be unpacked before a byte of it is written."""
    # A member cannot be longer than what is left of the archive, whatever it claims.
    packed = min(member.compress_size, path.stat().st_size - member.header_offset)
    size = member.file_size
    name = f"{path}: its member {member.filename[:60]!r}"
    if member.flag_bits & 1:
        raise CloudError(f"{name} is encrypted; unpack it yourself and give the folder")
    if member.compress_type not in _METHODS:
        raise CloudError(
            f"{name} is packed by method {member.compress_type}; expected 8 (deflate) or 0: unpack "
            "it yourself and give the folder"
        )
    if size > _MAX_SIZE:
        raise CloudError(
            f"{name} claims {size / _GIB:.0f} GiB, more than the {_MAX_SIZE // _GIB} GiB that are "
            "unpacked at most; unpack it yourself if that is right"
        )
    if size > _SMALL and size > _MAX_RATIO * max(packed, 1):
        raise CloudError(
            f"{name} unpacks to {size // max(packed, 1)} times its size, which no point cloud "
            "does (a zip bomb?); unpack it yourself if you trust it"
        )
    free = shutil.disk_usage(folder).free
    if size + _SPARE > free:
        raise CloudError(
            f"{name} needs {size / _GIB:.1f} GiB in {folder.parent}, {free / _GIB:.1f} GiB are "
            "free; make room, or set TMPDIR to a larger disk"
        )


def _beside(
    members: Sequence[zipfile.ZipInfo], chosen: Sequence[str], cameras: bool
) -> Iterator[Tuple[str, zipfile.ZipInfo, int]]:
    """Yield what tells of the CRS and the photographs: place in the project, member, most bytes.

    What is too large is ignored, and so are small files that are encrypted or packed oddly.
    """
    root = chosen[:-2]
    found = {"/".join(_parts(m)[len(root) :]): m for m in members if _parts(m)[: len(root)] == root}
    limits = {"/".join((*chosen[-2:-1], name)): SIDECAR_BYTES for name in SIDECARS}
    limits.update(dict.fromkeys(CAMERA_FILES if cameras else (), CAMERA_BYTES))
    for place, most in limits.items():
        member = found.get(place)
        if member is None or member.file_size > most:
            continue
        if most > SIDECAR_BYTES or (member.compress_type in _METHODS and not member.flag_bits & 1):
            yield place, member, most


def _write(
    path: Path, archive: zipfile.ZipFile, member: zipfile.ZipInfo, target: Path, most: int
) -> None:
    """Unpack one member; zipfile itself checks its length and checksum at the end."""
    name = f"{path}: its member {member.filename[:60]!r}"
    target.parent.mkdir(exist_ok=True)
    written = 0
    with archive.open(member) as source, target.open("wb") as out:
        for block in iter(partial(source.read, _BLOCK), b""):
            written += len(block)
            if written > most:
                raise CloudError(f"{name} is larger than it claims; {_AGAIN}")
            out.write(block)
    if written != member.file_size:
        raise CloudError(f"{name} has {written} bytes of {member.file_size}; {_AGAIN}")
