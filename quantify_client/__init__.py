"""Volumes with an honest error from OpenDroneMap outputs and other point clouds."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .errors import QuantifyError
    from .pipeline import convert_control, describe, measure, scale
    from .report import to_json, write_report
    from .sfm.servers.access import Access
    from .types import AreaFailure, AreaResult, Measurement, Options

__all__ = [
    "Access",
    "AreaFailure",
    "AreaResult",
    "Measurement",
    "Options",
    "QuantifyError",
    "convert_control",
    "describe",
    "measure",
    "scale",
    "to_json",
    "write_report",
]

_MODULES = ("errors", "types", "sfm.servers.access", "pipeline", "report")


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used, so that the command starts at once."""
    for room in _MODULES if name in __all__ else ():
        found = getattr(import_module(f".{room}", __name__), name, None)
        if found is not None:
            return found
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
