"""The flooded cells know nothing of sections, and come to the same volume."""

import numpy as np
import pytest
from scans import OFFSET, scan
from scipy.spatial.transform import Rotation
from solids import BODIES, cube, cup, sphere

from quantify_client.volcalc.body.occupancy import occupancy_volume


@pytest.mark.parametrize("name", ["sphere", "cube", "cube, rotated", "torus, lying"])
def test_volumes_of_known_bodies(name):
    body = BODIES[name]()
    points = scan(body, 15_000, 5)
    assert occupancy_volume(points).volume == pytest.approx(body.volume, rel=0.007)


def test_two_balls_are_the_sum_of_both():
    points = scan(sphere(), 6000, 5) - OFFSET
    both = occupancy_volume(np.vstack([points, points + np.array([1.5, 0.2, 0.1])]))
    assert both.volume == pytest.approx(2 * np.pi / 6, rel=0.01)


def test_the_volume_does_not_depend_on_the_cells_place_or_turn():
    points = scan(cube(), 10_000, 5) - OFFSET
    volumes = [
        occupancy_volume((points + shift) @ Rotation.from_rotvec(turn).as_matrix()).volume
        for shift, turn in [((0, 0, 0), (0, 0, 0)), ((0.013, 0.007, 0), (0.3, 0.5, -0.2))]
    ]
    assert volumes[0] == pytest.approx(volumes[1], rel=0.01)


def test_a_body_of_another_size_is_the_same_body():
    points = scan(sphere(), 4000, 5) - OFFSET
    assert occupancy_volume(points * 8.0).volume == pytest.approx(
        512.0 * occupancy_volume(points).volume, rel=1e-9
    )


@pytest.mark.parametrize("rest", [0.5, 0.8])
def test_an_open_bowl_is_flooded(rest):
    points = scan(sphere(), 6000, 5) - OFFSET
    assert occupancy_volume(points[points[:, 2] < rest - 0.5]) is None


def test_the_inside_of_a_cup_is_flooded_and_its_walls_are_not():
    body = cup(inner=0.3, floor=0.2)
    assert occupancy_volume(scan(body, 12_000, 5)).volume == pytest.approx(body.hollow, rel=0.02)


def test_a_sheet_encloses_nothing():
    points = np.random.default_rng(0).random((4000, 3)) * [1.0, 1.0, 0.001]
    assert occupancy_volume(points) is None
