"""Points with everything that is known of them: what is read to be written again.

:func:`read_las` does it for LAS and LAZ (COPC and the tiles of EPT are LAZ files, too). Nothing
is left out and nothing is skipped in decompressing.
"""

from __future__ import annotations

import struct
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Iterator, Optional, Protocol, Sequence, Tuple

import numpy as np
from laspy import DecompressionSelection

from ..errors import CloudError
from ..types import Bounds, FloatArray
from .base import finite_rows, naming, require_on_map
from .las import MAX_BUFFER, record_reader
from .las_header import AGAIN, LasLayout, read_layout
from .rewrite_records import Record, read_records
from .rewrite_schema import Rows, Schema, schema_of


@dataclass(frozen=True)
class Block:
    """Some points: (N,) float64 coordinates as the file has them, and (N,) records.

    ``lost`` counts the rows left out among them, which have no place: NaN or infinite coordinates.
    """

    x: FloatArray
    y: FloatArray
    z: FloatArray
    rows: Rows
    lost: int = 0


def placed_block(
    path: Path, x: FloatArray, y: FloatArray, z: FloatArray, rows: Rows, first: int
) -> Block:
    """Return the rows that have a place; `first` is how many of the file come before these.

    Raises
    ------
    CloudError
        A coordinate beyond any map.
    """
    keep = finite_rows(x, y, z)
    if keep is None:
        require_on_map(path, x, y, z, first)
        return Block(x, y, z, rows)
    require_on_map(path, x[keep], y[keep], z[keep], first)
    return Block(x[keep], y[keep], z[keep], rows[keep], int((~keep).sum()))


@dataclass(frozen=True)
class Origin:
    """What the header of a LAS file says beside its points.

    ``encoding`` is the global encoding, ``identity`` the 16 bytes of the project's GUID.
    """

    minor: int
    source_id: int
    encoding: int
    identity: bytes
    system: bytes
    records: Tuple[Record, ...]


class PointSource(Protocol):
    """A file (or a set) of points that is read once, from front to back."""

    @property
    def path(self) -> Path:
        """The file."""
        ...

    @property
    def count(self) -> int:
        """Points to come."""
        ...

    @property
    def schema(self) -> Schema:
        """Layout of the records to come."""
        ...

    @property
    def steps(self) -> Optional[Tuple[float, ...]]:
        """The smallest difference of x, y, z in the file; None when it has none of its own."""
        ...

    @property
    def bounds(self) -> Optional[Bounds]:
        """The box of the points, as far as the file says."""
        ...

    @property
    def origin(self) -> Optional[Origin]:
        """The rest of the header, for LAS."""
        ...

    @property
    def warnings(self) -> Sequence[str]:
        """What of the file cannot be delivered."""
        ...

    def blocks(self, size: int) -> Iterator[Block]:
        """Deliver all points in file order, at most `size` at a time."""
        ...


@dataclass(frozen=True)
class LasSource:
    """One LAS or LAZ file."""

    path: Path
    count: int
    schema: Schema
    steps: Tuple[float, ...]
    bounds: Optional[Bounds]
    origin: Origin
    warnings: Tuple[str, ...]

    def blocks(self, size: int) -> Iterator[Block]:
        """Deliver all points; CloudError when there are fewer than the header promises."""
        layout = read_layout(self.path)
        if layout.count != self.count:
            raise CloudError(f"{self.path}: changed while it was read; {AGAIN}")
        scales, offsets = layout.header.scales, layout.header.offsets
        for rows in _records(layout, self.schema, size):
            x, y, z = (
                rows[name] * float(scales[axis]) + float(offsets[axis])
                for axis, name in enumerate("XYZ")
            )
            yield Block(x, y, z, rows)


def read_las(path: Path) -> LasSource:
    """Read all of a LAS or LAZ file but its points.

    Raises
    ------
    CloudError
        As :func:`~quantify_client.cloud.las_header.read_layout`.
    """
    layout = read_layout(path)
    records = read_records(path)
    header = layout.header
    described = b"".join(
        record.data for record in records if record.is_extra_bytes and record.data is not None
    )
    schema = schema_of(int(header.point_format.id), layout.record_length, described)
    with naming(path, AGAIN), path.open("rb") as stream:
        head = stream.read(227)
    source_id, encoding, identity = struct.unpack_from("<HH16s", head, 4)
    rest = [
        f"{path}: {len(data)} bytes of unknown meaning {where} are left out"
        for data, where in _unknown(head, header)
        if data.strip(b"\0")
    ]
    minor = head[25]
    origin = Origin(minor, source_id, encoding, identity, head[26:58], tuple(records))
    steps = tuple(abs(float(scale)) for scale in header.scales)
    return LasSource(path, layout.count, schema, steps, layout.bounds, origin, tuple(rest))


def _unknown(head: bytes, header: Any) -> Sequence[Tuple[bytes, str]]:
    before = bytes(header.extra_vlr_bytes)
    if head[25] == 0 and before[-2:] == b"\xdd\xcc":
        before = before[:-2]  # LAS 1.0 marks the start of the points with these two
    return (bytes(header.extra_header_bytes), "in its header"), (before, "before its points")


def _records(layout: LasLayout, schema: Schema, size: int) -> Iterator[Rows]:
    """Read complete records, each time into a buffer of their own."""
    if not layout.count:
        return
    dtype = schema.dtype
    step = max(1, min(size, MAX_BUFFER // layout.record_length, layout.count))
    with ExitStack() as stack:
        with naming(layout.path, AGAIN):
            fill = record_reader(layout, stack, DecompressionSelection.all())
        for done in range(0, layout.count, step):
            rows: Rows = np.empty(min(step, layout.count - done), dtype)
            advice = f"its header promises {layout.count} points, {done} could be read; {AGAIN}"
            with naming(layout.path, advice):
                fill(rows.view(np.uint8))
            yield rows
