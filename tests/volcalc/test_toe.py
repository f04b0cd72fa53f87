"""Outlines on the pile are told, with the way to its toe; those on the ground are not."""

from __future__ import annotations

import numpy as np
import pytest
from shapely import affinity
from shapely.geometry import Point, box

from quantify_client.types import Window
from quantify_client.volcalc.terrain.accumulate import TerrainAccumulator
from quantify_client.volcalc.terrain.grid_offsets import measure_area
from quantify_client.volcalc.terrain.measure import TerrainRecipe

from .grounds import EAST, LEVEL, NORTH

pytestmark = pytest.mark.one_python


def cone(x, y, at=0.0, radius=8.0, top=4.0):
    return top * np.clip(1 - np.hypot(x - at, y) / radius, 0, None)


def circle(radius):
    return Point(0, 0).buffer(radius, 64)


def notices(form, outline, base="kriged", seed=0, blind=(0.0, 0.0)):
    """By code: of a survey of 60 m x 60 m with noise of 1 cm, on a slope of 10 %."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-30, 30, (2, 30_000))
    seen = (np.hypot(x, y) < blind[0]) | (np.hypot(x, y) >= blind[1])
    x, y = x[seen], y[seen]
    z = LEVEL + 0.1 * x + form(x, y) + 0.01 * rng.standard_normal(len(x))
    placed = affinity.translate(outline, EAST, NORTH)
    accumulator = TerrainAccumulator([Window(*placed.bounds)])
    accumulator.absorb(accumulator.reduce(x + EAST, y + NORTH, z))
    points = accumulator.points_of(0)
    result = measure_area("a", points.to_local(placed), points, TerrainRecipe(base=base))
    return {notice.code: notice.values for notice in result.warnings}


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("inside", [0.8, 1.5, 3.0])
def test_the_toe_is_as_far_out_as_the_outline_is_inside_of_it(inside, sign):
    """Heights at the outline are the slope, 0.5, times the way."""
    found = notices(lambda x, y: sign * cone(x, y), circle(8 - inside))
    assert list(found) == ["outline-on-pile"]
    assert found["outline-on-pile"]["share"] > 0.7
    assert found["outline-on-pile"]["toe_m"] == pytest.approx(inside, abs=0.9)
    assert found["outline-on-pile"]["height_m"] == pytest.approx(0.5 * inside, abs=0.05)


@pytest.mark.parametrize("base", ["kriged", "triangulate", "plane", LEVEL])
def test_an_outline_on_the_ground_is_not_told(base):
    assert notices(cone, circle(9.0), base) == {}
    assert notices(cone, circle(8.1), base) == {}


def test_a_toe_under_water_is_out_of_sight():
    """Without points from 6.6 to 11 m."""
    found = notices(cone, circle(4.0), blind=(6.6, 11.0))
    assert found["outline-on-pile"]["toe_m"] is None


def test_an_outline_across_a_neighbour_is_told():
    def both(x, y):
        return np.maximum(cone(x, y), cone(x, y, at=13.0, radius=6.0, top=3.0))

    found = notices(both, circle(9.0))
    assert list(found) == ["outline-crosses-neighbour"]
    # 2 m of the neighbour inside of a circle of 57 m; it is 7.6 m wide there.
    assert found["outline-crosses-neighbour"]["share"] == pytest.approx(0.13, abs=0.05)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_dams_and_channels_that_go_on_are_neither(sign):
    def dam(x, y):
        return sign * 1.5 * np.clip(1 - np.abs(x) / 5, 0, None)

    assert notices(dam, box(-6, -10, 6, 10)) == {}


@pytest.mark.parametrize("radius", [3.0, 4.0, 6.0])
def test_an_outline_well_inside_of_a_pile_is_told(radius):
    """No ground is near: what is predicted climbs the flanks."""

    def both(x, y):
        return np.maximum(cone(x, y, radius=7.0), cone(x, y, at=9.0, radius=7.0, top=3.5))

    assert next(iter(notices(both, circle(radius)))) == "outline-on-pile"
    assert next(iter(notices(cone, circle(radius)))) == "outline-on-pile"
