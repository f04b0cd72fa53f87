"""What must change no digit of an area's volume: heights, neighbours, order, repetitions, scale."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from shapely import affinity
from shapely.geometry import Polygon
from terrains import circle

from quantify_client.types import Window
from quantify_client.volcalc.terrain.accumulate import TerrainAccumulator
from quantify_client.volcalc.terrain.grid_offsets import measure_area
from quantify_client.volcalc.terrain.measure import TerrainRecipe

pytestmark = pytest.mark.one_python

#: A cone of radius 8 and height 4 on a square of 40, of which 15,000 points were measured.
CONE = np.pi * 8**2 * 4 / 3
OUTLINE = circle(9.0, 20.0, 20.0)
EAST, NORTH = 412_000.0, 5_712_000.0


def cone(count=15_000, seed=0):
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(0, 40, (2, count))
    z = 4 * np.clip(1 - np.hypot(x - 20, y - 20) / 8, 0, None) + rng.normal(0, 0.01, count)
    z[rng.random(count) < 0.01] += 5.0
    return np.stack([x, y, np.round(z, 6)])


POINTS = cone()


def placed(points, x=EAST, y=NORTH, z=0.0):
    return points + np.array([[x], [y], [z]])


def results(points, outlines, pieces=1, lowest=0.0):
    """The results of areas, as the pipeline measures them."""
    accumulator = TerrainAccumulator([Window(*outline.bounds) for outline in outlines], lowest)
    for part in np.array_split(points, pieces, axis=1):
        accumulator.absorb(accumulator.reduce(*part))
    for number, outline in enumerate(outlines):
        points = accumulator.points_of(number)
        yield measure_area("area", points.to_local(outline), points, TerrainRecipe())


def bits(result):
    return (
        result.volume_m3,
        result.cut_m3,
        result.fill_m3,
        result.std_m3,
        result.coverage,
        result.cell_m,
        result.points_used,
        dict(result.points_left_out),
        [check.volume_m3 for check in result.checks],
    )


def measured(points, outline=OUTLINE, **how):
    (result,) = results(points, [outline], **how)
    return result


@pytest.fixture(scope="module")
def plain():
    found = measured(placed(POINTS), affinity.translate(OUTLINE, EAST, NORTH))
    assert abs(found.volume_m3 - CONE) < 1.96 * found.std_m3 < 0.02 * CONE
    return found


def test_pictures_lie_where_the_area_lies(plain):
    """Everything is measured from the area's local origin; what is drawn is back in the frame."""
    outline = affinity.translate(OUTLINE, EAST, NORTH)
    relief = plain.relief
    drawn = shapely.from_wkb(relief.polygon_wkb)
    assert shapely.hausdorff_distance(drawn, outline) < 1e-8
    row, column = np.nonzero(relief.fraction)
    x, y = relief.min_x + column * relief.cell_m, relief.min_y + row * relief.cell_m
    near = 2 * relief.cell_m
    assert (x.min(), y.min()) == pytest.approx(outline.bounds[:2], abs=near)
    assert (x.max(), y.max()) == pytest.approx(outline.bounds[2:], abs=near)
    top = np.nanargmax(relief.above_base_m)
    peak = np.array([relief.min_x, relief.min_y]) + relief.cell_m * np.array(
        np.unravel_index(top, relief.above_base_m.shape)[::-1]
    )
    assert np.abs(peak - [EAST + 20, NORTH + 20]).max() < 2.0


def assert_same_cone(found, scale):
    """Cells are up to twice as wide, for the same density, at one scale as at another.

    Three standard deviations: one survey in twenty is beyond two, and these are many.
    """
    half = 3.0 * found.std_m3 / scale**3
    assert half < 0.01 * CONE
    assert found.volume_m3 / scale**3 == pytest.approx(CONE, abs=half)


@pytest.mark.parametrize("lift", [-11_000.0, -432.1, 0.37, 1600.0, 9000.0])
@pytest.mark.parametrize("cell", [0.0005, 0.02, 1.0, 50.0])
def test_how_high_a_site_lies_changes_no_volume(plain, lift, cell):
    """A site of cells of half a millimetre is 30 mm wide; its heights count from its own level."""
    scale = cell / plain.cell_m
    outline = affinity.scale(OUTLINE, scale, scale, origin=(0, 0))
    here = measured(POINTS * scale, outline)
    there = measured(placed(POINTS * scale, 0.0, 0.0, lift), outline, lowest=lift)
    assert there.cell_m == here.cell_m == pytest.approx(cell, rel=1.0)
    assert there.points_used == pytest.approx(here.points_used, abs=3)
    # Bins of heights lie elsewhere on the ground: a stray more or less.
    assert there.volume_m3 == pytest.approx(here.volume_m3, abs=0.1 * here.std_m3)
    assert_same_cone(there, scale)


@pytest.mark.parametrize("lift", [-11_000.0, 1600.0, 9000.0])
def test_a_plot_of_a_metre_needs_no_level_to_count_from(lift):
    """Of heights down to the sea's floor none is clipped, whatever the header says of z."""
    scale = 1.0 / 40
    points = POINTS * scale
    points[2] += lift
    found = measured(points, affinity.scale(OUTLINE, scale, scale, origin=(0, 0)))
    assert_same_cone(found, scale)


def test_heights_that_fit_nowhere_are_counted():
    points = placed(POINTS)
    points[2, ::50] += 1e9
    accumulator = TerrainAccumulator([Window(*affinity.translate(OUTLINE, EAST, NORTH).bounds)])
    accumulator.absorb(accumulator.reduce(*points))
    cubes = accumulator.points_of(0).cubes
    assert cubes.too_far == pytest.approx(15_000 / 50 * (18 / 40) ** 2, rel=0.3)


