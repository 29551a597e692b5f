"""What a person can choose about the report."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class ReportOptions:
    """How much of the model goes into the page; the numbers always use all of it."""

    max_scene_points: int = 25_000
    """Points drawn in the interactive scene (of the sparse points, and again of the cloud)."""
    max_scene_faces: int = 30_000
    """Faces of the mesh drawn in the interactive scene."""
    max_pair_rows: int = 200
    """Rows of the table of rejected pairs; metrics.json counts all of them."""
    figure_dpi: int = 150
    """Resolution of the PNG figures."""
