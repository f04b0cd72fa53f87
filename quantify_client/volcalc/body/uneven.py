"""How much uneven ground leaves unknown of what stands on it.

A body ends at the plane through the ground beside it. Below it the ground is as uneven as beside
it, and nobody saw it there: as much as blocks of ground are off the plane on average, so may the
base be.
"""

from __future__ import annotations

import math
from typing import Optional

import numpy as np
from scipy.spatial import cKDTree

from .enclose import Enclosed
from .estimate import area_of_foot
from .floor import Standing
from .plane import columns

__all__ = ["base_std"]

#: Ground this many spacings from the body, and no farther than this many times the base is wide.
_CLEAR = 2.0
_FAR = 2.0

#: Side of the blocks, as a share of the width of the base; the fewest of them, and of their points.
_BLOCK = 0.5
_FEWEST_BLOCKS = 6
_FEWEST = 10


def base_std(standing: Standing, body: Enclosed) -> Optional[float]:
    """Return the standard deviation of a volume from its base on uneven ground, m3.

    None without ground, 0 with too little of it to tell.
    """
    if standing.pose is None or not len(standing.ground):
        return None
    area = area_of_foot(body)
    width = math.sqrt(max(0.0, area))
    away = cKDTree(standing.points[:, :2]).query(standing.ground[:, :2])[0]
    ground = standing.ground[(away > _CLEAR * body.spacing) & (away < _FAR * width)]
    if not len(ground):
        return 0.0
    block = columns(ground, max(_BLOCK * width, body.spacing))
    count = np.bincount(block).astype(np.float64)
    mean = np.bincount(block, ground[:, 2]) / np.maximum(count, 1.0)
    square = np.bincount(block, (ground[:, 2] - mean[block]) ** 2)
    some = count >= _FEWEST
    blocks = int(np.count_nonzero(some))
    if blocks < _FEWEST_BLOCKS:
        return 0.0
    by_chance = float((square[some] / (count[some] - 1.0) / count[some]).mean())
    # The plane goes through this ground: three of its degrees of freedom are gone.
    off = float((mean[some] ** 2).sum()) / (blocks - 3.0)
    beyond = off - by_chance * (1.0 + 2.0 * math.sqrt(2.0 / blocks))
    return area * math.sqrt(max(0.0, beyond))
