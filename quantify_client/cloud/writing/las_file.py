"""Writing a LAS or LAZ file with laspy, and what laspy does not do.

Records of other programs are copied byte for byte (laspy shortens names of full length), long ones
in blocks. An interrupted or failed write is reported as such, where the compressor only says that
it failed. Point counts are also written where readers of LAS 1.3 and before look for them.
"""

from __future__ import annotations

import struct
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO, Dict, Iterator, List, Optional, Sequence, Set, Tuple

import lazrs
import numpy as np
from laspy import LasHeader, LasWriter, LazBackend, PackedPointRecord
from laspy.header import GlobalEncoding, Version
from laspy.vlrs.vlrlist import VLRList

from ...errors import CloudError, OutputError
from ...types import Bounds, Notice
from ..base import naming
from ..las.header import AGAIN, EXTENDED_HEAD, RECORD_HEAD, Record
from .coordinates import Quantization
from .record_layout import EXTENDED, Rows, Schema
from .sources import PointSource

_BLOCK = 1 << 20
_MANY = 2**32  # points that no version before 1.4 can count
_OLD_COUNTS = 107  # where a header has them
_TIMES, _SYNTHETIC, _WKT = 0b1, 0b1000, 0b1_0000  # bits of the global encoding
_SPEC, _EXTRA_BYTES = "LASF_Spec", 4
_WAVES = (*range(100, 356), 65535)
_REPLACED = ("LASF_Projection", "copc", "laszip encoded")
_PLACES = ("LAStools",)  # spatial index, neighbours of a tile


class RecordList(VLRList):  # type: ignore[misc]
    """Records that are written as they were; laspy's own ones as it does."""

    def write_to(
        self, stream: Any, as_extended: bool = False, encoding_errors: str = "strict"
    ) -> None:
        """Write all records, with heads as they have before the points, or after them."""
        head = EXTENDED_HEAD if as_extended else RECORD_HEAD
        for record in self:
            if not isinstance(record, Record):
                VLRList([record]).write_to(stream)
                continue
            user = record.user.encode("latin-1")
            stream.write(head.pack(0, user, record.number, record.length, record.description))
            for data in _content(record):
                stream.write(data)


def _content(record: Record) -> Iterator[bytes]:
    if record.data is not None:
        yield record.data
        return
    with naming(record.path, AGAIN):
        source = record.path.open("rb")
    with source:
        source.seek(record.offset)
        for start in range(0, record.length, _BLOCK):
            yield source.read(min(_BLOCK, record.length - start))


def choose_records(
    files: Sequence[Sequence[Record]],
) -> Tuple[Tuple[Record, ...], Tuple[Notice, ...]]:
    """Join the records of all files; where they differ, the first file's counts.

    A record that another program put there is kept. Those about the CRS, the compression and the
    layout are written anew, and those that say where points lie would be wrong.
    """
    kept: List[Record] = []
    known: Dict[Tuple[str, int], List[Record]] = {}
    lost: Dict[str, Set[str]] = {}
    for records in files:
        fresh = []
        for record in records:
            reason = _reason(record)
            if reason is None and record.key not in known:
                fresh.append(record)
                continue
            if reason is None and not any(_same(record, one) for one in known[record.key]):
                reason = "differ between the files, and are taken from the first"
            if reason:
                lost.setdefault(reason, set()).add(f"{record.user} {record.number}")
        for record in fresh:
            known.setdefault(record.key, []).append(record)
        kept += fresh
    warnings = []
    for reason, names in lost.items():
        more = f" and {len(names) - 5} more" if len(names) > 5 else ""
        text = f"records of the cloud that {reason}: {', '.join(sorted(names)[:5])}{more}"
        warnings.append(Notice("records-left-out", text, records=len(names)))
    return tuple(kept), tuple(warnings)


def _reason(record: Record) -> Optional[str]:
    """Return why a record is left out: None if it is not, no words if it is written anew."""
    own = record.key in ((_SPEC, _EXTRA_BYTES), ("liblas", 2112))
    if own or record.user in _REPLACED:
        return ""
    if record.user in _PLACES:
        return "hold the old positions of points, and are left out"
    if record.user == _SPEC and record.number in _WAVES:
        return "hold waveforms, and are left out"
    return None


