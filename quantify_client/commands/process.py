"""The process itself: signals that end it, and streams that are closed, full or gone."""

from __future__ import annotations

import math
import os
import signal
import sys
import threading
import time
from contextlib import contextmanager, suppress
from typing import Any, Callable, Dict, Iterator, Optional, TextIO, Tuple, cast

__all__ = ["Ending", "lost_output", "ready_streams"]

_STREAMS = 3  # input, output and errors
_AGAIN_S = 5.0
_REMINDER_S = 0.1


class Ending:
    """Has SIGTERM and SIGHUP end the program as Ctrl-C does, within a ``with`` block.

    Python looks at a signal between two steps of its main thread. One that comes just before a
    long wait in the system, or to another thread, does not end that wait; and an interruption
    raised where Python lets no exception out (a destructor, a callback) is lost. In both cases
    the main thread is reminded until it is interrupted.

    Attributes
    ----------
    number : of the signal that came; None before.
    """

    def __init__(self) -> None:
        self.number: Optional[int] = None
        self._interrupted = -math.inf  # when
        self._before: Dict[int, Any] = {}
        self._over = threading.Event()

    def __enter__(self) -> Ending:
        for name in ("SIGTERM", "SIGHUP"):
            number = getattr(signal, name, None)  # Windows has no SIGHUP
            # What is ignored, as under nohup, stays ignored.
            if number is not None and signal.getsignal(number) == signal.SIG_DFL:
                self._before[number] = signal.signal(number, self._end)
        self._hook, sys.unraisablehook = sys.unraisablehook, self._unraisable
        self._reminder = self._start_reminder() if hasattr(signal, "pthread_kill") else None
        return self

    def __exit__(self, *_: object) -> None:
        self._interrupted = math.inf  # nothing is left that could be interrupted
        if self._reminder is not None:
            self._stop_reminder(*self._reminder)
        sys.unraisablehook = self._hook
        for number, handler in self._before.items():
            # After one signal the process is ending with that status, and no other changes it.
            signal.signal(number, handler if self.number is None else signal.SIG_IGN)

    def _end(self, number: int, _frame: object) -> None:
        """Interrupt once; those who clean up are not interrupted again at once."""
        now = time.monotonic()
        if now - self._interrupted > _AGAIN_S:
            self.number, self._interrupted = number, now
            raise KeyboardInterrupt

    def _unraisable(self, fault: Any) -> None:
        """Take an interruption that nobody got for one that has still to come."""
        if self.number is None or fault.exc_type is not KeyboardInterrupt:
            self._hook(fault)
            return
        self._interrupted = -math.inf
        if self._reminder is not None:
            os.write(self._reminder[1], bytes([self.number]))

    def _start_reminder(self) -> Tuple[threading.Thread, int, int]:
        heard, told = os.pipe()
        os.set_blocking(told, False)
        thread = threading.Thread(target=self._remind, args=(heard,), daemon=True)
        thread.start()
        # What Python's own handler writes there is the number of each signal, whoever got it.
        return thread, told, signal.set_wakeup_fd(told, warn_on_full_buffer=False)

    def _stop_reminder(self, thread: threading.Thread, told: int, before: int) -> None:
        signal.set_wakeup_fd(before)
        self._over.set()
        os.close(told)
        thread.join()

    def _remind(self, heard: int) -> None:
        """Send a signal again, to the main thread, until that is interrupted."""
        main = threading.main_thread().ident
        with open(heard, "rb", buffering=0) as numbers:
            while number := numbers.read(1):
                if self._over.wait(_REMINDER_S) or main is None:
                    break
                if number[0] in self._before and self._interrupted == -math.inf:
                    signal.pthread_kill(main, number[0])  # which is one more number to read


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
