"""Stage curves and pour points, against closed forms and a flood from the outline."""

from __future__ import annotations

import csv
import heapq
import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from test_given_bases import EAST, NORTH, areas, cloud_at

import quantify_client
from quantify_client.cli import main
from quantify_client.errors import UsageError
from quantify_client.options import OPTIONS
from quantify_client.volcalc.terrain.stage import auto_levels, find_basins

ANGLE = np.linspace(0.0, 2.0 * np.pi, 129)
R, H, LEVEL = 15.0, 5.0, 100.0


def ring_of(radius):
    ring = np.column_stack([EAST + radius * np.cos(ANGLE), NORTH + radius * np.sin(ANGLE)])
    ring[-1] = ring[0]
    return ring.tolist()


def box_of(x, y):
    corners = [(-x, -y), (x, -y), (x, y), (-x, y), (-x, -y)]
    return [[EAST + a, NORTH + b] for a, b in corners]


def staged(path, form, ring, stage, half=26.0, **options):
    cloud = cloud_at(path, form, half=half, count=150_000)
    found = quantify_client.measure(cloud, area=areas(ring), stage=stage, grid=True, **options)
    (result,) = found.results
    return result


def pit(x, y):
    return LEVEL - np.clip(H * (1.0 - np.hypot(x, y) / R), 0.0, None)


def in_pit(level):
    h = level - (LEVEL - H)
    return math.pi * (R / H) ** 2 * h**3 / 3.0


def test_a_conical_pit_holds_what_a_cone_does_at_every_level(tmp_path):
    result = staged(tmp_path / "pit.laz", pit, ring_of(18.0), "auto")
    stage, capacity = result.stage, in_pit(LEVEL)
    # Up to the round level below the pour level, which the noise of the rim puts a little lower.
    assert 9 <= len(stage.levels) <= 26
    for row in stage.levels:
        assert row.volume_m3 == pytest.approx(in_pit(row.level_m), abs=1e-3 * capacity)
    for row in stage.levels[:-1]:
        water = math.pi * (R * (row.level_m - LEVEL + H) / H) ** 2
        assert row.water_area_m2 == pytest.approx(water, abs=5e-3 * math.pi * R**2)
    (spill,) = [point for point in stage.pour_points if point.outside]
    assert spill.level_m == pytest.approx(LEVEL, abs=0.02)
    assert spill.lowest_m == pytest.approx(LEVEL - H, abs=0.2)
    assert stage.capacity_m3 == pytest.approx(capacity, rel=5e-3)
    # It pours over its rim, 15 m away from the middle, and then over the outline at 18 m.
    assert 14.5 < math.hypot(spill.x - EAST, spill.y - NORTH) < 18.5
    assert [row.spills for row in stage.levels][:-1] == [False] * (len(stage.levels) - 1)


def channel(x, y):
    return 50.0 + 0.03 * x + 0.5 * abs(y)


def in_channel(level, half=20.0, wide=8.0):
    """Of a V with sides 1 : 2 the section is 2 d^2; above its banks the outline is a wall."""
    x = np.linspace(-half, half, 100_001)
    d = np.clip(level - 50.0 - 0.03 * x, 0.0, None)
    full = wide / 2.0
    section = np.where(d <= full, 2.0 * d**2, 2.0 * full**2 + 2.0 * wide * (d - full))
    return float(((section[1:] + section[:-1]) / 2.0).sum() * (x[1] - x[0]))


def test_a_channel_open_at_both_ends_is_closed_by_the_outline(tmp_path):
    levels = [50.0, 51.0, 52.5, 54.0, 55.0]
    result = staged(tmp_path / "channel.laz", channel, box_of(20.0, 8.0), levels)
    capacity = in_channel(55.0)
    assert [row.level_m for row in result.stage.levels] == levels
    for row in result.stage.levels:
        assert row.volume_m3 == pytest.approx(in_channel(row.level_m), abs=1e-3 * capacity)
        assert row.spills
    assert result.stage.pour_points == ()
    assert result.stage.capacity_m3 is None


