"""The shoelace formula on polygons whose area is known from elsewhere."""

import numpy as np
import pytest

from quantify_client.volcalc.paper import ring_areas

EAST, NORTH = 576_710.5, 5_188_139.0


def area_of(x, y):
    """Area of one polygon, counted from its first vertex."""
    return ring_areas(x - x[:1], y - y[:1], np.zeros(len(x), np.int64), 1)[0]


@pytest.mark.parametrize(
    ("vertices", "area"),
    [
        ([(0, 0), (1, 0), (1, 1), (0, 1)], 1.0),
        ([(0, 0), (0, 1), (1, 1), (1, 0)], -1.0),
        ([(0, 0), (3, 0), (0, 4)], 6.0),
        # An L of three unit squares, and a pentagon whose area is 30 by Pick's theorem
        # (27 interior and 8 boundary points of the grid).
        ([(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)], 3.0),
        ([(3, 4), (5, 11), (12, 8), (9, 5), (5, 6)], 30.0),
        ([(0, 0), (1, 1), (2, 2)], 0.0),
        ([(0, 0), (1, 1)], 0.0),
        ([(0, 0)], 0.0),
        ([], 0.0),
        ([(0, 0), (1, 0), (np.nan, 1)], np.nan),
    ],
)
@pytest.mark.parametrize("offset", [(0.0, 0.0), (EAST, NORTH)])
def test_known_polygons(vertices, area, offset):
    x, y = (np.array(vertices, dtype=float).reshape(-1, 2) + offset).T
    assert abs(area_of(x, y)) == pytest.approx(abs(area), abs=1e-8, nan_ok=True)
    if area not in (0.0, 30.0) and not np.isnan(area):
        assert np.sign(area_of(x, y)) == np.sign(area)


def test_rings_of_one_array_do_not_mix():
    angle = 2.0 * np.pi * np.arange(6) / 6
    x = np.concatenate([np.cos(angle), [0.0, 5.0, 5.0, 0.0]])
    y = np.concatenate([np.sin(angle), [0.0, 0.0, 2.0, 2.0]])
    areas = ring_areas(x, y, np.array([1] * 6 + [3] * 4), 5)
    assert areas == pytest.approx([0.0, 1.5 * np.sqrt(3.0), 0.0, 10.0, 0.0])
