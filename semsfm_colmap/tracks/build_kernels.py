"""Compiled union-find over keypoints (see `build`)."""

from __future__ import annotations

import numba
import numpy as np

from semsfm_colmap.types import Int


@numba.njit(cache=True)
def find(parent: Int, k: int) -> int:
    """The root of a node; paths are halved on the way."""
    while parent[k] != k:
        parent[k] = parent[parent[k]]
        k = parent[k]
    return k


@numba.njit(cache=True)
def join(first: Int, second: Int, image: Int, parent: Int, num_images: int) -> int:
    """Join the nodes of each match, unless their tracks see an image in common: how many do.

    Members of a track form a ring, so two tracks are compared cheaply.
    """
    n = len(parent)
    ring = np.arange(n)
    size = np.ones(n, dtype=np.int64)
    mark = np.full(num_images, -1, dtype=np.int64)
    refused = 0
    for e in range(len(first)):
        a, b = find(parent, first[e]), find(parent, second[e])
        if a == b:
            continue
        if size[a] < size[b]:
            a, b = b, a
        # images of the smaller track are looked up among those of the larger
        k = a
        while True:
            mark[image[k]] = e
            k = ring[k]
            if k == a:
                break
        clash = False
        k = b
        while True:
            if mark[image[k]] == e:
                clash = True
                break
            k = ring[k]
            if k == b:
                break
        if clash:
            refused += 1
            continue
        parent[b] = a
        size[a] += size[b]
        ring[a], ring[b] = ring[b], ring[a]
    return refused


@numba.njit(cache=True)
def roots(parent: Int) -> Int:
    """The root of every node."""
    root = np.empty_like(parent)
    for k in range(len(parent)):
        root[k] = find(parent, k)
    return root
