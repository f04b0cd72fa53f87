"""Points with all their attributes, from files of any format, for writing them again.

No point and no field is left out. LAS and LAZ (COPC and the tiles of
EPT are LAZ files, too) keep their records; the columns of other formats are sorted into fields.
"""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, Callable, Iterator, List, NamedTuple, Optional, Sequence, Tuple

import numpy as np
import numpy.typing as npt
from laspy import DecompressionSelection

from ...errors import CloudError
from ...types import Bounds, FloatArray, Notice
from .. import text
from ..base import naming, require_on_map
from ..ept.cloud import binary_rows, is_scaled, kind_of, laz_tile, scaled
from ..ept.index import AGAIN as COMPLETE_EPT
from ..ept.index import EptIndex, read_index
from ..las.header import AGAIN as COMPLETE_LAS
from ..las.header import LasLayout, Record, read_layout, read_records
from ..las.points import MAX_BUFFER, record_reader
from ..ply.cloud import VertexTable
from ..ply.header import AGAIN as COMPLETE_PLY
from .columns import Arrangement, Column, Values, arrange, arrange_fitting, misfits, named_fields
from .record_layout import Rows, Schema, schema_of

_ROWS = 200_000  # looked at together when columns are arranged


class Block(NamedTuple):
    """Some points: (N,) float64 coordinates as the file has them, and (N,) records.

    ``lost`` counts the rows left out among them, which have no place: NaN or infinite coordinates.
    """

    x: FloatArray
    y: FloatArray
    z: FloatArray
    rows: Rows
    lost: int = 0


@dataclass(frozen=True)
class PointSource:
    """A file (or a set) of points that is read once, from front to back.

    Attributes
    ----------
    count : points to come.
    schema : layout of their records.
    blocks : delivers all points in file order, at most so many at a time; raises CloudError when
        there are fewer than the header promises.
    steps : the smallest difference of x, y, z in the file; None when it has none of its own.
    bounds : the box of the points, as far as the file says.
    header : laspy's header of a LAS file.
    records : its variable-length records.
    warnings : what of the file cannot be delivered.
    files : all files that are read.
    """

    path: Path
    count: int
    schema: Schema
    blocks: Callable[[int], Iterator[Block]]
    files: Sequence[Path]
    steps: Optional[Tuple[float, ...]] = None
    bounds: Optional[Bounds] = None
    header: Optional[Any] = None
    records: Sequence[Record] = ()
    warnings: Sequence[str] = ()


def open_sources(path: Path) -> List[PointSource]:
    """Open a file with an ending that can be read, or an ept.json; one source for each LAZ tile.

    Raises
    ------
    CloudError
        A file that cannot be read; a tile that is missing, or holds other than the points that the
        index promises.
    """
    if path.name.lower() == "ept.json":
        index = read_index(path)
        if index.data_type == "laszip":
            return [_of_las(laz_tile(index, key)) for key in index.tiles]
        return [_of_binary_ept(index)]
    if path.suffix.lower() in (".las", ".laz"):
        return [_of_las(read_layout(path))]
    if path.suffix.lower() in (".tif", ".tiff"):
        raise CloudError(
            f"{path}: is a raster, which has no points to move; expected a point cloud: scale "
            "the cloud that it was made from"
        )
    return [_of_ply(path) if path.suffix.lower() == ".ply" else _of_text(path)]


def _of_las(layout: LasLayout) -> PointSource:
    path, header = layout.path, layout.header
    records = read_records(layout)
    described = b"".join(r.data or b"" for r in records if r.key == ("LASF_Spec", 4))
    schema = schema_of(int(header.point_format.id), layout.record_length, described)
    count = layout.count
    header.vlrs.clear()  # which `records` has; of a set there may be millions of tiles

    def blocks(size: int) -> Iterator[Block]:
        again = read_layout(path)  # not held, either
        if again.count != count:
            raise CloudError(f"{path}: changed while it was read; {COMPLETE_LAS}")
        scales, offsets = again.header.scales.tolist(), again.header.offsets.tolist()
        for rows in _las_rows(again, schema, size):
            x, y, z = (rows["XYZ"[axis]] * scales[axis] + offsets[axis] for axis in range(3))
            yield Block(x, y, z, rows)

    return PointSource(
        path,
        count,
        schema,
        blocks,
        files=(path,),
        steps=tuple(np.abs(header.scales).tolist()),
        bounds=layout.bounds,
        header=header,
        records=records,
        warnings=_of_unknown_bytes(path, header),
    )


