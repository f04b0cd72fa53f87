"""The scale of synthetic surveys against the truth; modes, and what is refused."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import List, Tuple

import numpy as np
import pytest
from networks import SCALE, Tape, network_of, outliers, survey, with_two_gross_errors
from scipy.spatial.transform import Rotation

from quantify_client.errors import ControlError
from quantify_client.scaler.adjustment.direct import direct_heights
from quantify_client.scaler.adjustment.fit import ScaleFit, fit
from quantify_client.scaler.adjustment.network import Network

UPRIGHT = Rotation.from_euler("z", 40, degrees=True).as_matrix()


@dataclass(frozen=True)
class Trials:
    """Of many surveys: error / std of the scale, std / scale, what was called wrong."""

    z: np.ndarray
    relative_std: np.ndarray
    called_wrong: List[int]


@pytest.fixture(scope="module")
def hundred() -> Trials:
    """The survey of the issue, a hundred times."""
    surveys = [survey(seed) for seed in range(100)]
    made = [(truth, fit(truth.network, "auto", False)) for truth in surveys]
    return Trials(
        np.array([(found.factor - truth.factor) / found.std for truth, found in made]),
        np.array([found.std / found.factor for _, found in made]),
        [seed for seed, (_, found) in enumerate(made) if found.adjustment.outliers],
    )


@pytest.mark.one_python
def test_true_scale_lies_within_three_std(hundred: Trials) -> None:
    assert (np.abs(hundred.z) <= 3.0).sum() >= 99


@pytest.mark.one_python
def test_scale_is_known_to_half_a_per_mille(hundred: Trials) -> None:
    """Better than 0.05 %: 20 tapes of 40 m, good to 5 mm and picked to 1 cm, give 0.013 %."""
    assert hundred.relative_std.max() < 5e-4
    assert hundred.relative_std.mean() == pytest.approx(1.3e-4, rel=0.1)


@pytest.mark.one_python
def test_std_is_as_large_as_the_errors_are(hundred: Trials) -> None:
    assert 0.8 < math.sqrt(float(np.mean(hundred.z**2))) < 1.25
    assert abs(float(np.mean(hundred.z))) < 0.3  # three sigma of a mean of a hundred


@pytest.mark.one_python
def test_good_observations_are_rarely_called_wrong(hundred: Trials) -> None:
    assert len(hundred.called_wrong) <= 4  # one is expected: a test at 1 %


@pytest.mark.one_python
def test_two_gross_errors_are_found_and_do_no_harm() -> None:
    missed, inside = [], 0
    for seed in range(15):  # five of them with both at one point
        truth = survey(seed)
        network, wrong = with_two_gross_errors(truth.network, seed)
        found = fit(network, "auto", False)
        if outliers(found.adjustment) != {("distance", number) for number in wrong}:
            missed.append((seed, wrong, outliers(found.adjustment)))
        inside += abs(found.factor - truth.factor) <= 3.0 * found.std
        assert found.std / found.factor < 5e-4
    assert missed == []
    assert inside >= 14


@pytest.mark.one_python
@pytest.mark.parametrize(("relief", "seeds"), [(0.0, range(30)), (0.3, range(30))])
def test_gentle_slope_takes_nothing_from_the_scale(relief: float, seeds: range) -> None:
    """Where the paper's step fails: dz = sqrt(D^2 - d^2) of 2 % over 40 m drowns in the GPS."""
    z, warned = [], []
    for seed in seeds:
        truth = survey(seed, relief=relief, slope=0.02)
        found = fit(truth.network, "auto", False)
        z.append((found.factor - truth.factor) / found.std)
        assert found.std / found.factor < 5e-4
        pairs = direct_heights(truth.network, truth.points[:, 2])
        warned += [bool(pair.note) and pair.interval_m is not None for pair in pairs]
        told = [bool(pair.note) for pair in pairs]
        assert all(told[i] for i, pair in enumerate(pairs) if pair.interval_m is not None)
    assert (np.abs(z) <= 3.0).sum() >= 29
    assert 0.7 < math.sqrt(float(np.mean(np.square(z)))) < 1.35
    # The others are those whose ground length GPS made 1.5 sigma too short: 7 in 100.
    assert np.mean(warned) > 0.85


# --- modes


def levelled(seed: int) -> Tuple[np.ndarray, ScaleFit]:
    truth = survey(seed, points=8, tapes=12, levelled=4)
    found = fit(truth.network, "full", False)
    assert found.mode == "full"
    return found.similarity.rotation @ truth.rotation, found


