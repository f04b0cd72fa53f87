"""What the user points at -> an open cloud: files, tiles, an ODM folder, an all.zip or a task."""

from __future__ import annotations

import re
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, replace
from datetime import datetime, timezone
from pathlib import Path
from typing import (
    Any,
    Callable,
    ContextManager,
    Iterator,
    List,
    Mapping,
    Optional,
    Sequence,
    Tuple,
    Union,
)

from .cloud import DEFAULT_CHUNK, Cloud, open_cloud
from .cloud.base import CloudWrapper, naming
from .crs import (
    UNITS_M,
    Statement,
    given_crs,
    merge_statements,
    same_coordinates,
    statement_of_cloud,
    statement_of_wkt,
)
from .errors import CloudError, UsageError, require_installed
from .files.reading import real_path
from .sfm.odm.archive import unpacked
from .sfm.odm.layout import (
    ENTWINE,
    GEOREFERENCING,
    LocatedCloud,
    Sidecar,
    belongs_to_odm,
    find_cloud,
    project_of,
    read_sidecar,
)
from .sfm.servers.access import Access
from .types import Chunk, CloudInfo, CrsPart, Faces, Notice, Options, Window

__all__ = ["Source", "file_of", "is_address", "open_source", "time_of"]

Aliases = Sequence[Tuple[str, str]]
"""Names of temporary folders, and what users know them by."""
Progress = Callable[[str, float], None]

_URL = re.compile(r"^https?:/", re.IGNORECASE)
_TIMED = (".las", ".laz")
_MODEL_STEM = "odm_georeferenced_model"
_INNER = (GEOREFERENCING, ENTWINE, "odm_filterpoints")


@dataclass(frozen=True)
class Source:
    """An open cloud and where it came from.

    Attributes
    ----------
    cloud : the points; valid while :func:`open_source` is.
    label : what the user gave.
    stem : name of the result when there are no polygons.
    is_odm : whether OpenDroneMap made it.
    inputs : per file its ``path``, ``size`` in bytes and ``mtime`` (ISO 8601, UTC; None outside the
        years 1 to 9999).
    project : folder of the ODM project that it is in, where there is one; valid as the cloud is.
    files : the cloud's own files, as they can be opened.
    """

    cloud: Cloud
    label: str
    stem: str
    is_odm: bool
    inputs: Sequence[Mapping[str, Any]]
    project: Optional[Path] = None
    files: Sequence[Path] = ()


@contextmanager
def open_source(
    sources: Sequence[Union[str, Path]],
    *,
    cameras: bool = False,
    access: Optional[Access] = None,
    windowed: bool = False,
    progress: Optional[Progress] = None,
    options: Optional[Options] = None,
) -> Iterator[Source]:
    """Open what the user gave: one source, or several tiles of one survey.

    A source is a point cloud, an ept.json, an ODM project folder, a folder of LAS or LAZ tiles,
    an all.zip, or the address of a task on a WebODM server; what is unpacked or fetched is removed
    at the end of the ``with`` block.

    Parameters
    ----------
    cameras : unpack or fetch what an archive or a task says of its photographs, too.
    access : of WebODM servers; by default what the environment says.
    windowed : only a part of the points will be asked for, or none.
    progress : told what is fetched, and the share that is there.
    options : the CRS and the units that the user gave, which go before what files say.

    Raises
    ------
    CloudError
        One line: what was found, what was expected, what to do.
    ServerError, OutputError
        The same, of what is fetched.
    """
    if not sources:
        raise CloudError("no source is given; expected a point cloud, a folder or an all.zip")
    # What follows ? in an address may hold a token, and says nothing of the task.
    names = [re.split("[?#]", str(s))[0] if is_address(s) else str(s) for s in sources]
    with ExitStack() as stack:
        located = [
            stack.enter_context(_task(given, access, cameras, windowed, progress))
            if is_address(given)
            else _local(given, cameras, stack)
            for given in names
        ]
        aliases = tuple(item.alias for item in located if item.alias)
        paths = tuple(path for item in located for path in item.paths)
        with _renaming(aliases):
            cloud = open_cloud(
                paths,
                {path: item.fetch for item in located if item.fetch for path in item.paths},
                any_crs=options is not None and options.crs is not None,
            )
        yield Source(
            cloud=_Presented(cloud, _info(cloud.info, located, aliases, options), aliases),
            label=" ".join(names),
            stem=_common_stem(names, located[0]) or "cloud",
            is_odm=any(item.is_odm for item in located),
            inputs=tuple(entry for item in located for entry in item.inputs or ()),
            project=project_of(paths[0]) if len(located) == 1 else None,
            files=paths,
        )


