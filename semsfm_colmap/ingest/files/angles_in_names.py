"""Angles in the names of files: ``tilt_-10.tif``, ``tilt_n10.tif``, ``tilt_p05.tif``, ``5deg.tif``.

A dash before a number is a sign only behind a separator or a word for an angle, or where other
names of the series have a plus or nothing in its place: ``grain-001`` is not negative. The letters
n and m stand for minus, p for plus.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import PurePosixPath

_NUMBER = re.compile(
    r"(?P<before>.*?)(?P<sign>[-+]|(?<![a-z])[nmp])?(?P<value>\d{1,3}(?:\.\d+)?)"
    r"(?P<after>\s*(?:deg|degree|degrees|\u00b0)?)",
    re.IGNORECASE,
)
_SEPARATED = re.compile(r"(?:^|[_ =(/])$|(?:tilt|alpha|angle|theta)$", re.IGNORECASE)
MAX_DEG = 360.0


def angles_in_names(names: Sequence[str]) -> list[float] | None:
    """The angle in degrees at the end of each name; None where a name has none.

    >>> angles_in_names(["tilt_-10.tif", "tilt_-5.tif", "tilt_0.tif", "tilt_+5.tif"])
    [-10.0, -5.0, 0.0, 5.0]
    >>> angles_in_names(["s_n10.tif", "s_0.tif", "s_p10.tif"])
    [-10.0, 0.0, 10.0]
    >>> angles_in_names(["grain-001.tif", "grain-002.tif"])
    [1.0, 2.0]
    """
    found = [_NUMBER.fullmatch(_stem(name)) for name in names]
    if not all(found):
        return None
    signs = [(match["sign"] or "").lower() for match in found if match]
    mixed = "+" in signs or "" in signs or "p" in signs
    angles = []
    for match, sign in zip(found, signs, strict=True):
        assert match is not None
        negative = sign in ("n", "m")
        if sign == "-":
            negative = mixed or _SEPARATED.search(match["before"]) is not None
        angles.append(-float(match["value"]) if negative else float(match["value"]))
    return [angle + 0.0 for angle in angles] if max(map(abs, angles)) <= MAX_DEG else None


def signed_order(names: Sequence[str]) -> list[str] | None:
    """Names sorted by their angles where some are negative; None where none is.

    All names must have one beginning, or they are not of one series of angles.
    """
    angles = angles_in_names(names) if names else None
    if angles is None or min(angles) >= 0:
        return None
    beginnings = {_beginning(name) for name in names}
    if len(beginnings) != 1:
        return None
    return [names[k] for k in sorted(range(len(names)), key=lambda k: (angles[k], names[k]))]


def _stem(name: str) -> str:
    return str(PurePosixPath(name).with_suffix(""))


def _beginning(name: str) -> str:
    match = _NUMBER.fullmatch(_stem(name))
    return match["before"] if match else name
