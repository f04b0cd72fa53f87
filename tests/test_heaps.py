"""Heaps on their floors in clouds without a CRS: terrain or bodies, and what both give."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

import quantify_client
from quantify_client.volcalc.body import local_frame
from quantify_client.volcalc.body.floor import stand
from quantify_client.volcalc.body.foot import Foot
from quantify_client.volcalc.body.heap import Heaps, around, seen_from_above

from clouds import write_ply  # isort: skip
from mounds import KINDS, OFFSET, random_heap, sampled  # isort: skip

# Arithmetic of arrays: no different on a second Python.
pytestmark = pytest.mark.one_python


def floor(half, count, rng, under=None):
    x, y = rng.uniform(-half, half, (2, count))
    seen = np.ones(count, dtype=bool) if under is None else ~under(x, y)
    return np.column_stack([x, y, np.zeros(count)])[seen]


def heap(count, half, radius, height, noise, seed=0):
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-half, half, (2, count))
    z = np.maximum(0.0, height * (1.0 - np.hypot(x, y) / radius))
    return np.column_stack([x, y, z + rng.normal(0.0, noise, count)])


def ball(count, radius, rng):
    points = rng.normal(size=(count, 3))
    return points * (radius / np.linalg.norm(points, axis=1))[:, None] + [0.0, 0.0, radius]


def cube(count, side, rng):
    """The four walls and the top of a cube that stands on the floor."""
    face, u, v = rng.integers(0, 5, count), rng.uniform(0, side, count), rng.uniform(0, side, count)
    far = np.where(face % 2, side, 0.0)
    x = np.where(face < 2, far, u)
    y = np.where(face < 2, u, np.where(face < 4, far, v))
    return np.column_stack([x, y, np.where(face == 4, side, v)])


def share(points):
    return seen_from_above(stand(points, np.ones(len(points), dtype=np.int64), "auto"))


HEAPS = [(0.45, 0.25, 0.12, 0.0), (0.45, 0.25, 0.12, 0.004), (20, 8, 4, 0.05), (20, 10, 1.5, 0.03)]


@pytest.mark.parametrize("form", HEAPS)
def test_a_heap_is_seen_from_above(form):
    assert share(heap(20_000, *form)) > 0.99


def test_bodies_on_a_floor_are_not():
    rng = np.random.default_rng(3)
    under = floor(3.0, 10_000, rng, lambda x, y: np.hypot(x, y) < 0.4)
    for noise in (0.0, 0.01):
        points = ball(10_000, 1.0, rng)
        body = points + rng.normal(0.0, noise, points.shape) if noise else points
        assert share(np.vstack([body, under])) < 0.6
    around = floor(5.0, 20_000, rng, lambda x, y: (x > 0) & (x < 1) & (y > 0) & (y < 1))
    assert share(np.vstack([cube(10_000, 1.0, rng), around])) < 0.6
    assert share(ball(10_000, 1.0, rng)) is None


@pytest.mark.parametrize("height", [0.6, 1.0, 2.0])
@pytest.mark.parametrize("noise", [0.0, 0.02, 0.04])
def test_a_gentle_heap_of_few_points_on_little_ground_is_one(height, noise, tmp_path):
    """It rises little between neighbours, and a plane through it and its ground has more points."""
    points = heap(5_000, 12.0, 10.0, height, noise, seed=5)
    assert share(points) > 0.99
    path = write_ply(tmp_path / "heap.ply", points + OFFSET)
    truth = math.pi * 10.0**2 * height / 3.0
    for shape in ("auto", "object"):
        (result,) = quantify_client.measure(path, source_unit="m", shape=shape).results
        assert result.volume_m3 == pytest.approx(truth, rel=0.03)
        assert abs(result.volume_m3 - truth) < 2.6 * result.std_m3


@pytest.mark.parametrize(("low", "pit"), [(-2.0, False), (-12.0, True)])
def test_no_outline_around_a_heap_leaves_even_ground_of_the_cloud(low, pit, tmp_path):
    """A heap that the cloud's edge cuts, and a pit beside it: the hull grown is no outline."""
    rng = np.random.default_rng(17)
    x, y = rng.uniform(low, 12.0, 6_000), rng.uniform(-12.0, 12.0, 6_000)
    z = np.maximum(0.0, 2.0 * (1.0 - np.hypot(x, y) / 4.0)) + rng.normal(0.0, 0.02, 6_000)
    if pit:
        z -= np.maximum(0.0, 1.0 - np.hypot(x - 5.6, y) / 1.2)
    points = np.column_stack([x, y, z])
    assert not around(stand(points, np.ones(len(points), dtype=np.int64), "auto")).outlines
    if not pit:  # 0.8 of the cone is on the cloud
        path = write_ply(tmp_path / "heap.ply", points + OFFSET)
        (result,) = quantify_client.measure(path, source_unit="m").results
        side = np.linspace(-4.0, 4.0, 2_001)
        u, v = np.meshgrid(side, side)
        cone = np.where(u > low, np.maximum(0.0, 2.0 * (1.0 - np.hypot(u, v) / 4.0)), 0.0)
        assert result.volume_m3 == pytest.approx(cone.sum() * (side[1] - side[0]) ** 2, rel=0.01)


