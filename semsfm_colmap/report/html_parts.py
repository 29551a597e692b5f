"""Small pieces of HTML; everything that comes from outside is escaped here."""

from __future__ import annotations

import base64
import html
import io
import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from semsfm_colmap.io.terminal import printable

FIGURE_QUALITY = 78
"""Of 100: the lettering stays clean."""


def text(value: object) -> str:
    """Any value as text that cannot become markup, nor turn the writing beside it."""
    return html.escape(printable(str(value)), quote=True)


def bullets(sentences: Iterable[str]) -> str:
    """A list of sentences."""
    return bullets_of(text(s) for s in sentences)


def bullets_of(items: Iterable[str]) -> str:
    """A list of pieces that are markup already."""
    return "<ul>" + "".join(f"<li>{item}</li>" for item in items) + "</ul>"


def remedies(pairs: Iterable[tuple[str, str]]) -> str:
    """A list of sentences, each with what to do about it below."""
    return bullets_of(f'{text(s)}<div class="remedy">{text(r)}</div>' for s, r in pairs)


def section(title: str, body: str, *, anchor: str, kind: str = "") -> str:
    """A boxed part of the page with a heading, which names it to a screen reader."""
    name = f"{text(anchor)}-title"
    heading = f'<h2 id="{name}">{text(title)}</h2>'
    opening = f'<section id="{text(anchor)}" class="{text(kind)}" aria-labelledby="{name}">'
    return f"{opening}{heading}{body}</section>"


def hint(sentence: str) -> str:
    """A remark in small type."""
    return f'<p class="hint">{text(sentence)}</p>'


@dataclass(frozen=True, kw_only=True)
class Row:
    """One row of a table; an absent one stands out."""

    cells: tuple[str, ...]
    absent: bool = False


def table(
    headers: Sequence[str],
    rows: Iterable[Row],
    *,
    text_columns: Sequence[int],
    narrow: bool = False,
    label: str = "Table",
) -> str:
    """A table whose numbers are flush right and whose `text_columns` are flush left.

    It scrolls in a box of its own, which the keyboard reaches and `label` names; the first of the
    text columns heads the rows.
    """
    row_header = text_columns[0] if text_columns else None

    def cell(k: int, content: str, head: bool) -> str:
        kind = ' class="text"' if k in text_columns else ""
        if head:
            # an empty corner is no header
            return f'<th scope="col"{kind}>{text(content)}</th>' if content else f"<td{kind}></td>"
        if k == row_header:
            return f'<th scope="row"{kind}>{text(content)}</th>'
        return f"<td{kind}>{text(content)}</td>"

    def row(cells: Sequence[str], head: bool = False) -> str:
        return "".join(cell(k, content, head) for k, content in enumerate(cells))

    body = "".join(
        f'<tr class="absent">{row(r.cells)}</tr>' if r.absent else f"<tr>{row(r.cells)}</tr>"
        for r in rows
    )
    size = "table narrow" if narrow else "table"
    return (
        f'<div class="{size}" role="region" tabindex="0" aria-label="{text(label)}"><table>'
        f"<thead><tr>{row(headers, head=True)}</tr></thead><tbody>{body}</tbody></table></div>"
    )


def definitions(pairs: Iterable[tuple[str, str]]) -> str:
    """Names and values side by side."""
    rows = "".join(f"<div><dt>{text(k)}</dt><dd>{text(v)}</dd></div>" for k, v in pairs)
    return f'<dl class="summary">{rows}</dl>'


def image(png: bytes, caption: str, *, picture: bool = False) -> str:
    """A PNG within the page, at half its pixels, so that it is sharp and all lettering is equal.

    A `picture`, of pixels rather than lines, goes in as WebP, which is a fifth of the size.
    """
    width, height = (int.from_bytes(png[k : k + 4], "big") for k in (16, 20))  # header chunk
    address = "data:image/png;base64," + base64.b64encode(png).decode("ascii")
    if picture:
        address = webp_address(png)
    return (
        f'<figure><img alt="{text(caption)}" width="{width // 2}" height="{height // 2}" '
        f'src="{address}"><figcaption>{text(caption)}</figcaption></figure>'
    )


def webp_address(png: bytes) -> str:
    """The same picture as WebP, as an address that needs no file."""
    import numpy as np
    from PIL import Image

    from semsfm_colmap.report.images.pictures import data_uri, webp

    return data_uri(webp(np.asarray(Image.open(io.BytesIO(png))), FIGURE_QUALITY))


def script_json(value: Any, *, element_id: str) -> str:
    """JSON in a script element that no string within can close."""
    body = json.dumps(value, allow_nan=False, separators=(",", ":"))
    for character in "<>&":
        body = body.replace(character, f"\\u{ord(character):04x}")
    return f'<script type="application/json" id="{text(element_id)}">{body}</script>'
