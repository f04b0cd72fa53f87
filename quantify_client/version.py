"""Which version this is and where it came from, also where the package was merely copied."""

from __future__ import annotations

import json
import shlex
import sys
from importlib import metadata
from pathlib import Path
from urllib.parse import urlsplit

__all__ = ["VERSION_FILE", "how_to_add", "package_version"]

_NAME = "quantify-client"

#: Beside this module inside WebODM's plugin, which no package manager knows.
VERSION_FILE = "VERSION"


def package_version() -> str:
    """Return the version of this copy of the package."""
    try:
        return (Path(__file__).parent / VERSION_FILE).read_text("utf-8").strip()
    except OSError:
        pass
    try:
        return metadata.version(_NAME)
    except metadata.PackageNotFoundError:
        return "unknown"


def how_to_add(extra: str) -> str:
    """Return the command that adds an extra's packages to this installation.

    From the checkout: this project is on no package index, whatever has its name there.
    """
    checkout = _checkout()
    where = "" if checkout else "in the checkout of 3D-Quantify: "
    command = [sys.executable, "-m", "pip", "install", f"{checkout or '.'}[{extra}]"]
    return where + " ".join(map(shlex.quote, command))


def _checkout() -> str:
    """Return the folder that pip installed this from, or nothing where that cannot be told."""
    from urllib.request import url2pathname  # late: with all of http

    try:
        text = metadata.distribution(_NAME).read_text("direct_url.json") or "{}"
        url = urlsplit(json.loads(text).get("url", ""))
    except (metadata.PackageNotFoundError, OSError, ValueError):
        return ""
    folder = Path(url2pathname(url.path)) if url.scheme == "file" else None
    return str(folder) if folder and (folder / "pyproject.toml").is_file() else ""
