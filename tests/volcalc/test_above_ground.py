"""Heaps on their ground, measured as bodies."""

from __future__ import annotations

from dataclasses import replace
from typing import Optional

import numpy as np
import pytest
from scans import OFFSET, volume_of

from quantify_client.errors import InputError
from quantify_client.volcalc.body import find
from quantify_client.volcalc.body.above_ground import AboveGround, above_ground
from quantify_client.volcalc.body.floor import Standing, stand

RADIUS, HEIGHT = 10.0, 1.5
VOLUME = np.pi * RADIUS**2 * HEIGHT / 3.0  # of a cone


def flat_cone(count: int, noise: float, beside: float = 0.0) -> np.ndarray:
    """A cone in the middle of ground 40 m wide, and another one in a corner."""
    rng = np.random.default_rng(7)
    x, y = rng.uniform(-20.0, 20.0, (2, count))
    z = np.maximum(0.0, HEIGHT * (1.0 - np.hypot(x, y) / RADIUS))
    z += np.maximum(0.0, beside - 0.3 * np.hypot(x - 15.0, y - 15.0))
    return np.column_stack([x, y, z + rng.normal(0.0, noise, count)])


@pytest.mark.parametrize(
    "noise", [0.03, *(pytest.param(noise, marks=pytest.mark.one_python) for noise in (0.0, 0.05))]
)
def test_a_flat_heap_is_what_lies_above_its_ground(noise: float) -> None:
    """Also where the ground's noise reaches above its plane here and there: 3 % of the height."""
    result = volume_of(flat_cone(30_000, noise) + OFFSET)
    assert result.volume_m3 == pytest.approx(VOLUME, rel=0.005)
    assert abs(result.volume_m3 - VOLUME) < 2.6 * result.std_m3 < 0.02 * VOLUME
    assert sum(one.volume_m3 for one in result.slices) == pytest.approx(result.volume_m3)


def test_what_is_no_higher_than_noise_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """A blade on the ground was -0.00003 m3."""

    def below_the_ground(standing: Standing) -> Optional[AboveGround]:
        heap = above_ground(standing)
        return heap and replace(heap, rest=-VOLUME)

    monkeypatch.setattr(find, "above_ground", below_the_ground)
    with pytest.raises(InputError, match="no higher than the ground is uneven: -[0-9.]+ .- "):
        volume_of(flat_cone(10_000, 0.03) + OFFSET)


def test_ground_with_other_things_on_it_is_no_even_floor() -> None:
    for beside, expected in ((0.0, True), (0.6, False)):
        points = flat_cone(20_000, 0.01, beside)
        standing = stand(points, np.ones(len(points), dtype=np.int64), "auto")
        assert (above_ground(standing) is not None) == expected
