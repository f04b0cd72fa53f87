"""Sections and the volumes between them agree with closed forms, and with each other."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from solids import even_vectors

from quantify_client.volcalc.body import sections, tetrahedra
from quantify_client.volcalc.body.sections import surface_of
from quantify_client.volcalc.body.tetrahedra import tetrahedralize

LEVEL = 160.0
"""Elevation of the middle of the bodies; sections see x and y relative to the body, z not."""

UP = np.array([0.0, 0.0, LEVEL])
RING, TUBE = 0.35, 0.15


def ceiling_of(space, inside):
    """Tetrahedra whose middles are inside are body, whatever their height."""
    middle = space.points[space.corners].mean(axis=1)
    return np.append(np.where(inside(middle), np.inf, -np.inf), -np.inf)


def everything(space):
    return ceiling_of(space, lambda middle: np.full(len(middle), True))


@pytest.fixture
def cube(monkeypatch):
    """The unit cube, its corners exactly where they are, about `LEVEL`."""
    monkeypatch.setattr(tetrahedra, "_JOGGLE", 0.0)
    corners = np.stack(np.meshgrid([0, 1], [0, 1], [0, 1]), axis=-1).reshape(-1, 3) * 1.0
    return tetrahedralize(np.vstack([corners, [0.4, 0.5, 0.6]]) + UP - [0, 0, 0.5])


@cache
def ball(upto=np.inf):
    """6,000 points evenly on a sphere of diameter 1; the body ends at an elevation."""
    space = tetrahedralize(0.5 * even_vectors(6000) + UP)
    return surface_of(space, np.minimum(everything(space), upto))


@cache
def torus(standing):
    """A torus that lies, or stands with its axis along y."""
    around, across = np.meshgrid(np.arange(150), np.arange(64), indexing="ij")
    around = (around + 0.5 * (across % 2)).ravel() * 2 * np.pi / 150
    across = across.ravel() * 2 * np.pi / 64
    away = RING + TUBE * np.cos(across)
    points = np.column_stack([away * np.cos(around), away * np.sin(around), TUBE * np.sin(across)])
    turn = Rotation.from_euler("x", 90 if standing else 0, degrees=True).as_matrix()
    space = tetrahedralize(points @ turn.T + UP)

    def inside(middle):
        x, y, z = ((middle - UP) @ turn).T
        return (np.hypot(x, y) - RING) ** 2 + z**2 < TUBE**2

    return surface_of(space, ceiling_of(space, inside))


@cache
def crumbs(seed, share):
    """A random choice of the tetrahedra of random points, and their volume."""
    rng = np.random.default_rng(seed)
    space = tetrahedralize(rng.normal(size=(40, 3)) + UP)
    chosen = rng.random(space.around + 1) < share
    chosen[-1] = False
    chosen[0] = True
    surface = surface_of(space, np.where(chosen, np.inf, -np.inf))
    return surface, float(space.volume[chosen].sum())


def shoelace(ring):
    x, y = ring.T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def rings_at(surface, level):
    """Signed areas of the outlines, the largest first; checks that they are closed."""
    rings = surface.outlines(level)
    areas = sorted(map(shoelace, rings), reverse=True)
    assert sum(areas) == pytest.approx(surface.areas(np.array([level]))[0], rel=1e-9, abs=1e-12)
    return areas


# --- closed forms


def test_every_section_of_a_cube_is_its_base(cube):
    surface = surface_of(cube, everything(cube))
    assert (surface.lowest, surface.highest) == (LEVEL - 0.5, LEVEL + 0.5)
    heights = np.array([1e-9, 0.1, 0.5, 0.6, 0.9, 1 - 1e-9])
    levels = surface.lowest + heights
    np.testing.assert_allclose(surface.areas(levels), 1.0, rtol=1e-12)
    np.testing.assert_allclose(surface.volume_below(levels), heights, rtol=1e-6, atol=1e-13)
    assert surface.volume() == pytest.approx(1.0, rel=1e-12)
    assert rings_at(surface, LEVEL) == pytest.approx([1.0], rel=1e-12)


def test_above_and_below_a_body_there_is_nothing(cube):
    surface = surface_of(cube, everything(cube))
    levels = LEVEL + np.array([-9.0, -0.6, 0.6, 9.0])
    assert surface.areas(levels).tolist() == [0.0] * 4
    np.testing.assert_allclose(surface.volume_below(levels), [0, 0, 1, 1], atol=1e-12)
    assert surface.outlines(LEVEL + 9.0) == []


def test_water_in_a_body_is_cut_at_its_level(cube):
    surface = surface_of(cube, np.where(everything(cube) > 0, LEVEL - 0.1, -np.inf))
    assert surface.highest == LEVEL - 0.1
    assert surface.volume() == pytest.approx(0.4, rel=1e-12)
    levels = LEVEL + np.array([-0.3, -0.11, -0.09, 0.3])
    np.testing.assert_allclose(surface.areas(levels), [1, 1, 0, 0], atol=1e-12)


def test_water_on_a_body_adds_what_it_covers(cube):
    # Body and water share faces: nothing counts twice, whichever tetrahedra are which.
    for body in range(1, cube.around):
        ceiling = np.full(cube.around + 1, LEVEL)
        ceiling[:body], ceiling[-1] = np.inf, -np.inf
        surface = surface_of(cube, ceiling)
        assert surface.volume_below(np.array([LEVEL]))[0] == pytest.approx(0.5, rel=1e-12)
        assert surface.areas(np.array([LEVEL - 0.2]))[0] == pytest.approx(1.0, rel=1e-12)


def test_sections_of_a_pyramid_shrink_with_the_square_of_height(monkeypatch):
    monkeypatch.setattr(tetrahedra, "_JOGGLE", 0.0)
    base = np.array([(0, 0), (6, 0), (6, 6), (0, 6)])
    points = np.vstack([np.column_stack([base, np.zeros(4)]), [1, 5, 3], [3, 3, 0.5]])
    space = tetrahedralize(points)
    surface = surface_of(space, everything(space))
    up = np.array([0.25, 0.5, 1.0, 2.0, 2.75])
    np.testing.assert_allclose(surface.areas(up), 36 * (1 - up / 3) ** 2, rtol=1e-12)
    np.testing.assert_allclose(surface.volume_below(up), 36 * (1 - (1 - up / 3) ** 3), rtol=1e-12)


def test_sections_of_a_ball_are_discs():
    up = np.linspace(-0.45, 0.45, 19)
    np.testing.assert_allclose(ball().areas(LEVEL + up), np.pi * (0.25 - up**2), rtol=0.005)
    cap = np.pi * (0.5 + up) ** 2 * (1.0 - up) / 3
    np.testing.assert_allclose(ball().volume_below(LEVEL + up), cap, rtol=0.005, atol=2e-4)
    for z in LEVEL + up[::6]:
        assert len(rings_at(ball(), z)) == 1


@pytest.mark.parametrize("up", [-0.1, 0.001, 0.1])
def test_sections_of_a_lying_torus_are_rings(up):
    half = np.sqrt(TUBE**2 - up**2)
    outer, inner = np.pi * (RING + half) ** 2, -np.pi * (RING - half) ** 2
    assert rings_at(torus(False), LEVEL + up) == pytest.approx([outer, inner], rel=0.01)


def test_sections_of_a_standing_torus_are_two_discs_where_its_hole_is():
    assert rings_at(torus(True), LEVEL + 0.01) == pytest.approx(2 * [np.pi * TUBE**2], rel=0.01)
    assert len(rings_at(torus(True), LEVEL + 0.4)) == 1


@pytest.mark.parametrize("standing", [False, True])
def test_the_volume_of_a_torus(standing):
    truth = 2 * np.pi**2 * RING * TUBE**2
    assert torus(standing).volume() == pytest.approx(truth, rel=0.005)


@pytest.mark.parametrize("standing", [False, True])
def test_the_surface_area_of_a_torus(standing):
    assert torus(standing).area() == pytest.approx(4 * np.pi**2 * RING * TUBE, rel=0.01)


def test_the_surface_area_of_a_ball_and_of_one_filled_with_water():
    assert ball().area() == pytest.approx(np.pi, rel=0.005)
    # A cap of height 0.6, and the water's own surface.
    cap = np.pi * 0.6 + np.pi * (0.25 - 0.1**2)
    assert ball(LEVEL + 0.1).area() == pytest.approx(cap, rel=0.005)


# --- what holds for any body

SEEDS = {"seed": st.integers(0, 500), "share": st.sampled_from([0.1, 0.5, 1.0])}


@given(**SEEDS)
@settings(max_examples=30)
def test_the_volume_is_the_sum_of_the_tetrahedra(seed, share):
    surface, volume = crumbs(seed, share)
    assert surface.volume() == pytest.approx(volume, rel=1e-10)
    levels = np.linspace(surface.lowest - 0.1, surface.highest + 0.1, 50)
    below = surface.volume_below(levels)
    assert np.all(np.diff(below) > -1e-12)
    assert below[0] == pytest.approx(0.0, abs=1e-12)
    assert below[-1] == pytest.approx(volume, rel=1e-10)


@given(**SEEDS)
@settings(max_examples=30)
def test_the_volume_grows_by_the_area(seed, share):
    surface, _ = crumbs(seed, share)
    # Between corners the area is of second degree: Gauss' rule of two points is exact.
    edges = np.unique(surface.corners[:, :, 2])
    half, middle = np.diff(edges) / 2, (edges[1:] + edges[:-1]) / 2
    gauss = sum(surface.areas(middle + sign * half / np.sqrt(3)) for sign in (-1, 1)) * half
    np.testing.assert_allclose(np.diff(surface.volume_below(edges)), gauss, rtol=1e-7, atol=1e-11)


@given(**SEEDS, at=st.floats(0.01, 0.99))
@settings(max_examples=30)
def test_the_outlines_enclose_the_section(seed, share, at):
    surface, _ = crumbs(seed, share)
    rings_at(surface, surface.lowest + at * (surface.highest - surface.lowest))


@pytest.mark.parametrize("body", [ball, lambda: torus(False), lambda: torus(True)])
def test_outlines_are_closed(body):
    surface = body()
    for ring in surface.outlines(LEVEL + 0.03):
        # A way that ends elsewhere would be closed by one long step.
        steps = np.linalg.norm(ring - np.roll(ring, 1, axis=0), axis=1)
        assert steps.max() < 0.05


@given(seed=st.integers(0, 500), ground=st.floats(-0.5, 0.5))
@settings(max_examples=20)
def test_a_body_and_what_is_left_around_it_fill_the_space(seed, ground):
    rng = np.random.default_rng(seed)
    space = tetrahedralize(rng.normal(size=(40, 3)) + UP)
    one = np.where(rng.random(space.around + 1) < 0.5, np.inf, LEVEL + ground)
    one[-1] = -np.inf
    # Up to its ceiling each tetrahedron is body; all of them up to `ground` at least.
    whole = surface_of(space, everything(space))
    surface = surface_of(space, one)
    at = np.array([LEVEL + ground])
    np.testing.assert_allclose(surface.volume_below(at), whole.volume_below(at), rtol=1e-10)
    np.testing.assert_allclose(surface.areas(at - 0.1), whole.areas(at - 0.1), rtol=1e-9)


def test_triangles_in_blocks_sum_to_all_of_them(monkeypatch):
    levels = LEVEL + np.linspace(-0.5, 0.5, 12)
    surface = torus(True)
    whole = (surface.volume(), surface.area(), surface.volume_below(levels), surface.areas(levels))
    monkeypatch.setattr(sections, "_BLOCK", 1000)
    parts = (surface.volume(), surface.area(), surface.volume_below(levels), surface.areas(levels))
    for one, other in zip(whole, parts):
        np.testing.assert_allclose(other, one, rtol=1e-9, atol=1e-12)
