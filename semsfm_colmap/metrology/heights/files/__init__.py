"""Height maps in the files of other programs, one module a format.

Each has `write(height_map, path)` and `read(path)`. X3P and SDF hold metres in a right-handed
system, rows along y; GSF, Gwyddion and TIFF are pictures whose first row is at the top, so that
rows are turned over. A map in px stays one in px: X3P and SDF, which know metres alone, refuse it.
"""
