"""MRC stacks written byte by byte after the published description of MRC2014."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tests.ingest.images import texture

MODES = {"i1": 0, "u1": 0, "i2": 1, "f4": 2, "u2": 6}


def write_stack(
    path: Path,
    images: Sequence[np.ndarray],
    *,
    pixel_angstrom: float = 250.0,
    extended: bytes = b"",
    imod_flags: int | None = None,
    order: str = "<",
) -> Path:
    """Images whose first row is the highest, stored lowest row first."""
    data = np.stack([image[::-1] for image in images])
    count, height, width = data.shape
    header = bytearray(1024)
    struct.pack_into(f"{order}4i", header, 0, width, height, count, MODES[data.dtype.str[1:]])
    struct.pack_into(f"{order}3i", header, 28, width, height, count)
    cell = [pixel_angstrom * n for n in (width, height, count)]
    struct.pack_into(f"{order}6f", header, 40, *cell, 90.0, 90.0, 90.0)
    struct.pack_into(f"{order}3i", header, 64, 1, 2, 3)
    struct.pack_into(f"{order}3f", header, 76, data.min(), data.max(), data.mean())
    struct.pack_into(f"{order}i", header, 92, len(extended))
    if imod_flags is not None:
        struct.pack_into(f"{order}2i", header, 152, 1146047817, imod_flags)
    header[208:212] = b"MAP "
    header[212:216] = bytes((0x44, 0x44, 0, 0) if order == "<" else (0x11, 0x11, 0, 0))
    stored = data.astype(data.dtype.newbyteorder(order)).tobytes()
    path.write_bytes(bytes(header) + extended + stored)
    return path


def textures(count: int = 4) -> list[np.ndarray]:
    """8-bit images that differ."""
    return [texture(seed) for seed in range(count)]


def write_mdoc(path: Path, tilts_deg: Sequence[float], general: str = "") -> Path:
    """As SerialEM writes it: global lines, then a block an image."""
    blocks = [f"[ZValue = {k}]\nTiltAngle = {tilt}\n" for k, tilt in enumerate(tilts_deg)]
    path.write_text(general + "\n" + "\n".join(blocks), encoding="utf-8")
    return path
