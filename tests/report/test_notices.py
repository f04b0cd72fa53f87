"""One line for each kind of warning, in the units asked for."""

from __future__ import annotations

import html

import pytest

from quantify_client.report.page.page import Pictures, render_html
from quantify_client.report.wording.notices import in_units, kind_of, lines_of_kinds
from quantify_client.report.wording.units import display_units, named_units
from quantify_client.types import Measurement, Notice

from . import surveys
from .test_reading import printed

US = named_units("us")
GAPS = "points support {}% of the area; the gaps were interpolated"
EDGE = "{} m2 of the area lie beyond the edge of the cloud"
OTHER = "the outline crosses a channel of 0.4 m over 2.5 m"


def several() -> Measurement:
    said = {"A": (GAPS.format(69),), "B": (GAPS.format(93), EDGE.format(12)), "C": (OTHER,)}
    results = [surveys.pile(name, warnings=lines) for name, lines in said.items()]
    return surveys.measurement(*results)


def test_the_terminal_has_one_line_for_a_kind() -> None:
    shown = printed(several(), width=200)
    assert shown.count("points support") == 1
    assert "in 2 areas (A, B): points support 69 to 93% of the area" in shown
    assert "Warning: B: 12 m\u00b2 of the area" in shown


def test_the_page_tells_all_warnings_at_the_top_and_each_areas_own_with_it() -> None:
    measurement = several()
    page = html.unescape(
        "".join(render_html(measurement, display_units(measurement, "us"), Pictures()))
    )
    assert page.count("points support") == 1
    before, *areas = page.split('<article class="card')
    assert "in 2 areas (A, B): points support 69 to 93% of the area" in before
    assert "130 ft\u00b2 of the area lie beyond" in areas[1]
    assert "a channel of 1.3 ft over 8.2 ft" in areas[2]
    assert "C: the outline crosses a channel of 1.3 ft over 8.2 ft" in before
    assert not any("channel" in part for part in (areas[0], areas[1]))


def test_one_area_needs_no_name() -> None:
    shown = printed(surveys.measurement(surveys.pile(warnings=(OTHER,))), width=200)
    assert f"Warning: {OTHER}" in shown


@pytest.mark.parametrize(
    ("sentence", "expected"),
    [
        ("7.91 m3, 0.33 m3 from the volume", "10.3 yd\u00b3, 0.43 yd\u00b3 from the volume"),
        ("more than +-0.29 m3;", "more than +-0.38 yd\u00b3;"),
        ("over a site 1,500 m across", "over a site 4921 ft across"),
        ("1.2e+06 m3 lie", "1600000 yd\u00b3 lie"),
        # No quantities: options, coordinates, rates, names.
        (
            "give --max-gap 3 or m3 4 mm, 5 m/s, area 7",
            "give --max-gap 3 or m3 4 mm, 5 m/s, area 7",
        ),
    ],
)
def test_quantities_are_told_in_the_units_asked_for(sentence: str, expected: str) -> None:
    assert in_units(sentence, US) == expected
    assert "ft" not in in_units(sentence, named_units("metric"))


def test_unknown_units_are_not_called_metres() -> None:
    measurement = several()
    unknown = display_units(
        Measurement(**{**vars(measurement), "length_unit": "unknown"}), "metric"
    )
    assert in_units(EDGE.format(12), unknown) == EDGE.format(12).replace("m2", "units\u00b2")


def test_kinds_differ_in_more_than_numbers() -> None:
    assert kind_of("a gap of 1.5 m at (3.0, -4.25, 1e-3)") == kind_of("a gap of 2 m at (1, -2, 3)")
    assert kind_of("a gap of 1.5 m") != kind_of("a hole of 1.5 m")
    assert kind_of("95 % of m3") == "# % of m3"


def test_a_code_is_a_kind_whatever_the_words() -> None:
    one = Notice("gaps-interpolated", "1 gap of 0.4 m was interpolated", count=1)
    two = Notice("gaps-interpolated", "2 gaps of up to 0.6 m were interpolated", count=2)
    other = Notice("edge", EDGE.format(12), area_m2=12.0)
    assert kind_of(one) == kind_of(two) == "gaps-interpolated"
    shown = in_units(one, US)
    assert isinstance(shown, Notice)
    assert (shown, shown.code, shown.values) == (
        "1 gap of 1.3 ft was interpolated",
        "gaps-interpolated",
        {"count": 1},
    )
    lines = lines_of_kinds([("A", one), ("A", other), ("B", two), ("C", two)], named=True)
    assert lines == [f"A: {one}", f"in 2 areas (B, C): {two}", f"A: {other}"]


def test_many_names_are_counted() -> None:
    said = [(f"pile {n}", GAPS.format(n)) for n in range(10)]
    (line,) = lines_of_kinds(said, named=True)
    assert line.startswith("in 10 areas (pile 0, ")
    assert "pile 7 and 2 more): " in line
    assert "support 0 to 9%" in line
