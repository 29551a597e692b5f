"""Cutting a long series into overlapping segments, and joining what they give.

Over many track lengths the constraints of the complete blocks no longer tell a slow affine bending
of the chain of cameras from noise, and the joint problem grows faster than the series. A segment is
short enough to be stiff; upgraded by itself it is Euclidean, so it joins its neighbours, with which
it has about half of its images in common, by a rotation and a shift alone, which do not bend:

    R_i = R_i^s Q_s^T,    t_i = t_i^s - P_i c_s    for all images i of segment s.

With the R_i eliminated the Q_s are the three smallest eigenvectors of one small matrix (the camera
basis constraints once more, with rotations for bases; Arie-Nachimson et al., 3DIMPVT 2012), the c_s
then the solution of a linear system. The hand of a segment is one of two; neighbours are given the
same one first.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree, shortest_path

from semsfm_colmap.factorization.blocks import Block, Part, connected_parts
from semsfm_colmap.geometry.rotations import (
    MIRROR_Z,
    depth_reversed,
    nearest_rotation,
    rotation_angle,
)
from semsfm_colmap.types import Float, Int, OrthographicCameras

MAX_HOPS = 12
"""Longest shortest path from image to image over common blocks that is factorized as one: some 12
track lengths. From 15 on (a closed turn of 30) the bending hides in the noise."""
MAX_IMAGES = 400
"""Most images that are factorized as one: more would dominate the time of the whole program."""
SEGMENT_IMAGES = 200
"""A segment has about so many images at most, if it still reaches to all neighbours of one."""
MIN_BLOCKS = 5
"""Fewest blocks of an image in a segment, or a third of all that it lies in."""
MIN_COMMON_IMAGES = 3
"""Two rotations between common images are the least that tells the hand."""

MAX_SCALE_STEP = 0.2
"""Largest difference of an image's log magnification between its segments: twice the widest spread
within a series that `refinement.magnification` knows."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Segment:
    """Euclidean cameras of some images, and their points, in a world of their own."""

    images: Int
    cameras: OrthographicCameras
    points: Float

    def reversed(self) -> Segment:
        """The other hand."""
        R = depth_reversed(np.asarray(self.cameras.cam_from_world))
        cameras = OrthographicCameras(
            cam_from_world=R,
            scale_px_per_unit=self.cameras.scale_px_per_unit,
            translation_px=self.cameras.translation_px,
        )
        return Segment(images=self.images, cameras=cameras, points=self.points @ MIRROR_Z)


def cut_into_segments(blocks: list[Block], num_images: int) -> list[Part]:
    """Overlapping segments that cover all images, or none where one is enough.

    Centres are chosen in image order, each the first image that the segments before leave out, so
    that neighbouring segments overlap by about a half.
    """
    rows = np.concatenate([np.full(len(b.images), k) for k, b in enumerate(blocks)])
    images = np.concatenate([b.images for b in blocks])
    B = sparse.csr_array((np.ones(len(rows)), (rows, images)), shape=(len(blocks), num_images))
    hops = shortest_path(B.T @ B, unweighted=True, directed=False)
    if np.max(hops) <= MAX_HOPS and num_images <= MAX_IMAGES:
        return []
    reach = 1
    while reach < MAX_HOPS // 2 and np.median(np.sum(hops <= reach + 1, axis=1)) <= SEGMENT_IMAGES:
        reach += 1
    enough = blocks_wanted(np.bincount(images, minlength=num_images))
    covered, tried = np.zeros(num_images, dtype=bool), np.zeros(num_images, dtype=bool)
    segments = []
    while not np.all(covered | tried):
        centre = int(np.argmin(covered | tried))
        tried[centre] = True
        inside = hops[centre] <= reach
        part = stiff_part([b for b in blocks if inside[b.images].all()], enough)
        if part is not None:
            covered[part.images] = True
            segments.append(part)
    return segments if len(segments) > 1 and covered.all() else []


