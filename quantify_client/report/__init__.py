"""Results as files, pictures, a page and a table; nothing is computed here.

matplotlib is loaded only when pictures are drawn.
"""

from __future__ import annotations

from .jsonout import to_json
from .table import print_table
from .write import require_writable, write_report

__all__ = ["print_table", "require_writable", "to_json", "write_report"]