def test_a_heap_of_too_few_points_for_its_own_outline_is_measured_in_one_around_it(tmp_path):
    path = write_ply(tmp_path / "heap.ply", heap(4_000, 17.0, 10.0, 2.4, 0.0) + OFFSET)
    found = quantify_client.measure(path, source_unit="m")
    (result,) = found.results
    truth = math.pi * 10.0**2 * 2.4 / 3.0
    assert result.area_m2 < 0.5 * 34.0**2
    assert result.volume_m3 == pytest.approx(truth, rel=0.005)
    assert "in an outline around it" in next(w for w in found.warnings if "seen from above" in w)


def test_where_an_outline_cannot_be_measured_others_are(monkeypatch, tmp_path):
    beside_the_cloud = shapely.box(90.0, 90.0, 95.0, 95.0)
    monkeypatch.setattr(local_frame, "around", lambda _: Heaps([beside_the_cloud], things=1))
    path = write_ply(tmp_path / "heap.ply", heap(40_000, 20, 8, 4, 0.05) + OFFSET)
    found = quantify_client.measure(path, source_unit="m")
    (result,) = found.results
    assert result.volume_m3 == pytest.approx(math.pi * 8**2 * 4 / 3.0, rel=0.01)
    assert "(--area auto)" in next(w for w in found.warnings if "seen from above" in w)


def two_heaps(count, noise):
    """Cones of 10 m by 6 m and 2.5 m by 1.5 m, on ground, and their volumes."""
    rng = np.random.default_rng(1)
    x, y = rng.uniform(-20.0, 40.0, count), rng.uniform(-20.0, 20.0, count)
    large, small = 10.0 - np.hypot(x, y), 2.5 - np.hypot(x - 18.0, y)
    z = 0.6 * np.maximum(0.0, np.maximum(large, small)) + rng.normal(0.0, noise, count)
    return np.column_stack([x, y, z]), [0.2 * math.pi * side**3 for side in (10.0, 2.5)]


@pytest.mark.parametrize("shape", ["auto", "terrain"])
def test_each_of_two_heaps_on_even_ground_is_measured(shape, tmp_path):
    points, truths = two_heaps(20_000, 0.03)
    path = write_ply(tmp_path / "heaps.ply", points + OFFSET)
    found = quantify_client.measure(path, source_unit="m", shape=shape)
    assert [result.name for result in found.results] == ["heaps 1", "heaps 2"]
    for result, truth in zip(found.results, truths):
        assert abs(result.volume_m3 - truth) < 2.6 * result.std_m3
        assert result.std_m3 < 0.02 * truth
    assert any("2 heaps" in warning for warning in found.warnings)


def test_explicit_terrain_counts_a_pit_far_from_the_heap(tmp_path):
    points, truths = two_heaps(20_000, 0.0)
    away = np.hypot(points[:, 0] - 32.0, points[:, 1] - 10.0)
    points[:, 2] -= 0.5 * np.maximum(0.0, 4.0 - away)
    pit = math.pi * 4.0**2 * 2.0 / 3.0
    path = write_ply(tmp_path / "heaps.ply", points + OFFSET)
    found = quantify_client.measure(path, source_unit="m", shape="terrain")
    (result,) = found.results
    assert abs(result.volume_m3 - (sum(truths) - pit)) < 2.6 * result.std_m3
    assert result.volume_m3 == pytest.approx(sum(truths) - pit, rel=0.01)
    # Of itself, the shape is that of the heaps: what is left out is told.
    found = quantify_client.measure(path, source_unit="m")
    assert len(found.results) == 2
    assert "higher or lower there than its plane" in told_of(found)


