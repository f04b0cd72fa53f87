"""Gaps: what is said of them, and what they do to a volume."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely
from clouds import write_ply
from shapely.geometry import box
from terrains import Errors, cone, placed, survey, tilted

from quantify_client import measure
from quantify_client.types import AreaFailure, AreaResult

# Many points: no different on a second Python.
pytestmark = pytest.mark.one_python

CONE = cone().on(tilted)


def scattered(block, share=0.4, seed=0):
    """Keep the points outside of a share of square blocks."""
    side = int(np.ceil(40 / block))
    gone = np.zeros(side**2, bool)
    gone[np.random.default_rng(seed).permutation(side**2)[: round(share * side**2)]] = True

    def keep(x, y):
        return ~gone[(y // block).astype(int) * side + (x // block).astype(int)]

    return keep, gone.reshape(side, side)


def share_left(gone, block, outline):
    """The exact share of an outline outside of the blocks that were emptied."""
    row, column = np.nonzero(gone)
    blocks = shapely.box(column * block, row * block, (column + 1) * block, (row + 1) * block)
    return 1 - shapely.area(shapely.intersection(blocks, outline)).sum() / outline.area


def results(folder, area, keep=None, terrain=CONE, seed=0, count=200_000):
    path = write_ply(
        folder / "survey.ply", survey(terrain.height, Errors(), count, seed, keep), extra=False
    )
    return measure(path, area=area).results


@pytest.mark.parametrize(("block", "seed"), [(0.5, 0), (1.0, 0), (0.73, 1), (1.7, 2), (3.3, 3)])
def test_scattered_gaps_of_forty_percent(tmp_path, block, seed):
    """Blocks of whole cells and blocks whose edges run through cells."""
    keep, gone = scattered(block, seed=seed)
    (result,) = results(tmp_path, CONE.area, keep, seed=seed)
    left = share_left(gone, block, CONE.outline)
    assert result.coverage == pytest.approx(left, abs=0.02)
    if block <= 1:  # so many blocks that the outline has its fair share of them
        assert result.coverage == pytest.approx(0.60, abs=0.02 + abs(left - 0.60))
    # Blocks of 3.3 m are as wide as the cone's flank is long: a lost summit is lost.
    slack = 0.03 * CONE.volume if block < 3 else 1.96 * result.std_m3
    assert result.volume_m3 == pytest.approx(CONE.volume, abs=slack)
    assert any("support" in w and "%" in w for w in result.warnings)
    assert {item.source: item.std_m3 for item in result.budget}["coverage"] > 0


def test_exactly_forty_percent_of_the_outline_s_blocks_is_a_coverage_of_sixty(tmp_path):
    """The outline is whole blocks, and so are the gaps."""
    outline = box(10, 10, 30, 30)
    gone = np.zeros((80, 80), bool)
    gone[20:60, 20:60] = (np.random.default_rng(1).permutation(1600) < 640).reshape(40, 40)

    def keep(x, y):
        return ~gone[(y // 0.5).astype(int), (x // 0.5).astype(int)]

    (result,) = results(tmp_path, placed(outline), keep)
    assert result.coverage == pytest.approx(0.60, abs=0.02)
    assert result.volume_m3 == pytest.approx(CONE.volume, rel=0.03)


def test_full_ground_is_supported_and_nothing_is_said(tmp_path):
    (result,) = results(tmp_path, CONE.area)
    assert result.coverage > 0.98
    assert not any("support" in w for w in result.warnings)


def test_below_half_the_area_is_refused_in_words(tmp_path):
    keep, _ = scattered(1.0, share=0.65)
    (failure,) = results(tmp_path, CONE.area, keep, count=60_000)
    assert isinstance(failure, AreaFailure)
    assert failure.name == "area-1"
    for words in ("support", "50%", "draw the area"):
        assert words in failure.error


def test_an_area_across_the_cloud_s_edge_is_measured_where_the_cloud_is(tmp_path):
    """A sixth of the square has no points; heights go on level for a little there."""
    square = box(30, 15, 42, 25)
    nothing = replace(CONE, feature=lambda x, y: 0 * x)
    (result,) = results(tmp_path, placed(square), terrain=nothing, count=60_000)
    assert isinstance(result, AreaResult)
    assert result.coverage == pytest.approx(10 / 12, abs=0.02)
    assert any("support" in w for w in result.warnings)
    assert abs(result.volume_m3) < 2 * 10 * 0.1 * 2  # the empty strip, off by the slope over it
    level = nothing.on(lambda x, y: 0 * x)
    (result,) = results(tmp_path, placed(square), terrain=level, count=60_000)
    assert abs(result.volume_m3) < min(0.01 * square.area, 1.96 * result.std_m3)


def test_far_across_the_edge_the_rest_is_left_out_and_said(tmp_path):
    keep = lambda x, y: x < 20  # noqa: E731
    square = box(8, 5, 29, 35)
    (result,) = results(tmp_path, placed(square), keep, count=60_000)
    assert result.coverage == pytest.approx(12 / 21, abs=0.02)
    assert any("beyond the edge of the cloud" in w for w in result.warnings)


def test_an_area_outside_the_cloud_fails_in_words_and_others_are_complete(tmp_path):
    away = shapely.affinity.translate(placed(box(0, 0, 5, 5)), 300, 0)
    features = [
        {"type": "Feature", "properties": {"name": name}, "geometry": shapely.geometry.mapping(p)}
        for name, p in (("away", away), ("heap", CONE.area))
    ]
    document = {"type": "FeatureCollection", "features": features}
    path = write_ply(tmp_path / "c.ply", survey(CONE.height, count=60_000), extra=False)
    measurement = measure(path, area=document)
    failure, heap = measurement.results
    assert isinstance(failure, AreaFailure)
    assert failure.name == "away"
    assert "outside" in failure.error or "overlap" in failure.error
    assert not measurement.complete
    assert heap.volume_m3 == pytest.approx(CONE.volume, rel=0.02)


def test_a_gap_at_the_summit_is_interpolated_and_its_error_is_in_the_interval(tmp_path):
    keep = lambda x, y: np.hypot(x - 20, y - 20) > 2  # noqa: E731
    (result,) = results(tmp_path, CONE.area, keep)
    assert result.coverage == pytest.approx(1 - 4 / 81, abs=0.01)
    # The membrane is level across the gap: the cone's cap of 1 m height is lost.
    assert result.volume_m3 == pytest.approx(CONE.volume - np.pi * 4 / 3, rel=0.01)
    assert abs(result.volume_m3 - CONE.volume) < 1.96 * result.std_m3
