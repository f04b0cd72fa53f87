"""Closed forms, end to end: a file of a survey goes in, its volume comes out.

200,000 points with 2 cm noise and 1 % of them 5 m off, unless said.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import shapely
from clouds import write_las, write_ply
from shapely.geometry import MultiPolygon, Point, Polygon, box
from terrains import (
    CLEAN,
    LEVEL,
    Errors,
    circle,
    cone,
    flat,
    four_piles,
    gully,
    integral,
    pit,
    placed,
    survey,
    tilted,
    undulating,
    walled_box,
)

from quantify_client import measure
from quantify_client.types import AreaResult

#: The same chain runs on the second Python with fewer points (test_pipeline.py, test_ground.py).
pytestmark = pytest.mark.one_python


def measured(folder, terrain, errors=None, seed=0, count=200_000, **options):
    """Survey a terrain into a file and measure it."""
    points = survey(terrain.height, errors or Errors(), count, seed)
    path = write_ply(folder / "survey.ply", points, extra=False)
    (result,) = measure(path, area=terrain.area, **options).results
    assert isinstance(result, AreaResult)
    return result


CASES = [
    ("cone, clean", cone(), CLEAN, 0.003),
    ("cone, clean, on a tilt", cone().on(tilted), CLEAN, 0.003),
    ("cone", cone(), Errors(), 0.01),
    ("cone on a tilt", cone().on(tilted), Errors(), 0.01),
    ("cone on undulating ground", cone().on(undulating), Errors(), 0.02),
    ("cone in a wide square", replace(cone(), outline=box(8, 9, 31, 33)), Errors(), 0.01),
    ("cone drawn at its toe", replace(cone(), outline=circle(8.0)), Errors(), 0.01),
    ("gully inside", gully(), Errors(), 0.01),
    ("gully across the outline", gully(crossing=True), Errors(), 0.01),
    ("gully across, on a tilt", gully(crossing=True).on(tilted), Errors(), 0.01),
    ("meandering gully inside", gully(3), Errors(), 0.01),
    ("meandering gully across the outline", gully(3, crossing=True), Errors(), 0.01),
    ("pit", pit(), Errors(), 0.01),
    ("pit on a tilt", pit().on(tilted), Errors(), 0.01),
    ("box with vertical walls", walled_box(), Errors(), 0.015),
    ("four touching piles", four_piles(), Errors(), 0.01),
    ("four piles on undulating ground", four_piles().on(undulating), Errors(), 0.04),
    ("pit, strays below", pit(), Errors(stray=(-5.0,)), 0.01),
    ("meandering gully, strays on both sides", gully(3), Errors(stray=(-5.0, 5.0)), 0.01),
    ("box, strays on both sides", walled_box(), Errors(stray=(-5.0, 5.0)), 0.015),
]


@pytest.mark.parametrize(
    ("terrain", "errors", "tolerance"), [c[1:] for c in CASES], ids=[c[0] for c in CASES]
)
def test_volume_matches_the_closed_form(tmp_path, terrain, errors, tolerance):
    result = measured(tmp_path, terrain, errors)
    assert result.volume_m3 == pytest.approx(terrain.volume, rel=tolerance)
    assert result.volume_m3 == pytest.approx(result.cut_m3 - result.fill_m3, rel=1e-9)
    cut, fill = (terrain.volume, 0.0) if terrain.volume > 0 else (0.0, -terrain.volume)
    if terrain.ground is not undulating:
        slack = tolerance * abs(terrain.volume)
        assert result.cut_m3 == pytest.approx(cut, abs=slack)
        assert result.fill_m3 == pytest.approx(fill, abs=slack)
    assert result.checks[0].volume_m3 == pytest.approx(terrain.volume, rel=1.5 * tolerance)
    assert result.area_m2 == pytest.approx(terrain.outline.area, rel=1e-9)
    assert result.coverage > 0.98
    if errors.outliers:
        strays = errors.outliers * (result.points_used + result.points_left_out["outliers"])
        assert result.points_left_out["outliers"] == pytest.approx(strays, rel=0.3)


def test_a_gully_across_the_outline_is_said_to_be_bridged(tmp_path):
    result = measured(tmp_path, gully(crossing=True), base="triangulate")
    assert sum("crosses a channel" in warning for warning in result.warnings) == 2


def test_the_interval_of_piles_on_undulating_ground_says_that_the_base_is_a_guess(tmp_path):
    terrain = four_piles().on(undulating)
    result = measured(tmp_path, terrain)
    assert result.std_m3 > 0.005 * terrain.volume
    low, high = (result.volume_m3 + sign * 1.96 * result.std_m3 for sign in (-1, 1))
    assert low < terrain.volume < high


# --- outlines


def test_two_parts_are_one_volume_on_bases_of_their_own(tmp_path):
    """Two cones on terraces 2 m apart in height."""
    low, high = cone(5.0, 3.0, 12.0, 12.0), cone(5.0, 3.0, 28.0, 28.0)
    terrain = replace(
        low,
        feature=lambda x, y: low.feature(x, y) + high.feature(x, y),
        ground=lambda x, y: 2.0 * (x + y > 40),
        outline=MultiPolygon([low.outline, high.outline]),
        volume=2 * low.volume,
    )
    result = measured(tmp_path, terrain, base="triangulate")
    assert result.volume_m3 == pytest.approx(terrain.volume, rel=0.01)
    assert result.area_m2 == pytest.approx(2 * low.outline.area)
    # One random field for both terraces is a poor model of the step, and its interval says so.
    kriged = measured(tmp_path, terrain)
    assert abs(kriged.volume_m3 - terrain.volume) < 1.96 * kriged.std_m3


@pytest.mark.parametrize("ground", [flat, tilted])
@pytest.mark.parametrize("base", ["triangulate", "plane"])
def test_a_hole_takes_area_away_and_gives_no_rim(tmp_path, ground, base):
    """A hole on the cone's flank: a rim along it would lift the base by metres."""
    hole = box(20.13, 18.2, 24.4, 22.6)
    whole = cone()
    outline = Polygon(whole.outline.exterior, [hole.exterior])
    volume = whole.volume - integral(whole.feature, hole)
    result = measured(
        tmp_path, replace(whole, outline=outline, volume=volume).on(ground), base=base
    )
    assert result.volume_m3 == pytest.approx(volume, rel=0.01)
    assert result.area_m2 == pytest.approx(whole.outline.area - hole.area)
    assert result.checks[0].volume_m3 == pytest.approx(volume, rel=0.015)


