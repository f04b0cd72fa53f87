"""A body from its points to its result: volume, slices, budget, checks and words."""

from functools import cache, partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scans import OFFSET, Flaws, scan, volume_of
from solids import BODIES, ball_part, box_part, cup, hollow_ball, mixed, sphere

from quantify_client.errors import InputError
from quantify_client.types import Notice
from quantify_client.volcalc.body import find
from quantify_client.volcalc.body.measure import measure_body
from quantify_client.volcalc.body.voxels import Thinned
from quantify_client.volcalc.body_slices import BodyRecipe

# Bodies as a command measures them run on every Python in test_body_command.py.
pytestmark = pytest.mark.one_python

BALL = np.pi / 6
CUP = cup(inner=0.3, floor=0.2)


@cache
def scanned(name, count, **flaws):
    bodies = {**BODIES, "cup": lambda: CUP}
    return scan(bodies[name](), count, 3, Flaws(**flaws))


@cache
def ball(**options):
    return volume_of(scanned("sphere", 2000), **options)


@cache
def box_on_ground():
    """A box of 1 m3 that nobody saw from below, on ground at elevation 100."""
    rng = np.random.default_rng(0)
    box = box_part((0, 0, 0), (1, 1, 1)).surface(4000, rng)
    flat = np.column_stack([rng.uniform(-0.5, 1.5, (2700, 2)), np.zeros(2700)])
    beside = np.abs(flat[:, :2] - 0.5).max(axis=1) > 0.5
    return np.vstack([box[box[:, 2] > 0], flat[beside]]) + OFFSET


def assert_consistent(result):
    """What holds for every result."""
    total = sum(part.volume_m3 for part in result.slices)
    assert total == pytest.approx(result.volume_m3, rel=1e-12)
    heights = sum(part.height_m for part in result.slices)
    assert heights == pytest.approx(result.max_height_m, rel=1e-9)
    assert result.max_z_m - result.min_z_m == pytest.approx(result.max_height_m, rel=1e-9)
    assert sum(part.points for part in result.slices) == result.points_used
    squares = sum(item.std_m3**2 for item in result.budget)
    assert result.std_m3 == pytest.approx(np.sqrt(squares), rel=1e-9)
    assert len(result.body.outlines) == len(result.slices)
    assert all(isinstance(line, Notice) and "\n" not in line for line in result.warnings)


@pytest.mark.parametrize("cloud", [partial(scanned, "sphere", 2000), box_on_ground])
def test_some_points_find_the_same_body_beside_all_as_after_them(monkeypatch, cloud):
    after = volume_of(cloud())
    monkeypatch.setattr(find, "_SIDE_BY_SIDE", 0)
    beside = volume_of(cloud())
    assert (beside.volume_m3, beside.budget) == (after.volume_m3, after.budget)


# --- slices


def test_a_ball_is_measured_at_coordinates_of_maps():
    result = ball()
    assert_consistent(result)
    assert result.volume_m3 == pytest.approx(BALL, rel=0.005)
    assert abs(result.volume_m3 - BALL) < 3 * result.std_m3 < 0.03 * BALL
    assert result.min_z_m == pytest.approx(99.5, abs=0.01)
    assert result.max_z_m == pytest.approx(100.5, abs=0.01)
    assert result.points_used == 2000
    assert result.points_left_out == {"ground": 0, "outliers": 0}
    assert result.body.floor is None
    assert result.warnings == ()
    (check,) = result.checks
    assert check.volume_m3 == pytest.approx(BALL, rel=0.01)


@pytest.mark.parametrize("slices", [7, 1000])
def test_any_number_of_slices_adds_up_to_the_same_volume(slices):
    result = ball(slices=slices)
    assert_consistent(result)
    assert len(result.slices) == slices
    assert result.volume_m3 == ball().volume_m3
    assert result.slice_height_m == pytest.approx(result.max_height_m / slices)


def test_slices_are_no_higher_than_asked_for():
    result = ball(slice_height=0.15)
    assert_consistent(result)
    assert len(result.slices) == 7
    assert result.slice_height_m == pytest.approx(result.max_height_m / 7)


def test_slices_of_a_ball_are_those_of_the_formula():
    for part in ball(slices=10).slices:
        low, high = (part.z_m - 100 + sign * part.height_m / 2 for sign in (-1, 1))
        exact = np.pi * ((high - low) / 4 - (high**3 - low**3) / 3)
        assert part.volume_m3 == pytest.approx(exact, rel=0.01, abs=5e-4)


