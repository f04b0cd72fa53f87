"""One adjustment of everything: what it does not depend on, and what it finds wrong."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, List

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from networks import SCALE, Survey, Tape, network_of, outliers, survey

from quantify_client.scaler.adjustment.fit import fit
from quantify_client.scaler.adjustment.network import Freedom, Network
from quantify_client.scaler.adjustment.outliers import adjust
from quantify_client.scaler.adjustment.solve import Adjustment
from quantify_client.scaler.adjustment.summary import observations, worst_conflict

WHOLE = Freedom(3, shift_xy=True, shift_z=False)
SMALL = survey(5, points=6, tapes=8, levelled=3)


def seeds(count: int) -> List[Any]:
    """Seeds of surveys; a second Python has the first."""
    return [0, *(pytest.param(seed, marks=pytest.mark.one_python) for seed in range(1, count))]


def adjusted(network: Network, freedom: Freedom = WHOLE) -> Adjustment:
    return adjust(network, freedom)


# --- what the result does not depend on


@pytest.mark.parametrize("seed", seeds(6))
def test_without_errors_everything_is_recovered(seed: int) -> None:
    truth = survey(seed, noise=0.0, levelled=3 * (seed % 2))
    found = fit(truth.network, "full", False)
    assert found.factor == pytest.approx(truth.factor, rel=1e-9)
    points = found.adjustment.state.points
    if seed % 2:
        assert points == pytest.approx(truth.points, abs=1e-6)
        assert found.similarity.apply(truth.network.cloud) == pytest.approx(truth.points, abs=1e-6)
    assert points[:, :2] == pytest.approx(truth.points[:, :2], abs=1e-6)
    assert np.diff(points[:, 2]) == pytest.approx(np.diff(truth.points[:, 2]), abs=1e-6)
    assert found.similarity.rotation == pytest.approx(truth.rotation.T, abs=1e-7)


@pytest.mark.parametrize("seed", range(4))
def test_cloud_may_lie_at_utm_coordinates(seed: int) -> None:
    truth = survey(seed, levelled=4)
    near = fit(truth.network, "full", False)
    shift = np.array([576_700.0, 5_188_140.0, 310.0]) - truth.network.cloud.mean(axis=0).round()
    far = fit(replace(truth.network, cloud=truth.network.cloud + shift), "full", False)
    assert far.factor == pytest.approx(near.factor, rel=1e-9)
    assert far.std == pytest.approx(near.std, rel=1e-7)
    # Known to a metre only, so nothing is adjusted to the last digit here: a thousandth.
    assert far.adjustment.state.points == pytest.approx(near.adjustment.state.points, abs=1e-3)


def permuted(network: Network, points: np.ndarray, lengths: np.ndarray) -> Network:
    """The same with its points in another order, its lengths too, every other one turned round."""
    where = np.argsort(points)
    ends = where[network.ends[lengths]]
    ends[::2] = ends[::2, ::-1]
    return replace(
        network,
        names=tuple(network.names[i] for i in points),
        horizontal=network.horizontal[points],
        horizontal_sigma=network.horizontal_sigma[points],
        elevation=network.elevation[points],
        elevation_sigma=network.elevation_sigma[points],
        cloud=network.cloud[points],
        cloud_covariance=network.cloud_covariance[points],
        ends=ends,
        length=network.length[lengths],
        length_sigma=network.length_sigma[lengths],
        bar=network.bar[lengths],
        check=network.check[lengths],
        higher=network.higher[lengths],
    )


@pytest.mark.parametrize("seed", range(4))
def test_order_does_not_matter(seed: int) -> None:
    network = survey(seed).network
    generator = np.random.default_rng(seed)
    points, lengths = generator.permutation(12), generator.permutation(len(network.ends))
    one, other = fit(network, "full", False), fit(permuted(network, points, lengths), "full", False)
    assert other.factor == pytest.approx(one.factor, rel=1e-9)
    assert other.std == pytest.approx(one.std, rel=1e-9)
    assert other.adjustment.state.points == pytest.approx(
        one.adjustment.state.points[points], abs=1e-3
    )


@settings(max_examples=15)
@given(st.floats(1e-3, 1e3))
def test_size_of_the_cloud_does_not_matter(size: float) -> None:
    network = SMALL.network
    other = replace(
        network, cloud=size * network.cloud, cloud_covariance=size**2 * network.cloud_covariance
    )
    one, scaled = fit(network, "full", False), fit(other, "full", False)
    assert scaled.factor * size == pytest.approx(one.factor, rel=1e-9)
    assert scaled.std * size == pytest.approx(one.std, rel=1e-6)


# --- what each observation brings


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("levels", [0, 5])
def test_redundancies_sum_to_what_there_is_too_much(seed: int, levels: int) -> None:
    network = survey(seed, levelled=levels).network
    network.check[:2] = True
    found = adjusted(network, Freedom(3, shift_xy=True, shift_z=levels > 0))
    rows, unknowns = int(found.active.sum()), found.model.size
    assert rows == 12 * 2 + levels + 12 * 3 + len(network.length) - 2
    assert unknowns == 12 * 3 + 3 + 2 + (levels > 0) + 1
    assert np.nansum(found.redundancy) == pytest.approx(rows - unknowns, abs=1e-3)
    assert np.isnan(found.redundancy).sum() == 2
    assert np.nanmin(found.redundancy) >= 0.0


CLOUD = {"A": (0, 0, 0), "B": (20, 0, 1), "C": (22, 18, 3), "D": (-1, 21, -2)}


def test_tape_that_alone_fixes_the_scale_carries_it_all() -> None:
    network = network_of("ABCD", [Tape("A", "C", 30.0)], cloud=CLOUD)
    found = adjusted(network, Freedom(0, False, False))
    last = len(found.model.kind) - 1
    assert found.contribution()[last] == pytest.approx(1.0, abs=1e-3)
    assert found.redundancy[last] == pytest.approx(0.0, abs=1e-6)
    assert found.std_without(found.model.kind == "distance") > 1.0


def test_two_equal_tapes_carry_half_each() -> None:
    cloud = {"A": (0, 0, 0), "B": (20, 0, 0), "C": (0, 9, 0), "D": (20, 9, 0)}
    network = network_of("ABCD", [Tape("A", "B", 24.0), Tape("C", "D", 24.0)], cloud=cloud)
    found = adjusted(network, Freedom(0, False, False))
    lengths = found.model.kind == "distance"
    assert found.contribution()[lengths] == pytest.approx([0.5, 0.5], abs=1e-6)
    # Of each of the two, half is controlled by the other: of the tape and of its two picks.
    variance = 0.005**2 + 2 * (1.2 * 0.01) ** 2
    assert found.redundancy[lengths] == pytest.approx(0.5 * 0.005**2 / variance, rel=1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_std_without_is_that_of_a_fit_without(seed: int) -> None:
    network = survey(seed).network
    found = adjusted(network)
    column = found.model.scale_column
    last = found.model.index == len(network.length) - 1
    kept = np.arange(len(network.length)) < len(network.length) - 1
    lengths = {
        name: getattr(network, name)[kept]
        for name in ("ends", "length", "length_sigma", "bar", "check", "higher")
    }
    without = adjusted(replace(network, **lengths))
    std = math.sqrt(without.covariance[column, column])
    assert found.std_without(last & (found.model.kind == "distance")) == pytest.approx(
        std, rel=0.01
    )


def test_check_lengths_take_no_part_and_are_reported() -> None:
    truth = survey(6)
    network = truth.network
    plain = replace(
        network,
        **{
            name: getattr(network, name)[2:]
            for name in ("ends", "length", "length_sigma", "bar", "check", "higher")
        },
    )
    length = network.length.copy()
    length[0] += 5.0
    checked = replace(network, length=length, check=np.arange(len(length)) < 2)
    one, other = adjusted(plain), adjusted(checked)
    assert other.state.log_scale == pytest.approx(one.state.log_scale, abs=1e-10)
    assert other.state.points == pytest.approx(one.state.points, abs=1e-7)
    assert other.outliers == ()
    records = [r for r in observations(other) if r.check]
    assert len(records) == 2
    for number, record in enumerate(records):
        ends = network.ends[number]
        across = math.dist(*other.state.points[ends])
        assert record.names == tuple(network.names[end] for end in ends)
        assert record.adjusted == pytest.approx(across, abs=1e-9)
        assert record.residual == pytest.approx(across - length[number], abs=1e-9)
        assert (record.redundancy, record.contribution, record.outlier) == (None, None, False)
    assert records[0].residual == pytest.approx(-5.0, abs=0.06)
    assert abs(records[1].residual) < 0.06


# --- what is wrong


@pytest.mark.one_python
def test_sigmas_that_are_too_small_are_raised() -> None:
    """Of every tape three times; the scale's std follows."""
    raised, ratio = [], []
    for seed in range(5):
        network = survey(seed, tape=0.15).network
        told = replace(network, length_sigma=np.full(len(network.length), 0.05))
        found, fair = adjusted(told), adjusted(network)
        assert found.outliers == ()
        assert "distance" in found.raised
        raised.append(found.raised["distance"])
        column = found.model.scale_column
        ratio.append(math.sqrt(found.covariance[column, column] / fair.covariance[column, column]))
    assert np.mean(raised) == pytest.approx(3.0, rel=0.2)
    assert np.mean(ratio) == pytest.approx(1.0, rel=0.2)