BOTTOMS = ((-9.0, 40.0), (9.0, 41.0))


def pond(x, y):
    """Two bowls in ground at 44 m, which do not touch."""
    each = [0.05 * ((x - a) ** 2 + y**2) + bottom for a, bottom in BOTTOMS]
    return np.minimum(np.minimum(*each), 44.0)


def in_bowl(level, bottom):
    """Of a paraboloid z = a r^2 the volume below h is pi h^2 / (2 a)."""
    return math.pi * max(level - bottom, 0.0) ** 2 / 0.1


@pytest.mark.one_python
def test_two_basins_that_do_not_meet_are_both_filled(tmp_path):
    levels = [40.5, 41.0, 42.0, 43.0, 44.0, 44.5]
    result = staged(tmp_path / "pond.laz", pond, ring_of(24.0), levels)
    capacity = in_bowl(44.0, 40.0) + in_bowl(44.0, 41.0)
    for row in result.stage.levels[:-1]:
        held = in_bowl(row.level_m, 40.0) + in_bowl(row.level_m, 41.0)
        assert row.volume_m3 == pytest.approx(held, abs=1e-3 * capacity)
    assert len(result.stage.pour_points) == 2
    assert result.stage.capacity_m3 == pytest.approx(capacity, rel=0.02)


def joined_pond(x, y):
    """The same with sides half as steep: they meet at 42.04 m, below the ground around at 44 m."""
    each = [0.02 * ((x - a) ** 2 + y**2) + bottom for a, bottom in BOTTOMS]
    return np.minimum(np.minimum(*each), 44.0)


@pytest.mark.one_python
def test_two_basins_that_meet_pour_over_their_saddle(tmp_path):
    result = staged(tmp_path / "pond.laz", joined_pond, ring_of(25.0), "auto", half=28.0)
    x = 1.0 / (0.02 * 36.0)  # where 0.02 (x + 9)^2 + 40 = 0.02 (x - 9)^2 + 41
    saddle = 0.02 * (x + 9.0) ** 2 + 40.0
    (inner,) = [point for point in result.stage.pour_points if not point.outside]
    # A crest between two slopes of 0.4 is up to 0.4 c / 4 lower in cells of size c.
    assert saddle - 0.1 * result.cell_m - 0.04 < inner.level_m < saddle
    assert (inner.x - EAST, inner.y - NORTH) == pytest.approx((x, 0.0), abs=0.7)
    # The shallower of the two holds this much: pi h^2 / (2 a).
    holds = math.pi * (inner.level_m - 41.0) ** 2 / 0.04
    assert inner.volume_m3 == pytest.approx(holds, rel=0.02)
    (outer,) = [point for point in result.stage.pour_points if point.outside]
    assert outer.level_m == pytest.approx(44.0, abs=0.02)
    side = (np.arange(-25.0, 25.0, 0.02)) + 0.01
    u, v = np.meshgrid(side, side)
    bowl = joined_pond(u, v)[np.hypot(u, v) <= 25.0]
    top = result.stage.levels[-1]
    held = float(np.clip(top.level_m - bowl, 0.0, None).sum()) * 0.0004
    assert top.volume_m3 == pytest.approx(held, rel=1e-3)
    assert result.stage.capacity_m3 == pytest.approx(held, rel=5e-3)


@pytest.mark.one_python
def test_intervals_hold_the_closed_form_with_noise_of_five_centimetres(tmp_path):
    rows = []
    for seed in range(6):
        cloud = cloud_at(tmp_path / f"{seed}.laz", pit, count=60_000, noise=0.05, seed=seed)
        found = quantify_client.measure(
            cloud, area=areas(ring_of(18.0)), stage=[96, 97, 98, 99], grid=True
        )
        rows += [
            (row.volume_m3 - in_pit(row.level_m)) / row.std_m3
            for row in found.results[0].stage.levels
        ]
    assert 0.3 < math.sqrt(np.mean(np.square(rows))) < 1.6


# --- basins of grids


