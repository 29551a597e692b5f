"""The series as a whole: its table, tilts, pixel size, refusals, and series.json."""
