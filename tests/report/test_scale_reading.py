"""What people read of a scaling: the terminal and the page."""

from __future__ import annotations

import io
import re
from dataclasses import replace
from pathlib import Path
from typing import Any, List

import pytest
from rich.console import Console

from quantify_client.errors import InputError, OutputError
from quantify_client.report.page import page as page_module
from quantify_client.report.page.markup import Markup, details, join, tag
from quantify_client.report.page.page import Pictures, render_html
from quantify_client.report.page.scaling import scale_section
from quantify_client.report.terminal.scaling import print_scaling
from quantify_client.report.wording.scaling import (
    error_words,
    factor_words,
    mode_words,
    observations_of,
    percent,
    worst,
)
from quantify_client.report.wording.units import METRIC, THIN_SPACE, US
from quantify_client.report.write import write_scale_report
from quantify_client.types import DirectHeight, Scaled, Scaling

from . import scalings, surveys
from .test_reading import HOSTILE_TEXTS, Tags

# Servers, sizes and words: no different on a second Python.
pytestmark = pytest.mark.one_python

CONTROL = re.compile("[\x00-\x09\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")


def printed(scaling: Scaling, units: str = "metric", **console: Any) -> str:
    options = {"width": 140, "file": io.StringIO(), "force_terminal": False, **console}
    terminal = Console(**options)
    print_scaling(scaling, terminal, units)
    return terminal.file.getvalue()


def line_of(shown: str, words: str) -> str:
    return next(line for line in shown.splitlines() if line.strip().startswith(words))


def test_factor_has_the_digits_of_its_error() -> None:
    scaling = scalings.least()
    assert factor_words(scaling) == "1.20482 \u00b1 0.00031"
    assert error_words(scaling) == "0.026\u00a0%, 259\u00a0ppm"
    assert error_words(replace(scaling, std=0.0312)) == "2.6\u00a0%"
    assert factor_words(replace(scaling, std=float("nan"))) == "1.204817"
    assert error_words(replace(scaling, std=float("nan"))) == ""


def test_mode_tells_what_is_kept() -> None:
    assert "keeps its vertical" in mode_words(scalings.in_a_line())
    assert "known to 0.031\u00b0" in mode_words(scalings.everything())


@pytest.mark.parametrize(("share", "words"), [(0.9996, "100"), (0.0099, "1.0"), (1e-5, "0")])
def test_shares_are_whole_percent_unless_small(share: float, words: str) -> None:
    assert percent(share) == f"{words}\u00a0%"


def test_a_position_is_one_row_and_the_worst_comes_first() -> None:
    rows = observations_of(scalings.everything())
    kinds = [row.kind for row in rows]
    assert kinds == sorted(kinds, key=["distance", "scale_bar", "gps", "elevation", "cloud"].index)
    assert {len(row.parts) for row in rows if row.kind == "gps"} == {2}
    assert {len(row.parts) for row in rows if row.kind == "cloud"} == {3}
    tapes = [row for row in rows if row.kind == "distance"]
    assert tapes[0].outlier
    sizes = [abs(row.in_sigmas or 0.0) for row in tapes]
    assert sizes == sorted(sizes, reverse=True)
    grades = {row.grade for row in rows}
    assert grades == {"good", "doubtful", "bad", "open"}


def test_a_length_taped_twice_is_two_rows() -> None:
    tapes = [scalings.observation("distance", "AB", r, 0.005) for r in (0.001, -0.02)]
    rows = observations_of(scalings.scaling(observations=tapes))
    assert [row.in_sigmas for row in rows] == pytest.approx([-4.0, 0.2], abs=1e-12)
    assert [row.grade for row in rows] == ["bad", "good"]


def test_a_sigma_of_zero_gives_no_grade() -> None:
    tape = scalings.observation("distance", "AB", 0.1, 0.0)
    (row,) = observations_of(scalings.scaling(observations=(tape,)))
    assert (row.in_sigmas, row.grade) == (None, "open")


def test_terminal_shows_outlier_conflict_checks_and_remarks() -> None:
    shown = printed(scalings.everything())
    assert "1.20482 \u00b1 0.00031" in shown
    assert "\u2717 Conflict: tape A-C disagrees with the rest by 0.310 m" in shown
    assert "The scale comes from 11 tapes (known to 0.026 %; " in shown
    wrong = line_of(shown, "tape A-C")
    for part in ("+0.3100", "62.0 \u2717", "left out: contradicts the rest"):
        assert part in wrong
    assert "check, not in the fit" in line_of(shown, "tape G-P")
    assert "nothing controls it" in line_of(shown, "elevation H")
    assert "31 %" in line_of(shown, "scale bar P-E")
    assert "2.6 ?" in line_of(shown, "elevation D")
    assert re.search(r"E [+-]0\.\d{3}  N [+-]0\.\d{3}", line_of(shown, "position A"))
    assert "RMS of the checks 0.012 m" in shown
    assert "Height difference C-D: the tape is shorter" in shown
    assert "Warning: The sigmas of 'gps' were raised by 1.4." in shown


