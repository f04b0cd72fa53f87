"""Clouds of the wrong size, and the control that tells their true one."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Dict, Optional, Sequence

import numpy as np
import pyproj
from terrains import EAST, LEVEL, MIDDLE, NORTH

UTM = "EPSG:32615"
CENTRE = np.array([EAST + MIDDLE, NORTH + MIDDLE, LEVEL])
_R = 6_378_137.0


def ground_factor(height: float = LEVEL) -> float:
    """Grid length / ground length on UTM's central meridian, from its definition: 0.9996 there."""
    e2 = 0.00669437999014
    lat = np.radians(45.15)
    radius = _R * np.sqrt(1 - e2) / (1 - e2 * np.sin(lat) ** 2)
    return float(0.9996 * radius / (radius + height))


def on_ground(points: np.ndarray) -> np.ndarray:
    """Places of the grid as metres on the ground about the centre."""
    return (points - CENTRE) / [ground_factor(), ground_factor(), 1.0]


def marks(height: Any, count: int = 8, seed: int = 4) -> np.ndarray:
    """(count, 3) places on a terrain's surface, in the grid."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(2, 38, (2, count))
    return np.column_stack([x + EAST, y + NORTH, height(x, y) + LEVEL])


def names_of(places: Sequence[Any]) -> Sequence[str]:
    return [f"M{i}" for i in range(len(places))]


def control(
    truth: np.ndarray,
    cloud: Optional[np.ndarray],
    *,
    tapes: int = 12,
    tape: float = 0.005,
    gps: Optional[float] = None,
    levels: int = 0,
    level: float = 0.01,
    noise: bool = True,
    seed: int = 9,
    **more: Any,
) -> Dict[str, Any]:
    """A control file: marks where they truly are (grid), and where the cloud has them."""
    rng = np.random.default_rng(seed)
    names, ground = names_of(truth), on_ground(truth)
    first, second = np.triu_indices(len(truth), 1)
    apart = np.linalg.norm(ground[first] - ground[second], axis=1)
    chosen = np.argsort(-apart)[:tapes]
    document: Dict[str, Any] = {"unit": "m", **more}
    if cloud is not None:
        document["cloud"] = {
            name: {"xyz": [float(v) for v in place], "accuracy": 0.005}
            for name, place in zip(names, cloud)
        }
    document["distances"] = [
        {
            "from": names[first[i]],
            "to": names[second[i]],
            "length": float(apart[i] + noise * rng.normal(0, tape)),
            "accuracy": tape,
        }
        for i in chosen
    ]
    if gps is not None:
        lon, lat = pyproj.Transformer.from_crs(UTM, 4326, always_xy=True).transform(
            *(truth[:, :2] + noise * rng.normal(0, gps, (len(truth), 2))).T
        )
        document["crs"] = "EPSG:4326"
        document["points"] = {
            name: {"lat": float(lat[i]), "lon": float(lon[i]), "accuracy": gps}
            for i, name in enumerate(names)
        }
        for i, name in enumerate(names[:levels]):
            height = float(truth[i, 2] + noise * rng.normal(0, level))
            document["points"][name].update(elevation=height, elevation_accuracy=level)
    return document


def write(path: Path, document: Dict[str, Any]) -> Path:
    """JSON, which is YAML as well."""
    path.write_text(json.dumps(document))
    return path
