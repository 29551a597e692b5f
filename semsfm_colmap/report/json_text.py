"""JSON that a person can read: one key a line, each row of numbers on one line, no nan."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np


def plain(value: Any) -> Any:
    """Turn arrays, numpy scalars and tuples into what JSON knows; non-finite numbers into None."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def _write(value: Any, indent: int) -> str:
    pad = " " * indent
    if isinstance(value, dict) and value:
        rows = [f"{json.dumps(key)}: {_write(item, indent + 1)}" for key, item in value.items()]
        return "{\n" + ",\n".join(f"{pad} {row}" for row in rows) + f"\n{pad}}}"
    if isinstance(value, list) and any(isinstance(item, dict | list) for item in value):
        rows = [
            _write(item, indent + 1) if isinstance(item, list) else json.dumps(item)
            for item in value
        ]
        return "[\n" + ",\n".join(f"{pad} {row}" for row in rows) + f"\n{pad}]"
    return json.dumps(value, allow_nan=False)


def to_json(value: Any) -> str:
    """The text of metrics.json: rows of numbers and the entries of tables take one line each."""
    return _write(plain(value), 0) + "\n"
