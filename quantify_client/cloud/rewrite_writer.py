"""Writing LAS and LAZ point by point, with the header as the last thing (LAS 1.4 R15)."""

from __future__ import annotations

import struct
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any, BinaryIO, Iterator, Optional, Sequence, Tuple

import lazrs
import numpy as np
import numpy.typing as npt

from ..errors import CloudError, OutputError
from ..types import Bounds, FloatArray
from .rewrite_quantum import Quantum
from .rewrite_records import Record, made
from .rewrite_schema import Rows, Schema
from .rewrite_source import Origin

_SIZES = {2: 227, 3: 235, 4: 375}
_SOFTWARE = b"quantify-client"
_TIMES, _SYNTHETIC, _WKT = 0b1, 0b1000, 0b1_0000  # bits of the global encoding
_MANY = 2**32  # points that no version before 1.4 can count


@dataclass(frozen=True)
class Plan:
    """What is known of a file before its first point.

    Attributes
    ----------
    compressed : LAZ instead of LAS.
    records : what is kept of the inputs' records.
    origin : of the LAS file it is made of, if any.
    wkt : the CRS.
    """

    schema: Schema
    quantum: Quantum
    compressed: bool
    count: int
    records: Tuple[Record, ...] = ()
    origin: Optional[Origin] = None
    wkt: Optional[str] = None

    @property
    def minor(self) -> int:
        """LAS 1.x: as the input, but 1.4 for what no earlier version can say."""
        needs = self.schema.extended or self.wkt is not None or self.count >= _MANY
        if needs or any(record.extended for record in self.records):
            return 4
        return max(2, self.origin.minor if self.origin else 2)


class _Noting:
    """A stream that keeps what interrupted it: the compressor only says that something did."""

    def __init__(self, stream: BinaryIO) -> None:
        self._stream = stream
        self.seek, self.tell, self.flush = stream.seek, stream.tell, stream.flush
        self._fault: Optional[BaseException] = None

    def write(self, data: Any) -> int:
        """Write as the stream does."""
        try:
            return self._put(data)
        except BaseException as fault:
            self._fault = fault
            raise

    def _put(self, data: Any) -> int:
        return self._stream.write(data)

    @contextmanager
    def telling(self) -> Iterator[None]:
        """Raise the cause of a compressor's error in its place."""
        try:
            yield
        except lazrs.LazrsError as error:
            if self._fault is not None:
                raise self._fault from None
            if "Failed to call" in str(error):
                # Interrupted on the way to write(), before that could note it.
                raise KeyboardInterrupt from None
            raise