def test_what_no_outline_was_found_for_is_told(tmp_path):
    """A lid that hangs above the ground was left out, and nothing said so."""
    points, (truth, _) = two_heaps(20_000, 0.01)
    lid = np.max(np.abs(points[:, :2] - [30.0, 10.0]), axis=1) < 1.5
    points[lid, 2] += 2.0
    points = points[np.hypot(points[:, 0] - 18.0, points[:, 1]) > 2.6]
    found = quantify_client.measure(
        write_ply(tmp_path / "heaps.ply", points + OFFSET), source_unit="m"
    )
    assert found.results[0].volume_m3 == pytest.approx(truth, rel=0.01)
    assert "1 of 2 things on the ground being in none" in told_of(found)


def told_of(found):
    return next(warning for warning in found.warnings if "seen from above" in warning)


def test_ground_that_is_not_even_is_measured_whole():
    """A cone, and a mound that is lower than twice what the ground's noise reaches."""
    rng = np.random.default_rng(2)
    x, y = rng.uniform(-12.0, 12.0, (2, 16_000))
    z = np.maximum(0.0, 2.0 - 0.5 * np.hypot(x + 6.0, y))
    z = np.maximum(z, 0.2 - 0.04 * np.hypot(x - 5.0, y)) + rng.normal(0.0, 0.04, len(x))
    standing = stand(np.column_stack([x, y, z]), np.ones(len(x), dtype=np.int64), "auto")
    heaps = around(standing)
    assert len(heaps.outlines) == heaps.things == 1
    assert not heaps.even


# Smooth hills 2 m high and their volumes: a bell, and a cone with a skirt that tapers off.
SMOOTH = [
    (lambda r: 2.0 * np.exp(-0.5 * (r / 1.8) ** 2), 2.0 * math.pi * 1.8**2 * 2.0),
    (
        lambda r: np.maximum(0.3 * np.exp(-(r - 2.0)), 0.0) * (r > 2.0)
        + (2.0 - 0.85 * r) * (r <= 2.0),
        2.0 * math.pi * (2.0**2 - 0.85 * 2.0**3 / 3.0 + 0.3 * (2.0 + 1.0)),
    ),
]


@pytest.mark.parametrize("noise", [0.0, 0.01])
@pytest.mark.parametrize(("form", "truth"), SMOOTH)
def test_what_tapers_off_into_the_ground_is_part_of_a_heap(form, truth, noise, tmp_path):
    """Whichever shape is chosen: -0.7 to -10 % were cut off where the noise of points hid it."""
    rng = np.random.default_rng(3)
    x, y = rng.uniform(-12.0, 12.0, (2, 20_000))
    points = np.column_stack([x, y, 0.03 * x + form(np.hypot(x - 1.0, y))])
    path = write_ply(tmp_path / "hill.ply", points + rng.normal(0.0, noise, points.shape) + OFFSET)
    for shape in ("auto", "terrain", "object"):
        (result,) = quantify_client.measure(path, source_unit="m", shape=shape).results
        assert result.volume_m3 == pytest.approx(truth, rel=0.01)
        assert abs(result.volume_m3 - truth) < 2.6 * result.std_m3 < 0.03 * truth


def test_a_hill_that_tapers_off_up_to_the_edge_is_all_of_the_cloud(tmp_path):
    rng = np.random.default_rng(4)
    x, y = rng.uniform(-6.0, 6.0, (2, 20_000))
    z = 1.5 * np.exp(-np.hypot(x, y) / 1.2) + rng.normal(0.0, 0.002, len(x))
    path = write_ply(tmp_path / "hill.ply", np.column_stack([x, y, z]) + OFFSET)
    found = quantify_client.measure(path, source_unit="m")
    (result,) = found.results
    assert result.area_m2 > 11.5**2
    assert "all of the cloud, as nowhere around it the ground is level" in told_of(found)


def test_what_hangs_above_the_ground_is_no_heap():
    """The crown of a tree beside a heap, of which only the top is in the cloud."""
    points, _ = two_heaps(20_000, 0.03)
    near = np.hypot(points[:, 0] - 18.0, points[:, 1]) < 2.5
    points[near, 2] += 4.0
    assert not around(stand(points, np.ones(len(points), dtype=np.int64), "auto")).outlines


