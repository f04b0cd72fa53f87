"""The view of a body that turns, and the page around it."""

from __future__ import annotations

import base64
import dataclasses
import hashlib
import json
import re
from pathlib import Path
from typing import Any, Dict, List

import numpy as np
import pytest

from quantify_client.report.page.view import view_markup
from quantify_client.report.wording.units import METRIC
from quantify_client.types import Floor

from . import bodies, surveys
from .bodies import body_of, plain, with_body
from .test_reading import HOSTILE_TEXTS, Tags, page


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
    body = body_of(torus)
    for key in ("points", "ground", "outliers"):
        packed = data["layers"][key]
        assert packed["count"] == len(getattr(body, key))
        error = np.abs(unpacked(packed) - getattr(body, key)).max()
        assert error <= packed["step"] * 0.501
        assert packed["step"] < 4.0 / 32767
    outlines = data["outlines"]
    assert outlines["rings"] == [[i // 2, 90] for i in range(80)]
    corners = np.vstack([ring for rings in body.outlines for ring in rings])
    assert np.abs(unpacked(outlines) - corners).max() <= outlines["step"] * 0.501
    z = [s.z_m - body.origin[2] for s in torus.slices]
    assert outlines["z"] == pytest.approx(z, abs=1e-6)


def test_far_strays_do_not_coarsen_the_body() -> None:
    outliers = np.array([[9e5, 0, 0], [0, 0, -3e4]], np.float32)
    [data] = data_of(view_markup(with_body(bodies.ball(), outliers=outliers), METRIC, north=False))
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
    known = {tuple(row) for row in np.round(body_of(ball).points.astype(float), 3)}
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
    everything = ["points", "outlines", "gaps", "ground", "outliers"]
    assert boxes_of(view_markup(bodies.ball(), METRIC, north=False)) == everything
    nothing = np.zeros((0, 3), np.float32)
    bare = with_body(bodies.torus(), ground=nothing, outliers=nothing, floor=None)
    assert boxes_of(view_markup(bare, METRIC, north=False)) == ["points", "outlines"]
    assert view_markup(with_body(bare, points=nothing, outlines=[]), METRIC, north=False) == ""


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
        changes_of_body={"floor": floor},
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
