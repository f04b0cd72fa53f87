"""A change, a series and what an area holds, as people and programs read them."""

from __future__ import annotations

import csv
import dataclasses
import io
from typing import Any, List

import pytest
from rich.console import Console

from quantify_client.report.document.series_csv import write_series
from quantify_client.report.document.stage_csv import write_stage
from quantify_client.report.page.page import Pictures, render_html
from quantify_client.report.terminal.results import print_table
from quantify_client.report.wording.alignment import alignment_lines, alignment_rows, survey_name
from quantify_client.report.wording.stage import capacity_words
from quantify_client.report.wording.units import METRIC, MINUS, THIN_SPACE, US, display_units
from quantify_client.types import AreaFailure, Epochs, Measurement, PourPoint, Stage

from . import changes, surveys
from .test_reading import HOSTILE_TEXTS, Tags


def plain(text: str) -> str:
    return text.replace(THIN_SPACE, " ").replace("\u00a0", " ").replace(MINUS, "-")


def printed(measurement: Measurement, width: int = 140, units: str = "metric") -> str:
    file = io.StringIO()
    console = Console(width=width, file=file, force_terminal=False)
    print_table(measurement, console, units=units)
    return file.getvalue()


def page(measurement: Measurement, units: str = "metric") -> str:
    return plain("".join(render_html(measurement, display_units(measurement, units), Pictures())))


def test_a_change_is_told_in_gain_and_loss() -> None:
    html, shown = page(changes.change()), printed(changes.change())
    for part in (
        "<title>Change: site/july.laz</title>",
        "Change report",
        "<span>Before</span><b>site/june.laz</b>",
        "<dt>Net change</dt>",
        "<dt>Gain, higher than before</dt>",
        "<dt>Loss, lower than before</dt>",
        '<th scope="row">Before</th><td>june.laz</td>',
        '<th scope="row">Level of detection of a cell</th><td>0.0588 m</td>',
        '<th scope="row">Area that changed</th><td>247.0 m² (25.0 %)</td>',
        "Above before, m",
    ):
        assert part in html, part
    for part in ("Net change m³", "Gain m³", "Loss m³", "change since site/june.laz"):
        assert part in shown, part
    assert "level of detection of a cell: 0.0588 m; area that changed: 247.0 m² (25.0 %)" in shown
    for word in ("Cut", "Fill", ">Base<", "Volume report"):
        assert word not in html
        assert word not in shown


def test_a_volume_keeps_its_words() -> None:
    html, shown = page(surveys.everything()), printed(surveys.everything())
    for part in (
        "<title>Volumes: brighton_beach/model.laz</title>",
        "Volume report",
        "<dt>Net</dt>",
        "<dt>Cut, above the base</dt>",
        "<dt>Fill, below the base</dt>",
        '<th scope="row">Base</th><td>plane</td>',
        "Above base, m",
        "Cut, m³",
    ):
        assert part in html, part
    assert "Cut m³" in shown
    for word in ("Gain", "Loss", "change", "Level of detection", "Surveys", "Before"):
        assert word not in html
        assert word not in shown


def test_all_areas_of_a_change_have_its_headings() -> None:
    html = page(changes.change(changes.changed("a"), changes.changed("b")))
    assert '<th class="n">Net change, m³</th>' in html
    assert '<th class="n">Gain, m³</th><th class="n">Loss, m³</th>' in html


def test_an_alignment_is_told_once() -> None:
    measurement = changes.change()
    html, shown = page(measurement), printed(measurement)
    assert "How the surveys lie on each other" in html
    assert "was moved by +0.402 m east" not in html + shown
    rows = {name: plain(value) for name, value in alignment_rows(changes.aligned(), METRIC)}
    assert rows == {
        "Moved": "july.laz onto june.laz",
        "Shift east": "+0.4021 ± 0.0042 m (1 \u03c3)",
        "Shift north": "-0.2968 ± 0.0039 m (1 \u03c3)",
        "Shift up": "+0.1013 ± 0.0018 m (1 \u03c3)",
        "Tilt, rising to": "+0.031 % east, -0.019 % north",
        "Differences on stable ground, before": "0.22 m",
        "Differences on stable ground, now": "0.031 m",
        "Mean of these, before": "0.1043 ± 0.0061 m (july.laz above the other)",
        "Stable ground compared": "12 340 m²",
    }
    for value in rows.values():
        assert value in html
    assert (
        "Fit: on 12 340 m² of stable ground they differ by 0.031 m (0.22 m before); tilt"
    ) in shown


def test_surveys_that_were_left_where_they_are() -> None:
    left = changes.aligned(aligned=False, before_rms_m=None, bias_m=None, bias_std_m=None)
    names = [name for name, _ in alignment_rows(left, METRIC)]
    assert not any("Shift" in name or "before" in name for name in names)
    assert [plain(line) for line in alignment_lines(left, US)] == [
        "Surveys: july.laz was left where it is beside june.laz",
        "Fit: on 3.049 acre of stable ground they differ by 0.10 ft",
    ]
    volume = surveys.measurement(surveys.pile(), alignment=left)
    assert "july.laz was left where it is" in printed(volume)
    assert "Volume report" in page(volume)


@pytest.mark.parametrize(
    ("label", "name"),
    [
        ("a/b.laz", "b.laz"),
        ("a\\b.laz", "b.laz"),
        ("b/", "b"),
        ("/", "/"),
        ("", ""),
        ("a/ ", "a/ "),
    ],
)
def test_surveys_are_called_by_their_files(label: str, name: str) -> None:
    assert survey_name(label) == name


