"""A grid that fills with weighted points and keeps the mean of those that fall into a cell."""

from __future__ import annotations

import numpy as np

from semsfm_colmap.errors import InputError
from semsfm_colmap.types import Float, PointCloud

_MERGE_ROWS = 2_000_000
"""Points gathered before they are merged into the grid: some 200 MB."""


class CloudGrid:
    """Weighted sums of the rows that fall into each cell."""

    def __init__(self, size: float) -> None:
        self.size = size
        self._waiting: list[Float] = []
        self._num_waiting = 0
        self._key = np.zeros(0, dtype=np.int64)
        self._sums = np.zeros((0, 9))

    def add(self, rows: Float) -> None:
        """Add rows (weight, position, normal, grey, variance)."""
        self._waiting.append(np.column_stack([rows[:, :1], rows[:, 1:] * rows[:, :1]]))
        self._num_waiting += len(rows)
        if self._num_waiting > _MERGE_ROWS:
            self._merge()

    def _merge(self) -> None:
        rows = np.concatenate(self._waiting)
        cell = np.floor(rows[:, 1:4] / rows[:, :1] / self.size).astype(np.int64) + (1 << 20)
        if len(cell) and (cell.min() < 0 or cell.max() >= 1 << 21):
            raise InputError("The depth maps spread too far: the cameras do not fit together.")
        key = (cell[:, 0] << 42) | (cell[:, 1] << 21) | cell[:, 2]
        key = np.concatenate([self._key, key])
        rows = np.concatenate([self._sums, rows])
        self._key, inverse = np.unique(key, return_inverse=True)
        self._sums = np.stack(
            [np.bincount(inverse, weights=column, minlength=len(self._key)) for column in rows.T],
            axis=1,
        )
        self._waiting, self._num_waiting = [], 0

    def cloud(self) -> tuple[PointCloud, Float]:
        """The weighted mean of each cell, and its weight."""
        if self._waiting:
            self._merge()
        mean = self._sums[:, 1:] / np.maximum(self._sums[:, :1], 1e-300)
        normals = mean[:, 3:6]
        normals = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
        grey = np.clip(np.rint(mean[:, 6:7]), 0, 255).astype(np.uint8)
        cloud = PointCloud(
            points=mean[:, :3],
            normals=normals,
            colors=np.repeat(grey, 3, axis=1),
            sigma=np.sqrt(mean[:, 7]),
        )
        return cloud, self._sums[:, 0]
