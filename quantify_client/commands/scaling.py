"""scale and gcp."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any, Mapping, Optional, Sequence, Tuple

from rich.console import Console

from ..errors import UsageError
from ..files.reading import real_path
from ..files.writing import require_replaceable
from ..pipeline.control.control_alone import convert_control
from ..pipeline.control.scale import scale
from ..report import (
    control_document,
    print_control,
    print_scaling,
    scale_document,
    write_scale_page,
)
from ..report.wording.words import printable
from ..types import Scaled, Scaling
from .credentials import access_of
from .measuring import options_of
from .messages import complain, stages

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
            write_scale_page(*_about(scaled), folder / name, given.units, out=scaled.out)
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
        document = scale_document(*_about(scaled), scaled.out, scaled.areas, scaled.failures)
        print(json.dumps(document, indent=2, allow_nan=False))
    else:
        _show(scaled, page, given.units)
    for failure in scaled.failures:
        complain(f"{failure.name}: {failure.error}; it is not among the moved polygons", 1)
    return 1 if scaled.failures else 0


def _show(scaled: Scaled, page: Optional[Path], units: str) -> None:
    print_scaling(scaled.scaling, Console(), units=units)
    for warning in scaled.warnings:
        print(f"Warning: {printable(warning)}")
    if scaled.out is not None:
        print(f"Cloud: {printable(scaled.out)}")
        print(f"Report: {printable(page)}")
    if scaled.areas is not None:
        print(f"Polygons: {printable(scaled.areas)}")


def _about(scaled: Scaled) -> Tuple[Scaling, str, Mapping[str, Any], Sequence[str]]:
    return scaled.scaling, scaled.source, scaled.provenance, scaled.warnings


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
        print(json.dumps(control_document(account), indent=2, allow_nan=False))
    else:
        print_control(account, Console(), units=given.units)
    for fault in account.faults:
        complain(f"{account.source}: {fault}", 1)
    return 1 if account.faults else 0
