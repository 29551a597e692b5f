"""The reduced system of the cameras, points eliminated, by pairs of images.

    S = sum_j [ J_a^T w J_a - (J_a^T w P_a) (sum w P^T P)^-1 (P_b^T w J_b) ]_{ab in j}

Only images that share a track have a block in S, so the blocks of the co-visible pairs are all that
is kept: for a long series with short tracks their number grows with the series, not with its
square. They become one matrix at the end, dense or sparse as it fits.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numba
import numpy as np
from scipy import sparse
from scipy.linalg import cho_factor, cho_solve, cholesky, solve_triangular
from scipy.sparse.csgraph import reverse_cuthill_mckee

from semsfm_colmap.geometry.points import add_observation, invert_symmetric
from semsfm_colmap.geometry.threads import blas_threads, threads_for
from semsfm_colmap.types import Float, Int

Matrix = Float | sparse.csc_array
"""A symmetric matrix: dense when small or full, else sparse."""

SPARSE_LIMIT = 1500
"""Systems of more parameters are kept sparse when they are."""
MAX_SPARSE_DENSITY = 0.2
"""Share d of non-zeros up to which the factorization within the band is faster: with n parameters,
d n apart at most, it takes 3.3 d^2 n^3 operations in one thread, the dense one n^3 / 3 in all."""
MIN_BLOCK = 96
"""Smallest blocks of the factorization within the band: smaller ones do not keep a core busy."""
BORDER_SHARE = 0.7
"""Columns that meet a larger share of the others belong to no band."""
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


@numba.njit(cache=True)
def _mark_pairs(image_idx, pointer, mark):  # type: ignore[no-untyped-def]
    for j in range(len(pointer) - 1):
        for a in range(pointer[j], pointer[j + 1]):
            for b in range(pointer[j], a + 1):
                mark[image_idx[a], image_idx[b]] = True


def covisible_pairs(image_idx: Int, pointer: Int, num_images: int) -> CovisiblePairs:
    """The pairs of images that tracks tie together."""
    mark = np.zeros((num_images, num_images), dtype=bool)
    _mark_pairs(image_idx, pointer, mark)
    first, second = np.nonzero(np.tril(mark | mark.T))
    lookup = np.full((num_images, num_images), -1, dtype=np.int64)
    lookup[first, second] = lookup[second, first] = np.arange(len(first))
    order = None
    if len(first) > MAX_SCATTERED_PAIRS:
        seen = np.flatnonzero(np.diff(pointer))
        order = seen[np.argsort(image_idx[pointer[seen]], kind="stable")]
    return CovisiblePairs(lookup=lookup, first=first, second=second, order=order)


@numba.njit(cache=True, parallel=True)
def _accumulate(  # type: ignore[no-untyped-def]
    J, A, r, w, image_idx, pointer, tracks, begin_row, lookup, chunk, blocks, gradient, max_len
):
    p = J.shape[2]
    for c in numba.prange(len(chunk) - 1):
        E = np.zeros((max_len, p, 3))
        F = np.zeros((p, 3))
        H = np.zeros((3, 3))
        Hinv = np.zeros((3, 3))
        b = np.zeros(3)
        for k in range(chunk[c], chunk[c + 1]):
            begin, end = pointer[tracks[k]], pointer[tracks[k] + 1]
            first_row = begin_row[k]
            H[:] = 0.0
            b[:] = 0.0
            for o in range(begin, end):
                add_observation(H, b, A[image_idx[o]], r[o, 0], r[o, 1], w[o])
            if not invert_symmetric(H, Hinv):
                continue
            for o in range(begin, end):
                i = image_idx[o]
                a = o - begin
                row = first_row + a
                own = blocks[c, lookup[i, i]]
                for k in range(p):
                    j0, j1 = w[o] * J[row, 0, k], w[o] * J[row, 1, k]
                    for m in range(3):
                        E[a, k, m] = j0 * A[i, 0, m] + j1 * A[i, 1, m]
                    for m in range(3):
                        F[k, m] = (
                            E[a, k, 0] * Hinv[0, m]
                            + E[a, k, 1] * Hinv[1, m]
                            + E[a, k, 2] * Hinv[2, m]
                        )
                    gradient[c, i, k] += (
                        j0 * r[o, 0]
                        + j1 * r[o, 1]
                        - (F[k, 0] * b[0] + F[k, 1] * b[1] + F[k, 2] * b[2])
                    )
                    for m in range(p):
                        own[k, m] += j0 * J[row, 0, m] + j1 * J[row, 1, m]
                for other in range(a + 1):
                    i2 = image_idx[begin + other]
                    block = blocks[c, lookup[i, i2]]
                    # stored for (later, earlier image); tracks are sorted by image
                    for k in range(p):
                        f0, f1, f2 = F[k, 0], F[k, 1], F[k, 2]
                        for m in range(p):
                            block[k, m] -= (
                                f0 * E[other, m, 0] + f1 * E[other, m, 1] + f2 * E[other, m, 2]
                            )


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
            _accumulate(
                J, A, r, w, image_idx, pointer, batch.tracks, batch.begin_row, pairs.lookup, chunk,
                blocks, gradient, max_len,
            )  # fmt: skip
    return blocks.sum(axis=0), gradient.sum(axis=0)


def assemble(
    blocks: Float, gradient: Float, pairs: CovisiblePairs, param_idx: Int, num_params: int
) -> tuple[Matrix, Float]:
    """The matrix (n, n) and gradient (n,) of the global parameters.

    Parameters of several images (aspect, skew) collect from all of them; fixed ones (-1) drop out.
    """
    own = pairs.first == pairs.second
    a, b = param_idx[pairs.first], param_idx[pairs.second]
    p = param_idx.shape[1]
    rows = np.broadcast_to(a[:, :, None], (len(a), p, p))
    cols = np.broadcast_to(b[:, None, :], (len(a), p, p))
    free = (rows >= 0) & (cols >= 0)
    both = free & ~own[:, None, None]
    i = np.concatenate([rows[free], cols[both]])
    j = np.concatenate([cols[free], rows[both]])
    values = np.concatenate([blocks[free], blocks[both]])
    g = np.zeros(num_params)
    used = param_idx >= 0
    np.add.at(g, param_idx[used], gradient[used])
    H = sparse.coo_array((values, (i, j)), shape=(num_params, num_params))
    share = len(values) / max(num_params, 1) ** 2
    if num_params > SPARSE_LIMIT and share < MAX_SPARSE_DENSITY:
        return H.tocsc(), g
    return H.toarray(), g


def add_prior(H: Matrix, jacobian: sparse.csr_array) -> Matrix:
    """``H + J^T J`` for a sparse J."""
    extra = sparse.csc_array(jacobian.T @ jacobian)
    if sparse.issparse(H):
        return sparse.csc_array(H + extra)
    return np.asarray(H + extra.toarray())


def banded_order(A: sparse.csc_array) -> tuple[Int, Int]:
    """Order that narrows the band (reverse Cuthill-McKee), and columns that no order narrows.

    Parameters of all images (aspect, skew) meet every other one: they are kept apart.
    """
    n = A.shape[0]
    full = np.diff(A.indptr) > BORDER_SHARE * n
    border, rest = np.flatnonzero(full), np.flatnonzero(~full)
    inner = sparse.csr_array(A[rest][:, rest])
    return rest[reverse_cuthill_mckee(inner, symmetric_mode=True)], border


def solve_in_band(A: sparse.csr_array, b: Float) -> Float:
    """Solve ``A X = B`` for a positive definite A of small bandwidth w.

    Cut into blocks of size w, A is block tridiagonal; its Cholesky factors are dense blocks, which
    is many times faster than LAPACK's banded routine at widths of some hundred.
    """
    n = A.shape[0]
    entries = A.tocoo()
    width = max(int(np.max(np.abs(entries.row - entries.col), initial=0)), MIN_BLOCK)
    cuts = [*range(0, max(n - width // 2, 1), width), n]
    starts = list(itertools.pairwise(cuts))
    factors: list[Float] = []
    links: list[Float] = []
    x = np.array(b, dtype=np.float64)
    for k, (first, last) in enumerate(starts):
        block = A[first:last, first:last].toarray()
        if k > 0:
            before = slice(*starts[k - 1])
            # W = C^-1 A_up; the next diagonal block loses W^T W
            up = A[before, first:last].toarray()
            W = solve_triangular(factors[-1], up, lower=True, check_finite=False)
            block -= W.T @ W
            x[first:last] -= W.T @ x[before]
            links.append(W)
        factors.append(cholesky(block, lower=True, overwrite_a=True, check_finite=False))
        x[first:last] = solve_triangular(factors[-1], x[first:last], lower=True, check_finite=False)
    for k in range(len(starts) - 1, -1, -1):
        rows = slice(*starts[k])
        if k + 1 < len(starts):
            x[rows] -= links[k] @ x[slice(*starts[k + 1])]
        x[rows] = solve_triangular(factors[k], x[rows], lower=True, trans="T", check_finite=False)
    return x


def solve_sparse(A: sparse.csc_array, g: Float) -> Float:
    """Solve ``A x = g`` for a sparse positive definite A by Cholesky within its band.

    With the border columns C and their corner D: ``B^-1 [C, g]`` in the band, then the small Schur
    complement ``D - C^T B^-1 C``.
    """
    order, border = banded_order(A)
    rows = sparse.csr_array(A[order])
    C = rows[:, border].toarray()
    with blas_threads(1):
        inner = solve_in_band(sparse.csr_array(rows[:, order]), np.column_stack([C, g[order]]))
    x = np.empty(len(g))
    x[border] = np.linalg.solve(
        A[border][:, border].toarray() - C.T @ inner[:, :-1], g[border] - C.T @ inner[:, -1]
    )
    x[order] = inner[:, -1] - inner[:, :-1] @ x[border]
    return x


def solve_damped(H: Matrix, damping: Float, g: Float) -> Float:
    """Solve ``(H + diag(damping)) x = g`` for a positive definite H (n, n); else LinAlgError."""
    if sparse.issparse(H):
        damped = sparse.csc_array(H + sparse.diags_array(damping, format="csc"))
        return solve_sparse(damped, g)
    dense = np.array(H)
    dense[np.diag_indices_from(dense)] += damping
    return np.asarray(cho_solve(cho_factor(dense, lower=True, overwrite_a=True), g))
