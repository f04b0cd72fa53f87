"""submit and resume: photographs to a server, its result back, and the volume in it."""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path
from typing import Any, Dict, List, Mapping, Optional, Tuple

from ..areas import require_polygons
from ..choices import check_options, choose_shape
from ..crs import given_crs
from ..errors import JobError, QuantifyError, UsageError
from ..jobs import Confirmed, Pace, Plan, cancel_job, create_job, plan_job, run_job
from ..jobs.create import require_free
from ..jobs.journal import ARCHIVE, GCP_NAME, WEBODM, load, resuming
from ..jobs.own import is_own, records_folder
from ..pipeline import measure
from ..pipeline.sending import ControlPlan, plan_control
from ..report import require_writable
from ..report.words import printable
from ..sfm.access import Access
from ..small_files import real_path
from ..types import Options
from ..writing import scratch
from .access import access_of, node_token
from .job_display import shown_job
from .kept import FILES, REPORT, finished, kept_options, kept_units, require_own_files
from .measuring import deliver, inputs_of, options_of
from .shown import complain, say, stages

__all__ = ["resume", "submit"]

PACE = Pace()


def submit(given: argparse.Namespace) -> int:
    """Check everything, send the photographs, wait, and measure what comes back."""
    options = _checked_options(given)
    with scratch() as folder:
        plan, control = _plan(given, folder / GCP_NAME)
        if control is not None and not control.applied:
            _leave_out_control(options)
        lines = _said(plan, control, options)
        if given.dry_run:
            return _show_plan(plan, lines, given)
        for line in lines:
            say(line)
        job = create_job(plan, given.out, {"options": options, "units": given.units})
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
        said = cancel_job(
            folder,
            node_token(given),
            access=_access(folder, given),
            confirmed=_confirmed(given),
        )
        document = {"schema": "quantify-client/1", "state": load(folder).state, "said": said}
        print(json.dumps(document, indent=2) if given.json else printable(said))
        return 0
    given.units = kept_units(folder, load(folder))
    return _go_on(folder, given)


def _go_on(folder: Path, given: argparse.Namespace, *, is_new: bool = False) -> int:
    job = load(folder)
    found = finished(folder, job)
    if found is not None:
        return _show_finished(folder, found, given)
    options = kept_options(folder, job)
    _refuse_link(folder / REPORT)
    require_writable(folder / REPORT, [options.get(name) for name in FILES])
    with shown_job() as report:
        archive = run_job(
            folder,
            node_token(given),
            access=_access(folder, given),
            confirmed=_confirmed(given),
            report=report,
            patience_h=given.patience,
            resubmit=given.resubmit,
            most_bytes=given.max_size,
            pace=PACE,
        )
    if not is_new:
        require_own_files(folder, job, options)
    return _measure(folder, archive, options, given)


def _access(folder: Path, given: argparse.Namespace) -> Optional[Access]:
    """Return who asks a WebODM server, where the job is on one."""
    return access_of(given) if load(folder).kind == WEBODM else None


def _confirmed(given: argparse.Namespace) -> Confirmed:
    """Return what was said of the server and the photographs, at this command."""
    return Confirmed(given.node or given.webodm, given.images, given.ca, given.insecure)


def _refuse_link(report: Path) -> None:
    if report.is_symlink():
        raise JobError(f"{report}: is a link, and reports replace files; remove it, then resume")


def _measure(
    folder: Path, archive: Path, options: Mapping[str, Any], given: argparse.Namespace
) -> int:
    """Scale, measure and report; the result that was fetched stays whatever happens here."""
    hint = (
        f"the server's result is safe in {archive}: {resuming(folder)} measures "
        "again once that is mended, 'quantify-client volume' with other options"
    )
    failure: Optional[QuantifyError] = None
    try:
        with stages() as progress:
            measurement = measure(archive, progress=progress, **options)
        return deliver(measurement, folder / REPORT, given)
    except QuantifyError as error:
        failure = error
    except KeyboardInterrupt:
        raise KeyboardInterrupt(f"interrupted; {resuming(folder)} goes on from here") from None
    raise type(failure)(f"{failure}; {hint}") from failure


