"""What a result says about itself."""

from types import SimpleNamespace

import numpy as np
import pytest

from quantify_client.types import Check
from quantify_client.volcalc.terrain import _warnings


def said(check_m3, std_m3):
    ground = SimpleNamespace(coverage=1.0, fraction=np.ones((2, 2)), filled=np.zeros((2, 2)))
    result = SimpleNamespace(volume_m3=100.0, cut_m3=100.0, fill_m3=0.0, std_m3=std_m3)
    return _warnings(ground, SimpleNamespace(name=0.0), None, result, [Check("prisms", check_m3)])


@pytest.mark.parametrize("off", [-0.11, 0.11])
def test_a_check_outside_the_interval_is_said_however_small_the_difference(off):
    assert "more than its 95 % interval of +-0.098 m3" in said(100.0 + off, 0.05)[0]


def test_a_check_inside_the_interval_or_off_by_rounding_is_not_worth_a_word():
    assert said(100.09, 0.05) == []
    assert said(100.0 + 1e-6, 0.0) == []
