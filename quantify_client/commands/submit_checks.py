"""The checks of a submit before anything is sent, and how their findings are shown."""

from __future__ import annotations

import argparse
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, Dict, List, Mapping, Optional, Tuple

from ..areas.read import require_polygons
from ..crs import given_crs
from ..errors import AreaError, QuantifyError, ServerError, UsageError
from ..files.reading import real_path
from ..jobs import JobPlan, plan_job
from ..jobs.create import require_free
from ..jobs.job import GCP_NAME
from ..options import choose_shape, proposes, read_options
from ..pipeline.control.control_alone import ControlPlan, plan_control
from ..pipeline.same_site import AreaPlan, compare_areas, require_control_near
from ..report.wording.words import printable
from ..report.write import require_writable
from ..sfm.photos.check import PhotoSummary, check_photos
from ..types import SCHEMA, Notice, warnings_json
from .credentials import access_of, node_token
from .job_options import FILES, REPORT
from .measuring import inputs_of, options_of
from .messages import complain_of, say, show_json

__all__ = ["Checked", "check", "show_checked"]


@dataclass
class Checked:
    """What was found in checking a submit.

    Attributes
    ----------
    given : the command line.
    kept : the options for measuring that the job keeps: files with their whole path, a CRS as text.
    faults : what would stop it; with ``--dry-run`` all of it is told, not only the first.
    """

    given: argparse.Namespace
    kept: Dict[str, Any]
    photos: Optional[PhotoSummary] = None
    control: Optional[ControlPlan] = None
    areas: Optional[AreaPlan] = None
    plan: Optional[JobPlan] = None
    faults: List[QuantifyError] = field(default_factory=list)

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
        words = ", ".join(f"{key} {value}" for key, value in self.kept.items())
        return [*lines, f"Measured afterwards: {words or 'the whole site'}"]

    def notes(self) -> List[str]:
        """Return the warnings: what is odd but does not stop the submit."""
        notes: List[str] = list(self.control.notes) if self.control else []
        if self.areas is not None:
            notes += self.areas.notes
            notes += [
                Notice("area-elsewhere", f"{area.name}: {area.error}", name=area.name)
                for area in self.areas.failures
            ]
        if {"area", "gcp"} <= self.kept.keys() and "area_frame" not in self.kept:
            text = (
                "polygons are taken as drawn on the cloud that is to be made, and move with it "
                "when the control moves that; for surveyed ones give --area-frame control"
            )
            notes.append(Notice("areas-move-with-the-cloud", text))
        return notes

    @property
    def places(self) -> List[Tuple[float, float]]:
        """Where photographs were taken: longitude and latitude, of those that know it."""
        photos = self.photos.photos if self.photos else ()
        return [photo.lonlat for photo in photos if photo.lonlat is not None]

    def check_files(self) -> None:
        """Find mistakes in files and folders that would only show after a night."""
        given, kept = self.given, self.kept
        if given.area is not None and not proposes(given.area):
            require_polygons(given.area)
        require_free(given.out)
        require_writable(given.out / REPORT, inputs_of(given))
        files = [name for name in FILES if not proposes(kept.get(name))]
        kept.update({name: str(real_path(kept[name])) for name in files if name in kept})
        if "crs" in kept:
            kept["crs"] = given_crs(kept["crs"])  # its text: the file may be gone by tomorrow

    def check_photographs(self) -> None:
        """Find the photographs, and what is wrong with them."""
        self.photos = check_photos(self.given.images)

    def check_control(self, folder: Path) -> None:
        """Find out who is to have the control; without use for the cloud, measure without it.

        Parameters
        ----------
        folder : where a solved gcp_list.txt may be kept for now.
        """
        gcp = self.given.gcp
        if gcp is None or self.photos is None:
            return
        names = {photo.name for photo in self.photos.photos}
        self.control = plan_control(gcp, names, folder / GCP_NAME)
        require_control_near(self.control.control, self.places)
        if self.control.applied:
            return
        del self.kept["gcp"]
        if self.kept.keys() & {"scale_mode", "area_frame"}:
            raise UsageError(
                f"{gcp}: is for the server alone, as it holds no lengths; leave --scale-mode and "
                "--area-frame out"
            )

    def check_areas(self) -> None:
        """Raise AreaError when no polygon is where the photographs were taken."""
        area = self.given.area
        if area is None or proposes(area) or self.photos is None:
            return
        plan = compare_areas(area, self.places)
        if plan.failures and len(plan.failures) == len(plan.names):
            first, *others = plan.failures
            more = f"; and {len(others)} more like it" if others else ""
            raise AreaError(
                f"{area}: {first.name} {first.error}{more}; if the photographs' GPS is what is "
                "wrong, submit without --area and measure the result ('quantify-client volume')"
            )
        self.areas = plan

    def make_plan(self) -> None:
        """Ask the server, and plan the job."""
        given, node = self.given, self.given.node is not None
        options: Dict[str, str] = {}
        for name, value in given.option:
            if options.setdefault(name, value) != value:
                raise UsageError(f"--option {name} is given twice, with different values; give one")
        plan = plan_job(
            given.images if self.photos is None else self.photos,
            given.node if node else given.webodm,
            node_token(given) if node else None,
            project=given.project,
            access=None if node else access_of(given),
            name=given.name,
            preset=given.preset,
            options=options,
            minimal=given.minimal,
            split=given.split,
            ground=given.base == "ground",
            ca=given.ca,
            insecure=given.insecure,
            report=lambda event: say(event.text),
        )
        self.plan = plan if self.control is None else replace(plan, gcp=self.control.sent)


def check(given: argparse.Namespace, folder: Path) -> Checked:
    """Check all that can be checked before anything is sent, the server last.

    With ``--dry-run`` nothing that is wrong hides the rest.

    Parameters
    ----------
    folder : where a solved gcp_list.txt may be kept for now.
    """
    if given.node is None and given.project is None:
        raise UsageError("--webodm goes with --project: give the number of the project there")
    if given.node is not None and given.project is not None:
        raise UsageError("--project goes with --webodm: leave one of them out")
    options = read_options(options_of(given))
    choose_shape(options, has_crs=True, is_odm=True)
    found = Checked(given, options.given())
    steps = (
        found.check_files,
        found.check_photographs,
        partial(found.check_control, folder),
        found.check_areas,
        found.make_plan,
    )
    for step in steps:
        try:
            step()
        except UsageError:
            raise
        except QuantifyError as fault:
            if not given.dry_run:
                raise
            found.faults.append(fault)
    return found


def show_checked(found: Checked, given: argparse.Namespace) -> int:
    """Show what --dry-run found; 1 when something is wrong, each on a line of stderr."""
    failures = found.areas.failures if found.areas else ()
    told = [str(fault) for fault in found.faults]
    told += [f"{area.name}: {area.error}" for area in failures]
    if given.json:
        show_json(_document(found, told))
    else:
        for line in (*found.lines(), "Nothing was sent (--dry-run)."):
            print(printable(line))
    return complain_of(told)


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
