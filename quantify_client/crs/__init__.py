"""Every coordinate transformation, unit and grid factor; the only user of pyproj.

:mod:`.projection` holds what is needed of PROJ, :mod:`.frame` the metric frame of a cloud with
where control placed it, :mod:`.choose_frame` how that frame is chosen, :mod:`.ground` the way of
geometries into it and of grid lengths to the ground, :mod:`.positions` that of single points,
:mod:`.local` their way to the ground of one site; :mod:`.statements` brings together what a file
says of its CRS in several places, :mod:`.geokeys` and :mod:`.wkt` read it, :mod:`.same` tells in
what two CRSs differ, :mod:`.plausible` whether a cloud can be where its CRS puts it.
"""

from __future__ import annotations

from .choose_frame import measuring_frame
from .frame import UNITS_M, Frame, apply_matrix, placed_frame
from .ground import (
    cloud_geometry_to_frame,
    geometry_to_frame,
    geometry_to_wgs84,
    grid_scale_factor,
    metres_per_unit,
    transfer_accuracy_m,
)
from .local import LocalFrame, local_frame, utm_grid
from .onto import frame_onto
from .plausible import location_warnings
from .positions import PlaneCoordinates, odm_header, plane_of, positions_to
from .projection import is_geographic, label
from .same import same_coordinates
from .statements import ASSUMED, MergedStatements, Statement, merge_statements, statement_of_cloud
from .wkt import as_wkt, given_crs, require_crs, statement_of_wkt

__all__ = [
    "ASSUMED",
    "UNITS_M",
    "Frame",
    "LocalFrame",
    "PlaneCoordinates",
    "MergedStatements",
    "Statement",
    "apply_matrix",
    "as_wkt",
    "cloud_geometry_to_frame",
    "frame_onto",
    "geometry_to_frame",
    "geometry_to_wgs84",
    "given_crs",
    "grid_scale_factor",
    "is_geographic",
    "label",
    "local_frame",
    "location_warnings",
    "measuring_frame",
    "metres_per_unit",
    "merge_statements",
    "odm_header",
    "placed_frame",
    "plane_of",
    "positions_to",
    "require_crs",
    "same_coordinates",
    "statement_of_cloud",
    "statement_of_wkt",
    "transfer_accuracy_m",
    "utm_grid",
]
