"""How a request to a server can fail."""

from __future__ import annotations

from typing import Optional

from ...errors import ServerError

__all__ = [
    "ArchiveError",
    "OutageError",
    "RefusedError",
    "StatusError",
    "StoppedError",
    "TaskLostError",
]


class StoppedError(Exception):
    """A request was given up on our side; not an OSError, which would pass for a broken line."""


class OutageError(ServerError):
    """The connection or the server is down for now; the same request may work later.

    Attributes
    ----------
    unsent : whether surely nothing of the request reached the server.
    """

    def __init__(self, message: str, *, unsent: bool = False) -> None:
        super().__init__(message)
        self.unsent = unsent


class ArchiveError(OutageError):
    """The archive that was downloaded is no sound zip; downloading it again may help."""


class RefusedError(ServerError):
    """The server understood the request and said no.

    Attributes
    ----------
    reason : what it said, without secrets.
    """

    def __init__(self, message: str, reason: str) -> None:
        super().__init__(message)
        self.reason = reason


class TaskLostError(RefusedError):
    """The server knows no such task, or no such upload, any more."""


class StatusError(ServerError):
    """The server answered with an HTTP status that trying again will not change.

    Attributes
    ----------
    status : the HTTP status.
    reason : what the JSON of the answer says, without secrets; None where it sent no JSON.
    """

    def __init__(self, message: str, status: int, reason: Optional[str]) -> None:
        super().__init__(message)
        self.status, self.reason = status, reason
