"""The reduced system of the cameras, points eliminated, by pairs of images.

    S = sum_j [ J_a^T w J_a - (J_a^T w P_a) (sum w P^T P)^-1 (P_b^T w J_b) ]_{ab in j}

Only images that share a track have a block in S, so the blocks of the co-visible pairs are all that
is kept: for a long series with short tracks their number grows with the series, not with its
square. They become one matrix at the end, in a band where the series has one (`band_layout`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import reverse_cuthill_mckee

from semsfm_colmap.geometry.band import BandLayout
from semsfm_colmap.geometry.reduced_kernels import accumulate_tracks, mark_pairs
from semsfm_colmap.geometry.threads import threads_for
from semsfm_colmap.types import Float, Int

DENSE_LIMIT = 700
"""Systems of fewer parameters are solved whole."""
MAX_BAND_SHARE = 0.4
"""Width of the band, as a share of all parameters, up to which it is faster: n parameters take
1.3 n w^2 operations at a width w, and n^3 / 3 in one block."""
MIN_BLOCK = 96
"""Smallest blocks of the band: smaller ones do not keep a core busy."""
SMOOTHING_SWEEPS = 8
SUM_CHUNKS = 4
"""Partial sums, whatever the number of threads, so that the result does not depend on it."""
BATCH_OBSERVATIONS = 500_000
"""Jacobians are held for so many observations at a time: 50 MB at six parameters an image."""
MAX_SCATTERED_PAIRS = 5000
"""Blocks of so many pairs (1.4 MB at six parameters an image) stay in a core's cache. Where there
are more, tracks are taken in the order of their first image, whatever their numbers, so that those
at hand are near one another."""
PARALLEL_COST = 10
"""What an observation costs here in units of a pass over it (see `threads_for`)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CovisiblePairs:
    """Pairs of images (a, b), a = b included, that have a track in common; each once."""

    lookup: Int
    """(M, M) number of the pair, -1 when the images share nothing; symmetric"""
    first: Int
    """(B,)"""
    second: Int
    """(B,) second <= first"""
    order: Int | None
    """(N,) tracks in the order in which they are summed; None: as they are numbered"""


def covisible_pairs(image_idx: Int, pointer: Int, num_images: int) -> CovisiblePairs:
    """The pairs of images that tracks tie together."""
    mark = np.zeros((num_images, num_images), dtype=bool)
    mark_pairs(image_idx, pointer, mark)
    first, second = np.nonzero(np.tril(mark | mark.T))
    lookup = np.full((num_images, num_images), -1, dtype=np.int64)
    lookup[first, second] = lookup[second, first] = np.arange(len(first))
    order = None
    if len(first) > MAX_SCATTERED_PAIRS:
        seen = np.flatnonzero(np.diff(pointer))
        order = seen[np.argsort(image_idx[pointer[seen]], kind="stable")]
    return CovisiblePairs(lookup=lookup, first=first, second=second, order=order)


@dataclass(frozen=True, kw_only=True, eq=False)
class TrackBatch:
    """Some tracks whose Jacobians are held at a time."""

    tracks: Int
    """(n,)"""
    begin_row: Int
    """(n + 1,) where each track begins in the batch"""
    rows: slice | Int
    """the batch's observations"""


def track_batches(pointer: Int, order: Int | None = None) -> Iterator[TrackBatch]:
    """Batches of at most `BATCH_OBSERVATIONS`, at least one track each.

    Parameters
    ----------
    pointer : (N + 1,)
    order : tracks in the order wanted; None: as they are numbered

    """
    tracks = np.arange(len(pointer) - 1) if order is None else order
    begin = np.concatenate([[0], np.cumsum(np.diff(pointer)[tracks])]).astype(np.int64)
    first = 0
    while first < len(tracks):
        last = int(np.searchsorted(begin, begin[first] + BATCH_OBSERVATIONS, side="right")) - 1
        last = min(max(last, first + 1), len(tracks))
        begin_row = begin[first : last + 1] - begin[first]
        some = tracks[first:last]
        rows: slice | Int = slice(int(begin[first]), int(begin[last]))
        if order is not None:
            offset = np.repeat(pointer[some] - begin_row[:-1], np.diff(begin_row))
            rows = offset + np.arange(len(offset))
        yield TrackBatch(tracks=some, begin_row=begin_row, rows=rows)
        first = last


