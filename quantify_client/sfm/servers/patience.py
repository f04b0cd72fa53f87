"""How long to go on trying when a server or the line to it is down."""

from __future__ import annotations

import random
import threading
import time
from typing import Callable, Optional, TypeVar

from ...errors import ServerError
from .faults import OutageError
from .multipart import StoppedError

__all__ = ["Patience"]

FIRST_PAUSE_S = 1.0
LONGEST_PAUSE_S = 60.0

T = TypeVar("T")


class Patience:
    """One outage after another, each survived up to a limit; shared by all threads of a job.

    Parameters
    ----------
    limit_s : seconds that one outage may last.
    tell : told in one line when an outage begins and when it is over.
    stopped : set when the job is to end.
    """

    def __init__(
        self,
        limit_s: float,
        tell: Callable[[str], None],
        stopped: Optional[threading.Event] = None,
        *,
        first_pause_s: float = FIRST_PAUSE_S,
    ) -> None:
        self._limit_s, self._tell = limit_s, tell
        self._stopped = stopped or threading.Event()
        self._first_pause_s = first_pause_s
        self._lock = threading.Lock()
        self._since: Optional[float] = None
        self._told = False
        self._failures = 0

    def through(self, call: Callable[[], T]) -> T:
        """Call until it succeeds; ServerError once an outage has lasted longer than the limit."""
        while True:
            failure: OutageError
            try:
                result = call()
            except OutageError as error:
                failure = error
            else:
                self.over()
                return result
            self.endure(failure)

    @property
    def is_tried(self) -> bool:
        """Whether the last thing heard of the server is an outage."""
        return self._since is not None

    def endure(self, failure: OutageError) -> None:
        """Pause, longer after each failure; raise ServerError when it has been enough."""
        if self._stopped.is_set():
            raise StoppedError
        now = time.monotonic()
        with self._lock:
            if self._since is None:
                self._since, self._told, self._failures = now, False, 0
            self._failures += 1
            doublings = min(self._failures - 1, 20)
            lasted = now - self._since
            tell = not self._told
            self._told = True
        if lasted >= self._limit_s:
            raise ServerError(f"{failure}; tried for {_duration(lasted)}")
        if tell:
            self._tell(f"{failure}; trying again for {_duration(self._limit_s)}")
        pause = min(self._first_pause_s * 2**doublings, LONGEST_PAUSE_S)
        pause *= random.uniform(0.5, 1.0)  # noqa: S311 - clients must not come back all at once
        self._stopped.wait(min(pause, self._limit_s - lasted))

    def over(self) -> None:
        """Note that the server has answered."""
        with self._lock:
            since, self._since = self._since, None
        if since is not None:
            self._tell(f"the server answers again after {_duration(time.monotonic() - since)}")


def _duration(seconds: float) -> str:
    """Say a time in the unit that fits.

    Examples
    --------
    >>> _duration(7200), _duration(90), _duration(2.4)
    ('2.0 h', '2 min', '2 s')
    """
    if seconds >= 5400:
        return f"{seconds / 3600:.1f} h"
    return f"{seconds / 60:.0f} min" if seconds >= 90 else f"{seconds:.0f} s"