def test_that_nothing_contradicts_is_no_conflict() -> None:
    shown = printed(scalings.crowd())
    assert "\u2713 Nothing contradicts the rest" in shown
    assert "Conflict" not in shown
    html = scale_section(scalings.crowd(), METRIC, None)
    assert "Nothing contradicts the rest" in html
    assert 'class="conflict"' not in html


def test_many_remarks_on_heights_are_counted() -> None:
    heights = [DirectHeight("A", f"B{i}", 9.0, 9.1, None, None, None, "no") for i in range(30)]
    shown = printed(scalings.scaling(direct=heights))
    assert shown.count("Height difference A-B") == 5
    assert "25 more height differences with a remark are in the report." in shown


def test_feet_where_people_read() -> None:
    shown = printed(scalings.everything(), "us")
    assert "+1.017" in line_of(shown, "tape A-C")
    assert line_of(shown, "Observation").split()[1:4] == ["ft", "ft", "ft"]
    assert "RMS of the checks 0.039 ft" in shown
    with pytest.raises(InputError, match="metric or us"):
        printed(scalings.least(), "imperial")


def test_colour_is_never_alone() -> None:
    plain = printed(scalings.everything())
    coloured = printed(scalings.everything(), force_terminal=True, color_system="standard")
    assert "\x1b[" in coloured
    assert "\x1b[" not in plain
    for mark in ("\u2713", "?", "\u2717", "\u25cb"):
        assert mark in plain


def test_at_most_40_rows_and_the_worst_are_among_them() -> None:
    scaling = scalings.crowd()
    rows = observations_of(scaling)
    shown = printed(scaling)
    assert len(rows) == 299
    assert "These are the worst 40; 259 more are in the report." in shown
    assert sum(re.match(r" ?(tape|position|\S+ in the cloud)", s) is not None
               for s in shown.splitlines()) == 40  # fmt: skip
    kept = worst(rows, 40)
    assert kept[0].kind == "distance"
    assert any(row.outlier for row in kept)
    least = min(abs(row.in_sigmas or 0.0) for row in kept if not row.outlier)
    assert all(abs(row.in_sigmas or 0.0) <= least for row in rows if row not in kept)


@pytest.mark.parametrize("width", [20, 40, 60, *range(70, 84, 2), 100, 123, 200])
def test_every_width_shows_every_number(width: int) -> None:
    shown = printed(scalings.everything(), width=width)
    for part in ("+0.3100", "50.2264", "62.0", "+0.0008", "contradicts", "check"):
        assert part in shown
    assert max(map(len, shown.splitlines())) <= width


@pytest.mark.parametrize("width", [40, 80, 140])
@pytest.mark.parametrize(
    "name", ["[red]A[/red] [/]", "a\x1b[2Jb", "a\x9b2J", "a\rb\x07", "a\u202eb"]
)
def test_names_are_text_on_the_terminal(name: str, width: int) -> None:
    shown = printed(scalings.everything(name=name), width=width)
    assert not CONTROL.search(shown)
    if "[red]" in name:
        assert "odd [red]A[/red] [/]" in shown


def test_a_terminal_without_unicode_gets_ascii() -> None:
    raw = io.BytesIO()
    file = io.TextIOWrapper(raw, encoding="ascii", errors="strict")
    print_scaling(scalings.everything(name="\u7802"), Console(file=file, width=140))
    file.flush()
    assert b"62.0 x" in raw.getvalue()
    assert b"0.031 deg" in raw.getvalue()


def write(scaling: Scaling, tmp_path: Path, **changes: Any) -> str:
    path, units = tmp_path / "scale.html", changes.pop("units", "metric")
    scaled = Scaled("all.zip", scaling, None, (), {"version": "0.1.0"})
    write_scale_report(replace(scaled, **changes), path, units)
    assert [p.name for p in tmp_path.iterdir()] == ["scale.html"]
    return path.read_text("utf-8")


def links(html: str) -> List[str]:
    tags = Tags()
    tags.feed(html)
    assert tags.open == []
    return [value for name, value in tags.attributes if name in ("src", "href")]


def test_page_needs_nothing_from_elsewhere(tmp_path: Path) -> None:
    html = write(scalings.everything(), tmp_path)
    assert [link[:22] for link in links(html)] == ["data:image/png;base64,"]
    assert "default-src 'none'; img-src data:; style-src 'unsafe-inline'\"" in html
    assert "url(" not in html
    assert "@import" not in html
    assert "http" not in re.sub(r"base64,[^\"]*", "", html).replace("http-equiv", "")