def _show_finished(folder: Path, found: Mapping[str, Any], given: argparse.Namespace) -> int:
    if given.json:
        print(json.dumps(found, indent=2, allow_nan=False))
    else:
        print(f"The job is finished. Report: {printable(folder / REPORT / 'report.html')}")
    failed = [row for row in found.get("results", []) if row.get("error")]
    again = f"'quantify-client volume {folder / ARCHIVE} --area FILE' measures other areas"
    for row in failed:
        complain(f"{row['name']}: {row['error']}; {again}", 1)
    return 1 if failed else 0


def _checked_options(given: argparse.Namespace) -> Dict[str, Any]:
    """Find mistakes that would only show after a night: contradictions, and files."""
    options = options_of(given)
    choose_shape(check_options(Options(**options)), has_crs=True, is_odm=True)
    if given.area is not None:
        require_polygons(given.area)
    require_free(given.out)
    require_writable(given.out / REPORT, inputs_of(given))
    for name in FILES:
        if options[name] is not None:
            options[name] = str(real_path(options[name]))
    if options["crs"] is not None:
        options["crs"] = given_crs(options["crs"])  # its text: the file may be gone by tomorrow
    return options


def _leave_out_control(options: Dict[str, Any]) -> None:
    """Measure without a control file that only the server has a use for."""
    gcp, options["gcp"] = options["gcp"], None
    if options["scale_mode"] != "auto" or options["area_frame"] != "cloud":
        raise UsageError(
            f"{gcp}: is for the server alone, as it holds no lengths; leave --scale-mode and "
            "--area-frame out"
        )


def _plan(given: argparse.Namespace, scratch: Path) -> Tuple[Plan, Optional[ControlPlan]]:
    node = given.node is not None
    if not node and given.project is None:
        raise UsageError("--webodm goes with --project: give the number of the project there")
    if node and given.project is not None:
        raise UsageError("--project goes with --webodm: leave one of them out")
    plan = plan_job(
        given.images,
        given.node if node else given.webodm,
        node_token(given) if node else None,
        project=given.project,
        access=None if node else access_of(given),
        name=given.name,
        preset=given.preset,
        options=_task_options(given.option),
        minimal=given.minimal,
        split=given.split,
        ground=given.base == "ground",
        ca=given.ca,
        insecure=given.insecure,
        report=lambda event: say(event.text),
    )
    if given.gcp is None:
        return plan, None
    control = plan_control(given.gcp, {photo.name for photo in plan.photos.photos}, scratch)
    return replace(plan, gcp=control.sent), control


def _task_options(given: List[Tuple[str, str]]) -> Dict[str, str]:
    options: Dict[str, str] = {}
    for name, value in given:
        if options.setdefault(name, value) != value:
            raise UsageError(f"--option {name} is given twice, with different values; give one")
    return options


def _said(plan: Plan, control: Optional[ControlPlan], options: Mapping[str, Any]) -> List[str]:
    chosen = {key: value for key, value in options.items() if value != getattr(Options(), key)}
    words = ", ".join(f"{key} {value}" for key, value in chosen.items())
    lines = plan.lines(control.said if control else None)
    return [*lines, f"Measured afterwards: {words or 'the whole site'}"]


def _show_plan(plan: Plan, lines: List[str], given: argparse.Namespace) -> int:
    if given.json:
        photos = plan.photos
        document = {
            "schema": "quantify-client/1",
            "server": plan.url,
            "name": plan.name,
            "photographs": len(photos.photos),
            "bytes": photos.size,
            "with_gps": photos.with_gps,
            "cameras": dict(photos.cameras),
            "options": dict(plan.options),
            "outputs": list(plan.outputs),
            "gcp": plan.gcp is not None,
            "warnings": [*plan.notes, *photos.warnings],
        }
        print(json.dumps(document, indent=2, allow_nan=False))
    else:
        print("\n".join(printable(line) for line in (*lines, "Nothing was sent (--dry-run).")))
    return 0