def accumulate_blocks(
    jacobian: Callable[[slice | Int], Float],
    A: Float,
    r: Float,
    w: Float,
    image_idx: Int,
    pointer: Int,
    pairs: CovisiblePairs,
    num_local: int,
) -> tuple[Float, Float]:
    """The blocks of S of all pairs and the gradient, by image.

    Parameters
    ----------
    jacobian : rows of observations -> (rows, 2, p), p = `num_local` parameters an image
    A, r, w : (M, 2, 3), (O, 2), (O,): cameras, residuals, weights over variance
    image_idx, pointer : observations sorted by track, then image

    Returns
    -------
    (B, p, p) and (M, p)

    """
    num_images = len(pairs.lookup)
    blocks = np.zeros((SUM_CHUNKS, len(pairs.first), num_local, num_local))
    gradient = np.zeros((SUM_CHUNKS, num_images, num_local))
    max_len = int(np.max(np.diff(pointer), initial=1))
    for batch in track_batches(pointer, pairs.order):
        # equal shares of observations
        targets = np.linspace(0, batch.begin_row[-1], SUM_CHUNKS + 1)
        chunk = np.searchsorted(batch.begin_row, targets).astype(np.int64)
        chunk[0], chunk[-1] = 0, len(batch.tracks)
        J = jacobian(batch.rows)
        with threads_for(PARALLEL_COST * len(J)):
            accumulate_tracks(
                J, A, r, w, image_idx, pointer, batch.tracks, batch.begin_row, pairs.lookup, chunk,
                blocks, gradient, max_len,
            )  # fmt: skip
    return blocks.sum(axis=0), gradient.sum(axis=0)


def reach_of(order: Int, graph: sparse.coo_array) -> int:
    """How far apart neighbours of the graph come to stand in an order."""
    place = np.empty(len(order), dtype=np.int64)
    place[order] = np.arange(len(order))
    return int(np.max(np.abs(place[graph.row] - place[graph.col]), initial=0))


def narrow_order(graph: sparse.coo_array) -> Int:
    """An order (M,) of the nodes in which neighbours are close.

    Reverse Cuthill-McKee goes out from one node ring by ring, and within a ring in any order: in a
    closed turn its band is nearly twice as wide as need be. Moving each node to the mean place of
    its neighbours a few times sorts the rings within.
    """
    order: Int = np.asarray(
        reverse_cuthill_mckee(sparse.csr_array(graph), symmetric_mode=True), dtype=np.int64
    )
    best, least = order, reach_of(order, graph)
    adjacency = sparse.csr_array(graph)
    adjacency.data[:] = 1.0
    place = np.empty(len(order))
    place[order] = np.arange(len(order))
    for _ in range(SMOOTHING_SWEEPS):
        place = (adjacency @ place) / np.maximum(np.diff(adjacency.indptr), 1)
        order = np.asarray(np.argsort(place, kind="stable"), dtype=np.int64)
        reach = reach_of(order, graph)
        if reach < least:
            best, least = order, reach
    return best


def band_layout(
    pairs: CovisiblePairs, param_idx: Int, num_params: int, prior_jacobian: sparse.csr_array
) -> BandLayout:
    """An order of the parameters in which those that meet are close, where there is one.

    Parameters of several images (aspect, skew) meet all others and form the border. Small or full
    systems stay dense.
    """
    if num_params < DENSE_LIMIT:
        return BandLayout.dense(num_params)
    used = param_idx >= 0
    shared = np.bincount(param_idx[used], minlength=num_params) > 1
    own = used & ~shared[param_idx]
    num_images = len(param_idx)
    # images that meet in a track or in a prior
    owner = np.zeros(num_params, dtype=np.int64)
    owner[param_idx[own]] = np.nonzero(own)[0]
    entries = sparse.coo_array(prior_jacobian)
    mine = ~shared[entries.col]
    rows = sparse.csr_array(
        (np.ones(mine.sum()), (entries.row[mine], owner[entries.col[mine]])),
        shape=(prior_jacobian.shape[0], num_images),
    )
    ties = sparse.csr_array(
        (np.ones(len(pairs.first)), (pairs.first, pairs.second)), shape=(num_images, num_images)
    )
    graph = sparse.coo_array(ties + ties.T + rows.T @ rows)
    order = narrow_order(graph)
    count = own.sum(axis=1)
    begin = np.empty(num_images, dtype=np.int64)
    begin[order] = np.cumsum(count[order]) - count[order]
    reach = begin[graph.row] + count[graph.row] - 1 - begin[graph.col]
    width = max(int(np.max(reach, initial=0)), MIN_BLOCK)
    num_inner = int(count.sum())
    if width > MAX_BAND_SHARE * num_inner:
        return BandLayout.dense(num_params)
    place = np.empty(num_params, dtype=np.int64)
    within = np.cumsum(own, axis=1) - 1
    place[param_idx[own]] = (begin[:, None] + within)[own]
    border = np.flatnonzero(shared)
    place[border] = num_inner + np.arange(len(border))
    assert num_inner + len(border) == num_params
    return BandLayout.banded(place, width, len(border))


def gradient_of(by_image: Float, param_idx: Int, num_params: int) -> Float:
    """The gradient (n,) from that by image (M, p); shared parameters collect from all images."""
    g = np.zeros(num_params)
    used = param_idx >= 0
    np.add.at(g, param_idx[used], by_image[used])
    return g