def test_page_states_factor_observations_points_and_heights(tmp_path: Path) -> None:
    html = write(scalings.everything(), tmp_path, warnings=("one of the run",), out="a/b.laz")
    html = html.replace(THIN_SPACE, " ").replace("\u00a0", " ")
    for part in (
        "1.20482<small> \u00b1 0.00031</small>",
        "1 \u03c3: 0.026 %, 259 ppm",
        "Conflict:</b> tape A-C disagrees with the rest",
        "The scale comes from 11 tapes",
        "Observations (33, 1 left out)",
        '<span class="grade bad">62.0 \u2717</span>',
        '<span class="grade doubtful">2.6 ?</span>',
        '<span class="grade open">0.0 \u25cb</span>',
        "left out: contradicts the rest",
        "Control points (9)",
        "46.83981115<br>-91.99050000",
        "Height differences from slope and ground (3, 2 with a remark)",
        "one of the run",
        "EPSG:32615",
        "a/b.laz",
    ):
        assert part in html, part
    assert html.count("The sigmas of &#x27;gps&#x27; were raised") == 1


def test_page_in_us_units_has_feet(tmp_path: Path) -> None:
    html = write(scalings.everything(), tmp_path, units="us")
    assert "Residual, ft" in html
    assert "+1.017" in html
    assert ", m<" not in html


@pytest.mark.parametrize("bad", [*HOSTILE_TEXTS, scalings.HOSTILE])
def test_nothing_from_outside_becomes_markup(bad: str, tmp_path: Path) -> None:
    scaling = replace(scalings.everything(name=bad), target_crs=bad, carried_by=bad)
    html = write(scaling, tmp_path, source=bad, provenance={bad: bad}, warnings=(bad,), out=bad)
    tags = Tags()
    tags.feed(html)
    assert tags.open == []
    assert not {"script", "iframe", "object", "link"} & set(tags.names)
    assert tags.names.count("img") == 1
    assert all(not name.startswith("on") for name, _ in tags.attributes)
    assert not CONTROL.search(html)


@pytest.mark.parametrize("scaling", [scalings.least(), scalings.scaling(), scalings.unplaced()])
def test_poor_scalings_have_a_page_too(scaling: Scaling, tmp_path: Path) -> None:
    html = write(scaling, tmp_path)
    assert not re.search(r"\b(nan|None|inf)\b", re.sub(r"base64,[^\"]*", "", html))
    assert len(links(html)) == 1


def test_long_tables_are_folded_and_short_ones_are_not() -> None:
    assert "<details><summary>Observations (299" in scale_section(scalings.crowd(), METRIC, None)
    assert "<details open><summary>Observations (1)" in scale_section(
        scalings.least(), METRIC, None
    )
    assert details("a", "b") == "<details><summary>a</summary>b</details>"


def test_only_markup_is_not_escaped() -> None:
    line = Markup("<br>")
    assert join("<b>", line) == "&lt;b&gt;<br>"
    assert join(f"{line}", line + "x") == "&lt;br&gt;&lt;br&gt;x"
    assert tag("p", tag("b", "&"), id='"><x', open=False) == (
        '<p id="&quot;&gt;&lt;x"><b>&amp;</b></p>'
    )
    assert tag("i", id=Markup('"')) == '<i id="&quot;"></i>'


def test_report_of_volumes_has_the_card_before_the_results(tmp_path: Path) -> None:
    picture = tmp_path / "scale.png"
    picture.write_bytes(b"png")
    measurement = surveys.measurement(
        surveys.pile(),
        scale=scalings.everything(),
        warnings=("The sigmas of 'gps' were raised by 1.4.",),
    )
    html = "".join(render_html(measurement, US, Pictures(scale=picture)))
    assert html.index('id="scale"') < html.index('id="area-1"')
    assert "<span>Scaled by</span><b>1.20482" in html
    assert html.count("were raised by 1.4") == 1
    assert 'id="scale"' not in "".join(
        render_html(surveys.measurement(surveys.pile()), US, Pictures())
    )


def test_the_budget_tells_what_scale_means() -> None:
    item = surveys.BudgetItem("scale", 3.0)
    result = surveys.body(budget=(item,))
    html = "".join(render_html(surveys.measurement(result), METRIC, Pictures()))
    assert "how well the control knows the size of the whole cloud" in html


def test_a_failure_leaves_the_earlier_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "scale.html"
    write(scalings.least(), tmp_path)
    earlier = path.read_bytes()

    def disk_full(*_args: Any, **_kwargs: Any) -> Any:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(page_module, "render_scale_html", disk_full)
    with pytest.raises(OutputError, match="No space left on device") as caught:
        write(scalings.least(), tmp_path)
    assert "\n" not in str(caught.value)
    assert path.read_bytes() == earlier
    assert [p.name for p in tmp_path.iterdir()] == ["scale.html"]


def test_a_page_that_cannot_be_written_is_refused_in_words(tmp_path: Path) -> None:
    (tmp_path / "scale.html").mkdir()
    for path in (tmp_path / "scale.html", tmp_path / "no" / "such" / "x.html"):
        with pytest.raises(OutputError, match="another name|name of a file"):
            write_scale_report(Scaled("a", scalings.least(), None, (), {}), path)
