"""Polygons drawn on the example survey, as GeoJSON."""

import shapely

from quantify_client.crs import geometry_to_wgs84

X, Y = 576700.0, 5188140.0
SQUARE = [[X, Y], [X + 10, Y], [X + 10, Y + 10], [X, Y + 10], [X, Y]]
HOLE = [[X + 4, Y + 4], [X + 6, Y + 4], [X + 6, Y + 6], [X + 4, Y + 6], [X + 4, Y + 4]]


def polygon(*rings):
    return {"type": "Polygon", "coordinates": list(rings) or [SQUARE]}


def feature(geometry, **properties):
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def collection(*features, **members):
    return {"type": "FeatureCollection", "features": list(features), **members}


def lonlat(frame, ring=SQUARE):
    moved = geometry_to_wgs84(shapely.Polygon(ring), frame)
    return [list(c) for c in moved.exterior.coords]


def only(area_set):
    (area,) = area_set.areas
    return area
