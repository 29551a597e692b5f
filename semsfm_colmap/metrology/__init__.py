"""Measurement on reconstructed surfaces: height maps, filters, areal and profile parameters."""
