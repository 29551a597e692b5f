"""The figures of an evaluation as text."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from semsfm_colmap.types import MOST_TOLD_CONFIDENCE

Row = tuple[str, str, str]
"""label, key, format"""

SECTIONS: tuple[tuple[str, tuple[Row, ...]], ...] = (
    (
        "cameras",
        (
            ("rotation error, median", "rotation_error_median_deg", "{:.3f} deg"),
            ("rotation error, largest", "rotation_error_max_deg", "{:.3f} deg"),
            ("  as given, median", "rotation_error_median_as_given_deg", "{:.3f} deg"),
            ("  depth-reversed, median", "rotation_error_median_depth_reversed_deg", "{:.3f} deg"),
            ("first to last image", "first_to_last_rotation_error_deg", "{:.3f} deg"),
            ("sum of rotations, estimated", "rotation_sum_estimated_deg", "{:.2f} deg"),
            ("sum of rotations, true", "rotation_sum_true_deg", "{:.2f} deg"),
            ("  ratio", "rotation_sum_ratio", "{:.5f}"),
            ("translation error, RMS", "translation_error_rms_px", "{:.2f} px"),
            ("scale error", "scale_error_percent", "{:+.3f} %"),
            ("magnification error, RMS", "relative_magnification_error_rms_percent", "{:.3f} %"),
        ),
    ),
    (
        "points",
        (
            ("points in two images or more", "num_points", "{:d}"),
            ("observations", "num_observations", "{:d}"),
            ("mean track length", "mean_track_length", "{:.2f}"),
            ("residual per coordinate, RMS", "residual_rms_px", "{:.3f} px"),
            ("off the surface, median", "structure_signed_median_px", "{:+.3f} px"),
            ("distance, median", "structure_abs_median_px", "{:.3f} px"),
            ("  without the median offset", "structure_abs_median_unbiased_px", "{:.3f} px"),
            ("  95th percentile", "structure_abs_p95_px", "{:.2f} px"),
            ("  as given, median", "structure_abs_median_as_given_px", "{:.3f} px"),
            ("  depth-reversed, median", "structure_abs_median_depth_reversed_px", "{:.3f} px"),
            ("distance, median", "structure_abs_median_um", "{:.4f} um"),
        ),
    ),
    (
        "mesh",
        (
            ("vertices", "mesh_num_vertices", "{:d}"),
            ("off the surface, median", "mesh_to_truth_signed_median_px", "{:+.3f} px"),
            ("distance, median", "mesh_to_truth_abs_median_px", "{:.3f} px"),
            ("  without the median offset", "mesh_to_truth_abs_median_unbiased_px", "{:.3f} px"),
            ("  95th percentile", "mesh_to_truth_abs_p95_px", "{:.2f} px"),
            ("true surface to mesh, median", "truth_to_mesh_median_px", "{:.3f} px"),
            ("true surface within 2 px", "truth_to_mesh_within_2px_percent", "{:.1f} %"),
        ),
    ),
)

HANDS = {
    "right": "the right one",
    "depth-reversed": "DEPTH-REVERSED; the figures below are of its mirror image",
    "undetermined": "cannot be told from these images",
}


def format_evaluation(figures: Mapping[str, Any]) -> str:
    """The figures of `evaluate` as a table for a terminal; what was not computed is left out."""
    lines = [
        f"images   {figures['num_images_registered']} of {figures['num_images_truth']}",
        f"hand     {HANDS[figures['hand']]} ({_stated(figures)})",
    ]
    for title, rows in SECTIONS:
        shown = [
            (label, form.format(figures[key]))
            for label, key, form in rows
            if figures.get(key) is not None
        ]
        if shown:
            lines += ["", title]
            lines += [f"  {label:<32}{_aligned(value)}" for label, value in shown]
    return "\n".join(lines) + "\n"


def _stated(figures: Mapping[str, Any]) -> str:
    """What the reconstruction itself said of its hand."""
    if figures["depth_sign_status"] != "resolved":
        return "the reconstruction leaves it open"
    confidence = figures["depth_sign_confidence"]
    told = "above 99%" if confidence > MOST_TOLD_CONFIDENCE else f"{confidence:.0%}"
    return f"the reconstruction is {told} sure of its own"


def _aligned(value: str) -> str:
    """Numbers right-aligned, units after them."""
    number, _, unit = value.partition(" ")
    return f"{number:>12} {unit}".rstrip()
