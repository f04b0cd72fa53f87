"""A check is held against the numbers that are printed, when these have had their last change."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any, Tuple

import numpy as np
import pytest
from scans import scan, volume_of
from solids import BODIES
from test_calibration import SHAPES, SIDE, _measure

from quantify_client.pipeline.checking import with_check_warnings
from quantify_client.types import AreaResult, Check, Measurement
from quantify_client.volcalc.terrain import grid_offsets, tin
from quantify_client.volcalc.terrain.measure import Measured, Sides
from quantify_client.volcalc.terrain.warnings import Findings

pytestmark = pytest.mark.one_python


def said(off: float, std: float, margin: float = 0.0, **changes: Any) -> Tuple[str, ...]:
    """Return what is said of a check that is so far off a volume of 100 m3."""
    known = dict.fromkeys(AreaResult.__dataclass_fields__)
    known.update(volume_m3=100.0, cut_m3=100.0, fill_m3=0.0, std_m3=std, warnings=())
    known.update(checks=(Check("prisms", 100.0 + off, margin),), **changes)
    (result,) = with_check_warnings(
        replace(
            Measurement("", None, "m", "terrain", "terrain", None, (), (), {}),
            results=(AreaResult(**known),),
        )
    ).results
    return tuple(result.warnings)


@pytest.mark.parametrize("off", [-0.11, 0.11])
def test_a_check_outside_the_interval_is_said_however_small_the_difference(off: float) -> None:
    (line,) = said(off, 0.05)
    assert f"gives {100 + off:.3f} m3, 0.110 m3 from the volume" in line
    assert "95 % interval of +-0.098 m3" in line
    assert line.code == "check-contradicts"
    assert line.values["difference_m3"] == pytest.approx(0.11)
    assert line.values["check_m3"] == 100.0 + off


def test_digits_that_no_difference_has_are_not_printed() -> None:
    (line,) = said(-0.177589577678683, 8.5e-14)
    assert "gives 99.82241 m3, 0.17759 m3 from" in line
    assert "+-1.7e-13 m3, and more than the +-0 m3" in line


def test_a_check_inside_the_interval_or_off_by_chance_or_rounding_is_not_worth_a_word() -> None:
    assert said(0.09, 0.05) == ()
    assert said(0.11, 0.05, margin=0.12) == ()
    assert said(1e-6, 0.0) == ()
    assert said(0.2, None) == ()


def test_a_body_is_referred_to_its_sections() -> None:
    assert "look at the sections" in said(3.0, 0.5, cut_m3=None, fill_m3=None)[0]


def test_what_widens_the_interval_later_counts() -> None:
    """The error of the scale joins when everything else is measured."""
    assert said(0.11, 0.05)
    assert not said(0.11, 0.06)


# --- the mean over the grid offsets, and its warnings


def test_the_check_is_over_the_mean_base_as_the_volume_is() -> None:
    """A base that is lower by 0.3 m3 with one of two grid offsets makes both greater by 0.15."""
    known = dict.fromkeys(AreaResult.__dataclass_fields__)
    known.update(volume_m3=8.0, cut_m3=8.0, fill_m3=0.0, slices=(), budget=(), warnings=())
    known.update(checks=(Check("prisms", 7.9, 0.2),), coverage=0.5, area_m2=9.0)
    first = Measured(
        AreaResult(**known), Findings(), None, 0.0, below=100.0, flanks=None, walled=False
    )
    result = grid_offsets._combined([first], [(Sides(8.4, 0.0, below=99.7),)])
    assert result.volume_m3 == pytest.approx(8.2)
    assert result.checks == (Check("prisms", pytest.approx(8.05), 0.2),)  # the margin of the first
    assert len(result.warnings) == 1  # of the coverage, once


def survey(seed: int, count: int = 10_000) -> AreaResult:
    """A plain cone with white noise and strays."""
    rng = np.random.default_rng(seed)
    heights, polygon, _ = SHAPES["cone"]
    u, v = rng.uniform(-SIDE / 2, SIDE / 2, (2, count))
    z = 160.0 + heights(u, v) + rng.normal(0, 0.03, count)
    z[rng.random(count) < 0.01] += 5.0
    return _measure(u + 576018.0, v + 5188018.0, z, polygon)


def test_a_plain_cone_is_not_warned_of() -> None:
    """1 of 5 was: the check's own error was left out."""
    offs = []
    for seed in range(8):
        result = survey(seed)
        assert not with_check_warnings(measurement_of(result)).results[0].warnings
        offs.append((result.checks[0].volume_m3 - result.volume_m3) / result.checks[0].margin_m3)
    # The margin is 2.6 standard deviations and more; it is no blank cheque either.
    assert 0.05 < np.sqrt(np.mean(np.square(offs))) < 0.6


@pytest.mark.parametrize("name", ["cube", "L-prism"])
def test_a_body_with_edges_is_not_warned_of(name: str) -> None:
    """Flooded cells lack 2.5 % of a prism with few points: a tenth of what they correct."""
    result = volume_of(scan(BODIES[name](), 4000, seed=4))
    off = abs(result.checks[0].volume_m3 - result.volume_m3)
    assert off > 0.015 * result.volume_m3
    assert off < result.checks[0].margin_m3 < 0.05 * result.volume_m3
    lines = with_check_warnings(measurement_of(result)).results[0].warnings
    assert not any("check by" in line for line in lines)


def test_a_check_that_is_wrong_is_told_with_the_numbers_printed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    whole = tin.tin_integral

    def wrong(*args: Any, **kind: Any) -> Any:
        found = whole(*args, **kind)
        return replace(found, volume=found.volume + 9.0)

    monkeypatch.setattr(tin, "tin_integral", wrong)
    result = survey(0)
    (line,) = with_check_warnings(measurement_of(result)).results[0].warnings
    given, off, wide, chance = map(float, re.findall(r"([\d.]+) m3", line))
    std = result.std_m3 or 0.0
    assert given == pytest.approx(result.checks[0].volume_m3, abs=0.05 * std)
    assert off == pytest.approx(abs(given - result.volume_m3), abs=0.1 * std)
    assert wide == pytest.approx(1.96 * std, abs=0.05 * std)
    assert off > chance


def measurement_of(result: AreaResult) -> Measurement:
    return Measurement("", None, "m", "terrain", "terrain", None, (result,), (), {})
