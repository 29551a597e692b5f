"""Region detectors and descriptors, behind one registry (`features.registry`)."""