@pytest.mark.parametrize("seed", seeds(10))
def test_wrong_pick_is_found(seed: int) -> None:
    truth = survey(seed, tapes=24)
    point = int(np.argmax(np.bincount(truth.network.ends.ravel())))
    off = np.random.default_rng(seed).normal(size=3)
    cloud = truth.network.cloud.copy()
    cloud[point] += 0.5 * off / np.linalg.norm(off)
    found = fit(replace(truth.network, cloud=cloud), "auto", False)
    assert outliers(found.adjustment) == {("cloud", point)}
    assert found.adjustment.raised == {}
    assert abs(found.factor - truth.factor) < 3.0 * found.std


@pytest.mark.parametrize("seed", seeds(5))
def test_wrong_elevation_among_five_is_found(seed: int) -> None:
    truth = survey(seed, levelled=5)
    elevation = truth.network.elevation.copy()
    elevation[seed] += 1.0
    found = fit(replace(truth.network, elevation=elevation), "full", False)
    assert outliers(found.adjustment) == {("elevation", seed)}
    assert abs(found.factor - truth.factor) < 3.0 * found.std


@pytest.mark.one_python
def test_wrong_position_is_found() -> None:
    truth = survey(2)
    horizontal = truth.network.horizontal.copy()
    horizontal[7] += [0.0, 100.0]
    found = fit(replace(truth.network, horizontal=horizontal), "auto", False)
    assert outliers(found.adjustment) == {("gps", 7)}


