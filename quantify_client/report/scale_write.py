"""The report of a scaling alone, written at once or not at all."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Mapping, Optional, Sequence, Union

from ..errors import OutputError
from ..files.writing import put_in_place, require_replaceable, scratch, staging
from ..types import Scaling
from .document.measurement import scale_document
from .wording.units import named_units
from .wording.words import printable

__all__ = ["write_scale_page", "write_scale_report"]


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
    written. Raises OutputError when the file cannot be written, or would replace one that is no
    earlier report.
    """
    try:
        require_replaceable(path)
        with staging(path.parent) as working:
            page = working / path.name
            write_scale_page(scaling, source, provenance, warnings, page, units, out=out)
            put_in_place(working, [path.name])
    except OutputError:
        raise
    except OSError as error:
        raise OutputError(
            f"The report cannot be written as {printable(path)}: {error.strerror or error}; "
            "what was there is unchanged. Make room or give another name."
        ) from error


def write_scale_page(
    scaling: Scaling,
    source: str,
    provenance: Mapping[str, Any],
    warnings: Sequence[str],
    path: Path,
    units: str = "metric",
    *,
    out: Optional[Union[str, Path]] = None,
) -> None:
    """Write the same file where nobody sees it yet; OSError when it cannot be written."""
    # Late: matplotlib is slow to load, and JSON needs none.
    from .figures.control.figure import scale_plan
    from .page.scale_page import render_scale_html

    shown = named_units(units)
    document = scale_document(scaling, source, provenance, warnings, out)
    with scratch() as folder:
        picture = folder / "scale.png"
        scale_plan(scaling, picture, shown)
        with path.open("w", encoding="utf-8") as file:
            file.writelines(render_scale_html(document, scaling, shown, picture))
