"""Where to begin bringing two surfaces together: their reliefs correlated in every turn and shift.

Both surfaces are seen along the normals of their mean planes, as coarse height maps. For every turn
of the second one about the normal, the correlation of the heights over the cells that both have,

    ncc(t) = sum F(x) M(x + t) / sqrt(sum F(x)^2 sum M(x + t)^2),

is known for all shifts t at once from Fourier transforms of heights, squares and masks. The best
shifts of the best turns are the starts, with both surfaces as they are given in front of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import fft

from semsfm_colmap.geometry.alignment import Similarity
from semsfm_colmap.geometry.mesh_normals import face_normals
from semsfm_colmap.geometry.rotations import rotation_from_vector
from semsfm_colmap.metrology.heights.height_map import (
    on_grid,
    reference_normal,
    right_handed_axes,
    seen_faces,
)
from semsfm_colmap.types import Array, Float, TriangleMesh

NUM_CELLS = 96
"""Cells along the longer side of the larger surface."""
TURN_STEP_DEG = 5.0
NUM_STARTS = 6
"""Turns that are tried further."""
MIN_OVERLAP = 0.3
"""Least share of the smaller surface that both must have in common."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Relief:
    """A surface over its mean plane."""

    mesh: TriangleMesh
    axes: Float
    """(3, 3) rows e_x, e_y, e_z"""
    centre: Float
    """(3,)"""

    @classmethod
    def of(cls, mesh: TriangleMesh) -> Relief:
        """The surface with the axes of its mean plane."""
        faces = seen_faces(mesh)
        used = mesh.vertices[np.unique(faces)]
        up = reference_normal(used, face_normals(mesh.vertices, faces))
        axes = right_handed_axes(up, np.array([1.0, 0.0, 0.0]))
        return cls(mesh=mesh, axes=axes, centre=used.mean(axis=0))

    @property
    def extent(self) -> float:
        """Longest distance across."""
        used = self.mesh.vertices[np.unique(seen_faces(self.mesh))]
        return 2.0 * float(np.linalg.norm((used - self.centre) @ self.axes[:2].T, axis=1).max())

    def heights(self, axes: Float, step: float, num: int) -> Float:
        """(num, num) heights about the centre, along the given axes, nan where there is none."""
        corner = self.centre - 0.5 * (num - 1) * step * (axes[0] + axes[1])
        return on_grid(self.mesh, "px", corner, axes, (step, step), (num, num)).z


def starts(fixed: TriangleMesh, moving: TriangleMesh) -> list[Similarity]:
    """Similarities that may bring `moving` near `fixed`, the worlds as they are first."""
    base, other = Relief.of(fixed), Relief.of(moving)
    step = max(base.extent, other.extent) / NUM_CELLS
    F = base.heights(base.axes, step, NUM_CELLS)
    found = []
    for deg in np.arange(0.0, 360.0, TURN_STEP_DEG):
        turn = rotation_from_vector(np.array([[0.0, 0.0, np.radians(deg)]]))[0]
        axes = turn @ other.axes
        score, (row, column) = best_shift(F, other.heights(axes, step, NUM_CELLS))
        R = base.axes.T @ axes
        along = step * (column * base.axes[0] + row * base.axes[1])
        shift = base.centre + along - R @ other.centre
        found.append((score, Similarity(rotation=R, scale=1.0, shift=shift)))
    found.sort(key=lambda pair: -pair[0])
    as_given = Similarity(rotation=np.eye(3), scale=1.0, shift=base.centre - other.centre)
    return [as_given, *(motion for _, motion in found[:NUM_STARTS])]


def best_shift(F: Float, M: Float) -> tuple[float, tuple[int, int]]:
    """The largest correlation and the cells, rows and columns, that M is to be moved by for it."""
    shape = [2 * n for n in F.shape]
    masks = [np.isfinite(z) for z in (F, M)]
    heights = [
        np.where(m, z - np.mean(z[m]), 0.0) if m.any() else np.zeros(z.shape)
        for z, m in zip((F, M), masks, strict=True)
    ]
    (f, f2, fm), (m, m2, mm) = (
        tuple(fft.rfft2(a, shape) for a in (z, z * z, there.astype(float)))
        for z, there in zip(heights, masks, strict=True)
    )

    def correlated(a: Array, b: Array) -> Float:
        # at s: sum over x of a(x + s) b(x), b moved by s
        return np.asarray(fft.irfft2(a * np.conj(b), shape))

    overlap = correlated(fm, mm)
    power = correlated(f2, mm) * correlated(fm, m2)
    enough = overlap >= MIN_OVERLAP * min(int(there.sum()) for there in masks)
    score = np.where(enough, correlated(f, m) / np.sqrt(np.maximum(power, 1e-300)), -1.0)
    row, column = np.unravel_index(int(np.argmax(score)), score.shape)
    best = float(score[row, column])
    rows, columns = (
        int(k) - n if k >= n // 2 else int(k) for k, n in zip((row, column), shape, strict=True)
    )
    return best, (rows, columns)