@pytest.mark.one_python
def test_rotation_is_recovered_to_within_its_std() -> None:
    """With elevations of four points; errors about the axes of the ground, in their std."""
    tilts, headings = [], []
    for seed in range(20):
        error, found = levelled(seed)
        east, north, up = np.degrees(Rotation.from_matrix(error).as_rotvec())
        assert found.tilt_std_deg is not None
        assert found.heading_std_deg is not None
        assert found.tilt_std_deg < 0.6
        tilts.append(math.hypot(east, north) / found.tilt_std_deg)
        headings.append(up / found.heading_std_deg)
        assert np.linalg.det(found.similarity.rotation) == pytest.approx(1.0, abs=1e-9)
    assert max(tilts) < 3.7  # one in a thousand of two together
    assert 0.4 < math.sqrt(float(np.mean(np.square(tilts)))) < 1.42
    assert 0.7 < math.sqrt(float(np.mean(np.square(headings)))) < 1.35


def test_full_transform_brings_the_cloud_to_the_ground() -> None:
    truth = survey(2, levelled=12, gps=0.02)
    found = fit(truth.network, "full", False)
    moved = found.similarity.apply(truth.network.cloud)
    assert np.abs(moved - truth.points).max() < 0.08
    # The middle of the cloud: the mean of twelve positions, and of twelve picks on the ground.
    assert found.shift_std_m == pytest.approx(
        math.hypot(0.02, 0.01 * SCALE) / math.sqrt(12), rel=0.01
    )


@pytest.mark.parametrize("mode", ["shift", "auto"])
def test_shift_keeps_the_vertical_exactly(mode: str) -> None:
    truth = survey(3, rotation=UPRIGHT, levelled=4)
    found = fit(truth.network, mode, True)
    assert found.mode == "shift"
    assert found.tilt_std_deg is None
    rotation = found.similarity.rotation
    assert rotation[2].tolist() == [0.0, 0.0, 1.0]
    assert rotation[:, 2].tolist() == [0.0, 0.0, 1.0]
    assert np.linalg.det(rotation) == pytest.approx(1.0, abs=1e-12)
    heading = math.degrees(math.atan2(rotation[1, 0], rotation[0, 0]))
    assert found.heading_std_deg is not None
    assert heading == pytest.approx(-40.0, abs=3.0 * found.heading_std_deg)
    assert abs(found.factor - SCALE) < 3.0 * found.std
    assert found.warnings == ()


def test_scale_leaves_the_cloud_where_it_is() -> None:
    truth = survey(3, levelled=4)
    found = fit(truth.network, "scale", False)
    whole = fit(truth.network, "full", False)
    assert found.mode == "scale"
    assert found.similarity.rotation.tolist() == np.eye(3).tolist()
    middle = truth.network.cloud.mean(axis=0)
    assert found.similarity.apply(middle[None])[0] == pytest.approx(middle)
    assert (found.tilt_std_deg, found.heading_std_deg, found.shift_std_m) == (None, None, None)
    assert found.factor == pytest.approx(whole.factor, rel=1e-9)  # positions help all the same


def test_reflection_is_never_returned() -> None:
    """Of a cloud that is a mirror image, heights and all, nothing is made that is not a turn."""
    truth = survey(1, levelled=12, gps=0.02)
    mirrored = replace(truth.network, cloud=truth.network.cloud * [1.0, 1.0, -1.0])
    found = fit(mirrored, "full", False)
    assert np.linalg.det(found.similarity.rotation) == pytest.approx(1.0, abs=1e-9)


BAR = {"A": (100.0, 200.0, 5.0), "B": (101.0, 201.4, 4.8)}


@pytest.mark.parametrize("mode", ["scale", "auto"])
@pytest.mark.parametrize("georeferenced", [True, False])
def test_one_bar_alone_gives_the_scale(mode: str, georeferenced: bool) -> None:
    network = network_of("AB", [Tape("A", "B", 2.1, 0.002, bar=True)], cloud=BAR, pick=0.003)
    found = fit(network, mode, georeferenced)
    length = math.sqrt(1.0**2 + 1.4**2 + 0.2**2)
    factor = 2.1 / length
    assert found.mode == "scale"
    assert found.factor == pytest.approx(factor, rel=1e-9)
    # Both picks, in metres of the ground, and the bar itself; over its length.
    std = math.sqrt(0.002**2 + 2 * (factor * 0.003) ** 2) / length
    assert found.std == pytest.approx(std, rel=1e-6)
    assert found.warnings == ()


# --- what is refused, and what auto falls back to

SQUARE = {"A": (0, 0, 0), "B": (30, 0, 2), "C": (30, 30, 5), "D": (0, 30, -4), "E": (12, 17, 9)}
LINE = {name: (10.0 * i, 5.0 * i, 2.0 * i) for i, name in enumerate("ABCDE")}
PLANE = {name: (x, y, 0.1 * x - 0.2 * y) for name, (x, y, _) in SQUARE.items()}
TAPE = [Tape("A", "B", 30.0)]


