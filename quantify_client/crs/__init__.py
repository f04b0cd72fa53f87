"""Every coordinate transformation, unit and grid factor; the only user of pyproj.

:mod:`.projection` holds what is needed of PROJ, :mod:`.frame` the metric frame of a cloud,
:mod:`.ground` the way of geometries into it and of grid lengths to the ground.
"""

from __future__ import annotations

from .frame import Frame, measuring_frame
from .ground import (
    cloud_geometry_to_frame,
    geometry_to_frame,
    geometry_to_wgs84,
    grid_scale_factor,
    transfer_accuracy_m,
)
from .projection import is_geographic

__all__ = [
    "Frame",
    "cloud_geometry_to_frame",
    "geometry_to_frame",
    "geometry_to_wgs84",
    "grid_scale_factor",
    "is_geographic",
    "measuring_frame",
    "transfer_accuracy_m",
]
