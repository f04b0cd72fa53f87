"""What can be checked of a submit before anything is sent, and how it is reported."""

from __future__ import annotations

import argparse
import json
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Dict, Iterator, List, Mapping, Optional, Tuple

from ..areas.read import require_polygons
from ..crs import given_crs
from ..errors import AreaError, QuantifyError, ServerError, UsageError
from ..files.reading import real_path
from ..jobs import Plan, plan_job
from ..jobs.create import require_free
from ..jobs.journal import GCP_NAME
from ..options import check_options, choose_shape
from ..pipeline.control.sending import ControlPlan, plan_control
from ..pipeline.sites import AreaPlan, compare_areas, require_control_near
from ..report import require_writable
from ..report.wording.words import printable
from ..sfm.photos.check import PhotoSummary, check_photos
from ..types import SCHEMA, Options, warnings_json
from .access import access_of, node_token
from .kept import FILES, REPORT
from .measuring import inputs_of, options_of
from .shown import complain, say

__all__ = ["Checked", "check", "show_checked"]


@dataclass
class Checked:
    """What was found out of a submit.

    Attributes
    ----------
    options : of measuring afterwards.
    faults : what would stop it, where all of that is to be told and not the first alone.
    """

    options: Dict[str, Any]
    gathers: bool = False
    photos: Optional[PhotoSummary] = None
    control: Optional[ControlPlan] = None
    areas: Optional[AreaPlan] = None
    plan: Optional[Plan] = None
    faults: List[QuantifyError] = field(default_factory=list)

    @contextmanager
    def step(self) -> Iterator[None]:
        """Keep what is wrong in a step to be told with the rest; or let it end the command."""
        try:
            yield
        except UsageError:
            raise
        except QuantifyError as fault:
            if not self.gathers:
                raise
            self.faults.append(fault)

    def lines(self) -> List[str]:
        """Say for people what would be sent and measured."""
        told = self.control.said if self.control else None
        if self.plan is not None:
            lines = self.plan.lines(told)
        else:
            lines = [f"Server: {fault}" for fault in self.faults if isinstance(fault, ServerError)]
            if self.photos is not None:
                lines += [f"Photographs: {self.photos.words}", f"Control: {told or 'none is sent'}"]
                lines += [f"Note: {note}" for note in self.photos.warnings]
        lines += [f"Note: {note}" for note in self.notes()]
        chosen = {k: v for k, v in self.options.items() if v != getattr(Options(), k)}
        words = ", ".join(f"{key} {value}" for key, value in chosen.items())
        return [*lines, f"Measured afterwards: {words or 'the whole site'}"]

    def notes(self) -> List[str]:
        """Say what is odd, and does not stop it."""
        notes = list(self.control.notes) if self.control else []
        if self.areas is not None:
            notes += self.areas.notes
            notes += [f"{area.name}: {area.error}" for area in self.areas.failures]
        drawn = self.options["area"] is not None and self.options["area_frame"] == "cloud"
        if drawn and self.options["gcp"] is not None:
            notes.append(
                "polygons are taken as drawn on the cloud that is to be made, and move with it "
                "when the control moves that; for surveyed ones give --area-frame control"
            )
        return notes


def check(given: argparse.Namespace, folder: Path) -> Checked:
    """Check all that can be checked before anything is sent, the server last.

    With ``--dry-run`` nothing that is wrong hides the rest.

    Parameters
    ----------
    folder : where a solved gcp_list.txt may be kept for now.
    """
    _require_server(given)
    found = Checked(options_of(given), given.dry_run)
    choose_shape(check_options(Options(**found.options)), has_crs=True, is_odm=True)
    with found.step():
        _check_files(given, found.options)
    with found.step():
        found.photos = check_photos(given.images)
    if found.photos is not None:
        _check_control(given, found, found.photos, folder)
        with found.step():
            _check_areas(given, found, found.photos)
    with found.step():
        found.plan = _plan(given, found)
    return found


def _require_server(given: argparse.Namespace) -> None:
    if given.node is None and given.project is None:
        raise UsageError("--webodm goes with --project: give the number of the project there")
    if given.node is not None and given.project is not None:
        raise UsageError("--project goes with --webodm: leave one of them out")


