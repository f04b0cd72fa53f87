"""The process itself: signals that end it, and streams that are closed, full or gone."""

from __future__ import annotations

import os
import signal
import sys
import time
from contextlib import contextmanager, suppress
from typing import Any, Callable, Dict, Iterator, Optional, TextIO, cast

__all__ = ["Ending", "lost_output", "ready_streams"]

_STREAMS = 3  # input, output and errors
_AGAIN_S = 5.0


class Ending:
    """Has SIGTERM and SIGHUP end the program as Ctrl-C does, within a ``with`` block.

    Attributes
    ----------
    number : of the signal that came; None before.
    """

    def __init__(self) -> None:
        self.number: Optional[int] = None
        self._came = 0.0
        self._before: Dict[int, Any] = {}

    def __enter__(self) -> Ending:
        for name in ("SIGTERM", "SIGHUP"):
            number = getattr(signal, name, None)  # Windows has no SIGHUP
            # What is ignored, as under nohup, stays ignored.
            if number is not None and signal.getsignal(number) == signal.SIG_DFL:
                self._before[number] = signal.signal(number, self._end)
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _end(self, number: int, _frame: object) -> None:
        """Interrupt once; those who clean up are not interrupted again at once."""
        now = time.monotonic()
        if self.number is None or now - self._came > _AGAIN_S:
            self.number, self._came = number, now
            raise KeyboardInterrupt


@contextmanager
def ready_streams() -> Iterator[None]:
    """Make all three streams usable, so that none of them interrupts the work.

    A closed stream becomes one to nowhere, and no file of ours gets its number. What cannot be said
    is not said; `lost_output` tells at the end.
    """
    while True:
        handle = os.open(os.devnull, os.O_RDWR)
        if handle >= _STREAMS:
            os.close(handle)
            break
    out = sys.stdout or open(1, "w", encoding="utf-8", closefd=False)  # noqa: SIM115
    err = sys.stderr or open(2, "w", encoding="utf-8", closefd=False)  # noqa: SIM115
    with suppress(AttributeError):
        cast(Any, out).reconfigure(errors="replace")
    sys.stdout, sys.stderr = cast(TextIO, _Forgiving(out)), cast(TextIO, _Forgiving(err))
    try:
        yield
    finally:
        sys.stdout, sys.stderr = out, err


class _Forgiving:
    """A stream whose disk may be full, and whose terminal or reader may go."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self.fault: Optional[OSError] = None

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        """Write as the stream does."""
        return self._surely(lambda: self._stream.write(text)) or 0

    def flush(self) -> None:
        """Flush as the stream does."""
        self._surely(self._stream.flush)

    def _surely(self, act: Callable[[], Any]) -> Any:
        try:
            return act()
        except OSError as error:
            self.fault = self.fault or error
            _silence(self._stream)


def lost_output() -> Optional[OSError]:
    """Write what stdout still holds; return why some of it could not be written."""
    stream = sys.stdout
    try:
        if stream is not None:
            stream.flush()
    except OSError as error:
        _silence(stream)
        return error
    fault: Optional[OSError] = getattr(stream, "fault", None)
    return fault


def _silence(stream: TextIO) -> None:
    """Let whatever else is written go nowhere, what is still buffered included."""
    with suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)
