"""Single points along an outline: strips beside it, and what is rougher than the pile."""

from __future__ import annotations

import numpy as np
import pytest
from shapely.geometry import Point, box

from quantify_client.types import Window
from quantify_client.volcalc.terrain.accumulate import TerrainAccumulator
from quantify_client.volcalc.terrain.grid import cell_parts, polygons_of
from quantify_client.volcalc.terrain.grid_offsets import measure_area
from quantify_client.volcalc.terrain.heights import cell_heights, fit_cells
from quantify_client.volcalc.terrain.measure import TerrainRecipe
from quantify_client.volcalc.terrain.outline_points import OutlinePoints
from quantify_client.volcalc.terrain.rim import sample_rim

from .grounds import EAST, LEVEL, NORTH, at_site

pytestmark = pytest.mark.one_python


def cloud(form, half=20.0, count=20_000, seed=0, noise=0.01):
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-half, half, (2, count))
    return x + EAST, y + NORTH, LEVEL + form(x, y, rng) + noise * rng.standard_normal(count)


def points_beside(form, outline, reach, **options):
    area = at_site(outline)
    accumulator = TerrainAccumulator([Window(*area.bounds)])
    accumulator.absorb(accumulator.reduce(*cloud(form, **options)))
    points = accumulator.points_of(0)
    polygon = points.to_local(area)
    bounds = Window(*polygon.bounds)
    cubes = fit_cells(points.cubes, bounds)
    heights = cell_heights(cubes, bounds)
    fraction = cell_parts(polygon, heights.window).share
    rim = sample_rim(polygons_of(polygon), heights, fraction)
    return OutlinePoints.of(heights.window, fraction > 0, rim, cubes, reach)


def test_strips_hold_the_mean_heights_at_their_middles():
    """On a plane that rises by 0.3, and 0.2: each strip is so far outwards as its middle is."""
    found = points_beside(lambda x, y, rng: 0.3 * x + 0.2 * y, box(-8, -8, 8, 8), (1.5, 3.5))
    z, error = found.strips(0.5, range(4))
    east = np.abs(found.rim.x - found.rim.x.max()) < 0.01
    away = (np.arange(4) + 0.5) * 0.5 * found.window.cell
    north = found.rim.y[east] - found.rim.y[east].mean()
    rise = z[east] - 0.2 * north[:, None]
    middle = np.abs(north) < 6
    np.testing.assert_allclose(np.diff(rise[middle].mean(axis=0)), 0.3 * np.diff(away), atol=0.05)
    assert 0.0 < np.nanmedian(error) < 0.1
    assert found.strips(0.5, range(4)).heights.shape == (len(found.rim.x), 4)


def test_the_errors_of_strips_are_as_large_as_they_are_said_to_be():
    """Level ground with noise of 0.1 m: heights scatter by their errors."""
    found = points_beside(lambda x, y, rng: 0.0 * x, box(-8, -8, 8, 8), (1.5, 3.5), noise=0.1)
    z, error = found.strips(0.5, range(4))
    known = np.isfinite(z)
    score = (z - np.mean(z[known]))[known] / error[known]
    assert np.sqrt(np.mean(score**2)) == pytest.approx(1.0, abs=0.3)


def heap(x, y, rng):
    return 4.0 * np.clip(1 - np.hypot(x, y) / 7, 0, None)


def with_plants(x, y, rng):
    """Along a third of the outline, 0.2 to 0.7 m high, and the ground between them."""
    near = (np.abs(np.hypot(x, y) - 7.6) < 0.6) & (np.arctan2(y, x) > 1.0)
    grown = near & (rng.random(len(x)) < 0.75)
    return heap(x, y, rng) + np.where(grown, rng.uniform(0.2, 0.7, len(x)), 0.0)


@pytest.mark.parametrize("radius", [5.0, 6.5, 7.0, 7.6])
def test_a_flank_is_as_rough_as_the_pile_and_its_toe_is_no_plant(radius):
    found = points_beside(heap, Point(0, 0).buffer(radius, 64), (7.0, 0.0))
    for stretch in np.array_split(np.arange(len(found.rim.x)), 12):
        assert not found.is_rough(stretch, 4 / 7)


def test_plants_along_an_outline_are_rougher_than_the_pile():
    found = points_beside(with_plants, Point(0, 0).buffer(7.6, 64), (7.0, 0.0))
    angle = np.arctan2(found.rim.y - found.rim.y.mean(), found.rim.x - found.rim.x.mean())
    assert found.is_rough(np.flatnonzero(angle > 1.2), 4 / 7)
    assert not found.is_rough(np.flatnonzero(angle < 0.8), 4 / 7)


def test_plants_are_told_as_such_and_a_flank_as_a_flank():
    def told(form, radius):
        area = at_site(Point(0, 0).buffer(radius, 64))
        accumulator = TerrainAccumulator([Window(*area.bounds)])
        accumulator.absorb(accumulator.reduce(*cloud(form, seed=3)))
        points = accumulator.points_of(0)
        return measure_area("a", points.to_local(area), points, TerrainRecipe()).warnings

    assert told(with_plants, 7.6)[0].code == "outline-crosses-neighbour"
    assert told(heap, 6.5)[0].code == "outline-on-pile"
    assert told(heap, 7.6) == ()


def told_of(form, outline, **options):
    area = at_site(outline)
    accumulator = TerrainAccumulator([Window(*area.bounds)])
    accumulator.absorb(accumulator.reduce(*cloud(form, **options)))
    points = accumulator.points_of(0)
    found = measure_area("a", points.to_local(area), points, TerrainRecipe())
    return [notice.code for notice in found.warnings]


def test_the_ground_is_seen_among_plants_and_not_inside_of_a_flank():
    """Cells of 1 m hold more flank and bare ground than plants."""
    for form, radius in ((with_plants, 7.6), (heap, 5.0), (heap, 6.5)):
        found = points_beside(form, Point(0, 0).buffer(radius, 64), (7.0, 0.0), count=8_000)
        over = found.z - LEVEL
        angle = np.arctan2(found.rim.y - found.rim.y.mean(), found.rim.x - found.rim.x.mean())
        height = 0.4 if form is with_plants else 4.0 * (1 - radius / 7)
        level = np.full(len(angle), height)
        grown = np.flatnonzero(angle > 1.2)
        assert found.shows_ground(grown, over, level, 0.01) == (form is with_plants)
        # Nothing is told by heights within the noise.
        assert not found.shows_ground(grown, over, level, 1.0)


def test_what_goes_on_at_one_end_is_another_pile_and_at_both_a_dam():
    def dam(x, y):
        return np.clip((4.0 - np.abs(y)) / 2.0, 0, 1.5)

    def from_the_east(x, y, rng):
        return np.maximum(heap(x + 4, y, rng), dam(x, y) * np.clip((x - 5.0) / 2.0, 0, 1))

    outline = box(-12, -9, 9, 9)
    for count in (20_000, 4_000):
        codes = told_of(from_the_east, outline, half=40.0, count=count)
        assert codes[:1] == ["outline-crosses-neighbour"]
    assert told_of(lambda x, y, rng: dam(x, y), outline, half=40.0, count=20_000) == []
