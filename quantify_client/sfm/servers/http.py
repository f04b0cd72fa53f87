"""One request to a server, done carefully; with `limits` all that knows requests.

Each request has a connection of its own: a kept one may be closed by the other side just when a
file is on its way, and then nobody knows whether the file arrived. Secrets never get into a
message: what requests raises holds the whole URL, so it is put into our own words and dropped.
"""

from __future__ import annotations

import json
import re
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any, Callable, Dict, Iterator, Mapping, Optional, Sequence
from urllib.parse import parse_qsl, urlencode, urljoin, urlsplit, urlunsplit

import requests
import urllib3

from ...errors import ServerError
from ..redaction import forms, hidden, mask_logs, plain
from .access import checked_url, origin, verification
from .errors import OutageError, RefusedError, StatusError
from .limits import Watch, WatchedAdapter, save, watched
from .upload_body import UploadBody

__all__ = ["Server"]

CONNECT_S = 30.0
SILENCE_S = 60.0  # without a byte: the line is dead
ANSWER_SILENCES = 5  # how long a small answer or one block may take, however slowly it drips
ANSWER_BYTES = 16 << 20  # in memory JSON may take twenty times as much
REASON_BYTES = 1 << 16
BLOCK = 1 << 18
REDIRECTS = 5
_PLAINLY = {"Connection": "close", "Accept-Encoding": "identity"}
_REFUSALS = {
    401: "refuses who asks (401), or wants to know it; {login_hint}",
    403: "forbids this (403): the token, or the address that you come from, may not do it",
    404: "has nothing there (404); check the URL, its port and its path prefix",
    413: "or a proxy before it refuses a file of that size (413); raise the proxy's limit "
    "(nginx: client_max_body_size)",
}
_FINAL_FAULTS = {
    "CERTIFICATE_VERIFY_FAILED": "its certificate is not trusted; give its authority's (--ca FILE) "
    "or use --insecure",
    "WRONG_VERSION_NUMBER": "speaks no TLS on this port; try http:// for https://",
    "record layer failure": "speaks no TLS on this port; try http:// for https://",
}
"""What stands in an exception of requests, and what it means, where trying again is no use."""
_NEVER_CONNECTED = ("NewConnectionError", "NameResolutionError", "ConnectTimeout", "Tunnel conn")


def _identified(
    request: requests.PreparedRequest, headers: Mapping[str, str]
) -> requests.PreparedRequest:
    """Give a request our own headers: requests would take a password from ~/.netrc instead."""
    request.headers.update(headers)
    return request


class _Session(requests.Session):
    """Follows no redirect of itself, and does not read all of its body to find that out."""

    def __init__(self, watch: Watch) -> None:
        super().__init__()
        for scheme in ("http://", "https://"):
            self.mount(scheme, WatchedAdapter(watch))

    def get_redirect_target(self, resp: requests.Response) -> None:
        """Return none: `Server` follows redirects itself."""


