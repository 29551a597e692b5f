"""The world that cuts are coordinates of, and the way from it to that of another model.

A model that is mapped again may be turned, shifted, scaled or depth-reversed. Images that both
models have show the same pixels, so that with the affine cameras ``u = P_i x + t_i`` of the one and
``u = P'_i x' + t'_i`` of the other

    P_i x + t_i = P'_i (k Q x + c) + t'_i     for all x:     P_i = k P'_i Q,   t_i - t'_i = P'_i c.

With the P stacked to A, the P' to B, both (2 M, 3), ``U S V^T = B^T A`` gives the orthogonal
``Q = U V^T`` and ``k = tr S / |B|^2`` (Procrustes), a reflection where the hand has changed; c is
the least-squares solution. Two numbers tell whether this is one world: ``|k B Q - A| / |A|``, by
which a point is off as a share of its distance from the middle, and the rest of the shifts as a
share of the image.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from semsfm_colmap.geometry.alignment import Similarity
from semsfm_colmap.geometry.subset import spread_over
from semsfm_colmap.types import Float, Int, OrthographicCameras, Solution

NUM_IMAGES = 8
"""Images, spread over the series, that stand for a world."""
MAX_MISFIT = 0.02
"""Of both numbers: a cut by hand is hardly more exact."""
MIN_DEPTH = 0.02
"""Least singular value of B over the largest one: directions of view that differ by less leave the
depth open."""


@dataclass(frozen=True, kw_only=True)
class WorldCamera:
    """The affine camera of an image."""

    image: str
    camera: tuple[float, ...]
    """P row by row, then t: 8 numbers"""


World = tuple[WorldCamera, ...]
"""Some cameras, which say in which coordinates a cut was made; empty: nobody knows."""


def world_of(names: Sequence[str], cameras: OrthographicCameras) -> World:
    """The world of a model."""
    rows = spread_over(len(names), NUM_IMAGES)
    return tuple(
        WorldCamera(
            image=names[i],
            camera=(
                *cameras.projection[i].reshape(-1).tolist(),
                *cameras.translation_px[i].tolist(),
            ),
        )
        for i in rows.tolist()
    )


def carry(
    world: World, names: Sequence[str], cameras: OrthographicCameras, image_size_px: Int
) -> Solution[Similarity]:
    """The similarity from a world to that of a model; ``message`` says how well it fits.

    Parameters
    ----------
    world : of the cut
    names, cameras, image_size_px : of the model, M images

    """
    number = {name: i for i, name in enumerate(names)}
    both = [known for known in world if known.image in number]
    rows = np.array([number[known.image] for known in both], dtype=np.int64)
    old = np.array([known.camera for known in both]).reshape(-1, 8)
    A, B = old[:, :6].reshape(-1, 3), cameras.projection[rows].reshape(-1, 3)
    spread = np.linalg.svd(B, compute_uv=False) if len(both) > 1 else np.zeros(3)
    if spread[2] <= MIN_DEPTH * spread[0]:
        return Solution(
            value=None,
            status="too few images",
            message=f"{len(both)} of its {len(world)} images are in the model, too few to tell",
        )
    U, S, Vt = np.linalg.svd(B.T @ A)
    Q, k = U @ Vt, float(S.sum() / np.sum(B**2))
    wanted = (old[:, 6:] - cameras.translation_px[rows]).reshape(-1)
    c = np.asarray(np.linalg.lstsq(B, wanted, rcond=None)[0], dtype=np.float64)
    turned = float(np.linalg.norm(k * B @ Q - A) / np.linalg.norm(A))
    shifted = _rms((B @ c - wanted) / np.repeat(image_size_px[rows].max(axis=1), 2))
    said = (
        f"the cameras of {len(both)} images agree to {100 * turned:.2g} % of the specimen and "
        f"{100 * shifted:.2g} % of the image"
    )
    if max(turned, shifted) > MAX_MISFIT:
        return Solution(value=None, status="another world", message=said)
    return Solution(value=Similarity(rotation=Q, scale=k, shift=c), message=said)


def _rms(values: Float) -> float:
    return float(np.sqrt(np.mean(values**2)))
