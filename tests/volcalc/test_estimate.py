"""Facets and noise: what the surface found lacks, and how it is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from quantify_client.volcalc.body.enclose import Enclosed
from quantify_client.volcalc.body.estimate import estimate, is_same_body
from quantify_client.volcalc.body.pattern import is_in_rows, is_of_mesh, is_on_grid
from quantify_client.volcalc.body.sections import BodySurface
from quantify_client.volcalc.body.spacing import Nearness

NOTHING = BodySurface(
    corners=np.empty((0, 3, 3)),
    number=np.empty((0, 3), dtype=np.int64),
    sign=np.empty(0),
    bottom=np.empty(0),
    top=np.empty(0),
)
BODY = Enclosed(
    surface=NOTHING,
    within=99.0,
    outer=0.0,
    inner=0.0,
    spacing=0.1,
    water=0.0,
    voids=0.0,
    narrow=0.0,
    gaps=(),
    patches=np.empty((0, 3, 3)),
    leaks=(),
    thin_walled=False,
    apart=np.empty(0, dtype=np.int64),
)


def test_a_skin_that_is_thicker_outside_gives_volume_back() -> None:
    noisy = replace(BODY, outer=6.0, inner=4.0)
    found = estimate(noisy, noisy, 3)
    assert found.volume == pytest.approx(99.0 + 1.0, abs=0.1)
    assert found.outline_std > 0.1


def test_thin_walls_hold_too_much_by_how_deep_their_points_are_buried() -> None:
    found = estimate(replace(BODY, inner=60.0, thin_walled=True), None, 1)
    assert found.volume == 99.0
    assert found.outline_std == pytest.approx(0.6)
    found = estimate(replace(BODY, inner=60.0, thin_walled=True, buried=10.0), None, 1)
    assert found.volume == pytest.approx(99.0 - 8.5)
    of_sheet = 0.6 * (2.0 * 10.0 / 99.0) ** 4 * 90.5
    assert found.outline_std == pytest.approx(np.linalg.norm([1.5, 0.6, of_sheet]))
    sheet = estimate(replace(BODY, thin_walled=True, buried=49.5), None, 1)
    assert sheet.volume < 1.96 * sheet.outline_std


def test_what_is_too_narrow_for_the_points_is_added_and_taken_away_in_part() -> None:
    found = estimate(replace(BODY, walls=4.0), None, 1)
    assert found.volume == pytest.approx(99.0 + 3.0)
    assert found.sampling_std == pytest.approx(1.4)
    found = estimate(replace(BODY, clefts=4.0), None, 1)
    assert found.volume == pytest.approx(99.0 - 2.0)
    assert found.sampling_std == pytest.approx(1.4)
    sheet = estimate(replace(BODY, walls=4.0, sheets=1.0), None, 1)
    assert sheet.volume == pytest.approx(99.0 + 1.5)
    assert sheet.sampling_std == pytest.approx(np.hypot(1.4, 1.5))


def test_other_walls_tell_nothing() -> None:
    assert is_same_body(BODY, replace(BODY, within=98.0))
    assert not is_same_body(BODY, replace(BODY, within=60.0))
    assert not is_same_body(BODY, replace(BODY, thin_walled=True))


@pytest.mark.parametrize(
    ("near", "rows", "grid"),
    [
        ((0.94, 0.955, 0.953, 0.067), 1.0, 0.0),  # means of voxels along the faces of a cube
        ((0.85, 0.903, 0.919, 0.026), 0.0, 0.0),  # of voxels that surfaces pass through
        ((0.918, 0.914, 0.905, 0.046), 0.0, 0.0),  # a least distance apart
        ((0.95, 0.94, 0.988, 0.796), 1.0, 1.0),  # grids
        ((2 / 3, 4 / 5, 6 / 7, 0.01), 0.0, 0.0),  # at random
    ],
)
def test_means_of_voxels_along_faces_are_nearly_a_grid(
    near: tuple[float, float, float, float], rows: float, grid: float
) -> None:
    assert is_in_rows(Nearness(*near, 0.1)) == rows
    assert is_on_grid(Nearness(*near, 0.1)) == grid


@pytest.mark.parametrize(
    ("near", "of_mesh"),
    [
        ((0.847, 0.836, 0.909, 0.02, 0.41), 1.0),  # vertices of public meshes: homer
        ((0.814, 0.870, 0.897, 0.02, 0.34), 1.0),  # nefertiti
        ((0.971, 0.984, 0.988, 0.25, 0.10), 1.0),  # armadillo
        ((2 / 3, 4 / 5, 6 / 7, 0.01, 0.52), 0.0),  # at random
        ((0.814, 0.901, 0.916, 0.02, 0.21), 0.0),  # means of voxels
        ((0.920, 0.912, 0.905, 0.05, 0.07), 0.0),  # a least distance apart
        ((0.797, 0.676, 0.825, 0.02, 0.18), 0.0),  # in lines
        ((0.709, 0.606, 0.945, 0.08, 0.66), 0.0),  # vertices of marching cubes
    ],
)
def test_vertices_of_meshes_are_told_by_how_far_their_neighbours_are(
    near: tuple[float, float, float, float, float], of_mesh: float
) -> None:
    assert is_of_mesh(Nearness(*near)) == of_mesh
