"""Lines of a text file, so many and so long that they always fit into memory."""

from __future__ import annotations

from pathlib import Path
from typing import List, TextIO

from ..errors import CloudError

__all__ = ["MAX_LINE", "Lines"]

MAX_LINE = 1 << 16  # characters; a row of a thousand columns has a quarter of that
_BLOCK = 4 << 20  # characters read, and so delivered, at a time


class Lines:
    """Reads on from where a stream is; lines come without their ends."""

    def __init__(self, path: Path, stream: TextIO, advice: str) -> None:
        self._path, self._stream, self._advice = path, stream, advice
        self._lines: List[str] = []
        self._at = 0
        self._rest = ""

    def take(self, most: int) -> List[str]:
        """Return the next lines, at least one and at most `most`; none at the end of the file.

        Raises
        ------
        CloudError
            A line is too long to be a row of numbers.
        """
        if self.ended:
            return []
        lines = self._lines[self._at : self._at + most]
        self._at += len(lines)
        return lines

    @property
    def ended(self) -> bool:
        """Whether there are no more; raises as `take` does."""
        while self._at == len(self._lines):  # a block without the end of a line brings none
            if not self._fill():
                return True
        return False

    def skip(self, count: int) -> bool:
        """Leave out lines; False when the file has fewer."""
        while count:
            passed = len(self.take(count))
            if not passed:
                return False
            count -= passed
        return True

    def _fill(self) -> bool:
        text = self._stream.read(_BLOCK)
        lines = (self._rest + text).split("\n")
        self._rest = lines.pop()
        if not text and self._rest:
            lines, self._rest = [self._rest], ""  # the last line has no end
        if max(len(self._rest), max(map(len, lines), default=0)) > MAX_LINE:
            raise CloudError(
                f"{self._path}: has a line of more than {MAX_LINE:,} characters, which no row of "
                f"numbers has; {self._advice}"
            )
        self._lines, self._at = lines, 0
        return bool(text or lines)
