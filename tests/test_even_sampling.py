"""Bodies of known volume whose points are evenly spaced: thinned, on grids, or placed so."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scans import volume_of
from scipy.spatial import cKDTree

# Arithmetic of arrays: no different on a second Python.
pytestmark = pytest.mark.one_python

BALL, CUBE, TORUS = 4.0 * math.pi / 3.0, 1.0, 2.0 * math.pi**2 * 0.16


def ball(count, rng):
    points = rng.normal(size=(count, 3))
    return points / np.linalg.norm(points, axis=1)[:, None]


def cube(count, rng):
    places, face = rng.uniform(-0.5, 0.5, (count, 2)), rng.integers(0, 6, count)
    points = np.empty((count, 3))
    for axis in range(3):
        on = face // 2 == axis
        points[on] = np.insert(places[on], axis, 0.0, axis=1)
        points[on, axis] = face[on] % 2 - 0.5
    return points


def torus(count, rng):
    """Radii 1 and 0.4, evenly by area: by rejection."""
    u, v = rng.uniform(0.0, 2.0 * np.pi, (2, 2 * count))
    kept = rng.random(2 * count) < (1.0 + 0.4 * np.cos(v)) / 1.4
    u, v = u[kept][:count], v[kept][:count]
    away = 1.0 + 0.4 * np.cos(v)
    return np.column_stack([away * np.cos(u), away * np.sin(u), 0.4 * np.sin(v)])


FORMS = {"ball": (ball, BALL), "cube": (cube, CUBE), "torus": (torus, TORUS)}


def in_voxels(points, side):
    """Means of the points of each voxel, as Open3D and PDAL thin."""
    place = np.floor(points / side).astype(np.int64)
    _, voxel = np.unique(place, axis=0, return_inverse=True)
    voxel = voxel.ravel()
    count = np.bincount(voxel)
    return np.column_stack([np.bincount(voxel, axis) / count for axis in points.T])


def apart(points, least):
    """Points of which no two are nearer than a distance, as CloudCompare and PDAL thin."""
    tree, kept = cKDTree(points), np.ones(len(points), dtype=bool)
    for number in range(len(points)):
        if kept[number]:
            near = np.array(tree.query_ball_point(points[number], least))
            kept[near[near > number]] = False
    return points[kept]


def holds(points, truth, rng, most, sigmas=2.5):
    result = volume_of(rng.permutation(points))
    assert result.volume_m3 == pytest.approx(truth, rel=most)
    assert abs(result.volume_m3 - truth) < sigmas * result.std_m3


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("noise", [0.0, 0.004])
def test_voxels(form, noise):
    rng = np.random.default_rng(8)
    make, truth = FORMS[form]
    points = make(200_000, rng)
    holds(in_voxels(points + noise * rng.normal(size=points.shape), 0.04), truth, rng, 0.004)


@pytest.mark.parametrize("form", FORMS)
def test_least_distance(form):
    rng = np.random.default_rng(9)
    make, truth = FORMS[form]
    holds(apart(make(60_000, rng), 0.05), truth, rng, 0.004)


@pytest.mark.parametrize("count", [2_000, 20_000])
def test_a_ball_of_golden_spirals(count):
    number = np.arange(count) + 0.5
    height, turn = 1.0 - 2.0 * number / count, math.pi * (1.0 + math.sqrt(5.0)) * number
    flat = np.sqrt(1.0 - height**2)
    points = np.column_stack([flat * np.cos(turn), flat * np.sin(turn), height])
    holds(points, BALL, np.random.default_rng(1), 0.001)


@pytest.mark.parametrize("steps", [20, 50])
def test_a_grid_on_a_cube(steps):
    side = np.arange(steps + 1) / steps - 0.5
    places = np.column_stack([axis.ravel() for axis in np.meshgrid(side, side)])
    faces = [np.insert(places, axis, at, axis=1) for axis in range(3) for at in (-0.5, 0.5)]
    # A grid whose points lie on the edges cuts nothing off, which a third of it cannot tell.
    rng = np.random.default_rng(2)
    holds(np.unique(np.vstack(faces), axis=0), CUBE, rng, 2.5 / steps**2, sigmas=4.0)
