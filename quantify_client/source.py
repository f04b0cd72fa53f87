"""What the user points at -> an open cloud: files, tiles, an ODM folder, an all.zip or a task."""

from __future__ import annotations

import re
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, replace
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, Callable, Iterator, List, Mapping, Optional, Sequence, Tuple, Union

from .cloud import DEFAULT_CHUNK, Cloud, Fetch, Mesh, open_cloud
from .cloud.base import naming
from .crs import UNITS_M, Statement, given_crs, merge, same_coordinates, stated_by, statement_of_wkt
from .errors import CloudError, UsageError
from .files.reading import real_path
from .sfm.odm.archive import unpacked
from .sfm.odm.layout import (
    ENTWINE,
    GEOREFERENCING,
    Sidecar,
    belongs_to_odm,
    find_cloud,
    project_of,
    read_sidecar,
)
from .sfm.servers.access import Access
from .types import Chunk, CloudInfo, CrsPart, Faces, Options, Window

__all__ = ["Source", "is_address", "open_source"]

_URL = re.compile(r"^https?:/", re.IGNORECASE)
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
    progress: Optional[Callable[[str, float], None]] = None,
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
    with ExitStack() as stack:
        wanted = _Wanted(cameras, access, windowed, progress or (lambda stage, share: None))
        located = [_locate(str(source), stack, wanted) for source in sources]
        aliases = tuple(alias for item in located for alias in item.aliases)
        with _renaming(aliases):
            cloud = open_cloud(
                [path for item in located for path in item.paths],
                {path: item.fetch for item in located if item.fetch for path in item.paths},
                any_crs=options is not None and options.crs is not None,
            )
        yield Source(
            cloud=_Presented(cloud, _info(cloud.info, located, aliases, options), aliases),
            label=" ".join(item.given for item in located),
            stem=_common_stem(located),
            is_odm=any(item.is_odm for item in located),
            inputs=tuple(entry for item in located for entry in item.inputs),
            project=project_of(located[0].paths[0]) if len(located) == 1 else None,
            files=tuple(path for item in located for path in item.paths),
        )


Aliases = Tuple[Tuple[str, str], ...]


@dataclass(frozen=True)
class _Wanted:
    """What of a source will be needed, and how to come by it; see `open_source`."""

    cameras: bool
    access: Optional[Access]
    windowed: bool
    progress: Callable[[str, float], None]


@dataclass(frozen=True)
class _Located:
    """One source found: its files, and how to name those that only exist for now."""

    given: str
    paths: Tuple[Path, ...]
    is_odm: bool
    inputs: Tuple[Mapping[str, Any], ...]
    sidecar: Optional[Sidecar] = None
    warnings: Tuple[str, ...] = ()
    aliases: Aliases = ()
    fetch: Optional[Fetch] = None
    stem: Optional[str] = None


def is_address(given: Union[str, Path]) -> bool:
    """Whether a source is on a server."""
    return bool(_URL.match(str(given)))


def _locate(given: str, stack: ExitStack, wanted: _Wanted) -> _Located:
    if is_address(given):
        return _locate_task(given, stack, wanted)
    path = Path(given)
    with naming(path, "check the path"):
        if not path.exists():
            raise CloudError(f"{path}: does not exist; check the path")
        is_folder = path.is_dir()
        if not (is_folder or path.is_file()):  # a device or pipe might never end
            raise CloudError(f"{path}: is not a file; check the path")
    if is_folder:
        found = find_cloud(path)
        inputs = tuple(_input(str(file), file) for file in found.paths)
        sidecar = None if found.warnings else read_sidecar(found.paths[0])
        return _Located(given, found.paths, found.is_odm, inputs, sidecar, found.warnings)
    entry = (_input(given, path),)
    if path.suffix.lower() == ".zip":
        file = stack.enter_context(unpacked(path, cameras=wanted.cameras))
        is_odm = file.parent.name.startswith("odm_")
        alias = (str(file.parent.parent if is_odm else file.parent), given)
        return _Located(given, (file,), is_odm, entry, read_sidecar(file), aliases=(alias,))
    return _Located(given, (path,), belongs_to_odm(path), entry, read_sidecar(path))


