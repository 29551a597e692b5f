"""Write the outputs of the stage: each file whole or not at all."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

import numpy as np

from semsfm_colmap.errors import UsageError
from semsfm_colmap.types import Array

LOSSLESS_SUFFIXES = (".png", ".tif", ".tiff")


def write_atomic(path: Path, content: bytes) -> None:
    """Write aside and rename, so that an interrupted run leaves no half file."""
    aside = path.with_name(f".{path.name[:200]}.{os.getpid()}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        aside.write_bytes(content)
        os.replace(aside, path)
    except OSError as error:
        with suppress(OSError):
            aside.unlink(missing_ok=True)
        raise UsageError(
            f"{path} cannot be written ({error.strerror}); check the output folder."
        ) from error
    except BaseException:
        aside.unlink(missing_ok=True)
        raise


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
