"""From observations to Euclidean cameras: blocks -> CBC -> robust polish -> upgrade.

A long series goes through this in overlapping segments, which are then joined (`segments`).
"""

from __future__ import annotations

import numpy as np

from semsfm_colmap.factorization.blocks import Block, Part, connected_parts, select_blocks
from semsfm_colmap.factorization.cbc import factorize_cbc
from semsfm_colmap.factorization.options import FactorizationOptions
from semsfm_colmap.factorization.polish import polish_affine
from semsfm_colmap.factorization.segments import Segment, cut_into_segments, join_segments
from semsfm_colmap.factorization.upgrade import upgrade_to_euclidean
from semsfm_colmap.geometry.eliminated import SolverOptions
from semsfm_colmap.geometry.points import residuals, solve_points, track_pointer
from semsfm_colmap.geometry.subset import keep_tracks, thin_evenly
from semsfm_colmap.geometry.triangulation import triangulate_tracks
from semsfm_colmap.types import (
    AffineModel,
    Float,
    Observations,
    OrthographicCameras,
    Solution,
)

POLISH_OBSERVATIONS = 400
"""Observations an image that the polish is content with: it is a start for the bundle adjustment,
which uses all."""
SEGMENT_OBSERVATIONS = 1200
"""Observations an image that segments choose from: they lose tracks at their ends, and filter."""
MIN_IMAGES = 3
"""Fewer do not give depth."""
AFFINE_THRESHOLD_PX = 8.0
"""Reprojection error up to which observations take part in the polish: the paper's first round."""


def robust_sigma(r: Float) -> float:
    """Standard deviation of residuals from their median absolute deviation."""
    return float(1.4826 * np.median(np.abs(r - np.median(r)))) if r.size else 0.0


def factorize(
    part: Part,
    observations: Observations,
    options: FactorizationOptions,
    rng: np.random.Generator,
) -> Solution[tuple[OrthographicCameras, Float]]:
    """Orthographic cameras of one connected part.

    Parameters
    ----------
    part : images i and blocks, numbered as in `observations`
    observations : sorted by track

    Returns
    -------
    Solution of (cameras of ``part.images`` in that order, points of the tracks that the polish
    used); diagnostics of each step

    """
    number = np.full(observations.num_images, -1, dtype=np.int64)
    number[part.images] = np.arange(len(part.images))
    blocks = [Block(images=number[b.images], tracks=b.tracks, M=b.M) for b in part.blocks]
    segments = cut_into_segments(blocks, len(part.images))
    if segments:
        local, _ = keep_tracks(
            observations, number[observations.image_idx] >= 0, min_length=3, image_number=number
        )
        chosen = thin_evenly(local, SEGMENT_OBSERVATIONS)
        local, _ = keep_tracks(local, chosen[local.track_idx])
        joined = factorize_segments(segments, local, options, rng)
        if joined.value is not None:
            return joined
    return factorize_whole(part, observations, options, rng)


def factorize_most(
    part: Part,
    observations: Observations,
    options: FactorizationOptions,
    rng: np.random.Generator,
) -> tuple[Part, Solution[tuple[OrthographicCameras, Float]]]:
    """`factorize`, without the images that hang on blocks which prove wrong.

    Blocks tie a part together; one whose tracks do not agree on a motion is dropped, and the part
    may fall apart by it. Then the images that are still tied are factorized: the others have tracks
    in common with them, and are registered by these.

    Returns
    -------
    What was factorized, the part itself as a rule, and its `factorize`

    """
    found = factorize(part, observations, options, rng)
    tied = np.asarray(found.diagnostics.get("tied_images", []), dtype=np.int64)
    if found.value is not None or not MIN_IMAGES <= len(tied) < len(part.images):
        return part, found
    images = part.images[tied]
    blocks = [block for block in part.blocks if np.isin(block.images, images).all()]
    return factorize_most(Part(images=images, blocks=blocks), observations, options, rng)


