"""submit and resume: photographs to a server, its result back, and the volume in it."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any, Dict, Mapping

from ..errors import JobError, QuantifyError, UsageError
from ..files.writing import scratch
from ..jobs import Confirmed, Pace, cancel_job, create_job, run_job
from ..jobs.job import ARCHIVE, WEBODM
from ..jobs.journal import load, resuming
from ..jobs.trust import is_own, records_folder
from ..pipeline.run import measure
from ..report.wording.words import printable
from ..report.write import require_writable
from ..types import SCHEMA
from .credentials import access_of, node_token
from .job_display import shown_job
from .job_options import FILES, REPORT, finished, kept_options, kept_units, require_own_files
from .measuring import deliver
from .messages import complain_of, say, show_json, stages
from .submit_checks import check, show_checked

__all__ = ["resume", "submit"]

PACE = Pace()


def submit(given: argparse.Namespace) -> int:
    """Check everything, send the photographs, wait, and measure what comes back."""
    with scratch() as folder:
        checked = check(given, folder)
        if given.dry_run or checked.plan is None:
            return show_checked(checked, given)
        for line in checked.lines():
            say(line)
        then = {"options": checked.kept, "units": given.units}
        job = create_job(checked.plan, given.out, then)
    if not is_own(job):
        say(
            f"Note: {records_folder()} cannot be written, so 'quantify-client resume' will want to "
            "be told the server and the photographs again (--node or --webodm, --images)."
        )
    return _go_on(given.out, given, is_new=True)


def resume(given: argparse.Namespace) -> int:
    """Go on with a job wherever it stopped; end it with --cancel."""
    folder = given.folder
    if given.cancel:
        if given.resubmit:
            raise UsageError("--cancel and --resubmit exclude each other: give one of them")
        said = cancel_job(folder, **_asking(folder, given))
        document = {"schema": SCHEMA, "state": load(folder).state, "said": said}
        if given.json:
            show_json(document)
        else:
            print(printable(said))
        return 0
    given.units = kept_units(folder, load(folder))
    return _go_on(folder, given)


def _go_on(folder: Path, given: argparse.Namespace, *, is_new: bool = False) -> int:
    job = load(folder)
    found = finished(folder, job)
    if found is not None:
        return _show_finished(folder, found, given)
    options = kept_options(folder, job)
    report_folder = folder / REPORT
    if report_folder.is_symlink():
        raise JobError(
            f"{report_folder}: is a link, and reports replace files; remove it, then resume"
        )
    require_writable(report_folder, [options.get(name) for name in FILES])
    with shown_job() as report:
        archive = run_job(
            folder,
            **_asking(folder, given),
            report=report,
            patience_h=given.patience,
            resubmit=given.resubmit,
            most_bytes=None if given.max_size is None else int(given.max_size * 1e9),
            pace=PACE,
        )
    if not is_new:
        require_own_files(folder, job, options)
    return _measure(folder, archive, options, given)


def _asking(folder: Path, given: argparse.Namespace) -> Dict[str, Any]:
    """Return who asks the server, and what was said of it and the photographs at this command."""
    return {
        "token": node_token(given),
        "access": access_of(given) if load(folder).kind == WEBODM else None,
        "confirmed": Confirmed(given.node or given.webodm, given.images, given.ca, given.insecure),
    }


def _measure(
    folder: Path, archive: Path, options: Mapping[str, Any], given: argparse.Namespace
) -> int:
    """Scale, measure and report; the result that was fetched stays whatever happens here."""
    hint = (
        f"the server's result is safe in {archive}: {resuming(folder)} measures "
        "again once that is mended, 'quantify-client volume' with other options"
    )
    try:
        with stages() as progress:
            measurement = measure(archive, progress=progress, **options)
        return deliver(measurement, folder / REPORT, given)
    except QuantifyError as error:
        raise type(error)(f"{error}; {hint}") from error
    except KeyboardInterrupt:
        raise KeyboardInterrupt(f"interrupted; {resuming(folder)} goes on from here") from None


def _show_finished(folder: Path, found: Mapping[str, Any], given: argparse.Namespace) -> int:
    if given.json:
        show_json(found)
    else:
        print(f"The job is finished. Report: {printable(folder / REPORT / 'report.html')}")
    again = f"'quantify-client volume {folder / ARCHIVE} --area FILE' measures other areas"
    failed = [row for row in found.get("results", []) if row.get("error")]
    return complain_of([f"{row['name']}: {row['error']}; {again}" for row in failed])