def _of_unknown_bytes(path: Path, header: Any) -> Tuple[Notice, ...]:
    """Return a warning for bytes that no record of the file describes."""
    before = bytes(header.extra_vlr_bytes)
    if header.version.minor == 0 and before[-2:] == b"\xdd\xcc":
        before = before[:-2]  # LAS 1.0 marks the start of the points with these two
    unknown = {"in its header": bytes(header.extra_header_bytes), "before its points": before}
    return tuple(
        Notice(
            "unknown-bytes-left-out",
            f"{path}: {len(data)} bytes of unknown meaning {where} are left out",
            file=str(path),
            bytes=len(data),
        )
        for where, data in unknown.items()
        if data.strip(b"\0")
    )


def _las_rows(layout: LasLayout, schema: Schema, size: int) -> Iterator[Rows]:
    """Read complete records, each time into a buffer of their own."""
    step = max(1, min(size, MAX_BUFFER // layout.record_length))
    with ExitStack() as stack:
        with naming(layout.path, COMPLETE_LAS):
            fill = record_reader(layout, stack, DecompressionSelection.all())
        for done in range(0, layout.count, step):
            rows: Rows = np.empty(min(step, layout.count - done), schema.dtype)
            told = f"its header promises {layout.count} points, {done} could be read"
            with naming(layout.path, f"{told}; {COMPLETE_LAS}"):
                fill(rows.view(np.uint8))
            yield rows


def _of_table(
    path: Path,
    count: int,
    axes: Sequence[int],
    arranged: Arrangement,
    values: Callable[[int], Iterator[Values]],
    advice: str,
    **more: Any,
) -> PointSource:
    """Return the source that columns are, `axes` of which are x, y and z."""

    def blocks(size: int) -> Iterator[Block]:
        done = 0
        for columns in values(size):
            with np.errstate(invalid="ignore"):  # NaN of single precision, left out below
                x, y, z = (np.array(columns[axis], dtype=np.float64) for axis in axes)
            rows, read = arranged.rows(columns, len(x)), len(x)
            keep = np.isfinite([x, y, z]).all(axis=0)
            if not keep.all():
                x, y, z, rows = x[keep], y[keep], z[keep], rows[keep]
            require_on_map(path, x, y, z, done)
            yield Block(x, y, z, rows, lost=read - len(x))
            done += read
        if done != count:
            raise CloudError(f"{path}: changed while it was read; {advice}")

    return PointSource(path, count, arranged.schema, blocks, **{"files": (path,), **more})


def _of_binary_ept(index: EptIndex) -> PointSource:
    """Return the tiles of a set without compression: packed rows, laid out by ept.json."""
    path = index.source

    def values(size: int) -> Iterator[Values]:
        for key in index.tiles:
            for rows in binary_rows(index, key, size):
                yield [scaled(rows, index, place) for place in range(len(index.schema))]

    with naming(path, COMPLETE_EPT):
        columns: List[Column] = [
            (str(column["name"]), "<f8" if is_scaled(column) else kind_of(column))
            for column in index.schema
        ]
        axes = [[name for name, _ in columns].index(axis) for axis in "XYZ"]
        steps = [abs(float(index.schema[axis].get("scale", 0))) for axis in axes]
        return _of_table(
            path,
            index.count,
            axes,
            arrange_fitting(columns, axes, values(_ROWS)),
            values,
            COMPLETE_EPT,
            steps=tuple(steps) if all(steps) else None,
            bounds=index.conforming,
            files=[path, *(index.tile(key) for key in index.tiles)],
        )


def _of_ply(path: Path) -> PointSource:
    table = VertexTable(path)
    vertex, axes = table.header.vertex, [table.header.columns[axis] for axis in "xyz"]
    columns: List[Column] = [(column.name, column.kind) for column in vertex.properties]

    def values(size: int) -> Iterator[Values]:
        for read in table.columns(range(len(columns)), size):
            yield (
                read
                if table.header.order
                else [_typed(path, *column, told) for column, told in zip(columns, read)]
            )

    arranged = arrange_fitting(columns, axes, values(_ROWS))
    return _of_table(path, vertex.count, axes, arranged, values, COMPLETE_PLY)


def _typed(path: Path, name: str, kind: str, values: FloatArray) -> npt.NDArray[Any]:
    """Return numbers in the type that a header gives; CloudError for one that has no room in it."""
    wanted = np.dtype(kind)
    if wanted.kind in "iu":
        limits = np.iinfo(wanted)
        inside = (values >= limits.min) & (values <= limits.max)
        if not (inside & (values == np.floor(values))).all():
            raise CloudError(
                f"{path}: {name!r} has a value that is no {wanted.name}, which its header "
                f"promises; {COMPLETE_PLY}"
            )
    with np.errstate(over="ignore"):
        return values.astype(wanted)


def _of_text(path: Path) -> PointSource:
    """Return a file of text, which is read once now, since it has no header to ask."""
    table = text.read_table(path)
    axes, (names, first) = table.columns[:3], _names(table)
    if max(axes) >= len(first):
        raise CloudError(
            f"{path}: line {table.lead + 1} has {len(first)} fields, fewer than the names of "
            f"columns promise; {text.AGAIN}"
        )
    columns = [(name, "<f8") for name in names]
    words = {i for i, field in enumerate(first) if field and not text.is_number(field)} - {*axes}
    use = [index for index in range(len(columns)) if index not in words]

    def values(size: int) -> Iterator[Values]:
        for numbers in table.numbers(size, use, {*use} - {*axes}, len(columns)):
            out: FloatArray = np.full((len(columns), len(numbers)), np.nan)
            out[use] = numbers.T
            yield list(out)

    fields = named_fields(columns, {*axes, *words})
    empty, count = {*use} - {*axes}, 0
    for read in values(_ROWS):
        count += len(read[0])
        for index in misfits(read, fields):
            del fields[index]
        empty = {index for index in empty if np.isnan(read[index]).all()}
    warnings = []
    if words:
        lost = ", ".join([names[i] or f"column-{i + 1}" for i in sorted(words)][:5])[:200]
        told = f"{path}: columns of text are left out: {lost}"
        warnings.append(Notice("text-columns-left-out", told, file=str(path), columns=len(words)))
    if table.gaps:
        gaps = "1 field is" if table.gaps == 1 else f"{table.gaps} fields are"
        told = f"{path}: {gaps} empty or not a number, and written as NaN"
        warnings.append(Notice("text-fields-empty", told, file=str(path), fields=table.gaps))
    arranged = arrange(columns, fields, {*axes, *words, *empty})
    return _of_table(path, count, axes, arranged, values, text.AGAIN, warnings=warnings)


def _names(table: text.TextTable) -> Tuple[List[str], List[str]]:
    """Return the columns' names, as far as the file has them, and the fields of its first row."""
    with naming(table.path, text.AGAIN), text.opened(table.path) as stream:
        lead = [line.strip().lstrip("#/ \t") for line in islice(stream, table.lead)]
        first = text.split(stream.readline(text.MAX_LINE), table.delimiter)
    told = text.split(next(filter(None, reversed(lead)), ""), table.delimiter)
    if text.named_columns(told) is None:
        told = []
    return [*told, *[""] * len(first)][: len(first)], first
