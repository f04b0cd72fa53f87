"""A job before anything is sent: everything that can be checked is, then the journal is written."""

from __future__ import annotations

import filecmp
import shutil
import uuid
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Iterable, List, Mapping, Optional, Tuple, Union

from ..errors import InputError, JobError, OutputError
from ..files.reading import real_path
from ..sfm.odm.layout import MINIMAL_OUTPUTS
from ..sfm.photos.check import PhotoSummary, check_photos
from ..sfm.servers.access import Access, split_token
from ..sfm.servers.outages import Patience
from ..sfm.servers.presets import choose_options
from .job import (
    ARCHIVE,
    GCP_NAME,
    JOURNAL,
    NODE,
    SEED,
    WEBODM,
    Job,
    JobEvent,
    Report,
    SentFile,
    connect,
    silent,
)
from .journal import locked, resuming, save
from .trust import keep_record

__all__ = ["JobPlan", "create_job", "plan_job", "require_free"]

FIRST_CONTACT_S = 5.0  # whoever starts a job is still there to correct the URL


@dataclass(frozen=True)
class JobPlan:
    """What a job would send and ask for; `lines` says it.

    `gcp` is a file in ODM's own format, in which every height is already known.
    """

    url: str
    name: str
    photos: PhotoSummary
    options: Mapping[str, Any]
    outputs: Tuple[str, ...] = ()
    gcp: Optional[Path] = None
    ca: Optional[Path] = None
    engine: str = ""
    notes: Tuple[str, ...] = ()
    project: Optional[int] = None
    label: str = "Node"

    def lines(self, control: Optional[str] = None) -> List[str]:
        """Return a summary of the job, line by line; `control` tells what becomes of the user's."""
        photos = self.photos
        shown = " ".join(
            f"{name}={str(value).lower() if isinstance(value, bool) else value}"
            for name, value in sorted(self.options.items())
        )
        return [
            f"{self.label}: {self.url} {self.engine}".rstrip(),
            f"Photographs: {photos.words}",
            f"Control: {control or self.gcp or 'none is sent'}",
            f"Options: {shown}",
            f"Result: {'what measuring needs' if self.outputs else 'everything'}",
            *(f"Note: {note}" for note in (*self.notes, *photos.warnings)),
        ]


def plan_job(
    images: Union[PhotoSummary, Iterable[Union[str, Path]]],
    url: str,
    token: Optional[str] = None,
    *,
    project: Optional[int] = None,
    access: Optional[Access] = None,
    name: Optional[str] = None,
    preset: str = "default",
    options: Optional[Mapping[str, Any]] = None,
    minimal: bool = False,
    split: Optional[int] = None,
    ground: bool = False,
    gcp: Optional[Path] = None,
    ca: Optional[Path] = None,
    insecure: bool = False,
    allow_faulty: bool = False,
    report: Report = silent,
) -> JobPlan:
    """Check photographs, options and control against what the node says of itself; send nothing.

    Parameters
    ----------
    images : files and folders; or what `check_photos` has found of them.
    url, token, ca, insecure : the node; or, with a `project`, the WebODM server.
    project : number of the project there that is to hold the task.
    access : who asks WebODM; by default what the environment says.
    name : what the node is to call the task; by default the first image's folder.
    preset, options, split, ground : see `choose_options`.
    minimal : have only what measuring needs packed into the result.
    gcp : a GCP file in ODM's format.

    Raises
    ------
    InputError
        A photograph, an option or the GCP file cannot be used.
    ServerError
        The node cannot be reached or refuses the token.
    """
    photos = images
    if not isinstance(photos, PhotoSummary):
        photos = check_photos(photos, allow_faulty=allow_faulty)
    if access is not None and project is not None:
        ca, insecure = access.ca or ca, access.insecure or insecure
    node = connect(url, token, project=project, access=access, ca=ca, insecure=insecure)
    patience = Patience(FIRST_CONTACT_S, lambda text: report(JobEvent("message", text=text)))
    engine = patience.through(node.engine)
    chosen, notes = choose_options(
        patience.through(node.options), preset, options, ground=ground, split=split
    )
    if engine.max_images is not None and len(photos.photos) > engine.max_images:
        raise InputError(
            f"{len(photos.photos)} photographs are there, and {node.name} takes at most "
            f"{engine.max_images}; give fewer, or another node"
        )
    if gcp is not None:
        _require_control(gcp, photos)
    if minimal and node.packs_all:
        notes = (*notes, "WebODM always packs everything into its all.zip.")
    return JobPlan(
        url=node.url,
        name=name or real_path(photos.photos[0].path).parent.name or "quantify",
        photos=photos,
        options=chosen,
        outputs=MINIMAL_OUTPUTS if minimal and not node.packs_all else (),
        gcp=gcp,
        ca=ca,
        engine=engine.words,
        notes=notes,
        project=project,
        label=node.label,
    )


