"""Region detectors, descriptors and the registry of both."""
