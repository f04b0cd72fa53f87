"""The areas with their numbers as GeoJSON (RFC 7946), for a GIS."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Dict, List, Mapping, Optional, Sequence, Tuple, Union

import shapely
from shapely.geometry.polygon import orient

from ...errors import CrsError
from ...files.writing import GENERATOR
from ...types import AreaFailure, AreaResult, Measurement, Proposal, plain
from .measurement import flat_properties, to_json

if TYPE_CHECKING:
    from ...crs import Frame

__all__ = ["CLOUD_COORDINATES", "outlines_document", "to_geojson"]

CLOUD_COORDINATES = "cloud coordinates, no CRS"
WGS84_DECIMALS = 9  # 0.1 mm on the ground
CLOUD_DECIMALS = 4
OUTLINE_DECIMALS = 6  # of what is measured by again, perhaps a body of centimetres


def to_geojson(measurement: Measurement) -> Dict[str, Any]:
    """Return a FeatureCollection: a feature for each result, failures with geometry null.

    Outlines that were proposed say so (``proposed``, ``kind``, ``height_m``, ``outline_std_m3``:
    how much of the volume is uncertain by where they lie); those of other kinds than piles, which
    are no results, follow, and what to use instead of an outline on a pile.

    Longitude and latitude of WGS 84, outer rings counter-clockwise. Without a CRS the cloud's
    own coordinates, which RFC 7946 does not know: the collection and each feature then say so
    in ``coordinate_reference``.
    """
    frame: Optional[Frame] = measurement.frame
    if frame is None or frame.crs is None:
        frame = None
    results, remark = measurement.results, "" if frame else CLOUD_COORDINATES
    others = [one for one in measurement.proposals if not one.measured]
    try:
        geometries = [_geometry(result, frame) for result in results]
        outlines = [_placed(one.polygon_wkb, frame) for one in others]
    except CrsError as error:  # a report is not lost for it
        remark = f"cloud coordinates: {error}"
        geometries = [_geometry(result, None) for result in results]
        outlines = [_placed(one.polygon_wkb, None) for one in others]
    said = {"coordinate_reference": remark} if remark else {}
    proposed = {one.name: _proposed(one) for one in measurement.proposals}
    rows = [
        {**flat_properties(row), **proposed.get(row["name"], {})}
        for row in to_json(measurement)["results"]
    ]
    rows += [{**proposed[one.name], "area_m2": one.area_m2} for one in others]
    features = [
        {"type": "Feature", "geometry": geometry, "properties": {**row, **said}}
        for geometry, row in zip([*geometries, *outlines], rows)
    ]
    features += [
        {
            "type": "Feature",
            "geometry": _placed(result.relief.proposal_wkb, None if remark else frame),
            "properties": {"name": f"{result.name} (proposed)", "proposed": True, **said},
        }
        for result in results
        if isinstance(result, AreaResult) and result.relief and result.relief.proposal_wkb
    ]
    return {"type": "FeatureCollection", "generator": GENERATOR, **said, "features": features}


def _geometry(
    result: Union[AreaResult, AreaFailure], frame: Optional[Frame]
) -> Optional[Dict[str, Any]]:
    if isinstance(result, AreaFailure) or result.relief is None:
        return None
    return _placed(result.relief.polygon_wkb, frame)


def _proposed(one: Proposal) -> Dict[str, Any]:
    said = {"name": one.name, "kind": one.kind, "height_m": one.height_m, "proposed": True}
    return said if one.outline_std_m3 is None else {**said, "outline_std_m3": one.outline_std_m3}


def _placed(wkb: bytes, frame: Optional[Frame]) -> Dict[str, Any]:
    geometry = shapely.from_wkb(wkb)
    if frame is None:
        return _written(geometry, CLOUD_DECIMALS)
    return _written(_to_wgs84(geometry, frame), WGS84_DECIMALS)


def outlines_document(
    outlines: Sequence[Tuple[Mapping[str, Any], Any]], crs: Optional[str]
) -> Dict[str, Any]:
    """Return polygons and their properties in the coordinates of a cloud.

    Parameters
    ----------
    outlines : properties, and a shapely Polygon or MultiPolygon in coordinates of `crs`.
    crs : ``EPSG:n`` or WKT, x and y in this order; it stands in the ``crs`` member of the 2008
        specification, as GIS programs read and write it. None: the cloud has none, and the
        collection says so.
    """
    collection: Dict[str, Any] = {"type": "FeatureCollection", "generator": GENERATOR}
    if crs is None:
        collection["coordinate_reference"] = CLOUD_COORDINATES
    else:
        urn = f"urn:ogc:def:crs:EPSG::{crs[5:]}" if crs.upper().startswith("EPSG:") else crs
        collection["crs"] = {"type": "name", "properties": {"name": urn}}
    features = [
        {
            "type": "Feature",
            "properties": plain(properties),
            "geometry": _written(geometry, OUTLINE_DECIMALS),
        }
        for properties, geometry in outlines
    ]
    return {**collection, "features": features}


def _written(geometry: Any, decimals: int) -> Dict[str, Any]:
    parts = [_rings(orient(part, 1.0), decimals) for part in shapely.get_parts(geometry)]
    if len(parts) == 1:
        return {"type": "Polygon", "coordinates": parts[0]}
    return {"type": "MultiPolygon", "coordinates": parts}


def _to_wgs84(geometry: Any, frame: Frame) -> Any:
    from ...crs import geometry_to_wgs84

    return geometry_to_wgs84(geometry, frame)


def _rings(polygon: Any, decimals: int) -> List[List[List[float]]]:
    rings = [polygon.exterior, *polygon.interiors]
    return [
        [[round(x, decimals), round(y, decimals)] for x, y, *_ in ring.coords] for ring in rings
    ]
