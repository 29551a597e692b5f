"""A doubt: what may be wrong in a result, by how much, and what would settle it."""

from __future__ import annotations

from dataclasses import dataclass

WHOLE = 1.0
"""Size of a doubt about the whole model."""
NO_ERROR = 0.001
"""Size of a doubt that makes the model smaller, or leaves it without a unit, not wrong."""


@dataclass(frozen=True, kw_only=True)
class Doubt:
    """What may be wrong, with its evidence, and what to do about it."""

    size: float
    """relative error of lengths, depths or angles that it may stand for; what costs images or
    points but no accuracy has a small one"""
    title: str
    """in a few words, for a line of a terminal"""
    sentence: str
    """with the numbers that it follows from"""
    action: str
    """what would settle it"""
    covers: tuple[str, ...] = ()
    """beginnings of the run's notes that say the same"""