def create_job(plan: JobPlan, folder: Path, then: Optional[Mapping[str, Any]] = None) -> Job:
    """Write a job's journal into a folder that holds none, and a record of it; nothing is sent.

    `then` is kept for the caller: how to go on with the result. No secret belongs into it.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{folder}: cannot be made ({error.strerror or error})") from error
    with locked(folder):
        require_free(folder)
        files = [
            SentFile(photo.name, str(real_path(photo.path)), photo.size, photo.mtime_ns)
            for photo in plan.photos.photos
        ]
        if plan.gcp is not None:
            files.append(_kept_control(plan.gcp, folder))
        job = Job(
            url=split_token(plan.url)[0],
            name=plan.name,
            options=dict(plan.options),
            outputs=plan.outputs,
            files=tuple(files),
            then=dict(then or {}),
            kind=NODE if plan.project is None else WEBODM,
            project=plan.project,
            marker="" if plan.project is None else f"quantify-client upload {uuid.uuid4()}",
            id=str(uuid.uuid4()),
        )
        keep_record(job, folder, plan.ca)
        return save(folder, job)


def require_free(folder: Path) -> None:
    """Raise JobError when a folder holds a job, or what a job's result would replace."""
    if (folder / JOURNAL).exists():
        raise JobError(
            f"{folder}: holds a job already; {resuming(folder)} goes on with it, another --out "
            "begins a new one"
        )
    for name in (ARCHIVE, f"{ARCHIVE}.part", SEED, "sent-1.jsonl"):
        if (folder / name).exists():
            article = "an" if name.startswith("a") else "a"
            raise JobError(
                f"{folder}: holds {article} {name} already, which the job's would replace; give "
                "another --out"
            )


def _kept_control(gcp: Path, folder: Path) -> SentFile:
    """Keep a copy in the job's folder: what is sent is that, whatever becomes of the original."""
    kept = folder / GCP_NAME
    if kept.exists() and not filecmp.cmp(gcp, kept, shallow=False):
        raise JobError(
            f"{folder}: holds another {GCP_NAME}, which the one that is sent would replace; give "
            "another --out"
        )
    try:
        shutil.copyfile(gcp, kept)
    except shutil.SameFileError:
        pass
    except OSError as error:
        raise OutputError(f"{kept}: cannot be written ({error.strerror or error})") from error
    status = kept.stat()
    return SentFile(GCP_NAME, str(real_path(kept)), status.st_size, status.st_mtime_ns)


def _require_control(gcp: Path, photos: PhotoSummary) -> None:
    """Raise InputError unless the file can be read and names at least one of the photographs."""
    try:
        lines = gcp.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        said = getattr(error, "strerror", None) or "not in UTF-8"
        raise InputError(f"{gcp}: cannot be read ({said}); expected ODM's gcp_list.txt") from error
    named = {fields[5] for fields in (line.split() for line in lines[1:]) if len(fields) > 5}
    if not named & {photo.name for photo in photos.photos}:
        raise InputError(
            f"{gcp}: names none of the photographs; expected lines 'x y z px py IMAGE', as "
            "'quantify-client gcp FILE --to odm' writes them"
        )
