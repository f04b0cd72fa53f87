"""The stated standard deviations are what the errors really are, over many simulated surveys."""

from __future__ import annotations

from functools import lru_cache
from typing import Callable, Dict, Tuple

import numpy as np
import pytest
from scipy import ndimage
from shapely.geometry import Point, Polygon, box

from quantify_client.types import AreaResult, Window
from quantify_client.volcalc.terrain.accumulate import TerrainAccumulator
from quantify_client.volcalc.terrain.grid_offsets import measure_area
from quantify_client.volcalc.terrain.measure import TerrainRecipe

EAST, NORTH, SIDE = 576000.0, 5188000.0, 36.0
CENTRE = (EAST + SIDE / 2, NORTH + SIDE / 2)
POINTS = 40_000
SURVEYS = 45  # tell the RMS to 11 %

Heights = Callable[[np.ndarray, np.ndarray], np.ndarray]


def _round(radius: float) -> Polygon:
    return Point(*CENTRE).buffer(radius, quad_segs=24)


def _cone(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    return np.maximum(0.0, 3.0 * (1 - np.hypot(u, v) / 6.0)) + 0.05 * u - 0.03 * v


def _gully(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    depth = 1.2 * np.clip(1 - np.abs(u) / 3.0, 0, None)
    return -depth * np.clip(np.cos(np.pi * v / 20.0), 0, None) * (np.abs(v) < 10)


def _pit(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    return -2.0 * np.clip(1 - (u**2 + v**2) / 36.0, 0, None) + 0.04 * u


GULLY_AREA = box(CENTRE[0] - 5, CENTRE[1] - 11, CENTRE[0] + 5, CENTRE[1] + 11)

# Volumes: pi r^2 h / 3; triangle 3 * 1.2 times the cosine's integral 2 * 20 / pi; pi r^2 h / 2.
SHAPES: Dict[str, Tuple[Heights, Polygon, float]] = {
    "cone": (_cone, _round(7.5), np.pi * 36 * 3 / 3),
    "gully": (_gully, GULLY_AREA, -144 / np.pi),
    "pit": (_pit, _round(7.5), -np.pi * 36 * 2 / 2),
}


@lru_cache(maxsize=1)
def _noise_field(seed: int, length: float, sigma: float) -> np.ndarray:
    """Gaussian noise of the given correlation length on a grid of 0.1 m."""
    rng = np.random.default_rng(seed)
    blur = length / np.sqrt(2) / 0.1
    field = ndimage.gaussian_filter(rng.normal(size=(480, 480)), blur, truncate=3.0)
    return field * (sigma * 2 * np.sqrt(np.pi) * blur)


def _survey(seed: int, noise: str) -> Tuple[AreaResult, float]:
    rng = np.random.default_rng(seed)
    heights, polygon, truth = SHAPES[list(SHAPES)[seed % len(SHAPES)]]
    u, v = rng.uniform(-SIDE / 2, SIDE / 2, (2, POINTS))
    z = 160.0 + heights(u, v)
    if noise == "white":
        z += rng.normal(0, 0.03, POINTS)
    else:
        at = [v / 0.1 + 240, u / 0.1 + 240]
        z += ndimage.map_coordinates(_noise_field(seed, 0.6, 0.02), at, order=1)
        z += rng.normal(0, 0.01, POINTS)
    z[rng.random(POINTS) < 0.01] += 5.0
    return _measure(u + CENTRE[0], v + CENTRE[1], z, polygon), truth


def _measure(x: np.ndarray, y: np.ndarray, z: np.ndarray, polygon: Polygon) -> AreaResult:
    accumulator = TerrainAccumulator([Window(*polygon.bounds)])
    accumulator.absorb(accumulator.reduce(x, y, z))
    points = accumulator.points_of(0)
    return measure_area("area", points.to_local(polygon), points, TerrainRecipe())


@pytest.mark.one_python
@pytest.mark.parametrize("noise", ["white", "correlated"])
def test_errors_are_as_large_as_the_stated_standard_deviation(noise: str) -> None:
    net, cut, fill = [], [], []
    for seed in range(SURVEYS):
        result, truth = _survey(seed, noise)
        net.append((result.volume_m3 - truth) / result.std_m3)
        cut.append((result.cut_m3 - max(truth, 0)) / result.cut_std_m3)
        fill.append((result.fill_m3 - max(-truth, 0)) / result.fill_std_m3)
    rms = float(np.sqrt(np.mean(np.square(net))))
    print(f"{noise}: RMS of (estimate - truth) / std: net {rms:.2f}")
    assert 0.8 < rms < 1.25
    # Cut and fill carry the flat ground's noise besides: their budget may be wide, never narrow.
    assert np.sqrt(np.mean(np.square(cut))) < 1.25
    assert np.sqrt(np.mean(np.square(fill))) < 1.25


@pytest.mark.parametrize("seed", range(4))
def test_flat_noisy_ground_has_neither_cut_nor_fill(seed: int) -> None:
    rng = np.random.default_rng(seed)
    x = rng.uniform(EAST, EAST + SIDE, POINTS)
    y = rng.uniform(NORTH, NORTH + SIDE, POINTS)
    result = _measure(x, y, rng.normal(160.0, 0.05, POINTS), _round(8.0))
    naive = 0.4 * 0.05 / np.sqrt(4) * result.area_m2
    assert abs(result.cut_m3) < 1.96 * result.cut_std_m3
    assert abs(result.fill_m3) < 1.96 * result.fill_std_m3
    assert result.cut_m3 + result.fill_m3 < naive
