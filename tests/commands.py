"""What tests of the command line share: a pile, its outline, and what they look at."""

import json
from pathlib import Path

from shapely.geometry import mapping
from terrains import cone, flat

import quantify_client

PILE = cone(radius=8.0, top=4.0).on(flat)
UTM = "EPSG:32615"
SCHEMA = json.loads(
    (Path(quantify_client.__file__).parent / "report/document/schema.json").read_text()
)


def features(*polygons, names=(), crs=UTM):
    """A GeoJSON text with one feature for each polygon."""
    names = [*names, *[None] * len(polygons)]
    document = {
        "type": "FeatureCollection",
        "features": [
            {
                "type": "Feature",
                "properties": {} if name is None else {"name": name},
                "geometry": mapping(polygon),
            }
            for polygon, name in zip(polygons, names)
        ],
    }
    if crs:
        document["crs"] = {"type": "name", "properties": {"name": crs}}
    return json.dumps(document)


def only(document):
    (result,) = document["results"]
    return result


def texts(part):
    """Return the sentences of a document's, or of a result's, warnings."""
    return [warning["text"] for warning in part["warnings"]]
