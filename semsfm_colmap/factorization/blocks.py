"""Complete sub-blocks of the measurement matrix [paper, equation 7 and steps 1, 2 of CBC].

A block is a set of images and the tracks seen in all of them. From every pair of images that share
tracks a block grows by the image that keeps the most of them, so every image lies in several
blocks, every edge of the co-visibility graph that a third image supports is in one, whatever the
order of the images, and a closed turn is wrapped by itself.

Two blocks fix the affinity between them when they have two images in common. Where many images
share few tracks (each seen in some of a hundred frames), blocks grown one by one rarely do, and the
series falls into pieces that belong together: there every image also gets a fan of triples, in
which each pair of neighbouring blocks has two images in common.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components, minimum_spanning_tree

from semsfm_colmap.factorization.blocks_kernels import (
    count_common,
    count_triples,
    gather,
    grow,
    in_both,
)
from semsfm_colmap.factorization.options import FactorizationOptions
from semsfm_colmap.geometry.points import track_pointer
from semsfm_colmap.geometry.subset import new_numbers
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


def visibility(observations: Observations) -> Visibility:
    """Index the observations, which are sorted by track, in both directions."""
    obs = observations
    pointer = track_pointer(obs.track_idx, obs.num_tracks)
    common = np.zeros((obs.num_images, obs.num_images), dtype=np.int64)
    count_common(pointer, obs.image_idx, common)
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


def grow_block(
    seen: Visibility, pair: tuple[int, int], size: int, min_tracks: int
) -> list[tuple[list[int], Int]]:
    """Grow a pair of images, one by one, by the image that keeps the most common tracks.

    Returns
    -------
    (images, common tracks) of each step from three images on

    """
    images = np.empty(max(size, 2), dtype=np.int64)
    shared, depth, found = grow(
        seen.track_pointer, seen.image_idx, seen.image_pointer, seen.tracks,
        pair[0], pair[1], size, min_tracks, images,
    )  # fmt: skip
    return [(images[:k].tolist(), shared[depth >= k]) for k in range(3, found + 1)]


def tied_groups(images: list[Int], num_images: int) -> Int:
    """Group numbers of blocks, given their images: tied by two images in common, transitively."""
    if not images:
        return np.zeros(0, dtype=np.int64)
    rows = np.concatenate([np.full(len(block), k) for k, block in enumerate(images)])
    B = sparse.csr_array(
        (np.ones(len(rows)), (rows, np.concatenate(images))), shape=(len(images), num_images)
    )
    tied = sparse.csr_array(B @ B.T)
    tied.data = (tied.data >= 2).astype(float)
    tied.eliminate_zeros()
    return np.asarray(connected_components(tied, directed=False)[1], dtype=np.int64)


def fan_triples(
    seen: Visibility, pairs: list[tuple[int, int]], min_tracks: int
) -> list[tuple[int, int, int]]:
    """Triples of images that tie all pairs of an image together, image by image.

    Among the neighbours of an image, tied by the tracks that all three see, the largest spanning
    tree: every pair of the image is in a triple, neighbouring triples have that pair in common, and
    a pair is in the fans of both of its images. So the blocks hang together as the pairs do.
    """
    num_images = len(seen.common)
    neighbours: list[list[int]] = [[] for _ in range(num_images)]
    for i, j in pairs:
        neighbours[i].append(j)
        neighbours[j].append(i)
    local = np.full(num_images, -1, dtype=np.int64)
    triples = set()
    for i, near in enumerate(neighbours):
        local[near] = np.arange(len(near))
        count = np.zeros((len(near), len(near)), dtype=np.int64)
        count_triples(
            seen.image_pointer[i], seen.image_pointer[i + 1], seen.track_pointer, seen.image_idx,
            seen.tracks, local, count,
        )  # fmt: skip
        local[near] = -1
        tree = minimum_spanning_tree(sparse.csr_array(np.where(count >= min_tracks, -count, 0)))
        for a, b in zip(*tree.nonzero(), strict=True):
            first, second, third = sorted((i, near[a], near[b]))
            triples.add((first, second, third))
    return sorted(triples)


def select_blocks(observations: Observations, options: FactorizationOptions) -> list[Block]:
    """The two smallest and the largest block around co-visible pairs, without duplicates.

    When they do not tie all their images together, the fans are added.
    """
    seen = visibility(observations)
    found: dict[tuple[int, ...], Block] = {}

    def add(images: tuple[int, ...], tracks: Int) -> None:
        if len(tracks) > options.max_block_tracks:
            keep = np.linspace(0, len(tracks) - 1, options.max_block_tracks)
            tracks = tracks[np.round(keep).astype(np.int64)]
        rows = np.array(images, dtype=np.int64)
        M = np.full((2 * len(rows), len(tracks)), np.nan)
        gather(seen.track_pointer, seen.image_idx, observations.xy, rows, tracks, M)
        found[images] = Block(images=rows, tracks=tracks, M=M)

    pairs = covisible_pairs(seen.common, options.num_block_neighbours, options.min_block_tracks)
    for pair in pairs:
        steps = grow_block(seen, pair, options.max_block_images, options.min_block_tracks)
        steps = steps[max(options.min_block_images - 3, 0) :]
        # the most tracks and the most images; what lies between adds little
        for images, tracks in [*steps[:2], *steps[2:][-1:]]:
            key = tuple(sorted(images))
            if key not in found:
                add(key, tracks)
    tied = tied_groups([block.images for block in found.values()], observations.num_images)
    if len(np.unique(tied)) > 1 and options.min_block_images <= 3:
        by_image = np.split(seen.tracks, seen.image_pointer[1:-1])
        for i, j, k in fan_triples(seen, pairs, options.min_block_tracks):
            if (i, j, k) not in found:
                add((i, j, k), in_both(in_both(by_image[i], by_image[j]), by_image[k]))
    return list(found.values())


@dataclass(frozen=True, kw_only=True, eq=False)
class Part:
    """A connected part of the series: its images and their blocks."""

    images: Int
    blocks: list[Block]

    def own_blocks(self, num_images: int) -> list[Block]:
        """The blocks with images numbered as they stand in `images`, of `num_images` in all."""
        number = new_numbers(self.images, num_images)
        return [Block(images=number[b.images], tracks=b.tracks, M=b.M) for b in self.blocks]


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
