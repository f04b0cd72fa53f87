"""shots.geojson, cameras.json and ground_control_points.geojson: as ODM writes them, and spoilt."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any, Callable, Dict

import numpy as np
import pytest
from odm_photos import CAMERAS, NAME, SITE, camera_entry, feature, write_shots

from quantify_client.errors import ControlError
from quantify_client.sfm.odm import json_files
from quantify_client.sfm.photos.cameras import read_control_positions, read_shots

DOWN = [math.pi, 0.0, 0.0]
BROWN = {**camera_entry(CAMERAS["brown"]), "focal_x": 0.85}


def _refused(call: Callable[[], Any], message: str, path: Path) -> str:
    with pytest.raises(ControlError, match=message) as caught:
        call()
    text = str(caught.value)
    assert "\n" not in text
    assert str(path) in text
    return text


def _shots_refused(folder: Path, message: str, *features: Any, **cameras: Any) -> str:
    paths = write_shots(folder, features, cameras.get("cameras"))
    return _refused(lambda: read_shots(*paths), message, paths[cameras.get("names", 0)])


def test_a_shot_is_read(tmp_path: Path) -> None:
    """Camera coordinates are x right, y down, z forward: from straight above, east, south, down."""
    shots = read_shots(*write_shots(tmp_path, [feature("IMG_1.JPG", SITE, DOWN)]))
    shot = shots.by_image["IMG_1.JPG"]
    assert shot.centre.tolist() == SITE.tolist()
    assert shot.rotation == pytest.approx(np.diag([1.0, -1.0, -1.0]), abs=1e-12)
    assert (shot.camera.projection, shot.camera.width, shot.camera.height) == ("brown", 4000, 3000)
    size = ("projection_type", "width", "height")
    assert shot.camera.parameters == {k: v for k, v in BROWN.items() if k not in size}
    assert shots.warnings == ()
    assert shots.label == str(tmp_path / "odm_report" / "shots.geojson")


def test_rotation_is_from_world_to_camera(tmp_path: Path) -> None:
    """A quarter turn about z takes the world's x axis to the camera's y axis."""
    turned = feature("A.JPG", SITE, [0, 0, math.pi / 2])
    shot = read_shots(*write_shots(tmp_path, [turned])).by_image["A.JPG"]
    assert shot.rotation @ [1.0, 0, 0] == pytest.approx([0, 1, 0], abs=1e-12)


@pytest.mark.parametrize("name", sorted(CAMERAS))
def test_every_model_is_read(name: str, tmp_path: Path) -> None:
    camera = CAMERAS[name]
    size = {"width": camera.width, "height": camera.height}
    focal = camera.parameters.get("focal", camera.parameters.get("focal_x"))
    shot = feature("A.JPG", SITE, DOWN, **size, focal=focal)
    if focal is None:  # ODM writes null for a camera without
        shot["properties"]["focal"] = None
    entry = camera_entry(camera)
    entry["projection_type"] = {"spherical": "equirectangular"}.get(name, name)
    read = read_shots(*write_shots(tmp_path, [shot], {NAME: entry}))  # with the prefix, too
    assert read.by_image["A.JPG"].camera == type(camera)(
        NAME[3:], name, camera.width, camera.height, camera.parameters
    )
    assert read.warnings == ()


@pytest.mark.parametrize(
    "model", ["dual", "radial", "simple_radial", "fisheye62", "fisheye624", "lens\n", "", None, 3]
)
def test_other_models_are_refused_by_name(model: Any, tmp_path: Path) -> None:
    cameras = {NAME[3:]: {**BROWN, "projection_type": model}}
    text = _shots_refused(
        tmp_path, "has the lens model", feature("A.JPG", SITE, DOWN), cameras=cameras, names=1
    )
    assert "expected one of perspective, brown, fisheye, fisheye_opencv, spherical" in text
    assert repr(str(model).strip()[:5])[1:-1] in text or not isinstance(model, str)


def test_a_camera_that_nobody_used_is_not_judged(tmp_path: Path) -> None:
    cameras = {NAME[3:]: BROWN, "other": {"projection_type": "dual"}}
    assert read_shots(*write_shots(tmp_path, [feature("A.JPG", SITE, DOWN)], cameras)).by_image


def test_photographs_have_their_own_size(tmp_path: Path) -> None:
    """Parameters are shares of the longer side: a resized photograph has the same rays."""
    features = [
        feature("A.JPG", SITE, DOWN, width=2000, height=1500),
        feature("B.JPG", SITE, DOWN, width=0, height=0),
    ]
    shots = read_shots(*write_shots(tmp_path, features)).by_image
    assert (shots["A.JPG"].camera.width, shots["A.JPG"].camera.height) == (2000, 1500)
    assert (shots["B.JPG"].camera.width, shots["B.JPG"].camera.height) == (4000, 3000)
    assert shots["A.JPG"].camera.parameters == shots["B.JPG"].camera.parameters


@pytest.mark.parametrize(
    ("sought", "found"),
    [
        ("IMG_1.JPG", "IMG_1.JPG"),
        ("img_1.jpg", "IMG_1.JPG"),
        ("images/IMG_1.JPG", "IMG_1.JPG"),
        ("C:\\survey\\Img_1.jpg", "IMG_1.JPG"),
        ("b.jpg", "b.jpg"),
        ("IMG_2.JPG", None),
        ("", None),
    ],
)
def test_photographs_by_name(sought: str, found: Any, tmp_path: Path) -> None:
    names = ("IMG_1.JPG", "b.jpg", "B.JPG")
    shots = read_shots(*write_shots(tmp_path, [feature(name, SITE, DOWN) for name in names]))
    shot = shots.find(sought)
    assert (shot.image if shot else None) == found
    with pytest.raises(ControlError, match="B.Jpg may be b.jpg and B.JPG"):
        shots.find("B.Jpg")


def test_split_projects_are_said(tmp_path: Path) -> None:
    features = [
        feature("A.JPG", SITE, DOWN),
        feature("A.JPG", [*(SITE[:2] + (0.3, 0.4)), SITE[2]], DOWN),
        feature("B.JPG", SITE, DOWN, focal=0.851),
    ]
    shots = read_shots(*write_shots(tmp_path, features))
    assert shots.by_image["A.JPG"].centre.tolist() == SITE.tolist()
    focal, again = shots.warnings
    assert "1 photographs were solved with another focal length than cameras.json" in focal
    assert "lists 1 photographs again, up to 0.5 m away" in again


def test_aligned_projects_are_said(tmp_path: Path) -> None:
    (tmp_path / "odm_georeferencing").mkdir()
    (tmp_path / "odm_georeferencing" / "alignment_matrix.json").write_text("[]")
    (warning,) = read_shots(*write_shots(tmp_path, [feature("A.JPG", SITE, DOWN)])).warnings
    assert "--align" in warning


@pytest.mark.parametrize("missing", ["translation", "camera", "rotation"])
def test_shots_of_an_old_odm_are_refused(missing: str, tmp_path: Path) -> None:
    text = _shots_refused(
        tmp_path,
        "its shots have no position or camera",
        feature("A.JPG", SITE, DOWN, **{missing: None}),
    )
    assert f"no {missing}" in text
    assert "process the photographs again with ODM 2.x" in text


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"translation": [1, 2]}, "a translation that is not three finite numbers"),
        ({"translation": ["1", "2", "3"]}, "a translation that is not"),
        ({"translation": [1, 2, math.nan]}, "a translation that is not"),
        ({"translation": [1, 2, 10**400]}, "a translation that is not"),
        ({"translation": {"x": 1}}, "a translation that is not"),
        ({"rotation": [math.inf, 0, 0]}, "a rotation that is not three angles"),
        ({"rotation": [1e300, 1e300, 0]}, "a rotation that is not"),
        ({"rotation": [True, 0, 0]}, "a rotation that is not"),
        ({"camera": ["v2"]}, "a camera that is not a name"),
        ({"filename": None}, "feature 1 names no photograph"),
        ({"filename": 7}, "feature 1 names no photograph"),
    ],
)
def test_spoilt_shots_are_refused(changes: Dict[str, Any], message: str, tmp_path: Path) -> None:
    _shots_refused(tmp_path, message, feature("A.JPG", SITE, DOWN, **changes))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"focal_x": None}, "has no focal_x above 0"),
        ({"focal_y": 0}, "has no focal_y above 0"),
        ({"focal_x": "0.85"}, "a focal_x that is not a finite number"),
        ({"k1": math.nan}, "a k1 that is not a finite number"),
        ({"p2": [1]}, "a p2 that is not a finite number"),
    ],
)
def test_spoilt_cameras_are_refused(changes: Dict[str, Any], message: str, tmp_path: Path) -> None:
    shot = feature("A.JPG", SITE, DOWN)
    _shots_refused(tmp_path, message, shot, cameras={NAME[3:]: {**BROWN, **changes}}, names=1)


def test_numbers_that_are_not_read_may_be_anything(tmp_path: Path) -> None:
    shot = feature("A.JPG", SITE, DOWN, capture_time=math.nan)
    shot["geometry"]["coordinates"] = [math.inf, math.nan, "x"]
    cameras = {NAME[3:]: {**BROWN, "k1_prior": math.nan, "id": "x"}}
    assert read_shots(*write_shots(tmp_path, [shot], cameras)).by_image


def test_cameras_that_do_not_fit_are_refused(tmp_path: Path) -> None:
    shot = feature("A.JPG", SITE, DOWN)
    text = _shots_refused(tmp_path, "does not have the camera", shot, cameras={"x": BROWN}, names=1)
    assert "of A.JPG; expected the cameras.json of the same ODM output" in text
    _shots_refused(tmp_path, "is no JSON object", shot, cameras={NAME[3:]: 3}, names=1)
    twice = {NAME: BROWN, NAME[3:]: BROWN}
    _shots_refused(tmp_path, "twice, with and without 'v2 '", shot, cameras=twice, names=1)
    sizeless = {NAME[3:]: {**BROWN, "width": 0, "height": "3000"}}
    unsized = feature("A.JPG", SITE, DOWN, width=None, height=-3)
    _shots_refused(tmp_path, "A.JPG has no width and height", unsized, cameras=sizeless)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is empty"),
        (b"version https://git-lfs.github.com/spec/v1\noid", "is a Git LFS pointer"),
        (b"<!DOCTYPE html>", "is a web page"),
        (b'{"features": [', "is not valid JSON"),
        (b"\xff\xfe{", "is not in UTF-8"),
        (b"[1]", "holds no JSON object"),
        (b"{}", "has no features"),
        (b'{"features": []}', "has no features"),
        (b'{"features": {"a": 1}}', "has no features"),
        (b'{"features": [1]}', "feature 1 has no properties"),
        (b'{"features": [{"properties": null}]}', "feature 1 has no properties"),
        (b'{"a":' * 100_000, "is nested too deeply"),
        (b"[" * 100_000, "is nested too deeply"),
    ],
)
def test_files_that_are_none_are_refused(content: bytes, message: str, tmp_path: Path) -> None:
    shots, cameras = write_shots(tmp_path, [])
    shots.write_bytes(content)
    _refused(lambda: read_shots(shots, cameras), message, shots)
    _refused(lambda: read_control_positions(shots), message, shots)


def test_a_number_of_thousands_of_digits_is_refused(tmp_path: Path) -> None:
    shots, cameras = write_shots(tmp_path, [feature("A.JPG", SITE, DOWN)])
    shots.write_text(shots.read_text().replace("4000", "9" * 5000))
    try:  # Python 3.9 reads it; then it is no size, and that of the camera counts
        assert read_shots(shots, cameras).by_image["A.JPG"].camera.width == 4000
    except ControlError as error:
        assert "holds a number that is none" in str(error)  # noqa: PT017 - one or the other


def test_files_that_are_not_there_are_refused(tmp_path: Path) -> None:
    shots, cameras = write_shots(tmp_path, [feature("A.JPG", SITE, DOWN)])
    gone = tmp_path / "gone.json"
    _refused(lambda: read_shots(gone, cameras), "does not exist", gone)
    _refused(lambda: read_shots(shots, tmp_path), "not a file", tmp_path)
    _refused(lambda: read_shots(shots, gone), "does not exist; expected the cameras.json", gone)


def test_a_file_without_end_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    paths = write_shots(tmp_path, [feature("A.JPG", SITE, DOWN)])
    monkeypatch.setattr(json_files, "MAX_BYTES", 100)
    _refused(lambda: read_shots(*paths), "is larger than", paths[0])


# -- ground_control_points.geojson ----------------------------------------------------------------

OBSERVED = {"shot_id": "A.JPG", "annotated": [0.5, 0.5], "reprojected": [0.5, 0.51]}


def _gcps(folder: Path, *points: Any) -> Path:
    path = folder / "ground_control_points.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": points}, indent=4))
    return path


def _gcp(name: Any = "P1", place: Any = (-81.75, 41.3, 210.0), **changes: Any) -> Dict[str, Any]:
    properties = {"id": name, "observations": [OBSERVED], "error": [0.3, -0.2, 0.05], **changes}
    point = {"type": "Point", "coordinates": place}
    return {"type": "Feature", "geometry": point, "properties": properties}


def test_a_control_position_is_read(tmp_path: Path) -> None:
    point = read_control_positions(_gcps(tmp_path, _gcp()))["P1"]
    assert point.surveyed == (-81.75, 41.3, 210.0)
    assert point.error_m == (0.3, -0.2, 0.05)
    assert point.images == ("A.JPG",)


@pytest.mark.parametrize("latitude", [-60.0, 0.0, 41.3, 78.0])
def test_reconstructed_is_surveyed_plus_error(latitude: float, tmp_path: Path) -> None:
    """Against an independent way: earth-centred coordinates and local axes."""
    pyproj = pytest.importorskip("pyproj", reason="the independent program")
    error = np.array([2.0, -3.0, 1.5])
    gcp = _gcp(place=[11.2, latitude, 1500.0], error=error.tolist())
    point = read_control_positions(_gcps(tmp_path, gcp))["P1"]
    to_earth = pyproj.Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True).transform
    lon, lat = np.radians(point.surveyed[:2])
    east = np.array([-np.sin(lon), np.cos(lon), 0])
    up = np.array([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
    axes = np.array([east, np.cross(up, east), up])
    moved = np.array(to_earth(*point.reconstructed)) - to_earth(*point.surveyed)
    assert axes @ moved == pytest.approx(error, abs=1e-5)


@pytest.mark.parametrize(
    ("point", "message"),
    [
        (_gcp(name=None), "feature 1 has no id"),
        (_gcp(place=[1, 2]), "P1 has no longitude, latitude and height"),
        (_gcp(place=[1, 95, 2]), "P1 has no longitude, latitude and height"),
        (_gcp(place=None), "P1 has no longitude"),
        (_gcp(error=[0, 0, math.nan]), "P1 has an error that is not three finite numbers"),
        (_gcp(error=None), "P1 has an error that is not"),
        ({**_gcp(), "geometry": None}, "P1 has no longitude"),
    ],
)
def test_spoilt_control_positions_are_refused(point: Any, message: str, tmp_path: Path) -> None:
    path = _gcps(tmp_path, point)
    _refused(lambda: read_control_positions(path), message, path)


def test_two_control_positions_of_one_name_are_refused(tmp_path: Path) -> None:
    path = _gcps(tmp_path, _gcp(), _gcp())
    _refused(lambda: read_control_positions(path), "two points of the name P1", path)


def test_observations_may_be_missing(tmp_path: Path) -> None:
    odd = [3, {"shot_id": 4}, OBSERVED]
    points = read_control_positions(
        _gcps(tmp_path, _gcp("a", observations=None), _gcp("b", observations=odd))
    )
    assert [point.images for point in points.values()] == [(), ("A.JPG",)]
