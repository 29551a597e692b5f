"""The comparison of detectors and descriptors: counts, overlap, precision, repeatability."""
