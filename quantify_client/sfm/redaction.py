"""Texts that must show nowhere: not in a message, not in what libraries log."""

from __future__ import annotations

import logging
import unicodedata
from typing import Iterable, List, Set
from urllib.parse import quote, quote_plus

__all__ = ["forms", "hidden", "mask_logs", "plain"]

_URL_LOGGERS = ("urllib3.connectionpool", "urllib3.util.retry", "urllib3.poolmanager")


def plain(text: object, most: int = 300) -> str:
    r"""Return what a server said on one line, without anything that steers a terminal.

    Examples
    --------
    >>> plain("not\nfound \x1b[31m")
    'not found ?[31m'
    """
    line = " ".join(str(text).split())
    line = "".join("?" if unicodedata.category(c) in ("Cc", "Cf", "Cs") else c for c in line)
    return line if len(line) <= most else line[: most - 3] + "..."


def hidden(text: str, secrets: Iterable[str]) -> str:
    """Return the text with every secret replaced."""
    for secret in sorted(secrets, key=len, reverse=True):
        text = text.replace(secret, "***")
    return text


def forms(secret: str) -> List[str]:
    """Every way in which a secret may be written in a URL or a message."""
    forms = {secret, quote(secret), quote(secret, safe=""), quote_plus(secret), repr(secret)[1:-1]}
    return list(forms)


class _Masking(logging.Filter):
    """Keeps secrets out of what urllib3 logs; it logs each request's path with its query."""

    secrets: Set[str] = set()  # noqa: RUF012 - one for the process, as the loggers are

    def filter(self, record: logging.LogRecord) -> bool:
        record.msg, record.args = hidden(record.getMessage(), self.secrets), ()
        return True


_MASKING = _Masking()


def mask_logs(secrets: Iterable[str]) -> None:
    """Have urllib3 log nothing that holds one of these."""
    _MASKING.secrets.update(secrets)
    for logger in _URL_LOGGERS:
        logging.getLogger(logger).addFilter(_MASKING)
