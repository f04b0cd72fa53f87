"""Where OpenDroneMap put the cameras: ``odm_report/shots.geojson`` and ``cameras.json``.

Both are written from the same reconstruction (``opendm/shots.py`` and ``opendm/camera.py`` in
ODM's sources): positions and rotations already in the coordinates of the delivered cloud.

What the files cannot tell, and what to watch the reprojection errors for:

* with ``--split``, each part has solved its cameras for itself, cameras.json keeps one of them,
  and a photograph of two parts is listed twice;
* with ``--align``, ODM multiplies rotation *vectors* by a matrix, which is no rotation;
* older versions take a site's east, north and up for the map's by one linear step, which turns
  photographs a little; newer ones fit the poses again afterwards.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path, PurePosixPath
from typing import Any, Dict, Iterator, List, Mapping, Optional, Sequence, Tuple

import numpy as np
from scipy.spatial.transform import Rotation

from ...errors import ControlError
from ...types import FloatArray, Notice
from ..odm.control_positions import ControlPosition, read_control_positions
from ..odm.json_files import features, is_number, numbers, read_object, shown
from .camera_models import PARAMETERS, REQUIRED, Camera

__all__ = ["ControlPosition", "Shot", "Shots", "read_control_positions", "read_shots"]

_SHOTS = "odm_report/shots.geojson of an ODM output"
_CAMERAS = "the cameras.json of the same ODM output"
_AGAIN = "process the photographs again with ODM 2.x or newer"
_PREFIX = "v2 "  # of OpenSfM's camera names; ODM strips it in cameras.json only
_ALIGNED = Path("odm_georeferencing") / "alignment_matrix.json"
_MAX_PIXELS = 1_000_000
_MAX_TURN = 4 * math.pi  # radians; ODM writes at most pi
_SAME_FOCAL = 1e-6
_MODEL_ALIASES = {"equirectangular": "spherical"}


@dataclass(frozen=True)
class Shot:
    """A photograph with the camera that took it and its pose.

    Attributes
    ----------
    image : file name.
    camera : with the size of this photograph.
    rotation : (3, 3) float64, world to camera.
    centre : (3,) float64, where the camera was, in the cloud's coordinates.
    """

    image: str
    camera: Camera
    rotation: FloatArray
    centre: FloatArray


@dataclass(frozen=True)
class Shots:
    """The photographs of a project that ODM could align.

    Attributes
    ----------
    by_image : by file name.
    label : the file they are from, for messages.
    warnings : what was assumed or looks wrong, one line each.
    """

    by_image: Mapping[str, Shot]
    label: str
    warnings: Sequence[Notice] = ()

    def find(self, image: str) -> Optional[Shot]:
        """Return the photograph of a name: the exact one, else one that differs in folder or case.

        Raises
        ------
        ControlError
            Several names differ in their case only, and none is exactly the one sought.
        """
        exact = self.by_image.get(image)
        if exact is not None:
            return exact
        found = self._by_base.get(_base(image), [])
        if len(found) > 1:
            names = " and ".join(shown(shot.image) for shot in found[:2])
            raise ControlError(
                f"{self.label}: {shown(image)} may be {names}; expected one photograph of that "
                "name: write it as the project does"
            )
        return found[0] if found else None

    @cached_property
    def _by_base(self) -> Mapping[str, List[Shot]]:
        found: Dict[str, List[Shot]] = {}
        for shot in self.by_image.values():
            found.setdefault(_base(shot.image), []).append(shot)
        return found


def _base(image: str) -> str:
    return PurePosixPath(image.replace("\\", "/")).name.casefold()


def read_shots(shots_path: Path, cameras_path: Path) -> Shots:
    """Return the poses of a project's photographs, with their cameras.

    Parameters
    ----------
    shots_path : Path
        ``odm_report/shots.geojson``.
    cameras_path : Path
        ``cameras.json`` of the same output.

    Raises
    ------
    ControlError
        A file is missing or not what ODM writes, is from a version without positions, or a camera
        has a lens model that is not read; one line that names the file.
    """
    listed = features(shots_path, read_object(shots_path, _SHOTS), _SHOTS)
    cameras = _Cameras(cameras_path, read_object(cameras_path, _CAMERAS))
    found: Dict[str, Shot] = {}
    odd_focal = 0
    repeated: List[float] = []
    for number, feature in enumerate(listed, start=1):
        properties = feature["properties"]
        shot = _shot(shots_path, number, properties, cameras)
        odd_focal += _differs(shot.camera, properties.get("focal"))
        if shot.image in found:
            apart = shot.centre - found[shot.image].centre
            repeated.append(float(np.linalg.norm(apart)))
        else:
            found[shot.image] = shot
    return Shots(
        found, str(shots_path), tuple(_doubts(shots_path, cameras_path, odd_focal, repeated))
    )


def _doubts(
    shots_path: Path, cameras_path: Path, odd_focal: int, repeated: Sequence[float]
) -> Iterator[Notice]:
    if odd_focal:
        yield Notice(
            "photographs-of-another-focal-length",
            f"{shots_path}: {odd_focal} photographs were solved with another focal length than "
            f"{cameras_path.name} has (--split, or files of two outputs): picks in them may be off",
            photographs=odd_focal,
        )
    if repeated:
        yield Notice(
            "photographs-listed-twice",
            f"{shots_path}: lists {len(repeated)} photographs again, up to {max(repeated):.3g} m "
            "away (--split); the first position of each is used",
            photographs=len(repeated),
            distance_m=max(repeated),
        )
    if (shots_path.parent.parent / _ALIGNED).is_file():
        yield Notice(
            "photographs-turned-by-align",
            f"{shots_path}: this output was aligned to another (--align), for which ODM does not "
            "turn the photographs correctly; trust picks only if they meet, or process without it",
        )


def _differs(camera: Camera, focal: Any) -> bool:
    """Whether the shot was solved with another focal length; spherical cameras have none."""
    own = camera.parameters.get("focal", camera.parameters.get("focal_x"))
    return own is not None and is_number(focal) and abs(focal / own - 1) > _SAME_FOCAL


def _shot(path: Path, number: int, properties: Mapping[str, Any], cameras: _Cameras) -> Shot:
    image = properties.get("filename")
    if not isinstance(image, str) or not image.strip():
        raise ControlError(f"{path}: feature {number} names no photograph; expected {_SHOTS}")
    name = f"{path}: the photograph {shown(image)}"
    missing = [key for key in ("translation", "camera", "rotation") if properties.get(key) is None]
    if missing:
        raise ControlError(
            f"{path}: its shots have no position or camera ({shown(image)}: no "
            f"{', '.join(missing)}), as an old ODM writes them; {_AGAIN}"
        )
    centre, turn = (numbers(properties[key], 3) for key in ("translation", "rotation"))
    if centre is None:
        raise ControlError(f"{name} has a translation that is not three finite numbers; {_AGAIN}")
    if turn is None or math.hypot(*turn) > _MAX_TURN:
        raise ControlError(f"{name} has a rotation that is not three angles in radians; {_AGAIN}")
    if not isinstance(properties["camera"], str):
        raise ControlError(f"{name} has a camera that is not a name; {_AGAIN}")
    camera = _sized(name, cameras.of(properties["camera"], image), properties)
    return Shot(image, camera, Rotation.from_rotvec(turn).as_matrix(), np.array(centre))


def _sized(name: str, camera: Camera, properties: Mapping[str, Any]) -> Camera:
    """Return the camera with the photograph's own size.

    Everything in cameras.json is a share of the longer side, so that a camera fits photographs of
    any size; ODM converts picks with the size of the photograph that they are in.
    """
    size = _size(properties) or (camera.width, camera.height)
    if not all(size):
        raise ControlError(
            f"{name} has no width and height, nor has its camera; expected its size in pixels: "
            f"{_AGAIN}"
        )
    if size == (camera.width, camera.height):
        return camera
    return replace(camera, width=size[0], height=size[1])


def _size(properties: Mapping[str, Any]) -> Optional[Tuple[int, int]]:
    """Return width and height; None unless both are whole numbers of pixels (0: unknown)."""
    found = numbers([properties.get("width"), properties.get("height")], 2)
    if found is None or not all(1 <= side <= _MAX_PIXELS and side.is_integer() for side in found):
        return None
    return int(found[0]), int(found[1])


class _Cameras:
    """The cameras of a file, each read when a photograph asks for it."""

    def __init__(self, path: Path, document: Mapping[str, Any]) -> None:
        self._path = path
        self._given = {_plain(name): entry for name, entry in document.items()}
        self._read: Dict[str, Camera] = {}
        repeated = [name for name, times in Counter(map(_plain, document)).items() if times > 1]
        if repeated:
            raise ControlError(
                f"{path}: has the camera {shown(repeated[0])} twice, with and without "
                f"{_PREFIX!r}; expected {_CAMERAS}"
            )

    def of(self, name: str, image: str) -> Camera:
        plain = _plain(name)
        if plain not in self._read:
            if plain not in self._given:
                raise ControlError(
                    f"{self._path}: does not have the camera {shown(name)} of {shown(image)}; "
                    f"expected {_CAMERAS}: give both files of one output"
                )
            self._read[plain] = _camera(self._path, plain, self._given[plain])
        return self._read[plain]


def _plain(name: str) -> str:
    return name[len(_PREFIX) :] if name.startswith(_PREFIX) else name


def _camera(path: Path, name: str, entry: Any) -> Camera:
    where = f"{path}: the camera {shown(name)}"
    if not isinstance(entry, dict):
        raise ControlError(f"{where} is no JSON object; expected {_CAMERAS}")
    given = entry.get("projection_type")
    projection = _MODEL_ALIASES.get(given, given) if isinstance(given, str) else ""
    if projection not in REQUIRED:
        raise ControlError(
            f"{where} has the lens model {shown(given)!r}; expected one of {', '.join(REQUIRED)}: "
            "process again with such a --camera-lens"
        )
    parameters = {}
    for key in PARAMETERS[projection]:
        value = entry.get(key)
        if value is None:
            continue
        if not is_number(value):
            raise ControlError(f"{where} has a {shown(key)} that is not a finite number; {_AGAIN}")
        parameters[key] = float(value)
    for key in REQUIRED[projection]:
        if parameters.get(key, 0.0) <= 0:
            raise ControlError(f"{where} has no {key} above 0; expected {_CAMERAS}")
    width, height = _size(entry) or (0, 0)
    return Camera(name, projection, width, height, parameters)
