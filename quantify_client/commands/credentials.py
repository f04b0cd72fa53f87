"""Credentials: from the environment, a file or the command line."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import Optional

from ..errors import InputError, UsageError
from ..files.reading import read_small
from ..sfm.servers.access import Access, split_token
from ..source import is_address

__all__ = ["access_of", "node_token", "token_of"]

NODE_TOKEN = "QUANTIFY_NODE_TOKEN"  # noqa: S105 - the variable's name
_MOST_BYTES = 16_384


def token_of(given: argparse.Namespace) -> Optional[str]:
    """Return the token that was given by file or option; None without."""
    if given.token_file is None:
        if given.token is not None and not given.token.strip():
            raise UsageError("--token is empty; give the token, or leave --token out")
        return given.token.strip() if given.token else None
    return _read_token(given.token_file)


def node_token(given: argparse.Namespace) -> Optional[str]:
    """Return the token of a node: of the command line, else the environment, else the URL."""
    apart = token_of(given) or os.environ.get(NODE_TOKEN, "").strip() or None
    _require_text(apart)
    return split_token(getattr(given, "node", None) or "", apart)[1]


def access_of(given: argparse.Namespace) -> Access:
    """Return how to get into a WebODM server: a token that is given, else the environment's.

    When no source is on a server the environment is not read: a mistake in it does not matter.
    """
    token = token_of(given)
    _require_text(token)
    asked = "sources" not in given or any(is_address(source) for source in given.sources)
    found = Access.from_environment() if asked and not token else Access()
    _require_text(found.user, found.password)
    return Access(
        user=found.user,
        password=found.password,
        token=token,
        ca=getattr(given, "ca", None),
        insecure=getattr(given, "insecure", False),
    )


def _require_text(*secrets: Optional[str]) -> None:
    """Raise InputError for what is not UTF-8, which no request can hold; it is not shown."""
    try:
        "".join(secret or "" for secret in secrets).encode()
    except UnicodeEncodeError:
        raise InputError(
            "the token, user or password holds bytes that are not UTF-8; give it as UTF-8"
        ) from None


def _read_token(path: Path) -> str:
    what = "a text file that holds a token and nothing else"
    try:
        text = read_small(path, most=_MOST_BYTES, what=what, error=InputError).decode("utf-8-sig")
    except UnicodeDecodeError:
        text = ""
    token = text.strip()
    if not token or len(token.split()) != 1:
        raise InputError(f"{path} holds no token, or more than one; expected {what}")
    return token
