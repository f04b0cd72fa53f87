"""Trying again while a server is down, and working in several threads meanwhile."""

from __future__ import annotations

import random
import threading
import time
from typing import Callable, List, Optional, TypeVar

from ...errors import ServerError
from .errors import OutageError, StoppedError

__all__ = ["Patience", "in_parallel"]

LONGEST_PAUSE_S = 60.0
LOOK_S = 0.2  # between two looks at what threads have done
JOIN_S = 2.0

T = TypeVar("T")


class Patience:
    """Survives one outage after another, each up to a limit; shared by all threads of a job.

    Parameters
    ----------
    limit_s : seconds that one outage may last.
    tell : told in one line when an outage begins and when it is over.
    stopped : set when the job is to end.
    first_pause_s : before the second try; each later pause is twice as long.
    """

    def __init__(
        self,
        limit_s: float,
        tell: Callable[[str], None],
        stopped: Optional[threading.Event] = None,
        *,
        first_pause_s: float = 1.0,
    ) -> None:
        self._limit_s, self._tell, self._first_pause_s = limit_s, tell, first_pause_s
        self._stopped = stopped or threading.Event()
        self._lock = threading.Lock()
        self._since: Optional[float] = None
        self._failures = 0

    def through(self, call: Callable[[], T]) -> T:
        """Call until it succeeds; ServerError once an outage has lasted longer than the limit."""
        while True:
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
        """Whether an outage is going on."""
        return self._since is not None

    def endure(self, failure: OutageError) -> None:
        """Pause, longer after each failure; raise ServerError when it has been enough."""
        if self._stopped.is_set():
            raise StoppedError
        now = time.monotonic()
        with self._lock:
            if self._since is None:
                self._since, self._failures = now, 0
            self._failures += 1
            failures, lasted = self._failures, now - self._since
        if lasted >= self._limit_s:
            raise ServerError(f"{failure}; tried for {_duration(lasted)}")
        if failures == 1:
            self._tell(f"{failure}; trying again for {_duration(self._limit_s)}")
        pause = min(self._first_pause_s * 2 ** min(failures - 1, 20), LONGEST_PAUSE_S)
        pause *= random.uniform(0.5, 1.0)  # noqa: S311 - clients must not come back all at once
        self._stopped.wait(min(pause, self._limit_s - lasted))

    def over(self) -> None:
        """Note that the server has answered."""
        with self._lock:
            since, self._since = self._since, None
        if since is not None:
            self._tell(f"the server answers again after {_duration(time.monotonic() - since)}")


def in_parallel(
    count: int,
    work: Callable[[], None],
    failures: List[BaseException],
    stopped: threading.Event,
    tell: Callable[[], None],
) -> None:
    """Run the same work in so many threads; return when all have ended, raise the first failure.

    After a failure or an interrupt the threads are waited for a little; one that is still blocked
    in the connection ends with the process.

    Parameters
    ----------
    failures : where those of the threads go; `work` should end when there is one, ...
    stopped : ... and when this is set, as it is when the caller is interrupted.
    tell : called now and then meanwhile.
    """

    def run() -> None:
        try:
            work()
        except StoppedError:
            return
        except BaseException as error:
            failures.append(error)

    threads = [threading.Thread(target=run, daemon=True) for _ in range(count)]
    for thread in threads:
        thread.start()
    try:
        while not failures:
            alive = [thread for thread in threads if thread.is_alive()]
            if not alive:
                break
            alive[0].join(LOOK_S)
            tell()
    except BaseException:
        stopped.set()
        raise
    finally:
        end = time.monotonic() + JOIN_S
        for thread in threads:
            thread.join(max(0.0, end - time.monotonic()))
    tell()
    if failures:
        raise failures[0]


def _duration(seconds: float) -> str:
    """Return a time in words, in the unit that fits.

    Examples
    --------
    >>> _duration(7200), _duration(90), _duration(2.4)
    ('2.0 h', '2 min', '2 s')
    """
    if seconds >= 5400:
        return f"{seconds / 3600:.1f} h"
    return f"{seconds / 60:.0f} min" if seconds >= 90 else f"{seconds:.0f} s"
