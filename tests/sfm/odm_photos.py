"""Synthetic photographs of a site: the two files that ODM writes of them, and picks in them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Dict, List, Mapping, Optional, Sequence, Tuple

import numpy as np
from scipy.spatial.transform import Rotation

from quantify_client.scaler.control.model import Pick
from quantify_client.sfm.photos.camera_models import Camera, project
from quantify_client.sfm.photos.cameras import Shot, Shots, read_shots

SITE = np.array([437_000.0, 4_572_800.0, 210.0])  # UTM-sized
NAME = "v2 maker model 4000 3000 brown 0.85"

CAMERAS: Mapping[str, Camera] = {
    "perspective": Camera("c", "perspective", 4000, 3000, {"focal": 0.85, "k1": -0.1, "k2": 0.02}),
    "brown": Camera(
        "c",
        "brown",
        4000,
        3000,
        {
            **{"focal_x": 0.85, "focal_y": 0.86, "c_x": 0.0144, "c_y": -0.0082},
            **{"k1": -0.1, "k2": 0.03, "k3": -0.004, "p1": -0.0027, "p2": 0.0064},
        },
    ),
    "fisheye": Camera("c", "fisheye", 4000, 3000, {"focal": 0.45, "k1": -0.02, "k2": 0.002}),
    "fisheye_opencv": Camera(
        "c",
        "fisheye_opencv",
        3000,
        4000,
        {
            **{"focal_x": 0.45, "focal_y": 0.46, "c_x": 0.01, "c_y": -0.02},
            **{"k1": -0.02, "k2": 0.003, "k3": 0.001, "k4": -0.0002},
        },
    ),
    "spherical": Camera("c", "spherical", 4000, 2000, {}),
}


def feature(
    image: str, centre: Sequence[float], turn: Sequence[float], **changes: Any
) -> Dict[str, Any]:
    """One shot as opendm/shots.py writes it; a change to None removes a property."""
    properties = {
        "filename": image,
        "camera": NAME,
        "focal": 0.85,
        "width": 4000,
        "height": 3000,
        "capture_time": 1467197388.0,
        "translation": [float(value) for value in centre],
        "rotation": [float(value) for value in turn],
        **changes,
    }
    properties = {key: value for key, value in properties.items() if value is not None}
    point = {"type": "Point", "coordinates": [-81.75, 41.3, 340.0]}
    return {"type": "Feature", "properties": properties, "geometry": point}


def camera_entry(camera: Camera) -> Dict[str, Any]:
    size = {"width": camera.width, "height": camera.height}
    return {"projection_type": camera.projection, **size, **camera.parameters}


def write_shots(
    folder: Path, features: Sequence[Any], cameras: Optional[Mapping[str, Any]] = None
) -> Tuple[Path, Path]:
    """Both files in their places in an ODM output; one plain brown camera if none is given."""
    if cameras is None:
        cameras = {NAME[3:]: {**camera_entry(CAMERAS["brown"]), "focal_x": 0.85}}
    shots = folder / "odm_report" / "shots.geojson"
    shots.parent.mkdir(parents=True, exist_ok=True)
    shots.write_text(json.dumps({"type": "FeatureCollection", "features": list(features)}))
    (folder / "cameras.json").write_text(json.dumps(cameras, indent=4))
    return shots, folder / "cameras.json"


def flight(folder: Path, camera: Camera = CAMERAS["brown"], rows: int = 4, seed: int = 1) -> Shots:
    """A grid of photographs 60 m above the site, tilted by a few degrees, through the files."""
    random = np.random.default_rng(seed)
    down = Rotation.from_rotvec([np.pi, 0, 0])
    features = []
    for row in range(rows):
        for column in range(rows):
            place = np.array([column - (rows - 1) / 2, row - (rows - 1) / 2, 0]) * 18.0
            centre = SITE + place + [0, 0, 60] + random.normal(0, 1, 3)
            heading = Rotation.from_euler("z", 180 * (row % 2) + random.normal(0, 4), degrees=True)
            tilt = Rotation.from_euler("xy", random.normal(0, 5, 2), degrees=True)
            size = {"width": camera.width, "height": camera.height}
            focal = camera.parameters.get("focal", camera.parameters.get("focal_x"))
            rotation = (tilt * heading * down).as_rotvec()
            name = f"IMG_{row}{column}.JPG"
            features.append(feature(name, centre, rotation, **size, focal=focal))
    return read_shots(*write_shots(folder, features, {NAME[3:]: camera_entry(camera)}))


def seen(shot: Shot, xyz: np.ndarray) -> np.ndarray:
    """Pixel (2,) of a point of the world; NaN outside of the photograph and at its very edge."""
    pixel = project(shot.camera, shot.rotation @ (xyz - shot.centre))[0]
    size = np.array([shot.camera.width, shot.camera.height])
    return pixel if np.all((pixel > 5) & (pixel < size - 5)) else np.full(2, np.nan)


def picks_of(
    shots: Shots,
    name: str,
    xyz: np.ndarray,
    most: int = 4,
    sigma: float = 0.0,
    seed: int = 0,
) -> List[Pick]:
    """Picks of a point in at most `most` photographs chosen at random, each with its noise."""
    random = np.random.default_rng(seed)
    images = [shot for shot in shots.by_image.values() if np.isfinite(seen(shot, xyz)).all()]
    chosen = [images[index] for index in sorted(random.permutation(len(images))[:most])]
    picks = []
    for shot in chosen:
        px, py = seen(shot, xyz) + random.normal(0, sigma, 2)
        picks.append(Pick(name, shot.image, float(px), float(py)))
    return picks
