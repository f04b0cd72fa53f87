"""The noise of points is found where it grows with slope and where points are few."""

import numpy as np
import pytest
from scipy import ndimage
from shapely.geometry import Point

from quantify_client.types import Window
from quantify_client.volcalc.terrain import noise as noise_module
from quantify_client.volcalc.terrain.accumulate import TerrainAccumulator
from quantify_client.volcalc.terrain.grid_offsets import measure_area
from quantify_client.volcalc.terrain.measure import TerrainRecipe
from quantify_client.volcalc.terrain.noise import measure_noise
from quantify_client.volcalc.terrain.point_noise import (
    _IN_BIN,
    _OVERLAP,
    _bends,
    _four,
    _relative_excess,
    _shrunk,
    white_noise,
)

#: The chain of all of them runs on the second Python in other tests.
pytestmark = pytest.mark.one_python

SHAPE = (190, 210)
CELL, LEVEL, S0 = 0.25, 160.0, 0.03
ROW, COLUMN = np.indices(SHAPE)
EAST, NORTH = (COLUMN - 105) * CELL, (ROW - 95) * CELL
DISTANCE = np.hypot(EAST, NORTH)
INSIDE = (DISTANCE < 18).astype(float)

#: Points lie anywhere in their cells.
ANYWHERE = np.full(SHAPE, 1 / 12)


def _cone():
    """Return heights and the tangent of the slope of a cone of 0.6 on level ground."""
    on = DISTANCE < 16
    return np.where(on, 0.6 * (16 - DISTANCE), 0.0), np.where(on, 0.6, 0.0)


def _ridge():
    """Return a ridge that is one period of a cosine: of every slope from 0 to 0.8."""
    on = np.abs(EAST) < 16
    phase = np.pi * EAST / 16
    top = 0.8 * 16 / np.pi
    return np.where(on, top * (1 + np.cos(phase)), 0.0), np.where(
        on, 0.8 * np.abs(np.sin(phase)), 0
    )


def _measured(shape, sigma, seed=0, count=4.0):
    """Return the noise of the cells of random points with a standard deviation `sigma`."""
    z, slope = shape
    inside = INSIDE if shape[1][0].max() == 0 else (np.abs(EAST) < 17).astype(float)
    variance = (sigma**2 + (slope * CELL) ** 2 / 12) / count
    z = LEVEL + z + np.random.default_rng(seed).normal(0, 1, SHAPE) * np.sqrt(variance)
    return measure_noise(z, np.broadcast_to(count, SHAPE), ANYWHERE, z, inside)


def _rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


@pytest.mark.parametrize("growth", [2.0, 5.0])
def test_noise_that_grows_with_slope_is_found_on_a_cone(growth):
    shape = _cone()
    face = DISTANCE < 15
    truth = S0 * (1 + growth * 0.6**2)
    noises = [_measured(shape, S0 * (1 + growth * shape[1] ** 2), seed) for seed in range(4)]
    found = _rms([noise.point[face] for noise in noises])
    assert found == pytest.approx(truth, rel=0.06)
    cells = _rms([noise.cell[face] for noise in noises])
    assert cells == pytest.approx(np.sqrt((truth**2 + (0.6 * CELL) ** 2 / 12) / 4), rel=0.05)
    assert _rms([noise.point[INSIDE == 0] for noise in noises]) == pytest.approx(S0, rel=0.05)


def test_noise_that_grows_with_slope_is_found_on_a_ridge_of_all_slopes():
    shape = _ridge()
    truth = S0 * (1 + 4 * shape[1] ** 2)
    noises = [_measured(shape, truth, seed) for seed in range(4)]
    for low, high in [(0.0, 0.15), (0.4, 0.6), (0.6, 0.75), (0.75, 0.8)]:
        band = (np.abs(EAST) < 15) & (shape[1] >= low) & (shape[1] <= high)
        found = _rms([noise.point[band] for noise in noises])
        assert found == pytest.approx(_rms(truth[band]), rel=0.12), (low, high)


