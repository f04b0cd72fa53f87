"""What servers and files say, fit to be shown: on one line, and without secrets."""

from __future__ import annotations

import logging
import unicodedata
from typing import Iterable, Set
from urllib.parse import quote, quote_plus

__all__ = ["forms", "hidden", "mask_logs", "plain"]

_URL_LOGGERS = ("urllib3.connectionpool", "urllib3.util.retry", "urllib3.poolmanager")


def plain(text: object, most: int = 300) -> str:
    r"""Return a text on one line, without anything that steers a terminal, cut if it is long.

    Examples
    --------
    >>> plain("not\nfound \x1b[31m")
    'not found ?[31m'
    """
    line = " ".join(str(text).split())
    line = "".join("?" if unicodedata.category(c) in ("Cc", "Cf", "Cs") else c for c in line)
    return line if len(line) <= most else line[: most - 3] + "..."


def hidden(text: str, secrets: Iterable[str]) -> str:
    """Return the text with every secret replaced by stars."""
    for secret in sorted(secrets, key=len, reverse=True):
        text = text.replace(secret, "***")
    return text


def forms(secret: str) -> Set[str]:
    """Return every way in which a secret may be written in a URL or a message."""
    return {secret, quote(secret), quote(secret, safe=""), quote_plus(secret), repr(secret)[1:-1]}


class _Masking(logging.Filter):
    """Keeps secrets out of what urllib3 logs; it logs each request's path with its query."""

    secrets: Set[str] = set()  # noqa: RUF012 - one for the process, as the loggers are

    def filter(self, record: logging.LogRecord) -> bool:
        record.msg, record.args = hidden(record.getMessage(), self.secrets), ()
        return True


_MASKING = _Masking()


def mask_logs(secrets: Iterable[str]) -> None:
    """Have urllib3 log nothing that holds one of these secrets."""
    _MASKING.secrets.update(secrets)
    for logger in _URL_LOGGERS:
        logging.getLogger(logger).addFilter(_MASKING)
