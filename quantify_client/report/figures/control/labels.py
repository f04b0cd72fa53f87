"""Where names go in a plan: beside their points, clear of each other and of what is drawn."""

from __future__ import annotations

from typing import Any, List, Optional, Sequence, Tuple

import numpy as np
from matplotlib.font_manager import FontProperties

from ....types import FloatArray

__all__ = ["Labels"]

Box = Tuple[float, float, float, float]  # left, bottom, right, top, in pixels
AWAY = 8.0  # pixels from a point to its name
# Right above is read first; the rest in the order that maps prefer.
SIDES = ((1, 1), (1, -1), (-1, 1), (-1, -1), (1, 0), (-1, 0), (0, 1), (0, -1))
BUSY = 3.0  # what covering a line costs, in units of the less preferred side


class Labels:
    """Puts one text after another where it covers least; gives up rather than cover a text."""

    def __init__(self, axes: Any, obstacles: FloatArray) -> None:
        """Take points (N, 2) in pixels that are better not covered."""
        self._axes = axes
        self._obstacles = obstacles
        self._taken: List[Box] = []
        self._renderer = axes.figure.canvas.get_renderer()
        corners = axes.transAxes.transform([(0.0, 0.0), (1.0, 1.0)])
        self._view: Box = (*corners[0], *corners[1])

    def reserve(self, box: Box) -> None:
        """Keep a box free of text."""
        self._taken.append(box)

    def put(
        self, words: str, anchors: Sequence[Tuple[float, float]], size: float, **looks: Any
    ) -> bool:
        """Write a text beside the first of the anchors (pixels) that has room, or not at all."""
        wide, high = self._extent(words, size, looks.get("weight", "normal"))
        best: Optional[Tuple[float, Box]] = None
        for rank, (x, y) in enumerate(anchors):
            for order, side in enumerate(SIDES):
                box = _box(x, y, side, wide, high)
                cost = self._cost(box)
                if cost is None:
                    continue
                cost += order + 2.0 * rank
                if best is None or cost < best[0]:
                    best = (cost, box)
        if best is None:
            return False
        self._write(words, best[1], size, looks)
        return True

    def _write(self, words: str, box: Box, size: float, looks: Any) -> None:
        self._taken.append(box)
        x, y = self._axes.transData.inverted().transform((box[0], (box[1] + box[3]) / 2))
        self._axes.text(x, y, words, size=size, ha="left", va="center", zorder=9, **looks)

    def _extent(self, words: str, size: float, weight: str) -> Tuple[float, float]:
        font = FontProperties(family="DejaVu Sans", size=size, weight=weight)
        wide, high, _ = self._renderer.get_text_width_height_descent(words, font, False)
        return float(wide) + 2.0, float(high) + 3.0

    def _cost(self, box: Box) -> Optional[float]:
        """Return how much a box covers; None where it covers text or leaves the plan."""
        left, bottom, right, top = box
        view = self._view
        if left < view[0] or bottom < view[1] or right > view[2] or top > view[3]:
            return None
        for other in self._taken:
            if left < other[2] and right > other[0] and bottom < other[3] and top > other[1]:
                return None
        x, y = self._obstacles.T
        covered = np.count_nonzero((x > left) & (x < right) & (y > bottom) & (y < top))
        return BUSY * float(np.sqrt(covered))


def _box(x: float, y: float, side: Tuple[int, int], wide: float, high: float) -> Box:
    across, up = side
    away = AWAY if not across or not up else 0.75 * AWAY
    left = x + away if across > 0 else x - away - wide if across < 0 else x - wide / 2
    bottom = y + away - 2 if up > 0 else y - away + 2 - high if up < 0 else y - high / 2
    return (left, bottom, left + wide, bottom + high)
