"""What people read: numbers, the terminal, the page."""

from __future__ import annotations

import io
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any, List

import pytest
from rich.console import Console

from quantify_client.errors import InputError
from quantify_client.report.page.page import Pictures, render_html
from quantify_client.report.terminal.results import print_table
from quantify_client.report.wording.units import (
    METRIC,
    MINUS,
    NOTHING,
    THIN_SPACE,
    display_units,
    fixed,
    number,
)
from quantify_client.report.wording.words import coverage_words, printable, slug

from . import scalings, surveys


@pytest.mark.parametrize(
    ("value", "std", "text"),
    [
        (1234.567, 2.34, "1 234.6"),
        (1234.567, 23.4, "1 235"),
        (1234.567, 234.0, "1 230"),
        (-1234567.0, 1.0, "-1 234 567.0"),
        (0.0, 0.5, "0.00"),
        (-0.001, 0.5, "0.00"),
        (0.012345, None, "0.01235"),
        (123456.7, None, "123 457"),
        (5.0, 0.0, "5.000"),
        (None, 1.0, NOTHING),
        (float("nan"), 1.0, NOTHING),
        (5.0, float("inf"), "5.000"),
    ],
)
def test_numbers_have_the_digits_their_error_supports(value: Any, std: Any, text: str) -> None:
    shown = number(value, std=std).replace(THIN_SPACE, " ").replace(MINUS, "-")
    assert shown == text


def test_negative_decimals_round_to_tens() -> None:
    assert fixed(1234.0, -2).replace(THIN_SPACE, " ") == "1 200"


def test_us_units_are_the_surveyors() -> None:
    us = display_units(surveys.measurement(), "us")
    assert us.volume_text(0.764554857984) == "1.0000\u00a0yd³"
    assert us.length_text(0.3048 * 12) == "12.00\u00a0ft"
    assert us.area_text(0.09290304) == "1.000\u00a0ft²"
    assert us.area_text(4046.8564224) == "1.000\u00a0acre"
    assert us.mass_text(0.90718474) == "1.000\u00a0short tons"


def test_unknown_units_are_never_converted() -> None:
    units = display_units(surveys.measurement(length_unit="unknown"), "us")
    assert units.volume_text(2.0) == "2.0000\u00a0units³"
    assert units.length_text(2.0) == "2.00\u00a0units"


@pytest.mark.parametrize(
    ("value", "height", "words"),
    [
        (4e-9, 0.8, "0.000"),
        (-4e-9, 20.0, "0.00"),
        (0.0123456, 0.05, "0.0123"),
        (330.5, 2.0, "330.50"),
    ],
)
def test_elevations_are_as_fine_as_what_they_are_of_is_high(
    value: float, height: float, words: str
) -> None:
    assert METRIC.elevation_text(value, height) == f"{words}\u00a0m"


def test_other_units_are_refused() -> None:
    with pytest.raises(InputError, match="metric or us"):
        display_units(surveys.measurement(), "imperial")


def test_coverage_is_100_only_when_complete() -> None:
    assert [coverage_words(c) for c in (1.0, 0.99999, 0.6, 0.0)] == [
        "100\u00a0%",
        "99.9\u00a0%",
        "60.0\u00a0%",
        "0\u00a0%",
    ]


def test_slugs_are_safe_file_names() -> None:
    for name in ("../../etc/passwd", "a/b\\c:d", "", "砂", "x" * 300, "-rf", "con\x00"):
        assert re.fullmatch(r"[a-z0-9]([a-z0-9-]{0,38}[a-z0-9])?", slug(name))


def printed(measurement: Any, **console: Any) -> str:
    options = {"width": 120, "file": io.StringIO(), "force_terminal": False, **console}
    terminal = Console(**options)
    print_table(measurement, terminal)
    return terminal.file.getvalue()


def test_table_has_a_row_an_area_with_the_numbers() -> None:
    pile = surveys.pile(volume_m3=1221.51, std_m3=5.3, cut_m3=1223.3, fill_m3=1.8)
    lines = printed(surveys.measurement(pile)).splitlines()
    row = next(line for line in lines if line.strip().startswith("North pile "))
    for cell in ("1 221.5", "10.4", "1 223.3", "1.8", "96.8 %", "2 215 t"):
        assert cell in row
    assert "shape terrain, method surface" in lines[0]


@pytest.mark.parametrize("width", [20, 40, 60, 80, 200])
def test_every_width_shows_every_number(width: int) -> None:
    shown = printed(surveys.everything(), width=width)
    for part in ("1 221.5", "-471.4", "473.0", "10.4", "-467.0"):
        assert part in shown
    assert max(map(len, shown.splitlines())) <= max(width, 20)


def test_numbers_are_not_broken_where_the_table_does_not_fit() -> None:
    shown = printed(surveys.measurement(surveys.hollow()), width=40)
    lines = [line.strip() for line in shown.splitlines()]
    place = lines.index("elevation 329.50 m")
    assert [line.split()[-1] for line in lines[place + 1 : place + 5]] == [
        "-467.0",
        "10.4",
        "1.7",
        "473.0",
    ]