# --- bases

TRIANGLE = Polygon([(5.0, 6.0), (37.0, 8.0), (19.0, 38.0)])
PILE = replace(cone(6.0, 3.0, 20.0, 17.0), outline=TRIANGLE).on(tilted)


def along(outline, height):
    """Heights of the ground along an outline, by length."""
    ways = np.linspace(0, outline.length, 20_000)
    places = shapely.line_interpolate_point(outline.exterior, ways)
    return height(*shapely.get_coordinates(places).T)


RIM = along(TRIANGLE, tilted)
LEVELS = {
    "average": RIM.mean(),
    "lowest": RIM.min(),
    "highest": RIM.max(),
    101.5: 1.5,
    98.0: -2.0,
}


@pytest.fixture(scope="module")
def pile(tmp_path_factory):
    assert TRIANGLE.contains(Point(20, 17).buffer(6.5))
    path = tmp_path_factory.mktemp("pile") / "pile.las"
    points = survey(PILE.height, Errors())
    # LAS offsets as ODM writes them; the points are whole millimetres.
    return write_las(path, points)


@pytest.fixture(scope="module")
def on_base(pile):
    """Measure the pile on a base; each one once, whichever tests ask for it."""

    @cache
    def measured_on(base):
        (result,) = measure(pile, area=PILE.area, base=base).results
        return result

    return measured_on


@pytest.mark.parametrize("base", LEVELS)
def test_level_bases_match_quadrature(on_base, base):
    result = on_base(base)

    def above(x, y):
        return PILE.height(x, y) - LEVELS[base]

    cut = integral(lambda x, y: np.maximum(above(x, y), 0), TRIANGLE, 0.03)
    fill = integral(lambda x, y: np.maximum(-above(x, y), 0), TRIANGLE, 0.03)
    # Lowest and highest hang on one rim point each: 1.5 cm of it.
    slack = (0.015 if base in ("lowest", "highest") else 0.004) * TRIANGLE.area
    assert result.cut_m3 == pytest.approx(cut, abs=slack)
    assert result.fill_m3 == pytest.approx(fill, abs=slack)
    assert result.volume_m3 == pytest.approx(cut - fill, abs=slack)
    assert result.base == base


@pytest.mark.parametrize("base", ["plane", "triangulate"])
def test_bases_that_follow_the_tilt_give_the_pile(on_base, base):
    result = on_base(base)
    assert result.volume_m3 == pytest.approx(PILE.volume, rel=0.01)


@pytest.mark.parametrize("seed", range(3))
def test_an_outline_on_a_slope_cuts_cells_where_it_lies(tmp_path, seed):
    """A circle of 5 m halfway up a cone: 0.4 % too low with heights of whole cells."""
    outline = circle(5.0)
    terrain = replace(cone(), outline=outline, volume=integral(cone().feature, outline))
    result = measured(tmp_path, terrain, CLEAN, seed, 20_000, base=LEVEL)
    assert result.volume_m3 == pytest.approx(terrain.volume, rel=1e-3)


