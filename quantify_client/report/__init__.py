"""Results as files, pictures, a page and a table; nothing is computed here.

matplotlib is loaded only when pictures are drawn.
"""

from __future__ import annotations

from .jsonout import to_json
from .table import print_table
from .write import write_report

__all__ = ["print_table", "to_json", "write_report"]
