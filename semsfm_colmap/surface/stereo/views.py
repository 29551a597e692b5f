"""Which images see a reference's surface from a useful angle, and how its pixels map into them.

Parallel projection makes both simple. With ``x_cam = R X`` and ``xy = s K2 x_cam[:2] + t``, the
pixel p of the reference r at depth z is the point ``X = R_r^T [K2^-1 (p - t_r) / s_r; z]``, which
image j sees at ``B p + z c + e``: an affine map of p for every plane z = const, exact, with

    B = (s_j / s_r) K2 Q K2^-1,   c = s_j K2 q,   e = t_j - B t_r,   [Q q; . .] = R_j R_r^T.

The parallax of a depth step dz is ``|c| dz = s_j sin(angle) dz`` for square pixels: only the angle
between the viewing directions counts, a turn in the image plane gives none.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from semsfm_colmap.types import Float, Int, OrthographicCameras, Reconstruction

_MIN_DEPTH_MARGIN_PX = 20.0
"""Depth beyond the sparse points that is searched at least: relief they may have missed."""
_MAX_FALLBACK_DEG = 35.0
"""Beyond this the two pictures of a rough surface no longer correlate."""


@dataclass(frozen=True, kw_only=True, eq=False)
class AffineSweep:
    """``xy_j = B[j] @ xy_ref + z c[j] + e[j]`` for V neighbours, in px of the scaled images."""

    B: Float
    """(V, 2, 2)"""
    c: Float
    """(V, 2) px per world unit"""
    e: Float
    """(V, 2) px"""


def affine_sweep(
    cameras: OrthographicCameras, reference: int, neighbors: Int, scaling: Float
) -> AffineSweep:
    """The maps from a reference to its neighbours when image i is resized by ``scaling[i]``.

    Parameters
    ----------
    cameras : M
    reference : image index
    neighbors : (V,) image indices
    scaling : (M, 2) resized px per image px, along x and y

    """
    relative = cameras.cam_from_world[neighbors] @ cameras.cam_from_world[reference].T
    ratio = cameras.scale_px_per_unit[neighbors] / cameras.scale_px_per_unit[reference]
    K2 = cameras.K2
    B = ratio[:, None, None] * (K2 @ relative[:, :2, :2] @ np.linalg.inv(K2))
    c = cameras.scale_px_per_unit[neighbors, None] * (relative[:, :2, 2] @ K2.T)
    e = cameras.translation_px[neighbors] - B @ cameras.translation_px[reference]
    into, out_of = scaling[neighbors], scaling[reference]
    return AffineSweep(B=into[:, :, None] * B / out_of, c=into * c, e=into * e)


def baseline_angles(cameras: OrthographicCameras, reference: int) -> Float:
    """Angle between the reference's viewing direction and each image's: (M,) rad."""
    d = cameras.viewing_direction
    cross = np.linalg.norm(np.cross(d, d[reference]), axis=1)
    return np.asarray(np.arctan2(cross, d @ d[reference]))


def choose_neighbors(
    cameras: OrthographicCameras,
    reference: int,
    *,
    num: int,
    min_angle_rad: float,
    max_angle_rad: float,
) -> Int:
    """Up to `num` images whose viewing directions spread around the reference's.

    Among the images whose angle lies in the range, take the one farthest from the reference and all
    taken so far, again and again (farthest-point sampling on the sphere of directions). A series
    finer than needed is thus thinned evenly, on both sides. When fewer than two images lie in the
    range, the nearest ones above `min_angle_rad` are taken instead.

    Returns
    -------
    (V,) image indices by increasing angle, V <= num; empty when no image gives any parallax

    """
    angle = baseline_angles(cameras, reference)
    candidates = np.flatnonzero((angle >= min_angle_rad) & (angle <= max_angle_rad))
    if len(candidates) < 2:
        beyond = np.flatnonzero(angle >= min_angle_rad)
        beyond = beyond[angle[beyond] < np.radians(_MAX_FALLBACK_DEG)]
        candidates = beyond[np.argsort(angle[beyond], kind="stable")][:2]
    if len(candidates) == 0:
        return candidates
    d = cameras.viewing_direction
    taken: list[int] = []
    distance = np.linalg.norm(d[candidates] - d[reference], axis=1)
    while len(taken) < min(num, len(candidates)) and distance.max() > 0:
        best = int(np.argmax(distance))
        taken.append(int(candidates[best]))
        distance = np.minimum(distance, np.linalg.norm(d[candidates] - d[candidates[best]], axis=1))
    out = np.array(taken, dtype=np.int64)
    return out[np.argsort(angle[out], kind="stable")]


def choose_references(
    cameras: OrthographicCameras, max_num: int, min_angle_rad: float = 0.0
) -> Int:
    """The images that get a depth map, spread over the viewing directions.

    In their order, each image that is seen at `min_angle_rad` or more to all taken before it: one
    nearer than that sees the same surface from the same side, and still counts as a neighbour. When
    that is more than `max_num`, the image farthest from those taken so far, again and again.

    Returns
    -------
    (K,) image indices, increasing, K <= max_num

    """
    d = cameras.viewing_direction

    def angles(idx: int) -> Float:
        sine = np.linalg.norm(np.cross(d, d[idx]), axis=1)
        return np.asarray(np.arctan2(sine, d @ d[idx]))

    taken: list[int] = []
    nearest = np.full(len(cameras), np.inf)
    for idx in range(len(cameras)):
        if nearest[idx] >= min_angle_rad:
            taken.append(idx)
            nearest = np.minimum(nearest, angles(idx))
    if len(taken) <= max_num:
        return np.array(taken, dtype=np.int64)
    taken, nearest = [0], angles(0)
    while len(taken) < max_num:
        nearest[taken] = -1.0
        taken.append(int(np.argmax(nearest)))
        nearest = np.minimum(nearest, angles(taken[-1]))
    return np.sort(np.array(taken, dtype=np.int64))


def depth_range(
    reconstruction: Reconstruction, reference: int, margin: float
) -> tuple[float, float] | None:
    """Nearest and farthest depth that the points seen in an image allow, in world units.

    The 1st and 99th percentile of their depths, widened at each end by `margin` of the difference,
    and for flat specimens by some px; None when the image sees fewer than three points.
    """
    obs = reconstruction.observations
    rows = (obs.image_idx == reference) & reconstruction.inlier
    seen = np.unique(obs.track_idx[rows])
    if len(seen) < 3:
        return None
    direction = reconstruction.cameras.viewing_direction[reference]
    low, high = np.percentile(reconstruction.points[seen] @ direction, [1.0, 99.0])
    px = 1.0 / reconstruction.cameras.scale_px_per_unit[reference]
    room = max(margin * (high - low), _MIN_DEPTH_MARGIN_PX * px)
    return float(low - room), float(high + room)
