"""What is downloaded, into a file: never more than was expected, nor than the disk can spare."""

from __future__ import annotations

import shutil
from contextlib import suppress
from pathlib import Path
from typing import Callable, Iterable, Optional

import requests

from ...errors import OutputError, QuantifyError

__all__ = ["SPARE_BYTES", "Saving"]

SPARE_BYTES = 64 << 20  # to leave free on the disk, at least ...
SPARE_SHARE = 0.05  # ... and of what is free when a download begins: others write there, too
LOOK_BYTES = 4 << 20  # how much is written between two looks at the disk


class Saving:
    """A file that a download goes into; it is removed when that fails for a reason of ours.

    Parameters
    ----------
    part : where it goes.
    total : its length, where the server tells it.
    most : how long it may be.
    excess : told when it is longer; raises.
    room : what to do when the disk is full; ends a message.
    """

    def __init__(
        self,
        part: Path,
        total: Optional[int],
        most: Optional[int],
        excess: Callable[[], None],
        room: str,
    ) -> None:
        self._part, self._total, self._most = part, total, most
        self._excess, self._room = excess, room
        self._remove()  # what an earlier try left of it is of no use and takes room
        free = shutil.disk_usage(part.parent).free
        self._spare = max(SPARE_BYTES, int(SPARE_SHARE * free))
        if most is not None and (total or 0) > most:
            excess()
        if total is not None and total + self._spare > free:
            raise OutputError(
                f"{part}: needs {(total + self._spare) / 1e6:.0f} MB with some to spare, "
                f"{free / 1e6:.0f} MB are free; {room}"
            )

    def save(self, blocks: Iterable[bytes], progress: Callable[[int, Optional[int]], None]) -> int:
        """Write blocks and return how many bytes they were."""
        try:
            return self._save(blocks, progress)
        except QuantifyError:
            self._remove()
            raise
        except requests.RequestException:
            raise  # an OSError too, but not the disk's
        except OSError as error:
            self._remove()
            raise OutputError(
                f"{self._part}: cannot be written ({error.strerror or error}); {self._room}"
            ) from error

    def _save(self, blocks: Iterable[bytes], progress: Callable[[int, Optional[int]], None]) -> int:
        done = looked = 0
        with self._part.open("wb") as out:
            for block in blocks:
                if self._most is not None and done + len(block) > self._most:
                    self._excess()
                out.write(block)
                done += len(block)
                if done - looked >= LOOK_BYTES:
                    looked = done
                    self._require_spare(done)
                progress(done, self._total)
        return done

    def _remove(self) -> None:
        with suppress(OSError):
            self._part.unlink()

    def _require_spare(self, done: int) -> None:
        free = shutil.disk_usage(self._part.parent).free
        if free < self._spare:
            raise OutputError(
                f"{self._part}: {done / 1e6:.0f} MB have come, of an unknown number, and only "
                f"{free / 1e6:.0f} MB are left on the disk; what came is removed: {self._room}"
            )
