"""Error over stated standard deviation of everything that a model states one for."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from semsfm_colmap.colmap.model.sparse import read_model
from semsfm_colmap.evaluation.distance import Surface
from semsfm_colmap.evaluation.truth import load_truth
from semsfm_colmap.geometry.alignment import (
    align_cameras_both_hands,
    align_rotations,
    depth_reversed_cameras,
)
from semsfm_colmap.geometry.normals import estimate_normals, mean_viewing_direction
from semsfm_colmap.geometry.rotations import MIRROR_Z, rotation_angle, vector_from_rotation
from semsfm_colmap.refinement.model_choice import widest_pair
from semsfm_colmap.types import Float

NUM_POINTS = 2000
"""Points judged of each series, as many pairs for distances."""


def measure(model_path: Path, truth_path: Path) -> dict[str, Any]:
    """Errors, sigmas and pulls of a model against the truth of its series.

    The pull of a point is its distance to the true surface over its standard deviation along its
    normal; that of a distance between two points, the change that these make to it.
    """
    model = read_model(model_path)
    said = json.loads((model_path / "orthographic.json").read_text())["reliability"]
    truth = load_truth(truth_path)
    number = {Path(name).stem: i for i, name in enumerate(truth.names)}
    true = truth.cameras.select(np.array([number[Path(n).stem] for n in model.image_names]))
    hands = align_cameras_both_hands(model.cameras, true)
    k = int(np.argmin([hand.rotation_rms_rad for hand in hands]))
    mine = depth_reversed_cameras(model.cameras) if k else model.cameras
    R, T = np.asarray(mine.cam_from_world), np.asarray(true.cam_from_world)
    error = vector_from_rotation(R @ align_rotations(R, T) @ np.swapaxes(T, 1, 2))
    error = error @ MIRROR_Z if k else error  # only squares are used
    a, b = widest_pair(R)
    # the angle about the same axis, which passes 180 degrees where an angle would turn back
    seen, meant = R[b] @ R[a].T, T[b] @ T[a].T
    axis = vector_from_rotation(meant)
    axis = axis / np.linalg.norm(axis)
    total_error = float(vector_from_rotation(seen @ meant.T) @ axis)
    sigma = said["total_rotation_sigma_deg"]
    assert model.sigma_rotation_rad is not None
    points = point_pulls(model, hands[k].true_from_estimated, truth)
    return {
        "num_images": len(R),
        "num_images_truth": len(truth.names),
        "total_deg": float(np.rad2deg(rotation_angle(meant))),
        "total_error_deg": float(np.rad2deg(total_error)),
        "total_sigma_deg": sigma,
        "parts_deg": said.get("total_rotation_sigma_parts_deg", {}),
        "drag": said.get("drag", {}),
        "total_pull": float(np.rad2deg(total_error)) / sigma,
        "rotation_error_median_deg": float(np.rad2deg(np.median(hands[k].rotation_error_rad))),
        "step_ratio": float(np.sum(steps(R)) / np.sum(steps(T))),
        "hand_right": k == 0,
        "hand_confidence": model.depth_sign.confidence,
        "rotation_pulls": (error / model.sigma_rotation_rad).ravel().tolist(),
        **points,
    }


def steps(cam_from_world: Float) -> Float:
    """Angles from each image to the next, rad."""
    R = cam_from_world
    return rotation_angle(R[1:] @ R[:-1].transpose(0, 2, 1))


def point_pulls(model: Any, to_truth: Any, truth: Any) -> dict[str, Any]:
    """Pulls of points and of distances between them."""
    rng = np.random.default_rng(0)
    if truth.mesh is None or model.point_covariance is None:
        return {"point_pulls": [], "distance_pulls": [], "signed_median_px": None}
    surface = Surface(truth.mesh)
    surface.orient(truth.cameras, truth.image_size_px)
    X = np.asarray(model.points)
    normals = estimate_normals(X, mean_viewing_direction(model), 30)
    some = rng.permutation(len(X))[:NUM_POINTS]
    # in the model's unit
    signed = surface.signed_distance(to_truth.apply(X[some])) / to_truth.scale
    n, C = normals[some], np.asarray(model.point_covariance)[some]
    sigma = np.sqrt(np.einsum("ni,nij,nj->n", n, C, n))
    other = rng.permutation(len(some))
    away = X[some] - X[some][other]
    length = np.linalg.norm(away, axis=1)
    far = length > np.median(length) / 4
    u = away / np.maximum(length, 1e-300)[:, None]
    error = signed * np.einsum("ni,ni->n", n, u) - signed[other] * np.einsum(
        "ni,ni->n", n[other], u
    )
    spread = np.sqrt(np.einsum("ni,nij,nj->n", u, C + C[other], u))
    px = truth.scale_px_per_unit * to_truth.scale
    return {
        "point_pulls": (signed / sigma).tolist(),
        "distance_pulls": (error[far] / spread[far]).tolist(),
        "signed_median_px": float(px * np.median(signed)),
        "signed_spread_px": float(px * 1.4826 * np.median(np.abs(signed - np.median(signed)))),
        "point_sigma_px": float(px * np.median(sigma)),
    }


def rms(pulls: list[float] | Float) -> float:
    """Root mean square of pulls; one beyond ten counts as ten, so that a stray is no verdict."""
    clipped = np.clip(np.asarray(pulls, dtype=np.float64), -10.0, 10.0)
    return float(np.sqrt(np.mean(clipped**2))) if len(clipped) else float("nan")


def coverage(pulls: list[float] | Float) -> float:
    """Share of pulls within a 95 % interval."""
    return float(np.mean(np.abs(pulls) < 1.96)) if len(pulls) else float("nan")
