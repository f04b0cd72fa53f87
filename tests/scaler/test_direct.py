"""The paper's step, dz = sqrt(D^2 - d^2), against numbers worked out by hand."""

from __future__ import annotations

import math
from typing import Tuple

import numpy as np
import pytest
from networks import Tape, network_of

from quantify_client.crs import local_frame
from quantify_client.scaler.adjustment.build import build_network
from quantify_client.scaler.adjustment.direct import (
    direct_height,
    direct_heights,
    relative_elevations,
)
from quantify_client.scaler.control.model import Control, ControlPoint, Length
from quantify_client.types import DirectHeight

AB = ("A", "B")


@pytest.mark.parametrize(
    ("slope", "ground", "dz", "sigma"),
    [
        ((5.0, 0.005), (4.0, 0.02), 3.0, math.sqrt(0.025**2 + 0.08**2) / 3.0),
        ((13.0, 0.01), (12.0, 0.1), 5.0, math.sqrt(0.13**2 + 1.2**2) / 5.0),
        ((13.0, 0.01), (5.0, 0.0), 12.0, 0.13 / 12.0),
        ((25.0, 0.0), (24.0, 0.03), 7.0, 0.72 / 7.0),
        ((10.0, 0.01), (0.0, 0.5), 10.0, 0.01),  # a plumb line
    ],
)
@pytest.mark.parametrize("sign", [1, -1])
def test_height_and_its_sigma(slope, ground, dz: float, sigma: float, sign: int) -> None:
    found = direct_height(AB, slope, ground, sign)
    assert found.dz_m == pytest.approx(sign * dz, rel=1e-12)
    assert found.std_m == pytest.approx(sigma, rel=1e-12)
    assert (found.start, found.end, found.slope_m, found.ground_m) == (*AB, slope[0], ground[0])
    assert found.interval_m is None
    assert found.note == ""


def test_level_pair_has_an_interval() -> None:
    """D^2 - d^2 = 900 - 894.01 = 5.99, give or take 2 sqrt(0.15^2 + 29.9^2) = 59.8."""
    found = direct_height(AB, (30.0, 0.005), (29.9, 1.0), 1)
    assert found.dz_m == pytest.approx(2.44745, abs=1e-5)
    assert found.std_m == pytest.approx(29.900376 / 2.44745, abs=1e-4)
    assert found.interval_m == pytest.approx((0.0, 11.0995), abs=1e-4)
    assert found.note == (
        "A-B: too level for its elevation difference to be determined (2.45 m with a sigma of "
        "12.22 m): it lies between 0.00 and 11.10 m"
    )


@pytest.mark.parametrize(("sigma", "level"), [(0.37, False), (0.38, True)])
def test_interval_begins_at_three_sigma_of_the_squares(sigma: float, level: bool) -> None:
    """D^2 - d^2 = 9 and its sigma 2 d sigma_d = 8 sigma_d: a third of it at sigma_d = 0.375."""
    found = direct_height(AB, (5.0, 0.0), (4.0, sigma), 1)
    assert (found.interval_m is not None) is level
    assert bool(found.note) is level


def test_level_pairs_are_told_as_such() -> None:
    """Of level pairs one in 740 exceeds three sigma to the steep side (normal distribution)."""
    rng, sure = np.random.default_rng(5), 0
    for tape, across in zip(rng.normal(30.0, 0.01, 20_000), rng.normal(30.0, 0.5, 20_000)):
        found = direct_height(AB, (tape, 0.01), (across, 0.5), 1)
        sure += found.dz_m is not None and found.interval_m is None
    assert sure / 20_000 == pytest.approx(0.00135, abs=0.0009)


def test_tape_shorter_than_the_ground_is_told_by_how_much() -> None:
    found = direct_height(AB, (10.0, 0.005), (10.5, 0.02), 1)
    assert (found.dz_m, found.std_m, found.interval_m) == (None, None, None)
    assert found.note == (
        "A-B: the tape (10.000 m) is 0.500 m shorter than the ground between both positions "
        "(10.500 m), so there is no elevation difference; measure the pair again, or correct the "
        "positions"
    )


def test_tape_a_little_shorter_than_the_ground_has_an_upper_limit() -> None:
    """D^2 - d^2 = -1.0025, and 3.92 sqrt(0.05^2 + 1.005^2) = 3.9445 on top is 1.7152^2."""
    found = direct_height(AB, (10.0, 0.005), (10.05, 0.1), 1)
    assert found.dz_m is None
    assert found.interval_m == pytest.approx((0.0, 1.7152), abs=1e-4)
    assert "0.050 m shorter" in found.note
    assert "at most 1.72 m that the sigmas allow" in found.note


def test_level_to_the_last_digit() -> None:
    found = direct_height(AB, (10.0, 0.005), (10.0, 0.1), 1)
    assert found.dz_m is None
    assert found.interval_m is not None


def test_sign_nobody_knows_is_refused() -> None:
    found = direct_height(AB, (5.0, 0.005), (4.0, 0.02), 0)
    assert (found.dz_m, found.std_m) == (None, None)
    assert found.note == (
        "A-B: it is not known which end is higher; add 'higher: A' or 'higher: B' to the distance"
    )


