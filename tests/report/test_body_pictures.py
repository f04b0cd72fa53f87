"""The pictures of a body measured by sections."""

from __future__ import annotations

import dataclasses
import io
import math
import re
from pathlib import Path
from typing import Any, Dict, List

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.path import Path as DrawnPath
from PIL import Image

from quantify_client.report.figures import pictures
from quantify_client.report.figures.body import (
    draw_sections,
    draw_stack,
    even_odd,
    evenly_spaced,
    sections_of,
)
from quantify_client.report.figures.slices import draw_convergence, draw_heights
from quantify_client.report.wording.units import METRIC, US
from quantify_client.types import AreaResult

from . import bodies, surveys
from .bodies import body_of, plain, with_body
from .test_reading import page


def axes() -> Any:
    figure = Figure(figsize=(6, 7), dpi=50)
    FigureCanvasAgg(figure)
    return figure.add_axes((0.1, 0.1, 0.8, 0.8))


def texts(drawn: Any) -> List[str]:
    return [plain(text.get_text()) for text in drawn.texts]


# Sections


def test_sections_lie_at_their_heights_above_the_origin() -> None:
    ball = bodies.ball()
    sections = sections_of(ball, body_of(ball))
    assert len(sections) == 40
    assert [s.z for s in sections[:2]] == pytest.approx([0.025, 0.075], abs=1e-9)
    assert (sections[0].share, sections[-1].share) == (0.0, 1.0)
    for section in sections:
        radius = math.sqrt(1 - (section.z - 1) ** 2)
        assert np.hypot(*section.rings[0].T) == pytest.approx(radius, abs=1e-9)


def test_sections_are_chosen_evenly_over_the_height() -> None:
    ball = bodies.ball(slices=240)
    some = evenly_spaced(sections_of(ball, body_of(ball)), 12)
    steps = np.diff([section.z for section in some])
    assert len(some) == 12
    assert steps == pytest.approx(2.0 / 12, abs=0.01)
    few = sections_of(bodies.ball(slices=5), body_of(bodies.ball(slices=5)))
    assert evenly_spaced(few, 12) == few


def test_a_slice_without_outline_is_not_drawn() -> None:
    ball = bodies.ball()
    outlines = [[], *body_of(ball).outlines[1:-1], [np.zeros((2, 2))]]
    assert len(sections_of(ball, body_of(with_body(ball, outlines=outlines)))) == 38


def test_a_ring_in_a_ring_is_a_hole_and_one_in_that_is_solid() -> None:
    rings = [bodies.circle(r, 3.0, 4.0) for r in (1.0, 3.0, 2.0)]
    unit = bodies.shoelace(bodies.circle(1.0))
    for order in ([0, 1, 2], [2, 0, 1]):
        area = even_odd([rings[i] for i in order])
        assert area.area == pytest.approx((9 - 4 + 1) * unit, rel=1e-9)


def test_broken_rings_are_drawn_as_far_as_they_surround_something() -> None:
    bow_tie = np.array([[0.0, 0], [2, 2], [2, 0], [0, 2]])
    spike = np.array([[5.0, 0], [6, 0], [6, 1], [9, 1], [6, 1], [5, 1]])
    flat = np.array([[0.0, 9], [1, 9], [2, 9]])
    assert even_odd([bow_tie]).area == pytest.approx(2.0)
    assert even_odd([bow_tie, spike, flat]).area == pytest.approx(3.0)
    assert even_odd([flat]).is_empty


def test_hundreds_of_rings_are_no_trouble() -> None:
    rings = [bodies.circle(0.4, x, y) for x in range(20) for y in range(21)]
    assert even_odd(rings).area == pytest.approx(420 * bodies.shoelace(rings[0]))


def windings(path: DrawnPath) -> List[float]:
    """The signed area of each ring of a path."""
    starts = [*np.flatnonzero(path.codes == DrawnPath.MOVETO), len(path.codes)]
    signed = []
    for first, last in zip(starts[:-1], starts[1:]):
        x, y = path.vertices[first:last].T
        signed.append(float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) / 2))
    return signed


# Pictures


def test_twelve_tori_are_drawn_to_one_scale_with_their_holes_open() -> None:
    torus, drawn = bodies.torus(), axes()
    some = evenly_spaced(sections_of(torus, body_of(torus)), 12)
    draw_sections(drawn, some, METRIC)
    assert len(drawn.collections) == 12
    scales = []
    for cell, section in zip(drawn.collections, some[::-1]):
        outer, hole = sorted(windings(cell.get_paths()[0]), key=abs, reverse=True)
        assert outer > 0 > hole
        scales.append((outer + hole) / section.slice.area_m2)
    assert scales == pytest.approx([scales[0]] * 12, rel=1e-6)


