"""The end of a command: what came out, what to doubt, on one screen of a terminal (24 x 80).

Made from metrics.json, so that what the report says is what the terminal says. Plain ASCII, for
terminals and logs that know nothing else.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from semsfm_colmap.report.number_text import THIN_SPACE, confidence, measured, number
from semsfm_colmap.report.trust_text import SAME_RANGE

WIDTH = 80
INDENT = 11
MAX_DOUBTS = 3
MAX_ACTION_LINES = 2
"""Of each doubt; the report has the rest."""
ASCII = str.maketrans(
    {
        THIN_SPACE: " ", "±": "+-", "°": " deg", "µ": "u", "²": "^2", "×": "x", "−": "-",
        "–": "-", "σ": "sigma", "\u00a0": " ",
    }
)  # fmt: skip
Json = Mapping[str, Any]


def in_ascii(text: str) -> str:
    """A sentence of the report for a terminal."""
    return text.translate(ASCII).encode("ascii", "replace").decode()


def summary_lines(
    metrics: Json, files: Sequence[str], following: Sequence[str], failed: Sequence[str] = ()
) -> list[str]:
    """The lines, each at most `WIDTH` characters but for names and commands that are longer.

    Parameters
    ----------
    metrics : the content of metrics.json
    files : where the results are
    following : commands to type next
    failed : stages that came to nothing

    """
    rows = [
        ("images", [_images(metrics)]),
        ("rotation", list(_rotation(metrics))),
        ("hand", [_hand(metrics["depth_sign"])]),
        ("scale", [_scale(metrics["world"])]),
        ("mesh", list(_mesh(metrics))),
        ("doubts", list(_doubts(metrics["verdict"]["doubts"]))),
        ("failed", list(failed)),
        ("files", textwrap.wrap(", ".join(files), WIDTH - INDENT, break_on_hyphens=False)),
        ("next", list(following)),
    ]
    return [
        f"  {name if k == 0 else '':<{INDENT - 2}}{in_ascii(text)}"
        for name, texts in rows
        for k, text in enumerate(texts)
    ]


def _images(m: Json) -> str:
    images, r = m["images"], m["residuals"]
    registered = f"{images['num_registered']} of {images['num_given']}"
    text = f"{registered}, {m['structure']['num_points']} points"
    rms = r.get("rms_per_coordinate_px")
    if rms is None:
        return text
    nm = r.get("rms_per_coordinate_nm")
    return f"{text}, residual {number(rms, 2)} px" + (
        "" if nm is None else f" = {number(nm, 2)} nm"
    )


def _rotation(m: Json) -> Iterator[str]:
    trust = m["reliability"]
    if not trust:
        return
    total, sigma = trust["total_rotation_deg"], trust["total_rotation_sigma_deg"]
    known = trust.get("total_rotation_sigma_parts_deg") is not None
    largest = measured(total, sigma if known else None) + "°" + ("" if known else ", no error bar")
    turn = m.get("rotation")
    if turn is None or abs(total - turn["range_deg"]) < SAME_RANGE * turn["range_deg"]:
        yield largest
    else:
        yield f"{number(turn['range_deg'])}° about one axis; between two views at most {largest}"


def _hand(sign: Json) -> str:
    if sign["status"] != "resolved":
        return f"open; the first model has {confidence(sign['confidence'])}"
    if "user" in sign["evidence"]:
        return "as you gave it"
    return f"decided, {confidence(sign['confidence'])}"


def _scale(world: Json) -> str:
    if world["unit"] != "um":
        return "no pixel size: all lengths are in px"
    return f"one pixel is {number(world['pixel_size_nm'], 4)} nm ({world['pixel_size_source']})"


def _mesh(m: Json) -> Iterator[str]:
    mesh = m["mesh"]
    if mesh is not None and "bounding_box_size_world" in mesh:
        size = " × ".join(number(s) for s in mesh["bounding_box_size_world"])
        yield f"{size} {m['world']['unit']}, {mesh['num_faces']} faces"


def _doubts(doubts: Sequence[Json]) -> Iterator[str]:
    if not doubts:
        yield "none"
    for doubt in doubts[:MAX_DOUBTS]:
        yield doubt["title"]
        lines = textwrap.wrap(
            in_ascii(doubt["action"]),
            WIDTH - INDENT - 3,
            max_lines=MAX_ACTION_LINES,
            placeholder=" ...",
            break_on_hyphens=False,
        )
        for k, line in enumerate(lines):
            yield f"{'-> ' if k == 0 else '   '}{line}"
    more = len(doubts) - MAX_DOUBTS
    if more > 0:
        yield f"and {more} more: see the report"
