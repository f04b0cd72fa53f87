"""The frame of a cloud that goes through a matrix on its way."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from quantify_client.crs import Frame, measuring_frame, placed_frame
from quantify_client.types import Bounds, Window

BOX = Bounds(576_650.0, 5_188_090.0, 300.0, 576_750.0, 5_188_190.0, 330.0)


def matrix_of(scale: float, angles, shift) -> np.ndarray:
    """About the middle of the box, which goes to `shift`."""
    turn = scale * Rotation.from_euler("zyx", angles, degrees=True).as_matrix()
    whole = np.eye(4)
    whole[:3, :3] = turn
    whole[:3, 3] = shift - turn @ [576_700.0, 5_188_140.0, 315.0]
    return whole


def points_in(box: Bounds, seed: int, count: int = 200) -> np.ndarray:
    low = [box.min_x, box.min_y, box.min_z]
    high = [box.max_x, box.max_y, box.max_z]
    return np.random.default_rng(seed).uniform(low, high, (count, 3))


def made(matrix: np.ndarray, crs=None, unit=None, target=None, bounds: Bounds = BOX) -> Frame:
    return placed_frame(measuring_frame(crs, unit, bounds), matrix, target, None, bounds)


TILTED = matrix_of(1.2, (130.0, 20.0, -35.0), [10.0, 20.0, 30.0])


@pytest.mark.parametrize(
    ("crs", "unit", "metres"),
    [
        (None, "m", 1.0),
        (None, "ft", 0.3048),
        ("EPSG:32615", None, 1.0),
        ("EPSG:2229", None, 1200 / 3937),
    ],
)
def test_matrix_comes_after_the_cloud_is_in_metres(crs, unit, metres: float) -> None:
    points = points_in(BOX, 1)
    frame = made(TILTED, crs, unit)
    found = np.column_stack(frame.to_frame(*points.T))
    by_hand = metres * points @ TILTED[:3, :3].T + TILTED[:3, 3]
    assert found == pytest.approx(by_hand, abs=1e-8)
    assert not frame.is_identity


def test_cloud_in_degrees_goes_by_way_of_its_zone() -> None:
    box = Bounds(-93.001, 46.0, 300.0, -93.0, 46.001, 330.0)
    frame = made(np.diag([2.0, 2.0, 2.0, 1.0]), "EPSG:4326", None, bounds=box)
    x, y, z = points_in(box, 2).T
    base = measuring_frame("EPSG:4326", None, box)
    assert np.array(frame.to_frame(x, y, z)) == pytest.approx(
        2.0 * np.array(base.to_frame(x, y, z))
    )


def test_points_given_are_not_changed() -> None:
    points = points_in(BOX, 3)
    x, y, z = points.T.copy()
    made(TILTED, None, "m").to_frame(x, y, z)
    assert np.array_equal(np.column_stack([x, y, z]), points)


ANGLE = st.floats(-180, 180)


@given(
    scale=st.floats(0.01, 100),
    angles=st.tuples(ANGLE, ANGLE, ANGLE),
    shift=st.sampled_from([(0.0, 0.0, 0.0), (576_700.0, 5_188_140.0, 310.0)]),
    seed=st.integers(0, 10**6),
    unit=st.sampled_from(["m", "ft", "us-ft"]),
)
def test_windows_and_bounds_enclose(scale: float, angles, shift, seed: int, unit: str) -> None:
    """However it is turned: no point above or below a window lies outside what is read for it."""
    frame = made(matrix_of(scale, angles, shift), None, unit)
    points = points_in(BOX, seed)
    x, y, z = frame.to_frame(*points.T)
    around = frame.bounds_to_frame(BOX)
    assert around.min_x <= x.min() <= x.max() <= around.max_x
    assert around.min_y <= y.min() <= y.max() <= around.max_y
    assert around.min_z <= z.min() <= z.max() <= around.max_z
    assert frame.placement.heights == pytest.approx((around.min_z, around.max_z))
    generator = np.random.default_rng(seed + 1)
    # A window between two of the points, so that its edges pass through them.
    first, second = generator.choice(len(points), 2, replace=False)
    low_x, high_x = sorted((x[first], x[second]))
    low_y, high_y = sorted((y[first], y[second]))
    window = Window(float(low_x), float(low_y), float(high_x), float(high_y))
    inside = (x >= low_x) & (x <= high_x) & (y >= low_y) & (y <= high_y)
    assert inside.sum() >= 2
    read = frame.window_to_source(window)
    assert (points[inside, 0] >= read.min_x).all()
    assert (points[inside, 0] <= read.max_x).all()
    assert (points[inside, 1] >= read.min_y).all()
    assert (points[inside, 1] <= read.max_y).all()


def test_upright_window_is_no_larger_than_needed() -> None:
    frame = made(matrix_of(2.0, (90.0, 0.0, 0.0), [0.0, 0.0, 0.0]), None, "m")
    read = frame.window_to_source(Window(-10.0, -20.0, 30.0, 40.0))
    # A quarter turn: x of the frame is -y of the cloud, y is its x; each halved.
    found = (read.min_x, read.min_y, read.max_x, read.max_y)
    east, north = 576_700.0, 5_188_140.0
    assert found == pytest.approx((east - 10.0, north - 15.0, east + 20.0, north + 5.0), abs=1e-6)


@pytest.mark.parametrize(
    ("angles", "upright"),
    [
        ((0.0, 0.0, 0.0), True),
        ((77.0, 0.0, 0.0), True),
        ((77.0, 0.0, 1e-6), True),
        ((77.0, 0.0, 1e-3), False),
        ((0.0, 30.0, 0.0), False),
        ((0.0, 90.0, 0.0), False),
        ((10.0, 0.0, 180.0), True),  # upside down: the vertical is the vertical
    ],
)
@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_upright_is_what_keeps_the_vertical(angles, upright: bool, scale: float) -> None:
    assert made(matrix_of(scale, angles, [0.0, 0.0, 0.0]), None, "m").is_upright is upright


def test_own_crs_keeps_its_unit() -> None:
    base = measuring_frame("EPSG:2229", None, BOX)
    own = placed_frame(base, np.eye(4), base.crs, 0.9999, BOX)
    assert own.crs == base.crs == "EPSG:2229"
    assert (own.unit_m, own.z_unit_m, own.grid_crs) == (base.unit_m, base.z_unit_m, base.grid_crs)
    assert own.placement.ground_factor == 0.9999
    other = placed_frame(base, np.eye(4), "EPSG:32611", None, BOX)
    assert other.crs == other.grid == "EPSG:32611"
    assert (other.unit_m, other.z_unit_m, other.grid_crs) == (1.0, 1.0, None)
    assert other.delivered is base


def test_unit_nobody_said_is_no_longer_warned_of() -> None:
    base = measuring_frame(None, None, BOX)
    assert base.length_unit == "unknown"
    assert base.warnings
    placed = placed_frame(base, TILTED, None, None, BOX)
    assert (placed.length_unit, placed.warnings, placed.crs) == ("m", (), None)


def test_warnings_of_the_cloud_are_kept() -> None:
    base = measuring_frame("EPSG:2229", None, BOX)
    assert base.warnings
    assert placed_frame(base, TILTED, None, None, BOX).warnings == base.warnings


def test_frame_without_control_is_its_own_delivered_frame() -> None:
    frame = measuring_frame("EPSG:2229", None, BOX)
    assert frame.delivered is frame
    assert np.array_equal(frame.matrix, np.eye(4))
    assert frame.is_upright
    assert frame.elevation(12.3, 4.0, 5.0) == 12.3


def test_elevation_of_a_tilted_cloud_is_that_of_its_place() -> None:
    frame = made(TILTED, None, "m")
    x, y, z = frame.to_frame(*np.array([[576_660.0], [5_188_100.0], [310.0]]))
    assert frame.elevation(310.0, 576_660.0, 5_188_100.0) == z[0]
    assert frame.elevation(310.0, 576_670.0, 5_188_100.0) != z[0]
