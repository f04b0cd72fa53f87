"""An error that all observations of a kind share: kinds contradict each other, not tapes."""

from __future__ import annotations

from dataclasses import replace
from typing import Tuple

import numpy as np
import pytest
from networks import survey

from quantify_client.errors import ControlError
from quantify_client.scaler.adjustment.fit import ScaleFit, fit

#: Whole commands: what they are made of is tested on the second Python as well.
pytestmark = pytest.mark.one_python


def lengthened(factor: float, **options: float) -> Tuple[ScaleFit, float]:
    made = survey(2, **options)
    network = replace(made.network, length=made.network.length * factor)
    return fit(network, "auto", georeferenced=False), made.factor


def test_tapes_a_percent_too_long_are_told_and_doubted() -> None:
    found, truth = lengthened(1.01, gps=0.02)
    assert found.factor == pytest.approx(1.01 * truth, rel=1e-3)
    # half of the difference of 1 %, and the truth within two of it
    assert found.std / found.factor == pytest.approx(0.005, rel=0.1)
    (said,) = [note for note in found.warnings if "as a whole" in note]
    assert said.startswith("by the tapes alone the scale is 1.21")
    assert "the positions alone 1.20" in said


def test_feet_for_metres_are_refused_by_name() -> None:
    with pytest.raises(ControlError, match=r"as a whole \(are feet and metres mixed up\?\)"):
        lengthened(0.3048, gps=0.02)


def test_positions_that_know_less_have_no_say() -> None:
    found, truth = lengthened(1.01, gps=3.0)
    assert found.factor == pytest.approx(1.01 * truth, rel=1e-3)
    assert not [note for note in found.warnings if "as a whole" in note]


@pytest.mark.parametrize("seed", range(5))
def test_kinds_that_agree_are_left_alone(seed: int) -> None:
    found = fit(survey(seed, gps=0.02).network, "auto", georeferenced=False)
    assert found.std / found.factor < 5e-4
    assert not [note for note in found.warnings if "as a whole" in note]


def test_bars_that_contradict_the_tapes_are_told() -> None:
    made = survey(4)
    network, lengths = made.network, made.network.length.copy()
    bars = np.arange(len(lengths)) < 4
    lengths[bars] *= 1.03
    network = replace(network, length=lengths, bar=bars)
    found = fit(network, "auto", georeferenced=False)
    (said,) = [note for note in found.warnings if "as a whole" in note]
    assert "scale bars alone" in said
    assert abs(found.factor / made.factor - 1.0) < 3.5 * found.std / found.factor
