"""Small pieces of HTML. Whatever comes from outside passes through :func:`text` here."""

from __future__ import annotations

import base64
import html
from pathlib import Path
from typing import Iterable, Iterator, List, Optional, Sequence, Tuple, Union

from ..wording.words import printable

__all__ = ["bar", "details", "facts", "figure", "note", "table", "text"]


def text(value: object) -> str:
    """Return the value as HTML text, also safe inside a quoted attribute.

    Examples
    --------
    >>> text('<b a="1">&')
    '&lt;b a=&quot;1&quot;&gt;&amp;'
    """
    return html.escape(printable(value), quote=True)


def table(
    head: Sequence[str],
    rows: Iterable[Sequence[str]],
    *,
    foot: Optional[Sequence[str]] = None,
    left: int = 1,
) -> str:
    """Return a table of markup cells; all but the first `left` columns hold numbers."""
    parts = ['<div class="scroll"><table><thead><tr>', *_cells(head, left, "th"), "</tr></thead>"]
    parts += ["<tbody>", *(f"<tr>{''.join(_cells(row, left, 'td'))}</tr>" for row in rows)]
    parts.append("</tbody>")
    if foot is not None:
        parts.append(f"<tfoot><tr>{''.join(_cells(foot, left, 'td'))}</tr></tfoot>")
    return "".join([*parts, "</table></div>"])


def _cells(cells: Sequence[str], left: int, tag: str) -> List[str]:
    return [
        f'<{tag} class="{"name" if i < left else "n"}">{cell}</{tag}>'
        for i, cell in enumerate(cells)
    ]


def facts(rows: Iterable[Tuple[str, str]]) -> str:
    """Return a table of names and markup values."""
    body = "".join(f'<tr><th scope="row">{text(k)}</th><td>{v}</td></tr>' for k, v in rows)
    return f'<table class="facts"><tbody>{body}</tbody></table>'


def bar(share: float) -> str:
    """Return a bar of a share in 0..1."""
    return f'<span class="bar"><i style="width:{min(max(share, 0.0), 1.0) * 100:.0f}%"></i></span>'


def note(lines: Sequence[str]) -> str:
    """Return a box with lines of plain text, or nothing."""
    if not lines:
        return ""
    items = "".join(f"<li>{text(line)}</li>" for line in lines)
    return f'<div class="note" role="note"><ul>{items}</ul></div>'


def details(summary: str, markup: str, *, opened: bool = False) -> str:
    """Return markup that is folded away, or can be."""
    tag = "<details open>" if opened else "<details>"
    return f"{tag}<summary>{text(summary)}</summary>{markup}</details>"


def figure(picture: Union[Path, bytes], words: str) -> Iterator[str]:
    """Yield a PNG (a file, or what is in one) as a figure of the page itself."""
    png = picture if isinstance(picture, bytes) else picture.read_bytes()
    yield f'<figure><img alt="{text(words)}" src="data:image/png;base64,'
    yield base64.b64encode(png).decode("ascii")
    yield '"></figure>'
