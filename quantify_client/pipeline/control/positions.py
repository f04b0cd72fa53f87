"""Where control points are in the cloud: given, picked in photographs, or reported by ODM."""

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
from ...types import FloatArray
from ...types.notice import Notice

__all__ = ["cloud_places"]

#: Sigma of a place in the cloud where none is given, in point spacings.
_SPACINGS = 2.0

_WGS84 = "EPSG:4326"

#: ODM prints its control points' misses to the millimetre.
_PRINTED_M = 0.001

_Found = Tuple[Dict[str, CloudPlace], List[Notice]]


def cloud_places(source: Source, frame: Frame, control: Control) -> _Found:
    """Return where points are, in metres of the cloud's own frame, and what was assumed.

    A place that is given wins over picks in photographs; ODM's own file of the control points that
    it was given is used where there is neither.

    Raises
    ------
    ControlError
        No point is in the cloud, a given place is far from it, or points are picked in photographs
        whose cameras are not in the project.
    """
    picked, notes = _picked(source, frame, control)
    given, more = _given(source, frame, control)
    places, notes = {**picked, **given}, [*notes, *more]
    if not places:
        places, notes = _reported_by_odm(source, frame, control)
    if not places:
        raise ControlError(
            f"{control.label}: no control point is in the cloud; give places in the cloud "
            "('cloud:'), or picks in photographs ('images:') and the ODM project as the source"
        )
    return places, notes


def _given(source: Source, frame: Frame, control: Control) -> _Found:
    if not control.cloud:
        return {}, []
    notes = []
    xyz = np.array([place.xyz for place in control.cloud.values()], dtype=np.float64)
    moved = np.column_stack(frame.to_frame(*xyz.T.copy()))
    _require_near(source, control, xyz)
    if any(is_ours(path) for path in source.files):
        text = (
            "the cloud was scaled before: places ('cloud:') of the delivered cloud do not fit it, "
            "and would scale it once more; give them as they are in this cloud"
        )
        notes.append(Notice("cloud-scaled-before", text))
    default = _SPACINGS * _spacing(source, frame)
    missing = sum(place.accuracy is None for place in control.cloud.values())
    if missing:
        text = (
            f"{missing} of {len(control.cloud)} places in the cloud have no accuracy: two point "
            f"spacings ({default:.3g} m) are taken; give 'accuracy'"
        )
        notes.append(Notice("accuracy-assumed", text, what="place", count=missing, sigma_m=default))
    out = {}
    for place, where in zip(control.cloud.values(), moved):
        sigma = default if place.accuracy is None else place.accuracy * _unit_m(frame)
        out[place.name] = CloudPlace(where, sigma**2 * np.eye(3))
    return out, notes


def _unit_m(frame: Frame) -> float:
    """Return metres per unit of the cloud's own x, y and z; 1 for a cloud in degrees."""
    return frame.unit_m if frame.geographic_crs is None else 1.0


def _spacing(source: Source, frame: Frame) -> float:
    """Return the mean distance between points, metres."""
    info = source.cloud.info
    if info.bounds is None or not info.point_count:
        return 0.05
    box = frame.bounds_to_frame(info.bounds)
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
            where = " ".join(f"{v:.6g}" if abs(v) < 1000 else f"{v:.2f}" for v in place)
            raise ControlError(
                f"{control.label}: cloud: {name} is at {where}, far from the cloud (x "
                f"{low[0]:.2f} to {high[0]:.2f}, y {low[1]:.2f} to {high[1]:.2f}, z {low[2]:.2f} "
                f"to {high[2]:.2f}); give its place in this cloud's own coordinates"
            )


def _picked(source: Source, frame: Frame, control: Control) -> _Found:
    wanted = [pick for pick in control.picks if pick.name not in control.cloud]
    if not wanted:
        return {}, []
    shots, cameras = (_inside(source, name) for name in (SHOTS, CAMERAS))
    if shots is None or cameras is None:
        if control.cloud:
            return {}, []
        raise ControlError(
            f"{control.label}: its points are picked in photographs, but {source.label} does not "
            f"hold the cameras ({SHOTS} and {CAMERAS}); give the ODM project folder or its "
            "all.zip, or places in the cloud ('cloud:')"
        )
    project = str(source.project)
    try:
        poses = read_shots(shots, cameras)
        found = triangulate(poses, wanted)
    except ControlError as error:
        raise ControlError(str(error).replace(project, source.label)) from error
    notes = [_renamed(note, project, source.label) for note in poses.warnings]
    out = {}
    for name, sighting in found.items():
        notes += [_renamed(note, project, source.label) for note in sighting.warnings]
        where = np.concatenate(frame.to_frame(*(np.array([v]) for v in sighting.xyz)))
        out[name] = CloudPlace(where, np.asarray(sighting.covariance) * _unit_m(frame) ** 2)
    rms = math.sqrt(float(np.mean([s.rms_px**2 for s in found.values()])))
    text = f"{len(found)} points from photographs, reprojection RMS {rms:.2f} pixels"
    notes.append(Notice("points-from-photographs", text, points=len(found), rms_px=rms))
    return out, notes


def _renamed(note: str, project: str, label: str) -> Notice:
    """Return a warning about the project with the name that the user gave it."""
    code = note.code if isinstance(note, Notice) else "photographs"
    values = note.values if isinstance(note, Notice) else {}
    return Notice(code, note.replace(project, label), **values)


def _inside(source: Source, name: str) -> Optional[Path]:
    """Return the path of a file of the ODM project; None where there is none."""
    path = None if source.project is None else source.project / name
    return path if path is not None and path.is_file() else None


def _reported_by_odm(source: Source, frame: Frame, control: Control) -> _Found:
    """Return what ODM wrote of the GCPs that it was given, for the points of the same names."""
    path = _inside(source, CONTROL_POSITIONS)
    if path is None or frame.grid is None:
        return {}, []
    wanted = {*control.points, *control.ends}
    known = read_control_positions(path)
    chosen = {name: known[name].reconstructed for name in known if name in wanted}
    if not chosen:
        return {}, []
    lon, lat, height = np.array(list(chosen.values()), dtype=np.float64).T
    x, y = positions_to(lon, lat, _WGS84, frame.grid)
    moved = np.column_stack([x * frame.unit_m, y * frame.unit_m, height])
    text = (
        f"{len(chosen)} points are taken from {CONTROL_POSITIONS}: control points given to ODM "
        "have shaped its model, so their residuals are no independent check"
    )
    sigma = max(_PRINTED_M, _spacing(source, frame))
    places = {name: CloudPlace(xyz, sigma**2 * np.eye(3)) for name, xyz in zip(chosen, moved)}
    return places, [Notice("points-from-odm", text, points=len(chosen))]