def factorize_segments(
    segments: list[Part],
    observations: Observations,
    options: FactorizationOptions,
    rng: np.random.Generator,
) -> Solution[tuple[OrthographicCameras, Float]]:
    """Segments one by one, then joined; without a value when they leave out images."""
    fits = [factorize_whole(segment, observations, options, rng) for segment in segments]
    done = [
        (Segment(images=segment.images, cameras=fit.value[0], points=fit.value[1]), fit)
        for segment, fit in zip(segments, fits, strict=True)
        if fit.value is not None
    ]
    found = np.concatenate([s.images for s, _ in done]) if done else np.zeros(0)
    joined = None
    if len(np.unique(found)) == observations.num_images:
        joined = join_segments([s for s, _ in done], observations.num_images)
    figures = {
        key: [fit.diagnostics[key] for _, fit in done]
        for key in ("eigenvalue_gap", "cbc_rms_px", "affine_rms_px", "affine_sigma_px")
    }
    return Solution(
        value=joined,
        status="ok" if joined else "segments_apart",
        message="" if joined else "the segments of the series leave out images or fall apart",
        iterations=sum(fit.iterations for _, fit in done),
        diagnostics={
            "num_segments": len(done),
            **{key: float(np.sqrt(np.mean(np.square(v)))) for key, v in figures.items() if v},
            # the weakest link
            "eigenvalue_gap": min(figures["eigenvalue_gap"], default=0.0),
        },
    )


def factorize_whole(
    part: Part,
    observations: Observations,
    options: FactorizationOptions,
    rng: np.random.Generator,
) -> Solution[tuple[OrthographicCameras, Float]]:
    """Orthographic cameras of one part at once; see `factorize`."""
    number = np.full(observations.num_images, -1, dtype=np.int64)
    number[part.images] = np.arange(len(part.images))
    blocks = [Block(images=number[b.images], tracks=b.tracks, M=b.M) for b in part.blocks]
    start = factorize_cbc(blocks, len(part.images), options, rng)
    if start.value is None:
        return Solution(
            value=None, status=start.status, message=start.message, diagnostics=start.diagnostics
        )
    local, _ = keep_tracks(
        observations, number[observations.image_idx] >= 0, min_length=2, image_number=number
    )
    A, t = start.value.A, start.value.t
    pointer = track_pointer(local.track_idx, local.num_tracks)
    X, inlier = triangulate_tracks(
        A, t, local.image_idx, pointer, local.xy, threshold_px=AFFINE_THRESHOLD_PX, trials=15
    )
    local, kept = keep_tracks(local, inlier, min_length=3)
    chosen = thin_evenly(local, POLISH_OBSERVATIONS)
    local, sample = keep_tracks(local, chosen[local.track_idx])
    kept = kept[sample]
    if len(local) < 12 * len(t) or len(np.unique(local.image_idx)) < len(t):
        return Solution(
            value=None,
            status="inconsistent_tracks",
            message="the tracks do not agree on one motion: too few survive triangulation with "
            "the cameras that the complete blocks suggest; look at the matches",
            diagnostics=start.diagnostics,
        )
    polish = polish_affine(
        AffineModel(A=A, t=t, X=X[kept]),
        local,
        solver=SolverOptions(
            max_iterations=options.polish_iterations,
            cost_tolerance=1e-6,
            loss=options.polish_loss,
            loss_width=options.polish_loss_width_px,
        ),
    )
    assert polish.value is not None
    model = polish.value
    noise = max(robust_sigma(polish.diagnostics["residuals"]), 1e-3)
    # accuracy of a camera's rows: noise over the extent of the object times root of observations
    extent = float(np.sqrt(np.mean(np.square(local.xy - local.xy.mean(axis=0)))))
    camera_sigma = max(noise / (extent * np.sqrt(len(local) / len(t))), 1e-5)
    upgrade = upgrade_to_euclidean(
        model, scale_sigma=options.scale_sigma, camera_sigma=camera_sigma
    )
    return Solution(
        value=upgrade.value,
        status=upgrade.status,
        message=upgrade.message,
        iterations=polish.iterations,
        costs=polish.costs,
        diagnostics={
            **start.diagnostics,
            "cbc_rms_px": rms_with_cameras(A, t, local),
            "affine_rms_px": polish.diagnostics["rms_px"],
            "affine_sigma_px": noise,
            "upgrade": dict(upgrade.diagnostics),
        },
    )


def rms_with_cameras(A: Float, t: Float, observations: Observations) -> float:
    """Root mean square residual per coordinate of the best points for given cameras."""
    obs = observations
    pointer = track_pointer(obs.track_idx, obs.num_tracks)
    X = np.nan_to_num(solve_points(A, t, obs.image_idx, pointer, obs.xy, np.ones(len(obs))))
    r = residuals(A, t, X, obs.image_idx, obs.track_idx, obs.xy)
    return float(np.sqrt(np.mean(r**2)))


def find_parts(observations: Observations, options: FactorizationOptions) -> list[Part]:
    """The connected parts of a series, largest first."""
    return connected_parts(select_blocks(observations, options), observations.num_images)
