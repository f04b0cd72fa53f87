"""Baarda's smallest detectable error, and lengths held against positions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from networks import survey

from quantify_client.errors import ControlError
from quantify_client.scaler.adjustment.between_groups import compare_with_positions
from quantify_client.scaler.adjustment.fit import fit
from quantify_client.scaler.adjustment.network import Freedom, Model, Network
from quantify_client.scaler.adjustment.solve import Adjustment, evaluate, minimise
from quantify_client.scaler.adjustment.start import starts

pytestmark = pytest.mark.one_python


def adjusted(network: Network) -> Adjustment:
    """Adjust everything, the size being unknown, and leave nothing out."""
    freedom = Freedom(0, shift_xy=False, shift_z=False)
    model = Model(network, freedom, starts(network, freedom)[0])
    used = np.ones(len(model.kind), dtype=bool)
    state, _ = minimise(model, used, {}, robust=False, evaluations=50)
    return evaluate(model.at(state), used, {}, ())


def test_an_error_that_is_called_detectable_is_found_in_four_of_five_surveys() -> None:
    trials, found = 40, 0
    for seed in range(trials):
        made = survey(seed, points=5, tapes=8, gps=1e4)
        good = adjusted(made.network)
        row = int(np.flatnonzero(good.model.kind == "distance")[0])
        length = made.network.length.copy()
        length[0] += good.detectable()[row]
        wrong = adjusted(replace(made.network, length=length))
        found += bool(wrong.excess[wrong.model.group[row]] > 1.0)
    assert found == pytest.approx(0.8 * trials, abs=3.0 * np.sqrt(0.8 * 0.2 * trials))


def test_feet_are_refused_where_the_positions_cannot_turn_the_cloud() -> None:
    """A flat site without elevations, a cloud in a frame of its own: only the size is fitted."""
    made = survey(2, relief=0.0, gps=3.0)
    assert fit(made.network, "auto", georeferenced=False).mode == "scale"
    feet = replace(made.network, length=made.network.length / 0.3048)
    with pytest.raises(ControlError, match="are feet and metres mixed up"):
        fit(feet, "auto", georeferenced=False)


@pytest.mark.parametrize("gps", [0.02, 3.0])
@pytest.mark.parametrize("relief", [0.0, 6.0])
def test_good_surveys_are_not_called_wrong_as_a_whole(gps: float, relief: float) -> None:
    for seed in range(10):
        network = survey(seed, gps=gps, relief=relief).network
        assert compare_with_positions(network)[1] == 0.0
