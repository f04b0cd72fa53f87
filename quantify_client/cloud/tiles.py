"""Several files as one survey."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Iterator, Optional, Sequence, Tuple

from ..crs.same import differ_in
from ..errors import CloudError
from ..files.reading import real_path
from ..types import Chunk, CloudInfo, Notice, Window
from .base import DEFAULT_CHUNK, Cloud, rechunk, touches, union


class TiledCloud:
    """Tiles of one survey, in any mix of formats, read one after the other."""

    def __init__(self, clouds: Sequence[Cloud], *, any_crs: bool = False) -> None:
        self._clouds = tuple(clouds)
        infos = [cloud.info for cloud in self._clouds]
        named, warnings = _common_crs(infos, any_crs)
        formats = {info.format for info in infos}
        steps = [max(axis) for axis in zip(*(info.steps for info in infos))]
        counts = [info.point_count for info in infos]
        self.info = CloudInfo(
            sources=tuple(source for info in infos for source in info.sources),
            format=formats.pop() if len(formats) == 1 else "mixed",
            point_count=sum(count or 0 for count in counts) if None not in counts else None,
            bounds=union(info.bounds for info in infos),
            crs=named.crs if named else None,
            crs_origin=named.crs_origin if named else None,
            faces=sum(info.faces for info in infos),
            warnings=tuple(dict.fromkeys(w for info in infos for w in info.warnings)) + warnings,
            crs_parts=named.crs_parts if named else (),
            steps=(steps[0], steps[1], steps[2]),
        )

    def chunks(self, window: Optional[Window] = None, size: int = DEFAULT_CHUNK) -> Iterator[Chunk]:
        """Deliver the points of every tile whose bounds touch `window`."""
        near = (cloud for cloud in self._clouds if touches(cloud.info.bounds, window))
        return rechunk((chunk for cloud in near for chunk in cloud.chunks(window, size)), size)


def require_distinct(paths: Sequence[Path]) -> None:
    """Raise CloudError when a file is given twice: its points would count twice."""
    seen = set()
    for path in paths:
        real = real_path(path)
        if real in seen:
            raise CloudError(f"{path}: is given twice; give each tile once")
        seen.add(real)


def _common_crs(
    infos: Sequence[CloudInfo], any_crs: bool
) -> Tuple[Optional[CloudInfo], Tuple[Notice, ...]]:
    """Return a tile with the CRS that all tiles with a CRS agree on, and warnings."""
    known = [info for info in infos if info.crs]
    if not known:
        return None, ()
    first = known[0]
    for other in known[1:]:
        parts = differ_in(str(other.crs), str(first.crs))
        if not parts:
            continue
        found = (
            f"{other.sources[0]}: is in another CRS ({_short(other.crs)}) than {first.sources[0]} "
            f"({_short(first.crs)}): another {' and '.join(parts)}"
        )
        if any_crs:
            text = f"{found}; both are taken to be in that of --crs"
            return first, (Notice("tiles-differ-in-crs", text),)
        raise CloudError(
            f"{found}; expected tiles of one survey: reproject one of them, measure them one by "
            "one, or give the CRS that both are in (--crs)"
        )
    silent = [info.sources[0] for info in infos if not info.crs]
    if not silent:
        return first, ()
    text = (
        f"{len(silent)} of {len(infos)} tiles name no CRS (the first: {silent[0]}); they are taken "
        "to be in that of the others (--crs sets another)"
    )
    return first, (Notice("tiles-without-crs", text, tiles=len(infos), without=len(silent)),)


def _short(crs: Optional[str]) -> str:
    """Return the code or the name of a CRS."""
    name = re.search(r'"([^"]*)"', crs or "")
    return name.group(1)[:40] if name else str(crs)[:40]