class LasWriter:
    """Writes one file; `path` is what it will be called."""

    def __init__(self, path: Path, stream: BinaryIO, plan: Plan) -> None:
        self._path, self._stream, self._plan = path, _Noting(stream), plan
        self.count = 0
        self._returns = np.zeros(16, dtype=np.int64)
        self._low = np.full(3, np.iinfo(np.int64).max)
        self._high = np.full(3, np.iinfo(np.int64).min)
        self._compressor: Any = None
        records = [record for record in plan.records if not record.extended]
        records += _own_records(plan)
        if plan.compressed:
            size = Schema(plan.schema.point_format).dtype.itemsize
            laszip = lazrs.LazVlr.new_for_compression(
                plan.schema.point_format, plan.schema.dtype.itemsize - size
            )
            data = bytes(laszip.record_data())
            records.append(made("laszip encoded", 22204, "http://laszip.org", data))
        self._long = [r for r in (*plan.records, *records) if r.extended]
        records = [record for record in records if not record.extended]
        with explaining(path):
            stream.write(bytes(_SIZES[plan.minor]))
            for record in records:
                record.write(stream)
            self._records, self._offset = len(records), stream.tell()
            if plan.compressed:
                self._compressor = lazrs.ParLasZipCompressor(self._stream, laszip)

    def write(self, rows: Rows, x: FloatArray, y: FloatArray, z: FloatArray) -> None:
        """Write records at new places.

        Parameters
        ----------
        rows : (N,) of the plan's dtype; their X, Y and Z are changed.
        x, y, z : (N,) float64, in the unit of the file.
        """
        if not len(rows):
            return
        for axis, values in enumerate((x, y, z)):
            integers = self._plan.quantum.integers(self._path, axis, values)
            rows["XYZ"[axis]] = integers
            self._low[axis] = min(self._low[axis], int(integers.min()))
            self._high[axis] = max(self._high[axis], int(integers.max()))
        extended = self._plan.schema.extended
        numbers = rows["returns"] & 0b1111 if extended else rows["old_returns"] & 0b111
        self._returns += np.bincount(numbers, minlength=16)
        self.count += len(rows)
        data: npt.NDArray[np.uint8] = np.ascontiguousarray(rows).view(np.uint8)
        with explaining(self._path), self._stream.telling():
            if self._compressor is None:
                self._stream.write(data.data)
            else:
                self._compressor.compress_many(data)

    def close(self) -> Bounds:
        """Write what comes after the points, then the header.

        Returns
        -------
        The box of the points, as a reader finds them.
        """
        bounds = self._bounds()
        with explaining(self._path), self._stream.telling():
            if self._compressor is not None:
                self._compressor.done()
            self._stream.seek(0, 2)
            first = self._stream.tell() if self._long else 0
            for record in self._long:
                record.write(self._stream)
            self._stream.seek(0)
            self._stream.write(self._header(bounds, first))
            self._stream.flush()
        return bounds

    def _bounds(self) -> Bounds:
        low, high = (
            [self._plan.quantum.value(axis, int(ends[axis])) for axis in range(3)]
            for ends in (self._low, self._high)
        )
        return Bounds(*low, *high)

    def _header(self, bounds: Bounds, first_long: int) -> bytes:
        plan = self._plan
        origin, minor = plan.origin, plan.minor
        today = date.today()
        returns = self._returns[1:].tolist()
        old = minor < 4 or (not plan.schema.extended and self.count < _MANY)
        head = struct.pack("<4sHH", b"LASF", origin.source_id if origin else 0, _encoding(plan))
        head += origin.identity if origin else bytes(16)
        head += struct.pack("<BB32s32s", 1, minor, origin.system if origin else b"", _SOFTWARE)
        head += struct.pack("<HH", today.timetuple().tm_yday, today.year)
        head += struct.pack("<HII", _SIZES[minor], self._offset, self._records)
        kind = plan.schema.point_format | (0x80 if plan.compressed else 0)
        head += struct.pack("<BH", kind, plan.schema.dtype.itemsize)
        head += struct.pack("<6I", *((self.count, *returns[:5]) if old else (0,) * 6))
        head += struct.pack("<6d", *(plan.quantum.step,) * 3, *plan.quantum.offsets)
        head += struct.pack("<2d", bounds.max_x, bounds.min_x)
        head += struct.pack("<2d", bounds.max_y, bounds.min_y)
        head += struct.pack("<2d", bounds.max_z, bounds.min_z)
        if minor >= 3:
            head += struct.pack("<Q", 0)  # no wave forms
        if minor >= 4:
            head += struct.pack("<QI", first_long, len(self._long))
            head += struct.pack("<16Q", self.count, *returns)
        return head


def _own_records(plan: Plan) -> Sequence[Record]:
    """The CRS, and what the extra bytes are."""
    own = []
    if plan.wkt is not None:
        text = plan.wkt.encode() + b"\0"
        own.append(made("LASF_Projection", 2112, "OGC WKT coordinate system", text))
    told = b"".join(extra.descriptor or b"" for extra in plan.schema.extras)
    if told:
        own.append(made("LASF_Spec", 4, "Extra Bytes", told))
    return own


def _encoding(plan: Plan) -> int:
    """Keep how times and returns are meant; formats from 6 on must say WKT, with or without."""
    kept = (plan.origin.encoding if plan.origin else 0) & (_TIMES | _SYNTHETIC)
    return kept | (_WKT if plan.wkt is not None or plan.schema.extended else 0)


@contextmanager
def explaining(path: Path) -> Iterator[None]:
    """Turn what the system says about an output into what the user can do."""
    try:
        yield
    except (OutputError, CloudError):
        raise
    except PermissionError:
        raise OutputError(
            f"{path}: no permission to write it; make the folder writable or give another name"
        ) from None
    except OSError as error:
        raise OutputError(
            f"{path}: cannot be written ({error.strerror or error}); make room or give another name"
        ) from error
    except lazrs.LazrsError as error:
        reason = " ".join(str(error).split())[:200]
        raise OutputError(
            f"{path}: cannot be written ({reason}); make room or give another name"
        ) from error
