"""Text files that microscopes write beside the image: which there are, and whose."""

from __future__ import annotations

import os
import stat
from functools import lru_cache
from pathlib import Path

from semsfm_colmap.ingest.files.header import ImageHeader
from semsfm_colmap.ingest.metadata import hitachi, jeol, tescan
from semsfm_colmap.ingest.metadata.reading import MetadataReading
from semsfm_colmap.ingest.metadata.text import decode, read_sections

MAX_SIDECAR_BYTES = 1 << 20
"""Real ones have 1 to 20 kB."""


def sidecar_paths(path: Path) -> list[Path]:
    """Candidates beside ``a.tif``: ``a.txt``, ``a.hdr``, ``a-tif.hdr``, ``a.tif.txt``, any case."""
    kind = path.suffix.lstrip(".")
    names = [f"{path.stem}{suffix}" for suffix in (".hdr", f"-{kind}.hdr", ".txt", f".{kind}.txt")]
    try:
        changed = path.parent.stat().st_mtime_ns
    except OSError:
        return []
    there = _names_below(path.parent, changed)
    return [path.with_name(name) for wanted in names for name in there.get(wanted.lower(), ())]


@lru_cache(maxsize=4)
def _names_below(folder: Path, _changed: int) -> dict[str, list[str]]:
    """The text files in a folder by their names in lower case: not all systems tell cases apart."""
    found: dict[str, list[str]] = {}
    try:
        for name in sorted(os.listdir(folder)):
            if name.lower().endswith((".hdr", ".txt")):
                found.setdefault(name.lower(), []).append(name)
    except OSError:
        return {}
    return found


def read_sidecar(path: Path, header: ImageHeader) -> MetadataReading | None:
    """Metadata from the first file beside the image that a microscope wrote, or None."""
    for candidate in sidecar_paths(path):
        raw = _read_bounded(candidate)
        if raw is None:
            continue
        text = decode(raw)
        sections = read_sections(text)
        if hitachi.SECTION in sections:
            return hitachi.read(sections, candidate.name, header)
        if "MAIN" in sections and ("SEM" in sections or "PixelSizeX" in sections["MAIN"]):
            return tescan.read(sections, candidate.name, header)
        values = jeol.parse(text)
        if values:
            return jeol.read(values, candidate.name, header)
    return None


def _read_bounded(path: Path) -> bytes | None:
    """The first bytes of a regular file; None for anything else (a pipe would block)."""
    try:
        if not stat.S_ISREG(os.stat(path).st_mode):
            return None
        with path.open("rb") as file:
            return file.read(MAX_SIDECAR_BYTES)
    except (OSError, ValueError):
        return None
