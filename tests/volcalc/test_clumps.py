"""Clouds whose points lie in clumps: cells follow the area, holes stay holes, intervals hold."""

from __future__ import annotations

import re

import numpy as np
import pytest
from shapely.geometry import Point, box

from quantify_client.errors import SupportError
from quantify_client.types import Window
from quantify_client.volcalc.terrain.accumulate import TerrainAccumulator
from quantify_client.volcalc.terrain.coverage import cells_of_clumps
from quantify_client.volcalc.terrain.grid_offsets import measure_area
from quantify_client.volcalc.terrain.heights import fit_cells, larger_cells
from quantify_client.volcalc.terrain.measure import TerrainRecipe

from .grounds import EAST, LEVEL, NORTH, at_site

HALF = 40.0


def clumps(rng, apart, radius, each):
    """Discs of points, as many on average in each, at random places (a cluster process)."""
    x, y = rng.uniform(-HALF, HALF, (2, round((2 * HALF / apart) ** 2)))
    which = np.repeat(np.arange(len(x)), rng.poisson(each, len(x)))
    away, angle = radius * np.sqrt(rng.random(len(which))), rng.uniform(0, 2 * np.pi, len(which))
    return x[which] + away * np.cos(angle), y[which] + away * np.sin(angle)


def points_of(x, y, z, outline):
    area = at_site(outline)
    accumulator = TerrainAccumulator([Window(*area.bounds)])
    accumulator.absorb(accumulator.reduce(EAST + x, NORTH + y, LEVEL + z))
    points = accumulator.points_of(0)
    return points.to_local(area), points


def measured(x, y, z, outline):
    polygon, points = points_of(x, y, z, outline)
    return measure_area("area", polygon, points, TerrainRecipe())


def pile_seen_by_clumps(seed):
    """A cone or a dome on tilted ground, and its volume."""
    rng = np.random.default_rng(seed)
    apart = rng.uniform(0.8, 1.6)
    x, y = clumps(rng, apart, apart * rng.uniform(0.08, 0.3), rng.uniform(8, 40))
    radius, height = rng.uniform(8, 14), rng.uniform(2, 5)
    away = np.hypot(x, y) / radius
    power = 1 + seed % 2
    top = height * np.clip(1 - away**power, 0, None)
    z = top + 0.05 * x - 0.03 * y + rng.normal(0, 0.02, len(x))
    volume = np.pi * radius**2 * height * power / (power + 2)
    return x, y, z, Point(0, 0).buffer(radius + 1.5), volume


def test_cells_grow_until_clumps_are_all_over_the_area():
    x, y, z, outline, volume = pile_seen_by_clumps(2)
    polygon, points = points_of(x, y, z, outline)
    small = fit_cells(points.cubes, Window(*polygon.bounds))
    found = measured(x, y, z, outline)
    assert found.cell_m > 2 * small.cell * small.factor
    assert found.coverage > 0.75
    assert found.volume_m3 == pytest.approx(volume, rel=0.05)


@pytest.mark.one_python
def test_intervals_hold_on_clumped_clouds():
    """90 to 100 % of 30 normal deviates are within 1.96 in 94 % of cases."""
    off = []
    for seed in range(30):
        *cloud, volume = pile_seen_by_clumps(100 + seed)
        found = measured(*cloud)
        off.append((found.volume_m3 - volume) / found.std_m3)
    off = np.array(off)
    assert np.mean(np.abs(off) < 1.96) >= 0.9
    assert 0.6 < np.sqrt(np.mean(off**2)) < 1.25


def test_each_size_of_cells_is_the_next_of_the_series():
    x, y = np.random.default_rng(0).uniform(-20, 20, (2, 20_000))
    polygon, points = points_of(x, y, 0 * x, box(-10, -10, 10, 10))
    cubes = fit_cells(points.cubes, Window(*polygon.bounds))
    sizes = [cubes.cell * cubes.factor]
    for _ in range(5):
        cubes = larger_cells(cubes)
        sizes.append(cubes.cell * cubes.factor)
        assert cubes.count.sum() == points.cubes.count.sum()
    assert sizes == pytest.approx([0.8, 1.0, 1.6, 2.0, 3.2, 4.0])


# --- holes

AREA = box(-10, -10, 10, 10)

#: Where the cloud has no points, of the share of 20 m x 20 m.
HOLES = {
    "round": lambda x, y, share: np.hypot(x, y) < np.sqrt(share * 400 / np.pi),
    "one side": lambda x, y, share: x < -10 + 20 * share,
    "corner": lambda x, y, share: np.maximum(x, y) < -10 + 20 * np.sqrt(share),
    "all around": lambda x, y, share: np.hypot(x, y) > np.sqrt((1 - share) * 400 / np.pi),
    "strips": lambda x, y, share: np.mod(x + 1, 20 / 3) < 20 / 3 * share,
    "three": lambda x, y, share: (
        np.min([np.hypot(x - u, y - v) for u, v in ((-5, -5), (5, -5), (0, 5))], axis=0)
        < np.sqrt(share * 400 / 3 / np.pi)
    ),
}


@pytest.mark.parametrize("name", HOLES)
@pytest.mark.parametrize(("share", "count"), [(0.65, 12_000), (0.55, 12_000), (0.55, 40_000)])
def test_holes_make_no_cell_larger(name, share, count):
    x, y = np.random.default_rng(count).uniform(-20, 20, (2, count))
    seen = ~HOLES[name](x, y, share)
    x, y = x[seen], y[seen]
    polygon, points = points_of(x, y, 0.02 * x, AREA)
    small = fit_cells(points.cubes, Window(*polygon.bounds))
    assert cells_of_clumps(small, polygon) is None
    with pytest.raises(SupportError) as refused:
        measured(x, y, 0.02 * x, AREA)
    told = re.search(r"in cells of (\S+) m", str(refused.value))
    assert float(told[1]) == pytest.approx(small.cell * small.factor)


def test_an_area_without_points_is_refused_as_before():
    x, y = np.random.default_rng(0).uniform(-20, 20, (2, 5_000))
    with pytest.raises(SupportError, match="the cloud has no points there"):
        measured(x, y, 0 * x, box(100, 100, 110, 110))


def test_clumps_too_few_for_the_area_are_refused():
    rng = np.random.default_rng(1)
    x, y = clumps(rng, 8.0, 0.5, 300)
    with pytest.raises(SupportError, match="at least 50% are needed"):
        measured(x, y, 0 * x, AREA)
