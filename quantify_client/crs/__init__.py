"""Every coordinate transformation, unit and grid factor; the only user of pyproj.

:mod:`.projection` holds what is needed of PROJ, :mod:`.frame` the metric frame of a cloud,
:mod:`.ground` the way of geometries into it and of grid lengths to the ground,
:mod:`.positions` that of single points, :mod:`.local` their way to the ground of one site,
:mod:`.placed` the frame of a cloud that is moved on its way,
:mod:`.onmap` where a web map shows it; :mod:`.statements` brings together
what a file says of its CRS in several places, :mod:`.geokeys` and :mod:`.wkt` read it,
:mod:`.same` tells in what two CRSs differ.
"""

from __future__ import annotations

from .frame import UNITS_M, Frame, measuring_frame
from .ground import (
    cloud_geometry_to_frame,
    geometry_to_frame,
    geometry_to_wgs84,
    grid_scale_factor,
    transfer_accuracy_m,
)
from .local import LocalFrame, local_frame, utm_grid
from .onmap import OnMap, on_map
from .placed import PlacedFrame, placed_frame
from .plausible import doubts
from .positions import Plane, odm_header, plane_of, positions_to
from .projection import is_geographic, label
from .same import same_coordinates
from .statements import ASSUMED, Stated, Statement, merge, stated_by
from .wkt import as_wkt, given_crs, require_crs, statement_of_wkt

__all__ = [
    "ASSUMED",
    "UNITS_M",
    "Frame",
    "LocalFrame",
    "OnMap",
    "PlacedFrame",
    "Plane",
    "Stated",
    "Statement",
    "as_wkt",
    "cloud_geometry_to_frame",
    "doubts",
    "geometry_to_frame",
    "geometry_to_wgs84",
    "given_crs",
    "grid_scale_factor",
    "is_geographic",
    "label",
    "local_frame",
    "measuring_frame",
    "merge",
    "odm_header",
    "on_map",
    "placed_frame",
    "plane_of",
    "positions_to",
    "require_crs",
    "stated_by",
    "same_coordinates",
    "statement_of_wkt",
    "transfer_accuracy_m",
    "utm_grid",
]
