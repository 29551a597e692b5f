"""From observations to Euclidean cameras: blocks -> CBC -> robust polish -> upgrade.

A long series goes through this in overlapping segments, which are then joined (`segments`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from semsfm_colmap.factorization.blocks import Part, connected_parts, select_blocks
from semsfm_colmap.factorization.cbc import factorize_cbc
from semsfm_colmap.factorization.options import FactorizationOptions
from semsfm_colmap.factorization.polish import polish_affine
from semsfm_colmap.factorization.segments import Segment, cut_into_segments, join_segments
from semsfm_colmap.factorization.upgrade import upgrade_to_euclidean
from semsfm_colmap.geometry.eliminated import SolverOptions
from semsfm_colmap.geometry.losses import MAD_TO_SIGMA
from semsfm_colmap.geometry.points import residuals, solve_points, track_pointer
from semsfm_colmap.geometry.subset import keep_tracks, take_subset, thin_evenly
from semsfm_colmap.geometry.triangulation import triangulate_tracks
from semsfm_colmap.records import StartFigures
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


@dataclass(frozen=True, kw_only=True, eq=False)
class Factorized:
    """Orthographic cameras to start the refinement from, of one part or segment."""

    cameras: OrthographicCameras
    points: Float
    """of the tracks that the polish used"""
    figures: StartFigures


def robust_sigma(r: Float) -> float:
    """Standard deviation of residuals from their median absolute deviation."""
    return float(MAD_TO_SIGMA * np.median(np.abs(r - np.median(r)))) if r.size else 0.0


def factorize(
    part: Part,
    observations: Observations,
    options: FactorizationOptions,
    rng: np.random.Generator,
) -> Solution[Factorized]:
    """Orthographic cameras of one connected part.

    Parameters
    ----------
    part : images i and blocks, numbered as in `observations`
    observations : sorted by track

    Returns
    -------
    Solution of Factorized, cameras of ``part.images`` in that order; a failure that leaves some of
    them tied together has their places in ``diagnostics["tied_images"]``

    """
    blocks = part.own_blocks(observations.num_images)
    segments = cut_into_segments(blocks, len(part.images))
    if segments:
        local = take_subset(observations, images=part.images, min_length=3).observations
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
) -> tuple[Part, Solution[Factorized]]:
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
) -> Solution[Factorized]:
    """Segments one by one, then joined; without a value when they leave out images."""
    fits = [factorize_whole(segment, observations, options, rng) for segment in segments]
    done = [
        (
            Segment(images=segment.images, cameras=fit.value.cameras, points=fit.value.points),
            fit.value.figures,
        )
        for segment, fit in zip(segments, fits, strict=True)
        if fit.value is not None
    ]
    found = np.concatenate([s.images for s, _ in done]) if done else np.zeros(0)
    joined = None
    if len(np.unique(found)) == observations.num_images:
        joined = join_segments([s for s, _ in done], observations.num_images)
    if joined is None:
        return Solution(
            value=None,
            status="segments_apart",
            message="the segments of the series leave out images or fall apart",
        )
    cameras, points = joined
    return Solution(
        value=Factorized(
            cameras=cameras, points=points, figures=joint_figures([f for _, f in done])
        ),
        iterations=sum(fit.iterations for fit in fits),
    )


def joint_figures(segments: list[StartFigures]) -> StartFigures:
    """Of all segments: root mean squares, and the eigenvalue gap of the weakest."""

    def rms(values: list[float | None]) -> float:
        return float(np.sqrt(np.mean(np.square([v for v in values if v is not None]))))

    gaps = [f.eigenvalue_gap for f in segments if f.eigenvalue_gap is not None]
    return StartFigures(
        num_segments=len(segments),
        eigenvalue_gap=min(gaps, default=0.0),
        cbc_rms_px=rms([f.cbc_rms_px for f in segments]),
        affine_rms_px=rms([f.affine_rms_px for f in segments]),
        affine_sigma_px=rms([f.affine_sigma_px for f in segments]),
    )


def factorize_whole(
    part: Part,
    observations: Observations,
    options: FactorizationOptions,
    rng: np.random.Generator,
) -> Solution[Factorized]:
    """Orthographic cameras of one part at once; see `factorize`."""
    blocks = part.own_blocks(observations.num_images)
    start = factorize_cbc(blocks, len(part.images), options, rng)
    if start.value is None:
        return Solution(
            value=None, status=start.status, message=start.message, diagnostics=start.diagnostics
        )
    local = take_subset(observations, images=part.images, min_length=2).observations
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
    noise = max(robust_sigma(polish.value.residuals), 1e-3)
    # accuracy of a camera's rows: noise over the extent of the object times root of observations
    extent = float(np.sqrt(np.mean(np.square(local.xy - local.xy.mean(axis=0)))))
    camera_sigma = max(noise / (extent * np.sqrt(len(local) / len(t))), 1e-5)
    upgrade = upgrade_to_euclidean(
        polish.value.model, scale_sigma=options.scale_sigma, camera_sigma=camera_sigma
    )
    if upgrade.value is None:
        return Solution(
            value=None,
            status=upgrade.status,
            message=upgrade.message,
            diagnostics=upgrade.diagnostics,
        )
    return Solution(
        value=Factorized(
            cameras=upgrade.value.cameras,
            points=upgrade.value.points,
            figures=StartFigures(
                num_blocks=start.value.num_blocks,
                eigenvalues=tuple(start.value.eigenvalues.tolist()),
                eigenvalue_gap=start.value.eigenvalue_gap,
                cbc_rms_px=rms_with_cameras(A, t, local),
                affine_rms_px=polish.value.rms_px,
                affine_sigma_px=noise,
                upgrade=upgrade.value.figures,
            ),
        ),
        status=upgrade.status,
        message=upgrade.message,
        iterations=polish.iterations,
        costs=polish.costs,
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
