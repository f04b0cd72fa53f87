"""Closed bodies whose volumes are known, measured: what `--shape object` promises.

The seeds here are none that a threshold was chosen on.
"""

from __future__ import annotations

import math
from typing import Optional

import numpy as np
import pytest
from scans import OFFSET, Flaws, scan, volume_of
from scipy.spatial import ConvexHull, cKDTree
from solids import (
    BODIES,
    BUNNY,
    NO_BUNNY,
    ball_part,
    box_part,
    bunny_mesh,
    random_body,
    union_volume,
    water_share,
)

from quantify_client.types import AreaResult

# Bodies as a command measures them run on every Python in test_body_command.py.
pytestmark = pytest.mark.one_python

FEW, MANY = 4_000, 25_000
SAMPLE = 20_000  # of the bodies themselves
NEEDS_BUNNY = pytest.mark.skipif(not BUNNY.exists(), reason=NO_BUNNY)
ALL = [pytest.param(n, marks=NEEDS_BUNNY if n == "bunny" else ()) for n in BODIES]


def error_of(result: AreaResult, truth: float) -> float:
    """Percent."""
    error = 100 * (result.volume_m3 / truth - 1)
    print(f"{error:+.3f} %, std {100 * (result.std_m3 or 0) / truth:.3f} %, {result.warnings}")
    return abs(error)


def limit(name: str, count: int) -> float:
    """Percent, for a clean cloud."""
    if count >= MANY:
        return 1.0 if name in ("cup", "bunny", "hollow ball") else 0.5
    return 3.0 if name in ("cup", "hollow ball") else 2.0


# --- clean clouds


@pytest.mark.parametrize("name", ALL)
def test_volume_from_few_points(name: str) -> None:
    body = BODIES[name]()
    result = volume_of(scan(body, FEW, seed=1001))
    assert error_of(result, body.volume) < limit(name, FEW)


@pytest.mark.parametrize("name", ["cube, rotated", "four legs"])
def test_volume_from_many_points(name: str) -> None:
    body = BODIES[name]()
    result = volume_of(scan(body, MANY, seed=1002))
    assert error_of(result, body.volume) < limit(name, MANY)


@NEEDS_BUNNY
def test_volume_of_the_bunny_from_many_points() -> None:
    result = volume_of(scan(BODIES["bunny"](), MANY, seed=1003))
    assert error_of(result, 0.20008) < 1.0


@pytest.mark.parametrize(
    ("name", "count"),
    # Walls must be some points thick for their two sides to be told apart.
    [
        ("cup", 15_000),
        ("cup", MANY),
        ("hollow ball", 10_000),
    ],
)
def test_voids_are_left_out_where_asked(name: str, count: int) -> None:
    body = BODIES[name]()
    result = volume_of(scan(body, count, seed=1004), hollow=True)
    assert body.hollow is not None
    assert error_of(result, body.hollow) < limit(name, count)


@pytest.mark.parametrize("name", ["torus, lying", "four legs"])
def test_hollow_changes_nothing_where_there_is_no_void(name: str) -> None:
    points = scan(BODIES[name](), 8_000, seed=1005)
    hollow = volume_of(points, hollow=True)
    assert hollow.volume_m3 == pytest.approx(volume_of(points).volume_m3, rel=1e-3)


# --- clouds as they come

NOISE, OUTLIERS, GRADIENT = Flaws(noise=0.01), Flaws(outliers=0.01), Flaws(gradient=10.0)
FLAWS = {"noise": NOISE, "outliers": OUTLIERS, "gradient": GRADIENT}


@pytest.mark.parametrize("flaws", FLAWS.values(), ids=FLAWS)
@pytest.mark.parametrize("name", ["sphere", "L-prism", "torus, standing"])
def test_flaws_of_clouds(name: str, flaws: Flaws) -> None:
    body = BODIES[name]()
    result = volume_of(scan(body, FEW, seed=1011, flaws=flaws))
    assert error_of(result, body.volume) < 1.5


