"""What a person can choose about the report."""

from __future__ import annotations

from dataclasses import dataclass

from semsfm_colmap.bounds import Checked, Count, CountOrNone, Positive


@dataclass(frozen=True, kw_only=True)
class ReportOptions(Checked):
    """How much of the model goes into the page; the numbers always use all of it."""

    max_scene_points: CountOrNone = 60_000
    """Points drawn in the 3-D viewer (of the sparse points, and again of the cloud)."""
    max_scene_faces: CountOrNone = 120_000
    """Faces of the mesh drawn in the 3-D viewer; a mesh with more is thinned and loses its
    texture."""
    max_page_mb: Positive = 15.0
    """Size of the page in 10^6 bytes: the scene is thinned until it fits."""
    max_pair_rows: CountOrNone = 200
    """Rows of the table of rejected pairs; metrics.json counts all of them."""
    figure_dpi: Count = 150
    """Resolution of the PNG figures."""
