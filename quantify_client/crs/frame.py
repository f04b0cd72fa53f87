"""The metric frame of a cloud, with where control placed it.

Metres, x and y on a map grid (or in no CRS at all), z up.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Optional, Sequence, Tuple

import numpy as np

from ..types import Bounds, FloatArray, Matrix4, Window
from .projection import full_turn, is_geographic, transform

__all__ = ["UNITS_M", "ControlPlacement", "Frame", "apply_matrix", "placed_frame"]

UNITS_M = {"m": 1.0, "cm": 0.01, "mm": 0.001, "ft": 0.3048, "us-ft": 1200 / 3937}

# Enclosing boxes are sampled at 21 x 21 points and grown by this share of their width, which is
# more than a meridian or parallel bends between two samples up to a width of 500 km.
_ENCLOSE = 1e-3
# Below this slope (1 mm at 1 km) the vertical of both frames is the same.
_UPRIGHT = 1e-6

XYZ = Tuple[FloatArray, FloatArray, FloatArray]


@dataclass(frozen=True)
class ControlPlacement:
    """How control placed a cloud: from the frame it was delivered in, by one matrix.

    Attributes
    ----------
    delivered : the frame of the cloud as it was delivered.
    matrix : 4 x 4, from metres of that frame to metres of the new one.
    heights : lowest and highest place of the cloud in the new frame, metres.
    ground_factor : length in the new frame / length on the ground; None where it is no grid.
    """

    delivered: Frame
    matrix: Matrix4
    heights: Tuple[float, float]
    ground_factor: Optional[float] = None


@dataclass(frozen=True)
class Frame:
    """The metric frame in which a cloud is measured.

    Attributes
    ----------
    crs : ``EPSG:n`` where that is certain, else WKT; None for a cloud without one. For a grid in
        feet this is the cloud's CRS while the frame's coordinates are its metres (feet x factor).
    length_unit : ``"m"``, or ``"unknown"`` when nobody said.
    warnings : what was assumed, a :class:`~quantify_client.types.Notice` each.
    grid_crs : complete definition of the grid (WKT, with TOWGS84 if any); None means ``crs``.
    geographic_crs : the cloud's own CRS when its coordinates are angles, or when it is measured on
        the grid of another cloud; else None.
    unit_m, z_unit_m : metres per unit of the grid, and of the cloud's z (negative: depths).
    center_lon : longitude round which the cloud counts (geographic clouds only).
    placement : how control placed the cloud here; None where it stays as it was delivered. With
        one, all of the above is that of the frame to which the cloud has been moved.
    """

    crs: Optional[str]
    length_unit: str
    warnings: Sequence[str] = ()
    grid_crs: Optional[str] = None
    geographic_crs: Optional[str] = None
    unit_m: float = 1.0
    z_unit_m: float = 1.0
    center_lon: float = 0.0
    placement: Optional[ControlPlacement] = None

    @property
    def is_identity(self) -> bool:
        """True when the cloud's own coordinates are the frame's."""
        return (
            self.placement is None
            and self.geographic_crs is None
            and self.unit_m == 1.0
            and self.z_unit_m == 1.0
        )

    @property
    def delivered(self) -> Frame:
        """The frame of the cloud as it was delivered: this one where control did not move it."""
        return self if self.placement is None else self.placement.delivered

    @property
    def matrix(self) -> FloatArray:
        """(4, 4), from metres of :attr:`delivered` to metres of this frame."""
        return np.eye(4) if self.placement is None else np.array(self.placement.matrix)

    @property
    def is_upright(self) -> bool:
        """True when the vertical is that of the delivered cloud."""
        turn = self.matrix[:3, :3]
        off = np.abs([*turn[:2, 2], *turn[2, :2]]).max()
        return bool(off <= _UPRIGHT * abs(turn[2, 2]))

    @property
    def grid(self) -> Optional[str]:
        """The grid's definition: frame coordinates / ``unit_m`` are coordinates in it."""
        return self.grid_crs if self.grid_crs is not None else self.crs

    @property
    def cloud_crs(self) -> Optional[str]:
        """The horizontal CRS of the cloud's own coordinates."""
        return self.geographic_crs if self.geographic_crs is not None else self.grid

    def elevation(self, delivered_z: float, x: float, y: float) -> float:
        """Return where an elevation of the delivered cloud lies in this frame.

        Parameters
        ----------
        delivered_z, x, y : in :attr:`delivered`, metres; a level of a tilted cloud is tilted, so
            it counts where it is.
        """
        if self.placement is None:
            return delivered_z
        row = self.placement.matrix[2]
        return float(row[0] * x + row[1] * y + row[2] * delivered_z + row[3])

    def to_frame(self, x: FloatArray, y: FloatArray, z: FloatArray) -> XYZ:
        """Bring coordinates of the cloud to the frame; safe to call from several threads.

        Parameters
        ----------
        x, y, z : (N,) float64, finite, in the cloud's own coordinates.

        Returns
        -------
        x, y, z : (N,) float64, metres. The very same arrays when :attr:`is_identity`.

        Raises
        ------
        CrsError
            When a point cannot be projected.
        """
        if self.placement is not None:
            return apply_matrix(self.matrix, *self.delivered.to_frame(x, y, z))
        if self.geographic_crs is not None and self.grid is not None:
            x, y = transform(self.geographic_crs, self.grid, x, y)
        return _scaled(x, self.unit_m), _scaled(y, self.unit_m), _scaled(z, self.z_unit_m)

    def window_to_source(self, window: Window) -> Window:
        """Enclose what lies above and below a window of the frame (metres) in the cloud's own x, y.

        Whatever the rounding, no point of the cloud within the window is outside the result.
        """
        if self.placement is not None:
            return self.delivered.window_to_source(_moved_back(self.placement, window))
        unit = self.unit_m
        if self.geographic_crs is None or self.grid is None:
            if unit == 1.0:
                return window
            x, y = np.array([[window.min_x, window.max_x], [window.min_y, window.max_y]])
            return _enclosing(x / unit, y / unit, grow=0.0)
        x, y = _samples(window)
        lon, lat = transform(self.grid, self.geographic_crs, x / unit, y / unit)
        if is_geographic(self.geographic_crs):
            turn = full_turn(self.geographic_crs)
            # Clouds count 0..360 or -180..180, and some lie across the date line.
            lon = (lon - self.center_lon + turn / 2) % turn + self.center_lon - turn / 2
        return _enclosing(lon, lat, grow=_ENCLOSE)

    def bounds_to_frame(self, bounds: Bounds) -> Bounds:
        """Enclose bounds of the cloud's own coordinates in bounds of the frame (metres)."""
        if self.placement is not None:
            return _box_of(self.matrix, self.delivered.bounds_to_frame(bounds))
        if self.is_identity:
            return bounds
        low_z, high_z = sorted((bounds.min_z * self.z_unit_m, bounds.max_z * self.z_unit_m))
        window = Window(bounds.min_x, bounds.min_y, bounds.max_x, bounds.max_y)
        if self.geographic_crs is not None and self.grid is not None:
            x, y = transform(self.geographic_crs, self.grid, *_samples(window))
            window = _enclosing(x, y, grow=_ENCLOSE)
        unit = self.unit_m
        return Bounds(
            window.min_x * unit,
            window.min_y * unit,
            low_z,
            window.max_x * unit,
            window.max_y * unit,
            high_z,
        )


