"""Whether the points have depth: does a third coordinate foretell observations it has not seen?

Images of a plane under parallel projection are affine maps of one another: two coordinates a point
explain them all, the tilts are known up to one parameter, and a third coordinate only fits the
noise, which then decides the angles. A fit with p coordinates a point leaves at observation o, had
it been held out,

    (I - H_o)^-1 r_o,    H_o = w_o A_i (sum_k w_k A_k^T A_k)^-1 A_i^T   (sums over its track),

r_o its residual, so that both models are judged without a second fit. For a plane in independent
noise the ratio of the two is 0.9, for depth that is twice its own sigma 1.1; relief on a few points
only shows in the upper quantiles of the points.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from semsfm_colmap.geometry.subset import keep_tracks
from semsfm_colmap.types import Float, Int, Observations, OrthographicCameras

QUANTILES = (0.5, 0.75, 0.9, 0.95, 0.98)
"""Of the held-out residuals: grains may cover a tenth of a plane."""
FLAT_RATIOS = (1.05, 1.07, 1.15, 1.25, 1.5)
"""For each, residuals of the plane over those of the points in space up to which nothing shows
depth. Rendered planes of 20 to 60 degrees of tilt have 0.98 to 1.015 at the median and, for wrong
matches that fit some depth by chance, up to 1.11 at 0.95; depth of twice its sigma has 1.1 in all,
a tenth of a plane under grains 3 in the last ones."""
CLEAR_EXCESS = 6.0
"""Where the first model is flat a guided pass has to show so many times the excess over 1 that
these ratios allow: what is left of blur and foreshortening in its alignments looks like depth of
some hundredths of a pixel."""
MAX_TRACKS = 2000
"""Of more tracks every so manieth is looked at."""
SWEEPS = 30
"""Alternations of the fit of a plane; they start close to its end."""


@dataclass(frozen=True, kw_only=True)
class Flatness:
    """Points in space against points in a plane."""

    ratio: float
    """held-out residuals of the plane over those of the points in space, median"""
    excess: float
    """how far such ratios exceed 1, as a share of what a plane may, at the quantile that shows
    depth best"""
    facing_deg: float
    """the rotation between the two images of the most different foreshortening, if the plane faced
    the viewer in the one where it appears largest"""

    def is_flat(self, max_excess: float = 1.0) -> bool:
        """True where a third coordinate foretells nothing."""
        return self.excess < max_excess

    @property
    def message(self) -> str:
        """One sentence, with what would settle it."""
        return (
            "the specimen is flat to within the noise: depth foretells no observation better than "
            f"a plane does (ratio of held-out residuals {self.ratio:.2f}); the tilt of a plane is "
            "known up to one parameter: if it faced the viewer in one of the images it turned "
            f"by {self.facing_deg:.1f} deg, if it was inclined in all by another angle, and all "
            "of them show the same images; known tilts would settle it, or a part of the specimen "
            "with relief"
        )


def _per_track(A: Float, obs: Observations) -> Float:
    """``sum_k w_k A_k^T A_k`` of each track: (M, 2, p) -> (N, p, p)."""
    p = A.shape[2]
    product = np.einsum("mka,mkb->mab", A, A)
    out = np.empty((obs.num_tracks, p, p))
    w = obs.precision
    for a in range(p):
        for b in range(p):
            out[:, a, b] = np.bincount(
                obs.track_idx, w * product[obs.image_idx, a, b], minlength=obs.num_tracks
            )
    return out


def held_out_residuals(A: Float, r: Float, obs: Observations) -> Float:
    """What the residuals (O, 2) had been without the observation: the module's formula."""
    inverse = np.linalg.pinv(_per_track(A, obs), hermitian=True)
    Ai = A[obs.image_idx]
    H = obs.precision[:, None, None] * np.einsum(
        "oia,oab,ojb->oij", Ai, inverse[obs.track_idx], Ai, optimize=True
    )
    left = np.eye(2) - H
    # where one direction hangs on this observation alone, nothing foretells it
    determined = np.linalg.det(left) > 1e-6
    out = np.full(r.shape, np.nan)
    out[determined] = np.linalg.solve(left[determined], r[determined][:, :, None])[:, :, 0]
    return out