def test_boxes_converge_to_the_volume():
    counts, volumes = np.transpose(ball().body.convergence)
    errors = np.abs(volumes / ball().volume_m3 - 1)
    # Of midpoints: 1 / (2 n^2) of a ball.
    assert errors[0] == pytest.approx(0.5 / counts[0] ** 2, rel=0.1)
    assert errors[-1] < 1e-5
    assert np.all(np.diff(counts) > 0)


# --- ground


@pytest.mark.parametrize("tilt", [0.0, 20.0])
def test_a_ball_on_ground_is_the_ball(tilt):
    points = scanned("sphere", 2500, ground=2.0, tilt=tilt, noise=0.001)
    result = volume_of(points)
    assert_consistent(result)
    assert result.volume_m3 == pytest.approx(BALL, rel=0.015)
    assert result.body.floor.found == "in the cloud"
    assert result.points_left_out["ground"] == result.body.floor.points > 2000
    assert any("lie on a floor at" in line for line in result.warnings)
    total = result.points_used + sum(result.points_left_out.values())
    assert total == len(points)


@pytest.mark.parametrize("floor", ["auto", 100.0])
def test_a_box_without_bottom_on_ground_is_closed_there(floor):
    result = volume_of(box_on_ground(), floor=floor)
    assert_consistent(result)
    assert result.volume_m3 == pytest.approx(1.0, rel=0.005)
    assert result.min_z_m == pytest.approx(100.0, abs=0.005)
    assert result.body.floor.elevation == pytest.approx(100.0, abs=0.005)
    assert result.body.floor.found == ("given" if floor == 100.0 else "in the cloud")


def test_a_floor_above_the_ground_cuts_the_body_there():
    # Half of the box; the lowest 0.5 spacings above the floor count as ground.
    result = volume_of(box_on_ground(), floor=100.5)
    assert_consistent(result)
    assert result.volume_m3 == pytest.approx(0.5, rel=0.01)
    assert result.min_z_m == pytest.approx(100.5)


def test_an_overhang_that_nobody_saw_above_the_ground_is_completed_and_told():
    result = volume_of(scanned("sphere", 3000, ground=2.0, missing=0.1))
    assert_consistent(result)
    assert result.volume_m3 == pytest.approx(BALL, rel=0.03)
    assert abs(result.volume_m3 - BALL) < 1.96 * result.std_m3
    assert any("was not seen" in line for line in result.warnings)


def test_an_upright_foot_that_nobody_saw_goes_on_to_the_ground_and_is_told():
    result = volume_of(scanned("cube", 3000, ground=2.0, missing=0.1))
    assert_consistent(result)
    assert result.volume_m3 == pytest.approx(1.0, rel=0.02)
    assert abs(result.volume_m3 - 1.0) < 1.96 * result.std_m3
    assert any("were not seen" in line for line in result.warnings)


# --- open and hollow


def test_an_open_bowl_is_an_error_in_one_line():
    points = scanned("sphere", 3000)
    with pytest.raises(InputError, match="the points enclose no space") as refused:
        volume_of(points[points[:, 2] < 100.0])
    assert "\n" not in str(refused.value)


def test_half_a_ball_open_below_is_closed_with_a_warning():
    points = scanned("sphere", 2000)
    result = volume_of(points[points[:, 2] > 100.0])
    assert_consistent(result)
    assert abs(result.volume_m3 - BALL / 2) < 1.96 * result.std_m3 < 0.17 * BALL / 2
    assert result.body.floor.found == "lowest points"
    assert result.body.floor.elevation == pytest.approx(100.0, abs=0.01)
    assert any("stand level on its lowest points" in line for line in result.warnings)
    with pytest.raises(InputError, match="the points enclose no space"):
        volume_of(points[points[:, 2] > 100.0], floor="none")


def test_a_leak_is_an_error_that_says_where_and_what_to_set():
    points = scanned("sphere", 3000)
    points = points[points[:, 0] < OFFSET[0] + np.sqrt(0.24)]
    with pytest.raises(InputError, match=r"give --max-gap 0\.2") as refused:
        volume_of(points, max_gap=0.1)
    assert "\n" not in str(refused.value)
    place = str(refused.value).split("(")[1].split(")")[0]
    np.testing.assert_allclose(
        [float(number) for number in place.split(", ")], OFFSET + np.array([0.49, 0, 0]), atol=0.05
    )
    closed = volume_of(points, max_gap=0.25)
    assert_consistent(closed)
    assert closed.volume_m3 == pytest.approx(BALL, rel=0.01)
    assert any("1 opening in the surface was closed" in line for line in closed.warnings)
    (check,) = closed.checks
    assert check.volume_m3 == pytest.approx(BALL, rel=0.02)


