"""Base surfaces against planes and harmonic functions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely
from shapely.geometry import Point, Polygon, box

from quantify_client.errors import SupportError
from quantify_client.volcalc.terrain.base import BASES, SURFACES, make_base
from quantify_client.volcalc.terrain.grid import cell_parts, polygons_of
from quantify_client.volcalc.terrain.ground import find_ground
from quantify_client.volcalc.terrain.rim import sample_rim

from .grounds import EAST, LEVEL, NORTH, at_site, centres, ground_under

SQUARE = at_site(box(5.1, 5.2, 15.3, 13.4))
SHAPES = {
    "square": SQUARE,
    "circle": at_site(Point(12, 12).buffer(6)),
    "concave": at_site(Polygon([(5, 5), (15, 5), (15, 15), (10, 7), (5, 15)])),
    "hole": Polygon(SQUARE.exterior, [at_site(box(8, 8, 10, 10)).exterior]),
    "parts": shapely.MultiPolygon([at_site(box(5, 5, 9, 9)), at_site(box(12, 5, 15, 9))]),
}


def tilted(x, y):
    return 0.1 * x - 0.07 * y


def bumpy(x, y):
    return 0.3 * np.sin(x) * np.cos(0.7 * y) + tilted(x, y)


def case(shape, height=bumpy, noise=0.02):
    polygon = SHAPES[shape]
    heights = ground_under(polygon, height, noise=noise)
    fraction = cell_parts(polygon, heights.window).share
    parts = polygons_of(polygon)
    return parts, heights.window, fraction > 0, sample_rim(parts, heights, fraction)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("name", SURFACES)
def test_bases_through_the_rim_rise_with_it(shape, name):
    parts, window, inside, rim = case(shape)
    low, high = (
        make_base(name, replace(rim, z=rim.z + rise), parts, window, inside).z[inside]
        for rise in (0.0, 2.5)
    )
    np.testing.assert_allclose(high, low + 2.5, rtol=0, atol=1e-9)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("name", BASES)
def test_bases_cover_the_cells_inside_and_no_others(shape, name):
    parts, window, inside, rim = case(shape)
    np.testing.assert_array_equal(
        np.isfinite(make_base(name, rim, parts, window, inside).z), inside
    )


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("name", ["triangulate", "plane"])
def test_on_a_plane_the_base_is_the_plane(shape, name):
    parts, window, inside, rim = case(shape, tilted, noise=0.0)
    off = make_base(name, rim, parts, window, inside).z - LEVEL - tilted(*centres(window))
    whole = cell_whole(shape, window)
    assert np.abs(off[whole]).max() < 5e-3
    # Middles of rim cells outside the polygon take the nearest rim height: half a cell away.
    assert np.abs(off[inside]).max() < 0.03


def cell_whole(shape, window):
    return cell_parts(SHAPES[shape], window).share == 1.0


def test_plane_is_the_weighted_least_squares_plane():
    parts, window, inside, rim = case("concave")
    base = make_base("plane", rim, parts, window, inside)
    design = np.column_stack([rim.x - EAST, rim.y - NORTH, np.ones(len(rim.z))])
    normal = design.T @ (design * rim.length[:, None])
    a, b, c = np.linalg.solve(normal, design.T @ (rim.length * (rim.z - LEVEL)))
    x, y = centres(window)
    np.testing.assert_allclose(base.z[inside], (LEVEL + a * x + b * y + c)[inside], atol=1e-8)


def test_plane_and_average_do_not_depend_on_how_densely_a_side_is_sampled():
    """Corners make short steps; weights by length keep a side's pull equal to its length."""
    parts, window, inside, rim = case("square", tilted, noise=0.0)
    average = make_base("average", rim, parts, window, inside).z[inside]
    middle = tilted((5.1 + 15.3) / 2, (5.2 + 13.4) / 2)
    np.testing.assert_allclose(average, LEVEL + middle, atol=1e-3)


def test_inside_a_circle_the_base_is_the_harmonic_surface_of_its_rim():
    """x^2 - y^2 and x y are harmonic: their values on a rim are continued by themselves."""
    for saddle in (lambda x, y: 0.02 * (x**2 - y**2), lambda x, y: 0.03 * x * y):
        parts, window, inside, rim = case("circle", saddle, noise=0.0)
        exact = LEVEL + saddle(rim.x - EAST, rim.y - NORTH)
        base = make_base("triangulate", replace(rim, z=exact), parts, window, inside)
        whole = cell_whole("circle", window)
        expected = LEVEL + saddle(*centres(window))
        relief = exact.max() - exact.min()
        np.testing.assert_allclose(base.z[whole], expected[whole], atol=0.01 * relief)


def test_arms_of_a_concave_outline_do_not_pull_each_other():
    """The right half lies 3 m higher: that must not reach across the notch between the arms."""
    parts, window, inside, rim = case("concave", lambda x, y: 3.0 * (x > 10), noise=0.0)
    base = make_base("triangulate", rim, parts, window, inside)
    x, y = centres(window)
    arms = cell_whole("concave", window) & (y > 10)
    np.testing.assert_allclose(base.z[arms & (x < 10)], LEVEL, atol=0.01)
    np.testing.assert_allclose(base.z[arms & (x > 10)], LEVEL + 3, atol=0.01)


def test_parts_have_bases_of_their_own():
    parts, window, inside, rim = case("parts", lambda x, y: 2.0 * (x > 10.5), noise=0.0)
    z = make_base("triangulate", rim, parts, window, inside).z
    x, _ = centres(window)
    np.testing.assert_allclose(z[inside & (x < 10.5)], LEVEL, atol=1e-6)
    np.testing.assert_allclose(z[inside & (x > 10.5)], LEVEL + 2, atol=1e-6)


def test_lowest_and_highest_are_those_of_the_rim():
    parts, window, inside, rim = case("square")
    for name, value in (("lowest", rim.z.min()), ("highest", rim.z.max())):
        base = make_base(name, rim, parts, window, inside)
        np.testing.assert_allclose(base.z[inside], value, rtol=0, atol=1e-9)
        assert base.name == name


@pytest.mark.parametrize("with_rim", [True, False])
def test_an_elevation_is_itself_and_depends_on_no_rim(with_rim):
    parts, window, inside, rim = case("square")
    base = make_base(159.5, rim if with_rim else None, parts, window, inside)
    assert (base.z[inside] == 159.5).all()
    assert base.rim is None


def test_kriged_is_the_predicted_ground_and_needs_no_rim():
    parts, window, inside, _ = case("square", tilted, noise=0.0)
    ground = find_ground(SQUARE, ground_under(SQUARE, tilted, noise=0.0), 1.0 * inside)
    base = make_base("kriged", None, parts, window, inside, ground)
    assert (base.name, base.rim) == ("kriged", None)
    expected = LEVEL + tilted(*centres(window))
    np.testing.assert_allclose(base.z[inside], expected[inside], rtol=0, atol=2e-3)


def test_where_no_ground_is_seen_triangulate_takes_the_place_of_kriged():
    parts, window, inside, rim = case("square")
    base = make_base("kriged", rim, parts, window, inside)
    assert base.name == "triangulate"
    same = make_base("triangulate", rim, parts, window, inside)
    np.testing.assert_array_equal(base.z, same.z)


def test_without_a_rim_only_an_elevation_is_a_base():
    parts, window, inside, _ = case("square")
    with pytest.raises(SupportError, match="give the base as an elevation"):
        make_base("plane", None, parts, window, inside)