def test_explicit_terrain_is_no_worse_known_than_what_is_found(tmp_path):
    """The whole cloud's base would be predicted from its rim, far from the heap: 0.5 % off."""
    path = write_ply(tmp_path / "heap.ply", heap(20_000, 20, 8, 2, 0.03) + OFFSET)
    truth = math.pi * 8**2 * 2 / 3.0
    found = quantify_client.measure(path, source_unit="m", shape="terrain")
    (result,) = found.results
    assert result.volume_m3 == pytest.approx(truth, rel=0.003)
    assert abs(result.volume_m3 - truth) < 2.6 * result.std_m3
    assert "heap-outlined" in [notice.code for notice in found.warnings]
    # A base that was asked for is that of all of the cloud.
    (whole,) = quantify_client.measure(
        path, source_unit="m", shape="terrain", base="lowest"
    ).results
    assert whole.area_m2 > 38.0**2


@pytest.mark.parametrize("form", HEAPS)
def test_a_heap_without_a_crs_is_measured_as_terrain_and_told(form, tmp_path):
    half, radius, height, noise = form
    path = write_ply(tmp_path / "heap.ply", heap(20_000, *form))
    found = quantify_client.measure(path, source_unit="m")
    (result,) = found.results
    truth = math.pi * radius**2 * height / 3.0
    assert found.shape == "terrain"
    assert abs(result.volume_m3 - truth) < 2.6 * result.std_m3
    assert result.volume_m3 == pytest.approx(truth, rel=0.003 if noise else 1e-3)
    told = [notice for notice in found.warnings if notice.code == "taken-for-terrain"]
    assert "--shape object measures what stands on the ground as a body" in told[0]
    assert quantify_client.describe(path, source_unit="m")["shape"] == "terrain"


def test_a_ball_on_its_floor_stays_a_body(tmp_path):
    rng = np.random.default_rng(1)
    under = floor(3.0, 8_000, rng, lambda x, y: np.hypot(x, y) < 0.4)
    path = write_ply(tmp_path / "ball.ply", np.vstack([ball(8_000, 1.0, rng), under]))
    found = quantify_client.measure(path, source_unit="m")
    assert found.shape == "object"
    assert found.results[0].volume_m3 == pytest.approx(4.0 * math.pi / 3.0, rel=0.01)


@pytest.mark.parametrize("form", HEAPS[:3])
def test_a_heap_measured_as_a_body_is_right_as_well(form, tmp_path):
    _, radius, height, _ = form
    path = write_ply(tmp_path / "heap.ply", heap(15_000, *form))
    (result,) = quantify_client.measure(path, source_unit="m", shape="object").results
    truth = math.pi * radius**2 * height / 3.0
    low, high = result.interval95_m3
    assert low < truth < high
    assert result.volume_m3 == pytest.approx(truth, rel=0.01)
    assert sum(piece.volume_m3 for piece in result.slices) == pytest.approx(result.volume_m3)


def as_body(points, folder, **options):
    path = write_ply(folder / "heap.ply", points)
    return quantify_client.measure(path, source_unit="m", shape="object", **options).results[0]


@pytest.mark.parametrize("kind", KINDS)
def test_random_heaps_are_right_as_bodies(kind, tmp_path):
    z = []
    for seed in range(60_000, 60_006):
        rng = np.random.default_rng(seed)
        form = random_heap(rng, kind)
        result = as_body(sampled(form, rng, 12_000)[0], tmp_path)
        assert result.volume_m3 == pytest.approx(form.volume, rel=0.01)
        assert result.max_height_m == pytest.approx(form.top, rel=0.15)
        parts = [piece.volume_m3 for piece in result.slices]
        assert math.fsum(parts) == pytest.approx(result.volume_m3)
        assert {item.source for item in result.budget} > {"outline", "sampling", "base"}
        z.append((result.volume_m3 - form.volume) / result.std_m3)
    assert max(map(abs, z)) < 3.0
    assert np.sqrt(np.mean(np.square(z))) < 1.6


def test_the_slices_of_a_heap_are_its_layers(tmp_path):
    # A cone: what lies above a level is a smaller one.
    result = as_body(heap(40_000, 20, 10, 1.5, 0.0), tmp_path, slices=10)
    edges = np.linspace(0.0, 1.0, 11)
    layers = -np.diff(math.pi * 10**2 * 1.5 / 3.0 * (1.0 - edges) ** 3)
    found = [piece.volume_m3 for piece in result.slices]
    assert found == pytest.approx(layers, abs=0.004 * layers.sum())
    # What is no higher than the ground's reach is no surface of the heap.
    assert result.surface_area_m2 == pytest.approx(math.pi * 10 * math.hypot(10, 1.5), rel=0.05)


def test_a_heap_at_the_border_of_the_cloud_counts_up_to_there(tmp_path):
    points = heap(15_000, 20, 10, 2.0, 0.01)
    result = as_body(points[points[:, 1] > 0.0], tmp_path)
    truth = math.pi * 10**2 * 2.0 / 6.0
    assert result.volume_m3 == pytest.approx(truth, rel=0.01)


