"""The series as a whole: first pass, crops, table, tilts, pixel size, refusals, and series.json."""
