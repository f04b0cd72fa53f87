"""Walls beside an area: the ground behind them is not what a pile at their foot stands on."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from shapely import affinity
from shapely.geometry import Point, box

from quantify_client.types import Window
from quantify_client.volcalc.terrain.accumulate import TerrainAccumulator
from quantify_client.volcalc.terrain.grid import cell_parts
from quantify_client.volcalc.terrain.grid_offsets import measure_area
from quantify_client.volcalc.terrain.measure import TerrainRecipe
from quantify_client.volcalc.terrain.walls import find_walls

from .grounds import EAST, LEVEL, NORTH, at_site, centres, ground_under

pytestmark = pytest.mark.one_python

HALF = Point(0, 0).buffer(8, 64).intersection(box(0.3, -20, 20, 20))


def half_cone(x, y):
    """4 m high against a wall of 6 m at x = 0, with high ground behind it."""
    return np.where(x < 0, 6.0, 4.0 * np.clip(1 - np.hypot(x, y) / 7, 0, None))


def measured(form, outline, seed=0):
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-30, 30, (2, 40_000))
    z = LEVEL + 0.05 * x + form(x, y) + 0.01 * rng.standard_normal(len(x))
    placed = affinity.translate(outline, EAST, NORTH)
    accumulator = TerrainAccumulator([Window(*placed.bounds)])
    accumulator.absorb(accumulator.reduce(x + EAST, y + NORTH, z))
    points = accumulator.points_of(0)
    return measure_area("a", points.to_local(placed), points, TerrainRecipe())


@pytest.mark.parametrize("turn", [0.0, 17.0, 45.0])
def test_a_pile_against_a_wall_stands_on_the_ground_before_it(turn):
    """Half a cone, without the strip of 0.3 m beside the wall: a section's area along it."""
    angle = np.radians(turn)

    def turned(x, y):
        return half_cone(
            x * np.cos(angle) + y * np.sin(angle), y * np.cos(angle) - x * np.sin(angle)
        )

    result = measured(turned, affinity.rotate(HALF, turn, origin=(0, 0)))
    whole = np.pi * 7**2 * 4 / 3 / 2
    x = (np.arange(300) + 0.5) / 1000
    y = np.linspace(-7, 7, 2001)
    strip = 0.3 * float(half_cone(x[:, None], y).mean()) * 14
    assert result.volume_m3 == pytest.approx(whole - strip, rel=0.015)
    assert result.warnings[0].code == "outline-at-wall"
    assert result.warnings[0].values["share"] == pytest.approx(16 / (16 + np.pi * 8), abs=0.08)
    assert result.warnings[0].values["height_m"] == pytest.approx(6.0, abs=0.7)


def walls_of(form, outline):
    """Of cells 0.25 m wide, on a slope of 10 %."""
    heights = ground_under(at_site(outline), lambda x, y: form(x, y) + 0.1 * x, noise=0.01)
    return find_walls(heights, cell_parts(at_site(outline), heights.window).share), heights.window


@pytest.mark.parametrize("slope", [0.0, 0.7, 0.85])
def test_what_loose_material_can_be_is_no_wall(slope):
    def cone(x, y):
        return np.clip(4 - slope * np.hypot(x, y), 0, None)

    walls, _ = walls_of(cone, Point(0, 0).buffer(7, 64))
    assert walls.off is None


def test_what_is_behind_a_wall_or_far_below_is_off_the_ground():
    """A yard between a terrace of 5 m, 2 m away, and a pit of 4 m that the outline is not at."""

    def yard(x, y):
        return np.where(x < -7, 5.0, np.where(x > 9, -4.0, 0.0))

    walls, window = walls_of(yard, box(-5, -5, 5, 5))
    x, _ = centres(window)
    assert walls.off[np.abs(x - 1) < 7].sum() == 0
    assert walls.off[(x < -8) | (x > 10)].all()


def test_a_pit_with_walls_is_measured_from_the_ground_above():
    def pit(x, y):
        return np.where(np.maximum(np.abs(x), np.abs(y)) < 5, -3.0, 0.0)

    for half in (6.0, 5.2):
        result = measured(pit, box(-half, -half, half, half))
        assert result.volume_m3 == pytest.approx(-300, rel=0.02)
        assert result.warnings == ()


def test_boxes_are_neither_too_small_nor_more_certain_than_they_are():
    """Walls of 3 m, 0.3 m between points: how many of a cell are on top is chance, and said so."""
    off, stds = [], []
    for seed in range(24):
        rng = np.random.default_rng(seed)
        turn, (east, north) = rng.uniform(0, 90), rng.uniform(-1, 1, 2)
        form = affinity.translate(affinity.rotate(box(-3.1, -2.3, 3.1, 2.3), turn), east, north)
        outline = affinity.translate(affinity.rotate(box(-4.5, -3.7, 4.5, 3.7), turn), east, north)

        def walled(x, y, form=form):
            return 3.0 * shapely.contains_xy(form, x, y)

        result = measured(walled, outline, seed)
        off.append(result.volume_m3 - 3.0 * 6.2 * 4.6)
        stds.append(result.std_m3)
    off, z = np.array(off), np.array(off) / np.array(stds)
    # The mean is known to a fifth of their scatter.
    assert abs(off.mean()) < 0.01 * 3.0 * 6.2 * 4.6
    assert 0.5 < np.sqrt(np.mean(z**2)) < 1.25


@pytest.mark.parametrize("off_walls", [2.0, 3.0])
def test_a_heap_in_a_pit_with_walls_stands_on_its_floor(off_walls):
    def heap(x, y):
        pit = np.where(np.maximum(np.abs(x), np.abs(y)) < 10, -4.0, 0.0)
        return pit + 2.0 * np.clip(1 - np.hypot(x, y) / 4, 0, None)

    half = 10 - off_walls
    result = measured(heap, box(-half, -half, half, half))
    assert result.volume_m3 == pytest.approx(np.pi * 16 * 2 / 3, rel=0.02)
