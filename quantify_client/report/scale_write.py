"""The report of a scaling alone, written at once or not at all."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any, Mapping, Optional, Sequence, Union

from ..errors import OutputError
from ..types import Scaling
from .scale_json import scale_document
from .units import Units, named_units
from .words import printable

__all__ = ["write_scale_report"]


def write_scale_report(
    scaling: Scaling,
    source: str,
    provenance: Mapping[str, Any],
    warnings: Sequence[str],
    path: Path,
    units: str = "metric",
    *,
    out: Optional[Union[str, Path]] = None,
) -> None:
    """Write one HTML file, its picture inside; what was there is replaced only by all of it.

    `units` of what people read is ``"metric"`` or ``"us"``; `out` is the scaled cloud that was
    written. Raises OutputError when the file cannot be written.
    """
    shown = named_units(units)
    document = scale_document(scaling, source, provenance, warnings, out)
    if path.is_dir():
        raise OutputError(f"{printable(path)} is a folder; give the name of a file.")
    try:
        # Beside the file: surely on the same disk, so that moving is renaming.
        with tempfile.TemporaryDirectory(prefix=".quantify-", dir=path.parent) as staging:
            _write(document, scaling, shown, Path(staging)).replace(path)
    except OSError as error:
        raise OutputError(
            f"The report cannot be written as {printable(path)}: {error.strerror or error}; "
            "what was there is unchanged. Make room or give another name."
        ) from error


def _write(document: Mapping[str, Any], scaling: Scaling, units: Units, folder: Path) -> Path:
    # Late: matplotlib is slow to load, and JSON needs none.
    from .scale_page import render_scale_html
    from .scale_plan import scale_plan

    picture, page = folder / "scale.png", folder / "scale.html"
    scale_plan(scaling, picture, units)
    with page.open("w", encoding="utf-8") as file:
        file.writelines(render_scale_html(document, scaling, units, picture))
    return page