def fit_plane(points: Float, observations: Observations) -> tuple[Float, Float, Float]:
    """Affine images of points in a plane: maps B (M, 2, 2), shifts (M, 2), residuals (O, 2).

    Parameters
    ----------
    points : (N, 3), whose best plane is the start

    """
    obs, i, j = observations, observations.image_idx, observations.track_idx
    M, N, w = obs.num_images, obs.num_tracks, obs.precision
    centred = points - points.mean(axis=0)
    _, _, Vt = np.linalg.svd(centred, full_matrices=False)
    uv = centred @ Vt[:2].T
    uv = uv / np.maximum(uv.std(axis=0), 1e-12)

    def gathered(values: Float, at: Int, size: int) -> Float:
        flat = values.reshape(len(values), -1)
        sums = [np.bincount(at, w * column, minlength=size) for column in flat.T]
        return np.asarray(np.stack(sums, axis=1).reshape(size, *values.shape[1:]), dtype=float)

    B, t, r = np.zeros((M, 2, 2)), np.zeros((M, 2)), np.zeros((len(obs), 2))
    for _ in range(SWEEPS):
        h = np.column_stack([uv[j], np.ones(len(j))])
        normal = gathered(h[:, :, None] * h[:, None, :], i, M)
        P = np.linalg.pinv(normal, hermitian=True) @ gathered(h[:, :, None] * obs.xy[:, None], i, M)
        B, t = P[:, :2].transpose(0, 2, 1), P[:, 2]
        y = obs.xy - t[i]
        right = gathered(np.einsum("oab,oa->ob", B[i], y), j, N)
        uv = np.einsum("nab,nb->na", np.linalg.pinv(_per_track(B, obs), hermitian=True), right)
        r = np.einsum("oab,ob->oa", B[i], uv[j]) - y
    return B, t, r


def facing_angle_deg(B: Float) -> float:
    """The tilt that the largest ratio of stretches of maps (M, 2, 2) stands for, from zero."""
    maps = B[:, None] @ np.linalg.pinv(B)[None]
    s = np.linalg.svd(maps, compute_uv=False)
    return float(np.rad2deg(np.arccos(np.min(s[..., 1] / np.maximum(s[..., 0], 1e-300)))))


def flatness(
    cameras: OrthographicCameras, points: Float, observations: Observations
) -> Flatness | None:
    """Points in space against a plane, for a model with its inlier observations.

    None where no track has enough observations to hold one out.
    """
    obs = observations
    step = -(-obs.num_tracks // MAX_TRACKS)
    if step > 1:
        obs, chosen = keep_tracks(obs, obs.track_idx % step == 0)
        points = points[chosen]
    B, _, r2 = fit_plane(points, obs)
    A = np.ascontiguousarray(cameras.projection)
    r3 = cameras.project(points[obs.track_idx], obs.image_idx) - obs.xy
    root = np.sqrt(obs.precision)
    plane = np.linalg.norm(held_out_residuals(B, r2, obs), axis=1) * root
    space = np.linalg.norm(held_out_residuals(A, r3, obs), axis=1) * root
    both = np.isfinite(plane) & np.isfinite(space)
    length = np.bincount(obs.track_idx, minlength=obs.num_tracks)[obs.track_idx]
    # of the shortest tracks one observation left out leaves little
    long = both & (length >= 4) if np.any(both & (length >= 4)) else both
    if not np.any(long):
        return None
    space_q, plane_q = (np.quantile(values[long], QUANTILES) for values in (space, plane))
    ratio = plane_q / np.maximum(space_q, 1e-12)
    excess = np.max((ratio - 1.0) / (np.array(FLAT_RATIOS) - 1.0))
    return Flatness(ratio=float(ratio[0]), excess=float(excess), facing_deg=facing_angle_deg(B))