@NEEDS_BUNNY
@pytest.mark.parametrize("flaws", FLAWS.values(), ids=FLAWS)
def test_flaws_of_clouds_of_the_bunny(flaws: Flaws) -> None:
    # Its ears are thin: with half as many points noise fills them.
    result = volume_of(scan(BODIES["bunny"](), 20_000, seed=1012, flaws=flaws))
    assert error_of(result, 0.20008) < 1.5


def test_strays_are_counted() -> None:
    result = volume_of(scan(BODIES["cube"](), 10_000, seed=1013, flaws=OUTLIERS))
    # 100 in a box eight times the cube: 12 within it, of which some lie next to its faces.
    left_out = sum(result.points_left_out.values())
    assert 75 < left_out <= 130
    assert result.points_used + left_out == 10_000 + 100


@pytest.mark.parametrize("name", ["sphere", "cube", "torus, lying"])
def test_a_hole_of_a_fifth_is_closed(name: str) -> None:
    body = BODIES[name]()
    result = volume_of(scan(body, FEW, seed=1021, flaws=Flaws(hole=0.2)))
    assert error_of(result, body.volume) < 3.0


# --- where it stands

ON_GROUND = 3_000  # of the body; the ground around has twice as many and more


@pytest.mark.parametrize("tilt", [0.0, 12.0])
@pytest.mark.parametrize("floor", ["auto", "plane"])
def test_a_sphere_without_its_lowest_tenth_stands_on_the_ground(floor: str, tilt: float) -> None:
    flaws = Flaws(missing=0.1, ground=2.5, tilt=tilt)
    result = volume_of(scan(BODIES["sphere"](), ON_GROUND, seed=1031, flaws=flaws), floor=floor)
    assert error_of(result, BODIES["sphere"]().volume) < 3.0


def test_a_noisy_scan_of_a_sphere_with_its_ground() -> None:
    flaws = Flaws(noise=0.005, outliers=0.005, missing=0.1, ground=2.5, tilt=5.0)
    result = volume_of(scan(BODIES["sphere"](), ON_GROUND, seed=1032, flaws=flaws))
    assert error_of(result, BODIES["sphere"]().volume) < 3.0


def test_a_sphere_without_its_lowest_third_is_measured_with_a_warning() -> None:
    flaws = Flaws(missing=0.3, ground=2.5)
    result = volume_of(scan(BODIES["sphere"](), ON_GROUND, seed=1033, flaws=flaws))
    assert error_of(result, BODIES["sphere"]().volume) < 10.0
    assert result.warnings


@pytest.mark.parametrize("floor", ["auto", OFFSET[2]])
def test_a_cube_on_the_ground_without_its_underside(floor: Optional[str]) -> None:
    flaws = Flaws(missing=0.01, ground=2.5)
    result = volume_of(scan(BODIES["cube"](), ON_GROUND, seed=1034, flaws=flaws), floor=floor)
    assert error_of(result, 1.0) < 2.0


@pytest.mark.parametrize("name", ["four legs", "cup"])
def test_a_whole_body_keeps_its_faces_that_are_flat(name: str) -> None:
    """A table's top, or a cup's bottom, is not taken for ground."""
    body = BODIES[name]()
    points = scan(body, 6_000, seed=1035)
    auto, none = (volume_of(points, floor=floor).volume_m3 for floor in ("auto", "none"))
    assert auto == pytest.approx(none, rel=0.005)


# --- the bodies themselves


@pytest.mark.parametrize("name", ALL)
def test_points_lie_evenly_on_an_area_as_large_as_stated(name: str) -> None:
    body = BODIES[name]()
    points = scan(body, SAMPLE, seed=1041) - OFFSET
    radius = math.sqrt(40 * body.area / SAMPLE / math.pi)
    neighbours = cKDTree(points).query_ball_point(points[:4000], radius, return_length=True)
    assert np.median(neighbours) == pytest.approx(41, abs=2.5)


def test_convex_bodies_fill_their_hulls() -> None:
    for name in ("cube", "cube, rotated", "sphere", "cup", "hollow ball"):
        body = BODIES[name]()
        hull = ConvexHull(scan(body, SAMPLE, seed=1042) - OFFSET)
        assert hull.volume == pytest.approx(body.volume, rel=0.005)


