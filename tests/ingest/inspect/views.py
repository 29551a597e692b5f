"""Views of a rough surface under parallel projection, and what an inspection says of them."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from semsfm_colmap.ingest.inspect.inspection import Inspection
from semsfm_colmap.ingest.options import IngestOptions
from tests.ingest.images import save

OPTIONS = IngestOptions()


HEIGHT, WIDTH = 300, 380


SURFACE = cv2.GaussianBlur(
    np.random.default_rng(3).normal(size=(HEIGHT, WIDTH)).astype(np.float32), (0, 0), 20
)
SURFACE *= 25 / SURFACE.std()


ALBEDO = sum(
    cv2.GaussianBlur(
        np.random.default_rng(10 + k).normal(size=(HEIGHT, WIDTH)).astype(np.float32), (0, 0), s
    ) * s * w
    for k, (s, w) in enumerate([(1.2, 60), (2.5, 60), (5, 60)])
) + 120  # fmt: skip


TILTS = [-12, -8, -4, 0, 4, 8, 12]


def view(angle_deg: float, seed: int = 0, *, depth: float = 1.0) -> np.ndarray:
    """A rough surface seen under parallel projection after a tilt about the y axis."""
    rows, columns = np.indices((HEIGHT, WIDTH), dtype=np.float32)
    angle = np.radians(angle_deg)
    x = (columns - WIDTH / 2) / np.cos(angle) - np.tan(angle) * SURFACE * depth + WIDTH / 2
    seen = cv2.remap(
        ALBEDO, x.astype(np.float32), rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT
    )
    noise = np.random.default_rng(seed).normal(0, 5, size=seen.shape)
    return np.clip(np.rint(seen + noise), 0, 255).astype(np.uint8)


def write_series(folder: Path, images: list[np.ndarray]) -> None:
    for i, image in enumerate(images):
        save(folder / f"{i}.png", image)


def answer(inspection: Inspection, question: str) -> str:
    (found,) = (a.answer for a in inspection.answers if a.question == question)
    return found


def warned(inspection: Inspection, word: str) -> list[str]:
    return [row.name for row in inspection.rows if any(word in w for w in row.warnings)]