def _check_files(given: argparse.Namespace, options: Dict[str, Any]) -> None:
    """Find mistakes in files and folders that would only show after a night."""
    if given.area is not None:
        require_polygons(given.area)
    require_free(given.out)
    require_writable(given.out / REPORT, inputs_of(given))
    for name in FILES:
        if options[name] is not None:
            options[name] = str(real_path(options[name]))
    if options["crs"] is not None:
        options["crs"] = given_crs(options["crs"])  # its text: the file may be gone by tomorrow


def _check_control(
    given: argparse.Namespace, found: Checked, photos: PhotoSummary, folder: Path
) -> None:
    if given.gcp is None:
        return
    with found.step():
        names = {photo.name for photo in photos.photos}
        found.control = plan_control(given.gcp, names, folder / GCP_NAME)
        require_control_near(given.gcp, _places(photos))
        if not found.control.applied:
            _leave_out_control(found.options)


def _leave_out_control(options: Dict[str, Any]) -> None:
    """Measure without a control file that only the server has a use for."""
    gcp, options["gcp"] = options["gcp"], None
    if options["scale_mode"] != "auto" or options["area_frame"] != "cloud":
        raise UsageError(
            f"{gcp}: is for the server alone, as it holds no lengths; leave --scale-mode and "
            "--area-frame out"
        )


def _places(photos: PhotoSummary) -> List[Tuple[float, float]]:
    return [photo.lonlat for photo in photos.photos if photo.lonlat is not None]


def _check_areas(given: argparse.Namespace, found: Checked, photos: PhotoSummary) -> None:
    """Raise AreaError when no polygon is where the photographs were taken."""
    if given.area is None:
        return
    plan = compare_areas(given.area, _places(photos))
    if plan.failures and len(plan.failures) == len(plan.names):
        first = plan.failures[0]
        more = f"; and {len(plan.failures) - 1} more like it" if len(plan.failures) > 1 else ""
        raise AreaError(
            f"{given.area}: {first.name} {first.error}{more}; if the photographs' GPS is what is "
            "wrong, submit without --area and measure the result ('quantify-client volume')"
        )
    found.areas = plan


def _plan(given: argparse.Namespace, found: Checked) -> Plan:
    node = given.node is not None
    plan = plan_job(
        given.images if found.photos is None else found.photos,
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
    return plan if found.control is None else replace(plan, gcp=found.control.sent)


def _task_options(given: List[Tuple[str, str]]) -> Dict[str, str]:
    options: Dict[str, str] = {}
    for name, value in given:
        if options.setdefault(name, value) != value:
            raise UsageError(f"--option {name} is given twice, with different values; give one")
    return options


def show_checked(found: Checked, given: argparse.Namespace) -> int:
    """Show what --dry-run found; 1 when something is wrong, each on a line of stderr."""
    failures = found.areas.failures if found.areas else ()
    told = [str(fault) for fault in found.faults]
    told += [f"{area.name}: {area.error}" for area in failures]
    if given.json:
        print(json.dumps(_document(found, told), indent=2, allow_nan=False))
    else:
        for line in (*found.lines(), "Nothing was sent (--dry-run)."):
            print(printable(line))
    for line in told:
        complain(line, 1)
    return 1 if told else 0


def _document(found: Checked, told: List[str]) -> Mapping[str, Any]:
    plan, photos = found.plan, found.photos
    return {
        "schema": SCHEMA,
        "server": plan and plan.url,
        "name": plan and plan.name,
        "photographs": photos and len(photos.photos),
        "bytes": photos and photos.size,
        "with_gps": photos and photos.with_gps,
        "cameras": photos and dict(photos.cameras),
        "options": plan and dict(plan.options),
        "outputs": plan and list(plan.outputs),
        "gcp": bool(found.control and found.control.sent),
        "warnings": warnings_json(
            [
                *(plan.notes if plan else ()),
                *(photos.warnings if photos else ()),
                *found.notes(),
            ]
        ),
        "errors": told,
    }
