"""The inputs of a measurement: area, control and name, of a request or of a saved file, checked."""

import hashlib
import json
import math
import re
import unicodedata

from ..quantify_client.types.shapes import Listed, MisshapenError, Number, Record, Text
from .folders import KEPT_DAYS, QUEUED_LOST_S

__all__ = [
    "LIMITS",
    "MOST_CRS",
    "area_key",
    "checked_area",
    "checked_control",
    "checked_name",
    "in_panel_words",
]

LIMITS = {
    "area_bytes": 1_000_000,
    "vertices": 10_000,
    "control_bytes": 200_000,
    "jobs": 2,
    "queued_lost_after_s": QUEUED_LOST_S,
    "kept_days": KEPT_DAYS,
}

_MOST_POLYGONS = 100
_NAME = 80
MOST_CRS = 4000

_PLACE = Listed(Number(-180, 180), 3, 2)
_BARS = Record(
    {
        "scale_bars": Listed(
            Record(
                {
                    "from": _PLACE,
                    "to": _PLACE,
                    "length_m": Number(above=0, most=100_000),
                    "accuracy_m": Number(above=0, most=1000),
                },
                others="refuse",
            ),
            50,
            1,
        )
    },
    others="refuse",
)
_CONTROL_NAME = Text(most=255)
_CONTROL_ENDINGS = (".yaml", ".yml", ".json", ".csv", ".txt")
_LON_LAT = ("CRS84", "4326")

#: The panel's names of command line options that messages of the library mention.
_FIELDS = {
    "--crs": "\u201cCoordinate system\u201d",
    "--toe": "\u201cMove each outline to the toe\u201d",
    "--layer": "\u201cTwo surfaces in one place\u201d",
    "--vertical-unit": "\u201cUnit of heights\u201d",
    "--source-unit": "\u201cUnit of lengths\u201d",
    "--gcp": "control",
}


def in_panel_words(text):
    """Return a message of the library with the panel's names of options."""
    text = re.sub(r"(?<![\w-])--[a-z-]+", lambda name: _FIELDS.get(name[0], name[0]), text)
    return re.sub(r"(?<![\w-])--(?=[a-z])", "", text)


def checked_control(control):
    """Return control as {"text", "name"} or {"scale_bars"}, or None."""
    if control is None:
        return None
    if not isinstance(control, dict):
        raise MisshapenError("control has to be an object with a text or with scale_bars")
    if "scale_bars" in control:
        return _BARS.clean(control, "control")
    most = LIMITS["control_bytes"]
    shape = Record({"text": Text(most=most, least=1), "name": _CONTROL_NAME}, ("text",))
    given = shape.clean(control, "control")
    if len(given["text"].encode("utf-8", "replace")) > most:
        raise MisshapenError(f"the control file is larger than {most} bytes")
    name = given.get("name", "control.yaml").lower()
    # The ending tells the format; nothing else of the name is kept.
    ending = next((end for end in _CONTROL_ENDINGS if name.endswith(end)), None)
    if ending is None:
        raise MisshapenError(f"the control file has to end in {', '.join(_CONTROL_ENDINGS)}")
    return {"text": given["text"], "name": f"control{ending}"}


def checked_name(name):
    """Return a name on one line, without what steers a reader."""
    if not isinstance(name, str):
        raise MisshapenError("name has to be a text")
    kept = "".join(c for c in " ".join(name[:1000].split()) if unicodedata.category(c)[0] != "C")
    kept = kept[:_NAME].strip()
    if not kept:
        raise MisshapenError("name is empty; give the measurement a name")
    return kept


def checked_area(area):
    """Return GeoJSON in longitude and latitude as a FeatureCollection of polygons with names."""
    if len(json.dumps(area)) > LIMITS["area_bytes"]:
        raise MisshapenError(f"the area is larger than {LIMITS['area_bytes']} bytes; simplify it")
    features = [
        {"type": "Feature", "properties": said, "geometry": geometry}
        for said, geometry in _polygons(area, {"name": None}, 0)
    ]
    if not features:
        raise MisshapenError("the area holds no polygon; draw one round what is to be measured")
    if len(features) > _MOST_POLYGONS:
        raise MisshapenError(f"the area holds more than {_MOST_POLYGONS} polygons; keep fewer")
    vertices = sum(_vertices(feature["geometry"]["coordinates"]) for feature in features)
    if vertices > LIMITS["vertices"]:
        raise MisshapenError(
            f"the area has {vertices} vertices; at most {LIMITS['vertices']} can be measured: "
            "simplify it"
        )
    return {"type": "FeatureCollection", "features": features}


