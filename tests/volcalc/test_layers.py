"""Cells with two surfaces over each other: what is one, what is not, and what is measured."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely.geometry import Point, Polygon, box
from shapely.geometry.base import BaseGeometry

from quantify_client.types import Window
from quantify_client.volcalc.terrain.accumulate import AreaPoints, TerrainAccumulator
from quantify_client.volcalc.terrain.grid_offsets import measure_area
from quantify_client.volcalc.terrain.heights import LOWER, UPPER, fit_cells
from quantify_client.volcalc.terrain.layers import NO_LAYERS, find_layers
from quantify_client.volcalc.terrain.measure import TerrainRecipe
from quantify_client.volcalc.terrain.outlying import mark_outliers

from .grounds import EAST, LEVEL, NORTH, at_site

YARD = box(-6, -6, 6, 6)
LAYERS = ("lower", "mean", "upper")


def places(count=30_000, seed=0, half=20.0):
    """Places at random over a yard that goes on around the area."""
    return np.random.default_rng(seed).uniform(-half, half, (2, count))


def points_of(x, y, z, outline=YARD):
    """The outline and points of a yard, from the local origin."""
    area = at_site(outline)
    accumulator = TerrainAccumulator([Window(*area.bounds)])
    accumulator.absorb(accumulator.reduce(EAST + x, NORTH + y, LEVEL + z))
    points = accumulator.points_of(0)
    return points.to_local(area), points


def found_in(polygon: BaseGeometry, points: AreaPoints):
    """Marked cubes and what is said of them."""
    bounds = Window(*polygon.bounds)
    return find_layers(mark_outliers(fit_cells(points.cubes, bounds), bounds), polygon)


def result(x, y, z, layer="upper", base=LEVEL, outline=YARD):
    polygon, points = points_of(x, y, z, outline)
    return measure_area("yard", polygon, points, TerrainRecipe(base=base, layer=layer))


def crowned(x, y, share, height=3.0, crown=None, seed=1):
    """Heights of a flat yard, of which a share of the points under a crown are on its top."""
    rng = np.random.default_rng([seed, 77])
    under = np.ones(len(x), bool) if crown is None else crown(x, y)
    seen = under & (rng.random(len(x)) < share)
    return np.where(seen, height, 0.0) + rng.normal(0, 0.01, len(x))


def told(result):
    return [notice for notice in result.warnings if notice.code == "two-surfaces"]


# --- volumes in closed form


@pytest.mark.parametrize(
    "share", [0.5, *(pytest.param(share, marks=pytest.mark.one_python) for share in (0.3, 0.7))]
)
def test_a_crown_over_the_whole_yard_has_the_volume_of_each_surface_and_of_their_mean(share):
    x, y = places()
    z = crowned(x, y, share, crown=lambda x, y: (np.abs(x) < 10) & (np.abs(y) < 10))
    mean = z[(np.abs(x) < 6) & (np.abs(y) < 6)].mean()
    for layer, height in (("upper", 3.0), ("lower", 0.0), ("mean", mean)):
        found = result(x, y, z, layer)
        # Cells of few points and of many count alike in the mean of both layers.
        assert found.volume_m3 == pytest.approx(height * 144, abs=6 if layer == "mean" else 0.5)
        (notice,) = told(found)
        assert notice.values["share"] > 0.99
        assert notice.values["apart_m"] == pytest.approx(3.0, abs=0.05)
        assert notice.values["layer"] == layer


@pytest.mark.parametrize("share", [0.3, pytest.param(0.5, marks=pytest.mark.one_python)])
@pytest.mark.parametrize("layer", ["upper", "lower"])
def test_the_interval_holds_where_a_crown_ends_in_the_yard(layer, share):
    """A disc of 4 m radius 3 m above a tilted yard: pi r^2 3 above the ground, or nothing."""
    truth = 48 * np.pi if layer == "upper" else 0.0
    for seed in range(4):
        x, y = places(seed=seed)
        z = crowned(x, y, share, crown=lambda x, y: np.hypot(x - 0.3, y + 0.7) < 4, seed=seed)
        found = result(x, y, z + 0.05 * x, layer, base="kriged")
        low, high = found.interval95_m3
        assert low < truth < high
        assert abs(found.volume_m3 - truth) < 15
        (notice,) = told(found)
        assert notice.values["share"] == pytest.approx(16 * np.pi / 144, abs=0.05)
        assert {item.source for item in found.budget} >= {"layer"}


def test_a_tree_beside_a_house_is_two_surfaces_and_the_house_is_one():
    x, y = places(60_000)
    house = (x > 0) & (x < 5) & (np.abs(y) < 5)
    z = crowned(x, y, 0.5, crown=lambda x, y: np.hypot(x + 2, y) < 2) + 4.0 * house
    tree = 12 * np.pi
    for layer, volume in (("upper", 200 + tree), ("lower", 200.0), ("mean", 200 + tree / 2)):
        assert result(x, y, z, layer).volume_m3 == pytest.approx(volume, abs=6)


@pytest.mark.one_python
def test_the_ground_around_is_the_lower_surface_whichever_is_measured():
    x, y = places()
    # A cone of 4 m radius and 2 m height in a ring of trees that begins beyond the outline.
    cone = 2 * np.clip(1 - np.hypot(x, y) / 4, 0, None)
    trees = crowned(x, y, 0.5, crown=lambda x, y: np.maximum(np.abs(x), np.abs(y)) > 6.6)
    for layer in LAYERS:
        found = result(x, y, cone + trees, layer, base="kriged")
        assert found.volume_m3 == pytest.approx(32 * np.pi / 3, abs=1.5)
        assert not told(found)


@pytest.mark.one_python
@settings(max_examples=8, deadline=None)
@given(
    share=st.floats(0.05, 0.95),
    height=st.floats(0.3, 8.0),
    radius=st.floats(0.5, 9.0),
    seed=st.integers(0, 10**6),
)
def test_lower_is_no_more_than_mean_and_mean_no_more_than_upper(share, height, radius, seed):
    x, y = places(8_000, seed)
    z = crowned(x, y, share, height, lambda x, y: np.hypot(x, y) < radius, seed)
    lower, mean, upper = (result(x, y, z, layer).volume_m3 for layer in LAYERS)
    # Interpolated heights are those of neighbours, which may be some noise lower or higher.
    assert lower <= mean + 0.1
    assert mean <= upper + 0.1


# --- what is one surface


def a_wall(angle, at=0.3):
    turned = np.radians(angle)
    return lambda x, y: 3.0 * (np.cos(turned) * x + np.sin(turned) * y > at)


def boxes(width, every=3.0):
    return lambda x, y: 3.0 * ((np.mod(x, every) < width) & (np.mod(y, every) < width))


def slope(degrees):
    return lambda x, y: np.tan(np.radians(degrees)) * x


def some_points(share, *heights, seed=4):
    """Points at random that are off by one of some heights."""
    rng = np.random.default_rng(seed)
    return lambda x, y: np.where(rng.random(len(x)) < share, rng.choice(heights, len(x)), 0.0)


ONE_SURFACE = {
    **{f"wall at {angle}": a_wall(angle) for angle in (0, 17, 45, 90)},
    **{f"boxes of {width} m": boxes(width) for width in (0.3, 0.6, 1.2, 2.0)},
    "trench": lambda x, y: -2.0 * (np.abs(x + 0.3 * y) < 0.7),
    "fence": lambda x, y: 2.0 * (np.abs(0.6 * x + 0.8 * y - 0.2) < 0.25),
    **{f"slope of {degrees}": slope(degrees) for degrees in (30, 45, 75, 85)},
    "cliff on a slope": lambda x, y: slope(45)(x, y) + a_wall(30)(x, y),
    "outliers": some_points(0.01, 5.0),
    "many outliers": some_points(0.06, 5.0, -5.0),
    "outliers above": some_points(0.05, 2.0),
    "grass": some_points(0.2, 0.2),
    "level": lambda x, y: 0.0 * x,
}


@pytest.mark.parametrize("name", ONE_SURFACE)
@pytest.mark.parametrize("seed", range(3))
def test_there_are_no_two_surfaces(name, seed):
    x, y = places(seed=seed)
    z = ONE_SURFACE[name](x, y) + np.random.default_rng(seed).normal(0, 0.02, len(x))
    cubes, layers = found_in(*points_of(x, y, z))
    assert layers.share == 0.0
    # A few of 576 cells, by chance.
    assert layers.maybe[0] < 0.01
    assert not cubes.layer.any()


def test_a_wall_whose_points_are_misplaced_is_one_surface():
    x, y = places()
    z = a_wall(20)(x, y)
    x, y = np.array([x, y]) + np.random.default_rng(1).normal(0, 0.2, (2, len(x)))
    assert found_in(*points_of(x, y, z))[1] == NO_LAYERS


def test_a_result_without_two_surfaces_is_the_same_whichever_is_asked_for():
    x, y = places()
    upper, lower, mean = (result(x, y, a_wall(17)(x, y), layer) for layer in LAYERS)
    for other in (lower, mean):
        assert (other.volume_m3, other.budget) == (upper.volume_m3, upper.budget)


# --- what is told


def test_a_crown_is_two_surfaces_in_a_window_of_many_points_and_few():
    for count in (4_000, 20_000, 200_000):
        x, y = places(count)
        z = crowned(x, y, 0.5, crown=lambda x, y: np.hypot(x, y) < 5)
        assert found_in(*points_of(x, y, z))[1].share == pytest.approx(25 * np.pi / 144, abs=0.09)


def test_cubes_are_marked_by_the_surface_that_they_are_of():
    x, y = places()
    cubes, _ = found_in(*points_of(x, y, crowned(x, y, 0.5)))
    height = (cubes.bin + 0.5) * cubes.cell - LEVEL
    assert (cubes.layer[height > 2] != LOWER).all()
    assert (cubes.layer[height < 1] != UPPER).all()
    inside = (cubes.column >= 0) & (cubes.row >= 0)
    assert (cubes.layer[inside] != 0).mean() > 0.9


def test_every_point_is_measured_or_left_out_for_a_reason():
    x, y = places()
    z = crowned(x, y, 0.4) + some_points(0.005, 40.0)(x, y)
    total = np.count_nonzero((np.abs(x) < 6) & (np.abs(y) < 6))
    for layer, share in (("upper", 0.6), ("lower", 0.4), ("mean", 0.0)):
        found = result(x, y, z, layer)
        left_out = found.points_left_out
        assert found.points_used + sum(left_out.values()) == total
        assert left_out["other of two surfaces"] == pytest.approx(share * total, rel=0.06)
        assert left_out["outliers"] == pytest.approx(0.005 * total, abs=10)


def test_the_order_of_points_changes_no_bit():
    x, y = places(10_000)
    z = crowned(x, y, 0.5, crown=lambda x, y: np.hypot(x, y) < 4)
    order = np.random.default_rng(5).permutation(len(x))
    one, other = result(x, y, z), result(x[order], y[order], z[order])
    assert told(one)
    assert (one.volume_m3, one.budget) == (other.volume_m3, other.budget)


def test_the_check_is_of_the_surface_that_is_measured():
    x, y = places()
    z = crowned(x, y, 0.5, crown=lambda x, y: np.hypot(x, y) < 4)
    for layer in ("upper", "lower"):
        found = result(x, y, z, layer, base="kriged", outline=Point(0, 0).buffer(5.5))
        (check,) = found.checks
        assert abs(check.volume_m3 - found.volume_m3) < found.std_m3


def test_an_area_of_a_few_points_has_no_layers():
    x, y = places(60)
    polygon, points = points_of(x, y, np.where(x > 0, 5.0, 0.0), Polygon(YARD.exterior))
    assert found_in(polygon, points)[1] == NO_LAYERS


def test_small_crowns_are_told_by_all_of_them_together():
    """Eight of 1.4 m, in cells of 0.7 m: a square of 5 x 5 cells around each is mostly ground."""
    x, y = places(16_000, half=16.0)
    centres = [(east, north) for east in (-4.0, 0.0, 4.0) for north in (-4.0, 0.0, 4.0)][:8]

    def crown(x, y):
        return np.min([np.hypot(x - e, y - n) for e, n in centres], axis=0) < 1.4

    (notice,) = told(result(x, y, crowned(x, y, 0.5, crown=crown)))
    # Of all cells that have a part of one.
    assert 8 * np.pi * 1.4**2 / 144 < notice.values["share"] < 8 * np.pi * 2.2**2 / 144
    assert notice.values["apart_m"] == pytest.approx(3.0, abs=0.1)


def test_walls_thinner_than_a_cell_are_no_crowns():
    """A grid of walls of 0.3 m, 3 m high, in cells of 0.7 m."""
    x, y = places(16_000, half=16.0)
    z = 3.0 * ((np.abs(x % 4 - 2) < 0.15) | (np.abs(y % 6 - 3) < 0.15))
    assert not told(result(x, y, z + np.random.default_rng(3).normal(0, 0.01, len(x))))