@pytest.mark.parametrize("width", range(50, 110, 3))
def test_no_heading_or_base_is_cut_off(width: int) -> None:
    pile = surveys.pile("round structure", base="triangulate", volume_m3=56.93)
    shown = printed(surveys.measurement(pile), width=width)
    for part in ("triangulate", "Coverage", "96.8 %", "structure"):
        assert part in shown


def test_markup_in_names_is_text() -> None:
    shown = printed(surveys.measurement(surveys.body("[red]x[/red] [/] :smile:")))
    assert "[red]x[/red] [/] :smile:" in shown


@pytest.mark.parametrize("name", ["a\x1b[2Jb", "a\x9b2Jb", "a\rb\x07", "a\u202eb", "a\x00b"])
def test_control_characters_never_reach_the_terminal(name: str) -> None:
    measurement = surveys.measurement(
        surveys.pile(name, warnings=(name,)),
        surveys.failure(name),
        source=name,
        warnings=(name,),
        crs=name,
    )
    shown = printed(measurement)
    assert not re.search("[\x00-\x09\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]", shown)


def test_a_terminal_without_unicode_gets_ascii() -> None:
    raw = io.BytesIO()
    file = io.TextIOWrapper(raw, encoding="ascii", errors="strict")
    print_table(surveys.measurement(surveys.pile("Größe 砂")), Console(file=file, width=120))
    file.flush()
    assert b"+-" in raw.getvalue()
    assert b"m3" in raw.getvalue()


def test_warnings_checks_bases_and_failures_are_in_words() -> None:
    shown = printed(surveys.everything(), width=200)
    assert "Warning: The cloud has no ground classes" in shown
    assert "Warning: Grassy hollow: 3.2 % of the cells" in shown
    assert "check by TIN prisms" in shown
    assert "elevation 329.50 m" in shown
    assert f"{surveys.HOSTILE}: not measured: The polygon crosses itself" in shown


class Tags(HTMLParser):
    """Collect what a browser would make of the page."""

    def __init__(self) -> None:
        super().__init__()
        self.names: List[str] = []
        self.attributes: List[Any] = []
        self.open: List[str] = []

    def handle_starttag(self, tag: str, attrs: Any) -> None:
        self.names.append(tag)
        self.attributes += attrs
        if tag not in ("meta", "img", "br"):
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def page(measurement: Any, tmp_path: Path, units: str = "metric") -> str:
    picture = tmp_path / "x.png"
    picture.write_bytes(b"png")
    shown = display_units(measurement, units)
    return "".join(render_html(measurement, shown, Pictures({0: picture}, overview=picture)))


HOSTILE_TEXTS = (surveys.HOSTILE, '"><img src=x onerror=alert(1)>', "<!--", "</style><b>", "$title")


@pytest.mark.parametrize("bad", HOSTILE_TEXTS)
def test_nothing_from_outside_becomes_markup(bad: str, tmp_path: Path) -> None:
    pile = surveys.hollow(bad, warnings=(bad,), base=bad, points_left_out={bad: 3}, checks=())
    measurement = surveys.measurement(
        pile,
        surveys.failure(bad),
        source=bad,
        crs=f'PROJCRS["{bad}",{bad}]',
        warnings=(bad,),
        shape=bad,
        method=bad,
        provenance={"options": {"area": bad}, bad: bad},
        scale=scalings.everything(name=bad),
    )
    html = page(measurement, tmp_path)
    tags = Tags()
    tags.feed(html)
    assert tags.open == []
    assert not {"script", "iframe", "object", "link", "b<"} & set(tags.names)
    assert tags.names.count("img") == 2
    assert all(not name.startswith("on") for name, _ in tags.attributes)
    assert html.count("<script") == 0


def test_page_needs_nothing_from_elsewhere(tmp_path: Path) -> None:
    html = page(surveys.everything(), tmp_path)
    tags = Tags()
    tags.feed(html)
    policy = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"
    assert ("content", policy) in tags.attributes
    links = [value for name, value in tags.attributes if name in ("src", "href")]
    assert links
    assert all(link.startswith(("data:image/png;base64,", "#area-")) for link in links)
    assert "url(" not in html
    assert "@import" not in html


def test_page_states_numbers_inputs_budget_bases_and_failures(tmp_path: Path) -> None:
    html = page(surveys.everything(), tmp_path).replace(THIN_SPACE, " ").replace("\u00a0", " ")
    for part in (
        "1 221.5",
        "95 %: 1 211.2 to 1 231.9 m³",
        "EPSG:32615",
        "0.999670",
        "184 321",
        "1 203 noise class",
        "Share of variance",
        "Base surfaces compared",
        "elevation 329.50 m",
        "Slices (13)",
        "Not measured: The polygon crosses itself",
        "piles.geojson",
    ):
        assert part in html, part


def test_page_in_us_units_has_no_metres_of_volume(tmp_path: Path) -> None:
    html = page(surveys.measurement(surveys.pile()), tmp_path, "us")
    assert "yd³" in html
    assert "m³" not in html
    assert "short tons" in html


def test_printable_keeps_ordinary_text() -> None:
    assert printable("Größe 砂 ± 🏔") == "Größe 砂 ± 🏔"
