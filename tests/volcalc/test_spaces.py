"""What lies how deep behind surfaces, and where these are open."""

from functools import cache

import numpy as np
import pytest
from scans import OFFSET, Flaws, scan
from solids import cup, hollow_ball, sphere, two_spheres

from quantify_client.volcalc.body.spaces import find_pockets, find_spaces
from quantify_client.volcalc.body.tetrahedra import tetrahedralize


@cache
def divided(points):
    """Points as bytes -> tetrahedra and pockets."""
    space = tetrahedralize(np.frombuffer(points).reshape(-1, 3))
    return space, find_pockets(space, float(np.median(space.spacing)))


def spaces_of(points, max_gap=None):
    """Tetrahedra, spaces and the volume of each space; checks what holds for all of them."""
    space, pocket = divided(np.ascontiguousarray(points).tobytes())
    spaces = find_spaces(space, pocket, max_gap)
    assert spaces.number[-1] == 0
    assert spaces.depth[0] == 0
    assert np.unique(spaces.number).tolist() == list(range(len(spaces.depth)))
    return space, spaces, np.bincount(spaces.number, space.volume)


def number_at(space, spaces, place):
    """Number of the space at a place: that of the tetrahedron whose middle is nearest."""
    middle = space.points[space.corners].mean(axis=1)
    return int(spaces.number[np.argmin(((middle - place) ** 2).sum(axis=1))])


def scanned(body, count, **flaws):
    return scan(body, count, 3, Flaws(**flaws)) - OFFSET


def holed_ball(width, count=5000):
    """A ball of diameter 1 with a round hole about a known direction; `width` is its diameter."""
    points = scanned(sphere(), count)
    way = np.array([2.0, -1.0, 2.0]) / 3.0
    return points[points @ way < np.sqrt(0.25 - width**2 / 4)], way


def test_a_ball_is_matter():
    _, spaces, volume = spaces_of(scanned(sphere(), 3000))
    assert spaces.depth.tolist() == [0, 1]
    assert volume[1] == pytest.approx(np.pi / 6, rel=0.01)
    assert not spaces.gaps
    assert not spaces.leaks


def test_a_void_lies_behind_the_surface_of_matter():
    space, spaces, volume = spaces_of(scanned(hollow_ball(), 5000))
    assert sorted(spaces.depth) == [0, 1, 2]
    matter, void = (number_at(space, spaces, (x, 0, 0)) for x in (0.4, 0.0))
    assert spaces.depth[[matter, void]].tolist() == [1, 2]
    body, hollow = 4 / 3 * np.pi * 0.5**3, 4 / 3 * np.pi * 0.3**3
    assert volume[void] == pytest.approx(hollow, rel=0.02)
    assert volume[matter] == pytest.approx(body - hollow, rel=0.02)


def test_a_ball_in_the_void_of_a_ball_is_matter_again():
    rng = np.random.default_rng(4)
    radii = np.repeat([0.6, 0.4, 0.2], [4000, 1800, 500])
    points = rng.normal(size=(len(radii), 3))
    points *= (radii / np.linalg.norm(points, axis=1))[:, None]
    space, spaces, _ = spaces_of(points)
    at = [number_at(space, spaces, (0, 0, z)) for z in (0.5, 0.3, 0.0)]
    assert spaces.depth[at].tolist() == [1, 2, 3]


def test_two_balls_are_matter_both():
    space, spaces, _ = spaces_of(scanned(two_spheres(), 4000))
    assert spaces.depth.tolist() == [0, 1, 1]
    one, other = (number_at(space, spaces, at) for at in ((0, 0, 0), (0.8, 0.1, 0.2)))
    assert one != other


@pytest.mark.parametrize("width", [0.15, 0.2, 0.3])
def test_a_hole_is_one_opening_in_its_place(width):
    points, way = holed_ball(width)
    _, spaces, volume = spaces_of(points)
    assert spaces.depth.tolist() == [0, 1]
    assert not spaces.leaks
    (gap,) = spaces.gaps
    # No points lie nearer than its edge, so the opening is wider by a gap between points at most.
    assert gap.width == pytest.approx(width, rel=0.15)
    middle = way * np.sqrt(0.25 - width**2 / 4)
    assert np.linalg.norm(np.array([gap.x, gap.y, gap.z]) - middle) < 0.2 * width
    # Closed flat: the ball without the cap behind the hole.
    height = 0.5 - np.sqrt(0.25 - width**2 / 4)
    cap = np.pi * height**2 * (1.5 - height) / 3
    assert volume[1] == pytest.approx(np.pi / 6 - cap, rel=0.01)


def test_two_holes_are_two_openings_the_wider_first():
    points, way = holed_ball(0.3)
    points = points[points @ way > -np.sqrt(0.25 - 0.2**2 / 4)]
    gaps = spaces_of(points)[1].gaps
    assert [gap.width for gap in gaps] == pytest.approx([0.3, 0.2], rel=0.15)
    sides = [np.dot((gap.x, gap.y, gap.z), way) for gap in gaps]
    assert sides == pytest.approx([0.48, -0.49], abs=0.03)


def test_what_lies_behind_an_opening_wider_than_allowed_is_outside():
    points, way = holed_ball(0.2)
    space, spaces, _ = spaces_of(points, max_gap=0.15)
    assert spaces.depth.tolist() == [0]
    assert number_at(space, spaces, (0, 0, 0)) == 0
    assert not spaces.gaps
    leak = spaces.leaks[0]
    assert leak.width == pytest.approx(0.2, rel=0.15)
    assert np.dot((leak.x, leak.y, leak.z), way) == pytest.approx(np.sqrt(0.24), abs=0.03)


def test_an_opening_narrower_than_allowed_is_closed():
    points, _ = holed_ball(0.2)
    free, limited = (spaces_of(points, max_gap)[1] for max_gap in (None, 0.25))
    assert limited.depth.tolist() == [0, 1]
    assert limited.gaps == free.gaps
    assert not limited.leaks


def test_a_leak_of_one_ball_leaves_the_other_closed():
    points, _ = holed_ball(0.3, 3000)
    points = np.vstack([points, scanned(sphere(), 3000) + np.array([2.0, 0.0, 0.0])])
    space, spaces, volume = spaces_of(points, max_gap=0.15)
    assert spaces.depth.tolist() == [0, 1]
    assert number_at(space, spaces, (2, 0, 0)) == 1
    assert volume[1] == pytest.approx(np.pi / 6, rel=0.01)
    assert spaces.leaks


def test_the_inside_of_a_cup_is_outside():
    space, spaces, volume = spaces_of(scanned(cup(inner=0.3, floor=0.2), 5000))
    assert spaces.depth.tolist() == [0, 1]
    assert number_at(space, spaces, (0, 0, 0.6)) == 0
    assert number_at(space, spaces, (0.4, 0, 0.6)) == 1
    assert volume[1] == pytest.approx(np.pi * (0.5**2 - 0.3**2 * 0.8), rel=0.02)


def test_half_a_shell_encloses_nothing():
    points = scanned(sphere(), 4000)
    _, spaces, _ = spaces_of(points[points[:, 2] < 0])
    assert spaces.depth.tolist() == [0]
    assert not spaces.gaps


def test_points_anywhere_enclose_nothing():
    points = np.random.default_rng(0).random((2000, 3))
    assert spaces_of(points)[1].depth.tolist() == [0]
