"""Write the outputs of the stage: each file whole or not at all."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from semsfm_colmap.types import Array

LOSSLESS_SUFFIXES = (".png", ".tif", ".tiff")


def encode_grey8(pixels: Array, suffix: str) -> bytes:
    """(H, W) uint8 as the bytes of a PNG or TIFF file."""
    import io

    buffer = io.BytesIO()
    if suffix.lower() == ".png":
        from PIL import Image

        Image.fromarray(np.ascontiguousarray(pixels), mode=None).save(
            buffer, format="png", compress_level=3
        )
    else:
        import tifffile

        tifffile.imwrite(
            buffer, np.ascontiguousarray(pixels), photometric="minisblack", compression="zlib",
            metadata=None,
        )  # fmt: skip
    return buffer.getvalue()


def remove_stale(root: Path, names: set[str], keep: set[str]) -> None:
    """Delete files an earlier run wrote below `root` that this one did not, and empty folders."""
    for name in sorted(names - keep):
        path = root / name
        if Path(name).is_absolute() or ".." in Path(name).parts:
            continue
        path.unlink(missing_ok=True)
        for parent in path.parents:
            if parent == root or not parent.is_dir() or any(parent.iterdir()):
                break
            parent.rmdir()
