"""Bodies of which a part was not seen: each step against what is known, and the volumes."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scans import OFFSET, Flaws, scan, volume_of
from scipy.spatial import Delaunay
from scipy.spatial.transform import Rotation
from solids import box_part, cube, cup, sphere, torus, union, unit_vectors

from quantify_client.errors import InputError
from quantify_client.volcalc.body import complete
from quantify_client.volcalc.body.cut import face_costs, minimum_cut
from quantify_client.volcalc.body.enclose import Enclosed, enclose
from quantify_client.volcalc.body.floor import stand
from quantify_client.volcalc.body.foot import unseen_share
from quantify_client.volcalc.body.going_on import going_on, grid_between
from quantify_client.volcalc.body.partly_seen import is_partly_seen
from quantify_client.volcalc.body.patches import Patches
from quantify_client.volcalc.body.tetrahedra import Tetrahedra, tetrahedralize
from quantify_client.volcalc.body.views import Views, places_all_round

NOBODY = np.empty((0, 3))


def cost_of(space: Tetrahedra, matter, costs, as_matter, as_outside) -> float:
    """Return what a labelling costs, by its definition."""
    ends = matter[space.first] != matter[space.second]
    own = np.where(matter[:-1], as_matter, as_outside)
    return float(costs[ends].sum() + own.sum())


@pytest.mark.parametrize("seed", range(12))
def test_no_labelling_costs_less_than_the_minimum_cut(seed: int) -> None:
    rng = np.random.default_rng(seed)
    space = tetrahedralize(rng.random((8, 3)))
    costs = face_costs(space, np.zeros(8, dtype=bool))
    # Small beside the faces' costs, so that the flow has to decide.
    as_matter, as_outside = rng.exponential(0.015, (2, space.around))
    found = minimum_cut(space, costs, as_matter, as_outside, 0.01)
    assert not found[-1]  # around the hull is outside
    every = itertools.product([False, True], repeat=space.around)
    least = min(
        cost_of(space, np.array([*one, False]), costs, as_matter, as_outside) for one in every
    )
    assert cost_of(space, found, costs, as_matter, as_outside) == pytest.approx(least, abs=1e-5)


def ball(count: int, lowest: float = -1.0, seed: int = 0) -> np.ndarray:
    """Points of a ball with a radius of 1 above a height."""
    points = unit_vectors(count, np.random.default_rng(seed))
    return points[points[:, 2] > lowest]


def test_a_camera_sees_the_near_side_of_a_ball_and_the_space_before_it() -> None:
    points = ball(4000)
    views = Views.of(points, 0.06, np.array([[0.0, -8.0, 0.0]]))
    seen = views.seen > 0
    # A sphere is seen up to the circle of tangents, y = -1/8.
    assert seen[points[:, 1] < -0.3].mean() > 0.97
    assert not seen[points[:, 1] > 0.1].any()
    towards = (views.normals * points).sum(axis=1)
    assert (towards[points[:, 1] < -0.5] > 0.9).mean() > 0.99
    before_it, beside_it, beyond_the_image = [0, -1.5, 0], [0.95, 0, 0.95], [0, 0, 3]
    asked = np.array(
        [before_it, [0.5, -1.4, 0.3], [0, 0, 0], [0, 2, 0], beside_it, beyond_the_image]
    )
    before, beyond = views.empty(asked.astype(float), np.array([True]), 9)
    assert before.tolist() == [1, 1, 0, 0, 0, 0]
    assert beyond.tolist() == [0, 0, 0, 0, 1, 1]


def test_a_camera_that_looks_in_through_the_opening_is_left_out() -> None:
    points = ball(4000, lowest=-0.2)
    places, _ = places_all_round(points, below=True)
    views = Views.of(points, 0.06, places)
    assert not views.fair[places[:, 2] < -2.0].any()
    assert ((views.normals * points).sum(axis=1) > 0.0).mean() > 0.99


@pytest.mark.parametrize(("tilt", "seen"), [(0.0, True), (8.0, False)])
def test_a_foot_was_seen_where_points_are_all_along_it(tilt: float, seen: bool) -> None:
    """A cube on ground, and one that stands on an edge, with a wedge below that nobody saw."""
    points = cube().surface(6_000, np.random.default_rng(3))
    turn = Rotation.from_euler("y", -tilt, degrees=True)
    points = turn.apply(points[points[:, 2] > 1e-9]) - np.array([0.5, 0.5, 0.0])
    cloud = on_ground(points[points[:, 2] > 1e-9], 0.55) - OFFSET
    standing = stand(cloud, np.ones(len(cloud), dtype=np.int64), "auto")
    body = enclose(standing.points, lid=standing.lid, hollow=False, max_gap=None)
    assert isinstance(body, Enclosed)
    share = unseen_share(standing, body)
    assert share < 0.08 if seen else share > 0.2
    assert is_partly_seen(standing, body, False) != seen


@pytest.mark.parametrize("tilt", [2.0, 4.0])
def test_a_wedge_below_a_foot_is_in_the_interval(tilt: float) -> None:
    """A cube that stands on an edge, its underside nowhere two spacings from the ground."""
    points = cube().surface(6_000, np.random.default_rng(4))
    turn = Rotation.from_euler("y", -tilt, degrees=True)
    points = turn.apply(points[points[:, 2] > 1e-9]) - np.array([0.5, 0.5, 0.0])
    result = volume_of(on_ground(points[points[:, 2] > 1e-9], 0.55))
    assert abs(result.volume_m3 - 1.0) < 3.3 * result.std_m3  # 13 and 36 without


def test_what_leaves_most_points_outside_is_not_their_body(monkeypatch) -> None:
    """As of lines ten times as far apart as their points: a cylinder was 0.01 % of itself."""
    points = ball(2_000, lowest=-0.4)
    standing = stand(points, np.ones(len(points), dtype=np.int64), "auto")
    assert complete.complete(standing, None, True) is not None
    outside = np.arange(round(0.6 * len(points)))
    monkeypatch.setattr(complete, "_outside", lambda *_: outside)
    assert complete.complete(standing, None, True) is None


def test_a_sphere_and_a_plane_go_on_as_they_are() -> None:
    points = ball(6000, lowest=-0.6)
    beyond = going_on(points, points, 0.05, NOBODY, lambda some: some[:, 2] < -2.0, 1.0)
    below = beyond[beyond[:, 2] < -0.6]
    assert len(below) > 100
    away = np.abs(np.linalg.norm(below, axis=1) - 1.0)  # of a flat lid, up to 0.4
    assert np.quantile(away, 0.75) < 0.06
    flat = np.random.default_rng(1).random((3000, 3)) * [1.0, 1.0, 0.0]
    up = np.tile([0.0, 0.0, 1.0], (3000, 1))
    edge = going_on(flat, up, 0.02, NOBODY, lambda some: np.abs(some[:, 0] - 0.5) > 0.7, 1.0)
    assert len(edge) > 100
    assert np.abs(edge[:, 2]).max() < 1e-6
    assert not (np.abs(edge[:, 0] - 0.5) > 0.7).any()


def test_it_ends_at_the_floor() -> None:
    points = ball(6000, lowest=-0.4) + np.array([0.0, 0.0, 1.0])
    floor = np.column_stack(
        [np.random.default_rng(2).uniform(-1, 1, (2000, 2)), np.full(2000, 0.3)]
    )
    beyond = going_on(points, points - [0, 0, 1.0], 0.05, floor, lambda some: some[:, 2] > 9.0, 1.0)
    assert len(beyond) > 50
    assert beyond[:, 2].min() > 0.3


@pytest.mark.one_python
@pytest.mark.parametrize("body", [sphere, torus, cube, cup], ids=lambda body: body.__name__)
def test_a_hole_of_a_fifth_is_inside_the_interval(body) -> None:
    made = body()
    result = volume_of(scan(made, 5_000, 3, Flaws(hole=0.2)))
    assert abs(result.volume_m3 - made.volume) < max(2.6 * result.std_m3, 0.004 * made.volume)
    assert result.std_m3 < 0.06 * made.volume


@pytest.mark.one_python
def test_a_ball_without_its_lowest_part_and_no_ground_is_bridged_as_it_curves() -> None:
    made = sphere()
    result = volume_of(scan(made, 8_000, 5, Flaws(missing=0.15)))
    assert result.volume_m3 == pytest.approx(made.volume, rel=0.03)  # closed flat: -6.1 %
    assert abs(result.volume_m3 - made.volume) < 1.96 * result.std_m3
    notice = next(one for one in result.warnings if one.code == "surface-completed")
    low, high = notice.values["low_m3"], notice.values["high_m3"]
    assert low <= result.volume_m3 <= high * 1.02
    assert result.checks == ()


@pytest.mark.one_python
@pytest.mark.parametrize("cameras", [0, 12])
def test_coverage_is_what_docs_say_it_is(cameras: int) -> None:
    around = 2 * np.pi * np.arange(12) / 12
    ring = np.column_stack([4 * np.cos(around), 4 * np.sin(around), np.full(12, 2.0)]) + OFFSET
    points = scan(sphere(), 2_500, 5, Flaws(missing=0.15))
    result = volume_of(points, cameras=ring[:cameras] if cameras else None)
    told = next(one.values for one in result.warnings if one.code == "surface-completed")
    low, high = told["low_m3"], told["high_m3"]
    coverage = next(one.std_m3 for one in result.budget if one.source == "coverage")
    share, likely = told["share"], 0.62 * low + 0.38 * high
    of_volume = np.hypot(0.03 * share, 2.5 * share**4) * likely
    assert coverage == pytest.approx(np.hypot((high - low) / np.sqrt(12.0), of_volume), rel=1e-9)


@pytest.mark.one_python
def test_what_may_be_under_a_slab_that_no_camera_saw_is_bounded() -> None:
    """A slab on a block at one side: below the rest of it there may be anything."""
    parts = [
        box_part([-0.5, -0.5, 0.0], [-0.2, 0.5, 0.3]),
        box_part([-0.5, -0.5, 0.3], [0.5, 0.5, 0.6]),
    ]
    volume = 0.3 * 1.0 * 0.3 + 1.0 * 1.0 * 0.3
    rng = np.random.default_rng(3)
    points = union("slab", parts, volume).surface(8_000, rng)
    underside = (np.abs(points[:, 2] - 0.3) < 1e-9) & (points[:, 0] > -0.2)
    behind = (np.abs(points[:, 0] + 0.2) < 1e-9) & (points[:, 2] < 0.3)  # of the block, in its dark
    points = points[~underside & ~behind & (points[:, 2] > 1e-9)]
    ground = np.column_stack([rng.uniform(-1.2, 1.2, (8_000, 2)), np.zeros(8_000)])
    ground = ground[(np.abs(ground[:, :2]) > 0.5).any(axis=1)]
    result = volume_of(np.vstack([points, ground]) + OFFSET)
    told = next(one.values for one in result.warnings if one.code == "surface-completed")
    assert 0.8 * volume < told["low_m3"] < 1.1 * volume
    assert told["high_m3"] > volume + 0.4 * (0.7 * 1.0 * 0.3)
    assert abs(result.volume_m3 - volume) < 2.6 * result.std_m3
    assert told["low_m3"] < result.volume_m3 < told["high_m3"]


def on_ground(points: np.ndarray, radius: float, seed: int = 4) -> np.ndarray:
    """The points and ground around them, none nearer to the middle than a radius."""
    ground = np.random.default_rng(seed).uniform(-2.5, 2.5, (8_000, 2))
    ground = ground[np.abs(ground).max(axis=1) > radius]
    return np.vstack([points, np.column_stack([ground, np.zeros(len(ground))])]) + OFFSET


@pytest.mark.one_python
def test_a_wall_that_no_camera_saw_leaves_no_hole_in_a_block() -> None:
    """Places that look in through the opening see nothing, and nothing is empty for that."""
    points = cube().surface(5_000, np.random.default_rng(1)) - np.array([0.5, 0.5, 0.0])
    points = points[(points[:, 0] < 0.499) & (points[:, 2] > 1e-9)]
    result = volume_of(on_ground(points, 0.5))
    assert result.volume_m3 > 0.6
    told = next(one.values for one in result.warnings if one.code == "surface-completed")
    assert told["high_m3"] > 0.95  # the ground shows below the other walls, from within
    assert abs(result.volume_m3 - 1.0) < 2.6 * result.std_m3


@pytest.mark.one_python
@pytest.mark.parametrize(("share", "off"), [(0.05, 0.02), (0.1, 0.04)])
def test_a_side_of_a_ball_that_no_camera_saw_goes_on_as_it_curves(share: float, off: float) -> None:
    """Of the places around only those that look in see its underside: 16 % were lost."""
    points = ball(6_000)
    points = points[points[:, 0] < 1.0 - 2.0 * share] + np.array([0.0, 0.0, 1.0])
    result = volume_of(on_ground(points, 0.8))
    assert result.volume_m3 == pytest.approx(4.0 / 3.0 * np.pi, rel=off)
    assert abs(result.volume_m3 - 4.0 / 3.0 * np.pi) < 2.6 * result.std_m3
    # Places that look in count in the smaller completion only.
    told = next(one.values for one in result.warnings if one.code == "surface-completed")
    assert told["high_m3"] > 0.993 * 4.0 / 3.0 * np.pi


def test_normals_of_a_patch_point_to_the_side_that_most_of_it_was_seen_from() -> None:
    points = ball(3_000)
    patches = Patches.of(points)
    assert len(np.unique(patches.number)) == 1
    out = (patches.normals * points).sum(axis=1)
    # The lowest twentieth was seen from within.
    votes = np.where(points[:, 2] > -0.9, 5.0, -3.0) * np.sign(out)
    turned = patches.to_most(votes)
    assert ((turned.normals * points).sum(axis=1) > 0.9).all()
    # Half against half: the points go by their own.
    divided = patches.to_most(np.where(points[:, 2] > 0.0, 5.0, -5.0) * np.sign(out))
    assert ((divided.normals * points).sum(axis=1) * points[:, 2] >= 0.0).all()


def test_a_line_of_sight_to_ground_that_is_missing_tells_nothing() -> None:
    """Of a ring of ground, the middle of which nobody saw; beyond its outer edge it does tell."""
    rng = np.random.default_rng(6)
    flat = rng.uniform(-3.0, 3.0, (6_000, 2))
    flat = flat[np.hypot(*flat.T) > 1.0]
    points = np.vstack([np.column_stack([flat, np.zeros(len(flat))]), [[0.0, 0.0, 2.0]]])[::-1]
    camera = np.array([[0.0, -8.0, 8.0]])
    over_the_hole, beyond_the_edge = np.array([[0.0, -1.0, 1.0], [0.0, 4.0, 1.0]])
    asked = np.array([over_the_hole, beyond_the_edge])
    for ground, expected in ((0, [1, 1]), (len(flat), [0, 1])):
        views = Views.of(points, 0.08, camera, ground=ground)
        assert views.empty(asked, np.array([True]), 9)[1].tolist() == expected


def test_the_tetrahedron_that_holds_a_point_is_found() -> None:
    """As scipy finds it by other means; points outside of the hull are around it."""
    rng = np.random.default_rng(2)
    points = unit_vectors(1500, rng) * [1.0, 2.0, 0.5]
    space = tetrahedralize(points)
    asked = points + rng.normal(scale=0.1, size=points.shape)
    found = space.holding(asked, np.arange(len(points)))
    expected = Delaunay(space.points).find_simplex(asked)
    assert 0.3 < (expected < 0).mean() < 0.7
    np.testing.assert_array_equal(found == space.around, expected < 0)
    middles = space.middles()
    np.testing.assert_array_equal(
        space.holding(middles, space.corners[:, 0]), np.arange(space.around)
    )


@pytest.mark.one_python
def test_known_cameras_do_not_look_through_where_points_are_sparse() -> None:
    """Ten times denser at one end: with pixels as wide as the median spacing -12 to -13 %."""
    points = scan(sphere(), 3_000, 3, Flaws(ground=2.5, missing=0.2, gradient=10))
    around = 2 * np.pi * np.arange(24) / 12 + 0.1
    away, up = np.repeat([4.0, 3.0], 12), np.repeat([0.5, 2.5], 12)
    cameras = np.column_stack([away * np.cos(around), away * np.sin(around), up]) + OFFSET
    result = volume_of(points, cameras=cameras)
    assert result.volume_m3 == pytest.approx(sphere().volume, rel=0.03)
    assert abs(result.volume_m3 - sphere().volume) < 1.96 * result.std_m3


@pytest.mark.one_python
def test_cameras_below_the_floor_are_left_out() -> None:
    points = scan(sphere(), 2_500, 3, Flaws(ground=2.5, missing=0.15))
    cameras = np.array([[4.0, 0.0, 1.0], [0.0, 4.0, 1.0], [-4.0, 0.0, -1.0]]) + OFFSET
    notices = {one.code: one for one in volume_of(points, cameras=cameras).warnings}
    assert notices["surface-completed"].values["cameras"] == 2
    assert str(notices["cameras-left-out"]).startswith("1 of 3 camera positions were left")


def test_hollow_and_max_gap_close_openings_as_they_say() -> None:
    points = scan(sphere(), 4_000, 3, Flaws(hole=0.3))
    codes = {one.code for one in volume_of(points, hollow=True).warnings}
    assert "surface-completed" not in codes
    with pytest.raises(InputError, match="--max-gap"):
        volume_of(points, max_gap=0.05)


def test_what_was_asked_for_is_named_where_nothing_is_enclosed() -> None:
    points = scan(sphere(), 2_000, 3, Flaws(missing=0.6))
    points = points[points[:, 0] < np.median(points[:, 0])]  # a quarter of a ball
    for asked, name in (({"max_gap": 2.0}, "--max-gap 2"), ({"hollow": True}, "--hollow")):
        with pytest.raises(InputError, match=f"enclose no space with {name}: without it what"):
            volume_of(points, floor="none", **asked)


@pytest.mark.one_python
def test_positions_of_cameras_count() -> None:
    """Cameras that look up from below see that nothing is there: the ball ends flat.

    Those at 45 degrees see no more of it than there is.
    """
    points = scan(sphere(), 8_000, 5, Flaws(missing=0.3))
    around = 2 * np.pi * np.arange(12) / 12
    ring = np.column_stack([4 * np.cos(around), 4 * np.sin(around)])
    above, level = (
        volume_of(points, cameras=np.column_stack([ring, np.full(12, z)]) + OFFSET)
        for z in (4.0, -0.2)
    )
    flat = sphere().volume * (1 - 0.3**2 * (3 - 2 * 0.3))  # without the cap, in closed form
    assert level.volume_m3 == pytest.approx(flat, rel=0.07)
    assert above.volume_m3 > 1.02 * level.volume_m3


@pytest.mark.one_python
def test_what_cameras_looked_down_on_stands_on_its_lowest_points() -> None:
    """A cube without its bottom: it ends there, known cameras or not."""
    points = cube().surface(8_000, np.random.default_rng(6))
    points = points[points[:, 2] > points[:, 2].min()]
    around = 2 * np.pi * np.arange(12) / 12
    middle = points.mean(axis=0)
    ring = np.column_stack([3 * np.cos(around), 3 * np.sin(around), np.full(12, 1.5)]) + middle
    for cameras in (None, ring + OFFSET):
        result = volume_of(points + OFFSET, cameras=cameras)
        assert "floor-at-lowest-points" in {warning.code for warning in result.warnings}
        assert abs(result.volume_m3 - 1.0) < 2.0 * result.std_m3 < 0.1


@pytest.mark.one_python
def test_narrow_parts_make_no_thin_walled_body_of_an_open_one() -> None:
    """A block with slots as narrow as gaps between points, of which nobody saw the bottom."""
    slots = np.linspace(0.04, 0.92, 11)
    walls = [0.0, *(slots + 0.04)], [*slots, 1.0]
    parts = [box_part((0, 0, 0), (1, 0.5, 0.15))]
    parts += [box_part((low, 0, 0.15), (high, 0.5, 0.4)) for low, high in zip(*walls)]
    truth = 0.5 * (0.15 + 0.25 * (1.0 - 11 * 0.04))
    points = union("slots", parts, truth).surface(12_000, np.random.default_rng(7))
    result = volume_of(points[points[:, 2] > 1e-9] + OFFSET)
    assert "surface-completed" in {warning.code for warning in result.warnings}
    assert abs(result.volume_m3 - truth) < 2.0 * result.std_m3 < 1.0 * truth


def test_a_grid_fills_what_nobody_saw() -> None:
    """Within the hull of a half ball on its floor, away from both, and not where it is empty."""
    points = ball(4_000)
    half = points[points[:, 2] > 0.0]
    x, y = (axis.ravel() for axis in np.meshgrid(*2 * [np.linspace(-1.0, 1.0, 41)]))
    floor = np.column_stack([x, y, np.zeros(len(x))])[x**2 + y**2 < 1.0]

    def is_empty(some: np.ndarray) -> np.ndarray:
        return np.asarray(some[:, 0] > 0.5)

    grid = grid_between(np.vstack([half, floor]), 0.06, is_empty)
    away = np.linalg.norm(grid, axis=1)
    assert away.max() < 1.0 - 0.7 * 0.12
    assert grid[:, 2].min() > 0.7 * 0.12
    assert grid[:, 0].max() <= 0.5
    room = 2 / 3 * np.pi * 0.9**3  # less what is empty, and the layer above the floor
    assert 0.55 * room < len(grid) * 0.12**3 < 0.9 * room
    far = np.vstack([half, half + np.full(3, 1e3)])  # no more of it than memory holds
    assert len(grid_between(far, 0.06, is_empty)) < 20_000
