"""Files: how they are read and written, and where the saved measurements of a task are.

Everything is written beside its place and renamed: a duplicated task's assets are hard links, and
a file that is half written is never seen. Names that come from outside are checked, not cleaned.
"""

import contextlib
import errno
import fcntl
import itertools
import json
import os
import re
import stat
import time
import uuid
from pathlib import Path

__all__ = [
    "MOST_BYTES",
    "MOST_FILES",
    "MOST_SAVED",
    "MOST_SAVED_BYTES",
    "BusyError",
    "UnreadableError",
    "disk_words",
    "is_id",
    "in_turn",
    "read_capped",
    "read_head",
    "saved_folder",
    "saved_path",
    "saved_paths",
    "why_full",
    "write_json",
]

MOST_SAVED = 200
MOST_BYTES = 8_000_000
MOST_SAVED_BYTES = 500_000_000
#: How many files of a folder are looked at: an imported all.zip may have filled it.
MOST_FILES = 2000
_ID = re.compile(r"[0-9a-f]{32}")
_LOCK_S, _LOOK_S = 5.0, 0.05


class UnreadableError(Exception):
    """A file is not there, or no file that may be read."""


class BusyError(Exception):
    """Others do the same at the moment, and take longer than a request may wait."""


def is_id(text):
    """Whether a text is an id of ours; nothing else may become part of a path."""
    return isinstance(text, str) and _ID.fullmatch(text) is not None


def disk_words(error):
    """Return what a failure to read or write means, without the paths that it names."""
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        return "the server's disk is full; free some space, then try again"
    what = error.strerror or type(error).__name__
    return f"the server cannot read or write its files ({what}); ask WebODM's administrator"


def write_json(path, document):
    """Write a document so that it appears complete or not at all."""
    path = Path(path)
    partial = path.with_name(f".{path.name}.{uuid.uuid4().hex[:8]}.part")
    try:
        partial.write_text(json.dumps(document, allow_nan=False), encoding="utf-8")
        partial.replace(path)
    finally:
        with contextlib.suppress(OSError):
            partial.unlink()


def read_head(path, most):
    """Return the first bytes of a regular file and its size.

    A link could lead anywhere, and a pipe would keep its reader waiting.
    """
    flags = os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
    try:
        with os.fdopen(os.open(str(path), flags), "rb") as stream:
            about = os.fstat(stream.fileno())
            if not stat.S_ISREG(about.st_mode):
                raise UnreadableError("it is no file")
            return stream.read(most), about.st_size
    except OSError as error:
        raise UnreadableError(error.strerror or "it cannot be read") from error


def read_capped(path, most=MOST_BYTES):
    """Read a regular file of bounded size."""
    data, _ = read_head(path, most + 1)
    if len(data) > most:
        raise UnreadableError(f"it is larger than {most} bytes")
    return data


@contextlib.contextmanager
def in_turn(root, places=1, name=".lock", wait_s=_LOCK_S):
    """Let at most `places` requests at once pass: WebODM serves them from several processes.

    Raises
    ------
    BusyError
        No place was free for so long: a request that waits keeps one of WebODM's few workers.
    """
    Path(root).mkdir(parents=True, exist_ok=True)
    ends = time.monotonic() + wait_s
    with contextlib.ExitStack() as stack:
        locks = [
            stack.enter_context((Path(root) / f"{name}{place or ''}").open("w"))
            for place in range(places)
        ]
        while not any(_locked(lock) for lock in locks):
            if time.monotonic() > ends:
                raise BusyError
            time.sleep(_LOOK_S)
        yield


def _locked(file):
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno not in (errno.EAGAIN, errno.EACCES):
            raise
        return False
    return True


def saved_folder(task):
    """Return where the measurements of a task are.

    Raises
    ------
    UnreadableError
        Something else is in its place: an imported all.zip can have put it there.
    """
    folder = Path(task.assets_path("volcalc"))
    try:
        if not stat.S_ISDIR(folder.lstat().st_mode):
            raise UnreadableError("something else is in the place of the folder volcalc")
    except FileNotFoundError:
        pass
    except OSError as error:
        raise UnreadableError(error.strerror or "it cannot be read") from error
    return folder


def saved_path(task, saved):
    """Return the file of one measurement."""
    return saved_folder(task) / f"{saved}.json"


def saved_paths(task):
    """Return the ids, files and sizes (bytes) of a task's measurements, the oldest first."""
    try:
        folder = saved_folder(task)
        with os.scandir(str(folder)) as entries:
            found = [
                (about.st_mtime, entry.name[:-5], about.st_size)
                for entry in itertools.islice(entries, MOST_FILES)
                if entry.name.endswith(".json") and is_id(entry.name[:-5])
                for about in [entry.stat(follow_symlinks=False)]
                if stat.S_ISREG(about.st_mode)
            ]
    except (OSError, UnreadableError):
        return []
    rows = sorted(found)[:MOST_SAVED]
    return [(saved, folder / f"{saved}.json", size) for _, saved, size in rows]


def why_full(task, saved):
    """Return why a measurement cannot be saved with those that there are; None when it can."""
    others = [size for other, _, size in saved_paths(task) if other != saved]
    with os.scandir(str(saved_folder(task))) as entries:
        if sum(1 for _ in itertools.islice(entries, MOST_FILES)) >= MOST_FILES:
            return f"the task's folder volcalc has {MOST_FILES} files or more; remove some"
    if len(others) >= MOST_SAVED:
        return f"the task has {MOST_SAVED} measurements; delete one first"
    if sum(others) > MOST_SAVED_BYTES:
        return f"the task's measurements take {MOST_SAVED_BYTES} bytes; delete one first"
    return None
