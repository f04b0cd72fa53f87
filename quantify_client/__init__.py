"""Volumes with an honest error from OpenDroneMap outputs and other point clouds."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any, List

if TYPE_CHECKING:
    from .errors import QuantifyError
    from .options import Options
    from .pipeline.control.control_alone import convert_control
    from .pipeline.control.scale import scale
    from .pipeline.run import change, describe, measure
    from .report.document.measurement import to_json
    from .report.write import write_report
    from .sfm.servers.access import Access
    from .types import AreaFailure, AreaResult, Measurement, Scaled

    __version__: str

# The module of each public name, imported when the name is first used: the command starts at once.
_MODULES = {
    "Access": "sfm.servers.access",
    "AreaFailure": "types",
    "AreaResult": "types",
    "Measurement": "types",
    "Options": "options",
    "QuantifyError": "errors",
    "Scaled": "types",
    "change": "pipeline.run",
    "convert_control": "pipeline.control.control_alone",
    "describe": "pipeline.run",
    "measure": "pipeline.run",
    "scale": "pipeline.control.scale",
    "to_json": "report.document.measurement",
    "write_report": "report.write",
}

__all__ = [
    "Access",
    "AreaFailure",
    "AreaResult",
    "Measurement",
    "Options",
    "QuantifyError",
    "Scaled",
    "__version__",
    "change",
    "convert_control",
    "describe",
    "measure",
    "scale",
    "to_json",
    "write_report",
]


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used."""
    if name == "__version__":
        return import_module(".version", __name__).package_version()
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f".{_MODULES[name]}", __name__), name)


def __dir__() -> List[str]:
    return list(__all__)
