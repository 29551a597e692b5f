"""Mapped projects: what the cues say, and whether it is right where there is a truth."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.depth_sign.calibration import MIN_CONFIDENCE
from benchmarks.depth_sign.scenes import error_of
from semsfm_colmap.colmap.model.sparse import read_model
from semsfm_colmap.evaluation.truth import load_truth
from semsfm_colmap.geometry.alignment import align_cameras
from semsfm_colmap.refinement.depth_reversal import (
    decide_depth_sign,
    reverse_depth,
    visibility_cues,
)


def project_row(text: str) -> list[str | int]:
    """One mapped project, FOLDER[:TRUTH], as a row of the table."""
    folder, _, truth_folder = text.partition(":")
    model = read_model(Path(folder) / "sparse" / "0")
    cameras, points = model.cameras, np.asarray(model.points)
    hand = "not known"
    reversed_ = False
    if truth_folder:
        truth = load_truth(Path(truth_folder))
        number = {Path(name).stem: k for k, name in enumerate(truth.names)}
        true = truth.cameras.select(
            np.array([number[Path(name).stem] for name in model.image_names])
        )
        reversed_ = error_of(align_cameras(cameras, true, reverse_depth=True)) < error_of(
            align_cameras(cameras, true)
        )
    cues = visibility_cues(
        cameras, points, model.observations.select(model.inlier), model.image_size_px
    )
    sign, reverse = decide_depth_sign(cues, MIN_CONFIDENCE)
    if truth_folder:
        hand = "right" if reverse == reversed_ else "wrong"
    twin = reverse_depth(cameras, points)
    other = visibility_cues(*twin, model.observations.select(model.inlier), model.image_size_px)
    assert all(np.isclose(other[k].t, -cues[k].t, atol=1e-6) for k in cues)
    flip = -1.0 if reverse else 1.0
    return [
        Path(folder).name,
        model.num_images,
        len(points),
        *(f"{flip * cue.t:.1f}" for cue in cues.values()),
        sign.status,
        f"{sign.confidence:.4f}",
        hand,
    ]