def flooded(z):
    """Levels of water that fills a grid to where it runs off over its edge (Barnes et al. 2014)."""
    level = np.full(z.shape, np.inf)
    ny, nx = z.shape
    heap = []
    for row in range(ny):
        for column in range(nx):
            if row in (0, ny - 1) or column in (0, nx - 1):
                level[row, column] = z[row, column]
                heapq.heappush(heap, (z[row, column], row, column))
    while heap:
        at, row, column = heapq.heappop(heap)
        for down in (-1, 0, 1):
            for right in (-1, 0, 1):
                r, c = row + down, column + right
                if 0 <= r < ny and 0 <= c < nx and np.isinf(level[r, c]):
                    level[r, c] = max(at, z[r, c])
                    heapq.heappush(heap, (level[r, c], r, c))
    return level


@given(st.integers(0, 100_000), st.integers(3, 12), st.integers(3, 12), st.booleans())
def test_basins_hold_what_a_flood_leaves_behind(seed, ny, nx, ties):
    rng = np.random.default_rng(seed)
    z = rng.integers(0, 4, (ny, nx)) * 1.0 if ties else rng.normal(size=(ny, nx))
    found = find_basins(z, np.full(z.shape, 2.0), 0.0, (EAST, NORTH), 1.0)
    depth = flooded(z) - z
    held = [point.volume_m3 for point in found.points if point.outside]
    assert sum(held) == pytest.approx(2.0 * depth.sum(), rel=1e-9, abs=0.02 * max(held or [0.0]))
    # What pours somewhere is no higher than what it pours from.
    for point in found.points:
        row, column = int(point.y - NORTH), int(point.x - EAST)
        assert z[row, column] == point.level_m > point.lowest_m
    edge = np.ones(z.shape, dtype=bool)
    edge[1:-1, 1:-1] = False
    assert found.outline == z[edge].min()


def test_noise_makes_no_basins():
    rng = np.random.default_rng(3)
    z = 10.0 + 0.05 * rng.normal(size=(120, 120))
    assert find_basins(z, np.ones(z.shape), 0.05, (0.0, 0.0), 1.0).points == []
    z[40:80, 40:80] -= 2.0
    (point,) = find_basins(z, np.ones(z.shape), 0.05, (0.0, 0.0), 1.0).points
    assert point.volume_m3 == pytest.approx(2.0 * 1600.0, rel=0.1)


def test_levels_are_round_and_end_where_it_spills():
    z = np.full((20, 20), 12.34)
    z[5:15, 5:15] = 10.11
    basins = find_basins(z, np.ones(z.shape), 0.0, (0.0, 0.0), 1.0)
    levels = auto_levels(10.11, 12.34, basins)
    assert levels[-1] == 12.34
    assert np.allclose(np.diff(levels[:-1]), 0.2)
    assert levels[0] == pytest.approx(10.2)


# --- the option


@pytest.mark.parametrize(
    ("given", "kept"),
    [
        ("auto", "auto"),
        (["auto"], "auto"),
        (12, "12"),
        ([3, 1.5], "1.5,3"),
        ("3, 1.5", "1.5,3"),
        (["2", "1,0"], "0,1,2"),
        (np.array([1.0, 2.5]), "1,2.5"),
    ],
)
def test_levels_are_kept_as_one_text(given, kept):
    assert OPTIONS["stage"].read(given) == kept
    assert OPTIONS["stage"].read(kept) == kept


@pytest.mark.parametrize("given", ["", "high", ["1", "x"], float("nan"), [], [30_000], range(1001)])
def test_what_is_no_level_is_refused_in_one_line(given):
    with pytest.raises(UsageError, match="--stage is .*; give auto or elevations") as caught:
        OPTIONS["stage"].read(given)
    assert "\n" not in str(caught.value)


