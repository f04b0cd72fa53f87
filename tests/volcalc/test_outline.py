"""The cloud's own outline."""

from __future__ import annotations

import numpy as np
import pytest

from quantify_client.errors import SupportError
from quantify_client.types import Window
from quantify_client.volcalc.terrain.accumulate import TerrainAccumulator
from quantify_client.volcalc.terrain.outline import cloud_outline

from .grounds import EAST, LEVEL, NORTH

CLOUD = Window(EAST, NORTH, EAST + 30, NORTH + 30)


def outlined(keep, count=40_000):
    x, y = np.random.default_rng(0).uniform(0, 30, (2, count))
    kept = keep(x, y)
    accumulator = TerrainAccumulator([CLOUD], room=False)
    z = np.full(np.count_nonzero(kept), LEVEL)
    accumulator.absorb(accumulator.reduce(EAST + x[kept], NORTH + y[kept], z))
    return cloud_outline(accumulator.points_of(0))


def outline_of(keep, count=40_000):
    return outlined(keep, count).polygon


def test_outline_of_a_disc_is_a_disc_less_an_edge_of_cells():
    disc = outline_of(lambda x, y: np.hypot(x - 15, y - 15) < 12)
    assert disc.is_valid
    assert disc.geom_type == "Polygon"
    assert np.pi * 11**2 < disc.area < np.pi * 12**2
    assert disc.centroid.x == pytest.approx(15, abs=0.1)
    assert disc.centroid.y == pytest.approx(15, abs=0.1)


def test_holes_are_closed():
    ring = outline_of(lambda x, y: (np.hypot(x - 15, y - 15) < 12) & (np.hypot(x - 15, y - 15) > 4))
    assert len(ring.interiors) == 0
    assert ring.area > np.pi * 11**2


def test_islands_are_parts_and_specks_are_not():
    outline = outline_of(
        lambda x, y: (x < 12) | (x > 20) & (y > 15) | (np.hypot(x - 20, y - 5) < 0.8)
    )
    assert outline.geom_type == "MultiPolygon"
    assert len(outline.geoms) == 2


def test_the_share_of_points_outside_is_what_the_edge_does_not_explain():
    disc = outlined(lambda x, y: np.hypot(x - 15, y - 15) < 12)
    assert disc.away == 0.0
    small = lambda x, y: np.hypot(x % 3 - 1.5, y % 3 - 1.5) < 0.7  # noqa: E731
    islands = outlined(lambda x, y: (np.hypot(x - 15, y - 15) < 8) | small(x, y) & (x < 5))
    x, y = np.random.default_rng(0).uniform(0, 30, (2, 40_000))
    away = small(x, y) & (x < 5) & (np.hypot(x - 15, y - 15) > 8)
    share = away.sum() / (away | (np.hypot(x - 15, y - 15) < 8)).sum()
    assert islands.away == pytest.approx(share, abs=0.02)
    assert share > 0.1


def test_points_too_far_apart_to_touch_are_refused_in_words():
    with pytest.raises(SupportError, match="--area"):
        outline_of(lambda x, y: x < 0.15, count=300)
