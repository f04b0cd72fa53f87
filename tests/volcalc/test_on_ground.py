"""Bodies on ground: a foot below a step, and ground that is uneven."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scans import OFFSET, volume_of
from solids import box_part, cube, union

from quantify_client.volcalc.body.enclose import enclose
from quantify_client.volcalc.body.floor import stand
from quantify_client.volcalc.body.uneven import base_std


@pytest.fixture
def rng():
    return np.random.default_rng(3)


def around(low, high, count, rng, reach=1.0):
    """Level ground, some metres to each side of a rectangle."""
    low, high = np.array(low), np.array(high)
    x, y = rng.uniform(low - reach, high + reach, (count, 2)).T
    off = (x < low[0]) | (x > high[0]) | (y < low[1]) | (y > high[1])
    return np.column_stack([x, y, np.zeros(count)])[off]


@pytest.mark.one_python
@pytest.mark.parametrize("step", [0.09, 0.12, 0.15])
def test_a_foot_ends_at_the_step_above_it(step, rng):
    """Sections above it are a quarter as large, and told that the foot was wider."""
    parts = [box_part((0, 0, 0), (1, 1, step)), box_part((0.3, 0.3, step), (0.8, 0.8, 0.5))]
    truth = step + 0.25 * (0.5 - step)
    points = union("steps", parts, truth).surface(8_000, np.random.default_rng(8))
    points = np.vstack([points[points[:, 2] > 1e-9], around((0, 0), (1, 1), 16_000, rng)])
    result = volume_of(points + 0.0005 * rng.standard_normal(points.shape) + OFFSET)
    assert result.volume_m3 == pytest.approx(truth, rel=0.02)
    assert abs(result.volume_m3 - truth) < 2.0 * result.std_m3


def standing_on(ground):
    points = cube().surface(6_000, np.random.default_rng(9))
    points -= points.min(axis=0)
    everything = np.vstack([points[points[:, 2] > 1e-9], ground])
    order = np.lexsort(everything.T)
    standing = stand(everything[order], np.ones(len(order), dtype=np.int64), "auto")
    body = enclose(standing.points, lid=standing.lid, hollow=False, max_gap=None)
    return standing, body


def test_the_base_is_as_far_off_as_blocks_of_ground_are(rng):
    """A chessboard of +- 1 cm, 64 fields of half a metre, of which a cube of 1 m3 hides four."""
    ground = around((0, 0), (1, 1), 60_000, rng, reach=1.5)
    field = np.floor((ground[:, :2] - ground[:, :2].min(axis=0)) / 0.5).astype(int).sum(axis=1)
    ground[:, 2] = np.where(field % 2, 0.01, -0.01)
    assert base_std(*standing_on(ground)) == pytest.approx(0.01 * math.sqrt(60 / 57), rel=0.15)


def test_noise_of_level_ground_is_no_unevenness(rng):
    ground = around((0, 0), (1, 1), 6_000, rng, reach=1.5)
    ground[:, 2] = 0.01 * rng.standard_normal(len(ground))
    assert base_std(*standing_on(ground)) < 5e-4


def test_without_ground_there_is_none():
    points = cube().surface(3_000, np.random.default_rng(9))
    standing = stand(points, np.ones(len(points), dtype=np.int64), "none")
    assert base_std(standing, enclose(points, hollow=False, max_gap=None)) is None


@pytest.mark.one_python
def test_of_uneven_ground_alone_there_may_be_nothing(rng):
    """A bent surface 2 m wide and as high as its points are apart, closed at the lowest of them."""
    x, y = rng.uniform(-1.0, 1.0, (2, 20_000))
    points = np.column_stack([x, y, 0.006 * np.sin(5 * x) * np.cos(4 * y)])
    points[:, 2] += 0.001 * rng.standard_normal(len(points))
    result = volume_of(points + OFFSET)
    assert result.warnings[0].code == "floor-at-lowest-points"
    assert result.volume_m3 < 1.96 * result.std_m3