def test_compare_is_the_single_runs_side_by_side(pile, on_base):
    (table,) = measure(pile, area=PILE.area, base="compare").results
    assert [row.base for row in table.bases] == [
        "kriged", "triangulate", "plane", "average", "lowest", "highest",
    ]  # fmt: skip
    for row in table.bases:
        alone = on_base(row.base)
        for name in ("volume_m3", "cut_m3", "fill_m3", "std_m3", "slices", "warnings"):
            assert getattr(row, name) == getattr(alone, name), (row.base, name)
    assert table.volume_m3 == table.bases[0].volume_m3


def test_a_base_is_off_by_its_departure_from_the_predicted_ground(tmp_path):
    """In squares: its volume less that on the kriged base, and what that one is off by."""
    table = measured(tmp_path, four_piles().on(undulating), count=60_000, base="compare")
    kriged, *others = table.bases
    (own,) = (item.std_m3 for item in kriged.budget if item.source == "base")
    assert own > 0
    for row in others:
        (std,) = (item.std_m3 for item in row.budget if item.source == "base")
        # Volumes are means over four grid offsets, the budget is that of the first.
        assert std == pytest.approx(math.hypot(own, row.volume_m3 - kriged.volume_m3), rel=0.05)


@pytest.mark.parametrize(
    "cutting",
    [{"slices": 1}, {"slices": 997}, {"slice_height": 0.37}, {"slice_height": 9.0}],
)
@pytest.mark.parametrize("base", [101.5])
def test_any_number_of_slices_sums_to_the_same_net(pile, on_base, cutting, base):
    auto = on_base(base)
    (result,) = measure(pile, area=PILE.area, base=base, **cutting).results
    assert result.volume_m3 == auto.volume_m3
    assert (result.cut_m3, result.fill_m3) == (auto.cut_m3, auto.fill_m3)
    volumes = np.array([part.volume_m3 for part in result.slices])
    middle = np.array([part.z_m for part in result.slices])
    assert volumes.sum() == pytest.approx(result.volume_m3, abs=1e-8)
    assert volumes[middle > 0].sum() == pytest.approx(result.cut_m3, abs=1e-8)
    assert -volumes[middle < 0].sum() == pytest.approx(result.fill_m3, abs=1e-8)
    if "slices" in cutting:
        assert cutting["slices"] <= len(volumes) <= cutting["slices"] + 1


def test_slices_are_those_of_the_cone(tmp_path):
    """Frustums of a cone on flat ground, with noise and strays."""
    terrain = cone()
    result = measured(tmp_path, terrain, slice_height=0.5)
    for number, part in enumerate(one for one in result.slices if 0.5 < one.z_m < 3.5):
        low, high = (8 * (1 - z / 4) for z in (0.5 * (number + 1), 0.5 * (number + 2)))
        frustum = np.pi * 0.5 / 3 * (low**2 + low * high + high**2)
        assert part.volume_m3 == pytest.approx(frustum, rel=0.02)


# --- nothing there


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("ground", [flat, tilted])
def test_on_a_noisy_plane_cut_and_fill_may_be_nothing(tmp_path, seed, ground):
    nothing = replace(cone(), feature=flat, volume=0.0).on(ground)
    result = measured(tmp_path, nothing, seed=seed, count=50_000)
    assert result.cut_m3 >= 0
    assert result.fill_m3 >= 0
    assert result.cut_m3 - 1.96 * result.cut_std_m3 <= 0
    assert result.fill_m3 - 1.96 * result.fill_std_m3 <= 0
    assert abs(result.volume_m3) <= 3 * result.std_m3
    # Summing what is above the base would give 0.4 sigma of a cell on each of half the cells.
    assert result.cut_m3 < 0.004 * result.area_m2


def test_a_perfect_plane_is_nothing(tmp_path):
    for options in ({}, {"slice_height": 1.0}, {"slices": 5}):
        nothing = replace(cone(), feature=flat, volume=0.0)
        result = measured(tmp_path, nothing, CLEAN, count=20_000, **options)
        assert result.volume_m3 == pytest.approx(0.0, abs=1e-6)
        assert result.min_z_m == pytest.approx(LEVEL)


def test_areas_of_one_file_keep_their_names(tmp_path):
    path = write_ply(tmp_path / "survey.ply", survey(cone().height, count=20_000), extra=False)
    features = [
        {
            "type": "Feature",
            "properties": {"name": name},
            "geometry": shapely.geometry.mapping(placed(box(12, 12, 28, 28))),
        }
        for name in ("heap", "heap")
    ]
    results = measure(path, area={"type": "FeatureCollection", "features": features}).results
    assert [result.name for result in results] == ["heap", "heap-2"]
    assert results[0].volume_m3 == results[1].volume_m3
