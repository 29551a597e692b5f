"""The sections with the images: a strip of all of them, a panel of one, a viewer of pairs."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from semsfm_colmap.records import MATCH_STEPS
from semsfm_colmap.report.html_parts import hint, text
from semsfm_colmap.report.image_statistics import ImageMetrics
from semsfm_colmap.report.images.fates import FATE_LABELS
from semsfm_colmap.report.images.panels import Panels
from semsfm_colmap.report.number_text import fixed, number

MAGNIFICATION = 50
"""Residual vectors are drawn this much longer than they are."""
PICTURES = (
    ("image", "image"),
    ("mesh", "mesh over the image"),
    ("depth", "depth map"),
    ("sigma", "σ of the depth"),
)
ZOOMS = (1, 2, 4)
WITHOUT_SCRIPT = (
    '<p class="hint" id="without-script">The panels of the images and the viewer of pairs need '
    "JavaScript; the table below and the figures do not.</p>"
)


def strip(panels: Panels, images: Sequence[ImageMetrics]) -> str:
    """All images small, each a button that shows its panel, with frame number, angle and RMS."""
    items = []
    for k, (image, picture) in enumerate(zip(images, panels.thumbnails, strict=True)):
        pose = image.pose
        if pose is None:
            below = "not registered"
        else:
            below = f"{fixed(pose.angle_deg, 1)}° · {number(pose.rms_px, 2)} px"
        shown = (
            f'<img alt="" src="{picture}">'
            if picture is not None
            else '<span class="gone">no file</span>'
        )
        kind = ' class="absent"' if pose is None else ""
        items.append(
            f'<li{kind}><button type="button" data-frame="{k}" aria-pressed="false" '
            f'title="{text(image.name)}">{shown}<span><b>{image.frame}</b> {text(below)}</span>'
            "</button></li>"
        )
    return f'<ul class="strip" id="strip" aria-label="All images">{"".join(items)}</ul>'


def _choices(
    legend: str, kind: str, name: str, labels: Iterable[tuple[str, str, bool]], extra: str = ""
) -> str:
    """Radio buttons or check boxes in a group with a name."""
    boxes = "".join(
        f'<label><input type="{kind}" name="{name}" value="{value}"{" checked" if on else ""}> '
        f"{label}</label>"
        for value, label, on in labels
    )
    return f"<fieldset><legend>{text(legend)}</legend>{boxes}{extra}</fieldset>"


def panel() -> str:
    """The panel of one image; the script fills it and shows it."""
    fates = [
        (str(int(fate)), f'<i class="mark fate-{int(fate)}" aria-hidden="true"></i>{text(label)} '
         f'<span class="count" data-fate="{int(fate)}"></span>', True)
        for fate, label in FATE_LABELS.items()
    ]  # fmt: skip
    pictures = [(value, text(label), value == "image") for value, label in PICTURES]
    blend = (
        '<label id="wipe-label">wipe <input type="range" id="wipe" min="0" max="100" value="50">'
        '</label><button type="button" id="blink" aria-pressed="false">blink</button>'
    )
    over = [
        ("keypoints", "keypoints", True),
        ("regions", "their scale and orientation", False),
        ("residuals", f"residuals × {MAGNIFICATION}", False),
        ("tracks", "tracks", False),
    ]
    reach = (
        '<label>over ± <input type="number" id="reach" min="1" max="99" value="3"> frames</label>'
    )
    zooms = "".join(f'<option value="{z}">{z} ×</option>' for z in ZOOMS)
    return (
        '<div id="panel" class="panel" hidden>'
        '<div class="controls on-screen"><button type="button" id="before">previous</button>'
        '<button type="button" id="after">next</button><label>size '
        f'<select id="zoom">{zooms}</select></label></div>'
        '<h3 id="panel-title" aria-live="polite"></h3><p id="panel-facts"></p>'
        '<div class="controls on-screen">'
        f"{_choices('Picture', 'radio', 'picture', pictures, blend)}"
        f"{_choices('Over it', 'checkbox', 'over', over, reach)}</div>"
        f'<div class="controls">{_choices("Keypoints", "checkbox", "fate", fates)}</div>'
        '<div class="view" id="view" tabindex="0" role="group" aria-label="The image; scrolls">'
        '<div class="stack" id="stack"><img id="base" alt=""><img id="second" alt="" hidden>'
        '<canvas id="overlay" role="img"></canvas></div></div>'
        '<div class="color-bar" id="color-bar" hidden><span id="color-low"></span>'
        '<span id="colors" class="colors"></span><span id="color-high"></span></div>'
        '<p class="hint" id="panel-hint"></p></div>'
    )


def images_body(panels: Panels, images: Sequence[ImageMetrics]) -> str:
    """Strip and panel."""
    body = WITHOUT_SCRIPT + strip(panels, images) + panel()
    remarks = " ".join(panels.remarks)
    return body + (hint(remarks) if remarks else "")


def pair_viewer() -> str:
    """Two images side by side with their matches and epipolar lines; the script fills it."""
    steps = [("-1", "all that were found", False)]
    steps += [(str(k), f"after {text(step)}", False) for k, step in enumerate(MATCH_STEPS[:-1])]
    steps[-1] = (steps[-1][0], steps[-1][1] + " (verified)", True)
    labelled = [
        (value, f'{label} <span class="count" data-step="{value}"></span>', on)
        for value, label, on in steps
    ]
    sides = "".join(
        f'<div class="side" id="side-{k}" tabindex="0" role="application" '
        f'aria-label="{name} image: click, or arrow keys, set the point" '
        f'aria-describedby="pair-facts"><img alt=""></div>'
        for k, name in enumerate(("Left", "Right"))
    )
    return (
        '<div id="pair" class="pair" hidden><h3 id="pair-title">A pair of images</h3>'
        '<div class="controls on-screen"><label>left <select id="pair-0"></select></label>'
        '<label>right <select id="pair-1"></select></label>'
        '<button type="button" id="pair-before">previous pair</button>'
        '<button type="button" id="pair-after">next pair</button>'
        '<button type="button" id="next-match">next match</button></div>'
        f'<div class="controls on-screen">{_choices("Matches", "radio", "step", labelled)}'
        '<label><input type="checkbox" id="pair-lines" checked> lines</label>'
        '<label><input type="checkbox" id="pair-dropped" checked> those that the step dropped'
        "</label></div>"
        f'<div class="sides" id="sides">{sides}<canvas id="pair-overlay" role="img" '
        'aria-label="Matches and epipolar lines"></canvas></div>'
        '<p id="pair-facts" aria-live="polite"></p>'
        + hint(
            "The paper's figure 4: the matches of a pair as each filter leaves them, those that it "
            "dropped in red. Click a point in one image: what it shows lies on the line in the "
            "other, wherever in depth it is. With a point set, Tab to an image and use the arrow "
            "keys; with Shift they move it by single pixels."
        )
        + "</div>"
    )
