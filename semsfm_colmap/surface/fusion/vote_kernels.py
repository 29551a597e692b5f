"""Compiled kernel of the fusion: what the other depth maps say about each pixel of one."""

from __future__ import annotations

import math

import numba

from semsfm_colmap.types import Array


@numba.njit(nogil=True, cache=True)
def add_votes(
    depth: Array,
    normals: Array,
    other_depth: Array,
    other_confidence: Array,
    B: Array,
    c: Array,
    e: Array,
    z_from: Array,
    toward: Array,
    tolerance: float,
    free_tolerance: float,
    max_jump: float,
    agreeing: Array,
    contradicting: Array,
    sums: Array,
    best_cosine: Array,
) -> None:
    """Compare one depth map with another and add up, in place.

    Pixel p with depth z lies in the other map at ``B p + z c + e`` with the other's depth
    ``z_from . (p, z, 1)``. What lies between the two surfaces along the other's ray, times the
    cosine to the normal, is the distance delta of the surfaces: positive when the other's is
    farther out. Within `tolerance` they agree; a point more than `free_tolerance` in front of the
    other's surface hides what the other saw, and is contradicted; behind it, the other just could
    not see it.

    Parameters
    ----------
    depth : (H, W) float32
    normals : (3, H, W) float32 in the camera frame, toward the viewer
    other_depth, other_confidence : (H', W') float32
    B, c, e : (2, 2), (2,), (2,)
    z_from : (4,)
    toward : (3,) the other's viewing direction in this camera's frame
    tolerance, free_tolerance, max_jump : world units; depths that differ by more than `max_jump`
        are not interpolated
    agreeing, contradicting : (H, W) uint8
    sums : (3, H, W) float32: weights w, w delta, w delta^2 of the agreeing maps
    best_cosine : (H, W) float32, how frontal the most frontal agreeing map sees the surface

    """
    H, W = depth.shape
    Ho, Wo = other_depth.shape
    for y in range(H):
        for x in range(W):
            z = depth[y, x]
            if not math.isfinite(z):
                continue
            cosine = -(
                normals[0, y, x] * toward[0]
                + normals[1, y, x] * toward[1]
                + normals[2, y, x] * toward[2]
            )
            if cosine < 0.15:  # the other sees it edge-on or from behind
                continue
            px, py = x + 0.5, y + 0.5
            u = B[0, 0] * px + B[0, 1] * py + c[0] * z + e[0] - 0.5
            v = B[1, 0] * px + B[1, 1] * py + c[1] * z + e[1] - 0.5
            if not (0.0 <= u < Wo - 1 and 0.0 <= v < Ho - 1):
                continue
            iu, iv = int(u), int(v)
            fu, fv = u - iu, v - iv
            low, high = math.inf, -math.inf
            complete = True
            for dy in range(2):
                for dx in range(2):
                    value = other_depth[iv + dy, iu + dx]
                    complete = complete and math.isfinite(value)
                    low, high = min(low, value), max(high, value)
            if complete and high - low < max_jump:
                there = (
                    (1 - fu) * (1 - fv) * other_depth[iv, iu]
                    + fu * (1 - fv) * other_depth[iv, iu + 1]
                    + (1 - fu) * fv * other_depth[iv + 1, iu]
                    + fu * fv * other_depth[iv + 1, iu + 1]
                )
            else:
                there = other_depth[int(v + 0.5), int(u + 0.5)]
            if not math.isfinite(there):
                continue
            delta = (z_from[0] * px + z_from[1] * py + z_from[2] * z + z_from[3] - there) * cosine
            if abs(delta) < tolerance:
                w = other_confidence[int(v + 0.5), int(u + 0.5)] * cosine
                agreeing[y, x] += 1
                sums[0, y, x] += w
                sums[1, y, x] += w * delta
                sums[2, y, x] += w * delta * delta
                best_cosine[y, x] = max(best_cosine[y, x], cosine)
            elif delta < -free_tolerance:
                contradicting[y, x] += 1