def test_a_leaking_ball_beside_another_is_not_counted_and_told():
    points = scanned("sphere", 3000)
    open_ball = points[points[:, 0] < OFFSET[0] + np.sqrt(0.24)] - [2.0, 0.0, 0.0]
    result = volume_of(np.vstack([points, open_ball]), max_gap=0.15)
    assert_consistent(result)
    assert result.volume_m3 == pytest.approx(BALL, rel=0.01)
    assert any("what lies behind is not counted" in line for line in result.warnings)


@pytest.mark.parametrize("hollow", [False, True])
@pytest.mark.parametrize("name", ["hollow ball", "cup"])
def test_voids_and_hollows_are_body_unless_hollow(name, hollow):
    body = hollow_ball() if name == "hollow ball" else CUP
    result = volume_of(scanned(name, 4000), hollow=hollow)
    assert_consistent(result)
    assert result.volume_m3 == pytest.approx(body.hollow if hollow else body.volume, rel=0.015)
    assert any("--hollow" in line for line in result.warnings) != hollow


def test_a_body_with_a_void_has_no_check():
    """The skin of the void lies inside, where the flood never comes."""
    assert volume_of(scanned("hollow ball", 5000)).checks == ()
    assert len(volume_of(scanned("sphere", 3000)).checks) == 1


# --- scale, place and ground factor


@pytest.mark.parametrize("scale", [7.3])
def test_scaling_the_points_scales_the_volume_by_the_third_power(scale):
    points = scanned("torus, lying", 1500) - OFFSET
    one, other = volume_of(points), volume_of(points * scale)
    assert other.volume_m3 == pytest.approx(one.volume_m3 * scale**3, rel=1e-6)
    assert other.max_height_m == pytest.approx(one.max_height_m * scale, rel=1e-6)


@pytest.mark.parametrize("factor", [0.9996])
def test_the_ground_factor_divides_the_volume_by_its_square(factor):
    # A body, and the same one on a grid that is `factor` times larger than the ground.
    points = scanned("sphere", 2000)
    here = points.mean(axis=0)
    grid = (points - here) * [factor, factor, 1.0] + here
    counts = np.ones(len(points), dtype=np.int64)
    on_ground, on_grid, corrected = (
        measure_body("ball", Thinned(some, counts, 0.0), BodyRecipe(ground_factor=k)).volume_m3
        for some, k in [(points, 1.0), (grid, 1.0), (grid, factor)]
    )
    assert corrected == pytest.approx(on_ground, rel=1e-6)
    assert corrected == pytest.approx(on_grid / factor**2, rel=2e-3)


# --- points


def test_thinned_points_are_counted_and_told():
    points = scanned("sphere", 3000)
    cloud = Thinned(points, np.full(3000, 4), 0.01)
    result = measure_body("ball", cloud, BodyRecipe())
    assert result.name == "ball"
    assert result.points_used == 12_000
    assert any("12,000 points were thinned to 3,000" in line for line in result.warnings)


def test_outliers_are_counted_and_many_are_told():
    few, many = (volume_of(scanned("sphere", 3000, outliers=share)) for share in (0.01, 0.06))
    assert few.volume_m3 == pytest.approx(BALL, rel=0.01)
    assert 18 <= few.points_left_out["outliers"] <= 30
    assert not any("outliers" in line for line in few.warnings)
    assert many.volume_m3 == pytest.approx(BALL, rel=0.015)
    assert any("of the points are outliers" in line for line in many.warnings)


def test_thin_walls_are_told():
    body = cup(inner=0.47, floor=0.03)
    result = volume_of(scan(body, 3000, 3))
    assert any("thinner than 3 point spacings" in line for line in result.warnings)


def test_the_check_knows_two_bodies_apart_from_one():
    one, other = ball_part(0.3, (0, 0, 0)), ball_part(0.2, (0.7, 0, 0.1))
    points = mixed([one.surface, other.surface], [9.0, 4.0])(3000, np.random.default_rng(0))
    result = volume_of(points + OFFSET)
    truth = one.volume + other.volume
    assert result.volume_m3 == pytest.approx(truth, rel=0.01)
    assert result.checks[0].volume_m3 == pytest.approx(truth, rel=0.01)


