"""Pictures are drawn of every kind of result, and tell cut from fill."""

from __future__ import annotations

import dataclasses
import io
import subprocess
import sys
from typing import Any, Tuple

import numpy as np
import pytest
import shapely
from PIL import Image

from quantify_client.report.figures import pictures
from quantify_client.report.figures.look import drawable, nice_step
from quantify_client.report.figures.terrain import shading
from quantify_client.report.figures.terrain.plan import contour_levels
from quantify_client.report.figures.terrain.section import longest_direction, sample, section_of
from quantify_client.report.wording.units import display_units
from quantify_client.types import Relief

from . import surveys


def draw(result: Any, **changes: Any) -> np.ndarray:
    measurement = surveys.measurement(result, **changes)
    png = pictures.area_picture(result, measurement, display_units(measurement, "metric"))
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).astype(int)


def reddish_and_bluish(image: np.ndarray) -> Tuple[int, int]:
    red, blue = image[..., 0], image[..., 2]
    return int((red - blue > 60).sum()), int((blue - red > 60).sum())


def test_a_pile_is_brown_and_a_pit_is_blue() -> None:
    red, blue = reddish_and_bluish(draw(surveys.pile()))
    assert red > 50_000 > 5_000 > blue
    red, blue = reddish_and_bluish(draw(surveys.hollow()))
    assert blue > 50_000 > 5_000 > red


def test_the_ground_round_one_area_hides_no_other() -> None:
    """Both areas' reliefs show the same pile, each within its own polygon."""
    halves = [shapely.box(4, 4, 20, 32), shapely.box(20, 4, 36, 32)]
    results = [
        surveys.terrain(name, surveys.relief(surveys.cone, polygon))
        for name, polygon in zip("ab", halves)
    ]
    measurement = surveys.measurement(*results)
    png = pictures.overview_picture(measurement, display_units(measurement, "metric"))
    assert png is not None
    image = np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).astype(int)
    plan = image[:, 75:1080]  # without the colour bar
    brown = plan[..., 0] - plan[..., 2] > 60
    columns = np.flatnonzero(brown.any(axis=0))
    middle = (columns[0] + columns[-1]) // 2
    left, right = brown[:, :middle].sum(), brown[:, middle:].sum()
    assert 0.7 < left / right < 1.4


def test_pictures_are_1400_wide_whatever_the_form() -> None:
    long = shapely.box(2, 2, 118, 8)
    for polygon, size in ((long, (120.0, 10.0)), (shapely.box(2, 2, 8, 118), (10.0, 120.0))):
        ground = surveys.relief(surveys.cone, polygon, size_m=size, cell_m=0.5)
        image = draw(surveys.terrain("long", ground))
        assert image.shape[1] == 1400
        assert 500 < image.shape[0] < 1200


@pytest.mark.parametrize("name", ["砂 🏔", "$\\frac{", "x" * 500, "", "a\nb\x1b", surveys.HOSTILE])
def test_any_name_can_be_drawn(name: str) -> None:
    assert draw(surveys.body(name)).shape[1] == 1400


def test_letters_the_font_lacks_become_boxes() -> None:
    assert drawable("砂 pile ²") == "\u25af pile ²"


@pytest.mark.parametrize("change", ["nothing known", "flat", "one cell", "no slices"])
def test_poor_reliefs_are_drawn_all_the_same(change: str) -> None:
    pile = surveys.pile()
    relief = pile.relief
    assert relief is not None
    if change == "nothing known":
        nothing = np.full_like(relief.elevation_m, np.nan)
        relief = dataclasses.replace(relief, elevation_m=nothing, above_base_m=nothing)
    elif change == "flat":
        flat = np.zeros_like(relief.elevation_m)
        relief = dataclasses.replace(relief, elevation_m=flat, above_base_m=flat)
    elif change == "one cell":
        one = np.ones((1, 1))
        square = shapely.to_wkb(shapely.box(0, 0, 1, 1))
        relief = Relief(0.0, 0.0, 1.0, one, one, one, one > 0, square)
    slices = () if change == "no slices" else pile.slices
    assert draw(dataclasses.replace(pile, relief=relief, slices=slices)).shape[1] == 1400


