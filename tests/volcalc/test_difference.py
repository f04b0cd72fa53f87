"""Two surveys in the same cells: shifts that are no whole cubes, lifts and tilts."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely.geometry import Point

from quantify_client.errors import SupportError
from quantify_client.types import Window
from quantify_client.volcalc.change.motion import Motion
from quantify_client.volcalc.terrain.accumulate import TerrainAccumulator
from quantify_client.volcalc.terrain.difference import (
    OtherSurvey,
    find_difference,
    in_same_cells,
    marked,
)
from quantify_client.volcalc.terrain.heights import mark_layers

from .grounds import EAST, LEVEL, NORTH, at_site

pytestmark = pytest.mark.one_python

AREA = Point(0, 0).buffer(6.0, 64)


def slope(x, y):
    return 0.4 * x - 0.25 * y


def kept(form, shift=(0.0, 0.0), count=20_000, seed=0, half=16.0):
    """Points of a surface that was displaced, in the cubes of the area's box."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-half, half, (2, count))
    accumulator = TerrainAccumulator([Window(*at_site(AREA).bounds)])
    accumulator.absorb(
        accumulator.reduce(EAST + x + shift[0], NORTH + y + shift[1], LEVEL + form(x, y))
    )
    return accumulator.points_of(0)


def difference(one, other, motion, *, is_later=True):
    polygon = one.to_local(at_site(AREA))
    bounds = Window(*polygon.bounds)
    cubes, moved = in_same_cells(one.cubes, other.cubes, motion, bounds)
    second = OtherSurvey("other", moved, motion, np.zeros((2, 2)), is_later, True, np.empty((0, 3)))
    cubes = mark_layers(cubes, bounds)
    return find_difference(polygon, cubes, marked(second, polygon), 1.0, "upper")


@settings(max_examples=10)
@given(
    shift=st.tuples(st.floats(-3, 3), st.floats(-3, 3)),
    rise=st.floats(-2, 2),
    counts=st.tuples(st.sampled_from([4_000, 20_000, 70_000]), st.sampled_from([5_000, 30_000])),
)
def test_a_plane_that_was_displaced_comes_back_wherever_it_was(shift, rise, counts):
    """The later one lies `shift` off and `rise` higher than it was."""
    one = kept(slope, count=counts[0])
    other = kept(lambda x, y: slope(x, y) + rise, shift, counts[1], seed=1)
    surface = difference(one, other, Motion((-shift[0], -shift[1], 0.0)))
    inside = surface.inside & np.isfinite(surface.heights.z)
    # Places are known to a cube, and each cell has several.
    assert np.mean(surface.heights.z[inside]) == pytest.approx(rise, abs=0.004)
    np.testing.assert_allclose(surface.heights.z[inside], rise, atol=0.3)
    assert surface.second.z.shape == surface.filled.shape


def test_lift_and_tilt_are_added_where_cells_are():
    one, other = kept(slope), kept(lambda x, y: slope(x, y) + 0.3 + 0.01 * x, seed=1)
    local = one.to_local(at_site(AREA)).centroid
    motion = Motion((0.0, 0.0, -0.3), (-0.01, 0.0), (local.x, local.y))
    surface = difference(one, other, motion)
    assert np.nanmean(surface.heights.z[surface.inside]) == pytest.approx(0.0, abs=0.003)
    before = difference(one, other, motion, is_later=False)
    np.testing.assert_allclose(before.heights.z, -surface.heights.z)


def test_an_area_that_the_other_survey_does_not_reach():
    one, other = kept(slope), kept(slope, shift=(14.0, 0.0), half=6.0)
    with pytest.raises(SupportError, match=r"other"):
        difference(one, other, Motion((-40.0, 0.0, 0.0)))
