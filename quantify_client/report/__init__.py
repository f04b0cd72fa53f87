"""Results as files, pictures, a page and a table; nothing is computed here.

matplotlib is loaded only when pictures are drawn.
"""

from __future__ import annotations

from .control_account import control_document, print_control
from .jsonout import to_json
from .scale_json import scale_document, scale_json
from .scale_table import print_scaling
from .scale_write import write_scale_report
from .table import print_table
from .write import require_writable, write_report

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
    "write_scale_report",
]
