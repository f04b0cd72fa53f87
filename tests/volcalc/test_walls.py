"""Walls beside an area: the ground behind them is not what a pile at their foot stands on."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from shapely import affinity
from shapely.geometry import Point, Polygon, box

from quantify_client.types import Window
from quantify_client.volcalc.terrain.accumulate import TerrainAccumulator
from quantify_client.volcalc.terrain.grid import cell_parts
from quantify_client.volcalc.terrain.grid_offsets import measure_area
from quantify_client.volcalc.terrain.heights import cell_heights, fit_cells
from quantify_client.volcalc.terrain.measure import TerrainRecipe
from quantify_client.volcalc.terrain.walls import find_walls, heights_at_walls

from .grounds import EAST, LEVEL, NORTH, at_site, centres, ground_under

pytestmark = pytest.mark.one_python

HALF = Point(0, 0).buffer(8, 64).intersection(box(0.3, -20, 20, 20))


def half_cone(x, y):
    """4 m high against a wall of 6 m at x = 0, with high ground behind it."""
    return np.where(x < 0, 6.0, 4.0 * np.clip(1 - np.hypot(x, y) / 7, 0, None))


def measured(form, outline, seed=0, count=40_000):
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-30, 30, (2, count))
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


# --- what single points show: walls that are lower, or thinner, than a cell


def codes(result):
    return [notice.code for notice in result.warnings]


@pytest.mark.parametrize(("height", "turn"), [(1.6, 0.0), (1.6, 30.0), (2.5, 17.0)])
def test_ground_behind_a_low_wall_is_left_out(height, turn):
    """A wall of less than two cells, between ground on two levels, and half a cone before it."""
    a = np.radians(turn)

    def before(x, y):
        u, v = x * np.cos(a) + y * np.sin(a), y * np.cos(a) - x * np.sin(a)
        return np.where(u < 0, height, 1.5 * np.clip(1 - np.hypot(u, v) / 6, 0, None))

    outline = Point(0, 0).buffer(7, 64).intersection(box(0.2, -20, 20, 20))
    result = measured(before, affinity.rotate(outline, turn, origin=(0, 0)), count=20_000)
    x, y = (np.arange(200) + 0.5) / 1000, np.linspace(-6, 6, 2001)
    strip = 0.2 * float((1.5 * np.clip(1 - np.hypot(x[:, None], y) / 6, 0, None)).mean()) * 12
    assert result.cell_m == pytest.approx(1.0, abs=0.25)
    assert result.volume_m3 == pytest.approx(np.pi * 36 * 1.5 / 3 / 2 - strip, rel=0.025)
    assert abs(result.volume_m3 - (np.pi * 9 - strip)) < 2.5 * result.std_m3
    assert "outline-at-wall" in codes(result)


def test_a_wall_thinner_than_a_cell_is_told_and_no_end_of_the_pile():
    """A corner of two walls 0.4 m thick, in cells of 0.8 m; the ground behind is as before."""

    def bay(x, y):
        heap = 3.0 * np.clip(1 - np.hypot(x - 3, y - 3) / 7, 0, None)
        wall = (np.minimum(x, y) > -0.4) & (np.minimum(x, y) < 0) & (np.maximum(x, y) < 12)
        return np.where((x > 0) & (y > 0), heap, 3.2 * wall)

    outline = Point(3, 3).buffer(8, 64).intersection(box(0.3, 0.3, 20, 20))
    result = measured(bay, outline, count=26_000)
    x = np.linspace(0.3, 11, 2001)
    u, v = np.meshgrid(x, x)
    volume = float((3.0 * np.clip(1 - np.hypot(u - 3, v - 3) / 7, 0, None)).mean()) * 10.7**2
    assert result.cell_m > 0.6
    assert result.volume_m3 == pytest.approx(volume, rel=0.015)
    assert codes(result)[0] == "outline-at-wall"
    # Cells across it hold the ground on both sides, too.
    assert 1.8 < result.warnings[0].values["height_m"] < 3.3


def test_the_edge_of_a_box_is_a_step_but_no_wall_before_it():
    """The outline is 0.3 m inside: it is told, and another one beyond the edge is proposed."""

    def container(x, y):
        return 2.5 * ((np.abs(x) < 3) & (np.abs(y) < 4))

    result = measured(container, box(-2.7, -3.7, 2.7, 3.7), count=26_000)
    assert {"outline-at-wall", "outline-on-pile"} <= set(codes(result))
    proposed = shapely.from_wkb(result.relief.proposal_wkb)
    # All but the corners.
    edge = at_site(box(-3, -4, 3, 4)).exterior
    assert edge.difference(proposed).length < 0.2 * edge.length


@pytest.mark.parametrize(("slope", "known"), [(1.3, False), (0.0, True)])
def test_only_steps_are_walls_and_no_even_slope(slope, known):
    """52 degrees, or a step of 2 m: what chance makes of a cell is that of its step."""
    area = at_site(box(-4, -4, 4, 4))
    rng = np.random.default_rng(1)
    x, y = rng.uniform(-12, 12, (2, 9_000))
    z = LEVEL + slope * x + (0.0 if slope else 2.0 * (x > 0.1)) + 0.01 * rng.standard_normal(9_000)
    accumulator = TerrainAccumulator([Window(*area.bounds)])
    accumulator.absorb(accumulator.reduce(x + EAST, y + NORTH, z))
    points = accumulator.points_of(0)
    polygon = points.to_local(area)
    cubes = fit_cells(points.cubes, Window(*polygon.bounds))
    heights = cell_heights(cubes, Window(*polygon.bounds))
    fraction = cell_parts(polygon, heights.window).share
    steep = fraction > 0
    at, error = heights_at_walls(polygon, cubes, heights.window, heights.z, steep)
    x, _ = heights.window.middles(steep)
    x = x + points.origin[0] - EAST - 0.1
    beside = np.abs(x) < 0.5 * heights.window.cell if known else np.isfinite(x)
    share = np.isfinite(at[steep][beside]).mean()
    assert share > 0.7 if known else share < 0.1
    if known:
        # A cell of n points, half of them 2 m up: 1 m over the square root of n.
        across = np.nanmax(error)
        assert 1.0 / np.sqrt(12) < across < 1.0 / np.sqrt(1.5)


@pytest.mark.parametrize("height", [1.0, 2.0, 4.0])
def test_ground_behind_a_curved_bank_is_left_out(height):
    """Along a third of a round outline with many corners: its hull holds the pile."""

    def bank(x, y):
        r = np.hypot(x, y)
        pile = np.clip(5.0 - 0.6 * r, 0, 2.5)
        return pile + height * ((np.abs(np.arctan2(y, x)) < 1.0) & (r > 8.83))

    result = measured(bank, Point(0, 0).buffer(8.63, 32), seed=3, count=70_000)
    r = np.linspace(0, 25 / 3, 20_001)
    ring = 2 * np.pi * r * np.clip(5.0 - 0.6 * r, 0, 2.5)
    volume = float(ring.sum() * (r[1] - r[0]))
    assert result.volume_m3 == pytest.approx(volume, rel=0.005)
    assert codes(result)[0] == "outline-at-wall"


def test_an_outline_with_most_of_its_corners_at_one_place_is_no_matter():
    """As tools write that union what they drew: a hundred times the same corner."""

    def wall(x, y):
        return np.where(x < 0, 2.0, 1.5 * np.clip(1 - np.hypot(x, y) / 6, 0, None))

    plain = Point(0, 0).buffer(7, 16).intersection(box(0.2, -20, 20, 20))
    ring = list(plain.exterior.coords)
    crowded = Polygon([ring[0]] * 100 + [(x + 1e-9, y) for x, y in [ring[1]] * 200] + ring[2:])
    one, other = (measured(wall, outline, count=20_000) for outline in (plain, crowded))
    assert other.volume_m3 == pytest.approx(one.volume_m3, rel=0.01)
