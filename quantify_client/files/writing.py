"""Write output files: what they may replace, all at once or none, also after a run was killed.

A run writes into a hidden working folder beside its results and moves them from there, all or
none. The folder is locked while the run lives: the next run into the same place removes those
whose run was killed, and leaves the others alone.
"""

from __future__ import annotations

import json
import os
import re
import secrets
import shutil
import stat
import sys
import tempfile
import time
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Iterator, List, Optional, Pattern, Sequence, Union

from ..errors import OutputError

__all__ = [
    "GENERATOR",
    "is_ours",
    "put_in_place",
    "require_replaceable",
    "scratch",
    "staging",
]

#: What marks a file as ours, in the way that each format has for it.
GENERATOR = "quantify-client"

_HEAD_BYTES = 2048
_MARKS = re.compile(
    rb'\s*\{\s*"schema": "quantify-client/'  # report.json
    rb'|\s*\{\s*"type": "FeatureCollection",\s*"generator": "quantify-client"'
    rb"|name,z_m,height_m,area_m2,volume_m3,points\r\n"  # slices.csv: its readers know no comment
    rb"|before,after,name,volume_m3,cut_m3,fill_m3,std_m3\r\n"  # series.csv
    rb"|name,level_m,water_area_m2,volume_m3,std_m3,spills\r\n"  # stage.csv
    rb"|\x89PNG.*tEXtSoftware\0quantify-client"
    rb'|<!doctype html>.*<meta name="generator" content="quantify-client">'
    # Pages written before they had that mark.
    rb'|<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n<meta http-equiv="'
    rb"Content-Security-Policy\" content=\"default-src 'none'; img-src data:; style-src "
    rb"'unsafe-inline'"
    rb"|II[*+]\0.*quantify-client\0"  # GeoTIFF, TIFFTAG_SOFTWARE
    rb"|LASF.{54}quantify-client\0"
    rb"|[^\n]+\n# quantify-client\n"  # gcp_list.txt, whose second line may be a comment
    rb"|PK\x03\x04.{6}\0\0\x21\0.{16}volcalc/__init__\.py",  # the plugin, dated 1980
    re.DOTALL,
)
_OUTLINES = "areas.geojson"  # had no mark at first: a report beside it and all numbers in it count
_MOST_BYTES = 100_000_000

_HIDDEN, _SCRATCH = ".quantify-", "quantify-"
_NAME = re.compile(r"\.?quantify-[0-9a-f]{16}")
_PLAN, _EARLIER = ".quantify-plan", ".quantify-earlier"
_TURN_S = 10.0

Input = Union[str, Path, None]


def is_ours(path: Path) -> bool:
    """Return whether a file is an earlier result of this program, by the mark inside."""
    try:
        if not path.is_file():
            return False
        with path.open("rb") as file:
            if _MARKS.match(file.read(_HEAD_BYTES)):
                return True
        return path.name == _OUTLINES and _is_unmarked_result(path)
    except OSError:
        return False


def _is_unmarked_result(path: Path) -> bool:
    report = path.with_name("report.json")
    if path.stat().st_size > _MOST_BYTES or not is_ours(report):
        return False
    try:
        rows = [feature["properties"] for feature in json.loads(path.read_bytes())["features"]]
        return bool(rows) and all("cut_interval95_low_m3" in row or "error" in row for row in rows)
    except (ValueError, TypeError, KeyError, RecursionError):
        return False


def require_replaceable(path: Path, inputs: Sequence[Input] = ()) -> None:
    """Raise OutputError when writing to a path would replace more than an earlier result.

    An earlier result that is an input of this run is not replaced either.

    Parameters
    ----------
    inputs : what the user gives to be read, under any name; None and what does not exist are
        ignored.
    """
    if not os.path.lexists(path):
        return
    if path.is_dir():
        raise OutputError(f"{path}: is a folder; move it, or give another name with --out")
    if any(_is_same(path, given) for given in inputs):
        raise OutputError(
            f"{path}: is the input itself, which would be replaced; give another --out"
        )
    if not is_ours(path):
        raise OutputError(
            f"{path}: is there already and no earlier result of this program, so it is not "
            "replaced; move it, or give another --out"
        )


def _is_same(path: Path, given: Input) -> bool:
    if given is None:
        return False
    with suppress(OSError, ValueError):
        return path.samefile(given)
    return False


def put_in_place(
    working: Path,
    names: Sequence[str],
    inputs: Sequence[Input] = (),
    outdated: Optional[Pattern[str]] = None,
) -> None:
    """Move files out of a working folder to beside it: all of them, or none.

    Parameters
    ----------
    names : of the files; what has such a name beside the folder has to be replaceable.
    outdated : names of earlier results of ours that go when the new ones are there.

    Raises
    ------
    OSError
        One of them cannot be moved; what was there is unchanged.
    """
    folder = working.parent
    with _turn(folder):
        for name in names:
            require_replaceable(folder / name, inputs)
        stale: List[Path] = []
        if outdated is not None:
            others = (path for path in folder.glob("*") if path.name not in names)
            stale = [path for path in others if outdated.fullmatch(path.name) and is_ours(path)]
        (working / _PLAN).write_text(json.dumps(list(names)), encoding="utf-8")
        _move(working, names)
        for path in stale:
            with suppress(OSError):  # the new results are complete all the same
                path.unlink()


