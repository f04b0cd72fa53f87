"""An all.zip: only the point cloud comes out of it, and only into a folder that is removed again.

An archive is somebody else's: names may lead out of the folder, a small file may unpack to a
huge one, the list of members may be longer than memory, and the end may be missing. All of that is
found before or while a member is written.
"""

from __future__ import annotations

import re
import shutil
import stat
import zipfile
from contextlib import contextmanager
from pathlib import Path
from typing import Iterator, List, Optional, Sequence, Tuple

from ...cloud import SUFFIXES, refuse_impostor
from ...cloud.base import naming
from ...errors import CloudError
from ...files.writing import scratch
from ..servers.zips import LIST, Bounded, LongListError
from .layout import CAMERA_BYTES, CAMERA_FILES, GEOREFERENCING, MODELS, SIDECAR_BYTES, SIDECARS

_GIB = 1 << 30
_MAX_SIZE = 200 * _GIB
_MAX_RATIO = 100
_SMALL = 10 << 20  # bytes: below this any ratio is harmless
_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)  # others unpack blocks of any size at once
_SPARE = 64 << 20  # bytes to leave free on the disk
_BLOCK = 1 << 20
_MAX_DEPTH = 6  # folders around odm_georeferencing
_DRIVE = re.compile(r"^[A-Za-z]:")
_AGAIN = "expected the complete all.zip of a task: download it again"


@contextmanager
def unpacked(path: Path, *, cameras: bool = False) -> Iterator[Path]:
    """Unpack the point cloud of an archive; its path is valid within the ``with`` block.

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
            target = folder / "/".join(_parts(chosen)[-2:])
            target.parent.mkdir(exist_ok=True)
            _require_sound(path, chosen, folder)
            _write(path, archive, chosen, target, chosen.file_size)
            for sidecar in _sidecars(members, chosen):
                _write(path, archive, sidecar, target.parent / _parts(sidecar)[-1], SIDECAR_BYTES)
            for name, member in _cameras(members, chosen) if cameras else ():
                _require_sound(path, member, folder)
                (folder / name).parent.mkdir(exist_ok=True)
                _write(path, archive, member, folder / name, CAMERA_BYTES)
        yield target


@contextmanager
def _opened(path: Path) -> Iterator[zipfile.ZipFile]:
    with Bounded(str(path)) as stream:
        try:
            archive = zipfile.ZipFile(stream)
        except LongListError:
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
    shown = repr(member.filename[:60])
    parts = _parts(member)
    reason = None
    if ".." in parts or (parts and parts[0].startswith("/")) or _DRIVE.match(member.filename):
        reason = "leads out of the folder it is unpacked to"
    elif stat.S_ISLNK(member.external_attr >> 16):
        reason = "is a link"
    if reason:
        raise CloudError(
            f"{path}: its member {shown} {reason}, so all of it is refused; " f"{_AGAIN}"
        )


def _choose(path: Path, members: Sequence[zipfile.ZipInfo]) -> zipfile.ZipInfo:
    """The georeferenced model; else the one cloud there is."""
    files = [member for member in members if not member.is_dir() and _parts(member)]
    inside = [m for m in files if GEOREFERENCING in m.filename and len(_parts(m)) <= _MAX_DEPTH + 2]
    for name in MODELS:
        found = [m for m in inside if tuple(_parts(m)[-2:]) == (GEOREFERENCING, name)]
        if found:
            return _only(path, found)
    clouds = [
        member
        for member in files
        if Path(_parts(member)[-1]).suffix.lower() in SUFFIXES and not _is_note(member)
    ]
    if clouds and not any(part.startswith("odm_") for m in files for part in _parts(m)):
        return _only(path, clouds)
    entwine = any(_parts(member)[-1] == "ept.json" for member in files)
    hint = "unpack it and give the folder, for its ept.json" if entwine else _AGAIN
    raise CloudError(
        f"{path}: holds no point cloud; looked for {GEOREFERENCING}/{', '.join(MODELS)}; {hint}"
    )


def _is_note(member: zipfile.ZipInfo) -> bool:
    """Text files that ODM outputs carry besides clouds (task_output.txt, proj.txt)."""
    return member.filename.lower().endswith(".txt")


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


def _sidecars(members: Sequence[zipfile.ZipInfo], chosen: zipfile.ZipInfo) -> List[zipfile.ZipInfo]:
    """Small files beside the model that name its CRS; oversized or encrypted ones are ignored."""
    folder = _parts(chosen)[:-1]
    return [
        member
        for member in members
        if _parts(member)[:-1] == folder
        and _parts(member)[-1] in SIDECARS
        and member.file_size <= SIDECAR_BYTES
        and member.compress_type in _METHODS
        and not member.flag_bits & 1
    ]


def _cameras(
    members: Sequence[zipfile.ZipInfo], chosen: zipfile.ZipInfo
) -> List[Tuple[str, zipfile.ZipInfo]]:
    """Find what tells of the photographs, in the model's own project; oversized is ignored."""
    root = _parts(chosen)[:-2]
    found = {"/".join(_parts(m)[len(root) :]): m for m in members if _parts(m)[: len(root)] == root}
    return [
        (name, found[name])
        for name in CAMERA_FILES
        if name in found and found[name].file_size <= CAMERA_BYTES
    ]


def _write(
    path: Path, archive: zipfile.ZipFile, member: zipfile.ZipInfo, target: Path, most: int
) -> None:
    """Unpack one member; zipfile itself checks its length and checksum at the end."""
    written = 0
    with archive.open(member) as source, target.open("wb") as out:
        while True:
            block: Optional[bytes] = source.read(_BLOCK)
            if not block:
                break
            written += len(block)
            if written > most:
                raise CloudError(
                    f"{path}: its member {member.filename[:60]!r} is larger than it claims; "
                    f"{_AGAIN}"
                )
            out.write(block)
    if written != member.file_size:
        raise CloudError(
            f"{path}: its member {member.filename[:60]!r} has {written} bytes of "
            f"{member.file_size}; {_AGAIN}"
        )
