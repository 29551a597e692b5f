"""A scene that fits into a page of limited size: fewer points and faces, smaller images."""

from __future__ import annotations

from semsfm_colmap.report.inputs import ReportInputs
from semsfm_colmap.report.options import ReportOptions
from semsfm_colmap.report.viewer.packing import as_text
from semsfm_colmap.report.viewer.scene import ViewerScene, build_scene, fewer

PICTURES_SHARE = 0.25
"""Of the room, for the images of the series."""
BASE64 = 4.0 / 3.0
MARGIN = 0.9
"""What is thinned is thinned to this share of what would just fit."""
MAX_ATTEMPTS = 4


def fitting_scene(inputs: ReportInputs, options: ReportOptions, room: int) -> ViewerScene | None:
    """The scene in at most `room` bytes of text; None when there is nothing to show, or no room."""
    pictures = int(PICTURES_SHARE * max(room, 0) / BASE64)
    for _ in range(MAX_ATTEMPTS):
        scene = build_scene(inputs, options, max_picture_bytes=pictures)
        if scene is None:
            return None
        size = len(as_text(scene.packed))
        if size <= room:
            return scene
        pictures = int(pictures * MARGIN * room / size)
        options = fewer(options, max(MARGIN * room / size, 0.1))
        if room <= 0:
            break
    return None
