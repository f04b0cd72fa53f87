"""The picture of a scaling is drawn whatever its control is like, and shows what is wrong."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path
from typing import Any, Dict

import numpy as np
import pytest
from PIL import Image

from quantify_client import write_report
from quantify_client.report.figures.control.figure import scale_picture
from quantify_client.report.figures.control.plan import control_plan
from quantify_client.report.figures.look import RESIDUALS
from quantify_client.report.wording.units import METRIC, US
from quantify_client.types import Scaling

from . import scalings, surveys

RED = (200, 16, 46)


def draw(scaling: Scaling) -> np.ndarray:
    image = Image.open(io.BytesIO(scale_picture(scaling, METRIC))).convert("RGB")
    return np.asarray(image).astype(int)


def count(image: np.ndarray, colour: Any) -> int:
    return int((np.abs(image - np.array(colour)).max(axis=-1) < 12).sum())


def one_point() -> Scaling:
    return replace(scalings.everything(), points=scalings.everything().points[:1])


def at_one_place() -> Scaling:
    points = [replace(p, east=0.0, north=0.0) for p in scalings.everything().points]
    return replace(scalings.everything(), points=points)


def without_residuals() -> Scaling:
    points = [replace(p, gps_residual=None, cloud_residual=None) for p in scalings.crowd(9).points]
    return scalings.scaling(points=points)


def exact() -> Scaling:
    zero = [replace(p, gps_residual=(0.0, 0.0), cloud_residual=(0.0, 0.0, 0.0))
            for p in scalings.crowd(9).points]  # fmt: skip
    return scalings.scaling(points=zero)


def not_a_number() -> Scaling:
    scaling = scalings.everything()
    points = [replace(scaling.points[0], east=float("nan")), *scaling.points[1:]]
    points[1] = replace(points[1], cloud_residual=(float("nan"), 0.0, 0.0))
    odd = replace(scaling.observations[-1], sigma=0.0, residual=float("nan"))
    return replace(scaling, points=points, observations=[*scaling.observations, odd])


CASES: Dict[str, Scaling] = {
    "everything": scalings.everything(),
    "phone": scalings.everything(gps=3.0),
    "least": scalings.least(),
    "nothing": scalings.scaling(),
    "two points": scalings.in_a_line(2),
    "west to east": scalings.in_a_line(),
    "south to north": scalings.in_a_line(4, (0.0, 1.0)),
    "100 points": scalings.crowd(),
    "unplaced": scalings.unplaced(),
    "one point": one_point(),
    "at one place": at_one_place(),
    "without residuals": without_residuals(),
    "exact": exact(),
    "not a number": not_a_number(),
    "hostile": scalings.everything(name=scalings.HOSTILE),
    "long": scalings.everything(name="x" * 300),
    "dollar": scalings.everything(name="$\\frac{"),
}


@pytest.mark.parametrize("case", CASES)
def test_every_control_is_drawn(case: str) -> None:
    image = np.asarray(Image.open(io.BytesIO(scale_picture(CASES[case], US))).convert("L"))
    assert image.shape[1] == 1400
    assert 300 < image.shape[0] < 1300
    assert (image < 128).sum() > 2_000


def test_only_what_was_left_out_is_red() -> None:
    scaling = scalings.everything()
    right = [o for o in scaling.observations if not o.outlier]
    assert count(draw(scaling), RED) > 1_500
    assert count(draw(replace(scaling, observations=right, conflict="")), RED) == 0


def test_arrows_are_exaggerated_by_a_round_factor_and_stay_in_the_view() -> None:
    plan = control_plan(scalings.everything(), METRIC)
    assert plan is not None
    for arrows in (plan.cloud, plan.gps):
        assert arrows is not None
        assert f"{arrows.factor:.0e}"[0] in "125"
        assert arrows.drawn == pytest.approx(arrows.residual * arrows.factor, abs=1e-12)
        west, east, south, north = plan.view(1.2)
        tips = arrows.start + arrows.drawn
        assert (tips > (west, south)).all()
        assert (tips < (east, north)).all()


def test_a_residual_is_an_arrow_of_its_own_point() -> None:
    scaling = scalings.everything()
    plan = control_plan(scaling, METRIC)
    assert plan is not None
    assert plan.gps is not None
    assert len(plan.gps.start) == 7  # of nine points seven have positions
    point = scaling.points[0]
    assert plan.gps.start[0] == pytest.approx((point.east, point.north))
    assert plan.gps.residual[0] == pytest.approx(point.gps_residual)


def test_positions_100_times_worse_are_told_and_not_drawn() -> None:
    plan = control_plan(scalings.everything(gps=6.0), METRIC)
    assert plan is not None
    assert plan.gps is None
    assert plan.hidden_gps > 1.0


def test_view_keeps_the_aspect_and_holds_all_points() -> None:
    for scaling in (scalings.in_a_line(2), scalings.crowd(), at_one_place()):
        plan = control_plan(scaling, US)
        assert plan is not None
        for aspect in (0.7, 1.0, 1.6):
            west, east, south, north = plan.view(aspect)
            assert (east - west) / (north - south) == pytest.approx(aspect, rel=1e-9)
            assert (plan.at > (west, south)).all()
            assert (plan.at < (east, north)).all()


def test_too_short_is_blue_and_too_long_is_brown() -> None:
    short, fits, long = (RESIDUALS(v)[:3] for v in (0.1, 0.5, 0.9))
    assert short[2] - short[0] > 0.3
    assert long[0] - long[2] > 0.3
    assert max(fits) - min(fits) < 0.05


def test_report_has_the_picture_and_the_next_without_scale_removes_it(tmp_path: Path) -> None:
    scaled = surveys.measurement(surveys.body(), scale=scalings.everything())
    names = [path.name for path in write_report(scaled, tmp_path)]
    assert names[3] == "scale.png"
    html = (tmp_path / "report.html").read_text("utf-8")
    assert html.count("data:image/png;base64,") == 2
    write_report(surveys.measurement(surveys.body()), tmp_path)
    assert not (tmp_path / "scale.png").exists()