class Server:
    """A server under one address.

    Parameters
    ----------
    url : http or https, with any port and any path prefix.
    query : sent with each request, to this host only.
    secrets : texts that must show nowhere.
    ca : a file of certificates to trust instead of the system's.
    insecure : trust any certificate.
    silence_s : how long the line may be without a byte.
    login_hint : what to do when the server wants to know who asks; ends a message.
    disk_hint : what to do when the disk is full; ends a message.
    success : every status that is success.
    """

    def __init__(
        self,
        url: str,
        *,
        query: Optional[Mapping[str, str]] = None,
        secrets: Sequence[str] = (),
        ca: Optional[Path] = None,
        insecure: bool = False,
        silence_s: float = SILENCE_S,
        login_hint: str = "check the credentials",
        disk_hint: str = "make room, or mend the folder, and resume",
        success: Sequence[int] = (200,),
    ) -> None:
        self._login_hint, self._disk_hint, self._success = login_hint, disk_hint, success
        self._secrets: Dict[str, None] = {}  # in order
        self._keep_secret(secrets)
        self.url = checked_url(url).rstrip("/")
        self.name = plain(urlsplit(self.url).netloc)
        self._query, self._headers = dict(query or {}), dict(_PLAINLY)
        self._silence_s, self._answer_s = silence_s, silence_s * ANSWER_SILENCES
        self._verify = verification(ca, insecure)
        self._proxies = requests.utils.get_environ_proxies(self.url)  # slow: not for each request

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.url!r})"

    def identify(self, headers: Mapping[str, str], secrets: Sequence[str]) -> None:
        """Send these headers from now on, to this host only; ServerError where none can be so."""
        if not all(value.isascii() and value.isprintable() for value in headers.values()):
            raise ServerError(
                f"{self.name}: the token holds characters that no token has (a line's end, say); "
                "look at where it comes from"
            )
        self._keep_secret(secrets)
        self._headers = {**headers, **_PLAINLY}

    def _keep_secret(self, secrets: Sequence[str]) -> None:
        new = [form for secret in secrets if secret for form in forms(secret)]
        self._secrets.update(dict.fromkeys(new))
        mask_logs(new)

    def redact(self, text: str) -> str:
        """Return the text with every secret replaced."""
        return hidden(text, self._secrets)

    def json(
        self,
        method: str,
        path: str,
        *,
        query: Optional[Mapping[str, str]] = None,
        headers: Optional[Mapping[str, str]] = None,
        upload: Optional[UploadBody] = None,
        **body: Any,
    ) -> Any:
        """Send one request and return its JSON answer.

        `body` is what requests takes: ``data``, ``files`` or ``json``. An `upload` instead of it
        may take as long as it goes on.

        Raises
        ------
        OutageError
            Worth trying again later.
        ServerError
            Not worth it; RefusedError when the answer holds an ``error``, StatusError when its
            status says no.
        """
        sent = dict(headers or {})
        if upload is not None:
            sent["Content-Type"], body = upload.content_type, {"data": upload}

        def ask(watch: Watch) -> Any:
            if upload is not None:
                upload.on_block = watch.tell
            with self._request(watch, method, path, query, headers=sent, **body) as response:
                return self._parsed(response)

        return watched(ask, self._answer_s, self.name)

    def download(
        self,
        path: str,
        part: Path,
        progress: Callable[[int, Optional[int]], None],
        *,
        most: Optional[int] = None,
        size_hint: str = "is the file there what it is said to be?",
        is_json: bool = False,
    ) -> None:
        """Write what is at a path into a file and check its length.

        `progress` is told the bytes so far and, where the server says so, of how many; more than
        `most` are refused, and `size_hint` then says what to do.
        """
        too_large = ServerError(
            f"{self.name}: sends more than the {(most or 0) / 1e6:.1f} MB that "
            f"{plain(path, 200)} can have; {size_hint}"
        )

        def ask(watch: Watch) -> None:
            with self._request(watch, "GET", path) as response:
                self._require_file(response, is_json)
                length = response.headers.get("Content-Length", "")
                total = int(length) if re.fullmatch(r"\d{1,18}", length, re.ASCII) else None
                done = save(
                    _counted(response.iter_content(BLOCK), watch),
                    part,
                    progress,
                    total=total,
                    most=most,
                    too_large=too_large,
                    disk_hint=self._disk_hint,
                )
            if total is not None and done != total:
                raise OutageError(f"{self.name}: the download ended after {done} of {total} bytes")

        watched(ask, self._answer_s, self.name)

    def _require_file(self, response: requests.Response, is_json: bool) -> None:
        kind = response.headers.get("Content-Type", "").lower()
        if ("json" in kind and not is_json) or "html" in kind:
            self._parsed(response)
            raise ServerError(f"{self.name}: sent {plain(kind, 40)} where a file was expected")

    @contextmanager
    def _request(
        self,
        watch: Watch,
        method: str,
        path: str,
        query: Optional[Mapping[str, str]] = None,
        **rest: Any,
    ) -> Iterator[requests.Response]:
        """Yield the response once its status is good; any failure becomes one of our errors."""
        asked = urlencode({**self._query, **(query or {})})
        url = f"{self.url}{path}?{asked}" if asked else self.url + path
        with _Session(watch) as session:
            try:
                with self._send(session, method, url, **rest) as response:
                    self._require_success(response)
                    if _is_packed(response):
                        raise ServerError(
                            f"{self.name}: packs its answer, which it was asked not to do; look at "
                            "the proxy before it"
                        )
                    yield response
                return
            except requests.RequestException as error:
                failure = self._explained(error)
            except urllib3.exceptions.HTTPError as error:
                failure = OutageError(f"{self.name}: the connection broke ({type(error).__name__})")
        raise failure  # here, so that it has no context with the URL in it

    def _send(
        self, session: requests.Session, method: str, url: str, **rest: Any
    ) -> requests.Response:
        """Send, and follow redirects of a GET; what is secret stays with the host it is for."""
        schemes = ("https",) if self.url.startswith("https:") else ("http", "https")
        for _ in range(REDIRECTS + 1):
            ours = origin(url) == origin(self.url)
            session.trust_env, session.proxies = not ours, dict(self._proxies) if ours else {}
            session.auth = partial(_identified, headers=self._headers if ours else _PLAINLY)
            response = session.request(
                method,
                url,
                timeout=(CONNECT_S, self._silence_s),
                stream=True,
                allow_redirects=False,
                verify=self._verify,
                **rest,
            )
            target = response.headers.get("Location")
            if response.status_code not in (301, 302, 303, 307, 308) or not target:
                return response
            response.close()
            session.close()  # the next request has a connection of its own, too
            url = self._redirected(url, target)
            if method != "GET" or urlsplit(url).scheme not in schemes:
                break
            if origin(url) != origin(self.url):
                url = self._without_secrets(url)
                session.cookies.clear()  # which do not know ports
        moved = plain(self.redact(urlunsplit((*urlsplit(url)[:3], "", ""))))
        raise ServerError(
            f"{self.name}: sends elsewhere, to {moved}; give the address where the server really is"
        )

    def _redirected(self, url: str, target: str) -> str:
        """Return where a redirect leads; ServerError when nobody could ask there."""
        with suppress(ValueError, requests.RequestException):
            url = urljoin(url, target)
            requests.Request("GET", url).prepare()
            origin(url)
            return url
        raise ServerError(
            f"{self.name}: sends elsewhere, to an address that is none; check the URL, and what "
            "stands between"
        )

    def _without_secrets(self, url: str) -> str:
        parts = urlsplit(url)
        given = parse_qsl(parts.query, True)
        kept = [(key, value) for key, value in given if self.redact(value) == value]
        if len(kept) == len(given):
            return url  # left as it is: a signed address must not be written anew
        return urlunsplit((*parts[:3], urlencode(kept), ""))

    def _require_success(self, response: requests.Response) -> None:
        status = response.status_code
        if status in self._success:
            return
        said = _REFUSALS.get(status, f"answers with status {status}")
        if status in (408, 425, 429) or status >= 500:
            raise OutageError(f"{self.name}: {said}; expected 200", unsent=status == 429)
        words = f"{self.name}: {said.format(login_hint=self._login_hint)}"
        raise StatusError(words, status, self._reason(response))

    def _reason(self, response: requests.Response) -> Optional[str]:
        """Return what a JSON answer says, whatever it is wrapped in; None for any other."""
        with suppress(ValueError, RecursionError, requests.RequestException):
            if not _is_packed(response):
                document = json.loads(next(response.iter_content(REASON_BYTES), b""))
                return plain(self.redact(" ".join(_texts(document))))
        return None

    def _parsed(self, response: requests.Response) -> Any:
        content = bytearray()
        for block in response.iter_content(BLOCK):
            content += block
            if len(content) > ANSWER_BYTES:
                raise OutageError(f"{self.name}: answers with no end; expected a short JSON text")
        if content.lstrip()[:1] == b"<":
            raise OutageError(
                f"{self.name}: answers with a web page; expected JSON: check the URL, its prefix, "
                "and whether a proxy or a login page stands between"
            )
        with suppress(ValueError, RecursionError):
            document = json.loads(content.decode("utf-8"))
            wrong = document.get("error") if isinstance(document, dict) else None
            if not wrong:
                return document
            reason = plain(self.redact(str(wrong)))
            raise RefusedError(f"{self.name}: {reason}", reason)
        raise OutageError(f"{self.name}: answers with something that is no JSON")

    def _explained(self, error: requests.RequestException) -> ServerError:
        words = repr(error)
        for sign, meaning in _FINAL_FAULTS.items():
            if sign in words:
                return ServerError(f"{self.name}: {meaning}")
        if isinstance(error, (requests.exceptions.InvalidURL, requests.exceptions.InvalidSchema)):
            return ServerError(f"{self.name}: is no address that can be asked; check the URL")
        if isinstance(error, requests.exceptions.ReadTimeout):
            return OutageError(f"{self.name}: says nothing for {self._silence_s:.0f} s")
        if any(sign in words for sign in _NEVER_CONNECTED):
            return OutageError(f"{self.name}: cannot be reached", unsent=True)
        return OutageError(f"{self.name}: the connection broke")


def _texts(document: Any) -> Iterator[str]:
    """Yield all texts in a JSON document."""
    if isinstance(document, str):
        yield document
    elif isinstance(document, (list, dict)):
        for part in document.values() if isinstance(document, dict) else document:
            yield from _texts(part)


def _is_packed(response: requests.Response) -> bool:
    """Whether a body is compressed: a little of it may unpack to anything."""
    return response.headers.get("Content-Encoding", "identity").strip().lower() != "identity"


def _counted(blocks: Iterator[bytes], watch: Watch) -> Iterator[bytes]:
    for block in blocks:
        watch.tell(len(block))
        yield block
