"""Camera basis constraints [Tardif et al., CVPR 2007; paper, equations 7-19].

Each complete block k, centred, has a rank-3 basis U_k of its rows' column space. The joint
projection matrix Pi (2 M, 3) must satisfy ``Pi_k = U_k Z_k`` for unknown Z_k. Eliminating the Z_k
leaves

    min_Pi  sum_k w_k | (I - U_k U_k^T) Pi_k |^2 ,

a sparse symmetric matrix of size 2 M whose three smallest eigenvectors are the cameras, up to a
common 3-D affinity. Parts of the series that no two blocks with two images in common tie together
have three such vectors each; the gap after the third eigenvalue shows how firmly the rest hangs
together. The translations then follow from the block means by one linear system.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from semsfm_colmap.factorization.blocks import Block, tied_groups
from semsfm_colmap.factorization.cbc_kernels import best_subspace, centred_basis, squared_distances
from semsfm_colmap.factorization.options import FactorizationOptions
from semsfm_colmap.geometry.threads import blas_threads
from semsfm_colmap.types import Bool, Float, Int, Solution

MOST = 0.8
"""Share of a block's tracks within the threshold above which no RANSAC is needed."""
DENSE_EIGEN_LIMIT = 3000
"""Up to so many rows the eigenvectors come from a dense decomposition."""
SINGLE_THREAD_ROWS = 1500
"""Up to so many rows one BLAS thread decomposes fastest: several wait for one another."""


@dataclass(frozen=True, kw_only=True, eq=False)
class BlockBasis:
    """What a block says of its cameras: row basis U (2 m, 3), weight, support, mean (2 m,)."""

    images: Int
    U: Float
    weight: float
    num_tracks: int
    mean: Float


def leading_basis(M: Float) -> tuple[Float, Float, Float]:
    """Row mean (2 m,), left singular vectors and singular values of the centred M (2 m, n).

    From the eigenvectors of the small matrix ``M M^T``; only their leading three matter.
    """
    mean, U, s = centred_basis(np.ascontiguousarray(M))
    return mean, U, s


def subspace_error(M: Float, mean: Float, U: Float) -> Float:
    """Squared distance of each column of M to the affine subspace ``mean + span(U)``: (n,)."""
    error = squared_distances(np.ascontiguousarray(M), mean, np.ascontiguousarray(U))
    return np.asarray(error)


def ransac_support(M: Float, limit: float, trials: int, rng: np.random.Generator) -> Bool:
    """Columns that agree with the best of at most `trials` subspaces through four random columns.

    Trials end when four columns as good as the best set found would have been drawn by then but for
    a chance of `cbc_kernels.MISS`.
    """
    n = M.shape[1]
    best = np.zeros(n, dtype=bool)
    best_subspace(
        np.asfortranarray(M), limit, rng.integers(0, n, (trials, 4)), rng.permutation(n), best
    )
    return best


def block_basis(
    block: Block, options: FactorizationOptions, rng: np.random.Generator
) -> BlockBasis | None:
    """Row basis of one block, from the tracks that agree on it.

    When the SVD of all tracks has most of them within the threshold, the others are trimmed; else
    random subspaces through four tracks are tried and the one with the most supporters wins. None
    when fewer than `min_block_tracks` agree or the block does not have rank three.
    """
    M = block.M
    rows, n = M.shape
    inlier = np.ones(n, dtype=bool)
    limit = options.block_ransac_threshold_px**2 * (rows / 2)
    robust = options.block_ransac_trials > 0 and n > 4
    if robust:
        mean, U, _ = leading_basis(M)
        inlier = subspace_error(M, mean, U[:, :3]) < limit
        if np.count_nonzero(inlier) < MOST * n:
            inlier = ransac_support(M, limit, options.block_ransac_trials, rng)
    for _ in range(2):
        if np.count_nonzero(inlier) < max(options.min_block_tracks, 4):
            return None
        mean, U, s = leading_basis(M[:, inlier])
        if robust:
            inlier = subspace_error(M, mean, U[:, :3]) < limit
    if s[2] <= 1e-6 * s[0]:
        return None
    weight = 1.0
    if options.block_weights == "signal_to_noise":
        rest = s[3 : min(rows, np.count_nonzero(inlier))]
        noise = float(np.mean(rest**2)) if len(rest) else 0.0
        # per track, so that the noise floor is a variance in px^2; 1e-4 px is below any detector
        noise = max(noise, 1e-8 * np.count_nonzero(inlier))
        weight = float(s[2] ** 2 / noise)
    return BlockBasis(
        images=block.images,
        U=U[:, :3],
        weight=weight,
        num_tracks=int(np.count_nonzero(inlier)),
        mean=mean,
    )


