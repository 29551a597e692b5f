"""The figures that tell a reconstruction from the truth."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from semsfm_colmap.errors import InputError
from semsfm_colmap.evaluation.distance import Surface
from semsfm_colmap.evaluation.truth import Truth
from semsfm_colmap.geometry.alignment import (
    CameraAlignment,
    align_cameras_both_hands,
    depth_reversed_cameras,
)
from semsfm_colmap.geometry.rotations import rotation_angle
from semsfm_colmap.types import Float, OrthographicCameras, Reconstruction, TriangleMesh

HAND_MARGIN = 1.1
"""One hand must align worse than the other by this factor for the comparison to decide."""
COMPLETENESS_PX = 2.0
"""Distance within which a part of the true surface counts as reconstructed."""
NUM_SURFACE_SAMPLES = 20_000
"""Points on the true surface that completeness is judged on: 0.3 % statistical error."""


def evaluate(
    reconstruction: Reconstruction,
    truth: Truth,
    mesh: TriangleMesh | None = None,
    *,
    crop_offset_px: tuple[float, float] = (0.0, 0.0),
) -> dict[str, Any]:
    """Compare a reconstruction, and a mesh made from it, with the truth.

    The cameras alone fix the common world (`align_cameras`); nothing is fitted to the surface. Both
    hands are aligned; the figures are those of the one that fits better, and for either hand the
    rotation and structure errors are given beside.

    Parameters
    ----------
    reconstruction : to judge; images are matched with the truth by name without extension
    truth : of the series
    mesh : in the world of the reconstruction
    crop_offset_px : (x0, y0) of the prepared images in the image area of the truth

    Returns
    -------
    JSON-able figures, units in the names; None where a figure has no meaning for the data.
    Signed distances are positive outside of the true surface.

    Raises
    ------
    InputError
        When no image of the reconstruction belongs to the truth.

    Examples
    --------
    A model that is the truth, with 20 points of its surface:

    >>> from semsfm_colmap.evaluation.truth import load_truth
    >>> from semsfm_colmap.types import Observations
    >>> truth = load_truth(Path("field"))  # what `synthesize` wrote: three images
    >>> points = truth.mesh.vertices[:20]
    >>> track_idx, image_idx = np.divmod(np.arange(60), 3)
    >>> observations = Observations(
    ...     track_idx=track_idx,
    ...     image_idx=image_idx,
    ...     keypoint_idx=track_idx,
    ...     xy=truth.cameras.project(points[track_idx], image_idx),
    ...     num_images=3,
    ...     num_tracks=20,
    ... )
    >>> model = Reconstruction(
    ...     image_names=truth.names,
    ...     image_size_px=np.full((3, 2), 64),
    ...     cameras=truth.cameras,
    ...     points=points,
    ...     observations=observations,
    ...     inlier=np.ones(60, dtype=bool),
    ... )
    >>> figures = evaluate(model, truth)
    >>> figures["num_images_registered"], round(figures["rotation_error_median_deg"], 4)
    (3, 0.0)

    """
    est_idx, true_idx = _common_images(reconstruction.image_names, truth)
    estimated = reconstruction.cameras.select(est_idx)
    shifted = replace(
        truth.cameras, translation_px=truth.cameras.translation_px - np.asarray(crop_offset_px)
    )
    true = shifted.select(true_idx)
    hands = align_cameras_both_hands(estimated, true)
    used = reconstruction.track_length() >= 2
    points = reconstruction.points[used & np.all(np.isfinite(reconstruction.points), axis=1)]
    surface = None
    if truth.mesh is not None:
        surface = Surface(truth.mesh)
        surface.orient(truth.cameras, truth.image_size_px)
    px = truth.scale_px_per_unit
    distances = [
        None if surface is None else px * surface.signed_distance(_to_truth(hand, points))
        for hand in hands
    ]
    hand, best = _choose_hand(hands, distances)
    alignment = hands[best]
    result: dict[str, Any] = {
        "num_images_truth": len(truth.names),
        "num_images_registered": len(est_idx),
        "hand": hand,
        **_depth_sign(reconstruction, hand),
        **_rotations(estimated, true, hands, best),
        **_scales(reconstruction, truth, alignment, true),
        **_residuals(reconstruction),
        "num_points": len(points),
        **_structure(distances, best, truth),
    }
    if mesh is not None and surface is not None:
        result |= _mesh_figures(mesh, surface, alignment, truth)
    names = [truth.names[i] for i in true_idx]
    errors = np.degrees(alignment.rotation_error_rad).tolist()
    result["rotation_error_by_image_deg"] = dict(zip(names, errors, strict=True))
    return result


def _common_images(names: tuple[str, ...], truth: Truth) -> tuple[Any, Any]:
    """Indices of the images that both know, in the order of the truth."""
    by_stem = {Path(name).stem: i for i, name in enumerate(names)}
    pairs = [
        (by_stem[Path(name).stem], i)
        for i, name in enumerate(truth.names)
        if Path(name).stem in by_stem
    ]
    if not pairs:
        first = names[0] if names else "none at all"
        raise InputError(
            f"No image of the reconstruction (first: {first}) is in {truth.path} (first:"
            f" {truth.names[0]}): evaluate against the truth of the same series."
        )
    est_idx, true_idx = np.array(pairs).T
    return est_idx, true_idx


def _to_truth(alignment: CameraAlignment, points: Float) -> Float:
    return alignment.true_from_estimated.apply(points)


def _choose_hand(
    hands: tuple[CameraAlignment, CameraAlignment], distances: list[Float | None]
) -> tuple[str, int]:
    """Name of the hand and its index, by the rotations, else by the distances to the surface."""
    scores = [tuple(hand.rotation_rms_rad for hand in hands)]
    if distances[0] is not None and distances[1] is not None and distances[0].size:
        scores.append(tuple(float(np.median(np.abs(d))) for d in distances if d is not None))
    for given, reverse in scores:
        # Below a nanoradian (or 1e-9 px) both fit exactly and nothing is decided.
        if max(given, reverse) > 1e-9 and given * HAND_MARGIN < reverse:
            return "right", 0
        if max(given, reverse) > 1e-9 and reverse * HAND_MARGIN < given:
            return "depth-reversed", 1
    return "undetermined", 0


def _depth_sign(reconstruction: Reconstruction, hand: str) -> dict[str, Any]:
    sign = reconstruction.depth_sign
    stated = sign.status == "resolved" and hand != "undetermined"
    return {
        "depth_sign_status": sign.status,
        "depth_sign_confidence": float(sign.confidence),
        "depth_sign_correct": (hand == "right") if stated else None,
    }


def _rotations(
    estimated: OrthographicCameras,
    true: OrthographicCameras,
    hands: tuple[CameraAlignment, CameraAlignment],
    best: int,
) -> dict[str, Any]:
    """Errors of the aligned rotations, and of the turn itself, which needs no alignment."""
    out: dict[str, Any] = {}
    for suffix, k in (("", best), ("_as_given", 0), ("_depth_reversed", 1)):
        error = np.degrees(hands[k].rotation_error_rad)
        out[f"rotation_error_median{suffix}_deg"] = float(np.median(error))
        out[f"rotation_error_max{suffix}_deg"] = float(error.max())
    out["rotation_error_rms_deg"] = float(np.degrees(hands[best].rotation_rms_rad))
    mine = depth_reversed_cameras(estimated) if best == 1 else estimated
    R, S = mine.cam_from_world, true.cam_from_world
    first_to_last = (R[-1] @ R[0].T) @ (S[-1] @ S[0].T).T
    out["first_to_last_rotation_error_deg"] = float(np.degrees(rotation_angle(first_to_last)))
    turned = float(np.degrees(rotation_angle(R[1:] @ np.swapaxes(R[:-1], 1, 2)).sum()))
    meant = float(np.degrees(rotation_angle(S[1:] @ np.swapaxes(S[:-1], 1, 2)).sum()))
    out["rotation_sum_estimated_deg"] = turned
    out["rotation_sum_true_deg"] = meant
    out["rotation_sum_ratio"] = turned / meant if meant > 0 else None
    translation = hands[best].translation_error_px
    out["translation_error_rms_px"] = float(np.sqrt(np.mean(translation**2)))
    return out


def _scales(
    reconstruction: Reconstruction,
    truth: Truth,
    alignment: CameraAlignment,
    true: OrthographicCameras,
) -> dict[str, Any]:
    """Error of lengths in um (None while the world is in px) and of the magnifications."""
    error = None
    if reconstruction.world_unit == "um":
        error = 100.0 * (1.0 / (alignment.true_from_estimated.scale * truth.unit_um) - 1.0)
    log_ratio = np.log(alignment.scale_ratio)
    return {
        "world_unit": reconstruction.world_unit,
        "pixel_size_true_um": truth.unit_um / float(true.scale_px_per_unit.mean()),
        "pixel_size_um": reconstruction.pixel_size_um,
        "scale_error_percent": error,
        "relative_magnification_error_rms_percent": float(100.0 * np.sqrt(np.mean(log_ratio**2))),
        "aspect_error_percent": 100.0 * (reconstruction.cameras.aspect / true.aspect - 1.0),
        "skew_error": reconstruction.cameras.skew - true.skew,
    }


def _residuals(reconstruction: Reconstruction) -> dict[str, Any]:
    residual = reconstruction.residuals()[reconstruction.inlier]
    num_tracks = int(np.count_nonzero(reconstruction.track_length()))
    out: dict[str, Any] = {
        "num_observations": len(residual),
        "mean_track_length": len(residual) / num_tracks if num_tracks else None,
    }
    square = np.mean(residual**2, axis=0) if len(residual) else None
    out["residual_rms_px"] = None if square is None else float(np.sqrt(square.mean()))
    for k, axis in enumerate("xy"):
        out[f"residual_rms_{axis}_px"] = None if square is None else float(np.sqrt(square[k]))
    return out


def _distances(prefix: str, signed_px: Float, pixel_size_um: float) -> dict[str, Any]:
    """Median signed, median absolute, the same without the median, and the tail."""
    names = ("signed_median", "abs_median", "abs_median_unbiased", "abs_p95")
    if not signed_px.size:
        return {f"{prefix}_{name}_{unit}": None for name in names for unit in ("px", "um")}
    bias = np.median(signed_px)
    values = (
        bias,
        np.median(np.abs(signed_px)),
        np.median(np.abs(signed_px - bias)),
        np.percentile(np.abs(signed_px), 95),
    )
    out = {f"{prefix}_{n}_px": float(v) for n, v in zip(names, values, strict=True)}
    return out | {
        f"{prefix}_{n}_um": float(v) * pixel_size_um for n, v in zip(names, values, strict=True)
    }


def _structure(distances: list[Float | None], best: int, truth: Truth) -> dict[str, Any]:
    """Distances of the points to the true surface, for the chosen hand and for both."""
    chosen = distances[best]
    if chosen is None:
        return {}
    out = _distances("structure", chosen, truth.pixel_size_um)
    for suffix, d in zip(("as_given", "depth_reversed"), distances, strict=True):
        value = None if d is None or not d.size else float(np.median(np.abs(d)))
        out[f"structure_abs_median_{suffix}_px"] = value
    return out


def _mesh_figures(
    mesh: TriangleMesh, surface: Surface, alignment: CameraAlignment, truth: Truth
) -> dict[str, Any]:
    """Accuracy (mesh to truth) and completeness (truth to mesh, where any camera sees it)."""
    px = truth.scale_px_per_unit
    vertices = _to_truth(alignment, mesh.vertices)
    out: dict[str, Any] = {
        "mesh_num_vertices": len(mesh.vertices),
        "mesh_num_faces": len(mesh.faces),
        **_distances("mesh_to_truth", px * surface.signed_distance(vertices), truth.pixel_size_um),
    }
    samples = surface.visible_samples(truth.cameras, truth.image_size_px, NUM_SURFACE_SAMPLES)
    if not len(mesh.faces) or not len(samples):
        return out | {"truth_to_mesh_median_px": None, "truth_to_mesh_within_2px_percent": 0.0}
    away = px * Surface(TriangleMesh(vertices=vertices, faces=mesh.faces)).distance(samples)
    return out | {
        "truth_to_mesh_median_px": float(np.median(away)),
        "truth_to_mesh_within_2px_percent": float(100.0 * np.mean(away <= COMPLETENESS_PX)),
    }
