"""Elevations of control points from tapes alone, and through a cloud."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from networks import Tape, network_of, survey

from quantify_client.errors import ControlError
from quantify_client.scaler.adjustment.elevations import solve_elevations
from quantify_client.scaler.adjustment.network import Network

# B is 3 m above A, C 5 m above B, D 2 m below C.
UP = {"A": 0.0, "B": 3.0, "C": 8.0, "D": 6.0}
PLACES = {"A": (0.0, 0.0), "B": (4.0, 0.0), "C": (4.0, 12.0), "D": (0.0, 12.0)}


def tape(ends: str, higher: str = "", off: float = 0.0) -> Tape:
    first, second = ends
    across = math.dist(PLACES[first], PLACES[second])
    length = math.hypot(across, UP[second] - UP[first]) + off
    return Tape(first, second, length, 0.002, higher=higher)


def network(*tapes: Tape, elevation=None, names: str = "ABCD", gps: float = 0.01) -> Network:
    return network_of(names, tapes, horizontal=PLACES, gps=gps, elevation=elevation, level=0.003)


def test_chain_relative_to_its_first_point() -> None:
    found = solve_elevations(network(tape("AB", "B"), tape("BC", "C"), tape("CD", "C")))
    assert found.reference == "A"
    assert found.points[:, 2] == pytest.approx([0.0, 3.0, 8.0, 6.0], abs=1e-6)
    assert found.notes == []
    # The step's own error, and summed along the chain.
    steps = [pair.std_m for pair in found.direct]
    by_hand = math.hypot(5 * 0.002, 4 * 0.01 * math.sqrt(2)) / 3.0
    assert steps[0] == pytest.approx(by_hand, rel=1e-9)
    assert found.std[0, 2] == pytest.approx(1e-4, rel=1e-3)
    assert found.std[1, 2] == pytest.approx(math.hypot(by_hand, 1e-4), rel=1e-3)
    assert found.std[1, 2] < found.std[2, 2] < found.std[3, 2]


def test_signs_are_those_that_were_noted() -> None:
    found = solve_elevations(network(tape("AB", "A"), tape("BC", "B"), tape("CD", "D")))
    assert found.points[:, 2] == pytest.approx([0.0, -3.0, -8.0, -6.0], abs=1e-6)


@pytest.mark.parametrize("known", ["A", "C"])
def test_known_elevation_lifts_the_rest(known: str) -> None:
    tapes = tape("AB", "B"), tape("BC", "C"), tape("CD", "C")
    found = solve_elevations(network(*tapes, elevation={known: 100.0 + UP[known]}))
    assert found.reference == ""
    assert found.points[:, 2] == pytest.approx([100.0, 103.0, 108.0, 106.0], abs=1e-6)
    assert found.std["ABCD".index(known), 2] == pytest.approx(0.003, rel=1e-3)


def test_pair_without_a_note_is_used_when_the_others_tell() -> None:
    """A-B and B-C are noted, so A-C is known to rise: it is then worth more than both."""
    two = tape("AB", "B"), tape("BC", "C")
    chain = solve_elevations(network(*two, names="ABC"))
    closed = solve_elevations(network(*two, tape("AC"), names="ABC"))
    assert closed.points[:, 2] == pytest.approx([0.0, 3.0, 8.0], abs=1e-6)
    assert closed.std[2, 2] < 0.9 * chain.std[2, 2]
    assert [pair.dz_m for pair in closed.direct] == pytest.approx([3.0, 5.0, 8.0])
    assert closed.notes == []


def test_signs_are_found_one_after_the_other() -> None:
    """Of C-D nobody noted anything, but both have elevations from other tapes."""
    tapes = tape("CD"), tape("AB", "B"), tape("BC", "C"), tape("BD", "D")
    found = solve_elevations(network(*tapes, elevation={"A": 0.0}))
    assert found.points[:, 2] == pytest.approx([0.0, 3.0, 8.0, 6.0], abs=1e-6)
    assert found.direct[0].dz_m == pytest.approx(-2.0)


def test_known_elevations_tell_the_sign() -> None:
    found = solve_elevations(network(tape("AB"), tape("BC", "C"), elevation={"A": 0.0, "B": 3.0}))
    assert found.points[:3, 2] == pytest.approx([0.0, 3.0, 8.0], abs=1e-6)
    assert found.notes == []


def test_point_that_nothing_tells_of_is_named_and_left_open() -> None:
    found = solve_elevations(network(tape("AB", "B"), tape("BC")))
    assert found.points[:2, 2] == pytest.approx([0.0, 3.0], abs=1e-6)
    assert np.isnan(found.points[2:]).all()
    assert [pair.note for pair in found.direct if pair.note] == [
        "B-C: it is not known which end is higher; add 'higher: B' or 'higher: C' to the distance"
    ]


@pytest.mark.parametrize(
    ("tapes", "reason"),
    [
        ([tape("AB")], "A-B: it is not known which end is higher; add 'higher: A' or 'higher: B'"),
        ([tape("AB", "B", -2.0)], "A-B: the tape (3.000 m) is 1.000 m shorter than the ground"),
        ([], "there are positions only, and no taped distances"),
        ([tape("AB", "B")._replace(check=True)], "there are positions only, and no taped"),
        ([tape("AB"), tape("CD")], "A-B: it is not known which end is higher"),
    ],
)
def test_what_cannot_be_solved_is_refused(tapes, reason: str) -> None:
    with pytest.raises(ControlError) as caught:
        solve_elevations(network(*tapes))
    assert reason in str(caught.value)
    assert str(caught.value).isprintable()


def test_no_tape_at_the_known_point() -> None:
    """What is known stays known: the others are left open, not refused."""
    found = solve_elevations(network(tape("BC", "C"), elevation={"A": 0.0}))
    assert found.points[0, 2] == pytest.approx(0.0, abs=1e-6)
    assert np.isnan(found.points[1:]).all()


def test_nothing_is_to_be_solved_where_all_is_known() -> None:
    asked = network(elevation=UP)
    found = solve_elevations(asked)
    assert found.points == pytest.approx(np.column_stack([asked.horizontal, asked.elevation]))
    assert found.std == pytest.approx(np.tile([0.01, 0.01, 0.003], (4, 1)))
    assert (found.reference, list(found.direct), list(found.notes)) == ("", [], [])


def test_check_takes_no_part() -> None:
    tapes = tape("AB", "B"), tape("BC", "C")
    plain = solve_elevations(network(*tapes, names="ABC"))
    checked = solve_elevations(
        network(*tapes, tape("AC", "C", off=1.0)._replace(check=True), names="ABC")
    )
    assert checked.points == pytest.approx(plain.points, abs=1e-9)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("levelled", [0, 4])
def test_through_a_cloud(seed: int, levelled: int) -> None:
    """Its shape tells the heights of all, once it is turned; no notes of signs are needed."""
    truth = survey(seed, gps=0.05, levelled=levelled)
    found = solve_elevations(truth.network)
    assert found.reference == ("" if levelled else "P0")
    up, true = found.points[:, 2], truth.points[:, 2]
    level = 0.0 if levelled else true[0]
    assert (np.abs(up - (true - level)) <= 4.0 * found.std[:, 2]).all()
    assert found.std[:, 2].max() < (0.1 if levelled else 0.6)
    assert all(pair.dz_m is not None or pair.note for pair in found.direct)


def test_through_a_cloud_heights_count_from_the_reference() -> None:
    truth = survey(0, gps=0.05)
    found = solve_elevations(truth.network)
    assert found.points[0, 2] == pytest.approx(0.0, abs=1e-9)
    assert found.std[0, 2] == pytest.approx(0.0, abs=1e-6)
    assert found.std[1:, 2].min() > 0.01


def test_too_few_in_the_cloud_leave_it_to_the_tapes() -> None:
    asked = network(tape("AB", "B"), tape("BC", "C"), names="ABC")
    cloud = np.full((3, 3), math.nan)
    cloud[:2] = [(0.0, 0.0, 0.0), (4.0, 0.0, 3.0)]
    found = solve_elevations(replace(asked, cloud=cloud))
    assert found.points[:, 2] == pytest.approx([0.0, 3.0, 8.0], abs=1e-6)
