"""What makes an area or a cloud hard to measure is measured all the same, or named."""

from __future__ import annotations

import re

import numpy as np
import pytest
from clouds import write_ply
from shapely.geometry import box
from terrains import EAST, MIDDLE, NORTH, Errors, circle, cone, placed, survey

from quantify_client import measure
from quantify_client.options import DEFAULT_BASE
from quantify_client.types import AreaFailure, AreaResult

pytestmark = pytest.mark.one_python

SITE = cone()
POINTS = survey(SITE.height, Errors(0.02, 0.0), 60_000)


def only(folder, xyz, area=None):
    path = write_ply(folder / "cloud.ply", xyz, extra=False)
    # With a base that was asked for it is the whole cloud, and not the heap on it.
    measurement = measure(path, area=area, shape="terrain", base=DEFAULT_BASE)
    (result,) = measurement.results
    return result, " ".join(measurement.warnings)


def assert_right(result):
    assert abs(result.volume_m3 - SITE.volume) < 1.96 * result.std_m3 < 0.1 * SITE.volume


@pytest.mark.parametrize("drawn", [True, False])
def test_half_a_per_cent_of_the_points_at_the_origin(tmp_path, drawn):
    origin = np.zeros((300, 3))
    result, said = only(tmp_path, np.concatenate([origin, POINTS]), SITE.area if drawn else None)
    assert_right(result)
    assert "300 points lie at the origin (0, 0, 0), far from all others" in said


@pytest.mark.parametrize("drawn", [True, False])
def test_two_per_cent_of_noise_over_kilometres(tmp_path, drawn):
    rng = np.random.default_rng(5)
    noise = rng.normal([EAST, NORTH, 100.0], [2500.0, 2500.0, 300.0], (1200, 3))
    result, said = only(tmp_path, np.concatenate([POINTS, noise]), SITE.area if drawn else None)
    assert_right(result)
    assert ("points lie far from nearly all others" in said) == (not drawn)


def test_points_far_away_are_told_with_a_code_and_their_number(tmp_path):
    rng = np.random.default_rng(5)
    noise = rng.normal([EAST, NORTH, 100.0], [2500.0, 2500.0, 300.0], (1200, 3))
    path = write_ply(tmp_path / "cloud.ply", np.concatenate([POINTS, noise]), extra=False)
    warnings = measure(path, shape="terrain").warnings
    found = {text.code: text.values for text in warnings if hasattr(text, "code")}
    assert 1100 < found["points-far-away"]["points"] <= 1200


@pytest.mark.parametrize("step", [0.5, 1.0])
def test_coordinates_in_steps_coarser_than_the_spacing(tmp_path, step):
    """Many points share each place then: cells follow the places."""
    result, _ = only(tmp_path, np.round(POINTS / step) * step, SITE.area)
    assert_right(result)
    assert result.coverage == pytest.approx(1.0, abs=0.01)
    assert result.cell_m >= 2 * step


def test_an_area_mostly_beyond_the_cloud_is_told_so(tmp_path):
    result, _ = only(tmp_path, POINTS, placed(circle(9.0, 43.0, 20.0)))
    assert isinstance(result, AreaFailure)
    assert "of it lie beyond the edge of the cloud" in result.error
    assert "quality" not in result.error


def test_an_area_of_small_holes_is_measured_in_larger_cells(tmp_path):
    """Of strips a metre wide between holes of four."""
    x, y = POINTS[:, 0] - EAST, POINTS[:, 1] - NORTH
    holes = (x % 5 < 4) & (y % 5 < 4) & (np.abs(x - 20) < 15) & (np.abs(y - 20) < 15)
    result, _ = only(tmp_path, POINTS[~holes], placed(box(6, 6, 34, 34)))
    assert abs(result.volume_m3 - SITE.volume) < 1.96 * result.std_m3 < 0.1 * SITE.volume
    assert result.warnings[0].code == "gaps-interpolated"


