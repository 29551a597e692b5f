"""Compiled walks over who sees what (see `blocks`); observations are sorted by track."""

from __future__ import annotations

import numba
import numpy as np

from semsfm_colmap.types import Float, Int


@numba.njit(cache=True)
def count_common(pointer: Int, image_idx: Int, common: Int) -> None:
    """Count the tracks that two images share: (M, M)."""
    for j in range(len(pointer) - 1):
        for a in range(pointer[j], pointer[j + 1]):
            for b in range(pointer[j], a):
                common[image_idx[a], image_idx[b]] += 1
                common[image_idx[b], image_idx[a]] += 1


@numba.njit(cache=True)
def grow(
    pointer: Int,
    image_idx: Int,
    image_pointer: Int,
    tracks: Int,
    first: int,
    second: int,
    size: int,
    min_tracks: int,
    images: Int,
) -> tuple[Int, Int, int]:
    """Grow a pair of images by the image that keeps the most common tracks, one by one.

    Returns
    -------
    the tracks of the pair, up to how many of `images` each is seen in all, how many images

    """
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


@numba.njit(cache=True)
def gather(pointer: Int, image_idx: Int, xy: Float, images: Int, tracks: Int, M: Float) -> None:
    """The measurements of some images (ascending) and tracks into M (2 m, n)."""
    for k in range(len(tracks)):
        for o in range(pointer[tracks[k]], pointer[tracks[k] + 1]):
            row = np.searchsorted(images, image_idx[o])
            if row < len(images) and images[row] == image_idx[o]:
                M[2 * row, k] = xy[o, 0]
                M[2 * row + 1, k] = xy[o, 1]


@numba.njit(cache=True)
def count_triples(
    begin: int, end: int, pointer: Int, image_idx: Int, tracks: Int, local: Int, count: Int
) -> None:
    """Tracks of one image that two of its neighbours see as well, by the neighbours' numbers."""
    for k in range(begin, end):
        j = tracks[k]
        for a in range(pointer[j], pointer[j + 1]):
            m = local[image_idx[a]]
            if m >= 0:
                for b in range(pointer[j], a):
                    n = local[image_idx[b]]
                    if n >= 0:
                        count[m, n] += 1
                        count[n, m] += 1


@numba.njit(cache=True)
def in_both(a: Int, b: Int) -> Int:
    """What two ascending lists have in common."""
    found = np.empty(min(len(a), len(b)), dtype=np.int64)
    n, i, j = 0, 0, 0
    while i < len(a) and j < len(b):
        if a[i] < b[j]:
            i += 1
        elif a[i] > b[j]:
            j += 1
        else:
            found[n] = a[i]
            n, i, j = n + 1, i + 1, j + 1
    return found[:n]