def _locate_task(given: str, stack: ExitStack, wanted: _Wanted) -> _Located:
    from .sfm.servers.webodm_cloud import (
        task_cloud,  # with what it needs, only where a server is asked
    )

    access = wanted.access if wanted.access is not None else Access.from_environment()
    found = stack.enter_context(
        task_cloud(
            given,
            access,
            cameras=wanted.cameras,
            windowed=wanted.windowed,
            progress=wanted.progress,
        )
    )
    sidecar = read_sidecar(found.path) or (
        Sidecar(found.crs, "the task's EPSG code") if found.crs else None
    )
    return _Located(
        found.given,
        (found.path,),
        True,
        (found.entry,),
        sidecar,
        found.warnings,
        aliases=((str(found.folder), found.given.rstrip("/")),),
        fetch=found.fetch,
        stem=found.stem,
    )


def _input(given: str, path: Path) -> Mapping[str, Any]:
    with naming(path, "check the path"):
        status = path.stat()
    changed: Optional[str] = None
    with suppress(ValueError, OverflowError, OSError):  # a time that no calendar has
        changed = datetime.fromtimestamp(status.st_mtime, tz=timezone.utc).isoformat()
    return {"path": given, "size": status.st_size, "mtime": changed}


def _info(
    info: CloudInfo, located: Sequence[_Located], aliases: Aliases, options: Optional[Options]
) -> CloudInfo:
    """Add what the user and the surroundings of the files say beyond the files themselves."""
    warnings = [_rename(text, aliases) for text in info.warnings]
    warnings += [text for item in located for text in item.warnings]
    given = None if options is None else _given(options)
    statements = [said for said in (given, stated_by(info)) if said is not None]
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
    for sidecar in sidecars:
        if sidecar.fits(info.bounds):
            statements.append(statement_of_wkt(sidecar.crs, sidecar.origin))
        elif not statements:
            warnings.append(
                f"{sidecar.origin} says {sidecar.crs}, but the cloud is nowhere near the place it "
                "gives: the cloud is taken to have no CRS (--crs gives one)"
            )
    stated = merge(statements)
    if given is not None and stated.crs is None:
        raise UsageError(
            "--vertical-unit goes with a CRS or a unit of x and y, and the cloud names neither: "
            "give --crs or --source-unit, too"
        )
    return replace(
        info,
        sources=tuple(_rename(text, aliases) for text in info.sources),
        crs=stated.crs,
        crs_origin=stated.origin,
        warnings=(*warnings, *stated.warnings),
        crs_parts=stated.parts or _unit_parts(options),
    )


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


def _unit_parts(options: Optional[Options]) -> Tuple[CrsPart, ...]:
    """Return the parts of a cloud without a CRS, whose unit the user gave."""
    unit = None if options is None else options.source_unit
    if unit is None:
        return ()
    return tuple(
        CrsPart(f"{axes} unit", unit, "--source-unit") for axes in ("horizontal", "vertical")
    )


class _Presented:
    """A cloud under the names the user knows, with what its surroundings say of it."""

    def __init__(self, cloud: Cloud, info: CloudInfo, aliases: Aliases) -> None:
        self._cloud = cloud
        self._aliases = aliases
        self.info = info

    def chunks(self, window: Optional[Window] = None, size: int = DEFAULT_CHUNK) -> Iterator[Chunk]:
        """As the cloud itself; errors name the archive instead of a temporary file."""
        with _renaming(self._aliases):
            yield from self._cloud.chunks(window, size)

    def faces(self) -> Optional[Faces]:
        """As the cloud itself; None where it has none."""
        with _renaming(self._aliases):
            return self._cloud.faces() if isinstance(self._cloud, Mesh) else None


@contextmanager
def _renaming(aliases: Aliases) -> Iterator[None]:
    try:
        yield
    except CloudError as error:
        if not aliases:
            raise
        raise CloudError(_rename(str(error), aliases)) from error


def _rename(text: str, aliases: Aliases) -> str:
    for temporary, given in aliases:
        text = text.replace(temporary, given)
    return text


def _common_stem(located: Sequence[_Located]) -> str:
    given: List[str] = [item.given for item in located]
    if len(given) == 1:
        if located[0].stem:
            return located[0].stem
        return _stem(Path(given[0])) or "cloud"
    parents = {real_path(name).parent for name in given}
    return (parents.pop().name if len(parents) == 1 else _stem(Path(given[0]))) or "cloud"


def _stem(path: Path) -> str:
    """The project's name for ODM's own file and folder names, else the file's."""
    real = real_path(path)
    if real.is_dir():
        return real.parent.name if real.name in _INNER else real.name
    stem = re.sub(r"\.copc$", "", real.stem, flags=re.IGNORECASE)
    if stem != _MODEL_STEM and real.name not in ("ept.json", "point_cloud.ply"):
        return stem
    folder = real.parent
    return (folder.parent.name if folder.name in _INNER else folder.name) or stem
