"""What a control file may contain: its keys, the headings of tables, units, and limits."""

from __future__ import annotations

from typing import Mapping, Tuple

__all__ = [
    "CLOUD_KEYS",
    "CONTROL_KEYS",
    "DISTANCE_KEYS",
    "LENGTH_KEYS",
    "MAX_ELEVATION_M",
    "MAX_LENGTHS",
    "MAX_LENGTH_M",
    "MAX_NAME",
    "MAX_PATH",
    "MAX_POINTS",
    "MIN_ACCURACY",
    "MIN_LENGTH_M",
    "PLACE_KEYS",
    "POINT_KEYS",
    "UNITS",
    "UNIT_WORDS",
    "Keys",
]

Keys = Mapping[str, Tuple[str, ...]]
"""Keys of an entry, and the headings that tables have for each, in lower case, the best first."""

#: The file itself; after each key other spellings, which are refused with a hint.
CONTROL_KEYS: Keys = {
    "crs": ("srs", "epsg"),
    "unit": ("units",),
    "height": (),
    "points": ("gcps",),
    "distances": ("lengths", "tapes"),
    "cloud": (),
    "images": ("picks", "photographs"),
    "scale_bars": ("bars", "scalebars"),
}

_X = ("x", "easting", "east", "e")
_Y = ("y", "northing", "north", "n")
_ACCURACY = ("accuracy", "sigma", "std")
POINT_KEYS: Keys = {
    "lat": ("lat", "latitude"),
    "lon": ("lon", "lng", "longitude", "long"),
    "easting": _X,
    "northing": _Y,
    "accuracy": _ACCURACY,
    "elevation": ("elevation", "elev", "z", "height", "altitude", "alt", "h"),
    "elevation_accuracy": ("elevation accuracy", "z accuracy", "vertical accuracy"),
}
DISTANCE_KEYS: Keys = {
    "from": ("from", "start"),
    "to": ("to", "end"),
    "length": ("length", "distance", "slope distance", "dist"),
    "accuracy": _ACCURACY,
    "higher": ("higher",),
    "check": ("check",),
}
CLOUD_KEYS: Keys = {"x": _X, "y": _Y, "z": ("z", "elevation", "elev"), "accuracy": _ACCURACY}

#: The parts that hold lengths.
LENGTH_KEYS: Mapping[str, Keys] = {
    "distances": DISTANCE_KEYS,
    "scale_bars": {key: DISTANCE_KEYS[key] for key in ("from", "to", "length", "accuracy")},
}
PLACE_KEYS: Keys = {"xyz": ("x", "y", "z"), "accuracy": ()}

UNITS = ("m", "ft", "us-ft")  # what tapes and surveys come in
UNIT_WORDS = {
    **dict.fromkeys(("metre", "metres", "meter", "meters"), "m"),
    **dict.fromkeys(("foot", "feet", "ift", "international foot"), "ft"),
    **dict.fromkeys(("us-foot", "usft", "ftus", "us_ft", "us ft", "survey foot"), "us-ft"),
}

MAX_NAME = 100  # characters
MIN_LENGTH_M, MAX_LENGTH_M = 1e-6, 100_000.0
MIN_ACCURACY = 1e-9  # its square still counts as a weight beside all others
MAX_ELEVATION_M = 20_000.0
MAX_POINTS = 2_000
MAX_LENGTHS = 20_000
MAX_PATH = 1_000
