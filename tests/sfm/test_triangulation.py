"""Picks -> points: exact where the picks are, else as accurate as promised, or refused."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any, Dict, List, Sequence

import numpy as np
import pytest
from odm_photos import CAMERAS, NAME, SITE, camera_entry, feature, flight, picks_of, write_shots

from quantify_client.errors import ControlError, UsageError
from quantify_client.scaler.control.model import Pick
from quantify_client.sfm.photos.camera_models import Camera
from quantify_client.sfm.photos.cameras import Shots, read_shots
from quantify_client.sfm.photos.triangulate import Sighting, triangulate

TARGET = SITE + np.array([3.0, -4.0, 1.5])
DOWN = [math.pi, 0.0, 0.0]
PLAIN = Camera("c", "perspective", 4000, 3000, {"focal": 0.8})


@pytest.fixture(scope="module")
def shots(tmp_path_factory: pytest.TempPathFactory) -> Shots:
    return flight(tmp_path_factory.mktemp("odm"))


def _row(folder: Path, *offsets: Sequence[float], camera: Camera = PLAIN) -> Shots:
    """Photographs straight down, 100 m above the site, at offsets (east, north) from it."""
    size = {"width": camera.width, "height": camera.height, "focal": camera.parameters["focal"]}
    features = [
        feature(f"IMG_{i}.JPG", _at(*offset, 100), DOWN, **size)
        for i, offset in enumerate(offsets, start=1)
    ]
    return read_shots(*write_shots(folder, features, {NAME[3:]: camera_entry(camera)}))


def _at(east: float, north: float, up: float) -> np.ndarray:
    return SITE + np.array([east, north, up])


def _moved(picks: List[Pick], index: int, dx: float, dy: float) -> List[Pick]:
    pick = picks[index]
    return [*picks[:index], replace(pick, px=pick.px + dx, py=pick.py + dy), *picks[index + 1 :]]


def _refused(shots: Shots, picks: Sequence[Pick], message: str) -> str:
    with pytest.raises(ControlError, match=message) as caught:
        triangulate(shots, picks)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def _std(sighting: Sighting) -> np.ndarray:
    return np.sqrt(np.diag(sighting.covariance))


# -- exact picks ----------------------------------------------------------------------------------


def test_a_point_by_hand(tmp_path: Path) -> None:
    """East 10, north 20 of the site, on its level, by the formulas on paper."""
    shots = _row(tmp_path, (0, 0), (30, 0), (30, 40))
    picks = [
        Pick("A", "IMG_1.JPG", 0.8 * 0.1 * 4000 + 1999.5, -0.8 * 0.2 * 4000 + 1499.5),
        Pick("A", "IMG_2.JPG", -0.8 * 0.2 * 4000 + 1999.5, -0.8 * 0.2 * 4000 + 1499.5),
        Pick("A", "IMG_3.JPG", -0.8 * 0.2 * 4000 + 1999.5, 0.8 * 0.2 * 4000 + 1499.5),
    ]
    sighting = triangulate(shots, picks)["A"]
    assert sighting.xyz == pytest.approx(tuple(_at(10, 20, 0)), abs=1e-7)
    assert sighting.rms_px < 1e-6
    assert sighting.warnings == ()


@pytest.mark.parametrize("name", sorted(CAMERAS))
@pytest.mark.parametrize("most", [2, 5])
def test_exact_picks_give_the_point_back(name: str, most: int, tmp_path: Path) -> None:
    shots = flight(tmp_path, CAMERAS[name])
    sighting = triangulate(shots, picks_of(shots, "A", TARGET, most, seed=2))["A"]
    assert sighting.xyz == pytest.approx(tuple(TARGET), abs=1e-6)
    assert len(sighting.picks) == most
    assert max(pick.residual_px for pick in sighting.picks) < 1e-4


def test_a_point_on_the_seam_of_a_sphere(tmp_path: Path) -> None:
    """It is at the left edge of one photograph and at the right edge of the other."""
    camera = CAMERAS["spherical"]
    upright = [math.pi / 2, 0, 0]  # x east, y down, z north
    size = {"width": 4000, "height": 2000, "focal": None}
    features = [
        feature("L.JPG", _at(-0.1, 9, 1), upright, **size),
        feature("R.JPG", _at(0.1, 9, 4), upright, **size),
        feature("S.JPG", _at(6, 9, 4), upright, **size),
    ]
    shots = read_shots(*write_shots(tmp_path, features, {NAME[3:]: camera_entry(camera)}))
    picks = picks_of(shots, "A", SITE, 3)
    edges = sorted(pick.px for pick in picks)
    assert edges[0] < 10
    assert edges[-1] > 3990
    # Picked a little too far, across the seam: the miss is 8 px, not 3,992.
    crossed = [replace(p, px=(p.px + 8) % 4000) if p.px > 3990 else p for p in picks]
    sighting = triangulate(shots, crossed, 10.0)["A"]
    assert max(pick.residual_px for pick in sighting.picks) < 8
    assert sighting.xyz == pytest.approx(tuple(SITE), abs=0.3)
    assert triangulate(shots, picks)["A"].xyz == pytest.approx(tuple(SITE), abs=1e-6)


def test_offset_is_picked_less_projected(tmp_path: Path) -> None:
    shots = _row(tmp_path, (0, 0), (30, 0), (0, 30), (30, 30))
    picks = _moved(picks_of(shots, "A", SITE, 4), 0, 4.0, 0.0)
    seen = triangulate(shots, picks)["A"].picks
    assert seen[0].offset[0] == pytest.approx(2.0, abs=0.6)  # half of it moves the point
    assert seen[0].residual_px == pytest.approx(math.hypot(*seen[0].offset))
    assert (seen[0].px, seen[0].py) == (picks[0].px, picks[0].py)


# -- accuracy -------------------------------------------------------------------------------------


def test_covariance_by_hand(tmp_path: Path) -> None:
    """Two photographs 60 m apart above a point: depth by the angle at which their rays meet."""
    sighting = triangulate(
        _row(tmp_path, (-30, 0), (30, 0)),
        [Pick("A", "IMG_1.JPG", 2959.5, 1499.5), Pick("A", "IMG_2.JPG", 1039.5, 1499.5)],
        0.5,
    )["A"]
    # One pixel is 100 / (0.8 * 4000) m; x and y are means of two, z comes of their difference.
    pixel = 0.5 * 100 / 3200
    expected = (pixel / math.sqrt(2), pixel / math.sqrt(2), pixel * 100 / 30 / math.sqrt(2))
    assert sighting.xyz == pytest.approx(tuple(SITE), abs=1e-7)
    assert _std(sighting) == pytest.approx(expected, rel=1e-6)
    assert sighting.sigma_px == 0.5


@pytest.mark.one_python
@pytest.mark.parametrize("name", sorted(CAMERAS))
def test_errors_are_as_large_as_promised(name: str, tmp_path: Path) -> None:
    """Points picked with 0.5 px in two to six photographs: errors against their covariance."""
    shots = flight(tmp_path, CAMERAS[name])
    random = np.random.default_rng(11)
    count = 500
    truth = {f"P{i}": SITE + random.uniform([-20, -20, -3], [20, 20, 3]) for i in range(count)}
    picks = [
        pick
        for i, (point, xyz) in enumerate(truth.items())
        for pick in picks_of(shots, point, xyz, 2 + i % 5, 0.5, seed=i)
    ]
    sightings = triangulate(shots, picks, 0.5)
    errors = np.array([np.array(sightings[point].xyz) - xyz for point, xyz in truth.items()])
    covariances = np.array([sightings[point].covariance for point in truth])
    std = np.sqrt(np.einsum("nii->ni", covariances))
    rms = np.sqrt(np.mean((errors / std) ** 2, axis=0))
    mahalanobis = np.einsum("ni,nij,nj->n", errors, np.linalg.inv(covariances), errors)
    assert np.all((rms > 0.9) & (rms < 1.1)), rms
    assert mahalanobis.mean() == pytest.approx(3, abs=0.4)
    assert sum(pick.outlier for s in sightings.values() for pick in s.picks) <= 1
    assert sum(bool(s.warnings) for s in sightings.values()) <= 3


@pytest.mark.one_python
def test_what_all_points_miss_by_widens_every_covariance(shots: Shots) -> None:
    """Picks of 2 px, promised as 0.5: errors are still as large as the covariance says."""
    random = np.random.default_rng(4)
    truth = {f"P{i}": SITE + random.uniform(-15, 15, 3) * [1, 1, 0.2] for i in range(200)}
    picks = [
        pick
        for i, (point, xyz) in enumerate(truth.items())
        for pick in picks_of(shots, point, xyz, 4, 2.0, seed=i)
    ]
    sightings = triangulate(shots, picks, 0.5)
    errors = np.array([np.array(sightings[point].xyz) - xyz for point, xyz in truth.items()])
    std = np.array([_std(sightings[point]) for point in truth])
    assert min(s.sigma_px for s in sightings.values()) == pytest.approx(2.0, rel=0.1)
    assert np.sqrt(np.mean((errors / std) ** 2)) == pytest.approx(1, abs=0.1)
    assert sum(pick.outlier for s in sightings.values() for pick in s.picks) <= 2


def test_covariance_is_never_below_what_was_promised(shots: Shots) -> None:
    exact = triangulate(shots, picks_of(shots, "A", TARGET, 5), 2.0)["A"]
    assert exact.sigma_px == 2.0
    twice = triangulate(shots, picks_of(shots, "A", TARGET, 5), 4.0)["A"]
    assert twice.covariance == pytest.approx(4 * exact.covariance)


def test_one_bad_point_does_not_widen_the_others(shots: Shots) -> None:
    random = np.random.default_rng(8)
    picks: List[Pick] = []
    for i in range(10):
        xyz = SITE + random.uniform(-15, 15, 3) * [1, 1, 0.2]
        picks += picks_of(shots, f"P{i}", xyz, 2, 0.5, seed=i)
    bad = _across(shots, picks_of(shots, "BAD", TARGET, 2, seed=1), 40)
    sightings = triangulate(shots, picks + bad, 0.5)
    assert max(sightings[f"P{i}"].sigma_px for i in range(10)) < 1.0
    assert sightings["BAD"].sigma_px > 10
    (warning,) = sightings["BAD"].warnings
    assert "disagree" in warning
    assert all(not pick.outlier for pick in sightings["BAD"].picks)


def _across(shots: Shots, picks: List[Pick], by: float) -> List[Pick]:
    """Move the first pick across the plane of both rays, where it spoils their meeting most."""
    first, second = (shots.by_image[pick.image] for pick in picks)
    base = first.rotation @ (second.centre - first.centre)
    across = np.array([-base[1], base[0]]) / math.hypot(base[0], base[1]) * by
    return _moved(picks, 0, float(across[0]), float(across[1]))


# -- wrong picks ----------------------------------------------------------------------------------


@pytest.mark.parametrize("off", [(25.0, 0.0), (0.0, -25.0), (-300.0, 400.0), (6.0, 6.0)])
@pytest.mark.parametrize("count", [4, 6])
def test_a_wrong_pick_is_found_by_name(shots: Shots, off: tuple, count: int) -> None:
    good = picks_of(shots, "A", TARGET, count, 0.3, seed=3)
    picks = _moved(good, 1, *off)
    sighting = triangulate(shots, picks, 0.5)["A"]
    assert [pick.outlier for pick in sighting.picks] == [i == 1 for i in range(count)]
    (warning,) = sighting.warnings
    assert f"point A: its pick in {picks[1].image} is " in warning
    assert f"{sighting.picks[1].residual_px:.1f} px from where the others meet" in warning
    assert sighting.picks[1].residual_px == pytest.approx(math.hypot(*off), abs=3)
    without = triangulate(shots, good[:1] + good[2:], 0.5)["A"]
    assert sighting.xyz == pytest.approx(without.xyz, abs=1e-6)
    assert sighting.rms_px == pytest.approx(without.rms_px, abs=1e-5)


def test_one_of_three_is_found_where_they_are_not_in_line(tmp_path: Path) -> None:
    shots = _row(tmp_path, (-20, -20), (20, -20), (0, 25))
    picks = _moved(picks_of(shots, "A", SITE, 3), 2, 30.0, -9.0)
    sighting = triangulate(shots, picks, 1.0)["A"]
    wrong = [pick.image for pick in sighting.picks if pick.outlier]
    # Moved along and across: of the three pairs only the first two meet.
    assert wrong == ["IMG_3.JPG"]
    assert sighting.xyz == pytest.approx(tuple(SITE), abs=1e-6)


def test_one_of_three_in_line_cannot_be_told(tmp_path: Path) -> None:
    """Moved along the line of flight, every two of the three meet: at three different heights."""
    shots = _row(tmp_path, (-30, 0), (0, 0), (30, 0))
    picks = _moved(picks_of(shots, "A", SITE, 3), 1, 60.0, 0.0)
    sighting = triangulate(shots, picks, 1.0)["A"]
    assert not any(pick.outlier for pick in sighting.picks)
    (warning,) = sighting.warnings
    assert "is wrong; none is left out" in warning
    assert sighting.sigma_px > 10


def test_two_wrong_picks_of_seven_do_not_hide_each_other(shots: Shots) -> None:
    picks = picks_of(shots, "A", TARGET, 7, 0.3, seed=5)
    picks = _moved(_moved(picks, 0, 60.0, -50.0), 4, 55.0, 45.0)
    sighting = triangulate(shots, picks, 0.5)["A"]
    assert [i for i, pick in enumerate(sighting.picks) if pick.outlier] == [0, 4]
    assert len(sighting.warnings) == 2


def test_two_picks_that_do_not_meet_are_said(shots: Shots) -> None:
    picks = _across(shots, picks_of(shots, "A", TARGET, 2, seed=1), 30)
    sighting = triangulate(shots, picks, 1.0)["A"]
    assert not any(pick.outlier for pick in sighting.picks)
    (warning,) = sighting.warnings
    assert re.search(r"disagree by 1[45]\.\d px \(RMS\) where 1 px per", warning)
    assert all(pick.image in warning for pick in picks)
    assert sighting.sigma_px == pytest.approx(30 / math.sqrt(2), rel=0.05)


def test_a_pick_of_something_else_that_looks_away(shots: Shots) -> None:
    """So wrong that all rays together meet nowhere in front of the cameras, or far off."""
    picks = picks_of(shots, "A", TARGET, 5, seed=4)
    wild = [replace(pick, px=10.0, py=2990.0) if i == 0 else pick for i, pick in enumerate(picks)]
    sighting = triangulate(shots, wild)["A"]
    assert sighting.picks[0].outlier
    assert sighting.xyz == pytest.approx(tuple(TARGET), abs=1e-5)


# -- what cannot be done --------------------------------------------------------------------------


def test_one_photograph_is_not_enough(shots: Shots) -> None:
    picks = picks_of(shots, "A", TARGET, 1)
    text = _refused(shots, picks, "point A is picked in one photograph only")
    assert f"({picks[0].image}); expected two or more" in text


def test_photographs_that_the_project_does_not_have(shots: Shots) -> None:
    known = picks_of(shots, "A", TARGET, 2)
    gone = Pick("A", "GONE.JPG", 5.0, 5.0)
    sighting = triangulate(shots, [gone, *known])["A"]
    assert len(sighting.picks) == 2
    (warning,) = sighting.warnings
    assert f"the photograph GONE.JPG is not in {shots.label}" in warning
    text = _refused(shots, [gone, known[0]], "which does not have GONE.JPG")
    assert shots.label in text
    assert f"in one photograph only ({known[0].image})" in text
    _refused(shots, [gone], "is picked in no photograph of .* which does not have GONE.JPG")


def test_names_are_found_in_any_case_and_folder(shots: Shots) -> None:
    picks = picks_of(shots, "A", TARGET, 3)
    named = [replace(pick, image=f"images/{pick.image.lower()}") for pick in picks]
    assert triangulate(shots, named)["A"].xyz == triangulate(shots, picks)["A"].xyz
    twice = [*picks, named[0]]
    _refused(shots, twice, f"picked twice in the photograph {picks[0].image}")


@pytest.mark.parametrize(
    ("px", "py"), [(-1, 5), (4001, 5), (5, -0.6), (5, 3000.5), (math.nan, 5), (5, math.inf)]
)
def test_picks_outside_of_the_photograph(shots: Shots, px: float, py: float) -> None:
    picks = [*picks_of(shots, "A", TARGET, 2), Pick("A", "IMG_00.JPG", px, py)]
    text = _refused(shots, picks, r"in IMG_00.JPG, which is outside of its 4000 x 3000 pixels")
    assert "resize the picks too" in text


def test_picks_at_the_very_corners_are_inside(tmp_path: Path) -> None:
    shots = _row(tmp_path, (-100, -75), (100, 75))
    picks = [Pick("A", "IMG_1.JPG", 4000, 0), Pick("A", "IMG_2.JPG", -0.5, 3000)]
    assert triangulate(shots, picks, 5.0)["A"].xyz[2] == pytest.approx(SITE[2] - 60, abs=1)


def test_picks_where_the_lens_has_no_ray(tmp_path: Path) -> None:
    folded = replace(PLAIN, parameters={"focal": 0.5, "k1": -0.6})
    shots = _row(tmp_path, (0, 0), (30, 0), camera=folded)
    picks = [Pick("A", "IMG_1.JPG", 3999, 2999), Pick("A", "IMG_2.JPG", 1999, 1499)]
    _refused(shots, picks, "the lens model of the camera .* has no ray")


def test_rays_that_meet_behind_the_cameras(tmp_path: Path) -> None:
    shots = _row(tmp_path, (-30, 0), (30, 0))
    apart = [Pick("A", "IMG_1.JPG", 1039.5, 1499.5), Pick("A", "IMG_2.JPG", 2959.5, 1499.5)]
    _refused(shots, apart, "its rays meet behind the camera of IMG_1.JPG")


def test_parallel_rays(tmp_path: Path) -> None:
    shots = _row(tmp_path, (-30, 0), (30, 0))
    parallel = [Pick("A", f"IMG_{i}.JPG", 2000, 1500) for i in (1, 2)]
    text = _refused(shots, parallel, "point A has no position: its rays are parallel")
    assert "seen from places well apart" in text
    same = _row(tmp_path, (0, 0), (0, 0))
    _refused(same, parallel, "its rays are parallel")


def test_nearly_parallel_rays_are_uncertain_and_said(tmp_path: Path) -> None:
    shots = _row(tmp_path, (0, 0), (0.5, 0), (1.0, 0))
    sighting = triangulate(shots, picks_of(shots, "A", SITE, 3), 0.5)["A"]
    (warning,) = sighting.warnings
    assert "its lines of sight meet at 0.57 degrees only, so it is uncertain by 2.2" in warning
    assert _std(sighting)[2] == pytest.approx(2.2, abs=0.05)


@pytest.mark.parametrize("sigma", [0, -1.0, math.nan, math.inf])
def test_pixel_sigma_that_is_none(shots: Shots, sigma: float) -> None:
    with pytest.raises(UsageError, match="expected the standard deviation of a pick"):
        triangulate(shots, picks_of(shots, "A", TARGET, 2), sigma)


def test_no_picks_no_points(shots: Shots) -> None:
    assert triangulate(shots, []) == {}


def test_messages_stay_on_one_line(shots: Shots) -> None:
    _refused(shots, [Pick("A\nB", "x\r\ny.JPG", 1, 1)], r"point A\?B .* x\?\?y.JPG")


# -- invariants -----------------------------------------------------------------------------------


def test_order_of_picks_and_other_points_do_not_move_a_point(shots: Shots) -> None:
    picks: Dict[str, Any] = {
        name: picks_of(shots, name, TARGET + np.array([i, 0, 0]), 4, 0.5, seed=i)
        for i, name in enumerate("ABC")
    }
    alone = triangulate(shots, picks["A"], 0.5)["A"]
    together = triangulate(shots, [*picks["C"], *reversed(picks["A"]), *picks["B"]], 0.5)
    assert list(together) == ["C", "A", "B"]
    assert together["A"].xyz == pytest.approx(alone.xyz, abs=1e-6)


def test_a_coordinate_of_millions_of_metres_costs_no_digits(shots: Shots) -> None:
    """The same photographs about zero; without a local origin derivatives lose five digits."""
    about_zero = {
        name: replace(shot, centre=shot.centre - SITE) for name, shot in shots.by_image.items()
    }
    near = Shots(about_zero, shots.label)
    picks = picks_of(near, "A", TARGET - SITE, 5, 0.5)
    here, there = triangulate(near, picks)["A"], triangulate(shots, picks)["A"]
    assert np.array(there.xyz) - SITE == pytest.approx(np.array(here.xyz), abs=1e-8)
    assert there.covariance == pytest.approx(here.covariance, rel=1e-7)
