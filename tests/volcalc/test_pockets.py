"""A pocket is wide inside and narrow at its passages; voids between points are none."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scans import OFFSET, Flaws, scan
from solids import ball_part, sphere, two_spheres

from quantify_client.volcalc.body.spaces import find_pockets
from quantify_client.volcalc.body.tetrahedra import Tetrahedra, tetrahedralize


def landscape(count, passages):
    """`count` tetrahedra with nothing but passages: (one, other, width) each; `count` is around."""
    first, second, width = np.array(passages, dtype=float).T
    nothing = np.empty((0, 3))
    return Tetrahedra(
        points=nothing,
        moved=nothing,
        spacing=np.empty(0),
        corners=np.zeros((count, 4), dtype=np.int64),
        volume=np.ones(count + 1),
        first=first.astype(np.int64),
        second=second.astype(np.int64),
        faces=np.zeros((len(width), 3), dtype=np.int64),
        area=np.ones(len(width)),
        width=width,
    )


def groups(pocket):
    """Sets of those that share a pocket."""
    return {frozenset(np.flatnonzero(pocket == number).tolist()) for number in np.unique(pocket)}


@cache
def pockets_of(body, count, **flaws):
    """Volume of each pocket beside outside, largest first."""
    points = scan(body(), count, 5, Flaws(**flaws)) - OFFSET
    space = tetrahedralize(points)
    pocket = find_pockets(space, float(np.median(space.spacing)))
    volume = np.bincount(pocket, space.volume)
    return sorted(np.delete(volume, pocket[-1]).tolist(), reverse=True)


# --- by hand: two chambers in line, the way out behind the first


def chambers(passage, out=1.0):
    """Chambers of width 10 joined by a passage; 4 is what is around."""
    return landscape(4, [(0, 1, 10), (2, 3, 10), (1, 2, passage), (0, 4, out)])


@pytest.mark.parametrize(
    ("passage", "out", "expected"),
    [
        (2, 1, [{0, 1}, {2, 3}, {4}]),
        (6.6, 1, [{0, 1}, {2, 3}, {4}]),  # 10 / 6.6 > 1.5
        (6.7, 1, [{0, 1, 2, 3}, {4}]),  # 10 / 6.7 < 1.5
        (6.7, 6.7, [{0, 1, 2, 3, 4}]),
        (2, 6.7, [{0, 1, 4}, {2, 3}]),
    ],
)
def test_a_pocket_is_one_and_a_half_times_wider_than_its_passage(passage, out, expected):
    found = find_pockets(chambers(passage, out), spacing=2.0)
    assert groups(found) == set(map(frozenset, expected))


@pytest.mark.parametrize(("passage", "pockets"), [(9.4, 3), (9.6, 2)])
def test_a_chamber_of_ten_spacings_needs_a_twentieth_only(passage, pockets):
    assert len(groups(find_pockets(chambers(passage), spacing=0.9))) == pockets


def test_each_tetrahedron_goes_where_its_widest_path_leads():
    # 1 lies between pocket 0 and what is around: its wider passage decides.
    room = [(0, 3, 9), (1, 2, 2)]
    to_pocket = landscape(4, [*room, (0, 2, 3), (1, 4, 2.5)])
    assert groups(find_pockets(to_pocket, 2.0)) == {frozenset({0, 3, 2}), frozenset({1, 4})}
    outwards = landscape(4, [*room, (0, 2, 1.5), (1, 4, 2.5)])
    assert groups(find_pockets(outwards, 2.0)) == {frozenset({0, 3}), frozenset({1, 2, 4})}


def one_by_one(space, spacing):
    """Number of each pocket: the passages opened one after the other, the widest first."""
    count = space.around + 1
    birth = np.zeros(count)
    for one, other, width in zip(space.first, space.second, space.width):
        birth[[one, other]] = np.maximum(birth[[one, other]], width)
    birth[-1] = np.inf
    tree, lasts = np.arange(count), np.arange(count) == count - 1
    for face in np.argsort(-space.width, kind="stable"):
        old, young = tree[space.first[face]], tree[space.second[face]]
        if old == young or (lasts[old] and lasts[young]):
            continue
        if lasts[young] or (not lasts[old] and (birth[old], old) < (birth[young], young)):
            old, young = young, old
        least = 1.05 if birth[young] > 10 * spacing else 1.5
        if birth[young] >= least * space.width[face]:
            lasts[young] = True
        else:
            tree[tree == young] = old
    return tree


@given(
    count=st.integers(1, 40),
    more=st.integers(0, 60),
    spacing=st.floats(0.1, 10.0),
    seed=st.integers(0, 10_000),
)
@settings(max_examples=60)
def test_trees_grown_all_at_once_are_those_grown_one_by_one(count, more, spacing, seed):
    rng = np.random.default_rng(seed)
    width = rng.lognormal(0.0, 1.0, count + more)
    ends = [(i, rng.integers(i + 1, count + 1)) for i in range(count)]
    ends += [tuple(np.sort(rng.choice(count + 1, 2, replace=False))) for _ in range(more)]
    space = landscape(count, [(*pair, w) for pair, w in zip(ends, width)])
    found = find_pockets(space, spacing)
    assert found.min() == 0
    assert len(np.unique(found)) == found.max() + 1
    assert groups(found) == groups(one_by_one(space, spacing))


@given(seed=st.integers(0, 100), power=st.integers(-10, 10))
@settings(max_examples=20)
def test_pockets_do_not_depend_on_scale(seed, power):
    points = np.random.default_rng(seed).normal(size=(60, 3))
    points /= np.linalg.norm(points, axis=1)[:, None]
    one, other = (tetrahedralize(points * scale) for scale in (1.0, 2.0**power))
    np.testing.assert_array_equal(find_pockets(one, 0.3), find_pockets(other, 0.3 * 2.0**power))


# --- bodies


def test_a_ball_is_one_pocket_beside_outside():
    (volume,) = pockets_of(sphere, 3000)
    assert volume == pytest.approx(np.pi / 6, rel=0.01)


def test_two_balls_are_two_pockets():
    assert pockets_of(two_spheres, 3000) == pytest.approx(2 * [4 / 3 * np.pi * 0.3**3], rel=0.015)


def test_a_ball_with_a_hole_of_a_fifth_keeps_its_pocket():
    assert len(pockets_of(sphere, 3000)) == 1
    (volume,) = pockets_of(sphere, 3000, hole=0.2)
    assert volume == pytest.approx(np.pi / 6, rel=0.02)


@pytest.mark.parametrize("seed", range(3))
def test_points_at_random_in_a_band_have_no_pockets(seed):
    rng = np.random.default_rng(seed)
    flat = rng.uniform(0, 1, (3000, 3)) * [1.0, 1.0, 0.1]
    space = tetrahedralize(flat)
    assert find_pockets(space, float(np.median(space.spacing))).max() == 0


@pytest.mark.parametrize("noise", [0.005, 0.01, 0.02])
def test_the_band_that_noise_makes_of_a_surface_adds_no_pockets(noise):
    assert len(pockets_of(sphere, 5000, noise=noise)) == 1


def test_a_full_ball_of_points_has_no_pocket():
    rng = np.random.default_rng(2)
    shell = ball_part(0.5, (0, 0, 0)).surface(3000, rng)
    space = tetrahedralize(shell * rng.random((3000, 1)) ** (1 / 3))
    assert find_pockets(space, float(np.median(space.spacing))).max() == 0