def of_equal_size(bases: list[BlockBasis]) -> Iterator[tuple[Int, list[BlockBasis]]]:
    """Blocks with equally many images together: their rows (K, 2 m) of the cameras, and they."""
    size = np.array([len(basis.images) for basis in bases])
    for m in np.unique(size):
        some = [bases[k] for k in np.flatnonzero(size == m)]
        images = np.stack([basis.images for basis in some])
        yield (2 * images[:, :, None] + np.arange(2)).reshape(len(some), -1), some


def sum_of_blocks(rows: list[Int], blocks: list[Float], n: int) -> sparse.csc_array:
    """``sum_k S_k^T B_k S_k`` of stacks of blocks B (K, r, r) with rows (K, r) among n."""
    i = [np.broadcast_to(r[:, :, None], B.shape).ravel() for r, B in zip(rows, blocks, strict=True)]
    j = [np.broadcast_to(r[:, None, :], B.shape).ravel() for r, B in zip(rows, blocks, strict=True)]
    values = np.concatenate([B.ravel() for B in blocks])
    places = (np.concatenate(i), np.concatenate(j))
    return sparse.coo_array((values, places), shape=(n, n)).tocsc()


def constraint_matrix(bases: list[BlockBasis], num_images: int) -> sparse.csc_array:
    """``sum_k w_k S_k^T (I - U_k U_k^T) S_k``, (2 M, 2 M), scaled to unit mean diagonal."""
    rows, blocks = [], []
    for idx, some in of_equal_size(bases):
        U = np.stack([basis.U for basis in some])
        weight = np.array([basis.weight for basis in some])
        rows.append(idx)
        blocks.append(weight[:, None, None] * (np.eye(idx.shape[1]) - U @ U.mT))
    n = 2 * num_images
    C = sum_of_blocks(rows, blocks, n)
    return C / (C.diagonal().sum() / n)


def smallest_eigenvectors(C: sparse.csc_array, count: int) -> tuple[Float, Float]:
    """The `count` smallest eigenvalues and their eigenvectors of a symmetric C >= 0."""
    if C.shape[0] <= DENSE_EIGEN_LIMIT:
        from scipy.linalg import eigh

        with blas_threads(1 if C.shape[0] < SINGLE_THREAD_ROWS else None):
            values, vectors = eigh(C.toarray(), subset_by_index=[0, count - 1])
        return values, vectors
    from scipy.sparse.linalg import eigsh

    start = np.ones(C.shape[0])  # a fixed start keeps the result the same from run to run
    values, vectors = eigsh(C, k=count, sigma=-1e-6, which="LM", v0=start)
    order = np.argsort(values)
    return values[order], vectors[:, order]


def two_camera_gauge(C: sparse.csc_array, first: int, second: int) -> Float:
    """The paper's gauge, equation 15: two cameras fixed, the rest by least squares.

    Camera `first` is [[1, 0, 0], [0, 1, 0]]; the first row of `second` is [0, 0, 1]. The affinity
    that does this exists when the two cameras' three rows are independent.
    """
    n = C.shape[0]
    fixed = np.array([2 * first, 2 * first + 1, 2 * second])
    free = np.setdiff1d(np.arange(n), fixed)
    Pi = np.zeros((n, 3))
    Pi[fixed] = np.eye(3)
    rhs = -(C[free][:, fixed] @ np.eye(3))
    Pi[free] = splu(C[free][:, free].tocsc()).solve(np.asarray(rhs))
    return Pi


def joint_projection(
    bases: list[BlockBasis], num_images: int, options: FactorizationOptions
) -> tuple[Float, Float]:
    """Cameras (M, 2, 3) up to an affinity, and the smallest eigenvalues of the constraints."""
    C = constraint_matrix(bases, num_images)
    values, vectors = smallest_eigenvectors(C, min(5, 2 * num_images))
    Pi = vectors[:, :3]
    if options.gauge == "two_cameras":
        A = Pi.reshape(-1, 2, 3)
        # the second camera is the one whose rows complete the first's the best
        Q, _ = np.linalg.qr(A[0].T)
        rest = A[:, 0] - (A[:, 0] @ Q) @ Q.T
        Pi = two_camera_gauge(C, 0, int(np.argmax(np.linalg.norm(rest, axis=1))))
    return Pi.reshape(-1, 2, 3), values


