"""MRC stacks of tilt series: one file with all images, each a section under a name of its own.

MRC2014 (Cheng et al., J. Struct. Biol. 192 (2015) 146-150): a header of 1024 bytes, an extended one
of `nsymbt` bytes, then `nz` sections of `ny` rows, the lowest row first: y points up. An image here
begins with its highest row, so sections are turned upside down as they are read; without that,
images would be mirrored, and the specimen with them.

A section is addressed as a file in a folder of the stack's name, ``tilts.st/tilts_0001.mrc``: what
reads files reads sections.
"""

from __future__ import annotations

import io
import os
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from semsfm_colmap.errors import InputError
from semsfm_colmap.ingest.files.header import ImageHeader, UnreadableImageError
from semsfm_colmap.types import Array

STACK_SUFFIXES = (".mrc", ".mrcs", ".st", ".ali", ".preali")
ANGLES_SUFFIX = ".rawtlt"
NOTES_SUFFIX = ".mdoc"
HEADER_BYTES = 1024
EXTENDED_BYTES = slice(92, 96)
"""Where the header says how long the extended one is."""
IMOD_STAMP = 1146047817
"""In bytes 153 to 156 of what IMOD writes; bit 1 of the next four then says that bytes are
signed."""
MODES = {0: 1, 1: 2, 2: 4, 6: 2, 12: 2}
"""Bytes a pixel of the modes that hold grey values."""
CLEARLY_ROUGHER = 1.3
"""How much larger the steps between pixels are where bytes are read with the wrong sign."""
MAX_UNSET_ANGSTROM = 1.0
"""Programs write 0 or 1 Angstrom where no pixel size is known; no image of a SEM has so small a
one."""


@dataclass(frozen=True, kw_only=True)
class StackHeader:
    """What the header of a stack says."""

    width: int
    height: int
    num_sections: int
    mode: int
    signed_bytes: bool
    says_sign: bool
    """Whether IMOD's flag says so, which is not guessed then"""
    pixel_size_um: float | None
    """None where none is set"""

    @property
    def num_bytes(self) -> int:
        """Of the pixels of all sections."""
        return self.width * self.height * self.num_sections * MODES[self.mode]


def is_stack(path: Path) -> bool:
    """Whether a path is a file that its suffix says to be a stack."""
    return path.suffix.lower() in STACK_SUFFIXES and path.is_file()


def is_section(path: Path) -> bool:
    """Whether a path is the address of a section."""
    return is_stack(path.parent)


def section_names(stack: Path) -> tuple[str, ...]:
    """``tilts_0001.mrc``, ... for the sections of a readable stack."""
    try:
        count = read_stack_header(stack).num_sections
    except UnreadableImageError as error:
        raise InputError(f"{stack}: {error}") from error
    return tuple(f"{stack.stem}_{k + 1:04d}.mrc" for k in range(count))


def section_number(path: Path) -> int:
    """From 0, of the address of a section."""
    return int(path.stem.rpartition("_")[2]) - 1


def companion_files(stack: Path) -> list[Path]:
    """The files beside a stack that say more about it: ``.rawtlt``, ``.st.mdoc``, ``.mdoc``."""
    candidates = [
        stack.with_suffix(ANGLES_SUFFIX),
        stack.with_name(stack.name + NOTES_SUFFIX),
        stack.with_suffix(NOTES_SUFFIX),
    ]
    return [path for path in candidates if path.is_file()]


def read_stack_header(stack: Path) -> StackHeader:
    """Size, kind and pixel size; refused where the file is shorter than they need."""
    try:
        size = os.stat(stack).st_size
        if size < HEADER_BYTES:
            raise UnreadableImageError(
                f"{size} bytes are too few for an MRC file; copy it again from the microscope."
            )
        header, extended_bytes = _header_alone(stack)
        found = _stack_header(header)
        needed = HEADER_BYTES + max(extended_bytes, 0) + found.num_bytes
    except OSError as error:
        raise UnreadableImageError(
            f"cannot be opened ({error.strerror}); check its permissions."
        ) from error
    except ValueError as error:
        raise UnreadableImageError("is not an MRC file, whatever its suffix.") from error
    if size < needed:
        raise UnreadableImageError(
            f"the file has {size} bytes but its header promises {needed} for {found.num_sections} "
            f"images of {found.width} x {found.height} pixels: it is truncated; copy it again."
        )
    return found


