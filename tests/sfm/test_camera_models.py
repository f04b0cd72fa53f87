"""Lenses: known pixels, the same pixels as OpenCV, and a way back for each of them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from odm_photos import CAMERAS

from quantify_client.sfm.photos import camera_models
from quantify_client.sfm.photos.camera_models import Camera, bearings, pixel_difference, project

MODELS = sorted(CAMERAS)


def _front(count: int = 500, spread: float = 0.5) -> np.ndarray:
    random = np.random.default_rng(3)
    depth = random.uniform(5, 200, count)
    return np.column_stack([random.uniform(-spread, spread, (count, 2)) * depth[:, None], depth])


def _matrix(camera: Camera) -> np.ndarray:
    """OpenCV's camera matrix; it counts from the middle of the first pixel, as OpenSfM does."""
    given = camera.parameters
    focal = [given.get("focal", given.get(name)) for name in ("focal_x", "focal_y")]
    middle = [given.get("c_x", 0.0), given.get("c_y", 0.0)]
    s = max(camera.width, camera.height)
    cx, cy = (m * s + side / 2 - 0.5 for m, side in zip(middle, (camera.width, camera.height)))
    return np.array([[focal[0] * s, 0, cx], [0, focal[1] * s, cy], [0, 0, 1]])


def test_flat_image_by_hand() -> None:
    camera = Camera("c", "perspective", 4000, 3000, {"focal": 0.8})
    pixels = project(camera, [[10.0, -20.0, 100.0], [0.0, 0.0, 3.0]])
    assert pixels == pytest.approx(np.array([[2319.5, 859.5], [1999.5, 1499.5]]))


def test_radial_terms_by_hand() -> None:
    camera = Camera("c", "perspective", 1000, 1000, {"focal": 1.0, "k1": 0.1, "k2": 0.01})
    # x = 2, r2 = 4: 2 (1 + 0.4 + 0.16) = 3.12 focal lengths from the middle.
    assert project(camera, [[2.0, 0.0, 1.0]]) == pytest.approx(np.array([[3619.5, 499.5]]))


@pytest.mark.parametrize(
    ("direction", "pixel"),
    [
        ((0, 0, 1), (1999.5, 999.5)),
        ((1, 0, 0), (2999.5, 999.5)),  # right: a quarter of the way round
        ((0, 1, 0), (1999.5, 1999.5)),  # straight down: the lower edge
        ((0, -1, 0), (1999.5, -0.5)),
        ((-1, 0, -1), (499.5, 999.5)),
    ],
)
def test_sphere_by_hand(direction: tuple, pixel: tuple) -> None:
    assert project(CAMERAS["spherical"], [direction])[0] == pytest.approx(np.array(pixel))


@pytest.mark.parametrize("name", ["perspective", "brown"])
def test_same_pixels_as_opencv(name: str) -> None:
    cv2 = pytest.importorskip("cv2", reason="OpenCV is the independent program")
    camera, points = CAMERAS[name], _front()
    k = [camera.parameters.get(key, 0.0) for key in ("k1", "k2", "p1", "p2", "k3")]
    expected = cv2.projectPoints(points, np.zeros(3), np.zeros(3), _matrix(camera), np.array(k))[0]
    assert project(camera, points) == pytest.approx(expected[:, 0], abs=1e-8)


@pytest.mark.parametrize("name", ["fisheye", "fisheye_opencv"])
def test_same_pixels_as_opencv_fisheye(name: str) -> None:
    cv2 = pytest.importorskip("cv2", reason="OpenCV is the independent program")
    camera, points = CAMERAS[name], _front(spread=3)
    k = np.array([camera.parameters.get(key, 0.0) for key in ("k1", "k2", "k3", "k4")])
    expected = cv2.fisheye.projectPoints(
        points[:, None], np.zeros(3), np.zeros(3), _matrix(camera), k
    )[0]
    assert project(camera, points) == pytest.approx(expected[:, 0], abs=1e-8)


@pytest.mark.parametrize("name", MODELS)
@given(across=st.floats(0, 1), down=st.floats(0, 1), distance=st.floats(0.01, 1e5))
def test_every_pixel_has_a_ray_that_leads_back(
    name: str, across: float, down: float, distance: float
) -> None:
    camera = CAMERAS[name]
    pixel = np.array([[across * camera.width - 0.5, down * camera.height - 0.5]])
    ray = bearings(camera, pixel)
    assert np.linalg.norm(ray, axis=1) == pytest.approx(1, abs=1e-12)
    back = pixel_difference(camera, project(camera, ray * distance), pixel)
    if camera.projection == "spherical" and abs(ray[0, 1]) > 1 - 1e-9:
        back = back[:, 1:]  # at a pole, longitude is as good as any other
    assert np.abs(back).max() < 1e-6


@pytest.mark.parametrize("name", MODELS)
@given(
    k=st.lists(st.floats(-0.3, 0.3), min_size=4, max_size=4),
    p=st.lists(st.floats(-0.02, 0.02), min_size=2, max_size=2),
    x=st.floats(-3, 3),
    y=st.floats(-3, 3),
)
def test_a_ray_that_is_seen_is_found_again(name: str, k: list, p: list, x: float, y: float) -> None:
    parameters = {
        **CAMERAS[name].parameters,
        **dict(zip(("k1", "k2", "k3", "k4", "p1", "p2"), k + p)),
    }
    camera = Camera("c", name, 4000, 2000 if name == "spherical" else 3000, parameters)
    point = np.array([[x, y, 1.0]])
    pixel = project(camera, point)
    if np.isnan(pixel).any():
        return
    ray = bearings(camera, pixel)[0]
    if np.isnan(ray).any():  # nothing is promised on the fold itself, where the map is flat
        assert _flatness(camera, point) < 1e-3
        return
    assert np.linalg.norm(np.cross(ray, point[0])) < 1e-9 / max(_flatness(camera, point), 1e-6)