def test_noise_where_points_are_few_is_found():
    shape = _cone()
    few = (EAST > 0) & (DISTANCE < 18)
    truth = np.where(few, 2.5 * S0, S0)
    noises = [_measured(shape, truth, seed, np.where(few, 2.0, 6.0)) for seed in range(4)]
    west = (EAST < -1) & (DISTANCE < 15)
    east = (EAST > 1) & (DISTANCE < 15)
    assert _rms([noise.point[east] for noise in noises]) == pytest.approx(2.5 * S0, rel=0.06)
    assert _rms([noise.point[west] for noise in noises]) == pytest.approx(S0, rel=0.15)


@pytest.mark.parametrize("shape", [_cone, _ridge])
def test_noise_that_is_the_same_everywhere_is_found_the_same_everywhere(shape):
    shape = shape()
    noises = [_measured(shape, np.full(SHAPE, S0), seed) for seed in range(16)]
    point = np.sqrt(np.mean([noise.point**2 for noise in noises], axis=0))
    np.testing.assert_allclose(point, S0, rtol=0.05)


def test_cells_of_a_random_number_of_points_have_the_noise_of_each_point():
    counts = np.random.default_rng(9).poisson(4.5, (8, *SHAPE)).clip(1).astype(float)
    for seed, count in enumerate(counts):
        noise = _measured(_cone(), np.full(SHAPE, S0), seed, count)
        assert noise.point[0, 0] == pytest.approx(S0, rel=0.1)
        assert _rms(noise.point[INSIDE > 0]) == pytest.approx(S0, rel=0.1)


@pytest.mark.parametrize("east", [8.0, 2.0])
def test_correlated_noise_does_not_count_as_noise_of_the_points(east):
    z, slope = _cone()
    count = np.where((INSIDE > 0) & (EAST > 0), east, 8.0)
    blur = 1.5 / np.sqrt(2)
    found = []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        field = ndimage.gaussian_filter(rng.normal(size=SHAPE), blur, mode="wrap")
        field *= 0.06 * 2 * np.sqrt(np.pi) * blur
        own = rng.normal(0, 1, SHAPE) * np.sqrt((S0**2 + (slope * CELL) ** 2 / 12) / count)
        noisy = LEVEL + z + field + own
        noise = measure_noise(noisy, count, ANYWHERE, noisy, INSIDE)
        assert noise.correlated > 0.04
        found.append(noise.point[(INSIDE > 0) & (EAST > 0)])
    assert _rms(found) == pytest.approx(S0, rel=0.1)


def test_too_few_cells_have_the_noise_of_the_ground():
    z, slope = _cone()
    inside = (np.pi * (DISTANCE / CELL) ** 2 < _IN_BIN).astype(float)
    noisy = LEVEL + np.random.default_rng(0).normal(0, 1, SHAPE) * np.where(inside > 0, 0.1, 0.01)
    noise = measure_noise(noisy, np.full(SHAPE, 4.0), ANYWHERE, noisy, inside)
    np.testing.assert_array_equal(noise.point, noise.point[0, 0])


def test_a_kink_of_the_ground_is_not_noise():
    """Variances of 1 and 1/4 by noise, and of 1 and 4 by kinks: 1 is left, with a std of 1."""
    rng = np.random.default_rng(0)
    ones, std = np.ones((1, 200_000)), np.sqrt([[2.0], [0.25 + 4.0]])
    square = (rng.normal(0.0, 1.0, (2, 200_000)) * std) ** 2
    limits = np.median(square * [[1.0], [4.0]], axis=1, keepdims=True)
    low = square / [[1.0], [0.25]] < limits
    excess, std, _ = _relative_excess(low[:, None], limits, ones, ones)
    assert excess[0] == pytest.approx(0.0, abs=0.03)
    assert std[0] == pytest.approx(1.0, abs=0.03)


