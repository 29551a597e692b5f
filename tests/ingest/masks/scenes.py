"""Drawn scenes for masks: a disc on an empty background, and before a scene that stands still."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

from tests.ingest.images import texture

ROWS, COLUMNS = np.indices((240, 300))


def disc(column: float = 150.0, radius: float = 70.0) -> np.ndarray:
    return (ROWS - 120.0) ** 2 + (COLUMNS - column) ** 2 < radius**2


def on_empty(seed: int, *, level: float = 25.0, column: float = 150.0) -> np.ndarray:
    """A textured disc on a background of noise."""
    rng = np.random.default_rng(seed + 1000)
    noise = rng.normal(level, 3.0, size=(240, 300))
    image = np.where(disc(column), texture(seed, 240, 300), noise)
    return np.clip(image, 0, 255).astype(np.uint8)


def turning(i: int, count: int = 12) -> np.ndarray:
    """A disc whose texture moves across it, as the face of a turning body does."""
    wide = texture(5, 240, 300 + 20 * count)
    return wide[:, 20 * i : 20 * i + 300]


def before_static(i: int, *, moves: bool = True) -> np.ndarray:
    rng = np.random.default_rng(i)
    scene = texture(99, 240, 300).astype(float)
    specimen = turning(i if moves else 0).astype(float)
    image = np.where(disc(), specimen, scene) + rng.normal(0, 4, size=(240, 300))
    return np.clip(image, 0, 255).astype(np.uint8)


def read_mask(path: Path) -> np.ndarray:
    return np.asarray(Image.open(path)) > 0