def test_uneven_ground_is_in_the_interval(tmp_path):
    z = []
    for seed in range(8):
        points = heap(6_000, 20, 10, 2.0, 0.0, seed)
        turn = np.random.default_rng(seed).uniform(0.0, 2.0 * math.pi, (2, 2))
        for axis, (one, other) in enumerate(turn):
            # Waves as long as the floor and longer ones.
            points[:, 2] += 0.02 * np.sin(points[:, axis] / 6.0 + one)
            points[:, 2] += 0.05 * np.sin(points[:, axis] / 12.0 + other)
        result = as_body(points, tmp_path)
        z.append((result.volume_m3 - math.pi * 10**2 * 2.0 / 3.0) / result.std_m3)
    assert np.sqrt(np.mean(np.square(z))) < 1.5


def test_the_crater_of_a_hollow_heap_is_no_part_of_it(tmp_path):
    rng = np.random.default_rng(5)
    x, y = rng.uniform(-20.0, 20.0, (2, 25_000))
    away = np.hypot(x, y)
    # A ring 3 m high whose crest is 8 m from the middle, 4 m wide to either side.
    points = np.column_stack([x, y, 3.0 * np.maximum(0.0, 1.0 - np.abs(away - 8.0) / 4.0)])
    ring = 2.0 * math.pi * 8.0 * 4.0 * 3.0
    result = as_body(points, tmp_path, hollow=True)
    assert result.volume_m3 == pytest.approx(ring, rel=0.003)


def test_ground_whose_noise_lies_in_two_layers_of_voxels_is_found(tmp_path):
    angle = math.radians(5.0)
    cos, sin = math.cos(angle), math.sin(angle)
    tilt = np.array([[1.0, 0.0, 0.0], [0.0, cos, -sin], [0.0, sin, cos]])
    points = heap(200_000, 16, 10, 2.0, 0.02) @ tilt.T + OFFSET
    result = as_body(points, tmp_path)
    assert result.volume_m3 == pytest.approx(math.pi * 10**2 * 2.0 / 3.0, rel=0.002)
    path = tmp_path / "heap.ply"
    assert quantify_client.describe(path, source_unit="m")["shape"] == "terrain"


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_the_foot_of_bodies_goes_on_to_the_floor(noise, tmp_path):
    rng, count = np.random.default_rng(7), 12_000 if noise else 10_000
    ground = floor(3.0, count, rng, lambda x, y: np.hypot(x, y) < 0.4)
    square = floor(3.0, count, rng, lambda x, y: (x > 0) & (x < 1) & (y > 0) & (y < 1))
    bodies = [
        (ball(count, 1.0, rng), ground, 4.0 * math.pi / 3.0),
        (cube(count, 1.0, rng), square, 1.0),
    ]
    for number, (body, beside, truth) in enumerate(bodies):
        points = np.vstack([body, beside])
        path = tmp_path / f"{number}.ply"
        write_ply(path, points + rng.normal(0.0, noise, points.shape) if noise else points)
        (result,) = quantify_client.measure(path, source_unit="m", shape="object").results
        assert result.volume_m3 == pytest.approx(truth, rel=0.004)
        assert abs(result.volume_m3 - truth) < 3.0 * result.std_m3


def test_the_volume_of_a_foot_is_that_of_its_form():
    cone = Foot(top=2.0, width=3.0, rise=-1.0)  # widths 5 to 3 over 2 m: frustum of a pyramid
    assert cone.volume == pytest.approx(2.0 * (25 + 15 + 9) / 3.0)
    assert cone.below(np.array([0.0, 1.0]))[1] == pytest.approx((25 + 20 + 16) / 3.0)
    upright = Foot(top=2.0, width=3.0, rise=0.0)
    assert upright.below(np.array([0.5, 2.0])) == pytest.approx([4.5, 18.0])
    overhang = Foot(top=2.0, width=3.0, rise=1.0, area_rise=6.0)  # nothing below 0.5 m
    assert overhang.volume == pytest.approx(9.0 * 1.5 / 2.0)
    assert overhang.below(np.array([0.4, 1.0])) == pytest.approx([0.0, 3.0 * 0.5 / 2.0])
    tip = Foot(top=2.0, width=1.0, rise=1.0)  # a pyramid on its tip, which is at 1 m
    assert tip.volume == pytest.approx(1.0 / 3.0)
