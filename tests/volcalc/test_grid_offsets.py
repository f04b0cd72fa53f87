"""The place of the cells: the mean over grid offsets, and what their scatter adds to the error."""

from __future__ import annotations

import math

import numpy as np
import pytest
from shapely.geometry import box

from quantify_client.types import Window
from quantify_client.volcalc.terrain import grid_offsets
from quantify_client.volcalc.terrain.accumulate import TerrainAccumulator
from quantify_client.volcalc.terrain.measure import TerrainRecipe

from .grounds import EAST, LEVEL, NORTH


def test_volume_is_the_mean_and_its_standard_error_is_in_slicing(monkeypatch):
    """Of a box with walls, where cells begin decides most."""
    measured, others = [], []

    def kept(function, found):
        def wrapped(*arguments):
            (result,) = function(*arguments)
            found.append(result)
            return (result,)

        monkeypatch.setattr(grid_offsets, function.__name__, wrapped)

    kept(grid_offsets.measure_terrain, measured)
    kept(grid_offsets.measure_sides, others)
    x, y = np.random.default_rng(0).uniform(0, 20, (2, 6_000))
    z = LEVEL + 3.0 * ((np.abs(x - 10) < 3.1) & (np.abs(y - 10) < 2.3))
    outline = box(EAST + 6, NORTH + 6, EAST + 14, NORTH + 14)
    accumulator = TerrainAccumulator([Window(*outline.bounds)])
    accumulator.absorb(accumulator.reduce(EAST + x, NORTH + y, z))
    points = accumulator.points_of(0)
    mean = grid_offsets.measure_area("a", points.to_local(outline), points, TerrainRecipe())
    first_result = measured[0].result
    volumes = np.array([first_result.volume_m3, *(one.cut - one.fill for one in others)])
    assert len(volumes) == 4
    assert mean.volume_m3 == pytest.approx(volumes.mean())
    (first,) = (item for item in first_result.budget if item.source == "slicing")
    (slicing,) = (item for item in mean.budget if item.source == "slicing")
    # The standard deviation of four over the root of four.
    scatter = math.sqrt(((volumes - volumes.mean()) ** 2).sum() / 3) / 2
    assert scatter > 0.05
    assert slicing.std_m3 == pytest.approx(math.hypot(first.std_m3, scatter))
    assert mean.std_m3 == pytest.approx(math.sqrt(sum(i.std_m3**2 for i in mean.budget)))


def test_one_tin_is_held_against_all_grid_offsets():
    """Its volume over the mean base: the base of one offset more or less has no part in it."""
    x, y = np.random.default_rng(1).uniform(0, 20, (2, 6_000))
    z = LEVEL + np.maximum(0.0, 2.0 - np.hypot(x - 10, y - 10) / 2) + 0.1 * np.sin(x)
    outline = box(EAST + 5, NORTH + 5, EAST + 15, NORTH + 15)
    accumulator = TerrainAccumulator([Window(*outline.bounds)])
    accumulator.absorb(accumulator.reduce(EAST + x, NORTH + y, z))
    points = accumulator.points_of(0)
    shape = points.to_local(outline)
    tin_of = {}
    for base in ("triangulate", "plane", LEVEL):
        recipe = TerrainRecipe(base=base)
        result = grid_offsets.measure_area("a", shape, points, recipe)
        tin_of[base] = result.checks[0].volume_m3 - result.volume_m3
    # Volume and check are over the same base: their difference is that of the surfaces alone.
    assert tin_of["triangulate"] == pytest.approx(tin_of[LEVEL], abs=0.005)
    assert tin_of["plane"] == pytest.approx(tin_of[LEVEL], abs=0.005)
