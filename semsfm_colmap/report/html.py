"""The report as one self-contained page: no network, no other file.

A content security policy forbids the page to load anything, so that it shows the same on a machine
behind an instrument's firewall, and in ten years.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib import resources

from semsfm_colmap.errors import MissingDependencyError
from semsfm_colmap.report.feature_study import study_body
from semsfm_colmap.report.figures import GONIOMETER_FIGURES, DrawnFigure
from semsfm_colmap.report.html_goniometer import goniometer_table
from semsfm_colmap.report.html_parts import (
    bullets,
    hint,
    image,
    remedies,
    script_json,
    section,
    text,
)
from semsfm_colmap.report.html_tables import (
    guided_table,
    images_table,
    pairs_table,
    rounds_table,
    run_tables,
    summary,
)
from semsfm_colmap.report.images.html import images_body, pair_viewer
from semsfm_colmap.report.images.panels import Panels
from semsfm_colmap.report.inputs import ReportInputs
from semsfm_colmap.report.metrics import Metrics
from semsfm_colmap.report.options import ReportOptions
from semsfm_colmap.report.verdict import judge
from semsfm_colmap.report.viewer.fit import fitting_scene
from semsfm_colmap.report.viewer.html import (
    KEYS,
    scene_element,
    viewer_block,
    viewer_scripts,
    viewer_style,
)
from semsfm_colmap.report.viewer.scene import ViewerScene

POLICY = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
    "img-src data: blob:; font-src data:; form-action 'none'; base-uri 'none'"
)
CAVEATS = (
    "A small residual does not show a right depth, and a formal σ is not an accuracy: measure "
    "something whose size you know."
)
EXPLANATION = (
    "Each frame stands for an image: the mark is its upper edge. Parallel projection fixes the "
    "direction of view and the place within the image plane; the distance and the size of the "
    "frames are arbitrary, and the rotation axis is drawn through the middle of the object. Places "
    "that are picked snap to vertices of mesh.ply."
)
SCENE_FIGURE = "scene"
PANEL_SCRIPTS = ("series", "images", "pairs")
SECTIONS = (
    ("scene-section", "Scene"), ("images", "Images"), ("pairs", "Matches"),
    ("figures", "Figures"), ("goniometer", "Goniometer"), ("rounds", "Filtering"),
    ("features", "Features"), ("guided", "Guided pass"), ("run", "Run"),
)  # fmt: skip


def _asset(name: str) -> str:
    return resources.files("semsfm_colmap.report").joinpath("assets", name).read_text("utf-8")


def _verdict(metrics: Metrics) -> str:
    verdict = judge(metrics)
    notes = verdict.not_said(metrics.notes)
    body = f"<h3>What was measured</h3>{bullets(verdict.measured)}"
    if verdict.trust:
        body += f"<h3>How far to trust it</h3>{bullets(verdict.trust)}"
    if verdict.doubts:
        listed = remedies((d.sentence, f"{d.action}.") for d in verdict.doubts)
        body += f'<div class="doubts"><h3>What to doubt, and what to do next</h3>{listed}</div>'
    else:
        nothing = "The checks of the report found nothing"
        beside = " beside what the notes from the run say" if notes else ""
        body += "<h3>What to doubt</h3>" + bullets([f"{nothing}{beside}."])
        body += f"<h3>What to do next</h3>{bullets(verdict.next)}"
    if notes:
        body += f"<h3>Notes from the run</h3>{bullets(notes)}"
    kind = "verdict doubtful" if verdict.doubts else "verdict"
    return section("Verdict", body + hint(CAVEATS), anchor="verdict", kind=kind)


def _scene(scene: ViewerScene | None, picture: DrawnFigure | None, reason: str) -> str:
    still = ""
    if picture is not None and picture.png is not None:
        still = image(picture.png, picture.caption, picture=True)
    if scene is None:
        body = hint(reason or "There is nothing to show: no points, no mesh.") + still
        return section("Scene", body, anchor="scene-section")
    body = viewer_block(mode="page", still=still) + hint(f"{KEYS} {EXPLANATION}")
    return section("Scene", body + hint(" ".join(scene.remarks)), anchor="scene-section")


def _goniometer(inputs: ReportInputs, figures: Sequence[DrawnFigure]) -> str:
    record = inputs.goniometer
    if record is None:
        body = hint(
            "Not measured; semsfm goniometer relates the rotation to the actuator's reading."
        )
        return section("Goniometer", body, anchor="goniometer")
    body = goniometer_table(record)
    body += bullets(record.notes) if record.notes else ""
    return section("Goniometer", body + _drawn(figures), anchor="goniometer")


IMAGES_HINT = (
    "Angles are about the fitted axis, relative to the first registered image; scale is relative "
    "to the median; σ is formal."
)


def _images(metrics: Metrics, panels: Panels | None) -> str:
    """The images with their panels, and the table of their numbers."""
    body = images_table(metrics) + hint(IMAGES_HINT)
    if panels is None:
        return section("Images", body, anchor="images")
    table = f"<h3>Table of the images</h3>{body}"
    return section("Images", images_body(panels, metrics.per_image) + table, anchor="images")


def _matches(metrics: Metrics, panels: Panels | None, max_rows: int) -> str:
    """The numbers of the pairs, and their matches over the images."""
    body = pairs_table(metrics, max_rows)
    if panels is not None and len(panels.thumbnails) > 1:
        body += pair_viewer()
    return section("Matches", body, anchor="pairs")


def _panel_scripts(panels: Panels | None) -> str:
    if panels is None:
        return ""
    scripts = "".join(f"<script>{_asset(f'{name}.js')}</script>" for name in PANEL_SCRIPTS)
    return script_json(panels.data, element_id="series-data") + scripts


def _figures(figures: Sequence[DrawnFigure]) -> str:
    return section("Figures", _drawn(figures), anchor="figures")


def _drawn(figures: Sequence[DrawnFigure]) -> str:
    """The figures side by side, and why some are not there."""
    drawn = "".join(
        image(f.png, f.caption, picture=f.picture) for f in figures if f.png is not None
    )
    absent = [f"Not drawn: {f.name.replace('_', ' ')}, {f.reason}." for f in figures if not f.png]
    return f'<div class="figures">{drawn}</div>' + "".join(hint(line) for line in absent)


def render_page(
    inputs: ReportInputs,
    metrics: Metrics,
    figures: Sequence[DrawnFigure],
    options: ReportOptions | None = None,
    panels: Panels | None = None,
) -> str:
    """The whole page as text.

    Parameters
    ----------
    panels : the images of the series, where they are at hand

    """
    options = options or ReportOptions()

    def page(scene: ViewerScene | None, reason: str = "") -> str:
        return _page(inputs, metrics, figures, options, panels, scene, reason)

    around = page(None)
    try:
        scripts = viewer_scripts()
    except MissingDependencyError as error:
        return page(None, f"{error}.")
    room = int(1e6 * options.max_page_mb) - len((around + scripts + viewer_style()).encode())
    scene = fitting_scene(inputs, options, room)
    if scene is None:
        return around
    return page(scene).replace("</main>", f"</main>{scene_element(scene)}{scripts}", 1)


def _page(
    inputs: ReportInputs,
    metrics: Metrics,
    figures: Sequence[DrawnFigure],
    options: ReportOptions,
    panels: Panels | None,
    scene: ViewerScene | None,
    reason: str,
) -> str:
    """The page without the scene's data and scripts."""
    by_name = {figure.name: figure for figure in figures}
    shown_elsewhere = {SCENE_FIGURE, *(kind.name for kind in GONIOMETER_FIGURES)}
    links = "".join(f'<a href="#{anchor}">{text(title)}</a>' for anchor, title in SECTIONS)
    body = (
        f'<h1>{text(inputs.title)}</h1><nav aria-label="Parts of the page">{links}</nav>'
        + _verdict(metrics)
        + section("Summary", summary(metrics), anchor="summary")
        + _scene(scene, by_name.get(SCENE_FIGURE), reason)
        + _images(metrics, panels)
        + _matches(metrics, panels, options.max_pair_rows)
        + _figures([figure for figure in figures if figure.name not in shown_elsewhere])
        + _goniometer(
            inputs, [by_name[kind.name] for kind in GONIOMETER_FIGURES if kind.name in by_name]
        )
        + section("Filtering by reprojection error", rounds_table(metrics), anchor="rounds")
        + section("Detectors and descriptors", study_body(inputs.feature_study), anchor="features")
        + section("Guided second pass", guided_table(metrics), anchor="guided")
        + section("Run", run_tables(metrics), anchor="run")
    )
    style = _asset("report.css")
    style += "" if panels is None else _asset("images.css")
    style += "" if scene is None else viewer_style()
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta http-equiv="Content-Security-Policy" content="{text(POLICY)}">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{text(inputs.title)}</title><style>{style}</style></head>\n"
        '<body><a class="skip" href="#content">Skip to the content</a>'
        f'<main id="content">{body}</main>{_panel_scripts(panels)}</body></html>\n'
    )
