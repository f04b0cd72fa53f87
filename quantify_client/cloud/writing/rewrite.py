"""A point cloud through a transform into a new LAS or LAZ file, with all it knows of its points.

This is a conversion, not a measurement: every point is kept, noise and withheld ones included, in
the order of the files, with every attribute it has. Memory does not depend on the number of points.

One LAS or LAZ file keeps its point format, its extra bytes and its version (1.4 where a CRS or
extended records need it); of COPC only the order of the points is left. Tiles in different formats
are written in the smallest one that has room for all of them, and what a tile lacks is 0. PLY, text
and binary EPT become format 6, 7 (colours) or 8 (infrared), see :mod:`.columns`. Wave forms are not
kept.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Callable, Iterator, List, Optional, Sequence, Tuple

from laspy import PointFormat

from ...crs import as_wkt
from ...errors import CloudError, OutputError
from ...files.reading import real_path
from ...files.writing import put_in_place, require_replaceable, staging
from ...types import Bounds, Notice
from .. import require_readable
from ..tiles import require_distinct
from .columns import names_of_normals
from .coordinates import Move, fitted, wanted_step
from .las_file import LasFile, choose_records, explaining, make_header
from .record_layout import Places, Rows, Schema, merge, to_schema
from .sources import Block, PointSource, open_sources

WRITTEN = (".laz", ".las")
"""The endings that can be written."""

_AT_LEAST = "expected at least one"
_CHUNK = 500_000  # points at a time: half of what measuring takes, whose points are not kept whole


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
    sources = _open([Path(path) for path in paths])
    inputs = [*map(Path, paths), *(file for source in sources for file in source.files)]
    with explaining(out):
        require_replaceable(out, inputs)
    schema, places = merge([source.schema for source in sources])
    wanted = wanted_step([(source.steps, source.bounds) for source in sources], move, bounds)
    quantization, coarser = fitted(wanted, bounds)
    records, left_out = choose_records([source.records for source in sources])
    header, after = make_header(sources, schema, quantization, records, wkt)
    said = [text for source in sources for text in source.warnings]
    said += [*coarser, *_changes(sources, schema), *left_out]

    def converted(block: Block, source: PointSource, places: Places) -> Rows:
        rows = to_schema(block.rows, source.schema, schema, places)
        moved = move(block.x, block.y, block.z) if len(rows) else ()
        for axis, values in enumerate(moved):
            rows["XYZ"[axis]] = quantization.integers(out, axis, values)
        return rows

    real = real_path(out)
    with explaining(out), staging(real.parent) as working:
        with (working / real.name).open("xb") as stream:
            file = LasFile(out, stream, header, after)
            lost = _write_points(file, sources, places, converted, progress)
            box = file.close()
        said += _lost(lost)
        written = RewriteReport(file.count, out, box, tuple(dict.fromkeys(said)))
        put_in_place(working, [real.name, *(beside(written, working) if beside else ())], inputs)
    return written


def _write_points(
    file: LasFile,
    sources: Sequence[PointSource],
    places: Sequence[Places],
    converted: Callable[[Block, PointSource, Places], Rows],
    progress: Optional[Callable[[str, float], None]],
) -> int:
    """Write all points; return how many rows had no place."""
    lost, total = 0, sum(source.count for source in sources)
    tell = progress or (lambda stage, share: None)
    tell("writing points", 0.0)
    for source, place in zip(sources, places):
        for block in source.blocks(_CHUNK):
            file.write(converted(block, source, place))
            lost += block.lost
            tell("writing points", min((file.count + lost) / total, 1.0))
    if not file.count:
        raise CloudError(f"{sources[0].path}: no point has finite coordinates; {_AT_LEAST}")
    return lost


def _lost(count: int) -> Sequence[Notice]:
    if not count:
        return ()
    points = "1 point has" if count == 1 else f"{count} points have"
    text = f"{points} a coordinate that is NaN or infinite: left out, the others are written"
    return (Notice("not-finite-left-out", text, points=count),)


def require_rewritable(paths: Sequence[Path], out: Path) -> None:
    """Raise OutputError when `out` cannot be written, before anything is read."""
    out = Path(out)
    if out.suffix.lower() not in WRITTEN or out.name.lower().endswith(".copc.laz"):
        found = ".copc.laz" if out.name.lower().endswith(".copc.laz") else out.suffix
        raise OutputError(
            f"{out}: cannot be written with the ending {found or 'none'!r}; expected "
            f"{' or '.join(WRITTEN)}"
        )
    with explaining(out):
        if out.exists() and not out.is_file():
            raise OutputError(f"{out}: is not a file; give the name of a file to write")
        if not real_path(out).parent.is_dir():
            raise OutputError(f"{out}: its folder does not exist; make it or give another name")
        require_replaceable(out, list(paths))


def _open(files: Sequence[Path]) -> List[PointSource]:
    if not files:
        raise CloudError("no point cloud is given; expected at least one file")
    require_distinct(files)
    sources: List[PointSource] = []
    for path in files:
        require_readable(path)
        sources += open_sources(path)
    if not any(source.count for source in sources):
        raise CloudError(f"{files[0]}: holds no points; {_AT_LEAST}")
    return sources


def _changes(sources: Sequence[PointSource], schema: Schema) -> Iterator[Notice]:
    """Deliver a warning for each thing that differs between the input and the output."""
    schemas = [source.schema for source in sources]
    formats = sorted({one.point_format for one in schemas})
    told, target = ", ".join(map(str, formats)), schema.point_format
    if any(PointFormat(number).has_waveform_packet for number in formats):
        text = (
            f"waveforms are not written (point format {target} instead of {told}); the points and "
            "their other attributes are kept"
        )
        yield Notice("wave-forms-left-out", text, point_format=target)
    elif len(formats) > 1:
        text = (
            f"the tiles have point formats {told}; all are written in format {target}, with 0 "
            "for fields that a tile does not have"
        )
        yield Notice("point-formats-differ", text, point_format=target)
    if any(len(one.extras) < len(schema.extras) for one in schemas):
        text = "the tiles differ in their extra attributes; those that a tile does not have are 0"
        yield Notice("extra-attributes-differ", text)
    known = {extra.name for one in schemas for extra in one.extras}
    renamed = [extra.name for extra in schema.extras if extra.name not in known]
    if renamed:
        text = (
            "attributes with the same name but different types or scales were renamed: "
            f"{', '.join(renamed)[:200]}"
        )
        yield Notice("extra-attributes-renamed", text, attributes=len(renamed))
    headers = [source.header for source in sources if source.header is not None]
    if len({header.global_encoding.gps_time_type for header in headers}) > 1:
        text = "the tiles use different kinds of GPS time; the header states that of the first tile"
        yield Notice("gps-times-differ", text)
    turned = names_of_normals(extra.name for extra in schema.extras)
    if turned:
        text = f"normals are not rotated with the points: {', '.join(turned)[:200]}"
        yield Notice("normals-kept", text)