def small(cloud, tapes=TAPE, placed="ABCDE", levels="") -> Network:
    return network_of(
        "ABCDE",
        tapes,
        cloud=cloud,
        horizontal={name: SQUARE[name][:2] for name in placed},
        elevation={name: cloud[name][2] for name in levels},
    )


@pytest.mark.parametrize(
    ("network", "mode", "reason"),
    [
        (small(SQUARE, placed="AB"), "shift", "2 points are both in the cloud and known by posit"),
        (small(SQUARE, placed="A"), "full", "1 point is both in the cloud and known by position"),
        (small(SQUARE, placed=""), "full", "no points are both in the cloud and known by position"),
        (small({"A": (0, 0, 0), "B": (9, 0, 0)}), "shift", "fewer than 3: add some"),
        (small(LINE), "full", "lie in one line, about which the cloud could turn freely: add a po"),
        (small(LINE, levels="ABCDE"), "full", "lie in one line"),
        (small(PLANE), "full", "lie in one plane and their elevations are unknown"),
        (small(PLANE, levels="AB"), "full", "lie in one plane and their elevations are unknown"),
        (small({**SQUARE, "C": SQUARE["A"]}), "full", "A and C are at the same place in the cloud"),
        (small({**SQUARE, "C": SQUARE["A"]}), "auto", "A and C are at the same place in the cloud"),
        (small(SQUARE, [], "A"), "scale", "nothing fixes the scale: 5 points are in the cloud, 0 "),
        (small(SQUARE, [], ""), "auto", "nothing fixes the scale"),
        (small({"A": (0, 0, 0)}), "scale", "nothing fixes the scale: 1 point is in the cloud"),
        (small({}), "auto", "nothing fixes the scale: 0 points are in the cloud"),
        (small(SQUARE, [Tape("A", "B", 30.0, check=True)], ""), "scale", "nothing fixes the scale"),
    ],
)
@pytest.mark.parametrize("georeferenced", [True, False])
def test_refusal_says_why_in_one_line(
    network: Network, mode: str, georeferenced: bool, reason: str
) -> None:
    with pytest.raises(ControlError) as caught:
        fit(network, mode, georeferenced)
    message = str(caught.value)
    assert reason in message
    assert message.isprintable()
    if mode in ("shift", "full") and "same place" not in reason:
        assert message.startswith(f"--scale-mode {mode} is not possible: ")


@pytest.mark.parametrize(
    ("network", "georeferenced", "reason"),
    [
        (small(SQUARE, placed="AB"), True, "2 points are both in the cloud and known by position"),
        (small(SQUARE, placed="AB"), False, "2 points are both in the cloud and known by position"),
        (small(LINE), False, "the control points lie in one line"),
        (small(PLANE), False, "the control points lie in one plane"),
    ],
)
def test_auto_falls_back_to_the_scale_and_says_so(
    network: Network, georeferenced: bool, reason: str
) -> None:
    found = fit(network, "auto", georeferenced)
    assert found.mode == "scale"
    assert found.similarity.rotation.tolist() == np.eye(3).tolist()
    told = f"only the scale is applied, the cloud stays where it is: {reason}"
    assert sum(note.startswith(told) for note in found.warnings) == 1
    unused = "positions of points in the cloud are not used: they cannot fix how it is turned"
    assert (unused in found.warnings) is not georeferenced
    across = math.dist(network.cloud[0], network.cloud[1])
    assert found.factor == pytest.approx(30.0 / across, abs=5 * found.std)


@pytest.mark.parametrize("placed", ["ABC", "ABCDE"])
def test_three_points_in_a_line_still_allow_a_shift(placed: str) -> None:
    truth = {name: (1.2 * x, 1.2 * y) for name, (x, y, _) in LINE.items()}
    network = network_of("ABCDE", [], cloud=LINE, gps=0.01, horizontal=truth)
    found = fit(network, "shift", True)
    assert found.mode == "shift"
    assert found.factor == pytest.approx(1.2, abs=5 * found.std)


def test_vertical_that_is_hardly_known_is_not_applied() -> None:
    """Low relief and GPS good to 3 m: the tilt is anybody's guess, the tapes' scale is not."""
    truth = survey(1, relief=0.3, gps=20.0)
    with pytest.raises(ControlError, match="hardly fix the vertical"):
        fit(truth.network, "full", False)
    found = fit(truth.network, "auto", False)
    assert found.mode == "scale"
    assert any("hardly fix the vertical" in note for note in found.warnings)
    assert abs(found.factor - truth.factor) < 3.0 * found.std


def test_vertical_that_is_known_poorly_is_warned_of() -> None:
    truth = survey(0, gps=6.0)
    found = fit(truth.network, "full", False)
    assert found.tilt_std_deg is not None
    assert 2.0 < found.tilt_std_deg < 20.0
    assert any(f"known to {found.tilt_std_deg:.1f} degrees only" in w for w in found.warnings)
