"""Stockpiles in rasters of known shape: where their outlines are, and what is no pile."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely.geometry import Point

from quantify_client.types import Window
from quantify_client.volcalc.stockpiles.find import find_stockpiles
from quantify_client.volcalc.stockpiles.jumps import STEEPEST, over_sides
from quantify_client.volcalc.stockpiles.raster import HeightRaster, raster_of
from quantify_client.volcalc.stockpiles.watershed import PROMINENCE, split_at_saddles
from quantify_client.volcalc.terrain.accumulate import TerrainAccumulator

from .grounds import EAST, LEVEL, NORTH

CELL, SIDE = 0.2, 192  # a site of 38.4 m
MIDDLE = SIDE * CELL / 2


def cone(x, y, radius=6.0, top=4.0, at=(0.0, 0.0)):
    return top * np.clip(1 - np.hypot(x - at[0], y - at[1]) / radius, 0, None)


def block(x, y, halves, top, at=(0.0, 0.0)):
    return np.where((np.abs(x - at[0]) < halves[0]) & (np.abs(y - at[1]) < halves[1]), top, 0.0)


def heights_of(form, slope=0.0, noise=0.01, seed=0):
    """Of heights around the middle of the site, which lies at map coordinates."""
    rng = np.random.default_rng(seed)
    y, x = (np.indices((SIDE, SIDE)) + 0.5) * CELL - MIDDLE
    z = LEVEL + slope * x + form(x, y) + noise * rng.standard_normal(x.shape)
    return HeightRaster(CELL, EAST - MIDDLE, NORTH - MIDDLE, z)


def proposals(form, **about):
    return find_stockpiles(heights_of(form, **about)).proposals


def names(found):
    return [one.name for one in found]


def local(outline):
    return shapely.transform(outline, lambda xy: xy - [EAST, NORTH])


# --- piles


@pytest.mark.parametrize("at", [(0.0, 0.0), (3.33, -7.77)])
def test_the_outline_of_a_cone_is_around_its_foot_and_within_two_cells_of_it(at):
    (pile,) = proposals(lambda x, y: cone(x, y, at=at))
    assert (pile.name, pile.kind) == ("pile-1", "pile")
    assert 4.0 - 2 * CELL * 4.0 / 6.0 < pile.height < 4.0  # a cell has no apex
    outline = local(pile.outline)
    assert outline.covers(Point(at).buffer(6.0))
    assert np.sqrt(outline.area / np.pi) < 6.0 + 2 * CELL
    assert Point(at).buffer(6.0 + 2 * CELL + CELL / np.sqrt(2)).covers(outline)  # and its corners
    # Few corners, to be edited: a third of the cells along it at most.
    assert shapely.get_num_coordinates(outline) < outline.length / CELL / 2
    assert pile.std == 0.0


def test_a_pile_at_the_edge_of_the_cloud_is_found():
    (pile,) = proposals(lambda x, y: cone(x, y, at=(-MIDDLE, 0.0)))
    assert pile.outline.area == pytest.approx(np.pi * 6.3**2 / 2, rel=0.1)


@pytest.mark.parametrize("slope", [0.02, 0.1, 0.3])
def test_a_tilted_site_has_the_same_outlines(slope):
    (level,), (tilted,) = (proposals(cone, slope=each) for each in (0.0, slope))
    assert tilted.outline.symmetric_difference(level.outline).area < 0.03 * level.outline.area
    assert tilted.height == pytest.approx(level.height, abs=0.1)


@pytest.mark.parametrize("seed", range(5))
def test_nothing_is_proposed_on_bare_ground(seed):
    rng = np.random.default_rng(seed)
    a, b, length = *rng.uniform(0, 6, 2), rng.uniform(3, 30)

    def waves(x, y):
        return 0.03 * (np.sin(6.283 * x / length + a) + np.sin(6.283 * y / length + b))

    for form in (lambda x, y: 0 * x, waves):
        found = find_stockpiles(heights_of(form, slope=0.1, seed=seed))
        assert found.proposals == ()
        assert found.highest < found.least_height


def test_of_a_level_plane_without_noise_nothing_stands_out():
    found = find_stockpiles(heights_of(lambda x, y: 0 * x, noise=0.0))
    assert (found.proposals, found.highest, found.its_area) == ((), 0.0, 0.0)
    assert (found.least_height, found.least_area) == (2 * CELL, 64 * CELL**2)


@pytest.mark.parametrize("apart", [6.0, 8.0])
def test_touching_cones_are_split_at_their_saddle(apart):
    ends = [(-apart / 2, 0.4), (apart / 2, 0.4)]
    first, second = proposals(
        lambda x, y: np.maximum(*(cone(x, y, radius=5.0, top=3.2, at=at) for at in ends))
    )
    # On the saddle: on the ground beyond it both outlines go around their own feet.
    saddle = shapely.box(-9, -0.6, 9, 1.4)
    parts = [local(one.outline).intersection(saddle) for one in (first, second)]
    left, right = sorted(parts, key=lambda part: part.bounds)
    assert left.bounds[2] == pytest.approx(0.0, abs=1.01 * CELL)
    assert right.bounds[0] == pytest.approx(0.0, abs=1.01 * CELL)
    # Half a cell along the ridge between them: its height times its length, over sqrt(12).
    half = apart / 2
    y = np.linspace(-np.sqrt(25 - half**2), np.sqrt(25 - half**2), 1001)
    over = np.trapezoid if hasattr(np, "trapezoid") else np.trapz
    ridge = over(3.2 * (1 - np.hypot(half, y) / 5.0), y)
    # (the toes of both are smoothed into it)
    assert CELL / np.sqrt(12) * ridge == pytest.approx(first.std, rel=0.4)


def test_summits_with_a_high_saddle_are_one_pile():
    ends = [(-0.7, 0.0), (0.7, 0.0)]  # the saddle is at 88 % of the height
    found = proposals(lambda x, y: np.maximum(*(cone(x, y, at=at) for at in ends)))
    assert names(found) == ["pile-1"]


def test_a_pile_with_a_cut_face_is_a_pile():
    """As a loader leaves it: half of a cone, cut at 80 degrees."""
    (pile,) = proposals(lambda x, y: np.minimum(cone(x, y), np.clip(5.7 * (x + 1), 0, None)))
    assert pile.kind == "pile"
    assert local(pile.outline).bounds[0] == pytest.approx(-1.0, abs=3 * CELL)


@pytest.mark.parametrize(
    ("limits", "expected"), [({}, 2), ({"least_height": 1.5}, 1), ({"least_area": 60.0}, 1)]
)
def test_least_height_and_area_leave_smaller_piles_out(limits, expected):
    raster = heights_of(
        lambda x, y: cone(x, y, at=(-7, 0)) + cone(x, y, radius=3.0, top=1.2, at=(8, 3))
    )
    found = find_stockpiles(raster, **limits)
    assert len(found.proposals) == expected
    assert all(getattr(found, name) == value for name, value in limits.items())


# --- what is no pile


@pytest.mark.parametrize(
    ("halves", "top", "kind"),
    [
        ((2.2, 0.9), 1.5, "vehicle"),
        ((0.9, 2.2), 1.4, "vehicle"),
        ((4.5, 1.2), 3.5, "vehicle"),
        ((7.0, 0.2), 2.0, "structure"),
        ((0.3, 6.0), 3.0, "structure"),
        ((4.0, 4.0), 5.0, "structure"),
        ((6.0, 7.0), 3.0, "structure"),
    ],
)
def test_what_ends_in_jumps_is_an_object(halves, top, kind):
    (thing,) = proposals(lambda x, y: block(x, y, halves, top, at=(0.07, -0.04)))
    assert thing.name == f"{kind}-1"
    assert thing.height == pytest.approx(top, abs=0.1)
    width, length, wider = 2 * halves[0], 2 * halves[1], 5 * CELL
    assert local(thing.outline).covers(shapely.box(-halves[0], -halves[1], *halves).buffer(-0.1))
    assert thing.outline.area < (width + wider) * (length + wider)


def test_crowns_of_trees_are_vegetation():
    rng = np.random.default_rng(3)
    leaves = rng.uniform(-1.0, 1.0, (SIDE, SIDE))
    (tree,) = proposals(lambda x, y: np.where(np.hypot(x, y) < 3.0, 5.0 + leaves, 0.0))
    assert tree.kind == "vegetation"


def test_a_pile_against_a_wall_ends_at_it():
    found = proposals(
        lambda x, y: np.maximum(
            np.where(x < 3, cone(x, y, at=(3, 0)), 0), block(x, y, (0.3, 9), 5, (3.3, 0))
        )
    )
    assert names(found) == ["pile-1", "structure-1"]
    pile, wall = (local(one.outline) for one in found)
    assert pile.bounds[2] == pytest.approx(3.0, abs=CELL)
    assert wall.bounds[1] == pytest.approx(-9.0, abs=2 * CELL)
    # c / sqrt(12) times the face of the cone on the wall, R h.
    assert found[0].std == pytest.approx(CELL / np.sqrt(12) * 24.0, rel=0.15)


def test_a_pile_goes_on_under_a_conveyor():
    found = proposals(lambda x, y: np.maximum(cone(x, y), block(x, y, (6.0, 0.5), 5.5, (5.5, 0))))
    assert names(found) == ["pile-1", "structure-1"]
    pile, conveyor = (local(one.outline) for one in found)
    assert pile.covers(Point(0, 0).buffer(6.0))
    assert not pile.interiors
    assert conveyor.bounds == pytest.approx((-0.5, -0.5, 11.5, 0.5), abs=2 * CELL)
    assert found[0].std > 0


def test_objects_are_no_part_of_piles_that_have_to_be_higher():
    raster = heights_of(lambda x, y: cone(x, y, at=(-6, 0)) + block(x, y, (2.2, 0.9), 1.5, (9, 0)))
    for least in (None, 3.0):
        assert names(find_stockpiles(raster, least).proposals) == ["pile-1", "vehicle-1"]


# --- invariants


@pytest.mark.one_python
@settings(max_examples=15)
@given(st.integers(0, 3), st.tuples(st.integers(-20, 20), st.integers(-20, 20)))
def test_turning_and_shifting_a_site_moves_its_proposals(quarters, shift):
    raster = heights_of(
        lambda x, y: np.maximum(
            np.maximum(cone(x, y, at=(4, 4)), cone(x, y, 4.0, 2.5, at=(-3, 4))),
            block(x, y, (2.2, 0.9), 1.5, at=(-4, -8)),
        )
    )
    moved = HeightRaster(
        CELL,
        raster.min_x + shift[0] * CELL,
        raster.min_y + shift[1] * CELL,
        np.rot90(raster.z, -quarters),  # rows go north: clockwise as seen, anticlockwise here
    )
    before, after = (find_stockpiles(each).proposals for each in (raster, moved))
    assert names(before) == names(after) == ["pile-1", "pile-2", "vehicle-1"]
    for one, other in zip(before, after):
        turned = shapely.affinity.rotate(one.outline, 90 * quarters, origin=(EAST, NORTH))
        there = shapely.affinity.translate(turned, shift[0] * CELL, shift[1] * CELL)
        assert there.symmetric_difference(other.outline).area < 0.05 * there.area


# --- pieces


def test_over_sides_of_slopes_walls_and_faces():
    x = (np.arange(60) - 30) * 0.5
    flank = np.tile(np.clip(8.0 - 0.7 * np.abs(x), 0, None), (40, 1))
    assert np.abs(over_sides(flank, 0.5, 4.0)).max() < 1e-12
    wall = np.where(np.abs(x) < 0.3, 3.0, 0.0) + np.zeros((40, 1))
    both, one = over_sides(wall, 0.5, 4.0)
    # A cell away is the ground on both sides: the wall is over it by what no slope explains.
    assert both[20, 30] == pytest.approx(3.0 - STEEPEST * 0.5)
    assert np.count_nonzero(both[20]) == 1
    # Five cells wide: of the two sides the further one counts, or the nearer one.
    block_of = np.where(np.abs(x) < 1.2, 9.0, 0.0) + np.zeros((40, 1))
    both, one = over_sides(block_of, 0.5, 4.0)
    assert both[20, 28:33] == pytest.approx(9.0 - STEEPEST * 0.5 * np.array([5, 4, 3, 4, 5]))
    assert one[20, 28:33] == pytest.approx(9.0 - STEEPEST * 0.5 * np.array([1, 2, 3, 2, 1]))
    face = np.where(x < 0, 3.0, 0.0) + np.zeros((40, 1))
    both, one = over_sides(face, 0.5, 4.0)
    assert not both.any()
    assert one[20, 29] == pytest.approx(3.0 - STEEPEST * 0.5)


@pytest.mark.parametrize("count", [3_000, 400_000])
def test_a_raster_has_the_heights_of_its_places(count):
    """Of a cloud in one part of its box."""
    rng = np.random.default_rng(1)
    x, y = rng.uniform(40, 60, count), rng.uniform(70, 90, count)
    accumulator = TerrainAccumulator([Window(EAST, NORTH, EAST + 100, NORTH + 100)], room=False)
    accumulator.absorb(accumulator.reduce(x + EAST, y + NORTH, LEVEL + 0.1 * x - 0.2 * y))
    raster = raster_of(accumulator.points_of(0))
    rows, columns = raster.z.shape
    east = raster.min_x + (np.arange(columns) + 0.5) * raster.cell - EAST
    north = raster.min_y + (np.arange(rows) + 0.5) * raster.cell - NORTH
    expected = LEVEL + 0.1 * east - 0.2 * north[:, None]
    inner = np.s_[1:-1, 1:-1]
    off = np.abs(raster.z - expected)[inner]
    assert np.nanmax(off) < 0.3 * raster.cell / 2
    assert np.nanmean((raster.z - expected)[inner]) == pytest.approx(0, abs=0.01 * raster.cell)
    # A few points in each.
    assert 4.0 < count * raster.cell**2 / 400 < 20
    assert (np.isfinite(raster.z).mean(), raster.seen.mean()) > (0.9, 0.95)


@pytest.mark.parametrize(("saddle", "piles"), [(0.9 - PROMINENCE, 2), (1.1 - PROMINENCE, 1)])
def test_summits_are_apart_by_their_prominence(saddle, piles):
    """Two tents, 10 and 8 high, whose saddle is at a share of the lower one's height."""
    x = np.arange(81.0)
    pass_at = 8.0 * saddle
    tents = np.maximum(
        10 - (10 - pass_at) * np.abs(x - 20) / 20, 8 - (8 - pass_at) * np.abs(x - 60) / 20
    )
    above = np.tile(tents, (30, 1))
    label = split_at_saddles(above, np.ones(above.shape, dtype=bool), least=0.1)
    assert label.max() == piles
    assert (label[:, :38] == label[15, 20]).all()
    assert (label[:, 43:] == label[15, 60]).all()
    assert split_at_saddles(above, np.ones(above.shape, dtype=bool), least=9.0).max() == 1


def test_no_region_has_no_piles():
    above = np.zeros((9, 9))
    assert not split_at_saddles(above, above > 0, 0.1).any()