def joint_translation(bases: list[BlockBasis], A: Float) -> Float:
    """Translations (M, 2) from the block means [paper, equations 17-19].

    In block k the mean measurement is ``A_i s_k + t_i`` with unknown centroid s_k. Linear least
    squares over all s_k and t; eliminating the s_k leaves, with Q_k an orthonormal basis of the
    block's rows of A, the same sparse pattern as the constraints of the cameras:

        sum_k w_k S_k^T (I - Q_k Q_k^T) (S_k t - mean_k) = 0 .

    A common shift of all points, ``t = A c``, is free; a tiny ridge picks one.
    """
    n = 2 * len(A)
    rows, blocks = [], []
    rhs = np.zeros(n)
    for idx, some in of_equal_size(bases):
        Q, _ = np.linalg.qr(A.reshape(n, 3)[idx])
        num_tracks = np.array([basis.num_tracks for basis in some])
        block = num_tracks[:, None, None] * (np.eye(idx.shape[1]) - Q @ Q.mT)
        rows.append(idx)
        blocks.append(block)
        mean = np.stack([basis.mean for basis in some])
        np.add.at(rhs, idx, np.einsum("kij,kj->ki", block, mean))
    normal = sum_of_blocks(rows, blocks, n)
    ridge = 1e-12 * float(normal.diagonal().max())
    normal = normal + ridge * sparse.eye_array(n, format="csc")
    return np.asarray(splu(sparse.csc_array(normal)).solve(rhs)).reshape(-1, 2)


def largest_tied(images: list[Int], group: Int) -> tuple[int, Int]:
    """The group of blocks that holds the most images, and these.

    Parameters
    ----------
    images, group : of each block

    """
    most = (-1, np.zeros(0, dtype=np.int64))
    for number in np.unique(group):
        inside = [i for i, g in zip(images, group, strict=True) if g == number]
        found = np.unique(np.concatenate(inside))
        if len(found) > len(most[1]):
            most = (int(number), found)
    return most


@dataclass(frozen=True, kw_only=True, eq=False)
class AffineStart:
    """Affine cameras without points: triangulate the tracks with them."""

    A: Float
    """(M, 2, 3)"""
    t: Float
    """(M, 2)"""
    eigenvalues: Float
    """the smallest of the constraints, rising; without noise three are zero"""
    num_blocks: int

    @property
    def eigenvalue_gap(self) -> float | None:
        """The fourth eigenvalue over the third: how far the cameras are from undetermined."""
        values = self.eigenvalues
        return float(values[3] / max(values[2], 1e-300)) if len(values) > 3 else None


def factorize_cbc(
    blocks: list[Block],
    num_images: int,
    options: FactorizationOptions,
    rng: np.random.Generator,
) -> Solution[AffineStart]:
    """Affine cameras of an incomplete measurement matrix from its complete blocks.

    A failure that leaves some images tied together names them in ``diagnostics["tied_images"]``.
    """
    bases = [b for b in (block_basis(block, options, rng) for block in blocks) if b is not None]
    used = [basis.images for basis in bases]
    group = tied_groups(used, num_images)
    number, tied = largest_tied(used, group)
    covered = np.zeros(num_images, dtype=bool)
    for images in used:
        covered[images] = True
    if not covered.all():
        missing = np.flatnonzero(~covered)
        return Solution(
            value=None,
            status="images_without_block",
            message=f"{len(missing)} image(s) share no {options.min_block_tracks} tracks with two "
            "others; leave them out or match more pairs",
            diagnostics={"images_without_block": missing.tolist(), "tied_images": tied.tolist()},
        )
    if len(tied) < num_images:
        return Solution(
            value=None,
            status="disconnected",
            message="no two blocks with two images in common tie all images together: the series "
            "falls into parts; match more pairs or lower the minimum of common tracks",
            diagnostics={"tied_images": tied.tolist()},
        )
    # what hangs on one image only says nothing of the others
    bases = [basis for basis, g in zip(bases, group, strict=True) if g == number]
    A, eigenvalues = joint_projection(bases, num_images, options)
    t = joint_translation(bases, A)
    return Solution(value=AffineStart(A=A, t=t, eigenvalues=eigenvalues, num_blocks=len(bases)))
