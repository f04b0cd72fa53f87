"""Which version this is, also where the package was copied rather than installed."""

from __future__ import annotations

from importlib import metadata
from pathlib import Path

__all__ = ["VERSION_FILE", "package_version"]

#: Beside this module inside WebODM's plugin, which no package manager knows.
VERSION_FILE = "VERSION"


def package_version() -> str:
    """Return the version of this copy of the package."""
    try:
        return (Path(__file__).parent / VERSION_FILE).read_text("utf-8").strip()
    except OSError:
        pass
    try:
        return metadata.version("quantify-client")
    except metadata.PackageNotFoundError:
        return "unknown"
