"""How a request to a server can fail."""

from __future__ import annotations

from typing import Optional

from ...errors import ServerError

__all__ = ["OutageError", "RefusedError", "StatusError"]


class OutageError(ServerError):
    """The line or the server is down for now; the same request may work later.

    Attributes
    ----------
    unsent : whether surely nothing of the request reached the server.
    """

    def __init__(self, message: str, *, unsent: bool = False) -> None:
        super().__init__(message)
        self.unsent = unsent


class RefusedError(ServerError):
    """The server understood and said no.

    Attributes
    ----------
    reason : what it said, without secrets.
    """

    def __init__(self, message: str, reason: str) -> None:
        super().__init__(message)
        self.reason = reason


class StatusError(ServerError):
    """The server answered with a status that no later try will change.

    Attributes
    ----------
    status : of HTTP.
    reason : what its JSON says beside it, without secrets; None where it sent no JSON.
    """

    def __init__(self, message: str, status: int, reason: Optional[str]) -> None:
        super().__init__(message)
        self.status, self.reason = status, reason