def _move(working: Path, names: Sequence[str]) -> None:
    """Rename all files; when one cannot be, put back what had been there."""
    folder, earlier = working.parent, working / _EARLIER
    earlier.mkdir()
    begun: List[str] = []
    try:
        for name in names:
            if os.path.lexists(folder / name):
                _keep(folder / name, earlier / name)
            begun.append(name)
            (working / name).replace(folder / name)
    except BaseException:
        for name in begun:
            if os.path.lexists(earlier / name):
                (earlier / name).replace(folder / name)
            elif not (working / name).exists():
                (folder / name).unlink()
        raise


def _keep(path: Path, copy: Path) -> None:
    """Give a file a second name, so that something is always there under the first."""
    try:
        os.link(path, copy)
    except OSError:  # a file system without hard links
        shutil.copy2(path, copy)


@contextmanager
def staging(folder: Path, *, make: bool = False) -> Iterator[Path]:
    """Yield a hidden working folder on the same disk as `folder`, so that moving is renaming.

    With `make` the folder itself is made when it is missing, and removed again when the ``with``
    block fails.
    """
    missing = [path for path in (folder, *folder.parents) if make and not path.exists()]
    try:
        if make:
            folder.mkdir(parents=True, exist_ok=True)
        with _working(folder, _HIDDEN) as working:
            yield working
    except BaseException:
        for path in missing:
            with suppress(OSError):
                path.rmdir()
        raise


@contextmanager
def scratch() -> Iterator[Path]:
    """Yield a temporary folder (in TMPDIR) that is removed after the ``with`` block."""
    with _working(Path(tempfile.gettempdir()), _SCRATCH) as working:
        yield working.resolve()


@contextmanager
def _working(parent: Path, prefix: str) -> Iterator[Path]:
    _sweep(parent, prefix)
    lock: Optional[int] = None
    path = parent
    try:
        while lock is None:
            path = parent / f"{prefix}{secrets.token_hex(8)}"
            path.mkdir(mode=0o700)
            lock = _locked(path)
        yield path
    finally:
        if path != parent:
            shutil.rmtree(path, ignore_errors=True)
        if lock is not None and lock >= 0:
            os.close(lock)


def _locked(path: Path) -> Optional[int]:
    """Lock a working folder and return the handle; None when another run has removed it already.

    The handle is -1 where folders cannot be locked: nothing is removed there afterwards.
    """
    if sys.platform == "win32":
        return -1
    import fcntl

    handle, failed = -1, None
    try:
        handle = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if os.path.samestat(os.fstat(handle), path.lstat()):
            return handle
    except (BlockingIOError, FileNotFoundError):
        pass  # another run has it, or has removed it
    except OSError:
        failed = -1
    if handle >= 0:
        os.close(handle)
    return failed


def _sweep(parent: Path, prefix: str) -> None:
    """Remove the working folders that killed runs of this user left in a folder."""
    for path in parent.glob(f"{prefix}*") if sys.platform != "win32" else ():
        with suppress(OSError):
            if not _NAME.fullmatch(path.name) or path.lstat().st_uid != os.getuid():
                continue
            handle = _locked(path)
            if handle is None or handle < 0:
                continue
            try:
                _finish(path)
                shutil.rmtree(path, ignore_errors=True)
            finally:
                os.close(handle)


def _finish(working: Path) -> None:
    """Complete the moves of a run that was killed during them; newer files are kept."""
    plan = working / _PLAN
    with suppress(OSError, ValueError, RecursionError):  # a plan may be anybody's
        known = plan.lstat()
        if not stat.S_ISREG(known.st_mode) or known.st_size > _MOST_BYTES:
            return
        names, begun = json.loads(plan.read_bytes()), known.st_mtime_ns
        with _turn(working.parent):
            for name in names if isinstance(names, list) else ():
                if not isinstance(name, str) or Path(name).name != name:
                    continue
                new, target = working / name, working.parent / name
                if not new.is_file():
                    continue
                replaceable = is_ours(target) and target.stat().st_mtime_ns <= begun
                if replaceable or not os.path.lexists(target):
                    new.replace(target)


@contextmanager
def _turn(folder: Path) -> Iterator[None]:
    """Let one run at a time move files in a folder, as far as its file system knows locks."""
    handle = -1
    if not _NAME.fullmatch(folder.name):  # a working folder is locked as it is
        with suppress(OSError):  # Windows opens no folders
            handle = os.open(folder, os.O_RDONLY)
    try:
        if handle >= 0 and not _locked_in_time(handle):
            raise OutputError(f"{folder}: another run writes into it; try again when it has ended")
        yield
    finally:
        if handle >= 0:
            os.close(handle)


def _locked_in_time(handle: int) -> bool:
    """Wait for a lock; False when another process keeps it for too long."""
    import fcntl

    deadline = time.monotonic() + _TURN_S
    while time.monotonic() < deadline:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return True
        except BlockingIOError:
            time.sleep(0.02)
        except OSError:  # there are no locks here
            return True
    return False
