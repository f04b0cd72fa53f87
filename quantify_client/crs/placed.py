"""The frame of a cloud that is moved on its way: its own frame first, then one matrix."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import product
from typing import Optional, Tuple

import numpy as np

from ..types import Bounds, FloatArray, Matrix4, Window
from .frame import Frame

__all__ = ["PlacedFrame", "placed_frame"]

# Below this slope (1 mm at 1 km) the vertical of both frames is the same.
_UPRIGHT = 1e-6


@dataclass(frozen=True)
class PlacedFrame(Frame):
    """A frame reached by way of another.

    Attributes
    ----------
    base : the cloud's own frame; everything inherited (crs, unit_m ...) is that of the target.
    matrix : 4 x 4, from metres of the base to metres of this frame.
    heights : lowest and highest place of the cloud in this frame, metres.
    ground_factor : length in this frame / length on the ground; None where it is no grid.
    """

    base: Frame = field(default_factory=lambda: Frame(None, "unknown"))
    matrix: Matrix4 = ()
    heights: Tuple[float, float] = (0.0, 0.0)
    ground_factor: Optional[float] = None

    @property
    def is_identity(self) -> bool:
        """Never: there is the matrix."""
        return False

    @property
    def is_upright(self) -> bool:
        """Whether the vertical stays the vertical."""
        turn = np.array(self.matrix)[:3, :3]
        off = np.abs([*turn[:2, 2], *turn[2, :2]]).max()
        return bool(off <= _UPRIGHT * abs(turn[2, 2]))

    def to_frame(
        self, x: FloatArray, y: FloatArray, z: FloatArray
    ) -> Tuple[FloatArray, FloatArray, FloatArray]:
        """Bring coordinates of the cloud to the frame: see :meth:`Frame.to_frame`."""
        return moved(np.array(self.matrix), *self.base.to_frame(x, y, z))

    def window_to_source(self, window: Window) -> Window:
        """Enclose what lies above and below a window of this frame in the cloud's coordinates."""
        back = np.linalg.inv(np.array(self.matrix))
        box = Bounds(
            window.min_x,
            window.min_y,
            self.heights[0],
            window.max_x,
            window.max_y,
            self.heights[1],
        )
        around = _enclosed(back, box)
        more = self._rounding(window, back) + 8.0 * float(
            np.spacing(max(map(abs, (around.min_x, around.min_y, around.max_x, around.max_y))))
        )
        return self.base.window_to_source(
            Window(
                around.min_x - more, around.min_y - more, around.max_x + more, around.max_y + more
            )
        )

    def _rounding(self, window: Window, back: FloatArray) -> float:
        """Bound what rounding here does to the way back: points on an edge are not to be lost."""
        there = (*self.heights, *np.array(self.matrix)[:3, 3])
        edges = (window.min_x, window.min_y, window.max_x, window.max_y)
        return 8.0 * float(np.spacing(max(map(abs, (*edges, *there)))) * np.abs(back[:3, :3]).sum())

    def bounds_to_frame(self, bounds: Bounds) -> Bounds:
        """Enclose bounds of the cloud's own coordinates in bounds of this frame (metres)."""
        return _enclosed(np.array(self.matrix), self.base.bounds_to_frame(bounds))


def placed_frame(
    base: Frame,
    matrix: FloatArray,
    target_crs: Optional[str],
    ground_factor: Optional[float],
    bounds: Bounds,
) -> PlacedFrame:
    """Return the frame of a cloud that goes through a matrix.

    Parameters
    ----------
    matrix : (4, 4), from metres of the base to metres of the target.
    target_crs : None where the cloud stays in a frame of its own; that of the base where it keeps
        it (also its unit then); else a CRS in metres.
    bounds : of the cloud, in its own coordinates.
    """
    own = target_crs is not None and target_crs == base.crs
    box = _enclosed(matrix, base.bounds_to_frame(bounds))
    return PlacedFrame(
        crs=target_crs,
        length_unit="m",
        # That the cloud's unit is unknown no longer matters.
        warnings=base.warnings if base.length_unit != "unknown" else (),
        grid_crs=base.grid_crs if own else None,
        unit_m=base.unit_m if own else 1.0,
        z_unit_m=base.z_unit_m if own else 1.0,
        base=base,
        matrix=tuple(tuple(float(v) for v in row) for row in matrix),
        heights=(box.min_z, box.max_z),
        ground_factor=ground_factor,
    )


def moved(
    matrix: FloatArray, x: FloatArray, y: FloatArray, z: FloatArray
) -> Tuple[FloatArray, FloatArray, FloatArray]:
    """Apply a 4 x 4 matrix to (N,) coordinates."""
    out = []
    for row in matrix[:3]:
        value = row[0] * x
        value += row[1] * y
        value += row[2] * z
        value += row[3]
        out.append(value)
    return out[0], out[1], out[2]


def _enclosed(matrix: FloatArray, box: Bounds) -> Bounds:
    corners = np.array(
        list(product((box.min_x, box.max_x), (box.min_y, box.max_y), (box.min_z, box.max_z)))
    )
    x, y, z = moved(matrix, *corners.T)
    return Bounds(
        float(x.min()),
        float(y.min()),
        float(z.min()),
        float(x.max()),
        float(y.max()),
        float(z.max()),
    )
