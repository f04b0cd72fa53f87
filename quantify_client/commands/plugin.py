"""plugin: the zip that WebODM's administrators upload."""

from __future__ import annotations

import argparse

from ..plugin_build import build_plugin
from ..report.words import printable

__all__ = ["plugin"]


def plugin(given: argparse.Namespace) -> int:
    """Build the zip and say where it is, how large, and what to do with it."""
    path = build_plugin(given.out, offline=given.offline)
    print(f"{printable(path)} ({path.stat().st_size / 1e6:.1f} MB)")
    print(
        "In WebODM: Administration > Plugins > Load Plugin (.zip), then restart WebODM; an older "
        "version has to be deleted there first."
    )
    return 0
