"""What is said of an adjustment, in words and numbers."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from networks import Tape, network_of, survey

from quantify_client.scaler.adjustment.fit import fit
from quantify_client.scaler.adjustment.network import Freedom, Network
from quantify_client.scaler.adjustment.outliers import adjust
from quantify_client.scaler.adjustment.solve import Adjustment
from quantify_client.scaler.adjustment.summary import (
    findings,
    observations,
    root_mean_square,
    scale_source,
    worst_conflict,
)
from quantify_client.types import ScaleObservation

PLACES = {"A": (0.0, 0.0), "B": (10.0, 0.0)}


def adjusted(network: Network, freedom: Freedom) -> Adjustment:
    return adjust(network, freedom)


def taped(*lengths: float) -> Adjustment:
    """One pair, taped several times to 5 mm; positions to 3 m say nothing of it."""
    tapes = [Tape("A", "B", length) for length in lengths]
    return adjusted(network_of("AB", tapes, horizontal=PLACES), Freedom(0, False, False, False))


def test_bad_tape_is_told_in_metres_and_sigmas() -> None:
    """0.31 m from the mean of two others: 0.31 / sqrt(5^2 + 5^2 / 2) mm = 50.6 sigma."""
    found = taped(10.0, 10.31, 10.0)
    assert worst_conflict(found) == "tape A-B disagrees with the rest by 0.310 m, 50.6 sigma"
    assert findings(found) == [
        "tape A-B disagrees with the rest by 0.31 m, 51 sigma, and was left out; measure it again"
    ]
    assert [r.outlier for r in observations(found) if r.kind == "distance"] == [False, True, False]


def test_two_that_disagree_are_both_told() -> None:
    """Each is 0.31 m from the other: 0.31 / sqrt(5^2 + 5^2) mm = 43.8 sigma of what was said."""
    found = taped(10.0, 10.31)
    # (the positions, good to 3 m, have a part in a thousand of a say)
    assert re.match(
        r"tape A-B disagrees with the rest by 0.310 m, 43.[89] sigma$", worst_conflict(found)
    )
    (told,) = findings(found)
    assert told.startswith("tapes fit 43.8 times worse than their accuracies say")
    sigmas = [r.sigma for r in observations(found) if r.kind == "distance"]
    assert sigmas == pytest.approx([0.005 * 43.84] * 2, rel=1e-3)


def test_nothing_is_told_where_nothing_contradicts() -> None:
    assert worst_conflict(taped(10.0, 10.01, 10.005)) == ""
    assert worst_conflict(taped(10.0)) == ""
    assert findings(taped(10.0, 10.01, 10.005)) == []


def test_wrong_pick_is_told_in_metres_whatever_controls_it() -> None:
    """Only along the tapes can a pick be controlled: what is missing there is what is told."""
    cloud = {"A": (0, 0, 0), "B": (10, 0, 0), "C": (20.5, 0, 0)}
    tapes = [Tape("A", "B", 10.0, 1e-4), Tape("B", "C", 10.0, 1e-4), Tape("A", "C", 20.0, 1e-4)]
    found = adjusted(network_of("ABC", tapes, cloud=cloud), Freedom(0, False, False))
    told = re.match(r".* by (\d\.\d+) m, (\d+\.\d) sigma", worst_conflict(found))
    assert told is not None
    # By the middle B misses 0.25 m of the cloud; either end would have to move by 0.5 m.
    assert 0.2 < float(told.group(1)) < 0.55
    assert float(told.group(2)) > 10.0


def test_bad_tape_of_a_survey() -> None:
    truth = survey(1)
    length = truth.network.length.copy()
    length[4] += 0.31
    found = fit(replace(truth.network, length=length), "auto", False).adjustment
    first, second = (truth.network.names[end] for end in truth.network.ends[4])
    pattern = (
        rf"tape {first}-{second} disagrees with the rest by 0\.(2[7-9]|3[0-5])\d m, [\d.]+ sigma"
    )
    assert re.fullmatch(pattern, worst_conflict(found))
    assert findings(found)[0].endswith("and was left out; measure it again")


def test_scale_of_tapes_and_positions() -> None:
    truth = survey(0)
    found = fit(truth.network, "auto", False)
    pattern = (
        r"the scale comes from 20 tapes \(known to (0\.\d+) %; without them it would be known to "
        r"([\d.]+) %\); next to nothing from 12 positions"
    )
    told = re.fullmatch(pattern, scale_source(found.adjustment))
    assert told is not None
    assert float(told.group(1)) == pytest.approx(100.0 * found.std / found.factor, rel=0.05)
    nothing = np.arange(0)
    without = replace(
        truth.network,
        ends=truth.network.ends[nothing],
        length=np.array([]),
        length_sigma=np.array([]),
        bar=np.array([], dtype=bool),
        check=np.array([], dtype=bool),
        higher=nothing,
    )
    alone = fit(without, "auto", False)
    assert float(told.group(2)) == pytest.approx(100.0 * alone.std / alone.factor, rel=0.15)


CLOUD = {"A": (0, 0, 0), "B": (10, 0, 0), "C": (0, 10, 1), "D": (10, 10, 2)}


def test_scale_of_a_bar_alone() -> None:
    network = network_of("ABCD", [Tape("A", "B", 12.0, 0.0, bar=True)], cloud=CLOUD)
    network.length_sigma[:] = 0.005
    found = adjusted(network, Freedom(0, False, False))
    std = math.sqrt(0.005**2 + 2 * (1.2 * 0.01) ** 2) / 12.0
    told = f"the scale comes from 1 scale bar (known to {100 * std:.2g} %; nothing else fixes it)"
    assert scale_source(found) == told


def test_scale_of_bars_that_tapes_help() -> None:
    tapes = [Tape("A", "B", 10.0, 0.002, bar=True), Tape("C", "D", math.sqrt(101.0), 0.004)]
    network = network_of("ABCD", tapes, cloud=CLOUD, pick=1e-4)
    told = scale_source(adjusted(network, Freedom(0, False, False)))
    # 0.02 % by the bar, 0.04 % by the tape: together 0.02 / sqrt(1.25).
    assert told == (
        "the scale comes from 1 scale bar (known to 0.018 %; without them it would be known to "
        "0.04 %); beside 1 tape"
    )


def record(kind: str, residual: float, check: bool = False, used: bool = True) -> ScaleObservation:
    redundancy = 0.5 if used else None
    return ScaleObservation(
        kind,
        None,
        ("A", "B"),
        1.0,
        1.0 + residual,
        residual,
        0.01,
        redundancy,
        None,
        not used,
        check,
    )


def test_root_mean_squares_by_hand() -> None:
    records = [
        record("distance", 0.03),
        record("scale_bar", -0.04),
        record("distance", 0.5, used=False),  # an outlier
        record("distance", 0.12, check=True, used=False),
        record("distance", -0.05, check=True, used=False),
        record("gps", 3.0),
        record("elevation", 7.0),
    ]
    assert root_mean_square(records, check=False) == pytest.approx(math.sqrt(0.0025 / 2))
    assert root_mean_square(records, check=True) == pytest.approx(math.sqrt(0.0169 / 2))
    positions = [record("gps", 3.0), record("gps", 4.0), record("gps", 9.0, used=False)]
    assert root_mean_square(positions, check=False) == pytest.approx(math.sqrt(12.5))
    assert root_mean_square(positions, check=True) is None
    assert root_mean_square([], check=False) is None


def test_records_are_what_was_observed() -> None:
    truth = survey(3, points=6, tapes=5, levelled=3)
    found = fit(truth.network, "full", False).adjustment
    records = observations(found)
    kinds = ["gps"] * 12 + ["elevation"] * 3 + ["cloud"] * 18 + ["distance"] * 5
    assert [r.kind for r in records] == kinds
    assert [r.component for r in records[:2]] == ["east", "north"]
    assert [r.component for r in records[15:18]] == ["x", "y", "z"]
    assert records[12].component is records[-1].component is None
    assert records[2].names == ("P1",)
    assert records[2].observed == truth.network.horizontal[1, 0]
    assert records[-1].names == tuple(truth.network.names[end] for end in truth.network.ends[-1])
    assert records[-1].observed == truth.network.length[-1]
    for each in records:
        assert each.adjusted - each.observed == pytest.approx(each.residual, abs=1e-9)
        assert each.redundancy is not None
        assert each.contribution is not None
        assert 0.0 <= each.redundancy <= 1.0
        assert 0.0 <= each.contribution <= 1.0
    assert found.point_std.shape == (6, 3)
    assert found.point_std[0, 2] < 0.02 < 0.3 < found.point_std[0, 0]


def test_note_of_which_end_is_higher_is_judged() -> None:
    truth = survey(2, levelled=12, level=0.005, gps=0.02)
    rise = truth.points[truth.network.ends[:, 1], 2] - truth.points[truth.network.ends[:, 0], 2]
    higher = np.sign(rise).astype(np.int64)
    noted = replace(truth.network, higher=higher)
    assert findings(fit(noted, "full", False).adjustment) == []
    wrong = int(np.argmax(rise))
    higher[wrong] = -1
    (told,) = findings(fit(noted, "full", False).adjustment)
    first, second = (truth.network.names[end] for end in truth.network.ends[wrong])
    assert re.fullmatch(
        rf"{first}-{second}: {first} was noted to be higher, but {second} is by [\d.]+ m; correct "
        r"the note, or look whether the points are swapped",
        told,
    )
    metres = re.search(r"is by ([\d.]+) m", told)
    assert metres is not None
    assert float(metres.group(1)) == pytest.approx(rise[wrong], abs=0.03)
