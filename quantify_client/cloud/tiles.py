"""Several files as one survey."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Iterator, List, Optional, Sequence, Tuple

from ..crs.same import differ_in
from ..errors import CloudError
from ..files.reading import real_path
from ..types import Bounds, Chunk, CloudInfo, Window
from .base import DEFAULT_CHUNK, Cloud, gather, touches


class TiledCloud:
    """Tiles of one survey, in any mix of formats, read one after the other."""

    def __init__(self, clouds: Sequence[Cloud], *, any_crs: bool = False) -> None:
        self._clouds = tuple(clouds)
        infos = [cloud.info for cloud in self._clouds]
        named, warnings = _common_crs(infos, any_crs)
        formats = {info.format for info in infos}
        counts = [info.point_count for info in infos]
        self.info = CloudInfo(
            sources=tuple(source for info in infos for source in info.sources),
            format=formats.pop() if len(formats) == 1 else "mixed",
            point_count=sum(count or 0 for count in counts) if None not in counts else None,
            bounds=_around([info.bounds for info in infos]),
            crs=named.crs if named else None,
            crs_origin=named.crs_origin if named else None,
            faces=sum(info.faces for info in infos),
            warnings=tuple(dict.fromkeys(w for info in infos for w in info.warnings)) + warnings,
            crs_parts=named.crs_parts if named else (),
            steps=_largest([info.steps for info in infos]),
        )

    def chunks(self, window: Optional[Window] = None, size: int = DEFAULT_CHUNK) -> Iterator[Chunk]:
        """Deliver the points of every tile whose bounds touch `window`."""
        return gather(self._each(window, size), size)

    def _each(self, window: Optional[Window], size: int) -> Iterator[Chunk]:
        for cloud in self._clouds:
            if touches(cloud.info.bounds, window):
                yield from cloud.chunks(window, size)


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
) -> Tuple[Optional[CloudInfo], Tuple[str, ...]]:
    """Return a tile with the CRS that all tiles with a CRS agree on, and warnings."""
    known: List[CloudInfo] = [info for info in infos if info.crs]
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
            return first, (f"{found}; both are taken to be in that of --crs",)
        raise CloudError(
            f"{found}; expected tiles of one survey: reproject one of them, measure them one by "
            "one, or give the CRS that both are in (--crs)"
        )
    silent = [info.sources[0] for info in infos if not info.crs]
    if not silent:
        return first, ()
    note = f"{len(silent)} of {len(infos)} tiles name no CRS (the first: {silent[0]})"
    return first, (f"{note}; they are taken to be in that of the others " "(--crs sets another)",)


def _largest(steps: Sequence[Tuple[float, float, float]]) -> Tuple[float, float, float]:
    x, y, z = (max(axis) for axis in zip(*steps))
    return x, y, z


def _short(crs: Optional[str]) -> str:
    """The code or the name of a CRS."""
    name = re.search(r'"([^"]*)"', crs or "")
    return name.group(1)[:40] if name else str(crs)[:40]


def _around(boxes: Sequence[Optional[Bounds]]) -> Optional[Bounds]:
    """The box of all boxes; those of tiles whose points are all left out do not matter."""
    known = [box for box in boxes if box is not None]
    if not known:
        return None
    return Bounds(
        min(box.min_x for box in known),
        min(box.min_y for box in known),
        min(box.min_z for box in known),
        max(box.max_x for box in known),
        max(box.max_y for box in known),
        max(box.max_z for box in known),
    )
