"""Water stands as high as the lowest way out, and nowhere else."""

import heapq
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scans import OFFSET, scan
from scipy.spatial.transform import Rotation
from solids import BODIES, cup

from quantify_client.volcalc.body.hollows import water_levels
from quantify_client.volcalc.body.sections import surface_of
from quantify_client.volcalc.body.spaces import find_pockets, find_spaces
from quantify_client.volcalc.body.tetrahedra import Tetrahedra, tetrahedralize

CUP = cup(inner=0.3, floor=0.2)
DEPTH = 0.8


@cache
def divided(body, count, tilt=0.0):
    """Tetrahedra, which are outside, and the spacing; z is at UTM-sized elevations."""
    turn = Rotation.from_euler("x", tilt, degrees=True).as_matrix()
    points = (scan(body, count, 3) - OFFSET) @ turn.T + [0.0, 0.0, OFFSET[2]]
    space = tetrahedralize(points)
    spacing = float(np.median(space.spacing))
    spaces = find_spaces(space, find_pockets(space, spacing))
    assert spaces.depth.max() == 1
    return space, spaces.depth[spaces.number] == 0, spacing


def water_in(body, count, tilt=0.0, least_depth=None):
    """Volume of water, and its level where there is some; nothing but the outside holds it."""
    space, outside, spacing = divided(body, count, tilt)
    if least_depth is None:
        least_depth = 4.0 * spacing
    level = water_levels(space, outside, least_depth, 1.5 * spacing)
    assert np.all(level[~outside] == -np.inf)
    assert level[-1] == -np.inf
    wet = level > -np.inf
    volume = surface_of(space, level).volume() if wet.any() else 0.0
    return volume, level[wet] - OFFSET[2]


def test_a_cup_holds_water_up_to_its_rim():
    volume, level = water_in(CUP, 5000)
    assert volume == pytest.approx(np.pi * 0.3**2 * DEPTH, rel=0.03)
    assert level.min() == pytest.approx(1.0, abs=0.01)
    assert np.ptp(level) == 0.0


@pytest.mark.parametrize("tilt", [10.0, 20.0])
def test_a_tilted_cup_holds_water_up_to_the_lowest_point_of_its_rim(tilt):
    volume, level = water_in(CUP, 5000, tilt)
    angle = np.radians(tilt)
    assert level.min() == pytest.approx(np.cos(angle) - 0.3 * np.sin(angle), abs=0.03)
    # The level cuts the axis a radius' rise below the rim: a cylinder cut askew, right as long as
    # the level does not reach the floor.
    assert volume == pytest.approx(np.pi * 0.3**2 * (DEPTH - 0.3 * np.tan(angle)), rel=0.06)


def test_a_cup_upside_down_holds_no_water():
    assert water_in(CUP, 5000, 180.0)[0] == 0.0


@pytest.mark.parametrize("name", ["torus, lying", "torus, standing", "four legs", "sphere", "cube"])
def test_what_opens_below_holds_no_water(name):
    assert water_in(BODIES[name](), 2500)[0] == 0.0


@pytest.mark.parametrize(("least_depth", "water"), [(0.7, True), (0.9, False)])
def test_hollows_shallower_than_asked_for_are_dry(least_depth, water):
    assert (water_in(CUP, 5000, least_depth=least_depth)[0] > 0.0) == water


def basin(*passages):
    """One tetrahedron from 0 to 2 m high, open to around by passages: (height, width) each."""
    heights, widths = np.transpose(passages)
    faces = np.arange(4, 4 + 3 * len(heights)).reshape(-1, 3)
    z = np.concatenate([[0, 2, 2, 2], np.repeat(heights, 3)])
    return Tetrahedra(
        points=np.column_stack([np.zeros((len(z), 2)), z + OFFSET[2]]),
        moved=np.zeros((len(z), 3)),
        spacing=np.ones(len(z)),
        corners=np.arange(4)[None],
        volume=np.array([1.0, 0.0]),
        first=np.zeros(len(faces), dtype=np.int64),
        second=np.ones(len(faces), dtype=np.int64),
        faces=faces,
        area=np.ones(len(faces)),
        width=widths,
    )


@pytest.mark.parametrize(
    ("passages", "expected"),
    [
        ([(1.0, 0.5)], 1.0),
        ([(1.0, 0.5), (0.9, 0.5)], 0.9),
        # The narrow one may be a notch that noise cut: half of it counts.
        ([(1.0, 0.5), (0.8, 0.1)], 0.9),
        ([(1.0, 0.5), (0.8, 0.2)], 0.9),
        ([(1.0, 0.5), (0.8, 0.21)], 0.8),
        # A narrow one above is none of the water's business.
        ([(1.0, 0.5), (1.2, 0.1)], 1.0),
        # No wide one at all: nothing to compare with.
        ([(0.8, 0.1), (0.7, 0.1)], 0.7),
        ([(0.05, 0.5)], -np.inf),
        ([(0.0, 0.5)], -np.inf),
    ],
)
def test_a_passage_as_narrow_as_a_notch_counts_half(passages, expected):
    level = water_levels(basin(*passages), np.ones(2, dtype=bool), least_depth=0.1, notch=0.2)
    assert (level - OFFSET[2]).tolist() == pytest.approx([expected, -np.inf])


def flooded_by_queue(first, second, height, around):
    """Level of each place: the lowest first, as in Wang and Liu's paper."""
    ways = [[] for _ in range(around + 1)]
    for one, other, pass_height in zip(first, second, height):
        ways[one].append((pass_height, other))
        ways[other].append((pass_height, one))
    level = np.full(around + 1, np.inf)
    queue = [(-np.inf, around)]
    while queue:
        here, place = heapq.heappop(queue)
        if here < level[place]:
            level[place] = here
            for pass_height, other in ways[place]:
                heapq.heappush(queue, (max(here, pass_height), other))
    level[around] = -np.inf
    return level


@given(seed=st.integers(0, 1000), share=st.floats(0.5, 1.0))
@settings(max_examples=20)
def test_levels_are_those_of_a_priority_flood(seed, share):
    rng = np.random.default_rng(seed)
    space = tetrahedralize(rng.normal(loc=(0, 0, 100.0), size=(80, 3)))
    outside = rng.random(space.around + 1) < share
    outside[-1] = True
    between = outside[space.first] & outside[space.second]
    expected = flooded_by_queue(
        space.first[between],
        space.second[between],
        space.points[space.faces[between], 2].min(axis=1),
        space.around,
    )
    found = water_levels(space, outside, 0.0, 0.0)
    lowest = np.append(space.points[space.corners, 2].min(axis=1), np.inf)
    # Where no way leads out, the level is none that a height could tell.
    known = np.isfinite(expected)
    known[-1] = True
    wet = outside & (expected > lowest)
    np.testing.assert_array_equal(found[known], np.where(wet, expected, -np.inf)[known])
