"""XML headers as flat paths, without entities, external references or unbounded depth."""

from __future__ import annotations

import re
from xml.parsers import expat

MAX_DEPTH = 32
MAX_ELEMENTS = 20_000
_FORBIDDEN = re.compile(r"<!\s*(DOCTYPE|ENTITY)", re.IGNORECASE)


class _StopParsingError(Exception):
    """Raised inside a handler to give up on a document."""


def flatten_xml(text: str) -> tuple[dict[str, str], str | None]:
    """``<Metadata><A><B>1</B></A></Metadata>`` -> ``{"A/B": "1"}`` and None, or why it failed.

    The root is left out of the paths; of elements with the same path the first is kept. An
    attribute is ``A/B@name``.
    A document type declaration is refused: no header needs one, and entities can be made to
    expand without end.
    """
    if _FORBIDDEN.search(text):
        return {}, "it declares a document type, which no microscope writes"
    values: dict[str, str] = {}
    stack: list[str] = []
    content: list[str] = []
    count = 0

    def start(name: str, attributes: dict[str, str]) -> None:
        nonlocal count
        count += 1
        if len(stack) >= MAX_DEPTH or count > MAX_ELEMENTS:
            raise _StopParsingError
        stack.append(name.rsplit(":", 1)[-1])
        content.clear()
        path = "/".join(stack[1:])
        for key, value in attributes.items() if path else ():
            values.setdefault(f"{path}@{key.rsplit(':', 1)[-1]}", value[:4096])

    def end(_name: str) -> None:
        value = "".join(content).strip()
        if value and len(stack) > 1:
            values.setdefault("/".join(stack[1:]), value[:4096])
        stack.pop()
        content.clear()

    parser = expat.ParserCreate()
    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.CharacterDataHandler = content.append
    start_of_xml = text.find("<")
    try:
        # The text is already decoded: a declared encoding no longer holds.
        body = re.sub(r"<\?xml[^>]{0,200}\?>", "", text[max(start_of_xml, 0) :], count=1)
        parser.Parse(body.strip(), True)
    except _StopParsingError:
        return {}, f"it has more than {MAX_ELEMENTS} elements or {MAX_DEPTH} levels"
    except (expat.ExpatError, ValueError) as error:
        return {}, f"it is not well-formed ({error})"
    return values, None