@pytest.mark.one_python
def test_the_command_writes_the_curve(tmp_path, capsys):
    cloud = cloud_at(tmp_path / "pit.laz", pit)
    area = tmp_path / "area.geojson"
    area.write_text(json.dumps(areas(ring_of(18.0))))
    out = tmp_path / "out"
    command = ["volume", cloud, "--area", str(area), "--stage", "97", "99", "--grid"]
    assert main([*command, "--out", str(out), "--json"]) == 0
    (result,) = json.loads(capsys.readouterr().out)["results"]
    assert [row["level_m"] for row in result["stage"]["levels"]] == [97.0, 99.0]
    with (out / "stage.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["volume_m3"]) for row in rows] == pytest.approx(
        [row["volume_m3"] for row in result["stage"]["levels"]]
    )
    assert (out / "area-01-area-1-stage.png").stat().st_size > 10_000
    assert main([*command, "--base", cloud]) == 2
    assert "--stage and --base-points go with one survey" in capsys.readouterr().err
    assert main(["volume", cloud, "--stage", "high"]) == 2


@pytest.mark.one_python
def test_a_plateau_around_a_pit_holds_nothing_and_the_capacity_is_that_of_the_last_level(tmp_path):
    def dish(x, y):
        return LEVEL - np.clip(1.0 - (x**2 + y**2) / 36.0, 0.0, None)

    for seed in (1, 2, 3):
        cloud = cloud_at(tmp_path / "d.laz", dish, half=60, count=400_000, noise=0.03, seed=seed)
        (result,) = quantify_client.measure(
            cloud, area=areas(box_of(54, 54)), stage="auto", grid=True
        ).results
        last = result.stage.levels[-1]
        truth = math.pi * 36.0 * (last.level_m - LEVEL + 1.0) ** 2 / 2.0
        assert last.volume_m3 == pytest.approx(truth, abs=2.5 * last.std_m3)
        assert last.water_area_m2 < 1.3 * math.pi * 36.0  # of 11,664 m2
        assert result.stage.capacity_m3 == pytest.approx(last.volume_m3, rel=0.01)


@pytest.mark.one_python
def test_water_does_not_fall_as_it_rises_and_levels_above_all_ground_are_told(tmp_path):
    cloud = cloud_at(tmp_path / "small.laz", pit, count=20_000, noise=0.02)
    levels = [99.9 + 0.001 * step for step in range(120)]
    (result,) = quantify_client.measure(
        cloud, area=areas(box_of(4, 4)), stage=[*levels, 321.5], grid=True
    ).results
    for column in ("volume_m3", "water_area_m2"):
        values = [getattr(row, column) for row in result.stage.levels]
        assert values == sorted(values)
    assert "stage-above-ground" in [notice.code for notice in result.warnings]


def lipped(x, y):
    """A frustum of 4 m depth, radii 20 m and 12 m, in ground that is tilted by 2 %."""
    away = np.hypot(x, y)
    tilted = LEVEL + 0.02 * x
    return np.minimum(tilted, 95.9 + np.clip(away - 12.0, 0.0, None) / 2.0)


@pytest.mark.one_python
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_capacity_behind_a_sharp_lip_is_within_its_interval(tmp_path, seed):
    cloud = cloud_at(tmp_path / "lip.laz", lipped, half=30, count=100_000, noise=0.03, seed=seed)
    (result,) = quantify_client.measure(
        cloud, area=areas(ring_of(25.0)), stage="auto", grid=True
    ).results
    # It spills where the lip is lowest, at x = -r: 100 - 0.02 r = 95.9 + (r - 12) / 2.
    radius = (100.0 - 95.9 + 6.0) / 0.52
    level = 100.0 - 0.02 * radius
    side = np.arange(-25.0, 25.0, 0.02) + 0.01
    u, v = np.meshgrid(side, side)
    held = np.clip(level - lipped(u, v), 0.0, None)[np.hypot(u, v) < radius + 0.02]
    truth = float(held.sum()) * 0.0004
    stage = result.stage
    assert abs(stage.capacity_m3 - truth) < 2.5 * stage.capacity_std_m3 < 0.05 * truth
    (point,) = [one for one in stage.pour_points if one.outside]
    assert abs(point.level_m - level) < 2.5 * point.level_std_m
