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
    found = []
    measure = grid_offsets.measure_terrain

    def kept(*arguments):
        found.append(measure(*arguments)[0])
        return (found[-1],)

    monkeypatch.setattr(grid_offsets, "measure_terrain", kept)
    x, y = np.random.default_rng(0).uniform(0, 20, (2, 6_000))
    z = LEVEL + 3.0 * ((np.abs(x - 10) < 3.1) & (np.abs(y - 10) < 2.3))
    outline = box(EAST + 6, NORTH + 6, EAST + 14, NORTH + 14)
    accumulator = TerrainAccumulator([Window(*outline.bounds)])
    accumulator.absorb(accumulator.reduce(EAST + x, NORTH + y, z))
    points = accumulator.points_of(0)
    mean = grid_offsets.measure_area("a", points.to_local(outline), points, TerrainRecipe())
    volumes = np.array([one.result.volume_m3 for one in found])
    assert len(volumes) == 4
    assert mean.volume_m3 == pytest.approx(volumes.mean())
    (first,) = (item for item in found[0].result.budget if item.source == "slicing")
    (slicing,) = (item for item in mean.budget if item.source == "slicing")
    # The standard deviation of four over the root of four.
    scatter = math.sqrt(((volumes - volumes.mean()) ** 2).sum() / 3) / 2
    assert scatter > 0.05
    assert slicing.std_m3 == pytest.approx(math.hypot(first.std_m3, scatter))
    assert mean.std_m3 == pytest.approx(math.sqrt(sum(i.std_m3**2 for i in mean.budget)))
