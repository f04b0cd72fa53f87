"""scale and gcp."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Optional, Sequence

from rich.console import Console

from ..errors import UsageError
from ..files.reading import real_path
from ..files.writing import require_replaceable
from ..pipeline.control.control_alone import convert_control
from ..pipeline.control.scale import scale
from ..report.terminal.control import control_document, print_control
from ..report.terminal.scaling import print_scaling
from ..report.wording.words import printable
from ..report.write import write_scale_page
from ..types import Scaled, document
from .credentials import access_of
from .measuring import options_of
from .messages import complain_of, show_json, stages

__all__ = ["gcp", "scale_cloud"]


def scale_cloud(given: argparse.Namespace) -> int:
    """Make a cloud true to size, and write it and a page about it."""
    page = None if given.out is None else _page(given.out)
    if page is not None:
        require_replaceable(page, [given.gcp, given.area, *given.sources])
    with stages() as progress:

        def beside(scaled: Scaled, folder: Path) -> Sequence[str]:
            name = _page(given.out).name
            progress("drawing", 0.0)
            write_scale_page(scaled, folder / name, given.units)
            progress("drawing", 1.0)
            return [name]

        scaled = scale(
            *given.sources,
            out=given.out,
            progress=progress,
            access=access_of(given),
            beside=beside,
            **options_of(given),
        )
    if given.json:
        show_json(document(scaled))
    else:
        _show(scaled, page, given.units)
    return complain_of(
        [f"{f.name}: {f.error}; it is not among the moved polygons" for f in scaled.failures]
    )


def _show(scaled: Scaled, page: Optional[Path], units: str) -> None:
    print_scaling(scaled.scaling, Console(), units=units)
    for warning in scaled.warnings:
        print(f"Warning: {printable(warning)}")
    if scaled.out is not None:
        print(f"Cloud: {printable(scaled.out)}")
        print(f"Report: {printable(page)}")
    if scaled.areas is not None:
        print(f"Polygons: {printable(scaled.areas)}")


def _page(out: Path) -> Path:
    """Where the page goes: beside the cloud itself, also where that is given by a link."""
    stem = out.name[: -len(out.suffix)] if out.suffix else out.name
    real = real_path(out) if out.is_symlink() else out
    if not real.name:
        raise UsageError("--out names no file; give FILE.laz")
    return real.with_name(f"{stem}-report.html")


def gcp(given: argparse.Namespace) -> int:
    """Say what a control file can give, and write it for OpenDroneMap."""
    if given.out is not None and given.to is None:
        raise UsageError("--out goes with --to odm: add it, or leave both out")
    account = convert_control(given.file, to=given.to, out=given.out)
    if given.json:
        show_json(control_document(account))
    else:
        print_control(account, Console(), units=given.units)
    return complain_of([f"{account.source}: {fault}" for fault in account.faults])
