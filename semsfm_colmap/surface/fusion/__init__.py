"""Depth maps to one cloud: what they agree on."""
