"""Who asks a WebODM server, and how its certificate is looked at."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Mapping, Optional

from ...errors import UsageError

__all__ = ["PASSWORD", "USER", "Access"]

USER, PASSWORD = "QUANTIFY_WEBODM_USER", "QUANTIFY_WEBODM_PASSWORD"
"""Names of the environment variables."""


@dataclass(frozen=True)
class Access:
    """Credentials of a WebODM server; none of them shows in a repr.

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
        """Take user and password from the environment.

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
        """Whether nobody in particular asks."""
        return self.token is None and (self.user is None or self.password is None)
