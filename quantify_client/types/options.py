"""Everything that decides a measurement."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Optional, Union

__all__ = [
    "Options",
]


@dataclass(frozen=True)
class Options:
    """Everything that decides a measurement; each field is a command-line option of the same name.

    ``slices`` is ``"auto"`` or a positive number; ``base`` one of the names in
    :mod:`quantify_client.volcalc.terrain.base`, ``"compare"`` or an elevation in metres; ``floor``
    is ``"auto"``, ``"none"``, ``"plane"`` or an elevation in metres; ``max_gap`` is in metres;
    ``accuracy``, of the faces of a mesh, is in metres; ``density`` is in t/m3. ``gcp`` is a control
    file; ``area_frame`` and ``scale_mode`` go with it.
    ``crs`` (``EPSG:n``, WKT, a PROJ string or a file with one) and ``vertical_unit`` go before what
    the cloud says, ``source_unit`` is for one that does not say: ``"m"``, ``"cm"``, ``"mm"``,
    ``"ft"`` or ``"us-ft"``.
    """

    area: Optional[Any] = None
    shape: str = "auto"
    method: Optional[str] = None
    slices: Union[str, int] = "auto"
    slice_height: Optional[float] = None
    base: Optional[Union[str, float]] = None
    center_caps: bool = False
    hollow: bool = False
    max_gap: Optional[float] = None
    floor: Union[str, float] = "auto"
    accuracy: Optional[float] = None
    grid: bool = False
    gcp: Optional[Any] = None
    area_frame: str = "cloud"
    scale_mode: str = "auto"
    crs: Optional[str] = None
    source_unit: Optional[str] = None
    vertical_unit: Optional[str] = None
    density: Optional[float] = None
    density_sigma: float = 0.0
    threads: int = 0
