"""Walls and clefts that are too narrow for the points: fins of a block, and a saw cut."""

from __future__ import annotations

import numpy as np
import pytest
from scans import OFFSET, volume_of
from solids import box_part, union

from quantify_client.types import AreaResult

BLOCK = box_part((0, 0, 0), (1, 1, 1))
FOOT = box_part((-0.01, -0.01, 0), (1.01, 1.01, 0.3))

#: Points are 0.04 m apart.
COUNT = 5_000


@pytest.mark.parametrize("noise", [0.0, 0.004])
@pytest.mark.parametrize("thickness", [0.01, 0.02, 0.04])
def test_a_fin_is_measured(thickness: float, noise: float) -> None:
    """They were left out, with an interval of 11 % of the block."""
    low, high = 0.5 - thickness / 2, 0.5 + thickness / 2
    parts = [BLOCK, box_part((0.9, low, 0.2), (1.5, high, 0.8))]
    result = assert_measured(parts, 1.0 + 0.3 * thickness, noise)
    assert any("most of the thin walls that they may be" in line for line in result.warnings)


@pytest.mark.parametrize("noise", [0.0, 0.004])
@pytest.mark.parametrize("width", [0.01, 0.02, 0.04])
def test_a_saw_cut_is_left_out(width: float, noise: float) -> None:
    """It was filled, with an interval of 15 %."""
    left = box_part((0, 0, 0.2), (0.5 - width / 2, 1, 1))
    right = box_part((0.5 + width / 2, 0, 0.2), (1, 1, 1))
    assert_measured([left, right, FOOT], 1.02**2 * 0.3 + 0.7 * (1.0 - width), noise)


def assert_measured(parts: list, truth: float, noise: float) -> AreaResult:
    rng = np.random.default_rng(int(1e4 * truth))
    points = union("block", parts, truth).surface(COUNT, rng)
    points += noise * rng.standard_normal(points.shape)
    result = volume_of(points + OFFSET, hollow=True)
    error = result.volume_m3 / truth - 1.0
    assert abs(error) < 0.012
    assert abs(error) < 1.96 * result.std_m3 / truth < 0.035
    return result