def is_address(given: Union[str, Path]) -> bool:
    """Whether a source is on a server."""
    return bool(_URL.match(str(given)))


def time_of(source: Source) -> Optional[Tuple[datetime, datetime]]:
    """Return when a survey was begun and ended, as its photographs or its points tell; or None."""
    from .cloud.las.times import time_of_points  # late: only where surveys are compared
    from .sfm.odm.times import times_of_photographs

    if source.project is not None:
        photographs = times_of_photographs(source.project)
        if photographs is not None:
            return photographs
    of_files = [time_of_points(path) for path in source.files if path.suffix.lower() in _TIMED]
    known = [time for time in of_files if time is not None]
    return (min(known), max(known)) if known else None


def _task(
    given: str,
    access: Optional[Access],
    cameras: bool,
    windowed: bool,
    progress: Optional[Progress],
) -> ContextManager[LocatedCloud]:
    require_installed("requests", "a task on a server")
    from .sfm.servers.webodm_cloud import task_cloud  # only where a server is asked

    who = Access.from_environment() if access is None else access
    return task_cloud(given, who, cameras, windowed, progress)


def _local(given: str, cameras: bool, stack: ExitStack) -> LocatedCloud:
    path = Path(given)
    with naming(path, "check the path"):
        if not path.exists():
            raise CloudError(f"{path}: does not exist; check the path")
        is_folder = path.is_dir()
        if not (is_folder or path.is_file()):  # a device or pipe might never end
            raise CloudError(f"{path}: is not a file; check the path")
    if is_folder:
        found = find_cloud(path)
        return replace(found, inputs=[file_of(str(file), file) for file in found.paths])
    entry = file_of(given, path)
    if path.suffix.lower() == ".zip":
        return replace(stack.enter_context(unpacked(path, cameras=cameras)), inputs=[entry])
    return LocatedCloud((path,), belongs_to_odm(path), read_sidecar(path), inputs=[entry])


def file_of(given: str, path: Path) -> Mapping[str, Any]:
    """Return what a result tells of a file that was read."""
    with naming(path, "check the path"):
        status = path.stat()
    changed: Optional[str] = None
    with suppress(ValueError, OverflowError, OSError):  # a time that no calendar has
        changed = datetime.fromtimestamp(status.st_mtime, tz=timezone.utc).isoformat()
    return {"path": given, "size": status.st_size, "mtime": changed}


def _info(
    info: CloudInfo, located: Sequence[LocatedCloud], aliases: Aliases, options: Optional[Options]
) -> CloudInfo:
    """Add what the user and the surroundings of the files say beyond the files themselves."""
    given = None if options is None else _given(options)
    statements = [said for said in (given, statement_of_cloud(info)) if said is not None]
    beside, far = _said_beside(info, located, statements)
    stated = merge_statements([*statements, *beside])
    if given is not None and stated.crs is None:
        raise UsageError(
            "--vertical-unit goes with a CRS or a unit of x and y, and the cloud names neither: "
            "give --crs or --source-unit, too"
        )
    parts = stated.parts
    if not parts and options is not None and options.source_unit is not None:
        parts = tuple(
            CrsPart(f"{axes} unit", options.source_unit, "--source-unit")
            for axes in ("horizontal", "vertical")
        )
    own = [_rename(text, aliases) for text in info.warnings]
    of_sources = [text for item in located for text in item.warnings]
    return replace(
        info,
        sources=tuple(_rename(text, aliases) for text in info.sources),
        crs=stated.crs,
        crs_origin=stated.origin,
        warnings=(*own, *of_sources, *far, *stated.warnings),
        crs_parts=parts,
    )


