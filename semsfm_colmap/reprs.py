"""What objects say of themselves at a prompt: one screen, whatever they hold."""

from __future__ import annotations

from dataclasses import MISSING, Field, fields, is_dataclass
from typing import Any

MAX_TEXT = 80
"""Characters of a value; a longer one is cut."""
MAX_ITEM = 24
FEW = 3
"""Items of a list that are shown."""


def outline(value: Any) -> str:
    """An object of arrays, a line a field: kinds and shapes of arrays, what is None left out.

    Examples
    --------
    >>> import numpy as np
    >>> from semsfm_colmap.types import AffineModel
    >>> AffineModel(A=np.zeros((4, 2, 3)), t=np.zeros((4, 2)), X=np.zeros((90, 3)))
    AffineModel(
      A: float64 (4, 2, 3)
      t: float64 (4, 2)
      X: float64 (90, 3)
    )

    """
    lines = [f"{type(value).__name__}("]
    for one in fields(value):
        held = getattr(value, one.name)
        if held is not None and one.repr:
            lines += f"{one.name}: {_short(held)}".splitlines()
    return "\n  ".join(lines) + "\n)"


def changed(options: Any) -> str:
    """Options by what is not at its default, as Python would make them again."""
    told = [
        f"{one.name}={value!r}"
        for one in fields(options)
        if (value := getattr(options, one.name)) != _default(one)
    ]
    return f"{type(options).__name__}({', '.join(told)})"


def _default(one: Field[Any]) -> Any:
    if one.default_factory is not MISSING:
        return one.default_factory()
    return one.default


def _short(value: Any) -> str:
    if hasattr(value, "dtype") and hasattr(value, "shape"):
        return f"{value.dtype} {value.shape}"
    if isinstance(value, (tuple, list)) and len(value) > FEW:
        kinds = (type(v).__name__ if is_dataclass(v) else repr(v) for v in value[:FEW])
        return f"{len(value)} of them: {', '.join(_cut(kind, MAX_ITEM) for kind in kinds)}, ..."
    said = repr(value)
    return said if is_dataclass(value) and "\n" in said else _cut(said, MAX_TEXT)


def _cut(text: str, size: int) -> str:
    return text if len(text) <= size else f"{text[: size - 3]}..."