def test_overview_needs_two_areas() -> None:
    one = surveys.measurement(surveys.pile(), surveys.body(), surveys.failure())
    two = surveys.measurement(surveys.pile(), surveys.hollow())
    units = display_units(one, "metric")
    assert pictures.overview_picture(one, units) is None
    png = pictures.overview_picture(two, units)
    assert png is not None
    red, blue = reddish_and_bluish(
        np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).astype(int)
    )
    assert red > 5_000
    assert blue > 5_000


def test_shade_is_that_of_a_plane() -> None:
    x, y = np.meshgrid(np.arange(9) * 2.0, np.arange(7) * 2.0)
    assert shading.slope(0.3 * x - 0.1 * y, 2.0, 1) == pytest.approx(0.3, abs=1e-12)
    assert shading.slope(0.3 * x - 0.1 * y, 2.0, 0) == pytest.approx(-0.1, abs=1e-12)
    assert shading.hill_shade(np.zeros((4, 5)), 1.0) == pytest.approx(0.7071, abs=1e-9)
    to_light, from_light = (shading.hill_shade(s * (x - y), 2.0).mean() for s in (1, -1))
    assert to_light > 0.8
    assert from_light < 0.5


def test_gaps_do_not_grow_in_the_shade() -> None:
    ground = np.arange(25.0).reshape(5, 5)
    ground[2, 2] = np.nan
    assert np.isnan(shading.hill_shade(ground, 1.0)).sum() == 1


def test_coarsening_averages_what_is_known() -> None:
    values = np.array([[1.0, 3.0, 5.0], [np.nan, 2.0, 7.0], [np.nan, np.nan, 9.0]])
    assert np.array_equal(
        shading.block_mean(values, 2), [[2.0, 6.0], [np.nan, 9.0]], equal_nan=True
    )


def test_section_runs_through_the_peak_along_the_longest_extent() -> None:
    polygon = shapely.box(4, 10, 40, 26)
    relief = surveys.relief(surveys.cone, polygon, gaps=0.0)
    section = section_of(relief)
    assert section is not None
    assert np.ptp(section.y) == pytest.approx(0.0, abs=1e-6)
    assert section.x[0] == pytest.approx(surveys.EASTING + 4 - 36 * 0.06, abs=0.01)
    above = section.terrain_m - section.base_m
    peak = int(np.nanargmax(above))
    assert section.x[peak] == pytest.approx(surveys.EASTING + 20, abs=0.6)
    assert above[peak] == pytest.approx(6.0, abs=0.2)
    assert np.isnan(section.base_m[0])  # the base ends where the area does


def test_a_line_is_sampled_between_known_cells_and_ends_where_the_cell_is_unknown() -> None:
    pile = surveys.pile().relief
    assert pile is not None
    values = np.array([[1.0, 3.0, np.nan], [2.0, 4.0, np.nan]])
    relief = dataclasses.replace(pile, min_x=surveys.EASTING, min_y=surveys.NORTHING, cell_m=2.0)
    x = surveys.EASTING + np.array([2.0, 1.0, 3.9, 4.1, -0.1])
    y = surveys.NORTHING + np.array([2.0, 1.5, 1.0, 1.0, 1.0])
    expected = [2.5, 1.25, 3.0, np.nan, np.nan]
    assert sample(values, relief, x, y) == pytest.approx(expected, abs=1e-9, nan_ok=True)


def test_longest_direction_points_along_a_turned_rectangle() -> None:
    turned = shapely.affinity.rotate(shapely.box(0, 0, 10, 2), 30, origin=(0, 0))
    assert longest_direction(turned) == pytest.approx([np.sqrt(3) / 2, 0.5], abs=1e-9)


def test_contours_are_slice_boundaries_without_zero() -> None:
    pile = surveys.pile()
    assert pile.relief is not None
    levels = contour_levels(list(pile.slices), pile.relief.above_base_m)
    assert levels
    assert all(abs(level) > 0.1 and (level / 0.5) % 1 == 0 for level in levels)


def test_steps_are_round() -> None:
    assert [nice_step(v) for v in (9.99, 0.05, 1234.0)] == [5.0, 0.05, 1000.0]


def test_importing_the_room_does_not_load_matplotlib() -> None:
    code = "import sys, quantify_client.report; sys.exit('matplotlib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
