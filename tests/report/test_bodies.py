"""The report of a body measured by sections: pictures, the view that turns, words, files."""

from __future__ import annotations

import base64
import csv
import dataclasses
import hashlib
import io
import json
import math
import re
from pathlib import Path
from typing import Any, Dict, List, Tuple

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.path import Path as DrawnPath
from PIL import Image

from quantify_client.report import pictures, to_json, write_report
from quantify_client.report.body_profile import draw_convergence, draw_heights
from quantify_client.report.body_words import floor_words, gap_words, left_out_words
from quantify_client.report.csvout import write_slices
from quantify_client.report.geojson import to_geojson
from quantify_client.report.multiples import draw_sections
from quantify_client.report.outlines import chosen, even_odd, sections_of
from quantify_client.report.stack import draw_stack
from quantify_client.report.units import METRIC, THIN_SPACE, US
from quantify_client.report.view import view_markup
from quantify_client.types import AreaResult, Floor, Gap, Solid

from . import bodies, surveys
from .test_documents import valid
from .test_reading import HOSTILE_TEXTS, Tags, page, printed


def solid_of(result: AreaResult) -> Solid:
    assert result.solid is not None
    return result.solid


def with_solid(result: AreaResult, **changes: Any) -> AreaResult:
    return dataclasses.replace(result, solid=dataclasses.replace(solid_of(result), **changes))


def axes() -> Any:
    figure = Figure(figsize=(6, 7), dpi=50)
    FigureCanvasAgg(figure)
    return figure.add_axes((0.1, 0.1, 0.8, 0.8))


def plain(text: str) -> str:
    return text.replace(THIN_SPACE, " ").replace("\u00a0", " ")


def texts(drawn: Any) -> List[str]:
    return [plain(text.get_text()) for text in drawn.texts]


# Sections


def test_sections_lie_at_their_heights_above_the_origin() -> None:
    ball = bodies.ball()
    sections = sections_of(ball, solid_of(ball))
    assert len(sections) == 40
    assert [s.z for s in sections[:2]] == pytest.approx([0.025, 0.075], abs=1e-9)
    assert (sections[0].share, sections[-1].share) == (0.0, 1.0)
    for section in sections:
        radius = math.sqrt(1 - (section.z - 1) ** 2)
        assert np.hypot(*section.rings[0].T) == pytest.approx(radius, abs=1e-9)


def test_sections_are_chosen_evenly_over_the_height() -> None:
    ball = bodies.ball(slices=240)
    some = chosen(sections_of(ball, solid_of(ball)), 12)
    steps = np.diff([section.z for section in some])
    assert len(some) == 12
    assert steps == pytest.approx(2.0 / 12, abs=0.01)
    few = sections_of(bodies.ball(slices=5), solid_of(bodies.ball(slices=5)))
    assert chosen(few, 12) == few


def test_a_slice_without_outline_is_not_drawn() -> None:
    ball = bodies.ball()
    outlines = [[], *solid_of(ball).outlines[1:-1], [np.zeros((2, 2))]]
    assert len(sections_of(ball, solid_of(with_solid(ball, outlines=outlines)))) == 38


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
    some = chosen(sections_of(torus, solid_of(torus)), 12)
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
    some = chosen(sections_of(ball, solid_of(ball)), 12)
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
    draw_sections(drawn, chosen(sections_of(ball, solid_of(ball)), 12), US)
    assert any(re.fullmatch(r"1 088\.8\d* ft", text) for text in texts(drawn))
    assert not any(text.endswith(" m") for text in texts(drawn))


def test_numbers_in_the_profile_stand_at_their_sections_heights() -> None:
    ball, drawn = bodies.ball(), axes()
    some = chosen(sections_of(ball, solid_of(ball)), 12)
    draw_heights(drawn, ball, some, METRIC)
    places = {text.get_text(): text.xy[1] for text in drawn.texts}
    assert places["1"] == pytest.approx(some[-1].slice.z_m)
    assert places["12"] == pytest.approx(some[0].slice.z_m)
    low, high = drawn.get_ylim()
    assert low < 330.0 < 332.0 < high
    assert len(drawn.collections[0].get_paths()) == 40


def test_convergence_shows_every_volume_the_result_and_its_interval() -> None:
    ball, drawn = bodies.ball(), axes()
    draw_convergence(drawn, ball, solid_of(ball), METRIC)
    line = next(line for line in drawn.lines if line.get_label() == "slices as boxes")
    counts, volumes = zip(*solid_of(ball).convergence)
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
    draw_stack(drawn, sections_of(ball, solid_of(ball)))
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
    result = with_solid(bodies.ball(), **POOR[change])
    assert picture(result).shape[1] == 1400
    html = page(bodies.measurement(result), tmp_path)
    assert html.endswith("</html>\n")


