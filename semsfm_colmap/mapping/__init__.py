"""Observations to reconstructions: factorization, refinement, guided pass, hand, world. Pure."""
