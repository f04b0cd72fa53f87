"""Outlines moved to the toe: the same volume wherever they were drawn; and those proposed."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import affinity
from shapely.geometry import GeometryCollection, LineString, Point, Polygon, box

from quantify_client.types import Window
from quantify_client.volcalc.terrain.accumulate import TerrainAccumulator
from quantify_client.volcalc.terrain.grid_offsets import measure_area
from quantify_client.volcalc.terrain.measure import TerrainRecipe
from quantify_client.volcalc.terrain.toe import polygonal

from .grounds import EAST, LEVEL, NORTH

pytestmark = pytest.mark.one_python

CONE = np.pi * 8**2 * 4 / 3


def cone(x, y, at=0.0, radius=8.0, top=4.0):
    return top * np.clip(1 - np.hypot(x - at, y) / radius, 0, None)


def touching(x, y):
    """Two cones; the line between them is where both are as high."""
    return np.maximum(cone(x, y), cone(x, y, at=13.0, radius=6.0, top=3.0))


def circle(radius):
    return Point(0, 0).buffer(radius, 64)


def measured(form, outline, toe=None, relief=0.0, seed=0):
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-30, 30, (2, 30_000))
    ground = 0.05 * x + relief * np.sqrt(2) * np.sin(x / 3 + seed) * np.cos(y / 4)
    z = LEVEL + ground + form(x, y) + 0.01 * rng.standard_normal(len(x))
    placed = affinity.translate(outline, EAST, NORTH)
    box_of_all = Window(*placed.bounds).grown(toe or 0.0)
    accumulator = TerrainAccumulator([box_of_all])
    accumulator.absorb(accumulator.reduce(x + EAST, y + NORTH, z))
    points = accumulator.points_of(0)
    return measure_area("a", points.to_local(placed), points, TerrainRecipe(toe=toe))


@pytest.mark.parametrize(("relief", "within"), [(0.0, 0.003), (0.03, 0.01)])
@pytest.mark.parametrize("inside", [-2.0, -1.0, -0.5, 0.5, 1.0, 2.0])
def test_the_volume_is_that_of_the_pile_wherever_the_outline_was(inside, relief, within):
    result = measured(cone, circle(8 - inside), toe=4.0, relief=relief)
    assert result.volume_m3 == pytest.approx(CONE, rel=within)
    low, high = result.interval95_m3
    assert low - 0.2 < CONE < high + 0.2
    moved = {w.code for w in result.warnings}
    assert moved <= {"outline-moved", "uneven-ground"}
    if inside > 0:
        assert "outline-moved" in moved
        assert result.area_m2 == pytest.approx(np.pi * 8.8**2, rel=0.15)


@pytest.mark.parametrize("inside", [-1.0, 0.5, 2.0])
def test_a_pile_that_touches_another_ends_in_the_saddle(inside):
    result = measured(touching, circle(8 - inside), toe=4.0)
    # The larger cone's side of the saddle, summed over a fine grid.
    x, y = np.meshgrid(np.arange(-9, 20, 0.02), np.arange(-9, 9, 0.02))
    own = cone(x, y) >= cone(x, y, at=13.0, radius=6.0, top=3.0)
    truth = float((cone(x, y) * own).sum()) * 0.02**2
    assert result.volume_m3 == pytest.approx(truth, rel=0.01)


def test_it_is_moved_no_further_than_was_asked():
    result = measured(cone, circle(5), toe=1.0)
    # The cone within 6 m: 2 pi times the integral of 4 (1 - r / 8) r.
    assert result.volume_m3 == pytest.approx(2 * np.pi * 4 * (6**2 / 2 - 6**3 / 24), rel=0.02)
    assert result.area_m2 == pytest.approx(np.pi * 6**2, rel=0.03)
    assert {w.code for w in result.warnings} == {"outline-on-pile", "outline-moved"}


def test_another_outline_is_proposed_and_gives_the_pile():
    drawn = measured(cone, circle(6.5))
    assert [w.code for w in drawn.warnings] == ["outline-on-pile"]
    proposed = shapely.from_wkb(drawn.relief.proposal_wkb)
    assert proposed.area == pytest.approx(np.pi * 8.8**2, rel=0.15)
    assert proposed.covers(affinity.translate(circle(7.9), EAST, NORTH))
    again = measured(cone, affinity.translate(proposed, -EAST, -NORTH))
    assert again.volume_m3 == pytest.approx(CONE, rel=0.003)
    assert again.warnings == ()
    assert again.relief.proposal_wkb is None


def test_of_a_pit_the_edge_is_found():
    result = measured(lambda x, y: -cone(x, y), circle(7), toe=3.0)
    assert result.volume_m3 == pytest.approx(-CONE, rel=0.003)


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 50), st.floats(-1.5, 1.5), st.floats(0.0, 90.0))
def test_turning_the_outline_changes_little(seed, inside, turn):
    """An octagon, whose sides are at all angles to the cells."""
    outline = affinity.rotate(Point(0, 0).buffer(8.3 - inside, 2), turn, origin=(0, 0))
    result = measured(cone, outline, toe=4.0, seed=seed)
    assert result.volume_m3 == pytest.approx(CONE, rel=0.006)


def test_points_and_lines_are_no_outline():
    mixed = GeometryCollection([box(0, 0, 1, 1), Point(5, 5), LineString([(0, 0), (9, 9)])])
    assert polygonal(mixed).equals(box(0, 0, 1, 1))
    assert polygonal(Point(1, 1)).is_empty


def test_what_stands_at_an_outline_does_not_lift_the_base():
    """A pile between others on two sides, cut along the saddles: the ground is that of the rest."""
    others = [(10.5, 0.0), (0.0, 10.5), (10.5, 10.5)]

    def four(x, y):
        near = [cone(x - east, y - north, radius=7.0, top=4.0) for east, north in others]
        return np.max([cone(x, y, radius=7.0, top=4.0), *near], axis=0)

    outline = circle(7.6).intersection(box(-10, -10, 5.25, 5.25))
    result = measured(four, outline, relief=0.02, seed=2)
    x = np.linspace(-7, 5.25, 4001)
    u, v = np.meshgrid(x, x)
    volume = float(cone(u, v, radius=7.0, top=4.0).mean()) * 12.25**2
    assert result.warnings[0].code == "outline-crosses-neighbour"
    assert result.volume_m3 == pytest.approx(volume, rel=0.015)
    low, high = result.interval95_m3
    assert low < volume < high


def test_polygons_are_valid_whatever_they_were_made_of():
    """A bow tie, and a hole without an area: two triangles of 1 m2, and the square."""
    tie = polygonal(Polygon([(0, 0), (2, 2), (2, 0), (0, 2)]))
    assert tie.is_valid
    assert tie.area == pytest.approx(2.0)
    pinned = polygonal(Polygon([(0, 0), (4, 0), (4, 4), (0, 4)], [[(1, 1), (2, 1), (1, 1)]]))
    assert pinned.is_valid
    assert pinned.geom_type == "Polygon"
    assert pinned.area == pytest.approx(16.0)


def test_where_most_of_the_toe_is_out_of_sight_nothing_is_proposed():
    """The cloud ends 1 m beyond an outline that is 3 m inside: nobody sees where the pile ends."""
    rng = np.random.default_rng(5)
    x, y = rng.uniform(-6, 6, (2, 8_000))
    seen = np.hypot(x, y) < 6
    x, y = x[seen], y[seen]
    z = LEVEL + cone(x, y) + 0.01 * rng.standard_normal(len(x))
    placed = affinity.translate(circle(5), EAST, NORTH)
    accumulator = TerrainAccumulator([Window(*placed.bounds)])
    accumulator.absorb(accumulator.reduce(x + EAST, y + NORTH, z))
    points = accumulator.points_of(0)
    result = measure_area("a", points.to_local(placed), points, TerrainRecipe())
    assert result.relief.proposal_wkb is None
    assert "proposed" not in " ".join(result.warnings)


def test_a_proposal_is_said_in_the_warning():
    result = measured(cone, circle(7))
    assert result.relief.proposal_wkb is not None
    assert result.warnings[0].endswith("or take the one that is proposed")
