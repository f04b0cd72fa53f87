"""Figures, and the colours that map layers share with them; needs no drawing library itself."""

from __future__ import annotations

__all__ = ["DIVERGING"]

#: Of heights above the base, from the deepest fill (water) to the highest cut (earth).
DIVERGING = (
    (0.00, "#123a63"),
    (0.14, "#2468a3"),
    (0.30, "#6fa8d2"),
    (0.43, "#cfe1ec"),
    (0.50, "#f8f6f1"),
    (0.57, "#f5dbc6"),
    (0.70, "#e29a6c"),
    (0.86, "#bb5130"),
    (1.00, "#6e1d12"),
)
