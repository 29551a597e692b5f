"""Named arrays and a header in one run of bytes, as the viewer's script reads them.

``SEMSFM3D``, the length of the header as uint32, the header as JSON in UTF-8, then the arrays,
little-endian, each at a multiple of 8 bytes from the end of the header. The header's ``arrays``
holds the type, shape and place of each.
"""

from __future__ import annotations

import base64
import gzip
import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from semsfm_colmap.errors import InputError
from semsfm_colmap.types import Array

MAGIC = b"SEMSFM3D"
ALIGNMENT = 8
TYPES = ("u1", "i1", "u2", "i2", "u4", "i4", "f4")
"""What the script has typed arrays for."""


def pack(header: Mapping[str, Any], arrays: Mapping[str, Array]) -> bytes:
    """The module's bytes.

    Raises
    ------
    ValueError
        An array is of a type that the script does not read.

    """
    table, parts, place = {}, [], 0
    for name, values in arrays.items():
        kind = values.dtype.str[1:]
        if kind not in TYPES:
            raise ValueError(f"{name} is {values.dtype} but expected one of {', '.join(TYPES)}")
        raw = np.ascontiguousarray(values, dtype=f"<{kind}").tobytes()
        table[name] = {"type": kind, "shape": list(values.shape), "at": place}
        gap = -len(raw) % ALIGNMENT
        parts += [raw, bytes(gap)]
        place += len(raw) + gap
    text = json.dumps({**header, "arrays": table}, allow_nan=False, separators=(",", ":"))
    head = text.encode("utf-8")
    head += b" " * (-(len(MAGIC) + 4 + len(head)) % ALIGNMENT)
    return b"".join([MAGIC, len(head).to_bytes(4, "little"), head, *parts])


def unpack(data: bytes) -> tuple[dict[str, Any], dict[str, Array]]:
    """Header and arrays again.

    Raises
    ------
    InputError
        These are not the module's bytes, or not all of them.

    """
    start = len(MAGIC) + 4
    size = int.from_bytes(data[len(MAGIC) : start], "little")
    if data[: len(MAGIC)] != MAGIC or len(data) < start + size:
        raise InputError("these bytes are no packed scene, or cut short: make it again")
    header = json.loads(data[start : start + size])
    body, arrays = data[start + size :], {}
    for name, entry in header.pop("arrays").items():
        count = int(np.prod(entry["shape"], dtype=np.int64))
        kind = np.dtype(f"<{entry['type']}")
        if len(body) < entry["at"] + count * kind.itemsize:
            raise InputError("the packed scene is cut short: make it again")
        values = np.frombuffer(body, dtype=kind, count=count, offset=entry["at"])
        arrays[name] = values.reshape(entry["shape"])
    return header, arrays


def as_text(data: bytes) -> str:
    """Compressed and in base64, for a page; the same bytes always give the same text."""
    return base64.b64encode(gzip.compress(data, compresslevel=9, mtime=0)).decode("ascii")


def from_text(text: str) -> bytes:
    """The bytes of `as_text`."""
    return gzip.decompress(base64.b64decode(text))
