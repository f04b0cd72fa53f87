"""A point cloud through a transform into a new LAS or LAZ file, with all it knows of its points.

This is a conversion, not a measurement: every point is kept, noise and withheld ones included, in
the order of the files, with every attribute it has. Memory does not depend on the number of points.

One LAS or LAZ file keeps its point format, its extra bytes and its version (1.4 where a CRS or
extended records need it); of COPC only the order of the points is left. Tiles in different formats
are written in the smallest one that has room for all of them, and what a tile lacks is 0. PLY, text
and binary EPT become format 6, 7 (colours) or 8 (infrared), see :mod:`.rewrite_table`. Wave forms
are not kept.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Callable, Dict, Iterator, List, Optional, Sequence, Tuple

from ..crs import as_wkt
from ..errors import CloudError, OutputError
from ..files.reading import real_path
from ..files.writing import put_in_place, require_replaceable, staging
from ..types import Bounds
from . import SUFFIXES, refuse_impostor
from .base import naming
from .rewrite_ept import BinaryTiles, read_ept
from .rewrite_ply import PlySource
from .rewrite_quantum import Move, fitted, wanted_step
from .rewrite_records import choose_records
from .rewrite_schema import Places, Schema, conform, merge
from .rewrite_source import PointSource, read_las
from .rewrite_table import of_directions
from .rewrite_text import TextSource
from .rewrite_writer import LasWriter, Plan, explaining
from .tiles import require_distinct

__all__ = ["WRITTEN", "RewriteReport", "require_rewritable", "rewrite_cloud"]

WRITTEN = (".laz", ".las")
"""The endings that can be written."""

_AT_LEAST = "expected at least one"
_CHUNK = 500_000  # points at a time: half of what measuring takes, whose points are not kept whole
_READERS: Dict[str, Callable[[Path], PointSource]] = {
    ".las": read_las,
    ".laz": read_las,
    ".ply": PlySource,
}


@dataclass(frozen=True)
class RewriteReport:
    """What has been written.

    Attributes
    ----------
    points : how many.
    path : the file.
    bounds : their box, as a reader of the file finds it.
    warnings : what could not be kept, and what is not as it was.
    """

    points: int
    path: Path
    bounds: Bounds
    warnings: Tuple[str, ...] = ()


Beside = Callable[[RewriteReport, Path], Sequence[str]]


def rewrite_cloud(
    paths: Sequence[Path],
    out: Path,
    move: Move,
    bounds: Bounds,
    crs: Optional[str],
    progress: Optional[Callable[[str, float], None]] = None,
    beside: Optional[Beside] = None,
) -> RewriteReport:
    """Write all points of a cloud, moved, with all their attributes.

    Parameters
    ----------
    paths : one file or several tiles of one survey; what `open_cloud` takes.
    out : a .laz or .las file. It is there when it is complete; an earlier result of ours that was
        there is replaced then.
    move : takes x, y, z as (N,) float64 in the files' coordinates, returns those to write. Called
        once for each chunk, in order, and before with a few places within the box.
    bounds : the box of the moved points, as well as it is known.
    crs : of the moved points, as WKT, PROJ string or ``EPSG:n``; None writes none.
    progress : called with a stage and the share done, from 0 to 1.
    beside : called when the file is complete, with what was written and a folder; returns the names
        of files that it has written there. They and the cloud appear together, or not at all.

    Raises
    ------
    CloudError
        A file that is missing, unreadable, damaged, shorter than it says, given twice, or without
        points.
    CrsError
        An unknown CRS.
    OutputError
        `out` has another ending, is one of the inputs or a file that is no result of ours, or
        cannot be written; a moved point that is so far outside of `bounds` that its coordinates
        cannot be written.
    """
    out = Path(out)
    require_rewritable(paths, out)
    wkt = as_wkt(crs) if crs is not None else None
    sources = _open(paths)
    inputs = _files(paths, sources)
    with explaining(out):
        require_replaceable(out, inputs)
    plan, places, warnings = _plan(sources, out, move, bounds, wkt)
    real = real_path(out)
    with explaining(out), staging(real.parent) as working:
        box, lost = _write(working / real.name, out, sources, places, plan, move, progress)
        written = RewriteReport(plan.count - lost, out, box, (*warnings, *_lost(lost)))
        put_in_place(working, [real.name, *(beside(written, working) if beside else ())], inputs)
    return written


def _write(
    path: Path,
    out: Path,
    sources: Sequence[PointSource],
    places: Sequence[Places],
    plan: Plan,
    move: Move,
    progress: Optional[Callable[[str, float], None]],
) -> Tuple[Bounds, int]:
    """Write everything to `path`, `out` in messages; return the box, and rows without a place."""
    with path.open("xb") as stream:
        writer = LasWriter(out, stream, plan)
        tell = progress or (lambda stage, share: None)
        lost = _stream(sources, places, plan.schema, move, writer, tell)
        if writer.count + lost != plan.count:
            raise CloudError(
                f"{sources[0].path}: {writer.count + lost} points could be read, expected "
                f"{plan.count}; give the files when nothing writes to them"
            )
        if not writer.count:
            raise CloudError(f"{sources[0].path}: no point has finite coordinates; {_AT_LEAST}")
        return writer.close(), lost


def _lost(count: int) -> Tuple[str, ...]:
    if not count:
        return ()
    points = "1 point has" if count == 1 else f"{count} points have"
    return (f"{points} a coordinate that is NaN or infinite: left out, the others are written",)


def require_rewritable(paths: Sequence[Path], out: Path) -> None:
    """Raise OutputError when `out` cannot be written, before anything is read."""
    out = Path(out)
    if out.suffix.lower() not in WRITTEN or out.name.lower().endswith(".copc.laz"):
        found = ".copc.laz" if out.name.lower().endswith(".copc.laz") else out.suffix
        raise OutputError(
            f"{out}: is to be written with the ending {found or 'none'!r}; expected "
            f"{' or '.join(WRITTEN)}"
        )
    with explaining(out):
        if out.exists() and not out.is_file():
            raise OutputError(f"{out}: is not a file; give the name of a file to write")
        if not real_path(out).parent.is_dir():
            raise OutputError(f"{out}: its folder does not exist; make it or give another name")
        require_replaceable(out, list(paths))


def _open(paths: Sequence[Path]) -> List[PointSource]:
    files = [Path(path) for path in paths]
    if not files:
        raise CloudError("no point cloud is given; expected at least one file")
    require_distinct(files)
    sources: List[PointSource] = []
    for path in files:
        with naming(path, "check the path"):
            if not path.is_file():
                found = "is not a file" if path.exists() else "does not exist"
                raise CloudError(f"{path}: {found}; check the path")
        refuse_impostor(path)
        if path.name.lower() == "ept.json":
            sources += read_ept(path)
            continue
        if path.suffix.lower() not in SUFFIXES:
            raise CloudError(
                f"{path}: has an unknown ending; expected {', '.join(SUFFIXES)} or an ept.json"
            )
        sources.append(_READERS.get(path.suffix.lower(), TextSource)(path))
    if not any(source.count for source in sources):
        raise CloudError(f"{files[0]}: holds no points; {_AT_LEAST}")
    return sources


def _files(paths: Sequence[Path], sources: Sequence[PointSource]) -> List[Path]:
    tiles = [tile for s in sources if isinstance(s, BinaryTiles) for tile in s.files()]
    return [*(Path(path) for path in paths), *(source.path for source in sources), *tiles]


def _plan(
    sources: Sequence[PointSource], out: Path, move: Move, bounds: Bounds, wkt: Optional[str]
) -> Tuple[Plan, List[Places], Tuple[str, ...]]:
    schema, places = merge([source.schema for source in sources])
    wanted = wanted_step([(source.steps, source.bounds) for source in sources], move, bounds)
    quantum, coarser = fitted(wanted, bounds)
    origins = [source.origin for source in sources if source.origin is not None]
    kept = choose_records([origin.records for origin in origins])
    plan = Plan(
        schema=schema,
        quantum=quantum,
        compressed=out.suffix.lower() == ".laz",
        count=sum(source.count for source in sources),
        records=kept.records,
        origin=origins[0] if origins else None,
        wkt=wkt,
    )
    said = [text for source in sources for text in source.warnings]
    said += [*coarser, *_changes(sources, schema), *kept.warnings]
    return plan, places, tuple(dict.fromkeys(said))


def _changes(sources: Sequence[PointSource], schema: Schema) -> Iterator[str]:
    """What is not as it was."""
    schemas = [source.schema for source in sources]
    formats = sorted({one.point_format for one in schemas})
    if any(one.has_waves for one in schemas):
        yield (
            "wave forms are left out, the points and their other attributes are kept: point "
            f"format {schema.point_format} instead of {', '.join(map(str, formats))}"
        )
    elif len(formats) > 1:
        yield (
            f"the tiles have point formats {', '.join(map(str, formats))}; all are written in "
            f"format {schema.point_format}, and what a tile lacks is 0"
        )
    if any(len(one.extras) < len(schema.extras) for one in schemas):
        yield "the tiles differ in their extra attributes; what a tile lacks is 0"
    known = {extra.name for one in schemas for extra in one.extras}
    renamed = [extra.name for extra in schema.extras if extra.name not in known]
    if renamed:
        yield f"attributes of one name that differ are kept apart: {', '.join(renamed)[:200]}"
    times = {source.origin.encoding & 1 for source in sources if source.origin is not None}
    if len(times) > 1:
        yield "the tiles count GPS time in different ways; the values are kept, the first one told"
    turned = of_directions(extra.name for extra in schema.extras)
    if turned:
        yield f"normals are kept as they are, whatever the move turns: {', '.join(turned)[:200]}"


def _stream(
    sources: Sequence[PointSource],
    places: Sequence[Places],
    target: Schema,
    move: Move,
    writer: LasWriter,
    progress: Callable[[str, float], None],
) -> int:
    """Write all points; return how many rows had no place."""
    lost = 0
    total = sum(source.count for source in sources)
    progress("writing points", 0.0)
    for source, place in zip(sources, places):
        for block in source.blocks(_CHUNK):
            rows = conform(block.rows, source.schema, target, place)
            if len(rows):
                writer.write(rows, *move(block.x, block.y, block.z))
            lost += block.lost
            progress("writing points", min((writer.count + lost) / total, 1.0))
    return lost