def test_a_series_has_a_row_for_each_pair_and_area() -> None:
    measurement = changes.change(series=changes.series(4, 2))
    shown, html = printed(measurement), page(measurement)
    rows = [line for line in shown.splitlines() if "Area 1" in line]
    assert [row.split()[-4:] for row in rows] == [
        ["120.0", "12.7", "130.0", "10.0"],
        ["32.1", "12.7", "42.1", "10.0"],
        ["-102.8", "12.7", "10.0", "112.8"],
        ["53.3", "12.7", "63.3", "10.0"],
    ]
    assert shown.count("2026-01-14 quarry.laz to 2026-02-14 quarry.laz") == 1
    assert shown.index("First to last") < shown.index("2026-01-14 quarry.laz to 2026-04-14")
    failed = "Area 2: not measured: points support 12 % of it; fly it again"
    assert failed in shown
    assert failed in html
    assert "change since flights/2026-01-14 quarry.laz" in shown
    for part in ("<h2>Series</h2>", "-102.8", "First to last", "53.3", "0.22 m"):
        assert part in html


def test_a_long_series_ends_with_the_latest_rows() -> None:
    shown = printed(changes.change(series=changes.series(10, 7)))
    assert "22 earlier rows are in the report" in shown
    assert "2026-02-14 quarry.laz to 2026-03-14 quarry.laz  " not in shown
    assert "2026-09-14 quarry.laz to 2026-10-14 quarry.laz  " in shown


def rows_of(write: Any, measurement: Measurement) -> List[List[str]]:
    file = io.StringIO(newline="")
    write(measurement, file)
    assert file.getvalue().count("\r\n") == file.getvalue().count("\n")
    return list(csv.reader(io.StringIO(file.getvalue(), newline="")))


def test_series_csv_has_the_numbers_as_they_are() -> None:
    pair = changes.between("a/=may.laz", "a/june.laz", [0.1 + 0.2])
    failed = AreaFailure(surveys.FORMULA, "no points")
    bare = dataclasses.replace(pair.results[0], std_m3=None)
    series = (dataclasses.replace(pair, results=(bare,), failures=(failed,)), pair)
    assert rows_of(write_series, changes.change(series=series)) == [
        ["before", "after", "name", "volume_m3", "cut_m3", "fill_m3", "std_m3"],
        ["a/=may.laz", "a/june.laz", "Area 1", "0.3", "10.3", "10.0", ""],
        ["a/=may.laz", "a/june.laz", "'=cmd()", "", "", "", ""],
        ["a/=may.laz", "a/june.laz", "Area 1", "0.3", "10.3", "10.0", "6.5"],
    ]


def test_formulas_in_names_of_surveys_are_text() -> None:
    series = (changes.between("=may.laz", "+june.laz", [1.0]),)
    assert rows_of(write_series, changes.change(series=series))[1][:2] == [
        "'=may.laz",
        "'+june.laz",
    ]


def test_stage_csv_has_a_row_for_each_level_of_each_area() -> None:
    measurement = surveys.measurement(
        changes.pond("=pond"), surveys.failure(), surveys.pile(), changes.pond("b")
    )
    rows = rows_of(write_stage, measurement)
    assert rows[0] == ["name", "level_m", "water_area_m2", "volume_m3", "std_m3", "spills"]
    assert rows[1] == ["'=pond", "328.25", "47.1238898038", "5.89048622548", "2.75", "false"]
    assert rows[14][1:2] + rows[14][4:] == ["331.5", "12.5", "true"]
    assert [row[0] for row in rows[1:]] == ["'=pond"] * 14 + ["b"] * 14


def test_what_an_area_holds_is_told_in_one_line() -> None:
    held = changes.stage()
    assert plain(capacity_words(held, METRIC)) == (
        "561 m³ in 2 basins when full, the largest spills at 330.40 m"
    )
    one = Stage(held.levels, [PourPoint(330.4, 0.0, 0.0, 543.3, 1.0, 328.0, outside=True)])
    assert plain(capacity_words(one, US)) == (
        "711 yd³ when full, spills over the outline at 1 083.99 ft"
    )
    assert "no basin was found" in capacity_words(Stage(held.levels, held.pour_points[2:]), METRIC)
    assert "holds 561 m³ in 2 basins" in printed(surveys.measurement(changes.pond()))


def test_the_page_has_levels_and_pour_points() -> None:
    html = page(surveys.measurement(changes.pond(), surveys.pile()))
    for part in (
        "Levels (14)",
        "Pour points (3)",
        "328.25",
        "47.12",
        '<td class="n">spills</td>',
        "over the outline",
        "into another basin",
        "576 786.00",
        "5 188 141.00",
    ):
        assert part in html, part
    assert html.count("What it holds") == 1


@pytest.mark.parametrize("bad", HOSTILE_TEXTS)
def test_nothing_of_a_change_becomes_markup(bad: str) -> None:
    pair = Epochs(bad, bad, (surveys.body(bad),), (AreaFailure(bad, bad),), changes.aligned())
    measurement = changes.change(
        changes.changed(bad, base=bad, stage=changes.stage()),
        source=bad,
        alignment=changes.aligned(moved=bad, reference=bad),
        series=(pair, pair),
    )
    tags = Tags()
    tags.feed(page(measurement))
    assert tags.open == []
    assert not {"script", "img", "b<"} & set(tags.names)
    assert all(not name.startswith("on") for name, _ in tags.attributes)


@pytest.mark.parametrize("width", [20, 40, 60, 200])
def test_every_width_of_a_terminal_has_all_numbers(width: int) -> None:
    measurement = changes.change(
        changes.changed(stage=changes.stage()), series=changes.series(4, 2)
    )
    shown = printed(measurement, width)
    for part in ("216.2", "-241.5", "12.7"):
        assert part in shown
    assert max(map(len, shown.splitlines())) <= width
