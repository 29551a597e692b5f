"""Complete sub-blocks of the measurement matrix [paper, equation 7 and steps 1, 2 of CBC].

A block is a set of images and the tracks seen in all of them. From every pair of images that share
tracks a block grows by the image that keeps the most of them, so every image lies in several
blocks, every edge of the co-visibility graph that a third image supports is in one, whatever the
order of the images, and a closed turn is wrapped by itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from semsfm_colmap.factorization.options import FactorizationOptions
from semsfm_colmap.types import Float, Int, Observations


@dataclass(frozen=True, kw_only=True, eq=False)
class Block:
    """Images (m,) and the measurements (2 m, n) of the tracks that all of them see."""

    images: Int
    tracks: Int
    M: Float


def visibility_matrix(observations: Observations) -> sparse.csr_array:
    """(M, N) sparse, entry = observation number + 1."""
    o = np.arange(1, len(observations) + 1)
    shape = (observations.num_images, observations.num_tracks)
    return sparse.csr_array((o, (observations.image_idx, observations.track_idx)), shape=shape)


def covisible_pairs(W: sparse.csr_array, num_neighbours: int, min_tracks: int) -> list[Int]:
    """For every image its neighbours by number of common tracks, each pair once."""
    common = sparse.csr_array(W @ W.T)
    common.setdiag(0)
    pairs = set()
    for i in range(W.shape[0]):
        begin, end = common.indptr[i], common.indptr[i + 1]
        neighbours, counts = common.indices[begin:end], common.data[begin:end]
        # equal counts in image order, so that the choice does not depend on the sort
        order = np.lexsort((neighbours, -counts))[:num_neighbours]
        pairs |= {
            (min(i, int(j)), max(i, int(j))) for j in neighbours[order[counts[order] >= min_tracks]]
        }
    return [np.array(pair, dtype=np.int64) for pair in sorted(pairs)]


def grow_block(
    W: sparse.csr_array, Wc: sparse.csc_array, pair: Int, size: int, min_tracks: int
) -> list[tuple[list[int], Int]]:
    """Grow a pair of images, one by one, by the image that keeps the most common tracks.

    Parameters
    ----------
    W, Wc : (M, N) visibility as 0 / 1, by rows and by columns

    Returns
    -------
    (images, common tracks) of each step from three images on

    """
    first, second = (W.indices[W.indptr[i] : W.indptr[i + 1]] for i in pair)
    tracks = np.intersect1d(first, second)
    images = [int(i) for i in pair]
    local = Wc[:, tracks]
    steps = []
    alive = np.ones(len(tracks), dtype=np.int64)
    rows = local.tocsr()
    while len(images) < size:
        common = rows @ alive
        common[images] = -1
        best = int(np.argmax(common))
        if common[best] < min_tracks:
            break
        images.append(best)
        seen = np.zeros(len(tracks), dtype=np.int64)
        seen[rows.indices[rows.indptr[best] : rows.indptr[best + 1]]] = 1
        alive *= seen
        steps.append((list(images), tracks[alive > 0].astype(np.int64)))
    return steps


def select_blocks(observations: Observations, options: FactorizationOptions) -> list[Block]:
    """Blocks of all sizes asked for around every co-visible pair, without duplicates."""
    entries = visibility_matrix(observations)
    W = entries.copy()
    W.data = np.ones_like(W.data)
    columns = W.tocsc()
    lookup = entries.tocsc()
    found: dict[tuple[int, ...], Block] = {}
    pairs = covisible_pairs(W, options.num_block_neighbours, options.min_block_tracks)
    for pair in pairs:
        steps = grow_block(W, columns, pair, options.max_block_images, options.min_block_tracks)
        for images, tracks in steps:
            key = tuple(sorted(images))
            if len(images) < options.min_block_images or key in found:
                continue
            if len(tracks) > options.max_block_tracks:
                keep = np.linspace(0, len(tracks) - 1, options.max_block_tracks)
                tracks = tracks[np.round(keep).astype(np.int64)]
            rows = np.array(key, dtype=np.int64)
            o = np.asarray(lookup[:, tracks].tocsr()[rows, :].todense(), dtype=np.int64) - 1
            M = observations.xy[o]  # (m, n, 2)
            M = M.transpose(0, 2, 1).reshape(2 * len(rows), len(tracks))
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