@pytest.mark.parametrize("scale", [2.0**-9, 0.25, 4.0, 2.0**12])
def test_a_scale_by_a_power_of_two_changes_no_bit(scale):
    outline = affinity.scale(OUTLINE, scale, scale, origin=(0, 0))
    here, there = measured(POINTS), measured(POINTS * scale, outline)
    assert there.volume_m3 == here.volume_m3 * scale**3
    assert there.coverage == here.coverage


@pytest.mark.parametrize("scale", [0.001, 0.3048, 0.7, 1.7, 39.37])
def test_at_any_scale_the_truth_is_in_the_interval(scale):
    outline = affinity.scale(OUTLINE, scale, scale, origin=(0, 0))
    assert_same_cone(measured(POINTS * scale, outline), scale)


def somewhere(rng):
    """An outline anywhere: on the cone, beside it, far away, large or small."""
    wide = 10.0 ** rng.uniform(-0.5, 3.5)
    x, y = rng.uniform(-1, 1, 2) * 10.0 ** rng.uniform(0, 6)
    corners = [(0, 0), (wide, 0.1 * wide), (wide, wide), (0.2 * wide, 0.8 * wide)]
    return affinity.translate(Polygon(corners), EAST + 20 + x, NORTH + 20 + y)


@pytest.mark.parametrize("seed", range(6))
def test_other_areas_and_other_parts_of_a_cloud_change_no_digit(plain, seed):
    rng = np.random.default_rng(seed)
    mine = affinity.translate(OUTLINE, EAST, NORTH)
    others = [somewhere(rng) for _ in range(rng.integers(1, 5))]
    place = int(rng.integers(0, len(others) + 1))
    outlines = [*others[:place], mine, *others[place:]]
    # More of the cloud, beyond the reach of the area, in other densities and at other heights.
    far = placed(rng.normal(0, 10.0 ** rng.uniform(1, 4, (3, 1)), (3, 3000)), 90.0, 0.0)
    far = far[:, np.hypot(far[0] - 20, far[1] - 20) > 70]
    points = np.concatenate([placed(POINTS), placed(far)], axis=1)
    points = points[:, rng.permutation(points.shape[1])]
    accumulator = TerrainAccumulator([Window(*o.bounds) for o in outlines], rng.uniform(-9, 9))
    for part in np.array_split(points, rng.integers(1, 9), axis=1):
        accumulator.absorb(accumulator.reduce(*part))
    kept = accumulator.points_of(place)
    found = measure_area("area", kept.to_local(mine), kept, TerrainRecipe())
    assert bits(found) == bits(plain)


def test_two_equal_yards_give_equal_volumes_however_far_apart(plain):
    """2 km apart they gave 248, at 5 km 169 and at 20 km 0 with a coverage of 100 %."""
    for apart in (2000.0, 5000.0, 20_000.0):
        points = np.concatenate([placed(POINTS), placed(POINTS, EAST + apart)], axis=1)
        outlines = [affinity.translate(OUTLINE, EAST + east, NORTH) for east in (0.0, apart)]
        one, other = results(points, outlines)
        assert bits(one) == bits(plain)
        assert other.volume_m3 == pytest.approx(plain.volume_m3, rel=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_order_and_chunks_change_no_bit(plain, seed):
    """Outliers among them: which points are strays does not depend on their order."""
    rng = np.random.default_rng(seed)
    points = placed(POINTS)[:, rng.permutation(POINTS.shape[1])]
    mine = affinity.translate(OUTLINE, EAST, NORTH)
    assert bits(measured(points, mine, pieces=int(rng.integers(1, 300)))) == bits(plain)


@pytest.mark.parametrize("times", [2, 3, 4, 10])
def test_points_that_are_there_several_times_change_no_bit(plain, times):
    mine = affinity.translate(OUTLINE, EAST, NORTH)
    found = measured(np.repeat(placed(POINTS), times, axis=1), mine)
    assert found.points_used == times * plain.points_used
    assert bits(found)[:6] == bits(plain)[:6]


@pytest.mark.parametrize("share", [0.01, 0.3, 0.8])
def test_some_points_there_again_change_little(plain, share):
    """Tiles that overlap, and a few points that are there a hundred times."""
    rng = np.random.default_rng(3)
    mine = affinity.translate(OUTLINE, EAST, NORTH)
    points = placed(POINTS)
    again = points[:, points[0] > EAST + 40 * (1 - share)]
    often = np.repeat(points[:, rng.random(points.shape[1]) < 0.002], 100, axis=1)
    for more in (again, often):
        found = measured(np.concatenate([points, more], axis=1), mine)
        assert found.cell_m == plain.cell_m
        assert found.coverage == pytest.approx(plain.coverage, abs=1e-3)
        assert found.volume_m3 == pytest.approx(plain.volume_m3, abs=0.5 * plain.std_m3)


def test_a_copy_with_a_millimetre_of_noise_changes_little(plain):
    mine = affinity.translate(OUTLINE, EAST, NORTH)
    points = placed(POINTS)
    copy = points + np.random.default_rng(5).normal(0, 1e-3, points.shape)
    found = measured(np.concatenate([points, copy], axis=1), mine)
    assert found.cell_m == plain.cell_m
    assert found.coverage == pytest.approx(plain.coverage, abs=2e-3)
    assert found.volume_m3 == pytest.approx(plain.volume_m3, abs=0.1 * plain.std_m3)
