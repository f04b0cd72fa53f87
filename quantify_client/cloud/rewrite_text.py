"""Text with all its columns."""

from __future__ import annotations

from itertools import islice
from pathlib import Path
from typing import Any, Iterator, List, Optional, Set, Tuple

import numpy as np

from ..errors import CloudError
from ..types import Bounds, FloatArray
from .base import naming
from .lines import MAX_LINE, Lines
from .rewrite_schema import Schema
from .rewrite_source import Block, Origin, placed_block
from .rewrite_table import Column, Values, arrange, candidates, misfits
from .text import (
    _AGAIN,
    _is_comment,
    _is_number,
    _named_columns,
    _opened,
    _sniff,
    _split,
    as_number,
    unmarked,
)

_LINES = 200_000  # rows held as text at a time


class TextSource:
    """One CSV, XYZ or TXT file; read once when it is opened, since it has no header to ask."""

    steps: Optional[Tuple[float, ...]] = None
    bounds: Optional[Bounds] = None
    origin: Optional[Origin] = None

    def __init__(self, path: Path) -> None:
        self.path = path
        with naming(path, _AGAIN), _opened(path) as stream:
            found = _sniff(path, stream)
        self._delimiter, self._lead = found.delimiter, found.lead
        self._axes = found.columns[:3]
        names, first = self._names()
        if max(self._axes) >= len(first):
            raise CloudError(
                f"{path}: line {self._lead + 1} has {len(first)} fields, fewer than the names of "
                f"columns promise; {_AGAIN}"
            )
        self._columns = [Column(name, "<f8") for name in names]
        self._words = {
            index for index, field in enumerate(first) if field and not _is_number(field)
        } - set(self._axes)
        self._gaps = 0
        self._survey()
        self.warnings = self._remarks(names)

    @property
    def schema(self) -> Schema:
        """Layout of the records to come."""
        return self._arranged.schema

    def blocks(self, size: int) -> Iterator[Block]:
        """Deliver all points in file order."""
        done = 0
        for values in self._values(size):
            x, y, z = (np.ascontiguousarray(values[axis]) for axis in self._axes)
            yield placed_block(self.path, x, y, z, self._arranged.rows(values, len(x)), done)
            done += len(x)
        if done != self.count:
            raise CloudError(f"{self.path}: changed while it was read; {_AGAIN}")

    def _names(self) -> Tuple[List[str], List[str]]:
        """The columns' names, as far as the file has them, and the fields of its first row."""
        with naming(self.path, _AGAIN), _opened(self.path) as stream:
            lead = [line.strip().lstrip("#/ \t") for line in islice(stream, self._lead)]
            first = _split(stream.readline(MAX_LINE), self._delimiter)
        lead = [line for line in lead if line]
        told = _split(lead[-1], self._delimiter) if lead else []
        if _named_columns(told) is None:
            told = []
        count = len(first)
        return [told[i] if i < len(told) else "" for i in range(count)], first

    def _survey(self) -> None:
        """Count the points, and find out which columns fit the fields they are named after."""
        slots = candidates(self._columns, {*self._axes, *self._words})
        empty = set(range(len(self._columns))) - set(self._axes) - self._words
        self.count, self._gaps = 0, 0
        for values in self._values(_LINES):
            self.count += len(values[0])
            for index in misfits(values, slots):
                del slots[index]
            empty = {index for index in empty if np.isnan(values[index]).all()}
        self._arranged = arrange(self._columns, slots, {*self._axes, *self._words, *empty})

    def _remarks(self, names: List[str]) -> Tuple[str, ...]:
        lost = [names[index] or f"column-{index + 1}" for index in sorted(self._words)]
        found: Tuple[str, ...] = ()
        if lost:
            found += (f"{self.path}: columns of words are left out: {', '.join(lost[:5])[:200]}",)
        if self._gaps:
            fields = "1 field is" if self._gaps == 1 else f"{self._gaps} fields are"
            found += (f"{self.path}: {fields} empty or no number, and written as NaN",)
        return found

    def _values(self, size: int) -> Iterator[Values]:
        number = self._lead
        with naming(self.path, _AGAIN):
            stream = _opened(self.path)
        with stream:
            source = Lines(self.path, stream, _AGAIN)
            with naming(self.path, _AGAIN):
                source.skip(number)
            while True:
                with naming(self.path, _AGAIN):
                    lines = unmarked(source.take(min(size, _LINES)))
                if not lines:
                    return
                rows = [line for line in lines if not _is_comment(line)]
                if rows:
                    yield list(self._table(lines, rows, number).T)
                number += len(lines)

    def _table(self, lines: List[str], rows: List[str], number: int) -> FloatArray:
        """Rows of numbers, NaN for words; `number` is how many lines come before these."""
        use = [index for index in range(len(self._columns)) if index not in self._words]
        columns: Any = use if self._words else None  # None: that rows differ in length is an error
        try:
            read: FloatArray = np.loadtxt(
                rows,
                dtype=np.float64,
                delimiter=self._delimiter,
                comments="#",
                usecols=columns,
                ndmin=2,
            )
        except (IndexError, ValueError):
            read = np.empty((0, 0))
        if read.shape == (len(rows), len(use)):
            table: FloatArray = np.full((len(rows), len(self._columns)), np.nan)
            table[:, use] = read
            return table
        out = [
            self._row(line, number + index + 1)
            for index, line in enumerate(lines)
            if not _is_comment(line)
        ]
        return np.array(out, dtype=np.float64)

    def _row(self, line: str, number: int) -> List[float]:
        """Read one row field by field; what is neither a coordinate nor a number becomes NaN."""
        fields = _split(line, self._delimiter)
        out = [np.nan] * len(self._columns)
        bad: Set[int] = set()
        for index in range(len(out)):
            try:
                axis = index in self._axes
                out[index] = as_number(fields[index]) if axis else float(fields[index])
            except (IndexError, ValueError):
                bad.add(index)
        if bad & set(self._axes) or len(fields) > len(out):
            raise CloudError(
                f"{self.path}: line {number} is {line.strip()[:60]!r}, with {len(fields)} fields; "
                f"the first row has {len(out)}; {_AGAIN}"
            )
        self._gaps += len(bad - self._words)
        return out
