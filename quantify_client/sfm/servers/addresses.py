"""Addresses of servers, and whose word is taken for them."""

from __future__ import annotations

import os
import ssl
from pathlib import Path
from typing import Optional, Tuple, Union
from urllib.parse import urlsplit

import urllib3

from ...errors import ServerError
from ..redaction import plain

__all__ = ["checked_url", "origin", "trusted"]


def origin(url: str) -> Tuple[str, str, Optional[int]]:
    """Give scheme, host and port: what decides who gets to see a token."""
    parts = urlsplit(url)
    return (
        parts.scheme,
        parts.hostname or "",
        parts.port or {"http": 80, "https": 443}.get(parts.scheme),
    )


def checked_url(url: str) -> str:
    """Return an address that can be used and stored; ServerError for any other."""
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


def trusted(ca: Optional[Path], insecure: bool) -> Union[bool, str]:
    """Give what requests is to verify certificates with."""
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