def _flatness(camera: Camera, point: np.ndarray) -> float:
    """Smallest change of the pixel by a small change of the ray, in focal lengths by radians."""
    columns = []
    for axis in ((1e-6, 0, 0), (0, 1e-6, 0)):
        ahead = project(camera, point + axis)
        columns.append(pixel_difference(camera, ahead, project(camera, point))[0] / 1e-6)
    matrix = np.array(columns) / camera.size
    return float(np.linalg.svd(matrix)[1][-1]) if np.isfinite(matrix).all() else 0.0


@pytest.mark.parametrize(
    ("name", "point"),
    [
        ("perspective", (0, 0, -1)),
        ("brown", (1, 2, 0)),
        ("fisheye", (0, 0, -1)),
        ("fisheye_opencv", (0, 0, 0)),
        ("spherical", (0, 0, 0)),
        ("perspective", (np.nan, 0, 1)),
        ("spherical", (np.inf, np.inf, 1)),
        ("perspective", (1e300, 0, 1e-300)),
    ],
)
def test_what_cannot_be_seen_is_nan(name: str, point: tuple) -> None:
    pixels = project(CAMERAS[name], [point, (0, 0, 2)])
    if np.isfinite(point).all():
        assert np.isnan(pixels[0]).all()
    assert np.isfinite(pixels[1]).all()


def test_fisheyes_see_behind_themselves() -> None:
    ray = np.array([[1.0, 0.0, -0.2]])
    for name in ("fisheye", "fisheye_opencv"):
        back = bearings(CAMERAS[name], project(CAMERAS[name], ray))
        assert back == pytest.approx(ray / np.linalg.norm(ray), abs=1e-12)


def test_nothing_beyond_the_fold() -> None:
    """The polynomial r (1 - r^2 / 3) turns back at r = 1, where it is 2/3."""
    camera = Camera("c", "perspective", 1000, 1000, {"focal": 1.0, "k1": -1 / 3})
    assert camera.fold == pytest.approx(1.0)
    assert np.isfinite(project(camera, [[0.99, 0, 1]])).all()
    assert np.isnan(project(camera, [[1.01, 0, 1]])).all()
    rays = bearings(camera, [[499.5 + 666, 499.5], [499.5 + 667, 499.5]])
    assert np.isfinite(rays[0]).all()
    assert np.isnan(rays[1]).all()


def test_the_way_back_is_found_far_from_the_middle() -> None:
    """Plain Newton from the distorted place leaves the lens: r grows to 2.3 times its image."""
    camera = Camera("c", "perspective", 1000, 1000, {"focal": 1.0, "k1": -0.09, "k2": 0.0028})
    points = np.column_stack([np.linspace(0, 1.8, 50), np.zeros(50), np.ones(50)])
    back = bearings(camera, project(camera, points))
    assert back[:, 0] / back[:, 2] == pytest.approx(points[:, 0], abs=1e-9)


@pytest.mark.parametrize("name", MODELS)
def test_no_pixels_and_pixels_that_are_none(name: str) -> None:
    assert bearings(CAMERAS[name], np.empty((0, 2))).shape == (0, 3)
    assert project(CAMERAS[name], np.empty((0, 3))).shape == (0, 2)
    assert np.isnan(bearings(CAMERAS[name], [[np.nan, 1.0], [np.inf, 1.0]])).all()


def test_no_ray_above_the_zenith() -> None:
    assert np.isnan(bearings(CAMERAS["spherical"], [[1000.0, -2.0]])).all()


def test_difference_goes_the_short_way_round() -> None:
    first, second = np.array([[3999.0, 10.0]]), np.array([[1.0, 12.0]])
    assert pixel_difference(CAMERAS["spherical"], first, second).tolist() == [[-2.0, -2.0]]
    assert pixel_difference(CAMERAS["brown"], first, second).tolist() == [[3998.0, -2.0]]


def test_bearings_reach_twelve_digits() -> None:
    for camera in CAMERAS.values():
        grid = np.stack(np.meshgrid(np.linspace(0, 2999, 20), np.linspace(0, 1999, 20)), -1)
        pixels = grid.reshape(-1, 2)
        rays = bearings(camera, pixels)
        missed = pixel_difference(camera, project(camera, rays), pixels)
        assert np.abs(missed).max() / camera.size < 1e-12 * math.tau


def test_derivative_of_the_distortion_is_that_of_its_differences() -> None:
    """It decides where the lens turns back, so Newton's method converging is not enough."""
    flat = np.array([[0.3, -0.2], [-0.5, 0.4], [0.0, 0.1]])
    for name in ("perspective", "brown", "fisheye_opencv"):
        _, derivative = camera_models._bent(CAMERAS[name], flat)
        for axis, columns in enumerate(((0, 1), (1, 2))):
            nudge = np.eye(2)[axis] * 1e-6
            ahead, behind = (
                camera_models._bent(CAMERAS[name], flat + s * nudge)[0] for s in (1, -1)
            )
            assert derivative[:, columns] == pytest.approx((ahead - behind) / 2e-6, abs=1e-8)
