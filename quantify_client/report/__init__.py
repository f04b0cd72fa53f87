"""Results as files, pictures, a page and a table; nothing is computed here.

Each name is imported when it is first used: matplotlib only where pictures are drawn, rich only
where a terminal is written to. Inside WebODM neither is there.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .document.measurement import scale_document, scale_json, to_json
    from .terminal.control import control_document, print_control
    from .terminal.results import print_table
    from .terminal.scaling import print_scaling
    from .write import require_writable, write_report, write_scale_page, write_scale_report

__all__ = [
    "control_document",
    "print_control",
    "print_scaling",
    "print_table",
    "require_writable",
    "scale_document",
    "scale_json",
    "to_json",
    "write_report",
    "write_scale_page",
    "write_scale_report",
]

_MODULES = {
    "control_document": "terminal.control",
    "print_control": "terminal.control",
    "print_scaling": "terminal.scaling",
    "print_table": "terminal.results",
    "require_writable": "write",
    "scale_document": "document.measurement",
    "scale_json": "document.measurement",
    "to_json": "document.measurement",
    "write_report": "write",
    "write_scale_page": "write",
    "write_scale_report": "write",
}


def __getattr__(name: str) -> Any:
    """Import a name's module when it is first used."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f".{_MODULES[name]}", __name__), name)
