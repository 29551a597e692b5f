"""Complete sub-blocks of the measurement matrix [paper, equation 7 and steps 1, 2 of CBC].

A block is a set of images and the tracks seen in all of them. From every pair of images that share
tracks a block grows by the image that keeps the most of them, so every image lies in several
blocks, every edge of the co-visibility graph that a third image supports is in one, whatever the
order of the images, and a closed turn is wrapped by itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from semsfm_colmap.factorization.options import FactorizationOptions
from semsfm_colmap.geometry.points import track_pointer
from semsfm_colmap.types import Float, Int, Observations


@dataclass(frozen=True, kw_only=True, eq=False)
class Block:
    """Images (m,) and the measurements (2 m, n) of the tracks that all of them see."""

    images: Int
    tracks: Int
    M: Float


@dataclass(frozen=True, kw_only=True, eq=False)
class Visibility:
    """Who sees what, by track and by image, as compressed rows."""

    track_pointer: Int
    """(N + 1,) where each track begins among the observations"""
    image_idx: Int
    """(O,) image of each observation"""
    image_pointer: Int
    """(M + 1,) where each image begins in `tracks`"""
    tracks: Int
    """(O,) tracks of each image, ascending"""
    common: Int
    """(M, M) tracks that two images share, zero on the diagonal"""


@numba.njit(cache=True)
def _count_common(pointer, image_idx, common):  # type: ignore[no-untyped-def]
    for j in range(len(pointer) - 1):
        for a in range(pointer[j], pointer[j + 1]):
            for b in range(pointer[j], a):
                common[image_idx[a], image_idx[b]] += 1
                common[image_idx[b], image_idx[a]] += 1


def visibility(observations: Observations) -> Visibility:
    """Index the observations, which are sorted by track, in both directions."""
    obs = observations
    pointer = track_pointer(obs.track_idx, obs.num_tracks)
    common = np.zeros((obs.num_images, obs.num_images), dtype=np.int64)
    _count_common(pointer, obs.image_idx, common)
    return Visibility(
        track_pointer=pointer,
        image_idx=obs.image_idx,
        image_pointer=track_pointer(obs.image_idx, obs.num_images),
        tracks=obs.track_idx[np.argsort(obs.image_idx, kind="stable")],
        common=common,
    )


def covisible_pairs(common: Int, num_neighbours: int, min_tracks: int) -> list[tuple[int, int]]:
    """For every image some of its neighbours by number of common tracks, each pair once.

    From the neighbour with the most common tracks to the last one that shares enough, spaced
    quadratically in rank: near ones share many tracks and stand many wrong ones, far ones see the
    depth and keep a long series straight.
    """
    pairs = set()
    for i, counts in enumerate(common):
        # equal counts in image order, so that the choice does not depend on the sort
        order = np.argsort(-counts, kind="stable")[: np.count_nonzero(counts >= min_tracks)]
        if len(order) == 0:
            continue
        spaced = np.linspace(0.0, 1.0, min(num_neighbours, len(order))) ** 2
        ranks = np.maximum(np.round(spaced * (len(order) - 1)), np.arange(len(spaced)))
        pairs |= {(min(i, int(j)), max(i, int(j))) for j in order[ranks.astype(np.int64)]}
    return sorted(pairs)


@numba.njit(cache=True)
def _grow(pointer, image_idx, image_pointer, tracks, first, second, size, min_tracks, images):  # type: ignore[no-untyped-def]
    a, b = image_pointer[first], image_pointer[second]
    end_a, end_b = image_pointer[first + 1], image_pointer[second + 1]
    shared = np.empty(min(end_a - a, end_b - b), dtype=np.int64)
    n = 0
    while a < end_a and b < end_b:
        if tracks[a] < tracks[b]:
            a += 1
        elif tracks[a] > tracks[b]:
            b += 1
        else:
            shared[n] = tracks[a]
            n += 1
            a += 1
            b += 1
    shared = shared[:n]
    depth = np.full(n, 2, dtype=np.int64)
    images[0], images[1] = first, second
    found = 2
    count = np.zeros(len(image_pointer) - 1, dtype=np.int64)
    while found < size:
        count[:] = 0
        for k in range(n):
            if depth[k] == found:
                for o in range(pointer[shared[k]], pointer[shared[k] + 1]):
                    count[image_idx[o]] += 1
        for k in range(found):
            count[images[k]] = -1
        best = np.argmax(count)
        if count[best] < min_tracks:
            break
        for k in range(n):
            if depth[k] == found:
                for o in range(pointer[shared[k]], pointer[shared[k] + 1]):
                    if image_idx[o] == best:
                        depth[k] = found + 1
                        break
        images[found] = best
        found += 1
    return shared, depth, found


def grow_block(
    seen: Visibility, pair: tuple[int, int], size: int, min_tracks: int
) -> list[tuple[list[int], Int]]:
    """Grow a pair of images, one by one, by the image that keeps the most common tracks.

    Returns
    -------
    (images, common tracks) of each step from three images on

    """
    images = np.empty(max(size, 2), dtype=np.int64)
    shared, depth, found = _grow(
        seen.track_pointer, seen.image_idx, seen.image_pointer, seen.tracks,
        pair[0], pair[1], size, min_tracks, images,
    )  # fmt: skip
    return [(images[:k].tolist(), shared[depth >= k]) for k in range(3, found + 1)]


@numba.njit(cache=True)
def _gather(pointer, image_idx, xy, images, tracks, M):  # type: ignore[no-untyped-def]
    for k in range(len(tracks)):
        for o in range(pointer[tracks[k]], pointer[tracks[k] + 1]):
            row = np.searchsorted(images, image_idx[o])
            if row < len(images) and images[row] == image_idx[o]:
                M[2 * row, k] = xy[o, 0]
                M[2 * row + 1, k] = xy[o, 1]


def select_blocks(observations: Observations, options: FactorizationOptions) -> list[Block]:
    """The two smallest and the largest block around co-visible pairs, without duplicates."""
    seen = visibility(observations)
    found: dict[tuple[int, ...], Block] = {}
    pairs = covisible_pairs(seen.common, options.num_block_neighbours, options.min_block_tracks)
    for pair in pairs:
        steps = grow_block(seen, pair, options.max_block_images, options.min_block_tracks)
        steps = steps[max(options.min_block_images - 3, 0) :]
        # the most tracks and the most images; what lies between adds little
        for images, tracks in [*steps[:2], *steps[2:][-1:]]:
            key = tuple(sorted(images))
            if key in found:
                continue
            if len(tracks) > options.max_block_tracks:
                keep = np.linspace(0, len(tracks) - 1, options.max_block_tracks)
                tracks = tracks[np.round(keep).astype(np.int64)]
            rows = np.array(key, dtype=np.int64)
            M = np.full((2 * len(rows), len(tracks)), np.nan)
            _gather(seen.track_pointer, seen.image_idx, observations.xy, rows, tracks, M)
            found[key] = Block(images=rows, tracks=tracks, M=M)
    return list(found.values())


@dataclass(frozen=True, kw_only=True, eq=False)
class Part:
    """A connected part of the series: its images and their blocks."""

    images: Int
    blocks: list[Block]


def tied_groups(images: list[Int], num_images: int) -> Int:
    """Group numbers of blocks, given their images: tied by two images in common, transitively."""
    rows = np.concatenate([np.full(len(block), k) for k, block in enumerate(images)])
    B = sparse.csr_array(
        (np.ones(len(rows)), (rows, np.concatenate(images))), shape=(len(images), num_images)
    )
    tied = sparse.csr_array(B @ B.T)
    tied.data = (tied.data >= 2).astype(float)
    tied.eliminate_zeros()
    return np.asarray(connected_components(tied, directed=False)[1], dtype=np.int64)


def connected_parts(blocks: list[Block], num_images: int) -> list[Part]:
    """Images tied together by blocks that share at least two images, largest part first.

    Two blocks with two cameras in common fix the affinity between them; with one they do not.
    """
    if not blocks:
        return []
    label = tied_groups([b.images for b in blocks], num_images)
    parts = []
    for part in range(label.max() + 1):
        mine = [b for b, p in zip(blocks, label, strict=True) if p == part]
        images = np.unique(np.concatenate([b.images for b in mine]))
        parts.append(Part(images=images, blocks=mine))
    # an image at a seam can be in two parts: the larger keeps it
    parts.sort(key=lambda p: (-len(p.images), int(p.images[0])))
    taken: set[int] = set()
    result = []
    for p in parts:
        images = np.array([i for i in p.images if int(i) not in taken], dtype=np.int64)
        kept = [b for b in p.blocks if not taken & set(b.images.tolist())]
        covered = np.unique(np.concatenate([b.images for b in kept])) if kept else images[:0]
        if len(covered) >= 3:
            result.append(Part(images=covered, blocks=kept))
            taken |= set(covered.tolist())
    return result
