"""How deep a surface buries points, and what that makes of the volume of thin walls."""

from __future__ import annotations

import numpy as np
import pytest
from scans import OFFSET, volume_of
from solids import cup

from quantify_client.volcalc.body.buried import depths
from quantify_client.volcalc.body.sections import BodySurface

# Arithmetic of arrays: no different on a second Python.
pytestmark = pytest.mark.one_python

CORNERS = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
WALLS = np.array([[0, 1, 5], [0, 5, 4], [2, 6, 7], [2, 7, 3], [0, 2, 3], [0, 3, 1]])


def test_depth_is_the_distance_from_the_nearest_triangle() -> None:
    surface = BodySurface.of(CORNERS, WALLS)  # y = 0, y = 1 and x = 0
    points = np.array([[0.5, 0.2, 0.5], [0.1, 0.4, 0.9], [0.0, 1.0, 1.0], [0.9, 0.7, 0.3]])
    assert depths(points, surface) == pytest.approx([0.2, 0.1, 0.0, 0.3])


@pytest.mark.parametrize("hollow", [True, False])
@pytest.mark.parametrize("noise", [0.0, 0.06])
@pytest.mark.parametrize(("wall", "count"), [(0.04, 8_000), (0.05, 16_000)])  # 1.8, 2.9 spacings
def test_thin_walls_are_right_to_their_interval(
    hollow: bool, noise: float, wall: float, count: int
) -> None:
    rng = np.random.default_rng(11)
    body = cup(inner=0.5 - wall, floor=wall)
    points = body.surface(count, rng) + rng.normal(0.0, noise * wall, (count, 3)) + OFFSET
    result = volume_of(points, hollow=hollow, floor="none")
    truth = body.hollow if hollow else body.volume
    assert result.volume_m3 == pytest.approx(truth, rel=0.03)
    assert abs(result.volume_m3 - truth) < 2.5 * result.std_m3
    assert "walls-too-thin" in {notice.code for notice in result.warnings}


@pytest.mark.parametrize("noise", [0.1, 0.3])
def test_noise_of_a_single_surface_may_be_no_body_at_all(noise: float) -> None:
    rng = np.random.default_rng(1)
    flat = np.column_stack([rng.uniform(-12, 12, (10_000, 2)), rng.normal(0, noise, 10_000)])
    result = volume_of(flat + OFFSET, floor="none")
    assert "walls-too-thin" in {notice.code for notice in result.warnings}
    assert abs(result.volume_m3) < 1.96 * result.std_m3


@pytest.mark.parametrize("hollow", [True, False])
def test_points_all_through_space_enclose_no_less_than_nothing(hollow: bool) -> None:
    """What the surface holds too much was more than all of it: -27 and -35 m3."""
    result = volume_of(np.random.default_rng(0).normal(size=(2_000, 3)) + OFFSET, hollow=hollow)
    assert 0.0 <= result.volume_m3 < 1.96 * result.std_m3