def placed_frame(
    delivered: Frame,
    matrix: FloatArray,
    target_crs: Optional[str],
    ground_factor: Optional[float],
    bounds: Bounds,
) -> Frame:
    """Return the frame of a cloud that control moved by a matrix.

    Parameters
    ----------
    matrix : (4, 4), from metres of the delivered frame to metres of the target.
    target_crs : None where the cloud stays in a frame of its own; that of the delivered frame
        where it keeps it (also its unit then); else a CRS in metres.
    bounds : of the cloud, in its own coordinates.
    """
    own = target_crs is not None and target_crs == delivered.crs
    box = _box_of(matrix, delivered.bounds_to_frame(bounds))
    rows = tuple(tuple(float(v) for v in row) for row in matrix)
    return Frame(
        crs=target_crs,
        length_unit="m",
        # That the cloud's unit is unknown no longer matters.
        warnings=delivered.warnings if delivered.length_unit != "unknown" else (),
        grid_crs=delivered.grid_crs if own else None,
        unit_m=delivered.unit_m if own else 1.0,
        z_unit_m=delivered.z_unit_m if own else 1.0,
        placement=ControlPlacement(delivered, rows, (box.min_z, box.max_z), ground_factor),
    )


def apply_matrix(matrix: FloatArray, x: FloatArray, y: FloatArray, z: FloatArray) -> XYZ:
    """Apply a 4 x 4 matrix to (N,) coordinates."""
    out = []
    for row in matrix[:3]:
        value = row[0] * x
        value += row[1] * y
        value += row[2] * z
        value += row[3]
        out.append(value)
    return out[0], out[1], out[2]


def _box_of(matrix: FloatArray, box: Bounds) -> Bounds:
    """Enclose a box that went through a matrix."""
    corners = product((box.min_x, box.max_x), (box.min_y, box.max_y), (box.min_z, box.max_z))
    moved = apply_matrix(matrix, *np.array(list(corners)).T)
    return Bounds(*(float(v.min()) for v in moved), *(float(v.max()) for v in moved))


def _moved_back(placement: ControlPlacement, window: Window) -> Window:
    """Enclose what lies above and below a window in one of the delivered frame."""
    matrix = np.array(placement.matrix)
    back = np.linalg.inv(matrix)
    low, high = placement.heights
    box = _box_of(back, Bounds(window.min_x, window.min_y, low, window.max_x, window.max_y, high))
    around = np.array([box.min_x, box.min_y, box.max_x, box.max_y])
    # What rounding does to the way there and back: points on an edge are not to be lost.
    edges = (window.min_x, window.min_y, window.max_x, window.max_y, low, high, *matrix[:3, 3])
    rounding = np.spacing(max(map(abs, edges))) * np.abs(back[:3, :3]).sum()
    more = float(8.0 * rounding) + 8.0 * float(np.spacing(np.abs(around).max()))
    return Window(*map(float, around + more * np.array([-1, -1, 1, 1])))


def _scaled(values: FloatArray, factor: float) -> FloatArray:
    return values if factor == 1.0 else values * factor


def _samples(window: Window) -> Tuple[FloatArray, FloatArray]:
    """(441,) x and y, spread over a window with its edges."""
    x, y = np.meshgrid(
        np.linspace(window.min_x, window.max_x, 21), np.linspace(window.min_y, window.max_y, 21)
    )
    return x.ravel(), y.ravel()


def _enclosing(x: FloatArray, y: FloatArray, grow: float) -> Window:
    """Box round coordinates, grown by a share of its size and by the rounding of the division."""
    places = np.column_stack([x, y])
    low, high = places.min(axis=0), places.max(axis=0)
    more = grow * (high - low) + 4 * np.maximum(np.spacing(abs(low)), np.spacing(abs(high)))
    return Window(*map(float, (*(low - more), *(high + more))))
