"""Lines of equal height through a grid, by marching squares."""

from __future__ import annotations

from typing import Any, Dict, List, Tuple

import numpy as np
import shapely

from ..types import FloatArray

__all__ = ["contour"]

# A square's corners are numbered south-west 1, south-east 2, north-east 4, north-west 8, and its
# edges south 0, east 1, north 2, west 3. For the corners that lie above, the edges that are joined;
# in a saddle the higher corners are taken to be apart.
_JOINED: Dict[int, Tuple[Tuple[int, int], ...]] = {
    1: ((3, 0),),
    2: ((0, 1),),
    3: ((3, 1),),
    4: ((1, 2),),
    5: ((3, 0), (1, 2)),
    6: ((0, 2),),
    7: ((3, 2),),
    8: ((2, 3),),
    9: ((2, 0),),
    10: ((0, 1), (2, 3)),
    11: ((2, 1),),
    12: ((1, 3),),
    13: ((1, 0),),
    14: ((0, 3),),
}


def contour(values: FloatArray, level: float) -> List[Any]:
    """Return the lines of one level as shapely LineStrings, closed where they close.

    Parameters
    ----------
    values : (ny, nx) float64; NaN where nothing is known: lines end there. Coordinates of the
        lines are column and row, at whole numbers where the values are.
    """
    if min(values.shape) < 2:
        return []
    low, high = values[:-1], values[1:]
    corners = (low[:, :-1], low[:, 1:], high[:, 1:], high[:, :-1])
    known = np.isfinite(corners[0] + corners[1] + corners[2] + corners[3])
    case = sum((corner > level).astype(np.int64) << i for i, corner in enumerate(corners))
    case = np.where(known, case, 0)
    pieces = []
    for number, joined in _JOINED.items():
        rows, columns = np.nonzero(case == number)
        if not len(rows):
            continue
        for ends in joined:
            line = [_crossing(values, level, rows, columns, edge) for edge in ends]
            pieces.append(np.stack(line, axis=1))
    if not pieces:
        return []
    merged = shapely.line_merge(
        shapely.multilinestrings(shapely.linestrings(np.concatenate(pieces)))
    )
    return list(shapely.get_parts(merged))


def _crossing(values: FloatArray, level: float, rows: Any, columns: Any, edge: int) -> FloatArray:
    """(N, 2) where the level crosses an edge of squares.

    Both squares of an edge count from its same end, so that their lines meet to the last bit.
    """
    across = edge in (0, 2)
    row = rows + (edge == 2)
    column = columns + (edge == 1)
    start = values[row, column]
    end = values[row, column + 1] if across else values[row + 1, column]
    share = (level - start) / (end - start)
    if across:
        return np.column_stack([column + share, row.astype(np.float64)])
    return np.column_stack([column.astype(np.float64), row + share])