@given(
    count=st.integers(4, 40),
    seed=st.integers(0, 1000),
    floor=st.sampled_from(["auto", "none", "plane", 99.8]),
    options=st.sampled_from([{}, {"hollow": True}, {"max_gap": 0.3}]),
)
@settings(max_examples=12)
def test_few_points_are_measured_or_refused(count, seed, floor, options):
    points = np.random.default_rng(seed).normal(size=(count, 3))
    points /= np.linalg.norm(points, axis=1)[:, None]
    try:
        result = volume_of(points + OFFSET, floor=floor, **options)
    except InputError:
        return
    assert_consistent(result)
    assert 0.0 < result.volume_m3 < np.inf


@pytest.mark.parametrize(
    ("points", "words"),
    [
        (np.zeros((3, 3)), "3 points: a volume needs at least 4"),
        (np.eye(4, 3), "4 distinct points span no body"),
        (np.random.default_rng(0).random((500, 3)) * [1, 1, 0], "span no body"),
        (sphere().surface(6, np.random.default_rng(0)), "enclose no space"),
    ],
)
def test_too_few_and_flat_points_are_an_error_in_one_line(points, words):
    cloud = Thinned(points + OFFSET, np.ones(len(points), dtype=np.int64), 0.0)
    with pytest.raises(InputError, match=words) as refused:
        measure_body("body", cloud, BodyRecipe(floor="none"))
    assert "\n" not in str(refused.value)


@pytest.mark.one_python
def test_nothing_advises_what_was_asked_for():
    on_ground = scan(BODIES["cube"](), 2000, seed=8, flaws=Flaws(ground=2.5))
    open_beside = scanned("sphere", 3000)
    open_beside = open_beside[open_beside[:, 0] < OFFSET[0] + np.sqrt(0.25 - 0.08**2)]
    assert any("--floor none measures all" in line for line in volume_of(on_ground).warnings)
    assert any("--max-gap sets how wide" in line for line in volume_of(open_beside).warnings)
    for asked, words in (
        (volume_of(on_ground, floor="plane"), "points lie on a floor"),
        (volume_of(open_beside, max_gap=0.25), "1 opening in the surface was closed"),
    ):
        assert any(words in line for line in asked.warnings)
        assert not any("--" in line for line in asked.warnings)


def test_a_body_larger_than_the_box_round_its_points_is_refused():
    """The 16 corners of two cubes that cross, 15 m3 in a box of 27 m3; 90 m3 were told."""
    corners = np.array([[x, y, z] for x in (0, 2) for y in (0, 2) for z in (0, 2)], dtype=float)
    points = np.concatenate([corners, corners + 1.0])
    with pytest.raises(InputError, match="holds 27 m3; take more points"):
        volume_of(points)


def test_points_that_enclose_nothing_by_themselves_are_told():
    rng = np.random.default_rng(4)
    ball = rng.normal(size=(4_000, 3))
    ball /= np.linalg.norm(ball, axis=1)[:, None]
    sheet = np.column_stack([np.full(1_000, 1.5), *rng.uniform(-0.6, 0.6, (2, 1_000))])
    told = {one.code: one for one in volume_of(rng.permutation(np.vstack([ball, sheet]))).warnings}
    assert told["points-outside-body"].values["share"] == pytest.approx(0.2, abs=0.01)
    noisy = ball + rng.normal(0.0, 0.01, ball.shape)
    assert "points-outside-body" not in {one.code for one in volume_of(noisy).warnings}


def test_a_block_of_which_only_the_top_was_seen_is_anything_above_its_ground():
    """Seen straight from above: it was larger than the box round the points of its top."""
    rng = np.random.default_rng(4)
    top = np.column_stack([rng.uniform(-1.0, 1.0, (6_000, 2)), np.full(6_000, 2.0)])
    ground = rng.uniform(-4.0, 4.0, (24_000, 2))
    ground = ground[np.abs(ground).max(axis=1) > 1.0]
    points = np.vstack([top, np.column_stack([ground, np.zeros(len(ground))])])
    result = volume_of(points + 0.004 * rng.standard_normal(points.shape) + OFFSET)
    assert abs(result.volume_m3 - 8.0) < 1.96 * result.std_m3
