"""What `mkdocs build` calls: generated pages go in, equations become MathML.

Pages of the root (ARCHITECTURE.md ...) and of the code (`reference.py`) are added under
``development/`` and ``reference/``. Equations are drawn by the browser itself, from MathML that
latex2mathml makes at build time: the site needs no script and no network for them.
"""

from __future__ import annotations

import html
import re
from pathlib import Path
from typing import Any

import reference
from latex2mathml.converter import convert
from mkdocs.structure.files import File, Files

ROOT = Path(__file__).parents[1]
FROM_ROOT = {
    "ARCHITECTURE.md": "development/architecture.md",
    "CONTRIBUTING.md": "development/contributing.md",
    "CHANGELOG.md": "development/changelog.md",
}
"""Pages beside the README, and where they are in the site."""
EQUATION = re.compile(r'<(span|div) class="arithmatex">\\([(\[])(.*?)\\[)\]]</\1>', re.DOTALL)


def on_files(files: Files, *, config: Any) -> Files:
    """Add the generated pages."""
    pages = reference.pages()
    for name, path in FROM_ROOT.items():
        pages[path] = moved((ROOT / name).read_text(encoding="utf-8"))
    for path, text in pages.items():
        files.append(File.generated(config, path, content=text))
    return files


def moved(text: str) -> str:
    """A page of the root with its links as they are from ``development/``."""
    text = re.sub(r"\]\(docs/", "](../", text)
    for name, path in FROM_ROOT.items():
        text = text.replace(f"]({name})", f"]({Path(path).name})")
    return text


def on_page_content(content: str, **_: Any) -> str:
    """Equations as MathML."""

    def drawn(found: re.Match[str]) -> str:
        tag, bracket, tex = found.groups()
        display = "block" if bracket == "[" else "inline"
        return f'<{tag} class="arithmatex">{convert(html.unescape(tex), display=display)}</{tag}>'

    return EQUATION.sub(drawn, content)