def test_sections_are_labelled_from_the_highest_with_elevation_and_area() -> None:
    ball, drawn = bodies.ball(), axes()
    some = evenly_spaced(sections_of(ball, body_of(ball)), 12)
    draw_sections(drawn, some, METRIC)
    shown = texts(drawn)
    assert shown[:3] == [
        "1",
        "331.88 m",
        METRIC.area_text(some[-1].slice.area_m2).replace("\u00a0", " "),
    ]
    assert shown[-4:-2] == ["12", "330.12 m"]
    assert shown[-1] == "1 m"  # the scale bar


def test_us_units_label_feet() -> None:
    ball, drawn = bodies.ball(), axes()
    draw_sections(drawn, evenly_spaced(sections_of(ball, body_of(ball)), 12), US)
    assert any(re.fullmatch(r"1 088\.8\d* ft", text) for text in texts(drawn))
    assert not any(text.endswith(" m") for text in texts(drawn))


def test_numbers_in_the_profile_stand_at_their_sections_heights() -> None:
    ball, drawn = bodies.ball(), axes()
    some = evenly_spaced(sections_of(ball, body_of(ball)), 12)
    draw_heights(drawn, ball, some, METRIC)
    places = {text.get_text(): text.xy[1] for text in drawn.texts}
    assert places["1"] == pytest.approx(some[-1].slice.z_m)
    assert places["12"] == pytest.approx(some[0].slice.z_m)
    low, high = drawn.get_ylim()
    assert low < 330.0 < 332.0 < high
    assert len(drawn.collections[0].get_paths()) == 40


def test_convergence_shows_every_volume_the_result_and_its_interval() -> None:
    ball, drawn = bodies.ball(), axes()
    draw_convergence(drawn, ball, body_of(ball), METRIC)
    line = next(line for line in drawn.lines if line.get_label() == "slices as boxes")
    counts, volumes = zip(*body_of(ball).convergence)
    assert list(line.get_xdata()) == list(counts)
    assert line.get_ydata() == pytest.approx(volumes)
    result = next(line for line in drawn.lines if line.get_label() == "result")
    assert result.get_ydata() == pytest.approx([ball.volume_m3] * 2)
    band = drawn.patches[0].get_bbox()
    half = 1.96 * 0.01 * ball.volume_m3
    assert (band.y0, band.y1) == pytest.approx((ball.volume_m3 - half, ball.volume_m3 + half))
    assert drawn.get_xscale() == "log"


def test_later_slabs_of_the_stack_lie_on_earlier_ones() -> None:
    ball, drawn = bodies.ball(), axes()
    draw_stack(drawn, sections_of(ball, body_of(ball)))
    heights = [c.get_paths()[-1].vertices[:, 1].mean() for c in drawn.collections]
    assert len(heights) == 40
    assert heights == sorted(heights)
    assert texts(drawn) == ["all 40 slices, to scale"]


def picture(result: AreaResult) -> Any:
    measurement = bodies.measurement(result)
    png = pictures.area_picture(result, measurement, METRIC)
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).astype(int)


POOR: Dict[str, Dict[str, Any]] = {
    "no outlines": {"outlines": [[] for _ in range(40)]},
    "no points": {"points": np.zeros((0, 3), np.float32)},
    "no convergence": {"convergence": []},
    "no floor": {"floor": None, "ground": np.zeros((0, 3), np.float32)},
    "one corner short": {"outlines": [[np.zeros((2, 2))]] * 40},
    "a point, not a body": {"outlines": [[np.zeros((4, 2))]] * 40},
}


@pytest.mark.parametrize("change", POOR)
def test_poor_solids_are_drawn_all_the_same(change: str, tmp_path: Path) -> None:
    result = with_body(bodies.ball(), **POOR[change])
    assert picture(result).shape[1] == 1400
    html = page(bodies.measurement(result), tmp_path)
    assert html.endswith("</html>\n")


def test_a_body_without_slices_and_interval_is_drawn() -> None:
    result = with_body(bodies.ball(), outlines=[])
    assert picture(dataclasses.replace(result, slices=(), std_m3=None)).shape[1] == 1400


@pytest.mark.parametrize("name", ["砂 🏔", "$\\frac{", "", surveys.HOSTILE])
def test_any_name_of_a_body_can_be_drawn(name: str) -> None:
    assert picture(bodies.torus(name, slices=8, points=600)).shape[1] == 1400
