"""A WebODM server: the addresses of its tasks, and requests with a user's credentials.

Everything behind a task is asked of its REST API under ``/api/``. What it says of errors: 404 for
what is not there and for what the user may not see; 403 for a token that has expired and for one
that it cannot read; 400 for a wrong password.
"""

from __future__ import annotations

import base64
import re
import threading
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Callable, Optional, Tuple, TypeVar
from urllib.parse import urlsplit, urlunsplit

from ...errors import CloudError, ServerError, UsageError
from ..redaction import plain
from .access import PASSWORD, USER, Access
from .errors import OutageError, StatusError
from .http import Server

__all__ = ["TaskAddress", "WebODM", "task_address"]

LOGIN_S = 3600.0  # a JWT lasts six hours by default, a server may be set to less
_UUID = r"[0-9a-fA-F]{8}(?:-?[0-9a-fA-F]{4}){3}-?[0-9a-fA-F]{12}"
_TASK = re.compile(
    r"^(?P<prefix>(?:/[^/]+)*?)/(?:"
    r"(?:map/|3d/)?project/(?P<p1>\d+)/task/(?P<t1>{u})"
    r"|public/task/(?P<t2>{u})"
    r"|api/projects/(?P<p3>\d+)/tasks/(?P<t3>{u})"
    r")(?:/.*)?$".replace("{u}", _UUID)
)
_LOGIN_HINT = f"set {USER} and {PASSWORD}"

T = TypeVar("T")


@dataclass(frozen=True)
class TaskAddress:
    """Where a task is.

    Attributes
    ----------
    given : the address as the user gave it, without what followed ``?`` or ``#``.
    server : the WebODM that has it.
    project : None in a public address, which does not tell it.
    """

    given: str
    server: str
    project: Optional[int]
    task: str

    @property
    def api(self) -> str:
        """Return the path of what belongs to the task; its files do not care for the project."""
        return f"/api/projects/{self.project or 0}/tasks/{self.task}"


def task_address(url: str) -> TaskAddress:
    """Return the parts of a task's address.

    Raises
    ------
    CloudError
        It is the address of something else.

    Examples
    --------
    >>> found = task_address(
    ...     "https://host:8443/odm/map/project/3/task/7b0fd1cc-64a6-4c5a-8a5d-ae4b0c5c9f2e/?t=dsm"
    ... )
    >>> found.server, found.project, found.task
    ('https://host:8443/odm', 3, '7b0fd1cc-64a6-4c5a-8a5d-ae4b0c5c9f2e')
    """
    bare = re.split(r"[?#]", url, maxsplit=1)[0]
    try:
        parts = urlsplit(bare)
    except ValueError:
        parts = urlsplit("")
    match = _TASK.match(parts.path) if parts.netloc else None
    if match is None:
        raise CloudError(
            f"{plain(bare.split('@')[-1], 200)}: is a web address, but no WebODM task's; expected "
            "https://HOST/project/P/task/T/map/, as the browser shows it with the task's map open; "
            "of other servers, download the all.zip and give that"
        )
    found = match.groupdict()
    project = found["p1"] or found["p3"]
    return TaskAddress(
        given=bare,
        server=urlunsplit((parts.scheme.lower(), parts.netloc, found["prefix"], "", "")),
        project=int(project) if project else None,
        task=found["t1"] or found["t2"] or found["t3"],
    )


