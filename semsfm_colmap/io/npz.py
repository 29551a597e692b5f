"""What numpy raises on a damaged .npz: the zip, its compression, the header of an array."""

from __future__ import annotations

import zlib
from tokenize import TokenError
from zipfile import BadZipFile

UNREADABLE = (
    OSError, ValueError, KeyError, EOFError, MemoryError, OverflowError, SyntaxError, TypeError,
    NotImplementedError, RuntimeError, TokenError, BadZipFile, zlib.error,
)  # fmt: skip
