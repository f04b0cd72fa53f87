"""plugin: the zips that WebODM's administrators upload."""

from __future__ import annotations

import argparse

from ..plugin_build import build_plugin, replaceable_zip
from ..report.wording.words import printable

__all__ = ["plugin"]

_FOR = {
    True: "for WebODM's own images (Python 3.9, x86-64): no download, 43 MB on the server",
    False: "for other servers: WebODM downloads the requirements, 117 MB on the server",
}


def plugin(given: argparse.Namespace) -> int:
    """Build the zips and say where they are, what for, and what to do with them."""
    kinds = [not given.online]
    if not (given.offline or given.online or given.out.suffix == ".zip"):
        kinds = [True, False]
    for offline in kinds:
        replaceable_zip(given.out, offline=offline)
    for offline in kinds:
        path = build_plugin(given.out, offline=offline)
        print(f"{printable(path)} ({path.stat().st_size / 1e6:.1f} MB): {_FOR[offline]}")
    print(
        "In WebODM: Administration > Plugins > Load Plugin (.zip), then restart WebODM; an older "
        "version has to be deleted there first. Saved measurements stay."
    )
    return 0