def test_a_body_without_slices_and_interval_is_drawn() -> None:
    result = with_solid(bodies.ball(), outlines=[])
    assert picture(dataclasses.replace(result, slices=(), std_m3=None)).shape[1] == 1400


@pytest.mark.parametrize("name", ["砂 🏔", "$\\frac{", "", surveys.HOSTILE])
def test_any_name_of_a_body_can_be_drawn(name: str) -> None:
    assert picture(bodies.torus(name, slices=8, points=600)).shape[1] == 1400


# The view that turns


def data_of(html: str) -> List[Dict[str, Any]]:
    found = re.findall(r'<script type="application/json">(.*?)</script>', html, re.DOTALL)
    return [json.loads(text) for text in found]


def unpacked(packed: Dict[str, Any]) -> Any:
    """As view.js does it."""
    whole = np.frombuffer(base64.b64decode(packed["data"]), "<i2")
    return whole.reshape(-1, len(packed["middle"])) * packed["step"] + packed["middle"]


def test_coordinates_in_the_page_are_those_of_the_solid() -> None:
    torus = bodies.torus(points=6000)
    [data] = data_of(view_markup(torus, METRIC, north=True))
    solid = solid_of(torus)
    for key in ("points", "ground", "strays"):
        packed = data["layers"][key]
        assert packed["count"] == len(getattr(solid, key))
        error = np.abs(unpacked(packed) - getattr(solid, key)).max()
        assert error <= packed["step"] * 0.501
        assert packed["step"] < 4.0 / 32767
    outlines = data["outlines"]
    assert outlines["rings"] == [[i // 2, 90] for i in range(80)]
    corners = np.vstack([ring for rings in solid.outlines for ring in rings])
    assert np.abs(unpacked(outlines) - corners).max() <= outlines["step"] * 0.501
    z = [s.z_m - solid.origin[2] for s in torus.slices]
    assert outlines["z"] == pytest.approx(z, abs=1e-6)


def test_far_strays_do_not_coarsen_the_body() -> None:
    strays = np.array([[9e5, 0, 0], [0, 0, -3e4]], np.float32)
    [data] = data_of(view_markup(with_solid(bodies.ball(), strays=strays), METRIC, north=False))
    assert data["layers"]["points"]["step"] < 2.0 / 32767
    assert max(data["high"]) < 2.1
    assert min(data["low"]) > -1.1


def test_many_points_are_sampled_the_same_way_each_time() -> None:
    ball = bodies.ball(points=60_000)
    first, second = (view_markup(ball, METRIC, north=False) for _ in range(2))
    assert first == second
    [data] = data_of(first)
    assert data["layers"]["points"]["count"] == 20_000
    assert "20 000 of 60 000" in plain(first)
    known = {tuple(row) for row in np.round(solid_of(ball).points.astype(float), 3)}
    shown = unpacked(data["layers"]["points"])
    near = sum(tuple(row) in known for row in np.round(shown, 3))
    assert near > 0.8 * len(shown)  # the others were rounded the other way


def test_gaps_are_marked_with_their_width() -> None:
    [data] = data_of(view_markup(bodies.ball(), METRIC, north=False))
    assert data["gaps"] == [
        [0.0, 0.0, 2.0, 0.31, "0.31\u00a0m"],
        [0.95, 0.2, 0.8, 0.12, "0.12\u00a0m"],
    ]


def test_no_text_of_the_data_ends_the_data() -> None:
    hostile = dataclasses.replace(METRIC, length="</script><!--&")
    markup = view_markup(bodies.ball(points=60), hostile, north=False)
    assert markup.count("</script>") == 1
    assert "<!--" not in markup
    [data] = data_of(markup)
    assert data["gaps"][0][4] == "0.31\u00a0</script><!--&"


def boxes_of(markup: str) -> List[str]:
    return re.findall(r'data-layer="(\w+)"', markup)


def test_only_what_there_is_has_a_check_box() -> None:
    everything = ["points", "outlines", "gaps", "ground", "strays"]
    assert boxes_of(view_markup(bodies.ball(), METRIC, north=False)) == everything
    nothing = np.zeros((0, 3), np.float32)
    bare = with_solid(bodies.torus(), ground=nothing, strays=nothing, floor=None)
    assert boxes_of(view_markup(bare, METRIC, north=False)) == ["points", "outlines"]
    assert view_markup(with_solid(bare, points=nothing, outlines=[]), METRIC, north=False) == ""


def test_the_view_can_be_read_and_used_without_a_mouse() -> None:
    markup = view_markup(bodies.ball(), METRIC, north=False)
    words = plain(re.search(r'aria-label="([^"]*)"', markup).group(1))  # type: ignore[union-attr]
    assert words.startswith("Ball in three dimensions: 40 of its section outlines between")
    assert "330.00 m and 332.00 m" in words
    assert 'tabindex="0"' in markup
    assert "<noscript>" in markup
    assert '<section class="view" hidden>' in markup


# The page


def test_the_policy_lets_only_the_pages_own_script_run(tmp_path: Path) -> None:
    html = page(bodies.measurement(bodies.ball(), bodies.torus()), tmp_path)
    scripts = re.findall(r"<script>(.*?)</script>", html, re.DOTALL)
    assert len(scripts) == 1
    digest = base64.b64encode(hashlib.sha256(scripts[0].encode()).digest()).decode()
    policy = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"
    assert f"content=\"{policy}; script-src 'sha256-{digest}'\"" in html
    assert len(data_of(html)) == 2


def test_the_script_uses_nothing_that_the_policy_forbids(tmp_path: Path) -> None:
    html = page(bodies.measurement(bodies.ball()), tmp_path)
    for part in (
        "eval(",
        "fetch(",
        "import(",
        "XMLHttp",
        "http://",
        "https://",
        "url(",
        "innerHTML",
    ):
        assert part not in html, part


@pytest.mark.parametrize("other", [surveys.pile, surveys.body])
def test_pages_of_terrain_and_of_the_papers_method_have_no_script(
    other: Any, tmp_path: Path
) -> None:
    html = page(surveys.measurement(other()), tmp_path)
    for part in ("<script", "script-src", "<canvas", "--view-", "noscript"):
        assert part not in html


class BodyTags(Tags):
    """Knows the tags without an end that a view has."""

    def handle_starttag(self, tag: str, attrs: Any) -> None:
        super().handle_starttag(tag, attrs)
        if tag == "input":
            self.open.pop()


@pytest.mark.parametrize("bad", [*HOSTILE_TEXTS, "</script><script>alert(1)</script>", "]]>"])
def test_nothing_from_outside_becomes_markup_of_a_body(bad: str, tmp_path: Path) -> None:
    floor = Floor((0.0, 0.0, 1.0), 330.0, 0.0, 7, bad)
    result = bodies.ball(
        bad,
        warnings=(bad,),
        points_left_out={bad: 3},
        changes_of_solid={"floor": floor},
        points=600,
    )
    measurement = bodies.measurement(result, surveys.failure(bad), source=bad, warnings=(bad,))
    html = page(measurement, tmp_path)
    tags = BodyTags()
    tags.feed(html)
    assert tags.open == []
    assert tags.names.count("script") == 2  # the data and view.js
    assert tags.names.count("img") == 1
    assert not {"iframe", "object", "link", "b<"} & set(tags.names)
    assert all(not name.startswith("on") for name, _ in tags.attributes)


def test_the_page_states_the_key_numbers(tmp_path: Path) -> None:
    html = plain(page(bodies.measurement(bodies.ball()), tmp_path))
    for part in (
        "4.187<small> ± 0.082 m³</small>",
        "95 %: 4.105 to 4.269 m³",
        '<dt>Height</dt><dd><div class="big">2.00<small> m',
        "elevation 330.00 to 332.00 m",
        '<dt>Surface area</dt><dd><div class="big">12.60<small> m²',
        '<dt>Slices</dt><dd><div class="big">40',
        "0.0500 m each",
        '<dt>Points used</dt><dd><div class="big">6 000',
        "4 521 left out",
        "4 321 ground, 200 stray",
        "Check: tetrahedra",
        "outline</td>",
        "sampling</td>",
        "Ground: a plane found in the cloud, at elevation 330.00 m, tilted 1.1°; 4 321 points",
        "Gaps: 2 closed, the widest 0.31 m wide, at elevation 332.00 m.",
    ):
        assert part in html, part


def test_several_bodies_are_compared_without_cut_and_fill(tmp_path: Path) -> None:
    html = page(bodies.measurement(bodies.ball(), bodies.torus(), surveys.failure()), tmp_path)
    assert "<h2>All bodies</h2>" in html
    assert "Cut," not in html
    assert "not measured" in html


def test_the_whole_page_stays_small(tmp_path: Path) -> None:
    def wavy(z: float) -> List[Any]:
        turn = np.linspace(0, 2 * math.pi, 2000, endpoint=False)
        radius = 1 + 0.05 * np.sin(40 * turn) + z / 10
        return [np.column_stack([radius * np.cos(turn), radius * np.sin(turn)])]

    result = bodies.body("Wavy", wavy, 2.0, slices=300, points=100_000)
    write_report(bodies.measurement(result), tmp_path)
    assert (tmp_path / "report.html").stat().st_size < 1_500_000
    crowd = [bodies.ball(f"Ball {i}") for i in range(20)]
    assert len(page(bodies.measurement(*crowd), tmp_path)) < 2_500_000


# Words


FLOORS: List[Tuple[Any, str]] = [
    (
        Floor((0.0, 0.0, 1.0), 12.5, 0.01, 1, "in the cloud"),
        "Ground: a plane found in the cloud, at elevation 12.50 m, level; "
        "1 point taken for it and left out.",
    ),
    (
        Floor((0.1, 0.0, 0.995), -3.0, 5.74, 0, "given"),
        "Ground: the plane that was given, at elevation \u22123.00 m, tilted 5.7°; "
        "no point was left out for it.",
    ),
    (
        Floor((0.0, 0.0, 1.0), 1.0, 0.0, 0, "lowest points"),
        "Ground: none in the cloud; the body is open below and was closed by a plane through its "
        "lowest points, at elevation 1.00 m, level; no point was left out for it.",
    ),
    (None, "Ground: none; the surface was taken as closed all round."),
]


@pytest.mark.parametrize(("floor", "words"), FLOORS)
def test_one_sentence_says_what_was_taken_for_ground(floor: Any, words: str) -> None:
    result = with_solid(bodies.ball(points=600), floor=floor)
    assert plain(floor_words(solid_of(result), METRIC)) == words


@pytest.mark.parametrize(
    ("gaps", "words"),
    [
        ((), "Gaps: none had to be closed."),
        ((Gap(0, 0, 0.5, 0.1234),), "Gaps: 1 closed, 0.12 m wide, at elevation 330.50 m."),
        (
            (Gap(0, 0, 0.5, 0.1), Gap(0, 0, 1.5, 0.2)),
            "Gaps: 2 closed, the widest 0.20 m wide, at elevation 331.50 m.",
        ),
    ],
)
def test_one_sentence_tells_the_gaps(gaps: Any, words: str) -> None:
    result = with_solid(bodies.ball(points=600), gaps=gaps)
    assert plain(gap_words(solid_of(result), METRIC)) == words


def test_the_terminal_tells_ground_gaps_and_points() -> None:
    shown = printed(bodies.measurement(bodies.ball("[b]Ball")), width=200)
    row = next(line for line in shown.splitlines() if line.strip().startswith("[b]Ball "))
    for cell in ("4.187", "0.082", "2.00 m", "12.60 m²", "40"):
        assert cell in row
    assert "Ground: a plane found in the cloud, at elevation 330.00 m, tilted 1.1°" in shown
    assert "Gaps: 2 closed, the widest 0.31 m wide" in shown
    assert "Points: 6 000 used; left out: 4 321 ground, 200 stray." in shown
    assert "check by tetrahedra" in shown


def test_nothing_left_out_is_said() -> None:
    assert left_out_words(bodies.ball(points=600, points_left_out={"ground": 0})) == "none"


@pytest.mark.parametrize("width", [20, 60, 90])
def test_narrow_terminals_show_every_number_of_a_body(width: int) -> None:
    shown = printed(bodies.measurement(bodies.ball()), width=width)
    for part in ("4.187", "0.082", "2.00", "12.60"):
        assert part in shown


# Files


def test_the_document_of_a_body_follows_the_schema_and_holds_no_solid() -> None:
    document = to_json(bodies.measurement(bodies.ball(), bodies.torus()))
    valid(document)
    assert document["method"] == "section"
    row = document["results"][0]
    assert "solid" not in row
    assert row["cut_m3"] is row["base"] is None
    assert [item["source"] for item in row["budget"]] == [
        "survey",
        "outline",
        "sampling",
        "slicing",
    ]
    assert row["slices"][0]["z_m"] == pytest.approx(330.025)
    assert sum(s["volume_m3"] for s in row["slices"]) == pytest.approx(row["volume_m3"])


def test_files_for_programs_are_written_for_bodies(tmp_path: Path) -> None:
    names = [p.name for p in write_report(bodies.measurement(bodies.torus()), tmp_path)]
    expected = ["report.json", "slices.csv", "areas.geojson", "area-01-torus.png", "report.html"]
    assert names == expected
    file = io.StringIO(newline="")
    write_slices(bodies.measurement(bodies.torus()), file)
    rows = list(csv.reader(io.StringIO(file.getvalue(), newline="")))
    assert len(rows) == 41
    assert float(rows[1][1]) == pytest.approx(330.0125)
    [feature] = to_geojson(bodies.measurement(bodies.torus()))["features"]
    assert feature["geometry"] is None
    assert feature["properties"]["surface_area_m2"] == 12.6