def test_shares_of_overlapping_differences_scatter_as_stated():
    rng = np.random.default_rng(0)
    shares = []
    for _ in range(3000):
        z = rng.normal(size=(30, 30))
        shares.append([
            np.mean(np.abs(_four(z, 1, -1.0) / 2) < 0.6745),
            np.mean(np.abs(_four(z, 2, -1.0) / 4) < 0.6745),
        ])  # fmt: skip
    independent = 0.25 / 27**2
    np.testing.assert_allclose(np.var(shares, axis=0) / independent, _OVERLAP, rtol=0.08)


def test_values_within_their_scatter_are_drawn_to_zero_and_others_kept():
    rng = np.random.default_rng(0)
    std = np.full(5, 0.2)
    chance = [_shrunk(rng.normal(0, 0.2, 5), std) for _ in range(500)]
    assert _rms(chance) < 0.1
    np.testing.assert_allclose(_shrunk(np.full(5, 3.0), std), 3.0, rtol=0.01)


def _survey(seed):
    """Return the surveyed points (3, N) of a cone on a turned, uneven raster, and its outline."""
    rng = np.random.default_rng(seed)
    line = np.arange(-28, 28, 0.2)
    u, v = (each.ravel() for each in np.meshgrid(line, line))
    angle = rng.uniform(0, np.pi / 2)
    x = u * np.cos(angle) - v * np.sin(angle) + rng.uniform(-0.1, 0.1, len(u))
    y = u * np.sin(angle) + v * np.cos(angle) + rng.uniform(-0.1, 0.1, len(u))
    kept = np.maximum(np.abs(x), np.abs(y)) < 18
    x, y = x[kept], y[kept]
    height = 0.7 * np.clip(8 - np.hypot(x, y), 0, None)
    sigma = 0.05 * (1 + 4 * np.where(height > 0, 0.7**2, 0.0))
    return x, y, LEVEL + height + rng.normal(0, 1, len(x)) * sigma, Point(0, 0).buffer(9)


def _deviations(surveys):
    """Return (estimate - truth) / std of the volumes of surveys whose noise grows with slope."""
    found = []
    for seed in range(surveys):
        x, y, z, polygon = _survey(seed)
        accumulator = TerrainAccumulator([Window(*polygon.bounds)])
        accumulator.absorb(accumulator.reduce(x, y, z))
        points = accumulator.points_of(0)
        result = measure_area("area", points.to_local(polygon), points, TerrainRecipe())
        found.append((result.volume_m3 - np.pi * 8**2 * 0.7 * 8 / 3) / result.std_m3)
    return np.array(found)


@pytest.mark.one_python
def test_the_interval_of_a_steep_pile_with_noisy_faces_holds(monkeypatch):
    deviations = _deviations(20)  # tell the RMS to 16 %
    monkeypatch.setattr(
        noise_module, "white_noise", lambda *values: white_noise(*values[:-1], values[-1] & False)
    )
    as_on_the_ground = _deviations(20)
    print(f"RMS {_rms(deviations):.2f}, with the ground's noise {_rms(as_on_the_ground):.2f}")
    assert 0.75 < _rms(deviations) < 1.25
    assert _rms(as_on_the_ground) > 1.1 * _rms(deviations)


def test_heights_within_cells_across_a_crease_are_as_far_off_their_planes_as_is_said():
    """All places of a crease of slope 1 in a cell, with 2,000 points in each cell."""
    line = (np.arange(2000) + 0.5) / 2000 - 0.5
    said, found = 0.0, 0.0
    for place in (np.arange(50) + 0.5) / 50 - 0.5:
        heights = np.maximum(np.arange(-6, 7)[:, None] + line - place, 0.0)
        mean = heights.mean(axis=1)
        slope = np.gradient(mean)
        found += (heights - mean[:, None] - slope[:, None] * line).var(axis=1)[2:-2].sum()
        said += _bends(np.tile(mean, (9, 1)), 0.0)[4].sum()
    assert said == pytest.approx(found, rel=0.02)