def test_volumes_of_unions_by_random_points() -> None:
    boxes = [box_part((0, 0, 0), (1, 0.5, 0.3)), box_part((0, 0, 0.2), (0.3, 0.5, 1))]
    volume, std = union_volume(boxes)
    assert volume == pytest.approx(0.255, abs=6 * std)
    assert std < 0.0005 * volume
    balls = [ball_part(0.3, (0, 0, 0)), ball_part(0.3, (0.3, 0.1, 0))]
    apart = math.hypot(0.3, 0.1)
    lens = math.pi * (1.2 + apart) * (0.6 - apart) ** 2 / 12
    volume, std = union_volume(balls)
    assert volume == pytest.approx(2 * balls[0].volume - lens, abs=6 * std)


def test_random_bodies_differ_and_hold_no_water() -> None:
    assert random_body(1043, 50_000).volume != random_body(1044, 50_000).volume
    assert random_body(1043, 50_000) is random_body(1043, 50_000)
    wall, floor = ((0, 0, 0), (0.1, 1, 0.6)), ((0, 0, 0), (1, 1, 0.1))
    other = [((0.9, 0, 0), (1, 1, 0.5)), ((0, 0, 0), (1, 0.1, 0.6)), ((0, 0.9, 0), (1, 1, 0.6))]
    tub = [box_part(*corners) for corners in (wall, floor, *other)]
    # Up to the lower rim: 0.8 x 0.8 x 0.4 of water.
    assert water_share(tub) == pytest.approx(0.256 / union_volume(tub)[0], rel=0.15)
    assert water_share(tub[1:]) == 0.0


def test_flaws_are_what_they_say() -> None:
    sphere = BODIES["sphere"]()
    denser = scan(sphere, SAMPLE, seed=1045, flaws=GRADIENT) - OFFSET
    assert len(denser) == SAMPLE
    # Equal bands of x have equal areas on a sphere.
    counts, _ = np.histogram(denser[:, 0], [-0.5, -0.4, 0.4, 0.5])
    assert counts[0] / counts[2] == pytest.approx(10**0.9, rel=0.1)
    noisy = np.linalg.norm(scan(sphere, SAMPLE, seed=1046, flaws=NOISE) - OFFSET, axis=1)
    assert np.std(noisy) == pytest.approx(0.01, rel=0.05)
    strays = np.abs(scan(sphere, SAMPLE, seed=1047, flaws=OUTLIERS) - OFFSET)
    off = np.abs(np.linalg.norm(strays, axis=1) - 0.5) > 1e-6
    assert np.count_nonzero(off) == 200
    assert 0.98 < strays.max() < 1.0
    ground = scan(sphere, SAMPLE, seed=1048, flaws=Flaws(missing=0.1, ground=2.5)) - OFFSET
    low = ground[ground[:, 2] < -0.4 - 1e-9]
    assert np.ptp(low[:, 2]) < 1e-6
    assert np.ptp(low[:, 0]) == pytest.approx(2.5, rel=0.01)
    # The sphere is cut where it is 0.3 from its axis; nothing is seen beneath.
    assert 0.29 < np.hypot(low[:, 0], low[:, 1]).min() < 0.34


@NEEDS_BUNNY
def test_the_bunny_closed_flat_has_the_volume_stated() -> None:
    corners, faces = bunny_mesh()
    a, b, c = (corners[faces[:, i]] for i in range(3))
    volume = np.einsum("ij,ij->", a, np.cross(b, c)) / 6
    sides = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    seen = set(map(tuple, sides.tolist()))
    after = {b: a for a, b in seen if (b, a) not in seen}
    holes = 0
    while after:
        ring = [next(iter(after))]
        while ring[-1] in after:
            ring.append(after.pop(ring[-1]))
        rim = corners[ring]
        middle = rim[:-1].mean(axis=0)
        volume += float(np.cross(rim[:-1], rim[1:]).sum(axis=0) @ middle) / 6
        holes += 1
    assert holes == 5
    assert volume == pytest.approx(0.20008, abs=1e-5)
