"""The viewer as a part of a page, and as a page of its own beside its server."""

from __future__ import annotations

from importlib import resources

from semsfm_colmap.report.html_parts import text
from semsfm_colmap.report.viewer.library import three_js
from semsfm_colmap.report.viewer.packing import as_text
from semsfm_colmap.report.viewer.scene import ViewerScene

SCRIPTS = (
    "bytes.js", "numbers.js", "budget.js", "navigation.js", "drawing.js", "overlay.js",
    "measuring.js", "viewer.js",
)  # fmt: skip
"""In the order in which they use one another."""
KEYS = (
    "Drag to turn, right-drag or shift-drag to move, wheel to zoom once the picture is clicked; "
    "two fingers move and zoom. Keys: arrows turn, with shift they move, + and - zoom, [ and ] "
    "roll; m measures, enter picks at the cross, escape clears."
)
CANVAS_LABEL = "The scene in three dimensions. " + KEYS
LIVE_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
    "connect-src 'self'; img-src blob:; form-action 'none'; base-uri 'none'; frame-ancestors 'none'"
)


def viewer_style() -> str:
    """The viewer's CSS."""
    return _asset("viewer.css")


def viewer_scripts() -> str:
    """The library and our scripts, each in an element of its own.

    Raises
    ------
    MissingDependencyError
        The library is not there.

    """
    return "".join(f"<script>{code}</script>" for code in (three_js(), *map(_asset, SCRIPTS)))


def viewer_block(*, mode: str, still: str = "") -> str:
    """The controls, the canvas and what is read from it.

    Parameters
    ----------
    mode : page for one that holds its scene, live for one beside its server
    still : HTML of a picture for paper, and where there is no WebGL

    """
    return (
        f'<div class="viewer" id="viewer" data-mode="{text(mode)}"><div class="viewer-controls">'
        + _group("Show", '<span class="viewer-group" data-part="layers"></span>')
        + '<label>Colour <select data-part="color"></select></label>'
        + _group("View", '<span class="viewer-group" data-part="views"></span>')
        + '<label>Through the camera of <select data-part="frame"></select></label>'
        '<label>Image over it <input type="range" data-part="blend" min="0" max="1" step="0.05" '
        'value="0.5"><span data-part="blend-hint"></span></label>'
        + _group("Section", _SECTION)
        + _group("Measure", _MEASURE, part="measuring")
        + '<button type="button" data-part="export">save as PNG</button></div>'
        '<div class="viewer-stage" data-part="stage">'
        f'<canvas data-part="canvas" tabindex="0" role="application" '
        f'aria-label="{text(CANVAS_LABEL)}"></canvas>'
        '<canvas data-part="overlay" aria-hidden="true"></canvas></div>'
        '<p class="hint" data-part="message" role="status"></p>'
        '<div class="viewer-readout" data-part="readout" aria-live="polite"></div>'
        f'<div class="viewer-still">{still}</div></div>'
    )


def scene_element(scene: ViewerScene) -> str:
    """The packed scene as an element that no browser runs."""
    data = as_text(scene.packed)
    return f'<script type="application/octet-stream" id="viewer-scene">{data}</script>'


def live_page(title: str) -> str:
    """The page of `semsfm view`, which asks its server for everything."""
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta http-equiv="Content-Security-Policy" content="{text(_in_meta(LIVE_POLICY))}">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{text(title)}: semsfm view</title><style>:root {{ color-scheme: light dark; }}"
        f'{viewer_style()}</style></head>\n<body class="viewer-page">'
        f"{viewer_block(mode='live')}{viewer_scripts()}</body></html>\n"
    )


def _in_meta(policy: str) -> str:
    """Without what browsers take from a header alone."""
    return "; ".join(p for p in policy.split("; ") if not p.startswith("frame-ancestors"))


def _asset(name: str) -> str:
    file = resources.files("semsfm_colmap.report.viewer").joinpath("assets", name)
    return file.read_text("utf-8")


def _group(legend: str, body: str, part: str = "") -> str:
    mark = f' data-part="{part}"' if part else ""
    return f'<fieldset class="viewer-group"{mark}><legend>{text(legend)}</legend>{body}</fieldset>'


_SECTION = (
    '<select data-part="cut" aria-label="direction of the section"><option value="">none</option>'
    '<option value="x">across x</option><option value="y">across y</option>'
    '<option value="z">across z</option><option value="view">across the view</option></select>'
    '<input type="range" data-part="cut-at" min="0" max="1" step="0.002" value="0.5" disabled '
    'aria-label="place of the section">'
    '<label><input type="checkbox" data-part="cut-flip" disabled> other side</label>'
    '<output data-part="cut-text"></output>'
)
_MEASURE = (
    '<button type="button" data-part="measure" aria-pressed="false">pick places</button>'
    '<form data-part="vertex-form"><label>vertex <input type="number" data-part="vertex" min="0" '
    'step="1"></label><button type="submit">add</button></form>'
    '<button type="button" data-part="clear">clear</button>'
)
