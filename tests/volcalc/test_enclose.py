"""The body behind a surface: its volume, its skin, its hollows, and surfaces that enclose none."""

from functools import cache

import numpy as np
import pytest
from scans import OFFSET, Flaws, scan
from solids import BODIES, box_part, cup, hollow_ball, sphere

from quantify_client.volcalc.body.enclose import Enclosed, Open, enclose

SPHERE, HOLLOW_BALL, CUP = sphere(), hollow_ball(), cup(inner=0.3, floor=0.2)
BESIDE = np.array([2.0, 0.0, 0.0])


@cache
def scanned(body, count, **flaws):
    return scan(body, count, 3, Flaws(**flaws)) - OFFSET


@cache
def enclosed(body, count, hollow=False, max_gap=None, **flaws):
    found = enclose(scanned(body, count, **flaws), hollow=hollow, max_gap=max_gap)
    assert isinstance(found, Enclosed)
    assert found.within == pytest.approx(found.surface.volume(), rel=1e-9)
    return found


@pytest.mark.parametrize("name", ["sphere", "cube, rotated", "torus, lying", "four legs"])
def test_volumes_of_known_bodies(name):
    body = SPHERE if name == "sphere" else BODIES[name]()
    found = enclosed(body, 5000)
    # Chords cut corners and bulges: all the lower, the fewer the points.
    assert found.within == pytest.approx(body.volume, rel=0.013)
    assert (found.water, found.voids) == (pytest.approx(0.0, abs=1e-9), 0.0)
    assert not found.gaps
    assert not found.thin_walled


def test_the_error_falls_with_the_number_of_points():
    errors = [abs(enclosed(SPHERE, n).within / SPHERE.volume - 1) for n in (1250, 5000)]
    assert errors[1] < 0.5 * errors[0]


@pytest.mark.parametrize("noise", [0.005, 0.01])
def test_the_skin_is_as_thick_as_the_noise(noise):
    found, clean = enclosed(SPHERE, 5000, noise=noise), enclosed(SPHERE, 5000)
    assert found.within == pytest.approx(SPHERE.volume, rel=0.03)
    # About two sigma on either side.
    thick, thin = ((one.outer + one.inner) / SPHERE.area for one in (found, clean))
    assert noise < thick < 6 * noise
    assert thin < 0.0005


@pytest.mark.parametrize("thickness", [0.0, 0.02, 0.03])
def test_a_wall_that_the_points_do_not_enclose_is_told_by_how_thick_it_is(thickness):
    rng = np.random.default_rng(2)
    sides = np.column_stack([np.full(600, 0.75), *rng.uniform(-0.2, 0.2, (2, 600))])
    sides[:, 0] += rng.choice([-0.5, 0.5], 600) * thickness
    found = enclose(np.vstack([scanned(SPHERE, 5000), sides]), hollow=False, max_gap=None)
    assert len(found.apart) == 600
    assert found.walls == pytest.approx(0.4**2 * thickness, rel=0.2, abs=1e-4)
    assert found.clefts < 1e-4
    for noise, least in ((0.0, 1e-4), (0.01, 1e-3)):
        whole = enclosed(SPHERE, 5000, noise=noise)
        assert whole.walls + whole.clefts < least * SPHERE.volume


def test_noise_of_a_single_sheet_may_be_no_wall():
    rng = np.random.default_rng(2)
    sheet = np.column_stack([np.full(600, 0.75), *rng.uniform(-0.2, 0.2, (2, 600))])
    sheet += 0.01 * rng.standard_normal(sheet.shape)
    ball = scanned(SPHERE, 5000, noise=0.01)
    found = enclose(np.vstack([ball, sheet]), hollow=False, max_gap=None)
    assert found.walls > 0.003  # 2 sigma of 0.16 m2
    assert found.sheets > 0.5


@pytest.mark.parametrize("hollow", [False, True])
def test_a_void_is_body_unless_hollow(hollow):
    found = enclosed(HOLLOW_BALL, 5000, hollow)
    truth = HOLLOW_BALL.hollow if hollow else HOLLOW_BALL.volume
    assert found.within == pytest.approx(truth, rel=0.01)
    assert found.voids == pytest.approx(HOLLOW_BALL.volume - HOLLOW_BALL.hollow, rel=0.02)


@pytest.mark.parametrize("hollow", [False, True])
def test_a_cup_is_full_unless_hollow(hollow):
    found = enclosed(CUP, 5000, hollow)
    assert found.within == pytest.approx(CUP.hollow if hollow else CUP.volume, rel=0.015)
    water = 0.0 if hollow else CUP.volume - CUP.hollow
    assert found.water == pytest.approx(water, rel=0.03, abs=1e-9)


def test_walls_thinner_than_the_points_are_far_apart_are_walls_all_the_same():
    thin = cup(inner=0.46, floor=0.04)
    full, empty = enclosed(thin, 6000), enclosed(thin, 6000, hollow=True)
    assert full.thin_walled
    assert full.within == pytest.approx(thin.volume, rel=0.02)
    assert empty.within == pytest.approx(thin.hollow, rel=0.25)


@pytest.mark.parametrize("surface", ["half a ball", "a sheet", "a tray"])
def test_an_open_surface_encloses_nothing(surface):
    if surface == "half a ball":
        points = scanned(SPHERE, 4000)
        points = points[points[:, 2] < 0]
    else:
        points = box_part((0, 0, 0), (1, 1, 0.3)).surface(4000, np.random.default_rng(0))
        points = points[points[:, 2] == 0] if surface == "a sheet" else points[points[:, 2] < 0.3]
        points = points + 0.001 * np.random.default_rng(1).normal(size=points.shape)
    found = enclose(points, hollow=False, max_gap=None)
    assert isinstance(found, Open)
    assert not found.leaks


def test_a_hole_is_closed_and_told():
    found = enclosed(SPHERE, 4000, hole=0.2)
    assert found.within == pytest.approx(SPHERE.volume, rel=0.01)
    assert [gap.width for gap in found.gaps] == pytest.approx([0.2], rel=0.15)
    assert not found.leaks


def test_a_hole_wider_than_allowed_leaks():
    found = enclose(scanned(SPHERE, 4000, hole=0.2), hollow=False, max_gap=0.1)
    assert isinstance(found, Open)
    assert found.leaks[0].width == pytest.approx(0.2, rel=0.15)


def test_a_leaking_body_beside_a_closed_one_is_not_counted():
    points = scanned(SPHERE, 3000, hole=0.3)
    points = np.vstack([points, scanned(SPHERE, 3000) + BESIDE])
    found = enclose(points, hollow=False, max_gap=0.15)
    assert found.within == pytest.approx(SPHERE.volume, rel=0.01)
    assert found.leaks
    assert not found.gaps


@pytest.mark.parametrize("scale", [2.0**-10, 2.0**10])
def test_a_body_of_another_size_is_the_same_body(scale):
    one = enclosed(SPHERE, 3000)
    other = enclose(scanned(SPHERE, 3000) * scale, hollow=False, max_gap=None)
    assert other.within == pytest.approx(one.within * scale**3, rel=1e-9)
    assert other.spacing == pytest.approx(one.spacing * scale, rel=1e-9)