def blocks_wanted(count: Int) -> Int:
    """Fewest blocks of each image in a segment, given how many it lies in altogether."""
    return np.minimum(MIN_BLOCKS, count // 3)


def stiff_part(blocks: list[Block], enough: Int) -> Part | None:
    """The largest part of a segment in which every image i lies in `enough[i]` blocks or more.

    At the ends of a segment the blocks that reach beyond are missing; images that hang by a few
    others spoil the whole, and they are in the next segment as well.
    """
    while True:
        parts = connected_parts(blocks, len(enough))
        if not parts:
            return None
        part = parts[0]
        count = np.bincount(np.concatenate([b.images for b in part.blocks]), minlength=len(enough))
        weak = (count > 0) & (count < enough)
        if not weak.any():
            return part
        blocks = [b for b in part.blocks if not weak[b.images].any()]


def common_images(a: Segment, b: Segment) -> tuple[Float, Float]:
    """The rotations of two segments' common images, (k, 3, 3) each."""
    _, i, j = np.intersect1d(a.images, b.images, assume_unique=True, return_indices=True)
    return np.asarray(a.cameras.cam_from_world[i]), np.asarray(b.cameras.cam_from_world[j])


def misfit(R1: Float, R2: Float) -> float:
    """Median angle that is left when one set of cameras is rotated onto the other, in rad."""
    Q = nearest_rotation(np.einsum("mji,mjk->ik", R1, R2))
    return float(np.median(rotation_angle(R1 @ Q @ R2.mT)))


def give_one_hand(segments: list[Segment]) -> list[Segment] | None:
    """Reverse segments so that neighbours have the same hand; None when they do not hang together.

    Every pair with common images says which hands agree, and by the ratio of the misfits how
    clearly; the clearest pairs that tie all segments together (a spanning tree) decide.
    """
    n = len(segments)
    clear, same = np.zeros((n, n)), np.ones((n, n), dtype=bool)
    for a in range(n):
        for b in range(a):
            R1, R2 = common_images(segments[a], segments[b])
            if len(R1) < MIN_COMMON_IMAGES:
                continue
            alike, opposite = misfit(R1, R2), misfit(R1, depth_reversed(R2))
            ratio = abs(np.log(max(opposite, 1e-12) / max(alike, 1e-12)))
            clear[a, b] = clear[b, a] = 1.0 + ratio
            same[a, b] = same[b, a] = alike <= opposite
    tree = minimum_spanning_tree(sparse.csr_array(-clear))
    order, before = breadth_first_order(tree, 0, directed=False)
    if len(order) < n:
        return None
    flipped = np.zeros(n, dtype=bool)
    for k in order[1:]:
        flipped[k] = flipped[before[k]] != (not same[k, before[k]])
    return [s.reversed() if f else s for s, f in zip(segments, flipped, strict=True)]


def common_frame(incidence: list[tuple[Int, Float]], num_images: int) -> Float:
    """``sum_i sum_{s, u at i} |F_is - F_iu|^2`` as a matrix over the segments' unknowns.

    Parameters
    ----------
    incidence : for each segment its images (m,) and the matrices F (m, d, 3) that its three
        unknowns are multiplied by in each of them

    Returns
    -------
    (3 S, 3 S) symmetric, positive semidefinite

    """
    count = np.zeros(num_images)
    for images, _ in incidence:
        count[images] += 1.0
    n, d = len(incidence), incidence[0][1].shape[1]
    # with F the stacked matrices: F^T F less what the mean over the segments of an image takes up
    stacked = np.zeros((num_images, d, n, 3))
    for s, (images, F) in enumerate(incidence):
        stacked[images, :, s] = F
    flat = stacked.reshape(num_images, d, 3 * n)
    own = np.zeros((3 * n, 3 * n))
    for s, (_, F) in enumerate(incidence):
        block = slice(3 * s, 3 * s + 3)
        own[block, block] = np.einsum("mdi,mdj->ij", F, F)
    return np.asarray(own - np.einsum("mdi,mdj->ij", flat / count[:, None, None], flat))


def join_segments(
    segments: list[Segment], num_images: int
) -> tuple[OrthographicCameras, Float] | None:
    """Cameras of all images and the points of all segments in one world; None if they fall apart.

    Every image must be in a segment. Segments are upgraded to a mean magnification of 1; where they
    hold images of several series in other shares, they differ in scale, and are not joined.
    """
    whole = give_one_hand(segments)
    if whole is None:
        return None
    rotations = [(s.images, np.asarray(s.cameras.cam_from_world)) for s in whole]
    _, vectors = np.linalg.eigh(common_frame(rotations, num_images))
    bases = vectors[:, :3].reshape(-1, 3, 3)  # Q_s^T up to one common matrix
    bases = bases * np.sign(np.median(np.linalg.det(bases)))
    QT = nearest_rotation(bases)
    total = np.zeros((num_images, 3, 3))
    log_scale, count = np.zeros(num_images), np.zeros(num_images)
    low, high = np.full(num_images, np.inf), np.full(num_images, -np.inf)
    for s, Q in zip(whole, QT, strict=True):
        total[s.images] += s.cameras.cam_from_world @ Q
        own = np.log(s.cameras.scale_px_per_unit)
        log_scale[s.images] += own
        low[s.images] = np.minimum(low[s.images], own)
        high[s.images] = np.maximum(high[s.images], own)
        count[s.images] += 1.0
    if np.max(high - low) > MAX_SCALE_STEP:
        return None
    R, scale = nearest_rotation(total), np.exp(log_scale / count)
    P = scale[:, None, None] * R[:, :2]
    # t_i^s - P_i c_s is the same for all segments of an image
    N = common_frame([(s.images, P[s.images]) for s in whole], num_images)
    mean = np.zeros((num_images, 2))
    for s in whole:
        mean[s.images] += np.asarray(s.cameras.translation_px) / count[s.images, None]
    rhs = np.concatenate(
        [
            np.einsum("mdi,md->i", P[s.images], s.cameras.translation_px - mean[s.images])
            for s in whole
        ]
    )
    shifts = np.linalg.lstsq(N, rhs, rcond=1e-10)[0].reshape(-1, 3)
    t = np.zeros((num_images, 2))
    points = []
    for s, Q, c in zip(whole, QT, shifts, strict=True):
        t[s.images] += (s.cameras.translation_px - P[s.images] @ c) / count[s.images, None]
        points.append(s.points @ Q + c)
    cameras = OrthographicCameras(
        cam_from_world=R @ R[0].T, scale_px_per_unit=scale, translation_px=t
    )
    return cameras, np.concatenate(points) @ R[0].T