def test_an_area_of_holes_is_told_so(tmp_path):
    x, y = POINTS[:, 0] - EAST, POINTS[:, 1] - NORTH
    holes = (x % 14 < 12) & (y % 14 < 12) & (np.abs(x - 20) < 15) & (np.abs(y - 20) < 15)
    result, _ = only(tmp_path, POINTS[~holes], placed(box(6, 6, 34, 34)))
    assert isinstance(result, AreaFailure)
    assert "the cloud has holes there" in result.error


def test_an_area_without_any_point_is_told_so(tmp_path):
    corner = (POINTS[:, 0] < EAST + 20) | (POINTS[:, 1] < NORTH + 20)
    result, _ = only(tmp_path, POINTS[corner], placed(box(29, 29, 34, 34)))
    assert "the cloud has no points there" in result.error


def test_heights_absurdly_far_are_told(tmp_path):
    middle = np.hypot(POINTS[:, 0] - EAST - 20, POINTS[:, 1] - NORTH - 20) < 9
    lifted = POINTS + np.outer(middle & (np.arange(len(POINTS)) % 100 == 0), [0, 0, 1e9])
    result, _ = only(tmp_path, lifted, SITE.area)
    assert_right(result)
    (reason,) = (name for name in result.points_left_out if "absurdly far" in name)
    assert result.points_left_out[reason] == np.count_nonzero(lifted[:, 2] > 1e8)


def test_a_whole_cloud_s_outline_tells_what_it_leaves_outside(tmp_path):
    x, y = POINTS[:, 0] - EAST, POINTS[:, 1] - NORTH
    rng = np.random.default_rng(2)
    middles = rng.permutation(np.stack(np.mgrid[-60:100:8, -60:100:8], -1).reshape(-1, 2))
    middles = middles[np.hypot(*(middles - 20).T) > 30][:120]
    away = rng.uniform(-0.9, 0.9, (120, 75, 2)) + middles[:, None]
    islands = np.column_stack([*away.reshape(-1, 2).T, np.full(9000, 100.0)])
    islands += (EAST, NORTH, 0.0)
    kept = POINTS[np.hypot(x - 20, y - 20) < 14]
    result, said = only(tmp_path, np.concatenate([kept, islands]))
    share = 9000 / (9000 + len(kept))
    assert f"{share:.0%} of the points lie outside the outline" in said
    assert_right(result)
    assert "outside the outline" not in only(tmp_path, POINTS)[1]


@pytest.mark.parametrize(
    ("count", "long", "wide", "share"), [(1000, 200, 10, 0.55), (60_000, 40, 40, 0.0)]
)
def test_an_outline_that_leaves_many_points_at_its_edge_tells(count, long, wide, share, tmp_path):
    x, y = np.random.default_rng(3).uniform(0, (long, wide), (count, 2)).T
    z = 100.0 + np.maximum(0.0, 4.0 * (1.0 - np.hypot(x - 20, y - 5) / 8.0))
    result, said = only(tmp_path, np.column_stack([x + EAST, y + NORTH, z]))
    assert isinstance(result, AreaResult)
    told = re.search(r"(\d+)% of the points lie outside the outline .*edge.*draw an area", said)
    assert (told is not None) == (share > 0)
    if told:
        assert int(told[1]) / 100 == pytest.approx(share, abs=0.03)
        assert 1.0 - result.area_m2 / (long * wide) == pytest.approx(share, abs=0.03)


def test_a_few_heights_that_no_terrain_has_are_told(tmp_path):
    """Nearly those of no data, in a hole; too few for the heights of the whole site to show."""
    deep = POINTS.copy()
    away = np.hypot(deep[:, 0] - EAST - MIDDLE, deep[:, 1] - NORTH - MIDDLE)
    deep[away < 2.0, 2] = -9998.9
    _, said = only(tmp_path, deep, SITE.area)
    assert "heights are -9998.9 to" in said
    assert "some cannot be those of terrain" in said
    assert "those of terrain" not in only(tmp_path, POINTS, SITE.area)[1]
