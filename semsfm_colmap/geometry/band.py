"""Symmetric positive definite matrices with a narrow band: factor, solve, entries of the inverse.

Cut into blocks of b columns, each block meets itself and the m next ones; a few columns that meet
all others stand apart as a border E. With R_k upper triangular, A_k the blocks below block k, and
``.`` for what the columns before have left,

    A = [ D_1            ]        R_k^T R_k = D_k.,     U_k = R_k^-T A_k.^T  (b, m b),
        [ A_1  D_2       ]
        [      A_2   ... ]        and the blocks k + 1 ... k + m lose U_k^T U_k,

so that n unknowns which meet up to w = m b apart take some n w^2 (1 + 1 / m) operations and
n (w + b) numbers. A dense matrix is one block.

Of the inverse Z only the entries within the band are made, from the last block to the first
[Takahashi, Fagan and Chin 1973; Erisman and Tinney 1975]: with G_k = R_k^-1 U_k and W the part of Z
of the blocks k + 1 ... k + m, which all meet each other,

    Z_{below k} = -W G_k^T,      Z_k = (R_k^T R_k)^-1 - G_k Z_{below k}.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.linalg import LinAlgError, blas, lapack

from semsfm_colmap.geometry.band_kernels import add_blocks, add_entries, get_blocks
from semsfm_colmap.types import Float, Int

BLOCK = 256
"""Rows of a block in a wider band, about: enough to keep a core busy."""


@dataclass(frozen=True, kw_only=True, eq=False)
class BandLayout:
    """Where each unknown stands: in which row of which block, or in the border."""

    block: Int
    """(n,) number of the block; that of the border is `num_blocks`"""
    row: Int
    """(n,) in its block"""
    size: int
    """b, rows of a block"""
    num_next: int
    """m, how many of the next blocks a block meets"""
    num_blocks: int
    num_border: int

    @property
    def num_rows(self) -> int:
        """Rows of all blocks: with some behind the last unknown that stand for nothing."""
        return self.size * self.num_blocks

    @property
    def width(self) -> int:
        """How far apart unknowns that meet may be, a dense matrix being its own band."""
        return self.size * max(self.num_next, 1)

    @property
    def position(self) -> Int:
        """(n,) row in the blocks one after the other, those of the border behind them."""
        return np.asarray(self.block * self.size + self.row)

    @classmethod
    def dense(cls, n: int) -> BandLayout:
        """One block."""
        return cls(
            block=np.zeros(n, dtype=np.int64),
            row=np.arange(n),
            size=max(n, 1),
            num_next=0,
            num_blocks=1,
            num_border=0,
        )

    @classmethod
    def banded(cls, place: Int, width: int, num_border: int) -> BandLayout:
        """Unknowns at places (n,), those that meet up to `width` apart; the last in the border."""
        num_next = max(round(width / BLOCK), 1)
        size = -(-width // num_next)
        inner = len(place) - num_border
        num_blocks = max(-(-inner // size), 1)
        outside = place >= inner
        return cls(
            block=np.where(outside, num_blocks, place // size),
            row=np.where(outside, place - inner, place % size),
            size=size,
            num_next=num_next,
            num_blocks=num_blocks,
            num_border=num_border,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class BandMatrix:
    """A symmetric matrix (n, n), its lower triangle within a layout."""

    layout: BandLayout
    band: Float
    """(K, (m + 1) b, b), the columns of each block from its diagonal down; of the diagonal block
    only the lower triangle counts"""
    border: Float
    """(e, K b)"""
    corner: Float
    """(e, e), only its lower triangle counts"""

    @classmethod
    def zeros(cls, layout: BandLayout) -> BandMatrix:
        """Nothing yet; rows that stand for no unknown have a one on the diagonal."""
        b, K, e = layout.size, layout.num_blocks, layout.num_border
        band = np.zeros((K, (layout.num_next + 1) * b, b))
        rest = np.arange(len(layout.block) - e - (K - 1) * b, b)
        band[-1, rest, rest] = 1.0
        return cls(layout=layout, band=band, border=np.zeros((e, K * b)), corner=np.zeros((e, e)))

    def _parts(self) -> tuple[Int, Int, Float, Float, Float]:
        return self.layout.block, self.layout.row, self.band, self.border, self.corner

    def add_blocks(self, blocks: Float, first: Int, second: Int, param_idx: Int) -> None:
        """Add blocks (B, p, p) of pairs of images, and their transposes for two different images.

        Parameters
        ----------
        first, second : (B,) images of the rows and columns
        param_idx : (M, p) unknowns of each image; -1 is none

        """
        add_blocks(*self._parts(), blocks, first, second, param_idx)

    def get_blocks(self, first: Int, second: Int, param_idx: Int) -> Float:
        """The entries (B, p, p) of pairs of images; 0 for an unknown -1 and outside the layout."""
        p = param_idx.shape[1]
        out = np.zeros((len(first), p, p))
        get_blocks(*self._parts(), first, second, param_idx, out)
        return out

    def add_products(self, jacobian: sparse.csr_array) -> None:
        """Add ``J^T J`` for a sparse J (k, n), its entries within the layout."""
        product = sparse.coo_array(jacobian.T @ jacobian)
        rows, cols = product.row.astype(np.int64), product.col.astype(np.int64)
        add_entries(*self._parts(), rows, cols, product.data)

    def main_diagonal(self) -> Float:
        """(n,)"""
        inner = np.einsum("kii->ki", self.band[:, : self.layout.size]).ravel()
        return np.concatenate([inner, np.diag(self.corner)])[self.layout.position]

    def toarray(self) -> Float:
        """(n, n), for a look at a small one."""
        one = np.zeros(1, dtype=np.int64)
        return self.get_blocks(one, one, np.arange(len(self.layout.block))[None])[0]

    def factorise(self, damping: Float | None = None) -> BandFactor:
        """Cholesky factor of the matrix, `damping` (n,) added to its diagonal.

        Raises
        ------
        LinAlgError : not positive definite

        """
        layout = self.layout
        b, K, e = layout.size, layout.num_blocks, layout.num_border
        extra = np.zeros(layout.num_rows + e)
        if damping is not None:
            extra[layout.position] = damping
        rest = self.band.copy()
        np.einsum("kii->ki", rest[:, :b])[:] += extra[: layout.num_rows].reshape(K, b)
        factors: list[Float] = []
        links: list[Float] = []
        for k in range(K):
            # the last blocks have fewer next ones
            m = min(layout.num_next, K - 1 - k)
            R, info = lapack.dpotrf(rest[k, :b].T, lower=0, clean=0)
            if info != 0:
                raise LinAlgError(f"block {k} of {K} is not positive definite")
            U = blas.dtrsm(1.0, R, rest[k, b : (m + 1) * b].T, lower=0, trans_a=1)
            for j in range(m):
                own, right = U[:, j * b : (j + 1) * b], U[:, j * b :]
                subtract_product(rest[k + 1 + j, : (m - j) * b], own, right, trans_a=1)
            factors.append(R)
            links.append(U)
        factor = BandFactor(layout=layout, factors=factors, links=links)
        if e > 0:
            Y = factor.solve_rows(self.border.T)
            E = np.tril(self.corner) + np.tril(self.corner, -1).T
            E += np.diag(extra[layout.num_rows :])
            corner = np.asarray(np.linalg.cholesky(E - self.border @ Y), dtype=np.float64)
            factor = BandFactor(
                layout=layout, factors=factors, links=links, border=Y, corner_factor=corner
            )
        return factor


def subtract_product(C: Float, A: Float, B: Float, **transposed: int) -> None:
    """``C^T -= A B`` in place, for C with its rows, A and B with their columns in one piece.

    All products by one library: numpy has another, and the threads of the two would wait for each
    other.
    """
    done = blas.dgemm(-1.0, A, B, beta=1.0, c=C.T, overwrite_c=1, **transposed)
    assert np.shares_memory(done, C)


@dataclass(frozen=True, kw_only=True, eq=False)
class BandFactor:
    """Cholesky factor of a band matrix."""

    layout: BandLayout
    factors: list[Float]
    """R_k (b, b), upper triangle"""
    links: list[Float]
    """U_k (b, m b), the last ones narrower"""
    border: Float | None = None
    """(K b, e) the inverse of the blocks times the border"""
    corner_factor: Float | None = None
    """(e, e) of the border's Schur complement"""

    @property
    def log_determinant(self) -> float:
        """Of the matrix."""
        roots = [np.diagonal(R) for R in self.factors]
        if self.corner_factor is not None:
            roots.append(np.diagonal(self.corner_factor))
        return float(2.0 * np.sum(np.log(np.concatenate(roots))))

    def solve_rows(self, right: Float) -> Float:
        """Solve for the rows of the blocks alone: (K b, r)."""
        b = self.layout.size
        x = np.array(right)
        for k, (R, U) in enumerate(zip(self.factors, self.links, strict=True)):
            here, below = slice(k * b, (k + 1) * b), slice((k + 1) * b, (k + 1) * b + U.shape[1])
            x[here] = blas.dtrsm(1.0, R, x[here], lower=0, trans_a=1)
            x[below] -= U.T @ x[here]
        for k in range(len(self.factors) - 1, -1, -1):
            R, U = self.factors[k], self.links[k]
            here, below = slice(k * b, (k + 1) * b), slice((k + 1) * b, (k + 1) * b + U.shape[1])
            x[here] = blas.dtrsm(1.0, R, x[here] - U @ x[below], lower=0)
        return x

    def solve(self, b: Float) -> Float:
        """Solve for right-hand sides (n,) or (n, r)."""
        layout = self.layout
        columns = b.reshape(len(b), -1)
        placed = np.zeros((layout.num_rows + layout.num_border, columns.shape[1]))
        placed[layout.position] = columns
        inner, outer = placed[: layout.num_rows], placed[layout.num_rows :]
        x = self.solve_rows(inner)
        if self.border is not None:
            assert self.corner_factor is not None
            outer = np.linalg.solve(
                self.corner_factor.T,
                np.linalg.solve(self.corner_factor, outer - self.border.T @ inner),
            )
            x -= self.border @ outer
        return np.asarray(np.concatenate([x, outer])[layout.position].reshape(b.shape))

    def inverse(self) -> BandMatrix:
        """The inverse within the layout; what lies outside the band is not made."""
        layout, b = self.layout, self.layout.size
        Z = BandMatrix.zeros(layout)
        for k in range(layout.num_blocks - 1, -1, -1):
            R, U = self.factors[k], self.links[k]
            upper, info = lapack.dpotri(R, lower=0)
            assert info == 0
            own = np.triu(upper)
            own += np.triu(upper, 1).T
            m = U.shape[1] // b
            if m > 0:
                G = blas.dtrsm(1.0, R, U, lower=0)
                below = Z.band[k, b : (m + 1) * b]
                for j in range(m):
                    # W is symmetric: its columns j from the diagonal down, and its rows j beyond
                    column = Z.band[k + 1 + j, : (m - j) * b]
                    own_G, next_G = G[:, j * b : (j + 1) * b], G[:, (j + 1) * b :]
                    subtract_product(below[j * b :], own_G, column.T)
                    subtract_product(below[j * b : (j + 1) * b], next_G, column[b:].T, trans_b=1)
                # symmetric, so that its transpose may lose it
                subtract_product(own, G, below.T, trans_b=1)
            Z.band[k, :b] = own
        if self.border is not None:
            assert self.corner_factor is not None
            inverse = np.linalg.inv(self.corner_factor)
            Z.corner[:] = inverse.T @ inverse
            Z.border[:] = -Z.corner @ self.border.T
            F = (self.border @ inverse.T).reshape(layout.num_blocks, b, -1)
            for k in range(layout.num_blocks):
                below = F[k : k + layout.num_next + 1].reshape(-1, F.shape[2])
                Z.band[k, : len(below)] += below @ F[k].T
        return Z
