"""A site of known volume as OpenDroneMap would deliver it: too small, and beside its true place.

A cone on a slope, in true metres on the ground. Its reconstruction in UTM is 3 % too small, and has
photographs, cameras, a LAZ and an EPT set; picks of marks in the photographs, taped distances and
positions by phone tell its true size.
"""

from __future__ import annotations

import io
import json
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Dict, List

import numpy as np
import pyproj
import shapely.affinity
from clouds import write_ept, write_las
from photographs import photograph
from sfm.odm_photos import SITE, flight, picks_of
from shapely.geometry import mapping
from terrains import EAST, LEVEL, MIDDLE, NORTH, Errors, circle, cone, survey, tilted

UTM = "EPSG:32617"
SHRUNK = 0.97
TERRAIN = cone(radius=8.0, top=4.0).on(tilted)
VOLUME_M3 = TERRAIN.volume
CENTRE = np.array([EAST + MIDDLE, NORTH + MIDDLE, LEVEL])
PHONE_M, TAPE_M, PICK_PX = 3.0, 0.005, 0.3


@dataclass(frozen=True)
class KnownTask:
    """The files: what a node makes (`project`, `archive`), and what a person has (the rest)."""

    project: Path
    archive: bytes
    photos: List[Path]
    control: Path
    area: Path


def make_task(folder: Path) -> KnownTask:
    """Write everything below a folder."""
    project = folder / "made"
    model = project / "odm_georeferencing" / "odm_georeferenced_model.laz"
    model.parent.mkdir(parents=True)
    points = survey(TERRAIN.height, Errors(0.01, 0.0), 40_000)
    write_las(model, delivered(points))
    (model.parent / "coords.txt").write_text("WGS84 UTM 17N\n437000 4572800\n")
    wkt = {"wkt": pyproj.CRS(UTM).to_wkt()}
    write_ept(project / "entwine_pointcloud", delivered(points), srs=wkt)
    shots = flight(project)
    taken = [(name, shot.centre[None, :2]) for name, shot in sorted(shots.by_image.items())]
    (folder / "photos").mkdir()
    photos = [
        photograph(folder / "photos" / name, seed=number, pad=40_000, gps=tuple(_lonlat(centre)[0]))
        for number, (name, centre) in enumerate(taken)
    ]
    marks = places()
    rows = [UTM]
    for number, place in enumerate(delivered(marks)):
        for pick in picks_of(shots, f"M{number}", place, most=6, sigma=PICK_PX, seed=number):
            rows.append(f"nan nan nan {pick.px:.3f} {pick.py:.3f} {pick.image} {pick.name}")
    (folder / "picks.txt").write_text("\n".join(rows) + "\n")
    (folder / "control.yaml").write_text(json.dumps(control_of(marks)))
    (folder / "piles.geojson").write_text(json.dumps(_area()))
    return KnownTask(
        project, packed(project), photos, folder / "control.yaml", folder / "piles.geojson"
    )


def delivered(points: np.ndarray) -> np.ndarray:
    """Where the reconstruction has places of the ground: shrunk, and in grid metres."""
    k = pyproj.Proj(UTM).get_factors(*_lonlat(SITE[None, :2])[0]).meridional_scale
    return SITE + SHRUNK * (points - CENTRE) * [k, k, 1.0]


def packed(project: Path) -> bytes:
    """Pack a project as an all.zip."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for path in sorted(p for p in project.rglob("*") if p.is_file()):
            archive.write(path, path.relative_to(project).as_posix())
    return out.getvalue()


def _lonlat(xy: np.ndarray) -> np.ndarray:
    to = pyproj.Transformer.from_crs(UTM, 4326, always_xy=True)
    return np.column_stack(to.transform(*xy.T.tolist()))  # pyproj 3.6 warns of arrays of one


def places(count: int = 8) -> np.ndarray:
    """Marks on the ground, in true metres."""
    rng = np.random.default_rng(4)
    x, y = rng.uniform(2, 38, (2, count))
    return np.column_stack([x + EAST, y + NORTH, TERRAIN.height(x, y) + LEVEL])


def control_of(marks: np.ndarray, sigma: float = PHONE_M, levelled: bool = False) -> Dict[str, Any]:
    """Return a control file: positions with their noise, taped distances, picks in photographs."""
    rng = np.random.default_rng(9)
    names = [f"M{number}" for number in range(len(marks))]
    k = pyproj.Proj(UTM).get_factors(*_lonlat(SITE[None, :2])[0]).meridional_scale
    true = SITE[:2] + k * (marks - CENTRE)[:, :2]
    phone = _lonlat(true + rng.normal(0, sigma, (len(marks), 2)))
    first, second = np.triu_indices(len(marks), 1)
    apart = np.linalg.norm(marks[first] - marks[second], axis=1)
    points = {
        name: {"lat": float(lat), "lon": float(lon), "accuracy": sigma}
        for name, (lon, lat) in zip(names, phone)
    }
    for point, mark in zip(points.values(), marks):
        if levelled:
            height = float(SITE[2] + (mark - CENTRE)[2] + rng.normal(0, sigma))
            point.update(elevation=height, elevation_accuracy=sigma)
    return {
        "unit": "m",
        "crs": "EPSG:4326",
        "images": "picks.txt",
        "points": points,
        "distances": [
            {
                "from": names[first[i]],
                "to": names[second[i]],
                "length": float(apart[i] + rng.normal(0, TAPE_M)),
                "accuracy": TAPE_M,
            }
            for i in np.argsort(-apart)[:12]
        ],
    }


def _area() -> Dict[str, Any]:
    """Return the pile's outline, drawn on the delivered cloud."""
    ring = shapely.affinity.translate(circle(9.5), EAST, NORTH)
    drawn = shapely.transform(
        ring, lambda xy: delivered(np.column_stack([xy, np.full(len(xy), LEVEL)]))[:, :2]
    )
    return {
        "type": "FeatureCollection",
        "crs": {"type": "name", "properties": {"name": UTM}},
        "features": [
            {"type": "Feature", "properties": {"name": "pile"}, "geometry": mapping(drawn)}
        ],
    }
