"""Structure from motion for scanning electron microscope series (parallel projection)."""

__version__ = "0.1.0"