class WebODM(Server):
    """A WebODM server, asked with somebody's credentials.

    Parameters
    ----------
    url : http or https, any port, any path prefix.
    access : who asks. A user logs in when the first request is made, and again when the server
        does not know the token any more.
    disk_hint : see `Server`.
    public : whether anything can be asked for without a user.
    """

    def __init__(
        self,
        url: str,
        access: Access,
        *,
        silence_s: float = 60.0,
        disk_hint: str = "make room, or mend the folder, and resume",
        public: bool = True,
    ) -> None:
        super().__init__(
            url,
            secrets=[secret for secret in (access.password, access.token) if secret],
            ca=access.ca,
            insecure=access.insecure,
            silence_s=silence_s,
            login_hint=_LOGIN_HINT,
            disk_hint=disk_hint,
            success=(200, 201),
        )
        self._access, self._public = access, public
        self._lock = threading.Lock()
        self._since: Optional[float] = None
        self._login = 0

    @property
    def is_anonymous(self) -> bool:
        """Whether requests carry no credentials."""
        return self._access.is_anonymous

    def json(self, method: str, path: str, **rest: Any) -> Any:
        """Send one request and return its JSON answer; see `Server.json`."""
        return self._known(partial(super().json, method, path, **rest))

    def download(
        self,
        path: str,
        part: Path,
        progress: Callable[[int, Optional[int]], None],
        **rest: Any,
    ) -> None:
        """Write what is at a path into a file; see `Server.download`."""
        self._known(partial(super().download, path, part, progress, **rest))

    def _known(self, ask: Callable[[], T]) -> T:
        """Ask with our credentials, logging in as needed; refusals are put into our own words."""
        if self.is_anonymous and not self._public:
            raise UsageError(f"{self.name}: a task on a WebODM needs a user; {_LOGIN_HINT}")
        login = self._log_in()
        try:
            try:
                return ask()
            except StatusError as error:
                can = self._access.token is None and not self.is_anonymous
                # 403 and JSON also say that a user may not do something: once more is harmless.
                if not (can and error.status in (401, 403) and error.reason is not None):
                    raise
            self._log_in(instead_of=login)
            return ask()
        except StatusError as error:
            raise self._in_words(error) from None

    def _log_in(self, instead_of: Optional[int] = None) -> int:
        """Have the server know us; return the number of the login that counts."""
        access = self._access
        if access.token is not None:
            self.identify({"Authorization": f"JWT {access.token}"}, [])
        if access.token is not None or access.user is None or access.password is None:
            return 0
        with self._lock:
            fresh = self._since is not None and time.monotonic() - self._since < LOGIN_S
            if not fresh or instead_of == self._login:
                kind, secret = self._ticket(access.user, access.password)
                self.identify({"Authorization": f"{kind} {secret}"}, [secret])
                self._since, self._login = time.monotonic(), self._login + 1
            return self._login

    def _ticket(self, user: str, password: str) -> Tuple[str, str]:
        """Return the kind of an Authorization header, and what is secret in it."""
        given = {"username": user, "password": password}
        try:
            answer = super().json("POST", "/api/token-auth/", json=given)
        except StatusError as error:
            if error.status in (400, 401) and error.reason is not None:
                raise ServerError(
                    f"{self.name}: refuses the user or the password; check {USER} and {PASSWORD}"
                ) from None
            if error.status in (403, 404, 405):  # switched off, or not let through: the password
                return "Basic", base64.b64encode(f"{user}:{password}".encode()).decode()
            raise ServerError(
                f"{self.name}: answers a login with status {error.status}; is it a WebODM?"
            ) from None
        token = answer.get("token") if isinstance(answer, dict) else None
        if not token or not isinstance(token, str):
            raise OutageError(f"{self.name}: answers a login with something that is no token")
        return "JWT", token

    def _in_words(self, failure: StatusError) -> StatusError:
        status, reason = failure.status, failure.reason
        said = f" ({reason})" if reason else ""
        if status in (401, 403) and self.is_anonymous:
            words = f"wants to know who asks{said}; {_LOGIN_HINT}"
        elif status in (401, 403) and self._access.token is not None:
            words = f"refuses the token{said}; they expire: get a new one, or {_LOGIN_HINT}"
        elif status in (401, 403):
            words = f"does not allow this{said}; check {USER}, {PASSWORD} and the user's rights"
        elif status == 404 and reason is not None:
            words = f"has nothing there ({reason})"
        elif status == 404:
            words = "has no WebODM at this address; check the host, its port and the path before it"
        elif reason:
            words = f"refuses that ({reason})"
        else:
            return failure
        return StatusError(f"{self.name}: {words}", status, reason)
