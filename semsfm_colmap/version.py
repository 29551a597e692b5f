"""The version, here once: the package says it, and hatch reads it."""

__version__ = "0.1.0"
