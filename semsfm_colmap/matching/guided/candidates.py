"""Keypoints that found no match, as further points to look for.

A descriptor that is not distinct enough, or that was seen once only, leaves a keypoint without a
track. Once the surface around it is known, its point is known but for little: the viewing ray meets
the tangent planes of its neighbours in the image. Where these agree, the patch can be looked for in
the other images like that of any other point, and there it proves right or wrong.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from semsfm_colmap.geometry.losses import MAD_TO_SIGMA
from semsfm_colmap.matching.guided.predict import References, Seeds
from semsfm_colmap.types import Float, Int, Observations, OrthographicCameras

NUM_NEIGHBORS = 8
"""Tangent planes that are asked."""
MAX_NEIGHBOR_DISTANCE_PX = 60.0
"""The farthest of them may be so far away."""
MIN_IMAGES = 2
"""Further images that must be near enough for the uncertain depth not to matter."""
MIN_DISTANCE_PX = 3.0
"""What lies closer to the place of a known point shows the same spot."""
MIN_COSINE = 0.2
"""Planes seen at a more grazing angle say nothing about the depth."""


def add_candidates(
    cameras: OrthographicCameras,
    seeds: Seeds,
    observations: Observations,
    read_keypoints: Callable[[int], Float],
    *,
    max_shift_px: float,
    max_num_points: int,
    rng: np.random.Generator,
) -> Seeds:
    """The points to look for, and after them those of keypoints without a track.

    A depth that is uncertain by s px shifts the point by s sin(angle) px in a view at some angle:
    candidates are those that are sure enough for the two nearest views.

    Parameters
    ----------
    observations : of `seeds`, in the images of `cameras`
    read_keypoints : number of an image -> (K, 2) px
    max_shift_px : how far from its predicted place a patch can be found
    max_num_points : candidates are added up to so many points in all, as many from each image

    """
    room = max_num_points - len(seeds.points)
    if room <= 0:
        return seeds
    quota = -(-room // len(cameras))
    direction = cameras.viewing_direction
    points: list[Float] = []
    normals: list[Float] = []
    images: list[Int] = []
    places: list[Float] = []
    for i in range(len(cameras)):
        rows = np.flatnonzero(observations.image_idx == i)
        near = observations.track_idx[rows]
        if len(near) < NUM_NEIGHBORS:
            continue
        # where known points are seen, and those that other images have brought
        brought = np.concatenate(points) if points else np.zeros((0, 3))
        taken = np.concatenate(
            [observations.xy[rows], cameras.project(brought, np.full(len(brought), i))]
        )
        xy = apart(read_keypoints(i), taken)
        X, normal, spread = interpolated(
            cameras, i, xy, observations.xy[rows], seeds.points[near], seeds.normals[near]
        )
        sine = np.sort(np.linalg.norm(np.cross(direction[i], direction), axis=1))
        good = np.flatnonzero(spread * sine[min(MIN_IMAGES, len(sine) - 1)] < max_shift_px)
        good = np.sort(rng.permutation(good)[:quota])
        points.append(X[good])
        normals.append(normal[good])
        images.append(np.full(len(good), i, dtype=np.int64))
        places.append(xy[good])
    if not points:
        return seeds
    return Seeds(
        points=np.concatenate([seeds.points, *points]),
        normals=np.concatenate([seeds.normals, *normals]),
        references=References(
            image_idx=np.concatenate([seeds.references.image_idx, *images]),
            xy=np.concatenate([seeds.references.xy, *places]),
        ),
    )


def apart(xy: Float, taken: Float) -> Float:
    """The places that are not near a taken one, nor near an earlier one that stays."""
    from scipy.spatial import cKDTree

    xy = xy[np.isfinite(xy).all(axis=1)]
    if len(taken) and len(xy):
        xy = xy[cKDTree(taken).query(xy)[0] > MIN_DISTANCE_PX]
    if not len(xy):
        return xy
    keep = np.ones(len(xy), dtype=bool)
    pairs = np.sort(cKDTree(xy).query_pairs(MIN_DISTANCE_PX, output_type="ndarray"), axis=1)
    # when a place is asked about, all that is said of the earlier one has been said
    for earlier, later in pairs[np.argsort(pairs[:, 1], kind="stable")]:
        keep[later] &= not keep[earlier]
    return xy[keep]


def interpolated(
    cameras: OrthographicCameras,
    image: int,
    xy: Float,
    known_xy: Float,
    known_points: Float,
    known_normals: Float,
) -> tuple[Float, Float, Float]:
    """Points on the viewing rays of places, from the tangent planes of their neighbours.

    The ray ``X0 + depth d`` meets the plane of neighbour k at ``n_k . (X_k - X0) / n_k . d``; the
    median over the neighbours is taken.

    Parameters
    ----------
    xy : (K, 2) px
    known_xy, known_points, known_normals : (N, 2) px, (N, 3), (N, 3) of the points seen there

    Returns
    -------
    Points (K, 3), unit normals (K, 3), and the robust standard deviation of the depths in px (K,),
    inf where the neighbours say too little

    """
    from scipy.spatial import cKDTree

    d = cameras.viewing_direction[image]
    origin = (xy - cameras.translation_px[image]) @ np.linalg.pinv(cameras.projection[image]).T
    cosine = known_normals @ d
    facing = np.flatnonzero(-cosine > MIN_COSINE)
    spread = np.full(len(xy), np.inf)
    if len(facing) < NUM_NEIGHBORS or not len(xy):
        return origin, np.zeros_like(origin), spread
    distance, idx = cKDTree(known_xy[facing]).query(xy, k=NUM_NEIGHBORS)
    idx = facing[idx]
    depth = (
        np.einsum("knj,knj->kn", known_normals[idx], known_points[idx] - origin[:, None])
        / cosine[idx]
    )
    middle = np.median(depth, axis=1)
    scale = float(np.linalg.norm(cameras.projection[image, 0]))
    robust = MAD_TO_SIGMA * np.median(np.abs(depth - middle[:, None]), axis=1) * scale
    reached = np.asarray(distance)[:, -1] < MAX_NEIGHBOR_DISTANCE_PX
    spread[reached] = robust[reached]
    normal = known_normals[idx].mean(axis=1)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    return origin + middle[:, None] * d, normal, spread
