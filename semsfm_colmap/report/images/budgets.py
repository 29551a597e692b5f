"""How much of a series goes into the page; what is left out is said there, and nothing counts less.

The bytes are those before base64, which adds a third. Together some 5 MB of page for any number of
images; the viewer of the model has the rest of the 15 MB.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Budgets:
    """Limits over all images together, and those of one."""

    picture_bytes: int = 2_300_000
    """The images themselves, in their panels"""
    thumbnail_bytes: int = 350_000
    mesh_bytes: int = 450_000
    """Views of the mesh"""
    mesh_pixels: int = 4_000_000
    """Each is a ray, and rays take time: half a second a million"""
    map_bytes: int = 600_000
    """Depth maps and sigma maps"""
    max_map_width_px: int = 480
    num_keypoints: int = 100_000
    max_keypoints: int = 5_000
    num_residuals: int = 36_000
    max_residuals: int = 500
    """More arrows in one image would hide one another."""
    num_trajectory_places: int = 36_000
    num_matches: int = 42_000
    max_matches: int = 300
