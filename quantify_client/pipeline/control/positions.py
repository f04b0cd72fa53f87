"""Where control points are in the cloud: given, picked in photographs, or told by ODM itself."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Dict, List, Optional, Tuple

import numpy as np

from ...crs import Frame, positions_to
from ...errors import ControlError
from ...files.writing import is_ours
from ...scaler.adjustment.build import CloudPlace
from ...scaler.control.model import Control
from ...sfm.odm.layout import CAMERAS, CONTROL_POSITIONS, SHOTS
from ...sfm.photos.cameras import read_control_positions, read_shots
from ...sfm.photos.triangulate import triangulate
from ...source import Source
from ...types import Bounds, FloatArray

__all__ = ["cloud_places"]

#: Where nobody says how well a point was found in the cloud, it is this many point spacings.
_SPACINGS = 2.0

_WGS84 = "EPSG:4326"

#: ODM prints its control points' misses to the millimetre.
_PRINTED_M = 0.001

Places = Dict[str, CloudPlace]


def cloud_places(source: Source, frame: Frame, control: Control) -> Tuple[Places, List[str]]:
    """Return where points are, in metres of the cloud's own frame, and what was assumed.

    A place that is given wins over picks in photographs; ODM's own file of the control points that
    it was given is used where there is neither.

    Raises
    ------
    ControlError
        Picks that do not lead to a point, or photographs that are not in the project.
    """
    notes: List[str] = []
    places = _picked(source, frame, control, notes)
    places.update(_given(source, frame, control, notes))
    if not places:
        places = _told_by_odm(source, frame, control, notes)
    if not places:
        raise ControlError(
            f"{control.label}: no control point is in the cloud; give places in the cloud "
            "('cloud:'), or picks in photographs ('images:') and the ODM project as the source"
        )
    return places, notes


def _given(source: Source, frame: Frame, control: Control, notes: List[str]) -> Places:
    if not control.cloud:
        return {}
    xyz = np.array([place.xyz for place in control.cloud.values()], dtype=np.float64)
    moved = np.column_stack(frame.to_frame(*xyz.T.copy()))
    _require_near(source, control, xyz)
    if any(is_ours(path) for path in source.files):
        notes.append(
            "the cloud was scaled before: places ('cloud:') of the delivered cloud do not fit it, "
            "and would scale it once more; give them as they are in this cloud"
        )
    default = _SPACINGS * _spacing(source, frame)
    missing = [name for name, place in control.cloud.items() if place.accuracy is None]
    if missing:
        notes.append(
            f"{len(missing)} of {len(control.cloud)} places in the cloud have no accuracy: two "
            f"point spacings ({default:.3g} m) are taken; give 'accuracy'"
        )
    unit = frame.unit_m if frame.geographic_crs is None else 1.0
    out = {}
    for place, where in zip(control.cloud.values(), moved):
        sigma = default if place.accuracy is None else place.accuracy * unit
        out[place.name] = CloudPlace(where, sigma**2 * np.eye(3))
    return out


def _spacing(source: Source, frame: Frame) -> float:
    """Return the mean distance between points, metres."""
    info = source.cloud.info
    if info.bounds is None or not info.point_count:
        return 0.05
    box: Bounds = frame.bounds_to_frame(info.bounds)
    area = (box.max_x - box.min_x) * (box.max_y - box.min_y)
    return max(math.sqrt(max(area, 0.0) / info.point_count), 1e-6)


def _require_near(source: Source, control: Control, xyz: FloatArray) -> None:
    """Refuse places that cannot be in this cloud: other coordinates, or another cloud."""
    bounds = source.cloud.info.bounds
    if bounds is None:
        return
    low = np.array([bounds.min_x, bounds.min_y, bounds.min_z])
    high = np.array([bounds.max_x, bounds.max_y, bounds.max_z])
    room = float(np.max(high - low))
    for name, place in zip(control.cloud, xyz):
        if (place < low - room).any() or (place > high + room).any():
            told = " ".join(f"{v:.6g}" if abs(v) < 1000 else f"{v:.2f}" for v in place)
            raise ControlError(
                f"{control.label}: cloud: {name} is at {told}, far from the cloud (x "
                f"{low[0]:.2f} to {high[0]:.2f}, y {low[1]:.2f} to {high[1]:.2f}, z {low[2]:.2f} "
                f"to {high[2]:.2f}); give its place in this cloud's own coordinates"
            )


def _picked(source: Source, frame: Frame, control: Control, notes: List[str]) -> Places:
    wanted = [pick for pick in control.picks if pick.name not in control.cloud]
    if not wanted:
        return {}
    project = source.project
    shots, cameras = (_inside(project, name) for name in (SHOTS, CAMERAS))
    if project is None or shots is None or cameras is None:
        if control.cloud:
            return {}
        raise ControlError(
            f"{control.label}: its points are picked in photographs, but {source.label} does not "
            f"hold the cameras ({SHOTS} and {CAMERAS}); give the ODM project folder or its "
            "all.zip, or places in the cloud ('cloud:')"
        )
    try:
        poses = read_shots(shots, cameras)
        found = triangulate(poses, wanted)
    except ControlError as error:
        raise ControlError(str(error).replace(str(project), source.label)) from error
    notes += [note.replace(str(project), source.label) for note in poses.warnings]
    out = {}
    for name, sighting in found.items():
        notes += sighting.warnings
        where = np.concatenate(frame.to_frame(*(np.array([v]) for v in sighting.xyz)))
        unit = frame.unit_m if frame.geographic_crs is None else 1.0
        out[name] = CloudPlace(where, np.asarray(sighting.covariance) * unit**2)
    rms = math.sqrt(float(np.mean([s.rms_px**2 for s in found.values()])))
    notes.append(f"{len(found)} points from photographs, reprojection RMS {rms:.2f} pixels")
    return out


def _inside(project: Optional[Path], name: str) -> Optional[Path]:
    path = None if project is None else project / name
    return path if path is not None and path.is_file() else None


def _told_by_odm(source: Source, frame: Frame, control: Control, notes: List[str]) -> Places:
    """Use what ODM wrote of the GCPs that it was given, for the points of the same names."""
    path = _inside(source.project, CONTROL_POSITIONS)
    if path is None or frame.grid is None:
        return {}
    known = read_control_positions(path)
    chosen = {name: known[name].reconstructed for name in known if name in _names(control)}
    if not chosen:
        return {}
    lon, lat, height = np.array(list(chosen.values()), dtype=np.float64).T
    x, y = positions_to(lon, lat, _WGS84, frame.grid)
    moved = np.column_stack([x * frame.unit_m, y * frame.unit_m, height])
    notes.append(
        f"{len(chosen)} points are taken from {CONTROL_POSITIONS}: control points given to ODM "
        "have shaped its model, so their residuals are no independent check"
    )
    sigma = max(_PRINTED_M, _spacing(source, frame))
    return {name: CloudPlace(where, sigma**2 * np.eye(3)) for name, where in zip(chosen, moved)}


def _names(control: Control) -> List[str]:
    return [*control.points, *(end for i in control.lengths for end in (i.start, i.end))]
