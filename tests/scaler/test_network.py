"""The equations: what is computed, and its derivatives; where the adjustment starts."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from networks import Tape, network_of, survey
from scipy.spatial.transform import Rotation

from quantify_client.scaler.adjustment.network import Freedom, Model, State
from quantify_client.scaler.adjustment.start import scale_of_lengths, starts

LARGE = Rotation.from_rotvec([1.2, -2.0, 0.7]).as_matrix()
FREEDOMS = [
    Freedom(turn, shift_xy, shift_z, scale)
    for turn in (0, 1, 3)
    for shift_xy, shift_z, scale in [(True, True, True), (True, False, True), (False, False, False)]
]


def model(freedom: Freedom, radius: float, rotation: np.ndarray = LARGE) -> Model:
    """Of a survey with everything that can be observed, about a state that is not its answer."""
    made = survey(4, points=5, tapes=6, levelled=3, rotation=LARGE)
    bar = np.arange(len(made.network.ends)) == 1
    network = replace(made.network, radius_m=radius, bar=bar)
    points = made.points + np.random.default_rng(1).normal(0, 1, made.points.shape)
    return Model(network, freedom, State(points, 0.3, rotation, np.array([5.0, -3.0, 2.0])))


@pytest.mark.parametrize("freedom", FREEDOMS, ids=str)
@pytest.mark.parametrize("radius", [math.inf, 6.37e6, 2e3])
@pytest.mark.parametrize("away", [0.0, 1e-8, 0.4], ids="away{}".format)
def test_derivatives_are_those_of_differences(freedom: Freedom, radius: float, away: float) -> None:
    """Also where the unknowns have gone far from the start: the angles by 23 degrees and more."""
    equations = model(freedom, radius)
    unknowns = away * np.random.default_rng(2).uniform(0.5, 1.5, equations.size)
    found = equations.jacobian(unknowns)
    assert found.shape == (len(equations.kind), equations.size)
    step = 1e-5
    for column in range(equations.size):
        move = np.zeros(equations.size)
        move[column] = step
        ahead, behind = equations.computed(unknowns + move), equations.computed(unknowns - move)
        assert found[:, column] == pytest.approx((ahead - behind) / (2 * step), abs=2e-6)


@pytest.mark.parametrize("angles", [(0.0, 0.0, 0.0), (0.0, 0.0, 3.0), (2.0, 1.0, -1.5)])
def test_derivatives_after_a_large_turn(angles) -> None:
    equations = model(Freedom(3, True, True), 6.37e6, Rotation.from_rotvec(angles).as_matrix())
    unknowns = np.zeros(equations.size)
    unknowns[equations.angle_columns] = [0.9, -1.4, 2.1]
    found, step = equations.jacobian(unknowns), 1e-5
    for column in equations.angle_columns:
        move = np.zeros(equations.size)
        move[column] = step
        ahead, behind = equations.computed(unknowns + move), equations.computed(unknowns - move)
        assert found[:, column] == pytest.approx((ahead - behind) / (2 * step), abs=2e-6)


def test_everything_is_computed_as_by_hand() -> None:
    network = network_of(
        "AB",
        [Tape("A", "B", 13.0)],
        horizontal={"A": (1.0, 2.0)},
        elevation={"B": 7.0},
        cloud={"A": (10.0, 0.0, 0.0), "B": (14.0, 0.0, 0.0)},
        radius=1000.0,
    )
    points = np.array([(30.0, 40.0, 100.0), (33.0, 44.0, 112.0)])
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # east becomes north
    state = State(points, math.log(2.0), quarter, np.array([30.0, 40.0, 100.0]))
    equations = Model(network, Freedom(3, True, True), state)
    assert equations.kind.tolist() == ["gps"] * 2 + ["elevation"] + ["cloud"] * 6 + ["distance"]
    assert equations.computed(np.zeros(equations.size)) == pytest.approx(
        [
            *(30.0 / 1.1, 40.0 / 1.1),  # its shadow at the height of the origin
            112.0 + (33.0**2 + 44.0**2) / 2000.0,  # the Earth falls away below the plane
            *(12.0, 0.0, 0.0),  # the pivot, 12 0 0, is where the shift is
            *(12.0 + 4.0 / 2.0, -3.0 / 2.0, 12.0 / 2.0),
            13.0,
        ]
    )
    assert equations.observed.tolist() == [1, 2, 7, 10, 0, 0, 14, 0, 0, 13]
    assert equations.sigma == pytest.approx([3, 3, 0.02, *[0.01] * 6, 0.005])
    assert equations.group.tolist() == [0, 0, 1, 2, 2, 2, 3, 3, 3, 4]
    assert equations.component.tolist() == [0, 1, 0, 0, 1, 2, 0, 1, 2, 0]
    assert equations.index.tolist() == [0, 0, 1, 0, 0, 0, 1, 1, 1, 0]


def test_whitened_rows_have_unit_variance_and_no_correlation() -> None:
    equations = model(Freedom(3, True, True), math.inf)
    generator = np.random.default_rng(3)
    root = generator.normal(0, 0.02, (5, 3, 3))
    covariance = root @ root.transpose(0, 2, 1) + 1e-6 * np.eye(3)
    equations = Model(
        replace(equations.network, cloud_covariance=covariance), equations.freedom, equations.start
    )
    whole = np.diag(equations.sigma**2)
    for group in np.unique(equations.group[equations.kind == "cloud"]):
        rows = np.flatnonzero(equations.group == group)
        whole[np.ix_(rows, rows)] = covariance[equations.index[rows[0]]]
    half = equations.whiten(np.linalg.cholesky(whole))
    assert half @ half.T == pytest.approx(np.eye(len(whole)), abs=1e-9)


def test_state_counts_from_the_start() -> None:
    equations = model(Freedom(1, True, False), math.inf)
    unknowns = np.zeros(equations.size)
    unknowns[4] = 0.25  # north of the second point
    unknowns[equations.angle_columns] = math.radians(30.0)
    unknowns[equations.shift_columns] = 7.0, 8.0
    unknowns[equations.scale_column] = math.log(2.0)
    there = equations.state(unknowns)
    moved = np.zeros((5, 3))
    moved[1, 1] = 0.25
    assert there.points - equations.start.points == pytest.approx(moved)
    turn = Rotation.from_euler("z", 30, degrees=True).as_matrix()
    assert there.rotation == pytest.approx(turn @ LARGE)
    assert there.shift == pytest.approx([12.0, 5.0, 2.0])
    assert there.log_scale == pytest.approx(0.3 + math.log(2.0))
    onward = equations.at(there)
    assert onward.computed(np.zeros(onward.size)) == pytest.approx(equations.computed(unknowns))


def test_network_without_anything_has_no_equations() -> None:
    empty = network_of("A")
    assert empty.pivot.tolist() == [0.0, 0.0, 0.0]
    equations = Model(
        empty, Freedom(0, False, False), State(np.zeros((1, 3)), 0.0, np.eye(3), np.zeros(3))
    )
    assert equations.size == 4
    assert equations.computed(np.zeros(4)).shape == (0,)
    assert equations.jacobian(np.zeros(4)).shape == (0, 4)


def test_scale_to_start_from_is_the_median_of_the_lengths() -> None:
    cloud = {"A": (0, 0, 0), "B": (10, 0, 0), "C": (0, 10, 0), "D": (0, 0, 10)}
    tapes = [
        Tape("A", "B", 12.0),
        Tape("A", "C", 12.2),
        Tape("A", "D", 50.0),  # a gross error
        Tape("B", "C", 1.0, check=True),
        Tape("A", "E", 1.0),  # E is not in the cloud
    ]
    assert scale_of_lengths(network_of("ABCDE", tapes, cloud=cloud)) == pytest.approx(1.22)
    assert scale_of_lengths(network_of("ABCDE", tapes[3:], cloud=cloud)) is None


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("levelled", [0, 4])
def test_one_of_the_starts_of_a_perfect_survey_is_its_answer(seed: int, levelled: int) -> None:
    made = survey(seed, noise=0.0, levelled=levelled)
    found = starts(made.network, Freedom(3, True, levelled > 0))
    best = min(found, key=lambda start: np.abs(start.rotation - made.rotation.T).max())
    assert best.rotation == pytest.approx(made.rotation.T, abs=1e-6)
    assert math.exp(best.log_scale) == pytest.approx(made.factor, rel=1e-9)
    assert best.points[:, :2] == pytest.approx(made.points[:, :2], abs=1e-4)