@pytest.mark.parametrize(
    ("higher", "up", "dz"),
    [
        ("B", None, 3.0),
        ("A", None, -3.0),
        ("B", (9.0, 1.0), 3.0),  # what was noted goes before what the cloud has
        ("", (9.0, 1.0), -3.0),
        ("", (1.0, 9.0), 3.0),
        ("", (1.0, math.nan), None),
        ("", (1.0, 1.0), None),
        ("", None, None),
    ],
)
def test_sign_is_that_of_the_note_or_of_the_cloud(higher: str, up, dz) -> None:
    tapes = [Tape("A", "B", 5.0, higher=higher), Tape("A", "C", 5.0)]
    network = network_of("ABC", tapes, horizontal={"A": (7.0, 7.0), "B": (7.0, 11.0)}, gps=0.1)
    heights = None if up is None else np.array([*up, 0.0])
    found = direct_heights(network, heights)
    assert len(found) == 1  # C has no position
    assert found[0].dz_m == (None if dz is None else pytest.approx(dz))
    assert found[0].ground_m == pytest.approx(4.0)
    if dz is not None:
        across = math.sqrt(2.0) * 0.1  # of both positions
        assert found[0].std_m == pytest.approx(math.hypot(5.0 * 0.005, 4.0 * across) / 3.0)


def pair(start: str, end: str, dz, std) -> DirectHeight:
    return DirectHeight(start, end, 10.0, 9.0, dz, std)


def test_elevations_along_a_chain_are_sums() -> None:
    pairs = [pair("A", "B", 3.0, 0.3), pair("C", "B", 1.0, 0.4), pair("C", "D", -2.5, 1.2)]
    found = relative_elevations(pairs, "A")
    heights = {"A": 0.0, "B": 3.0, "C": 2.0, "D": -0.5}
    assert {name: height for name, (height, _) in found.items()} == pytest.approx(heights)
    sigmas = {"A": 0.0, "B": 0.3, "C": 0.5, "D": 1.3}  # 3 4 5 and 5 12 13
    assert {name: sigma for name, (_, sigma) in found.items()} == pytest.approx(sigmas)
    assert relative_elevations(pairs, "D")["A"] == pytest.approx((0.5, 1.3))


def test_path_of_least_variance_is_taken() -> None:
    """A-C directly is worse than by way of B, A-B-C worse than by way of D and B."""
    pairs = [
        pair("A", "C", 9.0, 0.6),
        pair("A", "B", 3.0, 0.4),
        pair("B", "C", 5.0, 0.3),
        pair("A", "D", 1.0, 0.1),
        pair("D", "B", 2.5, 0.2),
        pair("B", "E", None, None),
    ]
    found = relative_elevations(pairs, "A")
    assert found["B"] == pytest.approx((3.5, math.sqrt(0.1**2 + 0.2**2)))
    assert found["C"] == pytest.approx((8.5, math.sqrt(0.1**2 + 0.2**2 + 0.3**2)))
    assert "E" not in found
    assert relative_elevations([], "A") == {"A": (0.0, 0.0)}


def straight(height: float) -> Tuple[float, float]:
    """The elevation difference of a pair of positions taped at some height of the site, and d."""
    lon, lat = 9.0, 48.0
    a, e2 = 6378137.0, 0.00669437999014
    sine = math.sin(math.radians(lat))
    meridian = a * (1 - e2) / (1 - e2 * sine**2) ** 1.5
    north = lat + math.degrees(100.0 / meridian)  # 100 m on the ellipsoid
    control = Control(
        label="t",
        crs="EPSG:4326",
        height_m=height,
        points={"A": ControlPoint("A", lon, lat, 0.01), "B": ControlPoint("B", lon, north, 0.01)},
        lengths=[Length("A", "B", math.sqrt(100.0**2 + 10.0**2), 0.005, higher="B")],
        cloud={},
        picks=[],
        warnings=(),
    )
    network, _ = build_network(control, local_frame("EPSG:4326", lon, lat, height), 0.0, {})
    (found,) = direct_heights(network)
    assert found.dz_m is not None
    return found.dz_m, found.ground_m


def test_ground_length_is_that_at_the_height_of_the_site() -> None:
    """100 m between two places are 3.1 cm longer at 2000 m: 0.3 m in dz = 10 m."""
    dz, ground = straight(0.0)
    assert ground == pytest.approx(100.0, abs=1e-4)
    assert dz == pytest.approx(10.0, abs=1e-3)
    dz, ground = straight(2000.0)
    by_hand = 100.0 * (1.0 + 2000.0 / 6_370_800.0)  # M at 48 N
    assert by_hand - 100.0 == pytest.approx(0.0314, abs=1e-4)
    assert ground == pytest.approx(by_hand, abs=2e-4)
    assert dz == pytest.approx(math.sqrt(100.0**2 + 10.0**2 - by_hand**2), abs=2e-3)
    assert dz == pytest.approx(10.0 - 0.319, abs=2e-3)
