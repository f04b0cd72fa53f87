"""The report of a body measured by sections: words, tables, files."""

from __future__ import annotations

import csv
import io
import math
from pathlib import Path
from typing import Any, List, Tuple

import numpy as np
import pytest

from quantify_client import to_json, write_report
from quantify_client.report.document.geojson import to_geojson
from quantify_client.report.document.slices_csv import write_slices
from quantify_client.report.wording.units import METRIC
from quantify_client.report.wording.words import floor_words, gap_words, left_out_words
from quantify_client.types import Floor, Gap

from . import bodies, surveys
from .bodies import body_of, plain, with_body
from .schemas import valid
from .test_reading import page, printed


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
        "4 321 ground, 200 outliers",
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
    result = with_body(bodies.ball(points=600), floor=floor)
    assert plain(floor_words(body_of(result), METRIC)) == words


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
    result = with_body(bodies.ball(points=600), gaps=gaps)
    assert plain(gap_words(body_of(result), METRIC)) == words


def test_the_terminal_tells_ground_gaps_and_points() -> None:
    shown = printed(bodies.measurement(bodies.ball("[b]Ball")), width=200)
    row = next(line for line in shown.splitlines() if line.strip().startswith("[b]Ball "))
    for cell in ("4.187", "0.082", "2.00 m", "12.60 m²", "40"):
        assert cell in row
    assert "Ground: a plane found in the cloud, at elevation 330.00 m, tilted 1.1°" in shown
    assert "Gaps: 2 closed, the widest 0.31 m wide" in shown
    assert "Points: 6 000 used; left out: 4 321 ground, 200 outliers." in shown
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
    valid(document, "schema.json")
    assert document["method"] == "section"
    row = document["results"][0]
    assert "body" not in row
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
