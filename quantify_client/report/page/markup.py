"""HTML elements whose contents are escaped, unless they are Markup already.

Written here because pages are also made inside WebODM's web process, which holds one copy of each
package: a template engine packed with the plugin could replace the one that WebODM uses.
"""

from __future__ import annotations

import base64
import html
from pathlib import Path
from typing import Iterable, Sequence, Tuple, Union

from ..wording.units import NOTHING
from ..wording.words import printable

__all__ = ["Markup", "bar", "details", "facts", "figure", "join", "note", "table", "tag", "tile"]


class Markup(str):
    """Text that is HTML already."""

    __slots__ = ()


def join(*parts: object) -> Markup:
    """Return the parts one after another, each escaped unless it is Markup.

    Examples
    --------
    >>> join("<b>", Markup("<br>"), 'a "b"', 3)
    '&lt;b&gt;<br>a &quot;b&quot;3'
    """
    return Markup(
        "".join(
            part if isinstance(part, Markup) else html.escape(printable(part)) for part in parts
        )
    )


def tag(name: str, *parts: object, **attributes: object) -> Markup:
    """Return an element with the parts inside; ``class_`` is class, ``data_x`` is data-x.

    An attribute that is True has no value; one that is False, None or "" is left out.

    Examples
    --------
    >>> tag("p", "a < b", class_="muted", hidden=True)
    '<p class="muted" hidden>a &lt; b</p>'
    """
    given = ""
    for key, value in attributes.items():
        if value:
            given += " " + key.rstrip("_").replace("_", "-")
            given += "" if value is True else f'="{html.escape(printable(value))}"'
    return Markup(f"<{name}{given}>{join(*parts)}</{name}>")


def table(
    head: Sequence[object],
    rows: Iterable[Sequence[object]],
    *,
    foot: Sequence[object] = (),
    left: int = 1,
) -> Markup:
    """Return a table; all but the first `left` columns hold numbers."""

    def line(cells: Sequence[object], kind: str) -> Markup:
        looks = ["name" if i < left else "n" for i in range(len(cells))]
        return tag("tr", *(tag(kind, cell, class_=look) for cell, look in zip(cells, looks)))

    parts = [tag("thead", line(head, "th")), tag("tbody", *(line(row, "td") for row in rows))]
    if foot:
        parts.append(tag("tfoot", line(foot, "td")))
    return tag("div", tag("table", *parts), class_="scroll")


def facts(rows: Iterable[Tuple[str, object]]) -> Markup:
    """Return a table of names and values; those without a value are left out."""
    shown = [
        tag("tr", tag("th", name, scope="row"), tag("td", value))
        for name, value in rows
        if value not in ("", NOTHING)
    ]
    return tag("table", tag("tbody", *shown), class_="facts")


def tile(name: str, value: str, small: str, below: str, kind: str = "") -> Markup:
    """Return one number of a headline: large, with its spread and unit, and a line below it."""
    big = tag("div", value, tag("small", small), class_="big")
    number = tag("dd", big, tag("div", below, class_="interval"))
    return tag("div", tag("dt", name), number, class_=kind)


def bar(share: float, words: str) -> Markup:
    """Return a bar of a share in 0..1, and the share in words."""
    width = tag("i", style=f"width:{min(max(share, 0.0), 1.0) * 100:.0f}%")
    return join(tag("span", width, class_="bar"), " ", tag("span", words, class_="share"))


def note(lines: Sequence[str]) -> Markup:
    """Return a box with lines of text, or nothing."""
    if not lines:
        return Markup()
    return tag("div", tag("ul", *(tag("li", line) for line in lines)), class_="note", role="note")


def details(summary: str, *parts: object, opened: bool = False) -> Markup:
    """Return parts below a summary that opens and closes them."""
    return tag("details", tag("summary", summary), *parts, open=opened)


def figure(picture: Union[Path, bytes, None], words: str) -> Markup:
    """Return a PNG (a file, or its bytes) as a figure inside the page, or nothing."""
    if picture is None:
        return Markup()
    png = picture if isinstance(picture, bytes) else picture.read_bytes()
    source = "data:image/png;base64," + base64.b64encode(png).decode("ascii")
    return Markup(f'<figure><img alt="{html.escape(printable(words))}" src="{source}"></figure>')