def area_key(area):
    """Return the same short text for the same area, whatever it is called."""
    if area is None:
        return "whole"
    geometries = [feature["geometry"] for feature in area["features"]]
    text = json.dumps(_rounded(geometries), sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _rounded(value):
    if isinstance(value, dict):
        return {key: _rounded(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_rounded(item) for item in value]
    return round(float(value), 9) + 0.0 if isinstance(value, (int, float)) else value


def _polygons(node, said, depth):
    """Yield the properties that are kept and the geometry of every polygon."""
    if depth > 8 or not isinstance(node, dict):
        raise MisshapenError("the area is not GeoJSON; expected a FeatureCollection with polygons")
    _require_lon_lat(node.get("crs"))
    kind = node.get("type")
    if kind == "FeatureCollection":
        for feature in _members(node, "features"):
            yield from _polygons(feature, {"name": None}, depth + 1)
    elif kind == "Feature":
        if node.get("geometry") is not None:
            yield from _polygons(node["geometry"], _kept(node.get("properties")), depth + 1)
    elif kind == "GeometryCollection":
        for geometry in _members(node, "geometries"):
            yield from _polygons(geometry, said, depth + 1)
    elif kind == "Polygon":
        yield said, {"type": kind, "coordinates": _rings(node.get("coordinates"))}
    elif kind == "MultiPolygon":
        parts = [_rings(part) for part in _members(node, "coordinates")]
        if parts:
            yield said, {"type": kind, "coordinates": parts}
    elif depth == 0:
        raise MisshapenError("the area is no polygon; draw one round what is to be measured")


def _members(node, key):
    members = node.get(key)
    if not isinstance(members, list):
        raise MisshapenError(f"the area has a {node.get('type')} without {key}")
    return members


def _kept(properties):
    """Return the name, and how well the outline of a pile is known that was proposed."""
    said = {"name": _label(properties)}
    if not isinstance(properties, dict) or properties.get("proposed") is not True:
        return said
    if properties.get("kind") == "pile":
        said.update(proposed=True, kind="pile")
        for key in ("height_m", "outline_std_m3"):
            value = properties.get(key)
            number = isinstance(value, (int, float)) and not isinstance(value, bool)
            if number and math.isfinite(value):
                said[key] = value
    return said


def _label(properties):
    for key in ("name", "Name", "NAME"):
        value = properties.get(key) if isinstance(properties, dict) else None
        if isinstance(value, (str, int, float)) and not isinstance(value, bool):
            try:
                return checked_name(str(value))
            except MisshapenError:
                continue
    return None


def _require_lon_lat(crs):
    if crs is not None and not any(word in json.dumps(crs) for word in _LON_LAT):
        raise MisshapenError(
            "the area is not in longitude and latitude; export it as GeoJSON in WGS 84 (EPSG:4326)"
        )


def _rings(rings):
    if not isinstance(rings, list) or not rings:
        raise MisshapenError("the area has a polygon without a ring")
    return [_ring(ring) for ring in rings]


def _ring(ring):
    if not isinstance(ring, list) or len(ring) < 3:
        raise MisshapenError("the area has a ring of fewer than 3 corners; redraw it")
    corners = [_corner(corner) for corner in ring]
    return corners if corners[0] == corners[-1] else [*corners, corners[0]]


def _corner(corner):
    if not isinstance(corner, list) or len(corner) < 2:
        raise MisshapenError("the area has a corner that is not [longitude, latitude]")
    for value, most in zip(corner, (180, 90)):
        number = isinstance(value, (int, float)) and not isinstance(value, bool)
        # "not within" also catches NaN; comparing avoids converting huge integers to float.
        if not number or not -most <= value <= most:
            raise MisshapenError(
                "the area has a corner that is no longitude and latitude; "
                "export it as GeoJSON in WGS 84 (EPSG:4326)"
            )
    return [float(corner[0]), float(corner[1])]


def _vertices(coordinates):
    if coordinates and isinstance(coordinates[0], (int, float)):
        return 1
    return sum(_vertices(inner) for inner in coordinates)
