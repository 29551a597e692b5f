"""Small pieces of HTML; everything that comes from outside is escaped here."""

from __future__ import annotations

import base64
import html
import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any


def text(value: object) -> str:
    """Any value as text that cannot become markup."""
    return html.escape(str(value), quote=True)


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
    """A boxed part of the page with a heading."""
    heading = f"<h2>{text(title)}</h2>"
    return f'<section id="{text(anchor)}" class="{text(kind)}">{heading}{body}</section>'


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
) -> str:
    """A table whose numbers are flush right and whose `text_columns` are flush left."""

    def row(tag: str, cells: Sequence[str]) -> str:
        return "".join(
            f'<{tag} class="text">{text(cell)}</{tag}>'
            if k in text_columns
            else f"<{tag}>{text(cell)}</{tag}>"
            for k, cell in enumerate(cells)
        )

    body = "".join(
        f'<tr class="absent">{row("td", r.cells)}</tr>'
        if r.absent
        else f"<tr>{row('td', r.cells)}</tr>"
        for r in rows
    )
    size = "table narrow" if narrow else "table"
    return (
        f'<div class="{size}"><table><thead><tr>{row("th", headers)}</tr></thead>'
        f"<tbody>{body}</tbody></table></div>"
    )


def definitions(pairs: Iterable[tuple[str, str]]) -> str:
    """Names and values side by side."""
    rows = "".join(f"<div><dt>{text(k)}</dt><dd>{text(v)}</dd></div>" for k, v in pairs)
    return f'<dl class="summary">{rows}</dl>'


def image(png: bytes, caption: str) -> str:
    """A PNG within the page, at half its pixels, so that it is sharp and all lettering is equal."""
    width = int.from_bytes(png[16:20], "big")  # the header chunk starts with the width
    data = base64.b64encode(png).decode("ascii")
    return (
        f'<figure><img alt="{text(caption)}" width="{width // 2}" '
        f'src="data:image/png;base64,{data}"><figcaption>{text(caption)}</figcaption></figure>'
    )


def script_json(value: Any, *, element_id: str) -> str:
    """JSON in a script element that no string within can close."""
    body = json.dumps(value, allow_nan=False, separators=(",", ":"))
    for character in "<>&":
        body = body.replace(character, f"\\u{ord(character):04x}")
    return f'<script type="application/json" id="{text(element_id)}">{body}</script>'