def _said_beside(
    info: CloudInfo, located: Sequence[LocatedCloud], statements: Sequence[Statement]
) -> Tuple[List[Statement], List[Notice]]:
    """Return what files beside the cloud say of its CRS, and warnings of what cannot be so."""
    sidecars: List[Sidecar] = []
    for sidecar in (item.sidecar for item in located if item.sidecar):
        if not any(same_coordinates(sidecar.crs, other.crs) for other in sidecars):
            sidecars.append(sidecar)
    if len(sidecars) > 1 and not any(statement.crs for statement in statements):
        named = " and ".join(f"{item.origin} {item.crs[:60]!r}" for item in sidecars[:2])
        raise CloudError(
            f"the sources are in different CRS ({named}); expected tiles of one survey: measure "
            "them one by one, or give the CRS of all (--crs)"
        )
    said: List[Statement] = []
    far: List[Notice] = []
    for sidecar in sidecars:
        if sidecar.fits(info.bounds):
            said.append(statement_of_wkt(sidecar.crs, sidecar.origin))
        elif not (statements or said):
            text = (
                f"{sidecar.origin} says {sidecar.crs}, but the cloud is nowhere near the place it "
                "gives: the cloud is taken to have no CRS (--crs gives one)"
            )
            far.append(Notice("crs-far-from-cloud", text, origin=sidecar.origin, crs=sidecar.crs))
    return said, far


def _given(options: Options) -> Optional[Statement]:
    """Return what the user says of the CRS and the heights."""
    height, unit = options.vertical_unit, options.source_unit
    if options.crs is None and height is None:
        return None
    return Statement(
        "--crs" if options.crs is not None else "--vertical-unit",
        None if options.crs is None else given_crs(options.crs),
        unit=None if unit is None or options.crs is not None else (unit, UNITS_M[unit]),
        height_unit=None if height is None else (height, UNITS_M[height]),
        places={"horizontal unit": "--source-unit" if options.crs is None else "--crs"}
        | ({} if height is None else {"vertical unit": "--vertical-unit"}),
    )


class _Presented(CloudWrapper):
    """A cloud under the names the user knows, with what its surroundings say of it."""

    def __init__(self, cloud: Cloud, info: CloudInfo, aliases: Aliases) -> None:
        super().__init__(cloud, info)
        self._aliases = aliases

    def chunks(self, window: Optional[Window] = None, size: int = DEFAULT_CHUNK) -> Iterator[Chunk]:
        """As the cloud itself; errors name the archive instead of a temporary file."""
        with _renaming(self._aliases):
            yield from self._cloud.chunks(window, size)

    def faces(self) -> Optional[Faces]:
        """As the cloud itself; None where it has none."""
        with _renaming(self._aliases):
            return super().faces()


@contextmanager
def _renaming(aliases: Aliases) -> Iterator[None]:
    try:
        yield
    except CloudError as error:
        if not aliases:
            raise
        raise CloudError(_rename(str(error), aliases)) from error


def _rename(text: str, aliases: Aliases) -> str:
    """Return a text, or a Notice, with the names that the user knows."""
    renamed = str(text)
    for temporary, given in aliases:
        renamed = renamed.replace(temporary, given)
    if not isinstance(text, Notice) or renamed == text:
        return text if renamed == text else renamed
    values = {
        key: _rename(value, aliases) if isinstance(value, str) else value
        for key, value in text.values.items()
    }
    return Notice(text.code, renamed, **values)


def _common_stem(names: Sequence[str], first: LocatedCloud) -> str:
    parents = {real_path(name).parent for name in names}
    if len(names) > 1 and len(parents) == 1:
        return parents.pop().name
    return (first.stem if len(names) == 1 else None) or _stem(Path(names[0]))


def _stem(path: Path) -> str:
    """Return the project's name for ODM's own file and folder names, else the file's."""
    real = real_path(path)
    if real.is_dir():
        return real.parent.name if real.name in _INNER else real.name
    stem = re.sub(r"\.copc$", "", real.stem, flags=re.IGNORECASE)
    if stem != _MODEL_STEM and real.name not in ("ept.json", "point_cloud.ply"):
        return stem
    folder = real.parent
    return (folder.parent.name if folder.name in _INNER else folder.name) or stem