def _same(one: Record, other: Record) -> bool:
    return one.data is not None and one.data == other.data


def make_header(
    sources: Sequence[PointSource],
    schema: Schema,
    quantization: Quantization,
    records: Sequence[Record],
    wkt: Optional[str],
) -> Tuple[Any, RecordList]:
    """Return laspy's header, and the records that come after the points.

    It is what the first LAS file has; LAS 1.4 where points, CRS or records need it.
    """
    texts = b"" if wkt is None else wkt.encode() + b"\0"
    described = b"".join(extra.descriptor or b"" for extra in schema.extras)
    made = [
        Record(user, number, text, len(data) > 0xFFFF, Path(), 0, len(data), data)
        for user, number, text, data in (
            ("LASF_Projection", 2112, b"OGC WKT coordinate system", texts),
            (_SPEC, _EXTRA_BYTES, b"Extra Bytes", described),
        )
        if data
    ]
    everything = [*records, *made]
    after = RecordList(record for record in everything if record.extended)
    origin = next((source.header for source in sources if source.header is not None), None)
    many = sum(source.count for source in sources) >= _MANY
    minor = max(2, origin.version.minor if origin else 2)
    if schema.extended or wkt is not None or many or after:
        minor = 4
    header = LasHeader(version=Version(1, minor), point_format=schema.laspy_format)
    header.scales = np.full(3, quantization.scale)
    header.offsets = np.array(quantization.offsets)
    header.generating_software, header.system_identifier = "quantify-client", ""
    encoding = _WKT if wkt is not None or schema.extended else 0  # which formats from 6 on must say
    if origin is not None:
        encoding |= origin.global_encoding.value & (_TIMES | _SYNTHETIC)
        header.system_identifier = origin.system_identifier
        header.file_source_id, header.uuid = origin.file_source_id, origin.uuid
    header.global_encoding = GlobalEncoding(encoding)
    header._vlrs = RecordList(record for record in everything if not record.extended)
    return header, after


class LasFile:
    """One file that is being written; `path` is what it will be called: .laz is compressed.

    Parameters
    ----------
    header, after : what :func:`make_header` made.
    """

    def __init__(self, path: Path, stream: BinaryIO, header: Any, after: RecordList) -> None:
        self._path, self._stream, self._after = path, _Noting(stream), after
        backend = LazBackend.LazrsParallel if path.suffix.lower() == ".laz" else None
        with explaining(path):
            self._writer = LasWriter(self._stream, header, laz_backend=backend, closefd=False)

    @property
    def count(self) -> int:
        """Points written."""
        return int(self._writer.header.point_count)

    def write(self, rows: Rows) -> None:
        """Write records, (N,) of the header's layout."""
        with explaining(self._path), self._stream.telling():
            self._writer.write_points(PackedPointRecord(rows, self._writer.header.point_format))

    def close(self) -> Bounds:
        """Write what comes after the points, then the header.

        Returns
        -------
        The box of the points, as a reader finds them.
        """
        header, count = self._writer.header, self.count
        with explaining(self._path), self._stream.telling():
            if self._after:  # for which versions before 1.4 have no place
                self._writer.write_evlrs(self._after)
            self._writer.close()
            if header.version.minor == 4 and header.point_format.id < EXTENDED and count < _MANY:
                returns = header.number_of_points_by_return[:5].tolist()
                self._stream.seek(_OLD_COUNTS)
                self._stream.write(struct.pack("<6I", count, *returns))
            self._stream.flush()
        return Bounds(*header.mins.tolist(), *header.maxs.tolist())


class _Noting:
    """A stream that remembers the error of a write, which the compressor does not pass on."""

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
        """Raise the remembered error in place of the compressor's."""
        try:
            yield
        except lazrs.LazrsError as error:
            if self._fault is not None:
                raise self._fault from None
            if "Failed to call" in str(error):
                # Interrupted on the way to write(), before that could note it.
                raise KeyboardInterrupt from None
            raise


@contextmanager
def explaining(path: Path) -> Iterator[None]:
    """Turn an error of the system into an OutputError that says what to do."""
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