def section_header(path: Path) -> ImageHeader:
    """The header of one section."""
    stack = read_stack_header(path.parent)
    return ImageHeader(
        format="mrc",
        width=stack.width,
        height=stack.height,
        bits=8 * MODES[stack.mode],
        channels=1,
        page=section_number(path),
    )


def decode_section(path: Path, header: ImageHeader) -> Array:
    """The pixels (H, W) of a section, highest row first."""
    stack = read_stack_header(path.parent)
    with _opened(path.parent) as file:
        sections = file.data if file.data.ndim == 3 else file.data[None]
        pixels = np.array(sections[header.page][::-1])
        signed = stack.signed_bytes
        if stack.mode == 0 and not stack.says_sign:
            signed = _smoother_sign(np.asarray(sections[len(sections) // 2]), otherwise=signed)
    if stack.mode == 0 and not signed:
        return pixels.view(np.uint8)
    return pixels


def _smoother_sign(pixels: Array, *, otherwise: bool) -> bool:
    """Whether bytes are signed: read the wrong way, grey values wrap round in mid-scale.

    That tears an image apart wherever it crosses the middle; many programs write unsigned bytes
    with the header of signed ones.
    """
    steps = [
        float(np.abs(np.diff(pixels.view(kind).astype(np.int16), axis=1)).mean())
        for kind in (np.int8, np.uint8)
    ]
    if max(steps) < CLEARLY_ROUGHER * min(steps):
        return otherwise
    return steps[0] < steps[1]


def _header_alone(stack: Path) -> tuple[Any, int]:
    """The header, and how long it says the extended one to be.

    mrcfile takes memory for that before it looks how long the file is, so it is told of none.
    """
    from mrcfile.mrcinterpreter import MrcInterpreter

    with stack.open("rb") as file:
        raw = file.read(HEADER_BYTES)
    told = io.BytesIO(raw[: EXTENDED_BYTES.start] + bytes(4) + raw[EXTENDED_BYTES.stop :])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        header = MrcInterpreter(told, permissive=True, header_only=True).header
    return header, int(np.frombuffer(raw[EXTENDED_BYTES], header.nsymbt.dtype)[0])


def _opened(stack: Path) -> Any:
    import mrcfile

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # older files lack marks that the standard asks for
        return mrcfile.mmap(stack, permissive=True)


def _stack_header(header: Any) -> StackHeader:
    width, height, count, mode = (int(header[name]) for name in ("nx", "ny", "nz", "mode"))
    if min(width, height, count) < 1:
        raise UnreadableImageError(
            f"is not an MRC file: its header says {width} x {height} pixels, {count} images."
        )
    if mode not in MODES:
        raise UnreadableImageError(
            f"MRC mode {mode} holds no grey values; save the stack in mode 0, 1, 2, 6 or 12."
        )
    axes = tuple(int(header[name]) for name in ("mapc", "mapr", "maps"))
    if axes not in ((1, 2, 3), (0, 0, 0)):
        raise UnreadableImageError(
            f"its columns, rows and sections lie along the axes {axes} and not (1, 2, 3); "
            "reorder the stack."
        )
    angstrom = float(header.cella.x) / int(header.mx) if int(header.mx) > 0 else 0.0
    known = np.isfinite(angstrom) and angstrom > MAX_UNSET_ANGSTROM
    return StackHeader(
        width=width,
        height=height,
        num_sections=count,
        mode=mode,
        signed_bytes=_signed_bytes(header),
        says_sign=_imod_flags(header) is not None,
        pixel_size_um=angstrom * 1e-4 if known else None,
    )


def _signed_bytes(header: Any) -> bool:
    """Of mode 0: as IMOD's flag says, else unsigned only where the largest value needs it."""
    flags = _imod_flags(header)
    if flags is not None:
        return bool(flags & 1)
    return not (float(header.dmin) >= 0 and float(header.dmax) > np.iinfo(np.int8).max)


def _imod_flags(header: Any) -> int | None:
    """The flags that IMOD writes behind its stamp; None where it wrote none."""
    raw = header.tobytes()
    for order in ("little", "big"):
        if int.from_bytes(raw[152:156], order) == IMOD_STAMP:
            return int.from_bytes(raw[156:160], order)
    return None