def test_two_bars_that_contradict_each_other_are_both_kept_and_doubted() -> None:
    bars = [Tape("A", "B", 24.0, 0.001, bar=True), Tape("C", "D", 30.0, 0.001, bar=True)]
    network = network_of("ABCD", bars, cloud=CLOUD, pick=0.001)
    found = adjusted(network, Freedom(0, False, False))
    assert found.outliers == ()
    assert found.raised["scale_bar"] > 100.0
    told = [r for r in observations(found) if r.kind == "scale_bar"]
    assert [r.sigma for r in told] == pytest.approx([0.001 * found.raised["scale_bar"]] * 2)
    assert "scale bar " in worst_conflict(found)
    # Both scales lie within two std of the result.
    for bar in bars:
        alone = bar.length / math.dist(CLOUD[bar.first], CLOUD[bar.second])
        column = found.model.scale_column
        std = math.sqrt(found.covariance[column, column])
        assert abs(math.log(alone) - found.state.log_scale) < 2.0 * std


def test_pair_taped_twice_that_nothing_else_controls_is_not_decided() -> None:
    """Which of both is wrong nobody can tell: none is left out, and all tapes are doubted."""
    tapes = [Tape("A", "B", 24.0), Tape("A", "B", 24.5), Tape("A", "C", 34.2), Tape("C", "D", 27.0)]
    cloud = {name: CLOUD[name] for name in "ACD"}
    network = network_of("ABCD", tapes, cloud=cloud, pick=0.01)
    found = adjusted(network, Freedom(0, False, False))
    assert found.outliers == ()
    assert found.raised["distance"] > 10.0


def test_equal_errors_of_tapes_far_apart_are_both_found() -> None:
    """Two statistics alike are two errors where leaving out one does not clear the other."""
    truth = survey(10)
    length = truth.network.length.copy()
    length[[13, 1]] += [0.5, -0.5]
    found = fit(replace(truth.network, length=length), "auto", False)
    assert outliers(found.adjustment) == {("distance", 1), ("distance", 13)}
    assert found.adjustment.raised == {}


def test_result_of_a_survey_is_that_of_its_truth() -> None:
    truth: Survey = SMALL
    found = fit(truth.network, "full", False)
    assert truth.factor == SCALE
    assert abs(found.factor - SCALE) < 3.0 * found.std
    residual = found.adjustment.residual / found.adjustment.sigma
    assert np.abs(residual).max() < 3.5
