"""What a job's folder keeps of the measuring: how it is to be done, and what came of it.

The folder may be damaged, or somebody else's: what is read from it is checked as what a user types.
"""

from __future__ import annotations

import json
from contextlib import suppress
from pathlib import Path
from typing import Any, Dict, Mapping, Optional

from ..crs import require_crs
from ..errors import CrsError, InputError, JobError, UsageError
from ..files.reading import read_small, real_path
from ..jobs.job import ARCHIVE, DONE, JOURNAL, Job
from ..jobs.trust import is_own
from ..options import OPTIONS, proposes, read_options

__all__ = ["FILES", "REPORT", "finished", "kept_options", "kept_units", "require_own_files"]

REPORT = "report"
FILES = tuple(n for n, option in OPTIONS.items() if option.kind == "given")
"""Options that name files, kept with their whole path."""
_UNITS = ("metric", "us")
_MOST_BYTES = 512_000_000  # of a report.json: many areas, many slices


def kept_options(folder: Path, job: Job) -> Dict[str, Any]:
    """Return how the result is to be measured.

    Raises
    ------
    JobError
        The journal holds what are no such options.
    """
    options = job.then.get("options", {})
    if not isinstance(options, dict):
        raise _no_options(folder, "'options'")
    for name, value in options.items():
        of_text = name in OPTIONS and OPTIONS[name].kind in ("given", "text")
        if name not in OPTIONS or (of_text and not isinstance(value, (str, type(None)))):
            raise _no_options(folder, repr(name[:60]))
    try:
        read = read_options(options).given()
        if "crs" in read:
            require_crs(read["crs"])  # kept as text: no file is read for a journal
    except (UsageError, CrsError) as error:
        raise _no_options(folder, str(error)) from error
    return read


def kept_units(folder: Path, job: Job) -> str:
    """Return the units of what people are shown."""
    units = job.then.get("units", "metric")
    if units not in _UNITS:
        raise _no_options(folder, "'units'")
    return str(units)


def finished(folder: Path, job: Job) -> Optional[Mapping[str, Any]]:
    """Return the measurement of a job that has nothing left to do; None while there is work."""
    page = folder / REPORT / "report.json"
    if job.state != DONE:
        return None
    with suppress(OSError, InputError, ValueError, RecursionError):
        if page.stat().st_mtime_ns >= (folder / JOURNAL).stat().st_mtime_ns:
            data = read_small(page, most=_MOST_BYTES, what="a report", error=InputError)
            found = json.loads(data, parse_constant=_refused)
            return found if _is_report(found) else None
    return None


def _refused(constant: str) -> Any:
    raise ValueError(constant)


def _is_report(found: Any) -> bool:
    rows = found.get("results") if isinstance(found, dict) else None
    return isinstance(rows, list) and all(
        isinstance(row, dict) and isinstance(row.get("name"), str) for row in rows
    )


def require_own_files(folder: Path, job: Job, options: Mapping[str, Any]) -> None:
    """Raise JobError for files to measure by that somebody else chose, outside their folder."""
    for name in () if is_own(job) else FILES:
        if options.get(name) is not None and not proposes(options[name]):
            path = real_path(options[name])
            if real_path(folder) not in path.parents:
                raise JobError(
                    f"{folder}: the result is in {folder / ARCHIVE}, and the journal of somebody "
                    f"else wants it measured by {path} (--{name}); if you want that, too, use "
                    f"'quantify-client volume {folder / ARCHIVE}' with options of your own"
                )


def _no_options(folder: Path, what: str) -> JobError:
    return JobError(
        f"{folder / JOURNAL}: its options for measuring are damaged, or of another version "
        f"({what}); measure with 'quantify-client volume {folder / ARCHIVE}' and your own options"
    )
