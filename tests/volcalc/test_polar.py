"""The paper's algorithm: its own numbers, closed forms and invariants."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from quantify_client.errors import InputError
from quantify_client.volcalc.paper import polar_volume

EAST, NORTH, HIGH = 576_710.5, 5_188_139.0, 160.25


def cube_surface(count, seed):
    """Points spread evenly at random over the faces of the unit cube."""
    rng = np.random.default_rng(seed)
    face = rng.integers(0, 6, count)
    points = rng.random((count, 3))
    points[np.arange(count), face % 3] = face // 3
    return points.T


def sphere_surface(count, seed, radius=0.5):
    points = np.random.default_rng(seed).normal(size=(count, 3))
    return radius * (points / np.linalg.norm(points, axis=1)[:, None]).T


def prism(corners, levels, radius=3.0, height=2.0):
    """A regular n-gon at each of the levels: its area is n/2 r^2 sin(2 pi / n)."""
    angle = 2.0 * np.pi * np.arange(corners) / corners + 0.1
    z = np.repeat(np.linspace(0.0, height, levels), corners)
    return (
        np.tile(radius * np.cos(angle), levels),
        np.tile(radius * np.sin(angle), levels),
        z,
    )


@pytest.mark.parametrize(("slabs", "paper"), [(10, 0.902733), (36, 0.972945), (50, 0.980506)])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_unit_cube_comes_out_as_in_the_paper(slabs, paper, seed):
    measured = polar_volume(*cube_surface(100_000, seed), slabs).volume
    assert measured == pytest.approx(paper, abs=0.015)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_thin_sphere_collapses_with_more_slabs_as_in_the_paper(seed):
    points = sphere_surface(2_000, seed)
    ten, fifty, hundred = (polar_volume(*points, slabs).volume for slabs in (10, 50, 100))
    assert hundred < fifty < ten < np.pi / 6.0
    assert hundred == pytest.approx(0.451873, abs=0.04)
    assert fifty == pytest.approx(0.522469, abs=0.04)
    assert ten == pytest.approx(0.490252, abs=0.04)


def test_centred_caps_take_the_bias_of_the_cube_s_caps_away():
    """A cap full of points gets about half its area; centred, only half of its slab is body."""
    points = cube_surface(100_000, 4)
    centred = polar_volume(*points, 10, center_caps=True)
    assert polar_volume(*points, 10).volume < 0.92
    assert centred.volume == pytest.approx(1.0, abs=0.01)
    assert centred.slices[0].z_m == pytest.approx(0.0)
    assert centred.slices[-1].z_m == pytest.approx(1.0)
    assert centred.slab_height == pytest.approx(1.0 / 9.0)


def test_centred_caps_put_one_level_of_a_pyramid_into_each_slab():
    """The slab at level z is a square of side 2 (1 - z); their sum is 4 h (1 + .81 + ... + 0)."""
    levels = np.linspace(0.0, 1.0, 11)
    corners = np.array([(1, 1), (1, -1), (-1, -1), (-1, 1)], dtype=float)
    x, y = ((1.0 - levels)[:, None, None] * corners).reshape(-1, 2).T
    result = polar_volume(x + EAST, y + NORTH, np.repeat(levels, 4), 11, center_caps=True)
    assert result.volume == pytest.approx(4.0 * 0.1 * 3.85)
    assert [one.points for one in result.slices] == [4] * 11


def test_two_stacked_squares():
    square = np.array([(0, 0), (1, 1), (1, 0), (0, 1)], dtype=float)
    x, y = np.concatenate([3.0 * square, square]).T
    result = polar_volume(x + EAST, y + NORTH, np.repeat([HIGH, HIGH + 2.0], 4), 2)
    assert [one.area_m2 for one in result.slices] == pytest.approx([9.0, 1.0])
    assert [one.z_m for one in result.slices] == pytest.approx([HIGH + 0.5, HIGH + 1.5])
    assert [one.points for one in result.slices] == [4, 4]
    assert result.volume == pytest.approx(10.0)
    assert result.slab_height == 1.0
    assert result.warnings == ()


@pytest.mark.parametrize("corners", [3, 4, 5, 6, 17, 360])
@pytest.mark.parametrize("slabs", [1, 2, 7])
def test_regular_prism_is_exact_where_the_survey_is(corners, slabs):
    x, y, z = prism(corners, levels=8)
    result = polar_volume(x + EAST, y + NORTH, z + HIGH, slabs)
    area = 0.5 * corners * 9.0 * np.sin(2.0 * np.pi / corners)
    assert result.volume == pytest.approx(2.0 * area, rel=1e-8)
    assert sum(one.volume_m3 for one in result.slices) == pytest.approx(result.volume)


def test_order_of_the_points_does_not_matter():
    x, y, z = sphere_surface(3_000, 7)
    shuffled = np.random.default_rng(8).permutation(3_000)
    assert polar_volume(x[shuffled], y[shuffled], z[shuffled], 20) == polar_volume(x, y, z, 20)


def test_empty_and_thin_slabs_count_nothing_and_say_so():
    x, y, z = prism(4, levels=2)
    result = polar_volume(x, y, z, 4)
    assert [one.area_m2 for one in result.slices] == pytest.approx([18.0, 0.0, 0.0, 18.0])
    assert "4 slices but only 2 distinct elevations" in result.warnings[0]
    assert "2 of 4 slices hold fewer than 3 points" in result.warnings[1]
    assert not any("\n" in line for line in result.warnings)


def test_a_gap_alone_is_no_reason_to_speak_of_distinct_elevations():
    x, y, z = prism(6, levels=8)
    kept = (z < 0.5) | (z > 1.9)
    (warning,) = polar_volume(x[kept], y[kept], z[kept], 3).warnings
    assert "1 of 3 slices hold fewer than 3 points" in warning


@pytest.mark.parametrize(
    ("x", "z", "slabs", "words"),
    [
        ([0, 1, 2], [0, 1, 2], 2, "3 points"),
        ([], [], 2, "0 points"),
        ([0, 1, 2, 3], [5, 5, 5, 5], 2, "all points lie at elevation 5"),
        ([0, 1, 2, 3], [0, 1, 2, 3], 0, "0 slices"),
        ([0, 1, np.nan, 3], [0, 1, 2, 3], 2, "NaN"),
        ([0, 1, 2, 3], [0, 1, np.inf, 3], 2, "NaN"),
        ([0, 1, 2, 3], [0, 1, 2], 2, "as many of each"),
    ],
)
def test_unusable_points_are_refused(x, z, slabs, words):
    x, z = np.array(x, dtype=float), np.array(z, dtype=float)
    with pytest.raises(InputError, match=words):
        polar_volume(x, x[::-1].copy(), z, slabs)


LATTICE = st.lists(
    st.tuples(st.integers(-9, 9), st.integers(-9, 9), st.integers(0, 9)), min_size=4, max_size=60
).filter(lambda points: len({point[2] for point in points}) > 1)
SLABS = st.integers(2, 12)


@given(points=LATTICE, slabs=SLABS, center_caps=st.booleans())
def test_whole_metres_of_translation_change_nothing(points, slabs, center_caps):
    x, y, z = np.array(points, dtype=float).T
    here = polar_volume(x, y, z, slabs, center_caps=center_caps)
    there = polar_volume(x + 576_710.0, y + 5_188_139.0, z, slabs, center_caps=center_caps)
    assert there == here
    assert here.volume >= 0.0


@given(points=LATTICE, slabs=SLABS, power=st.integers(-8, 8))
def test_scaling_by_s_multiplies_the_volume_by_its_cube(points, slabs, power):
    x, y, z = np.array(points, dtype=float).T
    scale = 2.0**power
    scaled = polar_volume(scale * x, scale * y, scale * z, slabs).volume
    assert scaled == pytest.approx(scale**3 * polar_volume(x, y, z, slabs).volume, rel=1e-12)


@given(seed=st.integers(0, 2**32 - 1), scale=st.floats(0.01, 100.0), slabs=SLABS)
def test_any_scale_of_a_body_without_ties(seed, scale, slabs):
    points = sphere_surface(400, seed)
    scaled = polar_volume(*(scale * points), slabs).volume
    assert scaled == pytest.approx(scale**3 * polar_volume(*points, slabs).volume, rel=1e-9)


@given(angle=st.floats(-np.pi, np.pi), corners=st.integers(5, 40), slabs=st.integers(1, 7))
def test_rotation_about_z_of_convex_outlines(angle, corners, slabs):
    """The middle moves with the bounding box, but a convex outline looks the same from anywhere."""
    x, y, z = prism(corners, levels=8)
    x = 1.7 * x
    turned = (
        np.cos(angle) * x - np.sin(angle) * y + EAST,
        np.sin(angle) * x + np.cos(angle) * y + NORTH,
    )
    assert polar_volume(*turned, z, slabs).volume == pytest.approx(
        polar_volume(x, y, z, slabs).volume, rel=1e-7
    )


@given(seed=st.integers(0, 2**32 - 1), slabs=SLABS)
def test_quarter_turns_of_any_cloud(seed, slabs):
    """Only quarter turns take a bounding box, and so the paper's middle, with them."""
    x, y, z = np.random.default_rng(seed).normal(size=(3, 200))
    here = polar_volume(x, y, z, slabs).volume
    assert polar_volume(-y, x, z, slabs).volume == pytest.approx(here, rel=1e-9)
