"""Addresses of servers, credentials for them, and which certificates are trusted."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Mapping, Optional, Tuple, Union
from urllib.parse import parse_qsl, urlsplit, urlunsplit

from ...errors import ServerError, UsageError
from ..redaction import plain

__all__ = ["PASSWORD", "USER", "Access", "checked_url", "origin", "split_token", "verification"]

USER, PASSWORD = "QUANTIFY_WEBODM_USER", "QUANTIFY_WEBODM_PASSWORD"
"""Names of the environment variables."""


@dataclass(frozen=True)
class Access:
    """Credentials for a WebODM server; none of them shows in a repr.

    Attributes
    ----------
    user, password : of a WebODM user; without them only what is public can be read.
    token : a JWT instead; it expires (after six hours by default) and cannot be renewed.
    ca, insecure : a file of certificates to trust instead of the system's; or trust any.
    """

    user: Optional[str] = field(default=None, repr=False)
    password: Optional[str] = field(default=None, repr=False)
    token: Optional[str] = field(default=None, repr=False)
    ca: Optional[Path] = None
    insecure: bool = False

    @classmethod
    def from_environment(cls, environ: Mapping[str, str] = os.environ) -> Access:
        """Return the user and password that the environment holds.

        Raises
        ------
        UsageError
            Only one of the two is set.
        """
        user, password = environ.get(USER) or None, environ.get(PASSWORD) or None
        if (user is None) != (password is None):
            given, missing = (USER, PASSWORD) if password is None else (PASSWORD, USER)
            raise UsageError(f"{given} is set and {missing} is not; set both, or neither")
        return cls(user=user, password=password)

    @property
    def is_anonymous(self) -> bool:
        """Whether requests carry no credentials."""
        return self.token is None and (self.user is None or self.password is None)


def origin(url: str) -> Tuple[str, str, Optional[int]]:
    """Return scheme, host and port: what decides who gets to see a token."""
    parts = urlsplit(url)
    port = parts.port or {"http": 80, "https": 443}.get(parts.scheme)
    return parts.scheme, parts.hostname or "", port


def checked_url(url: str) -> str:
    """Return a server's address that can be used and stored; ServerError for any other."""
    shown = plain(url.split("?")[0].split("@")[-1], 80)
    try:
        parts = urlsplit(url)
        sound = parts.scheme in ("http", "https") and parts.hostname and parts.port != 0
    except ValueError:
        sound = False
    if not sound:
        raise ServerError(f"{shown!r} is no address of a server; expected http://HOST:PORT")
    if parts.username is not None:
        raise ServerError(
            f"{shown!r}: names and passwords do not belong into a URL, which is stored; use a token"
        )
    if parts.query or parts.fragment:
        raise ServerError(f"{shown!r}: has something after '?' or '#'; give the address alone")
    return url


def split_token(url: str, token: Optional[str] = None) -> Tuple[str, Optional[str]]:
    """Return a node's URL without ``?token=``, and the token; one that is given apart wins.

    Examples
    --------
    >>> split_token("http://host:3000/?token=abc")
    ('http://host:3000/', 'abc')
    """
    try:
        parts = urlsplit(url)
    except ValueError:
        return url, token  # whoever uses it says what is wrong with it
    pairs = parse_qsl(parts.query)
    if not pairs or any(key != "token" for key, _ in pairs):
        return url, token
    return urlunsplit((*parts[:3], "", "")), token or pairs[0][1]


def verification(ca: Optional[Path], insecure: bool) -> Union[bool, str]:
    """Return what requests is to verify certificates with, as its argument ``verify``."""
    import ssl  # not for whoever only names a server

    import urllib3

    if insecure:
        urllib3.disable_warnings(urllib3.exceptions.InsecureRequestWarning)
        return False
    if ca is None:
        return os.environ.get("REQUESTS_CA_BUNDLE") or os.environ.get("CURL_CA_BUNDLE") or True
    try:
        if not ca.is_file():  # a pipe might never end
            raise ValueError("is not a file" if ca.exists() else "does not exist")
        ssl.create_default_context(cafile=str(ca))
    except (OSError, ValueError) as error:
        raise ServerError(
            f"{ca}: holds no certificate ({plain(getattr(error, 'strerror', None) or error, 80)}); "
            "expected a PEM file"
        ) from None
    return str(ca)
