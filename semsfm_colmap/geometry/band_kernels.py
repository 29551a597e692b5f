"""Compiled loops over the entries of a matrix in a band (see `band`).

`block` and `row` (n,) say where an unknown stands; band (K, (m + 1) b, b), border (e, K b) and
corner (e, e) are the parts of a `BandMatrix`.
"""

from __future__ import annotations

import numba

from semsfm_colmap.types import Float, Int


@numba.njit(cache=True)
def add_entries(
    block: Int,
    row: Int,
    band: Float,
    border: Float,
    corner: Float,
    first: Int,
    second: Int,
    values: Float,
) -> None:
    """Add entries whose transposes come too: those above the diagonal are left out."""
    K, b = band.shape[0], band.shape[2]
    for e in range(len(values)):
        k, c = block[first[e]], block[second[e]]
        i, j = row[first[e]], row[second[e]]
        if k < c or (k == c and i < j):
            continue
        if k < K:
            band[c, (k - c) * b + i, j] += values[e]
        elif c < K:
            border[i, c * b + j] += values[e]
        else:
            corner[i, j] += values[e]


@numba.njit(cache=True)
def add_blocks(
    block: Int,
    row: Int,
    band: Float,
    border: Float,
    corner: Float,
    blocks: Float,
    first: Int,
    second: Int,
    param_idx: Int,
) -> None:
    """Add blocks (B, p, p) of pairs of images, and the transposes of those of two images."""
    K, b = band.shape[0], band.shape[2]
    p = param_idx.shape[1]
    for e in range(len(first)):
        own = first[e] == second[e]
        for x in range(p):
            u = param_idx[first[e], x]
            if u < 0:
                continue
            for y in range(p):
                v = param_idx[second[e], y]
                if v < 0:
                    continue
                value = blocks[e, x, y]
                k, i, c, j = block[u], row[u], block[v], row[v]
                if k < c or (k == c and i < j):
                    if own:
                        # the other triangle of it is there as well
                        continue
                    k, i, c, j = c, j, k, i
                elif u == v and not own:
                    # one unknown of both images: the block and its transpose
                    value *= 2.0
                # written out: handing the arrays to a function takes five times as long
                if k < K:
                    band[c, (k - c) * b + i, j] += value
                elif c < K:
                    border[i, c * b + j] += value
                else:
                    corner[i, j] += value


@numba.njit(cache=True)
def get_blocks(
    block: Int,
    row: Int,
    band: Float,
    border: Float,
    corner: Float,
    first: Int,
    second: Int,
    param_idx: Int,
    out: Float,
) -> None:
    """Read blocks (B, p, p) of pairs of images; what lies outside the band is left as it is."""
    K, rows, b = band.shape
    p = param_idx.shape[1]
    for e in range(len(first)):
        for x in range(p):
            u = param_idx[first[e], x]
            for y in range(p):
                v = param_idx[second[e], y]
                if u < 0 or v < 0:
                    continue
                k, i, c, j = block[u], row[u], block[v], row[v]
                if k < c or (k == c and i < j):
                    k, i, c, j = c, j, k, i
                if k < K:
                    if (k - c) * b < rows:
                        out[e, x, y] = band[c, (k - c) * b + i, j]
                elif c < K:
                    out[e, x, y] = border[i, c * b + j]
                else:
                    out[e, x, y] = corner[i, j]
